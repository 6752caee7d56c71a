"""Pulses of a tacho or an encoder: the times at which a turning shaft passed marks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Pulses:
    """The pulses of one block, as recorded: some may be missing, and some too many.

    Attributes:
        times: shape (pulse,), s from the first sample of the block, float64, never falling.
        per_revolution: pulses of a whole turn, None where the source does not state it.
    """

    times: NDArray[np.float64]
    per_revolution: int | None = None

    def __post_init__(self) -> None:
        """Raise ValueError where the times have another shape, fall, or are not finite."""
        if self.times.ndim != 1:
            raise ValueError(f"times of pulses must have shape (pulse,), got {self.times.shape}")
        if not np.all(np.isfinite(self.times)) or np.any(np.diff(self.times) < 0.0):
            raise ValueError("times of pulses must be finite and never fall")
        if self.per_revolution is not None and self.per_revolution < 1:
            raise ValueError(f"pulses a revolution must be 1 or more, got {self.per_revolution}")

    def shifted(self, seconds: float) -> Pulses:
        """Return the pulses with times greater by ``seconds``."""
        return self if seconds == 0.0 else Pulses(self.times + seconds, self.per_revolution)

    def in_samples(self, rate: float, begin: int, end: int) -> Pulses:
        """Return the pulses from the sample ``begin`` to before ``end`` at a ``rate`` in Hz, times as they are.

        A pulse belongs to the sample at or before it, so that pieces that follow each other share none.
        """
        first, last = np.searchsorted(np.floor(self.times * rate), (begin, end))
        return Pulses(self.times[first:last], self.per_revolution)

    def between(self, begin: float, end: float) -> Pulses:
        """Return the pulses from ``begin`` to before ``end`` (s), their times counted from ``begin``."""
        first, last = np.searchsorted(self.times, (begin, end))
        return Pulses(self.times[first:last] - begin, self.per_revolution)
