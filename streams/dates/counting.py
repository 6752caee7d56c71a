"""Which number in the names of files counts them."""

from __future__ import annotations

import re
from dataclasses import dataclass

from streams.types.listing import natural_key, unpacked_name

_MAX_MISSING = 100
"""A count whose first file has a number up to this one begins at 1; behind it, at that file."""
_MAX_DIGITS = 15
_MIN_DISTINCT = 0.9
"""Share of the names that must have a number of their own."""
_NUMBER = re.compile(r"\d+")


@dataclass(frozen=True)
class Number:
    """A number in a name: its value, and how likely it counts files."""

    value: int
    rank: int


def folder_of(path: str) -> str:
    """Return the folder in the path of a file."""
    return path.rpartition("/")[0]


def numbers_of(path: str) -> list[Number]:
    """Return the numbers in the name of a file that may count files: none before a letter, as in 25600Hz."""
    name = unpacked_name(path).rpartition("/")[2]
    stem, dot, ending = name.rpartition(".")
    text = stem if dot and not ending.isdigit() else name
    found: list[Number] = []
    for match in _NUMBER.finditer(text):
        after, before = text[match.end() : match.end() + 1], text[: match.start()][-1:]
        if after.isalpha() or len(match[0]) > _MAX_DIGITS:
            continue
        padded = match[0][0] == "0" and len(match[0]) > 1
        found.append(Number(int(match[0]), 2 if padded else 0 if before.isalpha() else 1))
    return found


def place_in_names(path: str, names: list[str]) -> tuple[int, int, int] | None:
    """Return which number from the right counts files, how many a name has, and the first; None: none does.

    Of several, one counts that differs from name to name; then one with leading zeros, then one that stands alone,
    then the last. The first is 0 or 1, unless the least number shows that others were counted before.
    """
    own = numbers_of(path)
    if not own or any(folder_of(name) != folder_of(path) for name in names):
        return None
    numbers = {name: numbers_of(name) for name in {path, *names}}
    alike = sorted((name for name, found in numbers.items() if len(found) == len(own)), key=natural_key)
    if 2 * len(alike) < len(set(names)):
        return None
    table = [numbers[name] for name in alike]
    possible = [i for i in range(len(own)) if len({row[i].value for row in table}) >= _MIN_DISTINCT * len(table)]
    if not possible:
        return None
    chosen = max(possible, key=lambda i: (own[i].rank, i))
    least = min(row[chosen].value for row in table)
    first = least if least == 0 or least > _MAX_MISSING else 1
    return len(own) - chosen, len(own), first
