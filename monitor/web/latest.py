"""The latest values of all channels of a machine, read once for each block that came."""

from __future__ import annotations

import threading
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from monitor.records.packing import columns_of, numbers_of, places_of
from monitor.web.reading import StoreReader

NAMES = ("rms", "h_or", "v_eq", "v_eq_lower", "v_eq_upper", "tt", "tt_lower", "tt_upper", "p_threshold", "speed")
_QUERY = """
SELECT layout, row FROM blocks JOIN records ON block = id
WHERE source = ? AND length(row) > 0 ORDER BY sequence DESC LIMIT 1
"""


class LatestValues:
    """Values in the latest record of each source that has any, SI; may be asked from any thread."""

    def __init__(self, store: StoreReader) -> None:
        """Take the store."""
        self._store = store
        self._lock = threading.Lock()
        self._newest: tuple[object, int] | None = None
        self._values: dict[str, dict[str, dict[str, float]]] = {}

    def of(self, sources: Mapping[str, list[str]]) -> Mapping[str, Mapping[str, Mapping[str, float]]]:
        """Return the values by source, channel and name.

        Args:
            sources: channels by source.

        Raises:
            StoreError: the store cannot be read.
        """
        with self._lock, self._store.connection() as connection:
            newest = connection.execute("SELECT coalesce(max(id), 0) FROM blocks").fetchone()[0]
            if self._newest == (self._store.identity(), newest):
                return self._values
            values: dict[str, dict[str, dict[str, float]]] = {}
            for source, channels in sources.items():
                found = connection.execute(_QUERY, (source,)).fetchone()
                if found is None:
                    continue
                (layout,) = connection.execute("SELECT layout FROM layouts WHERE id = ?", (found[0],)).fetchone()
                places, row = places_of(layout, NAMES), numbers_of(found[1])[None, :]
                values[source] = {
                    channel: _finite(columns_of(row, places[channel])[0]) for channel in channels if channel in places
                }
            self._newest, self._values = (self._store.identity(), newest), values
            return values


def _finite(values: NDArray[np.float64]) -> dict[str, float]:
    return {name: value for name, value in zip(NAMES, values.tolist(), strict=True) if np.isfinite(value)}
