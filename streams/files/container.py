"""The files of a recording (file, folder or tar archive), with guarded access; the digest of their bytes."""

from __future__ import annotations

import bz2
import errno
import gzip
import hashlib
import lzma
import os
import stat
import tarfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Literal, Protocol

from models.platform.portable import NO_LINK, NO_WAIT, open_folder
from streams.types import large
from streams.types.large import Data, FileBytes, pieces_of, shared_path, stream_of
from streams.types.limits import MAX_BYTES, max_loaded_bytes
from streams.types.listing import Stat, is_skipped, list_files, natural_key, packed_suffix, shown, stat_file
from streams.types.samples import ReaderError
from streams.types.spec import SourceError


def content_hash(data: Data) -> str:
    """Return the BLAKE2b-128 digest of the bytes of a file, in hexadecimal."""
    digest = hashlib.blake2b(digest_size=16)
    for piece in pieces_of(data):
        digest.update(piece)
    return digest.hexdigest()


def hash_of_file(raw: Data, name: str) -> str:
    """Return :func:`content_hash` of a file that may be read from disk by that.

    Raises:
        ReaderError: ``changed`` where it has become shorter, ``unreadable`` where it cannot be read.
    """
    try:
        return content_hash(raw)
    except EOFError as error:
        raise changed_error(name) from error
    except OSError as error:
        raise ReaderError("unreadable", f"{name}: cannot be read ({error.strerror})") from error


def changed_error(name: str) -> ReaderError:
    """Return the rejection of a file that changed while it was read."""
    return ReaderError("changed", f"{name}: changed while it was read")


_Mode = Literal["r:", "r:gz", "r:bz2", "r:xz"]
_ARCHIVE_MODES: dict[str, _Mode] = {
    ".tar": "r:",
    ".tar.gz": "r:gz",
    ".tgz": "r:gz",
    ".tar.bz2": "r:bz2",
    ".tbz2": "r:bz2",
    ".tar.xz": "r:xz",
    ".txz": "r:xz",
}
_OPENERS = {".xz": lzma.open, ".bz2": bz2.open, ".gz": gzip.open}
_DAMAGED = (tarfile.TarError, OSError, EOFError, lzma.LZMAError, zlib.error)


@dataclass(frozen=True)
class Item:
    """One file of a recording, under its path in the folder or archive, with "/".

    ``read`` gives its bytes or raises ReaderError; of an archive's item only until the next item is requested.
    ``changed`` gives the time of its last change, s since 1970 UTC, None where it cannot be read. ``filled``: a regular
    file with bytes in it.
    """

    path: str
    read: Callable[[], Data]
    changed: Callable[[], float | None] = lambda: None
    filled: bool = True


class Files(Protocol):
    """The files of a recording."""

    root: Path
    sequential: bool
    """Whether the files come in the order in which they are stored, so that sorting needs buffering."""
    several: bool
    """Whether there may be more than one file."""
    closed: list[str]
    """The folders below it that may not be read, as of the latest iteration."""

    def __iter__(self) -> Iterator[Item]:
        """Iterate over all files; ReaderError where an archive breaks off."""
        ...

    def expect(self, paths: Sequence[str]) -> None:
        """Take the order in which files will be read, by which those that have to be fetched are fetched ahead."""
        ...


class Folder:
    """The files below a folder, in natural order of their paths."""

    sequential = False

    def __init__(self, root: Path, only: Sequence[str] | None = None, several: bool = True) -> None:
        """Take the files below ``root``, or ``only`` those of some paths."""
        self.root = root.resolve()
        self.several = several
        self.closed: list[str] = []
        self._only = only

    def __iter__(self) -> Iterator[Item]:
        """Iterate over all files, those that will be refused too; SourceError where the folder may not be read."""
        root = str(self.root)
        if self._only is not None:
            found = {path: stat_file(root, path) for path in self._only}
        else:
            closed: list[str] = []
            try:
                listing = list_files(root, closed)
            except OSError as error:
                raise SourceError(f"{shown(root)}: cannot be read ({error.strerror})") from error
            self.closed = sorted(closed, key=natural_key)
            found = {path: listing[path] for path in sorted(listing, key=natural_key)}
        for path, status in found.items():
            filled = status is not None and status.regular and status.size > 0
            changed = None if status is None else status.mtime_ns / 1e9
            yield Item(path, lambda path=path: read_regular(self.root, path), lambda at=changed: at, filled)

    def expect(self, paths: Sequence[str]) -> None:
        """Ignore the order: all files are here."""


class Archive:
    """The members of a tar archive in stored order, read in one pass."""

    sequential = True
    several = True

    def __init__(self, path: Path) -> None:
        """Take the archive at ``path``; it is never unpacked to disk."""
        self.root = path.resolve()
        self.closed: list[str] = []
        self._mode: _Mode = next(mode for ending, mode in _ARCHIVE_MODES.items() if path.name.lower().endswith(ending))

    def __iter__(self) -> Iterator[Item]:
        """Iterate over all members but folders; ReaderError where it is damaged."""
        try:
            with tarfile.open(self.root, self._mode) as archive:
                yield from _members(archive, self.root.name, max_loaded_bytes(self.root.stat().st_size))
        except _DAMAGED as error:
            raise _damage(error, self.root.name) from error

    def expect(self, paths: Sequence[str]) -> None:
        """Ignore the order: members come as they are stored."""


def _members(archive: tarfile.TarFile, name: str, max_bytes: int) -> Iterator[Item]:
    broken: list[ReaderError] = []
    for member in archive:
        path = PurePosixPath(member.name)
        if member.isdir() or any(map(is_skipped, path.parts)):
            continue

        def read(member: tarfile.TarInfo = member) -> Data:
            try:
                return _read_member(archive, member, max_bytes)
            except _DAMAGED as error:
                broken.append(_damage(error, f"{name}: {member.name}"))
                raise broken[0] from error

        yield Item(str(path), read, lambda member=member: float(member.mtime), member.isreg() and member.size > 0)
        if broken:
            # Members behind the damage cannot be found; this one has been reported already.
            return


def _read_member(archive: tarfile.TarFile, member: tarfile.TarInfo, max_bytes: int) -> Data:
    if not member.isreg():
        raise ReaderError("refused", f"{member.name}: a link or a device, not a regular file")
    if member.size > max_bytes:
        raise ReaderError("refused", f"{member.name}: {member.size} bytes, {max_bytes} are allowed")
    stream = archive.extractfile(member)
    data: Data = b""
    if stream is not None:
        data = FileBytes.copied(stream, max_bytes) if member.size >= large.MAX_IN_MEMORY else stream.read()
    if len(data) < member.size:
        raise EOFError(f"{len(data)} of {member.size} bytes")
    return data


def _damage(error: BaseException, where: str) -> ReaderError:
    # tarfile reports a compressed file that ends too early as not compressed; the EOFError is its context.
    if isinstance(error, EOFError) or isinstance(error.__context__, EOFError) or "unexpected end" in str(error):
        return ReaderError("incomplete", f"{where}: the archive breaks off here")
    return ReaderError("unreadable", f"{where}: the archive is damaged ({error})")


def path_within(root: Path, path: str) -> str:
    """Return the real path of ``path`` below the resolved folder ``root``.

    Raises:
        ReaderError: ``refused`` for a link out of the folder.
    """
    top = str(root)
    real = os.path.realpath(f"{top}/{path}")
    if real != top and not real.startswith(top if top == "/" else f"{top}/"):
        raise ReaderError("refused", f"{path}: a link out of {root.name}")
    return real


def read_regular(root: Path, path: str) -> Data:
    """Return the content of a file of a folder as :func:`read_guarded`, which follows links; here they are refused.

    A large one is read as it is needed.
    """
    status = stat_file(str(root), path)
    refuse_special(status, root, path)
    if status is None or not large.MAX_IN_MEMORY <= status.size <= MAX_BYTES:
        return read_guarded(root, path)
    real, handle = _opened(root, path)
    try:
        status = _checked(handle, path, MAX_BYTES)
    except ReaderError:
        os.close(handle)
        raise
    return FileBytes(handle, status, shared_path(handle, real))


def _opened(root: Path, path: str) -> tuple[str, int]:
    """Open a file for reading; return its real path and the descriptor; ReaderError as :func:`read_guarded`."""
    real = path_within(root, path)
    try:
        # A FIFO must not block; a link may have replaced the file meanwhile.
        return real, os.open(real, os.O_RDONLY | NO_WAIT | NO_LINK)
    except OSError as error:
        status = "refused" if error.errno in (errno.ELOOP, errno.ENXIO) else "unreadable"
        raise ReaderError(status, f"{path}: cannot be opened ({error.strerror})") from error


def _checked(handle: int, path: str, allowed: int) -> os.stat_result:
    """Return the status of an open file; ``refused`` where it is no regular one or too large."""
    found = os.fstat(handle)
    if not stat.S_ISREG(found.st_mode):
        raise ReaderError("refused", f"{path}: not a regular file")
    if found.st_size > allowed:
        raise ReaderError("refused", f"{path}: {found.st_size} bytes, {allowed} are allowed")
    return found


def refuse_special(status: Stat | None, root: Path, path: str) -> None:
    """Raise ``refused`` for a link, a pipe or a device."""
    if status is not None and not status.regular:
        path_within(root, path)
        raise ReaderError("refused", f"{path}: a link, a pipe or a device, not a regular file")


def read_guarded(root: Path, path: str, *, may_grow: bool = False, max_bytes: int | None = None) -> bytes:
    """Return the bytes of a regular file at ``path`` below the resolved folder ``root``.

    One that ``may_grow`` may get longer meanwhile; then the bytes that were there at first are given.

    Raises:
        ReaderError: ``refused`` for a link out of the folder, a FIFO, a device, a folder or a file above
            ``max_bytes`` (default ``MAX_BYTES``), ``unreadable`` where it cannot be opened, ``changed`` where it
            changes while it is read.
    """
    _, handle = _opened(root, path)
    try:
        before = _checked(handle, path, MAX_BYTES if max_bytes is None else max_bytes)
        # A raw read to the end reads on until there is no more; one of so many bytes may give fewer.
        with open(handle, "rb", buffering=-1 if may_grow else 0, closefd=False) as stream:
            data = stream.read(before.st_size) if may_grow else stream.read()
        after = os.fstat(handle)
    except OSError as error:
        raise ReaderError("unreadable", f"{path}: cannot be read ({error.strerror})") from error
    finally:
        os.close(handle)
    grown = may_grow and after.st_size >= before.st_size == len(data)
    same = (before.st_size, before.st_mtime_ns) == (after.st_size, after.st_mtime_ns) and len(data) == after.st_size
    if not (same or grown):
        raise ReaderError("changed", f"{path}: changed while it was read")
    return data


def first_of(root: Path, path: str, count: int) -> bytes:
    """Return the first bytes of a regular file below the resolved folder ``root``; none where it cannot be read."""
    try:
        _, handle = _opened(root, path)
    except ReaderError:
        return b""
    try:
        return os.read(handle, count) if stat.S_ISREG(os.fstat(handle).st_mode) else b""
    except OSError:
        return b""
    finally:
        os.close(handle)


def unpack(data: Data, name: str, limit: int | None = None) -> Data:
    """Decompress a file by the ending of its name; else return ``data`` itself. What becomes large is on disk.

    Raises:
        ReaderError: ``incomplete`` where the file breaks off, ``unreadable`` where it is no such file, ``refused``
            where it would become larger than ``limit`` bytes (default :func:`streams.types.limits.max_loaded_bytes`).
    """
    suffix = packed_suffix(name)
    if not suffix or not data:
        return data
    limit = max_loaded_bytes(len(data)) if limit is None else limit
    try:
        with stream_of(data) as packed, _OPENERS[suffix](packed) as stream:
            head: bytes = stream.read(min(limit, large.MAX_IN_MEMORY))
            raw = FileBytes.copied(stream, limit - len(head), head) if len(head) >= large.MAX_IN_MEMORY else head
            # A child may not write a file of more bytes, even to find that there are more.
            too_large = bool(stream.read(1))
    except EOFError as error:
        raise ReaderError("incomplete", f"{name}: the compressed file breaks off before its end") from error
    except (OSError, lzma.LZMAError, zlib.error, ValueError) as error:
        raise ReaderError("unreadable", f"{name}: not a valid {suffix} file ({error})") from error
    if too_large:
        raise ReaderError("refused", f"{name}: {len(data)} bytes become more than {limit} when unpacked")
    return raw


def is_archive(path: str) -> bool:
    """Return whether a path ends like the name of a tar archive."""
    return path.lower().endswith(tuple(_ARCHIVE_MODES))


def check_readable(folder: Path, where: str) -> None:
    """Raise where a folder may not be listed or searched; ``where`` is the key that names it.

    Raises:
        SourceError: it may not be read.
        OSError: it does not exist, or is no folder.
    """
    try:
        open_folder(str(folder))
    except PermissionError as error:
        raise SourceError(f"{where}: {str(folder)!r} may not be read ({error.strerror})") from error


def open_files(name: str, path: str, must_be_folder: bool = False) -> Files:
    """Return the files of a path: a file, a folder or a tar archive.

    Raises:
        SourceError: there is no such path, it is neither a regular file nor a folder (or no folder although it must be
            one), or a folder that may not be read.
    """
    where = f"[[source]] {name}: url"
    try:
        place = Path(path).expanduser()
        there = bool(path) and place.exists()
    except (OSError, RuntimeError, ValueError) as error:
        raise SourceError(f"{where}: {path!r} cannot be looked at ({error})") from error
    if not there:
        raise SourceError(f"{where}: there is no {path!r}")
    if place.is_dir():
        check_readable(place, where)
        return Folder(place)
    if must_be_folder:
        raise SourceError(f"{where}: expected a folder, {path!r} is a file")
    if not place.is_file():
        raise SourceError(f"{where}: expected a regular file, a folder or an archive, {path!r} is none of them")
    if is_archive(place.name):
        return Archive(place)
    # The configuration names this very file, so a link is followed; the link's own name is kept.
    real = place.resolve()
    return Folder(real.parent, [real.name], several=False)
