"""The admissible values of the parameters (thesis, Figs. 38 to 40) and where the candidates lie among them."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from matplotlib.patches import Rectangle
from numpy.typing import ArrayLike

from models.identify.limits import Interval, alpha_c_interval
from models.identify.space import contact_ratios
from monitor.identify.report.marks import BEFORE, BEST, FAR, NEAR, CandidateMark, chosen, draw_plane, grid, legend
from monitor.identify.report.subject import Subject, Values
from monitor.report.figures.drawing import BLUE, INK, SHADE, SOFT, log_ticks
from monitor.report.figures.sheet import Part
from monitor.words.numbers import figure

_GRID = 121
_LINES, _HEIGHT = 6, 85
_LINE_KHZ = (1.0, 2.0, 3.0, 5.0, 7.0, 9.0, 12.0, 16.0, 20.0)
_MARGIN, _BESIDE = 0.05, 0.4


def region_parts(subject: Subject) -> list[Part]:
    """Return the figures of the regions that a free parameter enters."""
    free, parts = set(subject.found.space.free), list[Part]()
    if free & {"m_r", "k_r"}:
        parts += [_resonator(subject), _modes(subject)]
    if free & {"alpha_c", "beta_c"}:
        parts.append(_contact(subject))
    if {"c_i", "c_r"} <= free:
        parts.append(_damping(subject))
    return parts


def _axis(subject: Subject, name: str) -> Values:
    """Return places along the interval of a parameter in Table 16, widened to what was configured."""
    low, high = getattr(subject.found.space.limits, name)
    before = subject.found.space.known[name]
    return np.linspace(min(low, before), max(high, before), _GRID)


def _plane_modes(subject: Subject) -> tuple[Values, Values, Values]:
    """Return m_r, k_r, and all natural frequencies, Hz, shape (k_r, m_r, loads and directions, modes)."""
    m_r, k_r = _axis(subject, "m_r"), _axis(subject, "k_r")
    across, up = np.meshgrid(m_r, k_r)
    return m_r, k_r, subject.found.space.modes(subject.found.best.values, across, up)


def _resonator(subject: Subject) -> Part:
    space = subject.found.space
    low, high = space.limits.f_r
    m_r, k_r, modes = _plane_modes(subject)
    highest = modes[..., -1]
    slack = np.minimum(highest.min(axis=-1) - low, high - highest.max(axis=-1))

    def draw(made: FigureBase) -> None:
        whole, near = made.subplots(1, 2)
        _shade(whole, m_r, 1e-9 * k_r, slack)
        lines = whole.contour(
            m_r, 1e-9 * k_r, 1e-3 * highest.mean(axis=-1), levels=_LINE_KHZ, colors=SOFT, linewidths=0.7, zorder=2
        )
        whole.clabel(lines, fmt=lambda value: f"{value:g} kHz", fontsize=7.5)
        for axes in (whole, near):
            marks = draw_plane(axes, subject, "m_r", "k_r")
            for name, draw_line in (("m_r", axes.axvline), ("k_r", axes.axhline)):
                if name not in space.free:
                    draw_line(subject.parameter(name).factor * space.known[name], color=INK, lw=0.8, ls=":")
        _allowed_box(whole, space.limits.m_r, (1e-9 * space.limits.k_r[0], 1e-9 * space.limits.k_r[1]))
        _zoom(near, subject)
        whole.set_title("all that the limits allow", loc="left", fontsize=9.5)
        near.set_title("the intervals", loc="left", fontsize=9.5)
        legend(made, marks)

    fixed = [name for name in ("m_r", "k_r") if name not in space.free]
    only = f" Only the dotted line is searched: {fixed[0]} is not free." if fixed else ""
    caption = (
        f"Shaded: m_r and k_r that give a natural frequency f_r from {low:g} to {high:g} Hz at every load, across and "
        "along it (Eqs. 59 to 69, Eq. 63 with the missing term); lines of equal f_r are means over loads and "
        f"directions, with all other parameters as in the best fit.{only} Draws of the posterior are what maps "
        "and libraries take."
    )
    data = {"f_r_limits_hz": [low, high], "f_r_best_hz": list(subject.found.resonances)}
    label = "Admissible masses and stiffnesses of the resonator, with the candidates that were simulated."
    return Part("Mass and stiffness of the resonator (Fig. 38)", caption, label, 4.4, draw, data, "resonator")


def _zoom(axes: Axes, subject: Subject) -> None:
    """Show the intervals of m_r and k_r, with lines of equal f_r."""
    spans: list[Values] = []
    for name in ("m_r", "k_r"):
        best, interval = subject.found.best.values[name], subject.found.intervals.get(name)
        low, high = (0.97 * best, 1.03 * best) if interval is None else (interval.low, interval.high)
        beside = _BESIDE * (high - low) or 0.01 * best
        spans.append(np.linspace(low - beside, high + beside, _GRID))
    m_r, k_r = spans
    # Labels are placed for the limits of the axes that are set before.
    axes.set(xlim=(m_r[0], m_r[-1]), ylim=(1e-9 * k_r[0], 1e-9 * k_r[-1]))
    highest = subject.found.space.modes(subject.found.best.values, *np.meshgrid(m_r, k_r))[..., -1].mean(axis=-1)
    lines = axes.contour(m_r, 1e-9 * k_r, highest, levels=7, colors=SOFT, linewidths=0.7, zorder=2)
    axes.clabel(lines, fmt=lambda value: f"{value:.0f} Hz", fontsize=7.5)
    axes.grid(visible=False)


def _shade(axes: Axes, x: Values, y: Values, slack: Values) -> None:
    """Shade where something is left of all limits, if anywhere."""
    axes.grid(visible=False)
    if np.any(slack >= 0.0):
        axes.contourf(x, y, slack, levels=[0.0, math.inf], colors=[SHADE], zorder=0)
        axes.contour(x, y, slack, levels=[0.0], colors=[INK], linewidths=1.0, zorder=2)


def _allowed_box(axes: Axes, across: Interval, up: Interval) -> None:
    corner, size = (across[0], up[0]), (across[1] - across[0], up[1] - up[0])
    axes.add_patch(Rectangle(corner, *size, fill=False, edgecolor=INK, lw=0.8, ls="--", zorder=2))


def _modes(subject: Subject) -> Part:
    m_r, k_r, modes = _plane_modes(subject)
    space = subject.found.space
    load = max(space.loads)
    place = 2 * space.loads.index(load)
    # Across and along the load, the two lower modes each.
    panels = [(place + way, mode) for mode in (0, 1) for way in (0, 1)]
    ways = ("across the load", "along the load")

    def draw(made: FigureBase) -> None:
        for axes, (row, mode) in zip(grid(made, len(panels), 2), panels, strict=True):
            values = modes[..., row, mode]
            columns = np.linspace(0.0, m_r.size - 1.0, _LINES + 2).astype(int)[1:-1]
            # Lines through even places at a height where none is close to another, and labelled there.
            levels, first = np.unique(values[_HEIGHT, columns], return_index=True)
            lines = axes.contour(m_r, 1e-9 * k_r, values, levels=levels, colors=BLUE, linewidths=0.9)
            spots = [(float(m_r[columns[i]]), 1e-9 * float(k_r[_HEIGHT])) for i in first]
            axes.clabel(lines, fmt=lambda value: f"{value:.0f} Hz", fontsize=7.5, manual=spots)
            axes.grid(visible=False)
            best = subject.found.best.values
            BEST.draw(axes, best["m_r"], 1e-9 * best["k_r"])
            axes.set_title(f"mode {mode + 1} {ways[row - place]}", loc="left", fontsize=9.5)
            axes.set(xlabel="m_r (kg)", ylabel="k_r (GN/m)")

    best = subject.found.space.modes(subject.found.best.values)[place : place + 2, :2]
    caption = (
        f"At {load:g} N, with all other parameters as in the best fit (star). Where such a frequency hardly changes "
        "with k_r, only the highest mode, above, tells k_r."
    )
    data = {"load_newton": load, "best_across_hz": best[0], "best_along_hz": best[1]}
    label = "The lower natural frequencies over mass and stiffness of the resonator."
    return Part("The other natural frequencies (Fig. 39)", caption, label, 5.0, draw, data, "modes")


def _contact(subject: Subject) -> Part:
    limits = subject.found.space.limits
    beta = np.linspace(*limits.beta_c, _GRID)
    ends = np.array([alpha_c_interval(limits, float(value)) for value in beta])
    inside = ends[:, 0] <= ends[:, 1]
    lower, upper = (np.column_stack([beta, ends[:, side]])[inside] for side in (0, 1))
    outline = np.concatenate([lower, upper[::-1]])

    def draw(made: FigureBase) -> None:
        left, right = made.subplots(1, 2)
        ratios = np.array([contact_ratios({"alpha_c": a, "beta_c": b}, limits) for b, a in outline.tolist()])
        if outline.size:
            left.fill(1e6 * outline[:, 0], outline[:, 1], facecolor=SHADE, edgecolor=INK, lw=1.0)
            right.fill(*(100.0 * ratios.T), facecolor=SHADE, edgecolor=INK, lw=1.0)
        marks = draw_plane(left, subject, "beta_c", "alpha_c")
        _draw_ratios(right, subject)
        right.set(xlabel=f"ζ_1 at {limits.f_1:g} Hz (%)", ylabel=f"ζ_2 at {limits.f_2:g} Hz (%)")
        legend(made, marks)

    fixed = [name for name in ("beta_c", "alpha_c") if name not in subject.found.space.free]
    only = f" {subject.parameter(fixed[0]).symbol} is not free, so the candidates lie on a line." if fixed else ""
    caption = (
        f"Shaded: what ζ_1 from {_percent(limits.zeta_1)}, ζ_2 from {_percent(limits.zeta_2)}, β_c from "
        f"{figure(1e6 * limits.beta_c[0])} to {figure(1e6 * limits.beta_c[1])} µs and α_c above zero leave "
        f"(Eqs. 70 to 74), as coefficients and as damping ratios.{only} A column of draws means that the tests "
        "tell β_c and not α_c."
    )
    best = contact_ratios(subject.found.best.values, limits)
    data = {"zeta_1_best": best[0], "zeta_2_best": best[1], "outline_beta_c_s": outline[:, 0]}
    label = "Admissible contact damping as coefficients and as damping ratios, with the candidates."
    return Part("Contact damping (Fig. 40)", caption, label, 3.7, draw, data, "contact_damping")


def _draw_ratios(axes: Axes, subject: Subject) -> None:
    limits, found, values = subject.found.space.limits, subject.found, subject.candidates.values

    def at(alpha: Values, beta: Values) -> tuple[Values, Values]:
        ratios = np.array(
            [contact_ratios({"alpha_c": a, "beta_c": b}, limits) for a, b in zip(alpha, beta, strict=True)]
        ).reshape(-1, 2)
        return 100.0 * ratios[:, 0], 100.0 * ratios[:, 1]

    for mark, rows in zip((FAR, NEAR), chosen(subject), strict=True):
        mark.draw(axes, *at(values["alpha_c"][rows], values["beta_c"][rows]))
    pairs: tuple[tuple[CandidateMark, dict[str, float]], ...] = ((BEFORE, found.space.known), (BEST, found.best.values))
    for mark, one in pairs:
        mark.draw(axes, *at(np.array([one["alpha_c"]]), np.array([one["beta_c"]])), order=5)


def _damping(subject: Subject) -> Part:
    space, best = subject.found.space, subject.found.best.values
    limits = space.limits
    boxes = {name: subject.bounds(name) for name in ("c_i", "c_r")}
    frequencies = {"c_i": limits.f_i, "c_r": limits.f_d}

    def ratio(name: str) -> float:
        """Return the factor from a coefficient to its damping ratio, %, at the stiffness of the best fit."""
        return 100.0 * math.pi * frequencies[name] / best[f"k_{name[-1]}"]

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        axes.set(xscale="log", yscale="log")
        marks = draw_plane(axes, subject, "c_i", "c_r")
        widest = [(low, high) for low, high in boxes.values()]
        for name, axis in (("c_i", axes.xaxis), ("c_r", axes.yaxis)):
            low, high = boxes[name]
            log_ticks(axis, 9, decades=math.log10(high / low))
            span = (high / low) ** _MARGIN
            (axes.set_xlim if name == "c_i" else axes.set_ylim)(low / span, high * span)
        _allowed_box(axes, *widest)
        # The ratios hold at the stiffness of the best fit.
        above = axes.secondary_xaxis("top", functions=_scaled(ratio("c_i")))
        above.set_xlabel(f"ζ_i at {limits.f_i:g} Hz (%)")
        log_ticks(above.xaxis, 9)
        beside = axes.secondary_yaxis("right", functions=_scaled(ratio("c_r")))
        beside.set_ylabel(f"ζ_r at {limits.f_d:g} Hz (%)")
        log_ticks(beside.yaxis, 9)
        legend(made, marks)

    caption = (
        f"Dashed: what ζ_i from {_percent(limits.zeta_i)} at {limits.f_i:g} Hz and ζ_r from {_percent(limits.zeta_r)} "
        f"at {limits.f_d:g} Hz allow the coefficients (Eqs. 75 to 78), at the widest over all stiffnesses; the scales "
        "of the ratios hold at the stiffnesses of the best fit."
    )
    data = {
        "zeta_i_best": 0.01 * ratio("c_i") * best["c_i"],
        "zeta_r_best": 0.01 * ratio("c_r") * best["c_r"],
    }
    label = "Damping of shaft and resonator, with the candidates that were simulated."
    return Part("Damping of shaft and resonator", caption, label, 4.2, draw, data, "damping")


def _scaled(factor: float) -> tuple[Callable[[ArrayLike], ArrayLike], Callable[[ArrayLike], ArrayLike]]:
    """Return the functions to and from a second scale."""
    return (lambda values: factor * np.asarray(values), lambda values: np.asarray(values) / factor)


def _percent(interval: Interval) -> str:
    return f"{figure(100.0 * interval[0], 2)} to {figure(100.0 * interval[1], 2)} %"
