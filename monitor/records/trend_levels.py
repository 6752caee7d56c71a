"""Extremes of records over stretches of time: how they are made, joined, and kept as rows of ``trends.db``."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.health.schema import STATUSES

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
BucketRow = tuple[int, int, int, str | None, int, bytes]


@dataclass(frozen=True, eq=False)
class Buckets:
    """Stretches of time of one length, and what the records in each of them were; n stretches in ascending order.

    Attributes:
        series: number of the channel that each is of, shape (n,); they are in ascending order by channel, then time.
        index: number of the stretch: its start over its length, shape (n,).
        low: least value of each feature, NaN where there is none, shape (n, feature).
        high: likewise the largest.
        counts: records of each status, in the order of ``STATUSES``, shape (n, status).
    """

    series: Whole
    index: Whole
    low: Array
    high: Array
    counts: Whole

    @classmethod
    def of_records(cls, series: Whole, time: Array, values: Array, status: Whole, length: float) -> Buckets:
        """Return the stretches that records fall into.

        Args:
            series: number of the channel that each record is of, shape (record,).
            time: of each record, s, shape (record,), in any order.
            values: its features, NaN where there is none, shape (record, feature).
            status: its place in ``STATUSES``, shape (record,).
            length: of a stretch, s.
        """
        counts = np.zeros((time.size, len(STATUSES)), dtype=np.int64)
        counts[np.arange(time.size), status] = 1
        index = np.floor_divide(time, length).astype(np.int64)
        return cls(series, index, values, values, counts)._joined()

    def coarser(self, factor: int) -> Buckets:
        """Return the stretches that are ``factor`` times as long."""
        return Buckets(self.series, self.index // factor, self.low, self.high, self.counts)._joined()

    def with_others(self, others: Buckets) -> Buckets:
        """Return the stretches of both."""
        if not others.index.size:
            return self
        names = ("series", "index", "low", "high", "counts")
        pairs = ((getattr(self, name), getattr(others, name)) for name in names)
        return Buckets(*(np.concatenate(pair) for pair in pairs))._joined()

    def _joined(self) -> Buckets:
        """Return one stretch for all of the same channel and number, in ascending order."""
        if not self.index.size:
            return self
        order = np.lexsort((self.index, self.series))
        series, index = self.series[order], self.index[order]
        starts = np.flatnonzero(np.append(True, (index[1:] != index[:-1]) | (series[1:] != series[:-1])))
        return Buckets(
            series[starts],
            index[starts],
            np.fmin.reduceat(self.low[order], starts, axis=0),
            np.fmax.reduceat(self.high[order], starts, axis=0),
            np.add.reduceat(self.counts[order], starts, axis=0),
        )

    def to_rows(self) -> Iterable[BucketRow]:
        """Yield series, number, records, other statuses than ok (JSON), features that are there (bits), extremes."""
        known = ~np.isnan(self.low)
        bits = (known @ (1 << np.arange(len(FEATURES), dtype=np.int64))).tolist()
        packed = [b""] * len(bits)
        for pattern, places in _alike(bits).items():
            columns = _columns(pattern)
            extremes = np.stack([part[np.ix_(places, columns)] for part in (self.low, self.high)], axis=1)
            whole, size = extremes.astype("<f8").tobytes(), 16 * len(columns)
            for order, place in enumerate(places):
                packed[place] = whole[order * size : (order + 1) * size]
        others: list[str | None] = [None] * len(bits)
        for place in np.flatnonzero(self.counts[:, 1:].any(axis=1)):
            counts = self.counts[place]
            others[place] = json.dumps(
                {int(status): int(counts[status]) for status in np.flatnonzero(counts) if status}
            )
        records = self.counts.sum(axis=1).tolist()
        return zip(self.series.tolist(), self.index.tolist(), records, others, bits, packed, strict=True)

    @classmethod
    def from_rows(cls, rows: Sequence[BucketRow]) -> Buckets:
        """Return what :meth:`to_rows` gave.

        Raises:
            ValueError: the rows are damaged.
        """
        size = len(rows)
        low, high = np.full((2, size, len(FEATURES)), np.nan)
        counts = np.zeros((size, len(STATUSES)), dtype=np.int64)
        for place, (_, _, records, others, _, _) in enumerate(rows):
            counts[place, 0] = records
            if others is not None:
                _spread(counts[place], json.loads(others))
        for pattern, places in _alike([row[4] for row in rows]).items():
            columns = _columns(pattern)
            packed = np.frombuffer(b"".join(rows[place][5] for place in places), dtype="<f8")
            extremes = packed.reshape(len(places), 2, len(columns))
            low[np.ix_(places, columns)], high[np.ix_(places, columns)] = extremes[:, 0], extremes[:, 1]
        series, index = (np.array([row[column] for row in rows], dtype=np.int64) for column in (0, 1))
        return cls(series, index, low, high, counts)


def _alike(bits: Sequence[int]) -> dict[int, list[int]]:
    """Return the places of each pattern of bits."""
    found: dict[int, list[int]] = {}
    for place, pattern in enumerate(bits):
        found.setdefault(pattern, []).append(place)
    return found


def _columns(pattern: int) -> list[int]:
    """Return which features a pattern of bits holds."""
    return [column for column in range(len(FEATURES)) if pattern >> column & 1]


def _spread(counts: Whole, others: dict[str, Any]) -> None:
    """Take the records of other statuses from those that count as ok."""
    for status, number in others.items():
        counts[int(status)] = number
        counts[0] -= number
