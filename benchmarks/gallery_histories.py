"""Figures of the gallery from RMS maps and whole lives (Figs. 55 and 57 to 61)."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from matplotlib.patches import Rectangle

from benchmarks.gallery_life_panels import STROKES, TWIN, G, named, not_comparable, pair, six
from benchmarks.gallery_lives import (
    ENVELOPE_BAND,
    HEALTHY,
    LENGTHS,
    LOADS,
    MINUTE,
    SPEED,
    TABLE_21,
    Twin,
    block,
    histories,
    maps,
    true_volume,
    twins,
)
from benchmarks.gallery_plate import Claim, Plate, letter, words
from models.machine.bearing import from_catalogue, kinematics
from models.maps.data import MapSlice, RmsMap
from monitor.health.signal.features import BlockFeatures
from monitor.report.figures.drawing import BLUE, GREY, INK, ORANGE, PURPLE, SHADE, VERMILION
from monitor.report.figures.rms_map import show_levels


def figure_55() -> Plate:
    """Return the steps of the tracker on a block of one life."""
    twin, at = twins()["E5"], maps().slice_at(LOADS["E5"], SPEED)
    i = _clearest_step(twin)
    minutes, highest = twin.t / MINUTE, float(np.nanmax(at.rms)) / G

    def draw(made: FigureBase) -> None:
        panels = made.subplots(3, 2)
        for axes, k in ((panels[0, 0], i), (panels[2, 0], i + 1)):
            axes.plot(minutes[: k + 1], twin.smoothed[: k + 1] / G, color=BLUE)
            axes.plot(minutes[k], twin.smoothed[k] / G, "o", color=VERMILION)
            axes.set(xlabel="time from t_fs (min)", ylabel="RMS (g)", xlim=(0, minutes[-1]), ylim=(0, None))
        _level(panels[0, 1], at, highest, twin, i)
        _level(panels[1, 0], at, highest, twin, i, chosen=True)
        _level(panels[1, 1], at, highest, twin, i, chosen=True, removed=i)
        _level(panels[2, 1], at, highest, twin, i + 1, chosen=True, removed=i)
        titles = ("X(i)", "all points of this RMS", "least V_eq", "smaller sizes removed", "X(i+1)", "map for i+1")
        for place, (axes, title) in enumerate(zip(panels.flat, titles, strict=True)):
            letter(axes, place, title)

    grows = [bool(a[0] <= b[0] and a[1] <= b[1]) for a, b in pairwise(zip(twin.dphi_d, twin.h_d, strict=True))]
    claims = [words("sizes never shrink", grows), words("V_eq never falls", list(np.diff(twin.v_eq) >= 0.0))]
    caption = (
        f"One step of the tracker on the twin of E5, at {minutes[i]:.0f} min from t_fs, on the map at 4700 N: white "
        "lines are the level, the dashed line is the volume that was chosen, hatched is what is removed."
    )
    data = {"time_min": minutes[i : i + 2], "rms_g": twin.smoothed[i : i + 2] / G}
    data |= {"dphi_deg": np.degrees(twin.dphi_d[i : i + 2]), "h_d_um": 1e6 * twin.h_d[i : i + 2]}
    return Plate(caption, "Steps of the tracker over the RMS map.", 7.0, draw, data, claims, TWIN)


def _clearest_step(twin: Twin) -> int:
    """Return the block after which both sizes grow most, in the middle of the life."""
    middle = slice(len(twin.t) // 5, 4 * len(twin.t) // 5)
    growth = np.diff(twin.dphi_d) / np.nanmax(twin.dphi_d) + np.diff(twin.h_d) / np.nanmax(twin.h_d)
    return middle.start + int(np.nanargmax(growth[middle]))


def _level(
    axes: Axes, at: MapSlice, highest: float, twin: Twin, k: int, *, chosen: bool = False, removed: int | None = None
) -> None:
    x, y = np.degrees(at.dphi_d), 1e6 * at.h_d
    axes.imshow(
        at.interpolate(*np.meshgrid(np.linspace(0, at.dphi_d[-1], 200), np.linspace(0, at.h_d[-1], 120))) / G,
        origin="lower",
        extent=(x[0], x[-1], y[0], y[-1]),
        aspect="auto",
        vmin=0.0,
        vmax=highest,
    )
    axes.contour(x, y, at.rms / G, levels=[twin.smoothed[k] / G], colors="white", linewidths=1.0)
    axes.grid(visible=False)
    axes.set(xlabel="extent (degrees)", ylabel="depth (µm)")
    if removed is not None:
        corner = np.degrees(twin.dphi_d[removed]), 1e6 * twin.h_d[removed]
        style = {"facecolor": "white", "alpha": 0.35, "edgecolor": INK, "hatch": "///"}
        axes.add_patch(Rectangle((0, 0), corner[0], y[-1], **style))
        axes.add_patch(Rectangle((corner[0], 0), x[-1] - corner[0], corner[1], **style))
    if chosen:
        span = np.linspace(0.3, x[-1], 300)
        product = np.degrees(twin.dphi_d[k]) * 1e6 * twin.h_d[k]
        axes.plot(span, np.minimum(product / span, y[-1]), color=INK, ls="--", lw=1.2)
        axes.plot(np.degrees(twin.dphi_d[k]), 1e6 * twin.h_d[k], "o", color=ORANGE, mec="black", ms=7)
    axes.set(xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))


def _history(column: int, label: str, what: str) -> Plate:
    found = histories()

    def line(test: str, axes: Axes) -> None:
        time, values = found[test][0], found[test][column]
        axes.axvspan((time[-1] - LENGTHS[test] * MINUTE) / 3600, time[-1] / 3600, color=SHADE, lw=0)
        axes.plot(time / 3600, values / G, color=BLUE, marker=".", ms=4)
        axes.set_ylim(0.0, None)

    def draw(made: FigureBase) -> None:
        six(label, line, made, "time (h)")

    steady, rises = [], []
    for _, *columns in found.values():
        values = columns[column - 1]
        healthy, final = values[:HEALTHY], values[HEALTHY:]
        steady.append(bool(np.std(healthy) < 0.25 * np.mean(healthy)))
        rises.append(bool(np.min(final) > 3.0 * np.max(healthy)))
    claims = [
        words("stays about constant before the final stage (sd below a quarter)", steady),
        words("rises steeply at its beginning (more than threefold)", rises),
    ]
    data: dict[str, Any] = {}
    for test, row in found.items():
        data |= {f"time_{test}_h": row[0] / 3600, f"value_{test}_g": row[column] / G}
    caption = f"{what} over six whole lives; shaded: the final stage. Blocks of 0.4 s, every 25 min in the final stage."
    return Plate(caption, f"{what} over six lives.", 4.0, draw, data, claims, TWIN)


def figure_57() -> Plate:
    """Return RMS over whole lives."""
    return _history(1, "RMS (g)", "RMS")


def figure_58() -> Plate:
    """Return H_or over whole lives."""
    return _history(2, "H_or (g)", "H_or")


def figure_59() -> Plate:
    """Return envelope spectra of one life before and in its final stage."""
    blocks = {
        "normal operation": block("E3", 0.0, 1),
        "final stage": block("E3", true_volume("E3", 0.9 * LENGTHS["E3"] * MINUTE), 2),
    }
    bpfo = kinematics(from_catalogue("1205 ETN9"), SPEED).bpfo

    def draw(made: FigureBase) -> None:
        panels = made.subplots(1, 2)
        for place, (axes, (name, found)) in enumerate(zip(panels, blocks.items(), strict=True)):
            envelope = found.envelopes[0]
            shown = envelope.frequency <= 1200.0
            for k in range(1, 6):
                axes.axvline(k * bpfo, color=GREY, ls=":", lw=1.0)
            axes.plot(envelope.frequency[shown], envelope.amplitude[shown] / G, color=PURPLE, lw=0.9)
            axes.set(xlabel="frequency (Hz)", xlim=(0.0, 1200.0), ylim=(0.0, None))
            letter(axes, place, name)
        panels[0].set_ylabel("amplitude (g)")

    named_lines = {name: found.lines[0]["outer"] for name, found in blocks.items()}
    claims = [
        words("harmonics of BPFO stand out in the final stage", [named_lines["final stage"].detected]),
        words("and do not in normal operation", [not named_lines["normal operation"].detected]),
    ]
    low, high = (int(v / 1e3) for v in ENVELOPE_BAND)
    caption = f"Envelope spectra of the twin of E3, {low} to {high} kHz; dotted: multiples of BPFO, {bpfo:.1f} Hz."
    return Plate(caption, "Envelope spectra before and in the final stage.", 2.9, draw, _lines(blocks), claims, TWIN)


def _lines(blocks: dict[str, BlockFeatures]) -> dict[str, Any]:
    data: dict[str, Any] = {}
    for name, found in blocks.items():
        key, envelope = name.replace(" ", "_"), found.envelopes[0]
        shown = envelope.frequency <= 1200.0
        data |= {f"frequency_{key}_hz": envelope.frequency[shown], f"amplitude_{key}_g": envelope.amplitude[shown] / G}
    return data


def figure_60() -> Plate:
    """Return the RMS of the final stages."""
    found = twins()

    def line(test: str, axes: Axes) -> None:
        color, stroke = STROKES[test]
        axes.plot(found[test].t / MINUTE, found[test].rms / G, color=color, ls=stroke, label=named(test))

    def draw(made: FigureBase) -> None:
        for axes in pair(made, line, "RMS (g)"):
            axes.set_ylim(0.0, None)

    ends = zip(("E4", "E5", "E6"), TABLE_21["experimental"], strict=True)
    claims = [
        not_comparable(f"RMS at the end of {test} (Table 21)", f"{value} g", f"{found[test].rms[-1] / G:.2g} g")
        for test, value in ends
    ]
    claims.append(
        words(
            "the RMS rises and falls on its way (E2, E4, E5)",
            [bool(np.any(np.diff(found[t].rms) < 0)) for t in ("E2", "E4", "E5")],
        )
    )
    data: dict[str, Any] = {}
    for test, twin in found.items():
        data |= {f"time_{test}_min": twin.t / MINUTE, f"rms_{test}_g": twin.rms / G}
    caption = "RMS in the final stage, every 5 minutes. Oscillations come from the stripes of the model."
    return Plate(caption, "RMS in six final stages.", 3.0, draw, data, claims, TWIN)


def figure_61() -> Plate:
    """Return the four maps."""
    rms_map = maps()
    at = [rms_map.slice_at(float(load), SPEED) for load in rms_map.load]
    highest = float(np.nanmax(rms_map.rms)) / G

    def draw(made: FigureBase) -> None:
        panels = made.subplots(2, 2, sharex=True, sharey=True)
        image = None
        for place, (axes, part) in enumerate(zip(panels.flat, at, strict=True)):
            image = show_levels(axes, part, highest, rms_map.part_radius)
            letter(axes, place, f"{part.load:g} N")
        for axes in panels[-1]:
            axes.set_xlabel("extent of the defect (degrees)")
        for axes in panels[:, 0]:
            axes.set_ylabel("depth of the defect (µm)")
        if image is not None:
            made.colorbar(image, ax=panels, pad=0.01).set_label("RMS of the casing (g)")

    data: dict[str, Any] = {"extent_deg": np.degrees(rms_map.dphi_d)[::10], "depth_um": 1e6 * rms_map.h_d[::4]}
    data |= {f"rms_at_{part.load:g}_newton_g": part.rms[::4, ::10] / G for part in at}
    caption = (
        "RMS maps at 40 Hz, mean of two rough floors, 0 to 9.5 kHz; white lines: RMS in g; dashed: equal V_eq. Stripes "
        "4° and 0.8° apart belong to the model; a grid of 1° hides the fine ones."
    )
    return Plate(caption, "Four RMS maps over extent and depth.", 6.0, draw, data, _map_claims(rms_map))


def _map_claims(rms_map: RmsMap) -> list[Claim]:
    rms = rms_map.rms[:, 0]
    means = np.mean(rms, axis=(1, 2))
    tops = [np.unravel_index(int(np.argmax(part)), part.shape) for part in rms]
    right = [bool(h >= 0.5 * rms.shape[1] and d >= 0.5 * rms.shape[2]) for h, d in tops]
    rough = [float(np.mean(np.abs(np.diff(part, axis=1))) / np.mean(part)) for part in rms]
    # From 2 degrees on: narrower ones are localised defects.
    wide = rms_map.dphi_d >= np.radians(2.0)
    shallow, deep = (float(np.mean(np.std(rms[:, h][:, wide], axis=1))) / G for h in (3, -1))
    where = ", ".join(f"{np.degrees(rms_map.dphi_d[d]):.0f}° x {1e6 * rms_map.h_d[h]:.0f} µm" for h, d in tops)
    return [
        words("the RMS rises with the load", [bool(a < b) for a, b in pairwise(means)]),
        words(
            "larger loads give a less smooth map (mean step along the extent over the mean RMS)",
            [a < b for a, b in pairwise(rough)],
        ),
        Claim(
            "RMS may fall as the defect grows",
            "in words",
            f"with depth at {100 * float(np.mean(rms_map.falling('h_d'))):.0f} %, with extent at "
            f"{100 * float(np.mean(rms_map.falling('dphi_d'))):.0f} % of the nodes",
            "agrees",
        ),
        Claim(
            "the highest RMS lies in the upper right-most part of each map",
            "in words",
            f"{sum(right)} of {len(right)} in the upper right quarter: {where}",
            "agrees" if all(right) else "differs" if not any(right) else "in part",
        ),
        Claim(
            "stable for shallow defects, whatever the extent",
            "in words",
            f"standard deviation over extents {shallow:.2g} g at 3 µm, {deep:.2g} g at 32 µm",
            "agrees" if shallow < 0.5 * deep else "differs",
        ),
    ]


FIGURES: dict[str, Callable[[], Plate]] = {
    "55": figure_55,
    "57": figure_57,
    "58": figure_58,
    "59": figure_59,
    "60": figure_60,
    "61": figure_61,
}
