"""The filter says when damage stands still, refuses steps that no damage makes, and goes on after a gap."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from monitor.health.size import Damage, DamageInput
from monitor.health.size.filter.particle_filter import FilterState, step
from monitor.health.size.filter.particles import LN_V, STILL, Particles, grow
from monitor.health.size.filter.prior import ErrorModel, GrowthPrior, build_lookup
from tests.support.effort import effort_count
from tests.support.filter import MICRON, MM2, RADIUS, SETTINGS, TOY, follow, toy_life, toy_map


def held_life(v_eq: float, blocks: int, seed: int) -> list[DamageInput]:
    """Levels of a damage that does not grow, ``v_eq`` in mm2, with the errors of one sensor."""
    rng = np.random.default_rng(seed)
    v = np.full(blocks, v_eq * MM2)
    h_d = 10 * MICRON * (v / (0.05 * MM2)) ** 0.45
    factor = np.exp(0.12 * rng.standard_normal(7) + 0.02 * rng.standard_normal((blocks, 7)))
    dphi_d = v / (RADIUS * h_d)
    rms = np.hypot(TOY.interpolate(dphi_d, h_d) * factor[:, 0], 0.5)
    harmonics = np.hypot(TOY.interpolate_harmonics(dphi_d, h_d) * factor[:, 1:], 0.05)
    rows = zip(rms.tolist(), harmonics.tolist(), strict=True)
    return [DamageInput(300.0 * k, level, tuple(lines)) for k, (level, lines) in enumerate(rows)]


def test_a_damage_that_stands_still_is_said_and_its_volume_does_not_drift() -> None:
    found = [follow(held_life(0.02, 96, seed))[1][-1] for seed in range(4)]
    assert np.mean([one.p_no_growth for one in found]) > 0.5
    assert abs(np.mean(np.log([one.v_eq / (0.02 * MM2) for one in found]))) < 0.35


def test_growing_damage_does_not_stand_still() -> None:
    for seed in range(3):
        blocks, _ = toy_life(60, seed=seed)
        found = [one.p_no_growth for one in follow(blocks)[1]]
        assert max(found[30:]) < 0.2, seed


@pytest.mark.parametrize("gain", [3.0, 0.3])
def test_a_gain_that_changes_is_implausible_and_leaves_no_trace(gain: float) -> None:
    blocks, _ = toy_life(40)
    state, _ = follow(blocks[:30])
    other = replace(
        blocks[30], rms=gain * blocks[30].rms, harmonics=tuple(gain * x for x in blocks[30].harmonics or ())
    )
    after, damage = step(state, other, map_slice=TOY, settings=SETTINGS)
    assert damage.status == "implausible"
    assert np.isnan(damage.v_eq)
    assert after is state
    assert step(state, other, map_slice=TOY, settings=replace(SETTINGS, implausible_sd=1e9))[1].status != "implausible"


def test_sound_lives_are_not_implausible() -> None:
    for seed in range(6):
        blocks, _ = toy_life(60, seed=seed)
        assert "implausible" not in {str(one.status) for one in follow(blocks)[1]}, seed


def test_after_a_gap_of_the_logging_the_filter_goes_on() -> None:
    blocks, v = toy_life(40)
    late = [one if k < 25 else replace(one, time=one.time + 20 * 3600.0) for k, one in enumerate(blocks)]
    found = follow(late)[1][-1]
    assert found.status in ("ok", "ambiguous")
    assert found.v_eq_lower / 1.5 < v[-1] < 1.5 * found.v_eq_upper


def still_particles(count: int, intervals: float) -> Particles:
    core = np.zeros((count, 8))
    core[:, :3] = math.log(0.01 * MM2), math.log(5e-6), math.log(1e-12)
    core[:, STILL] = intervals
    return Particles(core, np.full(count, 1.0 / count), np.zeros((count, 1, 2)), np.zeros((count, 1, 3)))


def test_growing_damage_comes_to_a_standstill_at_its_rate() -> None:
    growth = GrowthPrior(stops=0.01)
    after = grow(still_particles(20_000, 0.0), np.random.default_rng(1), 10 * growth.interval, growth)
    stands = after.core[:, STILL] > 0.0
    assert np.mean(stands) == pytest.approx(-math.expm1(-0.1), rel=0.06)
    assert set(after.core[stands, STILL]) == {10.0}


@pytest.mark.parametrize(("intervals", "rate"), [(1.0, 0.01), (30.0, 0.01), (3000.0, 1e-4)])
def test_the_longer_it_stood_the_longer_it_will(intervals: float, rate: float) -> None:
    growth = GrowthPrior(starts=0.01)
    after = grow(still_particles(20_000, intervals), np.random.default_rng(1), 10 * growth.interval, growth)
    grows = after.core[:, STILL] == 0.0
    # As many begin as at the largest rate; their weight is that of the real one.
    assert np.mean(grows) == pytest.approx(-math.expm1(-0.1), rel=0.06)
    assert after.weight[grows].sum() == pytest.approx(-math.expm1(-10.0 * rate), rel=0.06)
    assert after.weight.sum() == pytest.approx(1.0)
    assert set(after.core[~grows, STILL]) == {intervals + 10.0}
    assert set(after.core[~grows, LN_V]) == {math.log(0.01 * MM2)}


def test_a_long_standstill_does_not_drift_and_memory_stays_constant() -> None:
    updates = effort_count(quick=300, full=100_000)
    life, sizes = held_life(0.02, 200, 0), set[int]()
    state, damage = step(FilterState(), life[0], map_slice=TOY, settings=SETTINGS)
    for k in range(1, updates):
        state, damage = step(state, replace(life[k % 200], time=300.0 * k), map_slice=TOY, settings=SETTINGS)
        if k >= 100:
            sizes.add(len(json.dumps(state.to_dict())) // 100)
    assert damage.v_eq_lower < 0.02 * MM2 < damage.v_eq_upper
    assert damage.p_no_growth > 0.8
    assert len(sizes) <= 2


def test_a_state_without_standstill_goes_on() -> None:
    state, _ = follow(toy_life(20)[0])
    stored = json.loads(json.dumps(state.to_dict()))
    assert FilterState.from_dict(stored).to_dict() == stored
    particles = state.particles
    assert particles is not None
    older = replace(particles, core=particles.core[:, :STILL])
    old = {key: value for key, value in stored.items() if key != "interval"} | {"version": 1}
    restored = FilterState.from_dict(old | {"particles": older.to_dict()})
    assert restored.particles is not None
    assert not restored.particles.core[:, STILL].any()
    np.testing.assert_array_equal(restored.particles.core[:, :STILL], older.core)


ERRORS = ErrorModel()


def rms_spread(common: float = 0.0, rig: float = 0.0, floors: float = 0.0) -> tuple[float, np.ndarray]:
    """Return the standard deviation of the gain of the RMS, and that of the rest at each depth, at one extent."""
    plain = toy_map(spread=floors)
    shared = np.array([common, *[0.0] * 6])
    lookup = build_lookup(replace(plain, rms_rig_std=rig * plain.rms, rig_common=shared), ERRORS, 1)
    assert lookup is not None
    spread = lookup.table[:, 2].reshape(plain.h_d.size, plain.dphi_d.size)
    return float(lookup.gains[0]), spread[:, 40]


def test_the_spread_that_all_nodes_share_is_a_gain_and_the_rest_is_not() -> None:
    gain, rest = rms_spread(rig=0.5, floors=0.2)
    assert gain == ERRORS.rms_gain_sd
    assert rest[9] == pytest.approx(math.sqrt(math.log1p(0.5**2 + 0.2**2)))
    gain, rest = rms_spread(common=0.4, rig=0.5, floors=0.2)
    assert gain == pytest.approx(math.hypot(ERRORS.rms_gain_sd, 0.4))
    assert rest[9] == pytest.approx(math.sqrt(math.log1p(0.3**2 + 0.2**2)))
    # No rest is left where nodes differ by less than what they share.
    assert rms_spread(common=0.6, rig=0.5, floors=0.2)[1][9] == pytest.approx(math.sqrt(math.log1p(0.2**2)))


def test_rigs_drawn_over_one_floor_do_not_hide_that_floors_differ() -> None:
    _, rest = rms_spread(rig=0.12)
    # At 9 um floors alone spread the RMS by 8 %, at 2 um by 25 %.
    assert rest[9] == pytest.approx(math.sqrt(math.log1p(0.12**2 + math.expm1(0.08**2))))
    assert rest[2] > 0.25
    # A map of several floors has their spread.
    assert rms_spread(rig=0.12, floors=0.15)[1][2] == pytest.approx(math.sqrt(math.log1p(0.12**2 + 0.15**2)))


def widths(results: list[Damage]) -> float:
    """Return the median width of the interval of ln V_eq over the second half."""
    return float(np.median([math.log(r.v_eq_upper / r.v_eq_lower) for r in results[len(results) // 2 :]]))


def inside(results: list[Damage], v: np.ndarray) -> float:
    """Return the share of the blocks of the second half whose interval holds the truth."""
    half = len(results) // 2
    held = [r.v_eq_lower <= x <= r.v_eq_upper for r, x in zip(results[half:], v[half:], strict=True)]
    return float(np.mean(held))


def test_a_rig_that_is_off_everywhere_widens_the_interval_until_it_holds_the_truth() -> None:
    inputs, v = toy_life()
    # All that the machine shows is 1.7 times what the map says, beside the gain of the sensor.
    off = [
        DamageInput(one.time, 1.7 * one.rms, tuple(1.7 * line for line in one.harmonics or ()), one.load, one.speed)
        for one in inputs
    ]
    found = {
        common: follow(off, SETTINGS, replace(TOY, rig_common=np.full(7, common)))[1] for common in (0.0, 0.2, 0.5)
    }
    assert widths(found[0.0]) < widths(found[0.2]) < widths(found[0.5])
    assert inside(found[0.0], v) < inside(found[0.5], v)
    assert inside(found[0.5], v) > 0.8
