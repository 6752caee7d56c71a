"""Files of any length become blocks of one length: across files, within growing files, and after a restart."""

from __future__ import annotations

import struct
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from streams.files.datasets import DATA_SETS, DataSet, FileFacts
from streams.files.formats.npy_wav import read_npy
from streams.files.parse.complete import declared_size, whole_part
from streams.open import open_source
from streams.reblock import samples_hash
from streams.types.block import Block, Rejected
from tests.streams.folders import RATE, Rig, csv_bytes, noise
from tests.support.effort import effort_count

LENGTH = 100
BLOCK_S = LENGTH / RATE
T0 = 1_700_000_000.0


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    return Rig(tmp_path, block_s=BLOCK_S, format="csv")


def blocks(rig: Rig) -> list[Block]:
    return [item for item in rig.items if isinstance(item, Block)]


def rejections(rig: Rig) -> list[tuple[str, str]]:
    return [(item.name, item.status) for item in rig.items if isinstance(item, Rejected)]


def check_blocks(rig: Rig, samples: NDArray[np.float64]) -> None:
    found = blocks(rig)
    assert [block.samples.shape[1] for block in found] == [LENGTH] * len(found)
    np.testing.assert_array_equal(rig.samples(), samples)
    for block in found:
        assert block.content_hash == samples_hash(block.samples, block.rate, block.channels)


def test_files_count_as_as_many_waiting_blocks_as_those_before_gave(tmp_path: Path) -> None:
    for number in range(1, 9):
        (tmp_path / f"{number}.csv").write_bytes(csv_bytes(noise(10 * LENGTH, number)))
    rig = Rig(tmp_path, block_s=BLOCK_S, format="csv")
    found: list[float] = []
    while len(rig.items) < 80:
        found += [rig.source.queued_blocks()] * len(rig.run(30.0, most=1))
    # Nothing is known before the end of the first file; then the blocks of one in part count for those before it.
    for left, estimate in zip(range(69, -1, -1), found[10:], strict=True):
        assert left / 2.0 <= estimate <= 2.5 * left + 12.0
    assert rig.run(5.0) == []
    assert rig.source.queued_blocks() == 0


def test_a_log_that_grows_is_taken_up_where_the_last_block_ended(rig: Rig) -> None:
    samples = noise(1000, 1)
    data = csv_bytes(samples)
    path = rig.root / "log.csv"
    generator = np.random.default_rng(3)
    end = 0
    while end < len(data):
        # Half a line at the end most of the time: a number that is not all there must not be believed.
        end += int(generator.integers(1, 900))
        path.write_bytes(data[:end])
        rig.run(float(generator.choice([0.5, 4.0])))
        if generator.random() < 0.3:
            rig.restart()
    rig.run()
    check_blocks(rig, samples)
    assert [block.sequence for block in blocks(rig)] == list(range(1, 11))
    backlog = rig.source.backlog()
    assert (backlog.offered, backlog.accepted, backlog.pending) == (1, 1, 0)
    rig.restart()
    assert rig.run(2000.0) == []


def test_what_is_left_of_a_log_waits_and_is_short_in_the_end(rig: Rig) -> None:
    path = rig.root / "log.csv"
    path.write_bytes(csv_bytes(noise(130, 1)))
    rig.run(500.0)
    assert len(blocks(rig)) == 1
    assert rig.source.backlog().pending == 1
    with path.open("ab") as file:
        file.write(csv_bytes(noise(30, 2)))
    rig.run(500.0)
    assert rejections(rig) == []
    rig.run(200.0)
    assert rejections(rig) == [("log.csv[0.1 s]", "short")]
    assert rig.source.backlog().accepted == 1
    with path.open("ab") as file:
        file.write(csv_bytes(noise(100, 3)))
    rig.run()
    np.testing.assert_array_equal(blocks(rig)[-1].samples[0], noise(100, 3))


def test_a_log_that_is_rotated_while_it_grows_loses_and_doubles_nothing(rig: Rig) -> None:
    first, second = noise(250, 1), noise(200, 2)
    path = rig.root / "log.csv"
    path.write_bytes(csv_bytes(first[:220]))
    rig.run()
    with path.open("ab") as file:
        file.write(csv_bytes(first[220:]))
    path.rename(rig.root / "log.1.csv")
    path.write_bytes(csv_bytes(second))
    rig.run(700.0)
    found = blocks(rig)
    np.testing.assert_array_equal(
        np.sort(np.concatenate([block.samples[0] for block in found])), np.sort(np.concatenate([first[:200], second]))
    )
    assert [status for _, status in rejections(rig)] == ["short"]
    backlog = rig.source.backlog()
    assert (backlog.offered, backlog.accepted, backlog.pending) == (2, 2, 0)


def test_a_log_that_is_copied_away_and_truncated_doubles_nothing(rig: Rig) -> None:
    first, second = noise(1000, 1), noise(200, 2)
    path = rig.root / "log.csv"
    path.write_bytes(csv_bytes(first[:900]))
    rig.run()
    (rig.root / "log.1.csv").write_bytes(csv_bytes(first))
    path.write_bytes(csv_bytes(second))
    rig.run()
    check_blocks(rig, np.concatenate([first, second]))


def test_half_a_line_is_not_believed_while_its_writer_may_pause(rig: Rig) -> None:
    samples = noise(300, 1)
    data, path = csv_bytes(samples), rig.root / "log.csv"
    middle = data.index(b"\n", 900) + 4
    path.write_bytes(data[:middle])
    rig.run(10.0)
    assert [len(block.samples[0]) for block in blocks(rig)] == [LENGTH]
    path.write_bytes(data)
    rig.run()
    check_blocks(rig, samples)


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize("slow", [False, True])
def test_a_last_line_without_an_end_is_taken_with_its_file(rig: Rig, closed: bool, slow: bool) -> None:
    for number in range(1, 4):
        data = csv_bytes(noise(200, number))[:-1]
        path = rig.root / f"f{number}.csv"
        if slow:
            # It is read before it is all there.
            path.write_bytes(data[: len(data) // 2])
            rig.run(0.5)
        path.write_bytes(data)
        if closed:
            rig.watch.closed.add(path.name)
        rig.run(5.0)
    rig.run(20.0)
    check_blocks(rig, np.concatenate([noise(200, number) for number in range(1, 4)]))
    assert rig.source.backlog().pending == 0
    rig.restart()
    assert rig.run(2000.0) == []


@pytest.mark.parametrize("bad", [b"\x00\x01\xff" * 50, b"1,2\n3\n4,5,6\n"], ids=["binary", "ragged"])
def test_an_unreadable_file_holds_up_no_block_of_the_next(rig: Rig, bad: bytes) -> None:
    for number in range(1, 5):
        path = rig.root / f"f{number}.csv"
        path.write_bytes(bad if number == 2 else csv_bytes(noise(200, number))[:-1])
        rig.watch.closed.add(path.name)
        rig.run(2.5)
    assert len(blocks(rig)) == 6
    rig.run(25.0)
    check_blocks(rig, np.concatenate([noise(200, number) for number in (1, 3, 4)]))
    assert [name for name, _ in rejections(rig)] == ["f2.csv"]
    assert rig.source.backlog().pending == 0


@pytest.mark.parametrize("block_s", [BLOCK_S, "file"])
def test_a_file_that_is_written_anew_with_the_zeros_of_before_counts(tmp_path: Path, block_s: float | str) -> None:
    rig = Rig(tmp_path, block_s=block_s, format="csv")
    zeros = np.zeros(LENGTH)
    expected = [zeros, noise(LENGTH, 1), zeros, noise(LENGTH, 2), zeros]
    for samples in expected:
        # In place, as a logger does that has one name for its files: the inode stays.
        (tmp_path / "live.csv").write_bytes(csv_bytes(samples))
        rig.run(700.0)
    check = [item.samples[0] for item in rig.items if isinstance(item, Block)]
    np.testing.assert_array_equal(check, expected)


def test_files_without_a_date_are_never_joined(tmp_path: Path) -> None:
    rig = Rig(tmp_path, block_s=BLOCK_S, format="npy")
    for number in range(2):
        np.save(tmp_path / f"f{number}.npy", noise(250, number))
    rig.run()
    check_blocks(rig, np.concatenate([noise(250, number)[:200] for number in range(2)]))
    assert [status for _, status in rejections(rig)] == ["short", "short"]


def stamped_facts(path: str, place: str, zone: object) -> FileFacts | None:
    if not path.endswith(".npy"):
        return None
    start = float(path.removesuffix(".npy"))
    return FileFacts((start,), start=start, rate=RATE)


@pytest.fixture(scope="module", autouse=True)
def _stamped() -> object:
    DATA_SETS["stamped"] = DataSet("stamped", "TIME.npy", stamped_facts, read_npy)
    yield None
    del DATA_SETS["stamped"]


def said(item: Block | Rejected) -> tuple[object, ...]:
    """Return all that is said of a block, or of what stands in its place, but its samples."""
    return tuple(value for key, value in vars(item).items() if key != "samples")


CUTS = st.lists(st.integers(1, 260), min_size=1, max_size=8)


@settings(max_examples=effort_count(quick=10, full=300))
@given(cuts=CUTS, gap_after=st.integers(0, 8), restarts=st.sets(st.integers(0, 12)), seed=st.integers(0, 99))
def test_dated_files_give_the_same_blocks_however_they_were_cut(
    tmp_path_factory: pytest.TempPathFactory, cuts: list[int], gap_after: int, restarts: set[int], seed: int
) -> None:
    root = tmp_path_factory.mktemp("cut")
    rig = Rig(root, block_s=BLOCK_S, format="stamped", rate=None)
    samples = noise(sum(cuts), seed)
    begin, when, runs = 0, T0, [0]
    for index, count in enumerate(cuts):
        if index == gap_after and index:
            when += 1.0
            runs.append(begin)
        np.save(root / f"{when:.6f}.npy", samples[begin : begin + count])
        begin += count
        when += count / RATE
    for number in range(60):
        if not rig.run(5.0, most=1):
            break
        if number in restarts:
            rig.restart()
    rig.run(1500.0)
    runs.append(begin)
    expected = []
    for first, last in pairwise(runs):
        parts = [samples[at : min(at + LENGTH, last)] for at in range(first, last, LENGTH)]
        expected += [part for part in parts if part.size >= 0.9 * LENGTH]
    found = blocks(rig)
    assert len(found) == len(expected)
    for block, part in zip(found, expected, strict=True):
        np.testing.assert_array_equal(block.samples[0], part)
    assert sorted(rig.ledger.blocks("s")) == list(range(1, len(rig.items) + 1))
    assert rig.source.backlog().pending == 0
    assert rig.source.backlog().offered == len(cuts)
    assert list(map(said, rig.items)) == list(map(said, open_source(rig.spec)))


def test_times_of_blocks_go_on_across_files(tmp_path: Path) -> None:
    rig = Rig(tmp_path, block_s=BLOCK_S, format="stamped", rate=None)
    for index in range(3):
        np.save(tmp_path / f"{T0 + 0.15 * index:.6f}.npy", noise(150, index))
    rig.run(700.0)
    starts = [block.start for block in blocks(rig)]
    assert starts == pytest.approx([T0, T0 + 0.1, T0 + 0.2, T0 + 0.3], abs=1e-6)
    assert blocks(rig)[1].name.endswith("[0.1 s]")


def tdms_segment(payload: bytes, following: int | None = None) -> bytes:
    length = len(payload) if following is None else following
    return b"TDSm" + struct.pack("<IIQQ", 14, 4713, length, 0) + payload


def test_a_tdms_file_is_taken_segment_by_segment() -> None:
    one, two = tdms_segment(b"abc"), tdms_segment(b"defg")
    assert whole_part(one + two, "tdms") == one + two
    assert whole_part(one + two[:-1], "tdms") == one
    assert whole_part(one + tdms_segment(b"x", 0xFFFFFFFFFFFFFFFF), "tdms") == one
    assert whole_part(b"none", "tdms") == b""
    assert declared_size(one + two, "a.tdms") == len(one + two)
    assert declared_size(one + two[:-1], "a.tdms") == len(one + two)
    assert declared_size(one + two[:10], "a.tdms") == len(one) + 28


def test_a_tdms_log_that_grows_is_taken_up_where_the_last_block_ended(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    rig = Rig(tmp_path, block_s=BLOCK_S, format="tdms", rate=None)
    path, samples = tmp_path / "log.tdms", noise(600, 4)
    properties = {"wf_increment": 1.0 / RATE, "wf_start_time": np.datetime64("2024-05-01T12:00:00"), "unit_string": "g"}
    for begin in range(0, 600, 75):
        with nptdms.TdmsWriter(path, mode="w" if begin == 0 else "a") as writer:
            writer.write_segment([nptdms.ChannelObject("rig", "x", samples[begin : begin + 75], properties)])
        if begin % 150 == 0:
            # The logger is in the middle of its next segment.
            with path.open("ab") as file:
                file.write(tdms_segment(b"", 4096))
            rig.run(2.0)
            with path.open("rb+") as file:
                file.truncate(path.stat().st_size - len(tdms_segment(b"")))
        rig.run(5.0)
        if begin == 300:
            rig.restart()
    rig.run()
    check_blocks(rig, samples)
    start = np.datetime64("2024-05-01T12:00:00", "s").astype(float)
    assert [block.start for block in blocks(rig)] == pytest.approx([start + 0.1 * k for k in range(6)], abs=1e-6)


@pytest.mark.process
def test_headers_say_how_much_is_to_come(tmp_path: Path) -> None:
    import h5py
    import soundfile

    soundfile.write(tmp_path / "a.wav", np.zeros(100), 1000)
    np.save(tmp_path / "a.npy", np.zeros((3, 100)))
    for version, name in (("earliest", "a.h5"), ("latest", "b.h5")):
        with h5py.File(tmp_path / name, "w", libver=version) as file:
            file["x"] = np.zeros(100)
    for path in sorted(tmp_path.iterdir()):
        data = path.read_bytes()
        assert declared_size(data, path.name) == len(data), path.name
    for data in (b"", b"1,2\n", b"RIFF", b"RIFF\xff\xff\xff\xffWAVE", b"\x93NUMPY", b"\x93NUMPY\x01\x00\x05\x00{'a'}"):
        assert declared_size(data, "a.bin") is None
    assert whole_part(b"1\n2\n3", "csv") == b"1\n2\n"
