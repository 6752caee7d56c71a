"""Every static figure that the thesis prints, beside what this program obtains.

python -m benchmarks.published [--quick] [--json FILE]

One line for each place and quantity; --json holds every figure. ``--quick`` changes nothing: it all takes a second.
"""

from __future__ import annotations

from collections import Counter
from itertools import groupby

from benchmarks.common import Row, arguments, print_table, write_json
from models.published.catalogue import published_figures
from models.published.figure import Figure, worst


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
                "difference %": None if bound else f"{100.0 * poorest.difference:+.2f}",
                "verdict": verdict(group),
                "note": poorest.note,
            }
        )
    return rows


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


def main() -> None:
    """Print the table and write the JSON file if one was asked for."""
    options = arguments("Static figures of the thesis: printed, obtained, difference, verdict.")
    figures = published_figures()
    print_table("worst figure of each group", group_rows(figures))
    counts = Counter(figure.verdict for figure in figures)
    print_table("all figures", [{"verdict": name, "figures": count} for name, count in counts.items()])
    write_json(options.json, {"figures": figure_rows(figures)})


if __name__ == "__main__":
    main()
