"""Time to the end learned from recorded runs: the prior, the regression, the history, the state."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.health.rest.learned.fit import fit_runs, moments_of
from monitor.health.rest.learned.forecaster import LearnedState, step
from monitor.health.rest.learned.history import MAX_BINS, StageHistory
from monitor.health.rest.learned.model import Distribution, EndLevels, LearnedModel, student
from monitor.health.rest.learned.scores import covers, crps, scores_out_of_run
from monitor.health.size import DamageInput, Remaining, RemainingSettings, TtStatus
from tests.support.learned import family, run


def taken(
    blocks: Sequence[DamageInput], model: LearnedModel | None = None, **more: Any
) -> tuple[LearnedState, Remaining]:
    """Return the state and the forecast after the last of some blocks."""
    state, found = LearnedState(), Remaining(math.nan, TtStatus.NOT_FINAL_STAGE)
    for block in blocks:
        state, found = step(state, block, model, **more)
    return state, found


def test_without_runs_it_is_as_long_again_as_it_has_lasted() -> None:
    _, found = taken([DamageInput(100.0 * i, 1.0) for i in range(11)], settings=RemainingSettings(window=3000.0))
    assert found.status is TtStatus.OK
    assert (found.tt, found.tt_lower, found.tt_upper) == pytest.approx((1000.0, 1000.0 / 9.0, 9000.0))
    assert found.p_threshold == pytest.approx(0.75)
    assert found.t_threshold == pytest.approx(2000.0)
    assert math.isnan(found.p_crossed)
    for level, tt in found.quantiles:
        assert 1.0 - level == pytest.approx(1000.0 / (1000.0 + tt))
    assert LearnedModel().prior.startswith("no recorded run")


def test_few_runs_move_it_less_than_many() -> None:
    asked = moments_of(run(3600.0, seed=99), (0.75,))
    widths, errors = [], []
    for count in (0, 1, 3, 12):
        found = fit_runs(family(count)).distribution(asked.inputs[0], float(asked.elapsed[0]))
        widths.append(found.scale)
        errors.append(abs(math.log(found.quantile(0.5) / asked.left[0])))
    assert errors == sorted(errors, reverse=True)
    # One run could be checked on no other.
    assert widths[0] == widths[1] == 1.0
    assert widths[1] > widths[2] > widths[3]
    assert fit_runs(family(1)).prior.startswith("1 recorded run, fewer than 2")
    assert widths[-1] < 0.5
    assert errors[-1] < 0.4


def test_scores_are_out_of_run() -> None:
    runs = family(4)
    scores = scores_out_of_run(runs)
    assert scores["crps_share"] < 0.8 * np.mean([one["elapsed_crps_share"] for one in scores["by_share"].values()])
    assert 0.6 <= scores["over_life"]["coverage"] <= 1.0
    # A run of quite another kind is not forecast by itself.
    odd = replace(run(40.0 * 3600.0, end=0.3, seed=50), name="odd")
    others = scores_out_of_run([*runs, odd])
    assert others["crps_share"] > scores["crps_share"]
    assert scores["p_crossed"]["brier"] < scores["p_crossed"]["brier_base_rate"]


def test_a_run_counts_once_whatever_its_number_of_blocks() -> None:
    runs = family(4)
    dense = [run(runs[0].life, seed=0, blocks=600), *runs[1:]]
    sparse, full = fit_runs(runs), fit_runs(dense)
    assert full.coefficients == pytest.approx(sparse.coefficients, abs=0.12)


def test_units_do_not_matter() -> None:
    runs = family(5)
    in_mg = [replace(one, ln_rms=one.ln_rms + math.log(1e3), ln_baseline=math.log(1e3)) for one in runs]
    ours, theirs = fit_runs(runs), fit_runs(in_mg)
    assert theirs.coefficients == pytest.approx(ours.coefficients, rel=1e-9)
    assert theirs.end_levels.mean == pytest.approx(ours.end_levels.mean)


def test_runs_that_are_too_short_are_left_out_and_said() -> None:
    model = fit_runs([*family(2), replace(run(50.0, blocks=6), name="short")])
    assert [one["run"] for one in model.left_out] == ["short"]
    assert "7 blocks" in model.left_out[0]["reason"]
    assert len(model.runs) == 2


def test_beyond_the_runs_it_falls_back_and_says_so() -> None:
    model = fit_runs(family(6))
    inside = moments_of(run(3600.0, seed=9), (0.5,))
    x, elapsed = inside.inputs[0], float(inside.elapsed[0])
    assert not model.distribution(x, elapsed).outside
    for place, far in ((0, 9.0), (1, 9.0), (1, -9.0)):
        beyond = x.copy()
        beyond[place] += far
        found = model.distribution(beyond, elapsed)
        assert found.outside
        assert found.quantile(0.5) == pytest.approx(elapsed, rel=1e-3)
        assert found.scale == pytest.approx(1.0, rel=1e-3)
    # Early in a life the elapsed time is short in every run.
    early = x.copy()
    early[0] -= 9.0
    assert not model.distribution(early, 1.0).outside


def test_an_unknown_baseline_leaves_the_level_out() -> None:
    model = fit_runs(family(6))
    _, found = taken([DamageInput(60.0 * i, 7.0 + 0.1 * i) for i in range(20)], model)
    assert found.status is TtStatus.OK
    assert math.isnan(found.p_crossed)
    unknown = [replace(one, ln_baseline=math.nan) for one in family(6)]
    assert fit_runs(unknown).coefficients[1] == 0.0


def test_statuses_without_values() -> None:
    state, found = step(LearnedState(), DamageInput(0.0, 1.0), final_stage=False)
    assert (found.status, state) == (TtStatus.NOT_FINAL_STAGE, LearnedState())
    state, found = step(state, DamageInput(0.0, 1.0))
    assert found.status is TtStatus.TOO_FEW_POINTS
    for i in range(1, 4):
        state, found = step(state, DamageInput(10.0 * i, 1.0))
    assert found.status is TtStatus.OK
    again, found = step(state, DamageInput(40.0, math.nan))
    assert (found.status, again) == (TtStatus.CANNOT_TELL, state)
    with pytest.raises(ValueError, match="may not go back"):
        step(state, DamageInput(5.0, 1.0))
    # A clock that does not move on is no elapsed time.
    _, found = taken([DamageInput(7.0, 1.0)] * 5)
    assert found.status is TtStatus.TOO_FEW_POINTS
    _, found = step(state, DamageInput(1e9, 1.0))
    assert found.status is TtStatus.BEYOND_HORIZON


def test_single_spikes_move_little() -> None:
    model, quiet = fit_runs(family(6)), run(3600.0, seed=3)
    t, rms = quiet.t[:40].tolist(), np.exp(quiet.ln_rms[:40]).tolist()
    clean = [DamageInput(*block) for block in zip(t, rms, strict=True)]
    spiky = [replace(block, rms=block.rms * (20.0 if i % 9 == 3 else 1.0)) for i, block in enumerate(clean)]
    (_, ours), (_, theirs) = taken(clean, model, baseline=1.0), taken(spiky, model, baseline=1.0)
    assert abs(math.log(theirs.tt / ours.tt)) < 0.1


@given(st.lists(st.floats(-3.0, 3.0), min_size=4, max_size=150), st.floats(0.01, 1e5))
def test_the_history_is_bounded_and_comes_back_bit_for_bit(levels: list[float], interval: float) -> None:
    history = StageHistory.begin(5.0)
    for i, level in enumerate(levels):
        history = history.add(5.0 + interval * i, level)
    assert len(history.bins) < MAX_BINS
    assert len(history.recent) <= 5
    assert history.count == len(levels)
    back = StageHistory.from_dict(json.loads(json.dumps(history.to_dict())))
    assert back == history
    assert back.inputs(0.5).tobytes() == history.inputs(0.5).tobytes()
    # Bins and the one that is filling hold every block once.
    assert history.bin_blocks * len(history.bins) + history.filling[2] == history.count
    assert min(levels) <= history.level <= max(levels)


def test_growth_of_a_line_is_its_slope() -> None:
    history = StageHistory.begin(0.0)
    for i in range(2001):
        history = history.add(float(i), 1e-3 * i)
    whole, half, quarter = history.inputs(0.0)[2:].tolist()
    assert whole == pytest.approx(2.0, rel=0.15)
    assert half == pytest.approx(2.0, rel=0.25)
    assert quarter == pytest.approx(2.0, rel=0.4)


def test_the_model_comes_back_bit_for_bit() -> None:
    model = fit_runs(family(3))
    model = replace(model, scores=scores_out_of_run(family(3)))
    back = LearnedModel.from_dict(json.loads(json.dumps(model.to_dict())))
    assert back.hash == model.hash
    assert replace(model, scale=model.scale * 1.0000001).hash != model.hash
    assert LearnedModel.from_dict(json.loads(json.dumps(LearnedModel().to_dict()))).hash == LearnedModel().hash
    stored = model.to_dict()
    with pytest.raises(ValueError, match="inputs ln_elapsed"):
        LearnedModel.from_dict({**stored, "inputs": ["other"]})
    with pytest.raises(ValueError, match="centre of shape"):
        LearnedModel.from_dict({**stored, "centre": [0.0]})
    with pytest.raises(ValueError, match="version 1 expected"):
        LearnedState.from_dict({"version": 2})


@pytest.mark.parametrize("scale", [0.2, 0.7, 1.0])
def test_crps_against_samples(scale: float) -> None:
    found = Distribution(100.0, -0.4, scale)
    p = (np.arange(4000) + 0.5) / 4000
    sample = np.array([found.quantile(float(value)) for value in p])
    for left in (10.0, 80.0, 400.0):
        pinball = np.where(left >= sample, p * (left - sample), (1.0 - p) * (sample - left))
        assert crps(found, left) == pytest.approx(2.0 * pinball.mean(), rel=0.02)
        assert covers(found, left) == (found.quantile(0.1) <= left <= found.quantile(0.9))
    assert found.probability(found.quantile(0.3)) == pytest.approx(0.3)
    assert found.probability(0.0) == 0.0


def test_crps_of_elapsed_time_alone_in_closed_form() -> None:
    for share in (0.25, 0.5, 0.75):
        closed = 1.0 + 2.0 * share * math.log(share)
        assert crps(Distribution(share), 1.0 - share) == pytest.approx(closed, rel=1e-3)


@pytest.mark.parametrize(("freedom", "t", "tail"), [(1, 1.0, 0.75), (2, 2.0**0.5, 0.853553), (9, 2.262157, 0.975)])
def test_student(freedom: int, t: float, tail: float) -> None:
    assert student(freedom, t) == pytest.approx(tail, abs=1e-6)
    assert student(freedom, -t) == pytest.approx(1.0 - tail, abs=1e-6)


def test_a_level_beyond_most_ends_has_probably_crossed() -> None:
    ends = EndLevels(10, math.log(6.0), 0.7)
    assert ends.probability_beyond(math.log(6.0)) == pytest.approx(0.5)
    assert ends.probability_beyond(math.log(60.0)) > 0.98
    assert ends.probability_beyond(0.0) < 0.02
    assert math.isnan(EndLevels(1, 1.0).probability_beyond(1.0))
    # Fewer runs know less.
    assert EndLevels(3, math.log(6.0), 0.7).probability_beyond(0.0) > ends.probability_beyond(0.0)
