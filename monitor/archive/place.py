"""Where the index of an archive is: in the folder of the archive, or on this machine while a run goes on."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from models.work.folder_store import FolderStore
from models.work.stores import open_store
from models.work.task import Store
from monitor.archive.index import Index
from monitor.archive.manifest import ManifestError
from monitor.records.database import release_lock, take_lock

INDEX_NAME = "index.db"
_COPIED_EVERY_S = 60.0


@contextmanager
def open_index(out: str, *, read_only: bool = False) -> Iterator[tuple[Index, Callable[[], bool]]]:
    """Open the index of an archive; yield it with a function that is called after outcomes were noted.

    The function returns whether a later process will find them. In an object storage the index is a copy: of an
    archive that is being replayed at most a minute old.

    Raises:
        ManifestError: there is none to be read, or another process replays this archive.
    """
    store = open_store(out)
    if isinstance(store, FolderStore):
        with _local_index(Path(store.url) / INDEX_NAME, read_only=read_only) as index:
            yield index, lambda: True
        return
    with tempfile.TemporaryDirectory(prefix="spallwatch-index-") as folder:
        path = Path(folder) / INDEX_NAME
        data = store.read(INDEX_NAME)
        if data is None and read_only:
            raise ManifestError(f"{store.url}: holds no archive: there is no {INDEX_NAME}")
        if data is not None:
            path.write_bytes(data)
        with Index(path, read_only=read_only) as index:
            copier = _Copier(index, store)
            try:
                yield index, copier.copy_if_due
            finally:
                if not read_only:
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
    """Copies an index to the store of its archive."""

    def __init__(self, index: Index, store: Store) -> None:
        self._index, self._store = index, store
        self._copied = float("-inf")

    def copy_if_due(self) -> bool:
        """Copy the index once in a while; return whether that was done now."""
        due = time.monotonic() - self._copied >= _COPIED_EVERY_S
        if due:
            self.copy()
        return due

    def copy(self) -> None:
        if not self._index.planned:
            return
        self._index.settle()
        self._store.write(INDEX_NAME, self._index.path.read_bytes())
        self._copied = time.monotonic()
