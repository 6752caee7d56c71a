"""Marks that all figures of an identification share: candidates, the front, the best fit, the values before."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from monitor.identify.report.subject import Subject, Values
from monitor.report.figures.drawing import AXIS, BLUE, INK, ORANGE, PAPER, PURPLE, SKY, VERMILION

MAX_DOTS = 250
"""Candidates of each kind that a panel shows."""
FAR_EXCESS = 30.0
"""Candidates whose cost exceeds the least by more of what the intervals add are not drawn."""


@dataclass(frozen=True)
class CandidateMark:
    """How one kind of candidate is drawn, and its words in a legend."""

    words: str
    shape: str
    colour: str
    size: float
    filled: bool = True

    def draw(self, axes: Axes, x: Values | float, y: Values | float, order: int = 3) -> None:
        """Draw it at places."""
        inside = self.colour if self.filled else "none"
        edge = PAPER if self.shape == "*" else self.colour
        axes.plot(
            x, y, linestyle="none", marker=self.shape, markersize=self.size, color=self.colour, markerfacecolor=inside,
            markeredgecolor=edge, markeredgewidth=0.7 if self.filled else 1.2, zorder=order,
        )  # fmt: skip

    @property
    def handle(self) -> Line2D:
        """What a legend shows."""
        return Line2D(
            [], [], linestyle="none", marker=self.shape, markersize=self.size, color=self.colour,
            markerfacecolor=self.colour if self.filled else "none", markeredgecolor=self.colour, label=self.words,
        )  # fmt: skip


ANY = CandidateMark("simulated candidate", ".", AXIS, 3.5)
FAR = CandidateMark("outside the intervals", ".", AXIS, 3.5)
NEAR = CandidateMark("within the intervals", ".", BLUE, 5.5)
DRAW = CandidateMark("draw of the posterior", "o", PURPLE, 3.5, filled=False)
FRONT = CandidateMark("on the front", "D", ORANGE, 4.5)
BEST = CandidateMark("best fit", "*", VERMILION, 13.0)
BEFORE = CandidateMark("configured before", "s", INK, 6.5, filled=False)


def band_handle(words: str) -> Line2D:
    """Return what a legend shows of the shaded interval."""
    return Line2D([], [], color=SKY, alpha=0.4, lw=7, solid_capstyle="butt", label=words)


def legend(made: FigureBase, marks: list[CandidateMark], more: list[Line2D] | None = None) -> None:
    """Add one legend of marks above all panels of a figure."""
    handles = [*(mark.handle for mark in marks), *(more or [])]
    made.legend(handles=handles, loc="outside upper left", ncols=len(handles), handletextpad=0.4, columnspacing=1.4)


def chosen(subject: Subject) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the candidates that a figure shows: those outside the intervals, and those within.

    Evenly from the best to the worst where there are too many.
    """
    found = subject.candidates
    far = np.flatnonzero(~found.near & (found.excess <= FAR_EXCESS))
    return thinned(found.cost, far), thinned(found.cost, np.flatnonzero(found.near))


def thinned(cost: Values, rows: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return at most ``MAX_DOTS`` of some rows, evenly by their cost."""
    if rows.size <= MAX_DOTS:
        return rows
    order = rows[np.argsort(cost[rows], kind="stable")]
    return order[np.linspace(0, order.size - 1, MAX_DOTS).astype(int)]


def draw_plane(axes: Axes, subject: Subject, across: str, up: str) -> list[CandidateMark]:
    """Draw candidates, front, best fit and configured values in the plane of two parameters; return the marks.

    ``across`` and ``up`` are names of parameters.
    """
    x, y = (subject.parameter(name) for name in (across, up))
    values, (far, near) = subject.candidates.values, chosen(subject)
    best, before = subject.found.best.values, subject.found.space.known
    drawn = [subject.draws.get(name, np.full(subject.drawn_modes.size, best[name])) for name in (across, up)]
    FAR.draw(axes, x.factor * values[across][far], y.factor * values[up][far], order=2)
    DRAW.draw(axes, x.factor * drawn[0], y.factor * drawn[1], order=2)
    NEAR.draw(axes, x.factor * values[across][near], y.factor * values[up][near])
    front = [parameters for parameters, _ in subject.found.front]
    FRONT.draw(
        axes,
        x.factor * np.array([parameters[across] for parameters in front]),
        y.factor * np.array([parameters[up] for parameters in front]),
        order=4,
    )
    BEFORE.draw(axes, x.factor * before[across], y.factor * before[up], order=6)
    BEST.draw(axes, x.factor * best[across], y.factor * best[up], order=5)
    axes.set_xlabel(x.label)
    axes.set_ylabel(y.label)
    return [FAR, DRAW, NEAR, FRONT, BEST, BEFORE]


def grid(made: FigureBase, panels: int, columns: int) -> list[Axes]:
    """Return so many panels in rows of ``columns``; what is left of the last row is hidden."""
    columns = min(columns, panels)
    made_axes = made.subplots(-(-panels // columns), columns, squeeze=False)
    for axes in made_axes.flat[panels:]:
        axes.set_visible(False)
    return list(made_axes.flat[:panels])
