"""``spallwatch archive-days``: move the oldest published days to another folder."""

from __future__ import annotations

import time
from datetime import datetime
from pathlib import Path

import click

from monitor.commands import option
from monitor.commands.common import emit, progress_bar, read_config
from monitor.records.published_folder import MovedDay, MovedDaysError, days_before, move_day

_MAX_NAMED = 10


@click.command("archive-days")
@option.config
@click.option(
    "--before", type=click.DateTime(["%Y-%m-%d"]), required=True, metavar="DATE", help="Move the days before this one."
)
@click.option("--to", "folder", type=option.FOLDER, required=True, metavar="DIR", help="Folder that they are moved to.")
@option.output
def command(config_path: Path | None, before: datetime, folder: Path, as_json: bool, quiet: bool) -> None:
    """Move the oldest published days to another folder, beside a running daemon or without one.

    Each file is copied, the copy is read back and compared, and only then the file is removed. What was moved stands in
    MACHINE-moved.json beside the published files. After an interruption, run it again. A day that cannot be moved stays
    and is named at the end, with exit code 2.
    """
    machine = read_config(config_path).machine
    store = machine.state_dir / "state.db"
    machine.state_dir.mkdir(parents=True, exist_ok=True)
    days = days_before(machine.records_dir, machine.name, before.date())
    todo = progress_bar("moving days", quiet=quiet)(days, len(days))
    moved: list[MovedDay] = []
    refused: list[str] = []
    for path in todo:
        try:
            moved.append(move_day(path, machine.name, folder, store, time.time()))
        except MovedDaysError as error:
            refused.append(str(error))
    size = sum(day.size for day in moved)
    values = {"moved": [day.file for day in moved], "to": str(folder), "bytes": size}
    emit(values, [f"{len(moved)} days, {size / 1e6:.1f} MB, were moved to {folder}"], as_json=as_json)
    if refused:
        listed = list(dict.fromkeys(refused))
        more = [f"and {len(listed) - _MAX_NAMED} days more"] if len(listed) > _MAX_NAMED else []
        raise MovedDaysError("\n".join((*listed[:_MAX_NAMED], *more)))
