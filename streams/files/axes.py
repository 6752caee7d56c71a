"""Lines of a head that describe the axes of a diagram, as analysers write them: ``Y-axis: Acceleration, m/s2``."""

from __future__ import annotations

import re

from streams.files.keys import TIME_UNITS
from streams.files.statements import Facts, is_of_vibration, known_unit, named, plain_unit
from streams.types.samples import ReaderError

_WORDS = ("axis", "label", "title", "axistitle", "axislabel", "axisname", "achse", "achsentitel")
_UNITS = ("unit", "units", "axisunit", "axisunits", "unitlabel")
_X = frozenset(("abscissa", "abszisse", *(f"x{word}" for word in _WORDS)))
_Y = frozenset(("ordinate", *(f"y{word}" for word in _WORDS)))
_X_UNITS = frozenset(f"x{word}" for word in _UNITS)
AXES = _X | _Y
"""Plain keys of lines that name the quantity of an axis, and mostly its unit."""
_FREQUENCIES = ("hz", "khz", "cpm", "rpm", "1/s", "order", "orders")


def ordinate_units(facts: Facts) -> list[tuple[str, str]]:
    """Return the units that lines of the vertical axis state, each with its place."""
    found = ((place, _unit_of_axis(value)) for _, place, value in named(facts, _Y))
    return [(place, unit) for place, unit in found if unit is not None]


def abscissa_size(facts: Facts, where: str) -> float | None:
    """Return in what the horizontal axis is counted, in s; None where that is not stated.

    Raises:
        ReaderError: ``wrong_shape`` where it is a frequency, ``wrong_rate`` where several units are stated.
    """
    stated = [(place, known_unit(value)) for _, place, value in named(facts, _X_UNITS)]
    stated += [(place, _unit_of_axis(value)) for _, place, value in named(facts, _X)]
    sizes: dict[float, str] = {}
    for place, unit in stated:
        word = plain_unit(unit or "")
        if word in _FREQUENCIES:
            raise ReaderError(
                "wrong_shape", f"{where}: {place} states {unit}: a spectrum, where samples over time were expected"
            )
        if word in TIME_UNITS:
            sizes[TIME_UNITS[word]] = f"{place} {unit}"
    if len(sizes) > 1:
        raise ReaderError("wrong_rate", f"{where}: several units of time are stated: {', '.join(sizes.values())}")
    return next(iter(sizes), None)


def _unit_of_axis(value: object) -> str | None:
    """Return the unit behind the quantity of an axis: what stands in brackets, or the last word if it is one."""
    if not isinstance(value, str):
        return None
    inside = re.search(r"[\[(]([^\])]+)[\])]\s*$", value)
    if inside is not None:
        return known_unit(inside[1])
    last = known_unit(value.split()[-1]) if value.split() else None
    word = plain_unit(last or "")
    return last if is_of_vibration(last) or word in TIME_UNITS or word in _FREQUENCIES else None
