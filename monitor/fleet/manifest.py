"""The manifest of an archive: which recordings are of which machine, and with which configuration they are replayed.

TOML is for people, CSV for programs. Entries are yielded one by one, in the order of the file.
"""

from __future__ import annotations

import csv
import os
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, cast
from urllib.parse import unquote, urlsplit

from models.words.errors import WrongInputError
from monitor.config.positions import find_lines
from streams.files.remote import is_remote

History = Literal["each", "continued"]
HISTORIES: tuple[History, ...] = ("each", "continued")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
WORK_NAME = "archive-work"
"""Folder of the archive for what is needed until it is complete."""
TAKEN = (WORK_NAME, "index.db", "index.db.lock", "lease.json", "fleet.html", "records.zarr")
"""Names in the folder of an archive that are no machine's; nor are those that begin as SQLite's files of the index."""
_COLUMNS = ("machine", "config", "recording")
_FURTHER = ("history", "anew")
_KEYS = ("name", "config", "recordings", "history", "anew")


class ManifestError(WrongInputError):
    """The manifest cannot be used; the message names file and line, what was expected and what was found."""


@dataclass(frozen=True)
class ManifestEntry:
    """Recordings of one machine.

    Attributes:
        where: file and line, for messages.
        machine: its name, a part of paths.
        config: of the machine, an absolute path.
        recordings: paths, globs and URLs; relative paths are taken from the folder of the manifest.
        history: "each": every recording is a history of its own; "continued": they continue each other, in the order
            given, those of a glob in natural order of their names.
        anew: recordings with which the machine begins anew, as written in ``recordings`` or as a glob names them.
    """

    where: str
    machine: str
    config: Path
    recordings: tuple[str, ...]
    history: History = "each"
    anew: tuple[str, ...] = ()


def read_manifest(path: Path) -> Iterator[ManifestEntry]:
    """Yield the entries of a manifest, ``.toml`` or ``.csv``; a CSV is never held in memory.

    Raises:
        ManifestError: while it is read, naming file and line.
    """
    suffix = path.suffix.lower()
    if suffix not in (".toml", ".csv"):
        raise ManifestError(f"{path}: expected a name that ends in .toml or .csv")
    try:
        yield from _read_toml(path) if suffix == ".toml" else _read_csv(path)
    except (OSError, UnicodeDecodeError) as error:
        raise ManifestError(f"{path}: cannot be read: {error}") from None


def _read_toml(path: Path) -> Iterator[ManifestEntry]:
    text = path.read_text(encoding="utf-8-sig")
    try:
        values = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ManifestError(f"{path}: not TOML: {error}") from None
    lines = find_lines(text)
    unknown = [key for key in values if key != "machine"]
    machines = values.get("machine")
    if unknown or not isinstance(machines, list) or not machines:
        raise ManifestError(f"{path}: expected [[machine]] tables alone, got {', '.join(values) or 'nothing'}")
    for number, table in enumerate(cast("list[Any]", machines)):
        where = f"{path}:{lines.get(('machine', number), 1)}"
        if not isinstance(table, dict):
            raise ManifestError(f"{where}: expected a table [[machine]], got {table!r}")
        yield _entry_of(cast("dict[str, Any]", table), where, path.resolve().parent)


def _entry_of(table: Mapping[str, Any], where: str, folder: Path) -> ManifestEntry:
    for key in table:
        if key not in _KEYS:
            raise ManifestError(f"{where}: unknown key {key!r} of [[machine]]; expected {', '.join(_KEYS)}")
    recordings = table.get("recordings")
    if isinstance(recordings, str):
        recordings = [recordings]
    if not isinstance(recordings, list) or not recordings:
        raise ManifestError(f"{where}: recordings: expected a list of paths, globs or URLs, got {recordings!r}")
    listed = cast("list[Any]", recordings)
    if wrong := [item for item in listed if not isinstance(item, str) or not item.strip()]:
        raise ManifestError(f"{where}: recordings: expected paths, globs or URLs, got {wrong[0]!r}")
    return ManifestEntry(
        where,
        _machine_name(table.get("name"), where),
        _config_path(table.get("config"), where, folder),
        tuple(_from_folder(str(item).strip(), folder, f"{where}: recordings") for item in listed),
        _history(table.get("history", "each"), where),
        tuple(_from_folder(item, folder, f"{where}: anew") for item in _anew(table.get("anew", ()), where)),
    )


def _anew(value: object, where: str) -> Iterator[str]:
    """Yield the recordings of ``[[machine.anew]] at = RECORDING``."""
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise ManifestError(f"{where}: anew: expected tables [[machine.anew]] with at = RECORDING, got {value!r}")
    for item in cast("Sequence[Any]", value):
        table = cast("dict[str, Any]", item) if isinstance(item, dict) else {}
        at = table.get("at")
        if not isinstance(at, str) or not at.strip() or set(table) - {"at", "why"}:
            raise ManifestError(f"{where}: anew: expected at = RECORDING, and why = TEXT if you like, got {item!r}")
        yield at.strip()


def _read_csv(path: Path) -> Iterator[ManifestEntry]:
    folder = path.resolve().parent
    with path.open(encoding="utf-8-sig", newline="") as file:
        reader = csv.reader(file, strict=True)
        try:
            head = [column.strip() for column in next(reader, [])]
            allowed = {*_COLUMNS, *_FURTHER}
            if not {*_COLUMNS} <= {*head} <= allowed or len({*head}) < len(head):
                raise ManifestError(
                    f"{path}:1: expected the columns {', '.join(_COLUMNS)}, and {' and '.join(_FURTHER)} if you like, "
                    f"got {', '.join(head) or 'nothing'}"
                )
            for row in reader:
                if any(map(str.strip, row)):
                    yield _entry_of_row(row, head, f"{path}:{reader.line_num}", folder)
        except csv.Error as error:
            raise ManifestError(f"{path}:{reader.line_num}: not CSV: {error}") from None


def _entry_of_row(row: Sequence[str], head: Sequence[str], where: str, folder: Path) -> ManifestEntry:
    if len(row) != len(head):
        raise ManifestError(f"{where}: expected {len(head)} values, got {len(row)}")
    values = {column: value.strip() for column, value in zip(head, row, strict=True)}
    if not values["recording"]:
        raise ManifestError(f"{where}: recording: expected a path, a glob or a URL, got nothing")
    anew = values.get("anew", "")
    if anew not in ("", "yes", "no"):
        raise ManifestError(f"{where}: anew: expected yes, no or nothing, got {anew!r}")
    recording = _from_folder(values["recording"], folder, f"{where}: recording")
    return ManifestEntry(
        where,
        _machine_name(values["machine"], where),
        _config_path(values["config"], where, folder),
        (recording,),
        _history(values.get("history") or "each", where),
        (recording,) if anew == "yes" else (),
    )


def _machine_name(name: object, where: str) -> str:
    if not isinstance(name, str) or not _NAME.fullmatch(name) or _is_taken(name.lower()):
        raise ManifestError(
            f"{where}: name of the machine: expected letters, digits, '_', '.' or '-', at most 64, and none of "
            f"{', '.join(TAKEN)}; got {name!r}"
        )
    return name


def _is_taken(name: str) -> bool:
    return name in TAKEN or name.startswith("index.db")


def _config_path(config: object, where: str, folder: Path) -> Path:
    if not isinstance(config, str) or not config:
        raise ManifestError(f"{where}: config: expected the path of a configuration, got {config!r}")
    found = _below(folder, config, f"{where}: config")
    try:
        _look_up(found)
    except FileNotFoundError:
        raise ManifestError(f"{where}: config: there is no file {str(found)!r}") from None
    except OSError as error:
        raise ManifestError(f"{where}: config: {str(found)!r}: {error.strerror}") from None
    return found


@lru_cache(maxsize=256)
def _look_up(path: Path) -> None:
    """Look for a file once, as many rows name the same one; FileNotFoundError, which is not kept, without it."""
    if not path.is_file():
        raise FileNotFoundError(path)


def _history(history: object, where: str) -> History:
    if history not in HISTORIES:
        raise ManifestError(f"{where}: history: expected {' or '.join(HISTORIES)}, got {history!r}")
    return cast("History", history)


def _from_folder(recording: str, folder: Path, where: str) -> str:
    """Return a recording whose path, if it is relative, is taken from a folder; ``where`` is for the error."""
    if "://" in recording or recording.startswith("rig:"):
        return recording
    kind, colon, rest = recording.partition(":")
    if colon and kind == "folder":
        return f"folder:{_below(folder, rest, where)}"
    if colon and kind == "dataset":
        name, _, place = rest.partition(":")
        return f"dataset:{name}:{_below(folder, place, where)}"
    return str(_below(folder, recording, where))


def _below(folder: Path, path: str, where: str) -> Path:
    """Return a path, from a folder where it is relative; ManifestError where its ``~USER`` is unknown."""
    try:
        return folder / Path(path).expanduser()
    except RuntimeError:
        raise ManifestError(f"{where}: {path!r} is of a user who has no home folder here") from None


def local_path(url: str) -> Path | None:
    """Return the path that a recording of a manifest names, None where it names none."""
    if url.startswith("rig:") or is_remote(url):
        return None
    kind, colon, rest = url.partition(":")
    if colon and kind == "folder":
        return Path(rest)
    if colon and kind == "dataset":
        return Path(rest.partition(":")[2])
    return Path(url)


def without_file_scheme(url: str) -> str:
    """Return a ``file://`` URL as a path, so that a recording has one name however it is given; others as they are."""
    scheme, found, _ = url.partition("://")
    split = urlsplit(url) if found and scheme.lower() == "file" else None
    return url if split is None or split.netloc not in ("", "localhost") or not split.path else unquote(split.path)


def count_files(url: str) -> int | None:
    """Return the number of files in the folder that a recording is, in those below it too; None of anything else."""
    path = local_path(url)
    if path is None or not path.is_dir():
        return None
    return sum(len(files) for _, _, files in os.walk(path))
