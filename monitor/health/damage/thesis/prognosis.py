"""The thesis' first prognostic model (section 5.2.3.1): a tracked defect under another load or speed.

The sizes (dphi_d, h_d)(t) tracked under one condition give the history of the RMS under another, assuming that the
damage grows the same under both: it says how high the RMS would be with this damage, not when the bearing would fail.

The RMS comes from a map, interpolated, or from a simulation of each size, which is slower and more exact between nodes.
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
    """Return the RMS by a map, bilinear in the sizes, linear in load (N) and speed (Hz).

    Raises:
        OutsideMapError: the map does not cover the load or the speed.
    """
    at = rms_map.slice_at(load, speed)
    return lambda dphi_d, h_d: float(at.interpolate(dphi_d, h_d))


def rms_from_model(plan: MapPlan, load: float, speed: float) -> RmsAt:
    """Return the RMS by simulation of a map's plan, mean over its floors; needs numba."""
    from models.maps.nodes import scene_at, simulate_point

    def at(dphi_d: float, h_d: float) -> float:
        scenes = (scene_at(plan, load, speed, h_d, dphi_d, seed) for seed in range(plan.floors))
        responses = [simulate_point(plan, scene) for scene in scenes]
        usable = [response.rms for response in responses if response.status != "not_converged"]
        return float(np.mean(usable)) if len(usable) == len(responses) else float("nan")

    return at


def rms_history(dphi_d: ArrayLike, h_d: ArrayLike, rms_at: RmsAt) -> NDArray[np.float64]:
    """Return the RMS under the other condition, shape (n,), m/s2; NaN where there is no size or no RMS.

    Args:
        dphi_d: tracked extents, shape (n,), rad; NaN where the tracker had none.
        h_d: tracked depths, shape (n,), m.
    """
    x, y = np.broadcast_arrays(np.asarray(dphi_d, dtype=np.float64), np.asarray(h_d, dtype=np.float64))
    sizes = list(zip(x.tolist(), y.tolist(), strict=True))
    known = {size: rms_at(*size) for size in dict.fromkeys(sizes) if np.isfinite(size[0] + size[1])}
    return np.array([known.get(size, np.nan) for size in sizes], dtype=np.float64)
