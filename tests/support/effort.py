"""How much of a test to run: ``SPALLWATCH_EFFORT`` is ``quick`` (the default) or ``full``."""

from __future__ import annotations

import os


def effort_count(*, quick: int, full: int) -> int:
    """The number of cases for the effort asked for.

    Args:
        quick: number under ``SPALLWATCH_EFFORT=quick``.
        full: number under ``SPALLWATCH_EFFORT=full``.

    Returns:
        One of the two.

    Raises:
        ValueError: the variable holds another word.
    """
    effort = os.environ.get("SPALLWATCH_EFFORT", "quick")
    if effort not in ("quick", "full"):
        raise ValueError(f"SPALLWATCH_EFFORT must be quick or full, got {effort!r}")
    return quick if effort == "quick" else full
