"""The angle of the shaft from the vibration itself.

The path of a comb of orders is followed through the short-time spectra of signal and envelope, first coarsely over
time, then over angle, and refined by the phases of the orders. The signal that is read along this angle is one of a
shaft at a steady speed, and whether its lines are those of the shaft is decided as for one: by the comb of the shaft
and the bearing over the whole block, which must stand clear of every other speed. The lines must stand throughout it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from models.machine.bearing import Bearing, kinematics
from monitor.health.signal.floor import MIN_FLOOR_BINS, noise_floor
from monitor.health.signal.rotation.phase import correct, corrected, rows_by_angle
from monitor.health.signal.rotation.plane import LowRows, agreement, best_path, low_rows, plane_of
from monitor.health.signal.rotation.rotation import Rotation, constant
from monitor.health.signal.speed import SpeedEstimate, SpeedStatus, highest_line, speed_of_spectra, whitened
from monitor.health.signal.transform import AmplitudeSpectrum

DEFAULT_ORDERS = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0)
MIN_TURNS = 24
"""Turns at the lowest speed that a block must hold."""
MAX_TURNS_SD = 0.04
"""Greatest standard deviation of the angle at which one is given, turns."""
MIN_OWN_LINE = 2.5
"""Least height of a line of the shaft that is not one of a comb twice or three times as wide, ln of power."""
MIN_AGREEMENT = 0.6
"""Least excess of the lines at their orders over those at any shifted ones, in each part of a block."""
CLEARLY_LESS = 4.0
_SLIP = np.linspace(-0.02, 0.01, 61)
"""Score by which a path may be worse than one speed, where its lines stand higher; slip of the lines of a bearing."""
_WANDER = (8.0, 2.0, 0.003)
"""Window, spacing of knots and roughness, turns, of the phases about a steady speed."""
_GROWTH = 1.2
"""Greatest relative change of the speed within a second, where no acceleration is stated."""
_GROWTH_STEP = 0.2
_TURNS, _HOP = 6.0, 0.1
"""Length of a window at the lowest speed of an octave, turns; from one window to the next, s."""
_FINE_REACH, _FINE_STEP, _FINE_TURNS, _FINE_HOP = 0.08, 0.002, 12.0, 3.0
_FINE_GROWTH = 0.008
"""The second path: relative reach and step of the speed, window and hop, turns, and greatest growth, 1/turn."""
_END_OUTSIDE, _END_BESIDE = 4.0, 14.0
"""Turns from the end of a block up to which the second path is not used, and from which it is continued instead."""
_PASSES = ((4.0, 0.03), (8.0, 0.01))
_KNOT_TURNS = 2.0
"""Length of a window and roughness of the correction, turns, of each reading of the phases; spacing of its knots."""
_LONGER, _LONGEST = 0.3, 8.0
"""Windows of a comb that begins at order n are 0.3 n times as long in its own turns, at most 8 times."""
_SAME_SCALE = 0.005
"""Relative difference up to which the comb over the whole block is that of the path, and not a multiple of it."""
_RANGE_SLACK = 0.03
_END_TURNS = 0.05
"""Error of the angle at the ends of a block, where no window is whole, turns."""


def angle_from_vibration(
    samples: NDArray[np.floating],
    rate: float,
    bearing: Bearing,
    limits: tuple[float, float],
    orders: Sequence[float] = (),
    max_acceleration: float | None = None,
) -> tuple[Rotation | None, str]:
    """Return the angle of the shaft over a block, found in its vibration.

    Args:
        samples: shape (sample,), any unit.
        rate: Hz.
        bearing: its kinematics tell the speed from its multiples.
        limits: lowest and highest speed within the block, Hz.
        orders: lines of the shaft that are followed, per revolution, such as those of a mesh; by default the first
            eight.
        max_acceleration: greatest change of the speed, Hz/s; by default 1.2 times the speed in a second.

    Returns:
        The rotation and "ok"; or None and "too_few": the block holds too few turns, or "cannot_tell".

    Raises:
        ValueError: the limits are not 0 < low < high, or an order is not positive.
    """
    low, high = limits
    followed = np.sort(np.array(orders if orders else DEFAULT_ORDERS, dtype=np.float64))
    if not (0.0 < low < high < math.inf):
        raise ValueError(f"limits of the speed must satisfy 0 < low < high, got {low} to {high} Hz")
    if not followed[0] > 0.0:
        raise ValueError(f"orders must be positive, got {tuple(orders)}")
    duration = samples.size / rate
    if duration * low < MIN_TURNS:
        return None, "too_few"
    if not float(np.ptp(samples)) > 0.0:
        return None, "cannot_tell"
    top = min(max(highest_line(bearing, high), (followed[-1] + followed[0]) * high), 0.45 * rate)
    signals = low_rows(samples, rate, top)
    steady = _steady(signals, bearing, limits, followed)
    growth = _GROWTH if max_acceleration is None else min(_GROWTH, max_acceleration / low)
    rotation, found = _varying(signals, bearing, limits, followed, growth)
    if rotation is None or not _sharper(signals, (rotation, found), steady, bearing, followed):
        rotation, found = steady
        if found.status == SpeedStatus.OK:
            sd = _wander(signals, rotation, followed)
            rotation = replace(rotation, source="phase", turns_sd=sd)
    if found.status != SpeedStatus.OK or abs(found.speed / rotation.mean_speed - 1.0) > _SAME_SCALE:
        return None, "cannot_tell"
    if rotation.turns_sd > MAX_TURNS_SD or not _holds(signals, rotation, followed):
        return None, "cannot_tell"
    ends = _END_TURNS / rotation.turned
    speed_sd = math.hypot(rotation.speed_sd, ends, found.sd / found.speed)
    return replace(rotation, duration=duration, speed_sd=speed_sd), "ok"


_Candidate = tuple[Rotation, SpeedEstimate]


def _steady(signals: LowRows, bearing: Bearing, limits: tuple[float, float], orders: NDArray[np.float64]) -> _Candidate:
    """Return the rotation at the one speed that fits best, and the verdict on it."""
    begin = constant(0.5 * (limits[0] + limits[1]), signals.duration)
    found = _verdict(signals, begin, bearing, limits, orders)
    return (constant(found.speed, signals.duration) if found.status == SpeedStatus.OK else begin), found


def _varying(
    signals: LowRows, bearing: Bearing, limits: tuple[float, float], orders: NDArray[np.float64], growth: float
) -> tuple[Rotation | None, SpeedEstimate]:
    """Return the rotation of the best path, at the scale of the shaft where it can be told, and the verdict on it."""
    base = float(orders[0])
    multiples = orders / base
    reach = base * limits[0], min(base * limits[1], signals.top / (float(multiples[-1]) + 0.5))
    longer = min(max(1.0, _LONGER * base), _LONGEST)
    try:
        rotation = _scaled(_followed(signals, reach, multiples, growth, longer), 1.0 / base)
        found = _verdict(signals, rotation, bearing, limits, orders)
        if found.status == SpeedStatus.OK and abs(found.speed / rotation.mean_speed - 1.0) > _SAME_SCALE:
            # The path is that of another comb, which tells the speed of the shaft: its own orders are read as well.
            rotation = _scaled(rotation, found.speed / rotation.mean_speed)
            if max(rotation.speed_range) * float(orders[-1]) < 0.95 * signals.top:
                rotation = _scaled(_by_phases(signals, _scaled(rotation, base), multiples, longer), 1.0 / base)
            found = _verdict(signals, rotation, bearing, limits, orders)
    except ValueError:
        # A path through noise may turn back: that is no rotation.
        return None, SpeedEstimate(SpeedStatus.CANNOT_TELL)
    return rotation, found


def _sharper(
    signals: LowRows, path: _Candidate, steady: _Candidate, bearing: Bearing, orders: NDArray[np.float64]
) -> bool:
    """Return whether the lines stand clearer along a path than at one speed: a path through weak lines blurs others."""
    if path[1].score < steady[1].score - CLEARLY_LESS:
        return False
    if SpeedStatus.OK in (path[1].status, steady[1].status) and path[1].status != steady[1].status:
        return path[1].status == SpeedStatus.OK
    return _line_height(signals, path[0], bearing, orders) > _line_height(signals, steady[0], bearing, orders)


def _line_height(signals: LowRows, rotation: Rotation, bearing: Bearing, orders: NDArray[np.float64]) -> float:
    """Return the sum of the heights of the lines of the shaft, and of the best comb of the bearing, ln of power."""
    lines = kinematics(bearing, 1.0)
    total = 0.0
    for row in _by_angle(signals, rotation)[2]:
        tiny = float(np.finfo(np.float32).tiny)
        floor = np.maximum(noise_floor(row, MIN_FLOOR_BINS), tiny)
        height = np.maximum(np.log(np.maximum(np.square(row, dtype=np.float64), tiny) / floor), 0.0)
        tops = np.maximum(height, np.maximum(np.roll(height, 1), np.roll(height, -1)))

        def at(places: NDArray[np.float64], tops: NDArray[np.float64] = tops) -> NDArray[np.float64]:
            bins = np.rint(places * rotation.turned).astype(np.intp)
            return np.where(bins < tops.size, tops[np.minimum(bins, tops.size - 1)], 0.0)

        combs = np.outer(1.0 + _SLIP, np.arange(1.0, 5.0))
        races = [at(line * combs).sum(axis=1).max() for line in (lines.ftf, lines.bpfo, lines.bpfi, 2.0 * lines.bsf)]
        total += float(at(orders).sum()) + max(map(float, races))
    return total


def _wander(signals: LowRows, rotation: Rotation, orders: NDArray[np.float64]) -> float:
    """Return how far the phases of the orders wander about a steady speed, standard deviation, turns."""
    found = correct(signals, rotation, orders, *_WANDER)
    line = np.polyfit(found.turn, found.ahead, 1)
    return math.hypot(float(np.std(found.ahead - np.polyval(line, found.turn))), found.sd)


def _followed(
    signals: LowRows, limits: tuple[float, float], multiples: NDArray[np.float64], greatest: float, longer: float
) -> Rotation:
    """Return the rotation of the best comb, whatever it is of.

    Args:
        limits: of the first line of the comb, Hz.
        multiples: of the lines, in the first.
        greatest: relative growth, 1/s.
        longer: factor of the windows.
    """
    steps = max(1, math.ceil(greatest / _GROWTH_STEP - 1e-9))
    growth = np.arange(-steps, steps + 1, dtype=np.float64) * _GROWTH_STEP
    plane = plane_of(signals, limits, multiples, growth, _TURNS * longer, _HOP)
    log_speed, rates, _ = best_path(plane)
    coarse = _rotation_of_path(plane.time, log_speed, rates, signals.duration)
    return _by_phases(signals, _fine(signals, coarse, multiples, longer), multiples, longer)


def _fine(signals: LowRows, rotation: Rotation, multiples: NDArray[np.float64], longer: float) -> Rotation:
    """Return the rotation by a second path, near the first, through a plane over angle."""
    rows, per_turn = rows_by_angle(signals, rotation, 16.0 * float(multiples[-1]))
    by_angle = LowRows(per_turn, rows, float(multiples[-1]))
    growth = np.arange(-4.0, 5.0) * (0.25 * _FINE_GROWTH / longer)
    reach = 1.0 - _FINE_REACH, 1.0 + _FINE_REACH
    plane = plane_of(by_angle, reach, multiples, growth, _FINE_TURNS * longer, _FINE_HOP * longer, _FINE_STEP)
    log_speed, rates, _ = best_path(plane)
    fine = _rotation_of_path(plane.time, log_speed, rates, rotation.turned)
    time = rotation.time_at(float(rotation.turns_at(0.0)) + fine.time)
    logarithm = np.log(fine.speed * rotation.speed_at(time))
    # At the ends, where no window is whole, the speed goes on as before.
    for outside, beside in _ends(fine.time / longer, rotation.turned / longer):
        slope, level = np.polyfit(time[beside], logarithm[beside], 1)
        logarithm[outside] = level + slope * time[outside]
    return _rotation_of_path(time, logarithm, np.gradient(logarithm, time), rotation.duration)


def _by_phases(signals: LowRows, rotation: Rotation, multiples: NDArray[np.float64], longer: float) -> Rotation:
    """Return the rotation corrected by the phases of its orders."""
    for window, roughness in _PASSES:
        found = correct(signals, rotation, multiples, window * longer, _KNOT_TURNS * longer, roughness * longer)
        rotation = corrected(rotation, found)
    return rotation


def _ends(turn: NDArray[np.float64], turned: float) -> tuple[tuple[NDArray[np.bool_], NDArray[np.bool_]], ...]:
    """Return which knots stand near either end of a block, and which are those beside them."""
    first, last = _END_OUTSIDE, _END_BESIDE
    return tuple((at < first, (at >= first) & (at <= last)) for at in (turn, turned - turn))


def _rotation_of_path(
    time: NDArray[np.float64], log_speed: NDArray[np.float64], growth: NDArray[np.float64], duration: float
) -> Rotation:
    """Return the rotation of a path of ln of the speed and its slope, continued to both ends."""
    if time[0] > 0.0:
        first = log_speed[0] - growth[0] * time[0]
        time, log_speed = np.concatenate(([0.0], time)), np.concatenate(([first], log_speed))
        growth = np.concatenate((growth[:1], growth))
    if time[-1] < duration:
        last = log_speed[-1] + growth[-1] * (duration - time[-1])
        time, log_speed = np.concatenate((time, [duration])), np.concatenate((log_speed, [last]))
        growth = np.concatenate((growth, growth[-1:]))
    step = np.diff(time)
    # Simpson's rule; in the middle stands the cubic through ln of the speed.
    middle = 0.5 * (log_speed[:-1] + log_speed[1:]) + step / 8.0 * (growth[:-1] - growth[1:])
    speed = np.exp(log_speed)
    piece = step / 6.0 * (speed[:-1] + 4.0 * np.exp(middle) + speed[1:])
    return Rotation(time, np.concatenate(([0.0], np.cumsum(piece))), speed, duration, "phase")


def _scaled(rotation: Rotation, factor: float) -> Rotation:
    """Return the rotation of a shaft that turns so many times as fast."""
    return replace(
        rotation,
        turns=rotation.turns * factor,
        speed=rotation.speed * factor,
        turns_sd=rotation.turns_sd * factor,
    )


def _verdict(
    signals: LowRows, rotation: Rotation, bearing: Bearing, limits: tuple[float, float], orders: NDArray[np.float64]
) -> SpeedEstimate:
    """Return the speed of the shaft whose signal is read along a rotation: its scale, or that none can be told."""
    slowest, fastest = rotation.speed_range
    mean = rotation.mean_speed
    low = limits[0] * mean / slowest * (1.0 - _RANGE_SLACK)
    high = limits[1] * mean / fastest * (1.0 + _RANGE_SLACK)
    if not low < high:
        return SpeedEstimate(SpeedStatus.CANNOT_TELL)
    _, _, amplitude = _by_angle(signals, rotation)
    raw, envelope = (AmplitudeSpectrum(1.0 / rotation.duration, row) for row in amplitude)
    return speed_of_spectra(raw, envelope, bearing, (low, high), tuple(orders.tolist()))


def _holds(signals: LowRows, rotation: Rotation, orders: NDArray[np.float64]) -> bool:
    """Return whether the lines are those of the shaft itself, and stand at their orders in each part of the block."""
    rows, per_turn, amplitude = _by_angle(signals, rotation)
    heights = tuple(whitened(AmplitudeSpectrum(1.0, row)) for row in amplitude)
    if not _has_own_lines(heights, rotation.turned, orders):
        return False
    found = agreement(rows, per_turn, heights, 1.0 / rotation.turned)
    return found.size > 0 and float(found.min()) > MIN_AGREEMENT


def _has_own_lines(heights: tuple[NDArray[np.float64], ...], turned: float, orders: NDArray[np.float64]) -> bool:
    """Return whether a line stands at an order that is no double, and at one that is no triple, of the first.

    Where none does, the comb is that of a shaft or of passages that are twice or three times as fast.
    """
    multiples = np.rint(orders / orders[0])
    places = np.rint(orders * turned).astype(np.intp)
    tops = np.zeros(orders.size)
    for height in heights:
        for shift in (-1, 0, 1):
            at = np.minimum(places + shift, height.size - 1)
            tops = np.maximum(tops, np.where(places + shift < height.size, height[at], 0.0))
    return all(float(tops[multiples % part != 0].max(initial=0.0)) >= MIN_OWN_LINE for part in (2, 3))


def _by_angle(signals: LowRows, rotation: Rotation) -> tuple[NDArray[np.float32], float, NDArray[np.float32]]:
    """Return signal and envelope by angle, their samples per turn, and their spectra, one bin a turn of the block."""
    rows, per_turn = rows_by_angle(signals, rotation, 2.5 * signals.top / rotation.speed_range[0])
    count = rows.shape[1]
    window = np.hanning(count + 1)[:-1].astype(np.float32)
    kept = min(count // 2, math.ceil(signals.top / rotation.mean_speed * count / per_turn))
    return rows, per_turn, np.abs(np.fft.rfft(rows * window, axis=1)[:, :kept]) * (4.0 / count)
