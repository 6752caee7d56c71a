"""Naming on simulated signals: every family, what is no bearing, and what cannot be told apart."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from models.machine.bearing import Kinematics
from monitor.health.name.naming import (
    MIN_DEPTH,
    SURE,
    Naming,
    damaged_family,
    name_fault,
    score_threshold,
)
from monitor.health.signal.average import RecentSpectra
from monitor.health.signal.comb import FaultLines, comb_depth, line_spectrum
from monitor.health.signal.features import FAULTS, N_HARMONICS, FeatureSettings, block_features, fundamentals
from monitor.health.signal.floor import noise_floor
from monitor.health.signal.lines import SEARCH, fault_lines
from monitor.health.signal.search import UNVERIFIED_SLIP
from reference.signals import HealthyMachine, bearing_lines, impacts, pulses
from tests.support.effort import effort_count

RATE = 25600.0
BAND = (1000.0, 9000.0)
SAMPLES = NDArray[np.float64]


def named(amplitude: SAMPLES, resolution: float, lines: Kinematics) -> Naming:
    """Name from an envelope spectrum relative to its mean."""
    spectrum = line_spectrum(amplitude, resolution, speed=lines.speed)
    families = {fault: fault_lines(spectrum, line) for fault, line in fundamentals(lines).items()}
    return name_fault(spectrum, lines, families)


def averaged(
    blocks: Iterable[SAMPLES], lines: Kinematics, average_blocks: int = 1, speed_sd: float | None = None
) -> Naming:
    """Name from the mean of the spectra of several blocks, at a speed that is nominal or known."""
    recent, naming = RecentSpectra(), None
    for x in blocks:
        settings = FeatureSettings(
            RATE, (BAND,), fundamentals(lines), speed=lines.speed, speed_sd=speed_sd, average_blocks=average_blocks
        )
        features = block_features(x.astype(np.float32), RATE, settings, recent)
        recent = features.recent
        naming = name_fault(features.sought[0], lines, features.families[0], verified=features.shaft is not None)
    assert naming is not None
    return naming


def name(x: SAMPLES, lines: Kinematics, speed_sd: float | None = None) -> Naming:
    return averaged([x], lines, speed_sd=speed_sd)


def white(seed: int, n: int) -> SAMPLES:
    return np.random.default_rng(seed).standard_normal(n)


def comb(lines: NDArray[np.floating], depths: NDArray[np.floating], duration: float, seed: int) -> SAMPLES:
    """Noise that is modulated at some frequencies by some depths."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(RATE * duration)) / RATE
    swing = 1.0 + sum(d * np.cos(2.0 * np.pi * (f * t + rng.uniform())) for f, d in zip(lines, depths, strict=True))
    return rng.standard_normal(t.size) * swing


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize(
    ("designation", "speed", "duration"),
    [("6205", 30.0, 2.0), ("6205", 12.5, 5.0), ("1205 ETN9", 20.0, 3.0), ("ZA-2115", 33.3, 1.0), ("22207", 40.0, 2.0)],
)
def test_every_part_is_named(designation: str, speed: float, duration: float, fault: str) -> None:
    _, lines = bearing_lines(designation, speed)
    for seed in range(effort_count(quick=2, full=20)):
        x = impacts(np.random.default_rng(seed), fault, lines, duration=duration, height=20.0)
        naming = name(x, lines, speed_sd=0.0)
        assert naming.verified
        assert naming.fault == ("ball|cage" if fault == "cage" else fault)
        found = naming.families[fault]
        # The simulated impacts come half a percent late; the fifth line is found within a bin.
        within = 0.003 + 1.0 / (duration * N_HARMONICS * fundamentals(lines)[fault])
        assert found.speed_factor == pytest.approx(0.995, abs=within)
        assert found.comb_score > naming.threshold
        assert naming.rival == 0.0
        assert found.depth > MIN_DEPTH + SURE * found.depth_error


@pytest.mark.parametrize("height", [8.0, 100.0, 3000.0])
@pytest.mark.parametrize("fault", ["outer", "inner", "ball"])
def test_severe_damage_is_not_hidden_by_its_own_sidebands(fault: str, height: float) -> None:
    _, lines = bearing_lines("6205", 30.0)
    x = impacts(np.random.default_rng(1), fault, lines, duration=8.0, height=height, jitter=0.0, modulation=1.0)
    assert name(x, lines).fault == fault


def test_two_families_that_cannot_be_separated_are_named_together() -> None:
    """PRONOSTIA at 30 Hz: BPFI 221.7 and 2 BSF 215.3 Hz, records of 0.1 s."""
    _, lines = bearing_lines("PRONOSTIA", 30.0)
    for fault in ("inner", "ball"):
        blocks = (impacts(np.random.default_rng(k), fault, lines, duration=0.1, height=20.0) for k in range(16))
        assert averaged(blocks, lines, 16).fault == "inner|ball"
        x = impacts(np.random.default_rng(3), fault, lines, duration=4.0, height=20.0, slip=0.001)
        assert name(x, lines, speed_sd=0.0).fault == fault
        # Three per cent apart: with a speed that is nominal, the other one needs an error within its tolerance.
        stated = name(x, lines)
        assert (stated.fault, stated.part, stated.candidates) == ("undecided", None, ("inner", "ball"))
        assert not stated.verified


@pytest.mark.parametrize(("fault", "slip"), [("outer", 0.038), ("outer", 0.0), ("cage", 0.03), ("inner", -0.024)])
def test_at_a_known_speed_a_cage_that_slips_hides_nothing(fault: str, slip: float) -> None:
    """The inner race runs past a slower cage faster: its line rises."""
    _, lines = bearing_lines("6305", 29.4)
    x = impacts(np.random.default_rng(4), fault, lines, duration=4.0, height=30.0, slip=slip)
    naming = name(x, lines, speed_sd=0.0)
    assert naming.fault == ("ball|cage" if fault == "cage" else fault)
    assert naming.families[fault].speed_factor == pytest.approx(1.0 - slip, abs=0.004)
    # At a nominal speed that is right the range is wider still.
    stated = name(x, lines)
    assert (stated.fault, stated.verified) == (naming.fault, False)


def test_the_deepest_family_is_named_although_another_scores_higher() -> None:
    """A capped score counts many small lines as much as a few deep ones."""
    _, lines = bearing_lines("6205", 29.95)
    orders = np.arange(1.0, 6.0)
    deep, shallow = np.array([0.5, 0.25, 0.02, 0.05, 0.02]), np.full(5, 0.05)
    x = comb(np.concatenate([lines.bpfo * orders, lines.bpfi * orders]), np.concatenate([deep, shallow]), 40.0, seed=1)
    naming = name(x, lines, speed_sd=0.0)
    assert naming.families["inner"].comb_score > naming.families["outer"].comb_score
    assert naming.fault == "outer"


@pytest.mark.parametrize("ratio", [3.0, 5.0 / 3.0, 4.0 / 3.0])
def test_a_comb_of_another_origin_takes_the_place_of_a_family(ratio: float) -> None:
    """Every third line of a gear at a third of BPFO stands in the family; its own lines between say what it is."""
    _, lines = bearing_lines("6305", 22.63)
    first = lines.bpfo * (1.0 - 0.02) / ratio
    orders = np.arange(1.0, 16.0)
    naming = name(comb(first * orders, 0.35 / np.sqrt(orders), 5.0, seed=2), lines, speed_sd=0.0)
    assert naming.fault is None
    if naming.best == "outer" and naming.families["outer"].depth > MIN_DEPTH:
        assert naming.rival > 0.0


def test_one_line_is_no_comb() -> None:
    lone, comb_of_two = np.array([0.0, 0.5, 0.0, 0.0, 0.0]), np.array([0.4, 0.3, 0.0, 0.0, 0.0])
    assert float(comb_depth(np.square(lone))) == 0.0
    assert float(comb_depth(np.square(comb_of_two))) == pytest.approx(0.5)
    assert float(comb_depth(np.square(np.array([0.5, 0.1, 0.0, 0.0, 0.0])))) == pytest.approx(math.sqrt(0.01 + 0.16))


@pytest.mark.parametrize(("n_averages", "depth"), [(1, 0.3), (16, 0.3), (1, 0.1), (4, 0.15)])
def test_the_error_of_the_depth_is_its_scatter(n_averages: int, depth: float) -> None:
    """Lines on bins of Hann-windowed Gaussian noise, over many draws; averages in power."""
    rng = np.random.default_rng(8)
    n, spacing = 2000, 80
    kernel = np.array([-0.25, 0.5, -0.25])
    depths, errors = [], []
    for _ in range(effort_count(quick=60, full=400)):
        power = np.zeros(n)
        for _ in range(n_averages):
            white = (rng.standard_normal(n) + 1j * rng.standard_normal(n)) * 0.02
            bins = np.convolve(white, kernel, "same") * math.sqrt(8.0 / 3.0)
            for place in spacing * np.arange(1, 6):
                turn = np.exp(2j * np.pi * rng.uniform())
                bins[place - 1 : place + 2] += depth / math.sqrt(5.0) * turn * np.array([-0.5, 1.0, -0.5])
            power += np.square(np.abs(bins)) / n_averages
        spectrum = line_spectrum(np.sqrt(power), 1.0, n_averages=n_averages)
        found = fault_lines(spectrum, float(spacing), speed_factor=1.0)
        depths.append(found.depth)
        errors.append(found.depth_error)
    assert float(np.mean(depths)) == pytest.approx(depth, rel=0.1)
    assert float(np.std(depths)) == pytest.approx(float(np.mean(errors)), rel=0.4)


@pytest.mark.parametrize("error", [-0.09, -0.04, 0.04, 0.09])
@pytest.mark.parametrize("fault", FAULTS)
def test_a_stated_speed_that_is_wrong_gives_no_other_name(fault: str, error: float) -> None:
    """Within slip and tolerance the part is named as it is, further off it is not."""
    _, lines = bearing_lines("6205", 30.0)
    _, stated = bearing_lines("6205", 30.0 * (1.0 + error))
    x = impacts(np.random.default_rng(5), fault, lines, duration=3.0, height=20.0)
    right = "ball|cage" if fault == "cage" else fault
    assert name(x, stated).fault in ((right, None) if abs(error) < 0.05 else (None,))


def spectrum_of(lines: dict[float, float], resolution: float = 0.3) -> SAMPLES:
    """Return noise with lines (Hz) of such depths."""
    power = 1e-5 * np.random.default_rng(12).exponential(size=5000)
    for line, depth in lines.items():
        place = round(line / resolution)
        power[place - 1 : place + 2] += depth**2 * np.array([0.25, 1.0, 0.25])
    return np.sqrt(power)


def test_sidebands_of_an_inner_race_are_no_outer_race() -> None:
    """Two turns below BPFI of a 6203 stand 2.95 turns, which a speed stated 6 % low takes for BPFO."""
    _, lines = bearing_lines("6203", 20.0)
    _, stated = bearing_lines("6203", 20.0 * 0.94)
    inner = {
        lines.bpfi * k + 20.0 * turns: 0.4 / (1.0 + 0.03 * abs(turns)) for k in range(1, 6) for turns in range(-12, 13)
    }
    naming = named(spectrum_of({line: depth for line, depth in inner.items() if line > 3.0}), 0.3, stated)
    assert naming.best == "outer"
    assert naming.families["outer"].depth > 2.0 * MIN_DEPTH
    assert naming.rival > 0.8 * naming.families["outer"].depth
    assert naming.fault is None
    alone = {k * (lines.bpfi - 40.0): 0.4 for k in range(1, 6)}
    assert named(spectrum_of(alone), 0.3, stated).fault == "outer"


@pytest.mark.parametrize("speed", [24.7, 29.3, 30.0])
@pytest.mark.parametrize("fundamental", ["shaft", 50.0, 60.0, 100.0, 120.0, 37.1])
def test_combs_that_are_no_bearing_get_no_name(fundamental: float | str, speed: float) -> None:
    _, lines = bearing_lines("6205", speed)
    first = speed if fundamental == "shaft" else float(fundamental)
    orders = np.arange(1, math.floor(1500.0 / first) + 1)
    x = comb(first * orders, 0.5 / np.sqrt(orders), 3.0, seed=7)
    assert name(x, lines).fault is None


@pytest.mark.parametrize("error", [-0.02, -0.01, -0.003, 0.0, 0.003, 0.01, 0.02])
def test_harmonics_of_the_shaft_are_not_the_balls_of_a_6203(error: float) -> None:
    """2 BSF is 3.987 times the shaft: with a stated speed a little wrong, every fourth harmonic passes for it."""
    _, stated = bearing_lines("6203", 29.93 * (1.0 + error))
    orders = np.arange(1, 25)
    depths = np.where(orders % 4 == 0, 0.3, 0.06) / np.sqrt(orders)
    assert name(comb(29.93 * orders, depths, 5.0, seed=3), stated).fault is None


def test_the_balls_of_a_6203_are_named_although_the_shaft_is_near() -> None:
    _, lines = bearing_lines("6203", 29.93)
    x = impacts(np.random.default_rng(2), "ball", lines, duration=5.0, height=30.0, slip=0.012)
    assert name(x, lines).fault == "ball"


def test_white_noise_has_no_name() -> None:
    cases = [("6205", 30.0, 25600), ("22207", 10.0, 51200), ("PRONOSTIA", 27.5, 2560), ("1205 ETN9", 40.0, 25600)]
    # Long enough for the speed, which is nominal, to be sought on the shaft.
    cases.append(("6305", 31.0, 76800))
    for seed in range(effort_count(quick=200, full=2000)):
        designation, speed, n = cases[seed % len(cases)]
        _, lines = bearing_lines(designation, speed)
        assert name(white(seed, n), lines).fault is None


@pytest.mark.parametrize("depth", [0.03, 0.06, 0.10])
def test_balls_that_pass_the_load_zone_of_a_healthy_bearing_are_no_damage(depth: float) -> None:
    _, lines = bearing_lines("1205 ETN9", 30.0)
    rng = np.random.default_rng(11)
    machine = HealthyMachine(30.0, lines.bpfo, np.full(6, 0.3), depth * np.array([1.0, 0.4]), burst_rate=0.0)
    naming = name(machine.block(rng, 1.0, RATE, 128000), lines)
    assert naming.fault is None
    assert naming.families["outer"].depth == pytest.approx(depth * math.hypot(1.0, 0.4), rel=0.1, abs=0.01)


def test_one_block_of_impacts_does_not_decide_for_fifteen_quiet_ones() -> None:
    """Its spectrum is high everywhere; with equal weights it would be the mean, judged as if it were sixteen."""
    _, lines = bearing_lines("PRONOSTIA", 25.0)
    for seed in range(effort_count(quick=10, full=100)):
        rng = np.random.default_rng(seed)
        blocks = [rng.standard_normal(2560) for _ in range(16)]
        blocks[7] += pulses(2560, RATE, 0.01 + np.arange(3) / lines.bpfi, 1000.0)
        assert averaged(blocks, lines, 16).fault is None
        # The quiet ones dominate the average; most of the mean power is that of the loud one.
        recent = RecentSpectra()
        settings_ = FeatureSettings(RATE, (BAND,), fundamentals(lines), speed=lines.speed, average_blocks=16)
        for x in blocks:
            recent = block_features(x, RATE, settings_, recent).recent
        (mean,) = recent.averages()
        plain = [row.astype(np.float64) for row in recent.rows]
        quiet = float(np.mean([np.sum(row) for i, row in enumerate(plain) if i != 7]))
        assert float(np.sum(mean**2)) < 1.5 * quiet
        assert float(np.sum(np.mean(plain, axis=0))) > 2.0 * quiet


def test_the_average_of_equal_spectra_is_each_of_them() -> None:
    row = np.abs(white(4, 200)).astype(np.float32)
    spectra = RecentSpectra()
    for _ in range(5):
        spectra = spectra.add((row, 2.0 * row), 16)
    one, two = spectra.averages()
    np.testing.assert_allclose(one, row, rtol=1e-6)
    np.testing.assert_allclose(two, 2.0 * row, rtol=1e-6)


@settings(max_examples=effort_count(quick=10, full=25))
@given(gain=st.floats(1e-6, 1e6), seed=st.integers(0, 2**20), fault=st.sampled_from(FAULTS))
def test_the_scale_of_the_signal_does_not_matter(gain: float, seed: int, fault: str) -> None:
    _, lines = bearing_lines("6205", 30.0)
    x = impacts(np.random.default_rng(seed), fault, lines, duration=1.0, height=30.0)
    one, other = name(x, lines), name(gain * x, lines)
    assert one.fault == other.fault
    assert one.evidence is not None
    assert other.evidence is not None
    assert other.evidence.comb_score == pytest.approx(one.evidence.comb_score, rel=1e-3)
    assert other.evidence.depth == pytest.approx(one.evidence.depth, rel=1e-3)


@settings(max_examples=effort_count(quick=10, full=25))
@given(depth=st.floats(0.05, 0.5), seed=st.integers(0, 2**20))
def test_depth_is_the_modulation_without_the_noise(depth: float, seed: int) -> None:
    """For lines on bins of a spectrum of Gaussian noise: an absolute figure, whatever the noise."""
    _, lines = bearing_lines("6205", 30.0)
    rng = np.random.default_rng(seed)
    resolution = 0.2
    n = 8000
    power = 1e-5 * rng.exponential(size=n)
    for h in range(1, N_HARMONICS + 1):
        place = round(h * lines.bpfo / resolution)
        power[place - 1 : place + 2] += depth**2 / N_HARMONICS * np.array([0.25, 1.0, 0.25])
    naming = named(np.sqrt(power), resolution, lines)
    assert naming.families["outer"].depth == pytest.approx(depth, rel=0.05)


def test_the_floor_is_the_mean_of_noise_and_does_not_see_lines() -> None:
    rng = np.random.default_rng(6)
    power = 3.0 * rng.exponential(size=20000)
    assert float(np.mean(noise_floor(np.sqrt(power), 301))) == pytest.approx(3.0, rel=0.02)
    power[::50] += 1e4
    assert float(np.mean(noise_floor(np.sqrt(power), 301))) == pytest.approx(3.0, rel=0.06)


def test_the_threshold_falls_with_the_blocks_averaged() -> None:
    thresholds = [score_threshold(n) for n in (1, 4, 16, 60)]
    assert thresholds == sorted(thresholds, reverse=True)
    assert thresholds[0] == 14.0


def test_too_short_a_spectrum_says_nothing() -> None:
    _, lines = bearing_lines("PRONOSTIA", 27.5)
    for amplitude in (np.ones(30), np.zeros(400)):
        naming = named(amplitude, 10.0, lines)
        assert (naming.fault, naming.best, naming.evidence) == (None, None, None)
    # 12 Hz of the cage is not resolved at 10 Hz.
    assert set(named(np.abs(white(1, 400)), 10.0, lines).families) == {"outer", "inner", "ball"}


def test_of_a_comb_and_its_sidebands_at_a_known_speed_the_one_of_the_higher_score_is_the_damage() -> None:
    """Lines of the shaft hide more of an inner race at five times the shaft than of its sidebands."""
    _, lines = bearing_lines("6203", 20.0)

    def family(turns: float, depth: float, score: float) -> FaultLines:
        amplitude = np.full(5, depth / math.sqrt(5.0))
        return FaultLines(amplitude, np.zeros(5), np.ones(5, dtype=bool), 20.0 * turns, comb_score=score)

    outer = family(3.03, 1.0, 26.0)
    for inner, expected in (
        (family(5.035, 0.9, 30.0), "inner"),
        (family(5.035, 0.9, 25.0), "outer"),
        (family(5.035, 0.7, 30.0), "outer"),
        (family(5.1, 0.9, 30.0), "outer"),
    ):
        assert damaged_family("outer", {"outer": outer, "inner": inner}, lines, 0.1) == expected


def test_families_are_sought_within_tolerance_and_slip() -> None:
    _, lines = bearing_lines("6205", 30.0)
    for fault, family in name(white(9, 128000), lines).families.items():
        low, high = UNVERIFIED_SLIP[fault]
        assert low - SEARCH - 1e-9 <= family.speed_factor - 1.0 <= high + SEARCH + 1e-9
    assert set(fundamentals(lines)) == set(FAULTS)


def test_lines_that_are_close_together_are_no_family() -> None:
    """A cage of 12 Hz in half a second: six bins apart, where few lines of gears pass for it."""
    _, lines = bearing_lines("6305", 32.4)
    x = impacts(np.random.default_rng(6), "cage", lines, duration=0.5, height=40.0)
    assert "cage" not in name(x, lines, speed_sd=0.0).families
    longer = impacts(np.random.default_rng(6), "cage", lines, duration=1.5, height=40.0)
    assert "cage" in name(longer, lines, speed_sd=0.0).families
