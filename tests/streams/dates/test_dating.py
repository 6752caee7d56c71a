"""What dates the blocks of files, live and replayed: a header, a name, a count, the time of the last change."""

from __future__ import annotations

import os
import shutil
import tarfile
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from streams.open import open_source
from streams.types.block import Block, Rejected
from streams.types.spec import SourceError, SourceSpec
from streams.types.stamps import utc_text
from tests.streams.dated import START, elapsed, live, replayed, rows, spec_of, starts, write
from tests.streams.folders import CHANNELS, RATE, Rig
from tests.support.effort import effort_count

COUNT = effort_count(quick=24, full=10_000)
FORMATS = ("npy", "wav", "csv")


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
