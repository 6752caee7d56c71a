"""``[gear]``: the gears of a machine, their shafts and meshes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Annotated, Self

from pydantic import Field, model_validator

from monitor.config.connections import lost_name
from monitor.config.fields import LocatedError, Name, Section
from monitor.config.positions import Place
from monitor.health.gears.settings import GearPairing, GearSettings, GearWheel

Problems = Iterator[tuple[Place, str]]


class GearWheelSection(Section):
    """A wheel; without ``shaft`` it has one of its own, of the same name."""

    name: Name
    teeth: Annotated[int, Field(ge=4, le=2000)]
    shaft: Name | None = None

    @property
    def on(self) -> str:
        """Name of its shaft."""
        return self.shaft or self.name


class GearPairSection(Section):
    """Two wheels in mesh: the driver, then the driven one."""

    wheels: tuple[Name, Name]

    @property
    def words(self) -> str:
        """The wheels, for people."""
        return " and ".join(map(repr, self.wheels))


class GearSection(Section):
    """Gears beside the monitored bearings.

    ``bearing_shaft`` is the shaft of the monitored bearings, on which the speed of ``[operating]`` counts; by default
    that of the first wheel.
    """

    bearing_shaft: Name | None = None
    wheel: tuple[GearWheelSection, ...] = Field(min_length=2)
    pair: tuple[GearPairSection, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _connected(self) -> Self:
        problems = list(self._loose_ends())
        if not problems:
            problems = list(self._turning_problems())
        if problems:
            raise LocatedError(problems)
        return self

    def _loose_ends(self) -> Problems:
        """Yield names that are given twice or lead nowhere."""
        wheels = Counter(wheel.name for wheel in self.wheel)
        for index, wheel in enumerate(self.wheel):
            if wheels[wheel.name] > 1:
                yield ("wheel", index, "name"), f"[[gear.wheel]] name {wheel.name!r} is given twice"
        meshing: set[frozenset[str]] = set()
        for index, pair in enumerate(self.pair):
            place: Place = ("pair", index, "wheels")
            for name in pair.wheels:
                if name not in wheels:
                    yield place, f"[[gear.pair]] wheel {lost_name(name, list(wheels))}"
            both = frozenset(pair.wheels)
            if len(both) == 1:
                yield place, f"expected two wheels, got {pair.wheels[0]!r} twice"
            elif both in meshing:
                yield place, f"the pair of {pair.words} is given twice"
            meshing.add(both)
        shafts = list(dict.fromkeys(wheel.on for wheel in self.wheel))
        if self.bearing_shaft is not None and self.bearing_shaft not in shafts:
            yield ("bearing_shaft",), f"shaft {lost_name(self.bearing_shaft, shafts)}"

    def _turning_problems(self) -> Problems:
        """Yield pairs that cannot turn, and wheels that nothing turns."""
        at = self.shaft_of
        turns = self._turns()
        for index, pair in enumerate(self.pair):
            first, second = pair.wheels
            place: Place = ("pair", index, "wheels")
            if at[first] == at[second]:
                yield place, f"wheels {pair.words} are on one shaft, {at[first]!r}: they cannot mesh"
            elif at[first] in turns and turns[at[second]] != _driven(turns[at[first]], self.teeth, pair.wheels):
                yield place, f"the train locks: other pairs do not let {pair.words} turn as their teeth demand"
        meshing = {name for pair in self.pair for name in pair.wheels}
        for index, wheel in enumerate(self.wheel):
            if wheel.name not in meshing:
                yield ("wheel", index, "name"), f"wheel {wheel.name!r} is in no [[gear.pair]]"
            elif wheel.on not in turns:
                yield (
                    ("wheel", index, "shaft"),
                    f"no [[gear.pair]] joins shaft {wheel.on!r} of wheel {wheel.name!r} to shaft {self.speed_shaft!r}",
                )

    @property
    def speed_shaft(self) -> str:
        """The shaft on which the speed of ``[operating]`` counts."""
        return self.bearing_shaft or self.wheel[0].on

    @property
    def shaft_of(self) -> Mapping[str, str]:
        """The shaft of each wheel."""
        return {wheel.name: wheel.on for wheel in self.wheel}

    @property
    def teeth(self) -> Mapping[str, int]:
        """Teeth of each wheel."""
        return {wheel.name: wheel.teeth for wheel in self.wheel}

    def turns(self) -> Mapping[str, float]:
        """Return the turns of each shaft in one turn of ``speed_shaft``; negative: it turns the other way."""
        return {name: float(turns) for name, turns in self._turns().items()}

    def _turns(self) -> dict[str, Fraction]:
        at = self.shaft_of
        found = {self.speed_shaft: Fraction(1)}
        growing = True
        while growing:
            growing = False
            for pair in self.pair:
                for known, other in (pair.wheels, pair.wheels[::-1]):
                    if at[known] in found and at[other] not in found:
                        found[at[other]] = _driven(found[at[known]], self.teeth, (known, other))
                        growing = True
        return found

    def to_settings(self) -> GearSettings:
        """Return what the monitor knows of the gears: names, teeth and turns."""
        turns = self.turns()
        return GearSettings(
            wheels=tuple(GearWheel(wheel.name, wheel.teeth, abs(turns[wheel.on])) for wheel in self.wheel),
            pairs=tuple(GearPairing(*pair.wheels) for pair in self.pair),
        )


def _driven(turns: Fraction, teeth: Mapping[str, int], wheels: tuple[str, str]) -> Fraction:
    """Return the turns of the second wheel where the first makes ``turns``; outside gears reverse them."""
    return -turns * Fraction(teeth[wheels[0]], teeth[wheels[1]])
