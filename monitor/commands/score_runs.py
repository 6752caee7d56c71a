"""Reading and scoring of many runs, shared between workers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from models.work.runner import Runner
from models.work.task import Work
from monitor.commands.shared_folders import Seen, check_seen, record_files, seen
from monitor.report.score import scoring
from monitor.report.score.issued import Issued, read_issued

MEMORY = 300_000_000
"""Bytes that reading or scoring a run needs at most beside the program, measured by benchmarks/batch_memory.py."""


@dataclass(frozen=True)
class RecordsTask:
    """Records to be read.

    Attributes:
        path: as the workers open it.
        shown: as it was given.
        expected: what the caller sees of it.
        files: name, size and time of change, ns, of each of its files, so that records that changed are read again.
        elsewhere: whether the worker is on another machine and compares what it sees.
    """

    path: Path
    shown: str
    expected: Seen
    files: tuple[tuple[str, int, int], ...]
    elsewhere: bool


@dataclass(frozen=True)
class ScoreTask:
    """A run to be scored, as :func:`monitor.report.score.scoring.score_run` takes it."""

    issued: Issued
    end: scoring.End
    lifetimes: tuple[float, ...]
    onset: float | None


def read_records(threshold: float | None, task: RecordsTask) -> list[Issued]:
    """Read the forecasts in records for a threshold, m2.

    Raises:
        ScoreError, ReportError: as :func:`monitor.report.score.issued.read_issued`.
        SharedFolderError: this worker sees other records than the caller.
    """
    if task.elsewhere:
        check_seen(task.path, record_files(task.path), task.expected)
    return [replace(issued, records=task.shown) for issued in read_issued(task.path, threshold)]


def score_one(_shared: None, task: ScoreTask) -> dict[str, Any]:
    """Score one run."""
    return scoring.score_run(task.issued, task.end, lifetimes=task.lifetimes, onset=task.onset)


READING = Work("records", read_records, memory=MEMORY)
SCORING = Work("scores", score_one, memory=MEMORY)


def read_all(
    records: Sequence[Path], threshold: float | None, runner: Runner, *, elsewhere: bool
) -> Iterator[tuple[int, Issued]]:
    """Yield the runs in records, each with the place of its records.

    Raises:
        ScoreError, ReportError, SharedFolderError: as :func:`read_records`.
    """
    tasks = [_task(path, elsewhere=elsewhere) for path in records]
    for place, found in enumerate(runner.run(READING, threshold, tasks)):
        for issued in found:
            yield place, issued


def _task(path: Path, *, elsewhere: bool) -> RecordsTask:
    files = record_files(path)
    states = ((file, file.stat()) for file in files)
    named = tuple((str(file.relative_to(path.parent)), state.st_size, state.st_mtime_ns) for file, state in states)
    return RecordsTask(path.absolute(), str(path), seen(files), named, elsewhere)
