"""Makers and checks that tests of models share."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from models.gears.pair.rig import GearPairRig
from models.machine.bearing import Bearing, from_catalogue
from models.machine.rig import Rig, RigParameters
from models.machine.scene import PHYSICS, Defect, Floor, Scene, Slip, Waviness
from models.machine.speed_profile import ramp
from models.solve.angular.rig import AngularRig
from models.solve.ball_inertia.rig import BallInertiaRig
from models.solve.registry import Solver
from models.solve.ring_impact.rig import RingImpactRig
from models.solve.rotor.rig import RotorRig
from models.words.request import Request

OUTER = Defect(math.radians(6.0), 10e-6)


SCENE = Scene(40.0, 4000.0, defect=OUTER)


SHORT: dict[str, Any] = {"duration": 0.1, "rate": 25600.0, "accuracy": 5e-3}


REQUEST = Request(**SHORT)


ROLLERS = from_catalogue("NU 202 ECP")


def with_each_effect(scene: Scene, **others: Scene) -> dict[str, Scene]:
    """Return for each effect a scene that has it, with as few others as it can; ``others`` instead of these."""
    healthy = replace(scene, defect=None)
    return {
        "outer_defect": scene,
        "inner_defect": replace(scene, defect=replace(OUTER, part="inner")),
        "ball_defect": replace(scene, defect=replace(OUTER, part="ball")),
        "several_defects": replace(scene, more_defects=(replace(OUTER, position=1.0),)),
        "first_row": replace(
            scene, bearing=replace(scene.bearing, rows=2), defect=replace(OUTER, first_row=1), second_bearing=None
        ),
        "rough_floor": replace(scene, defect=replace(OUTER, floor=Floor("rough", seed=1))),
        "clearance": replace(healthy, clearance=5e-6),
        "roller": replace(healthy, bearing=ROLLERS, rig=Rig(element="roller", k_c=5e8), load=1000.0),
        "outer_ring_turns": replace(healthy, bearing=replace(scene.bearing, rotating_ring="outer")),
        "waviness": replace(healthy, waviness=(Waviness(1e-6, 13),)),
        "inner_waviness": replace(healthy, waviness=(Waviness(1e-6, 7, "inner"),)),
        "unbalance": replace(healthy, unbalance=1e-3),
        "gravity": replace(healthy, gravity=100.0),
        "slip": replace(scene, slip=Slip(0.01)),
        "mean_force_slip": replace(scene, slip=Slip(0.01, "mean_force")),
        "defect_width": replace(scene, defect=replace(OUTER, width=0.5)),
        "second_bearing": replace(healthy, second_bearing=scene.bearing),
        "axial_load": replace(healthy, axial_load=500.0),
        "couple_unbalance": replace(healthy, couple_unbalance=1e-4),
        "bow": replace(healthy, bow=1e-4),
        "rotating_load": replace(healthy, load_turns=True),
        "changing_speed": replace(healthy, speed_profile=ramp(scene.speed, 2.0 * scene.speed, 0.1)),
        **{f"with_{name}": replace(healthy, physics=(name,)) for name in PHYSICS},
        **others,
    }


# What only a defect drives.
RINGS = Scene(40.0, 1000.0, bearing=from_catalogue("6205"), rig=RingImpactRig(), defect=OUTER)


ANGLED = replace(RINGS.bearing, rows=2, contact_angle=0.2)


ROTOR = Scene(40.0, 1000.0, bearing=from_catalogue("6305"), rig=RotorRig(end_mass=0.3), defect=OUTER)


GEARS = Scene(40.0, 1000.0, bearing=from_catalogue("6305"), rig=GearPairRig(), defect=OUTER)


BALLS = Scene(40.0, 1000.0, bearing=from_catalogue("6206"), rig=BallInertiaRig(), defect=OUTER)


# With such couplings, damping and governor the motion settles in 0.06 s.
STIFF = AngularRig(mode_limit=8e3, coupling=8000.0, damping=0.06, governor=0.3)


SHAFT = Scene(100.0, 600.0, bearing=Bearing("", 11, 12.7e-3, 80e-3), rig=STIFF, defect=OUTER)


# For each type of parameters a scene with a defect of the outer race, and with each effect.
SCENES: dict[type[RigParameters], dict[str, Scene]] = {
    Rig: with_each_effect(SCENE),
    AngularRig: with_each_effect(
        SHAFT,
        roller=replace(SHAFT, bearing=ROLLERS),
        second_bearing=replace(SHAFT, defect=None, second_bearing=replace(SHAFT.bearing, n_elements=10)),
        changing_speed=replace(SHAFT, defect=None, speed_slope=-20.0),
    ),
    GearPairRig: with_each_effect(
        GEARS, roller=replace(GEARS, defect=None, bearing=ROLLERS, rig=GearPairRig(element="roller", k_c=5e8))
    ),
    BallInertiaRig: with_each_effect(BALLS, roller=replace(BALLS, bearing=ROLLERS)),
    RingImpactRig: with_each_effect(
        RINGS,
        first_row=replace(RINGS, bearing=ANGLED, defect=replace(OUTER, first_row=1), axial_load=100.0),
        clearance=replace(RINGS, clearance=20e-6),
        roller=replace(RINGS, bearing=ROLLERS),
        outer_ring_turns=replace(RINGS, bearing=replace(RINGS.bearing, rotating_ring="outer")),
        axial_load=replace(RINGS, axial_load=3000.0),
        rotating_load=replace(RINGS, load_turns=True),
        with_ring_modes=replace(RINGS, physics=("ring_modes",)),
    ),
    RotorRig: with_each_effect(
        ROTOR,
        roller=replace(ROTOR, defect=None, bearing=ROLLERS, rig=RotorRig(end_mass=0.3, element="roller", k_c=5e8)),
        second_bearing=replace(ROTOR, defect=None, second_bearing=from_catalogue("6205")),
        couple_unbalance=replace(ROTOR, defect=None, couple_unbalance=1e-3),
    ),
}


def base(solver: Solver) -> Scene:
    """Return the scene with a defect of the outer race that a solver takes."""
    return SCENES[solver.rig]["outer_defect"]
