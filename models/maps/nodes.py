"""Nodes of RMS maps, one row along dphi_d at a time, and their spread over uncertain parameters of the rig.

Rigs are drawn around the plan's and compared with it on the same floor, which separates the spread over parameters
(``rms_rig_std``) from that over floors (``rms_std``), and without slip, whose random error would hide the spread. The
simulation, and numba with it, is imported when it is run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from models.machine.rig import Rig
from models.machine.scene import Scene
from models.maps.plan import MAP_ACCURACY, scene_at
from models.solve.response import HARMONICS, STATUSES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.rig import RigParameters
    from models.maps.plan import MapPlan
    from models.solve.response import Response, Status
    from models.solve.six_dof.stationary import StationaryLevel

Progress = Callable[[int, int], None]

# Bytes of a row beside the program, at most.
ROW_MEMORY = 64_000_000
# Seconds of a scene of a row at this speed and above, Hz, and of one by another model; roughly.
_SCENE_SECONDS, _QUICK_SPEED, _MODEL_SECONDS = 4e-4, 20.0, 0.1
BATCH_SECONDS = 0.5
"""Work in a chunk of a batch that the next one waits for."""
# A smaller vibration counts as zero, m/s2.
_SILENCE = 1e-12
_UNCERTAIN = ("m_r", "k_c", "c_i", "c_r", "alpha_c", "beta_c")


@dataclass(frozen=True, eq=False)
class NodeStepError:
    """Relative error of the RMS and the lines due to the steps, measured at some nodes of a map."""

    rms: float
    lines: NDArray[np.float64]


def compare_steps(
    coarse: tuple[NDArray[np.float64], NDArray[np.float64]], fine: tuple[NDArray[np.float64], NDArray[np.float64]]
) -> NodeStepError:
    """Return the change by finer steps in RMS, shape (n,), and lines, shape (n, 6), as RMS over the nodes."""
    level = np.maximum(fine[0], _SILENCE)
    rms = np.where(fine[0] > _SILENCE, coarse[0] / level - 1.0, 0.0)
    lines = np.where(fine[0][:, None] > _SILENCE, (coarse[1] - fine[1]) / level[:, None], 0.0)
    return NodeStepError(float(np.sqrt(np.mean(rms**2))), np.sqrt(np.mean(lines**2, axis=0)))


@dataclass(frozen=True, eq=False)
class NodeRow:
    """One floor at one load, speed and depth, for several extents.

    Attributes:
        rms, harmonics: RMS, shape (D,), and lines 1..6 of BPFO, shape (D, 6), m/s2.
        error: relative error of the RMS, estimated: of steps and settling, or the standard error of the mean where it
            does not settle, shape (D,).
        harmonics_error: that of the lines, m/s2, shape (D, 6).
        spread: standard deviation of the RMS from period to period where it does not settle, or from turn to turn of
            a defect that turns, m/s2, shape (D,).
        se, harmonics_std, harmonics_se: standard error of the RMS, and scatter and standard error of the lines, as
            means over the turns of such a defect, m/s2; zero for the outer race, shapes (D,), (D, 6) and (D, 6).
        status: index into STATUSES, shape (D,).
    """

    rms: NDArray[np.float64]
    harmonics: NDArray[np.float64]
    error: NDArray[np.float64]
    harmonics_error: NDArray[np.float64]
    spread: NDArray[np.float64]
    se: NDArray[np.float64]
    harmonics_std: NDArray[np.float64]
    harmonics_se: NDArray[np.float64]
    status: NDArray[np.int64]

    @classmethod
    def zeros(cls, count: int) -> NodeRow:
        """Return a row of ``count`` extents to be filled in."""

        def levels() -> NDArray[np.float64]:
            return np.zeros(count)

        def lines() -> NDArray[np.float64]:
            return np.zeros((count, HARMONICS))

        return cls(
            rms=levels(),
            harmonics=lines(),
            error=levels(),
            harmonics_error=lines(),
            spread=levels(),
            se=levels(),
            harmonics_std=lines(),
            harmonics_se=lines(),
            status=np.zeros(count, dtype=np.int64),
        )


def scene_seconds(plan: MapPlan) -> float:
    """Return roughly how long a scene of a row takes, s."""
    if plan.model != Rig.model:
        return _MODEL_SECONDS
    return _SCENE_SECONDS * max(1.0, _QUICK_SPEED / min(plan.speed))


def simulate_point(plan: MapPlan, scene: Scene, factor: int = 1) -> Response:
    """Return one settled scene of a plan, with the accuracy of its nodes divided by ``factor``."""
    from models.solve.simulate import simulate

    # Lines beyond the band and the stored harmonics are not needed.
    lines_to = 0.0 if plan.rms_band is None else plan.rms_band[1]
    steps = None if plan.steps_per_period is None else factor * plan.steps_per_period
    return simulate(
        scene, accuracy=MAP_ACCURACY / factor, steps_per_period=steps, band=plan.rms_band, lines_to=lines_to
    )


def point_level(
    plan: MapPlan, point: tuple[float, float, float, float], seed: int = 0, factor: int = 1
) -> tuple[float, Status]:
    """Return the RMS at one point (load, speed, h_d, dphi_d) on one floor, m/s2, and its status.

    Accuracy and standard error are those of the nodes divided by ``factor``.
    """
    if plan.model != Rig.model:
        from models.maps.model_nodes import model_level

        other = model_level(plan, point, seed, factor)
        return other.rms, other.status
    if plan.part == "outer" or 0.0 in point[2:]:
        response = simulate_point(_as_outer(plan), scene_at(_as_outer(plan), *point, seed), factor)
        return response.rms, response.status
    level = _stationary_level(plan, point, seed, factor)
    return level.rms, level.status


def _as_outer(plan: MapPlan) -> MapPlan:
    """Return a plan in which a healthy bearing is one that repeats, whatever part the map is of."""
    return plan if plan.part == "outer" else replace(plan, part="outer", slip=None)


def _stationary_level(
    plan: MapPlan, point: tuple[float, float, float, float], seed: int, factor: int = 1
) -> StationaryLevel:
    from models.solve.six_dof.stationary import DEFAULT_STANDARD_ERROR, stationary_level

    return stationary_level(
        scene_at(plan, *point, seed),
        accuracy=MAP_ACCURACY / factor,
        standard_error=DEFAULT_STANDARD_ERROR / factor,
        band=plan.rms_band,
        number=seed,
    )


def simulate_node_row(
    plan: MapPlan, load: float, speed: float, h_d: float, extents: NDArray[np.float64], seed: int = 0
) -> NodeRow:
    """Return a row of a plan, without slip on the outer race; ``seed`` counts its floors from zero.

    Raises:
        ValueError: if a scene is outside the model.
    """
    if plan.model != Rig.model:
        return _model_row(plan, load, speed, h_d, extents, seed)
    if plan.part == "outer":
        return _periodic_row(plan, load, speed, h_d, extents, seed)
    return _stationary_row(plan, load, speed, h_d, extents, seed)


def _model_row(
    plan: MapPlan, load: float, speed: float, h_d: float, extents: NDArray[np.float64], seed: int
) -> NodeRow:
    """Return a row of a plan; nodes without damage are those of the healthy bearing, simulated once."""
    from models.maps.model_nodes import model_level

    found = NodeRow.zeros(len(extents))
    healthy = None
    for d, extent in enumerate(extents.tolist()):
        if extent > 0.0 and h_d > 0.0:
            level = model_level(plan, (load, speed, h_d, extent), seed)
        else:
            healthy = level = healthy or model_level(plan, (load, speed, 0.0, 0.0), seed)
        found.rms[d], found.se[d], found.spread[d] = level.rms, level.se, level.spread
        found.error[d] = level.error if level.status != "not_converged" else 1.0
        found.harmonics[d] = level.harmonics
        # The steps change a line by no more than the level, in proportion.
        found.harmonics_error[d] = found.error[d] * level.rms
        found.status[d] = STATUSES.index(level.status)
    return found


def _periodic_row(
    plan: MapPlan, load: float, speed: float, h_d: float, extents: NDArray[np.float64], seed: int
) -> NodeRow:
    from models.solve.six_dof.rows import simulate_row

    scene = scene_at(plan, load, speed, h_d, float(extents[-1]), seed)
    row = simulate_row(
        scene, extents, accuracy=MAP_ACCURACY, steps_per_period=plan.steps_per_period, band=plan.rms_band
    )
    found = NodeRow(
        rms=row.rms.copy(),
        harmonics=row.harmonics.copy(),
        error=row.rms_error.copy(),
        harmonics_error=row.harmonics_error.copy(),
        spread=np.zeros(len(extents)),
        se=np.zeros(len(extents)),
        harmonics_std=np.zeros_like(row.harmonics),
        harmonics_se=np.zeros_like(row.harmonics),
        status=np.where(row.rms_error <= MAP_ACCURACY, 0, STATUSES.index("inaccurate")).astype(np.int64),
    )
    # Scenes that have not settled are simulated further; some never repeat.
    for d in np.flatnonzero(~row.settled):
        response = simulate_point(plan, scene_at(plan, load, speed, h_d, float(extents[d]), seed))
        found.rms[d], found.harmonics[d], found.spread[d] = response.rms, response.harmonics, response.spread
        found.error[d] = response.rms_error if response.status != "not_converged" else 1.0
        found.harmonics_error[d] = np.nan_to_num(response.harmonics_error)
        found.status[d] = STATUSES.index(response.status)
    return found


def _stationary_row(
    plan: MapPlan, load: float, speed: float, h_d: float, extents: NDArray[np.float64], seed: int
) -> NodeRow:
    """Return a row over a part that turns; nodes without damage are those of the healthy bearing, without lines."""
    damaged = (extents > 0.0) & (h_d > 0.0)
    found = NodeRow.zeros(len(extents))
    if not np.all(damaged):
        healthy = _periodic_row(_as_outer(plan), load, speed, 0.0, np.zeros(1), 0)
        for name in ("rms", "error", "spread", "status"):
            getattr(found, name)[~damaged] = getattr(healthy, name)[0]
    for d in np.flatnonzero(damaged):
        level = _stationary_level(plan, (load, speed, h_d, float(extents[d])), seed)
        found.rms[d], found.se[d], found.spread[d] = level.rms, level.rms_se, level.spread
        found.error[d] = level.rms_error if level.status != "not_converged" else 1.0
        found.harmonics[d], found.harmonics_std[d] = level.harmonics, level.harmonics_std
        found.harmonics_se[d] = level.harmonics_se
        # The steps change a line by no more than the level, in proportion.
        found.harmonics_error[d] = found.error[d] * level.rms
        found.status[d] = STATUSES.index(level.status)
    return found


def nodes_at_random(plan: MapPlan, count: int, seed: int) -> list[tuple[float, float, float, float]]:
    """Return load, speed, h_d and dphi_d of random nodes, without the healthy edges if there are others."""
    rng = np.random.default_rng(seed)
    depths = [h for h in plan.h_d if h > 0.0] or [plan.h_d[0]]
    extents = [x for x in plan.dphi_d if x > 0.0] or [plan.dphi_d[0]]
    axes = (plan.load, plan.speed, depths, extents)
    load, speed, h_d, dphi_d = (np.array(axis)[rng.integers(0, len(axis), count)].tolist() for axis in axes)
    return list(zip(load, speed, h_d, dphi_d, strict=True))


def drawn_rig(plan: MapPlan, number: int) -> RigParameters:
    """Return draw ``number`` of the plan's rig: of its posterior, or independent log-normal factors of median 1."""
    if plan.rig_posterior is not None and isinstance(plan.rig, Rig):
        return plan.rig_posterior.rig(plan.rig, number)
    rng = np.random.default_rng([plan.rig_seed, number])
    names, sd = plan.rig.uncertain, np.full(len(plan.rig.uncertain), plan.rig_spread)
    if plan.model == Rig.model:
        names = (*_UNCERTAIN, "k_r")
        sd = np.array([plan.rig_spread] * len(_UNCERTAIN) + [plan.rig_spread_k_r])
    if plan.rig_spread_k_c is not None:
        sd[names.index("k_c")] = plan.rig_spread_k_c
    factors = np.exp(sd * rng.standard_normal(len(sd)))
    return replace(plan.rig, **{n: getattr(plan.rig, n) * float(f) for n, f in zip(names, factors, strict=True)})


def rig_scenes(plan: MapPlan) -> int:
    """Return the number of scenes per extent that the spread needs."""
    return plan.rig_draws + min(plan.rig_draws, _floors(plan))


def _floors(plan: MapPlan) -> int:
    return plan.floors if plan.floor.kind == "rough" else 1


@dataclass(frozen=True, eq=False)
class RigSpread:
    """What the draws of the rig change in one row.

    Attributes:
        rms, lines: standard deviations over the draws, m/s2, shapes (D,) and (D, 6).
        logarithms: change of the logarithm of RMS and lines, mean over the damaged nodes, shape (draws, 7); NaN where
            none is damaged.
    """

    rms: NDArray[np.float64]
    lines: NDArray[np.float64]
    logarithms: NDArray[np.float64]


def rig_rows(plan: MapPlan, load: float, speed: float, h_d: float) -> RigSpread:
    """Return what the draws of the rig change in a row.

    The standard deviations of a posterior are about the values of the plan's rig, which is not its mean. Draw n has the
    plan's floor n modulo their number.
    """
    plan = replace(plan, slip=None, floors=_floors(plan))
    drawn, own = (np.array(rows) for rows in zip(*_rig_pairs(plan, load, speed, h_d), strict=True))
    changes = drawn - own
    about_own = plan.rig_posterior is not None
    spread = np.sqrt(np.mean(changes**2, axis=0)) if about_own else np.std(changes, axis=0, ddof=1)
    damaged = (np.array(plan.dphi_d) > 0.0) & (h_d > 0.0)
    logarithms = np.full((len(drawn), 1 + HARMONICS), np.nan)
    if np.any(damaged):
        ratios = np.maximum(drawn[:, damaged], _SILENCE) / np.maximum(own[:, damaged], _SILENCE)
        logarithms = np.mean(np.log(ratios), axis=1)
    return RigSpread(spread[:, 0], spread[:, 1:], logarithms)


def _rig_pairs(
    plan: MapPlan, load: float, speed: float, h_d: float
) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Yield RMS and lines of each draw, and those of the plan's rig on the same floor, shape (D, 7) each."""
    extents = np.array(plan.dphi_d)
    own: dict[int, NDArray[np.float64]] = {}
    for number in range(plan.rig_draws):
        floor = number % plan.floors
        if floor not in own:
            own[floor] = _rig_columns(plan, load, speed, h_d, extents, floor)
        drawn = replace(plan, rig=drawn_rig(plan, number))
        if plan.rig_posterior is not None:
            drawn = replace(drawn, clearance=plan.rig_posterior.clearance(plan.clearance, number))
        yield _rig_columns(drawn, load, speed, h_d, extents, floor), own[floor]


def _rig_columns(
    plan: MapPlan, load: float, speed: float, h_d: float, extents: NDArray[np.float64], floor: int
) -> NDArray[np.float64]:
    row = simulate_node_row(plan, load, speed, h_d, extents, floor)
    return np.column_stack((row.rms, row.harmonics))
