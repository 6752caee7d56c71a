"""Makers and checks that tests of gear rolling share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.gears.train.bearings import RollingElements
from models.gears.train.motion import TrainState, simulate_train
from models.gears.train.parts import Body, GearTrain, Support, alike
from models.machine.bearing import from_catalogue
from models.machine.scene import Defect, Part, Scene
from models.solve.rotor.plan import at_rest
from models.solve.rotor.rig import RotorRig
from models.solve.rotor.solver import Rigid

BEARING = from_catalogue("6305")


def rotor_and_body(part: Part, step: float, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """The way of a symmetric rotor's disc by the rotor's kernel, and by that of a train: x + i y, m, every ``step``."""
    defect, rig = Defect(0.3, 8e-6, position=0.2, part=part), RotorRig(cage_angle_a=0.1, cage_angle_b=0.1)
    both = (replace(defect, support="b"),)
    scene = Scene(30.0, 800.0, bearing=BEARING, second_bearing=BEARING, rig=rig, defect=defect, more_defects=both)
    scene = replace(scene, clearance=2e-6)
    rest = at_rest(scene, elastic=False)
    supports = tuple(Support(name, alike(1.0), alike(0.5 * rig.c_n)) for name in "ab")
    body = Body("disc", rig.m, 1.0, supports, force=(800.0, 0.0))
    motion = simulate_train(
        GearTrain((body,), (), (), drive="disc", speed=30.0),
        duration=duration,
        rate=1.0 / step,
        step=0.25 * step,
        start=TrainState(0.0, np.array([rest[0], rest[1], 0.0]), np.zeros(3), np.zeros(0, dtype=np.bool_)),
        rolling=[
            RollingElements(name, BEARING, rig.k_c, 2e-6, damping=rig.c_b, cage_angle=0.1, defects=(defect,))
            for name in "ab"
        ],
    )
    # Where a ball with a defect meets a race, it is relieved at once, and the energy of its contact jumps.
    assert part == "ball" or motion.energy_residual() < 1e-4
    return Rigid(scene).trace(duration, step, rest=rest).c, motion.displacement[:, 0] + 1j * motion.displacement[:, 1]
