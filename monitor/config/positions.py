"""Line numbers of the keys of a TOML text, which the parser of the standard library does not give."""

from __future__ import annotations

import re
from collections.abc import Mapping

Place = tuple[str | int, ...]
"""Path of a value: keys, and indices of the entries of arrays."""

_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_SPACE = re.compile(r"[ \t]*")
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_BARE_VALUE = re.compile(r"[^,\]}#\r\n]+")
_STRINGS = (
    re.compile(r'"""(?:\\.|[^\\])*?"{3,5}', re.DOTALL),
    re.compile(r"'''.*?'{3,5}", re.DOTALL),
    re.compile(r'"(?:\\.|[^"\\\n])*"'),
    re.compile(r"'[^'\n]*'"),
)


def find_lines(text: str) -> dict[Place, int]:
    """Return the line, from 1, of each table, key and entry of a valid TOML text.

    A table that is given in several places has the line of the first. The result of an invalid text is not defined.
    """
    return _Scanner(text).scan()


def line_of(place: Place, lines: Mapping[Place, int]) -> int | None:
    """Return the line of a value or, where it is not there, of the nearest table around it; None without lines."""
    while place:
        if place in lines:
            return lines[place]
        place = place[:-1]
    return 1 if lines else None


class _Scanner:
    """Walks through a text once."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._at = 0
        self._counted = self._line = 0
        self._lines: dict[Place, int] = {}
        self._entries: dict[Place, int] = {}

    def scan(self) -> dict[Place, int]:
        table: Place = ()
        self._skip(_BLANK)
        while self._at < len(self._text):
            begin = self._at
            if self._text[self._at] == "[":
                table = self._header()
            else:
                self._pair(table)
            self._skip(_BLANK)
            if self._at == begin:
                break
        return self._lines

    def _skip(self, pattern: re.Pattern[str]) -> str:
        match = pattern.match(self._text, self._at)
        if match is not None:
            self._at = match.end()
        return "" if match is None else match[0]

    def _take(self, sign: str) -> bool:
        found = self._text.startswith(sign, self._at)
        self._at += len(sign) if found else 0
        return found

    def _note(self, place: Place, at: int | None = None) -> None:
        position = self._at if at is None else at
        if position < self._counted:
            self._counted = self._line = 0
        self._line += self._text.count("\n", self._counted, position)
        self._counted = position
        self._lines.setdefault(place, self._line + 1)

    def _header(self) -> Place:
        begin = self._at
        is_array = self._take("[[") or not self._take("[")
        table: Place = ()
        keys = self._keys()
        for index, key in enumerate(keys):
            table = (*table, key)
            last = index == len(keys) - 1
            self._note(table, begin)
            if last and is_array:
                self._entries[table] = self._entries.get(table, -1) + 1
            if table in self._entries:
                table = (*table, self._entries[table])
                self._note(table, begin)
        self._take("]]" if is_array else "]")
        return table

    def _keys(self) -> list[str]:
        keys: list[str] = []
        while True:
            self._skip(_SPACE)
            quoted = self._text[self._at : self._at + 1] in ("'", '"')
            keys.append(self._string()[1:-1] if quoted else self._skip(_BARE_KEY))
            self._skip(_SPACE)
            if not self._take("."):
                return keys

    def _pair(self, table: Place) -> None:
        begin, place = self._at, table
        for key in self._keys():
            place = (*place, key)
            self._note(place, begin)
        self._take("=")
        self._skip(_SPACE)
        self._value(place)

    def _value(self, place: Place) -> None:
        if self._take("["):
            self._entries_of(place, "]", array=True)
        elif self._take("{"):
            self._entries_of(place, "}", array=False)
        elif self._text[self._at : self._at + 1] in ("'", '"'):
            self._string()
        else:
            self._skip(_BARE_VALUE)

    def _entries_of(self, place: Place, end: str, *, array: bool) -> None:
        index = 0
        self._skip(_BLANK)
        while self._at < len(self._text) and not self._take(end):
            begin = self._at
            if array:
                self._note((*place, index))
                self._value((*place, index))
            else:
                self._pair(place)
            index += 1
            self._skip(_BLANK)
            self._take(",")
            self._skip(_BLANK)
            if self._at == begin:
                return

    def _string(self) -> str:
        for pattern in _STRINGS:
            if found := self._skip(pattern):
                return found
        self._at += 1
        return ""
