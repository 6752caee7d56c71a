"""Spellings of dates and zones: signs of China and Japan, years without a century, abbreviations of zones."""

from __future__ import annotations

import re

_OF_CENTURY = re.compile(r".\d\d[-/.]\d\d[-/.]\d\d(?!\d)")
_DATE_BY_SIGNS = re.compile(r"(\d{4})\s?年\s?(\d{1,2})\s?月\s?(\d{1,2})\s?日\s*")
_CLOCK_BY_SIGNS = re.compile(r"(\d{1,2})\s?[時时]\s?(\d{1,2})\s?分\s?(\d{1,2}(?:\.\d+)?)\s?秒")

ZONE_HOURS = {
    "CET": 1,
    "MEZ": 1,
    "CEST": 2,
    "MESZ": 2,
    "WET": 0,
    "WEST": 1,
    "EET": 2,
    "EEST": 3,
    "MSK": 3,
    "EST": -5,
    "EDT": -4,
    "CDT": -5,
    "MST": -7,
    "MDT": -6,
    "PDT": -7,
    "AKST": -9,
    "AKDT": -8,
    "HST": -10,
    "JST": 9,
    "KST": 9,
    "AEST": 10,
    "AEDT": 11,
    "AWST": 8,
    "NZST": 12,
    "NZDT": 13,
    "SAST": 2,
    **dict.fromkeys(("UTC", "GMT", "Z", "ZULU", "UCT"), 0),
}
"""Hours from UTC of abbreviations that stand for one zone alone, which CST, IST and BST do not."""


def in_signs(text: str) -> str:
    """Return a date whose parts stand before signs of China and Japan, or behind an apostrophe, in our signs.

    ``2025年3月11日 8時15分00秒`` becomes ``2025-3-11 8:15:00``; of ``'25-03-11`` the apostrophe stands for the century.
    """
    if text[:1] in "'’" and _OF_CENTURY.match(text):
        text = f"20{text[1:]}"
    if text.isascii():
        return text
    return _CLOCK_BY_SIGNS.sub(r"\1:\2:\3", _DATE_BY_SIGNS.sub(r"\1-\2-\3 ", text)).strip()
