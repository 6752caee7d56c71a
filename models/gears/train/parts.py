"""A train of gears: the bodies that turn, what joins them, and the speeds and torques at which it runs.

A body is a rigid shaft with all that turns with it. It has up to two translations across its axis, x and y, and one
rotation. Its angle counts in the sense in which it turns, so that an angle which is positive drives forward. Rotation
and translations are those beside the mean motion, which is that of rigid gears at the mean speed.

The displacement of a mesh is that of both teeth towards each other along the line of action, m:

    delta = n . (u_driver - u_driven) + r_driver phi_driver - r_driven phi_driven - e

with ``n`` the direction of the force on the driven wheel, ``r`` the base radii and ``e`` the error of the profiles.
The flanks that drive touch where delta > 0. The others touch where the displacement back exceeds the backlash.
SI units; angles in rad; frequencies and speeds in Hz, that is turns a second.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from models.words.checks import check_numbers, check_whole

if TYPE_CHECKING:
    from models.gears.teeth.mesh import MeshStiffness

Matrix2 = tuple[tuple[float, float], tuple[float, float]]
"""A symmetric matrix of the directions x and y."""

NONE: Matrix2 = ((0.0, 0.0), (0.0, 0.0))
# Relative difference of the speeds of a body along two paths at most, and of torques that count as balanced.
_SAME = 1e-9


def alike(value: float) -> Matrix2:
    """Return the matrix of what is the same in both directions."""
    return ((value, 0.0), (0.0, value))


@dataclass(frozen=True)
class Support:
    """A bearing between a body and the casing.

    Attributes:
        name: of the bearing, unique in the train.
        stiffness: N/m, symmetric, at the mean force.
        damping: N s/m, symmetric.
    """

    name: str
    stiffness: Matrix2
    damping: Matrix2 = NONE

    def __post_init__(self) -> None:
        """Raise a ValueError that names an unusable field."""
        for name in ("stiffness", "damping"):
            matrix: Matrix2 = getattr(self, name)
            (a, b), (c, d) = matrix
            usable = all(map(math.isfinite, (a, b, c, d))) and abs(b - c) <= _SAME * (abs(a) + abs(d))
            if not (usable and a >= 0.0 and d >= 0.0 and a * d - b * c >= -_SAME * a * d):
                raise ValueError(
                    f"support {self.name}: {name} must be symmetric and not negative definite, got {matrix!r}"
                )


@dataclass(frozen=True)
class Body:
    """A rigid shaft with all that turns with it.

    Attributes:
        name: unique in the train.
        mass: kg; used where the body translates.
        inertia: moment about the axis, kg m2; used where the body rotates.
        supports: the bearings that carry it; none where it does not translate.
        torque: that acts on it from outside, N m, positive where it drives, negative where it loads. That of the drive
            follows from the balance and must be 0 here.
        force: that acts on it from outside beside the torque, such as weight or a belt, N: x and y.
        speed_damping: torque against a deviation from the mean speed, N m s/rad: of a motor, a brake or oil.
        translates: whether the axis may move. A motor or a load counts as a body that does not.
        rotates: whether its speed may differ from the mean speed. A body that does not turns at the mean speed
            exactly, as with a flywheel of any size.
    """

    name: str
    mass: float = 0.0
    inertia: float = 0.0
    supports: tuple[Support, ...] = ()
    torque: float = 0.0
    force: tuple[float, float] = (0.0, 0.0)
    speed_damping: float = 0.0
    translates: bool = True
    rotates: bool = True

    def __post_init__(self) -> None:
        """Raise a ValueError that names an unusable field."""
        prefix = f"body {self.name}: "
        check_numbers(self, prefix, "not negative", "mass", "inertia", "speed_damping")
        check_numbers(self, prefix, "finite", "torque")
        if not all(map(math.isfinite, self.force)):
            raise ValueError(f"{prefix}force must be finite, got {self.force!r}")
        if self.rotates:
            check_numbers(self, prefix, "positive", "inertia")
        if not self.translates:
            if self.supports:
                raise ValueError(f"{prefix}supports are given, but translates is false")
            return
        check_numbers(self, prefix, "positive", "mass")
        (a, b), (_, d) = total(support.stiffness for support in self.supports)
        if not a * d - b * b > 0.0:
            raise ValueError(f"{prefix}translates, but its supports hold it in no or one direction only")


@dataclass(frozen=True)
class Wheel:
    """A gear wheel on a body.

    Attributes:
        name: unique in the train.
        body: name of the body that it turns with.
        teeth: their number.
        base_radius: m, in the transverse plane.
    """

    name: str
    body: str
    teeth: int
    base_radius: float

    def __post_init__(self) -> None:
        """Raise a ValueError that names an unusable field."""
        check_whole(self.teeth, f"wheel {self.name}: teeth", 1)
        check_numbers(self, f"wheel {self.name}: ", "positive", "base_radius")


@dataclass(frozen=True, eq=False)
class Mesh:
    """Two wheels in mesh.

    Attributes:
        driver, driven: names of the wheels.
        stiffness: over the turns of both wheels, along the transverse line of action.
        line_of_action: direction of the force on the driven wheel, from x towards y, rad (see ``line_of_action``).
        back_line: the same where the other flanks touch; None: the opposite of ``line_of_action``, as in models with
            one line of action.
        damping: N s/m along the line of action.
        backlash: way from one flank to the other along the line of action, m; infinite where the other flanks never
            touch. With 0 the teeth never separate: the mesh is a linear spring.
        damps_without_contact: whether the damping acts where no flanks touch, as in most published models of one pair.
        driver_start, driven_start: turns of the wheels at time 0 from where a tooth begins its mesh.
        base_helix: helix angle on the base cylinder, rad: the axial force is the transverse one times its tangent.
    """

    driver: str
    driven: str
    stiffness: MeshStiffness
    line_of_action: float
    back_line: float | None = None
    damping: float = 0.0
    backlash: float = math.inf
    damps_without_contact: bool = False
    driver_start: float = 0.0
    driven_start: float = 0.0
    base_helix: float = 0.0

    def __post_init__(self) -> None:
        """Raise a ValueError that names an unusable field."""
        check_numbers(self, f"{self.name}: ", "not negative", "damping")
        check_numbers(self, f"{self.name}: ", "finite", "line_of_action", "driver_start", "driven_start", "base_helix")
        if self.driver == self.driven:
            raise ValueError(f"{self.name}: driver and driven are the same wheel")
        if not self.backlash >= 0.0:
            raise ValueError(f"{self.name}: backlash must not be negative, got {self.backlash!r}")
        if self.back_line is not None and not math.isfinite(self.back_line):
            raise ValueError(f"{self.name}: back_line must be finite, got {self.back_line!r}")

    @property
    def name(self) -> str:
        """What the mesh is called in messages and results."""
        return f"{self.driver}-{self.driven}"


@dataclass(frozen=True)
class Torsion:
    """A shaft or coupling that joins the rotations of two bodies which turn alike.

    Attributes:
        first, second: names of the bodies.
        stiffness: N m/rad.
        damping: N m s/rad.
    """

    first: str
    second: str
    stiffness: float
    damping: float = 0.0

    def __post_init__(self) -> None:
        """Raise a ValueError that names an unusable field."""
        prefix = f"torsion {self.first}-{self.second}: "
        check_numbers(self, prefix, "positive", "stiffness")
        check_numbers(self, prefix, "not negative", "damping")
        if self.first == self.second:
            raise ValueError(f"{prefix}both ends are the same body")

    @property
    def name(self) -> str:
        """What the spring is called in messages and results."""
        return f"{self.first}-{self.second}"


@dataclass(frozen=True, eq=False)
class GearTrain:
    """Bodies, wheels, meshes and torsion springs, and the speed at which the drive turns.

    Attributes:
        drive: name of the body whose mean speed is given; its torque follows from the balance of the others.
        speed: mean speed of the drive, Hz, positive.
        acceleration: rate at which it rises, Hz/s; the torque of the drive includes that of the inertias.
    """

    bodies: tuple[Body, ...]
    wheels: tuple[Wheel, ...]
    meshes: tuple[Mesh, ...]
    torsions: tuple[Torsion, ...] = ()
    drive: str = ""
    speed: float = 1.0
    acceleration: float = 0.0

    def __post_init__(self) -> None:
        """Raise a ValueError that names what does not fit together."""
        check_numbers(self, "train: ", "positive", "speed")
        check_numbers(self, "train: ", "finite", "acceleration")
        for kind, names in (
            ("body", [body.name for body in self.bodies]),
            ("wheel", [wheel.name for wheel in self.wheels]),
            ("support", [support.name for body in self.bodies for support in body.supports]),
        ):
            twice = sorted({name for name in names if names.count(name) > 1})
            if twice:
                raise ValueError(f"train: {kind} {twice[0]} is given twice")
        self.body(self.drive)
        for wheel in self.wheels:
            self.body(wheel.body)
        for spring in self.torsions:
            self.body(spring.first)
            self.body(spring.second)
        for mesh in self.meshes:
            self._check_mesh(mesh)
        if self.body(self.drive).torque != 0.0:
            raise ValueError(f"body {self.drive}: is the drive, whose torque follows from the balance, and must be 0")
        self.ratios()

    def _check_mesh(self, mesh: Mesh) -> None:
        driver, driven = self.wheel(mesh.driver), self.wheel(mesh.driven)
        if driver.body == driven.body:
            raise ValueError(f"{mesh.name}: both wheels are on body {driver.body}")
        table = (mesh.stiffness.driver_teeth, mesh.stiffness.driven_teeth)
        if table != (driver.teeth, driven.teeth):
            raise ValueError(
                f"{mesh.name}: stiffness is that of {table} teeth, the wheels have {driver.teeth, driven.teeth}"
            )
        radii, teeth = driver.base_radius / driven.base_radius, driver.teeth / driven.teeth
        if abs(radii - teeth) > 1e-6 * teeth:
            raise ValueError(
                f"{mesh.name}: base radii {driver.base_radius!r} and {driven.base_radius!r} m are not as the teeth, "
                f"{driver.teeth} and {driven.teeth}"
            )
        apart = mesh.driver_start * driver.teeth - mesh.driven_start * driven.teeth
        if abs(apart - round(apart)) > 1e-6:
            raise ValueError(
                f"{mesh.name}: driver_start and driven_start must differ by whole pitches, got {apart:g} pitches"
            )

    def body(self, name: str) -> Body:
        """Return a body; raise a ValueError that says which there are."""
        for body in self.bodies:
            if body.name == name:
                return body
        raise ValueError(f"no body {name!r} in the train; there are: {', '.join(b.name for b in self.bodies)}")

    def wheel(self, name: str) -> Wheel:
        """Return a wheel; raise a ValueError that says which there are."""
        for wheel in self.wheels:
            if wheel.name == name:
                return wheel
        raise ValueError(f"no wheel {name!r} in the train; there are: {', '.join(w.name for w in self.wheels)}")

    def ratios(self) -> dict[str, float]:
        """Return the turns of each body per turn of the drive, by name.

        Raises:
            ValueError: if a body is not joined to the drive, or two paths give it different speeds.
        """
        joints: list[tuple[str, str, float]] = [(t.first, t.second, 1.0) for t in self.torsions]
        for mesh in self.meshes:
            driver, driven = self.wheel(mesh.driver), self.wheel(mesh.driven)
            joints.append((driver.body, driven.body, driver.teeth / driven.teeth))
        found, waiting = {self.drive: 1.0}, [self.drive]
        while waiting:
            here = waiting.pop()
            for first, second, ratio in joints:
                if here not in (first, second):
                    continue
                there, turns = (second, found[here] * ratio) if here == first else (first, found[here] / ratio)
                if there not in found:
                    found[there] = turns
                    waiting.append(there)
                elif abs(found[there] - turns) > _SAME * turns:
                    raise ValueError(f"train: body {there} would turn {found[there]:g} and {turns:g} times per turn")
        missing = [body.name for body in self.bodies if body.name not in found]
        if missing:
            raise ValueError(f"train: body {missing[0]} is not joined to the drive {self.drive}")
        return found

    def speeds(self) -> dict[str, float]:
        """Return the mean speed of each body, Hz, by name."""
        return {name: ratio * self.speed for name, ratio in self.ratios().items()}

    def mesh_orders(self, body: str) -> dict[str, float]:
        """Return how often the teeth of each mesh meet per turn of a body, by name of the mesh."""
        ratios = self.ratios()
        turns = ratios[self.body(body).name]
        wheels = {mesh.name: self.wheel(mesh.driver) for mesh in self.meshes}
        return {name: wheel.teeth * ratios[wheel.body] / turns for name, wheel in wheels.items()}

    def mesh_frequencies(self) -> dict[str, float]:
        """Return the mean mesh frequency of each mesh, Hz, by name."""
        return {name: order * self.speed for name, order in self.mesh_orders(self.drive).items()}

    def hunting_tooth_frequencies(self) -> dict[str, float]:
        """Return how often the same two teeth of each mesh meet, Hz: f_mesh / lcm(z1, z2)."""
        teeth = {mesh.name: (self.wheel(mesh.driver).teeth, self.wheel(mesh.driven).teeth) for mesh in self.meshes}
        return {name: value / math.lcm(*teeth[name]) for name, value in self.mesh_frequencies().items()}

    def torques(self) -> dict[str, float]:
        """Return the torque on each body, N m, by name: as given, and of the drive what keeps the mean speed.

        Where the speed rises, those that accelerate the bodies are taken off; the torques then balance.
        """
        ratios, rise = self.ratios(), 2.0 * math.pi * self.acceleration
        found = {b.name: b.torque - (b.inertia * ratios[b.name] * rise if b.rotates else 0.0) for b in self.bodies}
        found[self.drive] -= math.fsum(found[name] * ratio for name, ratio in ratios.items())
        return found

    def drive_torque(self) -> float:
        """Return the torque that the drive is given from outside, N m."""
        drive = self.body(self.drive)
        rise = 2.0 * math.pi * self.acceleration * drive.inertia if drive.rotates else 0.0
        return self.torques()[self.drive] + rise


def line_of_action(to_driven: float, pressure_angle: float, *, counterclockwise: bool, back: bool = False) -> float:
    """Return the direction of the force on the driven wheel of an external pair, rad.

    Args:
        to_driven: direction from the centre of the driver to that of the driven wheel, from x towards y, rad.
        pressure_angle: working angle in the transverse plane, rad.
        counterclockwise: whether the driver turns from x towards y.
        back: whether the flanks touch that do not drive.
    """
    turn = 0.5 * math.pi - pressure_angle
    return to_driven + (turn if counterclockwise is not back else -turn)


def total(matrices: Iterable[Matrix2]) -> Matrix2:
    """Return the sum of matrices, zero where there are none."""
    found = [[0.0, 0.0], [0.0, 0.0]]
    for matrix in matrices:
        for i in (0, 1):
            for j in (0, 1):
                found[i][j] += matrix[i][j]
    return ((found[0][0], found[0][1]), (found[1][0], found[1][1]))
