"""Lives that stand still: what the library forecaster says of them, and when it does not say so."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from monitor.health.size import DamageInput, TtStatus
from monitor.health.size.library.calibrate import RecordedRun, calibrate
from monitor.health.size.library.fit import crps, stands_still
from monitor.health.size.library.forecaster import (
    STANDING_BLOCKS,
    LibrarySettings,
    LibraryState,
    Moment,
    _forecast,
    step,
)
from monitor.health.size.library.model import Library
from monitor.records.library_file import load_library, save_library
from tests.oracles.toy_lives import INTERVAL, THRESHOLD, standing_library, standing_life, toy_library, toy_life
from tests.support.effort import effort_count
from tests.support.followed_lives import blocks_of, follow


def test_a_standstill_is_said_and_its_v_eq_does_not_creep_on() -> None:
    library = standing_library()
    assert library.made_of["never_reached"] == 30
    late: list[float] = []
    statuses: list[str] = []
    for number in range(100, 100 + effort_count(quick=3, full=20)):
        life = standing_life(number, seed=8)
        _, results = follow(blocks_of(life), library)
        late.append(math.log(results[-1].damage.v_eq / life.v_eq[-1]))
        statuses += [str(result.forecasts[0].status) for result in results[100:]]
        for damage, (forecast,) in results[5:]:
            assert damage.p_no_growth == forecast.p_no_growth
            assert (forecast.status == "no_growth") <= (math.isnan(forecast.tt) and forecast.p_no_growth >= 0.5)
            if forecast.status == "ok":
                assert math.isinf(forecast.tt_upper) == (forecast.p_no_growth > 0.5 * (1.0 - 0.8))
                assert all(math.isfinite(value) for _, value in forecast.quantiles)
    assert abs(np.mean(late)) < 0.15
    assert statuses.count("no_growth") > 0.6 * len(statuses)


def test_many_updates_leave_v_eq_where_it_is_and_the_state_as_large() -> None:
    library = standing_library()
    # No life lasts so long; it is about arithmetic and memory.
    fits = {name: replace(fit, longest=math.inf, limits=None) for name, fit in library.fits.items()}
    library, blocks = replace(library, fits=fits), blocks_of(standing_life(101, seed=8))[100:]
    updates, state, found, sizes = effort_count(quick=200, full=100_000), LibraryState(), [], []
    for number in range(updates):
        block = replace(blocks[number % len(blocks)], time=number * INTERVAL)
        asked = [THRESHOLD] if number > updates - 20 else []
        state, damage, _ = step(state, block, library, thresholds=asked)
        found.append(damage.v_eq)
        if number >= updates // 2:
            sizes.append(len(json.dumps(state.to_dict())) if number % (updates // 20) == 0 else 0)
    half = np.array(found[updates // 2 :])
    assert np.isfinite(half).all()
    assert abs(math.log(np.median(half[-50:]) / np.median(half[:50]))) < 0.1
    assert max(sizes) < 12_000
    again = LibraryState.from_dict(json.loads(json.dumps(state.to_dict())))
    after = replace(blocks[0], time=updates * INTERVAL)
    assert repr(step(again, after, library, thresholds=[THRESHOLD])) == repr(
        step(state, after, library, thresholds=[THRESHOLD])
    )


def test_growing_lives_are_not_said_to_stand_still() -> None:
    statuses = [
        str(result.forecasts[0].status)
        for number in range(200, 200 + effort_count(quick=3, full=20))
        for result in follow(blocks_of(toy_life(number)), standing_library())[1]
    ]
    assert statuses.count("no_growth") < 0.05 * len(statuses)


def test_the_probability_of_no_growth_is_the_share_of_standing_moments() -> None:
    fit = standing_library().fit_for("rms+harmonics")
    rows = range(0, len(fit.standing), 3)
    p = np.array([fit.p_no_growth(float(fit.said[r, -1]), 60, int(fit.life[r])) for r in rows])
    stood = fit.standing[::3]
    assert abs(p.mean() - stood.mean()) < 0.03
    between = (p > 0.3) & (p < 0.7)
    assert 0.25 < stood[between].mean() < 0.75
    assert stood[p < 0.1].mean() < 0.1
    assert stood[p > 0.9].mean() > 0.8


def test_no_growth_is_claimed_only_after_blocks_in_succession_that_say_so() -> None:
    library, state, standing, early = standing_library(), LibraryState(), 0, 0
    for block in blocks_of(standing_life(102, seed=8)):
        state, _, (forecast,) = step(state, block, library, thresholds=[THRESHOLD])
        standing = standing + 1 if forecast.p_no_growth >= 0.5 else 0
        assert state.standing == standing
        assert (forecast.status == TtStatus.NO_GROWTH) == (standing >= STANDING_BLOCKS)
        early += 0 < standing < STANDING_BLOCKS and forecast.status == TtStatus.OK
    assert standing > STANDING_BLOCKS
    assert early


def test_a_state_before_the_count_of_standing_blocks_is_read() -> None:
    state, _ = follow(blocks_of(toy_life(2000))[:8], toy_library())
    stored = state.to_dict() | {"version": 2}
    del stored["standing"]
    assert LibraryState.from_dict(stored) == replace(state, standing=0)


def moment(still: float) -> Moment:
    """Return a moment with a probability that V_eq stands still."""
    return Moment(predicted=(), ln_elapsed=0.0, blocks=20, t=0.0, p_no_growth=still, stands=still >= 0.5)


def test_no_growth_lowers_the_probability_of_reaching_the_threshold() -> None:
    sample, window = np.linspace(1e3, 2e4, 200), LibrarySettings(window=1e4)
    grows, may_stand = (_forecast(sample, THRESHOLD, moment(still), window, below=False) for still in (0.0, 0.3))
    assert may_stand.p_threshold == pytest.approx(0.7 * grows.p_threshold)
    assert may_stand.tt == grows.tt
    assert (math.isinf(may_stand.tt_upper), math.isinf(grows.tt_upper)) == (True, False)
    stands, beyond = (_forecast(0.0 * sample, THRESHOLD, moment(0.9), window, below=below) for below in (True, False))
    assert (stands.status, beyond.status) == (TtStatus.NO_GROWTH, TtStatus.ALREADY_CROSSED)
    assert math.isnan(stands.p_threshold)


@pytest.mark.parametrize(("tail", "expected"), [(1.0, True), (1.002, False)])
def test_a_life_stands_still_where_it_grows_by_less_than_a_thousandth_in_twelve_blocks(
    tail: float, expected: bool
) -> None:
    v_eq = np.concatenate((np.linspace(1.0, 2.0, 40), 2.0 * tail ** (np.arange(40) / 12.0)))
    stood = stands_still(v_eq)
    assert not stood[:39].any()
    assert set(stood[40:].tolist()) == {expected}
    assert not stands_still(v_eq[:1]).any()


AT = 2
"""Place of the threshold among the targets of a fit: V_eq, 0.03 mm2, 0.05 mm2."""


def recorded(number: int, *, left: float = 1.0) -> RecordedRun:
    """A toy life as a recorded run; on this rig the parts fail when ``left`` of what the library expects has passed."""
    life = toy_life(number)
    return RecordedRun(
        f"run {number}", life.t, life.rms, life.harmonics, life.load, life.speed, left * life.crossing(THRESHOLD)
    )


def errors(known: Library, numbers: range, left: float, features: str) -> tuple[float, float]:
    """CRPS and coverage at half of the time, over runs."""
    scores, covered = [], []
    for number in numbers:
        run = recorded(number, left=left)
        state, _, forecasts = step(LibraryState(), DamageInput(0.0), None, thresholds=[THRESHOLD])
        for i in np.flatnonzero(run.t <= 0.5 * run.end):
            block = DamageInput(
                float(run.t[i]), float(run.rms[i]), tuple(run.harmonics[i]), float(run.load[i]), float(run.speed[i])
            )
            state, _, forecasts = step(state, block, known, LibrarySettings(features=features), thresholds=[THRESHOLD])
        (forecast,) = forecasts
        remains = run.end - state.history.t_first - state.history.elapsed if state.history else 0.0
        levels, quantiles = zip(*forecast.quantiles, strict=True)
        scores.append(crps(np.interp(np.linspace(0, 1, 99), levels, quantiles), remains))
        covered.append(forecast.tt_lower <= remains <= forecast.tt_upper)
    return float(np.mean(scores)), float(np.mean(covered))


@pytest.mark.parametrize("features", ["rms", "rms+harmonics"])
def test_runs_of_a_rig_that_fails_early_put_it_right(features: str) -> None:
    runs = [recorded(number, left=0.6) for number in range(5000, 5012)]
    known = calibrate(toy_library(), runs, features=features, threshold=THRESHOLD)
    unseen = range(6000, 6000 + effort_count(quick=25, full=200))
    before, covered_before = errors(toy_library(), unseen, 0.6, features)
    after, covered_after = errors(known, unseen, 0.6, features)
    assert after < 0.8 * before
    assert covered_after > covered_before
    assert covered_after >= 0.6


def test_runs_like_the_library_change_little() -> None:
    runs = [recorded(number) for number in range(7000, 7030)]
    known = calibrate(toy_library(), runs, features="rms", threshold=THRESHOLD)
    fit = known.fits["rms"]
    assert abs(fit.shift[AT]) < 0.15
    assert 0.8 < fit.stretch[AT] < 1.25


def test_the_fewer_runs_the_less_is_changed() -> None:
    shifts = []
    for count in (1, 4, 16):
        runs = [replace(recorded(5000, left=0.6), name=str(i)) for i in range(count)]
        shifts.append(calibrate(toy_library(), runs, features="rms", threshold=THRESHOLD).fits["rms"].shift[AT])
    assert shifts[2] < shifts[1] < shifts[0] < 0.0
    assert shifts[1] == pytest.approx(2.5 * shifts[0])


def test_it_is_said_kept_and_not_added_up(tmp_path: Path) -> None:
    runs = [recorded(number, left=0.6) for number in range(5000, 5004)]
    once = calibrate(toy_library(), runs, features="rms", threshold=THRESHOLD)
    assert once.prior == "toy lives; calibrated on 4 recorded runs"
    assert once.calibration["rms 0.05"]["runs"] == 4
    assert once.hash != toy_library().hash
    assert once.fits["v_eq"] is toy_library().fits["v_eq"]
    assert once.fits["rms"].shift[0] == 0.0
    assert calibrate(once, runs, features="rms", threshold=THRESHOLD).hash == once.hash
    save_library(once, tmp_path / "a.npz")
    assert load_library(tmp_path / "a.npz").hash == once.hash


def test_blocks_without_figures_are_passed_over() -> None:
    run = recorded(5001, left=0.6)
    spoiled = replace(run, rms=np.where(np.arange(len(run.t)) % 7 == 3, np.nan, run.rms))
    known = calibrate(toy_library(), [spoiled], features="rms", threshold=THRESHOLD).fits["rms"].shift[AT]
    whole = calibrate(toy_library(), [run], features="rms", threshold=THRESHOLD).fits["rms"].shift[AT]
    assert known == pytest.approx(whole, abs=0.03)


def test_runs_outside_the_library_are_left_out_and_named_where_all_are() -> None:
    far = replace(recorded(5000), load=np.full(len(recorded(5000).t), 9000.0), name="far")
    known = calibrate(toy_library(), [far, recorded(5001)], features="rms", threshold=THRESHOLD)
    assert known.calibration["rms 0.05"] | {"shift": 0, "stretch": 0} == {
        "runs": 1,
        "left_out": 1,
        "shift": 0,
        "stretch": 0,
    }
    with pytest.raises(ValueError, match=r"no moment of any run lies within the library \(far\)"):
        calibrate(toy_library(), [far], features="rms", threshold=THRESHOLD)
    with pytest.raises(ValueError, match="got 'v_eq'"):
        calibrate(toy_library(), [recorded(5001)], features="v_eq", threshold=THRESHOLD)
    with pytest.raises(ValueError, match="no runs were given"):
        calibrate(toy_library(), [], features="rms", threshold=THRESHOLD)
