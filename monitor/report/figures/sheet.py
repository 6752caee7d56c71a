"""Reports of the model: figures with captions, as one picture (PNG, SVG) or as a page (HTML)."""

from __future__ import annotations

import io
import itertools
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure, FigureBase

from monitor.report.figures.drawing import INK, SOFT, STYLE, WIDTH, Picture, to_svg
from monitor.report.options import Options
from monitor.report.page import render
from monitor.report.tables import write_whole

_LETTERS = 150
"""Characters of a caption in one line of a picture."""
_LINE, _HEADING, _TITLE = 0.165, 0.34, 0.42
"""Heights in inches: of a line of caption, of a heading, of the title."""
_DPI = 130


@dataclass(frozen=True, eq=False)
class Part:
    """A figure of a model report; other fields as in :class:`monitor.report.figures.drawing.Picture`.

    Attributes:
        label: alternative text.
        height: in inches.
        draw: draws it into a figure (page) or subfigure (picture).
    """

    heading: str
    caption: str
    label: str
    height: float
    draw: Callable[[FigureBase], None]
    data: Mapping[str, Any] = field(default_factory=dict)
    name: str = ""

    @mpl.rc_context(STYLE)
    def picture(self, numbers: itertools.count[int]) -> Picture:
        """Return it as a figure of a page."""
        figure = Figure(figsize=(WIDTH, self.height), layout="constrained")
        self.draw(figure)
        return Picture(self.heading, to_svg(figure, self.label, numbers), self.caption, self.data, self.name)


@dataclass(frozen=True, eq=False)
class Sheet:
    """A model report: title, leading sentence, figures, and provenance as labels and texts."""

    title: str
    lead: str
    parts: Sequence[Part]
    facts: Sequence[tuple[str, str]] = ()


def write_sheet(sheet: Sheet, path: Path) -> None:
    """Write a report as HTML, PNG or SVG by the name's ending.

    Raises:
        OSError: the file cannot be written.
    """
    if path.suffix.lower() == ".html":
        numbers = itertools.count(1)
        pictures = [part.picture(numbers) for part in sheet.parts]
        values = {"sheet": sheet, "title": sheet.title, "pictures": pictures, "options": Options()}
        write_whole(path, render("model.html.j2", **values))
        return
    # On white, as a picture has no page.
    buffer, kind = io.BytesIO(), path.suffix.lower().removeprefix(".")
    with mpl.rc_context(STYLE):
        figure = compose(sheet)
        figure.set(dpi=_DPI, facecolor="white")
        # Figure.savefig would draw everything twice, the first time for the layout, which drawing makes anyway.
        if kind == "svg":
            FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None})
        else:
            FigureCanvasAgg(figure).print_png(buffer)
    write_whole(path, buffer.getvalue(), make_folder=False)


@mpl.rc_context(STYLE)
def compose(sheet: Sheet) -> Figure:
    """Return all parts below each other, with captions, and the facts at the foot."""
    captions = [textwrap.fill(part.caption, _LETTERS) for part in sheet.parts]
    foot = textwrap.fill("; ".join(f"{name}: {text}" for name, text in sheet.facts), _LETTERS + 10)
    heights = [part.height + _HEADING + _height(text) for part, text in zip(sheet.parts, captions, strict=True)]
    lead = textwrap.fill(sheet.lead, _LETTERS - 16)
    ends = [_TITLE + 1.2 * _height(lead), _height(foot) + 0.1]
    figure = Figure(figsize=(WIDTH, sum(heights) + sum(ends)), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(len(heights) + 2, 1, height_ratios=[ends[0], *heights, ends[1]])
    rows = [figure.add_subfigure(grid[place, 0]) for place in range(len(heights) + 2)]
    rows[0].text(0.012, 0.9, sheet.title, fontsize=14, fontweight="bold", color=INK, va="top")
    rows[0].text(0.012, 0.04, lead, color=SOFT, va="bottom")
    for row, part, caption in zip(rows[1:-1], sheet.parts, captions, strict=True):
        part.draw(row)
        row.suptitle(part.heading, x=0.012, ha="left", fontsize=11, fontweight="bold", color=INK)
        row.supxlabel(caption, x=0.012, ha="left", fontsize=8.5, color=SOFT)
    rows[-1].text(0.012, 0.95, foot, fontsize=7.5, color=SOFT, va="top")
    return figure


def _height(text: str) -> float:
    return _LINE * (text.count("\n") + 1) if text else 0.0
