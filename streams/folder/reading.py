"""Read the files of one source in the background, one at a time."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any

from streams.files.datasets import FileFacts
from streams.files.load import Loader
from streams.files.parse.child import ReaderProcess, use_process
from streams.folder.life import Entry
from streams.folder.raw import Raw, read_raw
from streams.types.limits import LARGE_BYTES, ChildLimits
from streams.types.samples import ReaderError, Samples

Result = Samples | ReaderError | None
"""Of reading a file; None where its bytes are those that are known already."""


def read_file(
    loader: Loader, entry: Entry, facts: FileFacts, growing: str | None, known: str | None
) -> tuple[Raw, Result]:
    """Read and parse a file, in the background; not parsed where its content hash is ``known``.

    Raises:
        ReaderError, UnfinishedError: its bytes cannot be read; see :func:`read_raw`.
    """
    raw = read_raw(loader.root, entry, growing)
    if raw.progress.content_hash == known:
        return raw, None
    try:
        return raw, loader.load_undated(raw.data, entry.path, facts, entry.key)
    except ReaderError as error:
        return raw, error


@dataclass(frozen=True, eq=False)
class Task:
    """Work in the background on a file, or on several; ``future`` has its result."""

    future: Future[Any]
    work: Callable[[], Any]
    keys: tuple[str, ...]
    size: int
    late: threading.Event

    def is_done(self, seconds: float) -> bool:
        """Wait at most ``seconds``; return whether the work is done. If not, its end wakes the source."""
        try:
            self.future.exception(max(seconds, 0.0))
        except TimeoutError:
            self.late.set()
        return self.future.done()


class Background:
    """A thread and a child process that read for one source, so that it does not delay the others.

    Both are started with the first task; after :meth:`close` it cannot be used again.
    """

    def __init__(self, wake: Callable[[], None], note: Callable[[tuple[str, ...]], None]) -> None:
        """Take what is called in the thread: ``wake`` after a task that is waited for, ``note`` with its files.

        The latter is called where a parser takes long or a file is large, and with no files after such a task.
        """
        self._wake, self._note = wake, note
        self._tasks: queue.SimpleQueue[Task | None] = queue.SimpleQueue()
        self._process: ReaderProcess | None = None
        self._thread: threading.Thread | None = None
        self._keys: tuple[str, ...] = ()
        self.last_s = 0.0
        """Duration of the last task."""
        self._noted = False

    def start(self, work: Callable[[], Any], keys: tuple[str, ...], size: int) -> Task:
        """Begin a task on files of ``size`` bytes; readers that it calls run in the child."""
        if self._thread is None:
            self._process = ReaderProcess(ChildLimits(), self._slow)
            self._thread = threading.Thread(target=self._run, args=(self._process,), name="reading", daemon=True)
            self._thread.start()
        task = Task(Future(), work, keys, size, threading.Event())
        self._tasks.put(task)
        return task

    def close(self) -> None:
        """Abandon what is under way; the thread ends by itself."""
        self._tasks.put(None)
        if self._process is not None:
            self._process.close()
        self._process = self._thread = None

    def _slow(self) -> None:
        self._noted = True
        self._note(self._keys)

    def _run(self, process: ReaderProcess) -> None:
        use_process(process)
        while (task := self._tasks.get()) is not None:
            self._execute(task)
            if task.late.is_set():
                self._wake()
            # Its samples may be large.
            del task

    def _execute(self, task: Task) -> None:
        self._keys, began = task.keys, time.monotonic()
        if task.size >= LARGE_BYTES:
            self._slow()
        try:
            result = task.work()
            # Before the result, by which the source goes on.
            self.last_s = time.monotonic() - began
            task.future.set_result(result)
        except MemoryError:
            reason = f"{', '.join(task.keys)}: there is not enough memory for {task.size} bytes"
            task.future.set_exception(ReaderError("refused", reason))
        except BaseException as error:
            self.last_s = time.monotonic() - began
            task.future.set_exception(error)
        if self._noted:
            self._noted = False
            self._note(())
