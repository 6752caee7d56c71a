"""Ensemble maps against their definition: simulate every floor of every node, and average."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from models.dynamics.lanes import LaneOptions, Slip
from models.ensemble import build_ensemble_map, ensemble_options, step_error
from models.map_build import scene_at
from models.map_data import STATUSES, MapError, MapPlan
from models.rms_map import load_map, save_map
from models.scene import Floor
from models.simulate import simulate

PLAN = MapPlan(
    load=(2000.0, 4000.0),
    speed=(40.0,),
    h_d=(0.0, 8e-6, 24e-6),
    dphi_d=(0.0, math.radians(6.0), math.radians(30.0)),
    floor=Floor("rough", seed=5),
    floors=3,
    rms_band=(0.0, 9500.0),
)


def test_mean_and_spread_are_those_of_the_floors() -> None:
    built = build_ensemble_map(PLAN)
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


def test_floors_beyond_one_group_and_processes_change_nothing() -> None:
    plan = replace(PLAN, load=(4000.0,), floors=34, steps_per_period=32, rms_band=None)
    slip = Slip(0.01, seed=2)
    one, two = (build_ensemble_map(plan, slip=slip, workers=n) for n in (1, 2))
    assert np.array_equal(one.rms, two.rms)
    assert np.array_equal(one.harmonic_std, two.harmonic_std)
    assert np.all(one.status == STATUSES.index("not_periodic"))


def test_slip_is_told_from_none_by_the_map_itself(tmp_path: Any) -> None:
    plan = replace(PLAN, load=(4000.0,), floors=2, steps_per_period=32, rms_band=None)
    none, slipping = build_ensemble_map(plan), build_ensemble_map(plan, slip=Slip(0.02))
    assert not any(name.startswith("slip_") for name in none.attributes)
    assert not np.array_equal(none.rms, slipping.rms)
    save_map(slipping, tmp_path / "map.nc")
    read = load_map(tmp_path / "map.nc")
    assert read.attributes["slip_phi_slip"] == 0.02
    assert read.attributes["slip_rule"] == "per_passage"
    assert read.plan == plan
    assert np.array_equal(read.rms_se, slipping.rms_se)


def test_progress_counts_every_scene() -> None:
    seen: list[tuple[int, int]] = []
    build_ensemble_map(
        replace(PLAN, floors=2, steps_per_period=32, rms_band=None),
        progress=lambda done, total: seen.append((done, total)),
    )
    assert seen[-1] == (36, 36)


def test_step_error_falls_with_the_step() -> None:
    options = ensemble_options(PLAN)
    coarse = step_error(PLAN, replace(options, steps_per_period=108))
    assert step_error(PLAN, options) < 0.3 * coarse


@pytest.mark.parametrize(
    ("change", "options"),
    [
        ({"floors": 1}, None),
        ({}, LaneOptions(band=(0.0, 100.0))),
        ({}, LaneOptions(slip=Slip(0.1), band=(0.0, 9500.0))),
    ],
)
def test_contradictions_are_refused(change: dict[str, Any], options: LaneOptions | None) -> None:
    with pytest.raises(MapError, match="ensemble map"):
        build_ensemble_map(replace(PLAN, **change), options=options)
