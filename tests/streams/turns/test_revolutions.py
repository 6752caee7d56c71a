"""Blocks by revolutions: as many turns in each, whatever the pieces in which their samples came."""

from __future__ import annotations

import functools
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from monitor.config.load import ConfigError, validate
from monitor.service.setup import source_spec
from streams.open import open_source
from streams.reblock import Reblocker
from streams.turns.pulses import BlockRevolutions, Pulses
from streams.types.block import Block, Rejected
from streams.types.samples import Samples
from streams.types.spec import ChannelSpec, SourceError, SourceSpec
from tests.streams.folders import Rig
from tests.support.effort import effort_count
from tests.support.reblock import cut_up, flushed

RATE = 1000.0
LONGEST = 2.0


def turned(seconds: float, begin: float, end: float) -> NDArray[np.float64]:
    """Return the revolutions at each sample while the speed goes from ``begin`` to ``end``, Hz."""
    time = np.arange(round(seconds * RATE)) / RATE
    return begin * time + 0.5 * (end - begin) / seconds * time**2


def pulses_at(turns: NDArray[np.float64], marks: int) -> NDArray[np.float64]:
    """Return the times of the marks, s."""
    wanted = np.arange(1, int(turns[-1] * marks)) / marks
    return np.interp(wanted, turns, np.arange(turns.size) / RATE)


def run(marks: int, *, channel: bool, **more: Any) -> Samples:
    turns = turned(20.0, 8.0, 20.0)
    noise = np.random.default_rng(0).normal(size=turns.size)
    tacho = (((turns * marks) % 1.0) < 0.3).astype(np.float64)
    rows = np.stack([noise, tacho]) if channel else noise[np.newaxis]
    pulses = None if channel else Pulses(pulses_at(turns, marks), marks)
    names = ("x", "tacho")[: len(rows)]
    base = Samples(rows, names, units=("g",) * len(rows), rate=RATE, origin="a", pulses=pulses)
    return replace(base, **more)


def turns_for(revolutions: float, marks: int, *, channel: bool) -> BlockRevolutions:
    return BlockRevolutions(revolutions, per_revolution=marks, channel="tacho" if channel else None)


@pytest.mark.parametrize("channel", [False, True])
@pytest.mark.parametrize("marks", [1, 4])
def test_each_block_has_its_turns(marks: int, channel: bool) -> None:
    found = flushed(Reblocker(LONGEST, turns_for(10, marks, channel=channel)), [run(marks, channel=channel)])
    turns = turned(20.0, 8.0, 20.0)
    begins = np.cumsum([0, *(cut.samples.values.shape[1] for cut in found)])
    assert begins[-1] == turns.size
    counted = np.diff(turns[np.minimum(begins, turns.size - 1)])
    # The first one has no mark at its begin.
    np.testing.assert_allclose(counted[1:-1], 10.0, atol=0.3 / marks)
    assert len(found) == 28
    assert [cut.missing == 0 for cut in found[:-1]] == [True] * 27


@functools.cache
def turns_at_once(channel: bool) -> tuple[Any, Any, Any]:
    """Return samples with two marks a turn, their turns, and the blocks that are cut of them at once."""
    whole, turns = run(2, channel=channel), turns_for(5, 2, channel=channel)
    return whole, turns, flushed(Reblocker(LONGEST, turns), [whole])


@settings(max_examples=effort_count(quick=12, full=300))
@given(sizes=st.lists(st.integers(0, 3000), max_size=8), channel=st.booleans())
def test_the_pieces_do_not_matter(sizes: list[int], channel: bool) -> None:
    whole, turns, at_once = turns_at_once(channel)
    pieces = [replace(whole, values=part, offset=begin) for begin, part in cut_up(whole.values, sizes)]
    in_pieces = flushed(Reblocker(LONGEST, turns), pieces)
    # A process that begins anew reads on after the last block.
    third = at_once[2]
    rest = replace(whole, values=whole.values[:, third.samples.offset :], offset=third.samples.offset)
    for other in (in_pieces, [*at_once[:2], *flushed(Reblocker(LONGEST, turns), [rest])]):
        assert [(cut.used, cut.missing) for cut in other] == [(cut.used, cut.missing) for cut in at_once]
        for one, two in zip(at_once, other, strict=True):
            np.testing.assert_array_equal(one.samples.values, two.samples.values)
            if not channel:
                first, second = one.samples.block_pulses, two.samples.block_pulses
                assert first is not None
                assert second is not None
                np.testing.assert_array_equal(first.times, second.times)


def test_a_slow_shaft_gives_the_longest_block_and_so_does_a_dead_tacho() -> None:
    whole = run(1, channel=False)
    for pulses in (Pulses(np.arange(1.0, 20.0)), Pulses(np.empty(0)), None):
        found = flushed(Reblocker(LONGEST, turns_for(10, 1, channel=False)), [replace(whole, pulses=pulses)])
        assert [cut.samples.values.shape[1] for cut in found] == [2000] * 10


def test_disturbed_pulses_make_no_flood_of_blocks() -> None:
    whole = run(1, channel=False)
    noisy = replace(whole, pulses=Pulses(np.sort(np.random.default_rng(1).uniform(0.0, 20.0, 19000))))
    found = flushed(Reblocker(LONGEST, turns_for(1, 1, channel=False)), [noisy])
    assert [cut.samples.values.shape[1] for cut in found] == [2000] * 10


@pytest.mark.parametrize(("share", "whole"), [(0.95, True), (0.5, False)])
def test_what_is_left_over_is_a_block_with_nine_tenths_of_its_turns(share: float, whole: bool) -> None:
    seconds = 1.0 + share
    samples = Samples(
        np.ones((1, round(seconds * RATE))), ("x",), units=("g",), rate=RATE, origin="a",
        pulses=Pulses(np.arange(0.005, seconds, 0.01)),
    )  # fmt: skip
    found = flushed(Reblocker(LONGEST, turns_for(100, 1, channel=False)), [samples])
    assert [cut.missing == 0 for cut in found] == [True, whole]


def test_missing_teeth_ratio_and_what_the_source_states() -> None:
    assert BlockRevolutions(2.0, per_revolution=60, missing_teeth=2).pulses_of(None) == 116
    assert BlockRevolutions(2.0, per_revolution=60, missing_teeth=2).pulses_of(36) == 68
    assert BlockRevolutions(10.0, per_revolution=1, ratio=4.0).pulses_of(None) == 2
    assert BlockRevolutions(0.1).pulses_of(None) == 1


@pytest.mark.parametrize("channel", [False, True])
def test_a_watched_folder_and_its_replay_cut_alike(tmp_path: Path, channel: bool) -> None:
    whole = run(2, channel=channel)
    size = 3000
    how: dict[str, Any] = {
        "block_s": LONGEST,
        "block_revolutions": turns_for(5, 2, channel=channel),
        "channels": (
            ChannelSpec("x", column=1, unit="g"),
            *((ChannelSpec("tacho", column=2, unit="unknown", any_unit=True),) if channel else ()),
        ),
        "format": "csv",
        "pulses": None if channel else "{stem}.pulses",
    }
    rig = Rig(tmp_path, **how)
    for number, begin in enumerate(range(0, 12000, size)):
        rows = whole.values[:, begin : begin + size]
        text = f"Start: 2024-05-01 12:00:{begin // 1000:02d}\n"
        text += "".join(",".join(f"{value:.4f}" for value in column) + "\n" for column in rows.T)
        (tmp_path / f"{number}.csv").write_text(text)
        if whole.pulses is not None:
            own = whole.pulses.in_samples(RATE, begin, begin + size).shifted(-begin / RATE).times
            (tmp_path / f"{number}.pulses").write_text("pulses\n" + "".join(f"{time:.7f}\n" for time in own))
        rig.run(4.0, most=3)
        rig.restart()
    rig.run(30.0)
    replayed = list(open_source(replace(rig.spec, url=f"folder:{tmp_path}")))
    assert len(rig.items) > 15
    for one, two in zip(rig.items, replayed, strict=False):
        assert isinstance(one, Block)
        assert isinstance(two, Block)
        assert (one.name, one.content_hash, one.start) == (two.name, two.content_hash, two.start)
    assert not any(isinstance(item, Rejected) for item in replayed[: len(rig.items)])


def config(operating: str, source: str) -> SourceSpec:
    text = f"""
[operating]
speed_hz = 20
{operating}
[[bearing]]
name = "b"
n_elements = 9
element_diameter_mm = 7.94
pitch_diameter_mm = 39.04
[[channel]]
name = "x"
source = "s"
unit = "g"
bearing = "b"
[[source]]
name = "s"
{source}
"""
    made = validate(tomllib.loads(text), Path("config.toml"))
    return source_spec(made, made.source[0], "x")


def test_the_configuration_says_how_turns_are_counted() -> None:
    spec = config(
        'tacho_channel = 3\npulses_per_revolution = 60\ntacho_missing_teeth = 2\ntacho_edge = "falling"',
        "block_revolutions = 50",
    )
    assert spec.block_revolutions == BlockRevolutions(50.0, 60, 2, 1.0, "3", None, True)


@pytest.mark.parametrize(
    ("operating", "source", "words"),
    [
        ("", "block_revolutions = 50", "needs block_s in seconds"),
        ("tacho_channel = 3", 'block_revolutions = 50\nblock_s = "file"', "cuts files"),
        ("tacho_channel = 3", 'block_revolutions = 50\nurl = "tcp://127.0.0.1:1"', "taken as they come"),
        ("", 'pulses = "t"\nurl = "mqtt://a/b"', "bring theirs with them"),
        ("tacho_channel = 3", "block_revolutions = 0", "block_revolutions"),
    ],
)
def test_what_cannot_be_cut_by_turns(operating: str, source: str, words: str) -> None:
    with pytest.raises((ConfigError, SourceError), match=words):
        config(operating, source)
