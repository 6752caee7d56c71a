"""Makers and checks that tests of gear train share."""

from __future__ import annotations

import math
from dataclasses import replace

from models.gears.teeth.mesh import MeshStiffness
from models.gears.train.linear import mesh_mass
from models.gears.train.parts import Body, GearTrain, Mesh, Support, Torsion, Wheel, alike, line_of_action

ANGLE = math.radians(20.0)


RADIUS = 0.0695


def pair(speed: float = 30.0, *, load: float = 100.0, backlash: float = 50e-6, share: float = 0.5) -> GearTrain:
    """A pair of 37 and 41 teeth on two supports, with 5 % of damping in the mesh."""
    stiffness = MeshStiffness.rectangular((37, 41), 5e8, share, 1.6, samples=32)
    lines = [line_of_action(0.0, ANGLE, counterclockwise=True, back=back) for back in (False, True)]
    train = GearTrain(
        bodies=(
            Body("first", 6.0, 1e-2, (Support("a", alike(4e8), alike(2e3)),)),
            Body("second", 7.0, 1.5e-2, (Support("b", alike(4e8), alike(2e3)),), torque=-load),
        ),
        wheels=(Wheel("pinion", "first", 37, RADIUS), Wheel("gear", "second", 41, RADIUS * 41 / 37)),
        meshes=(Mesh("pinion", "gear", stiffness, *lines, backlash=backlash),),
        drive="first",
        speed=speed,
    )
    mesh = train.meshes[0]
    damped = replace(mesh, damping=0.1 * math.sqrt(5e8 * mesh_mass(train, mesh)))
    return replace(train, meshes=(damped,))


def chain() -> GearTrain:
    """A motor on a shaft with 20 teeth, an intermediate shaft with 50 and 25, and one with 75."""
    stiffness = MeshStiffness.harmonic((20, 50), 4e8, [4e7], samples=16)
    second = MeshStiffness.harmonic((25, 75), 6e8, [6e7], samples=16)
    held = {name: (Support(name, alike(3e8), alike(1e3)),) for name in "abc"}
    return GearTrain(
        bodies=(
            Body("motor", inertia=0.05, translates=False),
            Body("in", 3.0, 2e-3, held["a"]),
            Body("middle", 8.0, 2e-2, held["b"]),
            Body("out", 15.0, 9e-2, held["c"], torque=-300.0),
        ),
        wheels=(
            Wheel("w20", "in", 20, 0.03),
            Wheel("w50", "middle", 50, 0.075),
            Wheel("w25", "middle", 25, 0.04),
            Wheel("w75", "out", 75, 0.12),
        ),
        meshes=(
            Mesh("w20", "w50", stiffness, 1.2, damping=500.0, backlash=8e-5),
            Mesh("w25", "w75", second, -0.4, damping=500.0, backlash=8e-5),
        ),
        torsions=(Torsion("motor", "in", 1e4, 1.0),),
        drive="motor",
        speed=25.0,
    )
