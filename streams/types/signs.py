"""Dates in numbers with signs of China and Japan, or without a century."""

from __future__ import annotations

import re

_OF_CENTURY = re.compile(r".\d\d[-/.]\d\d[-/.]\d\d(?!\d)")
_DATE_BY_SIGNS = re.compile(r"(\d{4})\s?年\s?(\d{1,2})\s?月\s?(\d{1,2})\s?日\s*")
_CLOCK_BY_SIGNS = re.compile(r"(\d{1,2})\s?[時时]\s?(\d{1,2})\s?分\s?(\d{1,2}(?:\.\d+)?)\s?秒")


def in_signs(text: str) -> str:
    """Return a date whose parts stand before signs of China and Japan, or behind an apostrophe, in our signs.

    ``2025年3月11日 8時15分00秒`` becomes ``2025-3-11 8:15:00``; of ``'25-03-11`` the apostrophe stands for the century.
    """
    if text[:1] in "'’" and _OF_CENTURY.match(text):
        text = f"20{text[1:]}"
    if text.isascii():
        return text
    return _CLOCK_BY_SIGNS.sub(r"\1:\2:\3", _DATE_BY_SIGNS.sub(r"\1-\2-\3 ", text)).strip()
