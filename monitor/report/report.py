"""Reports: one page of one or several runs, and the index of a batch."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from monitor import __version__
from monitor.report.comparison import compare, laws, milestones, scores
from monitor.report.data_quality import without_folders
from monitor.report.figures.spectrum import SpectrumView
from monitor.report.options import Options
from monitor.report.page import is_pdf, require_pdf, write_page
from monitor.report.run_section import RunPart, part_of_run
from monitor.report.runs import Records, ReportError, Run, read_runs
from monitor.report.summary import RunSummary, summarise
from monitor.report.tables import Table, write_tables, write_whole
from monitor.report.trend_files import write_trends

_FILE_ATTRIBUTES = {"product_version": f"spallwatch {__version__}"}


def build_report(
    records: Records | Sequence[Records],
    out: Path,
    *,
    title: str | None = None,
    spectra: Mapping[str, tuple[Any, ...]] | None = None,
    pending: int = 0,
    notes: Sequence[str] = (),
    options: Options | None = None,
    tables: Path | None = None,
    pdf: bool = False,
) -> Path:
    """Write a report of one or several runs and return its path.

    Args:
        records: see :func:`monitor.report.runs.read_runs`.
        out: the file, HTML or, where its name ends in .pdf, PDF; replaced atomically.
        title: None for that of the options.
        spectra: by channel, an envelope spectrum that is not in the store, as the fields of :class:`SpectrumView`.
        pending: blocks offered but not yet accepted or rejected, where there is one run.
        notes: sentences at the top, after those of the options.
        options: None for all sections, in UTC.
        tables: folder for every table of the page and the trends of each channel, as CSV and netCDF; None for none.
        pdf: write a PDF beside ``out`` too.

    Raises:
        ReportError: the records cannot be read, a file cannot be written, or a requirement of PDF is missing.
    """
    if pdf or is_pdf(Path(out)):
        require_pdf()
    options = options or Options()
    options = replace(options, title=title or options.title, notes=(*options.notes, *notes))
    views = {name: SpectrumView(*view) for name, view in (spectra or {}).items()}
    page, _ = report_runs(
        read_runs(records), out, options=options, views=views, pending=pending, tables=tables, pdf=pdf
    )
    return page


def report_runs(
    runs: Sequence[Run],
    out: Path,
    *,
    options: Options,
    views: Mapping[str, SpectrumView] | None = None,
    pending: int = 0,
    tables: Path | None = None,
    pdf: bool = False,
) -> tuple[Path, list[RunSummary]]:
    """Write a report of runs in memory, see :func:`build_report`; return its path and a summary of each run."""
    numbers = itertools.count(1)
    parts = [
        part_of_run(run, options, views or {}, pending if len(runs) == 1 else 0, numbers, anchor=f"r{place}")
        for place, run in enumerate(runs, start=1)
    ]
    summaries = [
        summarise(run, part, f"#run{place}", scored=options.holds("score"))
        for place, (run, part) in enumerate(zip(runs, parts, strict=True), start=1)
    ]
    compared = compare(summaries, options, numbers) if len(runs) > 1 and options.holds("comparison") else None
    alone = _tables_over_runs(summaries, options) if compared is None else []
    write_page(
        Path(out),
        "report.html.j2",
        pdf=pdf,
        zoomed=any(picture.zoom for part in parts for channel in part.channels for picture in channel.pictures),
        title=options.title or f"Bearing health: {', '.join(dict.fromkeys(run.machine for run in runs))}",
        notes=[without_folders(note) for note in options.notes],
        runs=parts,
        compared=compared,
        scores=[table for table in alone if table.name == "scores"],
        options=options,
    )
    if tables is not None:
        write_tables(
            [*(alone if compared is None else compared.tables), *_tables_of_runs(parts)], tables, _FILE_ATTRIBUTES
        )
        write_trends(runs, tables, _FILE_ATTRIBUTES)
    return Path(out), summaries


def _tables_over_runs(summaries: Sequence[RunSummary], options: Options) -> list[Table]:
    """Return the tables over runs that apply to a single run too."""
    found = [milestones(summaries, options.zone), laws(summaries), scores(summaries)]
    return [table for table in found if table is not None]


def _tables_of_runs(parts: Sequence[RunPart]) -> list[Table]:
    """Return the tables of each run, under unique names."""
    prefixes = [f"run{place}-" if len(parts) > 1 else "" for place in range(1, len(parts) + 1)]
    return [
        replace(table, name=f"{prefix}{table.name}")
        for prefix, part in zip(prefixes, parts, strict=True)
        for table in part.tables.values()
    ]


def write_index(
    runs: Sequence[RunSummary],
    failed: Sequence[tuple[str, str]],
    out: Path,
    options: Options,
    *,
    tables: bool,
    pdf: bool = False,
) -> Path:
    """Write ``index.html`` and ``failures.json`` of a batch into the folder ``out``; return the index.

    ``failed`` has name and error of each run without a report. ``tables``: write the tables over runs to ``tables/``
    too; ``pdf``: write ``index.pdf`` too.

    Raises:
        ReportError: a file cannot be written.
    """
    compared = compare(runs, options, itertools.count(1))
    path = out / "index.html"
    write_page(
        path,
        "index.html.j2",
        pdf=pdf,
        title=options.title or "Bearing health: all runs",
        notes=options.notes,
        compared=compared,
        failed=[(name, without_folders(error)) for name, error in failed],
        options=options,
    )
    listed = out / "failures.json"
    try:
        write_whole(listed, json.dumps([{"run": name, "error": error} for name, error in failed], indent=1))
    except OSError as error:
        raise ReportError(f"{listed}: cannot be written: {error.strerror or error}") from error
    if tables:
        write_tables(compared.tables, out / "tables", _FILE_ATTRIBUTES)
    return path
