"""``spallwatch backup``, ``restore`` and ``archive-days``: the state of a machine on another disk, and back."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import click

from monitor.commands import option
from monitor.commands.common import emit, progress_bar, read_config, say
from monitor.config.load import Config
from monitor.records.backup import (
    BackupError,
    Contents,
    RefusedError,
    back_up,
    backups_of,
    find_backup,
    note_backup,
    read_note,
)
from monitor.records.database import StoreError
from monitor.records.published_folder import MovedDay, MovedDaysError, MoveFailedError, days_before, move_day
from monitor.records.restore import Places, restore
from monitor.service.system import StatusFile, is_running
from monitor.words.numbers import count


@click.command("backup")
@click.argument("folder", metavar="DIR", type=option.FOLDER)
@option.config
@click.option("--keep", type=click.IntRange(min=1), default=7, help="Number of backups of the machine that stay.")
@option.output
def command(folder: Path, config_path: Path | None, keep: int, quiet: bool) -> option.Result:
    """Back the state of a machine up below DIR while its daemon runs.

    A backup is a folder with the store, the published files, the configuration with its maps and libraries, and a
    manifest of their hashes. It is verified before it gets its name. Secrets are not in it.
    """
    config = read_config(config_path)
    state_dir, began, utc = config.machine.state_dir, time.monotonic(), time.time()
    contents = Contents(
        config.machine.name,
        state_dir / "state.db",
        config.machine.records_dir,
        dict(_configuration(config, config_path or Path("config.toml"))),
    )
    try:
        least = round(1e6 * config.machine.min_free_mb)
        backup, removed = back_up(contents, folder, keep=keep, utc=utc, min_free=least)
    except (BackupError, RefusedError) as error:
        _note(state_dir, {**read_note(state_dir), "failed_utc": _iso(utc), "problem": str(error)}, quiet=quiet)
        raise
    values = {
        "out": str(backup.folder.absolute()),
        "blocks": backup.blocks,
        "files": len(backup.files),
        "bytes": backup.size,
        "seconds": round(time.monotonic() - began, 3),
        "removed": removed,
    }
    _note(state_dir, {"utc": _iso(utc), "out": values["out"], "blocks": backup.blocks}, quiet=quiet)
    return values, _backup_lines(values)


def _configuration(config: Config, path: Path) -> Iterator[tuple[str, Path]]:
    """Yield the configuration, and the maps and libraries that it names, by their names in the backup."""
    yield f"config/{path.name}", path
    for channel in config.channel:
        # Maps of several parts may have the same name in folders of their own.
        named = [("" if place == 0 else f"{place + 1}-", file) for place, file in enumerate(channel.maps)]
        for prefix, file in (*named, ("", channel.library)):
            if file is not None and file.is_file():
                yield f"config/{channel.name}-{prefix}{file.name}", file
    learned = config.forecast.library
    if learned is not None and learned.is_file():
        yield f"config/forecast-{learned.name}", learned


def _note(state_dir: Path, values: Mapping[str, Any], *, quiet: bool) -> None:
    """Note a result for the status."""
    try:
        note_backup(state_dir, values)
    except OSError as error:
        say(f"the status will not say this: {state_dir}: {error.strerror or error}", quiet=quiet)


def _iso(utc: float) -> str:
    return datetime.fromtimestamp(utc, UTC).isoformat(timespec="seconds").replace("+00:00", "Z")


def _backup_lines(values: Mapping[str, Any]) -> Iterator[str]:
    yield (
        f"{values['out']}: {count(values['blocks'], 'block')}, {count(values['files'], 'file')}, "
        f"{values['bytes'] / 1e6:.1f} MB in {values['seconds']:.1f} s, verified"
    )
    yield from (f"removed: {name}" for name in values["removed"])


@click.command("restore")
@click.argument("folder", metavar="DIR", type=option.FOLDER)
@option.config
@click.option("--replace", is_flag=True, help="Keep a store that is there as state.db.before-restore-TIME.")
@option.output
def restore_command(folder: Path, config_path: Path | None, replace: bool) -> option.Result:
    """Put a backup in the place of the state of a machine; its daemon must be stopped.

    DIR is a backup, or a folder of them, of which the newest of the machine is taken. It is verified first. Published
    files that are missing are put back; those that are there stay.
    """
    config = read_config(config_path)
    machine, began = config.machine, time.monotonic()
    chosen = find_backup(folder, machine.name)
    try:
        with StatusFile.open(machine.state_dir):
            places = Places(machine.state_dir / "state.db", machine.records_dir)
            done = restore(chosen, machine.name, places, replace=replace, utc=time.time())
    except StoreError as error:
        raise RefusedError(f"{error}; stop it first" if is_running(machine.state_dir) else str(error)) from None
    except BackupError as error:
        others = [path.name for path in backups_of(folder, machine.name) if path != chosen]
        raise BackupError(f"{error}" + (f"; others are: {', '.join(others[-5:])}" if others else "")) from error
    values = {
        "from": str(chosen.absolute()),
        "created_utc": done.backup.manifest["created_utc"],
        "blocks": done.backup.blocks,
        "files": list(done.files),
        "aside": None if done.aside is None else str(done.aside),
        "same_configuration": done.backup.manifest["config_hash"] == config.hash,
        "seconds": round(time.monotonic() - began, 3),
    }
    return values, _restore_lines(values)


def _restore_lines(values: Mapping[str, Any]) -> Iterator[str]:
    yield f"restored {count(values['blocks'], 'block')} from {values['from']} of {values['created_utc']}"
    if values["files"]:
        yield f"put back: {', '.join(values['files'])}"
    if values["aside"] is not None:
        yield f"the store before is kept as {values['aside']}"
    if not values["same_configuration"]:
        yield f"made with another configuration, which is below {values['from']}/config"


_MAX_NAMED = 10


@click.command("archive-days")
@option.config
@click.option(
    "--before", type=click.DateTime(["%Y-%m-%d"]), required=True, metavar="DATE", help="Move the days before this one."
)
@click.option("--to", "folder", type=option.FOLDER, required=True, metavar="DIR", help="Folder that they are moved to.")
@option.output
def archive_days_command(config_path: Path | None, before: datetime, folder: Path, as_json: bool, quiet: bool) -> None:
    """Move the oldest published days to another folder, beside a running daemon or without one.

    Each file is copied, the copy is read back and compared, and only then the file is removed. What was moved stands in
    MACHINE-moved.json beside the published files. After an interruption, run it again. A day that cannot be moved stays
    and is named at the end, with exit code 1 where the system refuses, else 2.
    """
    machine = read_config(config_path).machine
    store = machine.state_dir / "state.db"
    machine.state_dir.mkdir(parents=True, exist_ok=True)
    days = days_before(machine.records_dir, machine.name, before.date())
    todo = progress_bar("moving days", quiet=quiet)(days, len(days))
    moved: list[MovedDay] = []
    refused: list[MovedDaysError] = []
    for path in todo:
        try:
            moved.append(move_day(path, machine.name, folder, store, time.time()))
        except MovedDaysError as error:
            refused.append(error)
    size = sum(day.size for day in moved)
    values = {"moved": [day.file for day in moved], "to": str(folder), "bytes": size}
    emit(values, [f"{len(moved)} days, {size / 1e6:.1f} MB, were moved to {folder}"], as_json=as_json)
    if refused:
        listed = list(dict.fromkeys(map(str, refused)))
        more = [f"and {len(listed) - _MAX_NAMED} days more"] if len(listed) > _MAX_NAMED else []
        failed = any(isinstance(error, MoveFailedError) for error in refused)
        raise (MoveFailedError if failed else MovedDaysError)("\n".join((*listed[:_MAX_NAMED], *more)))
