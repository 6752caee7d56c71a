"""The watched folder: every file is accepted, rejected with a reason, or pending, and nothing counts twice."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from streams.folder.source import FolderSource
from streams.types.block import Block, Rejected
from streams.types.listing import is_skipped, shown, unshown
from streams.types.spec import ChannelSpec, SourceError, SourceSpec
from tests.streams.folders import Rig, SetClock, csv_bytes, noise, verdicts
from tests.support.streams_levels import open_wav
from tests.support.waiting import PATIENCE_S


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    return Rig(tmp_path)


def put(rig: Rig, name: str, seed: int, count: int = 200) -> Path:
    path = rig.root / name
    path.write_bytes(csv_bytes(noise(count, seed)))
    return path


def test_files_come_in_natural_order_once_settled(rig: Rig) -> None:
    for number in (10, 9, 1):
        put(rig, f"f{number}.csv", number)
    assert rig.run(1.0) == []
    assert rig.source.backlog().pending == 3
    assert rig.source.backlog().oldest_age_s >= 0.9
    assert verdicts(rig.run(5.0)) == [("f1.csv", "accepted"), ("f9.csv", "accepted"), ("f10.csv", "accepted")]
    assert [item.sequence for item in rig.items] == [1, 2, 3]
    backlog = rig.source.backlog()
    assert (backlog.offered, backlog.accepted, backlog.pending, backlog.oldest_age_s) == (3, 3, 0, 0.0)
    assert rig.run(30.0) == []


def test_a_closed_file_is_taken_at_once_where_files_come_in_order(rig: Rig) -> None:
    put(rig, "f2.csv", 2)
    rig.run()
    for name, taken in (("f3.csv", True), ("f1.csv", False)):
        put(rig, name, len(rig.items))
        rig.watch.closed.add(name)
        assert verdicts(rig.run(0.2)) == ([(name, "accepted")] if taken else [])


def test_a_file_that_is_written_slowly_is_waited_for(rig: Rig) -> None:
    path = rig.root / "a.csv"
    parts = csv_bytes(noise(200, 1))
    for end in range(100, len(parts), 300):
        path.write_bytes(parts[:end])
        assert rig.run(1.5) == []
    path.write_bytes(parts)
    assert verdicts(rig.run(5.0)) == [("a.csv", "accepted")]
    np.testing.assert_array_equal(rig.samples(), noise(200, 1))


@pytest.mark.parametrize("name", [".hidden.csv", "a.csv.tmp", "a.csv.part", "a.tdms_index", "b.TMP"])
def test_some_names_are_left_alone(rig: Rig, name: str) -> None:
    put(rig, name, 1)
    put(rig, "ok.csv", 2)
    assert verdicts(rig.run(1000.0)) == [("ok.csv", "accepted")]
    assert rig.source.backlog().offered == 1


def test_a_file_moved_into_place_is_taken(rig: Rig) -> None:
    path = put(rig, "a.csv.part", 1)
    assert rig.run(5.0) == []
    path.rename(rig.root / "a.csv")
    assert verdicts(rig.run(5.0)) == [("a.csv", "accepted")]


def test_a_file_without_bytes_waits_ten_minutes(rig: Rig) -> None:
    (rig.root / "a.csv").write_bytes(b"")
    put(rig, "b.csv", 1)
    assert verdicts(rig.run(590.0)) == [("b.csv", "accepted")]
    assert rig.source.backlog().pending == 1
    assert verdicts(rig.run(20.0)) == [("a.csv", "empty")]
    put(rig, "c.csv", 3).rename(rig.root / "a.csv")
    assert verdicts(rig.run(20.0)) == [("a.csv", "accepted")]


def test_links_pipes_and_strangers_are_refused_and_nothing_waits_for_them(rig: Rig, tmp_path: Path) -> None:
    outside = tmp_path.parent / f"{tmp_path.name}.outside.csv"
    outside.write_bytes(csv_bytes(noise(100, 9)))
    (rig.root / "link.csv").symlink_to(outside)
    os.mkfifo(rig.root / "pipe.csv")
    (rig.root / "folder").symlink_to(tmp_path.parent, target_is_directory=True)
    put(rig, "z.csv", 1)
    found = verdicts(rig.run(10.0))
    assert found == [("link.csv", "refused"), ("pipe.csv", "refused"), ("z.csv", "accepted")]
    assert rig.run(100.0) == []


def test_touched_renamed_copied_and_replaced_files_are_told_apart(rig: Rig) -> None:
    path = put(rig, "a.csv", 1)
    assert verdicts(rig.run()) == [("a.csv", "accepted")]
    os.utime(path, (1.6e9, 1.6e9))
    assert rig.run() == []
    path.rename(rig.root / "b.csv")
    assert rig.run() == []
    (rig.root / "b.csv").rename(rig.root / "c.csv")
    os.utime(rig.root / "c.csv", (1.5e9, 1.5e9))
    assert rig.run() == []
    assert rig.source.backlog().offered == 1
    shutil.copy(rig.root / "c.csv", rig.root / "copy.csv")
    os.link(rig.root / "c.csv", rig.root / "hard.csv")
    assert verdicts(rig.run()) == [("copy.csv", "duplicate"), ("hard.csv", "duplicate")]
    put(rig, "c.csv", 2)
    first, second = rig.run()
    assert isinstance(first, Block)
    assert (first.name, first.sequence) == ("c.csv", 2)
    assert verdicts([second]) == [("hard.csv", "duplicate")]
    rig.restart()
    assert rig.run(100.0) == []
    assert rig.ledger.blocks("s").keys() == {1, 2}


def test_a_rotated_log_is_one_file_under_its_new_name(rig: Rig) -> None:
    put(rig, "log.csv", 1)
    rig.run()
    (rig.root / "log.csv").rename(rig.root / "log.1.csv")
    put(rig, "log.csv", 2)
    (item,) = rig.run()
    assert item.name == "log.csv"
    assert rig.source.backlog().accepted == 2


def test_a_pending_file_that_is_renamed_is_offered_once(rig: Rig) -> None:
    put(rig, "a.csv", 1)
    rig.run(1.2)
    (rig.root / "a.csv").rename(rig.root / "b.csv")
    assert verdicts(rig.run(700.0)) == [("b.csv", "accepted")]
    assert rig.source.backlog().offered == 1


def test_a_pending_file_that_vanishes_is_missed(rig: Rig) -> None:
    put(rig, "0.csv", 0)
    rig.run()
    path = put(rig, "a.csv", 1)
    rig.run(1.2)
    path.unlink()
    assert rig.run(500.0) == []
    (item,) = rig.run(200.0)
    assert isinstance(item, Rejected)
    assert item.status == "unreadable"
    assert "gone" in item.reason


def test_a_dead_sensor_gives_the_same_bytes_without_being_a_copy(rig: Rig) -> None:
    for name in ("a.csv", "b.csv"):
        (rig.root / name).write_bytes(b"0.0000\n" * 100)
    assert verdicts(rig.run()) == [("a.csv", "accepted"), ("b.csv", "accepted")]


def test_damage_is_given_time_and_then_a_status(rig: Rig) -> None:
    (rig.root / "a.csv").write_bytes(b"1.0\nabc\n2.0\n")
    put(rig, "b.csv", 1)
    assert verdicts(rig.run(15.0)) == [("b.csv", "accepted")]
    (item,) = rig.run(10.0)
    assert isinstance(item, Rejected)
    assert (item.name, item.status) == ("a.csv", "unreadable")
    assert rig.source.backlog().rejected == 1


@pytest.mark.parametrize("number", [errno.EMFILE, errno.ENFILE, errno.EIO])
def test_a_file_that_the_system_refuses_for_a_while_is_read_later(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    opened, refused = os.open, [0]

    def refusing(path: str, flags: int, *others: int) -> int:
        if str(path).endswith("a.csv") and rig.clock.now < until:
            refused[0] += 1
            raise OSError(number, os.strerror(number))
        return opened(path, flags, *others)

    monkeypatch.setattr(os, "open", refusing)
    until = rig.clock.now + 300.0
    put(rig, "a.csv", 0)
    put(rig, "b.csv", 1)
    assert verdicts(rig.run(250.0)) == [("b.csv", "accepted")]
    assert refused[0] > 100
    assert verdicts(rig.run(60.0)) == [("a.csv", "accepted")]
    until = rig.clock.now + 700.0
    put(rig, "a.csv", 2)
    assert verdicts(rig.run(590.0)) == []
    assert [verdict for _, verdict in verdicts(rig.run(30.0))] == ["unreadable"]


def test_a_lying_header_waits_as_long_as_what_it_promises_may_come(rig: Rig) -> None:
    rig = Rig(rig.root, channels=rig.spec.channels, format="npy")
    np.save(rig.root / "a.npy", noise(500, 1))
    data = (rig.root / "a.npy").read_bytes()
    (rig.root / "a.npy").write_bytes(data[:1000])
    assert rig.run(300.0) == []
    (rig.root / "a.npy").write_bytes(data)
    assert verdicts(rig.run()) == [("a.npy", "accepted")]
    (rig.root / "b.npy").write_bytes(data[:1000])
    assert rig.run(590.0) == []
    assert verdicts(rig.run(20.0)) == [("b.npy", "incomplete")]


def test_sound_without_a_length_is_read_once_it_is_closed_or_long_unchanged(rig: Rig) -> None:
    channel = ChannelSpec("x", column=1, unit="g", scale=1.0)
    rig = Rig(rig.root, channels=(channel,), format="wav")
    data = open_wav((np.arange(200) * 97 % 211).astype(np.int16), 0xFFFFFFFF)
    (rig.root / "a.wav").write_bytes(data[:300])
    assert rig.run(300.0) == []
    (rig.root / "a.wav").write_bytes(data)
    assert rig.run(590.0) == []
    assert verdicts(rig.run(20.0)) == [("a.wav", "accepted")]
    (rig.root / "b.wav").write_bytes(data[:400])
    rig.watch.closed.add("b.wav")
    assert verdicts(rig.run(5.0)) == [("b.wav", "accepted")]


def test_names_that_are_no_text_are_shown_and_kept(rig: Rig) -> None:
    names = ["new\nline.csv", "<b>html.csv", os.fsdecode(b"\xff\xfe.csv"), "a" * 251 + ".csv", "back\\slash.csv"]
    for seed, name in enumerate(names):
        put(rig, name, seed)
    found = rig.run()
    assert len(found) == 5
    assert all(isinstance(item, Block) and item.name.isprintable() for item in found)
    assert {unshown(item.name) for item in found} == set(names)
    rig.restart()
    assert rig.run(700.0) == []
    assert rig.source.backlog().offered == 5


def test_names_are_written_one_to_one() -> None:
    for name in ["a.csv", "a\nb", "\\u000a", "\udcff", "é\u2028x", "\x85", "\\", "\\x41", "\U0001f600\U000e0001"]:
        assert unshown(shown(name)) == name
        assert shown(name).isprintable()
        assert shown(name).encode()
    assert is_skipped("x.tdms_index")


def test_a_folder_that_vanishes_and_comes_back(rig: Rig) -> None:
    put(rig, "a.csv", 1)
    rig.run()
    starts = len(rig.watch.starts)
    moved = rig.root.with_name(f"{rig.root.name}.away")
    rig.root.rename(moved)
    assert rig.run(100.0) == []
    problem = rig.source.problem()
    assert problem is not None
    assert "cannot be read" in problem
    rig.root.mkdir()
    put(rig, "b.csv", 2)
    assert verdicts(rig.run()) == [("b.csv", "accepted")]
    assert rig.source.problem() is None
    assert len(rig.watch.starts) == starts + 1
    rig.watch.dead = True
    rig.run()
    assert len(rig.watch.starts) == starts + 2


def test_what_was_delivered_but_not_committed_comes_again_with_the_same_number(rig: Rig) -> None:
    for number in range(1, 6):
        put(rig, f"f{number}.csv", number)
    rig.run(5.0, most=2)
    lost = rig.source.next(PATIENCE_S)
    assert lost is not None
    rig.restart()
    found = rig.run(5.0)
    assert [(item.name, item.sequence) for item in found] == [("f3.csv", 3), ("f4.csv", 4), ("f5.csv", 5)]
    assert rig.source.backlog().accepted == 5


def test_numbered_files_keep_their_numbers_and_what_takes_a_number_twice_is_said(tmp_path: Path) -> None:
    rig = Rig(tmp_path, format="pronostia", channels=(), rate=None)

    def write(name: str, seed: int) -> None:
        values = noise(2560, seed)
        lines = (f"9,0,0,{i / 0.0256:.3f},{value:.3f},{value:.3f}\n" for i, value in enumerate(values))
        (tmp_path / name).write_text("".join(lines))

    write("acc_00001.csv", 1)
    write("acc_00003.csv", 3)
    (tmp_path / "readme.txt").write_text("words")
    assert [item.sequence for item in rig.run()] == [1, 3]
    write("acc_00002.csv", 2)
    assert [item.sequence for item in rig.run()] == [2]
    write("acc_00003.csv", 4)
    (item,) = rig.run()
    assert isinstance(item, Rejected)
    assert (item.sequence, item.status) == (3, "changed")
    (tmp_path / "sub").mkdir()
    write("sub/acc_00001.csv", 1)
    (item,) = rig.run()
    assert isinstance(item, Rejected)
    assert (item.sequence, item.status) == (1, "duplicate")
    backlog = rig.source.backlog()
    assert (backlog.offered, backlog.accepted, backlog.rejected, backlog.ignored) == (6, 3, 2, 1)


def test_the_kind_of_files_is_found_out_when_the_first_one_comes(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    (tmp_path / "notes.xyz").write_bytes(b"\x01\x02")
    assert rig.run(30.0) == []
    assert rig.source.problem() is not None
    assert rig.source.backlog().pending == 1
    put(rig, "a.csv", 1)
    assert verdicts(rig.run()) == [("a.csv", "accepted")]
    assert rig.source.problem() is None
    assert rig.source.backlog().pending == 0


def test_a_crowd_that_is_copied_in_any_order_comes_in_order(rig: Rig) -> None:
    for index, number in enumerate(np.random.default_rng(5).permutation(60)):
        name = f"f{number + 1}.csv"
        put(rig, name, int(number))
        rig.watch.closed.add(name)
        if index % 3 == 2:
            rig.run(0.3)
    rig.run()
    assert [item.name for item in rig.items] == [f"f{number}.csv" for number in range(1, 61)]


def test_a_folder_with_very_many_files_is_scanned_in_short_turns_and_then_delivered_in_order(tmp_path: Path) -> None:
    class Busy(SetClock):
        patience_s = 0.02

        def monotonic(self) -> float:
            self.now += 0.001
            return self.now

    rig = Rig(tmp_path)
    for number in range(1, 301):
        put(rig, f"f{number}.csv", number, count=20)
    rig.clock = Busy()
    rig.restart()
    pending = [rig.source.backlog().pending]
    while pending[-1] < 300:
        assert rig.source.next(0.0) is None
        assert rig.source.queued_blocks() >= pending[-1]
        pending.append(rig.source.backlog().pending)
        rig.check()
    assert max(np.diff(pending)) <= 25
    rig.clock.now += 10.0
    while not rig.run(1.0, most=1):
        pass
    assert [item.name for item in rig.items] == ["f1.csv"]


def test_a_store_that_delays_one_scan_does_not_delay_the_next_ones(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    put(rig, "f1.csv", 1)
    rig.run()
    released = rig.ledger.released

    def slowly(source: str) -> Any:
        rig.clock.now += 2.0
        monkeypatch.undo()
        return released(source)

    monkeypatch.setattr(rig.ledger, "released", slowly)
    rig.run(3.0)
    # Moved in: no event names it.
    put(rig, "f2.csv", 2)
    rig.run(2.5 * rig.spec.settle_s)
    assert [item.name for item in rig.items] == ["f1.csv", "f2.csv"]


def test_files_that_come_in_order_are_not_held_back_after_a_pause_of_the_reader(rig: Rig) -> None:
    pending = []
    for number in range(1, 121):
        put(rig, f"f{number}.csv", number)
        rig.watch.closed.add(f"f{number}.csv")
        if 60 <= number < 80:
            # The process is busy with another source.
            rig.clock.now += 0.5
            continue
        rig.run(0.5)
        pending.append(rig.source.backlog().pending)
    assert max(pending[45:]) <= 1
    assert [item.name for item in rig.items] == [f"f{number}.csv" for number in range(1, 121)]


def test_a_folder_that_is_copied_backwards_while_a_logger_writes_comes_in_order(rig: Rig) -> None:
    for number in range(100, 160):
        put(rig, f"f{number}.csv", number)
        rig.watch.closed.add(f"f{number}.csv")
        rig.run(0.5)
    first = len(rig.items)
    for number in range(159, 100, -2):
        put(rig, f"e{number}.csv", number)
        put(rig, f"e{number - 1}.csv", number - 1)
        rig.run(0.5)
    rig.run(30.0)
    assert [item.name for item in rig.items[first:]] == [f"e{number}.csv" for number in range(100, 160)]


def test_a_file_in_the_place_of_the_folder_is_a_configuration_error(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(b"1\n")
    source = FolderSource(SourceSpec(name="s", url="folder:x"), str(tmp_path / "a.csv"))
    with pytest.raises(SourceError, match="expected a folder"):
        source.open(Rig(tmp_path).ledger)
