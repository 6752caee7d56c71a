"""The angle of the shaft from numbered pulses: a spline through them, or least squares where there are many.

Up to four marks a turn, the knots are the pulses, with the slopes of a cubic spline. With more marks, the time over the
angle is a cubic spline with two knots a turn (at least 256, at most a third of the pulses) by least squares: jitter and
the errors of single marks average out, and motion that is faster than a turn is not followed.

What comes again each turn, the eccentricity of a wheel or a shaft that swings with its own turns, is told apart by
neither: unless the errors of the marks are given, its size is part of the stated standard deviation.

The angle before the first pulse of a block and after its last, by a polynomial over time through pulses beside.

Its degree and the pulses that it takes are those that best tell pulses of the block from the ones before them, and from
the ones after; how well they do is the error that is stated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.rotation.intervals import PulseTrain, solved, spline_slopes
from monitor.health.signal.rotation.rotation import Rotation

_TRIED = ((1, 3), (2, 5), (2, 9), (3, 6))
"""Degree and pulses of the polynomials that are tried."""
_PLACES = 24
"""Places in the block at which they are tried, in both directions."""
_SLOWER = 2.0
"""Largest ratio, either way, of the speed at an end to the mean of the last two pulses."""


@dataclass(frozen=True)
class Predictor:
    """How the angle beyond pulses is told.

    Attributes:
        degree: of the polynomial over time.
        pulses: that it takes.
        sd: standard deviation of its error at the next pulse, in marks.
    """

    degree: int
    pulses: int
    sd: float


def best_predictor(times: NDArray[np.float64], marks: NDArray[np.float64]) -> Predictor:
    """Choose how the angle beyond pulses is told.

    Args:
        times: shape (pulse,), s, rising; at least three.
        marks: shape (pulse,), how many marks had passed, rising.
    """
    found: list[Predictor] = []
    for degree, pulses in _TRIED:
        if times.size <= pulses:
            continue
        first = np.unique(np.linspace(0, times.size - pulses - 1, _PLACES).astype(np.intp))
        forward = first[:, np.newaxis] + np.arange(pulses + 1)
        window = np.concatenate((forward, forward[:, ::-1]))
        told = _told(times[window[:, :-1]], marks[window[:, :-1]], times[window[:, -1]], degree)
        away = told - marks[window[:, -1]]
        found.append(Predictor(degree, pulses, float(np.sqrt(np.mean(np.square(away))))))
    if found:
        return min(found, key=lambda predictor: predictor.sd)
    return Predictor(1, 2, 0.5)


def _told(
    times: NDArray[np.float64], marks: NDArray[np.float64], at: NDArray[np.float64], degree: int
) -> NDArray[np.float64]:
    """Return the polynomials through windows of pulses, (window, pulse), at a time of each, (window,), in marks."""
    span = times[:, -1:] - times[:, :1]
    powers = np.arange(degree + 1.0)
    design: NDArray[np.float64] = np.power(((times - at[:, np.newaxis]) / span)[:, :, np.newaxis], powers)
    across = design.transpose(0, 2, 1)
    base = marks[:, :1]
    # The first coefficient is the value at the time itself.
    found = np.linalg.solve(across @ design, across @ (marks - base)[:, :, np.newaxis])
    return found[:, 0, 0] + base[:, 0]


def end_knot(
    times: NDArray[np.float64], marks: NDArray[np.float64], at: float, predictor: Predictor
) -> tuple[float, float]:
    """Return the marks that have passed at a time beyond pulses, and the marks per second there.

    Args:
        times: shape (pulse,), s; the last ones are the nearest to ``at``, before it or after.
        marks: shape (pulse,).
        at: s.
        predictor: how it is told.
    """
    time, mark = times[-predictor.pulses :] - at, marks[-predictor.pulses :] - marks[-1]
    unit = float(np.ptp(time))
    powers = np.arange(min(predictor.degree, time.size - 1) + 1.0)
    design: NDArray[np.float64] = np.power((time / unit)[:, np.newaxis], powers)
    found = np.asarray(np.linalg.solve(design.T @ design, design.T @ mark), dtype=np.float64)
    speed, last = float(found[1]) / unit, float((marks[-1] - marks[-2]) / (times[-1] - times[-2]))
    ahead = at - float(times[-1])
    mean = float(found[0]) / ahead
    if not (last / _SLOWER < speed < last * _SLOWER and last / _SLOWER < mean < last * _SLOWER):
        return float(marks[-1]) + last * ahead, last
    return float(marks[-1] + found[0]), speed


_DIRECT_MARKS = 4
_PIECES_A_TURN, _MIN_PIECES, _PULSES_A_PIECE, _MIN_PULSES = 2, 256, 3, 16
_AT_KNOT = np.array([1.0, 4.0, 1.0]) / 6.0
"""The three cubic B-splines that are not zero at a knot, there."""
_STEEPEST = 3.0
"""A cubic does not turn back where its slopes are at most three times the chords beside (Fritsch and Carlson, 1980)."""
_FLATTEST = 0.5
_NUMERIC = 3e-7
"""Error of a cubic of the angle over time for one of the time over the angle, revolutions."""
_RIDGE = 1e-9
Knots = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Times, s, marks that have passed, and marks per second, shape (knot,) each."""
_FOURTH = float(np.sqrt(70.0))
"""Standard deviation of the fourth difference of white noise of one unit."""


def rotation_of(
    train: PulseTrain,
    duration: float,
    ratio: float = 1.0,
    error: NDArray[np.float64] | None = None,
    slips: float = 0.0,
) -> Rotation:
    """Return the angle of a shaft over a block.

    Args:
        train: pulses with the numbers of their marks.
        duration: of the block, s.
        ratio: turns of the shaft per turn of the one with the marks.
        error: shape (per_revolution,), how far each mark stands ahead of its place, revolutions.
        slips: how often the count of the marks may be wrong by one.

    Raises:
        ValueError: the pulses do not give an angle that rises.
    """
    times, numbers = train.times, train.numbers - train.numbers[0] + 0.0
    if error is not None:
        numbers = numbers + error[train.numbers % train.per_revolution] * train.per_revolution
    pulses_a_turn = times.size / max(train.turned, 1e-9)
    if pulses_a_turn <= _DIRECT_MARKS or times.size < _MIN_PULSES:
        predictor = best_predictor(times, numbers)
        jitter = _jitter_of(train)
        sd = predictor.sd if jitter is None else jitter * (numbers[-1] - numbers[0]) / (times[-1] - times[0])
        again = 0.0
        ends_sd = tuple(
            _end_sd(near, away, sd, predictor)
            for near, away in ((times[:2], float(times[0])), (times[-2:], duration - float(times[-1])))
        )
        knots = _extended(times, numbers, spline_slopes(times, numbers), duration, predictor)
    else:
        pieces = min(max(_MIN_PIECES, round(_PIECES_A_TURN * train.turned)), times.size // _PULSES_A_PIECE)
        knots, sd, ends_sd = _least_squares(times, numbers, pieces, duration)
        again = 0.0 if error is not None else _each_turn(train)
    time, marks, speed = knots
    speed = limited(time, marks, speed)
    scale = ratio / train.per_revolution
    # Steps of one mark at any time: the angle wanders, without its drift by a sixth of their mean square at the end.
    slipped = np.sqrt(slips) * scale
    common = again * ratio, _NUMERIC * ratio
    end_sd = np.linalg.norm((*(scale * end for end in ends_sd), *common, again * ratio, slipped))
    return Rotation(
        time,
        marks * scale,
        speed * scale,
        duration,
        turns_sd=float(np.linalg.norm((sd * scale, *common, slipped / np.sqrt(6.0)))),
        speed_sd=float(end_sd / (scale * (marks[-1] - marks[0]))),
    )


def _jitter_of(train: PulseTrain) -> float | None:
    """Return the standard deviation of the times of pulses about a smooth motion, s, from their fourth differences.

    None where no five pulses follow each other.
    """
    even = np.ones(max(train.times.size - 4, 0), dtype=bool)
    step = np.diff(train.numbers)
    for shift in range(4):
        even &= step[shift : step.size - 3 + shift] == 1
    if not np.any(even):
        return None
    return float(np.sqrt(np.mean(np.square(np.diff(train.times, 4)[even])))) / float(_FOURTH)


def _least_squares(
    times: NDArray[np.float64], numbers: NDArray[np.float64], pieces: int, duration: float
) -> tuple[Knots, float, tuple[float, float]]:
    """Fit the time over the numbers of the marks by a cubic spline with equal pieces, which covers the block.

    Returns:
        Times of the knots, s, their marks, and marks per second, shape (pieces + 1,) each; the standard deviation of
        the knots, in marks, and that of both ends of the block.
    """
    # Where the block begins and ends, in marks: told of the mean speed of some pulses beside.
    few = min(2 * _PULSES_A_PIECE, times.size - 1)
    first = numbers[0] - times[0] * (numbers[few] - numbers[0]) / (times[few] - times[0])
    last = numbers[-1] + (duration - times[-1]) * (numbers[-1] - numbers[-1 - few]) / (times[-1] - times[-1 - few])
    first, last = min(first, numbers[0]), max(last, numbers[-1])
    width = (last - first) / pieces
    place = (numbers - first) / width
    piece = np.minimum(place.astype(np.intp), pieces - 1)
    basis = _basis(place - piece)
    # Of the straight line through both ends only the rest is fitted, so that the digits of the times are kept.
    slope = (times[-1] - times[0]) / (numbers[-1] - numbers[0])
    rest = times - times[0] - slope * (numbers - numbers[0])
    size = pieces + 3
    matrix, right = np.zeros((4, size)), np.zeros((size, 3))
    for i in range(4):
        right[i : i + pieces, 0] += np.bincount(piece, basis[i] * rest, pieces)
        for j in range(i, 4):
            matrix[3 - (j - i), j : j + pieces] += np.bincount(piece, basis[i] * basis[j], pieces)
    _add_ridge(matrix, _RIDGE * times.size / size)
    right[:3, 1] = right[-3:, 2] = _AT_KNOT
    solution = solved(matrix, right)
    c = solution[:, 0]
    fitted = np.sum([c[piece + i] * basis[i] for i in range(4)], axis=0)
    jitter = float(np.sqrt(np.sum(np.square(rest - fitted)) / max(times.size - size, 1)))
    marks = first + width * np.arange(pieces + 1)
    at = (c[:-2] + 4.0 * c[1:-1] + c[2:]) / 6.0 + times[0] + slope * (marks - numbers[0])
    speed = 1.0 / (slope + (c[2:] - c[:-2]) / (2.0 * width))
    leverage = (float(_AT_KNOT @ solution[:3, 1]), float(_AT_KNOT @ solution[-3:, 2]))
    ends_sd = tuple(float(jitter * np.sqrt(of_end) * speed[end]) for of_end, end in zip(leverage, (0, -1), strict=True))
    return (at, marks, speed), jitter * float(np.sqrt(size / times.size)) / slope, (ends_sd[0], ends_sd[1])


def _basis(u: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Return the four cubic B-splines over a piece, at places from 0 to 1 in it."""
    v = 1.0 - u
    return v**3 / 6.0, (4.0 - 6.0 * u * u + 3.0 * u**3) / 6.0, (4.0 - 6.0 * v * v + 3.0 * v**3) / 6.0, u**3 / 6.0


def _add_ridge(matrix: NDArray[np.float64], weight: float) -> None:
    """Add a small penalty on second differences, for pieces without a pulse; ``matrix`` is banded, upper."""
    size = matrix.shape[1]
    for i, j, value in ((0, 0, 1.0), (1, 1, 4.0), (2, 2, 1.0), (0, 1, -2.0), (1, 2, -2.0), (0, 2, 1.0)):
        matrix[3 - (j - i), j : size - 2 + j] += weight * value


def limited(time: NDArray[np.float64], turns: NDArray[np.float64], speed: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return speeds with which the angle rises everywhere."""
    chord = np.diff(turns) / np.diff(time)
    least = np.minimum(np.append(chord, np.inf), np.insert(chord, 0, np.inf))
    return np.clip(speed, _FLATTEST * least, _STEEPEST * least)


def _extended(
    time: NDArray[np.float64],
    marks: NDArray[np.float64],
    speed: NDArray[np.float64],
    duration: float,
    predictor: Predictor,
) -> Knots:
    """Extend knots to the beginning and the end of the block."""
    least = 1e-9 * duration
    if time[0] > least:
        at, slope = end_knot(time[::-1], marks[::-1], 0.0, predictor)
        time, marks, speed = np.insert(time, 0, 0.0), np.insert(marks, 0, at), np.insert(speed, 0, slope)
    if time[-1] < duration - least:
        at, slope = end_knot(time, marks, duration, predictor)
        time, marks, speed = np.append(time, duration), np.append(marks, at), np.append(speed, slope)
    return time, marks, speed


def _end_sd(times: NDArray[np.float64], away: float, sd: float, predictor: Predictor) -> float:
    """Return the standard deviation of the angle at an end of the block, ``away`` s from the last knot, in marks.

    Args:
        times: shape (2,), of the two knots at the end, s.
        away: s.
        sd: of the knots, marks.
        predictor: how the angle beyond them is told.
    """
    share = max(away / float(times[1] - times[0]), 0.0)
    return float(np.hypot(sd, predictor.sd * max(share, share * share)))


def _each_turn(train: PulseTrain) -> float:
    """Return the rms of what comes again each turn, revolutions: by mark, the mean distance from a mean over a turn."""
    every = np.arange(int(train.numbers[0]), int(train.numbers[-1]) + 1)
    length = train.per_revolution
    if every.size < 2 * length:
        return 0.0
    times = np.interp(every, train.numbers, train.times)
    sums = np.concatenate(([0.0], np.cumsum(times - times[0])))
    turn = (sums[length:] - sums[:-length]) / length
    # A mean over an even number of marks stands between two of them.
    middle = 0.5 * (turn[1:] + turn[:-1]) if length % 2 == 0 else turn
    first = length // 2
    inside = slice(first, first + middle.size)
    away = (times[inside] - times[0] - middle) / np.gradient(middle)
    mark = every[inside] % length
    by_mark = np.bincount(mark, away, length) / np.maximum(np.bincount(mark, minlength=length), 1)
    return float(np.std(by_mark)) / length


GAIN_SD = 1e-3
"""Relative standard deviation of the calibration of a speed signal, which the signal itself does not show."""
_MAX_SPEED_PIECES, _SAMPLES_A_PIECE, _MIN_SPEED_PIECES = 256, 8, 4
_STOPPED = 0.02
"""A part of the block below this share of the highest speed stands still."""


def rotation_of_speed(speed: NDArray[np.floating], rate: float) -> tuple[Rotation | None, str]:
    """Return the angle of a shaft over a block and "ok", or None and why there is none.

    The signal is integrated; the knots of the angle are the ends of up to 256 equal pieces.

    Args:
        speed: shape (sample,), Hz.
        rate: Hz.
    """
    pieces = min(_MAX_SPEED_PIECES, speed.size // _SAMPLES_A_PIECE)
    if pieces < _MIN_SPEED_PIECES:
        return None, "too_few"
    if not (np.isfinite(speed.min()) and np.isfinite(speed.max())):
        return None, "irregular"
    sums = np.cumsum(speed, dtype=np.float64)
    at = np.rint(np.linspace(0, speed.size - 1, pieces + 1)).astype(np.intp)
    turns = (sums[at] - 0.5 * (speed[at].astype(np.float64) + float(speed[0]))) / rate
    time = at / rate
    mean = np.diff(turns) / np.diff(time)
    highest = float(mean.max())
    if highest <= 0.0 or float(mean.min()) < -_STOPPED * highest:
        return None, "stopped" if highest == 0.0 and not np.any(mean) else "reversed"
    if float(mean.min()) < _STOPPED * highest:
        return None, "stopped"
    slopes = limited(time, turns, spline_slopes(time, turns))
    noise = float(np.sqrt(np.mean(np.square(np.diff(mean, 2))) / 6.0))
    duration = speed.size / rate
    overall = (turns[-1] - turns[0]) / time[-1]
    return Rotation(
        time,
        turns,
        slopes,
        duration,
        "profile",
        turns_sd=noise * duration / pieces * math.sqrt(pieces / 6.0),
        speed_sd=math.hypot(noise / math.sqrt(pieces) / overall, GAIN_SD),
    ), "ok"
