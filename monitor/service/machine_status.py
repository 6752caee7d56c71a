"""What a daemon says of its machine: who it is, how its sources and channels stand, and what is wrong."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from monitor import __version__
from monitor.config import Config
from monitor.health.alarms import is_silent, machine_state
from monitor.records.record import Record
from monitor.records.store import Store
from monitor.service.ingest import Ingest
from monitor.service.standing import channel_state
from monitor.service.summary import channel_summary

_FIRST_SILENCE = 600.0
_SHORTEST_SILENCE = 60.0
_SILENT_INTERVALS = 10.0


@dataclass(frozen=True)
class Last:
    """The latest block of a source.

    Attributes:
        sequence: its number, 0 before the first.
        time: its UTC time, s, or None.
        status: its status, or None.
        refused: whether it was rejected.
        came: when it was committed, s of the monotonic clock, or None where that was before the start.
        interval: shortest time from one block to the next, s, or None.
    """

    sequence: int = 0
    time: float | None = None
    status: str | None = None
    refused: bool = False
    came: float | None = None
    interval: float | None = None

    def after(self, record: Record, came: float | None) -> Last:
        """Return what is known after another block."""
        interval = self.interval
        if record.time is not None and self.time is not None and record.time > self.time:
            step = record.time - self.time
            interval = step if interval is None else min(step, interval)
        time = record.time if record.time is not None else self.time
        return Last(record.sequence, time, record.status, not record.accepted, came, interval)

    @property
    def patience(self) -> float:
        """Seconds after which silence is a state of its own."""
        if self.interval is None:
            return _FIRST_SILENCE
        return max(_SHORTEST_SILENCE, _SILENT_INTERVALS * self.interval)


class MachineStatus:
    """Puts together the status of one machine; it is used in the thread that commits."""

    def __init__(
        self,
        config: Config,
        store: Store,
        ingest: Ingest,
        monotonic: Callable[[], float],
        clock: Callable[[], float],
        *,
        began: float,
        since: float,
    ) -> None:
        """Take what is open, and from the store what the latest blocks were.

        Args:
            config: the machine.
            store: open.
            ingest: on that store.
            monotonic: seconds that never go back.
            clock: UTC seconds since 1970.
            began: monotonic time of the start.
            since: UTC time of the start.
        """
        self._config, self._ingest = config, ingest
        self._monotonic, self._clock = monotonic, clock
        self._began, self._since = began, since
        self.blocks = 0
        """Blocks committed since the start."""
        self._last = {name: _last_of(store, name) for name in ingest.watchers}

    def seen(self, record: Record) -> None:
        """Take note of a committed block."""
        self.blocks += 1
        self._last[record.source] = self._last[record.source].after(record, self._monotonic())

    def values(self, status: str, problems: Mapping[str, str]) -> dict[str, Any]:
        """Return what the daemon is doing, plain values for JSON.

        Args:
            status: "running", which becomes "degraded" where there are problems; "stopped".
            problems: what is wrong, in one sentence each, by the name of a source or of what else it is.
        """
        now = self._monotonic()
        channels = {
            name: self._channel(source, name, now)
            for source, watcher in self._ingest.watchers.items()
            for name in watcher.channels
        }
        return {
            "status": "degraded" if problems and status == "running" else status,
            "machine": self._config.machine.name,
            "state": machine_state(*(channel["state"] for channel in channels.values())),
            "pid": os.getpid(),
            "version": __version__,
            "since_utc": _utc(self._since),
            "updated_utc": _utc(self._clock()),
            "up_s": round(now - self._began, 3),
            "config_hash": self._config.hash,
            "blocks": self.blocks,
            "sources": {name: vars(backlog) for name, backlog in self._ingest.backlogs().items()},
            "problems": dict(problems),
            "channels": channels,
        }

    def _channel(self, source: str, name: str, now: float) -> dict[str, Any]:
        last, watcher = self._last[source], self._ingest.watchers[source]
        age = now - (self._began if last.came is None else last.came)
        silent = is_silent(age, last.patience, 1.0)
        state, reason = channel_state(watcher.alarming.state(name).condition, silent=silent, refused=last.refused)
        if state == "no_data":
            reason = f"no block for {age:.0f} s"
        elif state == "bad_data" and last.refused:
            reason = f"block {last.sequence} was rejected: {last.status}"
        return {
            "source": source,
            "state": state,
            "reason": reason,
            "last_block": last.sequence or None,
            "last_block_utc": _utc(last.time),
            "last_block_status": last.status,
            "last_block_age_s": None if last.came is None else round(now - last.came, 3),
            **channel_summary(watcher, name),
        }


def _last_of(store: Store, source: str) -> Last:
    record = store.record(source, store.last(source))
    return Last() if record is None else Last().after(record, None)


def _utc(time: float | None) -> str | None:
    if time is None:
        return None
    try:
        return datetime.fromtimestamp(time, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    except (OverflowError, OSError, ValueError):
        return None
