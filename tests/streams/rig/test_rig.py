"""The simulated rig: reproducible, with the truth it claims, and not described exactly by any map."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from models.machine.bearing import kinematics
from models.machine.rig import Rig
from models.solve.registry import RIGS, solvers
from models.words.request import Request
from streams.open import open_source
from streams.rig.bench import CHANNELS, INTERVAL, RATE, SimulatedRig, draw_life, machine_of, open_rig, perturbed
from streams.types.block import Block
from streams.types.source import Source
from streams.types.spec import SourceError, SourceSpec
from tests.support.effort import effort_count


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


# Samples of the first channel, m/s2.
_KNOWN = {
    2: (0.77025896, -0.39571238, -0.6175847),
    160: (4.6722403, -21.130156, -15.929428),
    200: (-3.9633908, 14.434603, 17.902561),
}


@pytest.mark.parametrize("sequence", _KNOWN)
def test_the_bench_of_the_thesis_stays_as_it_was(rig, sequence):
    np.testing.assert_allclose(rig.block(sequence).samples[0, 1000:1003], _KNOWN[sequence], rtol=1e-5, atol=1e-5)
    named = open_rig("rig:ferrara?seed=3&model=six_dof&bearing=1205 ETN9", "rig")
    np.testing.assert_array_equal(named.block(sequence).samples, rig.block(sequence).samples)
    assert rig.limits == ()


# Steps over the angle and those of gears take longest: five seconds of a block have two million of them.
SLOW = ("angular", "gear_pair")


@pytest.mark.parametrize("model", [model for model in RIGS if model not in SLOW or effort_count(quick=0, full=1)])
def test_any_model_with_the_defect_makes_blocks_of_a_life(model):
    rig = open_rig(f"rig:ferrara?seed=2&model={model}&healthy_blocks=1&blocks=40", "rig")
    assert rig.rig.model == rig.machine.model == model
    healthy, worn = rig.block(1), rig.block(40)
    assert worn.samples.shape == healthy.samples.shape == (3, 128000)
    assert np.isfinite(worn.samples).all()
    assert worn.samples[0].std() > 5.0 * healthy.samples[0].std()
    lines = np.abs(np.fft.rfft(np.abs(worn.samples[0].astype(float)) - np.abs(worn.samples[0]).mean()))
    bpfo = kinematics(rig.bearing, rig.speed).bpfo
    around = slice(round(5.0 * 0.95 * bpfo), round(5.0 * 1.05 * bpfo))
    assert lines[around].max() > 10.0 * np.median(lines)


@pytest.mark.parametrize("model", RIGS)
def test_parameters_of_any_model_deviate_and_the_next_seed_has_others(model):
    nominal = machine_of(model).nominal
    drawn = [perturbed(nominal, np.random.default_rng(seed)) for seed in (1, 2)]
    assert drawn[0] != drawn[1]
    for rig in drawn:
        for name in nominal.uncertain:
            assert 0.02 - 1e-12 <= abs(getattr(rig, name) / getattr(nominal, name) - 1.0) <= 0.05 + 1e-12


def test_blocks_of_a_motion_over_time_are_the_same_again():
    url = "rig:ferrara?seed=2&model=rotor&healthy_blocks=1&blocks=9"
    first, again = open_rig(url, "rig"), open_rig(url, "rig")
    np.testing.assert_array_equal(first.block(9).samples, again.block(9).samples)
    assert first.block(9).content_hash != open_rig(url.replace("rotor", "six_dof"), "rig").block(9).content_hash


@pytest.mark.parametrize("model", ["rotor", "ball_inertia"])
def test_a_motion_that_repeats_is_that_of_its_lines(model):
    rig = open_rig(f"rig:ferrara?seed=2&model={model}&healthy_blocks=1&blocks=9", "rig")
    scene = rig.scene(9, 40.0, 4000.0)
    response = rig._simulate(scene)
    over_time = next(one for one in solvers(model) if one.name in ("rigid", "time"))
    whole = over_time.solve(scene, Request(duration=0.25, rate=RATE, accuracy=1e-4))
    assert response.record is None
    assert whole.record is not None
    simulated = whole.record.of("a")
    # Both have the phase that the simulation begins with, the record after what is dropped.
    shift = np.angle(whole.coefficients[0, 1] / response.coefficients[0, 1])
    moved = rig._sampled(response, float(shift))[: simulated.size]
    assert np.std(moved - simulated) < 0.02 * np.std(simulated)


def test_a_motion_that_does_not_repeat_is_simulated_for_the_whole_block():
    rig = open_rig("rig:ferrara?seed=2&model=rotor&healthy_blocks=1&blocks=9", "rig")
    response = rig._simulate(replace(rig.scene(9, 40.0, 4000.0), unbalance=0.01))
    assert response.record is not None
    assert response.status in ("not_periodic", "inaccurate")
    assert not response.repeats
    period = RATE / response.bpfo
    early, late = rig._sampled(response, 0.0), rig._sampled(response, 2.0 * np.pi * 100.0 / period)
    assert early.size == late.size == 128000
    np.testing.assert_array_equal(early[100:2000], late[:1900])


def test_its_limits_are_said(rig):
    rotor = open_rig("rig:ferrara?seed=2&model=rotor", "rig")
    assert rotor.limits == (
        "its bearing is a 6205",
        "its accelerometer shows sensor a of rotor, which has no casing",
        "the floor of its defect is smooth",
    )
    impact = open_rig("rig:ferrara?seed=2&model=ring_impact&gain=0.001", "rig")
    assert impact.limits[-1] == "no map gives its V_eq: its impacts follow the extent of a defect, not its depth"
    assert impact.block(200).samples[0].std() < 100.0


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("model=lathe", "unknown model 'lathe'; known are: six_dof, "),
        ("model=rotor&bearing=1205", "contact angle of 10.* degrees; models that take it: six_dof, ring_impact"),
        ("model=rotor&sensor=mo", "sensor 'mo': this model has a, b, c"),
        ("model=rotor&sensor=x", "sensor='x' is none of mo"),
        ("bearing=zzz", "bearing 'zzz' is not in the catalogue"),
        ("gain=0", "gain must be positive"),
        ("model=ring_impact&bearing=6203&seed=3", "more than an element"),
    ],
)
def test_what_a_model_does_not_describe_is_refused_when_the_rig_is_opened(query, words):
    with pytest.raises(SourceError, match=words):
        open_rig(f"rig:ferrara?{query}", "rig")
