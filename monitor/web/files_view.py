"""The published files of records: which there are, and their download."""

from __future__ import annotations

import os
import re
import stat
from datetime import UTC, datetime
from typing import Any, BinaryIO

from monitor.web.answers import RequestError
from monitor.web.machines import Machine, Machines


def files(site: Machines) -> dict[str, Any]:
    """Return the published files of all machines, by name."""
    found = []
    for machine in site:
        for name, state in _published(machine).items():
            modified = datetime.fromtimestamp(state.st_mtime, UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
            found.append({"machine": machine.name, "file": name, "bytes": state.st_size, "modified_utc": modified})
    return {"files": sorted(found, key=lambda item: item["file"])}


def open_file(site: Machines, name: str) -> tuple[BinaryIO, int]:
    """Return an open published file and its size; it stays whole, also where it is published anew meanwhile.

    Raises:
        RequestError: 404, there is none of this name.
    """
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
        # Nothing is published yet, or the folder is away.
        return {}
    return found
