"""What the published description of a data set says of its files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import PurePosixPath
from zoneinfo import ZoneInfo

from streams.files import unpacked_name
from streams.samples import Samples

POUND_FORCE = 4.4482216152605
"""N in one pound-force."""


@dataclass(frozen=True)
class FileFacts:
    """What the name of a file, or of the folder that it lies in, says.

    Attributes:
        order: key that sorts the files by acquisition.
        number: 1-based number of the file in its run, or None where the names do not count.
        elapsed: seconds from the first sample of the run, or None.
        start: seconds since 1970 UTC of the first sample, or None.
        rate: sampling rate in Hz that the data set states for this file, or None.
        speed: shaft speed in Hz, or None.
        load: radial load in N, or None.
    """

    order: tuple[object, ...]
    number: int | None = None
    elapsed: float | None = None
    start: float | None = None
    rate: float | None = None
    speed: float | None = None
    load: float | None = None


@dataclass(frozen=True)
class DataSet:
    """One data set.

    Attributes:
        name: as in ``dataset:NAME:PATH``.
        files: what its files are called, for messages.
        facts: from a file's path, the name of the place that holds it and the time zone to its facts; None: no file of
            this set.
        read: from the unpacked bytes and the path of a file to its rows.
        unit: of every row, or None where only the configuration can say.
        snapshot: whether each file is one short record taken at intervals, and so one block whatever ``block_s`` says.
        samples: number of samples of a whole file, or None where they differ.
        states_rate: whether each file states its rate, or may.
        states_unit: whether each file may state its unit.
        counted: whether the files of a run are numbered from 1 without gaps, so that order is known in one pass.
    """

    name: str
    files: str
    facts: Callable[[str, str, ZoneInfo], FileFacts | None]
    read: Callable[[bytes, str], Samples]
    unit: str | None = "g"
    snapshot: bool = False
    samples: int | None = None
    states_rate: bool = False
    states_unit: bool = False
    counted: bool = False


def file_name(path: str) -> str:
    """Return the name of a file without its folder and the suffix of its compression."""
    return unpacked_name(PurePosixPath(path).name)
