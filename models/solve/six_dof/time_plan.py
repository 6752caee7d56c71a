"""What the time-domain kernel needs for a run: which ball meets which piece of which path, from when to when.

Balls are named by row and number and keep their path coordinate, angle = start + rate * t, for good; the kernel names
them by the slot of the cage that they occupy, so each meeting is cut where the cage has turned by one pitch.

Where the speed changes, all this is laid out over the nominal time, in which the shaft turns at its nominal speed, and
the instants are then put back to times. Knots of the profile are events too, so that it is one cubic between events.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.machine.bearing import kinematics
from models.machine.hertz import element_angles
from models.path.contour import Pieces, joined, part_paths, pieces
from models.solve.six_dof.kernels import time_domain as kernels
from models.solve.six_dof.kernels.step import NEAR_SLOPE, Balls
from models.solve.six_dof.setup import contact_power, scene_parameters

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.bearing import Kinematics
    from models.machine.scene import Defect, Scene
    from models.machine.speed_profile import SpeedProfile

# Events closer than this are one, s.
_SAME_TIME = 1e-10
_NEAR_ANGLE = math.pi / 2.0 + math.atan(NEAR_SLOPE)


def prepare_plan(scene: Scene, duration: float, lead: float = 0.0) -> kernels.Plan:
    """Return everything the kernel needs for a run of ``duration`` seconds (the sensor lies along the load).

    A profile of the speed begins after ``lead`` seconds.
    """
    profile = scene.rotation(max(duration - lead, _SAME_TIME))
    profile = profile if profile is None else profile.delayed(lead)
    bearing, lines = scene.bearing, kinematics(scene.bearing, scene.speed)
    omega, shaft = 2.0 * math.pi * lines.ftf, 2.0 * math.pi * scene.speed
    pitch = 2.0 * math.pi / bearing.n_elements
    angles = element_angles(bearing)
    # The slots sweep one pitch each; they are sorted by the least distance from the load on the way.
    off = np.abs(np.remainder(angles + 0.5 * pitch + math.pi, 2.0 * math.pi) - math.pi) - 0.5 * pitch
    order = np.argsort(off, kind="stable")
    sorted_angles = angles[order]
    waves = [w for w in scene.waviness if w.amplitude != 0.0]
    orders = np.array([float(w.order) for w in waves])[:, None]
    paths = [pieces(part_paths(bearing, defect)) for defect in scene.defects]
    rates = [_path_rate(defect, lines) for defect in scene.defects]
    path = joined(paths)
    nominal = duration if profile is None else float(profile.turns_at(duration)) / scene.speed
    meetings = _all_meetings(scene, paths, rates, nominal)
    knots = np.empty(0) if profile is None else np.array(profile.turns) / scene.speed
    bounds, turns, first, record, interval = _intervals(meetings, pitch / omega, nominal, knots)
    clock = None
    if profile is not None:
        bounds, clock = _on_clock(bounds, duration, profile, scene.speed)
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    row = meetings.row[record]
    ball = (meetings.ball[record] + turns[interval]) % bearing.n_elements
    slots = np.stack((np.cos(sorted_angles), np.sin(sorted_angles), np.ldexp(1.0, np.arange(len(order)))))
    power = contact_power(bearing)
    none, moves = slots[:, :0].copy(), bool(waves) or len(record) > 0
    near = len(order) if waves else int(np.sum(off <= _NEAR_ANGLE))
    return kernels.Plan(
        parameter=scene_parameters(scene),
        balls=Balls(slots, none, near, 0, power) if moves else Balls(none, slots, 0, near, power),
        bounds=bounds,
        turns=turns,
        first=first,
        slot=place[row * bearing.n_elements + ball],
        piece=meetings.piece[record],
        offset=meetings.offset[record],
        rate=np.array([rate for rate, part in zip(rates, paths, strict=True) for _ in part.start], dtype=np.float64),
        origin=path.start,
        inverse_width=path.inverse_width,
        cells_first=path.first,
        cells=path.cells,
        waves=np.array(
            [
                [
                    w.amplitude * math.cos(bearing.contact_angle),
                    w.order * (omega - (shaft if w.race == "inner" else 0.0)),
                    w.order * pitch,
                    w.phase,
                ]
                for w in waves
            ]
        ).reshape(len(waves), 4),
        crests=np.stack((np.cos(orders * sorted_angles), np.sin(orders * sorted_angles)), axis=1)
        if waves
        else np.zeros((0, 2, len(order))),
        push=None if scene.unbalance == 0.0 and clock is None else _push(scene.unbalance, shaft),
        clock=clock,
    )


def _push(unbalance: float, shaft: float) -> NDArray[np.float64]:
    """Return the kernel's ``push`` of an unbalance, kg m, at a shaft's angular speed, rad/s."""
    return np.array([unbalance * shaft * shaft, shaft, 0.0, unbalance * shaft])


def _on_clock(
    bounds: NDArray[np.float64], duration: float, profile: SpeedProfile, nominal: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the kernel's ``bounds`` from those in nominal time, and its ``clock``; ``nominal``: speed, Hz."""
    times = np.append(np.maximum.accumulate(profile.time_at(bounds[:-1] * nominal)), duration + 1.0)
    begin, cubics = profile.pieces
    within = 0.5 * (times[:-1] + np.minimum(times[1:], duration))
    piece = np.searchsorted(begin[1:], within, side="right")
    return times, np.column_stack((begin[piece], cubics[piece] / nominal))


def _path_rate(defect: Defect, lines: Kinematics) -> float:
    """Return the rate at which a ball moves over the damaged part, or a damaged ball spins, rad/s."""
    if defect.part == "outer":
        return 2.0 * math.pi * lines.ftf
    return 2.0 * math.pi * (lines.bsf if defect.part == "ball" else lines.ftf - lines.speed)


@dataclass(frozen=True, eq=False)
class _Meetings:
    """When which ball is on which piece, each array of shape (meetings,); see the kernel's records."""

    begin: NDArray[np.float64]
    end: NDArray[np.float64]
    row: NDArray[np.int64]
    ball: NDArray[np.int64]
    piece: NDArray[np.int64]
    offset: NDArray[np.float64]


def _all_meetings(scene: Scene, paths: list[Pieces], rates: list[float], duration: float) -> _Meetings:
    """Return the passages over the pieces of all defects, which are counted through."""
    found = [
        _meetings(scene, defect, path, rate, duration)
        for defect, path, rate in zip(scene.defects, paths, rates, strict=True)
    ]
    if not found:
        none, whole = np.empty(0), np.empty(0, dtype=np.int64)
        return _Meetings(none, none, whole, whole, whole, none)
    first = np.cumsum([0, *(len(path.start) for path in paths[:-1])])
    return _Meetings(
        begin=np.concatenate([m.begin for m in found]),
        end=np.concatenate([m.end for m in found]),
        row=np.concatenate([m.row for m in found]),
        ball=np.concatenate([m.ball for m in found]),
        piece=np.concatenate([m.piece + offset for m, offset in zip(found, first, strict=True)]),
        offset=np.concatenate([m.offset for m in found]),
    )


def _meetings(scene: Scene, defect: Defect, path: Pieces, along: float, duration: float) -> _Meetings:
    """Return all passages of balls over the pieces of one defect within the run."""
    bearing = scene.bearing
    rows = range(defect.first_row, defect.first_row + defect.rows)
    balls = 1 if defect.part == "ball" else bearing.n_elements
    start = element_angles(bearing).reshape(bearing.rows, bearing.n_elements)
    sweep = sorted((0.0, along * duration))
    passages = np.arange(math.floor(sweep[0] / (2.0 * math.pi)) - 1, math.ceil(sweep[1] / (2.0 * math.pi)) + 2)
    row, ball, passage, piece = (
        x.ravel()
        for x in np.meshgrid(
            np.array(rows, dtype=np.int64), np.arange(balls), passages, np.arange(len(path.start)), indexing="ij"
        )
    )
    offset = (0.0 if defect.part == "ball" else 1.0) * start[row, ball] - 2.0 * math.pi * passage.astype(np.float64)
    if scene.slip is not None:
        shape = (bearing.rows, bearing.n_elements, len(passages))
        # The passages over one race are those over all of its defects.
        seed = scene.slip.seed if defect.part == "outer" else [scene.slip.seed, 1]
        drawn = np.random.default_rng(seed).uniform(-1.0, 1.0, shape)
        offset = offset + scene.slip.phi_slip * drawn[row, ball, passage - passages[0]]
    times = np.sort(np.stack(((path.start[piece] - offset) / along, (path.end[piece] - offset) / along)), axis=0)
    keep = (times[1] > 0.0) & (times[0] < duration)
    return _Meetings(times[0][keep], times[1][keep], row[keep], ball[keep], piece[keep], offset[keep])


def _intervals(
    meetings: _Meetings, turn: float, duration: float, knots: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return the kernel's ``bounds``, ``turns`` and ``first``, and meeting and interval of each of its records.

    ``knots`` are further events.
    """
    whole = turn * np.arange(1, math.ceil(duration / turn) + 1)
    times = np.concatenate((meetings.begin, meetings.end, whole, knots))
    times = np.sort(times[(times > 0.0) & (times < duration)])
    times = np.concatenate(([0.0], times))
    bounds = times[np.concatenate(([True], np.diff(times) > _SAME_TIME))]
    turns = np.floor((bounds + _SAME_TIME) / turn).astype(np.int64)
    low = np.searchsorted(bounds, np.maximum(meetings.begin, 0.0), side="right") - 1
    high = np.searchsorted(bounds, meetings.end, side="right") - 1
    high = np.where(meetings.end >= duration, len(bounds), high)
    lengths = high - low
    record = np.repeat(np.arange(len(lengths)), lengths)
    interval = np.arange(len(record)) - np.repeat(np.cumsum(lengths) - lengths, lengths) + low[record]
    by_time = np.argsort(interval, kind="stable")
    first = np.concatenate(([0], np.cumsum(np.bincount(interval, minlength=len(bounds))))).astype(np.int64)
    return np.append(bounds, duration + 1.0), turns, first, record[by_time], interval[by_time]
