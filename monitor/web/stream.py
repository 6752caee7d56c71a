"""Server-sent events: one poll of statuses and stores for all clients, one copy of each message."""

from __future__ import annotations

import asyncio
import json
import logging
import time
from collections.abc import AsyncGenerator, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from monitor.records.database import StoreError
from monitor.records.queries import LogMarks, is_dated, newest_id, trends_after
from monitor.records.rollup import SeriesKey
from monitor.web.api import columns
from monitor.web.channel_view import newest_block
from monitor.web.event_view import marker, unacknowledged
from monitor.web.machines import Machines, WatchedMachine

_LOG = logging.getLogger(__name__)
_POLL_S = 0.5
_HEARTBEAT_S = 5.0
_COMMENT_S = 15.0
_MAX_WAITING = 64
_MAX_RECORDS = 5000
_RESTLESS = ("updated_utc", "up_s", "channels", "sources", "blocks", "progress_age_s", "listeners")
"""Keys that change all the time; they are sent with other changes, or with the heartbeat."""
Subject = tuple[str, str]


@dataclass(eq=False)
class Subscriber:
    """A client of the stream, with the machine and channel that it follows.

    It is dropped when too many messages wait, or for one that is signed in where it is not.
    """

    subject: Subject | None
    signed_in: bool = False
    waiting: asyncio.Queue[bytes] = field(default_factory=lambda: asyncio.Queue(_MAX_WAITING))
    dropped: bool = False


@dataclass
class _Seen:
    """State of a machine as it was sent last."""

    version: int = -1
    values: Mapping[str, Any] = field(default_factory=dict)
    newest: int | None = None
    marker: LogMarks | None = None
    spectra: dict[str, int | None] = field(default_factory=dict)


@dataclass(frozen=True)
class _Update:
    """A message, and the subject of its subscribers; None for all."""

    message: bytes
    subject: Subject | None = None


class Hub:
    """Polls while there are subscribers; used in the event loop."""

    def __init__(self, machines: Machines) -> None:
        """Take the machines."""
        self._machines = machines
        self._thread = ThreadPoolExecutor(1, "news")
        self._subscribers: dict[Subscriber, None] = {}
        self._seen: dict[str, _Seen] = {}
        self._heartbeat = 0.0
        self._wake = asyncio.Event()
        self._loop: asyncio.AbstractEventLoop | None = None

    def __len__(self) -> int:
        """Return the number of subscribers."""
        return len(self._subscribers)

    def wake(self) -> None:
        """Poll at once; may be called from any thread."""
        if self._loop is not None:
            self._loop.call_soon_threadsafe(self._wake.set)

    async def run(self) -> None:
        """Poll until cancelled."""
        self._loop = asyncio.get_running_loop()
        while True:
            if self._subscribers:
                subjects = {subscriber.subject for subscriber in self._subscribers if subscriber.subject is not None}
                for item in await self._loop.run_in_executor(self._thread, self._found, subjects):
                    self._send(item)
            else:
                # The next subscriber gets everything, and from then on changes.
                self._seen.clear()
            self._wake.clear()
            with suppress(TimeoutError):
                async with asyncio.timeout(_POLL_S):
                    await self._wake.wait()

    def make_room(self) -> bool:
        """End the oldest stream of a client that is not signed in; return whether there was one."""
        stranger = next((found for found in self._subscribers if not found.signed_in), None)
        if stranger is None:
            return False
        stranger.dropped = True
        self.unsubscribe(stranger)
        # It may wait for its next message.
        with suppress(asyncio.QueueFull):
            stranger.waiting.put_nowait(b": another page is signed in\n\n")
        return True

    def subscribe(self, subject: Subject | None, *, signed_in: bool = False) -> Subscriber:
        """Add a subscriber; it counts from now on until :meth:`unsubscribe`."""
        subscriber = Subscriber(subject, signed_in)
        self._subscribers[subscriber] = None
        return subscriber

    def unsubscribe(self, subscriber: Subscriber) -> None:
        """Remove a subscriber; removing it twice does nothing."""
        self._subscribers.pop(subscriber, None)

    async def messages(self, subscriber: Subscriber) -> AsyncGenerator[bytes]:
        """Yield the messages for a subscriber, and comments while there are none; remove it at the end."""
        loop = asyncio.get_running_loop()
        try:
            yield await loop.run_in_executor(self._thread, self._everything, subscriber.subject)
            while not subscriber.dropped:
                message = b": still here\n\n"
                with suppress(TimeoutError):
                    async with asyncio.timeout(_COMMENT_S):
                        message = await subscriber.waiting.get()
                yield message
        finally:
            self.unsubscribe(subscriber)

    def close(self) -> None:
        """End the thread."""
        self._thread.shutdown(wait=True, cancel_futures=True)

    def _send(self, update: _Update) -> None:
        for subscriber in self._subscribers:
            if update.subject in (None, subscriber.subject):
                try:
                    subscriber.waiting.put_nowait(update.message)
                except asyncio.QueueFull:
                    subscriber.dropped = True

    def _everything(self, subject: Subject | None) -> bytes:
        """Return the state of all machines; later commits are sent as changes."""
        for machine in self._machines:
            seen = self._seen.setdefault(machine.name, _Seen())
            channels = [subject[1]] if subject is not None and subject[0] == machine.name else []
            try:
                if seen.newest is None:
                    seen.newest, seen.marker = _newest_id(machine), marker(machine)
                for channel in channels:
                    seen.spectra.setdefault(channel, newest_block(machine, channel))
            except StoreError as error:
                _LOG.debug("%s: %s", machine.name, error)
        whole = [machine.status().values for machine in self._machines]
        return message("machines", {"full": True, "machines": whole})

    def _found(self, subjects: set[Subject]) -> list[_Update]:
        """Return what is new; a failed poll is retried."""
        try:
            return list(self._poll(subjects))
        except Exception:
            _LOG.exception("the stream cannot be updated")
            return []

    def _poll(self, subjects: set[Subject]) -> Iterator[_Update]:
        now = time.monotonic()
        beating = now - self._heartbeat >= _HEARTBEAT_S
        if beating:
            self._heartbeat = now
        changed: list[dict[str, Any]] = []
        logged, newest = False, None
        for machine in self._machines:
            seen = self._seen.setdefault(machine.name, _Seen())
            difference = _difference(seen, machine, beating)
            if difference is not None:
                changed.append(difference)
            try:
                yield from self._of_channels(machine, seen, [c for m, c in subjects if m == machine.name])
                changes, name = _logged(machine, seen)
                logged, newest = logged or changes, name or newest
            except StoreError as error:
                _LOG.debug("%s: %s", machine.name, error)
        if changed:
            yield _Update(message("machines", {"full": False, "machines": changed}))
        if logged:
            yield _Update(message("events", {"unacknowledged": self._unacknowledged(), "newest": newest}))

    def _unacknowledged(self) -> int:
        total = 0
        for machine in self._machines:
            try:
                total += unacknowledged(machine)
            except StoreError as error:
                _LOG.debug("%s: %s", machine.name, error)
        return total

    @staticmethod
    def _of_channels(machine: WatchedMachine, seen: _Seen, channels: list[str]) -> Iterator[_Update]:
        """Yield records and spectra of the channels that are followed."""
        newest = _newest_id(machine)
        if seen.newest is None or newest < seen.newest:
            seen.newest = newest
        for channel in channels:
            subject = (machine.name, channel)
            if newest > seen.newest:
                yield _Update(message("records", _records_after(machine, channel, seen.newest, newest)), subject)
            block = newest_block(machine, channel)
            if channel in seen.spectra and block is not None and block != seen.spectra[channel]:
                yield _Update(
                    message("spectrum", {"machine": machine.name, "channel": channel, "block": block}), subject
                )
            seen.spectra[channel] = block
        seen.newest = newest


def message(kind: str, value: Mapping[str, Any]) -> bytes:
    """Return a server-sent event."""
    data = json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    return f"event: {kind}\ndata: {data}\n\n".encode()


def _logged(machine: WatchedMachine, seen: _Seen) -> tuple[bool, str | None]:
    """Return whether the log of a machine changed, and the name of the newest event where there is a new one."""
    found = marker(machine)
    before, seen.marker = seen.marker, found
    if before is None or found == before:
        return False, None
    new = {f"{machine.name}:{found[0]}": found[0] != before[0], f"{machine.name}:n{found[1]}": found[1] != before[1]}
    return True, next((name for name, is_new in new.items() if is_new), None)


def _difference(seen: _Seen, machine: WatchedMachine, beating: bool) -> dict[str, Any] | None:
    """Return what changed of a machine since the last message, or None; ages of blocks do not count."""
    status = machine.status()
    if status.version == seen.version:
        return None
    before, values = seen.values, status.values
    channels = {
        name: channel
        for name, channel in values["channels"].items()
        if _without_age(channel) != _without_age(before.get("channels", {}).get(name))
    }
    own = {key: value for key, value in values.items() if key not in _RESTLESS}
    same = own == {key: value for key, value in before.items() if key not in _RESTLESS}
    if same and not channels and not beating:
        return None
    seen.version, seen.values = status.version, values
    return {**values, "channels": channels}


def _without_age(channel: Mapping[str, Any] | None) -> dict[str, Any]:
    return {key: value for key, value in (channel or {}).items() if key != "last_block_age_s"}


def _newest_id(machine: WatchedMachine) -> int:
    """Return the number of the newest block in the ledger, 0 where there is no block or no store."""
    return 0 if machine.store.identity() is None else newest_id(machine.store)


def _records_after(machine: WatchedMachine, channel: str, after: int, until: int) -> dict[str, Any]:
    """Return the newest records of a channel with ledger numbers above ``after``, up to ``until``."""
    section = machine.channel(channel)
    dated = is_dated(machine.store, section.source)
    key = SeriesKey(section.source, channel, bool(dated))
    table = trends_after(machine.store, key, after, until, _MAX_RECORDS)
    return {
        "machine": machine.name,
        "channel": channel,
        "dated": dated,
        "resolution_s": None,
        "columns": columns(table, absolute=section.unit != "unknown"),
    }
