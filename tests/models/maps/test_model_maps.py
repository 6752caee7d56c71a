"""Maps by models other than the six-degree-of-freedom one: nodes, file, and what is refused.

Ensemble maps against their definition: simulate every floor of every node, and average.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from models.machine.bearing import catalogue_entry, kinematics
from models.machine.scene import Defect, Floor, Scene, Slip
from models.maps import plan as plan_module
from models.maps.build import build_map, solver_of
from models.maps.check import check_map
from models.maps.data import RmsMap
from models.maps.ensemble import ensemble_nodes, ensemble_options, ensemble_rms, step_error
from models.maps.file import load_map, save_map
from models.maps.model_nodes import model_level
from models.maps.nodes import drawn_rig
from models.maps.plan import MapError, MapPlan, scene_at
from models.solve.angular.rig import AngularRig
from models.solve.ball_inertia.rig import BallInertiaRig
from models.solve.nominal_rigs import nominal_rig
from models.solve.response import STATUSES
from models.solve.ring_impact.rig import RingImpactRig
from models.solve.rotor.rig import RotorRig
from models.solve.simulate import simulate
from models.solve.six_dof.kernels.lanes import LANES
from models.solve.six_dof.lanes import LaneOptions, simulate_lanes
from models.work.choose import local_runner
from models.work.runner import SERIAL
from tests.support.effort import effort_count

ENTRY = catalogue_entry("6205")
EXTENTS = tuple(math.radians(x) for x in (0.0, 2.0, 8.0, 14.0))
DEPTHS = (0.0, 5e-6, 15e-6)
BAND = (0.0, 9500.0)


def plan_of(kind: type[RotorRig | BallInertiaRig] = RotorRig) -> MapPlan:
    rig = nominal_rig(kind, ENTRY)
    return MapPlan((4000.0,), (40.0,), DEPTHS, EXTENTS, bearing=ENTRY.bearing, rig=rig, model=kind.model, rms_band=BAND)


@pytest.fixture(scope="module")
def rotor() -> RmsMap:
    return build_map(plan_of())


def test_a_node_is_the_scene_of_its_place(rotor: RmsMap) -> None:
    plan = rotor.plan
    scene = Scene(40.0, 4000.0, ENTRY.bearing, plan.rig, Defect(EXTENTS[2], DEPTHS[1]), clearance=0.0, model="rotor")
    assert scene_at(plan, 4000.0, 40.0, DEPTHS[1], EXTENTS[2]).effects == scene.effects
    found = simulate(scene, accuracy=1e-4, band=BAND, duration=1.0)
    assert rotor.rms[0, 0, 1, 2] == pytest.approx(found.rms, rel=2e-3)
    assert found.record is not None
    lines = [found.record.line(k * kinematics(ENTRY.bearing, 40.0).bpfo) for k in range(1, 7)]
    np.testing.assert_allclose(rotor.harmonic_amplitude[0, 0, 1, 2], lines, atol=0.02 * found.rms)


def test_nodes_without_damage_are_those_of_the_healthy_bearing(rotor: RmsMap) -> None:
    healthy = rotor.rms[0, 0, 0, 0]
    assert np.all(rotor.rms[0, 0, 0, :] == healthy)
    assert np.all(rotor.rms[0, 0, :, 0] == healthy)
    assert np.all(rotor.rms[0, 0, 1:, 1:] > 10.0 * healthy)


def test_the_file_names_the_model_its_version_and_its_sensor(rotor: RmsMap, tmp_path: Path) -> None:
    save_map(rotor, tmp_path / "m.nc")
    read = load_map(tmp_path / "m.nc")
    assert read.plan == rotor.plan
    assert isinstance(read.plan.rig, RotorRig)
    named = {name: read.attributes[name] for name in ("model", "model_version", "sensor", "solver")}
    assert named == {"model": "rotor", "model_version": 1, "sensor": "a", "solver": "scenes"}
    assert read.attributes["rig_k_c"] == pytest.approx(read.plan.rig.k_c)


def test_another_version_of_the_model_is_another_map(
    rotor: RmsMap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_map(rotor, tmp_path / "m.nc")
    monkeypatch.setitem(plan_module.OTHER_VERSIONS, "rotor", 2)
    with pytest.raises(MapError, match="this version of the model; build the map anew"):
        load_map(tmp_path / "m.nc")


def test_its_errors_are_measured_with_the_model(rotor: RmsMap) -> None:
    found = check_map(rotor, 3)
    assert found.error_max < 4e-3
    assert math.isfinite(found.interpolation_rms)


@pytest.mark.parametrize("workers", [1, 2])
def test_the_result_does_not_depend_on_the_workers(workers: int) -> None:
    plan = replace(plan_of(BallInertiaRig), dphi_d=EXTENTS[:3], h_d=DEPTHS[:2])
    done: list[tuple[int, int]] = []
    with local_runner(workers) as runner:
        built = build_map(plan, runner=runner, progress=lambda n, total: done.append((n, total)))
    assert done[-1] == (6, 6)
    level = model_level(plan, (4000.0, 40.0, DEPTHS[1], EXTENTS[2]))
    assert built.rms[0, 0, 1, 2] == level.rms
    assert level.sensor == "a"


def test_a_defect_of_the_inner_race_has_its_own_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("models.maps.model_nodes._DURATIONS", (0.25, effort_count(quick=1, full=4)))
    plan = replace(plan_of(), part="inner", dphi_d=EXTENTS[2:3], h_d=DEPTHS[1:2])
    built = build_map(plan)
    scene = scene_at(plan, 4000.0, 40.0, DEPTHS[1], EXTENTS[2])
    record = simulate(scene, duration=effort_count(quick=1, full=4)).record
    assert record is not None
    first = record.line(kinematics(ENTRY.bearing, 40.0).bpfi)
    assert built.harmonic_amplitude[0, 0, 0, 0, 0] == pytest.approx(first, rel=0.1)
    assert built.rms_se[0, 0, 0, 0] > 0.0


def test_the_level_of_a_shaft_over_its_angle_is_an_acceleration() -> None:
    rig = AngularRig(mode_limit=10e3, coupling=8000.0, damping=0.06, governor=0.3)
    plan = replace(plan_of(), rig=rig, model="angular", dphi_d=EXTENTS[2:3], h_d=DEPTHS[1:2])
    level = model_level(plan, (4000.0, 40.0, DEPTHS[1], EXTENTS[2]))
    assert level.sensor == "a"
    found = simulate(scene_at(plan, 4000.0, 40.0, DEPTHS[1], EXTENTS[2]), accuracy=2e-3, band=BAND, duration=0.25)
    assert level.rms == pytest.approx(found.levels_of("a")[0], rel=1e-6)
    assert found.record is not None
    assert level.harmonics[0] == pytest.approx(found.record.line(found.bpfo, "a"), rel=0.1)


def test_draws_move_what_is_uncertain_of_the_model() -> None:
    plan = replace(plan_of(), rig_draws=3, dphi_d=EXTENTS[2:3], h_d=DEPTHS[1:2])
    drawn = drawn_rig(plan, 1)
    assert isinstance(drawn, RotorRig)
    for name in RotorRig.uncertain:
        assert 0.8 < getattr(drawn, name) / getattr(plan.rig, name) < 1.25
        assert getattr(drawn, name) != getattr(plan.rig, name)
    built = build_map(plan)
    assert 0.001 < built.rms_rig_std[0, 0, 0, 0] / built.rms[0, 0, 0, 0] < 0.5
    assert "k_r" not in plan.rig_spread_words


def test_second_bearing_and_axial_load_are_of_the_plan() -> None:
    plan = plan_of()
    other = replace(plan, second_bearing=catalogue_entry("6305").bearing)
    assert MapPlan.from_json(other.as_json()) == other
    assert scene_at(other, 4000.0, 40.0, 0.0, 0.0).second_bearing == other.second_bearing
    pushed = replace(plan, axial_load=100.0)
    assert MapPlan.from_json(pushed.as_json()) == pushed
    assert len({plan.hash(), other.hash(), pushed.hash()}) == 3
    with pytest.raises(MapError, match="axial_load: rotor does not describe this"):
        build_map(replace(pushed, dphi_d=EXTENTS[2:], h_d=DEPTHS[1:]))


def test_a_model_without_depth_is_refused_with_those_that_have_it() -> None:
    with pytest.raises(MapError, match=r"cannot be told by the model ring_impact: .* depth: six_dof, .*rotor"):
        replace(plan_of(), rig=RingImpactRig(), model="ring_impact")


def test_the_model_is_that_of_the_rig() -> None:
    with pytest.raises(MapError, match="model is 'six_dof', but the rig is that of rotor"):
        replace(plan_of(), model="six_dof")


def test_what_the_model_does_not_describe_is_refused_before_the_first_node() -> None:
    rough = replace(plan_of(), floor=Floor(kind="rough"), floors=2)
    with pytest.raises(MapError, match=r"rough_floor: rotor does not describe this .*: six_dof"):
        build_map(rough)
    assert solver_of(rough) == "scenes"


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
    assert np.all(fine.lines < 0.8 * coarse.lines)
