"""Where the index of an archive is: in the folder of the archive, or on this machine while a run goes on.

One process at a time replays an archive: by a lock in a folder, by a lease in an object storage. There, the index is
written only where it is still the one that this process wrote last, as a process may stand still between any question
and its answer. Nothing else may be there: no recordings, and no results of an archive whose index is gone.
"""

from __future__ import annotations

import os
import re
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from models.fleet.lease import Lease, LeaseLostError, leased, write_unchanged
from models.fleet.object_store import ObjectStore
from models.platform.process_signals import ended_as_interrupted
from models.work.folder_store import FolderStore, open_store
from models.work.task import FileStore
from monitor.fleet.index import INDEX_NAME, ForeignIndexError, Index
from monitor.fleet.manifest import TAKEN, WORK_NAME, ManifestError, local_path, without_file_scheme
from monitor.fleet.result import RESULT_NAME, RecordingResult
from monitor.records.durable import take_lock

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
        lock.close()
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


OWN = re.compile(r"(inputs|states)/[0-9a-f]{40}|records/[^/]+/[^/]+/([^/]+\.nc|result\.json)")
"""Files that an archive keeps in ``archive-work``."""
_LISTERS = 16
"""Machines that are listed at a time: object storage answers late."""


class Overlap:
    """Finds recordings among which an archive would be written."""

    def __init__(self, out: str, *, machines: bool) -> None:
        """Take the URL of the archive; ``machines``: whether it has a folder for each machine."""
        self._out, self._machines = out, machines
        self._place = _place_of(out)
        self._below: dict[str, tuple[str, str]] = {}

    def add(self, where: str, url: str) -> None:
        """Note a recording; ``where`` is file and line of its entry.

        Raises:
            ManifestError: the archive would be in it.
        """
        place = _place_of(url)
        if place is None or self._place is None:
            return
        if f"{self._place}/".startswith(f"{place}/"):
            raise ManifestError(f"{where}: recordings: {url} holds --out {self._out}; take another --out")
        if place.startswith(f"{self._place}/"):
            first = place[len(self._place) + 1 :].partition("/")[0]
            self._below.setdefault(first, (where, url))

    def check(self, machines: Iterable[str]) -> None:
        """Compare the recordings with what the archive will write.

        Raises:
            ManifestError: one is where files of the archive will be.
        """
        for name in (*TAKEN, *(machines if self._machines else ())):
            if name in self._below:
                where, url = self._below[name]
                raise ManifestError(
                    f"{where}: recordings: {url} is in {name} of --out {self._out}, where records will be written; "
                    "take another --out"
                )


def _place_of(url: str) -> str | None:
    """Return the place of a recording or archive, to be compared; None where it is in no folder and no bucket."""
    url = without_file_scheme(url)
    scheme, found, rest = url.partition("://")
    if found:
        return f"{scheme.lower().replace('s3a', 's3')}://{rest.rstrip('/')}"
    path = local_path(url)
    return None if path is None else _real(path)


def _real(path: Path) -> str:
    if path.is_symlink():
        return os.path.realpath(path).rstrip("/")
    # Millions of recordings are in few folders.
    return f"{_real_folder(str(path.absolute().parent))}/{path.name}".rstrip("/")


@lru_cache(maxsize=1024)
def _real_folder(path: str) -> str:
    return os.path.realpath(path).rstrip("/")


def refuse_lost_work(work: FileStore) -> None:
    """Refuse to begin where states or records of an archive are left.

    Raises:
        ManifestError: naming the first of them.
    """
    # Configurations alone are left by a process that was killed while it planned.
    ours = (name for name in work.names() if OWN.fullmatch(name) and not name.startswith("inputs/"))
    if (found := next(ours, None)) is not None:
        raise _lost(f"{WORK_NAME}/{found}")


def refuse_lost_results(index: Index, out: FileStore) -> None:
    """Refuse to begin where a machine of the index has results of an archive already.

    Raises:
        ManifestError: naming the first of them.
    """
    machines = list(index.machines())

    def first_result(machine: str) -> str | None:
        ours = re.compile(rf"{re.escape(machine)}/[^/]+/{re.escape(RESULT_NAME)}")
        listed = (name for name in out.names(f"{machine}/") if ours.fullmatch(name))
        return next((name for name in listed if _is_result(out.read(name))), None)

    with ThreadPoolExecutor(_LISTERS) as pool:
        for found in pool.map(first_result, machines):
            if found is not None:
                raise _lost(found)


def _is_result(data: bytes | None) -> bool:
    try:
        RecordingResult.from_json(data or b"")
    except (ValueError, KeyError, TypeError, AttributeError):
        return False
    return True


def _lost(name: str) -> ManifestError:
    return ManifestError(
        f"--out: holds {name} of an archive, and its {INDEX_NAME} is gone; take another --out, or delete what is left"
    )
