"""Records over MQTT: the records of the store are published in order, at least once; a file keeps the position.

A worker thread reads the store. An unreachable broker delays nothing else; what was missed is published later, at a
bounded rate. docs/reference/wire.md has topics and keys.
"""

from __future__ import annotations

import json
import logging
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from monitor.config.load import Config
from monitor.config.outputs import RecordMqttSection
from monitor.records.database import SharedConnection, StoreError
from monitor.records.durable import replacing
from monitor.records.queries import (
    LedgerPlace,
    StoredRecord,
    condensed_place,
    newest_id,
    place_at,
    place_of,
    records_after,
)
from monitor.service.broker import BrokerError, BrokerLink, Sessions
from monitor.service.neighbours.points import channel_message, state_message

_LOG = logging.getLogger(__name__)
PLACE = "published-mqtt.json"
"""File in the state folder: how far the records are published."""
_MAX_ROWS = 100
_MAX_UNCONFIRMED = 1000
_MAX_SILENCE_S = 30.0
_PLACE_S = 5.0
_STATE_S = 1.0
_ENDING_TURN_S = 0.05


@dataclass
class _Sent:
    """A block that was sent, and the number of its messages that are not confirmed yet."""

    at: LedgerPlace
    missing: int


class RecordMqtt(Sessions):
    """Publishes records; a failure is a :attr:`problem`, never an exception."""

    def __init__(
        self,
        section: RecordMqttSection | None,
        machine: str,
        channels: Mapping[str, Sequence[str]],
        state_dir: Path,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begin to publish new records, and those that an earlier run has not published; nothing without a section.

        ``channels`` are names by source; ``state_dir`` holds the store, the status file and the position.
        """
        super().__init__("publish-mqtt", "over MQTT", monotonic)
        if section is None:
            return
        self._section, self._machine, self._channels = section, machine, dict(channels)
        self._state_dir = state_dir
        self._store = state_dir / "state.db"
        self._topic = f"{section.topic}/{quote(machine, safe='')}"
        self._place: int | None = None
        self._written: LedgerPlace | None = None
        self._reached: LedgerPlace | None = None
        self._sent: deque[_Sent] = deque()
        self._waiting: dict[int, _Sent] = {}
        self._state: str | None = None
        # Number of the last message of the state, until it is confirmed.
        self._stated: int | None = None
        self._place_due = self._state_due = float("-inf")
        self._allowed = monotonic()
        # The position is set now, so that later records are published.
        try:
            with SharedConnection(self._store) as store:
                self._place = self._begin(store)
        except StoreError as error:
            self.problem = str(error)
        self.start()

    @classmethod
    def open(cls, config: Config) -> RecordMqtt:
        """Return what publishes the records of a machine as ``[publish.mqtt]`` says."""
        channels = {
            source.name: tuple(item.name for item in config.channel if item.source == source.name)
            for source in config.source
        }
        return cls(config.publish.mqtt, config.machine.name, channels, config.machine.state_dir)

    def _begin(self, store: SharedConnection) -> int:
        """Return the ledger number after which to begin: where an earlier run ended, else the present end."""
        path = self._state_dir / PLACE
        end = newest_id(store)
        try:
            found = json.loads(path.read_text(encoding="utf-8"))
            if found["source"] is None:
                return 0
            known = place_of(store, found["source"], found["sequence"])
            if known is not None:
                return known.id
            oldest = condensed_place(store, found["source"], found["sequence"])
            if oldest is not None:
                _LOG.warning("records left the store before they were published over MQTT; going on after them")
                return oldest
            _LOG.warning("the block at which publishing over MQTT ended is not in the store; going on with new ones")
        except FileNotFoundError:
            pass
        except (OSError, ValueError, KeyError, TypeError) as error:
            _LOG.warning("%s cannot be read (%s); publishing over MQTT goes on with new records", path, error)
        # The position in an empty store is kept, too, so that no record is skipped.
        self._reached = place_at(store, end) or LedgerPlace(0, "", 0)
        self._write_place()
        return end

    def _over(self) -> bool:
        return self._ending and self._monotonic() >= self._until

    def _session(self) -> None:
        """Publish over one connection, until the end or its loss."""
        self._connected = False
        will = (f"{self._topic}/state", state_message(self._machine, None))
        with SharedConnection(self._store) as store:
            if self._place is None:
                self._place = self._begin(store)
            link = BrokerLink(self._section, will=will, wake=self.changed)
            try:
                link.connect()
                self._works()
                self._state = None
                self._follow(link, store, self._place)
            finally:
                self._write_place()
                link.close()

    def _follow(self, link: BrokerLink, store: SharedConnection, place: int) -> None:
        self._sent.clear()
        self._waiting.clear()
        self._stated = None
        confirmed = self._monotonic()
        while not self._over():
            with self._wake:
                # As it is here for the whole round: the last state is published before the end.
                self._news, ending = False, self._ending
            link.check()
            if self._confirm(link) or not self._sent:
                confirmed = self._monotonic()
            elif self._monotonic() - confirmed > _MAX_SILENCE_S:
                raise BrokerError(f"mqtt {self._section.host}: the broker does not confirm")
            self._publish_state(link, ending=ending)
            ready = len(self._waiting) < _MAX_UNCONFIRMED and self._wait_allowed() <= 0.0
            found = False
            for number, record in records_after(store, self._machine, place, _MAX_ROWS) if ready else ():
                found = True
                if self._wait_allowed() > 0.0:
                    break
                self._publish(link, number, record)
                place = number
            if self._monotonic() >= self._place_due:
                self._write_place()
            if not found and self._wait(ending=ending):
                return

    def _wait(self, *, ending: bool) -> bool:
        """Wait for new records, or until the rate limit allows more; return whether to end."""
        until_allowed = self._wait_allowed()
        # A connection that is closed before its confirmations are read may lose what was sent last.
        if ending and not self._sent and self._stated is None and until_allowed <= 0.0:
            return True
        most = min(_STATE_S, until_allowed) if until_allowed > 0.0 else _STATE_S
        with self._wake:
            if ending:
                self._wake.wait_for(lambda: self._news, min(most, _ENDING_TURN_S))
            else:
                self._wake.wait_for(lambda: self._news or self._ending, most)
        return False

    def _wait_allowed(self) -> float:
        """Return the seconds until the rate limit allows another record, 0 or less if it does now."""
        return self._allowed - self._monotonic() - 1.0

    def _publish(self, link: BrokerLink, number: int, record: StoredRecord) -> None:
        source = record.source
        names = self._channels.get(source) or tuple(record.channels)
        item = _Sent(LedgerPlace(number, source, record.sequence), len(names))
        self._sent.append(item)
        for name in names:
            topic = "/".join((self._topic, quote(source, safe=""), quote(name, safe="")))
            self._waiting[link.publish(topic, channel_message(record, name), retain=self._section.retain)] = item
        self._allowed = max(self._allowed, self._monotonic()) + len(names) / self._section.most_per_s

    def _confirm(self, link: BrokerLink) -> bool:
        """Process confirmations; the position moves past blocks that are wholly confirmed."""
        confirmed = link.take_confirmed()
        if self._stated in confirmed:
            self._stated = None
        for message in confirmed:
            item = self._waiting.pop(message, None)
            if item is not None:
                item.missing -= 1
        while self._sent and not self._sent[0].missing:
            self._reached = self._sent.popleft().at
            self._place = self._reached.id
        return bool(confirmed)

    def _publish_state(self, link: BrokerLink, *, ending: bool) -> None:
        """Publish the state of the machine if it has changed."""
        now = self._monotonic()
        if now < self._state_due and not ending:
            return
        self._state_due = now + _STATE_S
        try:
            status = json.loads((self._state_dir / "status.json").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return
        if ending:
            status["status"] = "stopped"
        message = state_message(self._machine, status)
        if message != self._state:
            self._stated = link.publish(f"{self._topic}/state", message, retain=True)
            self._state = message

    def _write_place(self) -> None:
        """Write the position; on a full disk, some records are published again after a restart."""
        self._place_due = self._monotonic() + _PLACE_S
        if self._reached is None or self._reached == self._written:
            return
        values = {"source": self._reached.source or None, "sequence": self._reached.sequence}
        path = self._state_dir / PLACE
        try:
            with replacing(path) as temporary:
                temporary.write_text(json.dumps(values), encoding="utf-8")
        except OSError as error:
            _LOG.debug("%s cannot be written: %s", path, error)
            return
        self._written = self._reached
