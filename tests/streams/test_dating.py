"""What dates the blocks of files, live and replayed: a header, a name, a count, the time of the last change."""

from __future__ import annotations

import os
import shutil
import tarfile
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile

from streams.block import Block, Rejected
from streams.open import open_source
from streams.spec import SourceError, SourceSpec
from streams.stamps import utc_text
from tests.effort import effort_count
from tests.streams.folders import CHANNELS, RATE, Rig, csv_bytes, noise, verdicts

START = datetime(2024, 1, 31, 23, 0, 0, tzinfo=UTC).timestamp()
COUNT = effort_count(quick=24, full=10_000)
FORMATS = ("npy", "wav", "csv")
Row = tuple[str, str, float | None, float | None, str]


def write(folder: Path, name: str, seed: int, count: int = 100, head: str = "") -> Path:
    """Write a file of some samples in the format of its ending."""
    path = folder / name
    path.parent.mkdir(exist_ok=True)
    samples = noise(count, seed)
    if name.endswith(".npy"):
        np.save(path, samples)
    elif name.endswith(".wav"):
        soundfile.write(path, samples.astype(np.float32), int(RATE), subtype="FLOAT")
    else:
        path.write_bytes(head.encode() + csv_bytes(samples))
    return path


def spec_of(folder: Path, **settings: Any) -> SourceSpec:
    base: dict[str, Any] = {"rate": RATE, "channels": CHANNELS, "block_s": "file"}
    return SourceSpec("s", f"folder:{folder}", **base | settings)


def rows(items: Iterable[Block | Rejected], *, order: bool = False) -> list[Row]:
    """Return name, verdict, start, elapsed time and content of items, sorted by name unless ``order``."""
    found = [
        (item.name, "ok", item.start, item.elapsed, item.content_hash)
        if isinstance(item, Block)
        else (item.name, item.status, None, None, item.content_hash)
        for item in items
    ]
    return found if order else sorted(found, key=lambda row: row[0])


def replayed(folder: Path, **settings: Any) -> list[Row]:
    return rows(open_source(spec_of(folder, **settings)))


def starts(found: Iterable[Row]) -> dict[str, float | None]:
    return {name: None if start is None else start - START for name, _, start, _, _ in found}


def elapsed(found: Iterable[Row]) -> dict[str, float | None]:
    return {name: seconds for name, _, _, seconds, _ in found}


def live(folder: Path, **settings: Any) -> Rig:
    return Rig(folder, **settings)


@pytest.mark.parametrize("ending", FORMATS)
@pytest.mark.parametrize("block_s", ["file", 0.1, 0.05])
def test_undated_files_count_from_start_utc(tmp_path: Path, ending: str, block_s: Any) -> None:
    for number in range(1, 13):
        write(tmp_path, f"rec_{number}.{ending}", number)
    rig = live(tmp_path, start=START, block_s=block_s)
    rig.run(60.0)
    found = rows(rig.items)
    assert found == replayed(tmp_path, start=START, block_s=block_s)
    expected = {f"rec_{number}.{ending}": 0.1 * (number - 1) for number in range(1, 13)}
    if block_s == 0.05:
        expected |= {f"{name}[0.05 s]": time + 0.05 for name, time in expected.items()}
    assert starts(found) == pytest.approx(expected, abs=1e-6)
    assert elapsed(found) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("ending", FORMATS)
def test_without_start_utc_seconds_count_from_the_first_block(tmp_path: Path, ending: str) -> None:
    for number in range(3):
        write(tmp_path, f"rec_{number:03d}.{ending}", number)
    rig = live(tmp_path, interval=60.0)
    rig.run(60.0)
    found = rows(rig.items)
    assert found == replayed(tmp_path, interval=60.0)
    assert set(starts(found).values()) == {None}
    assert list(elapsed(found).values()) == [0.0, 60.0, 120.0]


def test_files_without_numbers_count_by_their_blocks(tmp_path: Path) -> None:
    for number, letter in enumerate("abcd"):
        write(tmp_path, f"{letter}.npy", number)
    rig = live(tmp_path, start=START, interval=10.0)
    rig.run(60.0)
    assert rows(rig.items) == replayed(tmp_path, start=START, interval=10.0)
    assert list(starts(rows(rig.items)).values()) == [0.0, 10.0, 20.0, 30.0]
    rig.restart()
    write(tmp_path, "e.npy", 5)
    (item,) = rows(rig.run(20.0))
    assert (item[2], item[3]) == (START + 40.0, 40.0)


@pytest.mark.parametrize("block_s", ["file", 0.1])
@pytest.mark.parametrize("ending", FORMATS)
def test_missing_rejected_and_late_files_keep_their_places(tmp_path: Path, ending: str, block_s: Any) -> None:
    settings = {"start": START, "interval": 10.0, "block_s": block_s}
    rig = live(tmp_path, **settings)
    for number in (1, 2, 5, 6):
        write(tmp_path, f"rec_{number}.{ending}", number)
    (tmp_path / f"rec_4.{ending}").write_bytes(b"\x7fELF\x00\x01" * 50)
    rig.run(700.0)
    write(tmp_path, f"rec_3.{ending}", 3)
    rig.run(60.0)
    rig.restart()
    write(tmp_path, f"rec_8.{ending}", 8)
    rig.run(60.0)
    found = rows(rig.items)
    assert {name: status for name, status, *_ in found if status != "ok"} == {f"rec_4.{ending}": "unreadable"}
    assert found == replayed(tmp_path, **settings)
    places = {name: time for name, time in starts(found).items() if time is not None}
    assert places == {f"rec_{number}.{ending}": 10.0 * (number - 1) for number in (1, 2, 3, 5, 6, 8)}


def test_the_first_file_may_be_missing_late_or_one_of_many(tmp_path: Path) -> None:
    for name, numbers, first in (("a", (2, 3), 1), ("b", (0, 2), 0), ("c", (48211, 48213), 48211)):
        folder = tmp_path / name
        for number in numbers:
            write(folder, f"rec_{number:05d}.npy", number)
        rig = live(folder, start=START, interval=10.0)
        rig.run(60.0)
        assert rows(rig.items) == replayed(folder, start=START, interval=10.0)
        assert list(starts(rows(rig.items)).values()) == [10.0 * (number - first) for number in numbers]
        if name == "a":
            write(folder, "rec_00001.npy", 1)
            rig.run(60.0)
            assert rows(rig.items) == replayed(folder, start=START, interval=10.0)


def test_a_copy_has_another_mtime_and_the_same_dates(tmp_path: Path) -> None:
    original, copy = tmp_path / "a", tmp_path / "b"
    for number in range(1, 5):
        os.utime(write(original, f"20240131_23000{number}.npy", number), (START, START + number))
        os.utime(write(original, f"x/rec_{number}.npy", number + 9), (START, START + number))
    shutil.copytree(original, copy)
    for path in copy.rglob("*.npy"):
        os.utime(path, (START, START + 1e6))
    for folder, settings in (("", {}), ("x", {"start": START})):
        assert replayed(original / folder, **settings) == replayed(copy / folder, **settings)
    asked = [starts(replayed(folder / "x", time_from="mtime")) for folder in (original, copy)]
    assert asked[0] == pytest.approx({f"rec_{number}.npy": number - 0.1 for number in range(1, 5)}, abs=1e-6)
    assert asked[1] == pytest.approx({f"rec_{number}.npy": 1e6 - 0.1 for number in range(1, 5)}, abs=1e-6)


def stamped(order: str, day: int, month: int) -> str:
    text = f"{day:02d}/{month:02d}" if order == "day_first" else f"{month:02d}/{day:02d}"
    return f"Date,{text}/2024\nTime,10:00:00\n"


@pytest.mark.parametrize("order", ["day_first", "month_first"])
def test_the_order_of_day_and_month_is_decided_by_a_later_file(tmp_path: Path, order: str) -> None:
    rig = live(tmp_path)
    days = [(4, 3), (5, 3), (13, 3), (4, 4)]
    for number, (day, month) in enumerate(days[:2], 1):
        write(tmp_path, f"rec_{number}.csv", number, head=stamped(order, day, month))
    assert rig.run(60.0) == []
    backlog = rig.source.backlog()
    assert (backlog.pending, backlog.rejected) == (2, 0)
    problem = rig.source.problem()
    assert problem is not None
    assert "day first" in problem
    assert "month first" in problem
    assert "date_order" in problem
    with pytest.raises(SourceError, match=r"day first.*month first.*date_order = day_first or month_first"):
        replayed(tmp_path)
    asked = replayed(tmp_path, date_order=order)
    for number, (day, month) in enumerate(days[2:], 3):
        write(tmp_path, f"rec_{number}.csv", number, head=stamped(order, day, month))
    rig.run(60.0)
    expected = [datetime(2024, month, day, 10, tzinfo=UTC).timestamp() for day, month in days]
    assert [row[2] for row in rows(rig.items, order=True)] == expected
    assert [row[2] for row in asked] == expected[:2]
    assert rows(rig.items) == replayed(tmp_path)
    assert rig.source.problem() is None
    rig.restart()
    write(tmp_path, "rec_5.csv", 5, head=stamped(order, 5, 4))
    assert [utc_text(row[2] or 0.0) for row in rows(rig.run(60.0))] == ["2024-04-05T10:00:00Z"]


@pytest.mark.parametrize("block_s", ["file", 0.1])
def test_many_files_without_an_order_hold_up_no_other_source(tmp_path: Path, block_s: Any) -> None:
    rig = live(tmp_path, block_s=block_s)
    for number in range(1, 13):
        write(tmp_path, f"rec_{number}.csv", number, head=stamped("day_first", number, 12 - number + 1))
    assert rig.run(20.0) == []
    for number in range(13, 25):
        write(tmp_path, f"rec_{number}.csv", number, head=stamped("day_first", 1, number % 12 + 1))
    rig.clock.now += 20.0
    before = len(vars(rig.source)["_intake"].undated)
    assert rig.source.next(0.0) is None
    assert len(vars(rig.source)["_intake"].undated) <= before + 1
    write(tmp_path, "rec_25.csv", 25, head=stamped("day_first", 25, 12))
    found = [row[0] for row in rows(rig.run(90.0), order=True)]
    expected = [f"rec_{number}.csv" for number in range(1, 26)]
    # Files that are cut are sorted by their headers, a few at a time.
    assert (found if block_s == "file" else sorted(found)) == (expected if block_s == "file" else sorted(expected))


def test_the_same_day_and_month_waits_for_no_file(tmp_path: Path) -> None:
    write(tmp_path, "rec_1.csv", 1, head=stamped("day_first", 3, 3))
    rig = live(tmp_path)
    rig.run(60.0)
    assert [utc_text(row[2] or 0.0) for row in rows(rig.items)] == ["2024-03-03T10:00:00Z"]


def test_files_that_disagree_wait(tmp_path: Path) -> None:
    rig = live(tmp_path)
    write(tmp_path, "rec_1.csv", 1, head=stamped("day_first", 13, 3))
    rig.run(60.0)
    write(tmp_path, "rec_2.csv", 2, head=stamped("month_first", 14, 3))
    assert rig.run(60.0) == []
    write(tmp_path, "rec_3.csv", 3, head=stamped("month_first", 4, 3))
    write(tmp_path, "rec_4.csv", 4, head="Date,2024-03-15\nTime,10:00:00\n")
    assert verdicts(rig.run(60.0)) == [("rec_4.csv", "accepted")]
    problem = rig.source.problem() or ""
    assert "rec_2.csv" in problem
    assert "spallwatch redate s" in problem
    assert rig.source.backlog().pending == 2
    with pytest.raises(SourceError, match=r"rec_2.csv.*cannot be day first, as rec_1.csv"):
        replayed(tmp_path)
    rig.restart()
    assert rig.run(60.0) == []
    (tmp_path / "rec_2.csv").unlink()
    assert verdicts(rig.run(1500.0)) == [("rec_2.csv", "unreadable"), ("rec_3.csv", "accepted")]
    assert rig.source.problem() is None


def test_names_of_files_decide_the_order_before_they_are_read(tmp_path: Path) -> None:
    for number, day in enumerate((3, 13, 4), 1):
        write(tmp_path, f"04-{day:02d}-2024_10-00-00.npy", number)
    rig = live(tmp_path)
    rig.run(60.0)
    assert [utc_text(row[2] or 0.0)[:10] for row in rows(rig.items, order=True)] == [
        *("2024-04-03", "2024-04-04", "2024-04-13"),
    ]
    assert rows(rig.items, order=True) == rows(open_source(spec_of(tmp_path)), order=True)


def test_names_that_leave_the_order_open_wait_and_a_replay_refuses(tmp_path: Path) -> None:
    for day in (3, 5):
        write(tmp_path, f"04-{day:02d}-2024_10-00-00.npy", day)
    rig = live(tmp_path)
    assert rig.run(60.0) == []
    assert "time_name" in (rig.source.problem() or "")
    with pytest.raises(SourceError, match="time_name"):
        replayed(tmp_path)
    found = replayed(tmp_path, time_name="%d-%m-%Y_%H-%M-%S")
    assert [utc_text(row[2] or 0.0)[:10] for row in found] == ["2024-03-04", "2024-05-04"]


def test_a_kept_choice_survives_a_restart_and_refuses_a_configuration_that_contradicts_it(tmp_path: Path) -> None:
    write(tmp_path, "rec_20240131_230000.npy", 1)
    rig = live(tmp_path)
    rig.run(60.0)
    assert rig.ledger.dating("s") is not None
    rig.restart()
    write(tmp_path, "rec_20240131_230010.npy", 2)
    assert starts(rows(rig.run(60.0))) == {"rec_20240131_230010.npy": 10.0}
    for settings, words in (
        ({"time_from": "header"}, "time_from is header, but its blocks are dated by the name"),
        ({"time_from": "count", "start": START}, "time_from is count"),
        ({"time_name": "%Y%m%d_%H%M%S"}, "time_name is %Y%m%d_%H%M%S"),
    ):
        with pytest.raises(SourceError, match=rf"{words}.*spallwatch redate s"):
            Rig(tmp_path, rig.ledger, **settings)
    counted = live(write(tmp_path / "b", "rec_1.npy", 3).parent, start=START, interval=5.0)
    counted.run(60.0)
    for settings in ({"start": START + 1.0, "interval": 5.0}, {"interval": 5.0}, {"start": START}):
        with pytest.raises(SourceError, match=r"(start_utc|interval_s) is .*spallwatch redate s"):
            Rig(counted.root, counted.ledger, **settings)


def test_blocks_of_an_earlier_version_stay_without_dates_until_a_command(tmp_path: Path) -> None:
    rig = live(tmp_path)
    write(tmp_path, "rec_1.npy", 1)
    rig.run(60.0)
    vars(rig.ledger)["_datings"].clear()
    rig.restart()
    write(tmp_path, "rec_2.npy", 2)
    (item,) = rig.run(60.0)
    assert isinstance(item, Block)
    assert (item.start, item.elapsed) == (None, None)
    with pytest.raises(SourceError, match="spallwatch redate s"):
        Rig(tmp_path, rig.ledger, time_from="name")


def test_lengths_give_the_interval_and_a_longer_file_has_no_date(tmp_path: Path) -> None:
    for number, count in enumerate((100, 105, 90, 200, 100), 1):
        write(tmp_path, f"rec_{number}.npy", number, count)
    rig = live(tmp_path, start=START)
    rig.run(60.0)
    found = rows(rig.items)
    assert found == replayed(tmp_path, start=START)
    expected = [0.0, 0.1, 0.2, None, 0.4]
    assert [None if time is None else round(time, 6) for time in starts(found).values()] == expected


def test_a_date_in_a_single_header_is_used_where_nothing_else_dates(tmp_path: Path) -> None:
    for number, head in ((1, ""), (2, "Start: 2024-02-01T10:00:00Z\n"), (3, "")):
        write(tmp_path, f"rec_{number}.csv", number, head=head)
    rig = live(tmp_path, interval=10.0)
    rig.run(60.0)
    assert [row[2] is not None for row in rows(rig.items)] == [False, True, False]
    assert rows(rig.items) == replayed(tmp_path, interval=10.0)
    counted = live(tmp_path, start=START, interval=10.0)
    counted.run(60.0)
    assert list(starts(rows(counted.items)).values()) == [0.0, 10.0, 20.0]
    source = open_source(spec_of(tmp_path, start=START, interval=10.0))
    assert len(list(source)) == 3
    assert "rec_2.csv states 2024-02-01T10:00:00Z" in " ".join(vars(source)["_dater"].remarks.values())


def test_an_archive_is_dated_like_its_folder(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    for number in (1, 2, 4):
        write(folder, f"rec_{number}.npy", number)
    with tarfile.open(tmp_path / "run.tar", "w") as archive:
        for number in (1, 2, 4):
            archive.add(folder / f"rec_{number}.npy", f"rec_{number}.npy")
    choices: list[dict[str, Any]] = [{"start": START}, {"start": START, "interval": 60.0}, {"time_from": "mtime"}]
    for settings in choices:
        packed = SourceSpec("s", str(tmp_path / "run.tar"), rate=RATE, channels=CHANNELS, block_s="file", **settings)
        found, expected = rows(open_source(packed)), replayed(folder, **settings)
        if "time_from" in settings:
            # A tar archive keeps whole seconds.
            assert [round((row[2] or 0.0) - (other[2] or 0.0)) for row, other in zip(found, expected, strict=True)] in (
                [0, 0, 0],
                [-1, -1, -1],
            )
        else:
            assert found == expected


def test_an_archive_that_breaks_off_at_its_first_file_is_said(tmp_path: Path) -> None:
    with tarfile.open(tmp_path / "run.tar", "w") as archive:
        archive.add(write(tmp_path, "rec_1.npy", 1, 4000), "rec_1.npy")
    path = tmp_path / "run.tar"
    path.write_bytes(path.read_bytes()[:2000])
    (item,) = open_source(SourceSpec("s", str(path), rate=RATE, channels=CHANNELS, block_s="file", start=START))
    assert isinstance(item, Rejected)
    assert item.status == "incomplete"


def test_data_sets_keep_their_own_dates_and_say_which_keys_they_do_not_use(tmp_path: Path) -> None:
    (tmp_path / "2004.02.12.10.32.39").write_text("\n".join("0.1\t0.2\t0.3\t0.4" for _ in range(20480)) + "\n")
    ims = open_source(SourceSpec("s", f"dataset:ims:{tmp_path}", start=START))
    (block,) = list(ims)
    assert isinstance(block, Block)
    assert utc_text(block.start or 0.0) == "2004-02-12T10:32:39Z"
    assert "start_utc not used: files of ims state their time" in vars(ims)["_dater"].remarks["own"]
    (tmp_path / "b").mkdir()
    for number in (1, 3):
        text = "\n".join(f"1,2,3,4,{i % 7},{i % (4 + number)}" for i in range(2560))
        (tmp_path / "b" / f"acc_{number:05d}.csv").write_text(text + "\n")
    pronostia = open_source(SourceSpec("s", f"dataset:pronostia:{tmp_path / 'b'}", start=START, time_from="mtime"))
    assert [item.start for item in pronostia if isinstance(item, Block)] == [START, START + 20.0]
    assert "time_from not used" in vars(pronostia)["_dater"].remarks["own"]


def test_names_that_are_no_text_are_dated_and_said(tmp_path: Path) -> None:
    name = os.fsdecode(b"Pr\xfcfstand_04-03-2024_10-00-00.npy")
    write(tmp_path, name, 1)
    rig = live(tmp_path)
    assert rig.run(30.0) == []
    assert (rig.source.problem() or "").encode().startswith(b"Pr\\xfcfstand_04-03-2024")
    write(tmp_path, "a_04-13-2024_10-00-00.npy", 2)
    assert [utc_text(row[2] or 0.0)[:10] for row in rows(rig.run(60.0), order=True)] == ["2024-04-03", "2024-04-13"]


def test_a_removed_file_decides_nothing_more(tmp_path: Path) -> None:
    for seed, text in enumerate(("13-04-2024", "04-13-2024", "03-04-2024")):
        write(tmp_path, f"{text}_10-00-00.npy", seed)
    rig = live(tmp_path)
    assert rig.run(60.0) == []
    assert "disagree" in (rig.source.problem() or "")
    (tmp_path / "04-13-2024_10-00-00.npy").unlink()
    rig.run(1500.0)
    assert [utc_text(row[2])[:10] for row in rows(rig.items) if row[2] is not None] == ["2024-04-03", "2024-04-13"]


def test_dates_do_not_move_numbers_or_contents(tmp_path: Path) -> None:
    for number in range(1, 5):
        write(tmp_path, f"2024-01-31_23-00-0{number}.csv", number, 1000)
    undated = tmp_path / "b"
    for number in range(1, 5):
        write(undated, f"{'abcd'[number - 1]}.csv", number, 1000)
    dated = [item for item in open_source(spec_of(tmp_path, block_s=0.3)) if "b/" not in item.name]
    shutil.rmtree(undated)
    assert [(item.sequence, item.content_hash) for item in open_source(spec_of(tmp_path, block_s=0.3))] == [
        (item.sequence, item.content_hash) for item in dated
    ]
    assert len({item.content_hash for item in dated}) == len(dated) == 16


def test_a_growing_log_counts_its_blocks(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    data = csv_bytes(noise(1000, 1))
    lines = data.splitlines(keepends=True)
    rig = live(tmp_path, start=START, block_s=0.1)
    for end in range(250, 1001, 250):
        path.write_bytes(b"".join(lines[:end]))
        rig.run(20.0)
    assert rows(rig.items) == replayed(tmp_path, start=START, block_s=0.1)
    assert list(starts(rows(rig.items, order=True)).values()) == pytest.approx([0.1 * i for i in range(10)])


def grown(tmp_path: Path, *steps: tuple[int, float], count: int = 1000) -> Rig:
    """Return a source beside the third of its logs, which grew to so many lines, followed by so many seconds each."""
    lines = csv_bytes(noise(count, 1)).splitlines(keepends=True)
    rig = live(tmp_path, start=START, block_s=0.1)
    for end, seconds in steps:
        (tmp_path / "rec_0003.csv").write_bytes(b"".join(lines[:end]))
        rig.run(seconds)
    return rig


def test_a_growing_log_that_is_not_the_first_waits_for_its_end_alone(tmp_path: Path) -> None:
    rig = grown(tmp_path, (250, 5.0), (500, 5.0), (1000, 15.0))
    assert rig.items == []
    assert rig.source.problem() == "rec_0003.csv: waits for its end: its length is the time between files"
    rig.run(10.0)
    assert rows(rig.items) == replayed(tmp_path, start=START, block_s=0.1)
    write(tmp_path, "rec_0004.csv", 2, 1000)
    rig.run(10.0)
    assert rows(rig.items) == replayed(tmp_path, start=START, block_s=0.1)
    assert list(starts(rows(rig.items, order=True)).values()) == pytest.approx([2 + 0.1 * i for i in range(20)])


def test_the_next_log_ends_a_growing_one_before_its_own_blocks(tmp_path: Path) -> None:
    rig = grown(tmp_path, (250, 5.0), (1000, 10.0))
    write(tmp_path, "rec_0004.csv", 2, 1000)
    rig.run(10.0)
    assert [row[0][:8] for row in rows(rig.items, order=True)] == 10 * ["rec_0003"] + 10 * ["rec_0004"]
    assert list(starts(rows(rig.items, order=True)).values()) == pytest.approx([2 + 0.1 * i for i in range(20)])


def test_a_log_that_grows_after_its_seeming_end_dates_the_later_ones(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    rig = grown(tmp_path, (250, 50.0), (1000, 50.0))
    write(tmp_path, "rec_0004.csv", 2, 1000)
    rig.run(10.0)
    found = list(starts(rows(rig.items, order=True)).values())
    assert found == pytest.approx([0.5, 0.6, 0.7, *(2 + 0.1 * i for i in range(3, 20))])
    assert "had 0.25 s when its end seemed to be seen, and now has 1 s: its first blocks are dated too early" in (
        caplog.text
    )


def test_keys_that_contradict_each_other_are_refused(tmp_path: Path) -> None:
    for settings in (
        {"time_from": "count"},
        {"time_from": "header", "time_name": "%Y%m%d"},
        {"time_from": "name", "interval": 5.0},
        {"time_from": "mtime", "date_order": "day_first"},
        {"time_name": "%H%M"},
        {"interval": -1.0},
    ):
        with pytest.raises(SourceError, match=r"\[\[source\]\] s: (time_from|time_name|interval_s|date_order)"):
            spec_of(tmp_path, **settings)


@pytest.mark.timeout(effort_count(quick=60, full=1800))
@pytest.mark.parametrize("by", ["header", "name", "count", "mtime"])
def test_many_files_are_dated_the_same_live_and_replayed(tmp_path: Path, by: str) -> None:
    settings: dict[str, Any] = {"time_from": by} | ({"start": START, "interval": 10.0} if by == "count" else {})
    moments = [datetime.fromtimestamp(START, UTC) + timedelta(seconds=10 * number) for number in range(COUNT)]
    missing, rejected, late = COUNT // 4, COUNT // 3, COUNT // 2
    held: list[tuple[Path, Path]] = []
    for number, moment in enumerate(moments):
        name = (
            f"{moment:%m-%d-%Y_%H-%M-%S}.npy" if by == "name" else f"rec_{number}.{'csv' if by == 'header' else 'npy'}"
        )
        head = f"Date,{moment:%m/%d/%Y}\nTime,{moment:%H:%M:%S}\n"
        path = write(tmp_path, name, number, 8, head if by == "header" else "")
        os.utime(path, (START, moment.timestamp() + 8 / RATE))
        if number == missing:
            path.unlink()
        if number == rejected:
            path.write_bytes(b"\x7fELF\x00\x01" * 50)
        if number == late:
            held.append((path, path.rename(tmp_path / f".{name}")))
    rig = live(tmp_path, **settings)
    rig.run(150.0)
    for path, hidden in held:
        hidden.rename(path)
    rig.run(150.0)
    found = rows(rig.items)
    assert len(found) == COUNT - 1
    assert [status for _, status, *_ in found if status != "ok"] == ["unreadable"]
    assert found == replayed(tmp_path, **settings)
    expected = {moment.timestamp() for number, moment in enumerate(moments) if number not in (missing, rejected)}
    assert {round(row[2], 3) for row in found if row[2] is not None} == expected
