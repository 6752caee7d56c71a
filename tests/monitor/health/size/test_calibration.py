"""An uncalibrated rig: when ``ok`` is withheld, relative V_eq, and thresholds that are not issued."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from models.machine.scene import Part
from monitor.config.alarms import AlarmLevel, AlarmsSection
from monitor.health.alarms import AlarmInput, AlarmSettings, AlarmState, Level, Rule
from monitor.health.alarms import step as alarm_step
from monitor.health.size import Damage, DamageInput, EdvStatus, Remaining, TtStatus
from monitor.health.size.calibration import beside, mark_forecast, mark_volume, relate
from monitor.health.size.level_set import LevelMap
from monitor.health.size.library.forecaster import LibrarySettings
from monitor.health.tracker import DamageGate, DamageSettings, DamageState, PartMap, step
from monitor.words.features import LEVELS
from tests.oracles.toy_lives import THRESHOLD, toy_library, toy_life

RADII: dict[Part, float] = {"outer": 0.0229, "inner": 0.0166}


def map_of(part: Part) -> PartMap:
    """RMS that rises with extent and depth from that of a healthy bearing."""
    rms = 0.2 + 10.0 * np.linspace(0.0, 1.0, 17)[:, None] ** 0.8 * np.linspace(0.0, 1.0, 26) ** 0.4
    level_map = LevelMap(np.radians(np.linspace(0.0, 50.0, 26)), np.linspace(0.0, 32e-6, 17), rms, RADII[part])
    return PartMap(lambda load, speed: (level_map, None))


CALIBRATED = DamageSettings(maps={part: map_of(part) for part in RADII}, thresholds=(0.02e-6, 10.0))
UNCALIBRATED = replace(CALIBRATED, calibrated=False)
GROWING = [DamageInput(60.0 * i, 2.0 + 0.2 * i) for i in range(20)]
Result = tuple[Damage, tuple[Remaining, ...]]


def tracked(settings: DamageSettings, blocks: list[DamageInput], fault: Part = "outer") -> list[Result]:
    """Track blocks, with a restart before each."""
    state, found = DamageState(), []
    for block in blocks:
        state = DamageState.from_dict(json.loads(json.dumps(state.to_dict())))
        state, damage, forecasts = step(state, block, DamageGate(fault=fault), settings)
        found.append((damage, forecasts))
    return found


def test_ok_is_withheld_and_v_eq_stays_as_it_is() -> None:
    pairs = list(zip(tracked(CALIBRATED, GROWING), tracked(UNCALIBRATED, GROWING), strict=True))
    assert {damage.status for (damage, _), _ in pairs} == {"ok"}
    for (calibrated, _), (damage, _) in pairs:
        assert damage == replace(calibrated, status=EdvStatus.UNCALIBRATED)
        assert damage.v_eq_relative == damage.v_eq / pairs[0][0][0].v_eq
    assert pairs[0][1][0].v_eq_relative == 1.0
    assert pairs[-1][1][0].v_eq_relative > 2.0


def test_other_statuses_of_v_eq_stay() -> None:
    for status in EdvStatus:
        expected = EdvStatus.UNCALIBRATED if status is EdvStatus.OK else status
        assert mark_volume(Damage(status)).status is expected
    falling = [*GROWING[:10], *(DamageInput(600.0 + 60.0 * i, 0.5) for i in range(6)), DamageInput(990.0, 100.0)]
    statuses = [damage.status for damage, _ in tracked(UNCALIBRATED, falling)]
    assert {EdvStatus.UNCALIBRATED, EdvStatus.WIDENED, EdvStatus.ABOVE_MAP} == set(statuses)


def test_a_threshold_is_not_compared_with_an_uncalibrated_v_eq() -> None:
    """Also ``already_crossed`` says where V_eq lies: with the masses of another bench, at the first block."""
    before, after = tracked(CALIBRATED, GROWING), tracked(UNCALIBRATED, GROWING)
    near = [forecasts[0] for _, forecasts in before]
    assert {"ok", "already_crossed", "too_few_points"} <= {one.status for one in near}
    for (_, calibrated), (_, forecasts) in zip(before, after, strict=True):
        for one, other in zip(calibrated, forecasts, strict=True):
            if one.status == "too_few_points":
                assert other.status is TtStatus.TOO_FEW_POINTS
                continue
            assert other.status is TtStatus.UNCALIBRATED
            assert other.threshold == one.threshold
            values = (other.tt, other.tt_lower, other.tt_upper, other.t_threshold, other.p_threshold)
            assert all(math.isnan(value) for value in (*values, *other.coefficients))
            assert other.quantiles == ()


def test_a_threshold_that_is_asked_for_is_issued_and_not_called_ok() -> None:
    asked = replace(UNCALIBRATED, uncalibrated_threshold=True)
    for (_, calibrated), (_, forecasts) in zip(tracked(CALIBRATED, GROWING), tracked(asked, GROWING), strict=True):
        for one, other in zip(calibrated, forecasts, strict=True):
            status = TtStatus.UNCALIBRATED if one.status == "ok" else one.status
            assert str(other) == str(replace(one, status=status))


@pytest.mark.parametrize("status", TtStatus)
def test_statuses_that_do_not_compare_stay(status: TtStatus) -> None:
    compared = {"ok", "already_crossed", "beyond_horizon", "crossing_in_past", "concave", "uncalibrated"}
    found = Remaining(1e-7, status, tt=5.0)
    withheld = mark_forecast(found, issued=False)
    assert (withheld.status is TtStatus.UNCALIBRATED) == (status in compared)
    assert math.isnan(withheld.tt) or status not in compared or status == "uncalibrated"
    assert mark_forecast(found, issued=True).status == ("uncalibrated" if status == "ok" else status)


def test_the_library_is_marked_like_the_map() -> None:
    library = toy_library()
    settings = DamageSettings(
        *("library", "library"),
        library=library,
        library_settings=LibrarySettings(features="rms+harmonics"),
        thresholds=(THRESHOLD,),
    )
    life = toy_life(3)
    blocks = [
        DamageInput(float(t), float(rms), tuple(map(float, lines)), float(load), float(speed))
        for t, rms, lines, load, speed in zip(life.t, life.rms, life.harmonics, life.load, life.speed, strict=True)
    ][:12]
    found = [tracked(replace(settings, calibrated=value), blocks) for value in (True, False)]
    assert "ok" in {damage.status for damage, _ in found[0]}
    for (calibrated, _), (damage, forecasts) in zip(*found, strict=True):
        assert damage.status == ("uncalibrated" if calibrated.status == "ok" else calibrated.status)
        assert str(damage.v_eq) == str(calibrated.v_eq)
        assert forecasts[0].status in ("uncalibrated", "too_few_points")


def test_the_first_value_is_that_of_the_blocks_that_waited_for_the_onset() -> None:
    state = DamageState()
    for block in GROWING[:4]:
        gate = DamageGate(final=False, raised=True, fault="outer")
        state, damage, _ = step(state, block, gate, UNCALIBRATED)
        assert damage.status is EdvStatus.NOT_FINAL_STAGE
    state, damage, _ = step(state, GROWING[4], DamageGate(fault="outer"), UNCALIBRATED)
    assert damage == tracked(UNCALIBRATED, GROWING[:5])[-1][0]
    assert damage.v_eq_relative > 1.0


def test_another_part_has_a_first_value_of_its_own() -> None:
    state, found = DamageState(), []
    for place, block in enumerate(GROWING[:12]):
        fault = "outer" if place < 6 else "inner"
        state, damage, _ = step(state, block, DamageGate(fault=fault), UNCALIBRATED)
        found.append(damage.v_eq_relative)
    assert found[0] == found[6] == 1.0
    assert min(found[1:6]) > 1.0


def test_a_state_of_an_earlier_version_takes_the_first_value_of_its_forecast() -> None:
    state = DamageState()
    for block in GROWING[:6]:
        state, _, _ = step(state, block, DamageGate(fault="outer"), CALIBRATED)
    stored = state.to_dict()
    del stored["first_v_eq"]
    assert DamageState.from_dict(stored).to_dict() == state.to_dict()
    assert state.first_v_eq == tracked(CALIBRATED, GROWING[:1])[0][0].v_eq
    # The library keeps no V_eq: there the next value becomes the first.
    stored["forecast"]["fit"] = None
    assert DamageState.from_dict(stored).first_v_eq is None


@pytest.mark.parametrize("v_eq", [0.0, math.nan])
def test_nothing_is_a_multiple_of_no_value(v_eq: float) -> None:
    first, damage = relate(None, Damage(EdvStatus.OK, v_eq=v_eq))
    assert first is None
    assert math.isnan(damage.v_eq_relative)


def levels(**more: Any) -> AlarmsSection:
    rules = [
        AlarmLevel(feature="v_eq", alert_mm2=0.01, on_delay_blocks=1),
        AlarmLevel(feature="tt", danger_hours=8, on_delay_blocks=1, latch=True),
        AlarmLevel(feature="v_eq_relative", alert=3, on_delay_blocks=1),
    ]
    return AlarmsSection(level=tuple(rules), **more)


def test_levels_in_volumes_and_times_are_suspended_and_relative_ones_are_not() -> None:
    names = {name for name, feature in LEVELS.items() if feature.needs_calibration}
    volumes = {f"{name}{end}" for name in ("v_eq", "v_eq_filter") for end in ("", "_lower", "_upper")}
    assert names == volumes | {"tt", "tt_lower", "tt_upper", "p_threshold"}
    settings = levels().to_settings("x", 0, absolute_volume=False)
    assert settings.suspended == ("v_eq", "tt")
    assert levels().to_settings("x", 0).suspended == ()
    values = {"v_eq": 5e-8, "tt": (60.0,), "v_eq_relative": 4.0, "edv_status": "uncalibrated"}
    _, output = alarm_step(AlarmState(), AlarmInput(1, usable=True, bad=False, values=values), settings)
    assert [change.rule for change in output.changes] == ["v_eq_relative"]


def test_a_suspended_level_does_not_vanish_without_a_status() -> None:
    """Once there is a V_eq that the level cannot be applied to, the channel is out of specification."""
    rule = Rule("v_eq", "v_eq", alert=Level(1e-8), on_delay=1)
    conditions = {}
    for suspended in (False, True):
        settings, state = AlarmSettings((replace(rule, suspended=suspended),)), AlarmState()
        found = []
        for number, v_eq in enumerate((None, 5e-9, 5e-9), 1):
            values = {"v_eq": v_eq, "edv_status": "not_final_stage" if v_eq is None else "widened"}
            state, output = alarm_step(state, AlarmInput(number, usable=True, bad=False, values=values), settings)
            found.append(output.condition)
        conditions[suspended] = found
    assert conditions == {
        False: ["normal", "normal", "normal"],
        True: ["normal", "out_of_specification", "out_of_specification"],
    }
    # A level that was raised before it was suspended does not stand for ever.
    raised = AlarmInput(1, usable=True, bad=False, values={"v_eq": 5e-8})
    state, _ = alarm_step(AlarmState(), raised, AlarmSettings((replace(rule, latch=True),)))
    assert state.level("v_eq", "alert").shown
    state, _ = alarm_step(state, raised, AlarmSettings((replace(rule, latch=True, suspended=True),)))
    assert not state.level("v_eq", "alert").shown


def test_an_uncalibrated_v_eq_without_levels_leaves_the_state_of_the_stage() -> None:
    values = {"v_eq": 5e-8, "edv_status": "uncalibrated"}
    _, output = alarm_step(
        AlarmState(), AlarmInput(1, usable=True, bad=False, stage="final", values=values), AlarmSettings()
    )
    assert output.condition == "maintenance_required"


OK = EdvStatus.OK
LIBRARY = Damage(OK, 2e-8, 1.5e-8, 2.6e-8, p_no_growth=0.1)


def test_where_they_agree_the_library_is_issued_with_the_filter_beside_it() -> None:
    found = beside(LIBRARY, Damage(OK, 1.8e-8, 1e-8, 3e-8, p_no_growth=0.4))
    assert (found.status, found.v_eq, found.v_eq_lower, found.v_eq_upper) == (OK, 2e-8, 1.5e-8, 2.6e-8)
    assert (found.v_eq_filter, found.v_eq_filter_lower, found.v_eq_filter_upper) == (1.8e-8, 1e-8, 3e-8)
    assert found.p_no_growth == 0.1


@pytest.mark.parametrize(
    ("tracked", "issued"),
    [
        (Damage(OK, 6e-8, 3e-8, 9e-8), 6e-8),
        (Damage(OK, 6e-8, 5.5e-8, 6.5e-8), 2e-8),
        (Damage(OK, 1e-8, 0.4e-8, 1.4e-8), 1e-8),
    ],
)
def test_where_their_intervals_are_apart_the_wider_is_ambiguous(tracked: Damage, issued: float) -> None:
    found = beside(LIBRARY, tracked)
    assert (found.status, found.v_eq) == (EdvStatus.AMBIGUOUS, issued)
    assert found.v_eq_filter == tracked.v_eq


@pytest.mark.parametrize("status", ["implausible", "outside_library", "bad_block"])
def test_a_refusal_of_the_library_stays_and_the_filter_is_told(status: str) -> None:
    found = beside(Damage(EdvStatus(status)), Damage(OK, 6e-8, 5e-8, 7e-8, p_no_growth=0.2))
    assert (found.status, found.v_eq_filter, found.p_no_growth) == (status, 6e-8, 0.2)
    assert math.isnan(found.v_eq)


def test_a_refusal_of_the_filter_changes_nothing() -> None:
    found = beside(LIBRARY, Damage(EdvStatus.ABOVE_MAP))
    assert (found.status, found.v_eq) == (OK, 2e-8)
    assert math.isnan(found.v_eq_filter)


def test_another_part_than_the_librarys_is_the_filters() -> None:
    tracked = Damage(OK, 6e-8, 5e-8, 7e-8)
    assert beside(Damage(EdvStatus.NOT_THIS_PART), tracked).v_eq == 6e-8
    assert beside(Damage(EdvStatus.NOT_THIS_PART), Damage(EdvStatus.NO_MAP)).status is EdvStatus.NOT_THIS_PART
