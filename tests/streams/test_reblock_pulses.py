"""Pulses through the re-blocker: those of each block, whatever the pieces in which its samples came."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from streams.reblock import Numbering, Reblocker, samples_hash
from streams.turns.pulses import Pulses
from streams.types.samples import Samples
from tests.support.reblock import cut_up, flushed

RATE = 1000.0 / 3.0
LENGTH = 16
BLOCK_S = LENGTH / RATE
T0 = 1.7e9
SIZES = st.lists(st.integers(0, 40), max_size=12)
TIMES = st.lists(st.floats(0.0, 0.999999), max_size=60)


def whole(length: int, shares: list[float], **more: object) -> Samples:
    values = np.random.default_rng(length).normal(size=(1, length))
    pulses = Pulses(np.sort(np.array(shares, dtype=np.float64)) * length / RATE, 4)
    base = Samples(values, ("x",), units=("g",), rate=RATE, origin="a", pulses=pulses)
    return replace(base, **more)


def in_pieces(samples: Samples, sizes: list[int]) -> list[Samples]:
    """Cut as a growing file comes: each piece knows the pulses of the whole file."""
    return [replace(samples, values=part, offset=begin) for begin, part in cut_up(samples.values, sizes)]


@given(length=st.integers(1, 120), shares=TIMES, sizes=SIZES)
def test_pulses_are_those_of_the_whole_recording(length: int, shares: list[float], sizes: list[int]) -> None:
    samples = whole(length, shares)
    found = flushed(Reblocker(BLOCK_S), in_pieces(samples, sizes))
    blocks = [cut.samples.block("s", 1, "a", "", None) for cut in found]
    assert samples.pulses is not None
    times = samples.pulses.times
    for number, block in enumerate(blocks):
        begin = number * LENGTH
        own = times[(np.floor(times * RATE) >= begin) & (np.floor(times * RATE) < begin + block.samples.shape[1])]
        assert block.pulses is not None
        np.testing.assert_array_equal(block.pulses.times, own - begin / RATE)
        assert block.pulses.per_revolution == 4
    assert sum(block.pulses.times.size for block in blocks if block.pulses is not None) == times.size


@given(length=st.integers(40, 120), shares=TIMES, sizes=SIZES)
def test_pulses_are_joined_over_files(length: int, shares: list[float], sizes: list[int]) -> None:
    samples = whole(length, shares, start=T0)
    files = []
    assert samples.pulses is not None
    for begin, part in cut_up(samples.values, sizes):
        own = samples.pulses.in_samples(RATE, begin, begin + part.shape[1]).shifted(-begin / RATE)
        files.append(replace(samples, values=part, start=T0 + begin / RATE, origin=str(begin), pulses=own))
    at_once = flushed(Reblocker(BLOCK_S), [samples])
    joined = flushed(Reblocker(BLOCK_S), files)
    assert len(at_once) == len(joined)
    for one, two in zip(at_once, joined, strict=True):
        first, second = one.samples.block_pulses, two.samples.block_pulses
        assert first is not None
        assert second is not None
        np.testing.assert_allclose(second.times, first.times, atol=1e-12)


def test_a_block_with_samples_of_a_file_without_pulses_has_none() -> None:
    first = whole(24, [0.1, 0.5, 0.9], start=T0)
    second = replace(first, start=T0 + 24 / RATE, origin="b", pulses=None)
    cuts = flushed(Reblocker(BLOCK_S), [first, second])
    assert [cut.samples.pulses is None for cut in cuts] == [False, True, True]


def test_a_block_of_files_that_count_differently_has_no_pulses() -> None:
    first = whole(24, [0.1, 0.5, 0.9], start=T0)
    second = replace(first, start=T0 + 24 / RATE, origin="b", pulses=Pulses(np.array([0.001]), 2))
    cuts = flushed(Reblocker(BLOCK_S), [first, second])
    assert [cut.samples.pulses is None for cut in cuts] == [False, True, False]


def test_pulses_are_part_of_what_identifies_a_block() -> None:
    samples, pulses = np.ones((1, 4)), Pulses(np.array([0.5]), 1)
    digests = {
        samples_hash(samples, 1.0, ("x",)),
        samples_hash(samples, 1.0, ("x",), Pulses(np.array([]))),
        samples_hash(samples, 1.0, ("x",), pulses),
        samples_hash(samples, 1.0, ("x",), Pulses(pulses.times + 1e-9, 1)),
        samples_hash(samples, 1.0, ("x",), Pulses(pulses.times, 2)),
    }
    assert len(digests) == 5
    cut = flushed(Reblocker(BLOCK_S), [whole(16, [0.25, 0.75])])[0]
    block = Numbering("s").cut(cut)
    assert block.content_hash == samples_hash(cut.samples.values, RATE, ("x",), cut.samples.block_pulses)
