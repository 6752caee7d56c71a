"""What a source is configured by, and the error that a configuration meets."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal
from zoneinfo import ZoneInfo

from models.errors import WrongInputError

if TYPE_CHECKING:
    from streams.link.network import NetworkSpec

DEFAULT_BLOCK_SECONDS = 5.0
UNITS = ("g", "m/s2", "V", "unknown")
"""The units that a channel may state."""


class SourceError(WrongInputError):
    """A source cannot be opened as configured; the message names it, what was expected and what was found."""


@dataclass(frozen=True)
class ChannelSpec:
    """Which row of a recording a channel is, and what its numbers mean.

    A channel is found by ``key``, else by ``column``, else by its own name among the names of the file or of the data
    set; where the file holds a single row, that row is it.

    Attributes:
        name: name of the channel.
        column: number of the column in the file, counted from 1, or the name in its header.
        key: pattern (``*``, ``?``, ``[...]``) of the variable or column name, such as ``X*_DE_time``.
        unit: "g", "m/s2", "V" or "unknown"; None leaves it to the file or the data set.
        scale: factor from the stored numbers to ``unit`` (an integer WAV is read as -1..1 of full scale).
        sensitivity_mv_per_g: sensitivity of the sensor where ``unit`` is "V".
    """

    name: str
    column: int | str | None = None
    key: str | None = None
    unit: str | None = None
    scale: float = 1.0
    sensitivity_mv_per_g: float | None = None

    def __post_init__(self) -> None:
        """Refuse a channel that can match nothing or has no meaning."""
        where = f"[[channel]] {self.name}"
        if self.unit is not None and self.unit not in UNITS:
            raise SourceError(f"{where}: unit must be one of {', '.join(UNITS)}, got {self.unit!r}")
        if isinstance(self.column, int) and self.column < 1:
            raise SourceError(f"{where}: columns are counted from 1, got column = {self.column}")
        if self.column is not None and self.key is not None:
            raise SourceError(f"{where}: give either column or key, not both")
        if not (math.isfinite(self.scale) and self.scale != 0.0):
            raise SourceError(f"{where}: scale must be finite and not zero, got {self.scale}")
        if self.unit == "V" and not (self.sensitivity_mv_per_g and self.sensitivity_mv_per_g > 0.0):
            raise SourceError(f"{where}: unit V needs a positive sensitivity_mv_per_g, got {self.sensitivity_mv_per_g}")


@dataclass(frozen=True)
class SourceSpec:
    """What the configuration says of one source.

    Attributes:
        name: name of the source.
        url: ``dataset:NAME:PATH``, ``folder:PATH``, ``rig:NAME?seed=N`` or a bare path, which is looked at.
        start: seconds since 1970-01-01 UTC of the first sample, for recordings without a date; else None.
        block_s: length of a block in s, or "file" for one block a file. Data sets of snapshots (PRONOSTIA, IMS,
            XJTU-SY) give one block a file whatever it says.
        format: "auto", one of the formats of docs/formats.md ("csv", "tdms", ...) or the name of a data set.
        rate: sampling rate in Hz where neither the file nor the data set states it; where one does, it must agree.
        range_g: range of the sensor in g, or None where unknown; no concern of the readers.
        channels: the channels to give; empty gives all that the data set knows.
        timezone: IANA name of the zone in which local time stamps of file names are read.
        settle_s: seconds for which a file of a watched folder must not have changed before it is read, unless it was
            closed or moved in.
        network: limits and credentials of a ``tcp:`` or ``mqtt:`` source, or None for the usual ones.
    """

    name: str
    url: str
    start: float | None = None
    block_s: float | Literal["file"] = DEFAULT_BLOCK_SECONDS
    format: str = "auto"
    rate: float | None = None
    range_g: float | None = None
    channels: tuple[ChannelSpec, ...] = ()
    timezone: str = "UTC"
    settle_s: float = 2.0
    network: NetworkSpec | None = None

    def __post_init__(self) -> None:
        """Refuse values that no recording could have."""
        where = f"[[source]] {self.name}"
        if self.block_s != "file" and not (math.isfinite(self.block_s) and self.block_s > 0.0):
            raise SourceError(f'{where}: block_s must be a positive number of seconds or "file", got {self.block_s!r}')
        if self.rate is not None and not (math.isfinite(self.rate) and self.rate > 0.0):
            raise SourceError(f"{where}: rate_hz must be positive, got {self.rate}")
        if not (math.isfinite(self.settle_s) and self.settle_s >= 0.0):
            raise SourceError(f"{where}: settle_s must be a number of seconds from 0, got {self.settle_s}")
        names = [channel.name for channel in self.channels]
        if len(set(names)) != len(names):
            raise SourceError(f"{where}: channel names must differ, got {', '.join(names)}")
        try:
            ZoneInfo(self.timezone)
        except (KeyError, ValueError, OSError) as error:
            raise SourceError(f"{where}: timezone {self.timezone!r} is not known") from error
