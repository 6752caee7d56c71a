"""Measured features and those of the best fit, against speed, width and load, and what is left between them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from models.identify.trials import FEATURES, Condition
from monitor.identify.report.front import COLOURS, SHAPES
from monitor.identify.report.marks import grid
from monitor.identify.report.subject import TITLES, Extent, Subject, Values
from monitor.report.figures.drawing import AXIS, BLUE, INK, VERMILION
from monitor.report.figures.sheet import Part
from monitor.words.numbers import count, figure
from streams.types.block import STANDARD_GRAVITY

_MAX_PANELS, _MAX_SERIES, _MAX_ROWS, _MAX_TICKS = 6, len(SHAPES), 36, 8
_FEATURE_COLOURS = {"rms": BLUE, "a_star": VERMILION}


@dataclass(frozen=True)
class _Axis:
    """A quantity of a condition: ``of`` takes it, in the unit."""

    name: str
    label: str
    unit: str
    of: Callable[[Condition], float]


_SPEED = _Axis("speed", "shaft speed (Hz)", "Hz", lambda condition: condition.speed)
_LOAD = _Axis("load", "load (N)", "N", lambda condition: condition.load)
_EXTENT = _Axis(
    "the extent of the defect", "extent of the defect (degrees)", "°", lambda condition: math.degrees(condition.dphi_d)
)
_FIGURES = {_SPEED.name: " (Fig. 45)", _EXTENT.name: " (Fig. 46)"}


def feature_parts(subject: Subject) -> list[Part]:
    """Return the features against what varies in the tests, and the residuals."""
    conditions, parts = subject.damaged, list[Part]()
    speeds, loads = ({axis.of(c) for c in conditions} for axis in (_SPEED, _LOAD))
    if len(speeds) > 1:
        parts.append(_features(subject, _SPEED, _LOAD, by_extent=True))
    if len({c.dphi_d for c in conditions}) > 1:
        parts.append(_features(subject, _EXTENT, _LOAD, by_extent=False))
    if not parts and len(loads) > 1:
        parts.append(_features(subject, _LOAD, _SPEED, by_extent=True))
    return [*parts, _residuals(subject)]


def _features(subject: Subject, across: _Axis, series: _Axis, *, by_extent: bool) -> Part:
    """Return features over ``across`` with a line for each value of ``series``, and a row for each defect or speed."""
    groups = _groups(subject, by_extent=by_extent)
    shown = groups[:_MAX_PANELS]
    lines = sorted({series.of(c) for c in subject.damaged})[:_MAX_SERIES]

    places = sorted({across.of(c) for c in subject.damaged})
    ticks = places if len(places) <= _MAX_TICKS else places[:: -(-len(places) // _MAX_TICKS)]

    # A feature that no test has is not drawn.
    features = [name for name in FEATURES if np.any(np.isfinite(subject.measured(name)))]
    wide = len(features)

    def draw(made: FigureBase) -> None:
        panels = grid(made, wide * len(shown), wide)
        for place, (words, rows) in enumerate(shown):
            for axes, feature in zip(panels[wide * place : wide * (place + 1)], features, strict=True):
                for value, colour, shape in zip(lines, COLOURS, SHAPES, strict=False):
                    own = np.array([n for n in rows if series.of(subject.conditions[n]) == value], dtype=np.intp)
                    _line(axes, subject, feature, across, own, colour, shape)
                axes.set_title(f"{TITLES[feature]}, {words}", loc="left", fontsize=9.5)
                axes.set_ylabel("g")
                axes.set_ylim(0.0, None)
                axes.set_xticks(ticks, [f"{value:.3g}" if value < 1e3 else f"{value:g}" for value in ticks])
                if place == len(shown) - 1:
                    axes.set_xlabel(across.label)
        handles = [
            Line2D([], [], color=colour, marker=shape, ms=5, label=f"{value:g} {series.unit}")
            for value, colour, shape in zip(lines, COLOURS, SHAPES, strict=False)
        ]
        handles += [
            Line2D([], [], color=INK, marker="o", ms=5, ls="-", lw=1.2, label="measured, mean"),
            Line2D([], [], color=INK, marker="x", ms=4.5, ls="none", label="one test"),
            Line2D([], [], color=INK, marker="o", ms=5, mfc="none", ls="--", lw=1.2, label="model"),
        ]
        made.legend(handles=handles, loc="outside upper left", ncols=len(handles))

    more = len(groups) - len(shown)
    caption = (
        "Filled with full lines: means of the tests; crosses: single tests; open with dashed lines: the best fit."
        + (f" {count(more, 'more row')} of panels {'is' if more == 1 else 'are'} in the table only." if more else "")
    )
    heading = f"Features against {across.name}{_FIGURES.get(across.name, '')}"
    data = {"x": [across.of(c) for c in subject.conditions]}
    for feature in features:
        data[f"{feature}_measured_g"] = (subject.measured(feature) / STANDARD_GRAVITY).tolist()
        data[f"{feature}_model_g"] = (subject.modelled(feature) / STANDARD_GRAVITY).tolist()
    label = f"Measured and modelled {' and '.join(TITLES[name] for name in features)} against {across.name}."
    name = f"features_{across.name.rpartition(' ')[2]}"
    return Part(heading, caption, label, 0.5 + 2.15 * len(shown), draw, data, name)


def _groups(subject: Subject, *, by_extent: bool) -> list[tuple[str, NDArray[np.intp]]]:
    """Return the conditions by defect, or by speed, part and depth, with words for each."""
    if by_extent:
        return [(subject.extent_words(extent), subject.rows_of(extent)) for extent in subject.extents]
    keys = [None if c.healthy else (c.speed, c.part, c.h_d) for c in subject.conditions]
    known = {key for key in keys if key is not None}
    several = len({key[1:] for key in known}) > 1
    found: list[tuple[str, NDArray[np.intp]]] = []
    for key in sorted(known):
        words = f"{key[0]:g} Hz" + (f", {key[1]}, {figure(1e6 * key[2])} µm deep" if several else "")
        found.append((words, np.flatnonzero([other == key for other in keys])))
    return found


def _line(
    axes: Axes, subject: Subject, feature: str, across: _Axis, rows: NDArray[np.intp], colour: str, shape: str
) -> None:
    """Draw a feature of some conditions: measured means, single tests, and the model."""
    rows = rows[np.argsort([across.of(subject.conditions[n]) for n in rows], kind="stable")]
    if not rows.size:
        return
    x = np.array([across.of(subject.conditions[n]) for n in rows])
    measured, model = (v[rows] / STANDARD_GRAVITY for v in (subject.measured(feature), subject.modelled(feature)))
    known = np.isfinite(measured)
    axes.plot(x[known], measured[known], color=colour, marker=shape, ms=5, lw=1.3)
    axes.plot(x, model, color=colour, marker=shape, ms=5, mfc="none", lw=1.3, ls="--")
    own = {subject.conditions[n] for n in rows}
    tests = [(across.of(c), value / STANDARD_GRAVITY) for c, value in subject.repetitions(feature) if c in own]
    if len(tests) > np.count_nonzero(known):
        axes.plot(*zip(*tests, strict=True), "x", color=colour, ms=4.5, mew=0.9)


def residuals(subject: Subject, feature: str) -> tuple[Values, Values]:
    """Return model over measurement less one, and the standard deviation of the mean that the fit implies.

    Both in %, shape (conditions,); NaN where the feature is not compared. The level of a healthy machine is an upper
    limit of the model's, and compared where the model exceeds it.
    """
    missing = np.full(len(subject.conditions), np.nan)
    if feature not in subject.objectives:
        return missing, missing.copy()
    problem, place = subject.problem, subject.objectives.index(feature)
    whole = np.full(problem.known.shape, np.nan)
    whole[problem.known] = problem.deviation * math.sqrt(subject.found.limit.variance)
    left = 100.0 * (subject.modelled(feature) / subject.measured(feature) - 1.0)
    below = np.array([condition.healthy for condition in subject.conditions]) & ~(left > 0.0)
    return np.where(below, np.nan, left), 100.0 * whole[:, place]


def condition_words(subject: Subject, condition: Condition) -> str:
    """Return a condition as text."""
    return f"{condition.speed:g} Hz, {condition.load:g} N, {subject.extent_words(Extent.of(condition))}"


def sorted_conditions(subject: Subject) -> list[int]:
    """Return the numbers of the conditions by defect, those of the healthy machine last, speed and load."""
    order = {extent: i for i, extent in enumerate(subject.extents)}
    last = len(order)
    conditions = subject.conditions
    return sorted(
        range(len(conditions)),
        key=lambda n: (order.get(Extent.of(conditions[n]), last), conditions[n].speed, conditions[n].load),
    )


def _residuals(subject: Subject) -> Part:
    compared = {feature: residuals(subject, feature) for feature in subject.objectives}
    compared_rows = [
        n for n in sorted_conditions(subject) if any(np.isfinite(values[n]) for values, _ in compared.values())
    ]
    rows = compared_rows
    if len(rows) > _MAX_ROWS:
        size = np.nanmax([np.abs(values) for values, _ in compared.values()], axis=0, initial=0.0)
        largest = set(np.argsort(-size)[:_MAX_ROWS].tolist())
        rows = [n for n in rows if n in largest]
    doubt = subject.problem.evaluator.levels([subject.found.best.values])[0].doubt

    def draw(made: FigureBase) -> None:
        panels = made.subplots(1, len(compared), sharey=True, squeeze=False)[0]
        places = np.arange(len(rows))
        for axes, (feature, (values, deviation)) in zip(panels, compared.items(), strict=True):
            colour = _FEATURE_COLOURS[feature]
            axes.axvline(0.0, color=AXIS, lw=1.0)
            moving = doubt[rows, FEATURES.index(feature)] > 0.0
            for chosen, inside in ((~moving, colour), (moving, "none")):
                axes.errorbar(
                    values[rows][chosen], places[chosen], xerr=deviation[rows][chosen], fmt="o", ms=5, color=colour,
                    mfc=inside, elinewidth=1.1,
                )  # fmt: skip
            axes.set_xlabel(f"{TITLES[feature]}: model over measurement (%)")
            widest = np.nanmax(np.abs(values[rows]) + deviation[rows], initial=1.0)
            axes.set_xlim(-1.08 * widest, 1.08 * widest)
        panels[0].set_yticks(places, [condition_words(subject, subject.conditions[n]) for n in rows])
        panels[0].set_ylim(len(rows) - 0.5, -0.5)

    left_out = len(compared_rows) - len(rows)
    caption = (
        "Difference of the best fit at each condition; the bars are one standard deviation of the mean of the tests as "
        "the fit implies it. A condition whose bar is far from zero is not explained by these parameters."
        + (" Open: the motion does not repeat, and counts less." if np.any(doubt > 0.0) else "")
        + (f" The {count(left_out, 'condition')} of the smallest are not shown." if left_out else "")
    )
    data = {f"{feature}_percent": values for feature, (values, _) in compared.items()}
    label = "Residuals of the best fit by condition."
    height = 0.8 + 0.21 * len(rows)
    return Part("Residuals by condition", caption, label, max(1.6, height), draw, data, "residuals")
