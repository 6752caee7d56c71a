"""The tables of docs/evidence/forecasting.md, made of what ``benchmarks.forecast.methods`` has measured.

Run as ``python -m benchmarks.forecast.page [--results FILE] [--document FILE]``. A table stands between the lines
``<!-- NAME of benchmarks.forecast.methods -->`` and ``<!-- end -->``. The three figures of a cell are those at 1/4, 1/2
and 3/4 of the time from the onset to the threshold.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

Row = Mapping[str, Any]
Column = tuple[str, Callable[[Row], str]]

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "benchmarks" / "results" / "forecast.json"
DOCUMENT = ROOT / "docs" / "evidence" / "forecasting.md"


def _number(digits: int) -> Callable[[Any], str]:
    return lambda value: "-" if value is None else f"{value:.{digits}f}"


_SHARE, _MINUTES = _number(2), _number(0)
_SCORES = {
    "TT: CRPS, min": ("crps_min", _MINUTES),
    "over climatology": ("over_climatology", _SHARE),
    "TT: coverage": ("tt_coverage", _SHARE),
    "TT: width, min": ("tt_width_min", _MINUTES),
    "ln V_eq: rms error": ("v_rms_ln", _SHARE),
    "V_eq: coverage": ("v_coverage", _SHARE),
    "ln V_eq: width": ("v_width_ln", _SHARE),
    "refused": ("refused", _SHARE),
}


def markdown(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """Return a table."""
    rows = [head, ["---"] + ["--:"] * (len(head) - 1), *lines]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def by_moment(rows: Sequence[Row], keys: Mapping[str, str], columns: Sequence[str]) -> str:
    """Return a table with the three moments of a figure in one cell.

    Args:
        rows: figures, the moments of one method beside each other.
        keys: title and key of the columns that tell the lines apart.
        columns: titles of ``_SCORES``.
    """
    groups: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(str(row[key]) for key in keys.values()), []).append(row)
    lines = []
    for group, moments in groups.items():
        cells = [[text(row.get(key)) for row in moments] for key, text in (_SCORES[title] for title in columns)]
        lines.append([*group, *("-" if set(cell) == {"-"} else " / ".join(cell) for cell in cells)])
    return markdown([*keys, *columns], lines)


def bound_table(rows: Sequence[Row]) -> str:
    """Return how far the forecasters are from the bound."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(row["method"], []).append(row)
    columns = (("CRPS over the bound's", "over_bound"), ("share of the way to it", "gain_reached"))
    lines = [
        [method, *(" / ".join(_SHARE(row[key]) for row in moments) for _, key in columns)]
        for method, moments in groups.items()
    ]
    return markdown(["method", *(title for title, _ in columns)], lines)


def _with_error(row: Row, key: str, digits: int) -> str:
    return "-" if row[key] is None else f"{row[key]:.{digits}f} ± {row[f'{key}_se']:.{digits}f}"


def tables(results: Mapping[str, Any]) -> dict[str, str]:
    """Return all tables by name."""
    figures = ["TT: CRPS, min", "over climatology", "TT: coverage", "ln V_eq: rms error", "V_eq: coverage"]
    every = [title for title in _SCORES if title != "over climatology"]
    law = {"law": "law", "method": "method"}
    return {
        "methods": by_moment(results["methods"], {"method": "method"}, every),
        "laws": by_moment(results["by_law"], law, figures),
        "unseen laws": by_moment(results["unseen_law"], {"law left out": "law left out", "method": "method"}, figures),
        "bound": bound_table(results["bound"]),
    }


def renewed(text: str, found: Mapping[str, str]) -> str:
    """Return the text of a page with its tables replaced.

    Raises:
        ValueError: if the page lacks the marks of a table.
    """
    for name, table in found.items():
        mark = f"<!-- {name} of benchmarks.forecast.methods -->"
        pattern = re.compile(re.escape(mark) + r"\n.*?<!-- end -->", re.DOTALL)
        if not pattern.search(text):
            raise ValueError(f"the page lacks the lines {mark!r} and '<!-- end -->'")
        replacement = f"{mark}\n\n{table}\n\n<!-- end -->"
        text = pattern.sub(lambda _, new=replacement: new, text)
    return text


def main() -> None:
    """Renew the page."""
    parser = argparse.ArgumentParser(description="Renew the tables of the page on forecasts.")
    parser.add_argument("--results", type=Path, default=RESULTS, help="what benchmarks.forecast.methods wrote")
    parser.add_argument("--document", type=Path, default=DOCUMENT, help="the page")
    options = parser.parse_args()
    found = tables(json.loads(options.results.read_text(encoding="utf-8")))
    text = options.document.read_text(encoding="utf-8")
    options.document.write_text(renewed(text, found), encoding="utf-8")


if __name__ == "__main__":
    main()
