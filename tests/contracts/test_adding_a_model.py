"""A model is one folder and one entry: with both, and nothing else changed, a scene is answered by it."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.process

FREQUENCY, DECAY, GAIN = 1500.0, 1500.0, 2e6
ENTRY = """
from models.words.extras import Model

MODEL = Model("ringing.rig:RingingRig", ("ringing.solver",))
"""
RIG = f'''
from dataclasses import dataclass
from typing import ClassVar

from models.machine.rig import RigParameters


@dataclass(frozen=True)
class RingingRig(RigParameters):
    """One mode that rings at each passage of a ball."""

    model: ClassVar = "ringing"
    first_sensor: ClassVar = "mo"
    uncertain: ClassVar = ()
    gain: float = {GAIN!r}
    calibrated: bool = False

    def check_bearing(self, bearing):
        """Accept any bearing."""
'''
SOLVER = f'''
import numpy as np

from models.machine.bearing import kinematics
from models.solve.engine.motion import Motion
from models.solve.engine.over_time import answer
from models.solve.registry import Solver, check_effects
from ringing.rig import RingingRig

EFFECTS = frozenset({{"outer_defect"}})


def solve(scene, request):
    """Return the vibration of a scene."""
    check_effects(scene, EFFECTS, "ringing")
    rate = kinematics(scene.bearing, scene.speed).bpfo
    force = scene.rig_as(RingingRig).gain * scene.defect.h_d

    def from_rest(steps, oversampling):
        since = np.mod(np.arange(steps) / (request.rate * oversampling), 1.0 / rate)
        earlier = since[:, None] + np.arange(60) / rate
        wave = force * np.exp(-{DECAY!r} * earlier) * np.sin(2.0 * np.pi * {FREQUENCY!r} * earlier)
        return wave.sum(axis=1)[:, None], True

    motion = Motion(from_rest, ("mo",), "ringing", "sum", rate, 1.0 / rate, 0.0, True)
    return answer(motion, request, 1e-5)


SOLVER = Solver("ringing", "sum", EFFECTS, 1e-6, lambda scene, request: 1e-3, solve, "it is a sum", RingingRig)
'''


def test_a_folder_and_an_entry_add_a_model(tmp_path: Path) -> None:
    (tmp_path / "ringing").mkdir()
    for name, text in (("__init__", ENTRY), ("rig", RIG), ("solver", SOLVER)):
        (tmp_path / "ringing" / f"{name}.py").write_text(text)
    named = tmp_path / "ringing-1.dist-info"
    named.mkdir()
    (named / "METADATA").write_text("Metadata-Version: 2.1\nName: ringing\nVersion: 1\n")
    (named / "entry_points.txt").write_text("[spallwatch.models]\nringing = ringing:MODEL\n")
    command = [sys.executable, "-m", "spallwatch", "simulate", "--json", "--model", "ringing"]
    command += ["--dphi-deg", "2", "--h-d-um", "10", "--speed-hz", "40", "--load-newton", "4000", "--accuracy", "0.001"]
    ran = subprocess.run(command, env=os.environ | {"PYTHONPATH": str(tmp_path)}, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    found = json.loads(ran.stdout)
    assert found["model"] == "ringing"
    # One ring is over before the next ball passes: power of one ring, as often as balls pass.
    pole = complex(-2.0 * DECAY, 4.0 * math.pi * FREQUENCY)
    ring = 0.5 * (1.0 / (2.0 * DECAY) + (1.0 / pole).real)
    assert found["rms_g"] * 9.80665 == pytest.approx(1e-5 * GAIN * math.sqrt(ring * found["bpfo_hz"]), rel=2e-3)
