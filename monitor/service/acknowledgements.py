"""Acknowledgements of alarms, from the event log to the states of the sources."""

from __future__ import annotations

import logging
import time

from monitor.health.alarms import AlarmAcknowledgement
from monitor.records.events import EventLog
from monitor.records.queries import LogMarks, log_marks
from monitor.records.store import Store
from monitor.service.ingest import Ingest

_LOG = logging.getLogger(__name__)
_COUNT_SHARE = 50.0
"""Least ratio of the time between two counts of unacknowledged events to the duration of one."""


class Acknowledgements:
    """Passes acknowledgements from the event log to the ingest; one that is passed twice has no effect.

    The first poll takes them all, also those given while no daemon ran.
    """

    def __init__(self, store: Store, log: EventLog, ingest: Ingest) -> None:
        """Keep store, log and ingest of one database."""
        self._store, self._log, self._ingest = store, log, ingest
        self._seen = 0
        self._count_due = float("-inf")
        self._marks: LogMarks | None = None
        self.unacknowledged = 0
        """Events and notices that are not acknowledged, as of the latest count."""

    def poll(self) -> None:
        """Take new acknowledgements; raise StoreError where the database cannot be read."""
        marks = log_marks(self._store)
        if marks == self._marks:
            return
        if marks.acknowledgements > self._seen:
            self._take()
            self._seen = max(self._seen, marks.acknowledgements)
        began = time.monotonic()
        if began >= self._count_due:
            self.unacknowledged = self._log.unacknowledged()
            # Counting takes a while in a log with very many events, and blocks wait for it.
            self._count_due = time.monotonic() + _COUNT_SHARE * (time.monotonic() - began)
            self._marks = marks

    def _take(self) -> None:
        for number, utc, event in self._log.acknowledged_alarms(self._seen):
            self._seen = number
            source, body, block = event.source or "", event.body, event.block or 0
            if source not in self._ingest.settings:
                continue
            given = AlarmAcknowledgement(body["channel"], body["rule"], body["severity"], block, utc)
            if self._ingest.acknowledge(source, given):
                _LOG.info("%s: %s of %s since block %d is acknowledged", source, given.severity, given.rule, block)
