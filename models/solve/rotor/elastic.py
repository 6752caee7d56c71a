"""The rotor on two bearings (Ceruti) on an elastic shaft, with and without a mass at its ends.

The shaft is two springs 3 E I / a^3 and 3 E I / b^3 between the disc and the inner rings, with internal damping that
is seen from the turning shaft (section 3.2.2). With ``RotorRig.end_mass`` the sensors are those of the rigid shaft.
Without, as in the source, the ends have no acceleration: the sensor is "c" alone, and a request for another is refused.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from models.solve.registry import Solver
from models.solve.rotor import massless_kernel
from models.solve.rotor.kernel import STATUS_OK
from models.solve.rotor.plan import at_rest, bearings_of
from models.solve.rotor.rig import RotorRig
from models.solve.rotor.solver import EFFECTS, LONGEST_STEP, Rigid, contact_step

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.scene import Scene
    from models.words.request import Sensor

_BENDING_ANGLE = 0.3
_MASSLESS_STEP = 10e-6
_LEAST_ERROR = 1e-5


class _Bent(Rigid):
    """What both elastic shafts share."""

    solver = "elastic"
    effects = EFFECTS | {"with_elastic_shaft"}
    positions = 8

    def at_rest(self) -> NDArray[np.float64]:
        return at_rest(self.scene, elastic=True)

    def state(self, rest: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.concatenate((rest, np.zeros(self.freedoms)))

    def ends(self, place: NDArray[np.float64]) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        return place[:, 4] + 1j * place[:, 5], place[:, 6] + 1j * place[:, 7]


class Lumped(_Bent):
    """The elastic shaft whose ends have a mass."""

    freedoms = 8
    seconds_a_step = 5e-7

    def longest_step(self) -> float:
        """Return the step to begin with, s: an end moves between its contacts and the shaft."""
        rig, step = self.scene.rig_as(RotorRig), LONGEST_STEP
        for k, (arm, bearing) in enumerate(zip((rig.a, rig.b), bearings_of(self.scene), strict=True)):
            step = min(step, contact_step(self.scene, 1.0 / rig.end_mass, k, bearing.n_elements * bearing.rows))
            spring = rig.shaft_stiffness[k]
            inverse = 1.0 / rig.end_mass + 1.0 / rig.m + arm**2 / rig.j_t
            step = min(step, _BENDING_ANGLE / math.sqrt(spring * inverse))
            if rig.internal_damping > 0.0:
                step = min(step, rig.end_mass / (2.0 * spring * rig.internal_damping))
        return step


class Massless(_Bent):
    """The elastic shaft of the source."""

    freedoms = 4
    sensors: tuple[Sensor, ...] = ("c",)
    seconds_a_step = 8e-7
    iterations = (0, 0)

    def longest_step(self) -> float:
        """Return the step to begin with, s."""
        return _MASSLESS_STEP

    def run(
        self, state: NDArray[np.float64], step: float, wave: NDArray[np.float64], place: NDArray[np.float64]
    ) -> bool:
        """Fill as ``Rigid.run``; ``iterations`` are then those of Newton's method, all and the most of one."""
        tally = np.zeros(2, dtype=np.int64)
        status = massless_kernel.run_massless(state, wave, place, step, self.plan(step * (len(wave) + 1)), tally)
        self.iterations = int(tally[0]), int(tally[1])
        return status == STATUS_OK


def shaft_of(scene: Scene, direction: float = 0.0) -> Rigid:
    """Return what integrates a scene with an elastic shaft."""
    kind = Lumped if scene.rig_as(RotorRig).end_mass > 0.0 else Massless
    return kind(scene, direction)


def warm() -> None:
    """Compile the kernels: one scene with ends that have a mass, and one without."""
    from models.machine.bearing import from_catalogue
    from models.machine.scene import Scene

    scene = Scene(40.0, 1000.0, bearing=from_catalogue("6305"), rig=RotorRig(end_mass=0.3))
    Rigid(scene).trace(1e-3, 1e-5)
    Massless(replace(scene, rig=RotorRig())).trace(1e-3, 1e-5)


SOLVER = Solver(
    model="rotor",
    name=Massless.solver,
    effects=Massless.effects,
    error=_LEAST_ERROR,
    cost=lambda scene, request: shaft_of(scene).cost(request),
    solve=lambda scene, request: shaft_of(scene, request.direction).solve(request),
    reason="it bends the shaft between disc and bearings",
    rig=RotorRig,
    trajectories=lambda scene, request: shaft_of(scene).trajectories(request),
)
