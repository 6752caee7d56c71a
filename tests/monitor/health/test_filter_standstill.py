"""The filter says when damage stands still, refuses steps that no damage makes, and goes on after a gap."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from monitor.health.damage import DamageInput
from monitor.health.damage.filter.particle_filter import FilterState, step
from monitor.health.damage.filter.particles import STILL, grow
from monitor.health.damage.filter.prior import GrowthPrior
from tests.monitor.health.test_filter import MICRON, MM2, RADIUS, SETTINGS, TOY, follow, toy_life


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


def test_standstill_begins_and_ends_at_its_rates() -> None:
    growth = GrowthPrior(still=0.5, stops=0.01, starts=0.03)
    state, _ = follow(toy_life(5)[0], replace(SETTINGS, growth=growth, particles=4000))
    assert state.particles is not None
    long_after = grow(state.particles, np.random.default_rng(1), 1e7, growth)
    assert np.mean(long_after.core[:, STILL]) == pytest.approx(0.25, abs=0.03)
    once = grow(state.particles, np.random.default_rng(1), 300.0, growth)
    began = state.particles.core[:, STILL] == 1.0
    assert np.mean(once.core[began, STILL]) == pytest.approx(np.exp(-0.03), abs=0.02)
    np.testing.assert_array_equal(once.core[began, 0], state.particles.core[began, 0])


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
