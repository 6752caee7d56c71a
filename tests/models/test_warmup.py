"""What warmup compiles is all that any scene needs."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from models.warmup import PARTS, compile_parts

# Types that are compiled or loaded for calls from Python, by kernel: in a process of its own, because other tests have
# called kernels in this one.
PROBE = """
import json, math, sys
from dataclasses import replace
from models.warmup import PARTS, compile_part

def types():
    kernels = [m for name, m in sys.modules.items() if name.startswith("models.") and "kernel" in name]
    return {
        f"{value.__module__}.{key}": len(value.signatures)
        for module in kernels for key, value in vars(module).items()
        if not isinstance(value, type) and hasattr(value, "signatures")
    }

for name in PARTS:
    compile_part(name)
again = {name: compile_part(name).kernels for name in PARTS}
warm = types()
from models.machine.bearing import from_catalogue
from models.solve.six_dof.lanes import LaneOptions, simulate_lanes
from models.solve.six_dof.time_domain import simulate_time
from models.machine.hertz import contact_stiffness
from models.maps.build import build_map
from models.maps.data import MapPlan
from models.solve.ring_impact.rig import RingImpactRig
from models.machine.rig import Rig
from models.machine.scene import Defect, Floor, Scene, Slip, Waviness
from models.solve.simulate import simulate

rough = Defect(0.35, 2e-5, floor=Floor("rough", seed=1))
plain = Scene(40.0, 4000.0)
options = LaneOptions(max_blocks=3, slip_blocks=2, steps_per_period=32)
for defect in (None, Defect(0.1, 1e-3), rough, replace(rough, rows=2)):
    scene = replace(plain, defect=defect, clearance=1e-6)
    simulate(scene)
    simulate(scene, band=(0.0, 9500.0)).lines("mr")
    simulate_lanes([scene], options)
    for rule in ("per_passage", "mean_force"):
        simulate_lanes([replace(scene, slip=Slip(0.01, rule))], options)
for part in ("outer", "inner", "ball"):
    every = replace(plain, defect=Defect(0.1, 1e-5, part=part), waviness=(Waviness(1e-6, 7),), unbalance=1e-3)
    simulate_time(every, 0.01, 25600.0, settle=0.0)
rollers = from_catalogue("NU 202 ECP")
of_rollers = replace(plain, bearing=rollers, rig=Rig(k_c=contact_stiffness(rollers), element="roller"))
simulate(of_rollers)
simulate_time(replace(every, bearing=rollers, rig=of_rollers.rig), 0.01, 25600.0, settle=0.0)
rings = replace(plain, bearing=from_catalogue("6205"), rig=RingImpactRig(slip_noise=1.0, pulse="half_sine"))
for part in ("outer", "inner", "ball"):
    simulate(replace(rings, defect=Defect(0.02, 1e-4, part=part)), duration=0.05)
build_map(MapPlan(load=(4000.0,), speed=(40.0,), h_d=(0.0, 1e-5), dphi_d=(0.1,), floor=Floor("rough", seed=1)))
print(json.dumps([again, warm, types()]))
"""


@pytest.mark.process
def test_after_it_nothing_is_compiled() -> None:
    """Neither by a part that is there, nor by other scenes."""
    done = subprocess.run([sys.executable, "-c", PROBE], capture_output=True, text=True, check=True)
    again, warm, used = json.loads(done.stdout)
    assert again == {name: {} for name in PARTS}
    assert sum(warm.values()) > 0
    assert used == warm


def test_negative_workers_are_refused() -> None:
    with pytest.raises(ValueError, match="workers"):
        next(compile_parts(-1))
