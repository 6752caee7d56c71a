"""Derive count and size of the elements of models/machine/catalogue/*.csv from the published load ratings beside them.

python -m benchmarks.catalogue.ratings rewrites the derived columns and prints the rules of design that follow from the
even bore codes; without a change of the published columns it changes nothing. Of each candidate count the size follows
from the static rating (ISO 76); the dynamic rating (ISO 281), the sizes in which elements are made, and the room
between the elements select the candidate. The effective lengths of cylindrical rollers are whole millimetres (less
0.6 mm for diameters from 15 to 18 mm, 0.4 mm from 25 mm), which selects the count that the ratings leave open.
"""

from __future__ import annotations

import csv
import math
import statistics
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

from models.machine.catalogue.ratings import Family, Internal, dynamic_rating, static_rating
from models.machine.catalogue.series import DesignRule, families, geometry, series_of
from models.words.numerics import find_root

FOLDER = Path(__file__).resolve().parents[2] / "models" / "machine" / "catalogue"
Row = dict[str, str]
_DYNAMIC_SD = 0.006
"""Scatter of printed dynamic ratings about ISO 281, relative: rounding to three digits and makers' own rounding."""
_ROOM = {"E": (1.25, 0.06), "": (1.40, 0.12)}
"""Pitch of the rollers over their diameter, and its spread, of the reinforced and the ordinary cylindrical design."""
_TAPERED_ROOM, _SPHERICAL_ROOM = 1.10, 1.15
LEAST_SHARE_SPREAD, LEAST_ROOM_SPREAD = 0.02, 0.02
"""Spreads below these are those of one maker's series; other makers differ by as much."""
_SPHERICAL_PITCH = 1.02
"""Pitch diameter over the mean of bore and outside diameter of spherical roller bearings (22317: 135.08 to 132.5)."""


def main() -> None:
    """Rewrite the derived columns of all series."""
    for family, function in DERIVE.items():
        path = FOLDER / f"{family}.csv"
        text = path.read_text(encoding="utf-8").splitlines()
        comments = [line for line in text if line.startswith("#")]
        rows = list(csv.DictReader(line for line in text if not line.startswith("#")))
        for row in rows:
            if row["static"]:
                row.update(function(row))
        with path.open("w", encoding="utf-8", newline="") as file:
            file.write("\n".join(comments) + "\n")
            writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
    for series, rule in fitted_rules().items():
        print(f'    "{series}": {rule},')


def fitted_rules() -> dict[str, DesignRule]:
    """Return the rule of each series with ratings: means and relative standard deviations over even bore codes."""
    found: dict[str, list[tuple[float, float, float, float | None]]] = defaultdict(list)
    for base, family in families().items():
        if base.startswith("NJ") or int(base[-2:]) % 2:
            continue
        for design in ("", "E") if family == "cylindrical" else ("",):
            bearing = geometry(base + design)
            if "derived" not in bearing.source:
                continue
            size, mean = bearing.element_diameter, 0.5 * (bearing.bore + bearing.outside)
            found[series_of(base) + design].append(
                (
                    size / (0.5 * (bearing.outside - bearing.bore)),
                    math.pi * bearing.pitch_diameter / (bearing.n_elements * size),
                    bearing.pitch_diameter / mean,
                    None if bearing.effective_length is None else bearing.effective_length / bearing.width,
                )
            )
    return {series: _rule(rows) for series, rows in found.items()}


def _rule(rows: list[tuple[float, float, float, float | None]]) -> DesignRule:
    shares, rooms, pitches = [row[0] for row in rows], [row[1] for row in rows], [row[2] for row in rows]
    share, room = statistics.mean(shares), statistics.mean(rooms)
    lengths = [length for *_, length in rows if length is not None]
    return DesignRule(
        round(share, 3),
        round(max(statistics.stdev(shares) / share, LEAST_SHARE_SPREAD), 3),
        round(room, 3),
        round(max(statistics.stdev(rooms) / room, LEAST_ROOM_SPREAD), 3),
        round(statistics.mean(pitches), 3),
        round(statistics.mean(lengths), 3) if lengths else None,
    )


def _mean(row: Row) -> float:
    return 0.5 * (float(row["bore"]) + float(row["outside"]))


def _angle(row: Row) -> float:
    return math.atan(float(row["e"]) / 1.5)


def _deep_groove(row: Row) -> dict[str, str]:
    return _balls(row, "deep_groove", 1, 0.0)


def _angular_contact(row: Row) -> dict[str, str]:
    return _balls(row, "angular_contact", 1, math.radians(40.0))


def _self_aligning(row: Row) -> dict[str, str]:
    return _balls(row, "self_aligning", 2, _angle(row))


def _balls(row: Row, family: Family, rows: int, angle: float) -> dict[str, str]:
    """Return count and diameter of the balls: the count whose ratings agree and whose diameter is one that is made."""
    pitch, static, dynamic = _mean(row), 1e3 * float(row["static"]), 1e3 * float(row["dynamic"])
    best: tuple[float, int, float] | None = None
    for count in range(5, 40):

        def rating(size: float, count: int = count) -> float:
            return static_rating(Internal(family, count, size, pitch, rows, angle)) - static

        low, high = 0.02 * pitch, min(0.4 * pitch, 0.98 * pitch * math.sin(math.pi / count))
        if rating(low) > 0.0 or rating(high) < 0.0:
            continue
        size = find_root(rating, low, high, rtol=1e-9)
        made = _made(size)
        bearing = Internal(family, count, size, pitch, rows, angle)
        cost = (math.log(dynamic_rating(bearing) / dynamic) / _DYNAMIC_SD) ** 2 + (math.log(size / made) / 0.004) ** 2
        if best is None or cost < best[0]:
            best = (cost, count, made)
    assert best is not None, row
    return {"z": str(best[1]), "ball": f"{best[2]:.3f}"}


def _made(size: float) -> float:
    """Return the nearest diameter in which balls are made: n/32 inch, small ones also n/64 inch or half millimetres."""
    step = 25.4 / 32.0 if size > 7.2 else 25.4 / 64.0
    inch = step * round(size / step)
    metric = 0.5 * round(size / 0.5)
    return metric if size < 4.0 and abs(metric - size) < 0.5 * abs(inch - size) else inch


def _cylindrical(row: Row) -> dict[str, str]:
    """Return count, diameter (half the difference of the raceway diameters) and effective length of the rollers."""
    static, dynamic = 1e3 * float(row["static"]), 1e3 * float(row["dynamic"])
    inner, width = float(row["inner"]), float(row["width"])
    mean, spread = _ROOM["E" if row["designation"].endswith("E") else ""]
    size = 0.5 * (float(row["outer"]) - inner)
    pitch = inner + size
    whole = 0.4 if 15.0 <= size <= 18.0 else 0.6 if size >= 25.0 else 0.0
    best: tuple[float, int, float] | None = None
    for count in range(8, 26):
        room = math.pi * pitch / (count * size)
        length = static / static_rating(Internal("cylindrical", count, size, pitch, effective_length=1.0))
        if not (1.03 < room < 1.65 and 0.5 * size < length < min(2.0 * size, width - 1.5)):
            continue
        bearing = Internal("cylindrical", count, size, pitch, effective_length=length)
        off = abs((length - whole + 0.5) % 1.0 - 0.5)
        cost = (
            (math.log(dynamic_rating(bearing) / dynamic) / _DYNAMIC_SD) ** 2
            + (off / 0.08) ** 2
            + ((room - mean) / spread) ** 2
        )
        if best is None or cost < best[0]:
            best = (cost, count, length)
    assert best is not None, row
    return {"z": str(best[1]), "roller": f"{size:g}", "length": f"{best[2]:.2f}"}


def _inclined(row: Row, family: Family) -> dict[str, str]:
    """Return count, diameter and length of tapered or spherical rollers.

    Both ratings determine diameter and product of count and length; the room between rollers, which varies little in
    these designs, gives the count.
    """
    rows, room, pitch = (
        (1, _TAPERED_ROOM, _mean(row)) if family == "tapered" else (2, _SPHERICAL_ROOM, _SPHERICAL_PITCH * _mean(row))
    )
    static, dynamic, angle = 1e3 * float(row["static"]), 1e3 * float(row["dynamic"]), _angle(row)

    def bearing(size: float, count: int) -> Internal:
        unit = Internal(family, count, size, pitch, rows, angle, 1.0)
        return Internal(family, count, size, pitch, rows, angle, static / static_rating(unit))

    section = 0.5 * (float(row["outside"]) - float(row["bore"]))
    best: tuple[float, Internal] | None = None
    for count in range(9, 26):
        size = find_root(
            lambda size, count=count: dynamic_rating(bearing(size, count)) - dynamic,
            0.15 * section,
            0.95 * section,
            rtol=1e-9,
        )
        cost = abs(math.pi * pitch / (count * size) - room)
        if best is None or cost < best[0]:
            best = (cost, bearing(size, count))
    assert best is not None, row
    found = best[1]
    return {
        "z": str(found.n_elements),
        "roller": f"{found.element_diameter:.2f}",
        "length": f"{found.effective_length:.2f}",
    }


DERIVE: dict[Family, Callable[[Row], dict[str, str]]] = {
    "deep_groove": _deep_groove,
    "angular_contact": _angular_contact,
    "self_aligning": _self_aligning,
    "cylindrical": _cylindrical,
    "tapered": lambda row: _inclined(row, "tapered"),
    "spherical": lambda row: _inclined(row, "spherical"),
}
"""The derivation of each family: columns of a row, as text, to the derived ones."""


if __name__ == "__main__":
    main()
