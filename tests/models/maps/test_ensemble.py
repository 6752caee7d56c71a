"""Ensemble maps against their definition: simulate every floor of every node, and average."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from models.machine.scene import Defect, Floor, Slip
from models.maps.build import build_map, solver_of
from models.maps.ensemble import ensemble_nodes, ensemble_options, ensemble_rms, step_error
from models.maps.file import load_map, save_map
from models.maps.plan import MapError, MapPlan, scene_at
from models.solve.response import STATUSES
from models.solve.simulate import simulate
from models.solve.six_dof.kernels.lanes import LANES
from models.solve.six_dof.lanes import LaneOptions, simulate_lanes
from models.work.choose import local_runner
from models.work.runner import SERIAL

PLAN = MapPlan(
    load=(2000.0, 4000.0),
    speed=(40.0,),
    h_d=(0.0, 8e-6, 24e-6),
    dphi_d=(0.0, math.radians(6.0), math.radians(30.0)),
    floor=Floor("rough", seed=5),
    floors=3,
    rms_band=(0.0, 9500.0),
)
COARSE = replace(PLAN, load=(4000.0,), steps_per_period=32, rms_band=None)


def test_mean_and_spread_are_those_of_the_floors() -> None:
    built = ensemble_nodes(PLAN)
    assert built.rms.shape == PLAN.shape
    assert built.harmonic_amplitude.shape == (*PLAN.shape, 6)
    for load, depth, extent in ((0, 1, 2), (1, 2, 1), (1, 0, 2), (1, 2, 0)):
        responses = [
            simulate(
                scene_at(PLAN, PLAN.load[load], 40.0, PLAN.h_d[depth], PLAN.dphi_d[extent], seed), band=PLAN.rms_band
            )
            for seed in range(PLAN.floors)
        ]
        rms = np.array([r.rms for r in responses])
        at = (load, 0, depth, extent)
        assert built.rms[at] == pytest.approx(rms.mean(), rel=5e-3)
        assert built.rms_std[at] == pytest.approx(rms.std(ddof=1), rel=5e-2, abs=5e-3 * rms.mean())
        lines = np.mean([r.harmonics for r in responses], axis=0)
        assert built.harmonic_amplitude[at] == pytest.approx(lines, abs=1e-2 * max(rms.mean(), 1e-3))
    assert built.rms_se == pytest.approx(built.rms_std / math.sqrt(3.0))
    assert np.all(built.status == STATUSES.index("converged"))
    assert np.all(built.rms_error < 2e-2 * built.rms + 1e-12)
    # Without depth or extent there is no floor to differ.
    assert np.all(built.rms_std[:, :, 0, :] < 1e-9)


def test_slip_is_simulated_in_lanes() -> None:
    plan = replace(COARSE, h_d=(8e-6, 24e-6), dphi_d=(0.1, 0.5), floors=16, slip=Slip(0.01))
    assert solver_of(replace(plan, slip=None)) == solver_of(replace(plan, slip=Slip(0.0))) == "rows"
    seen: list[tuple[int, int]] = []
    built = build_map(plan, progress=lambda done, total: seen.append((done, total)))
    assert built.attributes["solver"] == "lanes"
    assert np.array_equal(built.rms, ensemble_nodes(plan).rms)
    assert seen[-1] == (64, 64)


@pytest.mark.process
def test_floors_beyond_one_group_and_processes_change_nothing() -> None:
    plan = replace(COARSE, floors=34, slip=Slip(0.01, seed=2), h_d=(8e-6,), dphi_d=(0.1, 0.5))
    scenes = [
        replace(scene_at(plan, 4000.0, 40.0, 8e-6, 0.1, 0), slip=plan.slip, defect=Defect(0.1, 1e-6 * k))
        for k in range(1, 2 * LANES + 1)
    ]
    options = LaneOptions(steps_per_period=32, slip_blocks=2)
    with local_runner(2) as runner:
        one, two = (ensemble_nodes(plan, runner=r) for r in (SERIAL, runner))
        alone, shared = (simulate_lanes(scenes, options, runner=r) for r in (SERIAL, runner))
    assert np.array_equal(alone.rms, shared.rms)
    assert np.array_equal(alone.harmonics, shared.harmonics)
    assert np.array_equal(one.rms, two.rms)
    assert np.array_equal(one.harmonic_std, two.harmonic_std)
    assert np.all(one.status == STATUSES.index("not_periodic"))


def test_slip_is_part_of_the_plan_its_hash_and_the_file(tmp_path: Path) -> None:
    plan = replace(COARSE, floors=2, slip=Slip(0.02))
    assert plan.hash() != replace(plan, slip=None).hash() != replace(plan, slip=Slip(0.01)).hash()
    slipping = build_map(plan)
    assert not np.array_equal(slipping.rms, ensemble_nodes(replace(plan, slip=None)).rms)
    save_map(slipping, tmp_path / "map.nc")
    read = load_map(tmp_path / "map.nc")
    assert read.attributes["slip_phi_slip"] == 0.02
    assert read.attributes["slip_rule"] == "per_passage"
    assert read.plan == plan
    assert np.array_equal(read.rms_se, slipping.rms_se)


def test_a_smooth_floor_under_slip_is_averaged_over_records() -> None:
    plan = replace(COARSE, floor=Floor(), floors=4, slip=Slip(0.01), h_d=(24e-6,), dphi_d=(0.1, 0.5))
    built = build_map(plan)
    assert np.all(built.rms_std > 0.0)
    with pytest.raises(MapError, match="floors"):
        replace(plan, floors=1)
    mean_force = build_map(replace(plan, floors=1, slip=Slip(0.01, "mean_force")))
    assert np.all(mean_force.rms_std == 0.0)
    assert np.all(mean_force.status == STATUSES.index("converged"))


def test_any_point_is_the_mean_of_its_floors() -> None:
    plan = replace(PLAN, floors=18, rms_band=None)
    found = ensemble_rms(plan, (3000.0, 35.0, 5e-6, 0.3), 2, 0)
    options = ensemble_options(plan)
    assert options.steps_per_period is not None
    finer = replace(options, steps_per_period=2 * options.steps_per_period)
    scenes = [scene_at(plan, 3000.0, 35.0, 5e-6, 0.3, seed) for seed in range(18)]
    assert found == pytest.approx(simulate_lanes(scenes, finer).rms.mean(), rel=1e-3)


def test_step_error_falls_with_the_step() -> None:
    options = ensemble_options(PLAN)
    coarse, fine = step_error(PLAN, replace(options, steps_per_period=108)), step_error(PLAN, options)
    assert fine.rms < 0.3 * coarse.rms
    assert np.all(fine.lines < 0.6 * coarse.lines)
