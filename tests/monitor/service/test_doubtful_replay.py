"""Folders whose clock cannot be right: order, times, flags and words of a replay, and of the live folder."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from monitor.config.load import load_config
from monitor.health.record import Record
from monitor.health.signal.quality import OrderState, check_order
from monitor.records.store import Store
from monitor.service.replay import replay
from streams.dates.observed import TimeObservation
from streams.types.block import Block
from streams.types.stamps import utc_text
from tests.streams.folders import Rig

RATE, COUNT = 2048, 1024
CONFIG = """
[machine]
name = "m"
timezone = "{zone}"
[[bearing]]
name = "b"
designation = "6205"
[operating]
speed_hz = 29.5
[[source]]
name = "s"
url = "folder:data"
block_s = "file"
rate_hz = 2048
[[channel]]
name = "x"
source = "s"
bearing = "b"
column = 1
unit = "m/s2"
band_hz = [[200, 900]]
"""


@dataclass(frozen=True)
class Files:
    """Files of one folder, in the order in which they were written, and what is expected of them in that order.

    Attributes:
        names: paths below the folder.
        times: of the blocks, ISO 8601 UTC; None where nothing tells it.
        doubted: places of the blocks with the flag ``clock``.
        starts: stated in headers, where there are such.
        changed: last changes, ISO 8601 UTC.
        live: times and doubts of the folder that is watched, where it knows less.
    """

    names: Sequence[str]
    times: Sequence[str | None]
    doubted: set[int] = field(default_factory=set[int])
    starts: Sequence[str] = ()
    zone: str = "UTC"
    changed: Sequence[str] = ()
    sources: set[str] = field(default_factory=set[str])
    live: tuple[Sequence[str | None], set[int]] | None = None


def numbered(count: int, ending: str = ".csv") -> list[str]:
    return [f"{k:03d}{ending}" for k in range(count)]


def moved(time: str, seconds: float) -> str:
    return utc_text(datetime.fromisoformat(time).timestamp() + seconds)


def clock(date: str, *times: str) -> list[str]:
    return [f"{date}T{time}:00Z" for time in times]


P22 = [
    "00_20260328_120000.csv",
    "01_20260328_121000.csv",
    "02_20060101_000012.csv",
    "03_20060101_001012.csv",
    "04_20260328_124000.csv",
]
TENS = clock("2026-03-28", "12:00", "12:10", "12:20", "12:30", "12:40")
AUTUMN = ["01:40", "01:50", "02:00", "02:10", "02:20", "02:30", "02:40", "02:50"]
AUTUMN += ["02:00", "02:10", "02:20", "02:30", "02:40", "02:50", "03:00", "03:10"]
AUTUMN_UTC = [
    *clock("2026-10-24", "23:40", "23:50"),
    *clock("2026-10-25", *(f"{hour:02d}:{minute:02d}" for hour in (0, 1) for minute in range(0, 60, 10))),
    *clock("2026-10-25", "02:00", "02:10"),
]
CASES = {
    "two files of 2006 by a number": Files(P22, TENS, {2, 3}, sources={"name_local", "between"}),
    "two files of 2006 by their last changes": Files(
        [name[3:] for name in P22], TENS, {2, 3}, changed=TENS, sources={"name_local", "between"}
    ),
    "two files of 2006 and nothing that tells their place": Files(
        [P22[k][3:] for k in (0, 1, 4, 2, 3)], [TENS[0], TENS[1], TENS[4], None, None], {3, 4}
    ),
    "headers of 1970": Files(
        numbered(5),
        TENS,
        {2, 3},
        ["2026-03-28T12:00:00Z", "2026-03-28T12:10:00Z", "1970-01-01T00:00:09Z", "1970-01-01T00:10:09Z", TENS[4]],
        sources={"header", "between"},
    ),
    "headers behind by 1024 weeks": Files(
        numbered(5), TENS, {2, 3, 4}, [*TENS[:2], *(moved(time, -619315200.0) for time in TENS[2:])],
        sources={"header", "rollover"},
    ),
    "headers of 2006 beside names of 2026": Files(
        [f"{k}_20260328_12{k}000.csv" for k in range(5)], TENS, {2},
        [*TENS[:2], "2006-01-01T00:00:12Z", *TENS[3:]],
        sources={"header", "name"},
    ),
    "a date in folders": Files(
        ["2024/11/04/081500_ch1.csv", "2024/11/04/082500_ch1.csv", "2024/11/05/001500_ch1.csv"],
        ["2024-11-04T08:15:00Z", "2024-11-04T08:25:00Z", "2024-11-05T00:15:00Z"],
        sources={"name_local"},
    ),
    "a date in one folder": Files(
        ["2024-11-04/08.15.00.csv", "2024-11-04/08.25.00.csv"],
        ["2024-11-04T08:15:00Z", "2024-11-04T08:25:00Z"],
    ),
    "autumn by a number": Files(
        [f"{k:02d}_20261025_{time.replace(':', '')}00.csv" for k, time in enumerate(AUTUMN)],
        AUTUMN_UTC, zone="Europe/Rome", sources={"name_local"},
    ),
    "autumn by headers": Files(
        numbered(16), AUTUMN_UTC, set(), [f"2026-10-25 {time}:00" for time in AUTUMN], "Europe/Rome",
        sources={"header_local"},
    ),
    "autumn by headers of a day first": Files(
        numbered(16), AUTUMN_UTC, set(), [f"25/10/2026 {time}:00" for time in AUTUMN], "Europe/Rome",
    ),
    "autumn by last changes": Files(
        [f"20261025_{time.replace(':', '')}{20 * (7 < k < 14):02d}.csv" for k, time in enumerate(AUTUMN)],
        [time.replace(":00Z", f":{20 * (7 < k < 14):02d}Z") for k, time in enumerate(AUTUMN_UTC)],
        zone="Europe/Rome", changed=AUTUMN_UTC,
    ),
    "autumn by names alone": Files(
        [f"20261025_{time}00.csv" for time in ("0140", "0150", "0200", "0210", "0300")],
        [*AUTUMN_UTC[:4], "2026-10-25T02:00:00Z"],
        {2, 3},
        zone="Europe/Rome",
    ),
    "autumn with an offset": Files(
        numbered(4), clock("2026-10-25", "00:10", "00:50", "01:10", "01:50"), set(),
        [f"2026-10-25T02:{time}" for time in ("10:00+02:00", "50:00+02:00", "10:00+01:00", "50:00+01:00")],
        "Europe/Rome", sources={"header"},
    ),
    "the hour left out in spring": Files(
        numbered(3), [*clock("2026-03-29", "00:30", "00:50", "01:30")], {2},
        ["2026-03-29 01:30:00", "2026-03-29 01:50:00", "2026-03-29 02:30:00"], "Europe/Rome",
    ),
    "a leap second": Files(
        ["20161231_235950.csv", "20161231_235960.csv", "20170101_000010.csv"],
        ["2016-12-31T23:59:50Z", "2017-01-01T00:00:00Z", "2017-01-01T00:00:10Z"],
    ),
    "a leap second in a header": Files(
        numbered(2), ["2016-12-31T23:59:50Z", "2017-01-01T00:00:00Z"], set(),
        ["2016-12-31T23:59:50Z", "2016-12-31T23:59:60Z"],
    ),
    "set back by two hours": Files(
        numbered(5), [*TENS[:3], *clock("2026-03-28", "10:30", "10:40")], {2},
        [*TENS[:2], *clock("2026-03-28", "10:20", "10:30", "10:40")], sources={"header", "order"},
    ),
}  # fmt: skip


def write(root: Path, files: Files, place: int) -> None:
    path = root / files.names[place]
    path.parent.mkdir(parents=True, exist_ok=True)
    head = f"Start: {files.starts[place]}\nx\n" if files.starts else ""
    values = np.random.default_rng(place).standard_normal(COUNT)
    path.with_suffix(".tmp").write_text(head + "".join(f"{value:.4f}\n" for value in values))
    if files.changed:
        moment = datetime.fromisoformat(files.changed[place]).timestamp() + COUNT / RATE + 1.0
        os.utime(path.with_suffix(".tmp"), (moment, moment))
    path.with_suffix(".tmp").rename(path)


def replayed(folder: Path, files: Files) -> tuple[list[Record], dict[str, Any]]:
    (folder / "machine.toml").write_text(CONFIG.format(zone=files.zone))
    summary = replay(load_config(folder / "machine.toml"), None, folder / "out").summary
    with Store.open(folder / "out" / "state.db", read_only=True) as store:
        return list(store.records()), summary


@pytest.mark.parametrize("name", CASES)
def test_a_replay_puts_each_block_at_its_time_or_says_why_not(name: str, tmp_path: Path) -> None:
    files = CASES[name]
    for place in range(len(files.names)):
        write(tmp_path / "data", files, place)
    records, summary = replayed(tmp_path, files)
    assert [record.name for record in records] == [*files.names]
    assert [None if record.time is None else utc_text(record.time) for record in records] == [*files.times]
    assert {place for place, record in enumerate(records) if "clock" in record.flags} == files.doubted
    found = {record.channels["x"]["time_source"] for record in records} - {None}
    assert not files.sources or found == files.sources
    for place in files.doubted:
        record = records[place]
        assert record.status != "ok"
        assert "states" in record.reason
        assert record.time is None or record.channels["x"]["time_uncertainty_s"] >= 1.0
    assert [one["name"] for one in summary["doubtful_times"]] == [files.names[place] for place in sorted(files.doubted)]
    assert summary["time_source"] == {
        source: sum(record.channels["x"]["time_source"] == source for record in records) for source in found
    }
    assert ("local time of" in " ".join(summary["dating"])) is any(source.endswith("_local") for source in found)


def watched(root: Path, files: Files, *, one_by_one: bool) -> list[tuple[str, str | None, bool]]:
    """Return name, time and doubt of the blocks of a watched folder."""
    root.mkdir()
    rig = Rig(root, rate=float(RATE), timezone=files.zone)
    for place in range(len(files.names)):
        write(root, files, place)
        if one_by_one:
            rig.run(30.0)
    if not one_by_one:
        rig.run(60.0)
    state, found = OrderState(), []
    for item in rig.items:
        assert isinstance(item, Block)
        assert item.start is not None
        seen = TimeObservation(item.start, item.duration, statement=item.stated)
        state, flags, judged = check_order(state, item.sequence, seen)
        found.append((item.name, None if judged.time is None else utc_text(judged.time), "clock" in flags))
    return found


@pytest.mark.parametrize("one_by_one", [True, False])
@pytest.mark.parametrize(
    "name",
    [name for name in CASES if not name.startswith(("two files of 2006 and", "two files of 2006 by their"))],
)
def test_a_watched_folder_agrees(name: str, one_by_one: bool, tmp_path: Path) -> None:
    if name == "autumn by names alone":
        pytest.skip("that they come in this order tells the hour")
    if name == "autumn by last changes" and not one_by_one:
        pytest.skip("what waits together is taken in order of names")
    files = CASES[name]
    found = watched(tmp_path / "live", files, one_by_one=one_by_one)
    expected = zip(files.names, files.times, range(len(files.names)), strict=True)
    assert found == [(path, time, place in files.doubted) for path, time, place in expected]


@pytest.mark.parametrize("name", ["two files of 2006 by a number", "headers of 1970"])
def test_files_name_the_source_the_uncertainty_and_what_was_stated(name: str, tmp_path: Path) -> None:
    files = CASES[name]
    for place in range(5):
        write(tmp_path / "data", files, place)
    _, summary = replayed(tmp_path, files)
    (day,) = summary["records"]
    with xr.open_dataset(day) as records:
        assert (records.time.values[1:] > records.time.values[:-1]).all()
        meanings = records.time_source.attrs["flag_meanings"].split()
        words = [meanings[int(value) + 1] for value in records.time_source.values[:, 0]]
        assert set(words) == files.sources
        assert records.time_uncertainty_s.values[2:4, 0].min() >= 600.0
        assert np.isfinite(records.time_uncertainty_s.values).all()
        stated = records.time_stated.values[:, 0]
        assert [str(value)[:4] for value in stated] == [
            "NaT",
            "NaT",
            *(["2006"] * 2 if "2006" in name else ["1970"] * 2),
            "NaT",
        ]


@pytest.mark.parametrize("ppm", [0.0, 120.0, 5000.0])
def test_a_clock_that_drifts_is_said_and_flagged_where_no_block_bears_it(ppm: float, tmp_path: Path) -> None:
    begin, count = datetime.fromisoformat("2026-03-28T12:00:00Z").timestamp(), 40
    starts = [utc_text(begin + k * COUNT / RATE * (1.0 + 1e-6 * ppm)) for k in range(count)]
    starts = [start if "." in start else start.replace("Z", ".000Z") for start in starts]
    files = Files(numbered(count), [], set(), starts)
    for place in range(count):
        write(tmp_path / "data", files, place)
    records, summary = replayed(tmp_path, files)
    said = [sentence for sentence in summary["dating"] if "ppm" in sentence]
    assert bool(said) is (ppm > 0.0)
    assert any("clock" in record.flags for record in records) is (ppm > 1000.0)
    assert [record.time for record in records] == [datetime.fromisoformat(start).timestamp() for start in starts]
    last = records[-1].channels["x"]["time_uncertainty_s"]
    assert last == pytest.approx(1e-3 + 1e-6 * ppm * 0.5 * (count - 1), abs=2e-3)


def test_blocks_go_on_through_the_repeated_hour(tmp_path: Path) -> None:
    starts = [f"2026-10-25 02:59:5{second}" for second in ("8.0", "8.5", "9.0", "9.5")]
    starts += [f"2026-10-25 02:00:0{second}" for second in ("0.0", "0.5", "1.0")]
    files = Files(numbered(7), [], set(), starts, "Europe/Rome")
    for place in range(7):
        write(tmp_path / "data", files, place)
    (tmp_path / "machine.toml").write_text(CONFIG.format(zone=files.zone).replace('block_s = "file"', "block_s = 0.4"))
    replay(load_config(tmp_path / "machine.toml"), None, tmp_path / "out")
    with Store.open(tmp_path / "out" / "state.db", read_only=True) as store:
        records = list(store.records())
    begin = datetime.fromisoformat("2026-10-25T00:59:58Z").timestamp()
    blocks = [record for record in records if record.accepted]
    assert len(blocks) >= 8
    assert [record.time for record in blocks] == pytest.approx([begin + 0.4 * k for k in range(len(blocks))], abs=1e-3)
    # Of which hour the first one is, nothing tells; the others follow it.
    assert [record.sequence for record in records if "clock" in record.flags] == [1]
