"""The pulses of a wheel after their repair: which of its marks passed when."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class PulseTrain:
    """Times at which the marks of a turning wheel passed, each with the number of its mark.

    Attributes:
        times: shape (pulse,), s from the first sample of the block, rising; at least two.
        numbers: shape (pulse,), int64, rising: the marks are counted in the order in which they pass, also those whose
            pulse is missing, so that the wheel turns once in ``per_revolution``.
        per_revolution: places of marks on the wheel, those that are left empty for the index included.
        indexed: whether ``numbers`` are counted from the index of the wheel (an empty place, or a track of its own):
            then ``numbers % per_revolution`` is the same mark in each block.
    """

    times: NDArray[np.float64]
    numbers: NDArray[np.int64]
    per_revolution: int
    indexed: bool = False

    def __post_init__(self) -> None:
        """Raise ValueError where times and numbers do not fit together or do not rise."""
        if self.times.ndim != 1 or self.times.shape != self.numbers.shape or self.times.size < 2:
            shapes = f"{self.times.shape} and {self.numbers.shape}"
            raise ValueError(f"times and numbers of pulses must have one shape (pulse,) from 2 on, got {shapes}")
        if self.numbers.dtype.kind != "i":
            raise ValueError(f"numbers of pulses must be whole, got {self.numbers.dtype}")
        if not (np.all(np.diff(self.times) > 0.0) and np.all(np.diff(self.numbers) > 0)):
            raise ValueError("times and numbers of pulses must rise")
        if self.per_revolution < 1:
            raise ValueError(f"pulses a revolution must be 1 or more, got {self.per_revolution}")

    @property
    def turns(self) -> NDArray[np.float64]:
        """Revolutions of the wheel at each pulse, shape (pulse,), by marks at equal angles."""
        return self.numbers / self.per_revolution

    @property
    def turned(self) -> float:
        """Revolutions from the first pulse to the last."""
        return float(self.numbers[-1] - self.numbers[0]) / self.per_revolution
