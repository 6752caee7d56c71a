"""One block through all stages: explicit state, what each gate keeps out, the clock of damage, the choice of a band."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.health.channel import check_channel, detect_input, shallow_lines, step
from monitor.health.onset import LINES as LINES_OF
from monitor.health.onset import Baseline, DetectInput, DetectState
from monitor.health.onset import step as detector_step
from monitor.health.output import ChannelOutput
from monitor.health.rest import quadratic as forecast
from monitor.health.signal.average import RecentSpectra
from monitor.health.signal.bands import VOTES_NEEDED
from monitor.health.signal.condition import Quantity
from monitor.health.signal.quality import Verdict
from monitor.health.size import edv
from monitor.health.state import ChannelState
from monitor.health.tracker import DamageSettings, PartMap
from tests.support.effort import effort_count
from tests.support.pipeline import (
    DAMAGE,
    DETECT,
    FIRST_BAD,
    TRACKED,
    base,
    block_of,
    checked,
    life,
    map_slice,
    record_of,
    run,
)


@cache
def _whole() -> list[tuple[ChannelState, ChannelOutput]]:
    """Return the states and outputs after each block of the life; states are never changed."""
    state, found = ChannelState(), list[tuple[ChannelState, ChannelOutput]]()
    for i, x in enumerate(life()):
        state, output = step(state, checked(i, x, state, TRACKED), TRACKED)
        found.append((state, output))
    return found


def whole_life() -> tuple[ChannelState, list[ChannelOutput]]:
    states, outputs = zip(*_whole(), strict=True)
    return states[-1], list(outputs)


def test_a_life_goes_through_its_stages_and_gets_its_name() -> None:
    state, outputs = whole_life()
    assert state.detect.t_fs is not None
    assert state.detect.t_fs_known is not None
    assert FIRST_BAD <= state.detect.t_fs.sequence <= FIRST_BAD + 4
    assert state.detect.t_fs_known.sequence <= FIRST_BAD + 9
    assert [output.stage for output in outputs[:30]] == ["learning"] * 29 + ["healthy"]
    assert outputs[-1].stage == "final"
    assert all(o.naming is None or o.naming.fault is None for o in outputs[: FIRST_BAD - 1])
    assert state.named is not None
    assert state.named.fault == "outer"


@settings(max_examples=effort_count(quick=4, full=10))
@given(cuts=st.sets(st.integers(0, 79), max_size=8))
def test_states_written_as_json_midway_change_nothing(cuts: set[int]) -> None:
    blocks = life()
    state = ChannelState()
    for i, (x, (after, expected)) in enumerate(zip(blocks, _whole(), strict=True)):
        if i in cuts:
            state = ChannelState.from_dict(json.loads(json.dumps(state.to_dict(), allow_nan=False)))
        state, output = step(state, checked(i, x, state, TRACKED), TRACKED)
        assert record_of(i, state, output).to_json() == record_of(i, after, expected).to_json()
        assert state.to_dict() == after.to_dict()


def test_the_tracker_begins_at_t_fs_though_it_is_known_later() -> None:
    """Oracle: the tracker and the forecast, fed afterwards with every block from t_fs on."""
    state, outputs = whole_life()
    assert state.detect.t_fs is not None
    assert state.detect.t_fs_known is not None
    begin, known = state.detect.t_fs.sequence, state.detect.t_fs_known.sequence
    assert known > begin
    tracker, forecaster = edv.EdvState(), forecast.ForecastState()
    result, forecasts = None, ()
    for i in range(begin - 1, len(outputs)):
        features = outputs[i].features
        assert features is not None
        tracker, result = edv.step(tracker, features.rms, map_slice=map_slice(), settings=DAMAGE.edv)
        forecaster, forecasts = forecast.step(
            forecaster,
            10.0 * i,
            result.v_eq,
            thresholds=DAMAGE.thresholds,
            final_stage=True,
        )
    assert state.damage.edv == tracker
    assert state.damage.forecast == forecaster
    found = outputs[-1].damage
    assert found is not None
    assert result is not None
    for name in ("v_eq", "dphi_d", "h_d", "rms_smoothed", "status"):
        assert getattr(found, name) == getattr(result, name)
    for issued, expected in zip(outputs[-1].forecasts, forecasts, strict=True):
        assert repr(issued) == repr(expected)
    assert {str(o.damage.status) for o in outputs[: known - 1] if o.damage is not None} == {"not_final_stage"}
    assert state.damage.pending == ()


def test_stopped_blocks_do_not_advance_the_running_time() -> None:
    blocks = life(50, first_bad=99)
    for i in range(40, 45):
        blocks[i] = blocks[i] * np.float32(1e-3)
    state, outputs = run(blocks, base())
    assert [i for i, output in enumerate(outputs) if output.block.verdict.status == "stopped"] == list(range(40, 45))
    # 49 intervals, of which those to the five stopped blocks and to the first after them do not count.
    assert state.running_time == pytest.approx(10.0 * (49 - 6))
    assert outputs[42].detection is not None
    assert outputs[42].detection.score is None
    assert outputs[42].naming is None


@pytest.mark.parametrize("flag", ["late", "out_of_order", "clock"])
def test_the_running_time_ignores_blocks_out_of_their_time(flag: str) -> None:
    blocks = life(30, first_bad=99)
    state, _ = run(blocks, base(), flags={17: (flag,)})
    plain, _ = run(blocks, base())
    assert state.running_time == plain.running_time


def test_late_blocks_teach_and_move_nothing() -> None:
    blocks = life(60, first_bad=99)
    loud = [*blocks[:45], *[np.float32(30.0) * x for x in blocks[45:55]], *blocks[55:]]
    flags = dict.fromkeys(range(45, 55), ("late",))
    state, outputs = run(loud, TRACKED, flags=flags)
    assert state.detect.t_fs is None
    assert all(outputs[i].features is not None for i in range(45, 55))
    without, _ = run(blocks[:45], TRACKED)
    assert state.detect.baseline == without.detect.baseline


def test_without_a_unit_there_is_no_absolute_level() -> None:
    state, outputs = run(life(), replace(TRACKED, unit="unknown"))
    assert state.detect.t_fs is not None
    assert state.named is not None
    assert state.named.fault == "outer"
    assert {str(o.damage.status) for o in outputs if o.damage is not None} == {"no_absolute_level"}
    assert all(np.isnan(o.damage.v_eq) for o in outputs if o.damage is not None)


def test_without_a_map_the_status_says_so() -> None:
    _, outputs = run(life(), base(damage=DamageSettings()))
    assert {str(o.damage.status) for o in outputs if o.damage is not None} == {"no_map"}
    assert len([o for o in outputs if o.damage is not None]) == len(outputs)


def test_outside_the_conditions_of_the_map_the_status_says_so() -> None:
    nowhere = PartMap(lambda load, speed: (None, edv.EdvStatus.OUTSIDE_CONDITIONS))
    settings = base(damage=DamageSettings(maps={"outer": nowhere}))
    state, outputs = run(life(), settings)
    assert outputs[-1].damage is not None
    assert str(outputs[-1].damage.status) == "outside_conditions"
    assert state.damage.edv == edv.EdvState()


def test_a_channel_that_is_not_tracked_has_no_volume() -> None:
    _, outputs = run(life(), base())
    assert all(o.damage is None and o.forecasts == () for o in outputs)


def test_clipped_blocks_are_not_inverted_but_count_for_the_end_of_life() -> None:
    settings = replace(TRACKED, signal_range=300.0, detect=replace(DETECT, end_of_life_peak=250.0))
    blocks = life()
    for i in range(75, 79):
        blocks[i] = blocks[i].copy()
        blocks[i][100:104] = 300.0
    state, outputs = run(blocks, settings)
    assert [outputs[i].block.verdict.status for i in range(76, 79)] == ["clipped"] * 3
    damage = [output.damage for output in outputs[76:79]]
    assert [result and str(result.status) for result in damage] == ["bad_block"] * 3
    assert state.detect.t_eol is not None
    assert state.detect.t_eol.sequence == 76


def test_lines_that_are_traces_are_learned_but_do_not_count() -> None:
    """Damage of a neighbour, or elements that pass the load zone, stand clear of the noise and modulate little."""
    floor = np.full(5, 0.01)
    lines = {name: (np.full(5, 0.04), floor) for name in LINES_OF}
    lines["h_ball"] = (np.full(5, 0.06), floor)
    lines["h_cage"] = (np.array([0.5, 0.01, 0.01, 0.01, 0.01]), floor)
    # One line is no comb, and the outer race's lines count as in the thesis.
    assert shallow_lines(lines, 1.0) == {"h_ir", "h_cage"}
    assert shallow_lines(lines, 0.5) == {"h_cage"}
    learned = DetectState(baseline=Baseline(0.0, 0.03, {"h_ir": (0.0, 0.1), "h_ball": (0.0, 0.1)}))
    block = DetectInput(1, 0.0, 1.0, {"h_ir": 9.0, "h_ball": 1.0}, None)
    assert (detector_step(learned, block, DETECT)[1].score or 0.0) > 5.0
    assert detector_step(learned, replace(block, shallow=frozenset({"h_ir"})), DETECT)[1].score == 0.0


def test_a_rejected_block_leaves_the_state_untouched() -> None:
    blocks = life(40)
    state, _ = run(blocks, TRACKED)
    broken = blocks[0].copy()
    broken[7] = np.nan
    verdict = check_channel(broken, state, TRACKED)
    assert verdict.status == "nan"
    after, output = step(state, block_of(40, broken, verdict), TRACKED)
    assert after is state
    assert output.features is None
    assert output.stage == state.detect.stage


def test_an_unknown_speed_is_refused() -> None:
    with pytest.raises(ValueError, match="channel 'one': the shaft speed"):
        step(ChannelState(), replace(block_of(0, life(1)[0], Verdict()), speed=Quantity()), base())


def test_speed_and_load_are_those_of_the_block() -> None:
    speed, load = Quantity(25.0, "block"), Quantity(1000.0, "channel", 5.0)
    _, output = step(ChannelState(), replace(block_of(0, life(1)[0], Verdict()), speed=speed, load=load), base())
    assert (output.block.speed, output.block.load) == (speed, load)


def test_the_band_is_chosen_on_the_first_blocks_then_frozen() -> None:
    settings = base(bands=None, detect=replace(DETECT, run_in_blocks=VOTES_NEEDED))
    blocks = life(60)
    other = [*blocks[:VOTES_NEEDED], *life(60, seed=9, first_bad=20)[VOTES_NEEDED:]]
    state, outputs = run(blocks, settings)
    changed, _ = run(other, settings)
    assert [output.band_source for output in outputs] == ["provisional"] * VOTES_NEEDED + ["learning"] * 40
    assert len({output.bands for output in outputs[VOTES_NEEDED:]}) == 1
    assert state.bands == outputs[-1].bands == changed.bands
    assert state.votes is None
    # Spectra of the provisional band are not averaged with those of the chosen one.
    assert outputs[VOTES_NEEDED].naming is not None
    at_choice, _ = run(blocks[: VOTES_NEEDED + 1], settings)
    assert at_choice.spectra.count == 1


def test_only_blocks_that_run_vote() -> None:
    settings = base(bands=None)
    blocks = [np.float32(1e-6) * x for x in life(5)] + life(10)
    state, outputs = run(blocks, settings)
    assert [output.block.verdict.status for output in outputs[:5]] == ["stopped"] * 5
    assert state.votes is not None
    assert state.votes.total == 10


def test_while_the_band_is_provisional_the_baseline_learns_nothing() -> None:
    settings = base(bands=None, detect=replace(DETECT, run_in_blocks=0))
    state, _ = run(life(VOTES_NEEDED + 3), settings)
    assert len(state.detect.learned) == 3


def test_what_the_detector_takes_is_in_the_features() -> None:
    blocks = life(1)
    _, outputs = run(blocks, base())
    features = outputs[0].features
    assert features is not None
    block = detect_input(features, block_of(0, blocks[0], Verdict()), absolute=False, usable=True)
    lines = features.lines[0]["outer"]
    assert block.prominence["h_or"] == pytest.approx(lines.amplitude.sum() / lines.floor.sum())
    assert (block.rms, block.peak, block.sequence) == (features.rms, None, 1)


def test_spectra_of_another_length_start_anew() -> None:
    rows = RecentSpectra().add((np.ones(50, np.float32),), 4).add((np.ones(50, np.float32),), 4)
    assert rows.count == 2
    assert rows.add((np.ones(60, np.float32),), 4).count == 1
    assert RecentSpectra.from_list(json.loads(json.dumps(rows.to_list()))) == rows


def test_a_state_of_version_1_is_read() -> None:
    """It kept tracker, forecast and waiting blocks side by side, the latter by time and RMS only."""
    state, _ = whole_life()
    new = state.to_dict()
    damage = new.pop("damage")
    old = {**new, "version": 1, "edv": damage["edv"], "forecast": damage["forecast"], "pending": [[5.0, 0.25]]}
    read = ChannelState.from_dict(json.loads(json.dumps(old)))
    assert read.damage.edv == state.damage.edv
    assert read.damage.forecast == state.damage.forecast
    assert [(item.time, item.rms, item.harmonics) for item in read.damage.pending] == [(5.0, 0.25, None)]
