"""The record of the calls that change files: how it is made (``record.c``) and read."""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import struct
import subprocess
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

SOURCE = Path(__file__).with_name("record.c")
CALLS = {
    "c": "create", "w": "write", "t": "truncate", "s": "fsync", "d": "fdatasync", "r": "rename", "l": "link",
    "u": "unlink", "x": "rmdir", "m": "mkdir", "!": "mark",
}  # fmt: skip
"""Calls by their letter in the record; a mark is what the life says of itself."""
_HEAD = struct.Struct("=QQQIIcb6x")


@dataclass(frozen=True)
class Entry:
    """One call: its name in :data:`CALLS`, the inode, and what the call was given.

    Attributes:
        offset: of the data in the file, or the new size of a truncated file, bytes.
        paths: one path, two (rename, link), or none where the inode says it; the text of a mark.
    """

    call: str
    inode: int
    is_folder: bool
    offset: int
    paths: tuple[str, ...]
    data: bytes

    @property
    def mark(self) -> Mapping[str, Any]:
        """What the life says here; empty for a call."""
        return json.loads(self.paths[0]) if self.call == "mark" else {}


def has_compiler() -> bool:
    """Return whether the recorder can be compiled here."""
    return shutil.which("gcc") is not None


def compile_recorder(folder: Path) -> Path:
    """Compile the recorder into a folder; return the library. CalledProcessError where that fails."""
    library = folder / "record.so"
    subprocess.run(["gcc", "-O2", "-Wall", "-Werror", "-shared", "-fPIC", "-o", library, SOURCE, "-ldl"], check=True)
    return library


def recording(library: Path, root: Path, record: Path) -> dict[str, str]:
    """Return the environment of a program whose calls below ``root`` are appended to ``record``, which is made."""
    record.touch()
    return {**os.environ, "LD_PRELOAD": str(library), "CRASH_ROOT": str(root.resolve()), "CRASH_RECORD": str(record)}


def mark(**values: Any) -> None:
    """Note values in the record of the running program; from here on they count as promised."""
    ctypes.CDLL(None).crash_mark(json.dumps(values).encode())


def read_record(path: Path) -> Iterator[Entry]:
    """Yield the entries of a record in the order in which they took effect."""
    content = memoryview(path.read_bytes())
    place = 0
    while place < len(content):
        inode, offset, length, first, second, letter, is_folder = _HEAD.unpack_from(content, place)
        place += _HEAD.size
        parts: list[bytes] = []
        for size in (first, second, length):
            parts.append(bytes(content[place : place + size]))
            place += size
        paths = tuple(os.fsdecode(part) for part in parts[:2] if part)
        yield Entry(CALLS[letter.decode()], inode, bool(is_folder), offset, paths, parts[2])
