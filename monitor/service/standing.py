"""How a channel stands by now: what its alarms say, and whether it is heard at all."""

from __future__ import annotations

from monitor.health.alarms import BAD_DATA, NO_DATA, machine_state

_REASONS = {
    "normal": "healthy",
    "check_function": "the baseline is being learned",
    "out_of_specification": "how large the damage is cannot be said",
    "maintenance_required": "the final stage has begun, or an alert stands",
    "bad_data": "too many blocks are rejected or flagged",
    "no_data": "no block comes",
    "failure": "the end of life was reached, or a danger stands",
}


def channel_state(condition: str, *, silent: bool, refused: bool) -> tuple[str, str]:
    """Return the state of a channel after NAMUR NE 107 and why, in words.

    Args:
        condition: what the alarm stage made of its blocks.
        silent: whether its blocks stay away.
        refused: whether its latest block was rejected.
    """
    heard = [condition, *([NO_DATA] if silent else []), *([BAD_DATA] if refused else [])]
    state = machine_state(*heard)
    return state, _REASONS[state]
