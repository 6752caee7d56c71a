"""Numbers in the query of an address."""

from __future__ import annotations

import math
from collections.abc import Mapping

from monitor.web.answers import RequestError

Query = Mapping[str, str]


def optional_number(query: Query, key: str) -> float | None:
    """Return a number, or None where there is none.

    Raises:
        RequestError: 400, it is not one.
    """
    text = query.get(key, "")
    if text == "":
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise RequestError(400, f"{key} must be a number")
    return value


def whole_number(query: Query, key: str, default: int, low: int, high: int) -> int:
    """Return a whole number, brought between two ends.

    Raises:
        RequestError: 400, it is not one.
    """
    value = optional_number(query, key)
    if value is None:
        return default
    if value != math.floor(value):
        raise RequestError(400, f"{key} must be a whole number")
    return int(min(max(value, low), high))
