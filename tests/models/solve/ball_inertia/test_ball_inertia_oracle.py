"""The kernel of the balls with inertia against an oracle that shares no code with it, and its order of convergence."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from models.machine.bearing import from_catalogue
from models.machine.scene import Defect, Part, Scene
from models.solve.ball_inertia.rig import BallInertiaRig
from models.solve.ball_inertia.solver import at_rest, trace
from tests.oracles import ball_inertia_oracle
from tests.oracles.ball_inertia_oracle import R_0, Case, Spot
from tests.support.effort import effort_count

BEARING = replace(from_catalogue("6206"), element_diameter=9.5e-3)
CASES = {
    "three balls, gravity aslant": Case(balls=3, load=3000.0, speed=20.0, gap=1e-5, gravity=9.81, down=0.7),
    "inner race": Case(spots=(Spot("inner", 0.9, 0.055, 2e-5),), gap=1e-5, load=3000.0, cage=1.0),
    "both races": Case(spots=(Spot("outer", 0.2, 0.1, 1e-5), Spot("inner", 0.1, 0.1, 5e-6)), damping=(100.0, 400.0)),
    "half sines": Case(spots=(Spot("outer", 0.2, 0.1, 1e-5), Spot("inner", 0.1, 0.1, 5e-6)), half_sine=True),
    "unbalance": Case(unbalance=3e-3, speed=60.0, gap=2e-5, load=100.0, gravity=9.81),
    "seven balls, fast": Case(balls=7, speed=150.0, load=300.0, gap=5e-6),
}
QUICK = ("three balls, gravity aslant", "both races", "unbalance")


def scene_of(case: Case) -> Scene:
    """Return the product's scene of a case."""
    defects = tuple(Defect(s.extent, s.depth, position=s.middle, part=cast("Part", s.race)) for s in case.spots)
    rig = BallInertiaRig(
        m_b=0.0035,
        k_ci=ball_inertia_oracle.C_IN,
        k_co=ball_inertia_oracle.C_OUT,
        c_ci=case.damping[0],
        c_co=case.damping[1],
        cage_angle=case.cage,
        defect_shape="half_sine" if case.half_sine else "rectangle",
    )
    return Scene(
        case.speed,
        case.load,
        bearing=replace(BEARING, n_elements=case.balls),
        rig=rig,
        defect=defects[0] if defects else None,
        more_defects=defects[1:],
        clearance=case.gap,
        gravity=case.gravity,
        gravity_angle=case.down,
        unbalance=case.unbalance,
    )


@pytest.mark.parametrize("name", list(CASES) if effort_count(quick=1, full=2) == 2 else QUICK)
def test_accelerations_are_those_of_the_oracle(name: str) -> None:
    case, step, duration = CASES[name], 1e-6, 1e-3 * effort_count(quick=2, full=4)
    scene = scene_of(case)
    found = trace(scene, duration, step)
    chosen = np.arange(0, len(found.acceleration), 11)
    state = at_rest(scene)
    state[4 : 4 + case.balls] += R_0
    expected = ball_inertia_oracle.simulate(case, state, step * chosen.astype(np.float64))[:, 0]
    level = float(np.sqrt(np.mean(expected**2)))
    # At the instant of a jump one of both may stand before it: the middle of the errors, and nearly all of them.
    error = np.abs(found.acceleration[chosen] - expected) / level
    assert level > 0.01
    assert np.quantile(error, 0.99) < 2e-4
    assert np.median(error) < 1e-5
