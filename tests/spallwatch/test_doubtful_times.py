"""Clocks that jump, stop, begin again or say nothing, by every way in and format: no time is wrong without a word."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import spallwatch as sw
from monitor.health.block_time import timed
from monitor.health.signal.quality import OrderState
from spallwatch.recordings import DoubtedTimeWarning
from streams.dates.best import latest_of
from streams.types.block import Block
from streams.types.spec import ChannelSpec
from tests.streams.folders import Rig
from tests.support.dated_files import COUNT, DOUBTED, EVERY, MAKERS, RIGHT
from tests.support.ways_in import by_hand, channel_table

PRESENT = datetime.now(UTC).replace(microsecond=0)


class Seen(NamedTuple):
    """Time and uncertainty of a block, s, None where it has none, and whether a word says that it is doubted."""

    time: float | None
    uncertainty: float | None
    doubted: bool


Clocks = Sequence[datetime | None]


def _moved(begin: int, end: int, by: timedelta) -> Clocks:
    return [clock + by if begin <= index < end else clock for index, clock in enumerate(RIGHT)]


def _set(begin: int, end: int, at: datetime) -> Clocks:
    return [at + (index - begin) * EVERY if begin <= index < end else clock for index, clock in enumerate(RIGHT)]


def _without(*missing: int) -> Clocks:
    return [None if index in missing else clock for index, clock in enumerate(RIGHT)]


KINDS: dict[str, tuple[Clocks, set[int]]] = {
    "two in the future": (_set(4, 6, PRESENT + timedelta(days=400)), {4, 5}),
    "one in the future": (_set(4, 5, PRESENT + timedelta(days=40)), {4}),
    "the last three in the future": (_set(9, 12, PRESENT + timedelta(days=400)), {9, 10, 11}),
    "five ahead of a past": (_moved(4, 9, timedelta(days=200)), {4, 5, 6, 7, 8}),
    "four ahead by three hours": (_moved(3, 7, timedelta(hours=3)), {3, 4, 5, 6}),
    "three back by a day": (_moved(5, 8, -timedelta(days=1)), {5, 6, 7}),
    "four back by a year": (_moved(5, 9, -timedelta(days=365)), {5, 6, 7, 8}),
    "1970 for three": (_set(5, 8, datetime(1970, 1, 1, 0, 0, 9, tzinfo=UTC)), {5, 6, 7}),
    "1970 to the end": (_set(7, 12, datetime(1970, 1, 1, 0, 0, 9, tzinfo=UTC)), {7, 8, 9, 10, 11}),
    "2000 and again": (
        [*RIGHT[:3], *[datetime(2000, 1, 1, tzinfo=UTC) + EVERY * (k % 2) for k in range(4)], *RIGHT[7:]],
        {3, 4, 5, 6},
    ),
    "it stands": ([*RIGHT[:4], *[RIGHT[3]] * 2, *RIGHT[6:]], {4, 5}),
    "one without a date": (_without(5), {5}),
    "two without a date": (_without(5, 6), {5, 6}),
    "the last without a date": (_without(11), {11}),
}
"""What each of twelve files states, and which of them are wrong."""


def made(folder: Path, form: str, clocks: Clocks) -> Path:
    data = folder / "data"
    data.mkdir()
    for index, clock in enumerate(clocks):
        MAKERS[form][1](data, index, clock)
    return data


def by_blocks(folder: Path, form: str) -> dict[int, Seen]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = {str(block.attrs["name"]): block.attrs for block in sw.blocks(folder / "data", block_s="file")}
    said = [str(each.message) for each in caught if each.category is DoubtedTimeWarning]
    return {
        int(name[:2]): Seen(
            datetime.fromisoformat(words["start_utc"]).timestamp() if "start_utc" in words else None,
            words.get("time_uncertainty_s"),
            any(text.startswith(f"{name}: ") for text in said),
        )
        for name, words in found.items()
    }


def by_replay(folder: Path, form: str) -> dict[int, Seen]:
    came = by_hand(folder, channel_table(MAKERS[form][0], "g"))
    assert len(came.names) == COUNT, came.said
    return {
        int(name[:2]): Seen(None if np.isnan(time) else time, None, bool(flags & DOUBTED))
        for name, time, flags in zip(came.names, came.times, came.flags, strict=True)
    }


def by_folder(folder: Path, form: str) -> dict[int, Seen]:
    name, _, number = MAKERS[form][0].partition(" = ")
    text = number.strip('"')
    channel = ChannelSpec("x", unit="g", column=int(text) if text.isdigit() else text)
    if name == "key":
        channel = ChannelSpec("x", unit="g", key=text)
    rig = Rig(folder / "data", channels=(channel,), rate=None)
    rig.run(60.0)
    state, found = OrderState(), dict[int, Seen]()
    for item in rig.items:
        assert isinstance(item, Block), item
        state, placed = timed(state, item, None, latest_of(PRESENT.timestamp()))
        doubted = bool(set(placed.flags) & DOUBTED)
        found[int(item.name[:2])] = Seen(placed.block.start, placed.judged.uncertainty, doubted)
    return found


def check(found: dict[int, Seen], wrong: set[int], *, whole: bool) -> None:
    """Assert that a time is right or a word says that it is not; ``whole``: all files were known, none is missed."""
    assert len(found) == COUNT
    for index, seen in found.items():
        truth = RIGHT[index].timestamp()
        if not seen.doubted:
            assert not whole or index not in wrong, f"file {index} is believed"
            assert whole or index in wrong or seen.time == pytest.approx(truth, abs=1e-3), f"file {index}: {seen}"
            if whole:
                assert seen.time == pytest.approx(truth, abs=1e-3)
        elif whole and seen.time is not None and seen.uncertainty is not None:
            assert abs(seen.time - truth) <= seen.uncertainty + 1.0, f"file {index}: {seen}, in truth {truth}"
    if whole:
        assert {index for index, seen in found.items() if seen.doubted} == wrong
        times = [seen.time for _, seen in sorted(found.items()) if seen.time is not None]
        assert times == sorted(times)


IN_THREE = [(kind, [*MAKERS][(number + each) % 5]) for number, kind in enumerate(KINDS) for each in (0, 1, 3)]
"""Each kind in three of the formats."""


@pytest.mark.parametrize(("kind", "form"), IN_THREE)
def test_python_says_which_times_are_doubted(kind: str, form: str, tmp_path: Path) -> None:
    clocks, wrong = KINDS[kind]
    made(tmp_path, form, clocks)
    check(by_blocks(tmp_path, form), wrong, whole=True)


@pytest.mark.parametrize(("kind", "form"), IN_THREE)
def test_a_watched_folder_says_what_can_be_known(kind: str, form: str, tmp_path: Path) -> None:
    clocks, wrong = KINDS[kind]
    made(tmp_path, form, clocks)
    found = by_folder(tmp_path, form)
    check(found, wrong, whole=False)
    assert any(seen.doubted for seen in found.values())


@pytest.mark.parametrize(("kind", "form"), [(kind, [*MAKERS][k % 5]) for k, kind in enumerate(KINDS)])
def test_a_replay_flags_the_same_blocks(kind: str, form: str, tmp_path: Path) -> None:
    clocks, wrong = KINDS[kind]
    made(tmp_path, form, clocks)
    check(by_replay(tmp_path, form), wrong, whole=True)
