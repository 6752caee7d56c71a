"""Extremes of records over stretches of time: how they are made, joined, and kept as rows of ``trends.db``."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.records.schema import STATUSES

FEATURES = (
    *("rms", "rms_smoothed", "peak", "kurtosis", "crest_factor", "a_star", "h_or", "h_ir", "h_ball", "h_cage"),
    *("detect_score", "fault_snr", "v_eq", "v_eq_lower", "v_eq_upper", "tt", "tt_lower", "tt_upper", "p_threshold"),
    *("speed", "load"),
)
"""Variables of a record whose extremes are kept; of several bands or thresholds the first. Append only."""

LEVELS = (60, 600, 7200, 86400)
"""Lengths of the stretches, s; each is a whole number of times the one before."""

Array = NDArray[np.float64]
Whole = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Buckets:
    """Stretches of time of one length, and what the records in each of them were; n stretches in ascending order.

    Attributes:
        index: number of the stretch: its start over its length, shape (n,).
        low: least value of each feature, NaN where there is none, shape (n, feature).
        high: likewise the largest.
        counts: records of each status, in the order of ``STATUSES``, shape (n, status).
    """

    index: Whole
    low: Array
    high: Array
    counts: Whole

    @classmethod
    def of_records(cls, time: Array, values: Array, status: Whole, length: float) -> Buckets:
        """Return the stretches that records fall into.

        Args:
            time: of each record, s, shape (record,), in any order.
            values: its features, NaN where there is none, shape (record, feature).
            status: its place in ``STATUSES``, shape (record,).
            length: of a stretch, s.
        """
        counts = np.zeros((time.size, len(STATUSES)), dtype=np.int64)
        counts[np.arange(time.size), status] = 1
        index = np.floor_divide(time, length).astype(np.int64)
        return cls(index, values, values, counts)._joined()

    def coarser(self, factor: int) -> Buckets:
        """Return the stretches that are ``factor`` times as long."""
        return Buckets(self.index // factor, self.low, self.high, self.counts)._joined()

    def with_others(self, others: Buckets) -> Buckets:
        """Return the stretches of both."""
        if not others.index.size:
            return self
        pairs = ((getattr(self, name), getattr(others, name)) for name in ("index", "low", "high", "counts"))
        return Buckets(*(np.concatenate(pair) for pair in pairs))._joined()

    def _joined(self) -> Buckets:
        """Return one stretch for all of the same number, in ascending order."""
        if not self.index.size:
            return self
        order = np.argsort(self.index, kind="stable")
        index = self.index[order]
        starts = np.flatnonzero(np.append(True, index[1:] != index[:-1]))
        return Buckets(
            index[starts],
            np.fmin.reduceat(self.low[order], starts, axis=0),
            np.fmax.reduceat(self.high[order], starts, axis=0),
            np.add.reduceat(self.counts[order], starts, axis=0),
        )

    def to_rows(self) -> Iterable[tuple[int, int, str | None, int, bytes]]:
        """Yield number, records, other statuses than ok (JSON), features that are there (bits), their extremes."""
        known = ~np.isnan(self.low)
        bits = known @ (1 << np.arange(len(FEATURES), dtype=np.int64))
        for place, columns in enumerate(known):
            counts = self.counts[place]
            others = {int(status): int(counts[status]) for status in np.flatnonzero(counts) if status}
            yield (
                int(self.index[place]),
                int(counts.sum()),
                json.dumps(others) if others else None,
                int(bits[place]),
                np.concatenate((self.low[place, columns], self.high[place, columns])).astype("<f8").tobytes(),
            )

    @classmethod
    def from_rows(cls, rows: Sequence[tuple[int, int, str | None, int, bytes]]) -> Buckets:
        """Return what :meth:`to_rows` gave.

        Raises:
            ValueError: the rows are damaged.
        """
        size = len(rows)
        low, high = np.full((2, size, len(FEATURES)), np.nan)
        counts = np.zeros((size, len(STATUSES)), dtype=np.int64)
        alike: dict[int, list[int]] = {}
        for place, (_, records, others, bits, _) in enumerate(rows):
            alike.setdefault(bits, []).append(place)
            counts[place, 0] = records
            if others is not None:
                _spread(counts[place], json.loads(others))
        for bits, places in alike.items():
            columns = [column for column in range(len(FEATURES)) if bits >> column & 1]
            packed = np.frombuffer(b"".join(rows[place][4] for place in places), dtype="<f8")
            extremes = packed.reshape(len(places), 2, len(columns))
            low[np.ix_(places, columns)], high[np.ix_(places, columns)] = extremes[:, 0], extremes[:, 1]
        return cls(np.array([row[0] for row in rows], dtype=np.int64), low, high, counts)


def _spread(counts: Whole, others: dict[str, Any]) -> None:
    """Take the records of other statuses from those that count as ok."""
    for status, number in others.items():
        counts[int(status)] = number
        counts[0] -= number
