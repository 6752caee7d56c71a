"""Files during whose handling the process died: what was being handled, how often, and what is poisoned.

What is handled is written to a file beside the store, into one slot for each source and one for the thread that
analyses and commits, without waiting for the disk: the note has to survive the process, not a power cut. A process that
ends properly removes it. One that finds notes at its start counts a death for each file in them.

A process that is killed at any moment is likely to be analysing something. So a death within an analysis that takes
milliseconds counts as half of one; reading is noted only where it takes long.
"""

from __future__ import annotations

import json
import os
import sqlite3
import threading
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from models.platform.portable import BINARY, read_at, write_at
from monitor.records.database import Closing

TABLE = """CREATE TABLE IF NOT EXISTS deaths (
    source TEXT NOT NULL, path TEXT NOT NULL, times REAL NOT NULL, PRIMARY KEY (source, path)
) WITHOUT ROWID"""
_SLOT_BYTES = 4096
_MAX_SLOTS = 256
_EMPTY = b"\n"

QUICK, SLOW = 0.5, 1.0
"""Deaths as which one counts, by the usual duration of what was done."""

Handled = tuple[str, tuple[str, ...], float]
"""A source, the paths of files in its folder, and as how many deaths one counts."""


class HandlingNotes(Closing):
    """The notes of one process; its methods may be called from any thread.

    A slot is a line of JSON, ``[source, [path, ...], deaths, analysed]``, or an empty one. A note that cannot be
    written, or that is too long, is left out.
    """

    def __init__(self, path: Path) -> None:
        """Read the notes that the process before left in the file at ``path``."""
        self._lock = threading.Lock()
        self._slots: dict[tuple[str, bool], int] = {}
        self._handle: int | None = None
        self.left: list[Handled] = []
        with suppress(OSError):
            self._handle = os.open(path, os.O_RDWR | os.O_CREAT | BINARY, 0o600)
            self.left = _blamed(read_at(self._handle, _SLOT_BYTES * _MAX_SLOTS, 0))

    def write(self, source: str, paths: Sequence[str], deaths: float = SLOW, *, analysed: bool = False) -> None:
        """Note the files of a source that are read, or analysed, from now on; none: the handling is over."""
        note = json.dumps([source, list(paths), deaths, analysed]).encode() + b"\n" if paths else _EMPTY
        with self._lock, suppress(OSError):
            slot = self._slots.setdefault((source, analysed), len(self._slots))
            if self._handle is not None and slot < _MAX_SLOTS:
                write_at(self._handle, note if len(note) <= _SLOT_BYTES else _EMPTY, slot * _SLOT_BYTES)

    def clear(self) -> None:
        """Remove all notes."""
        with self._lock, suppress(OSError):
            if self._handle is not None:
                os.ftruncate(self._handle, 0)

    def close(self) -> None:
        """Remove all notes: the process ends properly."""
        self.clear()
        with self._lock:
            handle, self._handle = self._handle, None
            if handle is not None:
                os.close(handle)


def _blamed(data: bytes) -> list[Handled]:
    """Return the files in the notes of a process that died: those analysed, else those read in the background.

    An analysis takes milliseconds, reading in the background up to many seconds, so it goes on meanwhile.
    """
    found: dict[bool, list[Handled]] = {True: [], False: []}
    for place in range(0, len(data), _SLOT_BYTES):
        with suppress(ValueError, TypeError):
            source, paths, deaths, analysed = json.loads(data[place : place + _SLOT_BYTES].partition(b"\n")[0])
            found[bool(analysed)].append((str(source), tuple(map(str, paths)), float(deaths)))
    return found[True] or found[False]


def count_deaths(connection: sqlite3.Connection, handled: Sequence[Handled]) -> None:
    """Count a death, or half of one, for each file, within an open transaction."""
    connection.executemany(
        "INSERT INTO deaths VALUES (?, ?, ?) ON CONFLICT DO UPDATE SET times = times + excluded.times",
        [(source, path, deaths) for source, paths, deaths in handled for path in paths],
    )
