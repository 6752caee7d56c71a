"""Read the files of one source in the background, one at a time, and tell how they continue those read before."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from models.platform.supervision import OwnedThread, Restarts
from models.words.errors import SpallwatchError
from streams.files.container import content_hash, read_guarded, refuse_special
from streams.files.datasets import FileFacts
from streams.files.load import Loader
from streams.files.parse.child import ReaderProcess, use_process
from streams.files.parse.complete import whole_part
from streams.folder.life import FileEntry
from streams.reblock import Cut
from streams.types.limits import LARGE_BYTES, ChildLimits
from streams.types.listing import Stat, stat_file
from streams.types.samples import ReaderError, Samples
from streams.types.source import ACCEPTED, HEAD_BYTES, PENDING, FileProgress

_LONG_S = 60.0
"""Time after which a file that is being read is a problem."""


@dataclass(frozen=True, eq=False)
class Raw:
    """The bytes of a file as stored, and its progress without samples."""

    data: bytes
    progress: FileProgress

    def is_more_of(self, known: FileProgress) -> bool:
        """Return whether it begins with all the known bytes of another file, equals it, or is of the same file."""
        own = self.progress
        is_same = (known.size, known.mtime_ns, known.inode) == (own.size, own.mtime_ns, own.inode)
        if known.content_hash == own.content_hash or is_same:
            return True
        longer = 0 < known.read_bytes < len(self.data)
        return longer and content_hash(self.data[: known.read_bytes]) == known.content_hash


class UnfinishedError(SpallwatchError):
    """A file changed while it was read; ``stat`` is its new status, None if removed."""

    def __init__(self, stat: Stat | None) -> None:
        """Keep the present status."""
        super().__init__("changed while it was read")
        self.stat = stat


def read_raw(root: Path, entry: FileEntry, growing: str | None) -> Raw:
    """Return the bytes of a file; of a ``growing`` format those whose samples are final.

    Raises:
        ReaderError: as :func:`streams.files.container.read_guarded`, but for a file that changes.
        UnfinishedError: it has changed since it was selected.
    """
    refuse_special(entry.state.stat, root, entry.path)
    try:
        data = read_guarded(root, entry.path, may_grow=growing is not None)
    except ReaderError as error:
        after = stat_file(str(root), entry.path)
        if error.status == "changed" or after is None:
            raise UnfinishedError(after) from error
        raise
    after = stat_file(str(root), entry.path)
    if after is None or (after != entry.state.stat and growing is None):
        raise UnfinishedError(after)
    size = len(data)
    if growing is not None:
        data = whole_part(data, growing)
    digest = content_hash(data)
    head = content_hash(data[:HEAD_BYTES])
    return Raw(data, FileProgress(entry.key, size, after.mtime_ns, after.inode, head, digest, len(data)))


def count_block(cut: Cut) -> Iterator[tuple[FileEntry, FileProgress]]:
    """Give the files of which a block has samples, each with its progress once the block is committed."""
    for entry, end in cut.used:
        if not isinstance(entry, FileEntry) or entry.state.read is None:
            continue
        read, state, verdict = entry.state.read, entry.state, PENDING
        if end >= state.total and not read.is_part:
            in_blocks = state.blocks or not cut.missing or (state.base and state.base.samples)
            verdict = ACCEPTED if in_blocks else "short"
        yield entry, replace(read, path=entry.key, samples=end, verdict=verdict)


Result = Samples | ReaderError | None
"""Of reading a file; None where its bytes are those that are known already."""


def read_file(
    loader: Loader, entry: FileEntry, facts: FileFacts, growing: str | None, known: str | None
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
class FileTask:
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

    Both are started with the first task; after :meth:`close` it cannot be used again. A parser is ended where it takes
    too long, and a system call that hangs, as those of an unreachable share, is waited for.
    """

    def __init__(
        self, wake: Callable[[], None], note: Callable[[tuple[str, ...]], None], name: str = "reading"
    ) -> None:
        """Take what is called in the thread: ``wake`` after a task that is waited for, ``note`` with its files.

        The latter is called where a parser takes long or a file is large, and with no files after such a task.
        """
        self._wake, self._note = wake, note
        self._tasks: queue.SimpleQueue[FileTask | None] = queue.SimpleQueue()
        self._process: ReaderProcess | None = None
        self.restarts = Restarts(name)
        self._thread: OwnedThread | None = None
        self._began: float | None = None
        self._keys: tuple[str, ...] = ()
        self.last_s = 0.0
        """Duration of the last task."""
        self._noted = False

    def start(self, work: Callable[[], Any], keys: tuple[str, ...], size: int) -> FileTask:
        """Begin a task on files of ``size`` bytes; readers that it calls run in the child."""
        if self._thread is None:
            process = self._process = ReaderProcess(ChildLimits(), self._slow)
            self._thread = OwnedThread(self.restarts, lambda: self._run(process), thread="reading")
            self._thread.start()
        task = FileTask(Future(), work, keys, size, threading.Event())
        self._tasks.put(task)
        return task

    def tend(self) -> None:
        """Start the thread again where it has ended."""
        if self._thread is not None:
            self._thread.tend()

    def problem(self) -> str | None:
        """Return that the thread stays down, or which file takes long, or None."""
        began = self._began
        long = None if began is None else time.monotonic() - began
        if long is not None and long > _LONG_S:
            return f"{', '.join(self._keys)}: has been read for {long:.0f} s"
        return self.restarts.problem()

    def close(self) -> None:
        """Abandon what is under way; the thread ends by itself."""
        if self._thread is not None:
            self._thread.end()
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

    def _execute(self, task: FileTask) -> None:
        self._keys, began = task.keys, time.monotonic()
        self._began = began
        try:
            if task.size >= LARGE_BYTES:
                self._slow()
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
        finally:
            self._began = None
        if self._noted:
            # Where it fails, the thread is started again, and the note is replaced by the next.
            self._noted = False
            self._note(())
