"""The queue of notifications: a thread a way, retried with back-off, rate-limited, bounded, never in anybody's way."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from monitor.alarm_config import NotifySection
from monitor.service.notify.channels import Message, NotifyError, Way

_LOG = logging.getLogger(__name__)
_FIRST_PAUSE, _LONGEST_PAUSE = 5.0, 900.0
_HOUR = 3600.0
_MOST_IN_ONE = 20


class Notifier:
    """Tells of events over all configured ways; each has a queue of its own, so that one that fails delays no other."""

    def __init__(
        self,
        machine: str,
        ways: Sequence[Way],
        settings: NotifySection,
        *,
        first_pause: float = _FIRST_PAUSE,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        """Start a thread for each way.

        Args:
            machine: its name, in every message.
            ways: to tell over.
            settings: limits.
            first_pause: seconds before the second attempt; each further one waits twice as long, up to 15 minutes.
            monotonic: seconds that never go back.
        """
        self._queues = [_Queue(machine, way, settings, first_pause, monotonic) for way in ways]

    @classmethod
    def from_settings(cls, machine: str, settings: NotifySection) -> Notifier:
        """Return one with the ways of a configuration."""
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
        return cls(machine, ways, settings)

    def tell(self, event: Mapping[str, Any]) -> None:
        """Take an event into the queues; returns at once. Of a full queue the oldest is dropped and counted."""
        for queue in self._queues:
            queue.put(event)

    def problems(self) -> dict[str, str]:
        """Return what is wrong with each way that is failing, by its name."""
        return {f"notify.{queue.name}": queue.problem for queue in self._queues if queue.problem is not None}

    def waiting(self) -> int:
        """Return how many events wait in the longest queue."""
        return max((queue.waiting() for queue in self._queues), default=0)

    def close(self, timeout: float = 2.0) -> None:
        """Let the queues go on for a moment, then end."""
        until = time.monotonic() + timeout
        for queue in self._queues:
            queue.end()
        for queue in self._queues:
            queue.join(max(0.0, until - time.monotonic()))


class _Queue:
    def __init__(
        self, machine: str, way: Way, settings: NotifySection, first_pause: float, monotonic: Callable[[], float]
    ) -> None:
        self.name, self.problem = way.name, None
        self._machine, self._way, self._settings = machine, way, settings
        self._first_pause, self._monotonic = first_pause, monotonic
        self._events: deque[tuple[float, Mapping[str, Any]]] = deque()
        self._left_out = 0
        self._sent: deque[float] = deque()
        self._wake = threading.Condition()
        self._ending = False
        self._thread = threading.Thread(target=self._work, name=f"notify-{way.name}", daemon=True)
        self._thread.start()

    problem: str | None

    def put(self, event: Mapping[str, Any]) -> None:
        with self._wake:
            if len(self._events) >= self._settings.queue_events:
                self._events.popleft()
                self._left_out += 1
            self._events.append((self._monotonic(), event))
            self._wake.notify()

    def waiting(self) -> int:
        with self._wake:
            return len(self._events)

    def end(self) -> None:
        with self._wake:
            self._ending = True
            self._wake.notify()

    def join(self, timeout: float) -> None:
        self._thread.join(timeout)

    def _work(self) -> None:
        pause = self._first_pause
        while True:
            with self._wake:
                while not self._events and not self._ending:
                    self._wake.wait()
                if not self._events:
                    return
                wait = self._until_allowed()
                if wait > 0.0:
                    if self._ending:
                        return
                    self._wake.wait(wait)
                    continue
                batch = self._take()
            if self._try(batch):
                pause = self._first_pause
                continue
            with self._wake:
                self._put_back(batch)
                if self._ending or self._wake.wait_for(lambda: self._ending, pause):
                    return
            pause = min(2.0 * pause, _LONGEST_PAUSE)

    def _until_allowed(self) -> float:
        """Return the seconds until the rate limit lets another message through."""
        now = self._monotonic()
        while self._sent and now - self._sent[0] >= _HOUR:
            self._sent.popleft()
        return 0.0 if len(self._sent) < self._settings.most_per_hour else self._sent[0] + _HOUR - now

    def _take(self) -> tuple[list[tuple[float, Mapping[str, Any]]], int]:
        """Take what waits as one message: the newest events in full, of the others the number."""
        waiting, left_out = list(self._events), self._left_out
        self._events.clear()
        self._left_out = 0
        kept = waiting[-_MOST_IN_ONE:]
        return kept, left_out + len(waiting) - len(kept)

    def _put_back(self, batch: tuple[list[tuple[float, Mapping[str, Any]]], int]) -> None:
        """Keep what could not be told, but not for ever."""
        oldest = self._monotonic() - self._settings.give_up_hours * _HOUR
        kept = [item for item in batch[0] if item[0] >= oldest]
        room = max(0, self._settings.queue_events - len(self._events))
        chosen = kept[len(kept) - room :] if room < len(kept) else kept
        self._left_out += batch[1] + len(batch[0]) - len(chosen)
        self._events.extendleft(reversed(chosen))

    def _try(self, batch: tuple[list[tuple[float, Mapping[str, Any]]], int]) -> bool:
        message = Message(self._machine, tuple(event for _, event in batch[0]), batch[1])
        try:
            self._way.send(message)
        except NotifyError as error:
            if self.problem is None:
                _LOG.error("notification fails, it is tried again: %s", error)
            self.problem = str(error)
            return False
        except Exception as error:  # A fault of one way must not end its thread in silence.
            _LOG.exception("notification by %s fails", self.name)
            self.problem = f"{self.name}: {type(error).__name__}"
            return False
        self._sent.append(self._monotonic())
        self.problem = None
        return True
