"""What the figures of simulated lives share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import FigureBase

from benchmarks.gallery_lives import (
    LOADS,
    TESTS,
)
from benchmarks.gallery_plate import Claim, letter
from monitor.report.figures.drawing import BLUE, GREEN, VERMILION
from streams.block import STANDARD_GRAVITY

G = STANDARD_GRAVITY
TWIN = "simulated lives with the loads, lengths and growth of the tests; not the tests"
STROKES: dict[str, tuple[str, Any]] = {
    "E1": (BLUE, "-"),
    "E2": (VERMILION, "--"),
    "E3": (GREEN, "-."),
    "E4": (BLUE, "-"),
    "E5": (VERMILION, "--"),
    "E6": (GREEN, "-."),
}
HALVES = (TESTS[:3], TESTS[3:])


def named(test: str) -> str:
    """Return the name of a test with its load, as print has it."""
    return f"{test} ({LOADS[test] / 1e3:g} kN)"


def not_comparable(what: str, printed: str, obtained: str) -> Claim:
    """Return a claim about another machine, beside what the print has."""
    return Claim(what, printed, obtained, "not comparable")


def six(label: str, values: Callable[[str, Axes], None], made: FigureBase, x_label: str) -> None:
    """Draw each test into a panel of its own, as print does."""
    panels = made.subplots(2, 3)
    for place, (axes, test) in enumerate(zip(panels.flat, TESTS, strict=True)):
        values(test, axes)
        letter(axes, place, named(test))
    for axes in panels[-1]:
        axes.set_xlabel(x_label)
    for axes in panels[:, 0]:
        axes.set_ylabel(label)


def pair(made: FigureBase, line: Callable[[str, Axes], None], label: str) -> Sequence[Axes]:
    """Draw three tests into each of two panels, as print does."""
    panels = list(made.subplots(1, 2))
    for place, (axes, tests) in enumerate(zip(panels, HALVES, strict=True)):
        for test in tests:
            line(test, axes)
        letter(axes, place, "")
        axes.legend(loc="upper left", fontsize=8)
        axes.set_xlabel("time from t_fs (min)")
    panels[0].set_ylabel(label)
    return panels
