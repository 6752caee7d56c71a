"""Learned forecasts block by block: since t_fs, beside a library, on channels without a map, and as configured."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from monitor.config.load import Config, ConfigError, validate
from monitor.desk.judge.problems import find_problems
from monitor.health.rest.learned.fit import LearnedRun, fit_runs
from monitor.health.rest.learned.forecaster import LearnedState
from monitor.health.rest.learned.forecaster import step as learned_step
from monitor.health.rest.learned.model import LearnedModel
from monitor.health.rest.learned.pool import pool
from monitor.health.rest.learned.scores import PhysicalRun, library_weight
from monitor.health.size import DamageInput, EdvStatus, Remaining, RemainingSettings, TtStatus
from monitor.health.size.library.forecaster import QUANTILES, LibrarySettings
from monitor.health.tracker import DamageGate, DamageSettings, DamageState, step
from monitor.records.library_file import save_learned
from monitor.service.setup import source_settings
from monitor.service.summary import run_attributes
from tests.oracles.toy_lives import INTERVAL, THRESHOLD, toy_library
from tests.support.learned import family
from tests.support.pipeline import FIRST_BAD, base, life, record_of, run
from tests.support.tracking import LOAD, SPEED, growing

ALONE = DamageSettings(forecast_method="learned", learned=fit_runs(family(4)))
TIMES, RMS, LINES = growing(40)


def blocks(count: int = 40) -> list[DamageInput]:
    rows = zip(TIMES.tolist(), RMS.tolist(), LINES.tolist(), strict=True)
    return [DamageInput(t, rms, tuple(lines), LOAD, SPEED) for t, rms, lines in rows][:count]


def live(settings: DamageSettings, gates: list[DamageGate], state: DamageState | None = None) -> list[Remaining]:
    """Return the forecast of each block, its state through JSON before each."""
    state, found = state or DamageState(), []
    for block, gate in zip(blocks(len(gates)), gates, strict=True):
        state = DamageState.from_dict(json.loads(json.dumps(state.to_dict(), allow_nan=False)))
        state, _, (one,) = step(state, block, gate, settings)
        found.append(one)
    return found


def alone(baseline: float | None = 1.0) -> list[Remaining]:
    state, found = LearnedState(), []
    for block in blocks():
        state, one = learned_step(state, block, ALONE.learned, baseline=baseline, threshold=ALONE.thresholds[0])
        found.append(one)
    return found


def test_blocks_since_the_score_rose_are_taken_first() -> None:
    gates = [DamageGate(final=i >= 9, raised=i < 9, baseline=1.0, since_t_fs=INTERVAL * i) for i in range(40)]
    found = live(ALONE, gates)
    assert {one.status for one in found[:9]} == {TtStatus.NOT_FINAL_STAGE}
    assert found[9:] == alone()[9:]
    assert found[-1].tt > 0.0


def test_where_the_first_blocks_were_not_kept_the_clock_counts() -> None:
    late = [DamageGate(since_t_fs=1000.0 + INTERVAL * i) for i in range(4)]
    without = replace(ALONE, learned=LearnedModel())
    found = live(without, late)
    # With no runs TT is the elapsed time: 1000 s before the first block that was kept, and three intervals.
    assert found[-1].tt == pytest.approx(1000.0 + 3 * INTERVAL)
    unknown = live(without, [DamageGate()] * 4)
    assert unknown[-1].tt == pytest.approx(3 * INTERVAL)


def test_bad_blocks_are_left_out_and_a_closed_stage_begins_anew() -> None:
    bad = {5, 6}
    gates = [DamageGate(usable=i not in bad, baseline=1.0) for i in range(12)]
    found = live(ALONE, gates)
    assert [i for i, one in enumerate(found) if one.status is TtStatus.CANNOT_TELL] == [5, 6]
    state, _, _ = step(DamageState(), blocks()[0], DamageGate(), ALONE)
    for absolute in (True, False):
        closed = DamageGate(final=False, closed=True, absolute=absolute)
        after, damage, (one,) = step(state, blocks()[1], closed, ALONE)
        assert after.learned == LearnedState()
        assert after.pending == ()
        assert one.status is TtStatus.EPISODE_CLOSED
        assert damage.status is (EdvStatus.EPISODE_CLOSED if absolute else EdvStatus.NO_ABSOLUTE_LEVEL)


def test_it_needs_neither_unit_nor_map_nor_calibration() -> None:
    settings = replace(ALONE, calibrated=False)
    gates = [DamageGate(final=i >= 9, raised=i < 9, absolute=False, baseline=1.0) for i in range(40)]
    assert live(settings, gates)[9:] == alone()[9:]
    assert not settings.tracks_volume
    assert settings.prior == f"for TT, {settings.learned.prior}"


def test_a_state_of_before_takes_no_history() -> None:
    stored = DamageState().to_dict()
    del stored["learned"]
    assert DamageState.from_dict(stored).learned == LearnedState()


def test_combined_lies_between_and_is_learned_alone_without_a_calibrated_rig() -> None:
    library = toy_library(40)
    settings = DamageSettings(
        track_method="library",
        forecast_method="combined",
        thresholds=(THRESHOLD,),
        library=library,
        library_settings=LibrarySettings(features="rms+harmonics"),
        learned=ALONE.learned,
    )
    gates = [DamageGate(baseline=1.0)] * 24
    both = live(settings, gates)
    ours = live(replace(settings, calibrated=False), gates)
    theirs = live(replace(settings, forecast_method="library"), gates)
    assert [replace(one, threshold=0.0) for one in ours] == [replace(one, threshold=0.0) for one in alone()[:24]]
    compared = [i for i, one in enumerate(theirs) if one.status is TtStatus.OK and ours[i].status is TtStatus.OK]
    assert len(compared) > 10
    for i in compared:
        low, high = sorted((ours[i].tt, theirs[i].tt))
        assert low * 0.99 <= both[i].tt <= high * 1.01
        assert both[i].tt_lower <= both[i].tt <= both[i].tt_upper
    refused = [i for i, one in enumerate(theirs) if not one.quantiles]
    assert [both[i].tt for i in refused] == pytest.approx([ours[i].tt for i in refused], nan_ok=True)


def test_the_pool_of_a_forecast_with_itself_is_that_forecast() -> None:
    settings = RemainingSettings(window=500.0)
    state, one = LearnedState(), Remaining(0.0, TtStatus.TOO_FEW_POINTS)
    for block in blocks(20):
        state, one = learned_step(state, block, ALONE.learned, settings, baseline=1.0, threshold=THRESHOLD)
    mixed = pool(one, replace(one, status=TtStatus.OK), 0.5, settings)
    for name in ("tt", "tt_lower", "tt_upper", "p_threshold", "t_threshold"):
        assert getattr(mixed, name) == pytest.approx(getattr(one, name), rel=0.02)
    crossed = replace(one, status=TtStatus.ALREADY_CROSSED, quantiles=tuple((p, 0.0) for p, _ in one.quantiles))
    assert pool(one, crossed, 0.9, settings).tt < 0.1
    assert pool(one, crossed, 0.1, settings).tt > 0.5 * one.tt
    for silent in (Remaining(THRESHOLD, TtStatus.OUTSIDE_LIBRARY), replace(one, status=TtStatus.UNCALIBRATED)):
        assert pool(one, silent, 0.5, settings) == one


def test_a_hundred_thousand_blocks_take_no_more_memory() -> None:
    state = LearnedState()
    rng = np.random.default_rng(1)
    sizes = set[int]()
    for i, level in enumerate(np.exp(0.1 * rng.standard_normal(3000)).tolist()):
        state, _ = learned_step(state, DamageInput(10.0 * i, level), final_stage=True)
        if i % 500 == 499:
            sizes.add(len(json.dumps(state.to_dict())))
    assert max(sizes) < 64 * 60


def test_a_channel_without_a_map_has_tt_and_no_volume() -> None:
    tracked = base(damage=ALONE)
    state, outputs = run(life(), tracked)
    values = record_of(80, state, outputs[-1]).channels["one"]
    assert values["tt_status"] in (("ok",), ("outside_library",))
    assert values["tt"][0] > 0.0
    assert values["p_crossed"] is not None
    assert "edv_status" not in values
    statuses = {output.forecasts[0].status for output in outputs[: FIRST_BAD - 2]}
    assert statuses == {TtStatus.NOT_FINAL_STAGE}
    # The elapsed time counts from t_fs, not from the block by which it was known.
    plain = replace(tracked, damage=replace(ALONE, learned=LearnedModel()))
    _, told = run(life(), plain)
    mark = state.detect.t_fs
    assert mark is not None
    assert mark.time is not None
    assert told[-1].forecasts[0].tt == pytest.approx(790.0 - mark.time)


def configured(tmp_path: Path, forecast: dict[str, Any], **channel: Any) -> Config:
    source = {"name": "s", "url": "x", "rate_hz": 25600}
    own = {"name": "c", "source": "s", "unit": "g", "bearing": "test", "track": True, **channel}
    values = {
        "bearing": [{"name": "test", "designation": "1205 ETN9"}],
        "operating": {"speed_hz": 40.0, "load_newton": 4000.0},
        "source": [source],
        "channel": [own],
        "forecast": forecast,
        "alarms": {
            "level": [
                {"feature": "tt", "alert_hours": 10.0, "danger_hours": 1.0},
                {"feature": "v_eq", "alert_mm2": 0.01},
            ]
        },
    }
    return validate(values, tmp_path / "machine.toml")


def test_the_library_of_the_forecast_is_read_and_named(tmp_path: Path) -> None:
    save_learned(ALONE.learned, tmp_path / "runs.npz")
    config = configured(tmp_path, {"method": "learned", "library": "runs.npz"})
    settings = source_settings(config, config.source[0]).channels["c"]
    assert settings.damage is not None
    assert settings.damage.learned.hash == ALONE.learned.hash
    assert settings.calibration is None
    attributes = run_attributes(config, {"c": settings})
    assert attributes["forecast_end"] == "c: as recorded runs ended, v_th is not used"
    assert attributes["learned_hash"] == f"c: {ALONE.learned.hash}"
    assert "4 recorded runs" in attributes["prior"]
    # A level on TT compares no volume; one on V_eq does, and this rig is not calibrated.
    assert settings.alarms.suspended == ("v_eq",)
    assert not [one for one in find_problems(config) if "no_map" in one.came or "runs.npz" in one.came]


def test_what_a_configuration_may_not_say(tmp_path: Path) -> None:
    save_learned(ALONE.learned, tmp_path / "runs.json")
    for forecast, words in (
        ({"library": "runs.json"}, "belongs to method"),
        ({"method": "learned", "threshold_mm2": [0.01, 0.05]}, "must be one number, got 2"),
    ):
        with pytest.raises(ConfigError, match=words):
            configured(tmp_path, forecast)
    config = configured(tmp_path, {"method": "learned", "library": "none.npz"})
    with pytest.raises(ConfigError, match=r"\[forecast\] library: .*no such file"):
        source_settings(config, config.source[0])
    assert [one for one in find_problems(config) if "none.npz does not exist" in one.came]
    misplaced = configured(tmp_path, {"method": "learned"}, library="runs.json")
    with pytest.raises(ConfigError, match=r"give it as library of \[forecast\]"):
        source_settings(misplaced, misplaced.source[0])
    without = configured(tmp_path, {"method": "learned"})
    assert [one for one in find_problems(without) if "as long again as it has lasted" in one.came]


def test_a_file_changes_the_hash_of_the_configuration(tmp_path: Path) -> None:
    plain = configured(tmp_path, {"method": "learned"})
    assert plain.hash != configured(tmp_path, {"method": "learned", "library": "runs.json"}).hash


def physical(one: LearnedRun, factor: float) -> PhysicalRun:
    """Return a run with forecasts of the true time to its end times a factor, within 10 %."""
    found: list[Remaining] = []
    for t in one.t.tolist():
        quantiles = tuple((p, max(one.life - t, 1.0) * factor * (0.9 + 0.2 * p)) for p in QUANTILES)
        found.append(Remaining(THRESHOLD, TtStatus.OK, tt=quantiles[5][1], quantiles=quantiles))
    return PhysicalRun(one, found)


def test_a_library_weighs_by_its_errors_on_runs_left_out() -> None:
    runs = family(4)
    prior = LearnedModel(runs=({},) * 4).library_weight
    right, wrong = (library_weight([physical(one, factor) for one in runs]) for factor in (1.0, 50.0))
    assert right is not None
    assert wrong is not None
    assert wrong < prior <= right < 1.0
    assert library_weight([physical(runs[0], 1.0)]) is None
    # Without scores it weighs as much as four runs; without runs it is alone.
    assert prior == 0.5
    assert LearnedModel().library_weight == 1.0
    assert replace(LearnedModel(), weights={"learned": 0.7, "library": 0.3}).library_weight == 0.3
