"""Names of files that nobody vouches for: which are left alone, and how one is shown and stored."""

from __future__ import annotations

import os

_LEFT_ALONE = (".tmp", ".part", ".partial", ".crdownload", ".filepart", "_index")


def left_alone(name: str) -> bool:
    """Tell whether a file is somebody's own business: hidden, half-way through a copy, or an index beside the data.

    Args:
        name: the name without its folder.
    """
    return name.startswith((".", "~")) or name.lower().endswith(_LEFT_ALONE)


def shown(path: str) -> str:
    r"""Write a path in printable characters, one-to-one: a newline as ``\n``, a byte that is no UTF-8 as ``\xff``.

    Args:
        path: as the file system gave it, surrogates for bytes that are no UTF-8.
    """
    if path.isascii() and path.isprintable() and "\\" not in path:
        return path
    text = os.fsencode(path).decode("utf-8", "surrogateescape")
    return "".join(_shown(character) for character in text)


def _shown(character: str) -> str:
    code = ord(character)
    if 0xDC80 <= code <= 0xDCFF:
        return f"\\x{code - 0xDC00:02x}"
    if character == "\\":
        return "\\\\"
    if character.isprintable():
        return character
    return character.encode("unicode_escape").decode("ascii")
