"""The status of a machine for people and programs: its channels, alarms, sources, problems, NAMUR NE 107 status.

A source is silent when no block came for ten of its usual intervals, at least a minute. One notice says so. The silence
ends, with another notice, when blocks have come for as long without such a gap: a source with rare blocks causes one
notice, not many.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from monitor import __version__
from monitor.config.load import Config
from monitor.health.alarms import (
    BAD_DATA,
    FAILURE,
    MAINTENANCE,
    NO_DATA,
    OUT_OF_SPECIFICATION,
    SEVERITIES,
    AlarmSettings,
    AlarmState,
    RuleState,
    condition_of,
    limit_of,
    machine_state,
)
from monitor.health.record import Record
from monitor.health.state import SourceState
from monitor.records.database import StoreError
from monitor.records.events import EventLog
from monitor.records.queries import latest_flow_notices
from monitor.records.store import Store
from monitor.service.ingest import Ingest
from monitor.service.summary import bearing_summaries, channel_summary, with_words
from monitor.words.events import utc_text
from monitor.words.features import rule_words
from monitor.words.statuses import STATES, suspended_words

_LOG = logging.getLogger(__name__)
_DEFAULT_LIMIT_S = 600.0
_MIN_LIMIT_S = 60.0
_SILENT_INTERVALS = 10.0
_SEVERITY_OF = {FAILURE: "danger", MAINTENANCE: "alert"}
_STAGES = {FAILURE: ("end_of_life", "the end of life was reached"), MAINTENANCE: ("final", "the final stage has begun")}


def silence_limit(interval: float | None) -> float:
    """Return the seconds without a block after which a source with a usual interval (s, None unknown) is silent."""
    return _DEFAULT_LIMIT_S if interval is None else max(_MIN_LIMIT_S, _SILENT_INTERVALS * interval)


@dataclass(frozen=True)
class LatestBlock:
    """The latest block of a source; number 0 before the first."""

    sequence: int = 0
    time: float | None = None
    """UTC time of the latest block that has one, s, or None."""
    status: str | None = None
    rejected: bool = False
    committed: float | None = None
    """Monotonic time, s, or None where it was committed before the start."""
    flowing_since: float | None = None
    """Monotonic time of the first commit after the latest silence, s, or None."""

    def after(self, record: Record, committed: float | None, limit: float) -> LatestBlock:
        """Return the state after another block; ``limit`` as :func:`silence_limit` gives it."""
        since = self.flowing_since
        if since is None or self.committed is None or (committed is not None and committed - self.committed > limit):
            since = committed
        time = record.time if record.time is not None else self.time
        return LatestBlock(record.sequence, time, record.status, not record.accepted, committed, since)


@dataclass(frozen=True)
class DataFlow:
    """The flow of blocks of one source at present; ``block`` is the number of its latest one, or None."""

    block: int | None
    age: float
    """Seconds since that was committed, since the start, or since blocks could be taken again."""
    limit: float
    """Age beyond which the source is silent, s."""
    flowed: float
    """Seconds from the first to the latest block that came without a silence between them."""

    @property
    def silent(self) -> bool:
        """Whether no block came within the limit."""
        return self.age > self.limit


class SilenceLog:
    """Logs when sources fall silent and when their blocks come again, once each, also across restarts."""

    def __init__(
        self, store: Store, log: EventLog, channels: Mapping[str, Sequence[str]], clock: Callable[[], float]
    ) -> None:
        """Read the latest notice of each source; ``channels`` are names by source, ``clock`` gives UTC seconds."""
        self._log, self._clock = log, clock
        self._channels = {source: list(names) for source, names in channels.items()}
        latest = latest_flow_notices(store)
        self._silent = {source: latest.get(source) == "no_data" for source in channels}
        self.problem: str | None = None
        """Why a notice cannot be logged, or None; it is tried again."""

    def update(self, flows: Mapping[str, DataFlow]) -> list[dict[str, Any]]:
        """Log what has changed, and return the notices."""
        notices = []
        for source, flow in flows.items():
            if flow.silent == self._silent[source]:
                continue
            if not flow.silent and flow.flowed < flow.limit:
                continue
            body = self._notice(source, flow)
            try:
                self._log.notice(self._clock(), body)
            except StoreError as error:
                if self.problem is None:
                    _LOG.error("a notice cannot be logged: %s", error)
                self.problem = str(error)
                continue
            self.problem = None
            self._silent[source] = flow.silent
            _LOG.warning("%s", body["text"])
            notices.append(body)
        return notices

    def _notice(self, source: str, flow: DataFlow) -> dict[str, Any]:
        about = {"source": source, "channels": self._channels[source], "last_block": flow.block}
        if flow.silent:
            text = f"no block from source {source} for {flow.age:.0f} s"
            text += "" if flow.block is None else f"; the last was block {flow.block}"
            return {"kind": "no_data", **about, "age_s": round(flow.age, 3), "text": text}
        text = f"blocks come from source {source} again, for {flow.flowed:.0f} s by now"
        return {"kind": "data_again", **about, "text": text}


class MachineStatus:
    """The status of one machine, composed in the thread that commits."""

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
        recovered: str | None = None,
    ) -> None:
        """Read the latest block of each source; ``began`` (monotonic) and ``since`` (UTC) are the start, s.

        ``recovered`` says what a recovery at the start saved and lost.
        """
        self._config, self._ingest = config, ingest
        self._monotonic, self._clock = monotonic, clock
        self._began, self._since = began, since
        self._recovered = recovered
        self._taking_since = began
        self.blocks = 0
        """Blocks committed since the start."""
        self.page: str | None = None
        """Address of the page, or None where there is none."""
        self.unacknowledged = 0
        """Events and notices that need an acknowledgement."""
        self._latest = {name: LatestBlock() for name in ingest.settings}
        for name in ingest.settings:
            record = store.record(name, store.last(name))
            if record is not None:
                self._latest[name] = LatestBlock().after(record, None, silence_limit(None))

    def note(self, record: Record) -> None:
        """Note a committed block."""
        self.blocks += 1
        limit = silence_limit(self._ingest.interval(record.source))
        self._latest[record.source] = self._latest[record.source].after(record, self._monotonic(), limit)

    def resumed(self) -> None:
        """Note that blocks can be taken again: silence is counted from here, as none could arrive before."""
        self._taking_since = self._monotonic()

    def flows(self) -> dict[str, DataFlow]:
        """Return the present flow of blocks of each source."""
        now = self._monotonic()
        found = {}
        for source, latest in self._latest.items():
            age = now - max(self._taking_since, self._began if latest.committed is None else latest.committed)
            flowed = 0.0
            if latest.committed is not None and latest.flowing_since is not None:
                flowed = latest.committed - latest.flowing_since
            limit = silence_limit(self._ingest.interval(source))
            found[source] = DataFlow(latest.sequence or None, age, limit, flowed)
        return found

    def absolute(self, channel: str | None) -> bool:
        """Return whether the accelerations of a channel are in m/s2."""
        return all(section.unit != "unknown" for section in self._config.channel if section.name == channel)

    def values(
        self, status: str, problems: Mapping[str, str], failures: Mapping[str, Mapping[str, Any]] | None = None
    ) -> dict[str, Any]:
        """Return the status as plain values for JSON.

        ``status`` is "stopped", or "running", which becomes "degraded" where there are problems: sentences by the name
        of the source or the part. ``failures`` are those since the start, by the name of the part.
        """
        flows = self.flows()
        channels = {
            name: self._channel(source, name, flows[source])
            for source, settings in self._ingest.settings.items()
            for name in settings.channels
        }
        bearings = bearing_summaries(
            (self._ingest.state(name), settings) for name, settings in self._ingest.settings.items()
        )
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
            "poisoned": self._poisoned(),
            "sources": {name: vars(backlog) for name, backlog in self._ingest.backlogs().items()},
            "ignored": self._ingest.ignored(),
            "problems": dict(problems),
            "failures": dict(failures or {}),
            "recovered": self._recovered,
            "bearings": bearings,
            "channels": with_words(self._config, channels, bearings),
        }

    def _poisoned(self) -> dict[str, str]:
        """Return the files that are set aside, each with its source."""
        try:
            return {
                path: f"source {source}: the monitor died while it handled it"
                for source, path in self._ingest.poisoned()
            }
        except StoreError:
            # It is among the problems already.
            return {}

    def _channel(self, source: str, name: str, flow: DataFlow) -> dict[str, Any]:
        latest, now = self._latest[source], self._ingest.state(source)
        settings = self._ingest.settings[source].channels[name]
        rules = settings.alarms
        alarms = shown_alarms(now.alarms[name], rules)
        state, reason = channel_state(
            channel_condition(now, name, rules),
            alarms,
            stage=now.channels[name].detect.stage,
            suspended=rules.suspended,
            refused=f"block {latest.sequence} was rejected: {latest.status}" if latest.rejected else None,
            silent=f"no block for {flow.age:.0f} s" if flow.silent else None,
        )
        return {
            "source": source,
            "state": state,
            "reason": reason,
            "last_block": latest.sequence or None,
            "last_block_utc": utc_text(latest.time),
            "last_block_status": latest.status,
            "last_block_age_s": None if latest.committed is None else round(self._monotonic() - latest.committed, 3),
            "alarms": alarms,
            "levels": alarm_levels(now.alarms[name], rules),
            **channel_summary(now, settings),
        }


def shown_alarms(state: AlarmState, settings: AlarmSettings) -> list[dict[str, Any]]:
    """Return the alarms of a channel that are active or latched, dangers first."""
    return [
        {
            "rule": rule.name,
            "feature": rule.feature,
            "severity": severity,
            "active": level.active,
            "latched": level.held,
            "since_block": level.since,
        }
        for severity in reversed(SEVERITIES)
        for rule in settings.rules
        if (level := state.level(rule.name, severity)).shown
    ]


def alarm_levels(state: AlarmState, settings: AlarmSettings) -> list[dict[str, Any]]:
    """Return the levels of a channel, SI; None for one that is not configured, or not learned yet."""
    found = []
    for rule in settings.rules:
        baseline = state.rules.get(rule.name, RuleState()).baseline
        limits = {f"{severity}_si": limit_of(rule, getattr(rule, severity), baseline) for severity in SEVERITIES}
        found.append({"rule": rule.name, "feature": rule.feature, "side": rule.side, **limits})
    return found


def channel_condition(state: SourceState, channel: str, settings: AlarmSettings) -> str:
    """Return the status of a channel by its blocks alone, acknowledgements since the latest one included."""
    return condition_of(state.alarms[channel], settings, state.channels[channel].detect.stage)


def channel_state(
    condition: str,
    alarms: Sequence[Mapping[str, Any]] = (),
    *,
    stage: str = "healthy",
    suspended: Sequence[str] = (),
    silent: str | None = None,
    refused: str | None = None,
) -> tuple[str, str]:
    """Return the worst NAMUR NE 107 status that applies to a channel, and its reason as a sentence.

    ``condition`` is the status by the alarm stage, ``suspended`` the rules that are not applied. ``silent`` says for
    how long no block came, ``refused`` why the latest block was rejected, where that is so.
    """
    state = machine_state(condition, *([NO_DATA] if silent else []), *([BAD_DATA] if refused else []))
    reached, text = _STAGES.get(state, ("", ""))
    reasons = [text] if stage == reached else []
    for alarm in alarms:
        if alarm["severity"] == _SEVERITY_OF.get(state):
            waits = "" if alarm["active"] else ", which is over and waits to be acknowledged"
            reasons.append(f"{alarm['severity']} of {rule_words(alarm)} since block {alarm['since_block']}{waits}")
    fallback = {NO_DATA: silent, BAD_DATA: refused}.get(state)
    if state == OUT_OF_SPECIFICATION and suspended:
        fallback = f"{STATES[state][1]}; {suspended_words(suspended)}"
    return state, "; ".join(reasons) or fallback or STATES[state][1]
