from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchmarks.forecast.cases import (
    LEVELS,
    WORST,
    Answers,
    Cases,
    cases_of,
    means,
    no_volume,
    only_time,
    only_volume,
    score,
)
from benchmarks.forecast.library import ask, fitted, without_law
from benchmarks.forecast.lives import load_lives, save_lives
from benchmarks.forecast.naive import constant, lifetimes, of_elapsed_time, of_tracked_volume
from benchmarks.forecast.page import by_moment, renewed
from benchmarks.forecast.population import FRACTIONS, LIBRARY, TEST, THRESHOLD
from models.lives.life import LifeHistory, simulate_lives
from monitor.health.size import DamageInput
from monitor.health.size.library.forecaster import LibrarySettings, LibraryState, step
from monitor.health.size.library.model import Library

SHORT = replace(TEST, durations=(9000.0, 12000.0), interval=600.0, slip=(0.0, 0.0), seed=3)


@cache
def lives() -> tuple[LifeHistory, ...]:
    return tuple(simulate_lives(SHORT, range(18)))


@cache
def library() -> Library:
    return fitted(lives()[6:])


@cache
def cases() -> Cases:
    return cases_of(lives()[:6])


def test_moments_know_the_past_alone() -> None:
    for run, known, t, v_eq, tt in zip(cases().runs, cases().blocks, cases().t, cases().v_eq, cases().tt, strict=True):
        end = run.crossing(THRESHOLD)
        for m, share in enumerate(FRACTIONS):
            assert run.t[known[m] - 1] == t[m] <= share * end
            assert known[m] == run.t.size or run.t[known[m]] > share * end
            assert v_eq[m] == run.v_eq[known[m] - 1]
            assert t[m] + tt[m] == pytest.approx(end)


@pytest.mark.parametrize("features", ["rms", "rms+harmonics", "v_eq"])
def test_an_answer_is_what_block_by_block_steps_give(features: str) -> None:
    found = ask(library(), cases(), features)
    settings = LibrarySettings(features=features)
    for r, life in enumerate(cases().runs[:2]):
        state = LibraryState()
        for k in range(int(cases().blocks[r, -1])):
            block = DamageInput(
                time=float(life.t[k]),
                rms=float(life.rms[k]),
                harmonics=tuple(life.harmonics[k].tolist()),
                load=float(life.load[k]),
                speed=float(life.speed[k]),
                v_eq=float(life.v_eq[k]),
            )
            state, damage, (result,) = step(state, block, library(), settings, thresholds=[THRESHOLD])
            for m in np.flatnonzero(cases().blocks[r] == k + 1):
                assert found.v_eq[r, m] == pytest.approx(damage.v_eq, rel=1e-9, nan_ok=True)
                said = [value for _, value in result.quantiles] or np.full(LEVELS.size, np.nan)
                assert found.tt[r, m] == pytest.approx(np.array(said), rel=1e-9, abs=1e-3, nan_ok=True)


def test_a_missing_answer_is_scored_as_the_constant_guess() -> None:
    guess = constant(cases(), lives()[6:])
    base = score(cases(), guess, guess)
    tt = np.full((*cases().t.shape, LEVELS.size), np.nan)
    tt[0] = cases().tt[0][:, None]
    found = score(cases(), Answers(*no_volume(cases().t.shape), tt), guess)
    assert np.array_equal(found.error[1:], base.error[1:])
    assert found.error[0] == pytest.approx(np.zeros(3), abs=1e-6)
    assert np.all(found.refused[1:] == 1.0)
    assert np.all(found.refused[0] == 0.0)
    assert np.all(base.refused == 0.0)
    assert np.all(np.isnan(found.tt_inside[1:]))
    assert np.all(np.isnan(found.v_error))


def test_a_tracker_without_forecast_has_no_score_of_time() -> None:
    guess = constant(cases(), lives()[6:])
    v_eq = np.where(np.arange(3) == 1, np.nan, cases().v_eq)
    found = score(cases(), only_volume(v_eq, 0.5 * v_eq, 2.0 * v_eq), guess)
    assert np.all(np.isnan(found.error))
    assert np.all(found.refused[:, 1] == 1.0)
    assert found.v_error[:, 1] == pytest.approx(score(cases(), guess, guess).v_error[:, 1])
    assert np.all(found.v_error[:, [0, 2]] == 0.0)


def test_perfect_and_wild_answers_score_so() -> None:
    guess = constant(cases(), lives()[6:])
    exact = np.repeat(cases().tt[..., None], LEVELS.size, axis=2)
    perfect = score(cases(), Answers(cases().v_eq, 0.9 * cases().v_eq, 1.1 * cases().v_eq, exact), guess)
    assert np.max(perfect.error) == pytest.approx(0.0, abs=1e-6)
    assert np.all(perfect.tt_inside == 1.0)
    assert np.all(perfect.v_inside == 1.0)
    assert np.max(np.abs(perfect.v_error)) == 0.0
    assert perfect.v_width == pytest.approx(np.full(cases().t.shape, math.log(1.1 / 0.9)))
    wild = score(cases(), only_time(np.full(cases().t.shape, 1e9)), guess)
    assert np.all(wild.error == WORST)


def test_naive_forecasts_know_nothing_of_the_runs() -> None:
    others = lives()[6:]
    assert lifetimes(others) == pytest.approx([life.crossing(THRESHOLD) for life in others])
    found = of_elapsed_time(cases(), others)
    assert set(found) == {"climatology", "elapsed time alone"}
    assert all(np.all(np.diff(answer.tt, axis=-1) >= 0.0) for answer in found.values())
    straight = [np.linspace(0.0, 2.0 * THRESHOLD, life.t.size) for life in cases().runs]
    evenly = [replace(life, t=np.arange(life.t.size) * 600.0) for life in cases().runs]
    even = Cases(evenly, cases().blocks, cases().t, cases().v_eq, cases().tt, cases().law)
    line = of_tracked_volume(even, straight)["linear"].tt[..., 0]
    for r, life in enumerate(evenly):
        reaches = 0.5 * (life.t.size - 1) * 600.0
        now = life.t[cases().blocks[r] - 1]
        known = cases().blocks[r] > 1
        assert line[r][known] == pytest.approx(np.maximum(reaches - now, 0.0)[known], abs=1e-3)


def test_means_leave_out_runs_without_a_value() -> None:
    values = np.array([[1.0, np.nan], [3.0, np.nan], [5.0, 2.0]])
    found = means(values)
    assert [m.mean for m in found] == [3.0, 2.0]
    assert means(values, np.array([True, True, False]))[0].mean == 2.0


def test_lives_are_kept_as_they_were(tmp_path: Path) -> None:
    save_lives(lives()[:3], tmp_path / "lives.npz")
    for kept, life in zip(load_lives(tmp_path / "lives.npz"), lives()[:3], strict=True):
        assert (kept.number, kept.law) == (life.number, life.law)
        for name in ("t", "load", "speed", "rms", "harmonics", "v_eq", "dphi_d", "h_d"):
            assert np.array_equal(getattr(kept, name), getattr(life, name))
        assert kept.crossing(THRESHOLD) == life.crossing(THRESHOLD)


def test_a_library_without_a_law_has_none_of_it() -> None:
    kept = without_law(lives(), "power")
    assert {life.law for life in kept} == {life.law for life in lives()} - {"power"}


def test_the_test_population_is_another_one() -> None:
    assert TEST.seed != LIBRARY.seed
    assert TEST.floor_sd != LIBRARY.floor_sd
    assert dict(TEST.rig_spread) != dict(LIBRARY.rig_spread)


def test_the_page_is_renewed_between_its_marks_alone() -> None:
    page = "before\n<!-- a of benchmarks.forecast.methods -->\nold\n<!-- end -->\nafter\n<!-- end -->\n"
    new = renewed(page, {"a": "| new |"})
    assert "old" not in new
    assert new.startswith("before\n<!-- a of benchmarks.forecast.methods -->\n\n| new |\n\n<!-- end -->\nafter\n")
    assert renewed(new, {"a": "| new |"}) == new
    with pytest.raises(ValueError, match="b of benchmarks"):
        renewed(page, {"b": ""})


def test_three_moments_share_a_cell_and_what_is_missing_says_so() -> None:
    rows = [{"method": "m", "crps_min": crps, "refused": None} for crps in (1.2, 2.6, None)]
    assert (
        by_moment(rows, {"method": "method"}, ["TT: CRPS, min", "refused"]).splitlines()[2] == "| m | 1 / 3 / - | - |"
    )
