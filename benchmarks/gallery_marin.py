"""Figures of the gallery from Marin's 6206 with three and nine balls: signals, envelopes, power over speed.

Neither depth nor length of the defect is printed; ``models.published.marin`` says what is taken. Envelopes are of four
settled seconds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, partial
from itertools import pairwise

import numpy as np
from matplotlib.figure import FigureBase

from benchmarks.gallery_plate import Claim, Plate, letter, number, words
from benchmarks.gallery_spectra import Lines, Values, envelope_spectrum, kept_lines, named_panel, panels_of_lines
from models.machine.bearing import kinematics
from models.machine.scene import Scene
from models.published.marin import DROPPED, INNER, STEP, bearing_of, run, scene_of
from models.solve.ball_inertia.solver import solve
from models.words.request import Request
from monitor.report.figures.drawing import BLUE, VERMILION

SPEEDS = (5.0, 10.0, 20.0, 30.0, 40.0)
"""Of Figs. 6 to 9, Hz."""
ALL_SPEEDS = (5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0)
"""Of Fig. 16, Hz."""
DAMPING = 1000.0
"""Five times the printed damping, N s/m: with it BPFI comes first at 20 Hz."""
_RATE, _SECONDS, _BIN = 25600.0, 4.0, 1.0


def damaged(balls: int, speed: float, damping: float = 200.0) -> Scene:
    """Return the bearing with the defect of the inner race."""
    return scene_of(balls, speed, defect=INNER, damping=damping)


@cache
def lines_of(scene: Scene) -> Lines:
    """Return the spectrum of the envelope of y'', 500 to 10,000 Hz."""
    found = solve(scene, Request(duration=_SECONDS, rate=_RATE, accuracy=2e-2))
    return envelope_spectrum(found.acceleration(_RATE, _SECONDS), _RATE)


def signal_of(scene: Scene) -> Values:
    """Return y'' after the 0.2 s that the source leaves out, m/s2."""
    return run(scene).acceleration[round(DROPPED / STEP) :]


def bpfi(balls: int, speed: float) -> float:
    """Return the passages over a spot of the inner race, Hz."""
    return kinematics(bearing_of(balls), speed).bpfi


def _signals(balls: int, speeds: Sequence[float], claims: Sequence[Claim]) -> Plate:
    drawn = {speed: signal_of(damaged(balls, speed)) for speed in speeds}

    def draw(made: FigureBase) -> None:
        panels = np.atleast_1d(made.subplots(len(drawn), 1, sharex=True))
        for axes, (speed, signal) in zip(panels, drawn.items(), strict=True):
            # 4 us between points are more than a picture shows.
            few = signal[: round(0.5 / STEP) : 8]
            axes.plot(8e3 * STEP * np.arange(len(few)), few, color=BLUE, lw=0.5)
            axes.set(xlim=(0.0, 500.0), ylabel="m/s²")
            named_panel(axes, f"{speed:g} Hz")
        panels[-1].set_xlabel("time (ms)")

    caption = f"y'' with {balls} balls and a defect of the inner race, half a second."
    data = {"speed_hz": list(drawn), "sd_m_s2": [float(np.std(signal)) for signal in drawn.values()]}
    data |= {"peak_m_s2": [float(np.max(np.abs(signal))) for signal in drawn.values()]}
    return Plate(caption, f"Signals with {balls} balls.", 0.5 + 1.1 * len(drawn), draw, data, claims)


def _modulated(balls: int) -> Claim:
    """Return the claim that the envelope swings with BPFI."""
    cases = [lines_of(damaged(balls, speed)).stands_out(bpfi(balls, speed), 300.0, 3.0) for speed in SPEEDS]
    return words("peaks repeat with the defect: BPFI stands out of the envelope", cases)


def figure_6() -> Plate:
    """Return signals with three balls."""
    return _signals(3, SPEEDS, [_modulated(3)])


def figure_8() -> Plate:
    """Return signals with nine balls."""
    more = [bpfi(9, speed) > bpfi(3, speed) for speed in SPEEDS]
    return _signals(9, SPEEDS, [_modulated(9), words("peaks are more frequent than with three balls", more)])


def _envelopes(balls: int) -> Plate:
    drawn = {f"{speed:g} Hz": lines_of(damaged(balls, speed)) for speed in SPEEDS}
    claims = [
        words(f"the highest line is BPFI (damping {text})", [_first(balls, speed, damping) for speed in SPEEDS])
        for damping, text in ((200.0, "as printed"), (DAMPING, "five times as large"))
    ]
    high = 120.0 if balls == 3 else 300.0

    def draw(made: FigureBase) -> None:
        panels = list(np.atleast_1d(made.subplots(len(drawn), 1, sharex=True)))
        panels_of_lines(panels, drawn, high, {}, share=False)
        for axes, speed in zip(panels, SPEEDS, strict=True):
            axes.axvline(bpfi(balls, speed), color=VERMILION, lw=1.0, ls=":", zorder=0)

    caption = f"Spectra of the envelope of y'' with {balls} balls, 500 to 10,000 Hz; dotted: BPFI."
    data = kept_lines({f"at_{speed:g}_hz": lines for speed, lines in zip(SPEEDS, drawn.values(), strict=True)}, high)
    return Plate(caption, f"Envelopes with {balls} balls.", 0.5 + 1.1 * len(drawn), draw, data, claims)


def _first(balls: int, speed: float, damping: float) -> bool:
    lines = lines_of(damaged(balls, speed, damping))
    return abs(lines.highest(low=1.0) - bpfi(balls, speed)) < _BIN


def figure_14() -> Plate:
    """Return the signal with three balls at 20 Hz."""
    return _signals(3, (20.0,), [_modulated(3)])


def figure_15() -> Plate:
    """Return the envelope with three balls at 20 Hz, with the printed and with five times the damping."""
    drawn = {
        "damping as printed": lines_of(damaged(3, 20.0)),
        "five times the damping": lines_of(damaged(3, 20.0, DAMPING)),
    }
    line = bpfi(3, 20.0)
    sides = {"16.2": line - 20.0, "56.2": line + 20.0, "52.4": 2.0 * line - 20.0, "92.0": 2.0 * line + 20.0}
    printed, chosen = drawn.values()
    claims = [
        number("highest line, damping as printed", 36.19, printed.highest(low=1.0), "Hz", 0.5),
        number("highest line, five times the damping", 36.19, chosen.highest(low=1.0), "Hz", 0.5),
        number("BPFI", 36.19, line, "Hz", 0.01),
        *(number("side line", float(text), value, "Hz", 0.05) for text, value in sides.items()),
        words("these and f_s stand out", [chosen.stands_out(value, 120.0, 3.0) for value in (20.0, *sides.values())]),
    ]
    named = {"f_s": 20.0, "BPFI": line, "2 BPFI": 2.0 * line, "3 BPFI": 3.0 * line}

    def draw(made: FigureBase) -> None:
        panels = list(made.subplots(2, 1, sharex=True))
        panels_of_lines(panels, drawn, 120.0, named, share=False)

    caption = "Spectra of the envelope of y'' with three balls at 20 Hz; (a) of the print is measured."
    data = kept_lines({"printed": printed, "chosen": chosen}, 120.0)
    return Plate(caption, "Envelope with three balls at 20 Hz.", 3.0, draw, data, claims)


def figure_16() -> Plate:
    """Return the power over the speed, healthy and with a defect, three and nine balls."""
    found = {
        (balls, defect): [float(np.var(signal_of((damaged if defect else scene_of)(balls, s)))) for s in ALL_SPEEDS]
        for balls in (3, 9)
        for defect in (False, True)
    }

    def draw(made: FigureBase) -> None:
        panels = made.subplots(1, 2)
        for place, (axes, balls) in enumerate(zip(panels, (3, 9), strict=True)):
            for defect, color, marker in ((False, BLUE, "o"), (True, VERMILION, "s")):
                name = "defect of the inner race" if defect else "healthy"
                axes.plot(ALL_SPEEDS, found[balls, defect], color=color, marker=marker, ms=4, label=name)
            letter(axes, place, f"{balls} balls")
            axes.set(xlabel="speed (Hz)", ylabel="mean square of y'' ((m/s²)²)", yscale="log")
            # More than the print has: its four panels have an axis each.
            axes.legend(loc="best", fontsize=8)

    claims = []
    for balls in (3, 9):
        pairs = zip(found[balls, False], found[balls, True], strict=True)
        claims.append(words(f"{balls} balls: the defect raises the power", [healthy < hurt for healthy, hurt in pairs]))
        for defect in (False, True):
            values = found[balls, defect]
            rises = [low < high for low, high in pairwise(values)]
            kind = "with the defect" if defect else "healthy"
            claims.append(words(f"{balls} balls, {kind}: the power grows with the speed", rises))
    data: dict[str, Sequence[float]] = {"speed_hz": ALL_SPEEDS}
    data |= {f"power_{b}_balls_{'defect' if d else 'healthy'}_m2_s4": values for (b, d), values in found.items()}
    caption = "Mean square of y'' over the speed; the print defines no spectral power and prints no value."
    return Plate(caption, "Power of y'' over the speed with three and nine balls.", 3.2, draw, data, claims)


FIGURES: dict[str, Callable[[], Plate]] = {
    "6": figure_6,
    "7": partial(_envelopes, 3),
    "8": figure_8,
    "9": partial(_envelopes, 9),
    "14": figure_14,
    "15": figure_15,
    "16": figure_16,
}
