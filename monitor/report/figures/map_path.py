"""The RMS map with the path of the tracker over it, and the posterior of the defect."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray
from platformdirs import user_cache_dir

from models.machine.scene import Part
from models.maps.data import MapSlice, OutsideMapError, RmsMap
from models.maps.file import load_map
from models.maps.plan import DAMAGED, MapError
from monitor.health.size.filter.particles import Particles
from monitor.health.tracker import part_of
from monitor.records.archive import of_channel
from monitor.report.figures.drawing import (
    GREY,
    INK,
    ORANGE,
    STYLE,
    VERMILION,
    Picture,
    add_legend,
    legend_above,
    log_ticks,
    new_figure,
    to_svg,
)
from monitor.report.readings import unscaled
from monitor.report.runs import Channel, Run
from monitor.report.verdict import ChannelContext
from monitor.words.numbers import count, figure, volume
from streams.types.block import STANDARD_GRAVITY

_COLOURS = 18
_VOLUMES = {0.005: 0.4, 0.02: 0.62, 0.05: 0.8, 0.1: 0.97}
"""Volumes whose lines are drawn, mm3 per mm, and the share of the extent at which each is labelled."""
_MAX_POINTS = 400
_MAX_DOTS = 250


def kept_map(hashes: str, fault: str = "") -> RmsMap | None:
    """Return the map of the named part from the user's cache folder, None if it is not there.

    ``hashes`` are those of the channel's maps, joined by "+"; ``fault`` is "" where no part is named.
    """
    found = [rms_map for rms_map in map(_kept, hashes.split("+")) if rms_map is not None]
    maps: dict[Part, RmsMap] = {rms_map.part: rms_map for rms_map in found}
    part = part_of(fault or None, maps)
    return None if part is None else maps[part]


def _kept(wanted: str) -> RmsMap | None:
    if len(wanted) < 16 or not wanted.isalnum():
        return None
    try:
        found = load_map(Path(user_cache_dir("spallwatch")) / "maps" / f"rms-map-{wanted[:16]}.nc")
    except (MapError, OSError):
        return None
    return found if found.hash == wanted else None


def hash_of(run: Run, channel: str) -> str:
    """Return the hashes of a channel's RMS maps in the records, joined by "+", "" for none."""
    found = of_channel(run.attributes.get("map_hash"), channel)
    return "" if found in (None, "none") else found


@mpl.rc_context(STYLE)
def map_path(context: ChannelContext) -> Picture | None:
    """Draw the map, the tracker's path and the contour of the last RMS (thesis, Figs. 55 and 61).

    None without a map, where the tracker gave no sizes, or where the map does not cover the channel's load and speed.
    """
    run, channel = context.run, context.channel
    rms_map = context.options.map_for(channel.name) or kept_map(hash_of(run, channel.name), context.verdict.fault)
    if rms_map is None:
        return None
    rows = np.flatnonzero(np.isfinite(channel.column("dphi_d")) & np.isfinite(channel.column("h_d")))
    at = _condition(channel, rms_map)
    if not rows.size or at is None:
        return None
    extent, depth = np.degrees(at.dphi_d), 1e6 * at.h_d
    made, (axes,) = new_figure(4.3)
    axes.grid(visible=False)
    rms = at.rms / STANDARD_GRAVITY
    shown = axes.contourf(extent, depth, rms, levels=_COLOURS, cmap="viridis")
    made.colorbar(shown, ax=axes, pad=0.01, format="%.3g").set_label("RMS of the map (g)")
    _volumes(axes, rms_map.part_radius, extent, depth)
    x, y = np.degrees(channel.column("dphi_d")[rows]), 1e6 * channel.column("h_d")[rows]
    keep = np.unique(np.linspace(0, rows.size - 1, min(rows.size, _MAX_POINTS)).astype(int))
    axes.plot(x[keep], y[keep], color="#111111", linewidth=3.2)
    axes.plot([], [], color=GREY, linewidth=2.0, label="path of the tracker")
    axes.plot(x[keep], y[keep], ".-", color="white", linewidth=1.3, markersize=3)
    axes.plot(x[:1], y[:1], "o", color="white", markeredgecolor="black", markersize=7, label="first")
    axes.plot(x[-1:], y[-1:], "s", color=ORANGE, markeredgecolor="black", markersize=7, label="last")
    level = _latest_level(channel, int(rows[-1]))
    if math.isfinite(level) and np.nanmin(rms) < level < np.nanmax(rms):
        axes.contour(extent, depth, rms, levels=[level], colors=[VERMILION], linewidths=1.4)
        axes.plot([], [], color=VERMILION, label=f"sizes as loud as the last ({figure(level)} g)")
    cloud = _cloud(axes, run.particles.get(channel.name), rms_map.part_radius)
    axes.set_xlim(float(extent[0]), float(extent[-1]))
    axes.set_ylim(float(depth[0]), float(depth[-1]))
    axes.set_xlabel("extent of the defect (degrees)")
    axes.set_ylabel("depth of the defect (µm)")
    legend_above(axes)
    caption = (
        f"{count(rows.size, 'size')} that the tracker gave, from {figure(x[0], 2)}° and {figure(y[0], 2)} µm to "
        f"{figure(x[-1], 2)}° and {figure(y[-1], 2)} µm, over the map at {figure(at.load)} N and "
        f"{figure(at.speed)} Hz, of the {DAMAGED[rms_map.part]}. Dashed: equal volume."
    )
    if cloud:
        caption += " Dots: possible sizes after the last block, the larger the more likely."
    label = f"RMS map with the path that the tracker took over it on channel {channel.name}."
    data: dict[str, Any] = {"time_s": channel.time[rows], "dphi_deg": x, "h_d_um": y, "last_rms_g": level}
    data |= {"load_newton": at.load, "speed_hz": at.speed, **cloud}
    svg = to_svg(made, label, context.numbers)
    return Picture("The path over the RMS map", svg, caption + unscaled(run, channel), data, "path")


def _condition(channel: Channel, rms_map: RmsMap) -> MapSlice | None:
    values: list[float] = []
    for name in ("load", "speed"):
        row, axis = channel.last_row(name), getattr(rms_map, name)
        if row is None and len(axis) != 1:
            return None
        values.append(float(axis[0] if row is None else channel.column(name)[row]))
    try:
        return rms_map.slice_at(*values)
    except OutsideMapError:
        return None


def _latest_level(channel: Channel, row: int) -> float:
    """Return the RMS (g) that entered the map last: the moving mean of the thesis' tracker, else the RMS itself."""
    smoothed, rms = (float(channel.column(name)[row]) for name in ("rms_smoothed", "rms"))
    return (smoothed if math.isfinite(smoothed) else rms) / STANDARD_GRAVITY


def _volumes(axes: Axes, radius: float, extent: NDArray[np.float64], depth: NDArray[np.float64]) -> None:
    """Draw lines of equal volume, V_eq = radius dphi_d h_d (Eq. 90)."""
    span = np.linspace(max(float(extent[0]), 0.05), float(extent[-1]), 300)
    for value, share in _VOLUMES.items():
        h = value * 1e-6 / (radius * np.radians(span)) * 1e6
        inside = (h >= depth[0]) & (h <= depth[-1])
        if np.count_nonzero(inside) < 2:
            continue
        axes.plot(span[inside], h[inside], color="white", linewidth=0.8, linestyle="--", alpha=0.8)
        for place in np.flatnonzero(inside & (span <= share * extent[-1]))[-1:]:
            axes.annotate(
                volume(value * 1e-6),
                (float(span[place]), float(h[place])),
                (-3, 3),
                textcoords="offset points",
                color="white",
                fontsize=7.5,
                ha="right",
            )


def _cloud(axes: Axes, particles: Particles | None, radius: float) -> dict[str, Any]:
    """Draw the likeliest particles as dots; return what was drawn."""
    if particles is None or not particles.weight.size:
        return {}
    x, y = particles.sizes(radius)
    order = np.argsort(-particles.weight)[:_MAX_DOTS]
    weight = particles.weight[order] / particles.weight.max()
    x, y = np.degrees(x[order]), 1e6 * y[order]
    axes.scatter(x, y, s=2.0 + 22.0 * weight, color=ORANGE, alpha=0.55, linewidth=0)
    axes.plot([], [], ".", color=ORANGE, label="possible sizes")
    return {"particle_dphi_deg": x, "particle_h_d_um": y, "particle_weight": weight}


@mpl.rc_context(STYLE)
def posterior(context: ChannelContext) -> Picture | None:
    """Draw the distribution of V_eq after the last block by the physical tracker; None without two values."""
    channel = context.channel
    particles = context.run.particles.get(channel.name)
    if particles is None:
        return None
    v_eq = 1e6 * np.exp(particles.core[:, 0])
    weight = particles.weight / particles.weight.sum()
    usual = np.isfinite(v_eq) & (v_eq > 0)
    if np.sum(usual) < 2:
        return None
    edges = np.geomspace(max(v_eq[usual].min(), 1e-6), v_eq[usual].max() * 1.0001, 41)
    share, _ = np.histogram(v_eq[usual], edges, weights=weight[usual])
    made, (axes,) = new_figure(2.7)
    axes.stairs(share, edges, fill=True, color=ORANGE, alpha=0.45)
    axes.stairs(share, edges, color=ORANGE)
    truth = channel.last_row("v_eq_true")
    if truth is not None:
        axes.axvline(1e6 * channel.column("v_eq_true")[truth], color=INK, linestyle="--", label="true")
    axes.set_xscale("log")
    log_ticks(axes.xaxis)
    axes.set_xlabel("V_eq (mm³/mm)")
    axes.set_ylabel("probability per bin")
    add_legend(axes, loc="upper left")
    label = f"Distribution of V_eq on channel {channel.name} after the last block."
    caption = (
        f"{count(particles.weight.size, 'possible defect')}, worth {figure(particles.effective, 2)} of equal weight; "
        "two humps mean that two sizes explain the vibration."
    )
    data = {"edges_mm2": edges, "probability": share}
    svg = to_svg(made, label, context.numbers)
    return Picture("Distribution of V_eq after the last block", svg, caption, data, "posterior")
