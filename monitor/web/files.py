"""Files that the page serves: its own, and the published records."""

from __future__ import annotations

import json
import mimetypes
import os
import re
import stat
import threading
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO

from monitor.web.answers import Answer, RequestError, answer_of
from monitor.web.machines import Machine, Machines
from monitor.words.page import page_words

_FOLDER = Path(__file__).parent / "static"
_TYPES = {".js": "text/javascript", ".mjs": "text/javascript", ".svg": "image/svg+xml", ".LICENSE": "text/plain"}
_WORDS = b'<script type="application/json" id="words">'
_lock = threading.Lock()
_known: dict[str, tuple[tuple[int, int], Answer]] = {}


def static_file(name: str, folder: Path = _FOLDER) -> Answer:
    """Return a file of the page, kept in memory until it changes; :class:`RequestError` 404 where there is none."""
    if name not in {path.relative_to(folder).as_posix() for path in folder.rglob("*") if _is_plain(path)}:
        raise RequestError(404, "there is no such file")
    path = folder / name
    found = path.stat()
    state = (found.st_mtime_ns, found.st_size)
    with _lock:
        known = _known.get(str(path))
        if known is None or known[0] != state:
            known = _known[str(path)] = (state, answer_of(_content(path), _type_of(path), level=9))
        return known[1]


def _content(path: Path) -> bytes:
    """Return the bytes of a file; ``index.html`` with the words of the page in its place for them."""
    content = path.read_bytes()
    # "<" is escaped so that no word can end the element.
    words = json.dumps(page_words(), ensure_ascii=False).replace("<", "\\u003c").encode()
    return content.replace(_WORDS + b"{}", _WORDS + words) if path.name == "index.html" else content


def _is_plain(path: Path) -> bool:
    return path.is_file() and not path.is_symlink()


def _type_of(path: Path) -> str:
    kind = _TYPES.get(path.suffix) or mimetypes.guess_type(path.name)[0] or "application/octet-stream"
    return f"{kind}; charset=utf-8" if kind.startswith("text/") else kind


def published_files(site: Machines) -> dict[str, Any]:
    """Return the published files of all machines, by name."""
    found = []
    for machine in site:
        for name, state in _published(machine).items():
            modified = datetime.fromtimestamp(state.st_mtime, UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
            found.append({"machine": machine.name, "file": name, "bytes": state.st_size, "modified_utc": modified})
    return {"files": sorted(found, key=lambda item: item["file"])}


def open_published(site: Machines, name: str) -> tuple[BinaryIO, int]:
    """Return an open published file and its size; :class:`RequestError` 404 where there is none of this name."""
    for machine in site:
        if name in _published(machine):
            try:
                descriptor = os.open(machine.records_dir / name, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW)
            except OSError:
                continue
            file = os.fdopen(descriptor, "rb")
            return file, os.fstat(descriptor).st_size
    raise RequestError(404, "there is no such file")


def _published(machine: Machine) -> dict[str, os.stat_result]:
    """Return the files of a machine's folder that have the name of a day or of the undated records; no links."""
    pattern = re.compile(rf"{re.escape(machine.name)}-(\d{{8}}|undated)\.nc")
    found: dict[str, os.stat_result] = {}
    try:
        with os.scandir(machine.records_dir) as entries:
            for entry in entries:
                if pattern.fullmatch(entry.name):
                    state = entry.stat(follow_symlinks=False)
                    if stat.S_ISREG(state.st_mode):
                        found[entry.name] = state
    except OSError:
        # Nothing is published yet, or the folder cannot be reached.
        return {}
    return found
