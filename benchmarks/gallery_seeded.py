"""Figures of the gallery with the seeded defects D1 to D3, without slip and with it (Figs. 45 to 51)."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from matplotlib.figure import FigureBase
from numpy.typing import NDArray

from benchmarks.gallery_plate import DEFECTS, Claim, Plate, letter, number, words
from benchmarks.stationary import BAND, LOADS, RESONANCES, SPEEDS, Condition, conditions, resonance_rows, scene
from benchmarks.stationary import statement_rows as stated
from benchmarks.stationary_slip import (
    ANGLES,
    RULES,
    Levels,
    Rule,
    slip_levels,
    slip_spectra,
    slip_spectrum_rows,
    slip_statements,
)
from models.machine.bearing import kinematics
from models.machine.scene import Slip
from models.published.thesis import EXTENTS_DEG
from models.solve.six_dof.time_domain import simulate_time
from monitor.report.figures.drawing import BLUE, GREEN, GREY, PURPLE, VERMILION
from streams.block import STANDARD_GRAVITY

_STROKES = {1000.0: ("-", "o"), 2000.0: ("--", "s")}
_SPEED_COLOURS = dict(zip(SPEEDS, (BLUE, VERMILION, GREEN), strict=True))
_FEATURES = (("rms", "RMS (g)"), ("a_star", "A* (g)"))
_RATE = 25600.0
_SLIP_SECONDS = 0.5


@lru_cache(maxsize=1)
def _found() -> tuple[Condition, ...]:
    return tuple(conditions(compare=False))


def _one(defect: str, load: float, speed: float) -> Condition:
    [found] = [c for c in _found() if (c.defect, c.load, c.speed) == (defect, load, speed)]
    return found


def _claim(text: str, what: str, held: str) -> Claim:
    cases, _, of = held.partition(" of ")
    return Claim(what, text, held, "agrees" if cases == of else "differs" if cases == "0" else "in part")


def _statements(wanted: Sequence[tuple[str, str]]) -> list[Claim]:
    rows = {str(row["text"]): str(row["here"]) for row in stated(list(_found()))}
    return [_claim(text.partition(":")[0], what, rows[text]) for text, what in wanted]


def _feature_data() -> dict[str, Any]:
    data: dict[str, Any] = {"speed_hz": SPEEDS, "extent_deg": list(EXTENTS_DEG.values())}
    for c in _found():
        name = f"{c.defect}_{c.load:g}_newton_{c.speed:g}_hz"
        data |= {f"rms_{name}_g": c.rms, f"a_star_{name}_g": c.a_star}
    return data


def figure_45() -> Plate:
    """Return RMS and A* against speed."""

    def draw(made: FigureBase) -> None:
        panels = made.subplots(3, 2, sharex=True, sharey="col")
        for row, (defect, (color, _)) in enumerate(DEFECTS.items()):
            for column, (name, label) in enumerate(_FEATURES):
                axes = panels[row, column]
                for load, (stroke, marker) in _STROKES.items():
                    values = [getattr(_one(defect, load, speed), name) for speed in SPEEDS]
                    axes.plot(SPEEDS, values, color=color, ls=stroke, marker=marker, label=f"{load:g} N")
                letter(axes, 2 * row + column, f"{defect}, {label}")
        for axes in panels[-1]:
            axes.set(xlabel="rotation frequency (Hz)", xticks=SPEEDS, ylim=(0.0, None))
        panels[0, 0].legend(loc="upper left")

    claims = _statements(
        [
            ("measured: RMS rises with the load", "RMS rises with the load"),
            ("measured: RMS rises with the speed", "RMS rises with the speed"),
            ("measured: A* falls from 20 to 30 Hz (D1, D2)", "A* falls from 20 to 30 Hz (D1, D2)"),
            ("measured: A* rises from 30 to 40 Hz", "A* rises from 30 to 40 Hz"),
        ]
    )
    caption = "RMS and A* of the 18 stationary conditions against speed; simulated, 0 to 9.5 kHz, sensor on the casing."
    return Plate(caption, "RMS and A* against speed for D1 to D3.", 6.2, draw, _feature_data(), claims)


def figure_46() -> Plate:
    """Return RMS and A* against the width of the defect."""

    def draw(made: FigureBase) -> None:
        panels = made.subplots(3, 2, sharex=True, sharey="col")
        extents = list(EXTENTS_DEG.values())
        for row, (speed, color) in enumerate(_SPEED_COLOURS.items()):
            for column, (name, label) in enumerate(_FEATURES):
                axes = panels[row, column]
                for load, (stroke, marker) in _STROKES.items():
                    values = [getattr(_one(defect, load, speed), name) for defect in DEFECTS]
                    axes.plot(extents, values, color=color, ls=stroke, marker=marker, label=f"{load:g} N")
                letter(axes, 2 * row + column, f"{speed:g} Hz, {label}")
        for axes in panels[-1]:
            axes.set_ylim(0.0, None)
            axes.set_xticks(extents, [f"{defect}\n{extent:.2f}" for defect, extent in EXTENTS_DEG.items()])
            axes.set_xlabel("extent of the defect (degrees)")
        panels[0, 0].legend(loc="upper left")

    claims = _statements(
        [
            ("measured: RMS rises with the width", "RMS rises with the width"),
            ("simulated: at 30 Hz the RMS of D2 leaves the trend", "at 30 Hz the RMS of D2 leaves the trend"),
        ]
    )
    caption = "The same against the width of the defect. At 30 and 40 Hz D2 lies below D1."
    return Plate(caption, "RMS and A* against the width at three speeds.", 6.2, draw, _feature_data(), claims)


def figure_47() -> Plate:
    """Return one turn of the cage of every condition."""
    rate = 51200.0
    signals: dict[tuple[str, float, float], NDArray[np.float64]] = {}
    for c in _found():
        turn = 1.0 / kinematics(scene(c.defect, c.load, c.speed).bearing, c.speed).ftf
        signals[c.defect, c.load, c.speed] = c.response.acceleration(rate, turn, band=BAND) / STANDARD_GRAVITY

    def draw(made: FigureBase) -> None:
        panels = made.subplots(6, 3, sharey="row")
        for row, (defect, load) in enumerate((d, w) for d in DEFECTS for w in LOADS):
            for column, speed in enumerate(SPEEDS):
                axes, signal = panels[row, column], signals[defect, load, speed]
                axes.plot(1e3 * np.arange(signal.size) / rate, signal, lw=0.5, color=DEFECTS[defect][0])
                axes.set_xlim(0.0, 1e3 * signal.size / rate)
                axes.set_title(f"{defect}, {load:g} N, {speed:g} Hz", fontsize=8.5, loc="left")
            panels[row, 0].set_ylabel("(g)")
        for axes in panels[-1]:
            axes.set_xlabel("time (ms)")

    peaks = {key: float(np.abs(signal).max()) for key, signal in signals.items()}
    claims = [
        words(
            "peaks rise from 1000 to 2000 N, above all at 40 Hz with D2 and D3 (measured)",
            [peaks[d, 2000.0, 40.0] > peaks[d, 1000.0, 40.0] for d in ("D2", "D3")],
        ),
        words(
            "the impulses of D1 are seen at once: peak over three times the RMS",
            [peaks["D1", w, s] > 3.0 * _one("D1", w, s).rms for w in LOADS for s in SPEEDS],
        ),
    ]
    caption = "One turn of the cage of every condition (panels (a) to (f) are the rows), simulated, 0 to 9.5 kHz."
    data = {f"peak_{d}_{w:g}_newton_{s:g}_hz_g": peak for (d, w, s), peak in peaks.items()}
    # The first passage of each, at a fifth of the rate: enough to hold another program's against.
    data |= {f"signal_{d}_{w:g}_newton_{s:g}_hz_g": v[: round(rate / 20)][::16] for (d, w, s), v in signals.items()}
    data["signal_step_ms"] = 16e3 / rate
    return Plate(caption, "Waveforms of 18 conditions.", 9.0, draw, data, claims)


def figure_48() -> Plate:
    """Return the lines of D2 at 2000 N and 30 Hz."""
    frequency, amplitude = _one("D2", 2000.0, 30.0).response.lines()
    inside = frequency <= BAND[1]
    frequency, amplitude = frequency[inside], amplitude[inside] / STANDARD_GRAVITY

    def draw(made: FigureBase) -> None:
        panels = made.subplots(3, 1)
        for place, (axes, band) in enumerate(zip(panels, (BAND, (0.0, 2000.0), (6000.0, 9000.0)), strict=True)):
            shown = (frequency >= band[0]) & (frequency <= band[1])
            axes.vlines(frequency[shown], 0.0, amplitude[shown], color=DEFECTS["D2"][0], lw=1.5)
            for mode in RESONANCES:
                if band[0] <= mode <= band[1]:
                    axes.axvline(mode, color=GREY, ls=":", lw=1.1)
            axes.set(xlim=band, ylim=(0.0, None), ylabel="amplitude (g)")
            letter(axes, place, f"{band[0]:g} to {band[1]:g} Hz")
        panels[-1].set_xlabel("frequency (Hz)")

    claims = [
        Claim(
            f"largest line next to the resonance of {row['printed Hz']:g} Hz (one line away at most)",
            f"{row['printed Hz']:g} Hz",
            f"{row['largest line Hz']:.0f} Hz, {float(row['lines away'] or 0):+.1f} lines away",
            "agrees" if abs(float(row["lines away"] or 0)) <= 1.0 else "differs",
        )
        for row in resonance_rows(list(_found()))
    ]
    claims.append(number("BPFO", 146.7, _one("D2", 2000.0, 30.0).response.bpfo, "Hz", 0.05))
    caption = "Lines of D2 at 2000 N and 30 Hz at multiples of BPFO; dotted: the resonances that the text states."
    data = {"frequency_hz": frequency, "amplitude_g": amplitude}
    return Plate(caption, "Spectrum of D2 at 2000 N and 30 Hz.", 5.2, draw, data, claims)


def figure_49() -> Plate:
    """Return spectra of D2 at 2000 N and 30 Hz with slip."""
    spectra = slip_spectra(scene("D2", 2000.0, 30.0))

    def draw(made: FigureBase) -> None:
        panels = made.subplots(3, 1, sharex=True, sharey=True)
        for place, (axes, angle) in enumerate(zip(panels, ANGLES, strict=True)):
            frequency, amplitude = spectra[angle]
            shown = frequency <= BAND[1]
            axes.plot(frequency[shown], amplitude[shown], lw=0.6, color=DEFECTS["D2"][0])
            letter(axes, place, f"φ_slip = {angle:g} rad")
            axes.set(xlim=BAND, ylabel="amplitude (g)")
        panels[0].set_ylim(0.0, None)
        panels[-1].set_xlabel("frequency (Hz), lines of 1 Hz")

    rows = slip_spectrum_rows(spectra)
    low, middle, high = ([float(row[name] or 0.0) for row in rows] for name in list(rows[0])[1:])
    claims = [
        words("the middle group shrinks the more, the larger the slip", [a > b for a, b in itertools.pairwise(middle)]),
        Claim(
            "at 0.02 rad the middle group shrinks greatly, the lowest little",
            "in words",
            f"to {100 * middle[-1] / middle[0]:.0f} %, to {100 * low[-1] / low[0]:.0f} %",
            "agrees" if middle[-1] < 0.5 * middle[0] and low[-1] > 0.8 * low[0] else "differs",
        ),
        words("the peak of the highest group grows with the slip", [a < b for a, b in itertools.pairwise(high[1:])]),
    ]
    caption = "D2 at 2000 N and 30 Hz with slip, one second, one σ for each passage of a ball."
    data: dict[str, Any] = {"largest_slip_rad": [0.0, *ANGLES]}
    data |= {"low_group_g": low, "middle_group_g": middle, "high_group_g": high}
    return Plate(caption, "Spectra with slip up to 0.005, 0.01 and 0.02 rad.", 5.2, draw, data, claims)


def likeness(signal: NDArray[np.float64], period: float) -> float:
    """Return how like each other successive periods are: their correlation, the mean over all neighbours.

    Args:
        signal: any unit.
        period: in samples; fractions are allowed.
    """
    count = int(signal.size / period) - 1
    positions = np.arange(int(period))
    pieces = np.array([np.interp(k * period + positions, np.arange(signal.size), signal) for k in range(count)])
    return float(np.mean([np.corrcoef(a, b)[0, 1] for a, b in itertools.pairwise(pieces)]))


def figure_50() -> Plate:
    """Return waveforms of D2 at 2000 N and 30 Hz with slip."""
    plain = scene("D2", 2000.0, 30.0)
    lines = kinematics(plain.bearing, plain.speed)
    signals = {
        angle: simulate_time(replace(plain, slip=Slip(angle)), _SLIP_SECONDS, _RATE).acceleration(_RATE, _SLIP_SECONDS)
        / STANDARD_GRAVITY
        for angle in ANGLES
    }
    turn = round(_RATE / lines.ftf)

    def draw(made: FigureBase) -> None:
        panels = made.subplots(3, 1, sharex=True, sharey=True)
        for place, (axes, angle) in enumerate(zip(panels, ANGLES, strict=True)):
            axes.plot(1e3 * np.arange(turn) / _RATE, signals[angle][:turn], lw=0.8, color=PURPLE)
            letter(axes, place, f"φ_slip = {angle:g} rad")
            axes.set(xlim=(0.0, 1e3 * turn / _RATE), ylabel="acceleration (g)")
        panels[-1].set_xlabel("time (ms), one turn of the cage")

    like = [likeness(signals[angle], _RATE / lines.bpfo) for angle in ANGLES]
    claims = [
        Claim(
            "the signal is no longer periodic",
            "in words",
            "correlation of successive passages " + ", ".join(f"{v:.2f}" for v in like),
            "agrees" if like[0] < 0.999 else "differs",
        ),
        words("the variability grows with the slip", [a > b for a, b in itertools.pairwise(like)]),
    ]
    caption = "D2 at 2000 N and 30 Hz with slip, one turn of the cage, one σ for each passage of a ball."
    data = {"largest_slip_rad": ANGLES, "likeness_of_passages": like, "signal_step_ms": 4e3 / _RATE}
    data |= {f"signal_at_{angle:g}_rad_g": signal[: turn // 2 : 4] for angle, signal in signals.items()}
    return Plate(caption, "Waveforms with slip up to 0.005, 0.01 and 0.02 rad.", 5.0, draw, data, claims)


@lru_cache(maxsize=1)
def _levels() -> Levels:
    scenes = {(c.defect, c.load, c.speed): scene(c.defect, c.load, c.speed) for c in _found()}
    return slip_levels(scenes, BAND)


def figure_51() -> Plate:
    """Return RMS and A* against speed without slip, with the least and with the largest."""
    found = _levels()
    shown: list[tuple[Rule, str]] = [(rule, name) for name, _ in _FEATURES for rule in RULES]
    styles = {0.0: ("-", "o"), 0.005: ("--", "s"), 0.02: (":", "^")}

    def draw(made: FigureBase) -> None:
        panels = made.subplots(3, 4, sharex=True)
        for row, (defect, (color, _)) in enumerate(DEFECTS.items()):
            for column, (rule, name) in enumerate(shown):
                axes = panels[row, column]
                for angle, (stroke, marker) in styles.items():
                    for load in LOADS:
                        values = [getattr(found[rule, angle][defect, load, speed], name) for speed in SPEEDS]
                        axes.plot(
                            *(SPEEDS, values),
                            color=color,
                            ls=stroke,
                            marker=marker,
                            ms=4,
                            label=f"{angle:g} rad" if load == 2000.0 else None,
                            alpha=0.5 if load == 1000.0 else 1.0,
                        )
                axes.set_title(f"{defect}, {dict(_FEATURES)[name]}\n{rule.replace('_', ' ')}", fontsize=8.5, loc="left")
                axes.set(ylim=(0.0, None), xticks=SPEEDS)
        for axes in panels[-1]:
            axes.set_xlabel("speed (Hz)")
        made.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)

    claims = [
        _claim("in words", f"{row['text']} ({rule.replace('_', ' ')})", str(row[rule]))
        for row in slip_statements(found)
        for rule in RULES
    ]
    caption = (
        "RMS and A* against speed at 2000 N (strong) and 1000 N (pale), under two rules of how often σ is drawn: the "
        "limit of ever faster, and once for each passage. The print follows the first."
    )
    data = {
        f"{name}_{rule}_{angle:g}_rad_{d}_{w:g}_newton_{s:g}_hz_g": getattr(level, name)
        for (rule, angle), levels in found.items()
        if angle in styles
        for (d, w, s), level in levels.items()
        for name, _ in _FEATURES
    }
    return Plate(caption, "RMS and A* with slip by rule.", 6.6, draw, data, claims)


FIGURES: dict[str, Callable[[], Plate]] = {
    "45": figure_45,
    "46": figure_46,
    "47": figure_47,
    "48": figure_48,
    "49": figure_49,
    "50": figure_50,
    "51": figure_51,
}
