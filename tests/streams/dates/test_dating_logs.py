"""The count of blocks of logs that grow while they are read."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.streams.dated import START, live, replayed, rows, starts, write
from tests.streams.folders import Rig, csv_bytes, noise


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
