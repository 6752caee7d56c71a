"""Reports of many runs: one page per run and an index, made in parallel; an interrupted batch is resumed."""

from __future__ import annotations

import json
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from models.work.program import program
from models.work.redact import redact
from models.work.runner import SERIAL, Runner
from models.work.task import DIED, Failure, Work
from monitor.commands.common import InputError
from monitor.commands.shared_folders import (
    Seen,
    SharedFolderError,
    check_config,
    check_mark,
    check_seen,
    config_digest,
    folder_names,
    input_digest,
    marked,
    raise_if_unseen,
    record_files,
    remove_leftovers,
    replaced,
    seen,
)
from monitor.config.load import ConfigError, load_config
from monitor.records.database import StoreError
from monitor.report.options import Options, zone_of
from monitor.report.page import require_pdf
from monitor.report.runs import ReportError, read_runs
from monitor.report.summary import VERSION, RunSummary

_SUMMARY = "run.json"
_RECORDINGS = (".tar", ".bz2", ".xz", ".gz", ".tgz", ".zip", ".csv", ".mat", ".h5", ".hdf5", ".npy", ".txt", ".wav")


@dataclass(frozen=True)
class BatchRun:
    """A store, a file or folder of records, or a recording to replay; ``name`` is its folder, unique in the batch."""

    path: Path
    name: str
    recording: bool = False


@dataclass(frozen=True)
class BatchSettings:
    """How the pages of a batch are made; ``config_path`` is the configuration with which recordings are replayed.

    Maps must stand in ``options_path``, a TOML file with ``[report]``, because processes read that file themselves.
    """

    options: Options
    options_path: Path | None = None
    config_path: Path | None = None
    tables: bool = True
    pdf: bool = False


@dataclass(frozen=True)
class Pages:
    """What all pages of a batch share, as it is sent to workers; paths are absolute.

    Attributes:
        maps: channel and hash of the maps that ``options_path`` names.
        mark: of the caller in ``out``, for workers of other machines; "" without.
        configured: digest of the configuration with the files that it names; "" without one.
    """

    out: Path
    timezone: str
    sections: frozenset[str]
    notes: tuple[str, ...]
    options_path: Path | None
    config_path: Path | None
    tables: bool
    pdf: bool
    maps: tuple[tuple[str, str], ...] = ()
    mark: str = ""
    configured: str = ""

    @classmethod
    def of(cls, out: Path, settings: BatchSettings) -> Pages:
        """Return what is sent of the settings of a batch; ConfigError where the configuration cannot be used."""
        options, config = settings.options, settings.config_path
        return cls(
            out.absolute(),
            str(options.zone),
            options.sections,
            options.notes,
            None if settings.options_path is None else settings.options_path.absolute(),
            None if config is None else config.absolute(),
            settings.tables,
            settings.pdf,
            tuple(sorted((channel, rms_map.hash) for channel, rms_map in options.maps.items())),
            configured="" if config is None else config_digest(config, load_config(config)),
        )

    def options(self, title: str) -> Options:
        """Return the options of a page; its maps are read here."""
        from monitor.report.options import read_options

        maps = {} if self.options_path is None else read_options(self.options_path).maps
        return Options(title, zone_of(self.timezone), self.sections, maps, self.notes)


@dataclass(frozen=True)
class ReportTask:
    """One run of a batch; ``expected``: what the caller sees of it, for workers of other machines."""

    run: BatchRun
    expected: Seen | None = None


@dataclass(frozen=True)
class ReportOutcome:
    """Summaries of the runs on a page, or one sentence of why it failed; ``reused``: an earlier page is kept."""

    run: BatchRun
    summaries: tuple[RunSummary, ...]
    error: str = ""
    reused: bool = False


def find_runs(folder: Path, *, recordings: bool, leave_out: Path | None = None) -> list[BatchRun]:
    """Return the runs under a folder, at any depth, in the order of their paths.

    A folder with a ``state.db`` is a run, as is one with ``.nc`` files of records (or a folder ``records`` of them) and
    any other ``.db`` file. Folders inside a run are not searched, nor is ``leave_out``. With ``recordings``, every
    other entry of ``folder`` itself is a recording.

    Raises:
        ReportError: the folder does not exist, or holds no runs.
    """
    if not folder.is_dir():
        raise ReportError(f"{folder}: is no folder")
    apart = None if leave_out is None else leave_out.resolve()
    paths = [(path, False) for path in _stores(folder, apart)]
    taken = {path for path, _ in paths}
    if recordings:
        for entry in sorted(folder.iterdir()):
            inside = any(path == entry or entry in path.parents for path in taken)
            inside = inside or entry.name.startswith(".") or entry.resolve() == apart
            if not inside and (entry.is_dir() or entry.suffix.lower() in _RECORDINGS):
                paths.append((entry, True))
    if not paths:
        more = "" if recordings else "; recordings are replayed with --config FILE"
        raise ReportError(f"{folder}: holds no state.db and no .nc files of records{more}")
    paths.sort()
    names = folder_names((_text(path.relative_to(folder), path) for path, _ in paths), "run")
    return [BatchRun(path, name, recording) for (path, recording), name in zip(paths, names, strict=True)]


def _text(relative: Path, path: Path) -> str:
    """Return what a run is named by: its place, of a file without what follows the first dot."""
    return "-".join(relative.parts if path.is_dir() else (*relative.parts[:-1], path.name.partition(".")[0]))


def _stores(folder: Path, apart: Path | None) -> Iterator[Path]:
    if folder.resolve() == apart:
        return
    if (folder / "state.db").is_file() or any(folder.glob("*.nc")) or any((folder / "records").glob("*.nc")):
        yield folder
        return
    yield from sorted(folder.glob("*.db"))
    for inner in sorted(path for path in folder.iterdir() if path.is_dir() and not path.is_symlink()):
        yield from _stores(inner, apart)


def run_batch(
    runs: Sequence[BatchRun],
    out: Path,
    settings: BatchSettings,
    runner: Runner = SERIAL,
    *,
    elsewhere: bool = False,
) -> list[ReportOutcome]:
    """Report every run, each into a folder of its own under ``out``, then write the index.

    A page is kept if its records, settings and program are unchanged. A run that fails is listed in the index and in
    ``failures.json``; the others go on. ``elsewhere``: workers are on other machines, so they check that they see the
    same folders.

    Raises:
        ReportError: the output folder or the index cannot be written, or a requirement of PDF is missing.
        ConfigError: the configuration cannot be used.
        SharedFolderError: a worker sees other folders.
    """
    if settings.pdf:
        require_pdf()
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ReportError(f"{out}: cannot be made: {error.strerror or error}") from error
    pages = Pages.of(out, settings)
    absolute = [replace(run, path=run.path.absolute()) for run in runs]
    for run in runs:
        remove_leftovers(out / run.name, ["replay"])
    found = {run.name: outcome for run in absolute if (outcome := reused(pages, run)) is not None}
    left = [
        ReportTask(run, seen(record_files(run.path)) if elsewhere else None)
        for run in absolute
        if run.name not in found
    ]
    with marked(out, checked=elsewhere) as mark:
        for i, outcome in runner.outcomes(REPORTS, replace(pages, mark=mark), left):
            run = left[i].run
            if isinstance(outcome, Failure):
                raise_if_unseen(outcome)
                reason = "the process that made its report died" if outcome.kind == DIED else outcome.message
                found[run.name] = ReportOutcome(run, (), reason)
            else:
                found[run.name] = outcome
    for run in runs:
        remove_leftovers(out / run.name, ["replay"])
    outcomes = [replace(found[run.name], run=run) for run in runs]
    from monitor.report.report import write_index

    summaries = [summary for outcome in outcomes for summary in outcome.summaries]
    failed = [(outcome.run.name, outcome.error) for outcome in outcomes if outcome.error]
    write_index(summaries, failed, out, settings.options, tables=settings.tables, pdf=settings.pdf)
    return outcomes


def reused(pages: Pages, run: BatchRun) -> ReportOutcome | None:
    """Return the outcome of a run whose page can be kept, else None."""
    try:
        kept = _kept(pages.out / run.name, _digest(pages, run), pdf=pages.pdf)
    except OSError:
        return None
    return None if kept is None else ReportOutcome(run, kept, reused=True)


def report_one(pages: Pages, task: ReportTask) -> ReportOutcome:
    """Report one run of a batch; any error becomes its outcome.

    Raises:
        SharedFolderError: this worker sees other folders than the caller.
    """
    check_mark(pages.out, pages.mark)
    run = task.run
    try:
        check_seen(run.path, record_files(run.path), task.expected)
        return ReportOutcome(run, _report(pages, run, _digest(pages, run)))
    except SharedFolderError:
        raise
    except (ReportError, ConfigError, InputError, StoreError, OSError, ValueError) as error:
        return ReportOutcome(run, (), _one_line(error))
    except Exception as error:  # An unforeseen error in one run must not end the batch.
        frames = traceback.extract_tb(error.__traceback__)
        where = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
        return ReportOutcome(run, (), f"{type(error).__name__}: {_one_line(error)}{where}")


MEMORY = 300_000_000
"""Bytes that a report needs at most beside the program, measured."""
REPORTS = Work("reports", report_one, memory=MEMORY)


def _one_line(error: Exception) -> str:
    return " ".join(redact(str(error)).split()) or type(error).__name__


def _report(pages: Pages, run: BatchRun, digest: str) -> tuple[RunSummary, ...]:
    from monitor.report.report import report_runs
    from monitor.report.tables import write_whole

    folder = pages.out / run.name
    options = pages.options(f"Bearing health: {run.name}")
    source = _replayed(pages, run, folder) if run.recording else run.path
    runs = read_runs(source)
    if len(runs) == 1:
        runs = [replace(runs[0], label=f"{runs[0].machine}, {run.name}")]
    place = folder / "tables" if pages.tables else None
    page, summaries = report_runs(runs, folder / "report.html", options=options, tables=place, pdf=pages.pdf)
    link = f"{run.name}/{page.name}"
    linked = tuple(replace(item, link=link if len(runs) == 1 else f"{link}{item.link}") for item in summaries)
    text = json.dumps({"fingerprint": digest, "runs": [item.to_dict() for item in linked]}, allow_nan=False)
    # Written last: its presence means that the page is complete.
    write_whole(folder / _SUMMARY, text)
    return _summaries(json.loads(text))


def _replayed(pages: Pages, run: BatchRun, folder: Path) -> Path:
    """Replay a recording into ``replay`` beside its page and return that folder."""
    from monitor.service.replay import replay

    if pages.config_path is None:
        raise ReportError(f"{run.path}: is a recording; give --config FILE to replay it")
    config = load_config(pages.config_path)
    check_config(pages.config_path, config, pages.configured)
    with replaced(folder / "replay") as store:
        replay(config, str(run.path), store)
    return folder / "replay"


def _digest(pages: Pages, run: BatchRun) -> str:
    """Return a digest of what a page depends on: records, settings, configuration with its files, and program."""
    chosen = (pages.timezone, sorted(pages.sections), pages.notes, pages.tables, pages.pdf, pages.maps)
    configured = pages.configured if run.recording else ""
    return input_digest((program(), VERSION, *chosen, configured, run), [pages.options_path], record_files(run.path))


def _kept(folder: Path, digest: str, *, pdf: bool) -> tuple[RunSummary, ...] | None:
    """Return the summaries of a page that can be kept, else None."""
    try:
        stored = json.loads((folder / _SUMMARY).read_text(encoding="utf-8"))
        pages = ("report.html", "report.pdf") if pdf else ("report.html",)
        if stored["fingerprint"] != digest or not all((folder / page).is_file() for page in pages):
            return None
        return _summaries(stored)
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _summaries(stored: dict[str, Any]) -> tuple[RunSummary, ...]:
    return tuple(RunSummary.from_dict(item) for item in stored["runs"])
