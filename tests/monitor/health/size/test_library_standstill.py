"""Lives that stand still: what the library forecaster says of them, and when it does not say so."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from monitor.health.size import TtStatus
from monitor.health.size.library.fit import stands_still
from monitor.health.size.library.forecaster import (
    STANDING_BLOCKS,
    LibrarySettings,
    LibraryState,
    Moment,
    _forecast,
    step,
)
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
