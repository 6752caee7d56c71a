"""The angle of the shaft from numbered pulses: a spline through them, or least squares where there are many.

Up to four marks a turn, the knots are the pulses, with the slopes of a cubic spline. With more marks, the time over the
angle is a cubic spline with two knots a turn (at least 256, at most a third of the pulses) by least squares: jitter and
the errors of single marks average out, and motion that is faster than a turn is not followed.

Before the first and after the last pulse the speed changes as it does over the five knots beside, by at most half.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from monitor.health.rotation.banded import solved, spline_slopes
from monitor.health.rotation.rotation import Rotation
from monitor.health.rotation.train import PulseTrain

_DIRECT_MARKS = 4
_KNOTS_A_TURN, _MIN_KNOTS, _PULSES_A_KNOT = 2, 256, 3
_STEEPEST = 3.0
"""A cubic does not turn back where its slopes are at most three times the chords beside (Fritsch and Carlson, 1980)."""
_END = 5
"""Knots at an end that tell how the speed changes there."""
_LIMIT = 0.5
_RIDGE = 1e-9
_END_LEVERAGE = 2.5
"""Standard deviation of a cubic spline by least squares at its ends over that of all its knots."""
_FOURTH = np.sqrt(70.0)
"""Standard deviation of the fourth difference of white noise of one unit."""


def rotation_of(
    train: PulseTrain,
    duration: float,
    ratio: float = 1.0,
    error: NDArray[np.float64] | None = None,
    source: str = "tacho",
) -> Rotation:
    """Return the angle of a shaft over a block.

    Args:
        train: pulses with the numbers of their marks.
        duration: of the block, s.
        ratio: turns of the shaft per turn of the one with the marks.
        error: shape (per_revolution,), how far each mark stands ahead of its place, revolutions.
        source: one of ``monitor.health.condition.SOURCES``.

    Raises:
        ValueError: the pulses do not give an angle that rises.
    """
    numbers = train.numbers - train.numbers[0] + 0.0
    if error is not None:
        numbers += error[train.numbers % train.per_revolution] * train.per_revolution
    pulses_a_turn = train.times.size / max(train.turned, 1e-9)
    if pulses_a_turn <= _DIRECT_MARKS or train.times.size < _PULSES_A_KNOT * _END:
        time, marks, speed = train.times, numbers, spline_slopes(train.times, numbers)
        sd = _jitter_of(train)
        fitted_sd = end_sd = sd
    else:
        knots = max(_MIN_KNOTS, round(_KNOTS_A_TURN * train.turned))
        time, marks, speed, sd = _least_squares(train.times, numbers, min(knots, train.times.size // _PULSES_A_KNOT))
        fitted_sd = sd * np.sqrt(min(1.0, time.size / train.times.size))
        end_sd = _END_LEVERAGE * fitted_sd
    turns = marks * (ratio / train.per_revolution)
    speed = limited(time, turns, speed * (ratio / train.per_revolution))
    end_sd = _end_sd(time, turns, duration, end_sd)
    time, turns, speed = _to_the_ends(time, turns, speed, duration)
    mean = (turns[-1] - turns[0]) / (time[-1] - time[0])
    return Rotation(
        time,
        turns,
        speed,
        duration,
        source,
        turns_sd=float(fitted_sd * mean),
        speed_sd=float(end_sd / (turns[-1] - turns[0])),
    )


def _jitter_of(train: PulseTrain) -> float:
    """Return the standard deviation of the times of pulses about a smooth motion, s, from their fourth differences."""
    even = np.ones(train.times.size - 4, dtype=bool)
    step = np.diff(train.numbers)
    for shift in range(4):
        even &= step[shift : step.size - 3 + shift] == 1
    if not np.any(even):
        return 0.0
    return float(np.sqrt(np.mean(np.square(np.diff(train.times, 4)[even])))) / float(_FOURTH)


def _least_squares(
    times: NDArray[np.float64], numbers: NDArray[np.float64], pieces: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], float]:
    """Fit the time over the numbers of the marks by a cubic spline with equal pieces.

    Returns:
        Times of the knots, s, their numbers, the marks per second there, shape (pieces + 1,) each, and the standard
        deviation of the times about the fit, s.
    """
    width = (numbers[-1] - numbers[0]) / pieces
    place = (numbers - numbers[0]) / width
    piece = np.minimum(place.astype(np.intp), pieces - 1)
    u = place - piece
    v = 1.0 - u
    basis = (v**3 / 6.0, (4.0 - 6.0 * u * u + 3.0 * u**3) / 6.0, (4.0 - 6.0 * v * v + 3.0 * v**3) / 6.0, u**3 / 6.0)
    # Of the straight line through both ends only the rest is fitted, so that the digits of the times are kept.
    slope = (times[-1] - times[0]) / (numbers[-1] - numbers[0])
    rest = times - times[0] - slope * (numbers - numbers[0])
    size = pieces + 3
    matrix, right = np.zeros((4, size)), np.zeros(size)
    for i in range(4):
        right[i : i + pieces] += np.bincount(piece, basis[i] * rest, pieces)
        for j in range(i, 4):
            matrix[3 - (j - i), j : j + pieces] += np.bincount(piece, basis[i] * basis[j], pieces)
    _add_ridge(matrix, _RIDGE * times.size / size)
    c = solved(matrix, right)
    fitted = np.sum([c[piece + i] * basis[i] for i in range(4)], axis=0)
    sd = float(np.sqrt(np.sum(np.square(rest - fitted)) / max(times.size - size, 1)))
    marks = width * np.arange(pieces + 1)
    at = (c[:-2] + 4.0 * c[1:-1] + c[2:]) / 6.0 + times[0] + slope * marks
    return at, marks + numbers[0], 1.0 / (slope + (c[2:] - c[:-2]) / (2.0 * width)), sd


def _add_ridge(matrix: NDArray[np.float64], weight: float) -> None:
    """Add a small penalty on second differences, for pieces without a pulse; ``matrix`` is banded, upper."""
    size = matrix.shape[1]
    for i, j, value in ((0, 0, 1.0), (1, 1, 4.0), (2, 2, 1.0), (0, 1, -2.0), (1, 2, -2.0), (0, 2, 1.0)):
        matrix[3 - (j - i), j : size - 2 + j] += weight * value


def limited(time: NDArray[np.float64], turns: NDArray[np.float64], speed: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return speeds with which the angle rises everywhere."""
    chord = np.diff(turns) / np.diff(time)
    least = np.minimum(np.append(chord, np.inf), np.insert(chord, 0, np.inf))
    return np.clip(speed, (1.0 - _LIMIT) * least, _STEEPEST * least)


def _to_the_ends(
    time: NDArray[np.float64], turns: NDArray[np.float64], speed: NDArray[np.float64], duration: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Extend knots to the beginning and the end of the block."""
    for end, place in ((0.0, 0), (duration, -1)):
        ahead = end - time[place]
        if ahead * (-1.0 if place == 0 else 1.0) <= 1e-9 * duration:
            continue
        near = slice(None, _END) if place == 0 else slice(-_END, None)
        now, change = _of_parabola(time[near] - time[place], turns[near] - turns[place])
        at_end = float(np.clip(now + change * ahead, (1.0 - _LIMIT) * speed[place], (1.0 + _LIMIT) * speed[place]))
        beyond = turns[place] + 0.5 * (speed[place] + at_end) * ahead
        position = 0 if place == 0 else time.size
        time, turns = np.insert(time, position, end), np.insert(turns, position, beyond)
        speed = np.insert(speed, position, at_end)
    return time, turns, speed


def _of_parabola(time: NDArray[np.float64], turns: NDArray[np.float64]) -> tuple[float, float]:
    """Return speed and acceleration at time 0 of the parabola that fits best."""
    span = float(np.ptp(time))
    x = time / span
    design = np.stack((np.ones_like(x), x, x * x), axis=1)
    _, slope, curve = np.linalg.lstsq(design, turns, rcond=None)[0]
    return float(slope) / span, 2.0 * float(curve) / span**2


def _end_sd(time: NDArray[np.float64], turns: NDArray[np.float64], duration: float, sd: float) -> float:
    """Return the standard deviation of the revolutions of the block, of both ends together, revolutions."""
    speed = np.gradient(turns, time)
    total = 0.0
    for ahead, place in ((time[0], 0), (duration - time[-1], -1)):
        step = float(time[place + 1 if place == 0 else place] - time[place if place == 0 else place - 1])
        u = max(ahead / step, 0.0)
        # The error of a parabola through five points with noise, one step and more beyond the last.
        noise = sd * np.sqrt(1.0 + 1.7 * u + 1.2 * u * u) * speed[place]
        total += float(noise) ** 2
    return float(np.sqrt(total))
