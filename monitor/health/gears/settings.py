"""Which gears run beside a bearing: names, teeth and turns; all that the naming of a damaged wheel has to know."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from monitor.health.signal.interference import Interference

MAX_TEETH = 10_000
"""Most teeth of a wheel."""
_SAME = 1e-6
"""Relative error by which the mesh orders of the two wheels of a pair may differ: turns are rounded numbers."""
SIDEBANDS = 3
"""Steps of the turns of the wheels on either side of a harmonic of their mesh that are removed."""
_RESERVED = "|:"
"""Characters that the values of ``fault`` use: ``gear:a|b``."""


@dataclass(frozen=True)
class GearWheel:
    """One wheel.

    Attributes:
        name: of the wheel, unique in a train; without "|" and ":".
        teeth: how many.
        turns: of the wheel in one turn of the bearing's shaft, positive whatever the direction.

    Raises:
        ValueError: naming the field, what was expected and what came.
    """

    name: str
    teeth: int
    turns: float

    def __post_init__(self) -> None:
        """Refuse a wheel that has no name, teeth or turns."""
        if not self.name.strip() or any(character in self.name for character in _RESERVED):
            raise ValueError(f"wheel: name must be a text without '|' and ':', got {self.name!r}")
        if not 1 <= self.teeth <= MAX_TEETH:
            raise ValueError(f"wheel {self.name!r}: teeth must be 1 to {MAX_TEETH}, got {self.teeth!r}")
        if not (math.isfinite(self.turns) and self.turns > 0.0):
            raise ValueError(f"wheel {self.name!r}: turns must be positive and finite, got {self.turns!r}")

    @property
    def mesh_order(self) -> float:
        """Teeth that pass the mesh in one turn of the bearing's shaft."""
        return self.teeth * self.turns


@dataclass(frozen=True)
class GearPairing:
    """Two wheels in mesh, by name."""

    driver: str
    driven: str


@dataclass(frozen=True)
class GearSettings:
    """The gears beside a bearing.

    Attributes:
        wheels: all wheels.
        pairs: which of them mesh; a wheel may mesh with several.

    Raises:
        ValueError: a name occurs twice, a pair names no wheel or one wheel twice, a wheel is in no pair, or the teeth
            and turns of a pair do not fit.
    """

    wheels: tuple[GearWheel, ...]
    pairs: tuple[GearPairing, ...]

    def __post_init__(self) -> None:
        """Refuse wheels and pairs that do not fit."""
        twice = [name for name, count in Counter(wheel.name for wheel in self.wheels).items() if count > 1]
        if twice:
            raise ValueError(f"wheels: each name must be unique, got {twice[0]!r} twice")
        wheels = self.by_name
        for pair in self.pairs:
            for name in (pair.driver, pair.driven):
                if name not in wheels:
                    raise ValueError(f"pair {pair.driver!r}, {pair.driven!r}: {name!r} is none of {', '.join(wheels)}")
            driver, driven = wheels[pair.driver], wheels[pair.driven]
            if driver is driven:
                raise ValueError(f"pair {pair.driver!r}, {pair.driven!r}: two wheels are needed, got one twice")
            if abs(driver.mesh_order / driven.mesh_order - 1.0) > _SAME:
                raise ValueError(
                    f"pair {pair.driver!r}, {pair.driven!r}: teeth times turns must agree, got "
                    f"{driver.mesh_order:.9g} and {driven.mesh_order:.9g}"
                )
        meshing = {name for pair in self.pairs for name in (pair.driver, pair.driven)}
        alone = [name for name in wheels if name not in meshing]
        if alone:
            raise ValueError(f"wheel {alone[0]!r}: it must mesh with another wheel, got no pair of it")

    @cached_property
    def by_name(self) -> Mapping[str, GearWheel]:
        """Wheels by name, in their order."""
        return {wheel.name: wheel for wheel in self.wheels}

    def mesh_orders(self) -> tuple[float, ...]:
        """Return the mesh orders of the pairs, multiples of the bearing's shaft, in their order and each once."""
        found: list[float] = []
        for pair in self.pairs:
            order = self.by_name[pair.driver].mesh_order
            if not any(abs(order / other - 1.0) <= _SAME for other in found):
                found.append(order)
        return tuple(found)

    def groups(self) -> tuple[tuple[str, ...], ...]:
        """Return the wheels that can be told apart; those that turn alike stand together.

        What comes once a turn of one comes once a turn of the other: the order of their turns alone tells wheels apart.
        """
        found: list[list[GearWheel]] = []
        for wheel in self.wheels:
            alike = next((one for one in found if abs(one[0].turns / wheel.turns - 1.0) <= _SAME), None)
            if alike is None:
                found.append([wheel])
            else:
                alike.append(wheel)
        return tuple(tuple(wheel.name for wheel in one) for one in found)


def gear_interference(gears: GearSettings, tolerance: float = Interference.tolerance) -> tuple[Interference, ...]:
    """Return the lines of each mesh order, which are removed before the envelope, with sidebands of its wheels.

    What stands around each harmonic of a mesh comes once in a turn of either wheel (eccentricity, unequal teeth):
    sidebands of both, and their sums and differences.

    Args:
        gears: wheels and pairs.
        tolerance: relative error of the speed of the bearing's shaft.
    """
    found: list[Interference] = []
    for order in gears.mesh_orders():
        names: list[str] = []
        turns: list[float] = []
        for pair in gears.pairs:
            if abs(gears.by_name[pair.driver].mesh_order / order - 1.0) > _SAME:
                continue
            for name in (pair.driver, pair.driven):
                wheel = gears.by_name[name]
                if name not in names:
                    names.append(name)
                if not any(abs(wheel.turns / other - 1.0) <= _SAME for other in turns):
                    turns.append(wheel.turns)
        found.append(
            Interference(
                orders=(order,),
                sidebands=SIDEBANDS,
                spacing=turns[0],
                tolerance=tolerance,
                name=f"gear {', '.join(names)}",
                beside=tuple(turns[1:]),
            )
        )
    return tuple(found)
