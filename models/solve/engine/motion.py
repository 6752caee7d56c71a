"""A motion over time as a model gives it: accelerations from the beginning, with steps of any length.

Its first sensor is the one whose errors are stated. Beside it: how a recorder samples a signal that was simulated with
whole numbers of steps a sample; what turns (the beginning of a profile of the speed, lines over the angle, passages);
and where the points of a shaft move, of which an orbit is drawn.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np

from models.machine.bearing import kinematics
from models.solve.response import HARMONICS, PASSBAND, row_of
from models.words.numerics import filter_valid, kaiser_order
from models.words.request import Sensor

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.scene import Scene
    from models.machine.speed_profile import SpeedProfile
    from models.solve.response import SignalRecord
    from models.words.request import Request


_STOPBAND_DB = 80.0


def anti_alias_filter(oversampling: int) -> NDArray[np.float64]:
    """Return the taps (an odd number) of the filter before every ``oversampling``-th sample is kept."""
    width = (1.0 - PASSBAND) / oversampling
    count, beta = kaiser_order(_STOPBAND_DB, width)
    half = count // 2 + 1
    cutoff = 0.5 * (1.0 + PASSBAND) / oversampling
    taps = cutoff * np.sinc(cutoff * np.arange(-half, half + 1)) * np.kaiser(2 * half + 1, beta)
    return taps / taps.sum()


def margin_of(oversampling: int) -> int:
    """Return half the filter's length, samples."""
    return math.ceil(len(anti_alias_filter(oversampling)) // 2 / oversampling)


def sampled_at(signal: NDArray[np.float64], oversampling: int, first: int, samples: int) -> NDArray[np.float64]:
    """Return a signal as a recorder samples it, from sample ``first`` on."""
    taps = anti_alias_filter(oversampling)
    half, begin = len(taps) // 2, first * oversampling
    return filter_valid(signal[begin - half : begin + (samples - 1) * oversampling + half + 1], taps)[::oversampling]


# A smaller vibration counts as zero, m/s2.
SILENCE = 1e-9
# Error of the RMS over the RMS of the change of the waveform by halving the steps, where no single period is solved:
# what steps leave is mostly noise.
ERROR_OF_WAVE = 0.125

FromRest = Callable[[int, int], tuple["NDArray[np.float64]", bool]]


@dataclass(frozen=True, eq=False)
class Motion:
    """One scene over one time, with steps of any length that a sample has a whole number of.

    Attributes:
        from_rest: returns, for a number of steps and the steps a sample, the accelerations at the beginning of each
            step from t = 0 on, (steps, sensors), and whether they are finite.
        sensors: of the columns of what it returns.
        model, solver: what answers.
        bpfo: ball-pass frequency over the outer race, Hz.
        block: duration of a block, s: the slowest of the periods with which the level swings.
        settle: time that is simulated before and dropped, s.
        repeats: whether nothing but the passages of the balls drives the motion.
        passages: rate at which balls pass the defect, Hz, whose lines a request may ask for; None is BPFO.
        build_up: time from the beginning, s, before which the error of the steps is not looked at: modes that ring
            have not gathered theirs yet.
        profile: how the shaft turns from the first sample of the response on, where its speed changes.
        per_turn: balls that pass the outer race in a turn, where the speed changes; None where it is one.
        speed: of the shaft, Hz, where it is one and the model says how the shaft turns.
    """

    from_rest: FromRest
    sensors: tuple[Sensor, ...]
    model: str
    solver: str
    bpfo: float
    block: float
    settle: float
    repeats: bool
    passages: float | None = None
    build_up: float = 0.0
    profile: SpeedProfile | None = None
    per_turn: float | None = None
    speed: float | None = None

    def led_by(self, sensor: Sensor | None) -> Motion:
        """Return the motion with a sensor as the first, None for the first as it is."""
        if sensor is None or sensor == self.sensors[0]:
            return self
        row = row_of(self.sensors, sensor)
        order = [row, *(k for k in range(len(self.sensors)) if k != row)]

        def from_rest(steps: int, oversampling: int) -> tuple[NDArray[np.float64], bool]:
            wave, finite = self.from_rest(steps, oversampling)
            return np.ascontiguousarray(wave[:, order]), finite

        return replace(self, from_rest=from_rest, sensors=tuple(self.sensors[k] for k in order))


T = TypeVar("T")


class Planned(Generic[T]):
    """What runs from rest need beforehand: made for the longest of them so far, anew where a longer one comes."""

    def __init__(self, make: Callable[[float], T], least: float) -> None:
        """Keep what makes it for a time, s, and the time that it is made for at least."""
        self._make, self._until = make, least
        self._made: T | None = None

    def until(self, seconds: float) -> T:
        """Return it for a run of some seconds."""
        if self._made is None or seconds > self._until:
            self._until = max(seconds, self._until)
            self._made = self._make(self._until)
        return self._made


# What the filter of a recorder may reach beyond the margin of the fewest steps a sample, samples.
_MORE = 2


def lead_in(settle: float, rate: float) -> float:
    """Return the time before the first sample of a response, s, a whole number of samples: at least that to settle."""
    return max(margin_of(2) + _MORE, math.ceil(settle * rate)) / rate


def lines_over_angle(record: SignalRecord, profile: SpeedProfile, per_turn: float) -> NDArray[np.complex128]:
    """Return the Fourier coefficients 0..HARMONICS at multiples of some events a turn, through a Hann window.

    The Fourier integral is over the angle; as ``SignalRecord.coefficients`` else. Shape (sensors, HARMONICS + 1).
    """
    time: NDArray[np.float64] = np.arange(record.signal.shape[1], dtype=np.float64) / record.rate
    turns = profile.turns_at(time)
    share = (turns - turns[0]) / max(turns[-1] - turns[0], 1e-300)
    weight = np.sin(math.pi * share) ** 2 * profile.speed_at(time)
    weight = weight / max(float(weight.sum()), 1e-300)
    # The angle is reduced to one event before it is multiplied, so that long signals lose no digits.
    angle = np.mod(turns * per_turn, 1.0)
    waves = np.exp(-2j * np.pi * np.outer(np.arange(HARMONICS + 1), angle))
    return (record.signal * weight) @ waves.T


def passage_rate(scene: Scene) -> float:
    """Return the rate at which balls pass the first defect of a scene, Hz; BPFO where it has none."""
    bearing = scene.bearing
    if scene.defect is not None and scene.defect.support == "b" and scene.second_bearing is not None:
        bearing = scene.second_bearing
    lines = kinematics(bearing, scene.speed)
    return {"outer": lines.bpfo, "inner": lines.bpfi, "ball": 2.0 * lines.bsf}[scene.first_part]


MOST_TURNS = 20
"""Turns of the shaft that are kept at most: more hide each other in a picture."""
# Samples that are kept of a turn; steps are much shorter.
_SAMPLES_A_TURN = 2000


@dataclass(frozen=True, eq=False)
class Trajectories:
    """Displacements of points of a shaft, after the beginning from rest was dropped.

    Attributes:
        step: time between samples, s.
        place: from the centre of the outer rings, m, shape (points, 2, samples): along the load and across it.
        points: of the rows of ``place``, named as the sensors there.
        clearance: free way of each point until its ring meets the balls, m; NaN where it is in no bearing.
        error: largest change of a travel (largest less smallest place) when steps are halved, over the largest travel.
    """

    step: float
    place: NDArray[np.float64]
    points: tuple[Sensor, ...]
    clearance: tuple[float, ...]
    error: float

    def travel(self) -> NDArray[np.float64]:
        """Return how far each point moves along the load and across it, m, (points, 2)."""
        return np.ptp(self.place, axis=2)


Walk = Callable[[float, float], "NDArray[np.float64] | None"]
"""Return the places (points, 2, steps) from rest for a duration and a step, s, or None if the motion diverged."""


def settled(
    walk: Walk,
    scene: Scene,
    request: Request,
    *,
    step: float,
    settle: float,
    points: tuple[Sensor, ...],
    clearance: tuple[float, ...],
) -> Trajectories | None:
    """Return the trajectories of the last turns of a motion from rest, None if it diverged.

    ``step`` and half of it are tried; the finer one is kept. ``settle``: time to drop at the beginning, s.
    """
    duration = min(request.duration or math.inf, MOST_TURNS / scene.speed)
    kept: list[NDArray[np.float64]] = []
    for each in (step, 0.5 * step):
        place = walk(settle + duration, each)
        if place is None:
            return None
        kept.append(place[:, :, round(settle / each) :])
    travels = [np.ptp(place, axis=2) for place in kept]
    largest = float(np.max(travels[1]))
    error = float(np.max(np.abs(travels[1] - travels[0]))) / largest if largest > 0.0 else 0.0
    every = max(1, int(1.0 / (scene.speed * _SAMPLES_A_TURN * 0.5 * step)))
    return Trajectories(0.5 * step * every, kept[1][:, :, ::every], points, clearance, error)
