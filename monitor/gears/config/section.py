"""``[gear]``: the gears of a machine, their shafts and meshes; which of them turns how fast."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Any, Self

from pydantic import Field, model_validator

from monitor.config.explain import lost_name
from monitor.config.fields import ConfigSection, LocatedError, Name, NotNegative, Positive
from monitor.config.interference import TrainSection
from monitor.config.positions import Place
from monitor.gears.config.parts import (
    GearFaultSection,
    GearPairSection,
    GearShaftSection,
    GearSupportSection,
    GearTorsionSection,
    GearWheelSection,
)
from monitor.health.gears.settings import GearPairing, GearSettings, GearWheel

Problems = Iterator[tuple[Place, str]]


class GearSection(TrainSection):
    """Gears beside the monitored bearings.

    ``bearing_shaft`` is the shaft of the monitored bearings, on which the speed of ``[operating]`` counts; by default
    that of the first wheel. ``drive`` is the shaft that is driven from outside, by default that of the first pair's
    driver, and ``load`` the one that takes the power off. All other keys are those of the model: see ``gears.train``.
    """

    bearing_shaft: Name | None = None
    drive: Name | None = None
    load: Name | None = None
    torque_newton_m: Positive | None = None
    power_kw: Positive | None = None
    turns_from_x_to_y: bool = True
    alpha_c_per_s: NotNegative = 0.0
    beta_c_s: NotNegative | None = None
    shaft: tuple[GearShaftSection, ...] = ()
    support: tuple[GearSupportSection, ...] = ()
    torsion: tuple[GearTorsionSection, ...] = ()
    fault: tuple[GearFaultSection, ...] = ()
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
        for index, fault in enumerate(self.fault):
            if fault.wheel not in wheels:
                yield ("fault", index, "wheel"), f"wheel {lost_name(fault.wheel, list(wheels))}"
        yield from self._lost_shafts()

    def _lost_shafts(self) -> Problems:
        """Yield names of shafts that are given twice or lead nowhere."""
        shafts = self.shafts
        for key in ("bearing_shaft", "drive", "load"):
            name = getattr(self, key)
            if name is not None and name not in shafts:
                yield (key,), f"shaft {lost_name(name, shafts)}"
        for key, tables in (("shaft", self.shaft), ("support", self.support)):
            counts = Counter(table.name for table in tables)
            for index, table in enumerate(tables):
                if counts[table.name] > 1:
                    yield (key, index, "name"), f"[[gear.{key}]] name {table.name!r} is given twice"
        for index, support in enumerate(self.support):
            if support.shaft not in shafts:
                yield ("support", index, "shaft"), f"shaft {lost_name(support.shaft, shafts)}"
        for index, torsion in enumerate(self.torsion):
            place: Place = ("torsion", index, "shafts")
            for name in torsion.shafts:
                if name not in shafts:
                    yield place, f"shaft {lost_name(name, shafts)}"
            if torsion.shafts[0] == torsion.shafts[1]:
                yield place, f"expected two shafts, got {torsion.shafts[0]!r} twice"

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
        for index, torsion in enumerate(self.torsion):
            one, other = torsion.shafts
            if turns.get(one) != turns.get(other):
                yield ("torsion", index, "shafts"), f"the train locks: {one!r} and {other!r} do not turn alike"
        for index, shaft in enumerate(self.shaft):
            if shaft.name not in turns and shaft.name not in at.values():
                yield ("shaft", index, "name"), f"no wheel is on shaft {shaft.name!r}, and no [[gear.torsion]] joins it"
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
    def shafts(self) -> list[str]:
        """Names of all shafts: those of wheels, then those that have none."""
        return list(dict.fromkeys([*(wheel.on for wheel in self.wheel), *(shaft.name for shaft in self.shaft)]))

    @property
    def drive_shaft(self) -> str:
        """The shaft that is driven from outside."""
        return self.drive or self.shaft_of[self.pair[0].wheels[0]]

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
            for torsion in self.torsion:
                for one, other in (torsion.shafts, torsion.shafts[::-1]):
                    if one in found and other not in found:
                        found[other] = found[one]
                        growing = True
        return found

    def to_settings(self) -> GearSettings:
        """Return what the monitor knows of the gears: names, teeth and turns."""
        turns = self.turns()
        return GearSettings(
            wheels=tuple(GearWheel(wheel.name, wheel.teeth, abs(turns[wheel.on])) for wheel in self.wheel),
            pairs=tuple(GearPairing(*pair.wheels) for pair in self.pair),
        )

    @classmethod
    def model_keys(cls) -> dict[str, Any]:
        """Return the keys of ``[gear]`` on which no record depends: those that the model alone takes."""
        keys: dict[str, Any] = {name: True for name in cls.model_fields if name not in _OF_RECORDS}
        for name, (section, kept) in _OF_TABLES.items():
            keys[name] = {"__all__": set(section.model_fields) - kept}
        return keys


_OF_RECORDS = {"bearing_shaft", "wheel", "pair"}
_OF_TABLES: dict[str, tuple[type[ConfigSection], set[str]]] = {
    "wheel": (GearWheelSection, {"name", "teeth", "shaft"}),
    "pair": (GearPairSection, {"wheels"}),
}


def _driven(turns: Fraction, teeth: Mapping[str, int], wheels: tuple[str, str]) -> Fraction:
    """Return the turns of the second wheel where the first makes ``turns``; outside gears reverse them."""
    return -turns * Fraction(teeth[wheels[0]], teeth[wheels[1]])
