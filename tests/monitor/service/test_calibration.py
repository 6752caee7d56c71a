"""From ``[rig]``, maps and libraries to whether V_eq of a channel is that of its machine, and what is said of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from models.lives.population import Population
from models.machine.rig import Calibration, Claim, Rig
from models.maps.build import build_map
from models.maps.data import RmsMap
from models.maps.file import save_map
from models.maps.plan import MapPlan
from models.solve.rotor.rig import RotorRig
from monitor.config.bearing import RigSection
from monitor.config.load import Config, validate
from monitor.desk.judge.problems import find_problems
from monitor.service.machine_status import channel_state
from monitor.service.setup import source_settings
from monitor.service.summary import (
    is_calibrated,
    rig_of_library,
    run_attributes,
    uncalibrated_lines,
    weakest_calibration,
)
from tests.oracles.toy_lives import toy_library

HASH = "cd" * 32
NUMBERS = RigSection().numbers
CLAIMS: dict[Calibration, dict[str, Any]] = {
    False: {},
    "declared": {"calibrated": "declared", **NUMBERS},
    True: {"calibrated": True, "identification": HASH, **NUMBERS},
}
LEVELS = {"level": [{"feature": "v_eq", "alert_mm2": 0.01}, {"feature": "rms", "alert_g": 1.0}]}


@pytest.fixture(scope="module")
def small_map() -> RmsMap:
    return build_map(MapPlan(load=(4000.0,), speed=(40.0,), h_d=(0.0, 1e-5), dphi_d=(0.0, 0.1)))


def claimed(rms_map: RmsMap, claim: Calibration) -> RmsMap:
    """The map as if its rig had been calibrated so when it was built."""
    plan = replace(rms_map.plan, rig=replace(rms_map.plan.rig, calibrated=claim))
    return replace(rms_map, attributes={**rms_map.attributes, "parameters": plan.as_json(), "hash": plan.hash()})


def config(rig: dict[str, Any], forecast: dict[str, Any] | None = None, **channel: Any) -> Config:
    values: dict[str, Any] = {
        "bearing": [{"name": "test", "designation": "1205 ETN9"}],
        "operating": {"speed_hz": 40.0, "load_newton": 4000.0},
        "source": [{"name": "s", "rate_hz": 25600}],
        "channel": [{"name": "c", "source": "s", "unit": "g", "bearing": "test", "track": True, **channel}],
        "alarms": LEVELS,
        "forecast": forecast or {},
    }
    return validate(values | ({"rig": rig} if rig else {}), Path("machine.toml"))


@pytest.mark.parametrize("own", CLAIMS)
@pytest.mark.parametrize("built", CLAIMS)
def test_the_weakest_claim_of_configuration_and_map_holds(
    small_map: RmsMap, own: Calibration, built: Calibration
) -> None:
    """The weaker claim of map and configuration holds."""
    weakest = False if False in (own, built) else "declared" if "declared" in (own, built) else True
    c = config(CLAIMS[own])
    channel = source_settings(c, c.source[0], {"c": claimed(small_map, built)}).channels["c"]
    assert channel.damage is not None
    assert channel.calibration is weakest
    assert channel.damage.calibrated == (weakest is not False)
    assert channel.alarms.suspended == (("v_eq",) if weakest is False else ())
    words = {False: "no", True: "yes", "declared": "declared"}
    assert run_attributes(c, {"c": channel})["calibrated"] == words[weakest]
    assert len(list(uncalibrated_lines(c, {"c": channel}))) == (2 if weakest is False else 0)


@pytest.mark.parametrize(
    ("claims", "expected"),
    [
        ((), True),
        ((True, True), True),
        ((True, "declared"), "declared"),
        (("declared", False, True), False),
        ((False,), False),
    ],
)
def test_the_weakest_claim_holds(claims: tuple[Calibration, ...], expected: Calibration) -> None:
    assert weakest_calibration(*claims) is expected


def test_thresholds_on_the_scale_of_the_model_are_taken_where_asked_for(small_map: RmsMap) -> None:
    c = config({}, {"uncalibrated_threshold": True})
    channel = source_settings(c, c.source[0], {"c": small_map}).channels["c"]
    assert channel.damage is not None
    assert (channel.damage.calibrated, channel.damage.uncalibrated_threshold) == (False, True)
    assert channel.alarms.suspended == ()
    (line,) = uncalibrated_lines(c, {"c": channel})
    assert "not issued" not in line


def test_a_channel_that_is_not_tracked_claims_nothing(small_map: RmsMap) -> None:
    c = config({}, track=False)
    channel = source_settings(c, c.source[0], {"c": small_map}).channels["c"]
    assert (channel.calibration, channel.damage, channel.alarms.suspended) == (None, None, ())
    assert list(uncalibrated_lines(c, {"c": channel})) == []
    assert run_attributes(c, {"c": channel})["calibrated"] == "no"


def test_a_library_carries_its_rig() -> None:
    library = toy_library()
    assert (rig_of_library(library), is_calibrated(library)) == (None, False)
    for claim in CLAIMS:
        population = Population(rig=Rig(calibrated=claim))
        made = replace(library, made_of={"population": {"rig": population.rig.as_dict()}})
        assert rig_of_library(made) == population.rig
        assert is_calibrated(made) == (claim is not False)


def test_check_names_the_default_bench_the_missing_claim_and_the_suspended_level(
    tmp_path: Path, small_map: RmsMap
) -> None:
    path = tmp_path / "map.nc"
    save_map(small_map, path)
    found = [one.came for one in find_problems(config({}, map=str(path))) if "calibrated" in one.came]
    assert len(found) == 2
    assert "masses and springs are those of the default test bench" in found[0]
    assert "TT to a threshold in mm3/mm is not issued" in found[0]
    assert "level 'v_eq' not applied: the rig is not calibrated; give a level on v_eq_relative" in found[1]
    (declared, _) = (
        one.came for one in find_problems(config(CLAIMS["declared"], map=str(path))) if "calibrated" in one.came
    )
    assert "its map or library was built before [rig] was calibrated" in declared
    missing = [
        one.came for one in find_problems(config({}, map=str(tmp_path / "none.nc"))) if "uncalibrated" in one.came
    ]
    assert len(missing) == 1


@pytest.mark.parametrize("declared", [False, "declared"])
@pytest.mark.parametrize("built", [False, "declared"])
def test_a_map_of_another_model_rests_on_the_claim_of_the_shaft(built: Claim, declared: Claim) -> None:
    values = config(CLAIMS[True]).model_dump(mode="json", exclude_unset=True)
    values |= {"bearing": [{"name": "test", "designation": "6205"}], "shaft": {"calibrated": declared}}
    c = validate(values, Path("machine.toml"))
    entry = c.bearing[0].to_entry()
    rig = replace(c.parameters_of(RotorRig, entry), calibrated=built)
    plan = MapPlan((4000.0,), (40.0,), (0.0, 1e-5), (0.0, 0.1), bearing=entry.bearing, rig=rig, model="rotor")
    settings = source_settings(c, c.source[0], {"c": build_map(plan)}).channels["c"]
    assert settings.calibration == ("declared" if built == declared == "declared" else False)
    assert run_attributes(c, {"c": settings})["model"] == "c: rotor"
    lines = list(uncalibrated_lines(c, {"c": settings}))
    if settings.calibration == "declared":
        assert lines == []
    elif declared == "declared":
        assert "its map or library was built before [shaft] was declared" in lines[0]
    else:
        assert "[shaft] does not declare the parameters of rotor" in lines[0]


def test_a_rig_of_other_masses_is_not_called_the_default_bench(small_map: RmsMap) -> None:
    c = config({"m_i_kg": 2.0})
    settings = source_settings(c, c.source[0]).channels["c"]
    (line, _) = uncalibrated_lines(c, {"c": settings})
    assert "the rig is not calibrated on this machine" in line


def test_the_rig_of_another_bearing_is_named_as_such() -> None:
    c = config({"calibrated": "declared"})
    values = c.model_dump(mode="json", exclude_unset=True)
    values["bearing"] = [*values["bearing"], {"name": "other", "designation": "6205"}]
    values["channel"] = [{**values["channel"][0], "bearing": "other"}]
    c = validate(values, Path("machine.toml"))
    settings = source_settings(c, c.source[0]).channels["c"]
    assert settings.calibration is False
    assert "[rig] is that of another bearing" in next(uncalibrated_lines(c, {"c": settings}))


def test_a_level_that_is_not_applied_is_the_reason_of_the_state() -> None:
    assert channel_state("out_of_specification", suspended=("soon",))[1].endswith(
        "; level 'soon' not applied: the rig is not calibrated"
    )
    assert channel_state("maintenance_required", stage="final", suspended=("soon",))[1] == ("the final stage has begun")


def test_a_calibrated_rig_says_nothing(tmp_path: Path, small_map: RmsMap) -> None:
    path = tmp_path / "map.nc"
    save_map(claimed(small_map, "declared"), path)
    assert not [
        one.came for one in find_problems(config(CLAIMS["declared"], map=str(path))) if "calibrated" in one.came
    ]
