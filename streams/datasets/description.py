"""What the published description of a data set states of its files."""

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
    """What the name of a file, or of its folder, states; None where it does not.

    ``order`` sorts the files by acquisition, ``number`` is the 1-based number of the file in its run, ``elapsed`` in s
    counts from the first sample of the run. Start in s since 1970 UTC, rate and shaft speed in Hz, radial load in N.
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
        files: names of its files, for messages.
        facts: maps path, name of the root and time zone to the facts of a file; None: no file of this set.
        read: maps the unpacked bytes and the path of a file to its rows.
        unit: of every row, None where only the configuration can state it.
        snapshot: whether each file is one short record taken at intervals, and so one block whatever ``block_s`` says.
        samples: number in a whole file, None where they differ.
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
