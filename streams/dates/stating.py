"""What states the time of a file, and which other times of it are known."""

from __future__ import annotations

from streams.types.samples import Samples
from streams.types.stamps import Stamp, read_stamp, repeated_by, resolution_of, utc_text
from streams.types.times import TimeSource, TimeStatement

_SKIPPED_S = 3600.0
"""Usual length of what is left out of local time in spring."""
COUNTED = TimeStatement("count")
"""Of a count: no clock says how exact it is."""
_STAMPS: tuple[TimeSource, ...] = ("name", "name_local", "header", "header_local", "folder")
_MINUTE, _QUARTER, _LONGEST_OFFSET = 60.0, 900.0, 14 * 3600.0
Witnesses = dict[TimeSource, float | None]
"""Other times of the start of a file, s since 1970 UTC, None where there is none."""


def by_header(samples: Samples, start: float, zone: str, others: Witnesses) -> TimeStatement:
    """Return what the start in a header is by; ``zone`` is the IANA name of the zone of stamps that name none."""
    written = samples.stamp if samples.stamp is not None else samples.written
    stamp = None if written is None else read_stamp(written, zone)
    if stamp is None or not stamp.local:
        resolution = resolution_of(start) if stamp is None else stamp.resolution
        return TimeStatement("header", resolution, witnesses=lags_from(start, others))
    return _local("header_local", stamp, start, zone, others)


def by_name(stamp: Stamp, start: float, zone: str, others: Witnesses) -> TimeStatement:
    """Return what the start in a name is by; arguments as of :func:`by_header`."""
    if not stamp.local:
        return TimeStatement("name", stamp.resolution, witnesses=lags_from(start, others))
    return _local("name_local", stamp, start, zone, others)


def _local(source: TimeSource, stamp: Stamp, start: float, zone: str, others: Witnesses) -> TimeStatement:
    return TimeStatement(
        source,
        stamp.resolution,
        repeated_s=0.0 if stamp.skipped else repeated_by(start, zone),
        skipped_s=_SKIPPED_S if stamp.skipped else 0.0,
        witnesses=lags_from(start, others),
    )


def lags_from(start: float, others: Witnesses) -> tuple[tuple[TimeSource, float], ...]:
    """Return how far other times of a start are behind it, s."""
    return tuple((source, time - start) for source, time in others.items() if time is not None)


def stamp_doubt(start: float | None, length: float, stated: TimeStatement | None) -> str | None:
    """Return in words which other stamp of a file contradicts its start, None where none does.

    A name may be of the end of a file, in another zone, and written a minute later.

    Args:
        start: s since 1970 UTC.
        length: of the file, s.
        stated: what states the start.
    """
    if stated is None or start is None:
        return None
    for source, lag in stated.witnesses:
        apart = abs(lag) if abs(lag) > _LONGEST_OFFSET else abs(lag - _QUARTER * round(lag / _QUARTER))
        if source in _STAMPS and apart > _MINUTE + length:
            own, other = (each.removesuffix("_local") for each in (stated.source, source))
            return f"its {own} states {utc_text(start)}, its {other} {utc_text(start + lag)}"
    return None
