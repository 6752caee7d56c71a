"""Rigs and conditions far from the thesis' own: the accuracy that is asked for is met, or its absence is said.

Issue 14: with steps of fixed microseconds all of these were called converged, off by -20 % to a factor of 96.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from models.machine.bearing import from_catalogue, kinematics
from models.machine.hertz import bearing_stiffness, contact_stiffness
from models.machine.rig import Rig, natural_frequencies
from models.machine.scene import Defect, Floor, Scene
from models.solve.response import Response
from models.solve.simulate import simulate
from models.solve.six_dof.periodic import effort_for
from models.solve.six_dof.rows import simulate_row
from models.solve.six_dof.setup import MOST_STEPS
from models.words.request import Request
from tests.support.effort import effort_count

DEG = math.pi / 180.0
SPALL = Defect(20.0 * DEG, 20e-6)
SCENE = Scene(40.0, 4000.0, defect=SPALL)
RIG = Rig()
ROLLERS = from_catalogue("NU 202 ECP")
ROLLER_SCENE = Scene(40.0, 4000.0, ROLLERS, Rig(k_c=contact_stiffness(ROLLERS), element="roller"), SPALL)


def with_masses(factor: float) -> Scene:
    """Return the scene with lighter or heavier rings and resonator."""
    return replace(SCENE, rig=replace(RIG, **{name: factor * getattr(RIG, name) for name in ("m_i", "m_o", "m_r")}))


def with_rig(name: str, value: float) -> Scene:
    return replace(SCENE, rig=replace(RIG, **{name: value}))


SCENES = {
    "masses / 30": with_masses(1.0 / 30.0),
    "masses x 0.01": with_masses(0.01),
    "masses x 10": with_masses(10.0),
    "k_r x 100": with_rig("k_r", 100.0 * RIG.k_r),
    "beta_c 1e-2": with_rig("beta_c", 1e-2),
    "k_c x 100": with_rig("k_c", 100.0 * RIG.k_c),
    "k_c x 0.01": with_rig("k_c", 0.01 * RIG.k_c),
    "0.1 degrees": replace(SCENE, defect=Defect(0.1 * DEG, 20e-6)),
    "0.02 degrees": replace(SCENE, defect=Defect(0.02 * DEG, 20e-6)),
    "400 Hz": replace(SCENE, speed=400.0),
    "1 Hz": replace(SCENE, speed=1.0),
    "50 kN": replace(SCENE, load=50e3),
    "1 Hz, 50 kN": replace(SCENE, speed=1.0, load=50e3),
    "400 Hz, rough": replace(SCENE, speed=400.0, defect=replace(SPALL, floor=Floor("rough", seed=1))),
    "rollers": ROLLER_SCENE,
    "rollers, pit": replace(ROLLER_SCENE, speed=30.0, load=2000.0, defect=Defect(8.0 * DEG, math.inf)),
    "rollers, healthy": replace(ROLLER_SCENE, defect=None),
}
# They take as long as all others together.
SLOW = {"beta_c 1e-2", "rollers, pit", "1 Hz"}
NAMES = [name for name in SCENES if effort_count(quick=0, full=1) or name not in SLOW]


@cache
def truth_of(scene: Scene) -> Response:
    """Return the scene with a hundredth of the default error; where rounding or the most steps end before, less."""
    fine = simulate(scene, accuracy=1e-5)
    assert fine.rms_error < 0.1 * Request.accuracy
    return fine


@pytest.mark.parametrize("name", NAMES)
def test_the_estimate_bounds_the_error_and_what_is_asked_for_is_met(name: str) -> None:
    fine = truth_of(SCENES[name])
    assert fine.status in ("converged", "inaccurate")
    for accuracy in (5e-3, Request.accuracy):
        found = simulate(SCENES[name], accuracy=accuracy)
        assert found.status == "converged"
        assert found.multiplier < 1.0
        assert found.rms_error <= accuracy
        error = abs(found.rms / fine.rms - 1.0)
        # Three times where it misses (issue 14), besides what settling and the reference leave.
        assert error <= 3.0 * found.rms_error + 0.02 * accuracy + fine.rms_error
        assert found.peak == pytest.approx(fine.peak, rel=0.1)
        lines = np.abs(found.harmonics - fine.harmonics)
        assert np.all(lines <= 3.0 * found.harmonics_error + 3.0 * accuracy * fine.rms)


def test_most_estimates_bound_the_error_by_themselves() -> None:
    bounded = []
    for name in NAMES:
        fine, found = truth_of(SCENES[name]), simulate(SCENES[name])
        bounded.append(abs(found.rms / fine.rms - 1.0) <= found.rms_error + 2e-5 + fine.rms_error)
    assert np.mean(bounded) >= 0.9


@pytest.mark.parametrize("name", ["masses / 30", "k_r x 100", "0.1 degrees", "rollers"])
def test_a_row_is_as_accurate(name: str) -> None:
    scene = SCENES[name]
    assert scene.defect is not None
    row = simulate_row(scene, np.array([scene.defect.dphi_d]))
    assert row.settled[0]
    assert row.rms[0] == pytest.approx(simulate(scene).rms, rel=1e-9)


def test_what_is_not_met_is_said() -> None:
    """Steps that are given are taken; where they leave more than is asked for, the answer is inaccurate."""
    coarse, fine = simulate(SCENE, steps_per_period=128, accuracy=1e-5), truth_of(SCENE)
    assert coarse.status == "inaccurate"
    assert coarse.rms_error > 1e-5
    assert abs(coarse.rms / fine.rms - 1.0) <= 3.0 * coarse.rms_error
    enough = simulate(SCENE, steps_per_period=2048, accuracy=1e-3)
    assert enough.status == "converged"


def test_the_end_of_the_steps_is_said() -> None:
    """Rounding, or the most steps that are taken, ends the halving before an accuracy of nothing is met."""
    for accuracy in (1e-12, 1e-15)[: effort_count(quick=1, full=2)]:
        beyond = simulate(replace(SCENE, speed=400.0), accuracy=accuracy)
        assert beyond.status == "inaccurate"
        assert accuracy < beyond.rms_error < 1e-6


def test_slow_shafts_end_in_bounded_time_or_are_refused() -> None:
    """The steps of a period grow as the speed falls; the grids end at the most that is taken."""
    slow = simulate(replace(SCENE, speed=0.5))
    assert slow.status == "converged"
    damped = replace(SCENE, speed=0.5, rig=replace(RIG, beta_c=1.0))
    with pytest.raises(ValueError, match=rf"at most {MOST_STEPS // 2} are taken: the speed, 0\.5 Hz, is too low"):
        simulate(damped)


def test_a_resonance_beyond_the_range_of_the_estimate_is_refused() -> None:
    """The error estimate is held against an oracle for resonances of up to 1e5 ball rates."""
    stiffness = bearing_stiffness(SCENE.bearing, SCENE.load, RIG.k_c)
    highest = float(natural_frequencies(RIG, float(stiffness[1, 1]), float(stiffness[0, 0]))[-1])
    limit = highest / (1e5 * kinematics(SCENE.bearing, 1.0).bpfo)
    with pytest.raises(ValueError, match=rf"the highest resonance of the rig, {highest:.4g} Hz, is .* too low for it"):
        simulate(replace(SCENE, speed=0.99 * limit))
    assert effort_for(replace(SCENE, speed=1.01 * limit), Request()).steps > 64
