"""``spallwatch report``: one self-contained HTML page of one or several runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from monitor.commands.common import emit, output_options, say

if TYPE_CHECKING:
    from monitor.service.replay import Replay


@click.command("report")
@click.argument("records", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    default=Path("report.html"),
    show_default=True,
    help="The page.",
)
@click.option("--title", help="Of the page.")
@output_options
def command(records: tuple[Path, ...], out: Path, title: str | None, as_json: bool, quiet: bool) -> None:
    """Write one HTML page of RECORDS: netCDF files, folders of them, or state.db of one or several runs."""
    from monitor.report.report import build_report

    page = build_report(list(records), out, title=title)
    say(f"report: {page}", quiet=quiet)
    emit({"out": str(page)}, [], as_json=as_json)


def write_report(result: Replay, out: Path, title: str, notes: tuple[str, ...] = ()) -> Path:
    """Write the page of a replay that has just ended, with the envelope spectra that only it still has."""
    from monitor.report.report import build_report

    return build_report(
        result.store_path,
        out,
        title=title,
        spectra=result.spectra,
        pending=result.summary["pending"],
        notes=notes,
    )
