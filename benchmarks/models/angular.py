"""The shaft on two ball bearings over its angle: compared is the angular speed of the encoder's node."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import cast

import numpy as np

from benchmarks.models.integrated import settings
from benchmarks.models.problem import Floats, Motion, Problem, Rate, Run
from models.machine.bearing import Bearing
from models.machine.scene import Defect, Scene
from models.solve.angular.kernels import shaft as kernels
from models.solve.angular.plan import assemble, at_rest, prepare_plan
from models.solve.angular.rig import AngularRig
from tests.oracles import angular_oracle as oracle

# Steps of equal angle are taken for the lowest speed, less what the shaft oscillates.
_LOWEST = 0.999
SPALL = Defect(math.radians(7.0), 100e-6, width=math.radians(30.0), position=0.0, support="a")


def angular_scene(defect: Defect | None) -> Scene:
    """Return 11 and 10 balls at 6000 rpm, 600 N across the shaft and 200 N along."""
    return Scene(
        100.0,
        600.0,
        bearing=Bearing("", 11, oracle.D, oracle.DM),
        second_bearing=Bearing("", 10, oracle.D, oracle.DM),
        rig=AngularRig(),
        defect=defect,
        axial_load=200.0,
    )


class AngularProblem(Problem):
    """Thibault's shaft."""

    model = "angular"
    steps = (8e-6, 4e-6, 2e-6)
    reference, grid = 0.5e-6, 16e-6
    span, short = 0.032, 0.008
    # The oracle has all modes of the shaft, and solves each ball by scipy.
    plain_span = 32e-6
    settings = settings(("RK45", "DOP853", "LSODA"), (1e-2, 1e-3, 1e-4, 1e-5))

    def __init__(self, name: str, defect: Defect | None) -> None:
        """Find the equilibrium."""
        self.scene = name
        self._scene = angular_scene(defect)
        self._assembly = assemble(self._scene)
        self._plan = prepare_plan(self._scene, self._assembly)

    def work(self, step: float, seconds: float, *, signal: bool) -> Callable[[], Run]:
        """Return a run."""
        del signal
        wave = np.empty((round(seconds / step), kernels.SENSORS))
        turned = step * _LOWEST * 2.0 * math.pi * self._scene.speed

        def run() -> Run:
            kernels.run(self.start(), wave, step, turned, self._plan, kernels.new_work(self._plan))
            return Run(wave[:, :1], wave[:, 1])

        return run

    def rate(self) -> Rate | None:
        """Return the compiled derivative by the time."""
        plan, work = self._plan, kernels.new_work(self._plan)

        def rate(t: float, y: Floats) -> Floats:
            del t
            out = np.empty(len(y))
            kernels.rates(y, plan, work, out)
            return out

        return rate

    def start(self) -> Floats:
        """Return the equilibrium, turning."""
        return at_rest(self._plan, self._assembly)

    def scale(self) -> Floats:
        """Return 10 ms, 1 um and 1 cm/s of a kilogram, 1 urad and 1 mrad/s of a kg m2, 1 mrad, 1e-3 and 1 um."""
        n, m = len(self._plan.lateral.square), len(self._plan.torsion.square)
        return np.repeat([1e-2, 1e-6, 1e-2, 1e-6, 1e-3, 1e-3, 1e-6], [1, n, n, m, m, 4, 1])

    def read(self, times: Floats, states: Floats) -> Floats:
        """Return the angular speed less the nominal one."""
        del times
        n, m = len(self._plan.lateral.square), len(self._plan.torsion.square)
        speeds = states[1 + 2 * n + m : 1 + 2 * n + 2 * m]
        return (self._plan.torsion.shape[kernels.T_ENCODER] @ speeds)[:, None]

    def plain(self) -> Motion:
        """Return the oracle's equations of all coordinates."""
        scene, assembly = self._scene, self._assembly
        pits = tuple(oracle.Pit(0, d.part, d.position, d.dphi_d, d.width, d.h_d) for d in scene.defects)
        case = oracle.Case(scene.speed, scene.load, scene.axial_load, pits=pits)
        machine, nodes = oracle.Machine(case), oracle.ELEMENTS + 1
        x = assembly.displacement[:-1].reshape(-1, 5)
        begin = np.concatenate(
            (np.stack([x[:, 0], x[:, 4]], 1).ravel(), np.stack([x[:, 1], -x[:, 3]], 1).ravel(), x[:, 2])
        )
        cosines = cast("tuple[float, float]", tuple(math.cos(ring.mean_angle) for ring in assembly.rings))
        slide = float(assembly.displacement[-1])
        machine.prepare(begin, slide, cosines)
        n, m = 5 * nodes, nodes + 2
        start = np.concatenate((begin, np.zeros(n), machine.twist, np.zeros(m), case.cages, cosines, [slide]))
        scale = np.repeat([1e-6, 1e-2, 1e-6, 1e-3, 1e-3, 1e-6], [n, n, m, m, 4, 1])
        return Motion(machine.rate, start, scale)
