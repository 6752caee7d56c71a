"""The printed figures of chapter 3 of the thesis beside what the benchmarks of finite elements obtained.

Each ``benchmarks/results/fe_*.json`` has a table "published": place, bearing, quantity, condition, unit, printed and
obtained value, and where there is more to say a status and a note. Nothing is computed here.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from benchmarks.common import Row

RESULTS = Path(__file__).resolve().parent / "results"
POINTS = 3.0
"""Percentages that differ by so many points agree, and other values that differ by so many percent."""
_TIME = "another program on another machine"
NOTES: tuple[tuple[str, str, str], ...] = (
    ("Table 17", "k_", "printed is Eq. 19 with k_c = 5927 MN/m^1.5; exact Hertz at the contact angle lies 8 % below"),
    (
        "Fig. 25",
        "stiffness",
        "bars of steel or rigid, without play; the dimensions of the printed cage are not known",
    ),
    ("Fig. 25", "time", _TIME),
    ("3.4.3", "time", _TIME + "; ring and shaft are condensed once"),
    ("3.4.3", "load of the roller", "on a whole ring; cut to the loaded half as in the thesis: another row"),
)
"""Place, begin of the quantity, and what is known of the difference, where the results do not say it."""
WHOLE_WIDTH = {"NU 202 ECP": "sector, 11 mm", "6210": "sector, 20 mm"}
"""Sectors whose bore carries load over the whole width of the ring, in the table "widths" of fe_sizes."""
_WORDS = {"REPRO": "agrees", "NO": "differs"}


def fe_rows(folder: Path = RESULTS) -> list[Row]:
    """Return one row for every printed figure, in the order of places in the thesis.

    Raises:
        KeyError: a row of a results file lacks a key.
    """
    rows: list[Row] = []
    for path in sorted(folder.glob("fe_*.json")):
        results = json.loads(path.read_text(encoding="utf-8"))
        calibrated = {row["bearing"]: row for row in results.get("widths", []) if row["what"] in WHOLE_WIDTH.values()}
        rows.extend(_row(row, path.stem, calibrated) for row in results.get("published", []))
    return sorted(rows, key=lambda row: _place(str(row["place"])))


def _row(row: dict[str, Any], script: str, calibrated: dict[str, Any]) -> Row:
    printed, obtained = row["printed"], row["obtained"]
    status, note = row.get("status") or _status(row, printed, obtained), row.get("note") or _note(row)
    if row["bearing"] in calibrated and row["place"].startswith("Table"):
        other = calibrated[row["bearing"]]
        status = f"CALIB, {status}"
        note = (
            "level in sample: chamfers of the bore, not printed, are chosen; without them "
            f"{other['Q1 %']:.1f} and {other['Q2 %']:.1f} % (own rule)"
        )
    return {
        "place": row["place"],
        "bearing": row["bearing"],
        "quantity": row["quantity"],
        "condition": row["condition"],
        "unit": row["unit"],
        "printed": _text(printed),
        "obtained": _text(obtained),
        "status": _WORDS.get(status, status),
        "script": script,
        "note": note,
    }


def _note(row: dict[str, Any]) -> str:
    return next(
        (note for place, quantity, note in NOTES if row["place"] == place and row["quantity"].startswith(quantity)), ""
    )


def _status(row: dict[str, Any], printed: Any, obtained: Any) -> str:
    """Return "agrees" within the tolerance, else "differs"; "in kind" for a range, a word, or a time."""
    if row["quantity"].startswith("time") or isinstance(printed, str) or isinstance(obtained, str) or obtained is None:
        return "in kind"
    difference = abs(obtained - printed)
    allowed = POINTS if row["unit"] == "%" else 1e-2 * POINTS * abs(printed)
    return "agrees" if difference <= allowed else "differs"


def _text(value: Any) -> str:
    if value is None:
        return "-"
    return value if isinstance(value, str) else f"{value:.4g}"


def _place(place: str) -> tuple[int, str]:
    """Return a key by which tables come before figures, each by number, and sections last."""
    number = "".join(c if c.isdigit() else " " for c in place).split()
    kind = 0 if place.startswith("Table") else 1 if place.startswith("Fig") else 2
    return 1000 * kind + (int(number[0]) if number else 999), place
