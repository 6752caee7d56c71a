"""``[gear]`` as a train of the model: bodies, wheels, meshes and torques in SI."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from models.gears.damping import with_rayleigh
from models.gears.geometry import GearPair, TipRelief, ToothedWheel
from models.gears.mesh import MeshStiffness
from models.gears.phase import begin_of_mesh, turns_between
from models.gears.rack import BasicRack
from models.gears.stiffness_csv import GearTableError
from models.gears.train import Body, GearTrain, Mesh, Support, Torsion, Wheel, line_of_action
from monitor.config.fields import LocatedError
from monitor.config.gears.parts import GearPairSection, GearShaftSection, GearWheelSection
from monitor.config.gears.section import GearSection, Problems
from monitor.config.positions import Place

_MM, _UM = 1e-3, 1e-6
_SAME_RADIUS = 1e-6


@dataclass(frozen=True)
class TrainBuilder:
    """Builds the train of a section at one operating point.

    Attributes:
        gear: the section.
        speed: of its ``speed_shaft``, Hz.
    """

    gear: GearSection
    speed: float

    def build(self) -> GearTrain:
        """Return the train.

        Raises:
            LocatedError: a key that the model needs is missing, or values do not fit together; places are those below
                ``[gear]``.
        """
        self.check()
        radii = {name: self._base_radii(pair)[side] for pair in self.gear.pair for side, name in enumerate(pair.wheels)}
        try:
            train = GearTrain(
                bodies=tuple(self._body(name) for name in self.gear.shafts),
                wheels=tuple(Wheel(w.name, w.on, w.teeth, radii[w.name]) for w in self.gear.wheel),
                meshes=tuple(self._meshes(radii)),
                torsions=tuple(Torsion(*t.shafts, t.stiffness_newton_m_per_rad) for t in self.gear.torsion),
                drive=self.gear.drive_shaft,
                speed=self.speed * abs(self.turns[self.gear.drive_shaft]),
            )
            return with_rayleigh(train, self.gear.alpha_c_per_s, self._betas, default=self.gear.beta_c_s or 0.0)
        except ValueError as error:
            raise LocatedError([((), str(error))]) from None

    def check(self) -> None:
        """Raise a LocatedError with all keys that the model lacks and all pairs that cannot mesh."""
        problems = [*self._missing(), *self._geometry_problems()]
        if problems:
            raise LocatedError(problems)

    @cached_property
    def turns(self) -> dict[str, float]:
        """Turns of each shaft in one turn of the shaft on which the speed counts."""
        return dict(self.gear.turns())

    @cached_property
    def geometries(self) -> dict[int, GearPair | None]:
        """The pair of each index of ``[[gear.pair]]``, None where its wheels have no face width."""
        return {index: self._geometry(pair) for index, pair in enumerate(self.gear.pair)}

    @cached_property
    def _wheels(self) -> dict[str, GearWheelSection]:
        return {wheel.name: wheel for wheel in self.gear.wheel}

    @cached_property
    def _shafts(self) -> dict[str, GearShaftSection]:
        return {shaft.name: shaft for shaft in self.gear.shaft}

    def _missing(self) -> Problems:
        """Yield the keys that the model needs and the section does not have."""
        supported = {support.shaft for support in self.gear.support}
        for name in self.gear.shafts:
            shaft = self._shafts.get(name)
            if shaft is None:
                yield ("shaft",), f"there is none with name = {name!r}; the model needs its mass and inertia"
                continue
            place: Place = ("shaft", self.gear.shaft.index(shaft))
            if shaft.mass_kg is None and not shaft.fixed_axis:
                yield (*place, "mass_kg"), f"is missing; the model needs it of {name!r}, or fixed_axis = true"
            if shaft.inertia_kg_m2 is None and not shaft.constant_speed:
                yield (*place, "inertia_kg_m2"), f"is missing; the model needs it of {name!r}, or constant_speed = true"
            if shaft.fixed_axis == (name in supported):
                wanted = "none, as its axis is fixed" if shaft.fixed_axis else "at least one, or fixed_axis = true"
                yield ("support",), f"those with shaft = {name!r}: expected {wanted}"
        for index, pair in enumerate(self.gear.pair):
            if pair.module_mm is None:
                yield ("pair", index, "module_mm"), f"is missing; the model needs it of {pair.words}"
            yield from self._stiffness_missing(index, pair)
        yield from self._torque_problems()
        yield from self._reversed_pairs()
        if self.gear.beta_c_s is None and any(
            table.beta_c_s is None for table in (*self.gear.shaft, *self.gear.pair, *self.gear.torsion)
        ):
            yield ("beta_c_s",), "is missing; without damping no motion settles; 0.00001 to 0.001 s are usual"

    def _stiffness_missing(self, index: int, pair: GearPairSection) -> Problems:
        if pair.stiffness_newton_per_m is not None or pair.stiffness_csv is not None:
            return
        yield (
            ("pair", index, "stiffness_newton_per_m"),
            f"is missing; the model needs it of {pair.words}, or stiffness_csv",
        )

    def _torque_problems(self) -> Problems:
        given = [key for key in ("torque_newton_m", "power_kw") if getattr(self.gear, key) is not None]
        loads = [shaft.name for shaft in self.gear.shaft if shaft.load_torque_newton_m is not None]
        if len(given) + bool(loads) != 1:
            found = ", ".join([*given, *(f"load_torque_newton_m of {name!r}" for name in loads)]) or "none"
            yield (
                ("torque_newton_m",),
                f"expected one of torque_newton_m, power_kw and load_torque_newton_m of [[gear.shaft]], found {found}",
            )
        elif given and self._load() is None:
            ends = ", ".join(self._ends())
            yield ("load",), f"is missing; expected the shaft that takes the power off, perhaps one of {ends}"
        elif given and self._load() == self.gear.drive_shaft:
            yield ("load",), f"expected another shaft than the drive, {self.gear.drive_shaft!r}"

    def _reversed_pairs(self) -> Problems:
        """Yield pairs whose first wheel is the driven one: farther from the drive than the second."""
        at = self.gear.shaft_of
        away = {self.gear.drive_shaft: 0}
        joints = [*((at[a], at[b]) for a, b in (pair.wheels for pair in self.gear.pair))]
        joints += [torsion.shafts for torsion in self.gear.torsion]
        for steps in range(1, len(self.gear.shafts)):
            near = {name for name, count in away.items() if count == steps - 1}
            for first, second in joints:
                for one, other in ((first, second), (second, first)):
                    if one in near:
                        away.setdefault(other, steps)
        for index, pair in enumerate(self.gear.pair):
            first, second = pair.wheels
            if away[at[first]] > away[at[second]]:
                yield (
                    ("pair", index, "wheels"),
                    f"{second!r} drives {first!r}, as the drive is {self.gear.drive_shaft!r}; "
                    f'write wheels = ["{second}", "{first}"]',
                )

    def _ends(self) -> list[str]:
        """Return the shafts that are joined to one other shaft only, the drive aside."""
        at = self.gear.shaft_of
        joints = [*((at[a], at[b]) for a, b in (pair.wheels for pair in self.gear.pair))]
        joints += [torsion.shafts for torsion in self.gear.torsion]
        return [
            name
            for name in self.gear.shafts
            if name != self.gear.drive_shaft and sum(name in joint for joint in joints) == 1
        ]

    def _load(self) -> str | None:
        if self.gear.load is not None:
            return self.gear.load
        ends = self._ends()
        return ends[0] if len(ends) == 1 else None

    def _geometry_problems(self) -> Problems:
        """Yield why a pair cannot be made or mesh."""
        radii: dict[str, float] = {}
        for index, pair in enumerate(self.gear.pair):
            if pair.module_mm is None:
                continue
            place: Place = ("pair", index)
            try:
                self._geometry(pair)
                own = self._base_radii(pair)
            except ValueError as error:
                yield place, f"{pair.words}: {error}"
                continue
            for name, radius in zip(pair.wheels, own, strict=True):
                if abs(radii.setdefault(name, radius) / radius - 1.0) > _SAME_RADIUS:
                    yield place, f"wheel {name!r} has another module or pressure angle in another pair"
            distance = pair.centre_distance_mm
            if distance is not None and distance * _MM <= sum(own):
                yield (
                    (*place, "centre_distance_mm"),
                    f"expected more than the base radii together, {1e3 * sum(own):.6g} mm, got {distance:g}",
                )

    def _geometry(self, pair: GearPairSection) -> GearPair | None:
        first, second = (self._toothed(self._wheels[name]) for name in pair.wheels)
        if first is None or second is None or pair.module_mm is None:
            return None
        return GearPair(
            first,
            second,
            pair.module_mm * _MM,
            math.radians(pair.pressure_angle_deg),
            math.radians(pair.helix_angle_deg),
            None if pair.centre_distance_mm is None else pair.centre_distance_mm * _MM,
            BasicRack(pair.addendum, pair.dedendum, pair.fillet_radius),
        )

    @staticmethod
    def _toothed(wheel: GearWheelSection) -> ToothedWheel | None:
        if wheel.face_width_mm is None or wheel.bore_mm is None:
            return None
        relief = None
        if wheel.tip_relief_um and wheel.tip_relief_length_mm is not None:
            relief = TipRelief(wheel.tip_relief_um * _UM, wheel.tip_relief_length_mm * _MM, wheel.tip_relief_shape)
        return ToothedWheel(
            teeth=wheel.teeth,
            face_width=wheel.face_width_mm * _MM,
            hub_radius=0.5 * wheel.bore_mm * _MM,
            profile_shift=wheel.profile_shift,
            truncation=wheel.tip_truncation_mm * _MM,
            tip_relief=relief,
            modulus=wheel.modulus_gpa * 1e9,
            poisson=wheel.poisson,
        )

    def _base_radii(self, pair: GearPairSection) -> tuple[float, float]:
        """Return the base radii of a pair, m."""
        assert pair.module_mm is not None
        helix = math.radians(pair.helix_angle_deg)
        transverse = math.atan(math.tan(math.radians(pair.pressure_angle_deg)) / math.cos(helix))
        per_tooth = 0.5 * pair.module_mm * _MM / math.cos(helix) * math.cos(transverse)
        first, second = (per_tooth * self.gear.teeth[name] for name in pair.wheels)
        return first, second

    def working_angle(self, pair: GearPairSection) -> float:
        """Return the transverse working pressure angle of a pair, rad."""
        found = self.geometries[self.gear.pair.index(pair)]
        if found is not None:
            return found.working_angle
        helix = math.radians(pair.helix_angle_deg)
        if pair.centre_distance_mm is None:
            return math.atan(math.tan(math.radians(pair.pressure_angle_deg)) / math.cos(helix))
        return math.acos(sum(self._base_radii(pair)) / (pair.centre_distance_mm * _MM))

    def _body(self, name: str) -> Body:
        shaft = self._shafts[name]
        supports = [support for support in self.gear.support if support.shaft == name]
        return Body(
            name=name,
            mass=shaft.mass_kg or 0.0,
            inertia=shaft.inertia_kg_m2 or 0.0,
            supports=tuple(Support(support.name, support.matrix) for support in supports),
            torque=self._torque(shaft),
            speed_damping=shaft.speed_damping_newton_m_s,
            translates=not shaft.fixed_axis,
            rotates=not shaft.constant_speed,
        )

    def _torque(self, shaft: GearShaftSection) -> float:
        """Return the torque that loads a shaft from outside, N m, not positive; that of the drive follows."""
        if shaft.load_torque_newton_m is not None:
            return -shaft.load_torque_newton_m
        if shaft.name != self._load():
            return 0.0
        turns = abs(self.turns[shaft.name])
        if self.gear.power_kw is not None:
            return -1e3 * self.gear.power_kw / (2.0 * math.pi * self.speed * turns)
        if self.gear.torque_newton_m is not None:
            return -self.gear.torque_newton_m * abs(self.turns[self.gear.drive_shaft]) / turns
        return 0.0

    def _meshes(self, radii: dict[str, float]) -> Iterator[Mesh]:
        """Yield the meshes, each with the phase that those before leave it."""
        at = self.gear.shaft_of
        forward = self.gear.turns_from_x_to_y is (self.turns[self.gear.drive_shaft] > 0.0)
        placed: dict[str, tuple[float, float]] = {}
        for index, pair in enumerate(self.gear.pair):
            driver, driven = pair.wheels
            counterclockwise = forward is (self.turns[at[driver]] > 0.0)
            to_driven, angle = math.radians(pair.direction_deg), self.working_angle(pair)
            starts = self._starts(index, pair, placed, counterclockwise=counterclockwise)
            yield Mesh(
                driver=driver,
                driven=driven,
                stiffness=self._stiffness(pair),
                line_of_action=line_of_action(to_driven, angle, counterclockwise=counterclockwise),
                back_line=line_of_action(to_driven, angle, counterclockwise=counterclockwise, back=True),
                backlash=self._backlash(index, pair),
                driver_start=starts[0],
                driven_start=starts[1],
                base_helix=self._base_helix(pair),
            )

    def _starts(
        self,
        index: int,
        pair: GearPairSection,
        placed: dict[str, tuple[float, float]],
        *,
        counterclockwise: bool,
    ) -> tuple[float, float]:
        """Return the turns of both wheels at time 0 from where a tooth begins this mesh.

        ``placed`` holds, of the wheels of meshes before, where a tooth stands at time 0; it is written.
        """
        z1, z2 = (self.gear.teeth[name] for name in pair.wheels)
        geometry = self.geometries[index]
        lines: tuple[float, ...] = ()
        if geometry is not None:
            lines = begin_of_mesh(geometry, math.radians(pair.direction_deg), counterclockwise=counterclockwise)
        pitches = pair.phase_pitches
        for side, (name, teeth) in enumerate(zip(pair.wheels, (z1, z2), strict=True)):
            if pitches is None and lines and name in placed:
                sense = counterclockwise is (side == 0)
                pitches = teeth * turns_between(lines[side], placed[name][0], counterclockwise=sense)
        pitches = math.fmod(pitches or 0.0, 1.0)
        for side, (name, teeth) in enumerate(zip(pair.wheels, (z1, z2), strict=True)):
            if lines:
                sense = 1.0 if counterclockwise is (side == 0) else -1.0
                placed.setdefault(name, (lines[side] + sense * math.tau * pitches / teeth, pitches))
        return pitches / z1, pitches / z2

    def _stiffness(self, pair: GearPairSection) -> MeshStiffness:
        z1, z2 = (self.gear.teeth[name] for name in pair.wheels)
        mean = pair.stiffness_newton_per_m
        if pair.stiffness_csv is not None:
            found = read_course(pair, (z1, z2))
            return found if mean is None else found.scaled_to(mean)
        assert mean is not None
        if pair.stiffness_variation is not None and pair.contact_ratio is not None:
            return MeshStiffness.rectangular((z1, z2), mean, pair.stiffness_variation, pair.contact_ratio)
        return MeshStiffness.harmonic((z1, z2), mean, [])

    def _backlash(self, index: int, pair: GearPairSection) -> float:
        """Return the backlash along the line of action, m; infinite where neither key nor centre distance give one."""
        if pair.backlash_um is not None:
            return pair.backlash_um * _UM
        geometry = self.geometries[index]
        return geometry.backlash if geometry is not None and geometry.backlash > 0.0 else math.inf

    @staticmethod
    def _base_helix(pair: GearPairSection) -> float:
        return math.asin(math.sin(math.radians(pair.helix_angle_deg)) * math.cos(math.radians(pair.pressure_angle_deg)))

    @property
    def _betas(self) -> dict[str, float]:
        """Stiffness-proportional damping by name of a body, mesh or torsion spring, s, where a table has its own."""
        found = {shaft.name: shaft.beta_c_s for shaft in self.gear.shaft}
        found |= {"-".join(pair.wheels): pair.beta_c_s for pair in self.gear.pair}
        found |= {"-".join(torsion.shafts): torsion.beta_c_s for torsion in self.gear.torsion}
        return {name: beta for name, beta in found.items() if beta is not None}


def read_course(pair: GearPairSection, teeth: tuple[int, int]) -> MeshStiffness:
    """Return the mesh stiffness in the file of a pair.

    Raises:
        GearTableError: the file cannot be read or used.
    """
    path = pair.stiffness_csv
    assert path is not None
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise GearTableError(f"stiffness_csv {path}: cannot be read: {error}") from None
    return MeshStiffness.from_csv(teeth, text, str(path))
