"""The thesis' first prognostic model (section 5.2.3.1): a tracked defect under another load or speed.

The sizes (dphi_d, h_d)(t) that were tracked under one condition are given to the model under another, and what comes
out is the history of the RMS there. It rests on the damage growing the same under both, so that both end together: it
says how loud a bearing would be under the other condition with this damage, not when it would fail.

The RMS comes from a map, interpolated, or from a simulation of each size; side by side they show what interpolation
costs. A map between whose nodes the RMS rises and falls is the cheaper of the two and the less exact one.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.maps.data import RmsMap
from models.maps.plan import MapPlan

RmsAt = Callable[[float, float], float]
"""RMS (m/s2) of a defect by its extent (rad) and depth (m); NaN where there is none."""


def rms_from_map(rms_map: RmsMap, load: float, speed: float) -> RmsAt:
    """Return the RMS by map interpolation, bilinear in extent and depth, linear in load and speed.

    Args:
        rms_map: the map.
        load: N.
        speed: Hz.

    Raises:
        OutsideMapError: the map does not cover the load or the speed.
    """
    at = rms_map.slice_at(load, speed)
    return lambda dphi_d, h_d: float(at.interpolate(dphi_d, h_d))


def rms_from_model(plan: MapPlan, load: float, speed: float) -> RmsAt:
    """Return the RMS by direct simulation of what a map's plan describes, mean over its floors; needs numba.

    Args:
        plan: bearing, rig, floors and band.
        load: N.
        speed: Hz.
    """
    from models.maps.nodes import scene_at, simulate_point

    def at(dphi_d: float, h_d: float) -> float:
        scenes = (scene_at(plan, load, speed, h_d, dphi_d, seed) for seed in range(plan.floors))
        responses = [simulate_point(plan, scene) for scene in scenes]
        usable = [response.rms for response in responses if response.status != "not_converged"]
        return float(np.mean(usable)) if len(usable) == len(responses) else float("nan")

    return at


def rms_history(dphi_d: ArrayLike, h_d: ArrayLike, rms_at: RmsAt) -> NDArray[np.float64]:
    """Return the history of the RMS under the other condition; each size is asked for once.

    Args:
        dphi_d: tracked extents, shape (n,), rad; NaN where the tracker had none.
        h_d: tracked depths, shape (n,), m.
        rms_at: RMS of a size under the other condition.

    Returns:
        RMS, shape (n,), m/s2; NaN where there was no size or ``rms_at`` has none for it.
    """
    x, y = np.broadcast_arrays(np.asarray(dphi_d, dtype=np.float64), np.asarray(h_d, dtype=np.float64))
    sizes = list(zip(x.tolist(), y.tolist(), strict=True))
    known = {size: rms_at(*size) for size in dict.fromkeys(sizes) if np.isfinite(size[0] + size[1])}
    return np.array([known.get(size, np.nan) for size in sizes], dtype=np.float64)
