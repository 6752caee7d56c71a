"""Speed and load of a block, and their source: the block itself, a channel of it, the signal, or a constant."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from models.machine.bearing import Bearing
from monitor.health.signal.lines import SEARCH
from monitor.health.signal.quality import SpeedLimits, check_speed
from monitor.health.signal.rotation.rotation import Rotation, TachoSettings
from monitor.health.signal.speed import SpeedStatus, estimate_speed

_KNOWN = 0.003
"""Largest relative standard deviation of an estimate that rests on lines of the shaft."""
# Append only: the integers of the published files are positions in this tuple.
SOURCES = ("block", "channel", "estimate", "configured", "opcua", "tacho", "profile", "phase")


@dataclass(frozen=True)
class ConditionSettings:
    """Configured operating condition, SI.

    Attributes:
        speed: constant shaft speed, Hz, or None.
        load: constant load, N, or None.
        speed_channel: channel whose mean is the speed.
        speed_scale: Hz per unit of that channel.
        load_channel: channel whose mean is the load.
        load_scale: N per unit of that channel.
        speed_limits: range of the estimate from the signal, Hz, or None: it is not estimated.
        speed_exact: whether a constant or stated speed is that of the shaft, and not a nominal one.
        speed_tolerance: relative error of a nominal speed that the signal does not show.
        speed_read: whether a control system gives the speed of a block; where it does not, it is unknown.
        tacho: marks on the shaft and the channel of their pulses.
        speed_over_time: whether the speed channel is a signal over time, from which the angle follows.
        phase: whether the angle is estimated from the vibration, within ``speed_limits``.
        phase_orders: orders of the shaft that the estimate follows; (): its own.
        domain: "auto": spectra over the angle where it is known; "hertz": over time.
        limits: of the speed; outside them a block moves neither baseline, detector nor tracker.
    """

    speed: float | None = None
    load: float | None = None
    speed_channel: str | None = None
    speed_scale: float = 1.0
    load_channel: str | None = None
    load_scale: float = 1.0
    speed_limits: tuple[float, float] | None = None
    speed_exact: bool = False
    speed_tolerance: float = SEARCH
    speed_read: bool = False
    tacho: TachoSettings = field(default_factory=TachoSettings)
    speed_over_time: bool = False
    phase: bool = False
    phase_orders: tuple[float, ...] = ()
    domain: Literal["auto", "hertz"] = "auto"
    limits: SpeedLimits = field(default_factory=SpeedLimits)

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels that are not vibration."""
        named = (self.speed_channel, self.load_channel, *self.tacho.channels)
        return tuple(name for name in named if name is not None)

    @property
    def varies(self) -> bool:
        """Whether more than constants is configured."""
        return bool(self.channels) or self.speed_limits is not None or self.speed_read or self.tacho.of_source


@dataclass(frozen=True)
class Quantity:
    """A speed or a load.

    Attributes:
        value: Hz or N, or None where unknown.
        source: one of ``SOURCES``, or None.
        sd: standard deviation of its error, or None.
    """

    value: float | None = None
    source: str | None = None
    sd: float | None = None


def speed_of(
    stated: float | None,
    rows: Mapping[str, NDArray[np.floating]],
    samples: NDArray[np.floating] | None,
    rate: float,
    bearing: Bearing,
    settings: ConditionSettings,
    stated_source: str = "block",
    rotation: Rotation | None = None,
) -> Quantity:
    """Return the shaft speed: that of the angle, else what the block states, its channel, the estimate, the constant.

    Args:
        rotation: the angle of the shaft over the block, where it is known.
        stated: by the block, Hz, or None.
        rows: samples of the channels that are not vibration, each (sample,).
        samples: of the vibration channel, (sample,), or None where unusable.
        stated_source: where ``stated`` comes from, one of ``SOURCES``.
    """
    if rotation is not None:
        return Quantity(rotation.mean_speed, rotation.source, rotation.speed_sd * rotation.mean_speed)
    if stated is not None:
        return Quantity(stated, stated_source)
    found = _mean(rows, settings.speed_channel, settings.speed_scale, least=0.0)
    if found is not None:
        return found
    if settings.speed_limits is not None and samples is not None:
        estimate = estimate_speed(samples, rate, bearing, settings.speed_limits)
        if estimate.status == SpeedStatus.OK:
            return Quantity(estimate.speed, "estimate", estimate.sd)
    return Quantity(settings.speed, "configured") if settings.speed is not None else Quantity()


def known_sd(speed: Quantity, settings: ConditionSettings) -> float | None:
    """Return the standard deviation of the error of a speed that is known, Hz, or None: it is nominal.

    A speed channel and the angle of the shaft are measurements; an estimate of the speed is one where it rests on
    lines of the shaft.
    """
    if speed.value is None or speed.source in ("block", "configured", "opcua"):
        return 0.0 if settings.speed_exact else None
    sd = speed.sd or 0.0
    return None if speed.source == "estimate" and sd > _KNOWN * speed.value else sd


def speed_flags(speed: Quantity, limits: SpeedLimits, rotation: Rotation | None = None) -> tuple[str, ...]:
    """Return the flag of a block beyond the limits of its speed, or nothing; ``rotation`` where its angle is known."""
    if rotation is not None:
        return check_speed(rotation.speed_range, rotation.steepest, limits)
    return check_speed(None if speed.value is None else (speed.value, speed.value), None, limits)


def load_of(
    stated: float | None,
    rows: Mapping[str, NDArray[np.floating]],
    settings: ConditionSettings,
    stated_source: str = "block",
) -> Quantity:
    """Return the load of a block as :func:`speed_of` does; it is never estimated."""
    if stated is not None:
        return Quantity(stated, stated_source)
    found = _mean(rows, settings.load_channel, settings.load_scale, least=-math.inf)
    if found is not None:
        return found
    return Quantity(settings.load, "configured") if settings.load is not None else Quantity()


def _mean(rows: Mapping[str, NDArray[np.floating]], channel: str | None, scale: float, least: float) -> Quantity | None:
    """Return the mean and the spread of a channel; None unless the mean is finite and above ``least``."""
    row = None if channel is None else rows.get(channel)
    if row is None or row.size == 0:
        return None
    values = row.astype(np.float64) * scale
    mean = float(values.mean())
    if not (math.isfinite(mean) and mean > least):
        return None
    return Quantity(mean, "channel", float(values.std()))
