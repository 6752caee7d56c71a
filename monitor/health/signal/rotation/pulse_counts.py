"""What was repaired in the pulses of a block."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PulseCounts:
    """Repairs of the pulses of one block.

    Attributes:
        missing: pulses that were put in, those of teeth that are known to be missing not counted.
        extra: pulses that were left out.
        encoder_error: rms of the learned geometric error of the marks, rad of the shaft with the marks; None until
            it is learned.
    """

    missing: int = 0
    extra: int = 0
    encoder_error: float | None = None
