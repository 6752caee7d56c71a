"""The mean envelope spectrum of the latest blocks, from which the damaged part is named."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.health.codec import FLOAT32

MAX_TURNS_RATIO = 1.25
"""Revolutions of two blocks of one average, the larger over the smaller: lines are as much broader in the shorter."""


@dataclass(frozen=True, eq=False)
class RecentSpectra:
    """The latest envelope spectra of a channel, in power and relative to the mean envelope, oldest first.

    Attributes:
        rows: one array of shape (band, bin), float32, for each block.
        steps: spacing of the bins of each row, orders of the shaft, None where its spectra are over time: those are
            averaged at equal frequencies, the others at equal orders.
    """

    rows: tuple[NDArray[np.float32], ...] = ()
    steps: tuple[float | None, ...] = ()

    def __post_init__(self) -> None:
        """Count rows without a step as spectra over time."""
        object.__setattr__(self, "steps", (*self.steps, *(None,) * len(self.rows))[: len(self.rows)])

    @property
    def count(self) -> int:
        """How many blocks there are."""
        return len(self.rows)

    def add(self, amplitudes: tuple[NDArray[np.float32], ...], limit: int, step: float | None = None) -> RecentSpectra:
        """Return the spectra with those of one more block (one array a band), and at most ``limit`` blocks.

        Spectra that cannot be averaged with what was start anew: of another number of bands, over time after over the
        angle or the reverse, over time with another number of bins, of revolutions beyond ``MAX_TURNS_RATIO``.
        """
        length = min(amplitude.size for amplitude in amplitudes)
        row = np.square(np.stack([amplitude[:length] for amplitude in amplitudes]), dtype=np.float32)
        earlier = self if self.rows and self._fits(row, step) else RecentSpectra()
        return RecentSpectra((*earlier.rows, row)[-limit:], (*earlier.steps, step)[-limit:])

    def _fits(self, row: NDArray[np.float32], step: float | None) -> bool:
        """Return whether a row can be averaged with the latest."""
        latest = self.steps[-1]
        if step is None or latest is None:
            return step == latest and self.rows[-1].shape == row.shape
        return len(self.rows[-1]) == len(row) and max(step / latest, latest / step) <= MAX_TURNS_RATIO

    def without_oldest(self) -> RecentSpectra:
        """Return all but the oldest."""
        return RecentSpectra(self.rows[1:], self.steps[1:])

    def averages(self) -> tuple[NDArray[np.float64], ...]:
        """Return the root of the mean power of each band at the bins of the latest row, shape (bin,).

        Each block is weighted by one over its noise, the median over the bins. With equal weights a single impact,
        whose spectrum is high everywhere, would outweigh all other blocks, and what is left is no more certain than one
        spectrum.
        """
        rows = np.stack([self._at_latest(row, step) for row, step in zip(self.rows, self.steps, strict=True)])
        noise = np.maximum(np.median(rows, axis=2, keepdims=True), np.finfo(np.float64).tiny)
        weights = (1.0 / noise) / np.sum(1.0 / noise, axis=0)
        return tuple(np.sqrt(np.sum(weights * rows, axis=0)))

    def _at_latest(self, row: NDArray[np.float32], step: float | None) -> NDArray[np.float64]:
        """Return a row at the bins of the latest, shape (band, bin): in power, linear between its own.

        The power of a line, summed over its bins, stays; beyond the end of a row its last value is taken.
        """
        latest, size = self.steps[-1], self.rows[-1].shape[1]
        if step is None or latest is None or (step == latest and row.shape[1] == size):
            return row.astype(np.float64)
        places = np.arange(size, dtype=np.float64) * (latest / step)
        bins, found = np.arange(row.shape[1], dtype=np.float64), np.empty((row.shape[0], size))
        for band in range(row.shape[0]):
            found[band] = np.interp(places, bins, row[band])
        return found

    def __eq__(self, other: object) -> bool:
        """Equal where all rows are equal bit for bit."""
        return (
            isinstance(other, RecentSpectra)
            and self.steps == other.steps
            and all(np.array_equal(a, b) for a, b in zip(self.rows, other.rows, strict=True))
        )

    __hash__ = None  # pyright: ignore[reportAssignmentType]  # holds arrays: equal, but not hashable

    def to_list(self) -> list[dict[str, Any]]:
        """Return the rows as text that keeps every bit."""
        return [
            FLOAT32.encode(row) | ({} if step is None else {"step": step})
            for row, step in zip(self.rows, self.steps, strict=True)
        ]

    @classmethod
    def from_list(cls, rows: list[Mapping[str, Any]]) -> RecentSpectra:
        """Return what :meth:`to_list` wrote."""
        return cls(
            tuple(FLOAT32.decode(row).astype(np.float32) for row in rows), tuple(row.get("step") for row in rows)
        )
