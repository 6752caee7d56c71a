"""Day and month in either order: what decides it, and what waits until it is decided."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from streams.open import open_source
from streams.types.spec import SourceError
from streams.types.stamps import utc_text
from tests.streams.dated import live, replayed, rows, spec_of, write
from tests.streams.folders import verdicts


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


def test_a_removed_file_decides_nothing_more(tmp_path: Path) -> None:
    for seed, text in enumerate(("13-04-2024", "04-13-2024", "03-04-2024")):
        write(tmp_path, f"{text}_10-00-00.npy", seed)
    rig = live(tmp_path)
    assert rig.run(60.0) == []
    assert "disagree" in (rig.source.problem() or "")
    (tmp_path / "04-13-2024_10-00-00.npy").unlink()
    rig.run(1500.0)
    assert [utc_text(row[2])[:10] for row in rows(rig.items) if row[2] is not None] == ["2024-04-03", "2024-04-13"]
