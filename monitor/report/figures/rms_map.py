"""An RMS map as a report: levels, cuts through them, and their errors."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from models.maps.data import MapSlice, RmsMap
from models.maps.plan import DAMAGED, MapPlan
from models.solve.response import CASING, STATUSES
from monitor.report.figures.drawing import BLUE, GREEN, INK, PURPLE, SOFT, VERMILION, legend_above
from monitor.report.figures.sheet import Part, Sheet
from monitor.words.calibration import rig_words
from monitor.words.numbers import count, figure
from monitor.words.sensors import PLACES
from streams.types.block import STANDARD_GRAVITY

Values = NDArray[np.float64]

_MAX_PANELS = 12
_PIXELS = (240, 360)
_PANEL = 3.1
_CUTS = 4
_EXTENT, _DEPTH = "extent of the defect (degrees)", "depth of the defect (µm)"
_NEGLIGIBLE = 0.1
"""Errors below this many per cent are in the facts only."""
_STROKES: tuple[tuple[str, Any], ...] = ((BLUE, "-"), (VERMILION, "--"), (GREEN, "-."), (PURPLE, ":"))
V_EQ_MM2 = {0.005: 0.62, 0.02: 0.45, 0.05: 0.3, 0.1: 0.14}
"""Volumes whose hyperbolas are drawn, mm3 per mm, and the share of the panel's height at which each is labelled."""


@dataclass(frozen=True, eq=False)
class NodeError:
    """One kind of error of a map at the nodes of one condition: ``percent`` (H, D), NaN for no value."""

    name: str
    title: str
    percent: Values


def map_sheet(rms_map: RmsMap) -> Sheet:
    """Return the report of a map (thesis, Fig. 61) with twelve conditions at most."""
    at = [rms_map.slice_at(float(load), float(speed)) for load in rms_map.load for speed in rms_map.speed]
    level = _level(rms_map)
    parts = (
        [_line_part(at, level)] if min(at[0].rms.shape) < 2 else [_levels_part(rms_map, at), _cuts_part(at[0], level)]
    )
    if len(parts) > 1 and node_errors(at[0]):
        parts.append(_errors_part(at[0]))
    return Sheet(f"RMS map of {rms_map.plan.bearing.designation}", _lead(rms_map), parts, _facts(rms_map))


def condition(at: MapSlice) -> str:
    """Return load and speed of a slice as text."""
    return f"{at.load:g} N, {at.speed:g} Hz"


def node_miss(values: Values, axis: Values, place: int) -> Values:
    """Return the distance of each node from the line between its neighbours along an axis; zero at the ends.

    Half-way between nodes the error of linear interpolation of a smooth surface is a quarter of it. ``values`` (H, D)
    are at the nodes, ``axis`` has their ascending positions along the axis ``place``, 0 or 1.
    """
    found = np.zeros_like(values)
    if len(axis) < 3:
        return found
    v, out = np.moveaxis(values, place, -1), np.moveaxis(found, place, -1)
    share = (axis[1:-1] - axis[:-2]) / (axis[2:] - axis[:-2])
    out[..., 1:-1] = np.abs(v[..., 1:-1] - (v[..., :-2] * (1.0 - share) + v[..., 2:] * share))
    return found


def node_errors(at: MapSlice) -> list[NodeError]:
    """Return the errors of a slice that are not negligible."""
    largest = span_of(at.rms)[1]
    between = np.maximum(node_miss(at.rms, at.dphi_d, 1), node_miss(at.rms, at.h_d, 0))
    with np.errstate(invalid="ignore", divide="ignore"):
        kinds = [
            NodeError("nodes", "off the line of its neighbours\n(% of the largest RMS)", 100.0 * between / largest),
            NodeError("numerical", "numerical error\n(% of the RMS)", 100.0 * at.rms_error / at.rms),
            NodeError("floors", "spread over floors or periods\n(% of the RMS)", 100.0 * at.rms_std / at.rms),
            NodeError("rigs", "spread over rigs\n(% of the RMS)", 100.0 * at.rms_rig_std / at.rms),
        ]
    return [kind for kind in kinds if _most(kind.percent) > _NEGLIGIBLE]


def _most(values: Values) -> float:
    """Return the 99th percentile of finite values, zero without any."""
    finite = values[np.isfinite(values)]
    return float(np.percentile(finite, 99.0)) if finite.size else 0.0


def cut_nodes(size: int) -> list[int]:
    """Return the nodes of an axis for cuts: four, evenly spaced, with the last and without the first."""
    return sorted({round(k * (size - 1) / _CUTS) for k in range(1, _CUTS + 1)} - {0})


def show_levels(axes: Axes, at: MapSlice, highest: float, radius: float) -> Any:
    """Draw the RMS of a slice in g with contours and lines of equal volume; return the image for a colour bar."""
    extent, depth = np.degrees(at.dphi_d), 1e6 * at.h_d
    rms = at.rms / STANDARD_GRAVITY
    x = np.linspace(extent[0], extent[-1], _PIXELS[1])
    y = np.linspace(depth[0], depth[-1], _PIXELS[0])
    between = at.interpolate(*np.meshgrid(at.dphi_d[0] + np.radians(x - x[0]), 1e-6 * y)) / STANDARD_GRAVITY
    box = (x[0], x[-1], y[0], y[-1])
    image = axes.imshow(
        between, origin="lower", extent=box, aspect="auto", cmap="viridis", vmin=0.0, vmax=highest, zorder=1
    )
    levels = [level for level in np.linspace(0.0, highest, 7)[1:-1] if span_of(rms)[0] < level < span_of(rms)[1]]
    if levels:
        drawn = axes.contour(extent, depth, rms, levels=levels, colors="white", linewidths=0.6, alpha=0.7, zorder=3)
        axes.clabel(drawn, fmt="%.2g", fontsize=6.5)
    axes.grid(visible=False)
    axes.set(xlim=box[:2], ylim=box[2:])
    _volumes(axes, radius, box)
    return image


def _volumes(axes: Axes, radius: float, box: tuple[float, float, float, float]) -> None:
    """Draw V_eq = radius dphi_d h_d for a few volumes (thesis, Eq. 90)."""
    left, right, low, high = (float(value) for value in box)
    span = np.linspace(max(left, 0.05), right, 400)
    halo = [withStroke(linewidth=2.2, foreground="white", alpha=0.75)]
    for volume, height in V_EQ_MM2.items():
        h = volume * 1e-6 / (radius * np.radians(span)) * 1e6
        inside = (h >= low) & (h <= high)
        if np.count_nonzero(inside) < 2:
            continue
        axes.plot(span[inside], h[inside], color=INK, lw=1.0, ls="--", path_effects=halo, zorder=4)
        wanted = min(float(h[inside][0]), low + height * (high - low))
        place = np.flatnonzero(inside & (h >= wanted))[-1]
        at_right = bool(span[place] > 0.7 * right)
        axes.annotate(
            f"{volume:g} mm³/mm",
            (span[place], h[place]),
            xytext=(-4, 4) if at_right else (4, 2),
            textcoords="offset points",
            ha="right" if at_right else "left",
            va="bottom",
            color=INK,
            fontsize=7,
            path_effects=halo,
            zorder=5,
        )


def _level(rms_map: RmsMap) -> str:
    """Return what the RMS is of, with its unit; maps without the name of a sensor are of the casing."""
    return f"RMS of the {PLACES[rms_map.attributes.get('sensor', CASING[0])]} (g)"


def _levels_part(rms_map: RmsMap, at: Sequence[MapSlice]) -> Part:
    shown = at[:_MAX_PANELS]
    rows, highest = math.ceil(len(shown) / 2), span_of(rms_map.rms)[1] / STANDARD_GRAVITY
    falling = rms_map.falling("h_d").reshape(-1, *at[0].rms.shape)

    def draw(made: FigureBase) -> None:
        panels = _panels(made, len(shown))
        image = None
        for axes, part, falls in zip(panels.flat, shown, falling, strict=False):
            image = show_levels(axes, part, highest, rms_map.part_radius)
            _pale(axes, falls, np.degrees(part.dphi_d), 1e6 * part.h_d)
            axes.set_title(condition(part), fontsize=9.5, loc="left")
        if image is not None:
            made.colorbar(image, ax=panels, pad=0.01).set_label(_level(rms_map))

    caption = (
        "Colour and white lines: RMS in g. Dashed: equal damaged volume V_eq. Pale: RMS falls with depth, so that a "
        f"level does not tell one defect.{_not_shown(at)}"
    )
    data: dict[str, Any] = {
        "load_newton": [part.load for part in shown],
        "speed_hz": [part.speed for part in shown],
        "rms_least_g": [span_of(part.rms)[0] / STANDARD_GRAVITY for part in shown],
        "rms_most_g": [span_of(part.rms)[1] / STANDARD_GRAVITY for part in shown],
        "falls_with_depth": [int(np.count_nonzero(falls)) for falls in falling[: len(shown)]],
    }
    label = f"RMS over extent and depth of the defect at {len(shown)} conditions, up to {figure(highest)} g."
    height = 0.4 + (_PANEL if len(shown) > 1 else 1.35 * _PANEL) * rows
    return Part("RMS over extent and depth", caption, label, height, draw, data, "levels")


def _not_shown(at: Sequence[MapSlice]) -> str:
    more = len(at) - _MAX_PANELS
    return f" {more} more conditions are not shown." if more > 0 else ""


def _line_part(at: Sequence[MapSlice], level: str) -> Part:
    """Return the levels of a map of one depth or one extent, a line for each condition."""
    by_extent = len(at[0].dphi_d) >= len(at[0].h_d)
    x = np.degrees(at[0].dphi_d) if by_extent else 1e6 * at[0].h_d
    held = f"{1e6 * at[0].h_d[0]:.3g} µm deep" if by_extent else f"{np.degrees(at[0].dphi_d[0]):.3g}° wide"
    lines = [(part, part.rms.ravel() / STANDARD_GRAVITY) for part in at[:_MAX_PANELS]]

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        for (part, values), (color, stroke) in zip(lines, itertools.cycle(_STROKES), strict=False):
            axes.plot(x, values, color=color, ls=stroke, marker=".", label=condition(part))
        axes.set(xlabel=_EXTENT if by_extent else _DEPTH, ylabel=level)
        legend_above(axes, 4)

    caption = f"All defects of the map are {held}.{_not_shown(at)}"
    data: dict[str, Any] = {"extent_deg" if by_extent else "depth_um": x}
    data |= {f"rms_at_{part.load:g}_newton_{part.speed:g}_hz_g": values for part, values in lines}
    return Part("RMS along the map", caption, f"RMS of defects that are {held}.", 2.9, draw, data, "levels")


def _pale(axes: Axes, falls: NDArray[np.bool_], extent: Values, depth: Values) -> None:
    """Make pale the steps of depth along which the RMS falls."""
    x, y = np.linspace(extent[0], extent[-1], _PIXELS[1]), np.linspace(depth[0], depth[-1], _PIXELS[0])
    nearest = np.abs(x[:, None] - extent[None, :]).argmin(axis=1)
    below = np.clip(np.searchsorted(depth, y, side="right") - 1, 0, len(depth) - 1)
    shade = np.zeros((*_PIXELS, 4), dtype=np.float32)
    shade[..., :3] = 1.0
    shade[..., 3] = 0.35 * falls[np.ix_(below, nearest)]
    axes.imshow(shade, origin="lower", extent=(x[0], x[-1], y[0], y[-1]), aspect="auto", zorder=2)


def _panels(made: FigureBase, shown: int) -> Any:
    """Return panels over extent and depth, two in a row; those past the number of ``shown`` ones are hidden."""
    columns = min(2, shown)
    panels = made.subplots(math.ceil(shown / 2), columns, squeeze=False)
    for place, axes in enumerate(panels.flat):
        axes.set_visible(place < shown)
        if place % columns == 0:
            axes.set_ylabel(_DEPTH)
        if place + columns >= shown:
            axes.set_xlabel(_EXTENT)
    return panels


def _cuts_part(at: MapSlice, level: str) -> Part:
    extent, depth = np.degrees(at.dphi_d), 1e6 * at.h_d
    spread = np.maximum(at.rms_std, at.rms_rig_std) / STANDARD_GRAVITY
    rms = at.rms / STANDARD_GRAVITY
    data: dict[str, Any] = {"extent_deg": extent, "depth_um": depth}
    for node in cut_nodes(len(depth)):
        data[f"rms_at_{depth[node]:.3g}_um_g"] = rms[node]
    for node in cut_nodes(len(extent)):
        data[f"rms_at_{extent[node]:.3g}_deg_g"] = rms[:, node]

    def draw(made: FigureBase) -> None:
        left, right = made.subplots(1, 2, sharey=True)
        for look, node in zip(_STROKES, cut_nodes(len(depth)), strict=False):
            _cut(left, extent, rms[node], spread[node], look, f"{depth[node]:.3g} µm deep")
        for look, node in zip(_STROKES, cut_nodes(len(extent)), strict=False):
            _cut(right, depth, rms[:, node], spread[:, node], look, f"{extent[node]:.3g}° wide")
        left.set(xlabel=_EXTENT, ylabel=level, ylim=(0.0, None))
        right.set(xlabel=_DEPTH)
        for axes in (left, right):
            legend_above(axes, 2)

    shaded = " Shaded: one standard deviation over floors or rigs, whichever is larger." if np.any(spread) else ""
    caption = f"At {condition(at)}: along nodes of depth (left) and of extent (right).{shaded}"
    label = "RMS against extent at four depths, and against depth at four extents."
    return Part("Cuts through the map", caption, label, 2.9, draw, data, "cuts")


def _cut(axes: Axes, x: Values, y: Values, spread: Values, look: tuple[str, Any], name: str) -> None:
    color, stroke = look
    axes.plot(x, y, color=color, ls=stroke, label=name)
    if np.any(spread):
        axes.fill_between(x, y - spread, y + spread, color=color, alpha=0.15, lw=0)


def _errors_part(at: MapSlice) -> Part:
    kinds = node_errors(at)
    data: dict[str, Any] = {}
    for kind in kinds:
        finite = kind.percent[np.isfinite(kind.percent)]
        data |= {f"{kind.name}_median_percent": float(np.median(finite)), f"{kind.name}_most_percent": finite.max()}

    def draw(made: FigureBase) -> None:
        extent, depth = np.degrees(at.dphi_d), 1e6 * at.h_d
        style: dict[str, Any] = {"cmap": "magma_r", "vmin": 0.0, "shading": "nearest", "rasterized": True}
        for axes, kind in zip(_panels(made, len(kinds)).flat, kinds, strict=False):
            percent = np.ma.masked_invalid(kind.percent)
            drawn = axes.pcolormesh(extent, depth, percent, vmax=_most(kind.percent), **style)
            made.colorbar(drawn, ax=axes, pad=0.01, extend="max")
            axes.grid(visible=False)
            axes.set(xlim=(extent[0], extent[-1]), ylim=(depth[0], depth[-1]))
            axes.set_title(kind.title, fontsize=9, loc="left", color=SOFT)

    caption = (
        f"At {condition(at)}. A node that is off the line between its neighbours marks a stripe that the grid hardly "
        "resolves; between the nodes as they are, a smooth surface is off by a quarter of it. The scale ends at the "
        "99th percentile."
    )
    label = f"How far the map is to be trusted, over extent and depth: {', '.join(kind.name for kind in kinds)}."
    return Part("How far to trust it", caption, label, 2.6 * math.ceil(len(kinds) / 2), draw, data, "doubts")


def _lead(rms_map: RmsMap) -> str:
    """Return the leading sentence: the range of the RMS, and whether it is absolute."""
    low, high = (value / STANDARD_GRAVITY for value in span_of(rms_map.rms))
    trust = f"rig {rig_words(rms_map.plan.rig)}"
    if not rms_map.plan.rig.calibrated:
        trust += ", so that levels and volumes are relative"
    level = f"RMS {figure(low)} to {figure(high)} g" if math.isfinite(low) else "No simulation ended well: no RMS"
    return f"{level} in {_band(rms_map.plan)}; {trust}."


def span_of(values: np.ndarray) -> tuple[float, float]:
    """Return the least and the largest finite value, NaN without any."""
    finite = values[np.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if finite.size else (math.nan, math.nan)


def _facts(rms_map: RmsMap) -> list[tuple[str, str]]:
    """Return labels and texts of a map's provenance and errors."""
    plan, attributes = rms_map.plan, rms_map.attributes
    found = [
        ("Bearing", f"{plan.bearing.designation}, clearance {figure(1e6 * plan.clearance)} µm"),
        ("Damaged part", f"{DAMAGED[plan.part]}; V_eq = {rms_map.volume_words}"),
        ("Condition", f"{_axis(rms_map.load, 'N')}; {_axis(rms_map.speed, 'Hz')}"),
        ("Grid", f"{count(len(rms_map.dphi_d), 'extent')}, {count(len(rms_map.h_d), 'depth')}"),
        ("Floor", _floor(plan)),
        ("Rig", _rig(plan)),
        ("Band of the RMS", _band(plan)),
        ("Numerical error", _numerical(rms_map)),
        ("Between nodes", _error(attributes, "interpolation")),
    ]
    if plan.slip is not None:
        found.append(("Slip", f"up to {figure(math.degrees(plan.slip.phi_slip), 2)}°, {plan.slip.rule}"))
    if attributes.get("condition_error") is not None:
        found.append(("Between loads and speeds", _error(attributes, "condition")))
    states = [f"{np.count_nonzero(rms_map.status == code):,} {name}" for code, name in enumerate(STATUSES)]
    found.append(("Simulations", ", ".join(text for text in states if not text.startswith("0 "))))
    found.append(("Hash", rms_map.hash[:16]))
    return found


def _band(plan: MapPlan) -> str:
    return "full bandwidth" if plan.rms_band is None else f"{plan.rms_band[0]:g} to {plan.rms_band[1]:g} Hz"


def _axis(values: np.ndarray, unit: str) -> str:
    if len(values) < 5:
        return ", ".join(f"{value:g}" for value in values) + f" {unit}"
    return f"{values[0]:g} to {values[-1]:g} {unit} ({len(values)} nodes)"


def _floor(plan: MapPlan) -> str:
    if plan.floor.kind == "smooth":
        return "smooth" if plan.floors == 1 else f"smooth, mean of {plan.floors} records"
    floors = "one floor" if plan.floors == 1 else f"mean of {plan.floors} floors"
    return f"rough, {figure(1e6 * plan.floor.sd)} µm, {floors}, from seed {plan.floor.seed}"


def _rig(plan: MapPlan) -> str:
    if plan.rig_draws == 0:
        return rig_words(plan.rig)
    apart = "of its posterior" if plan.rig_posterior is not None else f"{figure(100 * plan.rig_spread)} % apart"
    return f"{rig_words(plan.rig)}; {plan.rig_draws} rigs drawn, {apart}"


def _numerical(rms_map: RmsMap) -> str:
    known = np.isfinite(rms_map.rms) & np.isfinite(rms_map.rms_error)
    level = float(np.sum(rms_map.rms[known] ** 2))
    if level == 0.0:
        return "unknown"
    return f"{figure(100.0 * math.sqrt(float(np.sum(rms_map.rms_error[known] ** 2)) / level), 2)} % (rms)"


def _error(attributes: dict[str, object], name: str) -> str:
    values = [attributes.get(f"{name}_error"), attributes.get(f"{name}_error_max")]
    known = [float(value) for value in values if isinstance(value, int | float | np.number)]
    if len(known) < 2 or not all(math.isfinite(value) for value in known):
        return "not measured"
    rms, most = (figure(100.0 * value, 2) for value in known)
    return f"wrong by {rms} % of the largest RMS (rms), {most} % at most"
