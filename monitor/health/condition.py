"""Speed and load of a block, and their source: the block itself, a channel of it, the signal, or a constant."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.bearing import Bearing
from monitor.health.spectrum.lines import SEARCH
from monitor.health.spectrum.speed import SpeedStatus, estimate_speed

_KNOWN = 0.003
"""Largest relative standard deviation of an estimate that rests on lines of the shaft."""
SOURCES = ("block", "channel", "estimate", "configured", "opcua")


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

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels that are not vibration."""
        return tuple(name for name in (self.speed_channel, self.load_channel) if name is not None)

    @property
    def varies(self) -> bool:
        """Whether more than constants is configured."""
        return bool(self.channels) or self.speed_limits is not None or self.speed_read


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
) -> Quantity:
    """Return the shaft speed: what the block states, else its channel, the estimate, or the constant.

    Args:
        stated: by the block, Hz, or None.
        rows: samples of the channels that are not vibration, each (sample,).
        samples: of the vibration channel, (sample,), or None where unusable.
        stated_source: where ``stated`` comes from, one of ``SOURCES``.
    """
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

    A speed channel is a measurement; an estimate is one where it rests on lines of the shaft.
    """
    if speed.value is None or speed.source in ("block", "configured", "opcua"):
        return 0.0 if settings.speed_exact else None
    sd = speed.sd or 0.0
    return None if speed.source == "estimate" and sd > _KNOWN * speed.value else sd


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
