"""What may be claimed of V_eq and TT on the scale of a rig that is not calibrated.

Such a V_eq is only comparable with other values of the same channel, so that it is related to its first value, and a
threshold in m2 has no meaning. Methods do not know of this: their outputs are marked after them.

The library and the filter beside each other: two models of the same growth, each with an interval of V_eq.

They share the levels, not the errors: the library has lives of other rigs and its laws of growth, the filter the map
and a random growth. Where their intervals have nothing in common, one of them is wrong, and which cannot be told.
"""

from __future__ import annotations

import math
from dataclasses import replace

from monitor.health.size import Damage, EdvStatus, Remaining, TtStatus

_COMPARED = frozenset(
    {TtStatus.OK, TtStatus.ALREADY_CROSSED, TtStatus.BEYOND_HORIZON, TtStatus.CROSSING_IN_PAST, TtStatus.CONCAVE}
)
"""Statuses that say where V_eq or its curve lies against the threshold."""


def relate(first: float | None, damage: Damage) -> tuple[float | None, Damage]:
    """Return the first tracked V_eq, m2, and the damage with V_eq as a multiple of it.

    ``first`` is None before the first positive value, which then becomes it.
    """
    if first is None:
        first = damage.v_eq if damage.v_eq > 0.0 and math.isfinite(damage.v_eq) else None
    return first, damage if first is None else replace(damage, v_eq_relative=damage.v_eq / first)


def mark_volume(damage: Damage) -> Damage:
    """Return the damage of an uncalibrated rig: ``uncalibrated`` in place of ``ok``, other statuses as they are."""
    return replace(damage, status=EdvStatus.UNCALIBRATED) if damage.status is EdvStatus.OK else damage


def mark_forecast(found: Remaining, *, issued: bool) -> Remaining:
    """Return the forecast of an uncalibrated rig.

    Where it is ``issued`` all the same, ``uncalibrated`` takes the place of ``ok``. Else every verdict that compares
    V_eq with the threshold becomes ``uncalibrated`` without values; other statuses stay.
    """
    if issued:
        return replace(found, status=TtStatus.UNCALIBRATED) if found.status is TtStatus.OK else found
    return Remaining(found.threshold, TtStatus.UNCALIBRATED) if found.status in _COMPARED else found


def beside(library: Damage, tracked: Damage) -> Damage:
    """Return V_eq of the library, with that of the filter (``tracked``) beside it.

    Where the intervals have nothing in common, the wider (in the logarithm) is issued as ``ambiguous``. Where the named
    part is not that of the library, the filter's V_eq on the map of that part is issued.
    """
    issued = library
    if library.status is EdvStatus.NOT_THIS_PART and tracked.v_eq > 0.0:
        issued = tracked
    elif _apart(library, tracked):
        issued = replace(max(library, tracked, key=_width), status=EdvStatus.AMBIGUOUS)
    return replace(
        issued,
        p_no_growth=library.p_no_growth if math.isfinite(library.p_no_growth) else tracked.p_no_growth,
        v_eq_filter=tracked.v_eq,
        v_eq_filter_lower=tracked.v_eq_lower,
        v_eq_filter_upper=tracked.v_eq_upper,
    )


def _apart(one: Damage, other: Damage) -> bool:
    # False where either has no interval.
    return one.v_eq_upper < other.v_eq_lower or other.v_eq_upper < one.v_eq_lower


def _width(damage: Damage) -> float:
    return math.log(damage.v_eq_upper / damage.v_eq_lower)
