"""Rotor, balls with inertia and six degrees of freedom are one model where their assumptions coincide.

That is: one ring stands still, the other, with a mass M, is pressed on healthy balls under a load W.

* rotor: the inner rings of two equal bearings move with 2 M under 2 W, without tilt, as the cages are equal;
* balls with inertia: balls so light that both contacts of each are one in series;
* six degrees of freedom: the outer ring moves, the inner one is too heavy to, the resonator too light to matter.

The ring is displaced from the static equilibrium along the load and let go, beside the passages of the balls. What is
left of each difference is a share e of stiffness or mass: it shifts the frequency by e / 2, and the waveform after a
time T by the phase omega T e / 2, at most; omega is taken as that of the ring on all balls at twice the load. A force
that one of them lacks adds its acceleration.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from models.machine.bearing import Bearing, catalogue, from_catalogue, kinematics
from models.machine.hertz import contact_exponent, contact_forces, element_angles, in_series, static_equilibrium
from models.machine.rig import Rig
from models.machine.scene import Scene
from models.solve.ball_inertia import kernel as ball_kernels
from models.solve.ball_inertia import solver as ball_inertia
from models.solve.ball_inertia.rig import BallInertiaRig
from models.solve.rotor.plan import at_rest
from models.solve.rotor.rig import RotorRig
from models.solve.rotor.solver import Rigid
from models.solve.six_dof.kernels import time_domain as kernels
from models.solve.six_dof.kernels.step import STATUS_OK
from models.solve.six_dof.time_domain import prepare_plan

SPAN = 0.02
SAMPLE = 10e-6
KICK = 5e-6
"""Displacement at the beginning, m."""
BALL = 2e-4
"""Mass of a light ball, kg: of a real one 3.5e-3."""
DAMPING = 100.0
"""Of both contacts of a ball in series, N s/m."""
# Masses of inner ring and resonator, kg, and frequency of this, rad/s.
HEAVY, LIGHT, RESONANCE = 1e9, 1e-3, 4e5


@dataclass(frozen=True)
class Case:
    """A bearing, the stiffness of its contacts, mass of the moving ring, kg, load, N, speed, Hz, and clearance, m."""

    bearing: Bearing
    k_i: float
    k_o: float
    mass: float = 1.561
    load: float = 3000.0
    speed: float = 20.0
    clearance: float = 0.0

    @property
    def k_c(self) -> float:
        """Both contacts in series."""
        return in_series(self.k_i, self.k_o, contact_exponent(self.bearing))

    @property
    def scene(self) -> Scene:
        """The scene without its rig."""
        rig = Rig(element=self.bearing.element)
        return Scene(self.speed, self.load, bearing=self.bearing, rig=rig, clearance=self.clearance)

    @property
    def stiffness(self) -> float:
        """Of all balls at twice the load, N/m."""
        angles, exponent = element_angles(self.bearing), contact_exponent(self.bearing)
        u = static_equilibrium(angles, 2.0 * self.load, self.k_c, clearance=self.clearance, exponent=exponent)
        return float(np.trace(contact_forces(u, angles, self.k_c, self.clearance, exponent)[1]))

    @property
    def displacement(self) -> float:
        """Of the ring, m: static, with its play and the kick."""
        angles, exponent = element_angles(self.bearing), contact_exponent(self.bearing)
        u = static_equilibrium(angles, self.load, self.k_c, clearance=self.clearance, exponent=exponent)
        return float(np.hypot(*u)) + KICK

    @property
    def cage(self) -> float:
        """Speed of the cage, rad/s."""
        return 2.0 * math.pi * kinematics(self.bearing, self.speed).ftf

    @property
    def highest(self) -> float:
        """Frequency of the ring on its balls at most, rad/s."""
        return math.sqrt(self.stiffness / self.mass)

    def tolerance(self, share: float) -> float:
        """Difference of waveforms, over their RMS, by a share of stiffness or mass."""
        return self.highest * SPAN * 0.5 * share + share


SIX = replace(from_catalogue("6206"), element_diameter=9.5e-3, pitch_diameter=46e-3)
C_I, C_O = 779180.0 * 1e3**1.5, 897760.0 * 1e3**1.5
CASES = {
    "6206, 3 kN": Case(SIX, C_I, C_O),
    "6206, light load": Case(SIX, C_I, C_O, load=200.0, speed=40.0),
    "6206, clearance": Case(SIX, C_I, C_O, clearance=1e-5),
    "6206, heavy ring": Case(SIX, C_I, C_O, mass=20.0, load=1000.0, clearance=5e-6, speed=50.0),
    "five balls": Case(replace(SIX, n_elements=5), C_I, C_O, load=1000.0),
}
ROLLERS = Case(catalogue()["NU 202 ECP"], 1e9, 1.1e9, load=5000.0)


def rotor(case: Case, damping: float) -> NDArray[np.float64]:
    """Acceleration of the inner ring along the load, m/s2, at the samples."""
    rig = RotorRig(
        m=2.0 * case.mass,
        k_c=case.k_c,
        c_b=damping,
        c_n=0.0,
        cage_angle_a=0.0,
        cage_angle_b=0.0,
        element=case.bearing.element,
    )
    scene = replace(case.scene, rig=rig, load=2.0 * case.load)
    rest = at_rest(scene, elastic=False)
    rest[[0, 4, 6]] += KICK
    return Rigid(scene).trace(SPAN, 0.5 * SAMPLE, rest=rest).acceleration[::2, 2]


def six_dof(case: Case, damping: float) -> NDArray[np.float64]:
    """The same of the outer ring, which goes the other way."""
    rig = Rig(
        m_i=HEAVY,
        m_o=case.mass - LIGHT,
        m_r=LIGHT,
        k_r=LIGHT * RESONANCE**2,
        k_c=case.k_c,
        c_i=0.0,
        c_r=0.0,
        m_b=1.0,
        alpha_c=damping,
        beta_c=0.0,
        element=case.bearing.element,
    )
    fold = 8
    wave, state = np.empty((fold * round(SPAN / SAMPLE), 2)), np.zeros((2, 6))
    # Centre of mass of the outer ring.
    state[0, 2] = -KICK
    assert kernels.run(state, wave, SAMPLE / fold, prepare_plan(replace(case.scene, rig=rig), 2.0 * SPAN)) == STATUS_OK
    return -wave[::fold, 0]


def light_balls(case: Case, damping: float) -> NDArray[np.float64]:
    """The same of the inner ring on balls of BALL kg.

    Compressions share as k_o^(2/3) to k_i^(2/3), and so do their rates: the damping of both is proportional to that.
    """
    inner, outer = case.k_i ** (2.0 / 3.0), case.k_o ** (2.0 / 3.0)
    c_ci, c_co = damping * (inner + outer) / outer, damping * (inner + outer) / inner
    rig = BallInertiaRig(
        m_rotor=case.mass - 0.061, m_b=BALL, k_ci=case.k_i, k_co=case.k_o, c_ci=c_ci, c_co=c_co, cage_angle=0.0
    )
    fold, scene = 16, replace(case.scene, rig=rig)
    state, wave = ball_inertia.at_rest(scene), np.empty((fold * round(SPAN / SAMPLE), 1))
    state[0] += KICK
    plan = ball_inertia.prepare_plan(scene, 2.0 * SPAN)
    assert ball_kernels.run(state, wave, np.empty((0, 2)), SAMPLE / fold, plan) == ball_kernels.STATUS_OK
    return wave[::fold, 0]


def difference(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """RMS of the difference, m/s2."""
    return float(np.sqrt(np.mean((one - other) ** 2)))


def level(wave: NDArray[np.float64]) -> float:
    """RMS, m/s2, at least 10."""
    found = float(np.sqrt(np.mean(wave**2)))
    assert found > 10.0
    return found


def outer_ring_tolerance(case: Case) -> float:
    """Share of the waveform: mass over that of the inner ring, and by how much the resonator is more than its mass.

    The resonator is let go too and rings with its mass over all; twice that, since a peak is more than an RMS.
    """
    share = case.mass / HEAVY + LIGHT / case.mass * (case.highest / RESONANCE) ** 2
    return case.tolerance(share) + 2.0 * LIGHT / case.mass


@pytest.mark.parametrize("name", [*CASES, "rollers"])
def test_undamped_six_degrees_of_freedom_are_the_rotor(name: str) -> None:
    case = ROLLERS if name == "rollers" else CASES[name]
    ours, other = six_dof(case, 0.0), rotor(case, 0.0)
    assert difference(ours, other) < outer_ring_tolerance(case) * level(other)


@pytest.mark.parametrize("name", list(CASES))
def test_damped_six_degrees_of_freedom_are_the_rotor(name: str) -> None:
    """The rotor's damping takes no part in the turn of the cage: it lacks c omega_c u of each ball that is pressed."""
    case = CASES[name]
    ours, other = six_dof(case, DAMPING), rotor(case, DAMPING)
    lacking = case.bearing.n_elements * DAMPING * case.cage * case.displacement / case.mass
    assert difference(ours, other) < outer_ring_tolerance(case) * level(other) + lacking
    assert lacking < 0.1 * level(other)


@pytest.mark.parametrize("name", list(CASES))
def test_light_balls_are_six_degrees_of_freedom_and_the_rotor(name: str) -> None:
    """The shares: a quarter of the balls' mass, as a ball goes with half of the ring's motion, and the second order of
    the displacement over the race's radius, which the balls' model has. The force: centrifugal, of each ball.
    """
    case = CASES[name]
    ours = light_balls(case, DAMPING)
    share = 0.25 * case.bearing.n_elements * BALL / case.mass + case.displacement / 18.25e-3
    lacking = case.bearing.n_elements * (BALL * 23e-3 * case.cage**2 + DAMPING * case.cage * case.displacement)
    assert case.tolerance(share) < 0.4
    for other in (rotor(case, DAMPING), six_dof(case, DAMPING)):
        assert difference(ours, other) < case.tolerance(share) * level(other) + lacking / case.mass
