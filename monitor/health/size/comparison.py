"""The library and the filter beside each other: two models of the same growth, each with an interval of V_eq.

They share the levels, not the errors: the library has lives of other rigs and its laws of growth, the filter the map
and a random growth. Where their intervals have nothing in common, one of them is wrong, and which cannot be told.
"""

from __future__ import annotations

import math
from dataclasses import replace

from monitor.health.size import Damage, EdvStatus


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
