"""Names by which the sections of a configuration refer to each other."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from monitor.config.positions import Place


def find_loose_ends(values: Mapping[str, Any]) -> Iterator[tuple[Place, str]]:
    """Yield the place of each name that is given twice or leads nowhere, and what was expected.

    ``values`` are the tables as parsed; those of the wrong kind are left to their own validation.
    """
    names: dict[str, list[str]] = {}
    for key in ("bearing", "source", "channel"):
        names[key] = []
        for index, table in _tables(values, key):
            name = table.get("name")
            if not isinstance(name, str):
                continue
            if name in names[key]:
                yield (key, index, "name"), f"[[{key}]] name {name!r} is given twice; expected one of its own"
            names[key].append(name)
    for index, table in _tables(values, "channel"):
        for key in ("source", "bearing"):
            yield from _leads(("channel", index, key), table.get(key), names[key], f"channel {table.get('name')!r}: ")
    for section, key in (("rig", "bearing"), ("shaft", "second_bearing")):
        table = values.get(section)
        found = table.get(key) if isinstance(table, Mapping) else None
        yield from _leads((section, key), found, names["bearing"], f"[{section}] ")


def _tables(values: Mapping[str, Any], key: str) -> Iterator[tuple[int, Mapping[str, Any]]]:
    """Yield the tables of an array of tables with their index."""
    found = values.get(key)
    for index, table in enumerate(found) if isinstance(found, list | tuple) else ():
        if isinstance(table, Mapping):
            yield index, table


def _leads(place: Place, name: Any, known: list[str], who: str) -> Iterator[tuple[Place, str]]:
    """Yield a name that is none of the known ones; without any, the missing section is the problem."""
    if not isinstance(name, str) or not known or name in known:
        return
    yield place, f"{who}{place[-1]} {lost_name(name, known)}"


def lost_name(name: str, known: Sequence[str]) -> str:
    """Return in words that a name is none of the known ones, with the one that is probably meant."""
    near = difflib.get_close_matches(name, known, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"{name!r} is not one of {', '.join(sorted(known))}{hint}"
