"""Mean level of a defect that turns (inner race or ball): the RMS of stationary records, with its standard error.

Such a motion has no period: while the defect turns through the load once (with the shaft, or a ball with the cage), the
balls pass, or the ball spins, a number of times that is not whole. Its level is the mean over the phase that is left.
A record begins at rest, its beginning is dropped, and what remains is cut into turns where the defect is opposite to
the load. The mean squares of the turns are fitted by the first harmonics of their phase: the constant is the mean over
all phases, and what the fit leaves gives its standard error. Records are added until that is small enough.

Near a simple fraction of a turn, one record visits few phases; records that begin in between are added from the start.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from models.machine.bearing import kinematics
from models.path.contour import part_paths
from models.solve.response import HARMONICS
from models.solve.six_dof.setup import TIME_EFFECTS, check_scene
from models.solve.six_dof.stationary_record import (
    StationaryRecord,
    cage_turns_of,
    placed,
    run_from_rest,
    settling_turns,
    steps_in_turn,
    take_record,
    turn_rate,
)
from models.words.request import check_band

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.bearing import Kinematics
    from models.machine.scene import Scene
    from models.solve.response import Status

    Values = NDArray[np.float64]

# Widest gap, in turns, that the other phase may leave.
_WIDEST_GAP = 0.2
# Limit of the records, as a multiple of those that the phases need, at the default standard error.
_MOST_RECORDS = 16
# Steps are halved so often at most, and no further where that reduces the error by less than half.
_HALVINGS = 3
# Error of the RMS over its change by twice the steps.
_CHANGE_TO_ERROR = 1.0 / 3.0
# How much deeper than the path a floor is that is not reached.
_BEYOND = 1.0 + 1e-6
# A smaller relative change between the halves of the records is no drift at any standard error.
_SAME_LEVEL = 3e-3
# Harmonics of the phase that are fitted, by the number of turns from which on; fewest batches for a standard error.
_HARMONICS = ((0, 2), (24, 4))
_BATCHES = 8

DEFAULT_STANDARD_ERROR = 5e-3

_EFFECTS = TIME_EFFECTS - {"outer_defect", "several_defects", "waviness", "inner_waviness", "unbalance", "gravity"}


@dataclass(frozen=True, eq=False)
class StationaryLevel:
    """Mean level of a scene along the load, SI units.

    Attributes:
        rms: of the casing in the band, m/s2.
        rms_se: its standard error, m/s2.
        rms_error: its relative error due to the steps, estimated by twice the steps.
        spread: standard deviation of the RMS from turn to turn, m/s2.
        harmonics: single-sided amplitudes of lines 1..6 of the damaged part, m/s2, shape (6,): multiples of BPFI, or
            of twice BSF. From parts of four turns of the cage, their powers averaged.
        harmonics_std: standard deviation of these amplitudes from part to part, m/s2, shape (6,).
        harmonics_se: their standard errors, m/s2, shape (6,).
        status: "not_periodic" (mean and spread hold), "inaccurate" (the steps or the standard error miss what was
            asked) or "not_converged" (the level drifts or left the finite numbers).
        turns: number of turns averaged.
    """

    rms: float
    rms_se: float
    rms_error: float
    spread: float
    harmonics: Values
    harmonics_std: Values
    harmonics_se: Values
    status: Status
    turns: int


def stationary_level(
    scene: Scene,
    *,
    accuracy: float,
    standard_error: float = DEFAULT_STANDARD_ERROR,
    band: tuple[float, float] | None = None,
    number: int = 0,
) -> StationaryLevel:
    """Return the mean level of a scene with a defect of the inner race or of a ball.

    Args:
        accuracy: relative error of the RMS due to the steps that is asked for.
        standard_error: relative standard error of the RMS that is asked for.
        band: frequencies (lo, hi), Hz, in which the RMS is taken; None is the full bandwidth.
        number: of the record among others of the scene: each begins in other phases, and draws its slip anew.

    Raises:
        ValueError: if the scene or an argument is outside what the model describes; the message names it.
    """
    _check(scene, accuracy, standard_error, band)
    return _cached_level(_as_reached(scene), accuracy, standard_error, band, number)


def _as_reached(scene: Scene) -> Scene:
    """Return a scene whose smooth floor is no deeper than a rolling element reaches, which changes nothing.

    Defects of one extent that are all deeper are then one scene.
    """
    defect = scene.defect
    assert defect is not None
    if defect.floor.kind == "rough" and defect.floor.sd > 0.0:
        return scene
    deepest = max(float(np.max(path(path.kinks())[0])) for path in part_paths(scene.bearing, defect))
    depth = deepest / math.cos(scene.bearing.contact_angle)
    return scene if defect.h_d <= depth else replace(scene, defect=replace(defect, h_d=depth * _BEYOND))


@lru_cache(maxsize=4096)
def _cached_level(
    scene: Scene, accuracy: float, standard_error: float, band: tuple[float, float] | None, number: int
) -> StationaryLevel:
    lines = kinematics(scene.bearing, scene.speed)
    cage_turns = cage_turns_of(scene, lines)
    per_turn = steps_in_turn(scene, lines, band)
    first, error = _first_record(placed(scene, number, 0), accuracy, per_turn, cage_turns, band)
    records, needed = [first], _starts(scene, lines, cage_turns)
    most = math.ceil(needed * _MOST_RECORDS * max(1.0, DEFAULT_STANDARD_ERROR / standard_error))
    level = _level(records, error, accuracy, standard_error)
    while first.finite and len(records) < most:
        enough = level.status != "not_converged" and level.rms_se <= standard_error * level.rms
        if enough and len(records) >= needed:
            break
        wanted = min(most, max(needed, 2 * len(records)))
        records += [
            take_record(placed(scene, number, place), first.per_turn, cage_turns, band)
            for place in range(len(records), wanted)
        ]
        level = _level(records, error, accuracy, standard_error)
    return level


def _check(scene: Scene, accuracy: float, standard_error: float, band: tuple[float, float] | None) -> None:
    """Raise a ValueError that names what the model does not describe."""
    defect = scene.defect
    if defect is None or defect.part == "outer" or not defect.moves_balls:
        raise ValueError("a stationary level needs a defect of the inner race or of a ball, with extent and depth")
    check_scene(scene, _EFFECTS)
    for name, value in (("accuracy", accuracy), ("standard_error", standard_error)):
        if not (math.isfinite(value) and value > 0.0):
            raise ValueError(f"{name} must be positive and finite, got {value!r}")
    if band is not None:
        check_band(band)


def _starts(scene: Scene, lines: Kinematics, cage_turns: int) -> int:
    """Return in how many phases records must begin, so that all phases are visited."""
    rate = turn_rate(scene, lines)
    # While the inner race turns once, so many balls pass the load; while the cage turns once, a ball spins so often.
    other = lines.bpfo if rate == lines.speed else lines.bsf
    gap = _widest_gap(other / rate, math.floor(cage_turns * rate / lines.ftf))
    return math.ceil(gap / _WIDEST_GAP)


def _widest_gap(ratio: float, turns: int) -> float:
    """Return the widest gap between the fractional parts of the first multiples of a ratio, on a circle of length 1."""
    visited = np.sort(np.mod(ratio * np.arange(turns), 1.0))
    return float(np.max(np.diff(np.append(visited, visited[0] + 1.0))))


def _first_record(
    scene: Scene, accuracy: float, per_turn: int, cage_turns: int, band: tuple[float, float] | None
) -> tuple[StationaryRecord, float]:
    """Return the first record, and the relative error of its RMS due to the steps, halved where that helps."""
    settling = settling_turns(kinematics(scene.bearing, scene.speed))
    record = take_record(scene, per_turn, cage_turns, band)
    coarse = run_from_rest(scene, per_turn // 2, settling)
    error = _step_error(record.beginning, coarse)
    for _ in range(_HALVINGS):
        if error <= accuracy or not record.finite:
            break
        finer = take_record(scene, 2 * record.per_turn, cage_turns, band)
        better = _step_error(finer.beginning, record.beginning)
        if not better < error:
            break
        helped = better <= 0.5 * error
        record, error = finer, better
        if not helped:
            break
    return record, error


def _step_error(fine: Values, coarse: Values) -> float:
    """Return the relative error of the RMS from the same time with steps and with twice the steps.

    The first quarter, in which both swing from rest, is left out.
    """
    a, b = (math.sqrt(float(np.mean(np.square(wave[len(wave) // 4 :])))) for wave in (fine, coarse))
    if not (math.isfinite(a) and math.isfinite(b)):
        return math.inf
    return _CHANGE_TO_ERROR * abs(a - b) / a if a > 0.0 else 0.0


@dataclass(frozen=True)
class _Fit:
    """Mean square over all phases, its standard error, and its change from early to late turns, m2/s4."""

    power: float
    error: float
    drift: float


def _fit(records: list[StationaryRecord]) -> _Fit:
    """Fit the first harmonics of the phase to the mean squares of the turns, by least squares.

    The standard error of the constant is that of independent residuals, or of the means over two, four ...
    neighbouring ones where it is larger: they may be correlated.
    """
    turns, phase = np.concatenate([r.turns for r in records]), np.concatenate([r.phase for r in records])
    if not np.all(np.isfinite(turns)):
        return _Fit(math.nan, math.nan, math.nan)
    order = next(k for least, k in reversed(_HARMONICS) if len(turns) >= least)
    angles = phase[:, None] * np.arange(1, order + 1)
    columns = np.concatenate((np.ones((len(turns), 1)), np.cos(angles), np.sin(angles)), axis=1)
    inverse = np.linalg.pinv(columns)
    found = inverse @ turns
    left = np.split(turns - columns @ found, np.cumsum([len(r.turns) for r in records])[:-1])
    scale = float(np.linalg.norm(inverse[0])) * math.sqrt(len(turns) / (len(turns) - columns.shape[1]))
    largest, size = 0.0, 1
    while True:
        batches = np.concatenate([r[: len(r) // size * size].reshape(-1, size).mean(axis=1) for r in left])
        if size > 1 and len(batches) < _BATCHES:
            break
        largest = max(largest, scale * math.sqrt(size * float(np.mean(batches**2))))
        size *= 2
    early, late = (float(np.mean(np.concatenate([np.array_split(r, 2)[half] for r in left]))) for half in (0, 1))
    return _Fit(float(found[0]), largest, abs(late - early))


def _level(records: list[StationaryRecord], error: float, accuracy: float, standard_error: float) -> StationaryLevel:
    """Return the level over all records; ``error`` is the relative one of the steps."""
    fit, lines = _fit(records), np.concatenate([r.lines for r in records])
    rms = math.sqrt(max(fit.power, 0.0))
    amplitudes = np.sqrt(lines)
    std = np.std(amplitudes, axis=0, ddof=1) if len(lines) > 1 else np.zeros(HARMONICS)
    status: Status = "not_periodic"
    # The relative errors of a level are half those of its square. Two halves differ with twice the error of the whole.
    if not math.isfinite(rms) or fit.drift > max(8.0 * fit.error, 2.0 * _SAME_LEVEL * fit.power):
        status = "not_converged"
    elif error > accuracy or fit.error > 2.0 * standard_error * fit.power:
        status = "inaccurate"
    return StationaryLevel(
        rms=rms,
        rms_se=fit.error / (2.0 * rms) if rms > 0.0 else 0.0,
        rms_error=error,
        spread=float(np.std(np.sqrt(np.concatenate([r.turns for r in records])), ddof=1)),
        harmonics=np.sqrt(np.mean(lines, axis=0)),
        harmonics_std=std,
        harmonics_se=std / math.sqrt(len(lines)),
        status=status,
        turns=sum(len(r.turns) for r in records),
    )
