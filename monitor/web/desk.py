"""The import desk of the page: folders below the configured ones, how they are read, and their configuration."""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from models.words.errors import WrongInputError
from monitor.config.fields import NAME_PATTERN
from monitor.web.answers import Answer, Query, RequestError, json_answer, json_object, numbers, without_folders
from monitor.web.security import MAX_BODY_BYTES

if TYPE_CHECKING:
    from monitor.desk.preview import ChannelPreview, Curve
    from monitor.desk.recording import RecordingDescription

MAX_FILE_BYTES = 1 << 28
"""Files that are larger are left to ``spallwatch init``."""
_MAX_LISTED = 500
_MAX_POINTS, _MIN_POINTS, _ALL_POINTS = 400, 60, 3200
"""Points of a curve, and of those of all channels."""
_MAX_DRAWN = 16
"""Channels that are drawn."""
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class ImportFolders:
    """Folders that the page may read, and the folder of the configurations that it may add to.

    Attributes:
        roots: what ``[web] import_folders`` names; none: there is no desk.
        configurations: where a configuration is saved.
    """

    roots: tuple[Path, ...]
    configurations: Path

    def place(self, text: str) -> Path:
        """Return a file or folder below a root, links resolved.

        Raises:
            RequestError: 403 where it is outside, whether it exists or not; 404 where there is none.
        """
        try:
            found = Path(text).resolve()
            inside = self.contains(found)
        except (OSError, ValueError, RuntimeError):
            # A null character, a link to itself.
            inside, found = False, Path()
        if not inside:
            raise RequestError(403, "this is outside the folders that [web] import_folders allows")
        if not found.exists():
            raise RequestError(404, f"there is no {found.name!r} in that folder")
        return found

    def contains(self, place: Path) -> bool:
        """Return whether a place whose links are resolved is a root or below one."""
        return any(place == root or root in place.parents for root in map(Path.resolve, self.roots))

    def checked(self, text: str) -> Path:
        """Return a place all of whose files may be read: none a link to the outside, none too large.

        Raises:
            RequestError: 403, 404, or 413 where a file is too large.
        """
        place = self.place(text)
        for file in _files_below(place):
            if file.is_symlink() and not self.contains(file.resolve()):
                raise RequestError(403, f"{file.name} is a link to a place outside [web] import_folders")
            size = file.stat().st_size if file.exists() else 0
            if size > MAX_FILE_BYTES:
                raise RequestError(
                    413, f"{file.name} has {size >> 20} MB, the page reads files up to {MAX_FILE_BYTES >> 20} MB; use "
                    "spallwatch init"
                )  # fmt: skip
        return place


NO_FOLDERS = ImportFolders((), Path())
"""There is no desk."""


def _files_below(place: Path) -> Iterator[Path]:
    """Yield a file, or all files and links below a folder; hidden ones are not read."""
    if not place.is_dir():
        yield place
        return
    for folder, folders, files in os.walk(place):
        folders[:] = [name for name in folders if not name.startswith(".")]
        links = [name for name in folders if (Path(folder) / name).is_symlink()]
        yield from (Path(folder) / name for name in (*files, *links) if not name.startswith("."))


def listing(folders: ImportFolders, query: Query) -> dict[str, Any]:
    """Return the folders and files of a folder, without a path those of the roots."""
    text = query.get("path", "")
    if not folders.roots:
        raise RequestError(404, "no folder is open to the import desk; [web] import_folders names them")
    if not text:
        entries = [{"name": root.name or str(root), "path": str(root), "folder": True} for root in folders.roots]
        return {"path": None, "parent": None, "entries": entries, "more": 0}
    place = folders.place(text)
    if not place.is_dir():
        raise RequestError(400, f"{place.name} is no folder")
    try:
        found = sorted((path for path in place.iterdir() if not path.name.startswith(".")), key=lambda path: path.name)
    except OSError as error:
        raise RequestError(403, f"{place.name} cannot be read ({error.strerror})") from None
    found = [path for path in found if not path.is_symlink() or folders.contains(path.resolve())]
    found.sort(key=lambda path: not path.is_dir())
    entries = [
        {"name": path.name, "path": str(path), "folder": path.is_dir(), "bytes": _bytes_of(path)}
        for path in found[:_MAX_LISTED]
    ]
    is_root = any(place == root.resolve() for root in folders.roots)
    more = max(0, len(found) - _MAX_LISTED)
    return {"path": str(place), "parent": None if is_root else str(place.parent), "entries": entries, "more": more}


def _bytes_of(path: Path) -> int | None:
    try:
        return None if path.is_dir() else path.stat().st_size
    except OSError:
        return None


def look(folders: ImportFolders, body: bytes) -> Answer:
    """Return how a folder or file is read; 400 with the key of the answer that is none."""
    return _with_keys(lambda: json_answer(described_values(*_described(folders, body))))


def save(folders: ImportFolders, body: bytes, user: str | None) -> Answer:
    """Write the configuration; a file that is there is kept, and refused."""

    def write() -> Answer:
        found, _ = _described(folders, body)
        out = found.save()
        _LOG.warning("%s saved the configuration %s by the import desk", user or "the holder of the token", out.name)
        next_word = "run" if found.desk.seen.is_folder else "replay"
        return json_answer({"file": out.name, "next": f"spallwatch {next_word} --config {out.name}"}, 201)

    return _with_keys(write)


def _with_keys(make: Any) -> Answer:
    from monitor.desk.desk import DeskError

    try:
        return make()
    except DeskError as error:
        return json_answer({"error": without_folders(error.sentence), "key": error.key}, 400)
    except WrongInputError as error:
        return json_answer({"error": without_folders(str(error)), "key": ""}, 400)


def _described(folders: ImportFolders, body: bytes) -> tuple[RecordingDescription, Path]:
    from monitor.desk.desk import DeskError
    from monitor.desk.recording import describe

    given = json_object(body[:MAX_BODY_BYTES])
    if given is None or not isinstance(given.get("path"), str) or not isinstance(given.get("answers", {}), dict):
        raise RequestError(400, "the body must be a JSON object with the path, and the answers as an object")
    texts = {key: given.get(key) or "" for key in ("name", "file", "timezone", "format")}
    if not all(isinstance(text, str) for text in texts.values()):
        raise RequestError(400, "name, file, timezone and format must be texts")
    place = folders.checked(given["path"])
    name = texts["file"].removesuffix(".toml")
    if name and re.fullmatch(NAME_PATTERN, name) is None:
        raise DeskError("file", f"expected up to 64 letters, digits, _ . and -, then .toml; got {texts['file']!r}")
    out = folders.configurations / f"{name or 'config'}.toml"
    found = describe(
        str(place), given.get("answers", {}), out=out, kind=texts["format"] or "auto",
        timezone=texts["timezone"] or "UTC", name=texts["name"] or None,
    )  # fmt: skip
    return found, place


def described_values(found: RecordingDescription, place: Path) -> dict[str, Any]:
    """Return a description as plain values; configuration and doubts are null while answers are missing."""
    from monitor.desk.preview import channels_of

    preview = None if found.missing else found.preview()
    rate = found.desk.seen.rate or found.desk.answers.rate_hz
    points = max(_MIN_POINTS, min(_MAX_POINTS, _ALL_POINTS // max(1, len(found.desk.seen.vibration))))
    channels = () if rate is None else channels_of(found.desk, points, _MAX_DRAWN)
    return {
        "path": str(place),
        "machine": found.desk.machine,
        "columns": [_finite(asdict(column)) for column in found.columns],
        "facts": [asdict(fact) for fact in found.facts],
        "questions": [
            {key: getattr(question, key) for key in ("key", "words", "why", "default", "proposed")}
            for question in found.questions
        ],
        "dates": [{"file": date.file, "time_s": date.time} for date in found.dates],
        "channels": [_channel_values(channel) for channel in channels],
        "ends": [] if preview is None else list(preview.ends),
        "doubts": None
        if preview is None
        else [
            {key: without_folders(getattr(doubt, key)) for key in ("severity", "key", "came", "expected")}
            for doubt in preview.doubts
        ],
        "configuration": None if preview is None else found.configuration(),
    }


def _finite(values: dict[str, Any]) -> dict[str, Any]:
    """Return values with None in place of numbers that JSON has not."""
    return {key: None if isinstance(v, float) and not np.isfinite(v) else v for key, v in values.items()}


def _channel_values(channel: ChannelPreview) -> dict[str, Any]:
    return {
        "name": channel.name,
        "bearing": channel.bearing,
        "unit": channel.unit,
        **dict(zip(("rms", "peak"), numbers(np.array([channel.rms, channel.peak])), strict=True)),
        "lines_hz": {part: numbers(np.array(lines)) for part, lines in channel.lines.items()},
        "signal": _curve_values(channel.signal, "step_s"),
        "spectrum": _curve_values(channel.spectrum, "step_hz"),
    }


def _curve_values(curve: Curve, step: str) -> dict[str, Any]:
    return {step: curve.step, "low": numbers(curve.low, 4), "high": numbers(curve.high, 4)}
