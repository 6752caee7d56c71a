"""Every figure that the five sources print: beside what this program obtains, or with why it computes none.

python -m benchmarks.published.figures [--quick] [--json FILE] [--document docs/evidence/published-figures.md]

One line for each place and quantity; --json holds every figure. ``--quick`` changes nothing: it takes a few seconds.
``--document`` renews the two tables in that file, between the lines that MARKS and the like name.
"""

from __future__ import annotations

import argparse
from collections import Counter
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.common import Row, print_table, write_json
from models.published.acceptance import Figure, worst
from models.published.thesis import published_figures
from models.published.uncomputed import uncomputed_figures
from reference.accepted import ACCEPTANCE, rows_of

if TYPE_CHECKING:
    from models.published.acceptance import AcceptanceRow

Marks = tuple[str, str]
MARKS: Marks = ("<!-- table of benchmarks.published.figures -->\n", "<!-- end of the table -->\n")
ACCEPTANCE_MARKS: Marks = (
    "<!-- acceptance table of benchmarks.published.figures -->\n",
    "<!-- end of the acceptance table -->\n",
)


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
                "note": "" if verdict(group) == "reproduced" else poorest.note,
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


def acceptance_rows() -> list[AcceptanceRow]:
    """Return the acceptance rows of all models but the thesis' bearings."""
    return [row for module in ACCEPTANCE for row in rows_of(module)]


def acceptance_table(accepted: list[AcceptanceRow]) -> list[Row]:
    """Return what the document says of acceptance rows."""
    return [
        {
            "source": row.source,
            "quantity": row.quantity,
            "unit": row.unit,
            "printed": row.printed,
            "obtained": f"{row.obtained:.4g}",
            "difference %": _signed(100.0 * row.difference),
            "status": row.status,
            "note": "" if row.status in ("EXACT", "REPRO") else row.note,
        }
        for row in accepted
    ]


def uncomputed_table() -> list[Row]:
    """Return the printed figures that are not computed."""
    return [
        {
            "source": figure.source,
            "place": ", ".join(figure.places),
            "quantity": figure.quantity,
            "printed": figure.printed,
            "status": figure.status,
            "reason": figure.reason,
        }
        for figure in uncomputed_figures()
    ]


def markdown_table(rows: list[Row]) -> str:
    """Return a table in Markdown."""
    names = list(rows[0])
    cells = [["" if row[name] is None else str(row[name]) for name in names] for row in rows]
    lines = [names, ["---"] * len(names), *cells]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def renewed(text: str, table: str, marks: Marks = MARKS) -> str:
    """Return the text of a document with the table between two marks replaced.

    Raises:
        ValueError: if a mark is missing.
    """
    before, first, rest = text.partition(marks[0])
    _, last, after = rest.partition(marks[1])
    if not first or not last:
        raise ValueError(f"the document lacks the lines {marks[0].strip()!r} and {marks[1].strip()!r}")
    return before + first + table + last + after


def tables_of_the_page() -> dict[Marks, str]:
    """Return the tables of the page by the marks that they stand between."""
    return {
        MARKS: markdown_table(group_rows(published_figures())),
        ACCEPTANCE_MARKS: markdown_table(acceptance_table(acceptance_rows())),
    }


def main() -> None:
    """Print the table; write the JSON file and renew the document if they were asked for."""
    parser = argparse.ArgumentParser(description="Published figures: printed, obtained, verdict.")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures to this file")
    parser.add_argument("--quick", action="store_true", help="changes nothing")
    parser.add_argument("--document", type=Path, metavar="FILE", help="renew the tables in this file")
    options = parser.parse_args()
    figures = published_figures()
    print_table("worst figure of each group", group_rows(figures))
    counts = Counter(figure.verdict for figure in figures)
    print_table("all figures", [{"verdict": name, "figures": count} for name, count in counts.items()])
    accepted, uncomputed = acceptance_table(acceptance_rows()), uncomputed_table()
    print_table("acceptance table of the other models", accepted)
    print_table("not computed", uncomputed)
    tables = {"figures": figure_rows(figures), "acceptance": accepted, "uncomputed": uncomputed}
    write_json(options.json, tables)
    if options.document is not None:
        text = options.document.read_text(encoding="utf-8")
        for marks, table in tables_of_the_page().items():
            text = renewed(text, table, marks)
        options.document.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
