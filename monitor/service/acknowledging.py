"""What people acknowledge: another process writes it to the event log, the one that commits reads it."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping

from monitor.records.events import EventLog
from monitor.records.store import Store
from monitor.service.alarming import Acknowledged
from monitor.service.watcher import Watcher

_LOG = logging.getLogger(__name__)
_SHARE = 50.0
_MARKS = """
SELECT (SELECT max(id) FROM acknowledgements), (SELECT max(id) FROM events), (SELECT max(id) FROM notices)
"""


class Acknowledgements:
    """Hands acknowledgements on to the alarms that they let go of, each once.

    The first look takes them all, also those that were given while no daemon ran, or that one knew of that was killed
    before its next block: what was let go of before holds nothing, so that nothing happens twice.
    """

    def __init__(self, store: Store, log: EventLog, watchers: Mapping[str, Watcher]) -> None:
        """Take what is open; nothing is read yet.

        Args:
            store: read in the thread that commits.
            log: on the same database, which has made its tables.
            watchers: by source.
        """
        self._store, self._log, self._watchers = store, log, dict(watchers)
        self._seen = 0
        self._count_due = float("-inf")
        self._marks: tuple[int | None, ...] | None = None
        self.unacknowledged = 0
        """Events and notices that wait for somebody, as of the latest look."""

    def look(self) -> None:
        """Take what is new.

        Raises:
            StoreError: the database cannot be read.
        """
        marks = self._store.rows(_MARKS)[0]
        if marks == self._marks:
            return
        if (marks[0] or 0) > self._seen:
            self._take()
            self._seen = max(self._seen, marks[0])
        began = time.monotonic()
        if began >= self._count_due:
            self.unacknowledged = self._log.unacknowledged()
            # Of a log with very many events it takes a while, and blocks wait for it.
            self._count_due = time.monotonic() + _SHARE * (time.monotonic() - began)
            self._marks = marks

    def _take(self) -> None:
        for number, utc, event in self._log.acknowledged_alarms(self._seen):
            self._seen = number
            watcher = self._watchers.get(event.source or "")
            if watcher is None:
                continue
            body, block = event.body, event.block or 0
            given = Acknowledged(watcher.source, body["channel"], body["rule"], body["severity"], block, utc)
            if watcher.alarming.acknowledge(given):
                _LOG.info(
                    "%s: %s of %s since block %d is acknowledged", *(given.source, given.severity, given.rule, block)
                )
