"""The re-blocker: the same blocks however the samples were cut, and nothing joined across a gap."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from streams.reblock import Reblocker, samples_hash
from streams.types.samples import Samples
from tests.oracles.reblock_oracle import blocks_of_runs
from tests.support.reblock import cut_up, flushed

RATE = 64.0
LENGTH = 16
BLOCK_S = LENGTH / RATE
T0 = 1.7e9


def chunk(values: NDArray[np.floating], start: float | None, origin: object, **more: object) -> Samples:
    rows = ("x", "y")[: values.shape[0]]
    base = Samples(values, rows, units=("g",) * len(rows), rate=RATE, start=start, origin=str(origin))
    return replace(base, **more)


RUNS = st.lists(st.integers(1, 70), min_size=1, max_size=4)
SIZES = st.lists(st.integers(0, 40), max_size=12)


@given(lengths=RUNS, sizes=SIZES, dated=st.booleans())
def test_blocks_are_those_of_the_whole_runs(lengths: list[int], sizes: list[int], dated: bool) -> None:
    generator = np.random.default_rng(sum(lengths))
    runs = [generator.normal(size=(2, length)) for length in lengths]
    chunks: list[Samples] = []
    starts = [T0 + 100.0 * index for index in range(len(runs))]
    for run, start in zip(runs, starts, strict=True):
        for begin, part in cut_up(run, sizes):
            if dated:
                chunks.append(chunk(part, start + begin / RATE, f"{start} {begin}"))
            else:
                chunks.append(chunk(part, None, start, offset=begin))
    found = flushed(Reblocker(BLOCK_S), chunks)
    expected = blocks_of_runs(runs, LENGTH)
    assert len(found) == len(expected)
    for cut, (index, begin, samples, whole) in zip(found, expected, strict=True):
        np.testing.assert_array_equal(cut.samples.values, samples)
        assert (cut.missing == 0) == whole
        assert cut.missing in (0, LENGTH - samples.shape[1])
        assert cut.samples.time_of(cut.samples.offset) == (starts[index] + begin / RATE if dated else None)
        assert samples_hash(cut.samples.values, RATE, cut.samples.channels) == samples_hash(samples, RATE, ("x", "y"))


@given(lengths=RUNS)
def test_what_was_used_of_each_origin_adds_up(lengths: list[int]) -> None:
    chunks, begin = [], 0
    for origin, length in enumerate(lengths):
        chunks.append(chunk(np.ones((1, length)), T0 + begin / RATE, origin))
        begin += length
    used: dict[object, int] = {}
    for cut in flushed(Reblocker(BLOCK_S), chunks):
        before = used.get(cut.samples.origin, 0)
        assert cut.samples.offset == before
        assert sum(end - used.get(origin, 0) for origin, end in cut.used) == cut.samples.values.shape[1]
        used.update(cut.used)
    assert used == {str(origin): length for origin, length in enumerate(lengths)}


def test_more_of_the_same_origin_is_joined_without_a_date() -> None:
    cutter = Reblocker(BLOCK_S)
    run = np.arange(40.0)[np.newaxis]
    cuts = list(cutter.feed(chunk(run[:, :10], None, "a.csv")))
    cuts += cutter.feed(chunk(run[:, 10:], None, "a.csv", offset=10))
    np.testing.assert_array_equal(np.concatenate([cut.samples.values for cut in cuts], axis=1), run[:, :32])
    assert cutter.held == 8
    assert cutter.origins == {"a.csv"}


def test_what_is_said_of_a_block_does_not_depend_on_when_its_file_was_read() -> None:
    rate, run = 1000.0, np.arange(300.0)[np.newaxis]
    whole = Samples(
        run, ("x",), units=("g",), rate=rate, start=1.7e9 + 1 / 3, elapsed=1 / 7, speed=30.0, load=10.0, origin="a"
    )
    other = replace(whole, origin="b", start=0.0, speed=40.0)
    at_once = flushed(Reblocker(0.1), [whole, other])
    cutter = Reblocker(0.1)
    parts = [replace(whole, values=run[:, :30]), replace(whole, values=run[:, 30:210], offset=30)]
    in_parts = [cut for part in parts for cut in cutter.feed(part)]
    # A process that begins anew reads on after the last block.
    in_parts += flushed(Reblocker(0.1), [replace(whole, values=run[:, 200:], offset=200), other])
    assert len(at_once) == len(in_parts) == 6
    for one, two in zip(at_once, in_parts, strict=True):
        first, second = ({k: v for k, v in vars(cut.samples).items() if k != "values"} for cut in (one, two))
        assert first == second
        assert (one.used, one.missing) == (two.used, two.missing)
    assert [cut.samples.speed for cut in at_once] == [30.0] * 3 + [40.0] * 3
    assert [cut.used for cut in at_once[:2]] == [(("a", 100),), (("a", 200),)]


@pytest.mark.parametrize(
    "other",
    [
        {"rate": 128.0},
        {"channels": ("z",)},
        {"units": ("V",)},
        {"start": T0 + 0.6 / RATE + 10 / RATE},
        {"start": T0 + 9 / RATE},
        {"start": None},
        {"values": np.ones((1, 10), dtype=np.float32)},
    ],
    ids=["rate", "channels", "units", "gap", "overlap", "undated", "sample type"],
)
def test_a_change_or_a_gap_is_never_joined(other: dict[str, object]) -> None:
    cutter = Reblocker(BLOCK_S)
    assert list(cutter.feed(chunk(np.zeros((1, 10)), T0, "a"))) == []
    second = replace(chunk(np.ones((1, 10)), T0 + 10 / RATE, "b"), **other)
    (left,) = cutter.feed(second)
    assert left.samples.values.shape == (1, 10)
    assert left.missing == 6
    assert cutter.origins == {"b"}


def test_undated_samples_of_two_origins_are_not_joined() -> None:
    cutter = Reblocker(BLOCK_S)
    assert list(cutter.feed(chunk(np.zeros((1, 10)), None, "a"))) == []
    (left,) = cutter.feed(chunk(np.ones((1, 10)), None, "b"))
    assert left.missing == 6


def test_a_rate_that_is_measured_anew_with_each_file_is_one_rate() -> None:
    cutter = Reblocker(BLOCK_S)
    assert list(cutter.feed(chunk(np.zeros((1, 10)), None, "a"))) == []
    (cut,) = cutter.feed(chunk(np.ones((1, 10)), None, "a", offset=10, rate=RATE * (1 + 2e-5)))
    assert cut.samples.rate == RATE
    assert cut.samples.values.shape == (1, LENGTH)


def test_a_rest_of_nine_tenths_is_a_block() -> None:
    cutter = Reblocker(10 / RATE)
    assert list(cutter.feed(chunk(np.zeros((1, 9)), T0, "a"))) == []
    (left,) = cutter.flush()
    assert (left.samples.values.shape[1], left.missing) == (9, 0)


def test_the_hash_tells_samples_rate_and_channels_apart() -> None:
    samples = np.arange(6.0).reshape(2, 3)
    names = ("x", "y")
    hashes = {
        samples_hash(samples, 1.0, names),
        samples_hash(samples + 1, 1.0, names),
        samples_hash(samples, 2.0, names),
        samples_hash(samples, 1.0, ("x", "z")),
        samples_hash(samples.reshape(1, 6), 1.0, ("x",)),
        samples_hash(samples.astype(np.float32), 1.0, names),
    }
    assert len(hashes) == 6
    assert samples_hash(np.asfortranarray(samples), 1.0, names) == samples_hash(samples, 1.0, names)
