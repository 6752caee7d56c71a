"""The six-degree-of-freedom model simulated over time, for scenes whose motion has no ball period.

Defects that turn (inner race, ball), a force that turns (unbalance) and balls that slip have no common period; several
defects need not have one. They are simulated from rest at the static equilibrium, the beginning is dropped, and what
remains is averaged with its standard error. Waviness and gravity are modelled here too.
``models/solve/six_dof/kernels/time_domain.py`` describes the integration.

Readings: the path coordinate is an angle on the damaged part, kinematics those of pure rolling (``Kinematics``). Slip
shifts when a ball meets the defect, not where it presses: the angle is small. Gravity changes the static equilibrium
and nothing else, because the rest of the model is linear in it.

A speed that changes (``Scene.speed_profile``) has one rate of steps, that of its highest speed. The unbalance pushes
with the square of the speed, and against its change. What the speed changes slowly (grease, temperature) is left out.

The error of the steps is estimated as ``models.solve.engine.over_time`` describes.

What the time-domain kernel needs for a run: which ball meets which piece of which path, from when to when.

Balls are named by row and number and keep their path coordinate, angle = start + rate * t, for good; the kernel names
them by the slot of the cage that they occupy, so each meeting is cut where the cage has turned by one pitch.

Where the speed changes, all this is laid out over the nominal time, in which the shaft turns at its nominal speed, and
the instants are then put back to times. Knots of the profile are events too, so that it is one cubic between events.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from models.machine.bearing import kinematics
from models.machine.hertz import element_angles
from models.machine.rig import Rig
from models.machine.speed_profile import constant
from models.path.contour import PathPieces, joined, part_paths, pieces
from models.solve.engine.motion import Motion, Planned, lead_in, passage_rate
from models.solve.engine.over_time import answer, duration_of, timed
from models.solve.registry import Solver
from models.solve.response import CASING, Response
from models.solve.six_dof.kernels import time_domain as kernels
from models.solve.six_dof.kernels.step import NEAR_SLOPE, P_DIRECTION_1, P_DIRECTION_2, STATUS_OK, Balls
from models.solve.six_dof.setup import (
    DEFAULT_STEP,
    MODEL,
    TIME_EFFECTS,
    check_scene,
    contact_power,
    default_settling,
    longest_step,
    scene_parameters,
    time_cost,
)
from models.words.checks import check_positive
from models.words.request import Request

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.bearing import Kinematics
    from models.machine.scene import Defect, Scene
    from models.machine.speed_profile import SpeedProfile


# Events closer than this are one, s.
_SAME_TIME = 1e-10
_NEAR_ANGLE = math.pi / 2.0 + math.atan(NEAR_SLOPE)


def prepare_plan(scene: Scene, duration: float, lead: float = 0.0) -> kernels.TimePlan:
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
    return kernels.TimePlan(
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


def _all_meetings(scene: Scene, paths: list[PathPieces], rates: list[float], duration: float) -> _Meetings:
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


def _meetings(scene: Scene, defect: Defect, path: PathPieces, along: float, duration: float) -> _Meetings:
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


_LEAST_ERROR = 1e-6


def solve(scene: Scene, request: Request) -> Response:
    """Return the vibration of a scene over the time that a request names, with steps that meet its accuracy.

    Raises:
        ValueError: if the scene or the request is outside what is solved here; the message names it.
    """
    return _simulate(scene, request, None, (math.cos(request.direction), math.sin(request.direction)), None)


def simulate_time(
    scene: Scene,
    duration: float,
    rate: float,
    *,
    settle: float | None = None,
    direction: tuple[float, float] = (1.0, 0.0),
    step: float = DEFAULT_STEP,
) -> Response:
    """Return ``duration`` seconds of the vibration of a scene with all effects that it names, sampled at ``rate`` Hz.

    As ``solve``, with steps that are given.

    Args:
        settle: time that is simulated before and dropped, s; by default 40 ball periods, and 0.2 s at least.
        direction: of the sensor, along the load and across it; made a unit vector.
        step: longest step of the integration, s; taken so that a sample has a whole number of steps, at least 2.

    Raises:
        ValueError: if the scene or an argument is outside what the model describes; the message names it.
    """
    check_positive(step=step)
    length = math.hypot(*direction)
    if not (math.isfinite(length) and length > 0.0):
        raise ValueError(f"direction must be a vector of finite length other than zero, got {direction!r}")
    unit = (direction[0] / length, direction[1] / length)
    return _simulate(scene, Request(duration=duration, rate=rate), settle, unit, step)


def _simulate(
    scene: Scene, request: Request, settle: float | None, direction: tuple[float, float], step: float | None
) -> Response:
    """Return the response with a given step, or where it is None with that of the request or of the accuracy."""
    check_scene(scene, TIME_EFFECTS)
    lines = kinematics(scene.bearing, scene.speed)
    dropped = _settling(settle, lines)
    request, profile = timed(scene, request)
    lead = 0.0
    if profile is not None:
        lead = lead_in(dropped, request.rate)
        dropped = lead - 0.5 / request.rate
    motion = Motion(
        from_rest=_FromRest(scene, request, dropped, direction, lead),
        sensors=CASING,
        model=MODEL,
        solver=SOLVER.name,
        bpfo=lines.bpfo,
        block=1.0 / _block_rate(scene, lines),
        settle=dropped,
        repeats=scene.repeats,
        passages=passage_rate(scene),
        profile=profile,
        per_turn=None if profile is None else lines.bpfo / lines.speed,
        speed=scene.speed,
    )
    return answer(motion, request, longest_step(scene, lines) if step is None else step, fixed=step is not None)


class _FromRest:
    """The accelerations of one scene from rest at the static equilibrium, with steps of any length."""

    def __init__(
        self, scene: Scene, request: Request, settle: float, direction: tuple[float, float], lead: float
    ) -> None:
        """Keep the scene; which ball meets what is planned with the first run, once for all steps."""

        def plan_of(seconds: float) -> kernels.TimePlan:
            plan = prepare_plan(scene, seconds, lead)
            plan.parameter[P_DIRECTION_1], plan.parameter[P_DIRECTION_2] = direction
            return plan

        self._rate, self._planned = request.rate, Planned(plan_of, duration_of(request, settle))

    def __call__(self, steps: int, oversampling: int) -> tuple[NDArray[np.float64], bool]:
        """Return the accelerations of casing and resonator, (steps, 2), and whether they are finite."""
        h = 1.0 / (self._rate * oversampling)
        wave = np.empty((steps, 2))
        status = kernels.run(np.zeros((2, 6)), wave, h, self._planned.until(steps * h))
        return wave, status == STATUS_OK


def _block_rate(scene: Scene, lines: Kinematics) -> float:
    """Return how many blocks a second has: the slowest of the frequencies with which the level swings, Hz."""
    if scene.repeats:
        return lines.bpfo
    return lines.ftf if "ball_defect" in scene.effects else lines.speed


def _settling(settle: float | None, lines: Kinematics) -> float:
    """Return the time to drop, s: the given one, or the default."""
    if settle is None:
        return default_settling(lines)
    if not (math.isfinite(settle) and settle >= 0.0):
        raise ValueError(f"settle must be finite and not negative, got {settle!r}")
    return settle


def warm() -> None:
    """Compile the kernels: one steady scene, one with unbalance, one whose speed changes.

    A force that turns with the shaft is left out of the machine code of scenes without one, as is a changing speed.
    """
    from models.machine.scene import Scene

    steady = Scene(40.0, 1000.0)
    for scene in (steady, replace(steady, unbalance=1e-3), replace(steady, speed_profile=constant(40.0, 1.0))):
        simulate_time(scene, 0.005, 25600.0, settle=0.0)


SOLVER = Solver(
    model=MODEL,
    name="time_domain",
    effects=TIME_EFFECTS,
    error=_LEAST_ERROR,
    cost=time_cost,
    solve=solve,
    reason="one ball period would not show all of it, so that it is simulated over time",
    rig=Rig,
)
