"""A store in a folder, on this machine or on a file system that all workers mount."""

from __future__ import annotations

import os
import re
import secrets
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from urllib.parse import unquote, urlsplit

from models.platform.portable import BINARY
from models.words.errors import WrongInputError
from models.words.extras import load
from models.work.filesystem import is_below
from models.work.task import FileStore


def open_store(url: str | Path) -> FileStore:
    """Return the store of a path or a URL: ``file://`` is a folder, others need the extra ``s3`` or ``cluster``.

    Raises:
        WrongInputError: the URL names no folder and no object store, or a package that it needs is missing.
    """
    if isinstance(url, Path) or "://" not in url:
        return FolderStore(url)
    split = urlsplit(url)
    if split.scheme.lower() == "file":
        if split.netloc not in ("", "localhost") or not split.path:
            raise WrongInputError(f"expected file:///FOLDER, got {url!r}")
        return FolderStore(Path(unquote(split.path)))
    try:
        store = load("work", "objects")
    except ModuleNotFoundError as error:
        raise WrongInputError(
            f'{split.scheme}:// needs object storage: pip install "spallwatch[s3]" ({error.name} is missing)'
        ) from None
    return store(url)


_PART = ".part-"
_OWN_PART = re.compile(r"\.part-\d+-[0-9a-f]{8}")


class FolderStore:
    """Files of a folder, each written beside its place and moved there.

    Attributes:
        url: absolute path of the folder.
    """

    def __init__(self, folder: Path | str) -> None:
        """Name the folder; it is made when something is written."""
        self._folder = Path(folder).absolute()
        self.url = str(self._folder)

    def read(self, name: str) -> bytes | None:
        """Return a file, None where there is none; OSError where it cannot be read."""
        try:
            return self._path(name).read_bytes()
        except (FileNotFoundError, NotADirectoryError):
            return None

    def write(self, name: str, data: bytes, *, durable: bool = True) -> None:
        """Write a file in one step, on the disk before it has its name if ``durable``; OSError where that fails."""
        path = self._path(name)
        part = path.with_name(f"{_PART}{os.getpid()}-{secrets.token_hex(4)}")
        handle = self._create(part)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(data)
                if durable:
                    file.flush()
                    os.fsync(file.fileno())
            part.replace(path)
        except BaseException:
            part.unlink(missing_ok=True)
            raise

    def delete(self, name: str) -> None:
        """Delete a file if it is there, and the folders that it leaves empty."""
        path = self._path(name)
        path.unlink(missing_ok=True)
        self._remove_empty(path.parent)

    def names(self, prefix: str = "") -> Iterator[str]:
        """Yield the names of all whole files that begin so, in any order."""
        first = prefix.rpartition("/")[0]
        yield from _names(os.path.join(self.url, *first.split("/")), f"{first}/" if first else "", prefix)  # noqa: PTH118

    def remove_parts(self) -> None:
        """Delete what killed processes have left half written, and the folders that this leaves empty."""
        for part in [part for part in self._folder.rglob(f"{_PART}*") if _OWN_PART.fullmatch(part.name)]:
            part.unlink(missing_ok=True)
            self._remove_empty(part.parent)

    def remove_if_empty(self) -> None:
        """Delete the folder unless something is in it."""
        with suppress(OSError):
            self._folder.rmdir()

    def _path(self, name: str) -> Path:
        parts = name.split("/")
        if not is_below(name) or any(part.startswith(_PART) for part in parts):
            raise ValueError(f"a name is parts joined by '/', got {name!r}")
        return self._folder.joinpath(*parts)

    def _remove_empty(self, folder: Path) -> None:
        """Delete a folder, and those above it within the store, as far as nothing is in them."""
        while folder != self._folder:
            try:
                folder.rmdir()
            except OSError:
                return
            folder = folder.parent

    def _create(self, part: Path) -> int:
        """Open a new file; another process may delete its empty folder in the meantime."""
        flags = os.O_CREAT | os.O_EXCL | os.O_WRONLY | BINARY
        for _ in range(100):
            with suppress(FileNotFoundError):
                return os.open(part, flags, 0o666)
            with suppress(FileNotFoundError, FileExistsError):
                part.parent.mkdir(parents=True, exist_ok=True)
        return os.open(part, flags, 0o666)


def _names(folder: str, before: str, prefix: str) -> Iterator[str]:
    try:
        entries = os.scandir(folder)
    except (FileNotFoundError, NotADirectoryError):
        return
    with entries:
        for entry in entries:
            name = before + entry.name
            if entry.is_dir():
                # Only folders on the way to the prefix, or below it.
                if name.startswith(prefix) or prefix.startswith(f"{name}/"):
                    yield from _names(entry.path, f"{name}/", prefix)
            elif name.startswith(prefix) and not entry.name.startswith(_PART):
                yield name
