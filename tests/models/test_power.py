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
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from models.kernels.period import Period
from models.scene import Defect, Scene
from tests.oracles import six_dof_oracle as oracle
from tests.periods import orbit_of, run

SCENES = {
    "healthy": Scene(40.0, 4000.0),
    "spall": Scene(40.0, 4000.0, defect=Defect(math.radians(20.0), 20e-6)),
    "spall, both rows": Scene(30.0, 2000.0, defect=Defect(math.radians(20.0), 10e-6, rows=2)),
    "shallow, wide": Scene(20.0, 5000.0, defect=Defect(math.radians(50.0), 3e-6)),
    "pit": Scene(30.0, 2000.0, defect=Defect(math.radians(4.236), 500e-6)),
    "clearance": Scene(40.0, 1000.0, defect=Defect(math.radians(20.0), 20e-6), clearance=8e-6),
}


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
                part=period.part[k : k + 1],
                advance=period.advance[k : k + 1],
            )
            state = run(one, state, np.empty((2, 2)))
            found.append(state)
    return np.array(found)


def powers_of(scene: Scene, steps: int) -> Powers:
    """Return the powers of the settled motion, from its states and the oracle's equations."""
    defect = scene.defect or Defect(0.0, 0.0)
    case = oracle.Case(scene.speed, scene.load, defect.dphi_d, defect.h_d, scene.clearance, defect.rows)
    model, omega = oracle.Oracle(case), case.omega_c
    period, begin = orbit_of(scene, steps)
    states, rest = trajectory(period, begin), model.at_rest()
    assert len(states) == len(period.time)
    share = oracle.M_R / (oracle.M_O + oracle.M_R)
    middles = np.repeat(
        [0.5 * (period.time[a] + period.time[b]) for a, b in segments(period)], np.diff(period.first) + 1
    )
    powers = np.empty((len(states), 5))
    for i, (t, middle, state) in enumerate(zip(period.time, middles, states, strict=True)):
        # The state's first axis lies along the load, the oracle's second.
        inner, v_inner, s, v_s, r, v_r = state[::-1].T
        u = inner - s - share * r + rest[:2] - rest[2:4]
        w = v_inner - v_s - share * v_r
        phi = model.start + omega * t
        d, slope = model.path_of_balls(phi, model.start + omega * middle)
        n, across = np.array([np.sin(phi), np.cos(phi)]), np.array([np.cos(phi), -np.sin(phi)])
        driven = omega * (u @ across - slope)
        delta, speed = u @ n - d - case.clearance, w @ n + driven
        pressed = np.maximum(delta, 0.0)
        damping = np.where(
            delta > 0.0, oracle.ALPHA_C * oracle.M_B + oracle.BETA_C * oracle.K_C * np.sqrt(pressed), 0.0
        )
        elastic = oracle.K_C * pressed**1.5
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
    powers = powers_of(SCENES[name], 2048)
    assert powers.heat > 0.0
    # 1e-3 is asked (issue 14); what is left is the quadrature over contacts that open, 3e-5 at worst.
    assert powers.heat == pytest.approx(powers.drive, rel=1e-4)
    # What is pressed into the contacts comes out of them again.
    assert abs(powers.elastic) < 1e-4 * powers.heat
    assert min(powers.shaft, powers.casing, powers.contacts) >= 0.0


def test_a_balance_without_one_of_its_terms_does_not_close() -> None:
    """The test above tells: each damper takes more than the tolerance, c_r the least."""
    powers = powers_of(SCENES["spall"], 1024)
    for part in (powers.shaft, powers.casing, powers.contacts):
        assert powers.heat - part != pytest.approx(powers.drive, rel=1e-5)
