from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as effort
from hypothesis import strategies as st
from numpy.typing import NDArray

from models.machine.bearing import kinematics
from monitor.health.signal.average import RecentSpectra
from monitor.health.signal.bands import BandVotes, rank_bands
from monitor.health.signal.condition import ConditionSettings
from monitor.health.signal.features import FAULTS, BlockFeatures, FeatureSettings, block_features, fundamentals
from monitor.health.signal.interference import Interference, all_combs
from monitor.health.signal.orders import (
    MAX_SPEED_RATIO,
    order_amplitude,
    order_samples,
    order_spectrum,
    same_axis,
    warp_of,
)
from monitor.health.signal.recording_bands import recording_bands
from monitor.health.signal.rotation.rotation import Rotation, constant
from monitor.health.signal.transform import BlockTransform
from monitor.health.state import ChannelSettings, SourceSettings
from reference.signals import bearing_lines
from streams.turns.pulses import Pulses
from streams.types.block import Block
from tests.support.effort import effort_count

RATE, N = 8000.0, 16_000
DURATION = N / RATE
LIMIT = 1200.0
CASES = effort_count(quick=10, full=200)


def hunting(speed: float, depth: float, frequency: float, duration: float = DURATION, turn: float = 0.0) -> Rotation:
    time = np.linspace(0.0, duration, 1 + math.ceil(64.0 * max(1.0, frequency * duration)))
    phase = 2.0 * np.pi * (frequency * time + turn)
    swing = depth * (np.cos(2.0 * np.pi * turn) - np.cos(phase)) / (2.0 * np.pi * frequency)
    return Rotation(time, speed * (time + swing), speed * (1.0 + depth * np.sin(phase)), duration)


def run_up(begin: float, end: float, duration: float = DURATION) -> Rotation:
    time = np.array([0.0, duration])
    return Rotation(time, np.array([0.0, 0.5 * (begin + end) * duration]), np.array([begin, end]), duration)


rotations = st.one_of(
    st.builds(hunting, st.floats(15.0, 40.0), st.floats(0.0, 0.3), st.floats(0.2, 2.0), turn=st.floats(0.0, 1.0)),
    st.builds(run_up, st.floats(10.0, 40.0), st.floats(10.0, 40.0)),
)


def tone(rotation: Rotation, order: float, turn: float = 0.1) -> NDArray[np.float64]:
    return np.cos(2.0 * np.pi * (order * rotation.turns_at(np.arange(N) / RATE) + turn))


def spectrum(x: NDArray[np.float64], rotation: Rotation, limit: float = LIMIT) -> tuple[NDArray[np.floating], float]:
    warp = warp_of(rotation, DURATION)
    assert warp is not None
    return order_amplitude(np.fft.rfft(x)[:-1], N, warp, limit)[0], warp.resolution


def hann_line(distance: NDArray[np.float64]) -> NDArray[np.float64]:
    """What a unit line reads so many bins away."""
    beside = 0.5 * (np.sinc(distance - 1.0) + np.sinc(distance + 1.0))
    return np.abs(np.sinc(distance) + beside)


@given(rotations, st.floats(0.02, 0.98), st.floats(0.0, 1.0))
@effort(max_examples=CASES, deadline=None)
def test_a_line_of_constant_order_reads_its_amplitude_for_any_profile(
    rotation: Rotation, share: float, turn: float
) -> None:
    order = share * LIMIT / rotation.mean_speed
    amplitude, resolution = spectrum(tone(rotation, order, turn), rotation)
    place = order * rotation.mean_speed / resolution
    bins = np.arange(amplitude.size)
    near = np.abs(bins - place) < 4.0
    np.testing.assert_allclose(amplitude[near], hann_line(bins[near].astype(np.float64) - place), atol=1e-4)
    assert amplitude[(np.abs(bins - place) > 60.0) & (bins > 1)].max() < 1e-4


@given(rotations, st.floats(1.02, 3.2))
@effort(max_examples=CASES, deadline=None)
def test_lines_above_the_limit_do_not_fold_below_it(rotation: Rotation, share: float) -> None:
    order = min(share * LIMIT, 0.48 * RATE * rotation.mean_speed / rotation.speed_range[1]) / rotation.mean_speed
    amplitude, resolution = spectrum(tone(rotation, order), rotation)
    far = np.arange(amplitude.size) < order * rotation.mean_speed / resolution - 60.0
    assert amplitude[2:][far[2:]].max() < 1e-4


@given(rotations, st.floats(0.0, DURATION / 2.0))
@effort(max_examples=CASES, deadline=None)
def test_the_spectrum_is_linear_and_the_angle_has_no_origin(rotation: Rotation, origin: float) -> None:
    moved = Rotation(rotation.time, rotation.turns + 1000.0 * origin, rotation.speed, rotation.duration)
    x, y = tone(rotation, 3.4), tone(rotation, 17.1)
    warp, other = warp_of(rotation, DURATION), warp_of(moved, DURATION)
    assert warp is not None
    assert other is not None

    def samples(signal: NDArray[np.float64]) -> NDArray[np.floating]:
        return order_samples(np.fft.rfft(signal)[:-1], N, warp, LIMIT)

    np.testing.assert_allclose(samples(2.0 * x - 0.5 * y), 2.0 * samples(x) - 0.5 * samples(y), atol=1e-10)
    np.testing.assert_allclose(other.times, warp.times, atol=1e-9)


def test_a_block_in_which_the_speed_varies_too_much_stays_over_time() -> None:
    x = tone(constant(20.0, DURATION), 5.0)
    transform = BlockTransform(N, RATE, [(2000.0, 3900.0)])
    least = 40.0 / MAX_SPEED_RATIO
    assert transform(x, rotation=run_up(1.01 * least, 40.0)).warp is not None
    refused, plain = transform(x, rotation=run_up(0.99 * least, 40.0)), transform(x)
    assert refused.warp is None
    np.testing.assert_array_equal(refused.envelopes[0].amplitude, plain.envelopes[0].amplitude)


def test_a_rotation_of_another_duration_is_refused() -> None:
    with pytest.raises(ValueError, match=r"the block lasts 2 s, its rotation 1\.9 s"):
        BlockTransform(N, RATE, [(2000.0, 3900.0)])(np.ones(N), rotation=constant(20.0, 1.9))


LINES = {"outer": 3.1, "inner": 4.9, "ball": 4.1, "cage": 0.38}


def impacts(rotation: Rotation, order: float, seed: int = 0) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    t = np.arange(round(0.02 * RATE)) / RATE
    x = 0.05 * rng.standard_normal(N)
    x += 0.02 * np.cos(2.0 * np.pi * rotation.turns_at(np.arange(N) / RATE))
    starts = rotation.time_at(np.arange(float(rotation.turns[0]) + 0.3 / order, rotation.turned, 1.0 / order))
    for start in starts[starts < DURATION - 0.03]:
        first = math.ceil(start * RATE)
        late = t + first / RATE - start
        x[first : first + t.size] += np.exp(-800.0 * late) * np.sin(2.0 * np.pi * 3000.0 * late)
    return x


def asked(rotation: Rotation | None, speed: float) -> FeatureSettings:
    lines = {fault: order * speed for fault, order in LINES.items()}
    return FeatureSettings(RATE, ((2000.0, 3900.0),), lines, speed=speed, speed_sd=0.0, rotation=rotation)


def test_a_block_at_one_speed_gives_the_same_figures_by_the_angle() -> None:
    rotation = constant(25.0, DURATION, "tacho")
    x = impacts(rotation, LINES["outer"])
    plain = block_features(x, RATE, asked(None, 25.0))
    found = block_features(x, RATE, asked(rotation, 25.0))
    assert (plain.domain, found.domain) == ("hertz", "order")
    assert found.rms == plain.rms
    assert found.velocity == plain.velocity
    for name, value in plain.values.items():
        assert found.values[name] == pytest.approx(value, rel=1e-3, abs=1e-3 * plain.rms), name
    np.testing.assert_allclose(found.bpfo_amplitude, plain.bpfo_amplitude, rtol=1e-3)
    for fault in FAULTS:
        expected, family = plain.families[0][fault], found.families[0][fault]
        assert family.detected == expected.detected
        assert family.fundamental == pytest.approx(expected.fundamental, rel=1e-3)
        np.testing.assert_allclose(family.amplitude, expected.amplitude, atol=1e-3 * expected.amplitude.max())


@pytest.mark.parametrize("rotation", [hunting(25.0, 0.1, 0.7), run_up(15.0, 35.0)], ids=["hunting", "run-up"])
def test_impacts_at_a_varying_speed_are_found_by_the_angle_alone(rotation: Rotation) -> None:
    x = impacts(rotation, LINES["outer"])
    speed = rotation.mean_speed
    still = constant(speed, DURATION)
    expected = block_features(impacts(still, LINES["outer"]), RATE, asked(still, speed)).families[0]["outer"]
    found = block_features(x, RATE, asked(rotation, speed)).families[0]
    assert found["outer"].score == max(family.score for family in found.values())
    assert found["outer"].depth == pytest.approx(expected.depth, rel=0.1)
    smeared = block_features(x, RATE, asked(None, speed)).families[0]["outer"]
    assert smeared.depth < 0.5 * expected.depth


def test_a_mesh_of_varying_speed_is_removed_before_the_envelope() -> None:
    rotation = hunting(25.0, 0.1, 0.7)
    turns = rotation.turns_at(np.arange(N) / RATE)
    mesh = sum(np.cos(2.0 * np.pi * (23 * k * turns + k * k)) for k in range(1, 6))
    settings = asked(rotation, rotation.mean_speed)
    combs = all_combs((Interference(orders=(23.0,)),), rotation.mean_speed)
    x = impacts(rotation, LINES["outer"])
    alone, covered = block_features(x, RATE, settings), block_features(x + mesh, RATE, settings)
    freed = block_features(x + mesh, RATE, replace(settings, interference=combs))
    depths = [found.families[0]["outer"].depth for found in (alone, covered, freed)]
    assert depths[1] < 0.4 * depths[0]
    assert depths[2] > 0.75 * depths[0]
    # Where there is no mesh, nothing is removed: the envelope has its bandwidth, and only that differs.
    untouched = block_features(x, RATE, replace(settings, interference=combs)).families[0]["outer"]
    np.testing.assert_allclose(untouched.amplitude, alone.families[0]["outer"].amplitude, rtol=2e-3)


def test_mains_are_removed_over_time_whatever_the_shaft_does() -> None:
    x = impacts(hunting(25.0, 0.1, 0.7), LINES["outer"]) + 2.0 * np.cos(2.0 * np.pi * 3100.0 * np.arange(N) / RATE)
    rotation = hunting(25.0, 0.1, 0.7)
    combs = all_combs((Interference(lines=(3100.0,), sidebands=2),), rotation.mean_speed)
    settings = asked(rotation, rotation.mean_speed)
    covered = block_features(x, RATE, settings).families[0]["outer"]
    assert block_features(x, RATE, replace(settings, interference=combs)).families[0]["outer"].depth > 2 * covered.depth


def test_blocks_at_different_speeds_are_averaged_at_equal_orders() -> None:
    def analysed(seed: int, speed: float, recent: RecentSpectra, *, by_angle: bool = True) -> BlockFeatures:
        rotation = hunting(speed, 0.05, 0.7)
        settings = replace(asked(rotation if by_angle else None, rotation.mean_speed), average_blocks=4)
        return block_features(impacts(rotation, LINES["inner"], seed), RATE, settings, recent)

    found = analysed(0, 25.0, RecentSpectra())
    for seed, speed in enumerate((23.0, 26.5, 24.2), start=1):
        found = analysed(seed, speed, found.recent)
    assert found.recent.count == 4
    single = found.lines[0]["inner"].scaled(1.0 / found.envelopes[0].mean).depth
    assert found.families[0]["inner"].depth == pytest.approx(single, rel=0.1)
    assert RecentSpectra.from_list(json.loads(json.dumps(found.recent.to_list()))) == found.recent
    assert analysed(4, 25.0, found.recent, by_angle=False).recent.count == 1
    assert analysed(4, 15.0, found.recent).recent.count == 1


def test_a_line_keeps_its_power_in_an_average_of_other_spacing() -> None:
    bins = np.arange(400.0)
    recent = RecentSpectra()
    for step, turn in ((0.0100, 0.3), (0.0108, 0.5), (0.0104, 0.0)):
        noise = 1e-3 * (1.5 + np.cos(bins + turn))
        recent = recent.add(((hann_line(bins - 2.0 / step) + noise).astype(np.float32),), 4, step)
    (average,) = recent.averages()
    top = int(np.argmax(average))
    assert top == pytest.approx(2.0 / 0.0104, abs=0.6)
    assert np.sqrt(np.sum(np.square(average[top - 2 : top + 3])) / 1.5) == pytest.approx(1.0, rel=0.02)


def test_a_band_is_judged_by_the_angle() -> None:
    rotation = hunting(25.0, 0.2, 0.7)
    lines = {fault: order * rotation.mean_speed for fault, order in LINES.items()}
    x = impacts(rotation, LINES["outer"])

    def score(signal: NDArray[np.float64], *rotations: Rotation) -> float:
        ranked = rank_bands([signal], RATE, lines, rotations)
        return next(candidate.score for candidate in ranked if candidate.band[0] == 2000.0)

    still = score(impacts(constant(rotation.mean_speed, DURATION), LINES["outer"]))
    assert score(x, rotation) == pytest.approx(still, rel=0.5)
    assert score(x) < 0.01 * still
    ranked = rank_bands([x], RATE, lines, [rotation])
    best = max(ranked, key=lambda candidate: candidate.score).band
    assert BandVotes().add(x, RATE, lines, (), rotation).best() == best


def test_only_spectra_by_the_same_angle_have_one_axis() -> None:
    rotation = hunting(25.0, 0.1, 0.7)
    geared = Rotation(rotation.time, 0.4 * rotation.turns + 7.0, 0.4 * rotation.speed, rotation.duration)
    assert same_axis(None, None)
    assert same_axis(rotation, geared)
    assert not same_axis(rotation, None)
    assert not same_axis(rotation, constant(rotation.mean_speed, DURATION))


@given(rotations, st.floats(0.02, 0.8), st.floats(0.0, 1.0))
@effort(max_examples=CASES, deadline=None)
def test_a_line_at_full_rate_reads_its_amplitude_up_to_0_4_of_the_sampling_order(
    rotation: Rotation, share: float, turn: float
) -> None:
    order = share * 0.5 * RATE / rotation.speed_range[1]
    found = order_spectrum(1.5 + 2.0 * tone(rotation, order, turn), RATE, rotation)
    assert found.revolutions == pytest.approx(rotation.turned)
    assert found.complete == pytest.approx(0.5 * RATE / rotation.speed_range[1], rel=1e-3)
    bins = found.order / found.step
    near = np.abs(bins - order / found.step) < 4.0
    np.testing.assert_allclose(found.amplitude[near], 2.0 * hann_line(bins[near] - order / found.step), atol=2e-4)
    assert found.mean == pytest.approx(1.5, abs=0.1)


@pytest.mark.parametrize("share", [1.1, 1.6])
def test_at_full_rate_what_is_above_the_limit_does_not_fold(share: float) -> None:
    rotation = hunting(25.0, 0.1, 0.7)
    limit = 60.0
    found = order_spectrum(tone(rotation, share * limit), RATE, rotation, limit)
    assert found.amplitude.size == int(limit / found.step) + 1
    assert found.amplitude[2 : -int(2.0 / found.step)].max() < 1e-4


@pytest.mark.parametrize(
    ("rotation", "samples", "message"),
    [
        (run_up(5.0, 40.0), N, "the speed varies from 5 to 40 Hz, at most by a factor of 6"),
        (constant(20.0, DURATION), N - 1, r"expected 64 samples or more of 2 s, got 1\.99988 s \(15999 samples\)"),
        (constant(20.0, 0.005), 40, r"expected 64 samples or more of 0\.005 s, got 0\.005 s \(40 samples\)"),
    ],
)
def test_an_order_spectrum_is_refused(rotation: Rotation, samples: int, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        order_spectrum(np.zeros(samples), RATE, rotation)


def test_the_band_of_a_short_recording_is_chosen_by_the_angle_of_its_blocks() -> None:
    bearing, _ = bearing_lines("6205", 25.0)
    settings = SourceSettings("s", {"one": ChannelSettings("one", bearing, condition=ConditionSettings())})
    blocks: list[Block] = []
    votes = BandVotes()
    for sequence, speed in enumerate((24.0, 26.0, 25.0), start=1):
        rotation = hunting(speed, 0.2, 0.7)
        lines = fundamentals(kinematics(bearing, rotation.mean_speed))
        x = impacts(rotation, lines["outer"] / rotation.mean_speed, sequence).astype(np.float32)
        pulses = Pulses(rotation.time_at(np.arange(0.05, rotation.turned, 0.125)), 8)
        blocks.append(Block(x[None], RATE, ("one",), ("m/s2",), "s", sequence, "block", pulses=pulses))
        votes = votes.add(x, RATE, lines, (), rotation)
    # The widest candidate begins elsewhere at each speed, and is one band nevertheless.
    assert votes.total == 3
    assert len({high - low > 3000.0 for (low, high), _ in votes.counts}) == len(votes.counts)
    assert recording_bands(blocks, settings)["one"] == pytest.approx(votes.best(), rel=1e-3)
    still = {"one": replace(settings.channels["one"], condition=ConditionSettings(domain="hertz"))}
    assert recording_bands(blocks, SourceSettings("s", still)) == {}


def test_a_speed_that_varies_too_much_is_no_known_speed() -> None:
    rotation = run_up(5.0, 40.0)
    x = impacts(rotation, LINES["outer"])
    found = block_features(x, RATE, asked(rotation, rotation.mean_speed))
    plain = block_features(x, RATE, replace(asked(None, rotation.mean_speed), speed_sd=None))
    assert found.domain == "hertz"
    assert found.shaft is None
    assert found.values == plain.values
