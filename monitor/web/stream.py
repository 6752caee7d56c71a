"""What is new, told to all who listen: one look at statuses and stores for everybody, one copy of every message."""

from __future__ import annotations

import asyncio
import json
import logging
import time
from collections.abc import AsyncGenerator, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

from monitor.records.database import StoreError
from monitor.web.event_view import marker, unacknowledged
from monitor.web.machines import Machine, Machines
from monitor.web.new_records import newest_id, records_after
from monitor.web.spectra_view import newest_block

_LOG = logging.getLogger(__name__)
_EVERY = 0.5
_HEARTBEAT = 5.0
_QUIET = 15.0
_MOST_WAITING = 64
_RESTLESS = ("updated_utc", "up_s", "channels", "sources", "blocks")
"""What changes all the time: it goes with what else changed, or with the heartbeat."""
Subject = tuple[str, str]


@dataclass(eq=False)
class Listener:
    """Somebody who listens.

    Attributes:
        subject: machine and channel that are followed closely, or None.
        waiting: messages that were not taken yet; whoever lets them pile up is dropped.
        dropped: set when that happened.
    """

    subject: Subject | None
    waiting: asyncio.Queue[bytes] = field(default_factory=lambda: asyncio.Queue(_MOST_WAITING))
    dropped: bool = False


@dataclass
class _Seen:
    """What was told of a machine last."""

    version: int = -1
    values: Mapping[str, Any] = field(default_factory=dict)
    newest: int | None = None
    marker: tuple[int, ...] | None = None
    spectra: dict[str, int | None] = field(default_factory=dict)


@dataclass(frozen=True)
class _News:
    """A message, and for whom: None is everybody."""

    message: bytes
    subject: Subject | None = None


class Hub:
    """Looks for what is new while anybody listens; used in the event loop."""

    def __init__(self, machines: Machines) -> None:
        """Take the machines."""
        self._machines = machines
        self._thread = ThreadPoolExecutor(1, "news")
        self._listeners: set[Listener] = set()
        self._seen: dict[str, _Seen] = {}
        self._heartbeat = 0.0
        self._wake = asyncio.Event()
        self._loop: asyncio.AbstractEventLoop | None = None

    def __len__(self) -> int:
        """Return how many listen."""
        return len(self._listeners)

    def wake(self) -> None:
        """Look at once; may be called from any thread."""
        if self._loop is not None:
            self._loop.call_soon_threadsafe(self._wake.set)

    async def run(self) -> None:
        """Look again and again, until cancelled."""
        self._loop = asyncio.get_running_loop()
        while True:
            if self._listeners:
                subjects = {listener.subject for listener in self._listeners if listener.subject is not None}
                for item in await self._loop.run_in_executor(self._thread, self._found, subjects):
                    self._tell(item)
            else:
                # Whoever comes first gets everything, and from then on what is new.
                self._seen.clear()
            self._wake.clear()
            try:
                await asyncio.wait_for(self._wake.wait(), _EVERY)
            except TimeoutError:
                continue

    async def listen(self, subject: Subject | None) -> AsyncGenerator[bytes]:
        """Yield the messages for one who listens, a comment where there is none for a while."""
        listener = Listener(subject)
        self._listeners.add(listener)
        loop = asyncio.get_running_loop()
        try:
            yield await loop.run_in_executor(self._thread, self._everything, subject)
            while not listener.dropped:
                try:
                    yield await asyncio.wait_for(listener.waiting.get(), _QUIET)
                except TimeoutError:
                    yield b": still here\n\n"
        finally:
            self._listeners.discard(listener)

    def close(self) -> None:
        """Let go of the thread."""
        self._thread.shutdown(wait=True, cancel_futures=True)

    def _tell(self, news: _News) -> None:
        for listener in self._listeners:
            if news.subject in (None, listener.subject):
                try:
                    listener.waiting.put_nowait(news.message)
                except asyncio.QueueFull:
                    listener.dropped = True

    def _everything(self, subject: Subject | None) -> bytes:
        """Return how all machines stand; what is committed from now on is news."""
        for machine in self._machines:
            seen = self._seen.setdefault(machine.name, _Seen())
            channels = [subject[1]] if subject is not None and subject[0] == machine.name else []
            try:
                if seen.newest is None:
                    seen.newest, seen.marker = newest_id(machine), marker(machine)
                for channel in channels:
                    seen.spectra.setdefault(channel, newest_block(machine, channel))
            except StoreError as error:
                _LOG.debug("%s: %s", machine.name, error)
        whole = [machine.status().values for machine in self._machines]
        return message("machines", {"full": True, "machines": whole})

    def _found(self, subjects: set[Subject]) -> list[_News]:
        """Return what is new; a look that fails is no end of looking."""
        try:
            return list(self._look(subjects))
        except Exception:
            _LOG.exception("what is new cannot be told")
            return []

    def _look(self, subjects: set[Subject]) -> Iterator[_News]:
        now = time.monotonic()
        beating = now - self._heartbeat >= _HEARTBEAT
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
            yield _News(message("machines", {"full": False, "machines": changed}))
        if logged:
            yield _News(message("events", {"unacknowledged": self._unacknowledged(), "newest": newest}))

    def _unacknowledged(self) -> int:
        total = 0
        for machine in self._machines:
            try:
                total += unacknowledged(machine)
            except StoreError as error:
                _LOG.debug("%s: %s", machine.name, error)
        return total

    @staticmethod
    def _of_channels(machine: Machine, seen: _Seen, channels: list[str]) -> Iterator[_News]:
        """Yield records and spectra of the channels that somebody follows."""
        newest = newest_id(machine)
        if seen.newest is None or newest < seen.newest:
            seen.newest = newest
        for channel in channels:
            subject = (machine.name, channel)
            if newest > seen.newest:
                yield _News(message("records", records_after(machine, channel, seen.newest, newest)), subject)
            block = newest_block(machine, channel)
            if channel in seen.spectra and block is not None and block != seen.spectra[channel]:
                yield _News(message("spectrum", {"machine": machine.name, "channel": channel, "block": block}), subject)
            seen.spectra[channel] = block
        seen.newest = newest


def message(kind: str, value: Mapping[str, Any]) -> bytes:
    """Return a server-sent event."""
    data = json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    return f"event: {kind}\ndata: {data}\n\n".encode()


def _logged(machine: Machine, seen: _Seen) -> tuple[bool, str | None]:
    """Return whether the log of a machine changed, and the name of the newest event where there is a new one."""
    found = marker(machine)
    before, seen.marker = seen.marker, found
    if before is None or found == before:
        return False, None
    new = {f"{machine.name}:{found[0]}": found[0] != before[0], f"{machine.name}:n{found[1]}": found[1] != before[1]}
    return True, next((name for name, is_new in new.items() if is_new), None)


def _difference(seen: _Seen, machine: Machine, beating: bool) -> dict[str, Any] | None:
    """Return what changed of a machine since it was told last, or None; ages of blocks are no change."""
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
