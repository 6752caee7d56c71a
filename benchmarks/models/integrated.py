"""Problems of the models that are integrated over time: rotor, balls with inertia, six degrees of freedom over time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

import numba
import numpy as np
from numpy.typing import NDArray

from benchmarks import opponents
from benchmarks.models.problem import Floats, Motion, Problem, Rate, Run, Setting
from benchmarks.work_precision import case_of, opponent_arrays
from models.machine.scene import Defect, Scene
from models.published import marin
from models.solve.ball_inertia import kernel as ball_kernels
from models.solve.ball_inertia import solver as balls
from models.solve.ball_inertia.rig import BallInertiaRig
from models.solve.engine.kernel_stepping import fill_depth, fill_start
from models.solve.rotor.elastic import shaft_of
from models.solve.rotor.kernels import forces as rotor_forces
from models.solve.rotor.kernels.rigid import hold
from models.solve.rotor.plan import at_rest, prepare_plan
from models.solve.rotor.rig import RotorRig
from models.solve.rotor.solver import Rigid
from models.solve.six_dof.kernels import time_domain as time_kernels
from models.solve.six_dof.time_domain import prepare_plan as prepare_time
from tests.oracles import ball_inertia_oracle, rotor_oracle, six_dof_oracle


def settings(methods: tuple[str, ...], tolerances: tuple[float, ...]) -> tuple[Setting, ...]:
    """Return all settings of some methods."""
    return tuple(Setting(method, tolerance) for method in methods for tolerance in tolerances)


@cast("Any", numba.njit)(cache=False, fastmath=False)
def _rotor_rate(t: float, z: Floats, plan: rotor_forces.Plan, work: rotor_forces.Work) -> Floats:
    """Return the time derivative of a state with the kernel's own forces, contacts as they are."""
    i = np.searchsorted(plan.bounds, t, side="right") - 1
    fill_start(t, plan.parameter, work.turn)
    fill_depth(t, 0.0, i, plan, work.depth)
    hold(z, np.int64(0), plan, work)
    rotor_forces.slope_of(z, np.int64(0), plan, work, np.int64(0))
    return work.slope[0].copy()


class RotorProblem(Problem):
    """The rotor of Ceruti; compared is the path of the disc."""

    model = "rotor"
    steps = (40e-6, 80e-6, 20e-6, 10e-6)
    reference, grid = 0.25e-6, 80e-6
    span = short = 0.5
    skipped, plain_span = 0.1, 0.01
    # Prototypes: 0.26 to 0.4 s, at 0.5 % of the peak.
    prototype = 0.26
    settings = settings(("RK45", "DOP853", "LSODA"), (1e-5, 1e-6, 1e-7, 1e-8))

    def __init__(self, name: str, scene: Scene, *, elastic: bool = False) -> None:
        """Keep the scene, and the way to solve it."""
        self.scene, self._scene, self._elastic = name, scene, elastic
        self._shaft = shaft_of(scene) if elastic else Rigid(scene, 0.0)
        self._massless = elastic and self._shaft.freedoms == 4
        if self._massless:
            self.model, self.steps, self.reference = "rotor, massless ends", (10e-6, 40e-6), 1e-6
            # Prototype: about a second.
            self.prototype = 1.0
        elif elastic:
            self.prototype = None

    def work(self, step: float, seconds: float, *, signal: bool) -> Callable[[], Run]:
        """Return a run; the signal are the disc's displacements."""
        shaft, steps = self._shaft, round(seconds / step)
        rest = at_rest(self._scene, elastic=self._elastic)
        wave = np.empty((steps, len(shaft.sensors)))
        place = np.empty((steps if signal else 0, shaft.positions))

        def run() -> Run:
            shaft.run(shaft.state(rest), step, wave, place)
            return Run(place[:, :2], wave[:, -1])

        return run

    def rate(self) -> Rate | None:
        """Return the compiled derivative; ends without mass have none."""
        if self._massless:
            return None
        plan = prepare_plan(self._scene, self.span + 1.0, self._shaft.freedoms)
        work = rotor_forces.new_work(plan)
        return lambda t, y: _rotor_rate(t, y, plan, work)

    def start(self) -> Floats:
        """Return the static equilibrium."""
        return self._shaft.state(at_rest(self._scene, elastic=self._elastic))

    def scale(self) -> Floats:
        """Return 10 um (and urad), and 1 mm/s."""
        return np.repeat([1e-5, 1e-3], self._shaft.freedoms)

    def read(self, times: Floats, states: Floats) -> Floats:
        """Return the displacements of the disc."""
        del times
        return states[:2].T

    def plain(self) -> Motion:
        """Return the oracle's complex equations on pairs of real numbers."""
        case, size = self._case(), self._shaft.freedoms

        def rate(t: float, y: Floats) -> Floats:
            z = y.view(np.complex128)
            q, v = z[: size // 2], z[size // 2 :]
            places = rotor_oracle.rings(case, t, q)
            loaded = {
                (k, i)
                for k in (0, 1)
                for i in range(rotor_oracle.N)
                if rotor_oracle.compression(case, k, i, t, places[k]) > 0.0
            }
            found = rotor_oracle.accelerations(case, t, q, v, loaded)[: size // 2]
            return np.concatenate((v, found)).view(np.float64)

        return Motion(rate, self.start(), self.scale())

    def _case(self) -> rotor_oracle.Case:
        scene, rig = self._scene, self._scene.rig_as(RotorRig)
        case = rotor_oracle.Case(
            speed=scene.speed, load=scene.load, a=rig.a, b=rig.b, gap=scene.clearance, end_mass=rig.end_mass,
            cage=(rig.cage_angle_a, rig.cage_angle_b), elastic=self._elastic,
        )  # fmt: skip
        if scene.defect is None:
            return case
        d = scene.defect
        return replace(case, part=d.part, middle=d.position, extent=d.dphi_d, depth=d.h_d)


@cast("Any", numba.njit)(cache=False)
def _ball_rate(t: float, z: Floats, plan: ball_kernels.Plan, work: ball_kernels.Work) -> Floats:
    """Return the time derivative of a state with the kernel's own forces, contacts as they are."""
    i = np.searchsorted(plan.bounds, t, side="right") - 1
    fill_start(t, plan.parameter, work.turn)
    fill_depth(t, 0.0, i, plan, work.depth)
    work.closed[:] = 1.0
    ball_kernels.slope_of(z, np.int64(0), plan, work, np.int64(0))
    return work.slope[0].copy()


class BallProblem(Problem):
    """The balls with inertia of Marin; compared is the path of the ring."""

    model = "ball_inertia"
    steps = (5e-6, 6.25e-6, 2.5e-6)
    reference, grid = 0.5e-6, 25e-6
    span, short = 0.1, 0.02
    plain_span = 2e-3
    settings = settings(("RK45", "DOP853", "LSODA"), (1e-2, 1e-3, 1e-4, 1e-6))

    def __init__(self, count: int, *, damaged: bool) -> None:
        """Make the scene of Table 2."""
        state = "healthy" if not damaged else "inner race, chaotic" if count == 3 else "inner race"
        self.scene = f"{count} balls, {state}"
        self._scene = marin.scene_of(count, defect=marin.INNER if damaged else None)
        self._count, self._damaged = count, damaged
        # Prototypes: 0.9 to 1.2 s with three balls, 2.0 to 2.3 s with nine, at steps of 5 to 6.7 us.
        self.prototype = 0.9 if count == 3 else 2.0

    def work(self, step: float, seconds: float, *, signal: bool) -> Callable[[], Run]:
        """Return a run; the signal are the ring's displacements."""
        plan, rest = balls.prepare_plan(self._scene, seconds + 1.0), balls.at_rest(self._scene)
        steps = round(seconds / step)
        wave, place = np.empty((steps, 1)), np.empty((steps if signal else 0, 2 + self._count))

        def run() -> Run:
            ball_kernels.run(rest.copy(), wave, place, step, plan)
            return Run(place[:, :2], wave[:, 0])

        return run

    def rate(self) -> Rate | None:
        """Return the compiled derivative."""
        plan = balls.prepare_plan(self._scene, 1.0)
        work = ball_kernels.new_work(plan)
        return lambda t, y: _ball_rate(t, y, plan, work)

    def start(self) -> Floats:
        """Return the static equilibrium."""
        return balls.at_rest(self._scene)

    def scale(self) -> Floats:
        """Return 1 um and 1 mm/s."""
        return np.repeat([1e-6, 1e-3, 1e-6, 1e-3], [2, 2, self._count, self._count])

    def read(self, times: Floats, states: Floats) -> Floats:
        """Return the displacements of the ring."""
        del times
        return states[:2].T

    def plain(self) -> Motion:
        """Return the oracle's equations, contacts as they are."""
        scene, rig, oracle = self._scene, self._scene.rig_as(BallInertiaRig), ball_inertia_oracle
        inner = marin.INNER
        spots = (oracle.Spot("inner", inner.position, inner.dphi_d, inner.h_d),) if self._damaged else ()
        case = oracle.Case(
            balls=self._count, speed=scene.speed, load=scene.load, gap=scene.clearance, gravity=scene.gravity,
            damping=(rig.c_ci, rig.c_co), cage=rig.cage_angle, spots=spots,
        )  # fmt: skip
        closed = np.ones(2 * self._count, dtype=np.bool_)

        def relief(t: float) -> tuple[Floats, Floats]:
            inside, outside = ([case.depth(race, i, t) for i in range(self._count)] for race in ("inner", "outer"))
            return np.array(inside), np.array(outside)

        start = self.start()
        start[4 : 4 + self._count] += oracle.R_0
        return Motion(lambda t, z: oracle.derivative(case, t, z, closed, relief), start, self.scale())


class OverTimeProblem(Problem):
    """Six degrees of freedom from rest; compared is the casing's acceleration.

    The compiled equations are those of ``benchmarks.opponents``, which evaluate the path of every ball.
    """

    model = "six_dof, over time"
    steps = (10e-6, 20e-6, 5e-6)
    reference, grid = 0.625e-6, 20e-6
    span, short = 0.4, 0.1
    settings = settings(("RK45", "DOP853", "LSODA"), (1e-5, 1e-6, 1e-7))

    def __init__(self, name: str, speed: float, load: float, defect: Defect | None) -> None:
        """Lay out what both take."""
        self.scene, self._scene = name, Scene(speed, load, defect=defect)
        self._arrays, self._rest = opponent_arrays(self._scene)

    def work(self, step: float, seconds: float, *, signal: bool) -> Callable[[], Run]:
        """Return a run."""
        del signal
        plan, wave = prepare_time(self._scene, seconds + step), np.empty((round(seconds / step), 2))

        def run() -> Run:
            time_kernels.run(np.zeros((2, 6)), wave, step, plan)
            return Run(wave[:, :1], wave[:, 0])

        return run

    def rate(self) -> Rate | None:
        """Return the compiled derivative of displacements from zero load."""
        arrays = self._arrays

        def rate(t: float, y: Floats) -> Floats:
            out = np.empty(12)
            opponents.derivative(t, t, y, out, arrays)
            return out

        return rate

    def start(self) -> Floats:
        """Return the static equilibrium."""
        return self._rest.copy()

    def scale(self) -> Floats:
        """Return 1 um and 1 cm/s."""
        return np.repeat([1e-6, 1e-2], 6)

    def read(self, times: Floats, states: Floats) -> Floats:
        """Return the casing's acceleration along the load."""
        rate = cast("Rate", self.rate())
        return np.array([[rate(float(t), y)[8]] for t, y in zip(times, states.T, strict=True)])

    def plain(self) -> Motion:
        """Return the oracle's equations, its sums over the balls in plain Python."""
        oracle = _Interpreted(case_of(self._scene))
        return Motion(lambda t, x: oracle.rhs(t, x, t), oracle.at_rest(), self.scale())


class _Interpreted(six_dof_oracle.Oracle):
    """The oracle with nothing compiled."""

    def path_of_balls(self, t: float, middle: float) -> NDArray[np.float64]:
        there, piece = self.places(middle)
        return cast("Any", six_dof_oracle.spline_values).py_func(
            there + self.case.omega_c * (t - middle), piece, *self.splines
        )

    def forces(self, t: float, x: Floats, v: Floats, middle: float) -> NDArray[np.float64]:
        case, phi = self.case, self.start + self.case.omega_c * t
        sums = cast("Any", six_dof_oracle.contact_sum).py_func
        return sums(phi, self.path_of_balls(t, middle), x, v, case.omega_c, case.clearance, self.k_c, self.exponent)
