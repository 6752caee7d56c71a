"""Refused senders: log lines at a limited rate, and notices for the event log."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

_LOG = logging.getLogger(__name__)
_MAX_LINES = 5
"""Lines of one kind within ``_LINES_S``; the others are counted."""
_LINES_S = 60.0
_NOTICE_S = 3600.0
"""Least time between two notices of one kind and source."""

LINK, JUMP, KEY = "link", "stream_refused", "sender_refused"
"""Kinds of refusals; the last two are also kinds of notices."""


@dataclass
class _Lines:
    since: float
    written: int = 0
    left_out: int = 0
    latest: str = ""


@dataclass
class _Notices:
    due: float = float("-inf")
    times: int = 0
    waiting: list[str] = field(default_factory=list)


class SenderRefusals:
    """Counts refusals, writes some of them to the log, and collects notices; used from any thread."""

    def __init__(self, name: str, clock: Callable[[], float] = time.monotonic) -> None:
        """Begin without any; ``name`` is of the source, ``clock`` monotonic seconds."""
        self._name, self._clock = name, clock
        self._lock = threading.Lock()
        self._lines: dict[str, _Lines] = {}
        self._notices: dict[tuple[str, str], _Notices] = {}
        self.count = 0
        """All refusals so far."""

    def add(self, reason: str, kind: str = LINK, source: str | None = None) -> None:
        """Log a refusal, and note it if it is of a kind for notices and names the source."""
        now = self._clock()
        with self._lock:
            self.count += 1
            self._write(kind, reason, now)
            if kind == LINK or source is None:
                return
            notices = self._notices.setdefault((kind, source), _Notices())
            notices.times += 1
            if now >= notices.due and not notices.waiting:
                notices.due = now + _NOTICE_S
                notices.waiting.append(reason)

    def _write(self, kind: str, reason: str, now: float) -> None:
        lines = self._lines.get(kind)
        if lines is None or now - lines.since >= _LINES_S:
            self._finish(lines)
            lines = self._lines[kind] = _Lines(now)
        if lines.written < _MAX_LINES:
            lines.written += 1
            _LOG.warning("source %s: %s", self._name, reason)
        else:
            lines.left_out += 1
            lines.latest = reason

    def _finish(self, lines: _Lines | None) -> None:
        if lines is not None and lines.left_out:
            _LOG.warning("source %s: %d more like this, the latest: %s", self._name, lines.left_out, lines.latest)

    def tick(self) -> None:
        """Log how many lines were left out, once their time is over."""
        now = self._clock()
        with self._lock:
            for kind, lines in list(self._lines.items()):
                if now - lines.since >= _LINES_S:
                    self._finish(lines)
                    del self._lines[kind]

    def take(self) -> list[dict[str, Any]]:
        """Return the new notices for the event log."""
        found = []
        with self._lock:
            for (kind, source), notices in self._notices.items():
                if notices.waiting:
                    found.append(
                        {"kind": kind, "source": source, "times": notices.times, "text": notices.waiting.pop()}
                    )
                    notices.times = 0
        return found
