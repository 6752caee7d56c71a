"""The clocks of two sources of one machine against each other."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import pairwise

from streams.dates.drift import span_text
from streams.dates.observed import ClockState
from streams.types.stamps import utc_text

_MAX_SCATTER_S = 300.0
_MIN_APART_S = 900.0
_ZONE_STEP_S = 900.0
"""Zones differ by multiples of a quarter of an hour."""
_AGREE_S = 120.0


def apart_words(one: str, other: str, lags: tuple[float, float]) -> str | None:
    """Return that two clocks are apart, None where they are not.

    Args:
        one, other: names of the sources.
        lags: of another clock, that of the computer, against those of the two, s.
    """
    ahead = lags[0] - lags[1]
    if abs(ahead) < _MIN_APART_S:
        return None
    is_zone = abs(ahead - _ZONE_STEP_S * round(ahead / _ZONE_STEP_S)) <= _AGREE_S
    first, second = (other, one) if ahead > 0.0 else (one, other)
    text = (
        f"times of {first} are {span_text(abs(ahead))} ahead of those of {second}, by the last changes of their files"
    )
    return text + ("; are they of another zone?" if is_zone else "")


def disjoint_words(spans: Mapping[str, tuple[float, float]]) -> Iterable[str]:
    """Yield which sources have no time in common; ``spans``: first and last start of each, s since 1970 UTC."""
    ordered = sorted(spans.items(), key=lambda pair: pair[1])
    for (one, early), (other, late) in pairwise(ordered):
        if early[1] < late[0]:
            yield f"{one} ends at {utc_text(early[1])}, before {other} begins at {utc_text(late[0])}"


def clocks_apart(clocks: Mapping[str, ClockState]) -> dict[str, str]:
    """Return by source that its clock is apart from that of one before it."""
    known: dict[str, float] = {}
    found: dict[str, str] = {}
    for name, clock in clocks.items():
        lag, scatter = clock.lags.get("mtime", (0.0, None))
        if scatter is None or scatter > _MAX_SCATTER_S:
            continue
        words = (apart_words(one, name, (other, lag)) for one, other in known.items())
        text = next((text for text in words if text is not None), None)
        if text is None:
            known[name] = lag
        else:
            found[name] = text
    return found
