"""What a worker does with a chunk, and how chunks lie in a store.

``shared/DIGEST``: what all tasks share; each process reads it once. ``tasks/KEY``: tasks of a chunk that are too large
to be sent. ``chunks/XX/KEY``: results of a chunk, XX being the first two digits of its key. ``started/KEY/CALLER-N``: a
marker while a chunk is at work; it stays where the worker is killed. ``failed/KEY/N``: the log of a failure, as JSON.
``run.json``: of which program, begun when.
"""

from __future__ import annotations

import json
import os
import re
import secrets
import socket
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import cache
from typing import Any

import numpy as np

from models.words.errors import WrongInputError
from models.work.codec import DamagedDataError, decode, digest, digest_of, encode, resolve
from models.work.errors import MemoryNeedError, OtherProgramError, failure_of
from models.work.folder_store import FolderStore, open_store
from models.work.program import processor, program, versions
from models.work.redact import has_signed_url
from models.work.task import DIED, ChunkCall, ChunkOutcome, Failure, FileStore

MAX_ATTEMPTS = 3
"""Failures of a chunk, or deaths of its worker, after which it is set aside."""
MAX_SENT_BYTES = 50_000
"""Size up to which the tasks of a chunk are sent; what is larger waits in the store."""
_MAX_SHARED = 4
_ABANDONED_S = 30.0
"""Time of a chunk after which its worker may have been frozen, and its run have ended without it, s."""


@dataclass(frozen=True)
class StoredChunk:
    """What the store holds of a chunk: its key, the results of its tasks in order, and how long they took where."""

    key: str
    results: list[Any]
    seconds: float
    worker: str
    processor: str


@dataclass(frozen=True)
class StoredTasks:
    """Is sent in the place of large tasks, which stand in the store."""

    key: str


def sent_tasks(store: FileStore, key: str, tasks: bytes) -> bytes:
    """Return what is sent of the encoded tasks of a chunk, after writing large ones to the store.

    Those with signed URLs are sent whatever their size: a reader of the store could use the signatures.
    """
    if len(tasks) <= MAX_SENT_BYTES or has_signed_url(tasks):
        return tasks
    store.write(f"tasks/{key}", tasks)
    return encode(StoredTasks(key))


def chunk_name(key: str) -> str:
    """Return the name of a chunk's results in the store."""
    return f"chunks/{key[:2]}/{key}"


def chunk_key(function: str, shared: str, tasks: bytes) -> str:
    """Return the key of a chunk: a digest of all that its results depend on, beside the processor."""
    return digest((function, shared, digest_of(tasks), program()))


def read_chunk(store: FileStore, key: str) -> StoredChunk | None:
    """Return a chunk from the store, None where it is not there.

    Raises:
        DamagedDataError: its file is torn, was changed, or is that of something else.
    """
    data = store.read(chunk_name(key))
    if data is None:
        return None
    found = _decoded(store, chunk_name(key), data)
    if not isinstance(found, StoredChunk) or found.key != key:
        raise DamagedDataError(f"{store.url}/{chunk_name(key)}: expected the results of this chunk, got others")
    return found


def lost_workers(store: FileStore, call: ChunkCall) -> list[str]:
    """Return the markers of a chunk that workers of its caller left, sorted; other callers' workers may be at work."""
    return sorted(store.names(f"started/{call.key}/{call.caller}-"))


def clear_marks(store: FileStore, key: str, caller: str) -> None:
    """Delete the markers of a chunk that workers of a caller left, so that these do not count as lost."""
    for name in list(store.names(f"started/{key}/{caller}-")):
        store.delete(name)


def clear_attempts(store: FileStore, key: str) -> None:
    """Delete the markers and the logs of a chunk, so that it may be attempted anew."""
    for name in [name for prefix in ("started", "failed") for name in store.names(f"{prefix}/{key}/")]:
        store.delete(name)


def run_chunk(call: ChunkCall, *, memory: int | None = None, worker: str | None = None) -> ChunkOutcome:
    """Run the tasks of a chunk and write their results to its store; no exception leaves it.

    Args:
        memory: bytes that this worker may use; a chunk that needs more is refused.
        worker: name of this worker for people; default host and process.
    """
    worker = worker or default_worker()
    try:
        _check(call, memory, worker)
        store = cached_store(call.store)
        lost = lost_workers(store, call)
        if len(lost) >= MAX_ATTEMPTS:
            return _failed(call, _died(store, lost), worker)
        marker = f"started/{call.key}/{call.caller}-{len(lost) + 1}-{secrets.token_hex(4)}"
        store.write(marker, _text({"label": call.label, "worker": worker, "time": time.time()}), durable=False)
        try:
            outcome = _run(call, store, worker)
        finally:
            store.delete(marker)
        if outcome.failure is None:
            for name in lost:
                store.delete(name)
        return outcome
    except Exception as error:
        return _failed(call, failure_of(error, of_task=False), worker, log=True)


def default_worker() -> str:
    """Return the name of this process for people."""
    return f"{socket.gethostname()} process {os.getpid()}"


@cache
def cached_store(url: str) -> FileStore:
    """Return the store of a URL, one a process."""
    return open_store(url)


def write_log(store: FileStore, key: str, label: str, failure: Failure, worker: str) -> None:
    """Write the log of a failure of a chunk."""
    number = sum(1 for _ in store.names(f"failed/{key}/")) + 1
    entry = asdict(failure) | {"label": label, "worker": worker, "time": time.time()}
    store.write(f"failed/{key}/{number}-{secrets.token_hex(4)}", _text(entry))


def _check(call: ChunkCall, memory: int | None, worker: str) -> None:
    if call.program != program():
        raise OtherProgramError(
            f"worker {worker} runs another program: its digest is {program()[:12]}, expected {call.program[:12]}"
        )
    if memory is not None and call.memory > memory:
        raise MemoryNeedError(
            f"{call.label} needs {call.memory / 1e6:.0f} MB, worker {worker} has {memory / 1e6:.0f} MB"
        )


def _run(call: ChunkCall, store: FileStore, worker: str) -> ChunkOutcome:
    function: Callable[[Any, Any], Any] = resolve(call.function)
    shared, tasks = _shared(call.store, store, call.shared), decode(call.tasks)
    if isinstance(tasks, StoredTasks):
        tasks = _found(store, f"tasks/{tasks.key}")
    begun = time.perf_counter()
    try:
        results = [function(shared, task) for task in tasks]
    except Exception as error:
        return _failed(call, failure_of(error), worker, log=True)
    seconds = time.perf_counter() - begun
    if seconds > _ABANDONED_S and next(iter(store.names(f"shared/{call.shared}")), None) is None:
        # Results would stay in a place that was tidied up.
        raise FileNotFoundError(f"{store.url}: {call.label}: its run has ended meanwhile")
    data = encode(StoredChunk(call.key, results, seconds, worker, processor()))
    store.write(chunk_name(call.key), data)
    return ChunkOutcome(call.key, None, seconds, len(data), worker, processor())


_kept: OrderedDict[tuple[str, str], Any] = OrderedDict()
_lock = threading.Lock()


def _shared(url: str, store: FileStore, name: str) -> Any:
    """Return what all tasks share, from memory where this process has read it before."""
    with _lock:
        key = (url, name)
        if key not in _kept:
            _kept[key] = _found(store, f"shared/{name}")
            while len(_kept) > _MAX_SHARED:
                _kept.popitem(last=False)
        _kept.move_to_end(key)
        return _kept[key]


def _found(store: FileStore, name: str) -> Any:
    data = store.read(name)
    if data is None:
        raise FileNotFoundError(f"{store.url} has no {name}: workers and caller must reach the same store")
    return _decoded(store, name, data)


def _decoded(store: FileStore, name: str, data: bytes) -> Any:
    try:
        return decode(data)
    except DamagedDataError as error:
        raise DamagedDataError(f"{store.url}/{name}: {error}") from None


def _died(store: FileStore, markers: list[str]) -> Failure:
    """Return the failure of a chunk whose workers died, by the markers that they left."""
    entries = [json.loads(store.read(marker) or b"{}") for marker in markers]
    workers = ", ".join(str(entry.get("worker", "unknown")) for entry in entries)
    return Failure(
        DIED, f"{len(markers)} workers were lost while they ran it: {workers}", "a killed process logs nothing"
    )


def _failed(call: ChunkCall, failure: Failure, worker: str, *, log: bool = False) -> ChunkOutcome:
    if log:
        # The store may be what failed.
        with suppress(Exception):
            write_log(cached_store(call.store), call.key, call.label, failure, worker)
    return ChunkOutcome(call.key, failure, 0.0, 0, worker, processor())


def _text(values: dict[str, Any]) -> bytes:
    return json.dumps(values, indent=1).encode()


_RUN = "run.json"
_FORMAT = 1
_OWN = re.compile(
    r"chunks/[0-9a-f]{2}/[0-9a-f]{40}|(shared|tasks)/[0-9a-f]{40}|(started|failed)/[0-9a-f]{40}/[0-9a-f-]+"
    r"|preflight/[0-9a-f]{16}(-\w+)?"
)


class KnownChunks:
    """The keys of all chunks in a store: 8 bytes of memory each, so that 10 million fit."""

    def __init__(self, store: FileStore) -> None:
        """List them."""
        # Two keys may begin alike; whether a chunk is there is known when it is read.
        keys = (int(name[-40:-24], 16) for name in store.names("chunks/") if _OWN.fullmatch(name))
        self._keys = np.sort(np.fromiter(keys, np.uint64))

    def __len__(self) -> int:
        """Return their number."""
        return len(self._keys)

    def __contains__(self, key: str) -> bool:
        """Return whether a chunk is likely in the store."""
        begin = np.uint64(int(key[:16], 16))
        place = int(np.searchsorted(self._keys, begin))
        return place < len(self._keys) and bool(self._keys[place] == begin)


def attempted_chunks(store: FileStore) -> set[str]:
    """Return the keys of chunks with markers or logs of earlier attempts."""
    names = (name for prefix in ("started/", "failed/") for name in store.names(prefix))
    return {name.split("/")[1] for name in names if _OWN.fullmatch(name)}


def write_shared(store: FileStore, name: str, data: bytes, *, again: bool = False) -> None:
    """Write what all tasks share, unless it is there; ``again``: a file that is there may be damaged."""
    if again or next(iter(store.names(f"shared/{name}")), None) is None:
        store.write(f"shared/{name}", data)


def write_run(store: FileStore) -> str | None:
    """Write of which program a store is; return a line for people where it was of another one.

    Raises:
        WrongInputError: the store has a file of that name which no runner wrote.
    """
    run = {
        "format": _FORMAT,
        "program": program(),
        "versions": versions(),
        "processor": processor(),
        "begun": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    before = _program_of(store)
    store.write(_RUN, json.dumps(run, indent=1).encode())
    if before in (None, run["program"]):
        return None
    return f"{store.url} was begun by another version of the program: its chunks are not used"


def _program_of(store: FileStore) -> str | None:
    data = store.read(_RUN) or b"{}"
    if data == b"{}":
        return None
    try:
        return str(json.loads(data)["program"])
    except (ValueError, TypeError, KeyError):
        raise WrongInputError(f"{store.url}: holds a {_RUN} of something else; expected a place for chunks") from None


def check_writable(store: FileStore) -> None:
    """Read and write a file of a store that was begun; what the store raises tells that it is lost."""
    store.write(_RUN, store.read(_RUN) or b"{}")


def delete_own(store: FileStore) -> None:
    """Delete what runners put into a store, and no other file; the folder, too, where that leaves it empty."""
    prefixes = ("started/", "failed/", "chunks/", "tasks/", "shared/", "preflight/")
    for name in [name for prefix in prefixes for name in store.names(prefix) if _OWN.fullmatch(name)]:
        store.delete(name)
    store.delete(_RUN)
    if isinstance(store, FolderStore):
        store.remove_parts()
        store.remove_if_empty()
