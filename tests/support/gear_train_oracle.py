"""Makers and checks that tests of gear train oracle share."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from models.gears.teeth.mesh import MeshStiffness
from models.gears.train.linear import freedoms
from models.gears.train.motion import TrainState, simulate_train
from models.gears.train.parts import GearTrain, Mesh
from tests.support.gear_train import chain, pair


def coarse(*, film: bool) -> GearTrain:
    """A pair whose flanks part in each pitch, with four samples a pitch."""
    train = pair(90.0)
    stiffness = MeshStiffness.rectangular((37, 41), 5e8, 0.9, 1.5, samples=4)
    mesh = replace(train.meshes[0], stiffness=stiffness, damps_without_contact=film)
    return replace(train, meshes=(replace(mesh, damping=0.4 * mesh.damping),))


def faulty() -> GearTrain:
    """Two meshes that rattle on both flanks, with faults of all kinds, the wheels turned on at time 0."""

    def worn(mesh: Mesh, z1: int, z2: int) -> Mesh:
        n = mesh.stiffness.samples
        loss = np.zeros(z1 * n)
        loss[3 * n : 4 * n] = 1e8
        once = [6e-6 * np.sin(2.0 * math.pi * np.arange(z * n) / (z * n)) for z in (z1, z2)]
        pitch = np.where(np.arange(z2 * n) // n % 3 == 0, 2e-6, 0.0)
        stiffness = replace(mesh.stiffness, driver_loss=loss, driver_error=once[0], driven_error=once[1] + pitch)
        start = {"driver_start": 2.9 / z1, "driven_start": 1.9 / z2}
        return replace(mesh, stiffness=stiffness, backlash=5e-6, back_line=mesh.line_of_action - 2.0, **start)

    train = replace(chain(), speed=60.0)
    teeth = [(20, 50), (25, 75)]
    meshes = tuple(worn(mesh, *pair) for mesh, pair in zip(train.meshes, teeth, strict=True))
    return replace(train, bodies=(*train.bodies[:3], replace(train.bodies[3], torque=-10.0)), meshes=meshes)


def placed(train: GearTrain, displacement: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """The state of the oracle."""
    state, names = np.zeros((len(train.bodies), 2, 3)), freedoms(train)
    for k, body in enumerate(train.bodies):
        for j, way in enumerate(("x", "y", "angle")):
            if f"{body.name}.{way}" in names:
                place = names.index(f"{body.name}.{way}")
                state[k, :, j] = displacement[place], velocity[place]
    return state.ravel()


def moving(train: GearTrain, settle: float) -> TrainState:
    """The state of a motion that has settled, put at turn 0."""
    end = simulate_train(train, duration=1e-3, rate=1e3, settle=settle).end
    return TrainState(0.0, end.displacement, end.velocity, np.zeros(0, dtype=np.bool_))
