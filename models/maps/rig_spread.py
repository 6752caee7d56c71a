"""Spread of a map over uncertain parameters of the rig.

Rigs are drawn around the plan's, and each is compared with the plan's own rig on the same floor, which separates the
spread over parameters (``rms_rig_std``) from that over floors (``rms_std``). The mean is that of the plan's rig. Draws
are simulated without slip, whose random error would hide the spread.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from models.maps.nodes import simulate_node_row

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.maps.plan import MapPlan
    from models.scene import Rig

UNCERTAIN = ("m_r", "k_c", "c_i", "c_r", "alpha_c", "beta_c")


def drawn_rig(plan: MapPlan, number: int) -> Rig:
    """Return draw ``number`` of the plan's rig: log-normal factors, independent of each other, median 1."""
    rng = np.random.default_rng([plan.rig_seed, number])
    sd = np.array([plan.rig_spread] * len(UNCERTAIN) + [plan.rig_spread_k_r])
    factors = np.exp(sd * rng.standard_normal(len(sd)))
    names = (*UNCERTAIN, "k_r")
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
    changes = np.array(list(_changes(plan, load, speed, h_d)))
    spread = np.std(changes, axis=0, ddof=1)
    return spread[:, 0], spread[:, 1:]


def _changes(plan: MapPlan, load: float, speed: float, h_d: float) -> Iterator[NDArray[np.float64]]:
    """Yield RMS and lines of each draw less those of the plan's rig on the same floor, shape (D, 7)."""
    extents = np.array(plan.dphi_d)
    own: dict[int, NDArray[np.float64]] = {}
    for number in range(plan.rig_draws):
        floor = number % plan.floors
        if floor not in own:
            own[floor] = _columns(plan, load, speed, h_d, extents, floor)
        drawn = replace(plan, rig=drawn_rig(plan, number))
        yield _columns(drawn, load, speed, h_d, extents, floor) - own[floor]


def _columns(
    plan: MapPlan, load: float, speed: float, h_d: float, extents: NDArray[np.float64], floor: int
) -> NDArray[np.float64]:
    row = simulate_node_row(plan, load, speed, h_d, extents, floor)
    return np.column_stack((row.rms, row.harmonics))
