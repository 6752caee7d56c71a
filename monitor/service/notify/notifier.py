"""Notifications of the event log: one worker thread per channel, so that a failing channel delays nothing else."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from monitor.config.load import Config
from monitor.config.outputs import NotifySection
from monitor.records.database import StoreError
from monitor.records.events import Delivered, Deliveries, EventLog, LoggedEvent
from monitor.records.store import Store
from monitor.service.broker import NotifyError
from monitor.service.children import Worker
from monitor.service.notify.channels import NotificationChannel, configured_channels
from monitor.service.notify.message import (
    MAX_LISTED,
    MessageItem,
    MessageSender,
    compose,
    draw_picture,
    picture_request,
    worst_of,
)
from monitor.service.system import read_status
from monitor.words.events import badness
from monitor.words.numbers import count

_LOG = logging.getLogger(__name__)
_FIRST_PAUSE_S, _MAX_PAUSE_S = 5.0, 900.0
_POLL_S = 60.0
_HOUR_S = 3600.0
_MIN_UTC_S = 315532800.0
"""1980; an earlier time comes from a clock that was not set."""
_NOT_DELIVERED = ("alarm_released",)


class Notifier:
    """Delivers events and notices over all configured channels.

    The position of each channel in the log is kept in the store: what was committed and not delivered when the process
    ended is delivered after the next start. A new channel begins at the present end of the log.
    """

    def __init__(
        self,
        machine: MessageSender,
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
        self._reader = _LogReader(store, tuple(channel.name for channel in channels), clock)
        clocks = _Clocks(monotonic, clock)
        self._followers = [
            _Follower(machine, channel, settings, self._reader, first_pause, clocks) for channel in channels
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
        return cls(MessageSender.of_config(config), configured_channels(config.notify), config.notify, store)

    def wake(self) -> None:
        """Note that the log has something new; returns at once."""
        for follower in self._followers:
            follower.changed()

    def workers(self) -> dict[str, Worker]:
        """Return the threads, by the name of the channel in a status."""
        return {f"notify.{follower.name}": follower for follower in self._followers}

    def problems(self) -> dict[str, str]:
        """Return the problems of the failing channels, by name."""
        found = {f"notify.{follower.name}": follower.trouble() for follower in self._followers}
        return {name: problem for name, problem in found.items() if problem is not None}

    def close(self, timeout: float = 2.0) -> None:
        """Try new events once more, then end; what is not delivered is delivered after the next start."""
        until = time.monotonic() + timeout
        for follower in self._followers:
            follower.end()
        for follower in self._followers:
            follower.join(max(0.0, until - time.monotonic()))
        self._reader.close()


@dataclass(frozen=True)
class _Clocks:
    """Seconds that never go back, and UTC seconds since 1970."""

    monotonic: Callable[[], float]
    utc: Callable[[], float]


class _LogReader:
    """The event log of a store and the positions of all channels in it; opened on first use, closed once."""

    def __init__(self, path: Path, channels: tuple[str, ...], clock: Callable[[], float]) -> None:
        self.path, self._channels, self._clock = path, channels, clock
        self._lock = threading.Lock()
        self._opened: tuple[EventLog, Deliveries] | None = None
        self._closed = False

    def open(self) -> tuple[EventLog, Deliveries]:
        """Return log and positions; a new channel begins at the present end. StoreError where this is impossible."""
        with self._lock:
            if self._closed:
                raise StoreError(f"{self.path}: the event log is closed")
            if self._opened is None:
                with contextlib.ExitStack() as opened:
                    log = opened.enter_context(EventLog(self.path))
                    deliveries = opened.enter_context(Deliveries(self.path))
                    deliveries.begin(self._channels, self._clock())
                    opened.pop_all()
                self._opened = log, deliveries
            return self._opened

    def close(self) -> None:
        with self._lock:
            opened, self._opened, self._closed = self._opened, None, True
        for item in opened or ():
            item.close()


class _Follower(Worker):
    """One worker thread: delivers what the log has after its position, with back-off and a rate limit.

    ``problem`` says why the latest attempt failed, or is None.
    """

    def __init__(
        self,
        machine: MessageSender,
        channel: NotificationChannel,
        settings: NotifySection,
        reader: _LogReader,
        first_pause: float,
        clocks: _Clocks,
    ) -> None:
        super().__init__(f"notify-{channel.name}")
        self.name, self._news = channel.name, True
        self._machine, self._channel, self._settings, self._reader = machine, channel, settings, reader
        self._first_pause, self._clocks = first_pause, clocks
        self._pause = first_pause
        self._warning: str | None = None
        self._progress: Delivered | None = None
        self._saved = True
        self._waiting_since: dict[str, float] = {}
        self._sent: deque[float] = deque()

    def _work(self) -> None:
        healthy = True
        while True:
            with self._wake:
                if self._ending and not (self._news and healthy):
                    return
                self._news = False
            wait = self._attempt()
            healthy = not wait
            with self._wake:
                if wait is None:
                    self._wake.wait_for(lambda: self._news or self._ending, _POLL_S)
                elif wait > 0.0:
                    self._wake.wait_for(lambda: self._ending, wait)
                else:
                    self._news = True

    def _attempt(self) -> float | None:
        """Deliver what waits; return the seconds until the next attempt, None if nothing waits."""
        try:
            return self._deliver()
        except (NotifyError, StoreError) as error:
            if self.problem is None and not self._ending:
                _LOG.error("notification by %s fails, it is tried again: %s", self.name, error)
            self.problem = str(error)
        except Exception as error:  # A fault of a channel must not end its thread.
            _LOG.exception("notification by %s fails", self.name)
            self.problem = f"{self.name}: {type(error).__name__}"
        wait, self._pause = self._pause, min(2.0 * self._pause, _MAX_PAUSE_S)
        return wait

    def _deliver(self) -> float | None:
        log, deliveries = self._reader.open()
        progress = self._load_progress(deliveries)
        # A full disk does not prevent a delivery.
        with contextlib.suppress(StoreError):
            deliveries.mark_found(self._clocks.utc())
        most = self._settings.queue_events
        events = log.events(progress.event, most)
        notices = log.notices(progress.notice, most)
        after = replace(
            progress,
            event=events[-1][0] if events else progress.event,
            notice=notices[-1][0] if notices else progress.notice,
        )
        more = 0.0 if most in (len(events), len(notices)) else None
        waiting = [
            (number, event) for number, event in (*events, *notices) if event.body.get("kind") not in _NOT_DELIVERED
        ]
        self._note_ages(deliveries, waiting)
        if not waiting and not progress.left_out:
            self._save_progress(deliveries, after)
            # A missing password is found before the first alarm.
            self._channel.check()
            self.problem, self._pause = self._warning, self._first_pause
            return more
        wait = self._wait_allowed()
        if wait > 0.0:
            return wait
        try:
            self._warning = self._send(waiting, progress.left_out)
        except Exception:
            self._give_up(deliveries, progress, waiting)
            raise
        now = self._clocks.monotonic()
        self._sent.append(now)
        utc = self._clocks.utc()
        sent = tuple(utc - (now - item) for item in self._sent)
        self._save_progress(deliveries, replace(after, left_out=0, sent=sent))
        self.problem, self._pause = self._warning, self._first_pause
        return more

    def _load_progress(self, deliveries: Deliveries) -> Delivered:
        """Return the present position, from the store at the start; write it if that failed before."""
        if self._progress is None:
            self._progress = deliveries.progress(self.name) or Delivered()
            now, utc = self._clocks.monotonic(), self._clocks.utc()
            self._sent.extend(now - (utc - item) for item in sorted(self._progress.sent) if 0.0 <= utc - item < _HOUR_S)
        if not self._saved:
            self._save_progress(deliveries, self._progress)
        return self._progress

    def _save_progress(self, deliveries: Deliveries, progress: Delivered) -> None:
        """Move to a position and write it; if the disk is full, messages are delivered again after a restart."""
        changed, self._progress = progress != self._progress, progress
        if changed or not self._saved:
            self._saved = False
            with contextlib.suppress(StoreError):
                deliveries.save(self.name, progress)
                self._saved = True

    def _note_ages(self, deliveries: Deliveries, waiting: list[tuple[int, LoggedEvent]]) -> None:
        """Note since when each event waits (s, monotonic), and sort them by that."""
        now, utc = self._clocks.monotonic(), self._clocks.utc()
        known, self._waiting_since = self._waiting_since, {}
        for number, event in waiting:
            since = known.get(event.id)
            if since is None:
                found = event.utc if event.id.startswith("n") else deliveries.found(number)
                age = 0.0 if found is None or found < _MIN_UTC_S else max(0.0, utc - found)
                since = now - age
            self._waiting_since[event.id] = since
        waiting.sort(key=lambda item: self._waiting_since[item[1].id])

    def _send(self, waiting: list[tuple[int, LoggedEvent]], left_out: int) -> str | None:
        events = [event for _, event in waiting]
        # Of two that are equally bad the later one is listed.
        ranked = sorted(range(len(events)), key=lambda index: (-badness(events[index].body), -index))
        listed = [events[index] for index in sorted(ranked[:MAX_LISTED])]
        later = self._clocks.utc() - self._clocks.monotonic()
        items = [MessageItem(event, found=self._waiting_since[event.id] + later) for event in listed]
        # Without a readable record the message lacks its values only.
        with contextlib.suppress(StoreError, ValueError), Store.open(self._reader.path, read_only=True) as store:
            items = [replace(item, values=_values(store, item.event)) for item in items]
        status = read_status(self._reader.path.parent)
        verdicts = status.get("bearings", {})
        heard = self._machine.bearings
        items = [replace(item, bearing=verdicts.get(heard.get(item.event.body.get("channel") or ""))) for item in items]
        message = compose(self._machine, items, left_out + len(events) - len(items))
        if self._channel.pictures:
            message = replace(message, picture=self._picture(items, status))
        warning = self._channel.send(message)
        _LOG.info("delivered by %s: %s", self.name, message.title)
        if warning is not None:
            _LOG.error("delivered by %s, but %s", self.name, warning)
        return warning

    def _picture(self, items: Sequence[MessageItem], status: Mapping[str, Any]) -> bytes | None:
        """Return the picture of the worst event, None where there is none, or the daemon ends."""
        worst = worst_of(items)
        if worst is None or self._ending:
            return None
        event, channel = worst.event, worst.event.body.get("channel")
        known = status.get("channels", {}).get(channel, {})
        request = picture_request(self._reader.path, event.source, event.block, event.utc, channel, worst.values, known)
        if request is None:
            return None
        title = f"{self._machine.name}: {channel}: {worst.text}"
        return draw_picture({**request, "title": title[:100], "zone": self._machine.zone}, lambda: self._ending)

    def _give_up(self, deliveries: Deliveries, progress: Delivered, waiting: list[tuple[int, LoggedEvent]]) -> None:
        """Skip what has been waiting for too long; the next message counts it."""
        oldest = self._clocks.monotonic() - self._settings.give_up_hours * _HOUR_S
        old = [(number, event) for number, event in waiting if self._waiting_since[event.id] < oldest]
        if not old:
            return
        _LOG.error("%s: given up after %g h: %s", self.name, self._settings.give_up_hours, count(len(old), "event"))
        notices = [number for number, event in old if event.id.startswith("n")]
        events = [number for number, event in old if not event.id.startswith("n")]
        self._save_progress(
            deliveries,
            replace(
                progress,
                event=max(events, default=progress.event),
                notice=max(notices, default=progress.notice),
                left_out=progress.left_out + len(old),
            ),
        )

    def _wait_allowed(self) -> float:
        """Return the seconds until the rate limit lets another message through."""
        now = self._clocks.monotonic()
        while self._sent and now - self._sent[0] >= _HOUR_S:
            self._sent.popleft()
        most = self._settings.most_per_hour
        return 0.0 if len(self._sent) < most else self._sent[-most] + _HOUR_S - now


def _values(store: Store, event: LoggedEvent) -> Mapping[str, Any]:
    """Return the values of an event's channel in the record of its block."""
    channel = event.body.get("channel")
    if event.source is None or event.block is None or channel is None:
        return {}
    record = store.record(event.source, event.block)
    return {} if record is None else record.channels.get(channel, {})
