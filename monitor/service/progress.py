"""Whether a daemon goes on: how long each source waits for a commit, and what a status that is old means.

Progress of a source is a commit of one of its blocks. Its age counts while blocks wait that could be committed at once;
a file that is not complete, and a sender that sends nothing, are no such wait.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

MAX_STATUS_AGE_S = 15.0
"""Age of a status file beyond which its daemon is stalled; it is written every second, on a slow machine every five."""
MAX_PROGRESS_AGE_S = 60.0
"""Wait of a source beyond which it is stalled, where no problem says why."""
_ALL = frozenset(("disk", "store"))
"""Problems with which no source goes on."""
_FROZEN = frozenset("Tt")
_MAX_LOOK_S = 5.0
"""Longest time between two looks that counts: a process that was frozen did not wait."""


class SourceProgress:
    """The age of the progress of each source, seen in the thread that commits."""

    def __init__(self, monotonic: Callable[[], float] = time.monotonic) -> None:
        """Begin when nothing waits."""
        self._monotonic = monotonic
        self._looked = monotonic()
        self._ages: dict[str, float] = {}

    def note(self, source: str) -> None:
        """Note that a block of a source is committed and acknowledged."""
        self._ages[source] = 0.0

    def look(self, ready: Mapping[str, int]) -> None:
        """Look at how many blocks of each source could be committed at once."""
        now = self._monotonic()
        passed, self._looked = min(now - self._looked, _MAX_LOOK_S), now
        for source, waiting in ready.items():
            self._ages[source] = self._ages.get(source, 0.0) + passed if waiting else 0.0

    def ages(self) -> dict[str, float]:
        """Return for how long blocks of each source have waited without a commit of one of them, s."""
        return {source: round(age, 3) for source, age in self._ages.items()}

    def stalled(self, reasons: Collection[str]) -> list[str]:
        """Return the sources that are stalled for no known reason; ``reasons`` are names of sources, "disk", "store".

        A full disk or a store that fails is the reason for all.
        """
        if not _ALL.isdisjoint(reasons):
            return []
        return [source for source, age in self._ages.items() if age > MAX_PROGRESS_AGE_S and source not in reasons]


def stall_of(status: Mapping[str, Any], path: Path, clock: Callable[[], float] = time.time) -> str | None:
    """Return in a sentence why a daemon that has its lock does not go on, or None.

    ``status`` is the content of the status file ``path``. A file that a full disk keeps from being written is old too:
    that is a problem of its own.
    """
    if status.get("pid") is not None and _is_frozen(int(status["pid"]), status.get("boot")):
        return "its process is frozen (SIGSTOP or a debugger)"
    try:
        age = clock() - path.stat().st_mtime
    except OSError:
        return None
    if age > MAX_STATUS_AGE_S:
        return f"it has not renewed its status for {age:.0f} s"
    stalled = status.get("stalled") or ()
    ages = status.get("progress_age_s") or {}
    return "; ".join(f"source {name}: blocks wait for {ages.get(name, 0):.0f} s" for name in stalled) or None


def unhealthy(status: Mapping[str, Any]) -> Iterator[str]:
    """Yield why a daemon does not do its work, of :func:`monitor.service.system.present_status`; nothing if it does."""
    if status["running"] == "stalled":
        yield f"the daemon is stalled: {status['stall']}"
    elif not status["running"] or status["status"] == "starting":
        yield {
            "never_ran": "the daemon has never run",
            "stopped": "the daemon was stopped",
            "starting": "the daemon is starting",
        }.get(status["status"], "the daemon has died")
        return
    problems = status.get("problems", {})
    yield from (problems[name] for name in ("store", "disk") if name in problems)


def boot_id() -> str | None:
    """Return what names this boot of this machine and its processes, or None where the system does not say."""
    try:
        namespace = Path("/proc/self/ns/pid").readlink()
        return f"{Path('/proc/sys/kernel/random/boot_id').read_text(encoding='ascii').strip()} {namespace}"
    except OSError:
        return None


def _is_frozen(pid: int, boot: str | None) -> bool:
    """Return whether a process was stopped by a signal; False where its numbers are those of another system."""
    if boot is None or boot != boot_id():
        return False
    try:
        found = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    return found.rpartition(")")[2].split()[0] in _FROZEN
