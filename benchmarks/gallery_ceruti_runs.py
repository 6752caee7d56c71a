"""Runs of Ceruti's rotor for the gallery, and how their signals and spectra are drawn.

Signals are those of the source's procedure (``models.published.ceruti``): from the middle of the clearance, without the
first turn of the cage. Spectra are of eight settled seconds, so that lines a turn of the cage apart are told apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase

from benchmarks.gallery_plate import Claim, Plate, number
from benchmarks.gallery_spectra import (
    Lines,
    Values,
    envelope_spectrum,
    kept_lines,
    named_panel,
    panels_of_lines,
)
from models.machine.bearing import from_catalogue, kinematics
from models.machine.scene import Part, Scene
from models.published.ceruti import DURATION, HALF_PITCH, SPEED, STEP, damaged, peak_value, rotor, run
from models.solve.rotor import elastic as rotor_elastic
from models.solve.rotor import solver as rigid_rotor
from models.solve.rotor.rig import RotorRig
from models.solve.rotor.solver import Rigid, Trace, trace_of
from models.words.request import Request, Sensor
from monitor.report.figures.drawing import BLUE

MM = 1e3
"""Millimetres in a metre: accelerations are printed in mm/s2."""
UNIT = "mm/s²"
LINES = kinematics(from_catalogue("6305"), SPEED)
END_MASS = 0.2
"""Mass of an end of the elastic shaft, kg, where the accelerations of A and B are shown."""
LUMPED = f"elastic shaft with {END_MASS:g} kg at either end, without which A and B have no acceleration"
SENSORS: tuple[Sensor, ...] = ("a", "c", "b")
SHOWN = (1.5, 1.75)
"""Times of a run that are drawn, s."""
HIGH = 300.0
"""End of the spectra that are drawn, Hz."""
RATE, SECONDS = 25600.0, 8.0
"""Of the settled signals: sampling rate, Hz, and duration, s."""


def lumped(length: float = 0.8, part: Part | None = None, eccentricity: float = 0.0) -> Scene:
    """Return the rotor on an elastic shaft with a mass at its ends."""
    scene = replace(rotor(HALF_PITCH, eccentricity, length, END_MASS), physics=("elastic_shaft",))
    return scene if part is None else damaged(part, scene)


def bent(eccentricity: float = 0.0) -> Scene:
    """Return the rotor on an elastic shaft as the source has it, with ends without mass: C alone has acceleration."""
    return replace(rotor(eccentricity=eccentricity), physics=("elastic_shaft",))


def rigid(length: float = 0.8, part: Part | None = None) -> Scene:
    """Return the rotor with a rigid shaft."""
    scene = rotor(length=length)
    return scene if part is None else damaged(part, scene)


def of(scene: Scene) -> Trace:
    """Return the run of a scene by the source's procedure; ends with a mass need a quarter of its steps."""
    if not scene.physics:
        return run(scene)
    return run(scene, elastic=True, step=0.25 * STEP if _has_ends(scene) else STEP)


def _has_ends(scene: Scene) -> bool:
    return scene.rig_as(RotorRig).end_mass > 0.0


def machine_of(scene: Scene) -> str:
    """Return what a scene is instead of the source's, "" where it is that."""
    return LUMPED if _has_ends(scene) else ""


def peak(scene: Scene, sensor: Sensor) -> float:
    """Return half the range after the first turn of the cage, mm/s2."""
    return peak_value(of(scene), sensor, scene)


@cache
def long_signal(scene: Scene, sensor: Sensor) -> Values:
    """Return eight settled seconds of a sensor, m/s2."""
    return _answer(scene).acceleration(RATE, SECONDS, sensor=sensor)


@cache
def _answer(scene: Scene) -> Any:
    request = Request(duration=SECONDS, rate=RATE, accuracy=2e-2)
    return (rotor_elastic if scene.physics else rigid_rotor).solve(scene, request)


@cache
def lines_of(scene: Scene, sensor: Sensor) -> Lines:
    """Return the spectrum of the envelope of a sensor, 500 to 10,000 Hz."""
    return envelope_spectrum(long_signal(scene, sensor), RATE)


def draw_signals(made: FigureBase, drawn: Sequence[tuple[str, Values, float]], *, share: bool = True) -> list[Axes]:
    """Draw signals, m/s2, each with its name and step, below each other; ``share``: on one scale. Return the panels."""
    panels = np.atleast_1d(made.subplots(len(drawn), 1, sharex=True, sharey=share))
    for axes, (name, signal, step) in zip(panels, drawn, strict=True):
        shown = slice(round(SHOWN[0] / step), round(SHOWN[1] / step))
        axes.plot(1e3 * step * np.arange(shown.stop - shown.start), signal[shown], color=BLUE, lw=0.7)
        axes.set(ylabel="m/s²", xlim=(0.0, 1e3 * (SHOWN[1] - SHOWN[0])))
        named_panel(axes, name)
    panels[-1].set_xlabel("time (ms)")
    return list(panels)


def levels(scene: Scene) -> dict[str, Any]:
    """Return PV and RMS of A, C and B as data."""
    return {
        f"{kind}_{sensor}_mm_s2": (
            peak(scene, sensor) if kind == "pv" else MM * float(np.std(long_signal(scene, sensor)))
        )
        for kind in ("pv", "rms")
        for sensor in SENSORS
    }


def signals(scene: Scene, caption: str, claims: Sequence[Claim], *, sensors: Sequence[Sensor] = SENSORS) -> Plate:
    """Return a plate of the accelerations along the load of some sensors."""
    found = of(scene)
    drawn = [(s.upper(), found.acceleration[:, found.sensors.index(s)], found.step) for s in sensors]
    text = f"{caption}. Along the load, a quarter of a second{_scale(scene)}."
    label = f"Accelerations of {', '.join(s.upper() for s in sensors)}."
    machine = machine_of(scene)

    def draw(made: FigureBase) -> None:
        draw_signals(made, drawn, share=not scene.physics)

    return Plate(text, label, 0.5 + 1.25 * len(drawn), draw, levels(scene), claims, machine)


def _scale(scene: Scene) -> str:
    return ", each on its own scale" if scene.physics else ""


def multiples(fundamental: float, name: str, count: int = 6) -> dict[str, float]:
    """Return the first multiples of a frequency by their names."""
    return {name if k == 1 else f"{k} {name}": k * fundamental for k in range(1, count + 1)}


def envelopes(
    scene: Scene, caption: str, claims: Sequence[Claim], named: dict[str, float], *, sensors: Sequence[Sensor] = SENSORS
) -> Plate:
    """Return a plate of the spectra of the envelopes of some sensors."""
    drawn = {sensor.upper(): lines_of(scene, sensor) for sensor in sensors}
    text = f"{caption}. Spectra of the envelope, 500 to 10,000 Hz, of eight settled seconds{_scale(scene)}."
    label = f"Spectra of the envelope of {', '.join(drawn)}."
    machine = machine_of(scene)

    def draw(made: FigureBase) -> None:
        panels = np.atleast_1d(made.subplots(len(drawn), 1, sharex=True))
        panels_of_lines(list(panels), drawn, HIGH, named, share=not scene.physics)

    return Plate(text, label, 0.5 + 1.25 * len(drawn), draw, kept_lines(drawn, HIGH), claims, machine)


def top(scene: Scene, sensor: Sensor, what: str, printed: float) -> Claim:
    """Return a claim of the highest line; the print resolves 0.939 Hz."""
    return number(what, printed, lines_of(scene, sensor).highest(), "Hz", 0.939)


def across(scene: Scene) -> Values:
    """Return the accelerations of A, B and C across the load, m/s2, (steps, 3), by the source's procedure."""
    g = scene.clearance
    rest = np.array([g, 0.0, 0.0, 0.0, g, 0.0, g, 0.0])
    return trace_of(scene, DURATION, STEP, Rigid(scene, 0.5 * math.pi), rest).acceleration


def tilting(scene: Scene) -> float:
    """Return the largest acceleration of tilting after the first turn of the cage, rad/s2."""
    found = of(scene)
    return float(np.max(np.abs(np.diff(found.tilt[round(1.0 / LINES.ftf / STEP) :], 2)))) / found.step**2


EQUAL, QUARTER, HALF = rotor(0.0), rotor(math.radians(12.85)), rotor(math.radians(25.7))
"""Healthy bearings, the balls of A ahead of those of B by nothing, a quarter and half of their spacing."""
