"""The simulated rig: reproducible, with the truth it claims, and not described exactly by any map."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models.rigs.six_dof import Rig
from streams.block import Block
from streams.open import open_source
from streams.rig import CHANNELS, INTERVAL, RATE, SimulatedRig, draw_life, open_rig, perturbed
from streams.source import Source
from streams.spec import SourceError, SourceSpec


@pytest.fixture(scope="module")
def rig() -> SimulatedRig:
    return open_rig("rig:ferrara?seed=3", "rig")


def test_it_is_a_source_and_opens_by_its_url(rig):
    assert isinstance(rig, Source)
    opened = open_source(SourceSpec(name="rig", url="rig:ferrara?seed=3"))
    assert len(opened) == len(rig) > 150
    first = next(iter(opened))
    assert isinstance(first, Block)
    assert first.channels == CHANNELS
    assert first.samples.shape == (3, 128000)
    assert first.rate == RATE


def test_the_same_seed_gives_the_same_blocks_in_any_order(rig):
    late, early = rig.block(160), rig.block(2)
    again = open_rig("rig:ferrara?seed=3", "rig")
    np.testing.assert_array_equal(again.block(2).samples, early.samples)
    np.testing.assert_array_equal(again.block(160).samples, late.samples)
    assert not np.array_equal(open_rig("rig:ferrara?seed=4", "rig").block(2).samples, early.samples)


def test_the_truth_is_the_volume_of_the_scene_that_is_simulated(rig):
    for sequence in (rig.life.onset, rig.life.onset + 20, len(rig)):
        defect = rig.scene(sequence, rig.speed, rig.load).defect
        assert defect is not None
        radius = rig.bearing.outer_race_radius
        truth = rig.truth(sequence, (0.05e-6, 0.1e-6))
        assert truth["v_eq_true"] == pytest.approx(radius * defect.dphi_d * defect.h_d, rel=1e-12)
        t = rig.time_after_onset(sequence)
        if truth["tt_true"][0] > 0.0:
            assert rig.life.v_eq(t + truth["tt_true"][0]) == pytest.approx(0.05e-6, rel=1e-9)
        assert truth["tt_true"][1] > truth["tt_true"][0]
    assert rig.truth(10, (0.05e-6,)) == {"v_eq_true": 0.0, "tt_true": (None,)}
    assert rig.scene(10, rig.speed, rig.load).defect is None


def test_its_parameters_are_two_to_five_percent_off():
    nominal = Rig()
    rng = np.random.default_rng(0)
    for _ in range(50):
        rig = perturbed(nominal, rng)
        off = [
            abs(getattr(rig, n) / getattr(nominal, n) - 1) for n in ("m_i", "m_o", "m_r", "k_i", "k_r", "k_c", "c_i")
        ]
        assert min(off) >= 0.02 - 1e-12
        assert max(off) <= 0.05 + 1e-12


def test_lives_grow_to_the_threshold_in_the_time_of_the_thesis():
    for seed in range(50):
        life = draw_life(np.random.default_rng(seed), 151)
        t = life.time_to(0.05e-6)
        assert 257 * 60 <= t <= 705 * 60
        assert life.v_eq(t) == pytest.approx(0.05e-6)
        volumes = [life.v_eq(x) for x in np.linspace(0, 1.3 * t, 20)]
        assert np.all(np.diff(volumes) > 0)


def test_damage_is_heard_at_the_test_bearing_first_of_all(rig):
    healthy, worn = rig.block(rig.life.onset - 1), rig.block(rig.life.onset + 30)
    rms = [block.samples.std(axis=1) for block in (healthy, worn)]
    assert rms[1][0] > 5 * rms[0][0]
    assert np.all(rms[1][1:] < 1.4 * rms[0][1:])


def test_blocks_are_spaced_by_the_interval(rig):
    assert rig.block(1).elapsed == 0.0
    assert rig.block(3).elapsed == 2 * INTERVAL
    assert math.isclose(rig.block(3).duration, 5.0)


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("rig:lathe", "unknown rig 'lathe'"),
        ("rig:ferrara?sed=1", "unknown option 'sed'"),
        ("rig:ferrara?seed=one", "seed='one' is not a number"),
        ("rig:ferrara?blocks=0", "blocks must be positive"),
        ("rig:ferrara?speed_hz=-3", "speed_hz must be positive"),
    ],
)
def test_wrong_urls_are_refused(url, words):
    with pytest.raises(SourceError, match=words):
        open_rig(url, "rig")
