"""Spectra over the angle of the shaft: of its angular speed, and of blocks of a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import FigureBase
from numpy.typing import NDArray

from monitor.health.signal.orders import OrderSpectrum
from monitor.health.signal.rotation.ias import IasStudy
from monitor.health.signal.rotation.rotation import Rotation
from monitor.health.signal.spectra import RawSpectra
from monitor.health.signal.waterfall import SpectrumRow
from monitor.report.figures.drawing import (
    BLUE,
    GREY,
    INK,
    PURPLE,
    STYLE,
    Picture,
    add_legend,
    legend_above,
    new_figure,
    places_kept,
    thin,
    to_svg,
)
from monitor.report.figures.sheet import Part, Sheet
from monitor.report.figures.spectrum import FAULT_MARKS, ORDERS, dot_lines, mark_parts
from monitor.report.verdict import ChannelContext
from monitor.words.numbers import count, figure
from monitor.words.parts import FAULTS
from monitor.words.statuses import FAULT_NAMES, LINE_NAMES

_SPEED_POINTS = 1500
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
    kept = places_kept(orders, amplitude, _SPEED_POINTS)
    orders, amplitude = orders[kept], np.maximum(amplitude[kept], np.finfo(np.float64).tiny)

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        axes.plot(orders, amplitude, color=GREY, lw=0.8)
        top = float(amplitude.max())
        axes.set(xlabel="events per revolution", ylabel="angular speed (rad/s)", yscale="log", xlim=(0.0, orders[-1]))
        axes.set_ylim(max(0.3 * float(np.percentile(amplitude, 5)), 1e-9 * top), 3.0 * top)
        mark_parts(axes, fundamentals, orders[-1], 2.0 * top)
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
    kept = places_kept(middle, speed, _SPEED_POINTS)

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        axes.plot(middle[kept], speed[kept], color=PURPLE, lw=0.9)
        axes.axhline(study.spectrum.mean_speed, color=INK, lw=0.6, ls="--")
        axes.set(xlabel="time (s)", ylabel="speed (Hz)", xlim=(middle[0], middle[-1]))

    data = {"time_s": middle[kept], "speed_hz": speed[kept]}
    caption = "Speed turn by turn; dashed: its mean. Its slow course is divided out of the spectrum."
    return Part("Speed", caption, "Speed of the shaft over time.", 1.9, draw, data, "speed")


_POINTS = 900
_LOWEST = 0.5
"""Events per revolution below which the spectrum is that of the mean speed's own change."""
_MIN_ORDERS = 12.0


@mpl.rc_context(STYLE)
def ias_picture(context: ChannelContext) -> Picture | None:
    """Draw the spectrum of the angular speed of the newest block over that before the onset; None without any."""
    rows = context.run.ias.get(context.channel.name, ())
    shown = [(row, row.view.ias) for row in rows if row.view is not None and row.view.ias is not None]
    if not shown:
        return None
    row, latest = shown[-1]
    orders = {part: line / row.speed for part, line in row.lines.items()}
    end = latest.width * latest.highest.size
    last = min(end, max(_MIN_ORDERS, (ORDERS + 0.5) * max(orders.values(), default=0.0)))
    made, (axes,) = new_figure(3.1)
    data: dict[str, Any] = {}
    top, quiet = 0.0, np.inf
    for number, (one, found) in enumerate(shown):
        x, y = _curve(found, last)
        newest = number == len(shown) - 1
        axes.plot(
            x, y, color=BLUE if newest else GREY, linewidth=0.8, label=f"block {one.sequence:,}", zorder=2 + newest
        )
        data[f"block_{one.sequence}"] = {"order": x, "amplitude_rad_s": y}
        top = max(top, float(y.max(initial=0.0)))
        quiet = min(quiet, float(np.median(y)) if y.size else np.inf)
    named = [part for part in FAULTS if part in context.verdict.fault.split("|") and part in orders]
    for part in named:
        label = f"{LINE_NAMES[part]} {orders[part]:.3g}"
        dot_lines(axes, orders[part], last, FAULT_MARKS[part][0], label, 0.9)
    axes.set_xlim(0.0, last)
    if 0.0 < quiet < top:
        # Errors of the marks stand a thousand times above the lines of a bearing.
        axes.set_yscale("log")
        axes.set_ylim(0.1 * quiet, 8.0 * top)
    else:
        axes.set_ylim(0.0, 1.15 * top or 1.0)
    axes.set_xlabel("events per revolution of the shaft")
    axes.set_ylabel("angular speed (rad/s)")
    add_legend(axes, loc="upper right", ncols=4)
    label = f"Spectrum of the angular speed of block {row.sequence:,}, from the times between pulses."
    return Picture("Angular speed", to_svg(made, label, context.numbers), _caption(shown), data, "ias")


def _curve(found: RawSpectra, last: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    order = np.arange(found.amplitude.size, dtype=np.float64) * found.resolution
    there = (order >= _LOWEST) & (order <= last)
    return thin(order[there], np.asarray(found.amplitude[there], dtype=np.float64), _POINTS)


def _caption(shown: Sequence[tuple[SpectrumRow, RawSpectra]]) -> str:
    row, found = shown[-1]
    text = (
        f"From the times between the pulses of block {row.sequence:,}; lines are {figure(found.resolution, 2)} events "
        "per revolution apart. A part that is struck once a passage brakes the shaft in that rhythm."
    )
    return f"{text} Grey: block {shown[0][0].sequence:,}, before the onset." if len(shown) > 1 else text


_ORDER_POINTS = 1500
_SPEEDS = 400


@dataclass(frozen=True, eq=False)
class ChannelOrders:
    """What is drawn of one channel.

    Attributes:
        one: what one unit of the axis is in the unit of the amplitudes.
        unit: of the axis, such as "g".
        fundamentals: first line of each part, events per revolution.
    """

    name: str
    spectrum: OrderSpectrum
    rotation: Rotation
    one: float
    unit: str
    fundamentals: Mapping[str, float]


def orders_sheet(channels: Mapping[str, ChannelOrders], name: str, *, envelope: bool) -> Sheet:
    """Return the report of one block; ``name`` is that of the block."""
    drawn = list(channels.values())
    low, high = drawn[0].rotation.speed_range
    lead = (
        f"{figure(drawn[0].spectrum.revolutions, 4)} turns at {figure(drawn[0].spectrum.mean_speed, 4)} Hz, from "
        f"{figure(low, 4)} to {figure(high, 4)} Hz."
    )
    parts = [_spectrum(channel, envelope=envelope) for channel in drawn]
    return Sheet(f"Orders of the shaft: {name}", lead, [*parts, _speed(drawn[0].rotation)])


def _spectrum(channel: ChannelOrders, *, envelope: bool) -> Part:
    spectrum = channel.spectrum
    kept = places_kept(spectrum.order, spectrum.amplitude, _ORDER_POINTS)
    order, amplitude = spectrum.order[kept], spectrum.amplitude[kept] / channel.one
    what = "envelope" if envelope else "acceleration"

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        axes.plot(order, amplitude, color=GREY, lw=0.8)
        top = float(amplitude.max(initial=0.0)) or 1.0
        axes.set(xlabel="order of the shaft", ylabel=f"{what} ({channel.unit})", xlim=(0.0, order[-1]))
        axes.set_ylim(0.0, 1.12 * top)
        mark_parts(axes, channel.fundamentals, order[-1], 1.06 * top, ruled=False)
        legend_above(axes)

    caption = "Markers stand at the kinematic orders of each part; rolling elements slip, by up to 2 %."
    data: dict[str, Any] = {"order": order, "amplitude": amplitude}
    return Part(f"Channel {channel.name}", caption, f"{what} over orders", 3.0, draw, data, f"orders_{channel.name}")


def _speed(rotation: Rotation) -> Part:
    time = np.linspace(0.0, rotation.duration, _SPEEDS)
    speed = rotation.speed_at(time)

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        axes.plot(time, speed, color=INK, lw=1.0)
        axes.set(xlabel="time in the block (s)", ylabel="speed (Hz)", xlim=(0.0, rotation.duration))

    data = {"time_s": time, "speed_hz": speed}
    return Part("Speed of the shaft", "", "speed of the shaft over the block", 1.8, draw, data, "speed")
