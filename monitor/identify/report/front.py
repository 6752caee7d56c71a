"""The trade-off between the features: front, parameters along it, its frequencies, one defect at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from numpy.typing import NDArray

from models.identify.search import non_dominated
from models.identify.trials import FEATURES, deviations
from monitor.identify.report.marks import BEST, FAR, FRONT, NEAR, band_handle, grid, legend, thinned
from monitor.identify.report.subject import TITLES, Extent, Subject, Values
from monitor.report.figures.drawing import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, SKY, VERMILION, legend_above
from monitor.report.figures.sheet import Part
from monitor.words.numbers import count, figure

SHAPES = ("o", "s", "^", "D", "v", "P")
COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
MAX_EXTENTS = len(SHAPES)
# Planes are shown up to so many times the objectives of the front and of the best fit.
_SIGHT = 1.6


@dataclass(frozen=True, eq=False)
class Alone:
    """What the simulated candidates do at the conditions of one defect.

    Attributes:
        front: candidates that no other dominates in the objectives there.
        objectives: differences of all candidates there, %, shape (candidates, objectives); NaN without the feature.
        nearest: the candidate of the front that is nearest to the origin, as the thesis chooses.
    """

    extent: Extent
    front: NDArray[np.intp]
    objectives: Values
    nearest: int


def front_parts(subject: Subject) -> list[Part]:
    """Return the figures of the trade-off; none where one feature is compared, or one candidate is on the front."""
    if len(subject.objectives) < 2:
        return []
    parts = [_front(subject)]
    if len(subject.found.front) > 1:
        parts += [_along(subject), _frequencies(subject)]
    return parts


def alone_parts(subject: Subject) -> list[Part]:
    """Return the figure of one defect at a time, where there are several and two features."""
    found = one_at_a_time(subject)
    return [_alone(subject, found)] if len(found) > 1 and len(subject.objectives) > 1 else []


def one_at_a_time(subject: Subject) -> list[Alone]:
    """Return the candidates judged by each defect alone; nothing is simulated for it.

    Defects without a known value of some objective are left out.
    """
    found: list[Alone] = []
    candidates = subject.candidates
    usable = np.flatnonzero(candidates.sharp)
    usable = usable if usable.size else np.arange(candidates.cost.size)
    for extent in subject.extents:
        rows = subject.rows_of(extent)
        columns = [FEATURES.index(name) for name in subject.objectives]
        measured = subject.problem.trials.mean[rows]
        if not all(np.any(np.isfinite(measured[:, c])) for c in columns):
            continue
        # Eq. 56 for all candidates at once, without unknown features.
        objectives = np.column_stack(
            [np.nanmean(deviations(candidates.features[:, rows, c], measured[:, c]), axis=1) for c in columns]
        )
        front = usable[non_dominated(objectives[usable])]
        nearest = int(front[np.argmin(np.linalg.norm(objectives[front], axis=1))])
        found.append(Alone(extent, front, objectives, nearest))
    return found


def _front_values(subject: Subject) -> Values:
    return np.array([list(objectives.values()) for _, objectives in subject.found.front])


def _front(subject: Subject) -> Part:
    found, candidates = subject.found, subject.candidates
    front, best = _front_values(subject), np.array(list(found.deviations.values()))
    ends = _SIGHT * np.maximum(front.max(axis=0), best)
    least = np.minimum(front.min(axis=0), best)
    low = np.maximum(least - 0.5 * (ends - least), 0.0)
    seen = np.flatnonzero(np.all(candidates.objectives <= ends, axis=1))
    far, near = (thinned(candidates.cost, rows) for rows in (seen[~candidates.near[seen]], seen[candidates.near[seen]]))

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        for mark, rows in ((FAR, far), (NEAR, near)):
            mark.draw(axes, candidates.objectives[rows, 0], candidates.objectives[rows, 1])
        order = np.argsort(front[:, 0])
        axes.plot(front[order, 0], front[order, 1], color=FRONT.colour, lw=0.9, drawstyle="steps-post", zorder=3)
        FRONT.draw(axes, front[:, 0], front[:, 1], order=4)
        BEST.draw(axes, float(best[0]), float(best[1]), order=5)
        axes.set(xlim=(low[0], ends[0]), ylim=(low[1], ends[1]))
        _label(axes, subject)
        legend(made, [FAR, NEAR, FRONT, BEST])

    one = len(front) == 1
    caption = (
        f"Mean differences over the conditions (Eq. 56). {count(len(front), 'candidate')} of "
        f"{count(len(candidates.cost), 'simulated one')} {'is' if one else 'are'} not dominated by another. "
    ) + (
        "One candidate is best in both features, so there is no trade-off between them."
        if one
        else "The best fit has the least sum of squares, which weighs every test by its scatter; so it need not be on "
        "the front."
    )
    data = {name: front[:, i] for i, name in enumerate(_names(subject))} | {"best": best}
    label = f"Differences of {' and '.join(TITLES[name] for name in subject.objectives)} of the simulated candidates."
    return Part("Pareto front (Fig. 41)", caption, label, 3.8, draw, data, "front")


def _names(subject: Subject) -> list[str]:
    return [f"delta_{name}_percent" for name in subject.objectives]


def _label(axes: Axes, subject: Subject) -> None:
    across, up = (f"Δ{TITLES[name]} (%)" for name in subject.objectives)
    axes.set(xlabel=across, ylabel=up)


def _along(subject: Subject) -> Part:
    front = _front_values(subject)[:, 0]
    across = f"Δ{TITLES[subject.objectives[0]]} (%)"
    best = subject.found.deviations[subject.objectives[0]]
    values = {p.name: p.factor * np.array([one[p.name] for one, _ in subject.found.front]) for p in subject.parameters}

    def draw(made: FigureBase) -> None:
        panels = grid(made, len(subject.parameters), 3)
        for axes, parameter in zip(panels, subject.parameters, strict=True):
            interval = subject.found.intervals[parameter.name]
            low, high = parameter.factor * interval.low, parameter.factor * interval.high
            axes.axhspan(low, high, color=SKY, alpha=0.18, lw=0, zorder=1)
            FRONT.draw(axes, front, values[parameter.name])
            BEST.draw(axes, best, parameter.factor * subject.found.best.values[parameter.name], order=5)
            axes.set(xlabel=across, ylabel=parameter.label)
        legend(made, [FRONT, BEST], [band_handle("interval")])

    caption = (
        "Each dot is a candidate of the front. What stays put along it, both features ask for; what does not, they "
        "disagree on, or neither tells. The bands are the intervals of the table, from the tests' likelihood and not "
        "from the front."
    )
    data = {across: front, **{subject.keys[name]: column for name, column in values.items()}}
    rows = -(-len(subject.parameters) // 3)
    label = "The free parameters of the candidates on the front."
    return Part("Parameters along the front (Fig. 42)", caption, label, 0.5 + 2.1 * rows, draw, data, "along_front")


def _frequencies(subject: Subject) -> Part:
    space = subject.found.space
    front = _front_values(subject)[:, 0]
    resonances = np.array([space.resonances(one) for one, _ in subject.found.front])
    best = subject.found.deviations[subject.objectives[0]]
    low, high = space.limits.f_r

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        for i, load in enumerate(space.loads[:MAX_EXTENTS]):
            for way, (words, filled) in enumerate((("across", False), ("along", True))):
                axes.plot(
                    front, 1e-3 * resonances[:, 2 * i + way], SHAPES[i], ms=5, color=COLOURS[i],
                    mfc=COLOURS[i] if filled else "none", label=f"{words} {load:g} N",
                )  # fmt: skip
        axes.plot(np.full(2, best), 1e-3 * np.array(subject.highest_modes), color=VERMILION, lw=5, alpha=0.3)
        axes.plot([], [], color=VERMILION, lw=5, alpha=0.3, label="all fits within the intervals")
        axes.set(xlabel=f"Δ{TITLES[subject.objectives[0]]} (%)", ylabel="f_r (kHz)")
        legend_above(axes, 5)

    near = subject.highest_modes
    caption = (
        f"The highest natural frequency of each candidate of the front, {figure(resonances.min(), 4)} to "
        f"{figure(resonances.max(), 4)} Hz, limits {low:g} to {high:g} Hz. The bar: {figure(near[0], 4)} to "
        f"{figure(near[1], 4)} Hz, of all simulated candidates within the intervals, which is at least how far f_r is "
        "open."
    )
    data = {"f_r_hz": resonances, _names(subject)[0]: front, "near_hz": list(near)}
    label = "The highest natural frequency of the candidates on the front."
    return Part("Natural frequency along the front (Fig. 43)", caption, label, 3.0, draw, data, "frequencies")


def _alone(subject: Subject, found: Sequence[Alone]) -> Part:
    shown = found[:MAX_EXTENTS]
    together = _front_values(subject)
    nearest = np.array([one.objectives[one.nearest] for one in shown])
    ends = _SIGHT * np.maximum(nearest.max(axis=0), together.max(axis=0))

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        axes.plot(together[:, 0], together[:, 1], "-", color=GREY, lw=0.9, marker=".", ms=4, label="all defects")
        for one, shape, colour in zip(shown, SHAPES, COLOURS, strict=False):
            at = one.objectives[one.front]
            at = at[np.argsort(at[:, 0])]
            axes.plot(
                at[:, 0], at[:, 1], color=colour, lw=0.9, marker=shape, ms=4.5, label=subject.extent_words(one.extent)
            )
            place = one.objectives[one.nearest]
            axes.plot(place[0], place[1], shape, ms=9, mfc="none", mec=INK, mew=1.1, zorder=5)
        axes.set(xlim=(0.0, ends[0]), ylim=(0.0, ends[1]))
        _label(axes, subject)
        legend_above(axes, 7)

    more = f" {count(len(found) - len(shown), 'defect')} more are in the table only." if len(found) > len(shown) else ""
    caption = (
        "The same candidates judged by the conditions of one defect alone; the outlined one of each is nearest to the "
        "origin, and in the table. No search was run for one defect, so a search of its own could come nearer."
        f"{more}"
    )
    data = {
        f"{name}_of_{figure(np.degrees(one.extent.dphi_d), 4)}_deg": one.objectives[one.front, i]
        for one in shown
        for i, name in enumerate(_names(subject))
    }
    label = "Fronts of the simulated candidates by one defect at a time."
    return Part("One defect at a time (Fig. 44)", caption, label, 3.6, draw, data, "alone")
