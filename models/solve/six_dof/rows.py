"""Settled levels of many scenes: defects of one operating point, of which maps are made, and blocks of a life."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from models.solve.response import HARMONICS, STATUSES
from models.solve.simulate import simulate
from models.solve.six_dof.kernels import settled as kernels
from models.solve.six_dof.kernels.lanes import LANES
from models.solve.six_dof.kernels.path import D_HALF
from models.solve.six_dof.lanes import LaneOptions, LaneRunner
from models.solve.six_dof.periodic import effort_for, steering
from models.solve.six_dof.setup import check_scene, defect_arrays, operating_point
from models.words.request import Request

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.scene import Scene


# Blocks of lives: relative error of the RMS due to the steps (rms over scenes), a tenth of the scatter of a block.
_ACCURACY = 2e-3
# Blocks of seven ball periods that are measured where balls slip. Their shortness adds to the scatter of the RMS about
# what a measured block has anyway (1 to 3 % at 2 to 10 mrad), beside which steps in one (1e-3) are good enough.
_SLIP_BLOCKS = 4


@dataclass(frozen=True, eq=False)
class Row:
    """Settled vibration of the casing for defects of several extents, SI units.

    Attributes:
        rms: RMS in the band, m/s2, shape (extents,).
        rms_error: its relative error due to the steps and what is left to settle, estimated, shape (extents,).
        change: relative change of the full-bandwidth RMS by the last period, or expected by the next, shape (extents,).
        settled: where a stable motion was found that repeats, and no other is feared beside it; elsewhere it has to be
            simulated on (models.solve.simulate), and the other fields mean nothing.
        multiplier: largest absolute Floquet multiplier, shape (extents,).
        harmonics: single-sided amplitudes of the first six lines k * bpfo, m/s2, shape (extents, 6).
        harmonics_error: their estimated errors, m/s2, shape (extents, 6).
    """

    rms: NDArray[np.float64]
    rms_error: NDArray[np.float64]
    change: NDArray[np.float64]
    settled: NDArray[np.bool_]
    multiplier: NDArray[np.float64]
    periods: NDArray[np.int64]
    harmonics: NDArray[np.float64]
    harmonics_error: NDArray[np.float64]


def simulate_row(
    scene: Scene,
    extents: NDArray[np.float64],
    *,
    accuracy: float = Request.accuracy,
    steps_per_period: int | None = None,
    tolerance: float | None = None,
    band: tuple[float, float] | None = None,
) -> Row:
    """Return the settled vibration of a scene for several extents of its defect.

    The same as ``models.solve.simulate.simulate`` of each of them, to the digits that the tolerance leaves. The
    interpreter lock is free meanwhile, so that rows can share the cores of a machine as threads.

    Args:
        extents: angular extents, rad, shape (extents,); that of the scene's own defect is not used.
        accuracy, steps_per_period, tolerance, band: as in ``models.solve.simulate.simulate``.

    Raises:
        ValueError: if the scene or an argument is outside what the model describes; the message names it.
    """
    defect = scene.defect
    if defect is None:
        raise ValueError("a row of defects needs a scene with a defect, got None")
    check_scene(scene)
    request = Request(accuracy=accuracy, tolerance=tolerance, steps_per_period=steps_per_period, band=band)
    narrowest, widest = (replace(defect, dphi_d=float(x)) for x in (np.min(extents), np.max(extents)))
    defect_arrays(scene.bearing, [narrowest])
    path, profile = defect_arrays(scene.bearing, [widest])
    healthy = scene.healthy
    steer = steering(healthy)
    found = np.empty((len(extents), kernels.R_LINES + 2 * HARMONICS))
    point, steer = operating_point(healthy), np.eye(12) if steer is None else steer
    effort, rest = effort_for(scene, request), np.zeros((2, 6))
    # From rest each, so that the result of a defect does not depend on its neighbours.
    for extent, place in zip(extents.tolist(), found, strict=True):
        path[:, D_HALF] = 0.5 * extent
        kernels.solve(path if extent > 0.0 else path[:0], profile, point, rest, steer, effort, place)
    return _as_row(found)


def _as_row(found: NDArray[np.float64]) -> Row:
    """Return the kernel's results by name."""
    lines = found[:, kernels.R_LINES :]
    radius = found[:, kernels.R_RADIUS]
    return Row(
        rms=found[:, kernels.R_RMS],
        rms_error=found[:, kernels.R_ERROR],
        change=found[:, kernels.R_CHANGE],
        settled=(found[:, kernels.R_SETTLED] > 0.0) & (radius < 1.0) & (found[:, kernels.R_DOUBTED] == 0.0),
        multiplier=radius,
        periods=found[:, kernels.R_PERIODS].astype(np.int64),
        harmonics=lines[:, :HARMONICS],
        harmonics_error=lines[:, HARMONICS:],
    )


def settled_levels(
    scenes: Sequence[Scene], band: tuple[float, float] | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the RMS in a band (n,) and the amplitudes of BPFO lines 1..6 (n, 6) of scenes, m/s2.

    Scenes with slip must share bearing, rig, clearance and slip; those of one speed are simulated side by side. Those
    that diverge give NaN. The band is in Hz,
    None for the full bandwidth.
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
    row = simulate_row(scene, np.array([defect.dphi_d]), accuracy=_ACCURACY, band=band)
    if row.settled[0]:
        return float(row.rms[0]), row.harmonics[0]
    # Scenes that have not settled are simulated further; some never repeat.
    response = simulate(scene, accuracy=_ACCURACY, band=band)
    if response.status == "not_converged":
        return float("nan"), np.full(HARMONICS, np.nan)
    return response.rms, response.harmonics


def _slipping(
    scenes: Sequence[Scene], band: tuple[float, float] | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Simulate groups of lanes of one speed, each with its own draws."""
    runner = LaneRunner(LaneOptions(slip_blocks=_SLIP_BLOCKS, band=band, instants=False))
    speeds: dict[float, list[int]] = {}
    for i, scene in enumerate(scenes):
        speeds.setdefault(scene.speed, []).append(i)
    groups = [places[i : i + LANES] for places in speeds.values() for i in range(0, len(places), LANES)]
    rms, harmonics = np.empty(len(scenes)), np.empty((len(scenes), HARMONICS))
    for number, places in enumerate(groups):
        found = runner.run([scenes[i] for i in places], number)
        failed = found.status == STATUSES.index("not_converged")
        rms[places] = np.where(failed, np.nan, found.rms)
        harmonics[places] = np.where(failed[:, None], np.nan, found.harmonics)
    return rms, harmonics
