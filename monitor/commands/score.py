"""``spallwatch score``: scores of the forecasts as issued, once the end is known."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from models.work.runner import Runner
from models.work.task import Work
from monitor.commands import option
from monitor.commands.cluster_options import Sharing, sharing
from monitor.commands.common import InputError
from monitor.commands.shared_folders import Seen, check_seen, record_files, seen
from monitor.report.score import scoring
from monitor.report.score.forecasts import Issued, read_issued

if TYPE_CHECKING:
    from monitor.report.score.forecasts import Issued

MEMORY = 300_000_000
"""Bytes that reading or scoring a run needs at most beside the program, measured."""


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
        ScoreError, ReportError: as :func:`monitor.report.score.forecasts.read_issued`.
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


_MIN_OTHERS = 2
"""Minimum number of other runs whose lifetimes are used as a population."""
_MIN_SHARED = 8
"""Number of runs from which processes pay, unless their number is given."""


class _Moment(click.ParamType):
    """A moment; UTC unless it has an offset."""

    name = "UTC"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return seconds since 1970."""
        if isinstance(value, float):
            return value
        try:
            moment = datetime.fromisoformat(str(value))
        except ValueError:
            self.fail(f"{value!r} is not a moment such as 2026-03-01T12:00:00Z", param, ctx)
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


@click.command("score")
@click.argument("records", nargs=-1, required=True, type=option.FILE)
@click.option("--end-utc", type=_Moment(), multiple=True, help="End of the run; one for each of RECORDS.")
@click.option("--end-s", type=float, multiple=True, help="The same for undated records, s from the first block.")
@click.option(
    "--threshold-mm2",
    type=option.POSITIVE,
    help="Threshold whose forecasts are scored, mm3 per mm. Without a given or simulated end, the end is the moment at "
    "which the tracked V_eq reached it.",
)
@click.option("--onset-utc", type=_Moment(), multiple=True, help="True onset of damage; one for each of RECORDS.")
@click.option("--onset-s", type=float, multiple=True, help="The same for undated records, s from the first block.")
@click.option(
    "--lifetime-s",
    type=option.POSITIVE,
    multiple=True,
    help="Final stage of another bearing of the same rig, s; repeatable. Default: those of the other RECORDS.",
)
@sharing("Processes")
@option.output
def command(
    records: tuple[Path, ...],
    end_utc: tuple[float, ...],
    end_s: tuple[float, ...],
    threshold_mm2: float | None,
    onset_utc: tuple[float, ...],
    onset_s: tuple[float, ...],
    lifetime_s: tuple[float, ...],
    sharing: Sharing,
    quiet: bool,
) -> option.Result:
    """Score the forecasts in RECORDS: netCDF files, folders of them, or a state.db, one run each.

    Each run is scored by itself, beside naive forecasts issued at the same moments. The end is given, or recorded by a
    simulated rig, or taken from the tracked V_eq with --threshold-mm2. --cluster and --resume need --chunks.
    """
    from monitor.report.score import scoring

    ends = _moments("end", records, end_utc, end_s)
    onsets = _moments("onset", records, onset_utc, onset_s)
    threshold = None if threshold_mm2 is None else threshold_mm2 * 1e-6
    if len(records) < _MIN_SHARED and sharing.workers == 0 and sharing.cluster is None:
        sharing = replace(sharing, workers=1)
    with sharing.open(None, quiet=quiet) as shared:
        found: list[tuple[int, Issued, scoring.End]] = []
        for place, issued in read_all(records, threshold, shared.runner, elsewhere=sharing.cluster is not None):
            end = scoring.end_of(issued, _on_axis("end", issued, ends[place]), tracked=threshold is not None)
            found.append((place, issued, end))
        _refuse_no_end(found, threshold_mm2)
        lives = _lifetimes(found)
        tasks: list[ScoreTask] = []
        for place, issued, end in found:
            others = tuple(life for other, life in lives.items() if other != place)
            lifetimes = lifetime_s or (others if len(others) >= _MIN_OTHERS else ())
            tasks.append(ScoreTask(issued, end, lifetimes, _on_axis("onset", issued, onsets[place])))
        runs = list(shared.runner.run(SCORING, None, tasks))
    values = {"runs": runs, "mean": scoring.mean_of_runs(runs), "cluster": shared.values()}
    return values, [*_lines(values), *shared.lines()]


def _moments(
    name: str, records: Sequence[Path], utc: Sequence[float], seconds: Sequence[float]
) -> list[tuple[str, float] | None]:
    """Return for each of the records the option that gives the moment, and its value.

    Raises:
        InputError: both options, or not one value for each of the records.
    """
    if utc and seconds:
        raise InputError(f"--{name}-utc and --{name}-s: give one of them, for dated or for undated records")
    option, values = (f"--{name}-utc", utc) if utc else (f"--{name}-s", seconds)
    if not values:
        return [None] * len(records)
    if len(values) != len(records):
        raise InputError(f"{option}: expected one for each of the {len(records)} RECORDS, got {len(values)}")
    return [(option, value) for value in values]


def _on_axis(name: str, issued: Issued, given: tuple[str, float] | None) -> float | None:
    """Return a given moment on the time axis of the records.

    Raises:
        InputError: it is of the other kind, or before the first record.
    """
    if given is None:
        return None
    option, value = given
    if option != (f"--{name}-utc" if issued.dated else f"--{name}-s"):
        kind, right = ("dated", f"--{name}-utc") if issued.dated else ("undated", f"--{name}-s")
        raise InputError(f"{issued.records}: is {kind}; give {right} rather than {option}")
    if value < issued.all_time[0]:
        raise InputError(f"{option}: lies before the first record of {issued.records}")
    return value


def _refuse_no_end(found: Sequence[tuple[int, Issued, Any]], threshold_mm2: float | None) -> None:
    """Refuse to score if no run has an end.

    Raises:
        InputError: naming the records and what may be given.
    """
    if any(end.source != "none" for _, _, end in found):
        return
    issued = found[0][1]
    option = "--end-utc" if issued.dated else "--end-s"
    if threshold_mm2 is None:
        raise InputError(
            f"{issued.records}: no end is known; give {option}, or --threshold-mm2 to take the moment at which the "
            "tracked V_eq reached it"
        )
    raise InputError(
        f"{issued.records}: the tracked V_eq never reached --threshold-mm2 {threshold_mm2:g}, so no end is known; "
        f"give {option}"
    )


def _lifetimes(found: Sequence[tuple[int, Issued, Any]]) -> dict[int, float]:
    """Return the final stage of each of the records, s: the longest among their channels."""
    lives: dict[int, float] = {}
    for place, issued, end in found:
        life = end.clock - issued.onset
        if life > 0:
            lives[place] = max(life, lives.get(place, 0.0))
    return lives


_COLUMNS = (
    ("CRA", "cra", 7),
    ("CRPS", "crps_s", 11),
    ("horizon", "prognostic_horizon_s", 11),
    ("coverage", "coverage", 8),
    ("width", "width_s", 11),
    ("answered", "answered", 8),
)


def _lines(values: Mapping[str, Any]) -> Iterator[str]:
    for run in values["runs"]:
        yield from _run_lines(run)
        yield ""
    mean = values["mean"]
    count = max((figure["runs"] for figure in mean.values()), default=0)
    if count > 1:
        yield f"means over {count} runs, with their standard errors"
        for title, name, _ in _COLUMNS:
            if name in mean:
                yield f"  {title:<10} {_with_error(name, mean[name])}"


def _run_lines(run: Mapping[str, Any]) -> Iterator[str]:
    yield (
        f"{run['records']}: {run['channel']}, {run['forecasts']} forecasts for {run['threshold_mm2']:g} mm3/mm "
        f"before the end ({_END_WORDS[run['end_source']]})"
    )
    if run["onset_delay_s"] is not None:
        yield f"  onset known after {_duration(run['onset_delay_s'])}, {run['false_alarms']} false alarms"
    if not run["forecasts"]:
        return
    verdict = {True: "passed", False: "failed", None: "not defined"}[run["alpha_lambda"]]
    yield f"  alpha-lambda (20 %, half-way): {verdict}"
    yield "  " + f"{'':<16}" + "".join(f"  {title:>{width}}" for title, _, width in _COLUMNS)
    for name, figures in {run["method"] or "as issued": run, **run["baselines"]}.items():
        label = name if figures is run else f"- {name}"
        yield "  " + f"{label:<16}" + "".join(f"  {_cell(key, figures[key]):>{width}}" for _, key, width in _COLUMNS)


_END_WORDS = {
    "given": "as given",
    "truth": "from the simulated rig",
    "tracked": "when the tracked V_eq reached it",
    "none": "not known",
}


def _cell(name: str, value: float | None) -> str:
    if value is None:
        return "-"
    return _duration(value) if name.endswith("_s") else f"{value:.3g}"


def _with_error(name: str, figure: Mapping[str, Any]) -> str:
    error = figure["standard_error"]
    return _cell(name, figure["mean"]) + (f" +- {_cell(name, error)}" if error is not None else "")


def _duration(seconds: float) -> str:
    """Return a duration (s) with three figures in one unit, for scores: "37 s", "2.5 min", "2.17 h", "3.1 d"."""
    for unit, size in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if abs(seconds) >= 2 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"
