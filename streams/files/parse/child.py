"""Unsafe parsers in a child process with limited memory, processor time and time.

Its death only gives the file that it read the status ``reader_crashed``.
"""

from __future__ import annotations

import atexit
import json
import os
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import dataclass
from itertools import accumulate
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.platform.portable import DiskFile, MemoryFile, PipeReader, after_fork, handed_down
from models.platform.process_signals import child_path
from models.words.errors import SpallwatchError
from streams.files.parse.worker import read_all, read_into, write_all
from streams.turns.pulses import Pulses
from streams.types.large import Data, FileBytes, NoRoomError, mapped_array, write_whole
from streams.types.limits import MAX_BYTES, ChildLimits
from streams.types.samples import (
    OpenGain,
    ReaderError,
    Samples,
    Sensitivity,
    UnlistedStatement,
    one_after_another,
)

_ANSWER_BYTES = 1 << 22
_REMEMBERED_BYTES = 1 << 24
"""Of a file, and of its samples, that a process which remembers gives again."""
_KEPT_BYTES = 64 << 20
_MIN_DISK_BYTES = 1 << 18
"""A smaller file cannot become so large that its samples are on disk: :func:`streams.types.limits.max_loaded_bytes`."""
SLOW_S = 0.25
"""A file whose parser takes longer is noted as being handled, see :class:`ReaderProcess`."""
# A service manager signals all processes at once; the child ends with its parent, so that no file counts as crashed.
_START = """
import signal, sys
for name in ("SIGINT", "SIGTERM", "SIGHUP"):
    if hasattr(signal, name):
        signal.signal(getattr(signal, name), signal.SIG_IGN)
import json
sys.path[:] = json.loads(sys.argv.pop())
from streams.files.parse.worker import main
main()
"""
_ENVIRONMENT = {
    # No parser needs threads of linear algebra; their stacks would take its address space.
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    # Memory of one file is kept for the next instead of being given back and faulted in again.
    "MALLOC_MMAP_THRESHOLD_": str(32 << 20),
    "MALLOC_TRIM_THRESHOLD_": str(256 << 20),
    "MALLOC_TOP_PAD_": str(16 << 20),
    # Its own pool would reserve more address space than a child has.
    "ARROW_DEFAULT_MEMORY_POOL": "system",
    # No file may make the HDF5 library load code.
    "HDF5_PLUGIN_PRELOAD": "::",
    "HDF5_USE_FILE_LOCKING": "FALSE",
}


@dataclass
class _Pipes:
    """What this process shares with a child: pipes to it and from it, two files, and one on disk for large samples."""

    requests: int
    answers: PipeReader
    input: MemoryFile
    output: MemoryFile
    disk: DiskFile | None = None

    def hang_up(self) -> None:
        """Close the pipes; the child ends by that."""
        os.close(self.requests)
        self.answers.close()

    def close_files(self) -> None:
        """Close the files."""
        self.input.close()
        self.output.close()
        self.drop_disk()

    def drop_disk(self) -> None:
        """Close the file on disk."""
        if self.disk is not None:
            self.disk.close()
        self.disk = None


class ReaderProcess(AbstractContextManager["ReaderProcess"]):
    """A child process that parses files, one at a time; started at the first call."""

    def __init__(
        self,
        limits: ChildLimits | None = None,
        slow: Callable[[], None] = lambda: None,
        *,
        remembers: bool = False,
    ) -> None:
        """Take the limits; nothing is started yet.

        ``slow`` is called in the thread of a call that takes longer than ``SLOW_S``, libraries not counted. One that
        ``remembers`` gives the samples of its latest call again, read-only, where all bytes and arguments are the same:
        opening a recording looks at its first file before the samples are wanted. Behind a file that was asked for once
        none is remembered before a name comes twice: a pass over many files holds one of them.
        """
        self._limits = limits or ChildLimits()
        self._slow = slow
        self._remembers = remembers
        self._latest: tuple[Callable[..., Any], Data, str, tuple[Any, ...], Samples] | None = None
        self._asked_once: str | None = None
        _all.add(self)
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._pipes: _Pipes | None = None
        self._files = 0
        self._closed = False

    @property
    def pid(self) -> int | None:
        """Number of the process, or None where none is running."""
        return None if self._process is None else self._process.pid

    def call(self, function: Callable[..., Any], data: Data, name: str, *arguments: Any) -> Any:
        """Call a function of a module in the child with ``data``, ``name`` and arguments.

        Where ``name`` ends like that of a compressed file, the child decompresses the data first. JSON can represent
        the arguments, and the result unless it is Samples.

        A :class:`~streams.types.large.FileBytes` is opened by the child; large samples come in a file.

        Raises:
            NoRoomError: the temporary folder has no room for large samples.
            ReaderError: as the reader; ``unreadable`` for its other exceptions; ``reader_crashed`` where the child died
                or was killed; ``refused`` where the file is larger than ``MAX_BYTES``.
            SystemExit: the process was closed, before or meanwhile: the program ends, which is no verdict on the file.
        """
        if len(data) > MAX_BYTES:
            raise ReaderError("refused", f"{name}: {len(data)} bytes, {MAX_BYTES} are allowed")
        request = {
            "module": function.__module__,
            "function": function.__name__,
            "name": name,
            "arguments": arguments,
            "size": len(data),
            "memory": self._limits.memory_for(len(data)),
            "cpu_s": self._limits.cpu_s_for(len(data)),
            "path": data.path if isinstance(data, FileBytes) else None,
        }
        with self._lock:
            latest, self._latest = self._latest, None
            if latest is not None and latest[:4] == (function, data, name, arguments):
                self._latest, self._asked_once = latest, None
                return latest[4]
            # Its memory serves the next one.
            latest, once = None, self._asked_once
            self._asked_once = None if name == once else name
            try:
                found = self._result(self._ask(request, data))
                self._shrink()
                if self._remembers and once in (None, name) and isinstance(found, Samples) and isinstance(data, bytes):
                    self._remember(function, data, name, arguments, found)
                return found
            except _DiedError as error:
                self._kill()
                if self._closed:
                    raise SystemExit("the reader process is closed") from error
                raise ReaderError("reader_crashed", f"{name}: the reader {error}") from error
            except NoRoomError:
                raise
            except (OSError, EOFError, ValueError, KeyError, TypeError) as error:
                self._kill()
                raise ReaderError("reader_crashed", f"{name}: the reader did not answer sensibly ({error})") from error

    def _remember(
        self, function: Callable[..., Any], data: bytes, name: str, arguments: tuple[Any, ...], found: Samples
    ) -> None:
        if not found.following and max(len(data), found.values.nbytes) <= _REMEMBERED_BYTES:
            found.values.flags.writeable = False
            self._latest = function, data, name, arguments, found

    def close(self) -> None:
        """End the child; a call that is under way in another thread ends with SystemExit."""
        self._closed = True
        if not self._lock.acquire(timeout=0.5):
            process = self._process
            if process is not None:
                process.kill()
            self._lock.acquire()
        try:
            self._stop()
        finally:
            self._lock.release()

    def __exit__(self, *error: object) -> None:
        """Close it."""
        self.close()

    def forget(self) -> None:
        """Close the handles of a child that belongs to the parent of a forked process."""
        pipes, self._pipes = self._pipes, None
        if pipes is not None:
            pipes.hang_up()
            pipes.close_files()

    def _ask(self, request: dict[str, Any], data: Data) -> dict[str, Any]:
        if self._process is not None and (self._files >= self._limits.files or self._process.poll() is not None):
            # Used up, or dead since the last file: not the fault of this one.
            self._stop()
        pipes = self._start() if self._process is None or self._pipes is None else self._pipes
        self._files += 1
        answers = pipes.answers
        if len(data) >= _MIN_DISK_BYTES:
            # A file whose samples need the temporary folder fails in the child, with the reason.
            with suppress(OSError):
                pipes.disk = pipes.disk or DiskFile()
                request["disk"] = pipes.disk.path
        if not isinstance(data, FileBytes):
            write_all(pipes.input.handle, data)
        try:
            write_whole(pipes.requests, json.dumps(request).encode() + b"\n")
        except BrokenPipeError as error:
            raise _DiedError(self._cause(request)) from error
        self._line(answers, self._limits.start_s, request, one=True)
        if not answers.wait(SLOW_S):
            self._slow()
        return json.loads(self._line(answers, self._limits.wall_s_for(len(data)), request))

    def _line(self, answers: PipeReader, seconds: float, request: dict[str, Any], one: bool = False) -> bytes:
        """Wait for one line of the child, of ``one`` byte where only its end is due."""
        deadline = time.monotonic() + seconds
        line = b""
        while not line.endswith(b"\n"):
            if not answers.wait(deadline - time.monotonic()):
                raise _DiedError(f"gave no answer within {seconds:g} s and was stopped")
            part = answers.read(1 if one else 1 << 16)
            if not part:
                raise _DiedError(self._cause(request))
            line += part
            if len(line) > _ANSWER_BYTES:
                raise _DiedError("gave an answer without end")
        return line

    def _result(self, answer: dict[str, Any]) -> Any:
        if self._pipes is None:
            raise ValueError("the reader process is closed")
        if "no_room" in answer:
            self._pipes.drop_disk()
            raise NoRoomError(int(answer["no_room"]), str(answer["reason"]))
        if "status" in answer:
            raise ReaderError(str(answer["status"]), str(answer["reason"]))
        if "value" in answer:
            return answer["value"]
        dtype = {4: np.float32, 8: np.float64}[answer["itemsize"]]
        told = [answer, *answer.get("following", ())]
        lengths = [prod(one["shape"]) for one in told]
        on_disk = self._pipes.disk if answer.get("on_disk") else None
        output = self._pipes.output.handle if on_disk is None else on_disk.handle
        count, revolution = answer.get("pulses") or (0, None)
        size = sum(lengths) * answer["itemsize"]
        if min(*answer["shape"], *lengths, count) < 0 or size + 8 * count != os.fstat(output).st_size:
            raise ValueError("the samples do not fit their shape")
        if "pulses" in answer:
            times = np.frombuffer(read_all(output, 8 * count, size), dtype=np.float64)
            answer["stated"]["pulses"] = Pulses(times, revolution)
        if on_disk is not None:
            values = mapped_array(on_disk, (sum(lengths),), dtype)
            self._pipes.disk = None
        else:
            values = np.empty(sum(lengths), dtype=dtype)
            read_into(output, values.data)
        found = [
            _stated_of(values[end - length : end].reshape(one["shape"]), one["stated"])
            for one, length, end in zip(told, lengths, accumulate(lengths), strict=True)
        ]
        return found[0] if len(found) == 1 else one_after_another(found, found[0].torn)

    def _shrink(self) -> None:
        """Give back the memory of a large file; that of a usual one is kept for the next."""
        for file in () if self._pipes is None else (self._pipes.input, self._pipes.output):
            if os.fstat(file.handle).st_size > _KEPT_BYTES:
                os.ftruncate(file.handle, 0)

    def _start(self) -> _Pipes:
        if self._closed:
            raise _DiedError("was closed")
        with ExitStack() as undo:
            ends: list[int] = []
            for _ in range(2):
                ends += os.pipe()
            child_reads, requests, answers, child_writes = ends
            for handle in ends:
                undo.callback(os.close, handle)
            files = [MemoryFile("input")]
            undo.callback(files[0].close)
            files.append(MemoryFile("output"))
            undo.callback(files[1].close)
            words, given = handed_down((child_reads, child_writes), files)
            # A plain new interpreter: a fork of a process with threads may hang in its first allocation.
            process: subprocess.Popen[Any] = subprocess.Popen(
                [sys.executable, "-P", "-c", _START, *words, json.dumps(child_path())],
                stderr=subprocess.DEVNULL,
                env={**os.environ, **_ENVIRONMENT},
                **given,
            )
            self._process = process
            undo.pop_all()
        for handle in (child_reads, child_writes):
            os.close(handle)
        self._pipes = pipes = _Pipes(requests, PipeReader(answers), files[0], files[1])
        self._files = 0
        return pipes

    def _cause(self, request: dict[str, Any]) -> str:
        """Say why the child is gone."""
        process = self._process
        if process is None:
            return "is gone"
        try:
            code = process.wait(timeout=2.0)
        except subprocess.TimeoutExpired:
            return "closed its end"
        name = signal.Signals(-code).name if code < 0 else ""
        if name == "SIGXCPU":
            return f"used more than {request['cpu_s']} s of processor time"
        return f"died of {name}" if name else f"ended with code {code}"

    def _stop(self) -> None:
        """Close the pipes of the child and wait for its end."""
        process, pipes, self._pipes = self._process, self._pipes, None
        if pipes is not None:
            pipes.hang_up()
        if process is not None:
            try:
                process.wait(timeout=1.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        if pipes is not None:
            pipes.close_files()
        self._process = None

    def _kill(self) -> None:
        if self._process is not None:
            self._process.kill()
        self._stop()


def _stated_of(values: NDArray[Any], fields: dict[str, Any]) -> Samples:
    lists: dict[str, Any] = {key: tuple(value) for key, value in fields.items() if isinstance(value, list)}
    if lists.get("sensitivities"):
        lists["sensitivities"] = tuple(level and Sensitivity(*level) for level in lists["sensitivities"])
    if lists.get("open_gain"):
        lists["open_gain"] = OpenGain(*lists["open_gain"])
    if lists.get("unlisted"):
        found = (UnlistedStatement(*entry) for entry in lists["unlisted"])
        lists["unlisted"] = tuple([one._replace(readings=tuple(one.readings)) for one in found])
    return Samples(values, **{**fields, **lists})


class _DiedError(SpallwatchError):
    """The child has died or must be killed."""


_all: weakref.WeakSet[ReaderProcess] = weakref.WeakSet()
_shared = ReaderProcess(remembers=True)
_inherited: list[ReaderProcess] = []
_of_thread = threading.local()


def _after_fork() -> None:
    """Begin with a new child in a forked process, where the lock may be held for ever."""
    global _shared
    _inherited.extend(_all)
    for process in _inherited:
        process.forget()
    _shared = ReaderProcess(remembers=True)


after_fork(_after_fork)
atexit.register(lambda: _shared.close())


def shared_process() -> ReaderProcess:
    """Return the process of the calling thread, else that of the program; the latter is closed at exit."""
    return getattr(_of_thread, "process", _shared)


def use_process(process: ReaderProcess) -> None:
    """Make all readers that the calling thread calls run in ``process``."""
    _of_thread.process = process


def isolated(function: Callable[..., Any], *arguments: Any) -> Callable[[Data, str], Any]:
    """Return a reader, with further arguments, that runs in a child process: :func:`shared_process`.

    It returns and raises what the reader does; see :meth:`ReaderProcess.call`.
    """

    def read(data: Data, name: str) -> Any:
        return shared_process().call(function, data, name, *arguments)

    return read
