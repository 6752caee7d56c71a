"""How a channel and a machine stand, in the words of NAMUR NE 107 and two of our own: no_data and bad_data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

STATES = (
    "normal",
    "check_function",
    "out_of_specification",
    "maintenance_required",
    "bad_data",
    "no_data",
    "failure",
)
"""From the least to the most urgent: of several channels, a machine has the most urgent state."""

_OUTSIDE = frozenset(
    {"above_map", "ambiguous", "outside_conditions", "outside_library", "no_absolute_level", "no_map", "no_library"}
)


def channel_state(known: Mapping[str, Any], *, silent: bool, refused: bool) -> tuple[str, str]:
    """Return the state of a channel and why, in one sentence.

    Args:
        known: ``stage`` and ``edv_status`` of the channel.
        silent: whether its blocks stay away.
        refused: whether its latest block was rejected.
    """
    stage = known["stage"]
    if stage == "end_of_life":
        return "failure", "the end of life was reached"
    if silent:
        return "no_data", "no block has come for too long"
    if refused:
        return "bad_data", "the latest block was rejected"
    if stage == "final":
        if known["edv_status"] in _OUTSIDE:
            return "out_of_specification", f"damaged, but how large it is cannot be said ({known['edv_status']})"
        return "maintenance_required", "damaged: the final stage has begun"
    if stage == "learning":
        return "check_function", "the baseline is being learned"
    return "normal", "healthy"


def worst(states: Iterable[str]) -> str:
    """Return the most urgent of some states; ``no_data`` where there are none."""
    return max(states, key=STATES.index, default="no_data")
