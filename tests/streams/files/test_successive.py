"""A file of several recordings gives what files of one recording each would give."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from spallwatch import blocks, read
from spallwatch.recordings import RecordingError
from streams.files.formats.text import read_layout
from streams.files.recognise import as_pattern
from streams.files.survey import survey
from streams.open import open_source
from streams.recording.state import ResumableSource
from streams.types.block import Block, Rejected
from streams.types.samples import ReaderError
from streams.types.spec import ChannelSpec, SourceSpec
from tests.streams.folders import Rig
from tests.streams.several_makers import (
    FILES,
    LVM_HEAD,
    NOON,
    RATE,
    TEXTS,
    TORN,
    Part,
    csv,
    hdf5,
    lvm,
    lvm_segment,
    parts_of,
    stamped_csv,
    tdms,
    torn_hdf5,
    uff,
    xlsx,
)
from tests.support.effort import effort_count

CHANNELS = (ChannelSpec("acc", column="acc"),)
LAYOUTS = TEXTS | FILES
GAPS = st.sampled_from([0.0, 2.0, 1800.0])
Item = tuple[Any, ...] | str


def items(path: Path, **spec: Any) -> list[Block | Rejected]:
    made = SourceSpec(name="s", url=str(path), channels=CHANNELS, **spec)
    return list(open_source(made))


def essence(found: Sequence[Block | Rejected]) -> list[Item]:
    """What of blocks does not depend on the names of their files."""
    return [
        (item.rate, item.start and round(item.start, 6), item.elapsed and round(item.elapsed, 6), item.samples.tolist())
        if isinstance(item, Block)
        else item.status
        for item in found
    ]


def written(folder: Path, parts: Sequence[Part], layout: str) -> tuple[Path, Path]:
    """Write the parts as one file, and as files of one part each; return both folders."""
    make, ending = LAYOUTS[layout]
    one, each = folder / "one", folder / "each"
    for made in (one, each):
        made.mkdir()
    (one / f"a.{ending}").write_bytes(make(parts))
    for number, part in enumerate(parts):
        (each / f"a{number:03d}.{ending}").write_bytes(make([part]))
    return one, each


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("block_s", ["file", 0.05])
@given(
    lengths=st.lists(st.integers(30, 130), min_size=2, max_size=5),
    gaps=st.lists(GAPS, min_size=5, max_size=5),
    seed=st.integers(0, 999),
)
@settings(max_examples=effort_count(quick=2, full=60), deadline=None)
def test_any_cut_into_recordings_gives_the_blocks_of_separate_files(
    tmp_path_factory: pytest.TempPathFactory,
    layout: str,
    block_s: Any,
    lengths: list[int],
    gaps: list[float],
    seed: int,
) -> None:
    parts = parts_of(lengths, gaps[: len(lengths)], seed)
    one, each = written(tmp_path_factory.mktemp("cut"), parts, layout)
    expected = essence(items(each, block_s=block_s))
    assert essence(items(one, block_s=block_s)) == expected
    assert any(isinstance(item, tuple) for item in expected) or block_s != "file"
    assert essence(watched(one, block_s=block_s, restarts=seed % 3 == 0)) == essence(watched(each, block_s=block_s))


def watched(folder: Path, *, restarts: bool = False, **spec: Any) -> list[Block | Rejected]:
    rig = Rig(folder, rate=None, channels=CHANNELS, **spec)
    while rig.run(1000.0, most=1):
        if restarts:
            rig.restart()
    repeated = [isinstance(item, Rejected) and item.is_repetition for item in rig.items]
    assert all(outcome == "committed" or again for outcome, again in zip(rig.outcomes, repeated, strict=True))
    return rig.items


def test_blocks_are_named_by_the_number_of_their_recording(tmp_path: Path) -> None:
    (tmp_path / "a.lvm").write_bytes(lvm(parts_of([100, 100, 100], [5.0] * 3)))
    assert [item.name for item in items(tmp_path, block_s="file")] == ["a.lvm", "a.lvm#2", "a.lvm#3"]
    names = [item.name for item in items(tmp_path, block_s=0.05)]
    assert names == [name for file in ("a.lvm", "a.lvm#2", "a.lvm#3") for name in (file, f"{file}[0.05 s]")]


@pytest.mark.parametrize("block_s", ["file", 0.05])
def test_a_daemon_killed_between_two_recordings_goes_on_with_the_second(tmp_path: Path, block_s: Any) -> None:
    parts = parts_of([100, 100, 100], [5.0] * 3)
    (tmp_path / "a.lvm").write_bytes(lvm(parts))
    rig = Rig(tmp_path, rate=None, channels=CHANNELS, block_s=block_s)
    count = 3 if block_s == "file" else 6
    for number in range(1, count + 1):
        assert len(rig.run(30.0, most=1)) == 1
        backlog = rig.source.backlog()
        assert (backlog.accepted, backlog.pending) == ((0, 1) if number < count else (1, 0))
        rig.restart()
    assert rig.run(1000.0) == []
    assert rig.outcomes == ["committed"] * count
    assert_array_equal(rig.samples(), np.concatenate([part.values[0] for part in parts]))
    assert [item.sequence for item in rig.items] == list(range(1, count + 1))


@pytest.mark.parametrize("block_s", ["file", 0.05])
@pytest.mark.parametrize("restarts", [False, True])
def test_recordings_that_are_appended_to_a_file_come_once(tmp_path: Path, block_s: Any, restarts: bool) -> None:
    parts = parts_of([100] * 4, [60.0] * 4)
    rig = Rig(tmp_path, rate=None, channels=CHANNELS, block_s=block_s)
    for count in range(1, 5):
        (tmp_path / "a.lvm").write_bytes(lvm(parts[:count]))
        rig.run(100.0)
        assert_array_equal(rig.samples(), np.concatenate([part.values[0] for part in parts[:count]]))
        if restarts:
            rig.restart()
    assert rig.outcomes == ["committed"] * len(rig.items)
    assert rig.source.backlog().accepted == 1


def test_a_copy_of_a_file_of_several_recordings_is_a_duplicate(tmp_path: Path) -> None:
    (tmp_path / "a.lvm").write_bytes(lvm(parts_of([100, 100], [5.0] * 2)))
    (tmp_path / "b.lvm").write_bytes((tmp_path / "a.lvm").read_bytes())
    for found in (items(tmp_path, block_s="file"), watched(tmp_path, block_s="file", restarts=True)):
        assert [getattr(item, "status", "") for item in found] == ["", "", "duplicate"]


BOTH = (ChannelSpec("acc", key="*acc"), ChannelSpec("vert", key="*vert"))


def torn_file(folder: Path, layout: str, count: int) -> tuple[Path, list[Part], bytes]:
    """Write a file whose last of ``count`` recordings of two channels breaks off; return what it would be, too."""
    parts = parts_of([100] * count, [5.0] * count, channels=2)
    make, ending = LAYOUTS[layout.partition(",")[0]]
    path = folder / f"a.{ending}"
    path.write_bytes(TORN[layout](parts, ("acc", "vert")))
    return path, parts, make(parts, ("acc", "vert"))


def of_both(folder: Path, block_s: Any) -> list[Block | Rejected]:
    return list(open_source(SourceSpec(name="s", url=str(folder), channels=BOTH, block_s=block_s)))


@pytest.mark.parametrize("layout", TORN)
@pytest.mark.parametrize("block_s", ["file", 0.05])
@pytest.mark.parametrize("count", [2, 3])
def test_of_a_file_that_breaks_off_the_whole_recordings_are_read(
    tmp_path: Path, layout: str, block_s: Any, count: int
) -> None:
    path, parts, _ = torn_file(tmp_path, layout, count)
    *found, last = of_both(path, block_s)
    assert_array_equal(
        np.concatenate([item.samples for item in found if isinstance(item, Block)], axis=1),
        np.concatenate([part.values for part in parts[:-1]], axis=1),
    )
    assert isinstance(last, Rejected)
    assert (last.name, last.status) == (f"{path.name}#{count}", "incomplete")
    assert path.name in last.reason
    if layout in ("csv", "stamped") and block_s != "file":
        # Such a text is read while it grows: blocks of its last recording have come.
        return
    rig = Rig(tmp_path, rate=None, channels=BOTH, block_s=block_s)
    assert not any(isinstance(item, Rejected) for item in rig.run(300.0))
    while rig.run(1000.0, most=1):
        rig.restart()
    assert essence(rig.items) == essence([*found, last])
    assert (rig.source.backlog().accepted, rig.source.backlog().pending) == (1, 0)
    assert [item.sequence for item in rig.items] == list(range(1, len(rig.items) + 1))


def test_a_group_of_its_own_may_break_off_anywhere(tmp_path: Path) -> None:
    parts = parts_of([100] * 3, [5.0] * 3, channels=2)
    (tmp_path / "a.h5").write_bytes(torn_hdf5(parts, ("acc", "vert"), place=1))
    first, second, last = of_both(tmp_path / "a.h5", "file")
    assert isinstance(first, Block)
    assert isinstance(second, Block)
    assert (first.start, second.start) == pytest.approx((parts[0].start, parts[2].start), abs=1e-3)
    assert isinstance(last, Rejected)
    assert "data set run2/vert: 10 chunks are promised, 2 were written" in last.reason


def test_a_group_of_which_a_later_segment_breaks_off_is_left_out(tmp_path: Path) -> None:
    parts = parts_of([100] * 3, [5.0] * 3)
    half = [replace(parts[2], values=parts[2].values[:, :50]), replace(parts[2], values=parts[2].values[:, 50:])]
    clocks = ("12-00", "12-30", "13-00", "13-00")
    text = tdms([*parts[:2], *half], groups=[f"2026-01-01_{clock}-00" for clock in clocks])
    (tmp_path / "a.tdms").write_bytes(text[:-50])
    assert [getattr(item, "status", "") for item in items(tmp_path, block_s="file")] == ["", "", "incomplete"]


@pytest.mark.parametrize("kind", ["hdf5", "tdms", "one group", "all"])
def test_what_may_be_no_recording_of_its_own_refuses_the_file(tmp_path: Path, kind: str) -> None:
    parts = parts_of([100, 100], [5.0] * 2)
    alike = [replace(part, start=NOON) for part in parts]
    makes = {
        "hdf5": ("h5", lambda: torn_hdf5(alike)),
        "tdms": ("tdms", lambda: tdms(alike)[:-50]),
        "one group": ("tdms", lambda: tdms(parts, groups=["2026-01-01_12-00-00"] * 2)[:-50]),
        "all": ("lvm", lambda: lvm(parts[:1])[:-50]),
    }
    ending, make = makes[kind]
    (tmp_path / f"a.{ending}").write_bytes(make())
    assert [getattr(item, "status", "") for item in items(tmp_path, block_s="file")] == ["incomplete"]


@pytest.mark.parametrize("layout", TORN)
def test_a_recording_that_breaks_off_is_waited_for(tmp_path: Path, layout: str) -> None:
    path, parts, whole = torn_file(tmp_path, layout, 2)
    rig = Rig(tmp_path, rate=None, channels=BOTH)
    assert rig.run(300.0) == []
    path.write_bytes(whole)
    assert len(rig.run(30.0)) == 2
    assert_array_equal(rig.samples(), np.concatenate([part.values[0] for part in parts]))


@pytest.mark.parametrize("layout", ["csv", "stamped"])
@pytest.mark.parametrize("restarts", [False, True])
def test_a_text_that_grew_and_breaks_off_is_told(tmp_path: Path, layout: str, restarts: bool) -> None:
    path, parts, _ = torn_file(tmp_path, layout, 2)
    rig = Rig(tmp_path, rate=None, channels=BOTH, block_s=0.05)
    while rig.run(1000.0, most=1):
        if restarts:
            rig.restart()
    assert rig.items[-1].name == path.name
    assert [getattr(item, "status", "") for item in rig.items].count("incomplete") == 1
    assert rig.source.backlog().pending == 0
    first = [item for item in rig.items if isinstance(item, Block)][:2]
    assert_array_equal(np.concatenate([item.samples for item in first], axis=1), parts[0].values)


@pytest.mark.parametrize("layout", [layout for layout in TORN if layout not in ("hdf5", "xlsx")])
def test_a_recording_that_was_left_out_comes_once_it_is_whole(tmp_path: Path, layout: str) -> None:
    path, parts, whole = torn_file(tmp_path, layout, 2)
    rig = Rig(tmp_path, rate=None, channels=BOTH)
    assert [isinstance(item, Block) for item in rig.run(1000.0)] == [True, False]
    path.write_bytes(whole)
    rig.run(1000.0)
    blocks_of = [item for item in rig.items if isinstance(item, Block)]
    assert_array_equal(np.concatenate([item.samples for item in blocks_of], axis=1), np.concatenate(
        [part.values for part in parts], axis=1))  # fmt: skip


def test_a_replay_goes_on_behind_the_first_recording_of_a_file(tmp_path: Path) -> None:
    (tmp_path / "a.lvm").write_bytes(lvm(parts_of([100, 100, 100], [5.0] * 3)))
    spec = SourceSpec(name="s", url=str(tmp_path), channels=CHANNELS, block_s="file")
    source = open_source(spec)
    assert isinstance(source, ResumableSource)
    whole = essence(list(source))
    for count in (1, 2):
        for _ in zip(range(count), source, strict=False):
            pass
        assert essence(list(open_source(spec, begin=source.state()))) == whole[count:]
    assert source.has_blocks(3)
    assert not source.has_blocks(4)


def renamed(parts: list[Part]) -> bytes:
    return (LVM_HEAD + lvm_segment(parts[0]) + lvm_segment(parts[1], ("vel",))).encode()


def undated(parts: list[Part]) -> bytes:
    return (LVM_HEAD + lvm_segment(parts[0]) + lvm_segment(parts[1], dated=False)).encode()


def overlapping(parts: list[Part]) -> bytes:
    return lvm([parts[0], replace(parts[1], start=NOON + 0.05)])


def set_back(parts: list[Part]) -> bytes:
    return csv([parts[0], replace(parts[1], start=NOON - 3600.0)])


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (renamed, "has acc, that with its head in line 132 vel"),
        (undated, "that with its head in line 130 states no start of its own"),
        (
            overlapping,
            "begins 2026-01-01T12:00:00.050Z, before that with its head in line 21 ends 2026-01-01T12:00:00.100Z",
        ),
        (set_back, "sensors recorded at the same time, or a clock that was set back"),
    ],
)
def test_what_may_be_no_recordings_of_the_same_channels_is_refused(
    make: Callable[[list[Part]], bytes], words: str
) -> None:
    with pytest.raises(ReaderError, match="holds 2 recordings") as caught:
        read_layout(make(parts_of([100, 100], [5.0] * 2)), "x.lvm")
    assert caught.value.status == "wrong_shape"
    assert words in str(caught.value)
    assert "a file of its own" in str(caught.value)


def test_a_contradiction_within_a_later_recording_is_refused_with_its_lines() -> None:
    first, second = map(lvm_segment, parts_of([100, 100], [5.0] * 2))
    other = second.replace("Delta_X\t0.001", "Delta_X\t0.002")
    with pytest.raises(ReaderError, match="in the recording from line 124 on") as caught:
        read_layout((LVM_HEAD + first + other).encode(), "x.lvm")
    assert caught.value.status == "wrong_rate"
    broken = (LVM_HEAD + first + second.replace("\n0.050000\t", "\n0.050000\tx")).encode()
    (line,) = [number for number, row in enumerate(broken.split(b"\n"), 1) if b"\tx" in row]
    with pytest.raises(ReaderError, match=f"line {line}"):
        read_layout(broken, "x.lvm")


def test_another_rate_is_that_of_its_recording_as_among_files(tmp_path: Path) -> None:
    parts = parts_of([100, 100], [5.0] * 2)
    parts[1] = replace(parts[1], rate=2000.0, unit="m/s2")
    one, each = written(tmp_path, parts, "lvm")
    for block_s in ("file", 0.05):
        found = items(one, block_s=block_s)
        assert essence(found) == essence(items(each, block_s=block_s))
        assert {item.rate for item in found if isinstance(item, Block)} == {1000.0, 2000.0}


def test_the_hour_that_occurs_twice_is_no_clock_set_back() -> None:
    first = parts_of([100], [0.0])[0]
    night = [replace(first, start=NOON + shift) for shift in (0.0, 1800.0, 60.0)]
    day = csv(night).replace(b"2026-01-01T12:", b"2025-10-26T02:").replace(b"00Z", b"00").replace(b"000Z", b"000")
    found = read_layout(day, "x.csv", "Europe/Berlin")
    assert len(found.recordings) == 3
    with pytest.raises(ReaderError, match="set back"):
        read_layout(day, "x.csv", "UTC")


@pytest.mark.parametrize("by", ["name", "count", "mtime"])
def test_what_dates_the_file_dates_its_first_recording_and_the_others_behind_it(tmp_path: Path, by: Any) -> None:
    text = lvm(parts_of([100, 100], [5.0] * 2))
    (tmp_path / "a_2026-02-03_04-05-06.lvm").write_bytes(text)
    found = items(tmp_path, block_s="file", time_from=by, start=NOON if by == "count" else None)
    first, second = (item.start for item in found if isinstance(item, Block))
    assert first is not None
    assert second is not None
    assert second - first == pytest.approx(5.1, abs=1e-5)
    if by == "mtime":
        assert second + 0.1 == pytest.approx((tmp_path / "a_2026-02-03_04-05-06.lvm").stat().st_mtime, abs=1e-3)


def test_read_says_how_several_recordings_are_read(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(stamped_csv(parts_of([100, 100], [5.0] * 2)))
    with pytest.raises(RecordingError, match=r"several recordings; .* blocks\(\.\.\., block_s=\"file\"\)"):
        read(tmp_path / "a.csv")
    found = list(blocks(tmp_path / "a.csv", block_s="file"))
    assert [signal.attrs["name"] for signal in found] == ["a.csv", "a.csv#2"]
    assert found[1].attrs["elapsed_s"] == pytest.approx(5.1)


def sidecars(folder: Path) -> Iterator[str]:
    (folder / "a.csv.json").write_text('{"speed_hz": 25.0, "start_utc": "2026-01-01T12:00:00Z"}')
    yield "first start"
    (folder / "a.csv.json").write_text('{"rate_hz": 900.0}')
    yield "wrong rate"


def test_a_sidecar_is_for_all_recordings_of_its_file_and_its_start_for_the_first(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(csv(parts_of([100, 100], [5.0] * 2)))
    states = sidecars(tmp_path)
    next(states)
    assert [item.speed for item in items(tmp_path, block_s="file") if isinstance(item, Block)] == [25.0, 25.0]
    next(states)
    assert [item.status for item in items(tmp_path, block_s="file") if isinstance(item, Rejected)] == ["wrong_rate"]


def test_files_of_one_channel_each_with_several_recordings_are_read_together(tmp_path: Path) -> None:
    for channel in range(1, 3):
        (tmp_path / f"r_ch{channel}.csv").write_bytes(csv(parts_of([100, 100], [5.0] * 2, seed=channel)))
    found = list(blocks(tmp_path, block_s="file"))
    assert [signal.sizes for signal in found] == [{"channel": 2, "time": 100}] * 2
    (tmp_path / "r_ch2.csv").write_bytes(csv(parts_of([200], [5.0])))
    with pytest.raises(RecordingError, match="different numbers of recordings"):
        list(blocks(tmp_path, block_s="file", files=["*_ch1.csv", "*_ch2.csv"]))


def test_rates_are_the_stated_ones() -> None:
    assert {one.rate for one in read_layout(lvm(parts_of([50, 50], [1.0, 1.0])), "x.lvm").recordings} == {RATE}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_titles_of_a_survey_name_the_channels_of_all_recordings(tmp_path: Path, layout: str) -> None:
    make, ending = LAYOUTS[layout]
    parts = parts_of([100, 100, 100], [5.0] * 3, channels=2)
    path = tmp_path / f"a.{ending}"
    path.write_bytes(make(parts, ("acc", "vert")))
    seen = survey(str(path))
    keys = tuple(ChannelSpec(row.name, key=as_pattern(row.title)) for row in seen.vibration)
    found = list(open_source(SourceSpec(name="s", url=str(path), channels=keys, block_s="file")))
    assert [item.samples.shape for item in found if isinstance(item, Block)] == [(2, 100)] * 3
    assert seen.starts[1] == pytest.approx(NOON + 10.2)


@pytest.mark.parametrize(("make", "ending"), [(tdms, "tdms"), (hdf5, "h5")])
@pytest.mark.parametrize("form", ["2026-01-01_12-%02d-00", "20260101_12%02d00"])
def test_groups_named_by_their_times_are_recordings(
    tmp_path: Path, make: Callable[..., bytes], ending: str, form: str
) -> None:
    path = tmp_path / f"a.{ending}"
    path.write_bytes(make(parts_of([100, 100], [5.0] * 2), groups=[form % 30, form % 0]))
    found = [item for item in items(path, block_s="file") if isinstance(item, Block)]
    assert [item.start for item in found] == [NOON, NOON + 1800.0]
    assert_array_equal(found[1].samples[0], parts_of([100, 100], [5.0] * 2)[0].values[0])


@pytest.mark.parametrize("make", [tdms, hdf5])
def test_groups_of_one_time_are_sensors_of_one_recording(tmp_path: Path, make: Callable[..., bytes]) -> None:
    ending = "tdms" if make is tdms else "h5"
    parts = parts_of([100, 100], [0.0] * 2)
    (tmp_path / f"a.{ending}").write_bytes(make([replace(part, start=NOON) for part in parts]))
    (signal,) = blocks(tmp_path, block_s="file")
    assert signal.sizes == {"channel": 2, "time": 100}


@pytest.mark.parametrize("make", [tdms, hdf5, xlsx])
def test_groups_that_overlap_are_refused_by_both_readings(tmp_path: Path, make: Callable[..., bytes]) -> None:
    ending = {tdms: "tdms", hdf5: "h5", xlsx: "xlsx"}[make]
    parts = parts_of([3000, 3000], [0.0] * 2)
    (tmp_path / f"a.{ending}").write_bytes(make([parts[0], replace(parts[1], start=NOON + 1.5)]))
    with pytest.raises(RecordingError, match="sensors recorded at the same time, or a clock that was set back"):
        list(blocks(tmp_path / f"a.{ending}", block_s="file"))


def test_sets_of_one_node_without_starts_are_refused_by_both_readings(tmp_path: Path) -> None:
    stamp = b"01-Jan-26 12:00:00.000000".ljust(80)
    text = uff(parts_of([100, 100], [0.0] * 2))
    assert text.count(stamp) == 1
    text = uff([replace(part, start=NOON) for part in parts_of([100, 100], [0.0] * 2)]).replace(
        stamp, b"NONE".ljust(80)
    )
    (tmp_path / "a.uff").write_bytes(text)
    with pytest.raises(RecordingError, match=r"2 functions are called 1:[+]Z: .*, recordings one after"):
        list(blocks(tmp_path / "a.uff", block_s="file"))


def test_sheets_without_starts_are_asked_for(tmp_path: Path) -> None:
    (tmp_path / "a.xlsx").write_bytes(xlsx([replace(part, start=NOON) for part in parts_of([100, 100], [0.0] * 2)]))
    with pytest.raises(RecordingError, match=r"name one in .* recordings one after another have the same columns"):
        list(blocks(tmp_path / "a.xlsx", block_s="file"))
