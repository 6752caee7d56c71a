"""``[gear]`` as a train of the model: bodies, wheels, meshes and torques in SI."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from models.gears.teeth.mesh import MeshStiffness, begin_of_mesh, turns_between
from models.gears.train.bearings import RollingSupport, with_bearings
from models.gears.train.linear import mean_state, with_rayleigh
from models.gears.train.parts import Body, GearTrain, Mesh, Support, Torsion, Wheel, alike, line_of_action
from models.machine.bearing import CatalogueEntry, catalogue_entry
from models.machine.contact_estimates import estimate_stiffness
from models.words.errors import WrongInputError
from monitor.config.fields import LocatedError
from monitor.config.load import Config
from monitor.config.positions import Place
from monitor.gears.config.meshes import PairModel
from monitor.gears.config.parts import GearPairSection, GearShaftSection, GearSupportSection
from monitor.gears.config.section import GearSection, Problems

_SAME_RADIUS = 1e-6
_NO_FORCE = 1e-9
"""Share of the largest force on a mesh below which none is said to pass."""
_FIRST_STIFFNESS = 1e8
"""Of bearings, N/m, until their own is known at the mean force."""


@dataclass(frozen=True)
class TrainBuilder:
    """Builds the train of a section at one operating point.

    Attributes:
        gear: the section.
        speed: of its ``speed_shaft``, Hz.
        config: that has the bearings which its supports name; without one they are those of the catalogue.
    """

    gear: GearSection
    speed: float
    config: Config | None = None

    @cached_property
    def train(self) -> GearTrain:
        """The train, built once; errors as in ``build``."""
        return self.build()

    def build(self) -> GearTrain:
        """Return the train.

        Raises:
            LocatedError: a key that the model needs is missing, or values do not fit together; places are those below
                ``[gear]``.
        """
        self.check()
        radii = {
            name: radius
            for model in self.pairs
            for name, radius in zip(model.section.wheels, model.base_radii, strict=True)
        }
        guess = [MeshStiffness.harmonic(model.teeth, model.mean_stiffness(), []) for model in self.pairs]
        try:
            train = GearTrain(
                bodies=tuple(self._body(name) for name in self.gear.shafts),
                wheels=tuple(Wheel(w.name, w.on, w.teeth, radii[w.name]) for w in self.gear.wheel),
                meshes=tuple(self._meshes(guess)),
                torsions=tuple(Torsion(*t.shafts, t.stiffness_newton_m_per_rad) for t in self.gear.torsion),
                drive=self.gear.drive_shaft,
                speed=self.speed * abs(self.turns[self.gear.drive_shaft]),
            )
            train = with_bearings(train, [*self._rolling()])
            train = replace(train, meshes=tuple(self._stiff_meshes(train)))
            return with_rayleigh(train, self.gear.alpha_c_per_s, self._betas, default=self.gear.beta_c_s or 0.0)
        except WrongInputError:
            raise
        except (ValueError, RuntimeError, ArithmeticError) as error:
            raise LocatedError([((), str(error))]) from None

    def _stiff_meshes(self, train: GearTrain) -> Iterator[Mesh]:
        """Yield the meshes with their stiffness at the mean force."""
        forces = mean_state(train).mesh_force
        forces = np.where(forces > _NO_FORCE * forces.max(), forces, 0.0)
        for index, (mesh, model) in enumerate(zip(train.meshes, self.pairs, strict=True)):
            force = float(forces[index])
            try:
                yield replace(mesh, stiffness=model.stiffness(force))
            except WrongInputError:
                raise
            except (ValueError, ArithmeticError) as error:
                where = f"{model.section.words} under a mean force of {force:.4g} N"
                raise LocatedError([(("pair", index), f"{where}: {error}")]) from None

    def check(self) -> None:
        """Raise a LocatedError with all keys that the model lacks and all pairs that cannot mesh."""
        problems = [*self._missing(), *self._geometry_problems(), *self._bearing_problems()]
        if problems:
            raise LocatedError(problems)

    @cached_property
    def turns(self) -> dict[str, float]:
        """Turns of each shaft in one turn of the shaft on which the speed counts."""
        return dict(self.gear.turns())

    @cached_property
    def pairs(self) -> tuple[PairModel, ...]:
        """The pairs with their wheels and faults."""
        wheels = {wheel.name: wheel for wheel in self.gear.wheel}

        def of(pair: GearPairSection) -> PairModel:
            first, second = (tuple(f for f in self.gear.fault if f.wheel == name) for name in pair.wheels)
            return PairModel(pair, (wheels[pair.wheels[0]], wheels[pair.wheels[1]]), (first, second))

        return tuple(map(of, self.gear.pair))

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
            yield from self._stiffness_missing(index, self.pairs[index])
        yield from self._torque_problems()
        yield from self._reversed_pairs()
        if self.gear.beta_c_s is None and any(
            table.beta_c_s is None for table in (*self.gear.shaft, *self.gear.pair, *self.gear.torsion)
        ):
            yield ("beta_c_s",), "is missing; without damping no motion settles; 0.00001 to 0.001 s are usual"

    def _stiffness_missing(self, index: int, model: PairModel) -> Problems:
        pair = model.section
        if not model.computed and pair.stiffness_newton_per_m is None and pair.stiffness_csv is None:
            yield (
                ("pair", index, "stiffness_newton_per_m"),
                f"is missing; the model needs it of {pair.words}, or stiffness_csv, or face_width_mm and bore_mm of "
                "both wheels, from which it is computed",
            )
        shaping = [fault for side in model.faults for fault in side if fault.shapes_teeth]
        if shaping and not model.computed:
            yield (
                ("fault", self.gear.fault.index(shaping[0])),
                f"kind = {shaping[0].kind!r} of wheel {shaping[0].wheel!r} needs the stiffness from the teeth: give "
                "face_width_mm and bore_mm of both wheels, and neither stiffness_csv nor stiffness_variation",
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
        """Yield why a pair cannot be made or mesh, or does not have its fault."""
        radii: dict[str, float] = {}
        for index, model in enumerate(self.pairs):
            pair, place = model.section, ("pair", index)
            if pair.module_mm is None:
                continue
            distance, least = pair.centre_distance_mm, 1e3 * sum(model.base_radii)
            try:
                assert model.geometry is None or model.geometry.contact_ratio > 0.0
            except ValueError as error:
                yield place, f"{pair.words}: {error}"
            else:
                if distance is not None and distance <= least:
                    yield (
                        (*place, "centre_distance_mm"),
                        f"expected more than the base radii together, {least:.6g} mm, got {distance:g}",
                    )
            for name, radius in zip(pair.wheels, model.base_radii, strict=True):
                if abs(radii.setdefault(name, radius) / radius - 1.0) > _SAME_RADIUS:
                    yield place, f"wheel {name!r} has another module or pressure angle in another pair"
        for index, fault in enumerate(self.gear.fault):
            try:
                fault.to_fault(self.gear.teeth[fault.wheel])
            except ValueError as error:
                yield ("fault", index), f"wheel {fault.wheel!r}: {error}"

    def _entry(self, support: GearSupportSection) -> tuple[CatalogueEntry, float]:
        """Return bearing and clearance, m, of a support; a ValueError where there is none of that name."""
        assert support.bearing is not None
        own = {} if self.config is None else {section.name: section for section in self.config.bearing}
        if support.bearing in own:
            entry, clearance = own[support.bearing].to_entry(), own[support.bearing].clearance_um
        else:
            try:
                entry, clearance = catalogue_entry(support.bearing), 0.0
            except KeyError as error:
                raise ValueError(f"{error.args[0]}; or the name of a [[bearing]]: {', '.join(own) or 'none'}") from None
        return entry, 1e-6 * (clearance if support.clearance_um is None else support.clearance_um)

    def _bearing_problems(self) -> Problems:
        """Yield bearings that are not known or have no contact stiffness."""
        for index, support in enumerate(self.gear.support):
            if support.bearing is not None:
                try:
                    estimate_stiffness(self._entry(support)[0])
                except ValueError as error:
                    yield ("support", index, "bearing"), str(error)

    def _rolling(self) -> Iterator[RollingSupport]:
        """Yield the supports whose stiffness is that of a bearing."""
        for support in self.gear.support:
            if support.bearing is not None:
                entry, clearance = self._entry(support)
                estimate = estimate_stiffness(entry)
                given = self.config is not None and self.config.gives_contact_stiffness(entry)
                k_c = self.config.rig_of(entry).k_c if self.config is not None and given else estimate.value
                yield RollingSupport(support.name, estimate.bearing, k_c, clearance)

    def _body(self, name: str) -> Body:
        shaft = self._shafts[name]
        supports = [support for support in self.gear.support if support.shaft == name]
        return Body(
            name=name,
            mass=shaft.mass_kg or 0.0,
            inertia=shaft.inertia_kg_m2 or 0.0,
            supports=tuple(Support(support.name, support.matrix or alike(_FIRST_STIFFNESS)) for support in supports),
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

    def _meshes(self, stiffness: Sequence[MeshStiffness]) -> Iterator[Mesh]:
        """Yield the meshes, each with the phase that those before leave it."""
        at = self.gear.shaft_of
        forward = self.gear.turns_from_x_to_y is (self.turns[self.gear.drive_shaft] > 0.0)
        placed: dict[str, float] = {}
        for model, course in zip(self.pairs, stiffness, strict=True):
            driver, driven = model.section.wheels
            counterclockwise = forward is (self.turns[at[driver]] > 0.0)
            to_driven, angle = math.radians(model.section.direction_deg), model.working_angle
            starts = self._starts(model, placed, counterclockwise=counterclockwise)
            yield Mesh(
                driver=driver,
                driven=driven,
                stiffness=course,
                line_of_action=line_of_action(to_driven, angle, counterclockwise=counterclockwise),
                back_line=line_of_action(to_driven, angle, counterclockwise=counterclockwise, back=True),
                backlash=model.backlash,
                driver_start=starts[0],
                driven_start=starts[1],
                base_helix=model.base_helix,
            )

    @staticmethod
    def _starts(model: PairModel, placed: dict[str, float], *, counterclockwise: bool) -> tuple[float, float]:
        """Return the turns of both wheels at time 0 from where a tooth begins this mesh.

        ``placed`` holds, of the wheels of meshes before, the direction of a tooth at time 0, rad; it is written.
        """
        pair, teeth = model.section, model.teeth
        lines: tuple[float, ...] = ()
        if model.geometry is not None:
            lines = begin_of_mesh(model.geometry, math.radians(pair.direction_deg), counterclockwise=counterclockwise)
        pitches = pair.phase_pitches
        for side, name in enumerate(pair.wheels):
            if pitches is None and lines and name in placed:
                sense = counterclockwise is (side == 0)
                pitches = teeth[side] * turns_between(lines[side], placed[name], counterclockwise=sense)
        pitches = math.fmod(pitches or 0.0, 1.0)
        for side, name in enumerate(pair.wheels):
            if lines:
                sense = 1.0 if counterclockwise is (side == 0) else -1.0
                placed.setdefault(name, lines[side] + sense * math.tau * pitches / teeth[side])
        return pitches / teeth[0], pitches / teeth[1]

    @property
    def _betas(self) -> dict[str, float]:
        """Stiffness-proportional damping by name of a body, mesh or torsion spring, s, where a table has its own."""
        found = {shaft.name: shaft.beta_c_s for shaft in self.gear.shaft}
        found |= {"-".join(pair.wheels): pair.beta_c_s for pair in self.gear.pair}
        found |= {"-".join(torsion.shafts): torsion.beta_c_s for torsion in self.gear.torsion}
        return {name: beta for name, beta in found.items() if beta is not None}
