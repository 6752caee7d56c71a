"""Spectra over orders of the shaft, one figure a channel, with the speed of the block."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import FigureBase

from monitor.health.signal.orders import OrderSpectrum
from monitor.health.signal.rotation.rotation import Rotation
from monitor.report.figures.drawing import GREY, INK, legend_above, places_kept
from monitor.report.figures.sheet import Part, Sheet
from monitor.report.figures.spectrum import mark_parts
from monitor.words.numbers import figure

_POINTS = 1500
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
    kept = places_kept(spectrum.order, spectrum.amplitude, _POINTS)
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
