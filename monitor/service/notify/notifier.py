"""Notifications of the event log: one worker thread per channel; each event is delivered at least once."""

from __future__ import annotations

import contextlib
import importlib
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from monitor.config.fields import Section
from monitor.config.load import Config
from monitor.config.notify import NotifySection
from monitor.records.database import StoreError
from monitor.service.notify.channels import NotificationChannel
from monitor.service.notify.follower import Clocks, Follower, LogReader
from monitor.service.notify.message import Sender

_FIRST_PAUSE_S = 5.0


class Notifier:
    """Delivers events and notices over all configured channels; a failing channel delays nothing else.

    The position of each channel in the log is kept in the store: what was committed and not delivered when the process
    ended is delivered after the next start. A new channel begins at the present end of the log.
    """

    def __init__(
        self,
        machine: Sender,
        channels: Sequence[NotificationChannel],
        settings: NotifySection,
        store: Path,
        *,
        first_pause: float = _FIRST_PAUSE_S,
        monotonic: Callable[[], float] = time.monotonic,
        clock: Callable[[], float] = time.time,
    ) -> None:
        """Start a thread for each channel, on the event log of the database ``store``.

        The second attempt comes after ``first_pause`` seconds; the pauses double, up to 15 minutes.
        """
        self._reader = LogReader(store, tuple(channel.name for channel in channels), clock)
        clocks = Clocks(monotonic, clock)
        self._followers = [
            Follower(machine, channel, settings, self._reader, first_pause, clocks) for channel in channels
        ]
        # Positions are set now, so that later events are delivered; on a full disk the threads repeat this.
        with contextlib.suppress(StoreError):
            self._reader.open()
        if not self._followers:
            self._reader.close()
        for follower in self._followers:
            follower.start()

    @classmethod
    def from_settings(cls, config: Config, store: Path) -> Notifier:
        """Return one with the channels of a configuration, for the store at a path."""
        return cls(Sender.of_config(config), configured_channels(config.notify), config.notify, store)

    def wake(self) -> None:
        """Note that the log has something new; returns at once."""
        for follower in self._followers:
            follower.wake()

    def problems(self) -> dict[str, str]:
        """Return the problems of the failing channels, by name."""
        found = {f"notify.{follower.name}": follower.problem for follower in self._followers}
        return {name: problem for name, problem in found.items() if problem is not None}

    def close(self, timeout: float = 2.0) -> None:
        """Try new events once more, then end; what is not delivered is delivered after the next start."""
        until = time.monotonic() + timeout
        for follower in self._followers:
            follower.end()
        for follower in self._followers:
            follower.join(max(0.0, until - time.monotonic()))
        self._reader.close()


def configured_channels(settings: NotifySection) -> list[NotificationChannel]:
    """Return the configured channels: section ``name`` belongs to class ``Channel`` of the module of that name here."""
    sections = {name: getattr(settings, name) for name in NotifySection.model_fields}
    return [
        importlib.import_module(f"{__package__}.{name}").Channel(section)
        for name, section in sections.items()
        if isinstance(section, Section)
    ]
