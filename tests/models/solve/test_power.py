"""Power balance: over a period the dampers turn into heat what the drive of the cage does, and nothing is left over.

Derived from Eqs. 35, 36, 39 and 44, in the oracle's coordinates and with its path. Energies, and the work of the load,
are the same again after a period. With v of the inner ring and v_r of casing against resonator the dampers take
c_i v^2 and c_r v_r^2. A ball pressed by delta, with the force F and the direction n (t across it) in a frame that turns
with omega, does -F n.u' on both rings, where u' = v_i - v_o, and

    delta' = u'.n + omega u.t - omega d'(phi),  F = k_c delta^1.5 + c(delta) delta'.

Integrated, F delta' leaves c(delta) delta'^2 alone. So the heat of all dampers is the integral of F omega (u.t - d')
over all balls: the work that turning the balls against their forces, and up the slopes of the moving path, takes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import root

from models.machine.bearing import from_catalogue
from models.machine.rig import Rig
from models.machine.scene import Defect, Scene, Waviness
from models.solve.six_dof.kernels.period import Period, blank_trace
from reference.periods import orbit_of, run
from tests.oracles import six_dof_oracle as oracle

# The oracle's geometry, with rollers instead of its balls.
BARREL = replace(from_catalogue("1205 ETN9"), designation="barrel", element="roller", effective_length=8e-3)
BARREL_RIG = Rig(k_c=1.2e9, element="roller")

SCENES = {
    "healthy": Scene(40.0, 4000.0),
    "spall": Scene(40.0, 4000.0, defect=Defect(math.radians(20.0), 20e-6)),
    "spall, both rows": Scene(30.0, 2000.0, defect=Defect(math.radians(20.0), 10e-6, rows=2)),
    "shallow, wide": Scene(20.0, 5000.0, defect=Defect(math.radians(50.0), 3e-6)),
    "pit": Scene(30.0, 2000.0, defect=Defect(math.radians(4.236), 500e-6)),
    "clearance": Scene(40.0, 1000.0, defect=Defect(math.radians(20.0), 20e-6), clearance=8e-6),
    "gravity across": Scene(40.0, 1000.0, gravity=50.0, gravity_angle=0.5 * math.pi, defect=Defect(0.3, 10e-6)),
    "waves": Scene(40.0, 4000.0, waviness=(Waviness(1e-6, 13, phase=0.4),)),
    "rollers": Scene(40.0, 4000.0, BARREL, BARREL_RIG),
    "rollers, spall": Scene(40.0, 4000.0, BARREL, BARREL_RIG, Defect(math.radians(20.0), 3e-6)),
}
# A roller that meets its contact at speed is damped from the first instant, by a force like the ninth root of its
# approach; the balance then closes with the steps more slowly.
SLOW = {"rollers, spall"}


@dataclass(frozen=True)
class Powers:
    """Means over a period, W."""

    shaft: float
    casing: float
    contacts: float
    elastic: float
    drive: float

    @property
    def heat(self) -> float:
        return self.shaft + self.casing + self.contacts


def trajectory(period: Period, state: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the state at each recorded value of a period, (values, 2, 6): both ends of every step, by segment."""
    found, nodes = [], period.nodes
    for k in range(len(period.first) - 1):
        found.append(state)
        for n in range(period.first[k], period.first[k + 1]):
            here = nodes._replace(turn=nodes.turn[n : n + 1], depth=nodes.depth[n : n + 1], rate=nodes.rate[n : n + 1])
            one = period._replace(
                nodes=here,
                first=np.array([0, 1]),
                flow=period.flow[k : k + 1],
                time=np.array([0.0, period.flow[k, 0]]),
                weight=np.full(2, 0.5),
            )
            state = run(one, state, blank_trace(one))
            found.append(state)
    return np.array(found)


def static_approach(scene: Scene, start: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the displacement of the inner against the outer ring at rest, m, (across, along) the load."""
    rig, exponent = scene.rig_as(Rig), exponent_of(scene)
    weight = scene.gravity * (rig.m_o + rig.m_r)
    force = np.array(
        [weight * math.sin(scene.gravity_angle), scene.load + weight * math.cos(scene.gravity_angle)], dtype=np.float64
    )
    normals = np.array([np.sin(start), np.cos(start)])

    def residual(u: NDArray[np.float64]) -> NDArray[np.float64]:
        pressed = np.maximum(1e-6 * u @ normals - scene.clearance, 0.0)
        return (normals @ (rig.k_c * pressed**exponent) - force) / scene.load

    return 1e-6 * root(residual, 1e6 * (scene.clearance + 5e-6) * force / np.linalg.norm(force), tol=1e-13).x


def exponent_of(scene: Scene) -> float:
    return 1.5 if scene.bearing.element == "ball" else 10.0 / 9.0


def powers_of(scene: Scene, steps: int) -> Powers:
    """Return the powers of the settled motion, from its states and the oracle's equations."""
    defect = scene.defect or Defect(0.0, 0.0)
    case = oracle.Case(scene.speed, scene.load, defect.dphi_d, defect.h_d, scene.clearance, defect.rows)
    model, omega = oracle.Oracle(case), case.omega_c
    k_c, exponent = scene.rig_as(Rig).k_c, exponent_of(scene)
    period, begin = orbit_of(scene, steps)
    states, rest = trajectory(period, begin), static_approach(scene, model.start)
    assert len(states) == len(period.time)
    share = oracle.M_R / (oracle.M_O + oracle.M_R)
    middles = np.repeat(
        [0.5 * (period.time[a] + period.time[b]) for a, b in segments(period)], np.diff(period.first) + 1
    )
    powers = np.empty((len(states), 5))
    for i, (t, middle, state) in enumerate(zip(period.time, middles, states, strict=True)):
        # The state's first axis lies along the load, the oracle's second.
        inner, v_inner, s, v_s, r, v_r = state[::-1].T
        u = inner - s - share * r + rest
        w = v_inner - v_s - share * v_r
        phi = model.start + omega * t
        d, slope = model.path_of_balls(t, middle)
        for wave in scene.waviness:
            height = wave.amplitude * math.cos(scene.bearing.contact_angle)
            d = d + height * np.cos(wave.order * phi + wave.phase)
            slope = slope - height * wave.order * np.sin(wave.order * phi + wave.phase)
        n, across = np.array([np.sin(phi), np.cos(phi)]), np.array([np.cos(phi), -np.sin(phi)])
        driven = omega * (u @ across - slope)
        delta, speed = u @ n - d - case.clearance, w @ n + driven
        pressed = np.maximum(delta, 0.0)
        damping = np.where(
            delta > 0.0, oracle.ALPHA_C * oracle.M_B + oracle.BETA_C * k_c * pressed ** (exponent - 1.0), 0.0
        )
        elastic = k_c * pressed**exponent
        powers[i] = (
            oracle.C_I * (v_inner @ v_inner),
            oracle.C_R * (v_r @ v_r),
            np.sum(damping * speed**2),
            np.sum(elastic * speed),
            np.sum((elastic + damping * speed) * driven),
        )
    return Powers(*(period.weight @ powers).tolist())


def segments(period: Period) -> list[tuple[int, int]]:
    """Return the first and the last recorded value of each segment."""
    return [(int(period.first[k]) + k, int(period.first[k + 1]) + k) for k in range(len(period.first) - 1)]


@pytest.mark.parametrize("name", list(SCENES))
def test_the_heat_of_the_dampers_is_the_work_of_the_drive(name: str) -> None:
    powers = powers_of(SCENES[name], 4096 if name in SLOW else 2048)
    assert powers.heat > 0.0
    # 1e-3 is asked; what is left is the quadrature over contacts that open, 3e-5 at worst with balls.
    tolerance = 1e-3 if name in SLOW else 1e-4
    assert powers.heat == pytest.approx(powers.drive, rel=tolerance)
    # What is pressed into the contacts comes out of them again.
    assert abs(powers.elastic) < tolerance * powers.heat
    assert min(powers.shaft, powers.casing, powers.contacts) >= 0.0


@pytest.mark.parametrize(("name", "dampers"), [("spall", 3), ("rollers", 2)])
def test_a_balance_without_one_of_its_terms_does_not_close(name: str, dampers: int) -> None:
    """The test above tells: each damper takes more than the tolerance, c_r the least (of healthy rollers 2e-8)."""
    powers = powers_of(SCENES[name], 1024)
    assert powers.heat == pytest.approx(powers.drive, rel=3e-6)
    for part in sorted((powers.shaft, powers.casing, powers.contacts))[-dampers:]:
        assert powers.heat - part != pytest.approx(powers.drive, rel=1e-5)
