"""The shaft's faults of Ceruti's section 4.1 as spectra that can be compared, with the command that makes each."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
from matplotlib.figure import FigureBase

from benchmarks.gallery_ceruti_runs import LINES, LUMPED, RATE, SECONDS, SENSORS, lumped
from benchmarks.gallery_plate import Claim, Plate, number, words
from benchmarks.gallery_spectra import Lines, Values, kept_lines, mark, spectrum
from models.machine.scene import Scene
from models.published.ceruti import SPEED
from models.solve.response import Response
from models.solve.rotor.elastic import solve
from models.words.request import Request, Sensor
from monitor.report.figures.drawing import AXIS, PURPLE

HIGH = 110.0
COMMON = (
    "spallwatch simulate --model rotor --bearing 6305 --speed-hz 16.6667 --load-newton 100 --clearance-um 11.285 "
    "--physics elastic_shaft --parameter end_mass=0.2 --parameter k_c=8.4484e9 --direction-deg 90 --duration-s 8"
)
"""The rotor of the picture, healthy; a fault is added to it."""
FAULTS: dict[str, tuple[str, dict[str, float]]] = {
    "healthy": ("", {}),
    "unbalance": ("--unbalance-kg-m 5e-4", {"unbalance": 5e-4}),
    "couple unbalance": ("--couple-unbalance-kg-m2 5e-4", {"couple_unbalance": 5e-4}),
    "bow": ("--bow-um 100", {"bow": 1e-4}),
    "looseness": ("--unbalance-kg-m 5e-4 --clearance-um 100", {"unbalance": 5e-4, "clearance": 1e-4}),
}
"""Options of each fault, and the same as fields of a scene."""


def scene_of(fault: str) -> Scene:
    """Return the rotor with a fault of the shaft."""
    return replace(lumped(), **FAULTS[fault][1])


@cache
def lines(fault: str, sensor: Sensor) -> Lines:
    """Return the spectrum of a sensor, m/s2."""
    return spectrum(_signal(fault, sensor), RATE)


@cache
def _signal(fault: str, sensor: Sensor) -> Values:
    return _answer(fault).acceleration(RATE, SECONDS, sensor=sensor)


@cache
def _answer(fault: str) -> Response:
    request = Request(duration=SECONDS, rate=RATE, accuracy=2e-2, direction=0.5 * math.pi)
    return solve(scene_of(fault), request)


def _phase(fault: str) -> float:
    """Return the phase between the lines of A and B at the speed of the shaft, degrees."""
    turns = [
        np.sum(signal * np.exp(-2j * math.pi * SPEED * np.arange(len(signal)) / RATE) * np.hanning(len(signal)))
        for signal in (_signal(fault, "a"), _signal(fault, "b"))
    ]
    return abs(math.degrees(float(np.angle(turns[0] / turns[1]))))


def figure_41() -> Plate:
    """Return the spectra of A, C and B with each fault of the shaft."""

    def draw(made: FigureBase) -> None:
        shown = [fault for fault in FAULTS if fault != "healthy"]
        panels = made.subplots(len(shown), 3, sharex=True, sharey=True)
        for row, fault in zip(panels, shown, strict=True):
            for axes, sensor in zip(row, SENSORS, strict=True):
                axes.plot(*lines(fault, sensor).below(HIGH), color=PURPLE, lw=1.0)
                axes.plot(*lines("healthy", sensor).below(HIGH), color=AXIS, lw=0.8, alpha=0.9)
                axes.set(xlim=(0.0, HIGH), yscale="log", ylim=(1e-4, 5.0))
                named = {"f_s": SPEED, "BPFO": LINES.bpfo, "2 BPFO": 2.0 * LINES.bpfo}
                mark(axes, named, names=fault == shown[0])
            row[0].set_ylabel(f"{fault}\n(m/s²)")
        for axes, sensor in zip(panels[0], SENSORS, strict=True):
            axes.set_title(sensor.upper(), loc="left", fontsize=10, pad=12.0)
        for axes in panels[-1]:
            axes.set_xlabel("frequency (Hz)")

    healthy = lines("healthy", "c").at(SPEED)
    shown = {f"{fault.replace(' ', '_')}_{sensor}": lines(fault, sensor) for fault in FAULTS for sensor in SENSORS}
    data = kept_lines(shown, HIGH)
    options = "; ".join(f"{fault}: `{text}`" for fault, (text, _) in FAULTS.items() if text)
    caption = (
        "Spectra of the accelerations of A, C and B across the load, eight settled seconds; grey: healthy, "
        f"`{COMMON}`; added to it, {options}. `--sensor a|b|c` chooses the point, `--plot FILE` draws it."
    )
    return Plate(caption, "Spectra with four faults of the shaft.", 6.2, draw, data, _claims(healthy), LUMPED)


def _claims(healthy: float) -> list[Claim]:
    rises = [lines(fault, "c").at(SPEED) > 10.0 * healthy for fault in ("unbalance", "bow")]
    a, c, b = (lines("couple unbalance", sensor).at(SPEED) for sensor in SENSORS)
    found = [lines("looseness", "c").stands_out(k * SPEED, HIGH, 3.0) for k in (1, 2, 3, 4)]
    tight = [lines("unbalance", "c").stands_out(k * SPEED, HIGH, 3.0) for k in (1, 2, 3, 4)]
    return [
        number("unbalance: frequency of the highest line of C", SPEED, lines("unbalance", "c").highest(), "Hz", 0.063),
        words("unbalance and bow: f_s at C is ten times that of the healthy rotor", rises),
        words(
            "couple unbalance (conical): f_s is lower at C than at A and B (a third at most)",
            [a > 3.0 * c, b > 3.0 * c],
        ),
        Claim(
            "couple unbalance: A and B move against each other",
            "in words",
            f"{_phase('couple unbalance'):.0f}° between them, unbalance {_phase('unbalance'):.0f}°",
            "agrees" if _phase("couple unbalance") > 150.0 > 30.0 > _phase("unbalance") else "differs",
        ),
        words(
            "looseness, here clearance: multiples of f_s up to the fourth stand out, more than without",
            [sum(found) == len(found), sum(found) > sum(tight)],
        ),
        Claim("misalignment: lines at f_s and 2 f_s", "in words", "no coupling in the model", "not comparable"),
    ]


FIGURES = {"4.1": figure_41}
