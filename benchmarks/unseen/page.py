"""The page docs/evidence/unseen.md from the results of ``benchmarks.unseen.judge`` and ``benchmarks.unseen.nonsense``.

Run as ``python -m benchmarks.unseen.page``. Reads ``benchmarks/results/unseen.json`` (judged), ``unseen_nonsense.json``
(judged), ``unseen_first.json`` (an earlier judged score), and the ``_baseline`` of each: those of the program before. A
file that there is not is left out, and said.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.unseen.ask import FRACTIONS
from benchmarks.unseen.causes import WATCHED
from benchmarks.unseen.judge import LINES, RMS

_FOLDER = Path(__file__).parents[1] / "results"
_PAGE = Path(__file__).parents[2] / "docs" / "evidence" / "unseen.md"
Rows = Sequence[Mapping[str, Any]]
_FLAGS = """By the library, TT at a stall becomes `no_growth` once V_eq has probably stood still for twelve blocks; by
a prior in which damage takes up to 20 h that is late: most stalls are not known within 50 blocks. Sound lives are
flagged by steps of the RMS that growth can make too, and by slow stretches. A step of the load that the monitor does
not know looks like growth or wear, and is not told.
"""

_BY_LAW = (("tt_inside", 2, RMS), ("tt_inside", 2, LINES), ("crps_min", 0, LINES), ("v_inside", 2, LINES))

_HEAD = """# Lives that nobody simulated for the forecast

A forecast by a [library of simulated lives](forecasting.md) is honest about its own prior; what it is worth depends on
how far the machine's own growth lies from it. Here it is asked about lives that were written for that alone
(`benchmarks/unseen/laws.py`, `unseen_lives.py`), without a look at the laws of the library:

- twelve laws, read from Table 22 of the thesis, the RMS of eleven PRONOSTIA runs, descriptions of XJTU-SY, and papers
  on crack growth and spalls; from the onset (0.0006 to 0.004 mm3/mm) to 0.05 mm3/mm they take 2 to 20 h;
- own rigs (all ten parameters 2 to 6 % off), floors, and slip in three of ten; a gain 12 % off that drifts by 5 % in a
  life; a speed up to 0.5 % off and unsteady by 0.05 to 0.4 %; a load up to 3 % off and unsteady by 0.3 to 1.5 %, in a
  fifth of the lives changed by up to 12 %, known to the monitor; background; 1.5 to 8 % of noise on each figure of a
  block; up to 6 % of the blocks, and at times an hour, missing.

Only the model of the bearing is shared with the library. **What this cannot show**: how far that model is from a real
machine. The library is that of `library build` with default settings for 3000 to 5000 N and 20 to 45 Hz. Its prior was
widened after the first score: scatter of each figure as recorded (RMS 1 to 8 %, lines 2
to 20 %), load and speed that are known wrongly, V_eq at the onset from 0.0004 mm3/mm, and 2 to 20 h to the threshold in
place of 2.5 to 15 h: the 95 % in place of the 90 % prediction interval of a further life after the six of Table 22.
That is also the range of the lives judged, so that none of them is shorter or longer any more.

Choices (how long a standstill must last to be claimed, limits of what a life can be, how likely growth accelerates)
were made on the lives of the first score, seeds from 1808000, which so became development lives. The score below is on
new ones, set aside before; the laws are the same twelve. On the library's own lives, whose laws are harder, the
intervals of TT are somewhat narrow: out of fold 0.67/0.76/0.84 (RMS) and 0.72/0.76/0.76 (lines) lie inside.

TT inside: the bounds as issued, whose upper end is infinite where standing still is likely enough. A missing answer
(`no_growth`, too few blocks) counts as the constant guess in the CRPS and not in the coverage. "Clock" weights other
lifetimes by the time gone; the median of "as long again as it has lasted" is exact at 1/2 by the choice of the moments.
"""


def _read(name: str) -> dict[str, Any] | None:
    path = _FOLDER / f"{name}.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else None


def _number(value: float | None, digits: int = 2) -> str:
    if value is None:
        return "–"
    return f"{value:.{digits}f}"


def _table(header: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    rule = "|".join(["---"] * len(header))
    body = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    return f"| {' | '.join(header)} |\n|{rule}|\n{body}\n"


def methods_table(rows: Rows) -> str:
    """Return all methods, the figures of the three moments behind each other."""
    figures = {"crps_min": 0, "tt_inside": 2, "v_rms": 2, "v_inside": 2, "refused": 2}
    lines: list[list[str]] = []
    for name in dict.fromkeys(row["method"] for row in rows):
        own = [row for row in rows if row["method"] == name]
        cells = ["/".join(_number(row[figure], digits) for row in own) for figure, digits in figures.items()]
        lines.append([f"{name} ({own[0]['lives']})", *cells])
    header = ["method (lives)", "CRPS of TT, min", "TT inside 80 %", "rms of ln V_eq", "V_eq inside 80 %", "refused"]
    return _table(header, lines)


def laws_table(rows: Rows) -> str:
    """Return CRPS and coverage by law, with RMS alone and with lines."""
    lines: list[list[str]] = []
    for law in dict.fromkeys(row["law"] for row in rows):
        cells: list[str] = []
        for figure, digits, methods in (
            ("tt_inside", 2, (RMS, LINES)),
            ("crps_min", 0, (LINES,)),
            ("v_inside", 2, (LINES,)),
        ):
            for method in methods:
                (row,) = [row for row in rows if row["law"] == law and row["method"] == method]
                cells.append("/".join(_number(row[f"{figure}_{at:g}"], digits) for at in FRACTIONS))
        lines.append([law.replace("_", " "), *cells])
    return _table(["law", "TT inside, RMS", "TT inside, lines", "CRPS, lines, min", "V_eq inside, lines"], lines)


def asked_table(rows: Rows) -> str:
    """Return what was asked for over all lives, and each law of which something was missed."""
    kept = [row for row in rows if not row["what"].startswith("coverage of TT, ") or row["met"] == "MISS"]
    kept += [row for row in rows if row not in kept and row["kind"] == "floor"]
    lines = [
        [
            row["kind"],
            row["what"].replace("_", " ").replace("V eq", "V_eq"),
            row["asked"],
            "/".join(_number(row[f"at_{at:g}"]) for at in FRACTIONS),
            row["met"].replace("MISS", "**missed**"),
        ]
        for row in kept
    ]
    return _table(["", "figure", "asked", "found at 1/4, 1/2, 3/4", ""], lines)


def causes_table(rows: Rows) -> str:
    """Return how often causes were flagged."""
    lines = [
        [
            row["cause"],
            row["method"],
            row["flag"],
            f"{row['flagged']:.0%} of {row['lives']}",
            f"{row['but_no_growth']:.0%}" if "but_no_growth" in row else "–",
            _number(row["median_delay"], 0),
            f"{row['before']:.0%}",
            f"{row['at_last']:.0%}",
            f"{row['ambiguous']:.0%}" if "ambiguous" in row else "–",
        ]
        for row in rows
    ]
    header = ["cause", "V_eq by", "to be flagged", f"within {WATCHED} blocks", "but `no_growth`", "median delay"]
    return _table([*header, "before", "at the last", "`ambiguous`"], lines)


def sound_table(rows: Rows) -> str:
    """Return how often lives without a cause were flagged."""
    lines = [
        [
            row["lives"],
            row["method"],
            str(row["count"]),
            f"{row['ever_flagged']:.1%}",
            f"{row['but_no_growth']:.1%}",
            f"{row['asked']:.0%}",
            row["met"].replace("MISS", "**missed**"),
            row["lives_by_status"] or "–",
        ]
        for row in rows
    ]
    return _table(["lives", "V_eq by", "count", "ever flagged", "but `no_growth`", "asked", "", "statuses"], lines)


def _origin(found: Mapping[str, Any]) -> str:
    made = found["made"]
    return f"Commit {found['commit']}, seeds from {made['seeds']}, library {made['library'][:12]} ({made['prior']})."


def page() -> str:
    """Return the page."""
    parts = [_HEAD]
    judged, flags = _read("unseen"), _read("unseen_nonsense")
    parts.append("## V_eq and TT\n")
    if judged is None:
        parts.append("Not judged yet: `python -m benchmarks.unseen.judge --judged`.\n")
    else:
        parts += [f"Scored once. {_origin(judged)}\n", methods_table(judged["methods"])]
        parts += ["### What was asked\n", asked_table(judged["asked"]), "### By law\n", laws_table(judged["laws"])]
    parts.append("## Flags\n")
    parts.append(_FLAGS)
    if flags is None:
        parts.append("Not judged yet: `python -m benchmarks.unseen.nonsense --judged --json FILE`.\n")
    else:
        parts += [f"Judged. {_origin(flags)}\n", causes_table(flags["causes"]), sound_table(flags["sound"])]
    return "\n".join(parts)


def main() -> None:
    """Write the page."""
    _PAGE.write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
