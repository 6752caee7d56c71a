"""Tables and diagram of the sizes of finite elements for docs/evidence/finite-elements.md."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from benchmarks.common import Row

mpl.use("Agg")


def renew(page: Path, tables: Mapping[str, Sequence[Row]]) -> None:
    """Replace each table between ``<!-- sizes NAME -->`` and ``<!-- end of sizes NAME -->``."""
    text = page.read_text(encoding="utf-8")
    for name, rows in tables.items():
        start, end = f"<!-- sizes {name} -->", f"<!-- end of sizes {name} -->"
        if start in text:
            before, rest = text.split(start, 1)
            after = rest.split(end, 1)[1]
            text = f"{before}{start}\n{markdown(_SHAPES.get(name, list)(rows))}\n{end}{after}"
    page.write_text(text, encoding="utf-8")


def _by_load(rows: Sequence[Row]) -> list[Row]:
    """Return the rows of both loads of a table of the thesis in one."""
    return [
        {
            "table, row": f"{low['place']}, {low['row']}",
            "w": low["w/b"],
            "l": low["l/b"],
            "Q_1: printed": low["printed %"],
            "here": low["obtained %"],
            "Q_2: printed": high["printed %"],
            "here ": high["obtained %"],
            "unknowns Q_1": low["unknowns"],
            "s Q_1": low["seconds"],
            "unknowns Q_2": high["unknowns"],
            "s Q_2": high["seconds"],
        }
        for low, high in zip(rows[::2], rows[1::2], strict=True)
    ]


def _by_variant(rows: Sequence[Row]) -> list[Row]:
    """Return one row a variant of the rule: error of each bearing, the largest, and the mean cost by the own rule's."""
    cases = list(dict.fromkeys((row["bearing"], row["Q N"]) for row in rows))
    found: list[Row] = []
    own = _sums(rows, "own")
    for what in dict.fromkeys(row["rule"] for row in rows if row["rule"] != "reference"):
        errors = {
            f"{name}, {load:g} N": next(
                row["error %"] for row in rows if row["rule"] == what and (row["bearing"], row["Q N"]) == (name, load)
            )
            for name, load in cases
        }
        unknowns, seconds = _sums(rows, str(what))
        found.append({"rule": what, **errors, "unknowns by own": unknowns / own[0], "time by own": seconds / own[1]})
    return found


def _sums(rows: Sequence[Row], what: str) -> tuple[float, float]:
    chosen = [row for row in rows if row["rule"] == what]
    return sum(float(row["unknowns"] or 0) for row in chosen), sum(float(row["seconds"] or 0) for row in chosen)


_SHAPES = {"tables": _by_load, "rule": _by_variant}


def markdown(rows: Sequence[Row]) -> str:
    """Return rows as a table of three digits."""
    names = list(rows[0])
    lines = ["| " + " | ".join(names) + " |", "|" + "---|" * len(names)]
    lines += ["| " + " | ".join(_cell(row[name]) for name in names) + " |" for row in rows]
    return "\n".join(lines)


def _cell(value: float | str | None) -> str:
    if isinstance(value, int) and not isinstance(value, bool):
        return f"{value:,}"
    if isinstance(value, float):
        return f"{value:.2f}" if abs(value) < 100.0 else f"{value:.0f}"
    return str(value)


def diagram(tables: Mapping[str, Sequence[Row]], target: Path) -> None:
    """Draw error against unknowns and against time of uniform and own meshes, one row of panels a load."""
    rows = tables.get("uniform")
    if not rows:
        return
    loads = sorted({float(row["Q N"] or 0.0) for row in rows})
    figure = Figure(figsize=(9.0, 3.3 * len(loads)), layout="constrained")
    panels = figure.subplots(len(loads), 2, squeeze=False)
    styles = {"own": ("C0", "o", "size follows the load"), "uniform": ("C1", "s", "one size throughout")}
    for line, load in zip(panels, loads, strict=True):
        for panel, what in zip(line, ("unknowns", "seconds"), strict=True):
            for kind, (colour, marker, label) in styles.items():
                found = [row for row in rows if row["Q N"] == load and str(row["rule"]).startswith(kind)]
                x = [float(row[what] or 0.0) for row in found]
                y = [abs(float(row["error %"] or 0.0)) for row in found]
                panel.loglog(x, y, color=colour, marker=marker, label=label)
                for a, b, row in zip(x, y, found, strict=True):
                    text = str(row["rule"]).split(", ")[1]
                    panel.annotate(text, (a, b), textcoords="offset points", xytext=(5, 4), fontsize=7)
            panel.axhline(1.0, color="0.7", linewidth=0.8)
            panel.set_xlabel("unknowns of both bodies" if what == "unknowns" else "processor time, s")
            panel.set_ylabel("error of the approach, %")
            panel.set_title(f"NU 202 ECP, inner contact, Q = {load:g} N", fontsize=9)
            panel.grid(visible=True, which="both", alpha=0.25)
    panels[0][0].legend(fontsize=8, loc="lower left")
    figure.savefig(target, dpi=110)
