"""Files of a folder: listing, printable names, type of the file system."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from models.platform.portable import device_number

NETWORK_FILE_SYSTEMS = frozenset(
    {"9p", "afs", "ceph", "cifs", "fuse.ceph", "fuse.glusterfs", "fuse.sshfs", "glusterfs", "lustre", "ncpfs", "nfs"}
    | {"nfs4", "smb3", "smbfs", "virtiofs", "vboxsf"}
)
"""Network file systems: no events of other machines, no reliable locks or shared memory."""

CLOSED = "may not be read (Permission denied)"
"""What is said of a folder that may not be listed or searched."""
_MOUNTS = Path("/proc/self/mountinfo")
_SKIPPED = (".tmp", ".part", ".partial", ".crdownload", ".filepart", "_index")
_ESCAPE = re.compile(r"\\\\|\\x[0-9a-f]{2}|\\u[0-9a-f]{4}|\\U[0-9a-f]{8}")
_PACKED = (".xz", ".bz2", ".gz")
_SIGNED = (1 << 63) - 1


class Stat(NamedTuple):
    """File status: size in bytes, last change in ns since 1970, inode, plain file."""

    size: int
    mtime_ns: int
    inode: int
    regular: bool = True


def stat_of(found: os.stat_result) -> Stat | None:
    """Return the status in a stat result, None for a folder."""
    if stat.S_ISDIR(found.st_mode):
        return None
    # Some file systems use all 64 bits; the ledger keeps signed numbers.
    return Stat(found.st_size, found.st_mtime_ns & _SIGNED, found.st_ino & _SIGNED, stat.S_ISREG(found.st_mode))


def is_likely_same(size: int, same: bool, stat: Stat, may_grow: bool) -> bool:
    """Return whether a file with a known inode is the one of ``size`` bytes: the ``same``, or one that has grown."""
    return same or (may_grow and stat.size > size)


def stat_file(root: str, path: str) -> Stat | None:
    """Return the status of a file or link; None where there is none or a folder."""
    try:
        return stat_of(os.lstat(f"{root}/{path}"))
    except (OSError, ValueError):
        return None


def list_files(root: str, closed: list[str] | None = None) -> dict[str, Stat]:
    """Return the status of all files below a folder by path; links are not followed.

    ``closed`` is extended by the folders below it that may not be read; OSError where the folder itself may not.
    """
    return dict(walk_files(root, closed))


def walk_files(root: str, closed: list[str] | None = None) -> Iterator[tuple[str, Stat]]:
    """Yield what :func:`list_files` returns, file by file."""
    folders = [""]
    while folders:
        folder = folders.pop()
        try:
            yield from _walk_one(root, folder, folders)
        except OSError as error:
            if not folder:
                raise
            if closed is not None and isinstance(error, PermissionError):
                closed.append(folder)


def _walk_one(root: str, folder: str, folders: list[str]) -> Iterator[tuple[str, Stat]]:
    """Yield the files of one folder, and add its folders to ``folders``."""
    with os.scandir(f"{root}/{folder}") as entries:
        for entry in entries:
            if is_skipped(entry.name):
                continue
            path = f"{folder}/{entry.name}" if folder else entry.name
            try:
                if entry.is_dir(follow_symlinks=False):
                    folders.append(path)
                    continue
                found = entry.stat(follow_symlinks=False)
                # Windows lists folders without the numbers of the files.
                status = stat_of(found if found.st_ino else os.lstat(f"{root}/{path}"))
            except PermissionError:
                # The folder may be listed, but not searched.
                raise
            except OSError:
                # Removed meanwhile.
                continue
            if status is not None:
                yield path, status


def is_skipped(name: str) -> bool:
    """Return whether a name is hidden, a partial copy, or an index beside the data."""
    return name.startswith((".", "~")) or name.lower().endswith(_SKIPPED)


def shown(path: str) -> str:
    r"""Return a path in printable characters, one-to-one.

    A newline becomes ``\u000a``, a byte that is no UTF-8 ``\xff``.
    """
    if path.isascii() and path.isprintable() and "\\" not in path:
        return path
    return "".join(_shown(character) for character in path)


def printable(text: str) -> str:
    r"""Return a sentence with the paths in it in printable characters; their backslashes stay as they are."""
    return text if text.isprintable() else "".join(c if c.isprintable() else _shown(c) for c in text)


def _shown(character: str) -> str:
    code = ord(character)
    if 0xDC80 <= code <= 0xDCFF:
        return f"\\x{code - 0xDC00:02x}"
    if character == "\\":
        return "\\\\"
    if character.isprintable():
        return character
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def unshown(text: str) -> str:
    """Return the path that :func:`shown` wrote."""
    return _ESCAPE.sub(_unescaped, text) if "\\" in text else text


def _unescaped(match: re.Match[str]) -> str:
    escape = match[0]
    if escape == "\\\\":
        return "\\"
    code = int(escape[2:], 16)
    return chr(code + 0xDC00) if escape[1] == "x" else chr(code)


def file_system_type(path: Path, mountinfo: str | None = None) -> str | None:
    """Return the type ("ext4", "nfs4") of the file system of a path, None if unknown.

    ``mountinfo`` is text in the format of /proc/self/mountinfo, by default that file.
    """
    if mountinfo is None:
        try:
            mountinfo = _MOUNTS.read_text(encoding="utf-8", errors="replace")
        except OSError:
            return None
    wanted = device_number(path.stat().st_dev)
    for line in mountinfo.splitlines():
        fields, separator, tail = line.partition(" - ")
        parts = fields.split()
        if separator and len(parts) > 2 and parts[2] == wanted:
            return tail.split()[0]
    return None


@lru_cache(maxsize=4096)
def natural_key(path: str) -> tuple[tuple[int, int, str], ...]:
    """Return a key that sorts numbers in names by value: ``file9`` before ``file10``.

    Keys are kept: to open and read a recording lists its files several times.
    """
    parts = re.split(r"(\d+)", path)
    return tuple((0, int(part), part) if part.isdecimal() else (1, 0, part) for part in parts if part)


def packed_suffix(name: str) -> str:
    """Return ".xz", ".bz2" or ".gz" where a file name ends so, else ""."""
    ending = name[name.rfind(".") :].lower()
    return ending if ending in _PACKED else ""


def unpacked_name(name: str) -> str:
    """Return a file name without its compression suffix."""
    suffix = packed_suffix(name)
    return name[: -len(suffix)] if suffix else name
