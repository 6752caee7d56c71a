"""The equivalent damaged volume (EDV), tracked from the RMS as in section 5.2.2 of the thesis.

Each block's RMS, smoothed by a trailing mean, is looked up in an RMS map: of all defects (dphi_d, h_d) with that RMS,
the one with the least volume V_eq = r_o dphi_d h_d (Eqs. 90 and 91) is taken. Neither size may shrink afterwards,
unless no point is left; the search then goes back by one grid step at a time.

RMS depends weakly on the extent of a defect: the result is the least volume that explains the RMS, kept by a ratchet,
not a measurement. See ``docs/explanation/tracking.md``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

from monitor.health.damage.thesis.level_set import LevelMap, LevelPoint, least_volume, step_back, widened_steps

STATE_VERSION = 1


class EdvStatus(StrEnum):
    """Outcome of one block.

    Only ``ok`` and ``widened`` carry a V_eq; with ``widened`` the search went back, so V_eq may be lower than before.
    ``below_map`` and ``above_map``: no defect of the map has this RMS. The others are verdicts of earlier stages,
    except ``no_map``, which is also given where a hole of the map covers the level.
    """

    OK = "ok"
    WIDENED = "widened"
    BELOW_MAP = "below_map"
    ABOVE_MAP = "above_map"
    NO_MAP = "no_map"
    NOT_FINAL_STAGE = "not_final_stage"
    BAD_BLOCK = "bad_block"
    NO_ABSOLUTE_LEVEL = "no_absolute_level"
    OUTSIDE_CONDITIONS = "outside_conditions"


GATES = frozenset(
    {
        EdvStatus.NO_MAP,
        EdvStatus.NOT_FINAL_STAGE,
        EdvStatus.BAD_BLOCK,
        EdvStatus.NO_ABSOLUTE_LEVEL,
        EdvStatus.OUTSIDE_CONDITIONS,
    }
)
"""Verdicts of earlier stages that keep a block from the tracker."""


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
class EdvState:
    """State of the tracker.

    Attributes:
        window: RMS of the latest blocks since t_fs, oldest first, at most ``smoothing_blocks``, m/s2.
        dphi_d: least extent still allowed, rad, or None before the first point.
        h_d: least depth still allowed, m, or None before the first point.
        stopped: the status that ended the tracking, or None.
    """

    window: tuple[float, ...] = ()
    dphi_d: float | None = None
    h_d: float | None = None
    stopped: EdvStatus | None = None
    version: int = STATE_VERSION

    def to_dict(self) -> dict[str, Any]:
        """Return the state as plain values for JSON."""
        return {**asdict(self), "window": list(self.window)}

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> EdvState:
        """Restore a state written by :meth:`to_dict`.

        Raises:
            ValueError: the state has another version.
        """
        if stored.get("version") != STATE_VERSION:
            raise ValueError(f"edv state: version {STATE_VERSION} expected, got {stored.get('version')!r}")
        stopped = stored["stopped"]
        return cls(
            window=tuple(stored["window"]),
            dphi_d=stored["dphi_d"],
            h_d=stored["h_d"],
            stopped=None if stopped is None else EdvStatus(stopped),
        )


@dataclass(frozen=True)
class EdvResult:
    """Damage after one block; NaN wherever ``status`` says that there is no value.

    Attributes:
        rms_smoothed: trailing mean of the RMS, m/s2.
        dphi_d: extent of the equivalent defect, rad.
        h_d: its depth, m.
        v_eq: equivalent damaged volume per width, m2 (1 mm3/mm is 1e-6 m2).
    """

    rms_smoothed: float
    dphi_d: float
    h_d: float
    v_eq: float
    status: EdvStatus


def step(
    state: EdvState,
    rms: float,
    *,
    map_slice: LevelMap | None,
    settings: EdvSettings | None = None,
    gate: EdvStatus | None = None,
) -> tuple[EdvState, EdvResult]:
    """Track one block (steps 2 to 8 of section 5.2.2).

    The mean is over the blocks that reached the tracker since t_fs, the present one included. A gated block leaves the
    state unchanged; one outside the map enters the mean only.

    Args:
        state: ``EdvState()`` at t_fs.
        rms: RMS of the block, m/s2, in the band of the map.
        map_slice: the map at the block's load and speed, or None where there is none.
        gate: verdict of an earlier stage that keeps this block out (one of ``GATES``), or None.

    Returns:
        The next state and the block's result. An ``rms`` that is negative or not finite is ``bad_block``.

    Raises:
        ValueError: ``gate`` is not one of ``GATES``.
    """
    settings = settings or EdvSettings()
    if gate is not None and gate not in GATES:
        raise ValueError(f"gate must be one of {sorted(GATES)} or None, got {gate!r}")
    if gate is None and not (math.isfinite(rms) and rms >= 0):
        gate = EdvStatus.BAD_BLOCK
    if gate is None and map_slice is None:
        gate = EdvStatus.NO_MAP
    if gate is not None or map_slice is None:
        return state, _without_point(math.nan, gate or EdvStatus.NO_MAP)

    window = (*state.window, float(rms))[-settings.smoothing_blocks :]
    smoothed = math.fsum(window) / len(window)
    if state.stopped is not None:
        return _remember(state, window), _without_point(smoothed, state.stopped)
    point, status = _find(map_slice, smoothed, state)
    if point is None:
        stopped = status if settings.stop_outside_map else None
        return _remember(state, window, stopped), _without_point(smoothed, status)
    advanced = EdvState(window=window, dphi_d=point.dphi_d, h_d=point.h_d)
    return advanced, EdvResult(smoothed, point.dphi_d, point.h_d, point.v_eq, status)


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


def _remember(state: EdvState, window: tuple[float, ...], stopped: EdvStatus | None = None) -> EdvState:
    """Return the state with a new window, stopped where ``stopped`` says so."""
    return EdvState(window=window, dphi_d=state.dphi_d, h_d=state.h_d, stopped=state.stopped or stopped)


def _without_point(smoothed: float, status: EdvStatus) -> EdvResult:
    return EdvResult(smoothed, math.nan, math.nan, math.nan, status)
