"""The files below a prefix of object storage, fetched as they are read, a bounded number at a time.

What was read is removed before more is fetched, so that the disk holds a batch of files and not the recording.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from models.platform.scratch import free_bytes, scratch_folder
from models.work.filesystem import filesystem
from streams.files.container import Item, read_regular
from streams.files.download import refuse_size
from streams.files.groups import FilesBeside
from streams.files.remote import (
    FETCHED,
    NOTHING_BESIDE,
    RemoteFile,
    fetch_files,
    fetched,
    foreseen,
    remote_files,
    split_url,
    target_of,
)
from streams.files.sidecar import FOLDER_NAMES
from streams.types.large import Data
from streams.types.listing import shown

MAX_FILES = 16
MAX_BATCH_BYTES = 64 << 20
"""Files are fetched together up to this size; a larger one is fetched alone."""


@dataclass(frozen=True)
class OpenedRemote:
    """A recording that can be opened here.

    Attributes:
        url: of the local copy, as sources are named.
        files: fetched as they are read; None where all of it is on this machine.
        fetched: bytes that were fetched before it was opened.
    """

    url: str
    files: RemoteFolder | None = None
    fetched: int = 0

    @property
    def size(self) -> int:
        """Bytes that were fetched by now."""
        return self.fetched if self.files is None else self.files.fetched_bytes


@contextmanager
def opened_remote(url: str, scratch: Path, beside: FilesBeside = NOTHING_BESIDE) -> Generator[OpenedRemote]:
    """Open a recording below ``scratch``: an object is fetched, of a prefix the names of its objects are.

    What was fetched is removed at the end; ``beside`` as of :func:`streams.files.remote.fetched`.

    Raises:
        SourceError, RemoteError: as :func:`streams.files.remote.fetched`, of the files of a prefix when they are read.
    """
    kind, place, scheme = split_url(url)
    found = remote_files(place) if scheme not in ("file", "http", "https") else []
    path = "" if not found else filesystem(place)[1]
    if not found or found[0].path.strip("/") == path.strip("/"):
        with fetched(url, scratch, beside=beside) as one:
            yield OpenedRemote(one.url, None, one.size)
        return
    with scratch_folder(FETCHED, scratch) as folder:
        root = folder / PurePosixPath(path).name
        with foreseen(place, "fetched"):
            root.mkdir()
        yield OpenedRemote(f"{kind}{root}", RemoteFolder(place, found, root, beside))


class RemoteFolder:
    """The objects below a prefix as the files of a folder."""

    sequential = False
    several = True

    def __init__(self, url: str, found: list[RemoteFile], root: Path, beside: FilesBeside = NOTHING_BESIDE) -> None:
        """Take the objects, at first in the order of their names, and fetch the side-cars of folders into ``root``."""
        self.root = root.resolve()
        self.closed: list[str] = []
        self.fetched_bytes = 0
        self._url, self._beside = url, beside
        self._files = {file.name: file for file in found}
        self._kept = {name for name in self._files if PurePosixPath(name).name in FOLDER_NAMES}
        self._here: set[str] = set()
        self.expect([name for name in self._files if name not in self._kept])
        self._fetch(self._kept)

    def __iter__(self) -> Iterator[Item]:
        """Iterate over all files; none is fetched by that."""
        for name, file in self._files.items():
            yield Item(name, lambda name=name: self._read(name), lambda at=file.changed: at, file.size > 0)

    def expect(self, paths: Sequence[str]) -> None:
        """Take the order in which files will be read; what is fetched with one are those behind it."""
        self._names = list(paths)
        self._places = {name: place for place, name in enumerate(self._names)}

    def _read(self, name: str) -> Data:
        if name not in self._here and name not in self._kept:
            self._remove()
            batch = self._batch(name)
            self._fetch(batch)
            self._here = batch
        return read_regular(self.root, name)

    def _together(self, name: str) -> set[str]:
        """Return the files that are read with one, itself among them."""
        return ({name, *self._beside.all(name)} & self._files.keys()) - self._kept

    def _batch(self, name: str) -> set[str]:
        """Return a file and those that will be read behind it, as many as may be here at once."""
        chosen = self._together(name)
        size = sum(self._files[one].size for one in chosen)
        place = self._places.get(name, len(self._names))
        for following in self._names[place + 1 : place + MAX_FILES]:
            more = self._together(following) - chosen
            size += sum(self._files[one].size for one in more)
            if size > MAX_BATCH_BYTES:
                break
            chosen |= more
        return chosen

    def _fetch(self, names: set[str]) -> None:
        """Fetch files; SourceError or RemoteError as :func:`streams.files.remote.fetched`."""
        wanted = [file for name, file in self._files.items() if name in names]
        size = sum(file.size for file in wanted)
        refuse_size(f"{self._url} ({len(wanted)} files)", size, free_bytes(self.root))
        targets = {file.path: target_of(self.root, file.name, self._url) for file in wanted}
        try:
            fetch_files(self._url, wanted, targets)
        except BaseException:
            # What came of them is not taken for the files.
            for target in targets.values():
                with suppress(OSError):
                    target.unlink()
            raise
        self.fetched_bytes += size

    def _remove(self) -> None:
        for name in self._here:
            with suppress(OSError):
                (self.root / name).unlink()
        self._here.clear()

    def __repr__(self) -> str:
        """Return the URL and the number of files."""
        return f"RemoteFolder({shown(self._url)}, {len(self._files)} files)"
