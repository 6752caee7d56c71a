"""The judge of V_eq and TT: its laws, its lives, and its scores against answers made by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.forecast.cases import LEVELS, Answers, score
from benchmarks.unseen import ask as unseen_ask
from benchmarks.unseen import causes as unseen_causes
from benchmarks.unseen import judge as unseen
from benchmarks.unseen import nonsense as unseen_nonsense
from benchmarks.unseen.laws import DURATIONS, LAWS, OTHER_LAWS, START, THRESHOLD, draw_growth
from benchmarks.unseen.lives import INTERVAL, LifeOptions, UnseenLife, simulate_life
from benchmarks.unseen.nonsense import Flags
from benchmarks.unseen.seeds import DEVELOPMENT_FIRST_SEED, JUDGED_FIRST_SEED, TEST_FIRST_SEED
from models.lives import laws as library_laws


@given(law=st.sampled_from([*LAWS, *OTHER_LAWS]), seed=st.integers(0, 2**32))
def test_damage_grows_from_its_start_to_the_threshold(law: str, seed: int) -> None:
    growth = draw_growth(law, np.random.default_rng(seed))
    assert np.all(np.diff(growth.v_eq) >= 0.0)
    assert START[0] * (1.0 - 1e-9) <= growth.v_eq[0] <= START[1] * (1.0 + 1e-9)
    assert growth.v_eq[-1] == pytest.approx(THRESHOLD)
    assert growth.t[0] == 0.0
    assert DURATIONS[0] <= growth.crossing <= DURATIONS[1] * (1.0 + 1e-9)
    # Within what the thesis' maps hold: 32 um, 50 degrees.
    assert np.all((growth.h_d > 0.0) & (growth.h_d <= 32e-6))
    assert np.max(growth.v_eq / growth.h_d) <= np.radians(50.0) * 0.0229


def test_held_damage_stands_still_and_never_crosses() -> None:
    growth = draw_growth("gradual", np.random.default_rng(3))
    held = growth.held_from(0.5 * growth.crossing, 2.0 * growth.crossing)
    before, after, late = (held.at(np.array([share * growth.crossing]))[0][0] for share in (0.4, 0.6, 1.9))
    assert before < after == late < THRESHOLD
    assert np.isinf(held.crossing)


def test_depth_comes_after_extent() -> None:
    growth = draw_growth("depth_after_extent", np.random.default_rng(5))
    extent = growth.v_eq / growth.h_d
    assert growth.h_d[200] == growth.h_d[0]
    assert extent[200] > extent[0]
    assert extent[-1] == pytest.approx(extent[-100])
    assert growth.h_d[-1] > growth.h_d[-100]


def test_the_judge_shares_no_law_with_the_library() -> None:
    assert not {law.__module__ for law in LAWS.values()} & {library_laws.__name__}
    seeds = sorted((JUDGED_FIRST_SEED, DEVELOPMENT_FIRST_SEED, TEST_FIRST_SEED))
    assert np.all(np.diff(seeds) > 10_000)


@pytest.fixture(scope="module")
def life() -> UnseenLife:
    """Return a short life."""
    return simulate_life("gradual", 0, TEST_FIRST_SEED, LifeOptions((7500.0, 7600.0), until=0.75))


def test_features_are_finite_and_blocks_end_where_asked(life: UnseenLife) -> None:
    assert life.t[0] == 0.0
    assert 0.75 * life.crossing - 13 * INTERVAL < life.t[-1] <= 0.75 * life.crossing + INTERVAL
    for values in (life.rms, life.harmonics, life.load, life.speed, life.v_eq):
        assert np.all(np.isfinite(values) & (values > 0.0))
    assert life.harmonics.shape == (life.t.size, 6)
    again = simulate_life("gradual", 0, TEST_FIRST_SEED, LifeOptions((7500.0, 7600.0), until=0.75))
    assert np.array_equal(life.rms, again.rms)


def test_changes_begin_at_their_cause(life: UnseenLife) -> None:
    rng, cause = np.random.default_rng(0), 6
    for change in (unseen_causes.noise, unseen_causes.gain, unseen_causes.dead):
        changed = change(rng, life, cause)
        assert np.array_equal(changed.rms[:cause], life.rms[:cause])
        assert np.all(changed.rms[cause:] != life.rms[cause:])
    late = unseen_causes.gap(rng, life, cause)
    assert late.t[cause] - late.t[cause - 1] == pytest.approx(20 * 3600 + life.t[cause] - life.t[cause - 1])
    assert unseen_causes.gain(rng, life, cause).rms[-1] == pytest.approx(3.0 * life.rms[-1])


def _made(crossings: list[float]) -> list[UnseenLife]:
    found: list[UnseenLife] = []
    for k, end in enumerate(crossings):
        t = np.arange(0.0, end, 100.0)
        v_eq = THRESHOLD * (t + 1.0) / (end + 1.0)
        one = np.ones(t.size)
        found.append(UnseenLife("gradual" if k % 2 else "steps", k, t, one, one, one, np.ones((t.size, 6)), v_eq, end))
    return found


def test_moments_are_the_last_blocks_before_their_share() -> None:
    cases = unseen_ask.moments_of(_made([1000.0, 2050.0]))
    assert cases.blocks.tolist() == [[3, 6, 8], [6, 11, 16]]
    assert cases.t[0].tolist() == [200.0, 500.0, 700.0]
    assert cases.tt[1].tolist() == [1550.0, 1050.0, 550.0]


def test_scores_of_answers_made_by_hand() -> None:
    cases = unseen_ask.moments_of(_made([1000.0, 2000.0, 3000.0, 4000.0]))
    right = np.repeat(cases.tt[..., None], LEVELS.size, axis=-1)
    known = Answers(cases.v_eq, 0.9 * cases.v_eq, 1.1 * cases.v_eq, right)
    # Twice V_eq, too narrow; TT twice as long in two of four lives, nothing said in one.
    wrong_tt = right * np.array([1.0, 2.0, 2.0, np.nan])[:, None, None]
    wrong = Answers(2.0 * cases.v_eq, 1.9 * cases.v_eq, 2.1 * cases.v_eq, wrong_tt)
    guess = unseen.naive(cases, np.array([2000.0, 4000.0]), cases.v_eq)
    scores = {
        name: score(cases, answers, guess[unseen.CONSTANT])
        for name, answers in ((unseen.RMS, wrong), (unseen.LINES, known), (unseen.BOUND, wrong))
    }
    scores |= {name: score(cases, answers, guess[unseen.CONSTANT]) for name, answers in guess.items()}
    scored = unseen.Scored(cases.law, scores, {})
    assert scored.mean(unseen.LINES, "crps_min") == [0.0, 0.0, 0.0]
    assert scored.mean(unseen.LINES, "tt_inside") == [1.0, 1.0, 1.0]
    assert scored.mean(unseen.RMS, "v_rms") == pytest.approx([np.log(2.0)] * 3)
    assert scored.mean(unseen.RMS, "v_inside") == [0.0, 0.0, 0.0]
    assert scored.mean(unseen.RMS, "refused") == [0.25] * 3
    assert scored.mean(unseen.RMS, "tt_inside") == pytest.approx([1 / 3] * 3)
    # The unanswered life counts as the constant: a median life of 3000 s less the time gone, of 4000 s.
    errors = [*cases.tt[1], *cases.tt[2], 1000.0, 1000.0, 1000.0]
    assert 60.0 * 4.0 * sum(scored.mean(unseen.RMS, "crps_min")) == pytest.approx(sum(errors))
    rows = {str(row["what"]): row["met"] for row in unseen.asked_rows(scored)}
    assert rows[f"rms of ln V_eq, {unseen.RMS}"] == "MISS"
    assert rows[f"rms of ln V_eq, {unseen.LINES}"] == "pass"
    # An interval that always holds is too wide.
    assert rows[f"coverage of TT, {unseen.LINES}"] == "MISS"
    assert rows[f"CRPS over clock, {unseen.LINES}"] == "pass"


def test_flags_count_from_their_cause_on() -> None:
    quiet: tuple[str, ...] = ()
    early = Flags((("no_map",), quiet, quiet, quiet), cause=2)
    late = Flags((quiet, quiet, quiet, ("no_growth",)), cause=2)
    assert early.delay is None
    assert late.delay == 1
    row = unseen_nonsense.cause_row("stall", "yes", "library", [early, late])
    assert (row["flagged"], row["before"], row["at_last"]) == (0.5, 0.5, 0.5)
    far = Flags((quiet,) * (unseen_causes.WATCHED + 3) + (("no_map",),), cause=2)
    assert far.delay is None


def test_standstill_said_of_a_sound_life_is_counted_apart(life: UnseenLife) -> None:
    cases = [unseen_causes.Case(life, 0)] * 2
    found = [Flags((("no_growth",),), 0), Flags((("implausible",),), 0)]
    every, steady = unseen_nonsense.sound_rows("library", cases, found)
    assert (every["ever_flagged"], every["but_no_growth"], every["met"]) == (1.0, 0.5, "MISS")
    assert steady["count"] == 2
