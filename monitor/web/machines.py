"""The machines of a page: configurations, statuses of their daemons, stores."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from monitor.config.load import Config
from monitor.config.source import ChannelSection
from monitor.records.database import StoreError
from monitor.records.reader import LatestValues, LedgerTally, StoreReader
from monitor.service.system import present_status
from monitor.web.answers import RequestError, without_folders

_LOG = logging.getLogger(__name__)
_FRESH_S = 0.2
_COUNT_S = 1.0
_COUNT_PAUSE_S = 0.01
"""Pause between two steps of a count that is behind, for the answers."""


@dataclass(frozen=True)
class Status:
    """The status of a daemon at the moment of reading; the version changes with the values."""

    version: int
    values: Mapping[str, Any]
    """As ``spallwatch status --json`` gives them; sentences name files without their folders."""
    age: float | None = None
    """Seconds since the file was written, or None where there is none."""


class WatchedMachine:
    """One machine; its methods may be called from any thread."""

    def __init__(self, config: Config) -> None:
        """Keep a configuration; nothing is opened."""
        self.config = config
        self.name = config.machine.name
        self.channels: dict[str, ChannelSection] = {channel.name: channel for channel in config.channel}
        self.state_dir, self.records_dir = config.machine.state_dir, config.machine.records_dir
        self.store = StoreReader(self.state_dir / "state.db")
        self.tally = LedgerTally(self.store)
        self.latest = LatestValues(self.store)
        self._lock = threading.Lock()
        self._status = Status(0, {})
        self._read: float | None = None

    def channel(self, name: str) -> ChannelSection:
        """Return a channel of the configuration; raise :class:`RequestError` 404 where there is none."""
        found = self.channels.get(name)
        if found is None:
            raise RequestError(404, f"machine {self.name} has no such channel")
        return found

    def absolute(self, channel: str | None) -> bool:
        """Return whether the accelerations of a channel are in m/s2; those of a removed channel are."""
        section = self.channels.get(channel or "")
        return section is None or section.unit != "unknown"

    def status(self) -> Status:
        """Return the status of its daemon, at most 0.2 s old."""
        with self._lock:
            now = time.monotonic()
            if self._read is None or now - self._read >= _FRESH_S:
                found = {
                    "name": self.name,
                    "timezone": self.config.machine.timezone,
                    "channels": {},
                    **present_status(self.config),
                }
                # It changes with every look; the moment of the backup stays.
                found.pop("last_backup_age_s")
                found.pop("boot", None)
                problems = found.get("problems", {})
                found["problems"] = {name: without_folders(problem) for name, problem in problems.items()}
                self._read = now
                version = self._status.version + (found != self._status.values)
                self._status = Status(version, found, self._age())
            return self._status

    def _age(self) -> float | None:
        try:
            return max(0.0, time.time() - (self.state_dir / "status.json").stat().st_mtime)
        except OSError:
            return None


class Machines:
    """All machines of a page, by name."""

    def __init__(self, configs: Sequence[Config]) -> None:
        """Raise ValueError where two machines have the same name."""
        self._machines = {config.machine.name: WatchedMachine(config) for config in configs}
        if len(self._machines) < len(configs):
            raise ValueError("two machines have the same name; names of machines must be different")

    def __iter__(self) -> Iterator[WatchedMachine]:
        """Yield the machines in the order of their configurations."""
        return iter(self._machines.values())

    def machine(self, name: str) -> WatchedMachine:
        """Return a machine by name; raise :class:`RequestError` 404 where there is none."""
        found = self._machines.get(name)
        if found is None:
            raise RequestError(404, "there is no such machine")
        return found

    def keep_counting(self, ending: threading.Event) -> None:
        """Count new blocks of all stores, in turn, until ``ending`` is set; a store that fails is tried again."""
        failing: dict[str, str] = {}
        while not ending.is_set():
            more = False
            for machine in self:
                if ending.is_set():
                    return
                try:
                    more = (machine.store.identity() is not None and machine.tally.update()) or more
                except StoreError as error:
                    if failing.get(machine.name) != str(error):
                        _LOG.warning("count of blocks: %s", error)
                    failing[machine.name] = str(error)
                except Exception:
                    _LOG.exception("count of blocks of machine %s", machine.name)
                    failing[machine.name] = "program error"
                    ending.wait(_COUNT_S)
                else:
                    failing.pop(machine.name, None)
            ending.wait(_COUNT_PAUSE_S if more else _COUNT_S)
