from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.health.size import Damage, DamageInput, EdvStatus
from monitor.health.size.filter.particle_filter import (
    FilterSettings,
    FilterState,
    step,
)
from monitor.health.size.filter.particles import (
    GAIN,
    LN_H,
    LN_V,
    Particles,
    assimilate,
    decorrelate,
    draw,
    grow,
    resample,
)
from monitor.health.size.filter.prior import ErrorModel, GrowthPrior, build_lookup
from monitor.health.size.level_set import LevelMap
from monitor.health.tracker import DamageGate, DamageSettings, DamageState, PartMap, TrackMethod
from monitor.health.tracker import step as damage_step
from tests.oracles.filter_oracle import latest_b_and_z, posterior_of_one_block, strangeness
from tests.support.effort import effort_count
from tests.support.filter import MICRON, MM2, RADIUS, SETTINGS, TOY, follow, toy_life, toy_map

CARRIES = (EdvStatus.OK, EdvStatus.AMBIGUOUS)


def test_a_life_with_lines_is_followed_and_inside_its_interval() -> None:
    inputs, v = toy_life()
    _, results = follow(inputs)
    error = np.log([r.v_eq for r in results] / v)
    inside = [r.v_eq_lower <= x <= r.v_eq_upper for r, x in zip(results, v, strict=True)]
    assert {r.status for r in results} <= set(CARRIES)
    assert np.sqrt(np.mean(error**2)) < 0.35
    assert np.mean(inside) > 0.6


def test_lines_of_bpfo_narrow_the_interval_that_rms_alone_leaves_wide() -> None:
    inputs, _ = toy_life()
    sure = ErrorModel(gain_sd=0.05, rms_gain_sd=0.02, harmonic_gain_sd=0.02, rms_model_sd=0.2, harmonic_model_sd=0.2)
    options = replace(SETTINGS, errors=sure)
    _, with_lines = follow(inputs, options)
    _, without = follow([replace(lookup, harmonics=None) for lookup in inputs], options)

    def width(results: list[Damage]) -> float:
        return float(np.median([math.log(r.v_eq_upper / r.v_eq_lower) for r in results]))

    assert width(with_lines) < 0.8 * width(without)


@settings(max_examples=effort_count(quick=6, full=200))
@given(st.integers(0, 2**32 - 1), st.integers(1, 12))
def test_the_kalman_filters_of_a_path_are_one_large_gaussian(seed: int, blocks: int) -> None:
    rng = np.random.default_rng(seed)
    errors = ErrorModel(freedom=1e12)
    lookup = build_lookup(TOY, errors, 2)
    assert lookup is not None
    first = draw(rng, 1, lookup.gains, GrowthPrior(), errors)
    particles = Particles(first.core[:2], np.full(2, 0.5), first.mean[:2], first.cov[:2])
    noise = rng.uniform(1e-3, 0.1, (blocks, 3))
    ln_x = rng.normal(1.0, 0.5, (blocks, 3))
    distance = rng.uniform(0.0, 0.5, (blocks, 3))
    rows = []
    for k in range(blocks):
        if k:
            core = particles.core.copy()
            core[:, [LN_V, LN_H]] += rng.uniform(0.0, 0.05, (2, 2))
            moved = Particles(core, particles.weight, particles.mean, particles.cov)
            particles = decorrelate(moved, np.tile(distance[k], (2, 1)))
        rows.append(lookup.at(*particles.sizes(RADIUS)))
        particles = assimilate(particles, lookup, RADIUS, ln_x[k], noise[k], errors)
    gains = np.array([errors.rms_gain_sd, errors.harmonic_gain_sd, errors.harmonic_gain_sd]) ** 2
    total = np.zeros(2)
    for n in range(2):
        for f in range(3):
            expected, w, s = (np.array([row[i][n, f] for row in rows]) for i in range(3))
            residual = ln_x[:, f] - expected - w * particles.core[n, GAIN]
            parts = (w, s, distance[1:, f], float(gains[f]))
            total[n] -= 0.5 * strangeness(*parts, noise[:, f], residual)
            mean, cov = latest_b_and_z(*parts, noise[:, f], residual)
            np.testing.assert_allclose(particles.mean[n, f], mean, rtol=1e-6, atol=1e-9)
            np.testing.assert_allclose(particles.cov[n, f], [cov[0, 0], cov[0, 1], cov[1, 1]], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(
        np.log(particles.weight[0] / particles.weight[1]), total[0] - total[1], rtol=1e-6, atol=1e-6
    )


def test_the_first_block_is_bayes_theorem() -> None:
    # A map that is a power of depth alone, and a path without freedom: V_eq is all there is to know.
    depth = toy_map()
    rms = 3.0 * (depth.h_d[:, None] / MICRON) ** 0.5 * np.ones_like(depth.rms)
    flat = replace(depth, rms=rms, rms_std=0.1 * rms)
    growth = GrowthPrior(h_threshold=(12e-6, 12.0001e-6), depth_share=(0.5, 0.50001), still=0.0)
    errors = ErrorModel(background_rms=1e-9, rms_model_sd=0.1, freedom=1e9)
    options = FilterSettings(RADIUS, particles=20000, lines=0, growth=growth, errors=errors, widening_rms=1.0)
    lookup = 3.0 * math.sqrt(12.0 * math.sqrt(0.004 / 0.05))
    _, result = step(FilterState(), DamageInput(0.0, lookup), map_slice=flat, settings=options)
    ln_v = np.log(np.geomspace(1e-4, 0.0475, 20001) * MM2)
    prior = -0.5 * ((ln_v - math.log(growth.v_start)) / growth.v_start_sd) ** 2
    spread = math.sqrt(math.log1p(0.01))
    h_d = 12.0 * np.sqrt(np.exp(ln_v) / (0.05 * MM2))
    # Bilinear between nodes 1 um apart.
    expected = np.log(np.interp(h_d, flat.h_d / MICRON, rms[:, 0])) - 0.5 * spread**2
    variance = errors.gain_sd**2 + errors.rms_gain_sd**2 + spread**2 + errors.scatter**2 + errors.rms_model_sd**2
    like = -0.5 * (math.log(lookup) - expected) ** 2 / variance
    low, middle, high = posterior_of_one_block(ln_v, prior, like, (0.1, 0.5, 0.9))
    assert math.log(result.v_eq) == pytest.approx(middle, abs=0.03)
    assert math.log(result.v_eq_lower) == pytest.approx(low, abs=0.03)
    assert math.log(result.v_eq_upper) == pytest.approx(high, abs=0.03)


def test_growth_without_chance_solves_its_differential_equation() -> None:
    growth = GrowthPrior(growth_noise_sd=0.0, kicks=0.0, jumps=0.0, roughness=1e-3, path_sd=0.0, stops=0.0)
    v, h_d, rate, power, share = 0.004 * MM2, 5e-6, 2e-12, 0.4, 0.3
    core = np.array([[math.log(v), math.log(h_d), math.log(rate), power, share, 0.0, 0.0, 0.0]])
    particles = Particles(core, np.ones(1), np.zeros((1, 1, 2)), np.zeros((1, 1, 3)))
    after = grow(particles, np.random.default_rng(1), 6000.0, growth)
    expected = v
    for _ in range(60000):
        expected += 0.1 * rate * (expected / growth.threshold) ** power
    assert math.exp(after.core[0, LN_V]) == pytest.approx(expected, rel=2e-3)
    assert after.core[0, LN_H] == pytest.approx(math.log(h_d) + share * math.log(expected / v), abs=1e-3)


def test_resampling_keeps_what_the_weights_say() -> None:
    rng = np.random.default_rng(3)
    particles = draw(rng, 2000, np.array([0.1]), GrowthPrior(), ErrorModel())
    weight = np.exp(-0.5 * ((particles.core[:, LN_V] - math.log(0.003 * MM2)) / 0.3) ** 2)
    weighted = Particles(particles.core, weight / weight.sum(), particles.mean, particles.cov)
    again = resample(weighted, rng, 2000)
    mean = np.sum(weighted.weight * weighted.core[:, LN_V])
    sd = math.sqrt(np.sum(weighted.weight * (weighted.core[:, LN_V] - mean) ** 2))
    assert np.mean(again.core[:, LN_V]) == pytest.approx(mean, abs=0.05 * sd)
    assert np.std(again.core[:, LN_V]) == pytest.approx(sd, rel=0.05)


def test_another_seed_draws_otherwise() -> None:
    inputs, _ = toy_life(3)
    assert follow(inputs)[1][-1].v_eq != follow(inputs, replace(SETTINGS, seed=1))[1][-1].v_eq


def test_the_state_does_not_grow() -> None:
    inputs, _ = toy_life(40)
    early, late = follow(inputs[:5])[0], follow(inputs)[0]
    assert abs(len(json.dumps(late.to_dict())) - len(json.dumps(early.to_dict()))) < 100


@pytest.mark.parametrize("method", ["thesis", "filter"])
@pytest.mark.parametrize(
    ("gates", "status"),
    [
        (DamageGate(final=False), EdvStatus.NOT_FINAL_STAGE),
        (DamageGate(usable=False), EdvStatus.BAD_BLOCK),
        (DamageGate(absolute=False), EdvStatus.NO_ABSOLUTE_LEVEL),
        (DamageGate(), EdvStatus.OUTSIDE_CONDITIONS),
        (DamageGate(), EdvStatus.NO_MAP),
    ],
)
def test_a_gated_block_leaves_the_trackers_alone(gates: DamageGate, status: EdvStatus, method: TrackMethod) -> None:
    level_map = LevelMap(TOY.dphi_d, TOY.h_d, TOY.rms, SETTINGS.part_radius)
    open_map = PartMap(lambda *_: (level_map, None), lambda *_: (TOY, None), SETTINGS)
    open_settings = DamageSettings(track_method=method, maps={"outer": open_map})
    inputs, _ = toy_life(4)
    state = DamageState()
    for block in inputs[:3]:
        state, _, _ = damage_step(state, block, DamageGate(), open_settings)
    refused = PartMap(lambda *_: (None, status), lambda *_: (None, status), SETTINGS)
    refusing = replace(open_settings, maps={"outer": refused})
    after, damage, _ = damage_step(state, inputs[3], gates, refusing)
    assert after.edv is state.edv
    assert after.filter is state.filter
    assert damage.status is status
    assert math.isnan(damage.v_eq)
    assert math.isnan(damage.rms_smoothed)


@pytest.mark.parametrize("rms", [math.nan, math.inf, -1.0, 0.0])
def test_a_block_without_rms_is_bad(rms: float) -> None:
    state, result = step(FilterState(), DamageInput(0.0, rms), map_slice=TOY, settings=SETTINGS)
    assert result.status is EdvStatus.BAD_BLOCK
    assert state.count == 0


def test_no_map_is_a_status() -> None:
    assert step(FilterState(), DamageInput(0.0, 3.0), map_slice=None, settings=SETTINGS)[1].status == "no_map"
    empty = replace(TOY, rms=np.full_like(TOY.rms, np.nan))
    assert step(FilterState(), DamageInput(0.0, 3.0), map_slice=empty, settings=SETTINGS)[1].status == "no_map"


@pytest.mark.parametrize(("rms", "status"), [(1e-3, "below_map"), (1e3, "above_map")])
def test_a_level_off_the_map_is_a_status_and_forgets_nothing(rms: float, status: str) -> None:
    inputs, _ = toy_life(6)
    state, _ = follow(inputs[:5])
    after, result = step(state, replace(inputs[5], rms=rms), map_slice=TOY, settings=SETTINGS)
    assert result.status == status
    assert after is state


def test_time_that_goes_back_is_an_error_and_time_that_stands_is_none() -> None:
    inputs, _ = toy_life(3)
    state, _ = follow(inputs)
    _, result = step(state, replace(inputs[-1], rms=inputs[-1].rms * 1.01), map_slice=TOY, settings=SETTINGS)
    assert result.status in CARRIES
    with pytest.raises(ValueError, match="not before the latest block"):
        step(state, inputs[0], map_slice=TOY, settings=SETTINGS)


def test_one_outlier_is_doubted() -> None:
    inputs, v = toy_life(40)
    inputs[30] = replace(inputs[30], rms=3.0 * inputs[30].rms)
    _, results = follow(inputs)
    assert abs(math.log(results[-1].v_eq / v[-1])) < 0.6


@pytest.mark.parametrize("shape", ["falling", "constant", "gap"])
def test_odd_histories_stay_finite(shape: str) -> None:
    inputs, _ = toy_life(40)
    if shape == "falling":
        inputs = [replace(h, rms=r.rms, harmonics=r.harmonics) for h, r in zip(inputs, inputs[::-1], strict=True)]
    elif shape == "constant":
        inputs = [replace(h, rms=inputs[20].rms, harmonics=inputs[20].harmonics) for h in inputs]
    else:
        inputs = [replace(h, time=h.time + (1e9 if k > 20 else 0.0)) for k, h in enumerate(inputs)]
    _, results = follow(inputs)
    for result in results:
        if result.status in CARRIES:
            assert 0.0 < result.v_eq_lower <= result.v_eq <= result.v_eq_upper < math.inf
        else:
            assert result.status in ("above_map", "implausible")
            assert math.isnan(result.v_eq)


def test_holes_of_a_map_take_their_neighbours() -> None:
    inputs, v = toy_life()
    rms = TOY.rms.copy()
    rms[5:9, 20:30] = np.nan
    _, results = follow(inputs, at=replace(TOY, rms=rms))
    assert abs(math.log(results[-1].v_eq / v[-1])) < 0.6


def test_a_map_without_spread_gets_the_one_of_the_simulated_bench() -> None:
    lookup = build_lookup(toy_map(spread=0.0), ErrorModel(), 1)
    assert lookup is not None
    shallow, deep = lookup.at(np.array([0.3, 0.3]), np.array([2e-6, 28e-6]))[2]
    assert shallow == pytest.approx([0.29, 0.18])
    assert deep == pytest.approx([0.1, 0.1])


def test_changing_conditions_are_followed_on_their_own_maps() -> None:
    conditions = [(4000.0, 40.0) if k % 2 else (4600.0, 33.0) for k in range(60)]
    maps = {c: toy_map(*c) for c in set(conditions)}
    lives = {c: toy_life(at=m)[0] for c, m in maps.items()}
    v = toy_life()[1]
    state, results = FilterState(), []
    for k, c in enumerate(conditions):
        state, result = step(state, lives[c][k], map_slice=maps[c], settings=SETTINGS)
        results.append(result)
    assert np.sqrt(np.mean(np.log([r.v_eq for r in results] / v) ** 2)) < 0.35


def test_several_sensors_are_averaged_and_one_may_fall_silent() -> None:
    inputs, v = toy_life(40)
    other, _ = toy_life(40, seed=2)
    state, results = FilterState(), []
    for k, pair in enumerate(zip(inputs, other, strict=True)):
        lookup = [pair[0], replace(pair[1], rms=math.nan)] if k > 25 else list(pair)
        state, result = step(state, lookup, map_slice=TOY, settings=SETTINGS)
        results.append(result)
    assert state.sensors == (1, 1, 1, 1)
    assert abs(math.log(results[-1].v_eq / v[-1])) < 0.5
    with pytest.raises(ValueError, match="one finite time"):
        step(state, [inputs[-1], replace(inputs[-1], time=1e6)], map_slice=TOY, settings=SETTINGS)


def test_two_kinds_of_volume_are_called_ambiguous() -> None:
    # Loud in two valleys of the extent far apart and silent between them: two defects may be.
    x = np.degrees(TOY.dphi_d)[None, :]
    rms = TOY.rms * np.where((x > 5.0) & (x < 15.0), 0.05, 1.0)
    growth = GrowthPrior(v_start=0.004 * MM2, v_start_sd=1.5, still=0.0)
    errors = ErrorModel(rms_model_sd=0.05)
    options = replace(SETTINGS, particles=6000, lines=0, growth=growth, errors=errors, ambiguous_ratio=1e9)
    split = replace(TOY, rms=rms, rms_std=0.05 * rms)
    _, result = step(FilterState(), DamageInput(0.0, 14.0), map_slice=split, settings=options)
    assert result.status is EdvStatus.AMBIGUOUS
    _, result = step(FilterState(), DamageInput(0.0, 14.0), map_slice=TOY, settings=options)
    assert result.status is EdvStatus.OK


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"part_radius": 0.0}, "part_radius"),
        ({"particles": 3}, "particles"),
        ({"lines": 7}, "lines"),
        ({"interval": 1.0}, "interval"),
    ],
)
def test_senseless_settings_are_refused(change: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(SETTINGS, **change)
