"""The mean envelope spectrum of the latest blocks, from which the damaged part is named."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class RecentSpectra:
    """The latest envelope spectra of a channel, in power and relative to the mean envelope, oldest first.

    Attributes:
        rows: one array of shape (band, bin), float32, for each block.
    """

    rows: tuple[NDArray[np.float32], ...] = ()

    @property
    def count(self) -> int:
        """How many blocks there are."""
        return len(self.rows)

    def add(self, amplitudes: tuple[NDArray[np.float32], ...], limit: int) -> RecentSpectra:
        """Return the spectra with those of one more block (one array a band), and at most ``limit`` blocks.

        RecentSpectra of another number of bins or bands start anew: they cannot be averaged with what was.
        """
        length = min(amplitude.size for amplitude in amplitudes)
        row = np.square(np.stack([amplitude[:length] for amplitude in amplitudes]), dtype=np.float32)
        earlier = self.rows if self.rows and self.rows[-1].shape == row.shape else ()
        return RecentSpectra((*earlier, row)[-limit:])

    def averages(self) -> tuple[NDArray[np.float64], ...]:
        """Return the root of the mean power of each band, shape (bin,), each block weighted by one over its noise.

        Noise is the median over the bins. With equal weights a single impact, whose spectrum is high everywhere, would
        outweigh all other blocks, and what is left is no more certain than one spectrum.
        """
        rows = np.stack(self.rows).astype(np.float64)
        noise = np.maximum(np.median(rows, axis=2, keepdims=True), np.finfo(np.float64).tiny)
        weights = (1.0 / noise) / np.sum(1.0 / noise, axis=0)
        return tuple(np.sqrt(np.sum(weights * rows, axis=0)))

    def __eq__(self, other: object) -> bool:
        """Equal where all rows are equal bit for bit."""
        return (
            isinstance(other, RecentSpectra)
            and self.count == other.count
            and all(np.array_equal(a, b) for a, b in zip(self.rows, other.rows, strict=True))
        )

    __hash__ = None  # pyright: ignore[reportAssignmentType]  # holds arrays: equal, but not hashable

    def to_list(self) -> list[dict[str, Any]]:
        """Return the rows as text that keeps every bit."""
        return [
            {"shape": list(row.shape), "float32": base64.b64encode(row.astype("<f4").tobytes()).decode("ascii")}
            for row in self.rows
        ]

    @classmethod
    def from_list(cls, rows: list[Mapping[str, Any]]) -> RecentSpectra:
        """Return what :meth:`to_list` wrote."""
        return cls(
            tuple(
                np.frombuffer(base64.b64decode(row["float32"]), dtype="<f4").reshape(row["shape"]).astype(np.float32)
                for row in rows
            )
        )
