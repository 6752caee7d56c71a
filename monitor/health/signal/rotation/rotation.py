"""The angle of a shaft over the time of a block, and its inverse."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.machine.speed_profile import time_of_turns

_SETTLED = 1e-13
"""Newton's method ends where no time moves by more than this share of the block: mostly after three steps."""
_PARTS = 32
"""Parts of a block whose mean speeds tell how steeply it changes: jitter of the pulses averages out in each."""


@dataclass(frozen=True, eq=False)
class Rotation:
    """The angle of the shaft over a block: a cubic between knots, continuous with its slope; the shaft never stops.

    Beyond the first and the last knot the speed is that of the knot.

    Attributes:
        time: shape (knot,), s from the first sample of the block, rising; at least two.
        turns: shape (knot,), revolutions of the shaft, rising; only differences count.
        speed: shape (knot,), Hz, the slope there.
        duration: of the block, s.
        source: what it was found from: one of ``monitor.health.signal.condition.SOURCES``.
        turns_sd: standard deviation of the error of the angle, revolutions, drift of the whole block left out.
        speed_sd: relative standard deviation of the error of the mean speed.
    """

    time: NDArray[np.float64]
    turns: NDArray[np.float64]
    speed: NDArray[np.float64]
    duration: float
    source: str = "tacho"
    turns_sd: float = 0.0
    speed_sd: float = 0.0

    def __post_init__(self) -> None:
        """Raise ValueError where the arrays do not fit together, or the shaft would stop or turn back."""
        if self.time.ndim != 1 or not self.time.shape == self.turns.shape == self.speed.shape or self.time.size < 2:
            shapes = f"{self.time.shape}, {self.turns.shape}, {self.speed.shape}"
            raise ValueError(f"time, turns and speed of a rotation must have one shape (knot,) from 2 on, got {shapes}")
        if not self.duration > 0.0:
            raise ValueError(f"duration must be positive, got {self.duration!r} s")
        if not (np.all(np.diff(self.time) > 0.0) and np.all(np.diff(self.turns) > 0.0) and np.all(self.speed > 0.0)):
            raise ValueError("time and turns of a rotation must rise, and its speeds be positive")
        if not self._least_of_pieces > 0.0:
            raise ValueError("the angle of a rotation turns back between two knots")

    @cached_property
    def _least_of_pieces(self) -> float:
        """Return the least speed between knots, Hz: that of a parabola in each piece."""
        step, chord = np.diff(self.time), np.diff(self.turns) / np.diff(self.time)
        begin, end = self.speed[:-1], self.speed[1:]
        curve, slope = begin + end - 2.0 * chord, 3.0 * chord - 2.0 * begin - end
        # With u from 0 to 1 along the piece: speed = begin + 2 slope u + 3 curve u^2.
        with np.errstate(divide="ignore", invalid="ignore"):
            at = np.clip(np.nan_to_num(-slope / (3.0 * curve), nan=0.0, posinf=0.0, neginf=0.0), 0.0, 1.0)
        lowest = begin + 2.0 * slope * at + 3.0 * curve * at * at
        return float(np.min(np.minimum(lowest, np.minimum(begin, end)), where=step > 0.0, initial=np.inf))

    def turns_at(self, time: ArrayLike) -> NDArray[np.float64]:
        """Return the revolutions at some times, s; the shape is that of the times."""
        return self._evaluate(np.asarray(time, dtype=np.float64))[0]

    def speed_at(self, time: ArrayLike) -> NDArray[np.float64]:
        """Return the speed at some times, Hz; the shape is that of the times."""
        return self._evaluate(np.asarray(time, dtype=np.float64))[1]

    def time_at(self, turns: ArrayLike) -> NDArray[np.float64]:
        """Return when the shaft had turned so many revolutions, s; the shape is that of the revolutions."""
        knots = self.time, self.turns, self.speed
        return time_of_turns(turns, knots, self._evaluate, duration=self.duration, settled=_SETTLED)

    def _evaluate(self, time: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return revolutions and speed at some times."""
        place = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, self.time.size - 2)
        step = self.time[place + 1] - self.time[place]
        inside = np.clip(time, self.time[0], self.time[-1])
        u = (inside - self.time[place]) / step
        rise = self.turns[place + 1] - self.turns[place]
        begin, end = self.speed[place] * step, self.speed[place + 1] * step
        curve, slope = begin + end - 2.0 * rise, 3.0 * rise - 2.0 * begin - end
        turns = self.turns[place] + u * (begin + u * (slope + u * curve))
        speed = (begin + u * (2.0 * slope + u * 3.0 * curve)) / step
        return turns + speed * (time - inside), speed

    @cached_property
    def turned(self) -> float:
        """Revolutions of the block."""
        begin, end = self.turns_at((0.0, self.duration))
        return float(end - begin)

    @property
    def mean_speed(self) -> float:
        """Revolutions of the block over its duration, Hz."""
        return self.turned / self.duration

    @cached_property
    def speed_range(self) -> tuple[float, float]:
        """Least and highest speed in the block, Hz, at its ends and the knots between them."""
        inside = self.time[(self.time > 0.0) & (self.time < self.duration)]
        speeds = self.speed_at(np.concatenate(([0.0], inside, [self.duration])))
        return float(speeds.min()), float(speeds.max())

    @cached_property
    def steepest(self) -> float:
        """Largest change of the speed within the block, Hz/s, either way: between the means of 32nds of the block."""
        part = self.duration / _PARTS
        speeds = np.diff(self.turns_at(np.linspace(0.0, self.duration, _PARTS + 1))) / part
        return float(np.max(np.abs(np.diff(speeds)))) / part

    @property
    def acceleration(self) -> float:
        """Change of the speed from the first to the last sample over the duration, Hz/s."""
        begin, end = self.speed_at((0.0, self.duration))
        return float(end - begin) / self.duration


def constant(speed: float, duration: float, source: str = "configured") -> Rotation:
    """Return the rotation at one speed, Hz."""
    time = np.array([0.0, duration])
    return Rotation(time, speed * time, np.full(2, speed), duration, source)


@dataclass(frozen=True)
class PulseCounts:
    """Repairs of the pulses of one block.

    Attributes:
        missing: pulses that were put in, those of teeth that are known to be missing not counted.
        extra: pulses that were left out.
        encoder_error: rms of the learned geometric error of the marks, rad of the shaft with the marks; None until
            it is learned.
    """

    missing: int = 0
    extra: int = 0
    encoder_error: float | None = None


@dataclass(frozen=True)
class TachoSettings:
    """Marks on a shaft, and the channel in which their pulses are recorded.

    Attributes:
        channel: of the pulses, None where they are not a channel.
        channel_b: second track of a quadrature encoder, for the direction, or None.
        per_revolution: marks of a whole turn, missing teeth included; a source that states its own takes precedence.
        missing_teeth: consecutive teeth that a wheel lacks once a turn (2 of a 60-2 wheel).
        ratio: turns of the shaft of the bearing per turn of the shaft with the marks.
        level: threshold in the unit of the channel, None: half way between its levels.
        edge: the edge of a pulse that counts.
        of_source: whether the source gives the times of the pulses.
    """

    channel: str | None = None
    channel_b: str | None = None
    per_revolution: int = 1
    missing_teeth: int = 0
    ratio: float = 1.0
    level: float | None = None
    edge: Literal["rising", "falling"] = "rising"
    of_source: bool = False

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels of pulses."""
        return tuple(name for name in (self.channel, self.channel_b) if name is not None)
