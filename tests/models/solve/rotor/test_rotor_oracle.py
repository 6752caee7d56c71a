"""The rotor's kernel against an oracle that shares no code with it: every effect, rigid and elastic shaft."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest

from models.machine.bearing import from_catalogue
from models.machine.scene import Defect, Part, Scene
from models.solve.rotor.elastic import trace_elastic
from models.solve.rotor.rig import RotorRig
from models.solve.rotor.solver import trace
from tests.oracles import rotor_oracle
from tests.oracles.rotor_oracle import Case
from tests.support.effort import effort_count

CASES = {
    "healthy": Case(),
    "unlike arms": Case(a=0.3, b=0.5, cage=(0.1, 0.7)),
    "outer race": Case(part="outer", middle=0.02, extent=0.01, depth=1e-4),
    "inner race of B": Case(part="inner", side=1, middle=0.05, extent=0.01, depth=5e-6, cage=(0.1, 0.05)),
    "ball": Case(part="ball", middle=0.3, extent=0.05, depth=5e-5),
    "unbalance and couple": Case(unbalance=5e-4, couple=1e-3, lead=0.4, speed=40.0),
    "bow": Case(bow=5e-5, slope=1e-4, lead=1.0, speed=40.0, gap=0.0),
    "end masses": Case(end_mass=0.3, a=0.3, b=0.5, bow=2e-5),
    "elastic": Case(elastic=True, end_mass=0.3),
    "elastic, all": Case(
        elastic=True, end_mass=0.3, loss=2e-4, part="outer", middle=0.02, extent=0.01, depth=1e-5, a=0.1, b=0.15,
        unbalance=5e-4, couple=1e-3, bow=2e-5, slope=1e-4, lead=0.4, speed=30.0
    ),
}  # fmt: skip
QUICK = ("unlike arms", "outer race", "ball", "bow", "elastic, all")


def scene_of(case: Case) -> Scene:
    """Return the product's scene of a case."""
    bearing = from_catalogue("6305")
    defect = None
    if case.part != "none":
        support = "a" if case.side == 0 else "b"
        defect = Defect(case.extent, case.depth, position=case.middle, part=cast("Part", case.part), support=support)
    rig = RotorRig(
        length=case.a + case.b,
        a=case.a,
        end_mass=case.end_mass,
        internal_damping=case.loss,
        cage_angle_a=case.cage[0],
        cage_angle_b=case.cage[1],
        couple_angle=case.lead,
        bow_angle=case.lead,
        bow_slope=case.slope / case.bow if case.bow else 0.0,
    )
    return Scene(
        case.speed,
        case.load,
        bearing=bearing,
        second_bearing=bearing,
        rig=rig,
        defect=defect,
        clearance=case.gap,
        unbalance=case.unbalance,
        couple_unbalance=case.couple,
        bow=case.bow,
    )


@pytest.mark.parametrize("name", list(CASES) if effort_count(quick=1, full=2) == 2 else QUICK)
def test_accelerations_are_those_of_the_oracle(name: str) -> None:
    case, step, duration = CASES[name], 10e-6, 0.03
    scene = scene_of(case)
    found = (trace_elastic if case.elastic else trace)(scene, duration, step)
    chosen = np.arange(0, len(found.acceleration), 7)
    expected = rotor_oracle.simulate(case, step * chosen.astype(np.float64))
    level = np.sqrt(np.mean(expected**2, axis=0))
    ours = found.acceleration[chosen]
    # At the instant of a jump one of both may stand before it: the middle of the errors, and nearly all of them.
    error = np.abs(ours - expected) / level
    assert np.quantile(error, 0.99) < 5e-4
    assert np.median(error) < 2e-5
