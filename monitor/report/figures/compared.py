"""One scene by several models, drawn over each other: each at the first sensor that its model has."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import FigureBase

from models.response import Response
from models.scene import EFFECTS, Scene
from monitor.report.figures.drawing import AXIS, BLUE, GREEN, ORANGE, PURPLE, VERMILION, legend_above
from monitor.report.figures.scene import PLACES, SensorSignal, fundamental_of, signal_of
from monitor.report.figures.sheet import Part, Sheet
from monitor.words.numbers import figure
from streams.block import STANDARD_GRAVITY

_COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE)
# Decades that a spectrum shows below its highest line.
_DECADES = 4.0
_ZOOM = 2000.0


def compared_sheet(scene: Scene, answers: Mapping[str, Response]) -> Sheet:
    """Return the report of one scene by several models.

    Args:
        scene: what is simulated.
        answers: the response of each model, by its name.
    """
    fundamental, name = fundamental_of(scene)
    sensed = {
        f"{model} ({PLACES[found.sensors[0]]})": signal_of(found, found.sensors[0], fundamental)
        for model, found in answers.items()
        if np.all(np.isfinite(found.levels[0])) and found.rms > 0.0
    }
    if not sensed:
        raise ValueError("no model gave a level, so that there is nothing to draw")
    damage = (
        "healthy" if scene.defect is None else f"defect of the {scene.defect.part} race".replace("ball race", "ball")
    )
    title = f"{scene.bearing.designation}, {scene.speed:g} Hz, {scene.load:g} N, {damage}: {len(sensed)} models"
    lead = (
        "Each model has parameters of its own and is shown where its first sensor is, so that levels need not agree; "
        "what can be compared is the rhythm and which lines there are."
    )
    effects = ", ".join(EFFECTS[effect] for effect in scene.effects) or "none"
    levels = ", ".join(f"{label} {figure(one.rms / STANDARD_GRAVITY)} g" for label, one in sensed.items())
    return Sheet(
        title,
        lead,
        [_waveforms(sensed, name), _spectra(sensed, fundamental, name)],
        [("Effects", effects), ("RMS", levels)],
    )


def _waveforms(sensed: Mapping[str, SensorSignal], name: str) -> Part:
    def draw(made: FigureBase) -> None:
        panels = np.atleast_1d(made.subplots(len(sensed), 1, sharex=True))
        for axes, colour, (label, one) in zip(panels, _COLOURS, sensed.items(), strict=False):
            axes.plot(1e3 * (one.time - one.time[0]), one.signal / STANDARD_GRAVITY, color=colour, lw=0.8, label=label)
            axes.set_ylabel("g")
            legend_above(axes)
        panels[-1].set(xlabel="time (ms)")

    data: dict[str, Any] = {}
    for number, (label, one) in enumerate(sensed.items(), start=1):
        data |= {
            f"model_{number}": label,
            f"time_{number}_ms": 1e3 * (one.time[::4] - one.time[0]),
            f"acceleration_{number}_g": one.signal[::4] / STANDARD_GRAVITY,
        }
    caption = (
        f"The time of four passages ({name}), each model on its own scale; of a motion that does not repeat the "
        "loudest moment."
    )
    label = f"Accelerations over four passages by {len(sensed)} models."
    return Part("Signals", caption, label, 0.6 + 1.5 * len(sensed), draw, data, "signals")


def _spectra(sensed: Mapping[str, SensorSignal], fundamental: float, name: str) -> Part:
    shares = {label: one.amplitude / one.rms for label, one in sensed.items()}
    highest = max(float(share.max(initial=0.0)) for share in shares.values())

    def draw(made: FigureBase) -> None:
        panels = made.subplots(2, 1)
        for axes, end in zip(panels, (None, _ZOOM), strict=True):
            for colour, (label, one) in zip(_COLOURS, sensed.items(), strict=False):
                shown = one.frequency <= (one.frequency[-1] if end is None else end)
                x, y = one.frequency[shown], shares[label][shown]
                style = {"marker": ".", "ms": 3.0, "ls": "none"} if one.periodic else {"lw": 0.7}
                axes.plot(x, y, color=colour, label=label, **style)
            axes.set(yscale="log", ylabel="amplitude / RMS", ylim=(highest * 10.0**-_DECADES, 2.0 * highest))
        for multiple in range(1, int(_ZOOM / fundamental) + 1):
            panels[-1].axvline(multiple * fundamental, color=AXIS, lw=0.4, zorder=0)
        panels[-1].set(xlabel="frequency (Hz)", xlim=(0.0, _ZOOM))
        legend_above(panels[0])

    caption = (
        f"Amplitudes over the RMS of each model; dots are lines of motions that repeat, {_DECADES:g} decades "
        f"are shown. Below up to {_ZOOM:g} Hz, with the multiples of {name}, {figure(fundamental)} Hz."
    )
    data: dict[str, Any] = {"fundamental_hz": fundamental}
    for number, (label, one) in enumerate(sensed.items(), start=1):
        seen = shares[label] > highest * 10.0**-_DECADES
        data |= {
            f"model_{number}": label,
            f"frequency_{number}_hz": one.frequency[seen],
            f"amplitude_{number}_g": one.amplitude[seen] / STANDARD_GRAVITY,
        }
    return Part("Spectra", caption, f"Spectra by {len(sensed)} models.", 4.6, draw, data, "spectra")
