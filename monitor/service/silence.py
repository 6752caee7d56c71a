"""Whether the blocks of a source stay away, and the notices that say so: one when it falls silent, one when it is back.

A source is silent when nothing came for ten of its usual intervals, at least a minute. It is heard again when blocks
have come for as long without such a gap: one that delivers now and then is said to be silent once, not every time.
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
_FIRST_SILENCE = 600.0
_SHORTEST_SILENCE = 60.0
_SILENT_INTERVALS = 10.0
_SAID = """
SELECT json_extract(body, '$.source'), json_extract(body, '$.kind') FROM notices
WHERE json_extract(body, '$.kind') IN ('no_data', 'data_again') ORDER BY id
"""


def patience(interval: float | None) -> float:
    """Return the seconds after which silence is a state of its own.

    Args:
        interval: usual seconds from block to block, or None where it is not known yet.
    """
    return _FIRST_SILENCE if interval is None else max(_SHORTEST_SILENCE, _SILENT_INTERVALS * interval)


@dataclass(frozen=True)
class Last:
    """The latest block of a source.

    Attributes:
        sequence: its number, 0 before the first.
        time: UTC time of the latest block that has one, s, or None.
        status: its status, or None.
        refused: whether it was rejected.
        came: when it was committed, s of the monotonic clock, or None where that was before the start.
        flowing: since when blocks come without a silence, s of the monotonic clock, or None before the first.
    """

    sequence: int = 0
    time: float | None = None
    status: str | None = None
    refused: bool = False
    came: float | None = None
    flowing: float | None = None

    def after(self, record: Record, came: float | None, patience: float) -> Last:
        """Return what is known after another block."""
        flowing = self.flowing
        if flowing is None or self.came is None or (came is not None and came - self.came > patience):
            flowing = came
        time = record.time if record.time is not None else self.time
        return Last(record.sequence, time, record.status, not record.accepted, came, flowing)


@dataclass(frozen=True)
class Hearing:
    """What is heard of a source by now.

    Attributes:
        block: number of its latest block, or None.
        age: seconds since that was committed, since the start, or since blocks could be taken again.
        patience: seconds after which silence is a state of its own.
        flowed: seconds from the first to the latest block that came without a silence between them.
    """

    block: int | None
    age: float
    patience: float
    flowed: float

    @property
    def silent(self) -> bool:
        """Whether its blocks stay away."""
        return self.age > self.patience


class SilenceLog:
    """Logs when sources fall silent and when they are back, once each, also across restarts."""

    def __init__(
        self, store: Store, log: EventLog, channels: Mapping[str, Sequence[str]], clock: Callable[[], float]
    ) -> None:
        """Find out what the log says of each source.

        Args:
            store: of the log.
            log: open.
            channels: by source, what listens to it.
            clock: UTC seconds since 1970.
        """
        self._log, self._clock = log, clock
        self._channels = {source: list(names) for source, names in channels.items()}
        said = dict(store.rows(_SAID))
        self._silent = {source: said.get(source) == "no_data" for source in channels}
        self.problem: str | None = None
        """Why a notice cannot be logged, or None; it is tried again."""

    def look(self, heard: Mapping[str, Hearing]) -> list[dict[str, Any]]:
        """Log what has changed, and return it."""
        found = []
        for source, hearing in heard.items():
            if hearing.silent == self._silent[source]:
                continue
            if not hearing.silent and hearing.flowed < hearing.patience:
                continue
            body = self._notice(source, hearing)
            try:
                self._log.notice(self._clock(), body)
            except StoreError as error:
                if self.problem is None:
                    _LOG.error("a notice cannot be logged: %s", error)
                self.problem = str(error)
                continue
            self.problem = None
            self._silent[source] = hearing.silent
            _LOG.warning("%s", body["text"])
            found.append(body)
        return found

    def _notice(self, source: str, hearing: Hearing) -> dict[str, Any]:
        about = {"source": source, "channels": self._channels[source], "last_block": hearing.block}
        if hearing.silent:
            text = f"no block from source {source} for {hearing.age:.0f} s"
            text += "" if hearing.block is None else f"; the last was block {hearing.block}"
            return {"kind": "no_data", **about, "age_s": round(hearing.age, 3), "text": text}
        text = f"blocks come from source {source} again, for {hearing.flowed:.0f} s by now"
        return {"kind": "data_again", **about, "text": text}
