"""What stands beside the published files: the snapshot of the store, and the register of days that are elsewhere.

The register ``MACHINE-moved.json`` says which days were moved away, or deleted by the size cap, so that reports and the
rebuilding of a lost store can name them. It is written before a file is removed.

The snapshot ``MACHINE-state.json`` is written after the files and holds no block that they lack: the states of the
stages, each with its block, the newest rows of the small tables, and the sizes of the files. With the records it makes
a lost store again.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import asdict, dataclass, field, replace
from datetime import date
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from models.words.errors import WrongInputError
from monitor.records.durable import locked, make_folder, replacing, sync_file, sync_folder
from monitor.records.filing import published_files
from monitor.records.ledger import DATING
from monitor.records.store import Store

_LOCK = "days.lock"


class MovedDaysError(WrongInputError):
    """A published day cannot be moved, or the register cannot be used; the message names the file and the cause."""


class MoveFailedError(MovedDaysError):
    """The system refuses what a move needs."""

    exit_code = 1


@dataclass(frozen=True)
class MovedDay:
    """A published file that is no longer in its folder.

    Attributes:
        file: its name.
        to: folder that it was moved to, or None where it was deleted.
        size: bytes.
        blake2b: digest of its content, hexadecimal.
        utc: when it was moved, seconds since 1970.
    """

    file: str
    to: str | None
    size: int
    blake2b: str
    utc: float


def register_path(records_dir: Path, machine: str) -> Path:
    """Return the path of the register of a machine."""
    return records_dir / f"{machine}-moved.json"


def moved_days(records_dir: Path, machine: str) -> list[MovedDay]:
    """Return the moved and deleted days of a machine in the order of their names; MovedDaysError if unreadable."""
    path = register_path(records_dir, machine)
    try:
        return [MovedDay(**entry) for entry in json.loads(path.read_text(encoding="utf-8"))["days"]]
    except (FileNotFoundError, NotADirectoryError):
        return []
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise MovedDaysError(f"{path}: is not a register of moved days: {error}") from error


def moving_days(store: Path) -> AbstractContextManager[None]:
    """Keep others from writing or moving published files of the store's machine."""
    return locked(store.with_name(_LOCK))


def days_before(records_dir: Path, machine: str, before: date) -> list[Path]:
    """Return the published files of the days before a date, the oldest first."""
    first = f"{machine}-{before:%Y%m%d}.nc"
    # The undated file sorts after all days.
    return [path for path in published_files(records_dir, machine) if path.name < first]


def move_day(path: Path, machine: str, to: Path, store: Path, utc: float) -> MovedDay:
    """Copy a published file to a folder, compare the copy, note it in the register, and remove the file.

    An earlier copy is replaced where the file has all of its blocks: late ones came after it was moved. After an
    interruption at any moment the file or its whole copy is there, and the call can be repeated.

    Raises:
        MovedDaysError: the copy cannot be written, or a file with other blocks has its name; nothing is removed.
    """
    try:
        make_folder(to)
        if to.samefile(path.parent):
            raise MovedDaysError(f"{to}: is the folder of the published files; name another")
        with moving_days(store):
            digest = _digest(path)
            target = to / path.name
            if not target.exists() or (_digest(target) != digest and _holds_all_of(path, target)):
                with replacing(target) as temporary:
                    shutil.copyfile(path, temporary)
            sync_file(target)
            if _digest(target) != digest:
                raise MovedDaysError(
                    f"{target}: differs from {path}, which has not all of its blocks; nothing was removed"
                )
            moved = MovedDay(path.name, str(to.resolve()), path.stat().st_size, digest, utc)
            _remove(path, machine, moved)
    except OSError as error:
        raise MoveFailedError(f"{path}: cannot be moved to {to}: {error.strerror or error}") from error
    return moved


def delete_day(path: Path, machine: str, store: Path, utc: float) -> MovedDay:
    """Note a published file as deleted, and delete it; MovedDaysError where that is impossible."""
    try:
        with moving_days(store):
            deleted = MovedDay(path.name, None, path.stat().st_size, _digest(path), utc)
            _remove(path, machine, deleted)
    except OSError as error:
        raise MovedDaysError(f"{path}: cannot be deleted: {error.strerror or error}") from error
    return deleted


def reached_days(records_dir: Path, machine: str, beat: Callable[[], object] = lambda: None) -> list[Path]:
    """Return the moved days that are where they were moved to, as they were moved; ``beat`` is called for each.

    A register that cannot be read names none.
    """
    found: list[Path] = []
    with suppress(MovedDaysError):
        for entry in moved_days(records_dir, machine):
            beat()
            with suppress(OSError):
                if entry.to is not None and _digest(path := Path(entry.to) / entry.file) == entry.blake2b:
                    found.append(path)
    return found


def absence_text(moved: Sequence[MovedDay]) -> str | None:
    """Return which days are elsewhere as a sentence, or None without any."""
    if not moved:
        return None
    names = sorted(entry.file.removesuffix(".nc") for entry in moved)
    folders = sorted({Path(entry.to).name for entry in moved if entry.to is not None})
    deleted = sum(entry.to is None for entry in moved)
    parts = [f"{len(moved) - deleted} were moved to {', '.join(folders)}"] if folders else []
    parts += [f"{deleted} were deleted by the size cap"] if deleted else []
    span = names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"
    return f"{len(names)} published days ({span}) are not in this folder: {', '.join(parts)}"


def _remove(path: Path, machine: str, moved: MovedDay) -> None:
    known = [entry for entry in moved_days(path.parent, machine) if entry.file != moved.file]
    entries = sorted([*known, moved], key=lambda entry: entry.file)
    text = json.dumps({"days": [asdict(entry) for entry in entries]}, indent=1)
    with replacing(register_path(path.parent, machine)) as temporary:
        temporary.write_text(text, encoding="utf-8")
    path.unlink()
    sync_folder(path.parent)


def _holds_all_of(path: Path, other: Path) -> bool:
    """Return whether a published file has all blocks of another; not where that is none."""
    # The daemon, which reads the register, loads no netCDF.
    from monitor.records.second_copy import lost_blocks

    return lost_blocks(other, path) == 0


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, partial(hashlib.blake2b, digest_size=16)).hexdigest()


FORMAT = 1
_MAX_ROWS = 1000
_TABLES = {"notices": "id", "acknowledgements": "id", "refusals": "rowid", "told": "way", "stream_resets": "resets"}
"""Tables of the store of which the newest rows are published, and their order."""
# A single statement sees a single moment.
_STATES = """
SELECT (SELECT max(id) FROM blocks), stage_states.name, source, sequence, content_hash, state
FROM (SELECT 1) LEFT JOIN stage_states LEFT JOIN blocks ON blocks.id = block ORDER BY stage_states.name
"""


class StatedBlock(NamedTuple):
    """The state of a stage and the identity of the block after which it holds."""

    source: str
    sequence: int
    content_hash: str
    state: str


@dataclass(frozen=True)
class Snapshot:
    """What a store holds beside its records.

    Attributes:
        last_block: ledger number of the last block, 0 without one.
        states: by name of the stage.
        tables: rows by table, each a mapping by column.
        files: size in bytes of each file of records, by name.
    """

    machine: str
    last_block: int = 0
    states: Mapping[str, StatedBlock] = field(default_factory=dict[str, StatedBlock])
    tables: Mapping[str, list[dict[str, Any]]] = field(default_factory=dict[str, list[dict[str, Any]]])
    files: Mapping[str, int] = field(default_factory=dict[str, int])


def snapshot_path(records_dir: Path, machine: str) -> Path:
    """Return the path of the snapshot of a machine."""
    return records_dir / f"{machine}-state.json"


def take_snapshot(store: Store) -> Snapshot:
    """Return what a store holds now, without files; StoreError where it cannot be read."""
    rows = store.rows(_STATES)
    states = {row[1]: StatedBlock(*row[2:]) for row in rows if row[2] is not None}
    tables = {table: _newest(store, table) for table in _TABLES}
    dating = store.rows("SELECT key, value FROM meta WHERE key GLOB ?", f"{DATING}*")
    tables["meta"] = [{"key": key, "value": value} for key, value in dating]
    return Snapshot(store.machine, rows[0][0] or 0, states, tables)


def _newest(store: Store, table: str) -> list[dict[str, Any]]:
    """Return the newest rows of a table, oldest first; none where the store lacks it."""
    columns = [row[1] for row in store.rows(f"PRAGMA table_info({table})")]
    if not columns:
        return []
    rows = store.rows(f"SELECT {', '.join(columns)} FROM {table} ORDER BY {_TABLES[table]} DESC LIMIT {_MAX_ROWS}")
    return [dict(zip(columns, row, strict=True)) for row in reversed(rows)]


def write_snapshot(snapshot: Snapshot, records_dir: Path) -> None:
    """Replace the published snapshot durably; OSError where it cannot be written."""
    path = snapshot_path(records_dir, snapshot.machine)
    body = {"format": FORMAT, **{name: getattr(snapshot, name) for name in Snapshot.__dataclass_fields__}}
    with replacing(path) as temporary:
        temporary.write_text(json.dumps({**body, "digest": _snapshot_digest(body)}), encoding="utf-8")


def read_snapshot(records_dir: Path, machine: str) -> Snapshot | None:
    """Return the published snapshot of a machine; None where there is none, or it is not as it was written."""
    try:
        body = json.loads(snapshot_path(records_dir, machine).read_text(encoding="utf-8"))
        digest = body.pop("digest")
        if body["format"] != FORMAT or body["machine"] != machine or digest != _snapshot_digest(body):
            return None
        states = {name: StatedBlock(*values) for name, values in body["states"].items()}
        return Snapshot(machine, body["last_block"], states, body["tables"], body["files"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def is_published(snapshot: Snapshot, records_dir: Path) -> bool:
    """Return whether the published snapshot has the same states and tables."""
    present = read_snapshot(records_dir, snapshot.machine)
    return present is not None and replace(present, files=snapshot.files) == snapshot


def _snapshot_digest(body: Mapping[str, Any]) -> str:
    return hashlib.blake2b(json.dumps(body, sort_keys=True).encode(), digest_size=16).hexdigest()
