"""Vibration of the casing in the blocks of one simulated life, with or without slip."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from models.bearing import kinematics
from models.dynamics.lanes import LANES, STATUSES, LaneOptions, LaneRunner
from models.dynamics.rows import simulate_row
from models.dynamics.six_dof import steps_for
from models.response import HARMONICS
from models.simulate import simulate, steps_to_resolve

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.scene import Scene

# Relative error of the RMS due to the steps (rms over scenes): a tenth of the scatter of a block.
_ACCURACY = 2e-3
# Blocks of seven ball periods that are measured where balls slip. Their shortness adds to the scatter of the RMS about
# what a measured block has anyway (1 to 3 % at 2 to 10 mrad: benchmarks/lives.py).
_SLIP_BLOCKS = 4


def settled_levels(
    scenes: Sequence[Scene], band: tuple[float, float] | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the RMS in a band (n,) and the amplitudes of BPFO lines 1..6 (n, 6) of scenes, m/s2.

    NaN for scenes that diverged.

    Args:
        scenes: without slip any; with slip those of one bearing, rig, clearance, speed and slip.
        band: Hz, or None for the full bandwidth.
    """
    slip = scenes[0].slip if scenes else None
    if slip is not None and slip.redraws:
        return _slipping(scenes, band)
    rms, harmonics = np.empty(len(scenes)), np.empty((len(scenes), HARMONICS))
    for i, scene in enumerate(scenes):
        rms[i], harmonics[i] = _periodic(scene, band)
    return rms, harmonics


def _periodic(scene: Scene, band: tuple[float, float] | None) -> tuple[float, NDArray[np.float64]]:
    defect = scene.defect
    if defect is None:
        raise ValueError("a block of a life needs a scene with a defect, got None")
    steps = steps_for(scene, _ACCURACY)
    if band is not None:
        steps = max(steps, steps_to_resolve(band[1], 1.0 / kinematics(scene.bearing, scene.speed).bpfo))
    row = simulate_row(scene, np.array([defect.dphi_d]), steps_per_period=steps, band=band)
    if row.settled[0]:
        return float(row.rms[0]), row.harmonics[0]
    # Scenes that have not settled are simulated further; some never repeat.
    response = simulate(scene, steps_per_period=steps, band=band)
    if response.status == "not_converged":
        return float("nan"), np.full(HARMONICS, np.nan)
    return response.rms, response.harmonics


def _slipping(
    scenes: Sequence[Scene], band: tuple[float, float] | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Simulate groups of lanes, each with its own draws."""
    runner = LaneRunner(LaneOptions(slip_blocks=_SLIP_BLOCKS, band=band))
    found = [runner.run(scenes[i : i + LANES], i // LANES) for i in range(0, len(scenes), LANES)]
    failed = np.concatenate([r.status for r in found]) == STATUSES.index("not_converged")
    rms = np.where(failed, np.nan, np.concatenate([r.rms for r in found]))
    return rms, np.where(failed[:, None], np.nan, np.concatenate([r.harmonics for r in found]))
