"""Texts that are not in UTF-8: of the encodings of some languages, the one in which known keys stand."""

from __future__ import annotations

import codecs
import re

from streams.files.abscissa import abscissa_called
from streams.files.keys import KEYS
from streams.files.statements import is_of_vibration, known_unit, plain_key

_ENCODINGS = ("cp1252", "cp932", "gb18030", "cp1250")
"""Of equal ones the first counts: Western Europe, Japan, China, Central Europe."""
_HEAD_BYTES, _HEAD_LINES = 1 << 16, 200
_FIELDS = re.compile('[:：=＝;；\t,，"()（）\\[\\]\r]+')
_BY_BLANKS = str.maketrans({**{0xFF01 + i: 0x21 + i for i in range(94)}, 0x3000: 0x20})


def western_signs(text: str) -> str:
    """Return a text with the signs of ASCII in place of those of full width, as ``：`` for a colon."""
    return text if text.isascii() else text.translate(_BY_BLANKS)


def in_utf8(data: bytes) -> bytes:
    """Return a text in UTF-8 where its head is in another encoding that known keys tell, else as it is."""
    head = data[:_HEAD_BYTES]
    if head.isascii() or _is_utf8(head):
        return data
    lines = b"\n".join(line for line in head.split(b"\n")[:_HEAD_LINES] if not line.isascii())
    scores = {encoding: _known(lines, encoding) for encoding in _ENCODINGS}
    best = max(_ENCODINGS, key=lambda encoding: scores[encoding])
    return data if best == _ENCODINGS[0] else data.decode(best, "replace").encode()


def _is_utf8(head: bytes) -> bool:
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return False
    return True


def _known(lines: bytes, encoding: str) -> int:
    """Return how many words of lines beyond ASCII are keys, units or names of times; -1 in another encoding."""
    try:
        text = lines.decode(encoding)
    except UnicodeDecodeError:
        return -1
    words = {word.strip() for word in _FIELDS.split(text.replace("\n", ",")) if not word.isascii()}
    return sum(
        plain_key(word) in KEYS
        or is_of_vibration(known_unit(word))
        or abscissa_called(word, "").kind in ("time", "index")
        for word in words
    )
