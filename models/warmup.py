"""Compile in advance the kernels of each model (``spallwatch warmup``).

Each part runs a model for a moment, which compiles its kernels or loads them from disk. Parts go to two processes where
there are two cores, because numba compiles one function at a time in a process.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field, replace

from models.machine.scene import Defect, Scene, Slip
from models.machine.speed_profile import constant

_SCENE = Scene(40.0, 4000.0, defect=Defect(dphi_d=0.1, h_d=1e-5))


@dataclass(frozen=True)
class CompiledPart:
    """Time to prepare one part.

    ``elapsed`` is wall time, imports and loading included, s; ``kernels`` are the processor seconds of the compiler by
    function, as of ``models.platform.jit.compiling``, empty if all were loaded.
    """

    name: str
    elapsed: float
    kernels: dict[str, float] = field(default_factory=dict)


def _one_scene() -> None:
    from models.solve.simulate import simulate

    simulate(_SCENE)


def _rows_of_a_map() -> None:
    from models.maps.build import build_map
    from models.maps.plan import MapPlan

    build_map(MapPlan(load=(4000.0,), speed=(40.0,), h_d=(1e-5,), dphi_d=(0.1,)))


def _many_scenes() -> None:
    from models.solve.six_dof.lanes import LaneOptions, simulate_lanes

    simulate_lanes([replace(_SCENE, slip=Slip(0.01))], LaneOptions(slip_blocks=2))


def _over_time() -> None:
    from models.solve.six_dof.time_domain import simulate_time

    # A force that turns with the shaft is left out of the machine code of scenes without one, as is a changing speed.
    steady = Scene(40.0, 1000.0)
    for scene in (steady, replace(steady, unbalance=1e-3), replace(steady, speed_profile=constant(40.0, 1.0))):
        simulate_time(scene, 0.005, 25600.0, settle=0.0)


def _impacts() -> None:
    from models.machine.bearing import from_catalogue
    from models.solve.ring_impact.rig import RingImpactRig
    from models.solve.simulate import simulate

    scene = Scene(40.0, 1000.0, bearing=from_catalogue("6205"), rig=RingImpactRig(), defect=Defect(0.02, 1e-4))
    simulate(scene, duration=0.05, rate=25600.0)


def _rotor() -> None:
    from models.machine.bearing import from_catalogue
    from models.solve.rotor.elastic import trace_elastic
    from models.solve.rotor.rig import RotorRig
    from models.solve.rotor.solver import trace

    scene = Scene(40.0, 1000.0, bearing=from_catalogue("6305"), rig=RotorRig(end_mass=0.3))
    trace(scene, 1e-3, 1e-5)
    trace_elastic(replace(scene, rig=RotorRig()), 1e-3, 1e-5)


def _balls() -> None:
    from models.machine.bearing import from_catalogue
    from models.solve.ball_inertia.rig import BallInertiaRig
    from models.solve.ball_inertia.solver import trace

    trace(Scene(40.0, 1000.0, bearing=from_catalogue("6206"), rig=BallInertiaRig()), 1e-3, 5e-6)


def _angular_speed() -> None:
    from models.machine.bearing import from_catalogue
    from models.solve.angular.rig import AngularRig
    from models.solve.angular.solver import solve, trace
    from models.solve.registry import Request

    # With such couplings, damping and governor little is simulated before the record.
    rig = AngularRig(mode_limit=5e3, coupling=1e5, damping=0.5, governor=10.0)
    scene = Scene(40.0, 1000.0, bearing=from_catalogue("6206"), rig=rig)
    trace(scene, 0.1, 1e-2)
    solve(scene, Request(duration=1e-3, rate=5120.0, accuracy=1.0))


def _gears() -> None:
    from models.dynamics.gear_pair import SOLVER
    from models.machine.bearing import from_catalogue
    from models.rigs.gear_pair import GearPairRig
    from models.solve.registry import Request

    scene = Scene(40.0, 1000.0, bearing=from_catalogue("6305"), rig=GearPairRig())
    SOLVER.solve(scene, Request(duration=1e-3, rate=5120.0, accuracy=1.0))


# The longest first, so that two processes end together; the last part reuses the kernels of the first.
PARTS: dict[str, Callable[[], None]] = {
    "one settled scene": _one_scene,
    "angular speed": _angular_speed,
    "many scenes at once": _many_scenes,
    "over time": _over_time,
    "impacts on rings": _impacts,
    "gears": _gears,
    "rotor": _rotor,
    "balls with inertia": _balls,
    "rows of a map": _rows_of_a_map,
}


def compile_part(name: str) -> CompiledPart:
    """Compile or load one of PARTS in this process.

    Raises:
        KeyError: if there is no part of that name.
    """
    began = time.perf_counter()
    from models.platform.jit import compiling

    with compiling() as kernels:
        PARTS[name]()
    return CompiledPart(name, time.perf_counter() - began, kernels)


def compile_parts(workers: int) -> Iterator[CompiledPart]:
    """Compile or load all of PARTS and yield each when it is done.

    ``workers`` is the number of processes: 1 is this one, 0 one per core; at most two are used.

    Raises:
        ValueError: if workers is negative.
    """
    if workers < 0:
        raise ValueError(f"workers must not be negative, got {workers!r}")
    workers = min(workers or os.cpu_count() or 1, 2)
    if workers == 1:
        yield from map(compile_part, PARTS)
        return
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        for done in as_completed([pool.submit(compile_part, name) for name in PARTS]):
            yield done.result()
