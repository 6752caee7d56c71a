"""What lies in a folder at this moment."""

from __future__ import annotations

import os
import stat
from dataclasses import dataclass

from streams.folder.names import left_alone

_SIGNED = (1 << 63) - 1


@dataclass(frozen=True, slots=True)
class Stat:
    """What the file system says of a file.

    Attributes:
        size: in bytes.
        mtime_ns: time of the last change, ns since 1970.
        inode: its number.
        regular: whether it is a plain file rather than a link, a pipe or a device.
    """

    size: int
    mtime_ns: int
    inode: int
    regular: bool = True


def stat_of(found: os.stat_result) -> Stat | None:
    """Return what counts of a stat result, None for a folder."""
    if stat.S_ISDIR(found.st_mode):
        return None
    # Some file systems use all 64 bits; the ledger keeps signed numbers.
    return Stat(found.st_size, found.st_mtime_ns & _SIGNED, found.st_ino & _SIGNED, stat.S_ISREG(found.st_mode))


def look_at(root: str, path: str) -> Stat | None:
    """Look at one file without following links; None where it is not there or is a folder."""
    try:
        return stat_of(os.lstat(f"{root}/{path}"))
    except (OSError, ValueError):
        return None


def list_files(root: str, closed: list[str] | None = None) -> dict[str, Stat]:
    """List all files below a folder but those that are left alone; links are listed, never followed.

    Args:
        root: the folder.
        closed: gets the folders below it that may not be read, as paths below it.

    Returns:
        What the file system says of each, by path below the folder.

    Raises:
        OSError: the folder itself cannot be read.
    """
    found: dict[str, Stat] = {}
    folders = [""]
    while folders:
        folder = folders.pop()
        try:
            _list_one(root, folder, folders, found)
        except OSError as error:
            if not folder:
                raise
            if closed is not None and isinstance(error, PermissionError):
                closed.append(folder)
    return found


def _list_one(root: str, folder: str, folders: list[str], found: dict[str, Stat]) -> None:
    """Add the files of one folder to those that were found, and its folders to those that are to be looked at."""
    with os.scandir(f"{root}/{folder}") as entries:
        for entry in entries:
            if left_alone(entry.name):
                continue
            path = f"{folder}/{entry.name}" if folder else entry.name
            try:
                if entry.is_dir(follow_symlinks=False):
                    folders.append(path)
                    continue
                status = stat_of(entry.stat(follow_symlinks=False))
            except PermissionError:
                # The folder may be listed, but nothing in it looked at.
                raise
            except OSError:
                # Gone between the list and the look.
                continue
            if status is not None:
                found[path] = status
