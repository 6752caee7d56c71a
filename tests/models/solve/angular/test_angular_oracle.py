"""The shaft on two ball bearings against an oracle that shares no code with it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from models.machine.bearing import Bearing
from models.machine.scene import Defect, Part, Scene
from models.machine.speed_profile import SpeedProfile
from models.solve.angular.plan import assemble
from models.solve.angular.rig import AngularRig
from models.solve.angular.solver import trace
from tests.oracles import angular_oracle
from tests.oracles.angular_oracle import DM, Case, D, Pit
from tests.support.effort import effort_count

# All modes as they are, as of the oracle.
RIG = AngularRig(mode_limit=100e3)
WIDE = math.radians(30.0)
CASES = {
    "healthy, slower and slower": Case(cages=(0.1, 0.2), slope=-300.0),
    "hunting": Case(cages=(0.1, 0.2), swing=30.0, pace=20.0, unbalance=1e-4),
    "onto a spall": Case(pits=(Pit(0, "outer", 0.13, 0.2, WIDE, 100e-6),)),
    "inner race of B, shallow": Case(speed=150.0, axial=0.0, pits=(Pit(1, "inner", -0.12, 0.2, None, 4e-6),)),
    "20,000 rpm, narrow spall": Case(20000 / 60, pits=(Pit(1, "outer", 0.1, 0.15, 0.1, 100e-6),)),
    "unbalance, seven balls": Case(50.0, 200.0, -100.0, (7, 7), 200.0, 1e-3, (0.3, 0.0), 10e-6),
}
QUICK = ("onto a spall",)


def swinging(case: Case) -> SpeedProfile:
    """Return the rotation of a case, with knots so close that its acceleration is that of the formula."""
    times = np.linspace(0.0, 0.005, 501)
    angle, speed, _ = case.nominal(times)
    return SpeedProfile(*(tuple(row.tolist()) for row in (times, angle / (2.0 * math.pi), speed / (2.0 * math.pi))))


def scene_of(case: Case) -> Scene:
    """Return the product's scene of a case."""
    defects = tuple(
        Defect(
            pit.extent, pit.depth, position=pit.middle, part=cast("Part", pit.race), width=pit.width,
            support="b" if pit.bearing else "a",
        )
        for pit in case.pits
    )  # fmt: skip
    a, b = (Bearing("", balls, D, DM) for balls in case.balls)
    return Scene(
        case.speed,
        case.load,
        bearing=a,
        second_bearing=b,
        rig=replace(RIG, cage_angle_a=case.cages[0], cage_angle_b=case.cages[1], play=case.play),
        defect=defects[0] if defects else None,
        more_defects=defects[1:],
        axial_load=case.axial,
        speed_slope=case.slope,
        unbalance=case.unbalance,
        speed_profile=swinging(case) if case.swing else None,
    )


@pytest.mark.parametrize("name", list(CASES) if effort_count(quick=1, full=2) == 2 else QUICK)
def test_speed_and_accelerations_are_those_of_the_oracle(name: str) -> None:
    # The ball meets the spall after a tenth of a millisecond.
    case, duration = CASES[name], effort_count(quick=3, full=10) * 1e-4
    scene = scene_of(case)
    found = trace(scene, duration * case.speed, 2.0 * math.pi * case.speed * 1e-6)
    assert found.finite
    assert found.unbalanced < 1e-6
    chosen = np.arange(0, len(found.time), 14)
    assembly = assemble(scene)
    cosines = tuple(math.cos(ring.mean_angle) for ring in assembly.rings)
    expected = angular_oracle.simulate(
        case,
        assembly.displacement[:-1].reshape(-1, 5),
        float(assembly.displacement[-1]),
        cast("tuple[float, float]", cosines),
        found.time[chosen],
    )
    assert found.angle[chosen] - found.angle[0] == pytest.approx(expected["angle"] - expected["angle"][0], abs=2e-9)
    for ours, other in (
        (found.ias[chosen], expected["ias"]),
        *zip(found.acceleration[chosen].T, expected["acceleration"].T, strict=True),
    ):
        level = float(np.sqrt(np.mean(other**2)))
        assert level > 0.0
        assert np.abs(ours - other).max() < 3e-3 * level
        assert np.median(np.abs(ours - other)) < 5e-4 * level
