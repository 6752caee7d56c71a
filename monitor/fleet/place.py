"""Where the index of an archive is: in the folder of the archive, or on this machine while a run goes on.

One process at a time replays an archive: by a lock in a folder, by a lease in an object storage. There, the index is
written only where it is still the one that this process wrote last, as a process may stand still between any question
and its answer.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from models.fleet.kept import write_unchanged
from models.fleet.lease import Lease, LeaseLostError, leased
from models.fleet.object_store import ObjectStore
from models.platform.process_signals import ended_as_interrupted
from models.work.folder_store import FolderStore, open_store
from models.work.task import FileStore
from monitor.fleet.index import INDEX_NAME, ForeignIndexError, Index
from monitor.fleet.manifest import ManifestError
from monitor.records.database import release_lock, take_lock

_COPIED_EVERY_S = 60.0
_MAX_GUARDED_BYTES = 64 << 20
"""Of an index that one conditional request writes; larger ones go in parts, after the lease was confirmed."""


@dataclass(frozen=True)
class Opened:
    """An index that is open.

    Attributes:
        index: the index.
        noted: called after outcomes were noted; returns whether a later process will find them.
        confirm: called before what readers take for whole is written; raises LeaseLostError where another process
            replays the archive by now.
        keep: brings outcomes to where a later process finds them, also after a loss of power, before what the index
            named earlier is deleted; raises as ``confirm``.
    """

    index: Index
    noted: Callable[[], bool]
    confirm: Callable[[], None]
    keep: Callable[[], None] = lambda: None


@contextmanager
def open_index(
    out: str, *, read_only: bool = False, tell: Callable[[str], None] = lambda text: None
) -> Iterator[Opened]:
    """Open the index of an archive.

    In an object storage the index is a copy: of an archive that is being replayed at most a minute old. ``tell`` is
    called with a line for people before a lease is waited for.

    Raises:
        ManifestError, LeaseHeldError: there is none to be read, or another file; another process replays this archive.
        LeaseLostError: another process has taken over.
    """
    store = open_store(out)
    try:
        with _opened(store, read_only=read_only, tell=tell) as opened:
            yield opened
    except ForeignIndexError:
        # Its own message may name a copy.
        raise ManifestError(
            f"{'' if read_only else '--out '}{store.url}: its {INDEX_NAME} is no index of an archive that this version "
            "reads; it is left as it is"
        ) from None


@contextmanager
def _opened(store: FileStore, *, read_only: bool, tell: Callable[[str], None]) -> Iterator[Opened]:
    if isinstance(store, FolderStore):
        with _local_index(Path(store.url) / INDEX_NAME, read_only=read_only) as index:
            yield Opened(index, lambda: True, lambda: None, lambda: None if read_only else index.settle())
        return
    assert isinstance(store, ObjectStore)
    with tempfile.TemporaryDirectory(prefix="spallwatch-index-") as folder:
        path = Path(folder) / INDEX_NAME
        if not read_only:
            # A lease that a signal left behind would be waited for by the next command.
            with ended_as_interrupted(), leased(store, tell) as lease, _copied_index(store, path, lease) as opened:
                yield opened
            return
        data = store.read(INDEX_NAME)
        if data is None:
            raise ManifestError(f"{store.url}: holds no archive: there is no {INDEX_NAME}")
        path.write_bytes(data)
        with Index(path, read_only=True) as index:
            yield Opened(index, lambda: False, lambda: None)


@contextmanager
def _copied_index(store: ObjectStore, path: Path, lease: Lease) -> Iterator[Opened]:
    kept = store.read_kept(INDEX_NAME)
    if kept is not None:
        path.write_bytes(kept.data)
    with Index(path) as index:
        copier = _Copier(index, store, lease, None if kept is None else kept.tag)
        # From here on a process that held the lease before cannot write the index any more.
        copier.copy()
        try:
            yield Opened(index, copier.copy_if_due, lease.confirm, copier.copy)
        finally:
            copier.copy()


@contextmanager
def _local_index(path: Path, *, read_only: bool) -> Iterator[Index]:
    if read_only:
        if not path.exists():
            raise ManifestError(f"{path.parent}: holds no archive: there is no {INDEX_NAME}")
        with Index(path, read_only=True) as index:
            yield index
        return
    folder, new = path.parent, not path.parent.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = take_lock(path)
    except OSError as error:
        raise ManifestError(f"--out {folder}: cannot be written: {error.strerror or error}") from None
    if lock is None:
        raise ManifestError(f"--out {folder}: another process replays this archive")
    planned = True
    try:
        with Index(path) as index:
            try:
                yield index
            finally:
                planned = index.planned
    finally:
        if not planned:
            path.unlink()
            if new:
                path.with_name(f"{path.name}.lock").unlink(missing_ok=True)
        release_lock(lock)
        if new and not planned:
            with suppress(OSError):
                folder.rmdir()


class _Copier:
    """Copies an index to the store of its archive, where it is still the one that was copied before."""

    def __init__(self, index: Index, store: ObjectStore, lease: Lease, tag: str | None) -> None:
        self._index, self._store, self._lease, self._tag = index, store, lease, tag
        self._copied = float("-inf")

    def copy_if_due(self) -> bool:
        """Copy the index once in a while; return whether that was done now. LeaseLostError as soon as it is known."""
        self._lease.check()
        due = time.monotonic() - self._copied >= _COPIED_EVERY_S
        if due:
            self.copy()
        return due

    def copy(self) -> None:
        """Copy the index, if it is planned.

        Raises:
            LeaseLostError: another process has taken over.
        """
        if not self._index.planned:
            return
        self._lease.confirm()
        # Unlike any index of another process, also where nothing has been done yet.
        self._index.set_meta(writer=self._lease.token)
        self._index.settle()
        data = self._index.path.read_bytes()
        if len(data) <= _MAX_GUARDED_BYTES:
            tag = write_unchanged(self._store, INDEX_NAME, data, self._tag)
            if tag is None:
                self._lease.confirm()
                raise LeaseLostError(f"{self._store.url}: {INDEX_NAME} was written by another process; this one ends")
            self._tag = tag
        else:
            self._store.write(INDEX_NAME, data)
        self._copied = time.monotonic()
