"""Block: some seconds of vibration, input of the monitor; conversion to SI."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from streams.turns.pulses import Pulses
from streams.types.times import TimeStatement

STANDARD_GRAVITY = 9.80665
"""m/s2 in one g (the conventional value, CGPM 1901)."""
VELOCITY = "mm/s"
"""The unit of a channel whose sensor measures a velocity."""


@dataclass(frozen=True, eq=False)
class Block:
    """Consecutive samples of one or several channels, with what is known about them.

    Attributes:
        samples: shape (channel, sample), float32 or float64, in the unit of each channel.
        rate: Hz.
        units: of each row: "m/s2", "g", "V", "unknown" or "mm/s", as the file or the configuration states it.
        sequence: 1-based number in the source's own unit (a PRONOSTIA file, a 5-second block).
        name: origin for people: a file name, "recording.wav[55 s]".
        start: seconds since 1970-01-01 UTC of the first sample, None without a date.
        elapsed: seconds from the first sample of the source to that of this block, None where unknown.
        speed: of the shaft in Hz, None where the source does not state it; likewise the radial load in N.
        speed_source: "block", or another word of the record where something besides the recording gave the speed;
            likewise of the load.
        pulses: of a tacho or an encoder, None where the source has none besides its channels.
        pulses_per_revolution: pulses of a whole turn in a channel that is a tacho, None where it is not stated.
        content_hash: hexadecimal digest of the raw bytes the block was read from, or of its samples.
        left_out: names of rows of its file that are no channels, where none were configured.
        stated: what states the start, and how exactly; None where that is not known.
    """

    samples: NDArray[np.floating]
    rate: float
    channels: tuple[str, ...]
    units: tuple[str, ...]
    source: str
    sequence: int
    name: str
    start: float | None = None
    elapsed: float | None = None
    speed: float | None = None
    load: float | None = None
    content_hash: str = ""
    speed_source: str = "block"
    load_source: str = "block"
    pulses: Pulses | None = None
    pulses_per_revolution: int | None = None
    stated: TimeStatement | None = None
    left_out: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Raise ValueError where the parts do not fit together."""
        if self.samples.ndim != 2:
            raise ValueError(f"block {self.name}: samples must have shape (channel, sample), got {self.samples.shape}")
        if not (len(self.channels) == len(self.units) == self.samples.shape[0]):
            raise ValueError(
                f"block {self.name}: {self.samples.shape[0]} rows, but {len(self.channels)} channel names "
                f"and {len(self.units)} units"
            )

    @property
    def duration(self) -> float:
        """Length in seconds."""
        return self.samples.shape[1] / self.rate


@dataclass(frozen=True)
class Rejected:
    """The place of a block that could not be made; counted and stored like a block.

    ``sequence`` is the number that the block would have had, ``name`` the file or part of it, ``status`` a rejection
    status of the interface (``unreadable``, ``nan``, ...), ``reason`` one sentence of what was expected and found,
    ``content_hash`` the digest of the raw bytes where they could be read, else "".
    """

    source: str
    sequence: int
    name: str
    status: str
    reason: str
    content_hash: str = ""

    @property
    def is_repetition(self) -> bool:
        """Whether another block has the content or the number, so that this takes no number and makes no record."""
        return self.status in ("duplicate", "changed")


def to_si(
    samples: NDArray[np.floating],
    unit: str,
    scale: float = 1.0,
    sensitivity_mv_per_g: float | None = None,
) -> tuple[NDArray[np.floating], str]:
    """Convert samples of any shape to m/s2, velocities to m/s, in their precision.

    ``scale`` is the factor from the stored numbers to ``unit``; the sensitivity is for "V".

    Returns the samples and "m/s2", or "m/s" of unit "mm/s"; those of unit "unknown" scaled, and "unknown".

    Raises:
        ValueError: the unit is none of ours, or "V" comes without a sensitivity.
    """
    factor = float(scale)
    target = "m/s2"
    if unit == "g":
        factor *= STANDARD_GRAVITY
    elif unit == VELOCITY:
        factor *= 1e-3
        target = "m/s"
    elif unit == "V":
        if not sensitivity_mv_per_g or sensitivity_mv_per_g < 0.0:
            raise ValueError(f"unit V needs a positive sensitivity_mv_per_g, got {sensitivity_mv_per_g}")
        factor *= 1e3 * STANDARD_GRAVITY / sensitivity_mv_per_g
    elif unit == "unknown":
        target = "unknown"
    elif unit != "m/s2":
        raise ValueError(f"unit must be g, m/s2, V, unknown or mm/s, got {unit!r}")
    if factor == 1.0:
        return samples, target
    # A float32 sample near the top of its range becomes inf here, which the quality stage names.
    with np.errstate(over="ignore", invalid="ignore"):
        return samples * factor, target
