"""The equivalent damaged volume (EDV), tracked from the RMS as in section 5.2.2 of the thesis.

Each block's RMS, smoothed by a trailing mean, is looked up in an RMS map: of all defects (dphi_d, h_d) with that RMS,
the one with the least volume V_eq = r_o dphi_d h_d (Eqs. 90 and 91) is taken. Neither size may shrink afterwards,
unless no point is left; the search then goes back by one grid step at a time.

RMS depends weakly on the extent of a defect: the result is the least volume that explains the RMS, kept by a ratchet,
not a measurement. See ``docs/explanation/tracking.md``.

:func:`rms_history` is the first prognostic model (section 5.2.3.1): how high the RMS would be with the tracked defect
under another load or speed, if the damage grows the same under both; it does not say when the bearing would fail.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from monitor.health.codec import StoredState
from monitor.health.size import Damage, EdvStatus
from monitor.health.size.level_set import LevelMap, LevelPoint, least_volume, step_back, widened_steps

if TYPE_CHECKING:
    from models.maps.data import RmsMap
    from models.maps.plan import MapPlan

RmsAt = Callable[[float, float], float]
"""RMS (m/s2) of a defect by its extent (rad) and depth (m); NaN where there is none."""


@dataclass(frozen=True)
class EdvSettings:
    """Settings of the thesis' tracker.

    Attributes:
        smoothing_blocks: length of the trailing mean of the RMS (section 5.4.1: 6).
        stop_outside_map: end the tracking for good at the first RMS outside the map (step 3 of the thesis); otherwise
            the tracking goes on when the RMS is back.
    """

    smoothing_blocks: int = 6
    stop_outside_map: bool = False

    def __post_init__(self) -> None:
        """Raise ValueError for a mean over no block."""
        if self.smoothing_blocks < 1:
            raise ValueError(f"smoothing_blocks must be 1 or more, got {self.smoothing_blocks}")


@dataclass(frozen=True)
class EdvState(StoredState):
    """State of the tracker.

    Attributes:
        window: RMS of the latest blocks since t_fs, oldest first, at most ``smoothing_blocks``, m/s2.
        dphi_d: least extent still allowed, rad, or None before the first point.
        h_d: least depth still allowed, m, or None before the first point.
        stopped: the status that ended the tracking, or None.
    """

    VERSIONS = (1,)

    window: tuple[float, ...] = ()
    dphi_d: float | None = None
    h_d: float | None = None
    stopped: EdvStatus | None = None
    version: int = VERSIONS[-1]


def step(
    state: EdvState, rms: float, *, map_slice: LevelMap | None, settings: EdvSettings | None = None
) -> tuple[EdvState, Damage]:
    """Track one block (steps 2 to 8 of section 5.2.2).

    The mean is over the blocks that reached the tracker since t_fs, the present one included; a block outside the map
    enters the mean only.

    Args:
        state: ``EdvState()`` at t_fs.
        rms: RMS of the block, m/s2, in the band of the map; negative or not finite it is ``bad_block``.
        map_slice: the map at the block's load and speed, or None where there is none.
    """
    settings = settings or EdvSettings()
    if not (math.isfinite(rms) and rms >= 0):
        return state, Damage(EdvStatus.BAD_BLOCK)
    if map_slice is None:
        return state, Damage(EdvStatus.NO_MAP)
    window = (*state.window, float(rms))[-settings.smoothing_blocks :]
    smoothed = math.fsum(window) / len(window)
    if state.stopped is not None:
        return replace(state, window=window), Damage(state.stopped, rms_smoothed=smoothed)
    point, status = _find(map_slice, smoothed, state)
    if point is None:
        stopped = status if settings.stop_outside_map else None
        return replace(state, window=window, stopped=stopped), Damage(status, rms_smoothed=smoothed)
    advanced = replace(state, window=window, dphi_d=point.dphi_d, h_d=point.h_d)
    return advanced, Damage(status, v_eq=point.v_eq, dphi_d=point.dphi_d, h_d=point.h_d, rms_smoothed=smoothed)


def _find(map_slice: LevelMap, level: float, state: EdvState) -> tuple[LevelPoint | None, EdvStatus]:
    """Return the point of Eq. 91 in the allowed quadrant, or in its least widening that has one (step 7)."""
    if level < map_slice.rms_min - map_slice.tolerance:
        return None, EdvStatus.BELOW_MAP
    if level > map_slice.rms_max + map_slice.tolerance:
        return None, EdvStatus.ABOVE_MAP
    dphi_from = float(map_slice.dphi_d[0]) if state.dphi_d is None else state.dphi_d
    h_from = float(map_slice.h_d[0]) if state.h_d is None else state.h_d
    point = least_volume(map_slice, level, dphi_from, h_from)
    if point is not None:
        return point, EdvStatus.OK
    steps = widened_steps(map_slice, level, dphi_from, h_from)
    if steps is None:
        return None, EdvStatus.NO_MAP
    for count in (steps, steps + 1, map_slice.rms.size):
        dphi_back = step_back(map_slice.dphi_d, dphi_from, count)
        h_back = step_back(map_slice.h_d, h_from, count)
        point = least_volume(map_slice, level, dphi_back, h_back)
        if point is not None:
            return point, EdvStatus.WIDENED
    return None, EdvStatus.NO_MAP


def rms_from_map(rms_map: RmsMap, load: float, speed: float) -> RmsAt:
    """Return the RMS by a map, bilinear in the sizes, linear in load (N) and speed (Hz).

    Raises:
        OutsideMapError: the map does not cover the load or the speed.
    """
    at = rms_map.slice_at(load, speed)
    return lambda dphi_d, h_d: float(at.interpolate(dphi_d, h_d))


def rms_from_model(plan: MapPlan, load: float, speed: float) -> RmsAt:
    """Return the RMS by simulation of a map's plan, mean over its floors; needs numba.

    It is slower than a map, and more exact between its nodes.
    """
    from models.maps.nodes import point_level

    def at(dphi_d: float, h_d: float) -> float:
        levels = [point_level(plan, (load, speed, h_d, dphi_d), seed) for seed in range(plan.floors)]
        usable = [rms for rms, status in levels if status != "not_converged"]
        return float(np.mean(usable)) if len(usable) == len(levels) else float("nan")

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
