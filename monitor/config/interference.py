"""Lines that are removed before the envelope: ``[[interference]]``, and the meshes of ``[gear]`` unasked."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import Field, model_validator

from models.machine.bearing import Kinematics
from monitor.config.fields import ConfigSection, Count, Positive
from monitor.health.gears.settings import GearSettings, gear_interference
from monitor.health.signal.features import fundamentals
from monitor.health.signal.interference import Interference
from monitor.health.signal.shaft import ACCEPTED

if TYPE_CHECKING:
    from monitor.config.load import Config

_CLOSE = 0.02


class InterferenceSection(ConfigSection):
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
        return words_of(self.to_interference())

    def families_removed(self, kinematics: Kinematics) -> tuple[str, ...]:
        """Return the fault families whose own comb would be removed, at the speed of ``kinematics``."""
        return families_removed(self.to_interference(), kinematics)


def words_of(lines: Interference) -> str:
    """Return what is removed, for people."""
    what = [f"order {order:g}" for order in lines.orders] + [f"{line:g} Hz" for line in lines.lines]
    many = "all multiples" if lines.harmonics is None else f"{lines.harmonics} multiples"
    sides = f", {lines.sidebands} sidebands each" if lines.sidebands else ""
    apart = (lines.spacing, *lines.beside)
    of = f" at {' and '.join(f'{spacing:g}' for spacing in apart)} orders" if lines.beside else ""
    name = f"{lines.name}: " if lines.name else ""
    return f"{name}{', '.join(what)}, {many}{sides}{of}"


def families_removed(lines: Interference, kinematics: Kinematics) -> tuple[str, ...]:
    """Return the fault families whose own comb would be removed, at the speed of ``kinematics``."""
    places = [comb.fundamental for comb in lines.combs(kinematics.speed)]
    return tuple(
        fault
        for fault, first in fundamentals(kinematics).items()
        if any(abs(place / first - 1.0) < _CLOSE for place in places)
    )


class TrainSection(ConfigSection):
    """The gears beside the monitored bearings."""

    @property
    @abstractmethod
    def speed_shaft(self) -> str:
        """The shaft on which the speed of ``[operating]`` counts."""

    @abstractmethod
    def to_settings(self) -> GearSettings:
        """Return wheels and pairs, with turns of wheels per turn of ``speed_shaft``."""

    @classmethod
    @abstractmethod
    def model_keys(cls) -> dict[str, Any]:
        """Return the keys on which no record depends: those that the model alone takes."""


def removed_lines(config: Config) -> tuple[Interference, ...]:
    """Return all lines that are removed, in the order of the file, those of ``[gear]`` last.

    The lines of gears are sought as far as the shaft itself is, unless its speed is exact.
    """
    found = tuple(section.to_interference() for section in config.interference)
    if config.gear is None:
        return found
    tolerance = Interference.tolerance if config.operating.speed_exact else ACCEPTED
    return found + gear_interference(config.gear.to_settings(), tolerance)
