"""``[[interference]]``: lines of other origin that are removed before the envelope."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from models.bearing import Kinematics
from monitor.config.fields import Count, Positive, Section
from monitor.health.spectrum.features import fundamentals
from monitor.health.spectrum.interference import Interference

_CLOSE = 0.02


class InterferenceSection(Section):
    """Lines of gear meshes (``orders`` of the shaft), of mains, inverters or other shafts (``lines_hz``).

    Each counts with ``harmonics`` multiples (by default all), each of these with ``sidebands`` lines on either side,
    ``sideband_orders`` of the shaft apart.
    """

    name: Annotated[str, Field(max_length=200)] = ""
    orders: tuple[Positive, ...] = ()
    lines_hz: tuple[Positive, ...] = ()
    harmonics: Count | None = None
    sidebands: Annotated[int, Field(ge=0, le=20)] = Interference.sidebands
    sideband_orders: Positive = Interference.spacing
    tolerance: Annotated[float, Field(ge=0, le=0.05)] = Interference.tolerance

    @model_validator(mode="after")
    def _some(self) -> Self:
        if not self.orders and not self.lines_hz:
            raise ValueError("give orders or lines_hz, or both")
        return self

    def to_interference(self) -> Interference:
        """Return the settings in SI."""
        return Interference(
            orders=self.orders,
            lines=self.lines_hz,
            harmonics=self.harmonics,
            sidebands=self.sidebands,
            spacing=self.sideband_orders,
            tolerance=self.tolerance,
            name=self.name,
        )

    @property
    def words(self) -> str:
        """What is removed, for people."""
        what = [f"order {order:g}" for order in self.orders] + [f"{line:g} Hz" for line in self.lines_hz]
        many = "all multiples" if self.harmonics is None else f"{self.harmonics} multiples"
        sides = f", {self.sidebands} sidebands each" if self.sidebands else ""
        name = f"{self.name}: " if self.name else ""
        return f"{name}{', '.join(what)}, {many}{sides}"

    def families_removed(self, kinematics: Kinematics) -> tuple[str, ...]:
        """Return the fault families whose own comb would be removed, at the speed of ``kinematics``."""
        lines = [comb.fundamental for comb in self.to_interference().combs(kinematics.speed)]
        return tuple(
            fault
            for fault, first in fundamentals(kinematics).items()
            if any(abs(line / first - 1.0) < _CLOSE for line in lines)
        )
