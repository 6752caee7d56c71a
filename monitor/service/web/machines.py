"""The machines of a page: their configurations, what their daemons say of them, and their stores."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from monitor.config import ChannelSection, Config
from monitor.service.status_file import read_status
from monitor.service.web.answers import RequestError
from monitor.service.web.reading import StoreReader

_FRESH = 0.2
_PATHS = re.compile(r"(?<![\w/.])(?:/[^\s/:;,'\"]+)+/([^\s/:;,'\"]*)")


def without_folders(text: str) -> str:
    """Return a sentence with the file names that are in it, but not the folders."""
    return _PATHS.sub(r"\1", text)


@dataclass(frozen=True)
class Status:
    """What a daemon said, as it was when it was read.

    Attributes:
        version: another number wherever something else is said.
        values: as ``spallwatch status --json`` gives them; sentences name files without their folders.
    """

    version: int
    values: Mapping[str, Any]


class Machine:
    """One machine; its methods may be called from any thread."""

    def __init__(self, config: Config) -> None:
        """Take a configuration; nothing is opened yet."""
        self.config = config
        self.name = config.machine.name
        self.channels: dict[str, ChannelSection] = {channel.name: channel for channel in config.channel}
        self.store = StoreReader(config.machine.state_dir / "state.db")
        self._lock = threading.Lock()
        self._status = Status(0, {})
        self._read: float | None = None

    @property
    def records_dir(self) -> Path:
        """Folder of the published files."""
        return self.config.machine.records_dir

    def channel(self, name: str) -> ChannelSection:
        """Return a channel of the configuration.

        Raises:
            RequestError: 404.
        """
        found = self.channels.get(name)
        if found is None:
            raise RequestError(404, f"machine {self.name} has no such channel")
        return found

    def status(self) -> Status:
        """Return what its daemon says, at most a moment old."""
        with self._lock:
            now = time.monotonic()
            if self._read is None or now - self._read >= _FRESH:
                self._read = now
                found = read_status(self.config.machine.state_dir)
                found["problems"] = {
                    name: without_folders(problem) for name, problem in found.get("problems", {}).items()
                }
                if found != self._status.values:
                    self._status = Status(self._status.version + 1, found)
            return self._status


class Machines:
    """All machines of a page, by name."""

    def __init__(self, configs: Sequence[Config]) -> None:
        """Take configurations.

        Raises:
            ValueError: two machines have the same name.
        """
        self._machines = {config.machine.name: Machine(config) for config in configs}
        if len(self._machines) < len(configs):
            raise ValueError("two machines have the same name; names of machines must be different")

    def __iter__(self) -> Any:
        """Yield the machines in the order of their configurations."""
        return iter(self._machines.values())

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self._machines)

    def machine(self, name: str) -> Machine:
        """Return a machine by name.

        Raises:
            RequestError: 404.
        """
        found = self._machines.get(name)
        if found is None:
            raise RequestError(404, "there is no such machine")
        return found
