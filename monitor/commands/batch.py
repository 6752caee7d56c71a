"""Reports of many runs: one page a run and an index, side by side over processes, taken up again where they stopped."""

from __future__ import annotations

import glob
import hashlib
import json
import multiprocessing
import re
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from models.workers import in_processes
from monitor import __version__
from monitor.config.load import ConfigError, load_config
from monitor.records.store import StoreError
from monitor.report.batch.summary import VERSION, RunSummary
from monitor.report.options import Options
from monitor.report.pdf import require_pdf
from monitor.report.runs import ReportError, read_runs

_SUMMARY = "run.json"
_RECORDINGS = (".tar", ".bz2", ".xz", ".gz", ".tgz", ".zip", ".csv", ".mat", ".h5", ".hdf5", ".npy", ".txt", ".wav")
_NOT_A_NAME = re.compile(r"[^\w.+-]+")


@dataclass(frozen=True)
class Item:
    """One run of a batch.

    Attributes:
        path: a store, a file or folder of records, or a recording.
        name: of its folder under the output, unlike any other.
        recording: whether it has to be replayed first.
    """

    path: Path
    name: str
    recording: bool = False


@dataclass(frozen=True)
class Task:
    """What a process is given: one run, where its page goes, and how it is made."""

    item: Item
    out: Path
    options: Options
    options_path: Path | None
    config_path: Path | None
    tables: bool
    pdf: bool = False


@dataclass(frozen=True)
class Outcome:
    """What became of a run.

    Attributes:
        item: the run.
        summaries: of the runs on its page; empty where it failed.
        error: in one sentence, "" where it did not.
        reused: whether its page was there already.
    """

    item: Item
    summaries: tuple[RunSummary, ...]
    error: str = ""
    reused: bool = False


def find_items(folder: Path, *, recordings: bool, leave_out: Path | None = None) -> list[Item]:
    """Return the runs under a folder, however deep, in the order of their paths.

    A folder with a ``state.db`` is a run, so is one with ``.nc`` files of records (or a folder ``records`` of them), so
    is any other ``.db`` file. What lies inside a run is not looked at.

    Args:
        folder: to look in.
        recordings: take what else lies in ``folder`` itself for recordings, one an entry.
        leave_out: a folder in it that is not looked at, such as that of the pages.

    Raises:
        ReportError: the folder does not exist, or holds nothing of the kind.
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
    items = []
    for path, recording in sorted(paths):
        relative = path.relative_to(folder)
        parts = relative.parts if path.is_dir() else (*relative.parts[:-1], path.name.partition(".")[0])
        name = _NOT_A_NAME.sub("_", "-".join(parts)).strip("._") or "run"
        names[name.lower()] = names.get(name.lower(), 0) + 1
        number = names[name.lower()]
        items.append(Item(path, name if number == 1 else f"{name}-{number}", recording))
    return items


def _stores(folder: Path, apart: Path | None) -> Iterator[Path]:
    if folder.resolve() == apart:
        return
    if (folder / "state.db").is_file():
        yield folder
        return
    if any(folder.glob("*.nc")) or any((folder / "records").glob("*.nc")):
        yield folder
        return
    yield from sorted(folder.glob("*.db"))
    for inner in sorted(path for path in folder.iterdir() if path.is_dir() and not path.is_symlink()):
        yield from _stores(inner, apart)


def run_batch(
    items: Sequence[Item],
    out: Path,
    *,
    options: Options,
    options_path: Path | None = None,
    config_path: Path | None = None,
    tables: bool = True,
    pdf: bool = False,
    workers: int = 0,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[Outcome]:
    """Report every run, each into a folder of its own, then the index.

    A page whose records, options and program are those of the last time stays as it is. A run that fails is listed in
    the index and in ``failures.json``; the others go on.

    Args:
        items: the runs.
        out: folder of the pages, made where it is missing.
        options: of the pages; maps in it have to be in ``options_path``, as processes read that file themselves.
        options_path: TOML file with ``[report]``.
        config_path: configuration with which recordings are replayed.
        tables: write every table as CSV and netCDF too.
        pdf: write every page, and the index, as PDF too.
        workers: processes; 0 means one a core.
        progress: told how many of how many are done.

    Returns:
        What became of each run.

    Raises:
        ReportError: the output folder or the index cannot be written, or what a PDF needs is missing.
    """
    if pdf:
        require_pdf()
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ReportError(f"{out}: cannot be made: {error.strerror or error}") from error
    plain = replace(options, maps={})
    tasks = [Task(item, out, plain, options_path, config_path, tables, pdf) for item in items]
    found = {task.item.name: outcome for task in tasks if (outcome := reused(task)) is not None}
    if found:
        progress(len(found), len(tasks))
    for outcome in _outcomes([task for task in tasks if task.item.name not in found], workers):
        found[outcome.item.name] = outcome
        progress(len(found), len(tasks))
    outcomes = [found[item.name] for item in items]
    from monitor.report.batch.index import write_index

    runs = [summary for outcome in outcomes for summary in outcome.summaries]
    failed = [(outcome.item.name, outcome.error) for outcome in outcomes if outcome.error]
    write_index(runs, failed, out, options, tables=tables, pdf=pdf)
    return outcomes


def _outcomes(tasks: Sequence[Task], workers: int) -> Iterator[Outcome]:
    """Yield what becomes of each task in order; where a process dies, the rest go on in one of their own each."""
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
                yield Outcome(task.item, (), "the process that made its report died")


def reused(task: Task) -> Outcome | None:
    """Return the outcome of a run whose page needs no making, else None."""
    try:
        kept = _kept(task.out / task.item.name, fingerprint(task), pdf=task.pdf)
    except OSError:
        return None
    return None if kept is None else Outcome(task.item, kept, reused=True)


def report_one(task: Task) -> Outcome:
    """Report one run of a batch; whatever goes wrong with it is its outcome."""
    try:
        return Outcome(task.item, _report(task, task.out / task.item.name, fingerprint(task)))
    except (ReportError, ConfigError, StoreError, OSError, ValueError) as error:
        return Outcome(task.item, (), _one_line(error))
    except Exception as error:  # One run that nobody thought of must not take the other thousands with it.
        frames = traceback.extract_tb(error.__traceback__)
        where = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
        return Outcome(task.item, (), f"{type(error).__name__}: {_one_line(error)}{where}")


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def _report(task: Task, folder: Path, print_of: str) -> tuple[RunSummary, ...]:
    from monitor.report.options import read_options
    from monitor.report.report import report_runs
    from monitor.report.tables import write_whole

    options = replace(read_options(task.options_path, task.options), title=None)
    source = _replayed(task, folder) if task.item.recording else task.item.path
    runs = read_runs(source)
    if len(runs) == 1:
        runs = [replace(runs[0], label=f"{runs[0].machine}, {task.item.name}")]
    options = replace(options, title=f"Bearing health: {task.item.name}")
    place = folder / "tables" if task.tables else None
    page, summaries = report_runs(runs, folder / "report.html", options=options, tables=place, pdf=task.pdf)
    link = f"{task.item.name}/{page.name}"
    linked = tuple(replace(item, link=link if len(runs) == 1 else f"{link}{item.link}") for item in summaries)
    stored = {"fingerprint": print_of, "runs": [item.to_dict() for item in linked]}
    # The last file to be written: where it is, the page is whole.
    write_whole(folder / _SUMMARY, json.dumps(stored, allow_nan=False, default=_no_nan))
    return linked


def _no_nan(value: Any) -> Any:
    raise TypeError(f"a summary holds {type(value).__name__}")


def _replayed(task: Task, folder: Path) -> Path:
    """Replay a recording into ``replay`` beside its page and return that folder."""
    from monitor.service.replay import replay

    if task.config_path is None:
        raise ReportError(f"{task.item.path}: is a recording; give --config FILE to replay it")
    store = folder / "replay"
    if store.exists():
        # Left by a run that was cut off; a replay is made again from the recording.
        for path in sorted(store.rglob("*"), reverse=True):
            path.rmdir() if path.is_dir() else path.unlink()
    folder.mkdir(parents=True, exist_ok=True)
    replay(load_config(task.config_path), str(task.item.path), store)
    return store


def fingerprint(task: Task) -> str:
    """Return a digest of all that makes a page: its records, options, configuration and the program's version."""
    digest = hashlib.sha256()
    options = task.options
    said = (
        __version__,
        VERSION,
        str(options.zone),
        sorted(options.sections),
        options.notes,
        task.tables,
        task.pdf,
        task.item,
    )
    digest.update(repr(said).encode())
    for path in (task.options_path, task.config_path if task.item.recording else None):
        digest.update(b"-" if path is None else path.read_bytes())
    for path in _inputs(task.item.path):
        found = path.stat()
        digest.update(repr((str(path), found.st_size, found.st_mtime_ns)).encode())
    return digest.hexdigest()


def _inputs(path: Path) -> list[Path]:
    """Return the files that a page is made of; a write-ahead log without anything in it comes and goes with readers."""
    if path.is_file():
        found = [path, *path.parent.glob(f"{glob.escape(path.name)}-wal")]
    else:
        found = sorted(item for item in path.rglob("*") if item.is_file())
    records = [item for item in found if item.suffix in (".db", ".nc", ".db-wal")]
    return [item for item in records or found if item.suffix != ".db-wal" or item.stat().st_size > 0]


def _kept(folder: Path, print_of: str, *, pdf: bool) -> tuple[RunSummary, ...] | None:
    """Return the summaries of a page that needs no making, else None."""
    try:
        stored = json.loads((folder / _SUMMARY).read_text(encoding="utf-8"))
        pages = ("report.html", "report.pdf") if pdf else ("report.html",)
        if stored["fingerprint"] != print_of or not all((folder / page).is_file() for page in pages):
            return None
        return tuple(RunSummary.from_dict(item) for item in stored["runs"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
