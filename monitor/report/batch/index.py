"""The index of a batch: all runs in one table, compared, and the failures with their causes."""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from pathlib import Path

from monitor import __version__
from monitor.report.batch.comparison import compare
from monitor.report.batch.summary import RunSummary
from monitor.report.data_quality import without_folders
from monitor.report.options import Options
from monitor.report.report import write_page
from monitor.report.runs import ReportError
from monitor.report.tables import write_tables, write_whole


def write_index(
    runs: Sequence[RunSummary],
    failed: Sequence[tuple[str, str]],
    out: Path,
    options: Options,
    *,
    tables: bool,
    pdf: bool = False,
) -> Path:
    """Write ``index.html`` and ``failures.json`` of a batch, and its tables where they are wanted.

    Args:
        runs: summaries of all reported runs.
        failed: name and error of each run that could not be reported.
        out: folder of the batch.
        options: of its pages.
        tables: write the tables over runs to ``tables/`` too.
        pdf: write ``index.pdf`` too.

    Returns:
        The index.

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
        told = [{"run": name, "error": error} for name, error in failed]
        write_whole(listed, json.dumps(told, indent=1))
    except OSError as error:
        raise ReportError(f"{listed}: cannot be written: {error.strerror or error}") from error
    if tables:
        write_tables(compared.tables, out / "tables", {"product_version": f"spallwatch {__version__}"})
    return path
