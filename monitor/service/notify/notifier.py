"""Telling of what the event log has: a thread a way, at least once each event, in nobody's way."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from monitor.config.load import Config
from monitor.config.notify import NotifySection
from monitor.records.database import StoreError
from monitor.service.notify.channels import Way
from monitor.service.notify.follower import Book, Clocks, Follower
from monitor.service.notify.message import Machine

_FIRST_PAUSE = 5.0


class Notifier:
    """Tells of events and notices over all configured ways; one that fails delays no other, and never who commits.

    Each way keeps its place in the store: what was committed and not told when the process ended, however it ended, is
    told after the next start. A way that is new begins at the present end of the log.
    """

    def __init__(
        self,
        machine: Machine,
        ways: Sequence[Way],
        settings: NotifySection,
        store: Path,
        *,
        first_pause: float = _FIRST_PAUSE,
        monotonic: Callable[[], float] = time.monotonic,
        clock: Callable[[], float] = time.time,
    ) -> None:
        """Start a thread for each way.

        Args:
            machine: who tells.
            ways: to tell over.
            settings: limits.
            store: the database with the event log.
            first_pause: seconds before the second attempt; each further one waits twice as long, up to 15 minutes.
            monotonic: seconds that never go back.
            clock: UTC seconds since 1970.
        """
        self._book = Book(store, tuple(way.name for way in ways), clock)
        clocks = Clocks(monotonic, clock)
        self._followers = [Follower(machine, way, settings, self._book, first_pause, clocks) for way in ways]
        # At once, so that whatever is committed from here on is told; on a full disk the threads try it again.
        with contextlib.suppress(StoreError):
            self._book.open()
        if not self._followers:
            self._book.close()
        for follower in self._followers:
            follower.start()

    @classmethod
    def from_settings(cls, config: Config, store: Path) -> Notifier:
        """Return one with the ways of a configuration, for the store at a path."""
        settings = config.notify
        ways: list[Way] = []
        if settings.smtp is not None:
            from monitor.service.notify.smtp import SmtpWay

            ways.append(SmtpWay(settings.smtp))
        if settings.webhook is not None:
            from monitor.service.notify.webhook import WebhookWay

            ways.append(WebhookWay(settings.webhook))
        if settings.mqtt is not None:
            from monitor.service.notify.mqtt import MqttWay

            ways.append(MqttWay(settings.mqtt))
        return cls(Machine.of_config(config), ways, settings, store)

    def tell(self) -> None:
        """Say that the log has something new; returns at once."""
        for follower in self._followers:
            follower.wake()

    def problems(self) -> dict[str, str]:
        """Return what is wrong with each way that is failing, by its name."""
        found = {f"notify.{follower.name}": follower.problem for follower in self._followers}
        return {name: problem for name, problem in found.items() if problem is not None}

    def close(self, timeout: float = 2.0) -> None:
        """Let the ways try once more what is new, then end; what is not told by then is told after the next start."""
        until = time.monotonic() + timeout
        for follower in self._followers:
            follower.end()
        for follower in self._followers:
            follower.join(max(0.0, until - time.monotonic()))
        self._book.close()
