"""What a daemon says of its machine: who it is, how its sources and channels stand, and what is wrong."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import Any

from monitor import __version__
from monitor.config.load import Config
from monitor.health.alarms import machine_state
from monitor.health.record import Record
from monitor.records.store import Store
from monitor.service.ingest import Ingest
from monitor.service.silence import Hearing, Last, patience
from monitor.service.standing import alarm_levels, channel_condition, channel_state, shown_alarms
from monitor.service.summary import channel_summary
from monitor.words.events import utc_text


class MachineStatus:
    """Puts together the status of one machine; it is used in the thread that commits."""

    def __init__(
        self,
        config: Config,
        store: Store,
        ingest: Ingest,
        monotonic: Callable[[], float],
        clock: Callable[[], float],
        *,
        began: float,
        since: float,
    ) -> None:
        """Take what is open, and from the store what the latest blocks were.

        Args:
            config: the machine.
            store: open.
            ingest: on that store.
            monotonic: seconds that never go back.
            clock: UTC seconds since 1970.
            began: monotonic time of the start.
            since: UTC time of the start.
        """
        self._config, self._ingest = config, ingest
        self._monotonic, self._clock = monotonic, clock
        self._began, self._since = began, since
        self._taking = began
        self.blocks = 0
        """Blocks committed since the start."""
        self.page: str | None = None
        """Address of the page, or None where there is none."""
        self.unacknowledged = 0
        """Events and notices that wait for somebody."""
        self._last = {name: _last_of(store, name) for name in ingest.settings}

    def seen(self, record: Record) -> None:
        """Take note of a committed block."""
        self.blocks += 1
        last, interval = self._last[record.source], self._ingest.state(record.source).order.interval
        self._last[record.source] = last.after(record, self._monotonic(), patience(interval))

    def resumed(self) -> None:
        """Take note that nothing could be taken for a while: that sources were not heard meanwhile says nothing."""
        self._taking = self._monotonic()

    def heard(self) -> dict[str, Hearing]:
        """Return what is heard of each source by now."""
        now = self._monotonic()
        found = {}
        for source, last in self._last.items():
            age = now - max(self._taking, self._began if last.came is None else last.came)
            flowed = 0.0 if last.came is None or last.flowing is None else last.came - last.flowing
            interval = self._ingest.state(source).order.interval
            found[source] = Hearing(last.sequence or None, age, patience(interval), flowed)
        return found

    def absolute(self, channel: str | None) -> bool:
        """Return whether the accelerations of a channel are in m/s2."""
        return all(section.unit != "unknown" for section in self._config.channel if section.name == channel)

    def values(self, status: str, problems: Mapping[str, str]) -> dict[str, Any]:
        """Return what the daemon is doing, plain values for JSON.

        Args:
            status: "running", which becomes "degraded" where there are problems; "stopped".
            problems: what is wrong, in one sentence each, by the name of a source or of what else it is.
        """
        heard = self.heard()
        channels = {
            name: self._channel(source, name, heard[source])
            for source, settings in self._ingest.settings.items()
            for name in settings.channels
        }
        return {
            "status": "degraded" if problems and status == "running" else status,
            "machine": self._config.machine.name,
            "state": machine_state(*(channel["state"] for channel in channels.values())),
            "pid": os.getpid(),
            "version": __version__,
            "since_utc": utc_text(self._since),
            "updated_utc": utc_text(self._clock()),
            "up_s": round(self._monotonic() - self._began, 3),
            "config_hash": self._config.hash,
            "blocks": self.blocks,
            "page": self.page,
            "alarms": sum(len(channel["alarms"]) for channel in channels.values()),
            "unacknowledged": self.unacknowledged,
            "sources": {name: vars(backlog) for name, backlog in self._ingest.backlogs().items()},
            "problems": dict(problems),
            "channels": channels,
        }

    def _channel(self, source: str, name: str, heard: Hearing) -> dict[str, Any]:
        last, now, rules = self._last[source], self._ingest.state(source), self._ingest.settings[source].channels[name]
        alarms = shown_alarms(now.alarms[name], rules.alarms)
        state, reason = channel_state(
            channel_condition(now, name, rules.alarms),
            alarms,
            stage=now.channels[name].detect.stage,
            refused=f"block {last.sequence} was rejected: {last.status}" if last.refused else None,
            silent=f"no block for {heard.age:.0f} s" if heard.silent else None,
        )
        return {
            "source": source,
            "state": state,
            "reason": reason,
            "last_block": last.sequence or None,
            "last_block_utc": utc_text(last.time),
            "last_block_status": last.status,
            "last_block_age_s": None if last.came is None else round(self._monotonic() - last.came, 3),
            "alarms": alarms,
            "levels": alarm_levels(now.alarms[name], rules.alarms),
            **channel_summary(now, name),
        }


def _last_of(store: Store, source: str) -> Last:
    record = store.record(source, store.last(source))
    return Last() if record is None else Last().after(record, None, patience(None))
