"""The rotation of a shaft whose speed changes: its phase over time, and the profiles that machines have.

The phase is a cubic between knots, continuous with its slope. A ramp and a table of speeds are that exactly; of hunting
and coasting down, knots are so close that the phase keeps within PHASE_ERROR of the formula.

When a shaft had turned so far, where its phase is a cubic between knots, continuous with its slope.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.words.checks import check_positive

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from numpy.typing import ArrayLike, NDArray

    Phase = Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]]


Floats = NDArray[np.float64]
_NEWTON_STEPS = 40


def time_of_turns(
    wanted: ArrayLike,
    knots: tuple[Floats, Floats, Floats],
    evaluate: Callable[[Floats], tuple[Floats, Floats]],
    *,
    duration: float,
    settled: float,
) -> Floats:
    """Return the times of some revolutions, s, by Newton's method within a piece; the shape is that of the revolutions.

    Args:
        wanted: revolutions, any shape.
        knots: time (s), revolutions and speed (Hz), each (knot,); beyond them the speed stays.
        evaluate: revolutions and speed at some times.
        duration: s.
        settled: it ends where no time moves by more than this share of the duration, or of the latest time.
    """
    turns = np.asarray(wanted, dtype=np.float64)
    time, phase, speed = knots
    found = np.interp(turns, phase, time)
    found = np.where(turns < phase[0], time[0] + (turns - phase[0]) / speed[0], found)
    found = np.where(turns > phase[-1], time[-1] + (turns - phase[-1]) / speed[-1], found)
    piece = np.searchsorted(phase, turns, side="right")
    low, high = np.concatenate(([-np.inf], time))[piece], np.concatenate((time, [np.inf]))[piece]
    for _ in range(_NEWTON_STEPS):
        at, slope = evaluate(found)
        following = np.clip(found - (at - turns) / slope, low, high)
        moved = np.max(np.abs(following - found), initial=0.0)
        found = following
        if moved <= settled * max(duration, float(np.max(np.abs(found), initial=0.0))):
            break
    return found


PHASE_ERROR = 1e-8
"""Of a cubic between knots against the formula of a profile, revolutions."""
_LEAST_KNOTS, _MOST_KNOTS = 16, 1_000_000
_SETTLED = 1e-15
# Waves that make a random wander, and their frequencies over that of the hunting.
_WANDER_WAVES = 12
_WANDER_RANGE = (0.1, 3.0)


@dataclass(frozen=True)
class SpeedProfile:
    """The phase of a shaft that never stops. Before the first knot and after the last the speed is that of the knot.

    Attributes:
        time: of the knots, s, rising from 0; at least two.
        turns: phase there, revolutions, rising from 0.
        speed: slope of the phase there, Hz, positive.
    """

    time: tuple[float, ...]
    turns: tuple[float, ...]
    speed: tuple[float, ...]

    def __post_init__(self) -> None:
        """Raise a ValueError where the knots do not fit together, or the shaft would stop or turn back."""
        if not len(self.time) == len(self.turns) == len(self.speed) >= 2:
            sizes = f"{len(self.time)}, {len(self.turns)} and {len(self.speed)}"
            raise ValueError(f"speed_profile: time, turns and speed must be as many, from 2 on, got {sizes}")
        if self.time[0] != 0.0 or self.turns[0] != 0.0:
            raise ValueError(f"speed_profile must begin at 0 s and 0 turns, got {self.time[0]!r} s, {self.turns[0]!r}")
        time, turns, speed = self._arrays
        if not all(bool(np.all(np.isfinite(values))) for values in self._arrays):
            raise ValueError("speed_profile: time, turns and speed must be finite")
        if not (np.all(np.diff(time) > 0.0) and np.all(np.diff(turns) > 0.0)):
            raise ValueError("speed_profile: time and turns must rise")
        if not self.speed_range[0] > 0.0:
            raise ValueError(f"speed_profile: the shaft stops or turns back, its least speed is {min(speed)!r} Hz")

    @cached_property
    def _arrays(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        return np.array(self.time), np.array(self.turns), np.array(self.speed)

    @cached_property
    def pieces(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Beginning of each cubic, s, (K,), and its coefficients by time from there, lowest first, turns/s^k, (K, 4).

        The first holds before the first knot too, at the speed there; the last one begins at the last knot.
        """
        time, turns, speed = self._arrays
        step, rise = np.diff(time), np.diff(turns)
        bent = np.zeros((len(time) + 1, 4))
        bent[1:, 0], bent[1:, 1] = turns, speed
        bent[0, 1] = speed[0]
        bent[1:-1, 2] = (3.0 * rise / step - 2.0 * speed[:-1] - speed[1:]) / step
        bent[1:-1, 3] = (speed[:-1] + speed[1:] - 2.0 * rise / step) / (step * step)
        return np.concatenate(([0.0], time)), bent

    def _at(self, time: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return time from the beginning of a piece, and its coefficients, (..., 4)."""
        wanted = np.asarray(time, dtype=np.float64)
        begin, cubics = self.pieces
        place = np.searchsorted(begin[1:], wanted, side="right")
        return wanted - begin[place], cubics[place]

    def _evaluate(self, time: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return revolutions and speed at some times."""
        s, c = self._at(time)
        turns = c[..., 0] + s * (c[..., 1] + s * (c[..., 2] + s * c[..., 3]))
        return turns, c[..., 1] + s * (2.0 * c[..., 2] + 3.0 * s * c[..., 3])

    def turns_at(self, time: ArrayLike) -> NDArray[np.float64]:
        """Return the revolutions since time zero at some times, s; the shape is that of the times."""
        return self._evaluate(time)[0]

    def speed_at(self, time: ArrayLike) -> NDArray[np.float64]:
        """Return the speed at some times, Hz."""
        return self._evaluate(time)[1]

    def acceleration_at(self, time: ArrayLike) -> NDArray[np.float64]:
        """Return the change of the speed at some times, Hz/s; at a knot that of what follows."""
        s, c = self._at(time)
        return 2.0 * c[..., 2] + 6.0 * s * c[..., 3]

    def time_at(self, turns: ArrayLike) -> NDArray[np.float64]:
        """Return when the shaft has turned so many revolutions, s: to rounding, by Newton's method within a piece."""
        return time_of_turns(turns, self._arrays, self._evaluate, duration=self.duration, settled=_SETTLED)

    @property
    def duration(self) -> float:
        """Time from the first to the last knot, s."""
        return self.time[-1]

    @property
    def mean_speed(self) -> float:
        """Revolutions over the duration, Hz."""
        return self.turns[-1] / self.time[-1]

    @cached_property
    def speed_range(self) -> tuple[float, float]:
        """Least and highest speed, Hz: at knots, or where a parabola between them turns."""
        begin, c = self.pieces
        _, _, speed = self._arrays
        with np.errstate(divide="ignore", invalid="ignore"):
            at = -c[1:-1, 2] / (3.0 * c[1:-1, 3])
        inside = (at > 0.0) & (at < np.diff(begin[1:]))
        at = np.where(inside, at, 0.0)
        turning = c[1:-1, 1] + at * (2.0 * c[1:-1, 2] + 3.0 * at * c[1:-1, 3])
        speeds = np.concatenate((speed, turning))
        return float(speeds.min()), float(speeds.max())

    def delayed(self, seconds: float) -> SpeedProfile:
        """Return the profile that begins so much later, after a time at its first speed; 0 is the same profile."""
        if seconds == 0.0:
            return self
        check_positive(seconds=seconds)
        before = self.speed[0] * seconds
        return SpeedProfile(
            (0.0, *(t + seconds for t in self.time)),
            (0.0, *(n + before for n in self.turns)),
            (self.speed[0], *self.speed),
        )

    def part(self, begin: float, seconds: float) -> SpeedProfile:
        """Return so many seconds of the profile from a time on, s; its time and turns count from there."""
        check_positive(seconds=seconds)
        inside = [t for t in self.time if begin < t < begin + seconds]
        time = np.array([begin, *inside, begin + seconds])
        turns = self.turns_at(time)
        return _of_arrays(time - begin, turns - turns[0], self.speed_at(time))


def _of_arrays(time: NDArray[np.float64], turns: NDArray[np.float64], speed: NDArray[np.float64]) -> SpeedProfile:
    return SpeedProfile(tuple(time.tolist()), tuple(turns.tolist()), tuple(speed.tolist()))


def constant(speed: float, seconds: float) -> SpeedProfile:
    """Return the rotation at one speed, Hz."""
    return ramp(speed, speed, seconds)


def ramp(begin: float, end: float, seconds: float) -> SpeedProfile:
    """Return a speed that changes evenly from one to another, Hz, up or down."""
    check_positive(begin=begin, end=end, seconds=seconds)
    return SpeedProfile((0.0, seconds), (0.0, 0.5 * (begin + end) * seconds), (begin, end))


def table(times: Iterable[float], speeds: Iterable[float]) -> SpeedProfile:
    """Return the profile that changes evenly between speeds at some times, s and Hz; the first time becomes 0.

    Raises:
        ValueError: if there are fewer than two, times do not rise, or a speed is not positive.
    """
    time, speed = np.array(list(times), dtype=np.float64), np.array(list(speeds), dtype=np.float64)
    if time.shape != speed.shape or time.size < 2:
        raise ValueError(f"a table of speeds needs as many times as speeds, 2 at least, got {time.size}, {speed.size}")
    if not (np.all(np.isfinite(time)) and np.all(np.isfinite(speed)) and np.all(speed > 0.0)):
        raise ValueError("a table of speeds needs finite times, and speeds that are positive and finite")
    if not np.all(np.diff(time) > 0.0):
        raise ValueError("the times of a table of speeds must rise")
    turns = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time))))
    return _of_arrays(time - time[0], turns, speed)


def coast_down(begin: float, end: float, seconds: float) -> SpeedProfile:
    """Return a speed that dies away exponentially from one to a lower one, Hz: the torque is in proportion to it."""
    check_positive(begin=begin, end=end, seconds=seconds)
    if not end < begin:
        raise ValueError(f"coasting down ends below its beginning of {begin!r} Hz, got {end!r} Hz")
    rate = math.log(begin / end) / seconds

    def phase(t: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return -begin / rate * np.expm1(-rate * t), begin * np.exp(-rate * t)

    return _sampled(phase, begin * rate**3, seconds)


def hunt(
    mean: float,
    share: float,
    frequency: float,
    seconds: float,
    *,
    phase: float = 0.0,
    wander: float = 0.0,
    seed: int = 0,
) -> SpeedProfile:
    """Return a speed that swings about its mean: mean * (1 + share * sin(2 pi frequency t + phase) + random wander).

    Args:
        mean: Hz.
        share: amplitude over the mean.
        frequency: of the hunting, Hz.
        phase: of it at time zero, rad.
        wander: standard deviation over the mean of a sum of waves with random phases, a tenth to three times as fast.
        seed: of the wander.
    """
    check_positive(mean=mean, frequency=frequency, seconds=seconds)
    for name, value in (("share", share), ("wander", wander)):
        if not (math.isfinite(value) and 0.0 <= value < 1.0):
            raise ValueError(f"{name} of a hunting speed must lie between 0 and 1, got {value!r}")
    rng = np.random.default_rng([seed, 7])
    low, high = _WANDER_RANGE
    waves = [(share, 2.0 * math.pi * frequency, phase)]
    if wander > 0.0:
        rates = 2.0 * math.pi * frequency * low * (high / low) ** rng.uniform(0.0, 1.0, _WANDER_WAVES)
        size = wander * math.sqrt(2.0 / _WANDER_WAVES)
        waves += [(size, float(rate), float(rng.uniform(0.0, 2.0 * math.pi))) for rate in rates]
    amplitude, rate, start = (np.array(column)[:, None] for column in zip(*waves, strict=True))

    def swing(t: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        angle = rate * t + start
        turns = mean * (t - np.sum(amplitude / rate * (np.cos(angle) - np.cos(start)), axis=0))
        return turns, mean * (1.0 + np.sum(amplitude * np.sin(angle), axis=0))

    return _sampled(swing, mean * float(np.sum(amplitude * rate**3)), seconds)


def _sampled(
    phase: Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]],
    fourth: float,
    seconds: float,
) -> SpeedProfile:
    """Return the knots of a formula of turns and speed; ``fourth``: bound of the fourth derivative of the turns.

    A cubic between knots h apart is off by h^4 / 384 of that.
    """
    step = (384.0 * PHASE_ERROR / fourth) ** 0.25 if fourth > 0.0 else math.inf
    count = max(_LEAST_KNOTS, math.ceil(seconds / step))
    if count > _MOST_KNOTS:
        raise ValueError(f"a speed that changes this fast takes {count} knots, at most {_MOST_KNOTS} are taken")
    time = np.linspace(0.0, seconds, count + 1)
    turns, speed = phase(time)
    if not speed.min() > 0.0:
        raise ValueError(f"speed_profile: the shaft stops or turns back, its least speed is {float(speed.min())!r} Hz")
    turns[0] = 0.0
    return _of_arrays(time, turns, speed)
