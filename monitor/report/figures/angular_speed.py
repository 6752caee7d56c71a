"""The angular speed of a shaft: its slow course, and its spectrum over events per revolution."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import FigureBase

from monitor.health.rotation.ias_study import IasStudy
from monitor.report.figures.drawing import GREY, INK, PURPLE, legend_above, places_kept
from monitor.report.figures.sheet import Part, Sheet
from monitor.report.figures.spectrum import FAULT_MARKS, ORDERS
from monitor.words.numbers import count, figure
from monitor.words.statuses import FAULT_NAMES

_POINTS = 1500
_PLAIN_ORDERS = 50.0
"""Events per revolution that are shown where no bearing is given."""


def ias_sheet(study: IasStudy, fundamentals: Mapping[str, float], values: Mapping[str, Any], name: str) -> Sheet:
    """Return the report of a recording of pulses.

    Args:
        study: of its pulses.
        fundamentals: first line of each part, events per revolution; empty where no bearing is given.
        values: what ``spallwatch ias`` prints.
        name: of the recording.
    """
    spectrum = study.spectrum
    found = [FAULT_NAMES[part] for part, one in values["lines"].items() if one["detected"]]
    lead = (
        f"{count(spectrum.turns, 'turn')} at {figure(spectrum.mean_speed, 4)} Hz, {spectrum.per_revolution} marks a "
        f"turn. Lines that stand out: {', '.join(found) or 'none'}."
        if fundamentals
        else f"{count(spectrum.turns, 'turn')} at {figure(spectrum.mean_speed, 4)} Hz, {spectrum.per_revolution} "
        "marks a turn."
    )
    facts = [
        ("Pulses", f"{study.train.times.size}, {study.missing} missing, {study.extra} too many"),
        ("Error of a pulse", f"{figure(values['timing_noise_ns'])} ns"),
        (
            "Repeats each turn",
            f"{figure(values['wheel_error_deg'])}° ± {figure(values['wheel_error_sd_deg'], 2)}°"
            + (", taken out" if study.removed else ""),
        ),
    ]
    return Sheet(f"Angular speed: {name}", lead, [_spectrum_part(study, fundamentals), _speed_part(study)], facts)


def _spectrum_part(study: IasStudy, fundamentals: Mapping[str, float]) -> Part:
    spectrum = study.spectrum
    highest = (ORDERS + 0.3) * max(fundamentals.values(), default=_PLAIN_ORDERS / (ORDERS + 0.3))
    shown = slice(1, max(3, min(spectrum.amplitude.size, int(highest / spectrum.resolution) + 1)))
    orders, amplitude = spectrum.orders[shown], spectrum.amplitude[shown]
    kept = places_kept(orders, amplitude, _POINTS)
    orders, amplitude = orders[kept], np.maximum(amplitude[kept], np.finfo(np.float64).tiny)

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        axes.plot(orders, amplitude, color=GREY, lw=0.8)
        top = float(amplitude.max())
        axes.set(xlabel="events per revolution", ylabel="angular speed (rad/s)", yscale="log", xlim=(0.0, orders[-1]))
        axes.set_ylim(max(0.3 * float(np.percentile(amplitude, 5)), 1e-9 * top), 3.0 * top)
        for part, line in fundamentals.items():
            colour, marker = FAULT_MARKS[part]
            at = [k * line for k in range(1, ORDERS + 1) if k * line <= orders[-1]]
            axes.plot(at, [2.0 * top] * len(at), marker, color=colour, ms=5, label=FAULT_NAMES[part], clip_on=False)
            for place in at:
                axes.axvline(place, color=colour, lw=0.5, alpha=0.5)
        if fundamentals:
            legend_above(axes)

    caption = (
        "Amplitude of the relative change of the speed times its mean. What repeats with the wheel, its errors "
        "included, stands on whole multiples of it."
    )
    data = {"order": orders, "amplitude_rad_s": amplitude}
    return Part(
        "Spectrum over events per revolution", caption, "Spectrum of the angular speed.", 3.4, draw, data, "ias"
    )


def _speed_part(study: IasStudy) -> Part:
    train = study.train
    marks = train.per_revolution
    # Whole turns: what repeats with the wheel falls out.
    at = np.arange(train.numbers[0], train.numbers[-1] + 1, marks)
    time = np.interp(at, train.numbers, train.times)
    middle, speed = 0.5 * (time[1:] + time[:-1]), 1.0 / np.diff(time)
    kept = places_kept(middle, speed, _POINTS)

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        axes.plot(middle[kept], speed[kept], color=PURPLE, lw=0.9)
        axes.axhline(study.spectrum.mean_speed, color=INK, lw=0.6, ls="--")
        axes.set(xlabel="time (s)", ylabel="speed (Hz)", xlim=(middle[0], middle[-1]))

    data = {"time_s": middle[kept], "speed_hz": speed[kept]}
    caption = "Speed turn by turn; dashed: its mean. Its slow course is divided out of the spectrum."
    return Part("Speed", caption, "Speed of the shaft over time.", 1.9, draw, data, "speed")
