"""``[gear]`` as a train of the model: what each key becomes, and which are missing."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from models.gears.teeth.faults import Eccentricity, GearFault, PitchError, Pitting, ProfileError, ToothCrack, ToothSpall
from models.gears.teeth.geometry import GearPair, ToothedWheel
from models.gears.teeth.mesh import begin_of_mesh, turns_between
from models.gears.teeth.stiffness import mesh_stiffness
from models.gears.train.parts import GearTrain
from monitor.config.fields import LocatedError
from monitor.config.load import validate
from monitor.gears.config.section import GearSection
from monitor.gears.config.train import TrainBuilder
from tests.support.config import MINIMAL
from tests.support.config_gear_train import APPENDIX, changed

_MM, _UM = 1e-3, 1e-6
TOOTHED = {"face_width_mm": 30.0, "bore_mm": 60.0}


def without(*keys: str) -> dict[str, Any]:
    return {key: value for key, value in APPENDIX.items() if key not in keys}


def build(tables: dict[str, Any], speed: float = 8.44) -> GearTrain:
    return TrainBuilder(GearSection.model_validate(tables), speed).build()


def test_the_appendix_turns_at_943_newton_metres() -> None:
    # 50 kW at 8.44 Hz: 942.9 N m; the mesh at 37 times 8.44 Hz.
    train = build(APPENDIX)
    assert train.drive_torque() == pytest.approx(942.86, abs=0.01)
    assert train.torques()["driven"] == pytest.approx(-942.86, abs=0.01)
    assert train.mesh_frequencies() == pytest.approx({"1-3": 312.28, "3-5": 312.28})
    assert [mesh.damping for mesh in train.meshes] == pytest.approx([77300.0, 386500.0], rel=1e-3)
    assert train.wheels[0].base_radius == pytest.approx(0.074 * math.cos(math.radians(20.0)))


def test_torque_and_power_say_the_same_whatever_shaft_the_speed_is_of() -> None:
    wheels = [{**wheel, "teeth": teeth} for wheel, teeth in zip(APPENDIX["wheel"], (20, 40, 30), strict=True)]
    base = {**APPENDIX, "wheel": wheels, "bearing_shaft": "intermediate"}
    train = build(base, speed=5.0)
    assert train.speeds() == pytest.approx({"driver": 10.0, "intermediate": 5.0, "driven": 20.0 / 3.0})
    torque = 5e4 / (2 * math.pi * 10.0)
    assert train.drive_torque() == pytest.approx(torque)
    by_torque = build({**{k: v for k, v in base.items() if k != "power_kw"}, "torque_newton_m": torque}, speed=5.0)
    assert by_torque.torques() == pytest.approx(train.torques())
    loads = [{**shaft, "load_torque_newton_m": 100.0} if n else shaft for n, shaft in enumerate(base["shaft"])]
    both = build({**{k: v for k, v in base.items() if k != "power_kw"}, "shaft": loads}, speed=5.0)
    assert both.drive_torque() == pytest.approx(100.0 * 0.5 + 100.0 * 2.0 / 3.0)


def test_the_force_on_each_driven_wheel_turns_it_as_it_turns() -> None:
    # Whatever the first shaft's sense: the moment of the force about the driven wheel has the sign of its turning.
    for forward in (True, False):
        train = build({**APPENDIX, "turns_from_x_to_y": forward})
        for mesh, opposite in zip(train.meshes, (True, False), strict=True):
            # The contact lies at the pitch point, seen from the driven wheel in the direction of the driver, -x.
            moment = -math.sin(mesh.line_of_action)
            assert (moment > 0.0) is (forward is not opposite)


@pytest.mark.parametrize("direction", [0.0, 70.0, 180.0])
def test_an_idler_gives_its_second_mesh_a_phase(direction: float) -> None:
    wheels = [{**wheel, **TOOTHED} for wheel in APPENDIX["wheel"]]
    pairs = [APPENDIX["pair"][0], {**APPENDIX["pair"][1], "direction_deg": direction}]
    first, second = build({**APPENDIX, "wheel": wheels, "pair": pairs}).meshes
    assert (first.driver_start, first.driven_start) == (0.0, 0.0)
    pair = GearPair(ToothedWheel(37, 0.03, 0.03), ToothedWheel(37, 0.03, 0.03), 0.004)
    one = begin_of_mesh(pair, 0.0, counterclockwise=True)[1]
    two = begin_of_mesh(pair, math.radians(direction), counterclockwise=False)[0]
    # The idler turns clockwise: a tooth that began the second mesh so many turns before stands there by now.
    pitches = (two - one - math.tau * second.driver_start) / (math.tau / 37)
    assert pitches == pytest.approx(round(pitches), abs=1e-9)
    given = build({**APPENDIX, "wheel": wheels, "pair": [pairs[0], {**pairs[1], "phase_pitches": 0.25}]}).meshes[1]
    assert given.driver_start * 37 == pytest.approx(0.25)


@pytest.mark.parametrize("counterclockwise", [True, False])
def test_flanks_touch_where_a_tooth_begins_its_mesh(counterclockwise: bool) -> None:
    """Both flanks, placed by their centre lines, pass through A; the tip of the driven wheel is there."""
    pair = GearPair(
        ToothedWheel(23, 0.02, 0.01, profile_shift=0.3), ToothedWheel(71, 0.02, 0.02), 0.003, centre_distance=0.1423
    )
    to_driven = 0.4
    lines = begin_of_mesh(pair, to_driven, counterclockwise=counterclockwise)
    centres = (0.0, pair.distance * np.exp(1j * to_driven))
    tip = pair.profiles[1].tip_radius
    touched: list[complex] = []
    for side, (profile, line, centre) in enumerate(zip(pair.profiles, lines, centres, strict=True)):
        radius = tip if side else math.hypot(profile.base_radius, pair.contact_path[0])
        half = float(profile.half_angle(radius))
        # The driver pushes with the flank ahead of its centre line, on the one behind of the driven wheel: both lie
        # on the same side, as the wheels turn against each other.
        sign = 1.0 if counterclockwise else -1.0
        touched.append(centre + radius * np.exp(1j * (line + sign * half)))
    assert abs(touched[0] - touched[1]) < 1e-12


def test_turns_between_directions_count_in_the_sense_of_the_wheel() -> None:
    assert turns_between(0.0, math.pi / 2.0, counterclockwise=True) == pytest.approx(0.25)
    assert turns_between(0.0, math.pi / 2.0, counterclockwise=False) == pytest.approx(-0.25)


def test_geometry_gives_the_backlash_of_its_centre_distance() -> None:
    wheels = [{**wheel, **TOOTHED} for wheel in APPENDIX["wheel"]]
    pairs = [{**pair, "centre_distance_mm": 148.1} for pair in APPENDIX["pair"]]
    train = build({**APPENDIX, "wheel": wheels, "pair": pairs})
    pair = GearPair(ToothedWheel(37, 0.03, 0.03), ToothedWheel(37, 0.03, 0.03), 0.004, centre_distance=0.1481)
    assert train.meshes[0].backlash == pytest.approx(pair.backlash)
    assert build(changed("pair", 0, backlash_um=80.0)).meshes[0].backlash == pytest.approx(80e-6)
    assert build(APPENDIX).meshes[0].backlash == math.inf


def test_stiffness_is_given_as_a_mean_a_share_or_a_course(tmp_path: Path) -> None:
    mesh = build(changed("pair", 0, stiffness_variation=0.3, contact_ratio=1.6)).meshes[0].stiffness
    assert mesh.mean == pytest.approx(7.73e8)
    assert np.ptp(mesh.base) == pytest.approx(0.3 * 7.73e8)
    course = tmp_path / "k.csv"
    course.write_text("pitch,stiffness_newton_per_m\n0,2e8\n0.5,4e8\n")
    mesh = build(changed("pair", 0, stiffness_csv=str(course))).meshes[0].stiffness
    assert (mesh.mean, mesh.base.max() / mesh.base.min()) == (pytest.approx(7.73e8), pytest.approx(2.0))
    mesh = build(changed("pair", 0, stiffness_csv=str(course), stiffness_newton_per_m=None)).meshes[0].stiffness
    assert mesh.mean == pytest.approx(3e8)


def toothed(**more: object) -> dict[str, Any]:
    """Return the train with stiffness from its teeth."""
    wheels = [{**wheel, **TOOTHED} for wheel in APPENDIX["wheel"]]
    pairs = [{key: value for key, value in p.items() if key != "stiffness_newton_per_m"} for p in APPENDIX["pair"]]
    return {**APPENDIX, "wheel": wheels, "pair": pairs, **more}


def test_stiffness_follows_from_the_teeth_at_the_mean_force() -> None:
    pair = GearPair(ToothedWheel(37, 0.03, 0.03), ToothedWheel(37, 0.03, 0.03), 0.004)
    train = build(toothed())
    expected = mesh_stiffness(pair, train.drive_torque() / pair.base_radii[0])
    np.testing.assert_allclose(train.meshes[0].stiffness.base, expected.base, rtol=1e-9)
    scaled = build({**toothed(), "pair": APPENDIX["pair"]}).meshes[0].stiffness
    assert scaled.mean == pytest.approx(7.73e8)
    np.testing.assert_allclose(scaled.base / scaled.mean, expected.base / expected.mean, rtol=1e-9)


@pytest.mark.parametrize(
    ("fault", "made"),
    [
        (
            {"kind": "crack", "tooth": 3, "depth_mm": 2.0, "angle_deg": 60.0},
            ToothCrack(3, _MM * 2.0, math.radians(60.0)),
        ),
        (
            {"kind": "spall", "depth_mm": 0.1, "length_mm": 1.0, "width_mm": 9.0},
            ToothSpall(0, _MM, _MM * 9.0, _MM * 0.1),
        ),
        ({"kind": "pitting", "share": 0.2, "length_mm": 2.0}, Pitting(0, 0.2, _MM * 2.0)),
        ({"kind": "pitch", "tooth": 5, "error_um": 12.0}, PitchError.of_tooth(37, 5, _UM * 12.0)),
        ({"kind": "pitch", "seed": 5, "error_um": 12.0}, PitchError.drawn(37, _UM * 12.0, 5)),
        ({"kind": "eccentricity", "error_um": 30.0, "phase_deg": 90.0}, Eccentricity(_UM * 30.0, math.pi / 2)),
        ({"kind": "profile", "slope_um": -8.0, "waves": 3.0}, ProfileError(slope=_UM * -8.0, waves=3.0)),
    ],
)
def test_each_kind_of_fault_becomes_one_of_its_wheel(fault: dict[str, Any], made: GearFault) -> None:
    gear = GearSection.model_validate(toothed(fault=[{"wheel": "3", **fault}]))
    assert gear.fault[0].to_fault(37) == made
    sound, faulty = build(toothed()), TrainBuilder(gear, 8.44).build()
    # Wheel 3 is driven in the first mesh and drives the second.
    for mesh, other, side in zip(faulty.meshes, sound.meshes, ("driven", "driver"), strict=True):
        tables = [getattr(mesh.stiffness, f"{side}_{kind}") for kind in ("loss", "error")]
        assert any(table is not None and table.any() for table in tables)
        opposite = "driver" if side == "driven" else "driven"
        assert getattr(mesh.stiffness, f"{opposite}_loss") is None
        np.testing.assert_allclose(mesh.stiffness.base, other.stiffness.base, rtol=1e-12)


def test_a_fault_is_said_with_its_sizes() -> None:
    faults = [
        {"wheel": "3", "kind": "crack", "tooth": 3, "depth_mm": 2.5},
        {"wheel": "1", "kind": "pitting", "share": 0.2, "length_mm": 2.0},
        {"wheel": "1", "kind": "profile", "slope_um": -8.0},
    ]
    assert [fault.words for fault in GearSection.model_validate(toothed(fault=faults)).fault] == [
        "crack of tooth 3 of wheel 3, depth 2.5 mm",
        "pitting of wheel 1, length 2 mm, share 0.2",
        "profile of wheel 1, slope -8 µm",
    ]


def test_an_eccentricity_needs_no_teeth() -> None:
    fault = {"wheel": "1", "kind": "eccentricity", "error_um": 30.0}
    error = build({**APPENDIX, "fault": [fault]}).meshes[0].stiffness.driver_error
    assert error is not None
    assert (error.max(), error.min()) == (pytest.approx(3e-5), pytest.approx(-3e-5, rel=1e-3))


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ({"kind": "crack"}, "kind = 'crack' needs depth_mm"),
        ({"kind": "crack", "depth_mm": 2.0, "share": 0.5}, "share is no key of kind = 'crack'; expected angle_deg"),
        ({"kind": "profile", "tooth": 1}, "needs slope_um, crown_um or waviness_um"),
        ({"kind": "pitch", "error_um": 5.0}, "needs tooth, or seed"),
        ({"kind": "pitch", "error_um": 5.0, "seed": 1, "tooth": 1}, "needs tooth, or seed"),
        ({"kind": "eccentricity", "error_um": -5.0}, "must not be negative"),
        ({"kind": "tooth", "error_um": -5.0}, "Input should be 'crack'"),
        ({"kind": "crack", "depth_mm": 2.0, "wheel": "9"}, "wheel '9' is not one of 1, 3, 5"),
    ],
)
def test_a_fault_that_cannot_be_is_refused(fault: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        GearSection.model_validate(toothed(fault=[{"wheel": "3", **fault}]))


@pytest.mark.parametrize(
    ("tables", "place", "said"),
    [
        (toothed(fault=[{"wheel": "1", "kind": "crack", "tooth": 37, "depth_mm": 1.0}]), ("fault", 0), "0 to 36"),
        ({**APPENDIX, "fault": [{"wheel": "1", "kind": "crack", "depth_mm": 1.0}]}, ("fault", 0), "face_width_mm"),
        (toothed(fault=[{"wheel": "1", "kind": "crack", "depth_mm": 40.0}]), ("pair", 0), "crack depth"),
        (toothed(load="intermediate"), ("pair", 1), "no torque passes this mesh"),
    ],
)
def test_a_fault_or_torque_that_does_not_fit_its_mesh_is_named(
    tables: dict[str, Any], place: tuple[str | int, ...], said: str
) -> None:
    with pytest.raises(LocatedError) as raised:
        build(tables)
    assert [at for at, text in raised.value.problems if said in text] == [place]


def test_bearings_of_the_configuration_or_the_catalogue_carry_a_shaft() -> None:
    supports = [{"name": s["name"], "shaft": s["shaft"], "bearing": "6311"} for s in APPENDIX["support"]]
    config = validate({**MINIMAL, "gear": {**APPENDIX, "support": supports}}, Path("machine.toml"))
    assert isinstance(config.gear, GearSection)
    first, second, _ = TrainBuilder(config.gear, 8.44, config).build().bodies
    (along, _), (_, across) = first.supports[0].stiffness
    # The force on the first shaft is mostly along y, where its bearing is stiffer; the idler carries twice as much.
    assert across > along > 1e8
    assert second.supports[0].stiffness[1][1] > across
    supports[0] |= {"bearing": MINIMAL["bearing"][0]["name"], "clearance_um": 20.0}
    config = validate({**MINIMAL, "gear": {**APPENDIX, "support": supports}}, Path("machine.toml"))
    assert isinstance(config.gear, GearSection)
    assert (
        TrainBuilder(config.gear, 8.44, config).build().bodies[0].supports[0].stiffness != first.supports[0].stiffness
    )


@pytest.mark.parametrize(
    ("support", "said"),
    [
        ({}, "give stiffness_newton_per_m, or bearing"),
        ({"bearing": "6311", "stiffness_newton_per_m": 1e8}, "give stiffness_newton_per_m, or bearing"),
        ({"clearance_um": 5.0, "stiffness_newton_per_m": 1e8}, "clearance_um belongs to bearing"),
    ],
)
def test_a_support_has_one_stiffness(support: dict[str, Any], said: str) -> None:
    supports = [{"name": "b0", "shaft": "driver", **support}, *APPENDIX["support"][1:]]
    with pytest.raises(ValueError, match=re.escape(said)):
        GearSection.model_validate({**APPENDIX, "support": supports})


def test_an_unknown_bearing_is_named() -> None:
    supports = [{"name": "b0", "shaft": "driver", "bearing": "6999"}, *APPENDIX["support"][1:]]
    with pytest.raises(LocatedError, match=r"6999.*or the name of a") as raised:
        build({**APPENDIX, "support": supports})
    assert raised.value.problems[0][0] == ("support", 0, "bearing")


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        (without("shaft"), ["shaft", "name = 'driver'", "mass and inertia"]),
        (changed("shaft", 1, mass_kg=None), ["('shaft', 1, 'mass_kg')", "missing", "'intermediate'", "fixed_axis"]),
        (changed("shaft", 1, inertia_kg_m2=None), ["inertia_kg_m2", "missing", "constant_speed"]),
        (changed("support", 1, shaft="driven"), ["support", "'intermediate'", "at least one"]),
        (changed("shaft", 1, fixed_axis=True), ["support", "'intermediate'", "expected none"]),
        (changed("pair", 1, module_mm=None), ["('pair', 1, 'module_mm')", "'3' and '5'"]),
        (changed("pair", 1, stiffness_newton_per_m=None), ["stiffness_newton_per_m", "stiffness_csv", "'3' and '5'"]),
        (changed("pair", 1, module_mm=5.0), ["wheel '3' has another module"]),
        (changed("pair", 1, centre_distance_mm=120.0), ["centre_distance_mm", "139.07", "120"]),
        (changed("pair", 1, wheels=["5", "3"]), ["('pair', 1, 'wheels')", "'3' drives '5'", '["3", "5"]']),
        (without("power_kw"), ["torque_newton_m, power_kw and load_torque", "found none"]),
        ({**APPENDIX, "torque_newton_m": 9.0}, ["found torque_newton_m, power_kw"]),
        ({**APPENDIX, "load": "driver"}, ["another shaft than the drive"]),
        ({**APPENDIX, "drive": "intermediate"}, ["('load',)", "driver, driven", "'3' drives '1'"]),
        (without("beta_c_s"), ["beta_c_s", "no motion settles"]),
    ],
)
def test_a_missing_key_is_named(tables: dict[str, Any], said: list[str]) -> None:
    with pytest.raises(LocatedError) as raised:
        build(tables)
    found = "\n".join(f"{place} {text}" for place, text in raised.value.problems)
    for words in said:
        assert words in found


def test_a_shaft_that_nothing_joins_is_refused() -> None:
    with pytest.raises(ValueError, match="no wheel is on shaft 'drivr'"):
        GearSection.model_validate(changed("shaft", 0, name="drivr"))


def test_all_problems_of_geometry_name_the_pair() -> None:
    wheels = [{**wheel, **TOOTHED, "teeth": 12} for wheel in APPENDIX["wheel"]]
    with pytest.raises(LocatedError, match="'1' and '3': driver profile_shift must be at least"):
        build({**APPENDIX, "wheel": wheels})
