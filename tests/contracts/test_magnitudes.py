"""Every model's answer has a magnitude that a bearing can have, or a status that warns."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from models.machine.bearing import catalogue_entry
from models.machine.scene import Defect, Scene
from models.solve.nominal_rigs import nominal_rig
from models.solve.registry import Solver, solvers
from models.words.request import Request
from tests.support.effort import effort_count
from tests.support.models import base

SOLVERS = {f"{one.model}-{one.name}": one for one in solvers() if one.name != "mean_force"}
G = 9.80665
LEAST, MOST = 1e-6, 1e3
"""Accelerations between which those of bearings are, g: of a defect that is felt, at any load of a machine."""
REQUEST = Request(duration=0.1, rate=25600.0, accuracy=5e-2)
WARNING = ("uncalibrated", "not_converged")


def drawn(solver: Solver, number: int) -> Scene:
    """Return a scene with the nominal parameters of a model, a defect and conditions of a machine."""
    rng = np.random.default_rng((43, number))
    entry = catalogue_entry(str(rng.choice(["6205", "6206", "6305"])))
    ranges = ((0.02, 0.2), (2e-6, 5e-5), (100.0, 5e3))
    extent, depth, load = (math.exp(rng.uniform(math.log(a), math.log(b))) for a, b in ranges)
    scene = Scene(float(rng.uniform(10.0, 60.0)), load, entry.bearing, defect=Defect(extent, depth))
    own = base(solver).rig
    # The shaft of the tests settles soon; contacts of the angular model follow from its bearing.
    rig = own if solver.model == "angular" else nominal_rig(solver.rig, entry)
    if solver.name == "elastic":
        scene = replace(scene, physics=("elastic_shaft",))
    return replace(scene, rig=rig, model=solver.model)


@pytest.mark.parametrize("name", list(SOLVERS))
def test_a_level_is_that_of_a_bearing_or_its_status_warns(name: str) -> None:
    solver = SOLVERS[name]
    scenes = [base(solver), *(drawn(solver, number) for number in range(effort_count(quick=2, full=20)))]
    for scene in scenes:
        found = solver.solve(scene, REQUEST)
        levels = [level[0] / G for sensor, level in zip(found.sensors, found.levels, strict=True) if sensor != "ias"]
        believable = all(LEAST < level < MOST for level in levels)
        assert believable or found.status in WARNING, (scene, levels, found.status)


def test_the_model_of_impacts_on_rings_is_far_beyond_and_warns() -> None:
    """Its impulse has no unit: a level of hundreds of g is no fault of the scene."""
    solver = SOLVERS["ring_impact-modal"]
    scenes = [drawn(solver, number) for number in range(effort_count(quick=10, full=100))]
    found = [solver.solve(scene, REQUEST) for scene in scenes]
    assert max(one.rms for one in found) > 100.0 * G
    assert {one.status for one in found} == {"uncalibrated"}
