"""Reports of many runs: one page per run and an index, made in parallel; an interrupted batch is resumed."""

from __future__ import annotations

import glob
import hashlib
import json
import multiprocessing
import re
import shutil
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path

from models.workers import in_processes
from monitor import __version__
from monitor.config.load import ConfigError, load_config
from monitor.records.database import StoreError
from monitor.report.options import Options
from monitor.report.page import require_pdf
from monitor.report.runs import ReportError, read_runs
from monitor.report.summary import VERSION, RunSummary

_SUMMARY = "run.json"
_RECORDINGS = (".tar", ".bz2", ".xz", ".gz", ".tgz", ".zip", ".csv", ".mat", ".h5", ".hdf5", ".npy", ".txt", ".wav")
_NOT_A_NAME = re.compile(r"[^\w.+-]+")


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
class Task:
    """Input of a process: one run, the folder of all pages, and the settings."""

    run: BatchRun
    out: Path
    settings: BatchSettings


@dataclass(frozen=True)
class Outcome:
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
    names: dict[str, int] = {}
    runs = []
    for path, recording in sorted(paths):
        relative = path.relative_to(folder)
        parts = relative.parts if path.is_dir() else (*relative.parts[:-1], path.name.partition(".")[0])
        name = _NOT_A_NAME.sub("_", "-".join(parts)).strip("._") or "run"
        names[name.lower()] = names.get(name.lower(), 0) + 1
        number = names[name.lower()]
        runs.append(BatchRun(path, name if number == 1 else f"{name}-{number}", recording))
    return runs


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
    *,
    workers: int = 0,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[Outcome]:
    """Report every run, each into a folder of its own under ``out``, then write the index.

    A page is kept if its records, settings and program are unchanged. A run that fails is listed in the index and in
    ``failures.json``; the others go on. ``workers`` is the number of processes, 0 one per core; ``progress`` is called
    with the number done and the total.

    Raises:
        ReportError: the output folder or the index cannot be written, or a requirement of PDF is missing.
    """
    if settings.pdf:
        require_pdf()
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ReportError(f"{out}: cannot be made: {error.strerror or error}") from error
    plain = replace(settings, options=replace(settings.options, maps={}))
    tasks = [Task(run, out, plain) for run in runs]
    found = {task.run.name: outcome for task in tasks if (outcome := reused(task)) is not None}
    if found:
        progress(len(found), len(tasks))
    for outcome in _outcomes([task for task in tasks if task.run.name not in found], workers):
        found[outcome.run.name] = outcome
        progress(len(found), len(tasks))
    outcomes = [found[run.name] for run in runs]
    from monitor.report.report import write_index

    summaries = [summary for outcome in outcomes for summary in outcome.summaries]
    failed = [(outcome.run.name, outcome.error) for outcome in outcomes if outcome.error]
    write_index(summaries, failed, out, settings.options, tables=settings.tables, pdf=settings.pdf)
    return outcomes


def _outcomes(tasks: Sequence[Task], workers: int) -> Iterator[Outcome]:
    """Yield the outcome of each task in order; after a process has died, each further task has its own process."""
    done = 0
    try:
        for outcome in in_processes(report_one, tasks, workers):
            yield outcome
            done += 1
        return
    except BrokenProcessPool:
        pass
    for task in tasks[done:]:
        with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
            try:
                yield pool.submit(report_one, task).result()
            except BrokenProcessPool:
                yield Outcome(task.run, (), "the process that made its report died")


def reused(task: Task) -> Outcome | None:
    """Return the outcome of a run whose page can be kept, else None."""
    try:
        kept = _kept(task.out / task.run.name, fingerprint(task), pdf=task.settings.pdf)
    except OSError:
        return None
    return None if kept is None else Outcome(task.run, kept, reused=True)


def report_one(task: Task) -> Outcome:
    """Report one run of a batch; any error becomes its outcome."""
    try:
        return Outcome(task.run, _report(task, task.out / task.run.name, fingerprint(task)))
    except (ReportError, ConfigError, StoreError, OSError, ValueError) as error:
        return Outcome(task.run, (), _one_line(error))
    except Exception as error:  # An unforeseen error in one run must not end the batch.
        frames = traceback.extract_tb(error.__traceback__)
        where = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
        return Outcome(task.run, (), f"{type(error).__name__}: {_one_line(error)}{where}")


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def _report(task: Task, folder: Path, print_of: str) -> tuple[RunSummary, ...]:
    from monitor.report.options import read_options
    from monitor.report.report import report_runs
    from monitor.report.tables import write_whole

    settings = task.settings
    options = read_options(settings.options_path, settings.options)
    options = replace(options, title=f"Bearing health: {task.run.name}")
    source = _replayed(task, folder) if task.run.recording else task.run.path
    runs = read_runs(source)
    if len(runs) == 1:
        runs = [replace(runs[0], label=f"{runs[0].machine}, {task.run.name}")]
    place = folder / "tables" if settings.tables else None
    page, summaries = report_runs(runs, folder / "report.html", options=options, tables=place, pdf=settings.pdf)
    link = f"{task.run.name}/{page.name}"
    linked = tuple(replace(item, link=link if len(runs) == 1 else f"{link}{item.link}") for item in summaries)
    stored = {"fingerprint": print_of, "runs": [item.to_dict() for item in linked]}
    # Written last: its presence means that the page is complete.
    write_whole(folder / _SUMMARY, json.dumps(stored, allow_nan=False))
    return linked


def _replayed(task: Task, folder: Path) -> Path:
    """Replay a recording into ``replay`` beside its page and return that folder."""
    from monitor.service.replay import replay

    if task.settings.config_path is None:
        raise ReportError(f"{task.run.path}: is a recording; give --config FILE to replay it")
    store = folder / "replay"
    if store.exists():
        # Left by an interrupted batch; the recording is replayed again.
        shutil.rmtree(store)
    folder.mkdir(parents=True, exist_ok=True)
    replay(load_config(task.settings.config_path), str(task.run.path), store)
    return store


def fingerprint(task: Task) -> str:
    """Return a digest of the inputs of a page: records, settings, configuration and version of the program."""
    settings, options = task.settings, task.settings.options
    chosen = (str(options.zone), sorted(options.sections), options.notes, settings.tables, settings.pdf)
    digest = hashlib.sha256(repr((__version__, VERSION, *chosen, task.run)).encode())
    for path in (settings.options_path, settings.config_path if task.run.recording else None):
        digest.update(b"-" if path is None else path.read_bytes())
    for path in _inputs(task.run.path):
        found = path.stat()
        digest.update(repr((str(path), found.st_size, found.st_mtime_ns)).encode())
    return digest.hexdigest()


def _inputs(path: Path) -> list[Path]:
    """Return the files that a page depends on, without empty write-ahead logs, which readers create and remove."""
    if path.is_file():
        found = [path, *path.parent.glob(f"{glob.escape(path.name)}-wal")]
    else:
        found = sorted(item for item in path.rglob("*") if item.is_file())
    records = [item for item in found if item.suffix in (".db", ".nc", ".db-wal")]
    return [item for item in records or found if item.suffix != ".db-wal" or item.stat().st_size > 0]


def _kept(folder: Path, print_of: str, *, pdf: bool) -> tuple[RunSummary, ...] | None:
    """Return the summaries of a page that can be kept, else None."""
    try:
        stored = json.loads((folder / _SUMMARY).read_text(encoding="utf-8"))
        pages = ("report.html", "report.pdf") if pdf else ("report.html",)
        if stored["fingerprint"] != print_of or not all((folder / page).is_file() for page in pages):
            return None
        return tuple(RunSummary.from_dict(item) for item in stored["runs"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
