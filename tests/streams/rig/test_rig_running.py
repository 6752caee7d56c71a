"""A simulated rig whose speed changes within its blocks, and its tacho."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from models.machine.bearing import kinematics
from models.machine.shaft_marks import LEVEL_VOLT, ShaftMarks, as_channel, time_of_turns
from models.machine.speed_profile import hunt, ramp
from streams.rig.bench import CHANNELS, RATE, open_rig
from streams.types.block import Block
from streams.types.spec import SourceError


def crossings(block: Block) -> NDArray[np.float64]:
    """Return when the tacho rises through half of its level, s, by straight lines between samples."""
    signal = block.samples[block.channels.index("tacho")].astype(np.float64) - 0.5 * LEVEL_VOLT
    at = np.flatnonzero((signal[:-1] < 0.0) & (signal[1:] >= 0.0))
    return (at - signal[at] / (signal[at + 1] - signal[at])) / block.rate


def off_marks(turns: NDArray[np.float64], per_turn: int) -> NDArray[np.float64]:
    """Return how far angles, turns, stand off equal marks."""
    phase = turns * per_turn
    middle = np.angle(np.mean(np.exp(2j * math.pi * phase))) / (2.0 * math.pi)
    return (np.remainder(phase - middle + 0.5, 1.0) - 0.5) / per_turn


@pytest.mark.parametrize("run", ["ramp&speed_hz=10", "coast&speed_hz=40&fault=ball", "hunt&speed_hz=25&fault=inner"])
def test_the_tacho_is_the_angle_of_the_block_and_the_lines_are_of_its_fault(run: str) -> None:
    rig = open_rig(f"rig:ferrara?seed=2&healthy_blocks=1&run={run}&tacho=8", "rig")
    block, turns = rig.with_turns(60)
    assert block.channels == (*CHANNELS, "tacho")
    assert block.units == ("m/s2",) * 3 + ("V",)
    assert block.pulses_per_revolution == 8
    rotation = rig.rotation(60)
    assert turns == pytest.approx(rotation.turns_at(np.arange(128000) / RATE), abs=1e-12)
    assert np.all(np.diff(turns) > 0.0)
    times = crossings(block)
    assert abs(len(times) - 8.0 * turns[-1]) < 2
    assert np.abs(off_marks(rotation.turns_at(times), 8)).max() < 1e-6
    truth = rig.truth(60, ())
    assert truth["speed_true"] == pytest.approx(turns[-1] / 5.0, rel=1e-4)
    assert truth["speed_range_true"] == rotation.speed_range
    # The passages stand out over the angle, at their order.
    lines = kinematics(rig.bearing, 1.0)
    order = {"outer": lines.bpfo, "inner": lines.bpfi, "ball": 2.0 * lines.bsf}[rig.running.fault]
    power = block.samples[0].astype(np.float64) ** 2
    few, middle = power.reshape(-1, 20).mean(axis=1), turns.reshape(-1, 20).mean(axis=1)
    orders = np.linspace(0.9 * order, 1.1 * order, 201)
    level = np.abs(np.exp(-2j * math.pi * np.outer(orders, middle)) @ ((few - few.mean()) * np.gradient(middle)))
    assert abs(orders[level.argmax()] / order - 1.0) < 0.01
    assert level.max() > 5.0 * np.median(level)


def test_a_block_depends_on_its_number_and_the_url_alone() -> None:
    url = "rig:ferrara?seed=2&healthy_blocks=1&run=hunt&speed_hz=25&tacho=2&tacho_jitter_us=10&slip_deg=0.5"
    one, again, other = open_rig(url, "rig"), open_rig(url, "rig"), open_rig(url + "&hunt_percent=5", "rig")
    later, first = one.block(9), one.block(2)
    assert np.array_equal(again.block(2).samples, first.samples)
    assert not np.array_equal(again.block(9).samples, first.samples)
    assert later.content_hash != first.content_hash
    assert other.block(2).content_hash != first.content_hash


def test_a_long_run_is_cut_anywhere_and_a_steady_rig_may_have_a_tacho() -> None:
    rig = open_rig("rig:ferrara?seed=2&run=ramp&speed_hz=10&run_s=60", "rig")
    ranges = [rig.rotation(k).speed_range for k in range(1, 30)]
    assert all(2.4 < high - low < 2.6 for low, high in ranges)
    assert np.ptp([low for low, _ in ranges]) > 15.0
    steady, plain = (open_rig(f"rig:ferrara?seed=2{more}", "rig") for more in ("&tacho=4", ""))
    ours, other = steady.block(3), plain.block(3)
    assert np.array_equal(ours.samples[:3], other.samples)
    assert np.abs(off_marks(steady.rotation(3).turns_at(crossings(ours)), 4)).max() < 1e-6
    assert len(other.channels) == 3


def test_the_faults_of_marks_have_the_size_that_is_asked_for() -> None:
    profile = ramp(10.0, 40.0, 20.0)
    marks = ShaftMarks(32, error=math.radians(0.1), missing=0.02, extra=0.01, seed=5)
    even = ShaftMarks(32, seed=5)
    turned = float(profile.turns_at(20.0))
    times, clean = marks.pulses(profile.time_at, turned, 20.0), even.pulses(profile.time_at, turned, 20.0)
    assert len(clean) == pytest.approx(32.0 * turned, abs=1)
    assert len(times) == pytest.approx(0.99 * len(clean), rel=0.006)
    error = 360.0 * off_marks(profile.turns_at(times), 32)
    assert np.sqrt(np.mean(error[np.abs(error) < 0.4] ** 2)) == pytest.approx(0.1, rel=0.1)
    assert np.mean(np.abs(error) > 0.4) < 0.015
    assert 360.0 * np.sqrt(np.mean((marks.marks - np.arange(32) / 32) ** 2)) == pytest.approx(0.1)
    shaken = ShaftMarks(32, jitter=1e-5, seed=5).pulses(profile.time_at, turned, 20.0)
    assert np.std(shaken[5:-5] - clean[5 : 5 + len(shaken) - 10]) == pytest.approx(1e-5, rel=0.1)
    # Another run has another jitter on the same marks.
    assert not np.array_equal(ShaftMarks(32, jitter=1e-5, seed=5).pulses(profile.time_at, turned, 20.0, 1), shaken)


def test_times_from_sampled_turns_are_those_of_the_profile() -> None:
    profile = hunt(25.0, 0.2, 0.5, 2.0)
    turns = profile.turns_at(np.arange(5121) / 2560.0)
    inside, beyond = np.linspace(0.0, 50.0, 500), np.array([-1.0, -0.1, 50.1, 51.0])
    time_at = time_of_turns(turns, 2560.0)
    assert time_at(inside) == pytest.approx(profile.time_at(inside), abs=1e-8)
    assert time_at(beyond) == pytest.approx(profile.time_at(beyond), abs=2e-5)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("run=walk", "run='walk' is none of steady, ramp, coast, hunt"),
        ("run=hunt&hunt_percent=120", "hunt_percent must lie between 0 and 100"),
        ("run=coast&speed_to_hz=50", "speed_to_hz must be below speed_hz"),
        ("run=ramp&model=rotor", "rotor does not describe a speed that changes"),
        ("tacho=400", "too fast for a channel"),
        ("tacho_missing=0.01", "tacho_missing belongs to tacho"),
        ("tacho=4&tacho_missing=1", "marks.missing is a share"),
        ("tacho=4&tacho_jitter_us=-1", "tacho_jitter_us must be positive"),
        ("fault=cage", "fault='cage' is none of outer, inner, ball"),
        ("fault=ball&slip_deg=1", "the fault is of a ball"),
    ],
)
def test_what_cannot_run_is_refused(options: str, words: str) -> None:
    with pytest.raises(SourceError, match=words):
        open_rig(f"rig:ferrara?{options}", "rig")


def test_marks_that_are_too_fast_for_a_channel_are_refused() -> None:
    with pytest.raises(ValueError, match="3000 marks a second are too fast for a channel of 25600 Hz"):
        as_channel(np.array([0.1]), 100, RATE, 3000.0)
