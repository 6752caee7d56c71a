"""Maps, lives and candidates are the same in a plain loop, as chunks of a store, and resumed half-way."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from models.identify import evaluate
from models.identify.evaluate import Evaluator
from models.identify.trials import Condition
from models.lives.life import simulate_life, simulate_lives
from models.lives.population import Population
from models.machine.rig import Rig
from models.machine.scene import Defect, Floor, Scene, Slip
from models.maps.build import build_map, refine_plan
from models.maps.check import check_map, mean_levels
from models.maps.data import RmsMap
from models.maps.ensemble import ensemble_nodes
from models.maps.plan import MapPlan
from models.solve.six_dof.kernels.lanes import LANES
from models.solve.six_dof.lane_group import Group, Workspace, group_bytes
from models.solve.six_dof.lanes import LaneOptions, shared_grid, simulate_lanes
from models.work.choose import local_runner
from models.work.codec import encode
from models.work.folder_store import FolderStore
from models.work.pool import SerialExecutor
from models.work.runner import SERIAL, Runner
from models.work.task import CHUNK_SECONDS, MIN_CHUNKS, Work
from tests.models.identify.cases import BAND, space_of

PLAN = MapPlan(
    load=(4000.0,), speed=(40.0,), h_d=(0.0, 10e-6, 20e-6), dphi_d=(0.0, 0.1, 0.2), rms_band=BAND, rig_draws=2
)
SLIPPING = replace(PLAN, slip=Slip(0.01), floor=Floor("rough", seed=3), floors=2, h_d=(10e-6,), rig_draws=0)
POPULATION = replace(Population(), durations=(3600.0, 3600.0), slip=(0.0, 0.0))
LOADS = (1000.0, 2000.0)
CONDITIONS = tuple(Condition(load, 40.0, extent, 5e-4) for load in LOADS for extent in (0.04, 0.08))


def arrays_of(rms_map: RmsMap) -> bytes:
    """Return all values of a map and its measured errors as bytes."""
    told = {name: rms_map.attributes[name] for name in sorted(rms_map.attributes) if name != "created"}
    values = {name: value for name, value in vars(rms_map).items() if isinstance(value, np.ndarray)}
    return encode((values, repr(told)))


@cache
def built() -> RmsMap:
    return build_map(PLAN)


def a_map(runner: Runner) -> bytes:
    return arrays_of(build_map(PLAN, runner=runner))


def slipping_scenes(runner: Runner) -> bytes:
    points = [(n, (4000.0, 40.0, 10e-6, 0.1)) for n in range(2)]
    nodes = ensemble_nodes(SLIPPING, runner=runner)
    scenes = [Scene(40.0, 4000.0, defect=Defect(0.1, 1e-5 + 1e-7 * i), slip=SLIPPING.slip) for i in range(LANES + 1)]
    response = simulate_lanes(scenes, LaneOptions(slip_blocks=2), runner=runner)
    return encode((vars(nodes), list(mean_levels(SLIPPING, points, runner=runner)), vars(response)))


def a_check(runner: Runner) -> bytes:
    return encode((check_map(built(), 2, runner=runner), refine_plan(PLAN, 0.2, runner=runner).dphi_d))


def lives(runner: Runner) -> bytes:
    return encode(list(simulate_lives(POPULATION, [4, 0, 2], runner)))


def candidates(runner: Runner) -> bytes:
    evaluator = Evaluator(space_of("m_r", rig=Rig(), loads=LOADS), CONDITIONS, BAND, runner)
    known = evaluator.space.known
    return encode(evaluator.levels([{**known, "m_r": known["m_r"] * (1.0 - 1e-3 * i)} for i in range(5)]))


KINDS: tuple[Callable[[Runner], bytes], ...] = (a_map, slipping_scenes, a_check, lives, candidates)


@pytest.mark.parametrize("result_of", KINDS)
def test_chunks_and_resuming_change_no_bit(
    result_of: Callable[[Runner], bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(evaluate, "_SENT_SECONDS", 0.0)
    monkeypatch.setattr(evaluate, "_CHUNK_SECONDS", 1e-3)
    whole, store = result_of(SERIAL), FolderStore(tmp_path)
    with Runner(SerialExecutor(), store) as runner:
        assert result_of(runner) == whole
    chunks = runner.tally.chunks
    kept = sorted(store.names("chunks/"))
    # Chunks of equal tasks are one file.
    assert 1 < len(kept) <= chunks
    for name in kept[::2]:
        store.delete(name)
    with Runner(SerialExecutor(), store, resume=True) as runner:
        assert result_of(runner) == whole
    assert runner.tally.chunks == chunks
    assert len(kept) // 2 <= runner.tally.kept < chunks


def test_threads_change_no_bit() -> None:
    with local_runner(3) as runner:
        assert a_map(runner) == a_map(SERIAL)
        assert candidates(runner) == candidates(SERIAL)


def test_few_candidates_are_not_sent(tmp_path: Path) -> None:
    with Runner(SerialExecutor(), FolderStore(tmp_path)) as runner:
        evaluator = Evaluator(space_of("m_r", rig=Rig(), loads=LOADS), CONDITIONS, BAND, runner)
        evaluator.levels([evaluator.space.known])
    assert runner.tally.chunks == 0


@pytest.mark.parametrize("rule", ["per_passage", "mean_force"])
@pytest.mark.parametrize(("extent", "slip"), [(0.0, 0.0), (0.3, 0.01), (0.9, 0.05)])
def test_the_memory_of_a_group_is_stated(extent: float, slip: float, rule: str) -> None:
    scene = Scene(40.0, 4000.0, defect=Defect(extent, 1e-5), slip=Slip(slip, rule) if slip else None)  # pyright: ignore[reportArgumentType]
    workspace = Workspace()
    Group(shared_grid([scene], LaneOptions()), [scene] * LANES, scene.slip, workspace)
    kept = 8 * (workspace._tables.size + workspace._wave.size)
    assert kept < group_bytes(scene.bearing, scene.speed, (extent, 1), scene.slip, None) < 2 * kept + 64e6


def test_chunks_follow_from_the_tasks_alone() -> None:
    work = Work("lives", simulate_life, memory=1)
    assert work.sized(0.1).per_chunk == round(CHUNK_SECONDS / 0.1)
    assert work.sized(0.1, 10 * MIN_CHUNKS).per_chunk == 10
    assert work.sized(0.1, MIN_CHUNKS - 1).per_chunk == work.sized(math.inf).per_chunk == 1
    assert work.sized(0.1, chunk=0.5).per_chunk == 5
