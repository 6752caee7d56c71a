"""Maps by models other than the six-degree-of-freedom one: nodes, file, and what is refused."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from models.machine.bearing import catalogue_entry, kinematics
from models.machine.scene import Defect, Floor, Scene
from models.maps import plan as plan_module
from models.maps.build import build_map, solver_of
from models.maps.check import check_map
from models.maps.data import RmsMap
from models.maps.file import load_map, save_map
from models.maps.model_nodes import model_level
from models.maps.nodes import drawn_rig
from models.maps.plan import MapError, MapPlan, scene_at
from models.solve.angular.rig import AngularRig
from models.solve.ball_inertia.rig import BallInertiaRig
from models.solve.nominal_rigs import nominal_rig
from models.solve.ring_impact.rig import RingImpactRig
from models.solve.rotor.rig import RotorRig
from models.solve.simulate import simulate
from models.work.choose import local_runner
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
