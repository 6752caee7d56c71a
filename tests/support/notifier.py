"""Makers and checks that tests of notifier share."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

from monitor.config.outputs import NotifySection
from monitor.health.record import Record
from monitor.records.events import Deliveries, EventLog
from monitor.records.store import Store
from monitor.service.broker import NotifyError
from monitor.service.notify.channels import Message, NotificationChannel
from monitor.service.notify.message import MessageSender
from monitor.service.notify.notifier import Notifier
from tests.support.waiting import PATIENCE_S

PRESS = MessageSender("press")


NOW = 1.79e9


class Recorder(NotificationChannel):
    """A channel that keeps its messages; it fails while ``failing``, and waits while ``go`` is clear."""

    def __init__(self, name: str = "channel") -> None:
        super().__init__(None)
        self.name = name
        self.messages: list[Message] = []
        self.attempts = 0
        self.failing = False
        self.missing: str | None = None
        self.complaint: str | None = None
        self.go = threading.Event()
        self.go.set()

    def check(self) -> None:
        if self.missing is not None:
            raise NotifyError(self.missing)

    def send(self, message: Message) -> str | None:
        self.attempts += 1
        self.go.wait(PATIENCE_S)
        if self.failing:
            raise NotifyError("no answer")
        self.messages.append(message)
        return self.complaint

    @property
    def numbers(self) -> list[int]:
        """The numbers of the delivered events and notices, in order."""
        return [event["n"] for message in self.messages for event in message.values["events"]]


class Log:
    """A store with events numbered as they come."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "state.db"
        self.store = Store.open(self.path, machine="press")
        self.log = EventLog(self.path)
        self.sequence = self.last = 0

    def add(self, *kinds: str, time: float | None = NOW, **more: Any) -> None:
        """Commit a block with events."""
        self.sequence += 1
        events = []
        for kind in kinds:
            self.last += 1
            events.append({"kind": kind, "channel": "x", "n": self.last, **more})
        record = Record("s", self.sequence, "b", str(self.sequence), time=time, events=tuple(events))
        assert self.store.commit(record, {}) == "committed"

    def notice(self, kind: str = "no_data", utc: float = NOW) -> None:
        """Log an event without a block."""
        self.last += 1
        self.log.notice(utc, {"kind": kind, "n": self.last})

    def close(self) -> None:
        self.log.close()
        self.store.close()


class Notifying:
    """A notifier that is closed at the end of the block."""

    def __init__(self, log: Log, *channels: Recorder, **more: Any) -> None:
        section = NotifySection(**more.pop("limits", {}))
        self.notifier = Notifier(
            PRESS, channels, section, log.path, **{"first_pause": 0.05, "clock": lambda: NOW, **more}
        )

    def __enter__(self) -> Notifier:
        return self.notifier

    def __exit__(self, *rest: object) -> None:
        self.notifier.close()


def positions(log: Log, channel: str) -> list[tuple[int, int]]:
    with Deliveries(log.path) as deliveries:
        place = deliveries.progress(channel)
    return [] if place is None else [(place.event, place.notice)]
