"""Figures of the gallery from Ceruti's rotor (001): healthy bearings (section 6.1), and all figures that are made."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.figure import FigureBase

from benchmarks import gallery_ceruti_defects, gallery_ceruti_faults, gallery_ceruti_shaft
from benchmarks.gallery_ceruti_runs import (
    EQUAL,
    HALF,
    LINES,
    MM,
    QUARTER,
    RATE,
    UNIT,
    across,
    draw_signals,
    envelopes,
    levels,
    lines_of,
    long_signal,
    multiples,
    of,
    peak,
    tilting,
    top,
)
from benchmarks.gallery_plate import Claim, Plate, number, words
from benchmarks.gallery_spectra import kept_lines, spectrum
from models.machine.scene import Scene
from models.published.acceptance import envelope
from models.published.ceruti import STEP
from models.solve.response import band_passed
from monitor.report.figures.drawing import BLUE, PURPLE, VERMILION


def figure_61() -> Plate:
    """Return the accelerations of C along and across the load."""
    found = of(EQUAL)
    along, side = found.acceleration[:, 2], across(EQUAL)[:, 2]
    same = [bool(np.allclose(found.acceleration[:, k], along, atol=1e-6 * np.ptp(along))) for k in (0, 1)]
    rms = MM * float(np.std(along[round(1.0 / LINES.ftf / STEP) :]))
    claims = [
        number("PV of C; section 6.1.1 prints 3403.9 for this run", 1857.0, peak(EQUAL, "c"), UNIT, 0.5),
        number("RMS of C; which run it is of is not printed", 604.0, rms, UNIT, 0.5),
        words("A and B move as C", same),
        words("the shaft never tilts", [tilting(EQUAL) < 1e-3]),
        words("both directions are comparable", [0.2 < float(np.std(side) / np.std(along)) < 5.0]),
    ]
    caption = "Healthy bearings, balls of A and B at equal angles, rigid shaft: C along (X) and across the load (Y)."

    def draw(made: FigureBase) -> None:
        draw_signals(made, [("X", along, STEP), ("Y", side, STEP)])

    return Plate(caption, "Accelerations of C in two directions.", 3.0, draw, levels(EQUAL), claims)


def figure_62() -> Plate:
    """Return the spectrum of C."""
    lines = spectrum(long_signal(EQUAL, "c"), RATE)
    claims = [words("highest lines lie above the frequencies of the bearing", [lines.highest() > LINES.bpfi])]

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        axes.plot(*lines.below(1500.0), color=PURPLE, lw=0.9)
        axes.set(xlim=(0.0, 1500.0), ylim=(0.0, None), xlabel="frequency (Hz)", ylabel="C (m/s²)")

    caption = "Spectrum of C along the load, balls at equal angles, eight settled seconds, Hann window."
    return Plate(caption, "Spectrum of C.", 2.6, draw, kept_lines({"C": lines}, 1500.0), claims)


def figure_63() -> Plate:
    """Return the band-passed acceleration of C and its envelope."""
    signal = long_signal(EQUAL, "c")[: round(0.15 * RATE)]
    few = slice(0, round(0.1 * RATE))
    time = 1e3 * np.arange(few.stop) / RATE
    passed = band_passed(signal, RATE, (500.0, 10_000.0))[few]
    around = envelope(signal, RATE)[few]

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        axes.plot(time, passed, color=BLUE, lw=0.8, label="500 to 10,000 Hz")
        axes.plot(time, around, color=VERMILION, lw=1.2, label="envelope")
        axes.set(xlim=(0.0, 100.0), xlabel="time (ms)", ylabel="C (m/s²)")
        axes.legend(loc="upper right")

    caption = "Acceleration of C within 500 to 10,000 Hz and its envelope; no value is printed."
    data = {"passed_m_s2": passed[::4], "envelope_m_s2": around[::4], "step_ms": 4e3 / RATE}
    return Plate(caption, "Band-passed signal and envelope.", 2.6, draw, data)


def figure_64() -> Plate:
    """Return the spectrum of the envelope of C."""
    found = lines_of(EQUAL, "c")
    falling = [found.at(k * LINES.bpfo) > found.at((k + 1) * LINES.bpfo) for k in range(1, 6)]
    claims = [
        top(EQUAL, "c", "highest line (BPFO)", 43.3676),
        number("BPFO", 43.1749, LINES.bpfo, "Hz", 5e-5),
        words("higher multiples of BPFO are there and smaller", falling),
    ]
    caption = "Healthy bearings, balls at equal angles, rigid shaft"
    return envelopes(EQUAL, caption, claims, multiples(LINES.bpfo, "BPFO"), sensors=("c",))


def _coordinates(scene: Scene, degrees: str, claims: Sequence[Claim]) -> Plate:
    """Return the accelerations of C in its four coordinates."""
    found, side = of(scene), across(scene)[:, 2]
    tilt = np.diff(found.tilt, 2, prepend=found.tilt[:1], append=found.tilt[-1:]) / found.step**2
    drawn = [("X", found.acceleration[:, 2], STEP), ("Y", side, STEP)]
    drawn += [("φ_y", tilt.real, STEP), ("φ_x'", -tilt.imag, STEP)]

    def draw(made: FigureBase) -> None:
        for axes in draw_signals(made, drawn, share=False)[2:]:
            axes.set_ylabel("rad/s²")

    caption = f"Healthy bearings, balls of A {degrees}° ahead of those of B, rigid shaft: C in its four coordinates."
    data = levels(scene) | {"largest_tilting_rad_s2": tilting(scene)}
    return Plate(caption, "Accelerations of C and its tilting.", 5.2, draw, data, claims)


def figure_66() -> Plate:
    """Return the four coordinates with a quarter of a spacing between the balls of A and B."""
    claims = [
        number("PV of C, balls at equal angles", 3403.9, peak(EQUAL, "c"), UNIT, 0.05),
        number("PV of C, 12.85°", 1856.5, peak(QUARTER, "c"), UNIT, 0.05),
        words("tilting, zero with balls at equal angles, arises", [tilting(QUARTER) > 1.0 > 1e3 * tilting(EQUAL)]),
    ]
    return _coordinates(QUARTER, "12.85", claims)


def figure_67() -> Plate:
    """Return the four coordinates with half a spacing between the balls of A and B."""
    claims = [
        number("PV of C, 25.7°; section 6.5.1 prints 999.5", 648.9111, peak(HALF, "c"), UNIT, 5e-5),
        words("PV of C falls from 0° over 12.85° to 25.7°", [peak(EQUAL, "c") > peak(QUARTER, "c") > peak(HALF, "c")]),
        words("tilting arises", [tilting(HALF) > 1.0 > 1e3 * tilting(EQUAL)]),
    ]
    return _coordinates(HALF, "25.7", claims)


def figure_68() -> Plate:
    """Return the spectrum of C's envelope with a quarter of a spacing."""
    claims = [top(QUARTER, "c", "highest line (2 BPFO); the text may mean Fig. 6.9", 86.3498)]
    caption = "Healthy bearings, balls of A 12.85° ahead, rigid shaft"
    return envelopes(QUARTER, caption, claims, multiples(LINES.bpfo, "BPFO"), sensors=("c",))


def figure_69() -> Plate:
    """Return the spectrum of C's envelope with half a spacing."""
    one, other = lines_of(HALF, "c"), lines_of(EQUAL, "c")
    lower = [one.at(k * LINES.bpfo) < other.at(k * LINES.bpfo) for k in range(1, 7)]
    claims = [
        top(HALF, "c", "highest line (2 BPFO, said of Fig. 6.8)", 86.3498),
        words("each line is lower than with balls at equal angles", lower),
    ]
    caption = "Healthy bearings, balls of A 25.7° ahead, rigid shaft"
    return envelopes(HALF, caption, claims, multiples(LINES.bpfo, "BPFO"), sensors=("c",))


FIGURES: dict[str, Callable[[], Plate]] = {
    "6.1": figure_61,
    "6.2": figure_62,
    "6.3": figure_63,
    "6.4": figure_64,
    "6.6": figure_66,
    "6.7": figure_67,
    "6.8": figure_68,
    "6.9": figure_69,
    **gallery_ceruti_defects.FIGURES,
    **gallery_ceruti_shaft.FIGURES,
    **gallery_ceruti_faults.FIGURES,
}
