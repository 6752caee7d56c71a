"""Pulses of the marks on a shaft, as a tacho or an encoder gives them, with the faults that those have."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from models.words.checks import check_numbers, check_whole
from models.words.numerics import spline

TimeAt = Callable[[NDArray[np.float64]], NDArray[np.float64]]

# A front rises over so many samples, which a straight line between samples then meets halfway; a pulse and the pause
# after it last a whole number of fronts at least.
_FRONT_SAMPLES = 2.0
_LEAST_FRONTS = 2.0
_PULSE_SHARE = 0.4
LEVEL_VOLT = 5.0
"""Height of the pulses of a channel, V."""


@dataclass(frozen=True)
class ShaftMarks:
    """Marks around a shaft, and how well they are read.

    Attributes:
        per_turn: of a whole turn.
        error: rms of the angle by which marks stand off their places, rad; the same in every turn. Half of its power is
            an eccentricity, a wave once around, the rest is drawn for each mark.
        jitter: standard deviation of the time of a pulse, s, drawn for each.
        missing: share of the pulses that are lost.
        extra: pulses that are none, at random times, over those of the marks.
        seed: of all that is drawn, and of the angle of the first mark at time zero.
    """

    per_turn: int
    error: float = 0.0
    jitter: float = 0.0
    missing: float = 0.0
    extra: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        check_whole(self.per_turn, "marks.per_turn", 1)
        check_whole(self.seed, "marks.seed", 0)
        check_numbers(self, "marks.", "not negative", "error", "jitter", "missing", "extra")
        if not self.missing < 1.0:
            raise ValueError(f"marks.missing is a share, from 0 to below 1, got {self.missing!r}")

    @cached_property
    def marks(self) -> NDArray[np.float64]:
        """Angles of the marks from the first one's place, turns, (per_turn,)."""
        rng = np.random.default_rng([self.seed, 1])
        even: NDArray[np.float64] = np.arange(self.per_turn, dtype=np.float64) / self.per_turn
        wave = math.sqrt(2.0) * np.sin(2.0 * math.pi * (even + rng.uniform()))
        off: NDArray[np.float64] = math.sqrt(0.5) * (wave + rng.standard_normal(self.per_turn))
        off = off - off.mean()
        level = math.sqrt(float(np.mean(np.square(off))))
        return even + (off * (self.error / (2.0 * math.pi * level)) if level > 0.0 else 0.0)

    def pulses(self, time_at: TimeAt, turned: float, end: float, run: int = 0) -> NDArray[np.float64]:
        """Return the times of the pulses from 0 to before ``end``, s, ascending.

        Args:
            time_at: returns when the shaft has turned so far, s, from its turns since time zero.
            turned: revolutions from time zero to the end.
            end: s.
            run: of which jitter, missing and further pulses depend: 0, 1, ...
        """
        first = float(np.random.default_rng([self.seed, 2]).uniform())
        rng = np.random.default_rng([self.seed, 3, run])
        # By two turns beyond both ends, which jitter and errors do not span.
        places = (np.arange(-2, math.ceil(turned) + 2)[:, None] + first + self.marks[None, :]).ravel()
        times = time_at(places)
        inside = np.sum((times >= 0.0) & (times < end))
        times = times + self.jitter * rng.standard_normal(times.size)
        kept = times[rng.uniform(size=times.size) >= self.missing]
        found = np.sort(np.concatenate((kept, rng.uniform(0.0, end, rng.poisson(self.extra * inside)))))
        return found[(found >= 0.0) & (found < end)]


def time_of_turns(turns: NDArray[np.float64], rate: float) -> TimeAt:
    """Return what gives the time, s, of revolutions, from those at samples (at ``rate``, Hz), by a cubic spline.

    Beyond the samples the speed is that of the first or the last of them.
    """
    inside = spline(turns, np.arange(turns.size, dtype=np.float64) / rate)
    end = (turns.size - 1) / rate
    ends = ((turns[1] - turns[0]) * rate, (turns[-1] - turns[-2]) * rate)

    def time_at(wanted: NDArray[np.float64]) -> NDArray[np.float64]:
        before, after = (wanted - turns[0]) / ends[0], end + (wanted - turns[-1]) / ends[1]
        return np.where(wanted < turns[0], before, np.where(wanted > turns[-1], after, inside(wanted)))

    return time_at


def as_channel(pulses: NDArray[np.float64], samples: int, rate: float, marks_hz: float) -> NDArray[np.float32]:
    """Return pulses as a recorder samples them, V, (samples,); rising fronts pass half of the level at their times.

    Args:
        pulses: times, s, ascending.
        samples: of the signal.
        rate: of them, Hz.
        marks_hz: highest rate of the marks, from which the length of the pulses follows.

    Raises:
        ValueError: if the marks pass too fast for the sampling rate.
    """
    front = _FRONT_SAMPLES / rate
    width = _PULSE_SHARE / marks_hz
    if width < _LEAST_FRONTS * front:
        most = _PULSE_SHARE * rate / (_LEAST_FRONTS * _FRONT_SAMPLES)
        raise ValueError(
            f"{marks_hz:g} marks a second are too fast for a channel of {rate:g} Hz, which shows {most:g} at most"
        )
    times = np.concatenate(([-math.inf, -math.inf], pulses))
    at = np.arange(samples) / rate
    latest = np.searchsorted(times, at + 0.5 * front, side="right") - 1
    signal = np.zeros(samples)
    for back in range(2):
        since = at - times[np.maximum(latest - back, 0)]
        rising, falling = np.clip(since / front + 0.5, 0.0, 1.0), np.clip((since - width) / front + 0.5, 0.0, 1.0)
        signal = np.maximum(signal, rising - falling)
    return (LEVEL_VOLT * signal).astype(np.float32)
