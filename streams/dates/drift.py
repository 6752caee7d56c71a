"""A clock against the count of samples, over blocks that follow each other without a gap."""

from __future__ import annotations

from streams.dates.observed import ClockState, TimeObservation

DAY = 86400.0
_MAX_DRIFT = 1e-3
"""Drift that a block bears, as its rate (``_RATE_TOLERANCE`` of the quality)."""
_MIN_BLOCKS = 10


def with_run(state: ClockState, seen: TimeObservation) -> tuple[float, float, tuple[float, float] | None]:
    """Compare a start with the count of samples; return ``run_began``, ``run_counted`` and ``drift`` of the state."""
    last, began, resolution = state.time, state.run_began, seen.resolution
    if last is None or began is None or resolution is None or not state.length:
        return seen.time, 0.0, state.drift
    if abs(seen.time - last - state.length) > 0.01 * state.length + 2.0 * resolution:
        return seen.time, 0.0, state.drift
    counted = state.run_counted + state.length
    longest = state.drift is None or counted >= state.drift[1]
    return began, counted, (seen.time - began - counted, counted) if longest else state.drift


def seconds_ahead(state: ClockState, seen: TimeObservation) -> float:
    """Return by how much the clock is ahead of the count of samples since the latest gap, s."""
    return 0.0 if state.run_began is None else seen.time - state.run_began - state.run_counted


def uncertainty_of(state: ClockState, seen: TimeObservation) -> float | None:
    """Return the uncertainty of a time that is believed, s, None where nothing states how exact it is."""
    resolution = seen.resolution
    if resolution is None:
        return None
    ahead = abs(seconds_ahead(state, seen))
    return resolution + ahead if ahead > 2.0 * resolution else resolution


def drift_doubt(state: ClockState, seen: TimeObservation) -> str | None:
    """Return that a clock drifts by more than a block bears, or None."""
    ahead, counted = seconds_ahead(state, seen), state.run_counted
    if not counted >= _MIN_BLOCKS * seen.length > 0.0:
        return None
    if abs(ahead) <= max(_MAX_DRIFT * counted, 5.0 * (seen.resolution or 0.0)):
        return None
    return f"its clock is {drift_words((ahead, counted))}"


def drift_words(drift: tuple[float, float]) -> str:
    """Return a drift in words: ``ClockState.drift``."""
    ahead, counted = drift
    what = "ahead of" if ahead > 0.0 else "behind"
    return (
        f"{abs(ahead):.3g} s {what} the count of samples after {span_text(counted)} ({1e6 * ahead / counted:+.3g} ppm)"
    )


def span_text(seconds: float) -> str:
    """Return a time in the largest fitting unit."""
    for size, unit in ((365.25 * DAY, "years"), (DAY, "days"), (3600.0, "h"), (60.0, "min")):
        if abs(seconds) >= 2.0 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"
