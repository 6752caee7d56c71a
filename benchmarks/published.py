"""Every static figure that the thesis prints, beside what this program obtains.

python -m benchmarks.published [--quick] [--json FILE] [--document docs/evidence/published-figures.md]

One line for each place and quantity; --json holds every figure. ``--quick`` changes nothing: it all takes a second.
``--document`` renews the table in that file, between the lines that MARKS names.
"""

from __future__ import annotations

import argparse
from collections import Counter
from itertools import groupby
from pathlib import Path

from benchmarks.common import Row, print_table, write_json
from models.published.figure import Figure, worst
from models.published.thesis import published_figures

MARKS = ("<!-- table of benchmarks.published -->\n", "<!-- end of the table -->\n")


def group_rows(figures: list[Figure]) -> list[Row]:
    """Return one row for every place and quantity, with the figure that is met worst."""
    rows: list[Row] = []
    for (designation, place, quantity), members in groupby(figures, lambda f: (f.designation, f.place, f.quantity)):
        group = list(members)
        poorest = worst(group)
        bound = "" if poorest.relation == "=" else poorest.relation + " "
        rows.append(
            {
                "bearing": designation,
                "place": place,
                "quantity": quantity,
                "figures": len(group),
                "unit": poorest.unit,
                "printed": bound + poorest.text,
                "obtained": f"{poorest.obtained:.6g}",
                "difference %": None if bound else _signed(100.0 * poorest.difference),
                "verdict": verdict(group),
                "note": poorest.note,
            }
        )
    return rows


def _signed(value: float) -> str:
    """Return two decimals with a sign, and no sign where they are zero."""
    text = f"{value:+.2f}"
    return "0.00" if float(text) == 0.0 else text


def verdict(group: list[Figure]) -> str:
    """Return the verdict that all share, or how many have which."""
    counts = Counter(figure.verdict for figure in group)
    if len(counts) == 1:
        return next(iter(counts))
    return ", ".join(f"{count} {name}" for name, count in counts.most_common())


def figure_rows(figures: list[Figure]) -> list[Row]:
    """Return one row for every figure."""
    return [
        {
            "bearing": f.designation,
            "place": f.place,
            "quantity": f.quantity,
            "condition": f.condition,
            "unit": f.unit,
            "relation": f.relation,
            "printed": f.printed,
            "obtained": f.obtained,
            "difference_percent": 100.0 * f.difference,
            "verdict": f.verdict,
            "note": f.note,
        }
        for f in figures
    ]


def markdown_table(figures: list[Figure]) -> str:
    """Return the table of the groups in Markdown."""
    rows = group_rows(figures)
    names = list(rows[0])
    cells = [["" if row[name] is None else str(row[name]) for name in names] for row in rows]
    lines = [names, ["---"] * len(names), *cells]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def renewed(text: str, table: str) -> str:
    """Return the text of a document with the table between its marks replaced.

    Raises:
        ValueError: if a mark is missing.
    """
    before, first, rest = text.partition(MARKS[0])
    _, last, after = rest.partition(MARKS[1])
    if not first or not last:
        raise ValueError(f"the document lacks the lines {MARKS[0].strip()!r} and {MARKS[1].strip()!r}")
    return before + first + table + last + after


def main() -> None:
    """Print the table; write the JSON file and renew the document if they were asked for."""
    parser = argparse.ArgumentParser(description="Static figures of the thesis: printed, obtained, verdict.")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures to this file")
    parser.add_argument("--quick", action="store_true", help="changes nothing")
    parser.add_argument("--document", type=Path, metavar="FILE", help="renew the table in this file")
    options = parser.parse_args()
    figures = published_figures()
    print_table("worst figure of each group", group_rows(figures))
    counts = Counter(figure.verdict for figure in figures)
    print_table("all figures", [{"verdict": name, "figures": count} for name, count in counts.items()])
    write_json(options.json, {"figures": figure_rows(figures)})
    if options.document is not None:
        text = options.document.read_text(encoding="utf-8")
        options.document.write_text(renewed(text, markdown_table(figures)), encoding="utf-8")


if __name__ == "__main__":
    main()
