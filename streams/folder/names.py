"""Names of files that nobody vouches for: which are left alone, and how one is shown and stored."""

from __future__ import annotations

import re

_LEFT_ALONE = (".tmp", ".part", ".partial", ".crdownload", ".filepart", "_index")
_ESCAPE = re.compile(r"\\\\|\\x[0-9a-f]{2}|\\u[0-9a-f]{4}|\\U[0-9a-f]{8}")


def left_alone(name: str) -> bool:
    """Tell whether a file is somebody's own business: hidden, half-way through a copy, or an index beside the data.

    Args:
        name: the name without its folder.
    """
    return name.startswith((".", "~")) or name.lower().endswith(_LEFT_ALONE)


def shown(path: str) -> str:
    r"""Write a path in printable characters, one-to-one: a newline as ``\u000a``, a byte that is no UTF-8 as ``\xff``.

    Args:
        path: as the file system gave it, surrogates for bytes that are no UTF-8.
    """
    if path.isascii() and path.isprintable() and "\\" not in path:
        return path
    return "".join(_shown(character) for character in path)


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
