"""What states the time of samples, and how exactly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

MIN_TIME = 347155200.0
"""1981-01-01 UTC, s: earlier times are of a clock that was never set (epochs of Unix, of FAT and of GPS)."""

TimeSource = Literal[
    "header",
    "header_local",
    "name",
    "name_local",
    "count",
    "mtime",
    "frame",
    "source",
    "order",
    "between",
    "rollover",
    "folder",
]
TIME_SOURCES: tuple[TimeSource, ...] = get_args(TimeSource)
"""What the time of a block comes from. Append only: the integers of published files follow the order."""


@dataclass(frozen=True)
class TimeStatement:
    """What states the start of samples, and what else is known of their time; differences are to the stated start.

    Attributes:
        source: what states it; "_local" where the zone is the configured one.
        resolution: s, of the last digit that is stated; None where nothing says how exact it is.
        repeated_s: how much later it is in the second of two equal local hours; 0: the time occurs once.
        skipped_s: length of the hour that is left out, where the stated local time does not exist; else 0.
        placed_s: what other names show to be the time of a file whose clock was wrong, ``margin_s`` its uncertainty.
        hour_is_open: whether the order of the files does not tell which of two equal local hours it is of.
        has_place: whether its place among the files is known.
        witnesses: other times of the same start, by source, such as the last change less the length.
        is_stated: False for a file without a date among those that have one: its start is estimated, to ``margin_s``.
    """

    source: TimeSource
    resolution: float | None = None
    repeated_s: float = 0.0
    skipped_s: float = 0.0
    placed_s: float | None = None
    margin_s: float = 0.0
    hour_is_open: bool = False
    has_place: bool = True
    witnesses: tuple[tuple[TimeSource, float], ...] = ()
    is_stated: bool = True
