"""Pulses of a tacho: times at which a turning shaft passed marks; where a block of so many turns ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from streams.turns.tacho import edge_times

_MIN_SHARE = 0.02
"""Least length of a block as a share of the longest: disturbed pulses make no flood of blocks."""
_KEPT_SHARE = 0.9
"""A remainder with at least this part of the turns is a block."""


@dataclass(frozen=True)
class BlockRevolutions:
    """How many turns a block has, and what counts them.

    Attributes:
        revolutions: of the shaft of the bearing in a block.
        per_revolution: marks of a whole turn, missing teeth included, where the source states none.
        missing_teeth: of the marks of a turn.
        ratio: turns of the shaft of the bearing per turn of that with the marks.
        channel: of the pulses, None where they come as times.
        level: threshold in the unit of the channel, None: half way between its levels.
        falling: whether the falling edge of a pulse counts.
    """

    revolutions: float
    per_revolution: int = 1
    missing_teeth: int = 0
    ratio: float = 1.0
    channel: str | None = None
    level: float | None = None
    falling: bool = False

    def times_in(self, row: NDArray[np.floating], rate: float) -> NDArray[np.float64]:
        """Return the times of the pulses in samples of the channel, s from the first one."""
        return edge_times(row, rate, self.level, falling=self.falling)

    def pulses_of(self, per_revolution: int | None) -> int:
        """Return the pulses of a block; ``per_revolution`` as the source states it, or None."""
        marks = (per_revolution or self.per_revolution) - self.missing_teeth
        return max(1, round(self.revolutions / self.ratio * max(1, marks)))

    def end(self, pulses: Pulses, rate: float, longest: int) -> int | None:
        """Return the number of samples of a block, None where there are not so many turns.

        It ends half way between two pulses, away from the edges of both.

        Args:
            pulses: from the first sample of the block on.
            rate: Hz.
            longest: number of samples of the longest block.
        """
        count = self.pulses_of(pulses.per_revolution)
        if pulses.times.size <= count:
            return None
        end = round(0.5 * float(pulses.times[count - 1] + pulses.times[count]) * rate)
        return end if _MIN_SHARE * longest <= end <= longest else None

    def is_enough(self, pulses: Pulses | None) -> bool:
        """Return whether a remainder with these pulses is a block."""
        return pulses is not None and pulses.times.size >= _KEPT_SHARE * self.pulses_of(pulses.per_revolution)


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
