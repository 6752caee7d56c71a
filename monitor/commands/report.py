"""``spallwatch report``: one self-contained HTML page of one or several runs, or one per run and an index."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from monitor.commands import option
from monitor.commands.cluster_options import Sharing, sharing
from monitor.commands.common import InputError, say
from monitor.words.numbers import duration

if TYPE_CHECKING:
    from monitor.commands.report_batch import BatchSettings, ReportOutcome


@click.command("report")
@click.argument("records", nargs=-1, type=option.FILE)
@click.option("--out", type=option.FILE, help="The page, .html or .pdf [report.html]; with --batch a folder [reports].")
@click.option("--title", help="Title of the page.")
@click.option("--timezone", help="Time zone of dates, such as Europe/Rome. [UTC]")
@click.option(
    "--map",
    "maps",
    multiple=True,
    metavar="FILE|CHANNEL=FILE",
    help="RMS map under the path of the tracker; repeatable.",
)
@click.option("--include", type=option.OUT_FILE, help="TOML file whose [report] selects the content.")
@click.option("--tables/--no-tables", default=None, help="Write every table as CSV and netCDF. [with --batch]")
@click.option("--batch", type=option.FOLDER, help="Report every run under this folder.")
@click.option("--config", "config_path", type=option.FILE, help="With --batch: replay recordings.")
@click.option("--pdf", is_flag=True, help="Write every page as PDF too (needs the extra pdf and Pango).")
@sharing("With --batch: processes")
@option.output
def command(
    records: tuple[Path, ...],
    out: Path | None,
    title: str | None,
    timezone: str | None,
    maps: tuple[str, ...],
    include: Path | None,
    tables: bool | None,
    batch: Path | None,
    config_path: Path | None,
    pdf: bool,
    sharing: Sharing,
    quiet: bool,
) -> option.Result:
    """Write one page, HTML or PDF, of RECORDS: netCDF files, folders of them, or state.db of one or several runs.

    With --batch, write a page for each run under a folder and an index of them all. Pages that are complete and
    unchanged are kept, also without --resume. A run that fails is listed in the index and in failures.json, and the
    exit code is then 1.
    """
    from monitor.commands.report_batch import BatchSettings
    from monitor.report.options import Options, read_maps, read_options, zone_of

    options = read_options(include, Options())
    if timezone is not None:
        options = replace(options, zone=zone_of(timezone, "--"))
    options = replace(options, title=title or options.title)
    if batch is not None:
        if records or maps:
            raise InputError("--batch DIR takes no RECORDS and no --map; name maps in the [report.maps] of --include")
        settings = BatchSettings(options, include, config_path, tables is not False, pdf)
        return _batch(batch, out or Path("reports"), settings, sharing, quiet=quiet)
    if not records:
        raise click.UsageError("Missing argument 'RECORDS...' (or --batch DIR).")
    if config_path is not None:
        raise InputError("--config belongs to --batch; to replay one recording: spallwatch replay")
    if sharing.cluster is not None:
        raise InputError("--cluster belongs to --batch: one page is made here")
    if sharing.chunks is not None:
        raise InputError("--chunks belongs to --batch: one page is made here")
    from monitor.report.report import build_report

    options = replace(options, maps={**options.maps, **read_maps(maps)})
    page = out or Path("report.html")
    folder = page.with_name(f"{page.stem}-tables") if tables else None
    build_report(list(records), page, options=options, tables=folder, pdf=pdf)
    say(f"report: {page}", quiet=quiet)
    values: dict[str, Any] = {"out": str(page)}
    if pdf:
        values["pdf"] = str(page.with_suffix(".pdf"))
    if folder is not None:
        values["tables"] = sorted(str(path) for path in folder.iterdir())
    return values, []


def _batch(folder: Path, out: Path, settings: BatchSettings, sharing: Sharing, *, quiet: bool) -> option.Result:
    from monitor.commands.report_batch import find_runs, run_batch
    from monitor.report.comparison import grade_of

    began = time.perf_counter()
    runs = find_runs(folder, recordings=settings.config_path is not None, leave_out=out)
    # The pages are what is kept of a batch, rather than chunks.
    with replace(sharing, resume=False).open(out, quiet=quiet) as shared:
        outcomes = run_batch(runs, out, settings, shared.runner, elsewhere=sharing.cluster is not None)
    seconds = time.perf_counter() - began
    failed = sum(bool(outcome.error) for outcome in outcomes)
    values = {
        "index": str(out / "index.html"),
        "runs": [
            {
                "name": outcome.run.name,
                "path": str(outcome.run.path),
                "report": None if outcome.error else str(out / outcome.run.name / "report.html"),
                "states": [grade_of(summary) for summary in outcome.summaries],
                "reused": outcome.reused,
                "error": outcome.error or None,
            }
            for outcome in outcomes
        ],
        "failed": failed,
        "reused": sum(outcome.reused for outcome in outcomes),
        "seconds": seconds,
        "cluster": shared.values(),
    }
    return values, [*_lines(outcomes, out, seconds), *shared.lines()], failed > 0


def _lines(outcomes: Sequence[ReportOutcome], out: Path, seconds: float) -> Iterator[str]:
    failed = [outcome for outcome in outcomes if outcome.error]
    reused = sum(outcome.reused for outcome in outcomes)
    yield (
        f"{len(outcomes) - len(failed)} of {len(outcomes)} runs reported in {duration(seconds)}"
        + (f", {reused} of them unchanged" if reused else "")
    )
    for outcome in failed:
        yield f"failed: {outcome.run.name}: {outcome.error}"
    yield f"index: {out / 'index.html'}"
