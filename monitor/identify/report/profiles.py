"""Profiles of the likelihood of each parameter with its interval."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from matplotlib.lines import Line2D

from monitor.identify.report.marks import ANY, BEST, band_handle, grid, legend
from monitor.identify.report.subject import Parameter, Subject, Values
from monitor.report.figures.drawing import AXIS, BLUE, INK, PURPLE, SKY, VERMILION, log_ticks
from monitor.report.figures.sheet import Part

_BINS = 70
_TOP, _RUG = 4.0, -0.38
# What is shown beside an interval, over its width, and the ratio of the ends from which on the axis is logarithmic.
_BESIDE, _LOG_RATIO = 0.6, 8.0


def profile_part(subject: Subject) -> Part:
    """Return the figure of the profiles, a panel for each free parameter."""

    def draw(made: FigureBase) -> None:
        for axes, parameter in zip(grid(made, len(subject.parameters), 3), subject.parameters, strict=True):
            _panel(axes, subject, parameter)
        lines = [
            Line2D([], [], color=BLUE, marker=".", ms=6, lw=0.9, label="profile"),
            band_handle("interval"),
            Line2D([], [], color=PURPLE, ls="none", marker="|", ms=7, label="draw of the posterior"),
            Line2D([], [], color=INK, ls="--", lw=0.9, label="end of what the limits allow"),
        ]
        legend(made, [ANY, BEST], lines)

    level = 100.0 * subject.options.level
    caption = (
        "The misfit that is left when one parameter is held and all others adapt: 0 is the best fit, and up to 1 a "
        f"value is within its {level:g} % interval (Fisher's F, with the residual variance of the best fit). Grey: any "
        "candidate that was simulated there. One below the line betters the "
        "profile nearby. A flat floor is a parameter that the tests do not tell; several valleys are several answers."
    )
    data = {
        subject.keys[name]: [list(pair) for pair in interval.profile]
        for name, interval in subject.found.intervals.items()
    } | {"least": subject.found.limit.least, "added": subject.found.limit.added}
    rows = -(-len(subject.parameters) // 3)
    label = "Profile likelihoods of the free parameters."
    return Part("How well each parameter is told", caption, label, 0.5 + 2.2 * rows, draw, data, "profiles")


def sight(subject: Subject, parameter: Parameter) -> tuple[float, float, bool]:
    """Return the ends of the axis of a parameter, SI, and whether it is logarithmic."""
    interval, (least, most) = subject.found.intervals[parameter.name], subject.bounds(parameter.name)
    low, high = interval.low, interval.high
    positive = not subject.found.space.is_linear(parameter.name) and low > 0.0
    if positive and high > _LOG_RATIO * low:
        beside = (high / low) ** _BESIDE
        return max(low / beside, 0.9 * least), min(high * beside, 1.1 * most), True
    beside = _BESIDE * (high - low) or 0.05 * (most - least)
    margin = 0.03 * (min(high + beside, most) - max(low - beside, least))
    return max(low - beside, least) - margin, min(high + beside, most) + margin, False


def _panel(axes: Axes, subject: Subject, parameter: Parameter) -> None:
    interval, limit = subject.found.intervals[parameter.name], subject.found.limit
    low, high, wide = sight(subject, parameter)
    factor = parameter.factor
    candidates = subject.candidates
    axes.axvspan(factor * interval.low, factor * interval.high, color=SKY, alpha=0.18, lw=0, zorder=1)
    axes.axhline(1.0, color=AXIS, lw=0.9)
    x, excess = lowest(candidates.values[parameter.name], candidates.excess, low, high, wide=wide)
    ANY.draw(axes, factor * x, excess)
    profile = np.array(interval.profile)
    x, excess = lowest(profile[:, 0], (profile[:, 1] - limit.least) / limit.added, low, high, wide=wide)
    axes.plot(factor * x, excess, color=BLUE, marker=".", ms=5, lw=0.9, zorder=3)
    draws = subject.draws[parameter.name]
    axes.plot(factor * draws, np.full(draws.size, _RUG), "|", color=PURPLE, ms=6, mew=0.6, alpha=0.6, zorder=2)
    best = subject.found.best
    BEST.draw(axes, factor * best.values[parameter.name], (best.cost - limit.least) / limit.added, order=5)
    for end in subject.bounds(parameter.name):
        if low <= end <= high and math.isfinite(end):
            axes.axvline(factor * end, color=INK, ls="--", lw=0.9)
    if wide:
        axes.set_xscale("log")
        log_ticks(axes.xaxis, 7, decades=math.log10(high / low))
    axes.set(xlim=(factor * low, factor * high), ylim=(-0.15 * _TOP, _TOP), xlabel=parameter.label)
    axes.set_ylabel("misfit")
    if interval.reason:
        axes.text(
            0.5, 0.93, "undetermined", transform=axes.transAxes, ha="center", va="top", color=VERMILION, fontsize=9
        )


def lowest(values: Values, excess: Values, low: float, high: float, *, wide: bool) -> tuple[Values, Values]:
    """Return the lowest of some points in each of ``_BINS`` columns between two ends, ascending.

    ``wide``: the columns are even in the logarithm.
    """
    inside = (values >= low) & (values <= high) & (excess <= 2.0 * _TOP)
    values, excess = values[inside], excess[inside]
    if not values.size:
        return values, excess
    edges = np.geomspace(low, high, _BINS + 1) if wide else np.linspace(low, high, _BINS + 1)
    bins = np.searchsorted(edges, values)
    order = np.lexsort((excess, bins))
    first = order[np.concatenate([[True], np.diff(bins[order]) > 0])]
    first = first[np.argsort(values[first], kind="stable")]
    return values[first], excess[first]
