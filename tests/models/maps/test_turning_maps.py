"""Maps of the inner race and of a ball: nodes, files, V_eq, refusals."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from netCDF4 import Dataset

from models.machine.bearing import from_catalogue
from models.machine.scene import Floor, Part, Slip
from models.maps.build import build_map, refine_plan, solver_of
from models.maps.check import check_map
from models.maps.data import RmsMap
from models.maps.file import load_map, save_map
from models.maps.nodes import point_level
from models.maps.plan import MAP_ACCURACY, MapError, MapPlan, scene_at
from models.path.contour import part_radius
from models.solve.response import STATUSES
from models.solve.simulate import simulate
from models.solve.six_dof.stationary import stationary_level
from models.work.choose import local_runner
from monitor.service.setup import to_slice

PLAN = MapPlan(
    load=(4000.0,),
    speed=(40.0,),
    h_d=(0.0, 8e-6, 12e-6, 18e-6, 24e-6),
    dphi_d=(0.0, math.radians(10), math.radians(40)),
    rms_band=(0.0, 9500.0),
)


@cache
def built(part: Part) -> RmsMap:
    return build_map(replace(PLAN, part=part))


@pytest.mark.parametrize("part", ["inner", "ball"])
def test_nodes_are_stationary_levels_and_edges_are_healthy(part: Part) -> None:
    m = built(part)
    scene = scene_at(m.plan, 4000.0, 40.0, PLAN.h_d[2], PLAN.dphi_d[2])
    assert scene.defect is not None
    assert scene.defect.part == part
    level = stationary_level(scene, accuracy=MAP_ACCURACY, band=PLAN.rms_band)
    here = (0, 0, 2, 2)
    assert (m.rms[here], m.rms_se[here], m.rms_std[here]) == (level.rms, level.rms_se, level.spread)
    assert m.rms_error[here] == level.rms_error * level.rms
    np.testing.assert_array_equal(m.harmonic_amplitude[here], level.harmonics)
    np.testing.assert_array_equal(m.harmonic_se[here], level.harmonics_se)
    healthy = simulate(replace(scene, defect=None), band=PLAN.rms_band, accuracy=MAP_ACCURACY)
    assert m.rms[0, 0, 0] == pytest.approx(healthy.rms, rel=5e-3)
    assert m.rms[0, 0, :, 0] == pytest.approx(healthy.rms, rel=5e-3)
    assert np.all(m.harmonic_amplitude[0, 0, 0] == 0.0)
    damaged = m.rms[0, 0, 1:, 1:]
    assert np.all(damaged > 50.0 * healthy.rms)
    assert np.all(m.rms_se[0, 0, 1:, 1:] <= 5e-3 * damaged)
    assert np.all(m.status[0, 0, 1:, 1:] == STATUSES.index("not_periodic"))
    assert solver_of(m.plan) == m.attributes["solver"] == "time"


def test_rms_rises_with_depth_until_the_floor_is_out_of_reach() -> None:
    """A ball sinks 11.4 um (outer race) or 16.4 um (inner race) into a spot of 10 degrees, by hand from its edges."""
    ball = built("ball").rms[0, 0, 1:, 1]
    assert ball[0] < ball[1] < ball[2]
    assert ball[2] == ball[3]
    inner = built("inner").rms[0, 0, 1:, 2]
    assert inner[0] < 0.8 * inner[3]


def test_the_volume_is_that_of_the_damaged_part() -> None:
    """1205 ETN9: r_o = 22.91 mm, r_i = 16.64 mm, balls of 7.12 mm: 0.1 rad and 10 um are 16.64e-9 m2 and 3.56e-9 m2."""
    bearing = from_catalogue("1205 ETN9")
    cases: tuple[tuple[Part, float, str], ...] = (
        ("outer", 22.91e-9, "r_o * dphi_d * h_d, r_o = 22.91 mm"),
        ("inner", 16.64e-9, "r_i * dphi_d * h_d, r_i = 16.64 mm"),
        ("ball", 3.56e-9, "r_b * dphi_d * h_d, r_b = 3.56 mm"),
    )
    for part, volume, words in cases:
        m = replace(built("inner"), attributes={"parameters": replace(PLAN, part=part).as_json()})
        assert m.part_radius == part_radius(bearing, part)
        assert m.part_radius * 0.1 * 10e-6 == pytest.approx(volume, rel=1e-12)
        assert to_slice(m, 4000.0, 40.0).volume(0.1, 10e-6) == pytest.approx(volume, rel=1e-12)
        assert m.volume_words == words


def test_a_file_says_its_part_and_comes_back_the_same(tmp_path: Path) -> None:
    for part, lines, name in (("inner", "BPFI", "inner race"), ("ball", "2 BSF", "ball")):
        path = tmp_path / f"{part}.nc"
        save_map(built(part), path)
        loaded = load_map(path)
        assert loaded.plan == built(part).plan
        assert loaded.part == part
        for values in ("rms", "rms_se", "rms_std", "rms_error", "harmonic_amplitude", "harmonic_se", "status"):
            np.testing.assert_array_equal(getattr(loaded, values), getattr(built(part), values))
        with Dataset(path) as dataset:
            assert (dataset.damaged_part, dataset.lines_of) == (part, lines)
            assert dataset.v_eq == f"r_{part[0]} * dphi_d * h_d"
            assert dataset.v_eq_radius == loaded.part_radius
            assert name in dataset.title
    with Dataset(tmp_path / "ball.nc", "r+") as dataset:
        plan = json.loads(dataset.parameters)
        dataset.parameters = json.dumps(plan | {"part": "inner"}, sort_keys=True)
    with pytest.raises(MapError, match="hash"):
        load_map(tmp_path / "ball.nc")


def test_plans_of_the_outer_race_keep_their_hash() -> None:
    assert "part" not in json.loads(PLAN.as_json())
    assert MapPlan.from_json(PLAN.as_json()) == PLAN
    inner = replace(PLAN, part="inner")
    assert MapPlan.from_json(inner.as_json()) == inner
    assert len({PLAN.hash(), inner.hash(), replace(PLAN, part="ball").hash()}) == 3


def test_floors_are_averaged_and_workers_change_nothing() -> None:
    plan = replace(PLAN, h_d=(6e-6,), dphi_d=(0.2, 0.4), part="inner", floor=Floor("rough", seed=4), floors=3)
    with local_runner(2) as runner:
        m = build_map(plan, runner=runner)
    np.testing.assert_array_equal(m.rms, build_map(plan).rms)
    levels = [point_level(plan, (4000.0, 40.0, 6e-6, 0.2), seed)[0] for seed in range(3)]
    assert m.rms[0, 0, 0, 0] == pytest.approx(np.mean(levels), rel=1e-12)
    assert m.rms_std[0, 0, 0, 0] == pytest.approx(np.std(levels, ddof=1), rel=1e-9)
    assert m.rms_se[0, 0, 0, 0] == pytest.approx(np.std(levels, ddof=1) / math.sqrt(3), rel=1e-9)


def test_axes_are_refined_and_maps_are_checked() -> None:
    plan = replace(PLAN, h_d=(10e-6, 20e-6), dphi_d=(0.1, 0.2, 0.3), part="ball")
    refined = refine_plan(plan, 0.02)
    assert refined.part == "ball"
    assert np.prod(refined.shape) > np.prod(plan.shape)
    found = check_map(built("ball"), 2)
    assert 0.0 < found.error_rms <= found.error_max < 1e-2
    assert found.interpolation_rms > 0.0


def test_an_uncertain_rig_spreads_the_level() -> None:
    m = build_map(replace(PLAN, h_d=(10e-6,), dphi_d=(0.2,), part="inner", rig_draws=3))
    assert 0.0 < m.rms_rig_std[0, 0, 0, 0] < m.rms[0, 0, 0, 0]


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"part": "innner"}, "part must be one of"),
        ({"part": "ball", "dphi_d": (0.1, 3.2)}, "dphi_d of the ball"),
        ({"part": "ball", "slip": Slip(0.01), "floors": 2}, "slip moves a ball"),
        ({"part": "inner", "slip": Slip(0.01, "mean_force")}, "mean_force"),
        ({"part": "inner", "steps_per_period": 300}, "steps_per_period"),
    ],
)
def test_plans_outside_the_model_are_refused(change: dict[str, object], word: str) -> None:
    with pytest.raises(MapError, match=word):
        replace(PLAN, **change)
