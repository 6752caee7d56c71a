"""Notices of silent sources: one when a source falls silent, one when its blocks come again.

A source is silent when no block came for ten of its usual intervals, at least a minute. The silence ends when blocks
have come for as long without such a gap, so that a source with rare blocks causes one notice, not many.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from monitor.health.record import Record
from monitor.records.database import StoreError
from monitor.records.events import EventLog
from monitor.records.store import Store

_LOG = logging.getLogger(__name__)
_DEFAULT_LIMIT_S = 600.0
_MIN_LIMIT_S = 60.0
_SILENT_INTERVALS = 10.0
_LATEST_KINDS = """
SELECT json_extract(body, '$.source'), json_extract(body, '$.kind') FROM notices
WHERE json_extract(body, '$.kind') IN ('no_data', 'data_again') ORDER BY id
"""


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
        latest = dict(store.rows(_LATEST_KINDS))
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
