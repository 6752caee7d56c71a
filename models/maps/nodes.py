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

from models.response import STATUSES
from models.scene import Defect, Rig, Scene

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.maps.plan import MapPlan
    from models.response import Response

Progress = Callable[[int, int], None]

# Relative error of the RMS that is asked of each node.
MAP_ACCURACY = 2e-3
# A smaller vibration counts as zero, m/s2.
_SILENCE = 1e-12
_UNCERTAIN = ("m_r", "k_c", "c_i", "c_r", "alpha_c", "beta_c")


@dataclass(frozen=True, eq=False)
class StepError:
    """Relative error of the RMS and the lines due to the steps, measured at some nodes of a map."""

    rms: float
    lines: NDArray[np.float64]


def compare_steps(
    coarse: tuple[NDArray[np.float64], NDArray[np.float64]], fine: tuple[NDArray[np.float64], NDArray[np.float64]]
) -> StepError:
    """Return the change by finer steps in RMS, shape (n,), and lines, shape (n, 6), as RMS over the nodes."""
    level = np.maximum(fine[0], _SILENCE)
    rms = np.where(fine[0] > _SILENCE, coarse[0] / level - 1.0, 0.0)
    lines = np.where(fine[0][:, None] > _SILENCE, (coarse[1] - fine[1]) / level[:, None], 0.0)
    return StepError(float(np.sqrt(np.mean(rms**2))), np.sqrt(np.mean(lines**2, axis=0)))


@dataclass(frozen=True, eq=False)
class NodeRow:
    """One floor at one load, speed and depth, for several extents.

    Attributes:
        rms, harmonics: RMS, shape (D,), and lines 1..6 of BPFO, shape (D, 6), m/s2.
        error: relative error of the RMS, estimated: of steps and settling, or the standard error of the mean where it
            does not settle, shape (D,).
        harmonics_error: that of the lines, m/s2, shape (D, 6).
        spread: standard deviation of the RMS from period to period where it does not settle, m/s2, shape (D,).
        status: index into STATUSES, shape (D,).
    """

    rms: NDArray[np.float64]
    harmonics: NDArray[np.float64]
    error: NDArray[np.float64]
    harmonics_error: NDArray[np.float64]
    spread: NDArray[np.float64]
    status: NDArray[np.int64]


def scene_at(plan: MapPlan, load: float, speed: float, h_d: float, dphi_d: float, seed: int = 0) -> Scene:
    """Return the scene of one point of a plan; ``seed`` counts its floors from zero."""
    floor = replace(plan.floor, seed=plan.floor.seed + seed)
    defect = Defect(dphi_d, h_d, floor, plan.position, plan.rows)
    return Scene(speed, load, plan.bearing, plan.rig, defect, plan.clearance, plan.model, slip=plan.slip)


def simulate_point(plan: MapPlan, scene: Scene, factor: int = 1) -> Response:
    """Return one settled scene of a plan, with the accuracy of its nodes divided by ``factor``."""
    from models.simulate import simulate

    # Lines beyond the band and the stored harmonics are not needed.
    lines_to = 0.0 if plan.rms_band is None else plan.rms_band[1]
    steps = None if plan.steps_per_period is None else factor * plan.steps_per_period
    return simulate(
        scene, accuracy=MAP_ACCURACY / factor, steps_per_period=steps, band=plan.rms_band, lines_to=lines_to
    )


def simulate_node_row(
    plan: MapPlan, load: float, speed: float, h_d: float, extents: NDArray[np.float64], seed: int = 0
) -> NodeRow:
    """Return a row of a plan without slip; ``seed`` counts its floors from zero.

    Raises:
        ValueError: if a scene is outside the model.
    """
    from models.dynamics.rows import simulate_row

    scene = scene_at(plan, load, speed, h_d, float(extents[-1]), seed)
    row = simulate_row(
        scene, extents, accuracy=MAP_ACCURACY, steps_per_period=plan.steps_per_period, band=plan.rms_band
    )
    found = NodeRow(
        rms=row.rms.copy(),
        harmonics=row.harmonics.copy(),
        error=row.rms_error + row.change,
        harmonics_error=row.harmonics_error.copy(),
        spread=np.zeros(len(extents)),
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


def nodes_at_random(plan: MapPlan, count: int, seed: int) -> list[tuple[float, float, float, float]]:
    """Return load, speed, h_d and dphi_d of random nodes, without the healthy edges if there are others."""
    rng = np.random.default_rng(seed)
    depths = [h for h in plan.h_d if h > 0.0] or [plan.h_d[0]]
    extents = [x for x in plan.dphi_d if x > 0.0] or [plan.dphi_d[0]]
    axes = (plan.load, plan.speed, depths, extents)
    load, speed, h_d, dphi_d = (np.array(axis)[rng.integers(0, len(axis), count)].tolist() for axis in axes)
    return list(zip(load, speed, h_d, dphi_d, strict=True))


def drawn_rig(plan: MapPlan, number: int) -> Rig:
    """Return draw ``number`` of the plan's rig: log-normal factors, independent of each other, median 1."""
    rng = np.random.default_rng([plan.rig_seed, number])
    sd = np.array([plan.rig_spread] * len(_UNCERTAIN) + [plan.rig_spread_k_r])
    factors = np.exp(sd * rng.standard_normal(len(sd)))
    names = (*_UNCERTAIN, "k_r")
    return replace(plan.rig, **{n: getattr(plan.rig, n) * float(f) for n, f in zip(names, factors, strict=True)})


def rig_scenes(plan: MapPlan) -> int:
    """Return the number of scenes per extent that the spread needs."""
    return plan.rig_draws + min(plan.rig_draws, _floors(plan))


def _floors(plan: MapPlan) -> int:
    return plan.floors if plan.floor.kind == "rough" else 1


def rig_rows(plan: MapPlan, load: float, speed: float, h_d: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the standard deviations over the draws of the RMS, shape (D,), and of the lines, shape (D, 6), m/s2.

    Draw n has the plan's floor n modulo their number.
    """
    plan = replace(plan, slip=None, floors=_floors(plan))
    changes = np.array(list(_rig_changes(plan, load, speed, h_d)))
    spread = np.std(changes, axis=0, ddof=1)
    return spread[:, 0], spread[:, 1:]


def _rig_changes(plan: MapPlan, load: float, speed: float, h_d: float) -> Iterator[NDArray[np.float64]]:
    """Yield RMS and lines of each draw less those of the plan's rig on the same floor, shape (D, 7)."""
    extents = np.array(plan.dphi_d)
    own: dict[int, NDArray[np.float64]] = {}
    for number in range(plan.rig_draws):
        floor = number % plan.floors
        if floor not in own:
            own[floor] = _rig_columns(plan, load, speed, h_d, extents, floor)
        drawn = replace(plan, rig=drawn_rig(plan, number))
        yield _rig_columns(drawn, load, speed, h_d, extents, floor) - own[floor]


def _rig_columns(
    plan: MapPlan, load: float, speed: float, h_d: float, extents: NDArray[np.float64], floor: int
) -> NDArray[np.float64]:
    row = simulate_node_row(plan, load, speed, h_d, extents, floor)
    return np.column_stack((row.rms, row.harmonics))
