"""Gears beside seeded machines: level, lines, and the records of older seeds, which stay as they were."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.seeded_faults import HELD_OUT, TRAINING, VALIDATION, Plan, band_rms, draw, make, noise_of
from benchmarks.seeded_gears import (
    GEAR_DAMAGED,
    GEAR_HEALTHY,
    GEAR_LIVES,
    GEAR_TRAINING,
    GearState,
    draw_gears,
    gear_vibration,
    geared,
    level_below,
)

# (seed, speed, first samples) as before there were gears of another kind.
_KNOWN = (
    (0, 7.8, (0.60042924, -0.6484019, -0.14408445)),
    (7, 10.8, (4.4173694, -6.131142, 1.2538619)),
)
SEED = 6


def plan() -> Plan:
    return replace(draw(SEED), part=None, gear=None)


@pytest.mark.parametrize(("seed", "speed", "samples"), _KNOWN)
def test_older_seeds_give_the_records_that_they_gave(seed: int, speed: float, samples: tuple[float, ...]) -> None:
    record = make(seed)
    assert record.plan.speed == pytest.approx(speed, abs=0.06)
    np.testing.assert_allclose(record.samples[:3], samples, rtol=1e-4)


def test_seeds_to_judge_are_apart_from_all_others() -> None:
    sets = [set(seeds) for seeds in (GEAR_HEALTHY, GEAR_DAMAGED, GEAR_LIVES, TRAINING, VALIDATION, HELD_OUT)]
    assert sum(map(len, sets)) == len(set.union(*sets))
    assert set(GEAR_TRAINING) <= set(TRAINING)


@pytest.mark.parametrize("state", ["loaded", "idle"])
def test_gears_have_the_level_that_is_asked_and_change_nothing_else(state: GearState) -> None:
    noise = noise_of(plan())
    gears = draw_gears(SEED, 20.0, state)
    record, again = geared(SEED, plan(), gears), geared(SEED, plan(), gears)
    np.testing.assert_array_equal(record.samples, again.samples)
    added = record.samples.astype(np.float64) - geared(SEED, plan(), replace(gears, db=-300.0)).samples
    level = 20.0 * np.log10(band_rms(added, plan()) / band_rms(noise, plan()))
    assert level == pytest.approx(20.0 if state == "loaded" else 10.0, abs=0.01)


def test_loaded_gears_are_lines_of_the_mesh_and_the_turns_of_both_wheels() -> None:
    drawn = replace(plan(), speed=20.0, duration=1.0, rate=12000.0)
    gears = replace(draw_gears(SEED, state="loaded"), driver=24, driven=40, wander=0.0, swing=(0.5, 0.3), uneven=0.0)
    power = np.square(np.abs(np.fft.rfft(gear_vibration(np.random.default_rng(1), drawn, gears, 12000))))
    # The record is one second long: a bin is a hertz.
    sides = (0, 20, -20, 12, -12, 8, -8, 32, -32)
    lines = [480 * order + side for order in (1, 2, 3) for side in sides]
    assert power[lines].min() > 100.0 * np.median(power)
    kept = np.ones(power.size, dtype=bool)
    kept[::4] = False
    assert power[kept].sum() < 1e-6 * power.sum()


def test_damage_is_so_far_below_the_gears() -> None:
    gears = draw_gears(SEED, 20.0, "loaded")
    assert level_below(gears, -20.0) == pytest.approx(1.0)
    assert level_below(gears, -40.0) == pytest.approx(0.1)
