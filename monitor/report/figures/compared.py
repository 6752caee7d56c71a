"""One scene by several models, drawn over each other: each at the first sensor that its model has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import FigureBase
from numpy.typing import NDArray

from models.machine.scene import EFFECTS, Scene
from models.solve.response import Response
from monitor.report.figures.drawing import AXIS, BLUE, GREEN, ORANGE, PURPLE, VERMILION, legend_above
from monitor.report.figures.scene import SensorSignal, fundamental_of, signal_of
from monitor.report.figures.sheet import Part, Sheet
from monitor.words.numbers import figure
from monitor.words.sensors import PLACES, unit_in_names, unit_of_sensor

_COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE)
# Decades that a spectrum shows below its highest line.
_DECADES = 4.0
# Multiples of the passage frequency that are shown one by one.
_MULTIPLES = 10


@dataclass(frozen=True, eq=False)
class _Model:
    """What one model gave: its name and place, the unit of its sensor (value in SI, text), and its signal."""

    label: str
    unit: tuple[float, str]
    sensed: SensorSignal

    @property
    def level(self) -> str:
        """The RMS in the unit of the sensor, for people."""
        return f"{figure(self.sensed.rms / self.unit[0])} {self.unit[1]}"

    @property
    def shares(self) -> NDArray[np.float64]:
        """The amplitudes of the spectrum over the RMS."""
        return self.sensed.amplitude / self.sensed.rms


def compared_sheet(scene: Scene, answers: Mapping[str, Response]) -> Sheet:
    """Return the report of one scene by several models.

    Args:
        scene: what is simulated.
        answers: the response of each model, by its name.

    Raises:
        ValueError: if none of them has a level.
    """
    fundamental, name = fundamental_of(scene)
    found = [
        _Model(
            f"{model} ({PLACES[sensor]})", unit_of_sensor(sensor, answer.status), signal_of(answer, sensor, fundamental)
        )
        for model, answer in answers.items()
        if np.all(np.isfinite(answer.levels[0])) and answer.rms > 0.0
        for sensor in answer.sensors[:1]
    ]
    if not found:
        raise ValueError("no model gave a level, so that there is nothing to draw")
    damage = (
        "healthy" if scene.defect is None else f"defect of the {scene.defect.part} race".replace("ball race", "ball")
    )
    title = f"{scene.bearing.designation}, {scene.speed:g} Hz, {scene.load:g} N, {damage}: {len(found)} models"
    lead = (
        "Each model has parameters of its own and is shown where its first sensor is, so that levels need not agree; "
        "what can be compared is the rhythm and which lines there are."
    )
    effects = ", ".join(EFFECTS[effect] for effect in scene.effects) or "none"
    levels = ", ".join(f"{one.label} {one.level}" for one in found)
    return Sheet(
        title,
        lead,
        [_waveforms(found, name), _spectra(found, fundamental, name)],
        [("Effects", effects), ("RMS", levels)],
    )


def _waveforms(found: Sequence[_Model], name: str) -> Part:
    def draw(made: FigureBase) -> None:
        panels = np.atleast_1d(made.subplots(len(found), 1, sharex=True))
        for axes, colour, one in zip(panels, _COLOURS, found, strict=False):
            time = 1e3 * (one.sensed.time - one.sensed.time[0])
            axes.plot(time, one.sensed.signal / one.unit[0], color=colour, lw=0.8, label=one.label)
            axes.set(ylabel=one.unit[1], xlim=(0.0, time[-1]))
            legend_above(axes)
        panels[-1].set(xlabel="time (ms)")

    data: dict[str, Any] = {}
    for number, one in enumerate(found, start=1):
        data |= {
            f"model_{number}": one.label,
            f"time_{number}_ms": 1e3 * (one.sensed.time[::4] - one.sensed.time[0]),
            f"signal_{number}_{_ending(one)}": one.sensed.signal[::4] / one.unit[0],
        }
    caption = (
        f"The time of four passages ({name}), each model on its own scale; of a motion that does not repeat the "
        "loudest moment."
    )
    label = f"Signals over four passages by {len(found)} models."
    return Part("Signals", caption, label, 0.6 + 1.5 * len(found), draw, data, "signals")


def _ending(one: _Model) -> str:
    """Return the end of the names of data in the unit of a sensor."""
    return unit_in_names(one.unit[1])


def _spectra(found: Sequence[_Model], fundamental: float, name: str) -> Part:
    highest = max(float(one.shares.max(initial=0.0)) for one in found)
    shown = (_MULTIPLES + 0.5) * fundamental

    def draw(made: FigureBase) -> None:
        whole, few = made.subplots(2, 1)
        for colour, one in zip(_COLOURS, found, strict=False):
            whole.plot(*_crest(one, fundamental), color=colour, lw=1.2, label=one.label)
            near = one.sensed.frequency <= shown
            if one.sensed.periodic:
                style: dict[str, Any] = {"marker": "o", "ms": 4.0, "ls": "none"}
            else:
                style = {"lw": 0.9}
            few.plot(one.sensed.frequency[near], one.shares[near], color=colour, **style)
        for multiple in range(1, _MULTIPLES + 1):
            few.axvline(multiple * fundamental, color=AXIS, lw=0.4, zorder=0)
        for axes in (whole, few):
            axes.set(yscale="log", ylabel="amplitude / RMS", ylim=(highest * 10.0**-_DECADES, 2.0 * highest))
        whole.set(xlim=(0.0, max(float(one.sensed.frequency[-1]) for one in found)))
        few.set(xlabel="frequency (Hz)", xlim=(0.0, shown))
        # More than four names in a row would be wider than the panels.
        legend_above(whole, 4 if len(found) <= 4 else 3)

    caption = (
        f"Amplitudes over the RMS of each model. Above: the highest line in each span of {figure(fundamental)} Hz "
        f"({name}). Below: all lines up to {_MULTIPLES} {name}; dots are those of motions that repeat."
    )
    data: dict[str, Any] = {"fundamental_hz": fundamental}
    for number, one in enumerate(found, start=1):
        seen = one.shares > highest * 10.0**-_DECADES
        data |= {
            f"model_{number}": one.label,
            f"frequency_{number}_hz": one.sensed.frequency[seen],
            f"amplitude_{number}_{_ending(one)}": one.sensed.amplitude[seen] / one.unit[0],
        }
    return Part("Spectra", caption, f"Spectra by {len(found)} models.", 4.6, draw, data, "spectra")


def _crest(one: _Model, span: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the highest share in each span of frequency, about its multiples, and where it is."""
    frequency, shares = one.sensed.frequency, one.shares
    number = np.round(frequency / span).astype(np.intp)
    first = np.flatnonzero(np.diff(number, prepend=-1))
    return span * number[first].astype(np.float64), np.asarray(np.maximum.reduceat(shares, first), dtype=np.float64)
