"""How the angle of the shaft is found from what a machine gives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class TachoSettings:
    """Marks on a shaft, and the channel in which their pulses are recorded.

    Attributes:
        channel: of the pulses, None where they are not a channel.
        channel_b: second track of a quadrature encoder, for the direction, or None.
        per_revolution: marks of a whole turn, missing teeth included; a source that states its own takes precedence.
        missing_teeth: consecutive teeth that a wheel lacks once a turn (2 of a 60-2 wheel).
        ratio: turns of the shaft of the bearing per turn of the shaft with the marks.
        level: threshold in the unit of the channel, None: half way between its levels.
        edge: the edge of a pulse that counts.
        of_source: whether the source gives the times of the pulses.
    """

    channel: str | None = None
    channel_b: str | None = None
    per_revolution: int = 1
    missing_teeth: int = 0
    ratio: float = 1.0
    level: float | None = None
    edge: Literal["rising", "falling"] = "rising"
    of_source: bool = False

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels of pulses."""
        return tuple(name for name in (self.channel, self.channel_b) if name is not None)
