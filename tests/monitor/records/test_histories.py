"""Histories out of published records: what counts as the final stage, as usable, and as damage time."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from monitor.health.record import Record
from monitor.records.histories import HistoryError, read_history, write_history
from monitor.records.publish import publish
from monitor.records.store import Store

T_FS = 1200.0
DAY = 1_700_000_000.0


def values(i: int, **changes: Any) -> dict[str, Any]:
    """Block ``i`` of a channel whose final stage began with block 4 and was known with block 6."""
    known = {"t_fs": T_FS, "stage": "final"} if i >= 6 else {"stage": "healthy"}
    lines = tuple(0.1 * k for k in range(1, 7))
    base = {"rms": 1.0 + i, "bpfo_amplitude": lines, "load": 4000.0, "speed": 40.0, "quality_status": "ok"}
    return {**base, **known, "v_eq": 1e-9 * i if i >= 6 else None, **changes}


def written(
    folder: Path,
    change: Callable[[int], dict[str, Any]] = lambda i: {},
    channels: tuple[str, ...] = ("a",),
    start: float | None = None,
) -> Path:
    folder.mkdir(exist_ok=True)
    with Store.open(folder / "state.db", machine="m") as store:
        for i in range(12):
            time: dict[str, Any] = {"elapsed": 300.0 * i} if start is None else {"time": start + 300.0 * i}
            every = {name: values(i, **change(i)) for name in channels}
            record = Record(source="s", sequence=i + 1, name=f"b{i}", content_hash=f"h{i}", channels=every, **time)
            store.commit(record, {})
        publish(store, folder / "records")
    return folder


def test_the_history_begins_at_t_fs_though_it_was_known_later(tmp_path: Path) -> None:
    history = read_history(written(tmp_path))
    assert history.channel == "a"
    assert history.time.tolist() == [300.0 * i for i in range(4, 12)]
    assert history.running.tolist() == [300.0 * i for i in range(8)]
    assert history.rms.tolist() == [1.0 + i for i in range(4, 12)]
    assert history.harmonics.shape == (8, 6)
    assert np.isnan(history.v_eq[:2]).all()
    assert history.v_eq[2:] == pytest.approx([1e-9 * i for i in range(6, 12)])


def test_the_history_is_that_of_the_latest_final_stage_and_ends_where_it_closed(tmp_path: Path) -> None:
    closed = {"t_fs": None, "stage": "healthy"}
    history = read_history(written(tmp_path / "closed", lambda i: closed if i > 8 else {}))
    assert history.time.tolist() == [300.0 * i for i in range(4, 9)]
    again = {8: closed, 9: closed, 10: {"t_fs": 2700.0}, 11: {"t_fs": 2700.0}}
    assert read_history(written(tmp_path / "again", lambda i: again.get(i, {}))).time.tolist() == [
        2700.0,
        3000.0,
        3300.0,
    ]


def test_standstill_is_no_damage_time_and_no_reading(tmp_path: Path) -> None:
    stopped = {"quality_status": "stopped", "quality_flags": ("stopped",)}
    history = read_history(written(tmp_path, lambda i: stopped if i in (7, 8) else {}))
    assert history.time.tolist() == [300.0 * i for i in (4, 5, 6, 9, 10, 11)]
    assert history.running.tolist() == [0.0, 300.0, 600.0, 600.0, 900.0, 1200.0]


@pytest.mark.parametrize("flag", ["clipped", "late", "out_of_order", "flat"])
def test_blocks_that_no_tracker_takes_are_left_out(tmp_path: Path, flag: str) -> None:
    history = read_history(
        written(tmp_path, lambda i: {"quality_status": flag, "quality_flags": (flag,)} if i == 8 else {})
    )
    assert 2400.0 not in history.time
    assert history.running[-1] == 2100.0


def test_dated_records_over_midnight_are_one_history(tmp_path: Path) -> None:
    start = 86400.0 * (DAY // 86400.0 + 1) - 1800.0
    folder = written(tmp_path, lambda i: {"t_fs": start + T_FS} if i >= 6 else {}, start=start)
    assert len(list((folder / "records").glob("*.nc"))) == 2
    history = read_history(folder)
    assert history.running.tolist() == [300.0 * i for i in range(8)]
    assert history.time[0] == start + T_FS


def test_of_several_channels_one_must_be_named(tmp_path: Path) -> None:
    folder = written(tmp_path, channels=("a", "b"))
    with pytest.raises(HistoryError, match=r"several channels have a final stage \(a, b\).*--channel"):
        read_history(folder)
    assert read_history(folder, "b").channel == "b"
    with pytest.raises(HistoryError, match=r"has no channel 'c'; it has a, b"):
        read_history(folder, "c")


def test_what_holds_no_history_is_refused(tmp_path: Path) -> None:
    healthy = written(tmp_path, lambda i: {"t_fs": None, "stage": "healthy"})
    with pytest.raises(HistoryError, match="no channel has a final stage"):
        read_history(healthy)
    (tmp_path / "garbage.nc").write_bytes(b"no netCDF")
    with pytest.raises(HistoryError, match=r"garbage\.nc: cannot be read"):
        read_history(tmp_path / "garbage.nc")
    (tmp_path / "empty").mkdir()
    with pytest.raises(HistoryError, match=r"holds no \.nc files"):
        read_history(tmp_path / "empty")
    write_history(tmp_path / "tracked.nc", [0.0, 1.0], {"v_eq": [1e-9, None]})
    with pytest.raises(HistoryError, match="holds no health records"):
        read_history(tmp_path / "tracked.nc")


def test_a_file_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    with pytest.raises(HistoryError, match="cannot be written"):
        write_history(tmp_path / "nowhere" / "out.nc", [0.0], {"v_eq": [1e-9]})
