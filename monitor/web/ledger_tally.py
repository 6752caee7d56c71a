"""Number of blocks by status, counted incrementally."""

from __future__ import annotations

import threading
from collections import Counter, deque
from collections.abc import Mapping
from typing import Any

from monitor.web.answers import without_folders
from monitor.web.reading import StoreReader

_STEP_BLOCKS = 20_000
_MAX_LISTED = 1000
_QUERY = """
SELECT id, source, sequence, status, axis_time, day IS NOT NULL, name, reason FROM blocks WHERE id > ?
ORDER BY id LIMIT ?
"""


class LedgerTally:
    """Counts by source and status, and the latest blocks that were not ``ok``; may be used from any thread."""

    def __init__(self, store: StoreReader) -> None:
        """Keep the store; nothing is counted yet."""
        self._store = store
        self._lock = threading.Lock()
        self._file: tuple[int, int] | None = None
        self._begin()

    def _begin(self) -> None:
        self._last = 0
        self._counts: Counter[tuple[str, str]] = Counter()
        self._others: deque[dict[str, Any]] = deque(maxlen=_MAX_LISTED)
        self.complete = False

    def update(self) -> bool:
        """Count some blocks; return whether there are more. StoreError where the store cannot be read."""
        with self._lock:
            file = self._store.identity()
            if file != self._file:
                self._file = file
                self._begin()
            rows = self._store.rows(_QUERY, self._last, _STEP_BLOCKS)
            for number, source, sequence, status, time, dated, name, reason in rows:
                self._counts[source, status] += 1
                self._last = number
                if status != "ok":
                    self._others.append(
                        {
                            "source": source,
                            "block": sequence,
                            "name": name.replace("\\", "/").rpartition("/")[2],
                            "time_s": time,
                            "dated": bool(dated),
                            "status": status,
                            "reason": without_folders(reason),
                        }
                    )
            self.complete = len(rows) < _STEP_BLOCKS
            return not self.complete

    def counts(self, source: str | None = None) -> dict[str, int]:
        """Return the number of blocks by status, of one source or of all."""
        found: Counter[str] = Counter()
        with self._lock:
            for (name, status), number in self._counts.items():
                if source in (None, name):
                    found[status] += number
        return dict(sorted(found.items()))

    def by_source(self) -> Mapping[tuple[str, str], int]:
        """Return the number of blocks by source and status."""
        with self._lock:
            return dict(self._counts)

    def others(self, limit: int, source: str | None = None) -> list[dict[str, Any]]:
        """Return the latest blocks that were not ``ok``, the newest first."""
        with self._lock:
            found = [block for block in reversed(self._others) if source in (None, block["source"])]
        return found[:limit]
