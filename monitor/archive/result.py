"""What the replay of one recording of an archive leaves: where its records are, their shape, and its summary."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Status = Literal["done", "failed"]


@dataclass(frozen=True)
class RecordsFile:
    """One netCDF file of records.

    Attributes:
        name: in the store of the records, such as "press/2024-03/press-20240301.nc".
        day: UTC day as a number of days since 1970, or None for records without a date.
        rows: of the file, one a block.
        size: bytes.
    """

    name: str
    day: int | None
    rows: int
    size: int


@dataclass(frozen=True)
class Shape:
    """Variables and dimensions of records, so that arrays can be planned without opening a file.

    Attributes:
        channels: in order; the dimension ``channel``.
        variables: dimensions of each variable but the row (``time``) and, as ``channel`` where it has one, by name.
        sizes: greatest size of each of these dimensions.
        attributes: global attributes that tell what made the records: hashes, versions, calibration.
    """

    channels: tuple[str, ...] = ()
    variables: Mapping[str, tuple[str, ...]] = field(default_factory=dict[str, tuple[str, ...]])
    sizes: Mapping[str, int] = field(default_factory=dict[str, int])
    attributes: Mapping[str, Any] = field(default_factory=dict[str, Any])


@dataclass(frozen=True)
class RecordingResult:
    """A recording that was replayed, or that cannot be.

    Attributes:
        machine: name of the machine, as a part of a path.
        recording: name of the recording, as a part of a path, unique in its machine.
        url: where the recording is, without credentials.
        status: "failed" where the recording or the configuration is at fault; ``reason`` then says why in one line.
        files: of the records, by day, those without a date first; their rows together are ``rows``.
        first, last: UTC of the first and last dated block, s since 1970, or None.
        summary: keys of ``replay --json``, {} where it failed.
        seconds: wall time of fetching and replaying.
        bytes_read: size of the recording.
    """

    machine: str
    recording: str
    url: str
    status: Status = "done"
    reason: str = ""
    files: tuple[RecordsFile, ...] = ()
    rows: int = 0
    first: float | None = None
    last: float | None = None
    shape: Shape = field(default_factory=Shape)
    summary: Mapping[str, Any] = field(default_factory=dict[str, Any])
    seconds: float = 0.0
    bytes_read: int = 0
