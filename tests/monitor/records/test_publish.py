from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.health.record import Record
from monitor.health.schema import VARIABLES
from monitor.records.dataset import to_dataset, words
from monitor.records.events import EventLog
from monitor.records.publish import PublishError, file_name, publish
from monitor.records.published_folder import read_snapshot, snapshot_path
from monitor.records.store import Store
from tests.oracles.records_oracle import array_of, records
from tests.support.effort import effort_count

DAY = 86400.0
NOON = 1_700_000_000.0 // DAY * DAY + DAY / 2
ATTRIBUTES = {"config_hash": "c1", "map_hash": None, "rms_band_hz": (0.0, 9500.0), "calibrated": False}


def block(sequence: int, time: float | None, **values: Any) -> Record:
    full = {"rms": 1.0 + sequence, "stage": "final", "fault": "inner|ball", "edv_status": "ok", "v_eq": 2e-8, **values}
    return Record(
        source="s", sequence=sequence, name=f"b{sequence}", content_hash="h", time=time, channels={"x": full, "y": {}}
    )


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    with Store.open(tmp_path / "state.db", machine="m") as opened:
        opened.describe(ATTRIBUTES)
        yield opened


def names(paths: list[Path]) -> list[str]:
    return [path.name for path in paths]


@given(st.lists(records(bands=2), min_size=1, max_size=5, unique_by=lambda record: record.sequence))
@settings(max_examples=effort_count(quick=10, full=400))
def test_the_dataset_holds_what_the_records_hold(tmp_path_factory: pytest.TempPathFactory, made: list[Record]) -> None:
    with Store.open(tmp_path_factory.mktemp("store") / "state.db", machine="m") as store:
        store.commit_many([(record, {}) for record in made])
        rows = list(store.stored())
    dataset = to_dataset(rows, dated=False, attributes={})
    by_time = [row.to_record() for row in sorted(rows, key=lambda row: (row.filing.time, row.source, row.sequence))]
    channels = [str(channel) for channel in dataset.channel.values]
    assert sorted(channels) == sorted({channel for record in made for channel in record.channels})
    assert np.all(np.diff(dataset.time.values) >= 0)
    assert list(dataset.content_hash.values) == [record.content_hash for record in by_time]
    for name, variable in VARIABLES.items():
        if name in dataset:
            expected = array_of(variable, by_time, channels, bands=2)
            if dataset[name].ndim < expected.ndim:
                expected = expected[:, :, 0]
            np.testing.assert_array_equal(dataset[name].values.astype(float), expected, err_msg=name)
        else:
            assert variable.optional


def test_a_day_opens_plainly_and_says_what_it_is(store: Store, tmp_path: Path) -> None:
    store.describe({**ATTRIBUTES, "institution": "a workshop"})
    store.commit(block(1, NOON, t_fs=NOON, t_fs_block=1, quality_flags=("gap", "clipped")), {})
    store.commit(block(2, NOON + 0.25), {})
    (path,) = publish(store, tmp_path / "records")
    assert path.name == "m-20231114.nc"
    with xr.open_dataset(path) as dataset:
        assert dataset.sizes["time"] == 2
        # xarray makes nanoseconds since 1970 of a float64, which holds them to about 0.2 us.
        step = dataset.time.values[1] - dataset.time.values[0]
        assert abs(step - np.timedelta64(250, "ms")) < np.timedelta64(1, "us")
        assert dataset.rms.sel(channel="x").values.tolist() == [2.0, 3.0]
        assert dataset.rms.attrs["units"] == "m s-2"
        assert dataset.v_eq.attrs["units"] == "m2"
        assert dataset.t_fs.values[0, 0] == dataset.time.values[0]
        assert np.isnat(dataset.t_fs.values[1, 0])
        assert dataset.t_fs_block.values[0, 0] == 1
        assert np.isnan(dataset.t_fs_block.values[1, 0])
        assert words(dataset.fault)[:, 0].tolist() == ["inner|ball", "inner|ball"]
        assert words(dataset.quality_flags)[:, 0].tolist() == ["clipped|gap", ""]
        assert words(dataset.stage).tolist() == [["final", ""], ["final", ""]]
        assert dataset.stage.attrs["flag_meanings"].split()[0] == "no_value"
        assert dataset.status.values.tolist() == ["ok", "ok"]
        assert json.loads(str(dataset.events.values[0])) == []
        assert dataset.attrs["Conventions"] == "CF-1.11, ACDD-1.3"
        for key in ("title", "summary", "keywords", "id", "date_created", "time_coverage_start", "source", "history"):
            assert dataset.attrs[key]
        assert dataset.attrs["config_hash"] == "c1"
        assert dataset.attrs["map_hash"] == "none"
        assert dataset.attrs["calibrated"] == "no"
        assert dataset.attrs["rms_band_hz"].tolist() == [0.0, 9500.0]
        assert dataset.attrs["institution"] == "a workshop"
        assert dataset.attrs["schema_version"] == 1


def test_days_lie_side_by_side_along_time(store: Store, tmp_path: Path) -> None:
    store.commit_many([(block(number, NOON + number * DAY / 4), {}) for number in range(8)[1:]])
    paths = publish(store, tmp_path)
    assert names(paths) == ["m-20231114.nc", "m-20231115.nc", "m-20231116.nc"]
    parts = [xr.open_dataset(path) for path in paths]
    whole = xr.concat(parts, dim="time", data_vars="minimal", coords="minimal", compat="override", join="outer")
    assert whole.sequence.values.tolist() == list(range(1, 8))
    assert set(map(str, parts[0].variables)) == set(map(str, parts[2].variables))
    for part in parts:
        part.close()


def test_only_days_that_changed_are_written_again(store: Store, tmp_path: Path) -> None:
    for number in range(1, 4):
        store.commit(block(number, NOON + number * DAY), {})
    assert len(publish(store, tmp_path)) == 3
    assert publish(store, tmp_path) == []
    store.commit(block(4, NOON + 3 * DAY + 5), {})
    assert names(publish(store, tmp_path)) == ["m-20231117.nc"]
    # A late record falls into a day that is long closed.
    store.commit(block(5, NOON + DAY + 5), {})
    (late,) = publish(store, tmp_path)
    assert late.name == "m-20231115.nc"
    with xr.open_dataset(late) as dataset:
        assert dataset.sequence.values.tolist() == [1, 5]
    assert len(publish(store, tmp_path, rebuild=True)) == 3


def test_what_changes_without_a_block_is_in_the_snapshot(store: Store, tmp_path: Path) -> None:
    store.commit(block(1, NOON, v_eq=1e-8), {"source:s": {"sequence": 1, "speed": 40.1}})
    assert len(publish(store, tmp_path)) == 1
    with EventLog(store.path) as log:
        log.notice(NOON + 1.5, {"kind": "stream_reset", "text": "s"})
    assert publish(store, tmp_path) == []
    found = read_snapshot(tmp_path, "m")
    assert found is not None
    assert [row["utc"] for row in found.tables["notices"]] == [NOON + 1.5]
    assert list(found.files) == ["m-20231114.nc"]
    before = snapshot_path(tmp_path, "m").stat().st_ino
    assert publish(store, tmp_path) == []
    assert snapshot_path(tmp_path, "m").stat().st_ino == before


def test_a_lost_or_cut_file_is_made_again(store: Store, tmp_path: Path) -> None:
    for number in range(1, 4):
        store.commit(block(number, NOON + number * DAY), {})
    first, _, third = publish(store, tmp_path)
    content = third.read_bytes()
    first.unlink()
    third.write_bytes(content[: len(content) // 2])
    assert publish(store, tmp_path) == [first, third]
    assert publish(store, tmp_path) == []
    with xr.open_dataset(third) as dataset:
        assert dataset.sequence.values.tolist() == [3]
    assert len(publish(store, tmp_path / "elsewhere")) == 3


def test_a_recording_without_a_date(store: Store, tmp_path: Path) -> None:
    for number in range(1, 4):
        record = block(number, None, t_fs=10.0, t_fs_block=2)
        store.commit(Record(**{**record.__dict__, "elapsed": 10.0 * (number - 1)}), {})
    (path,) = publish(store, tmp_path)
    assert path.name == "m-undated.nc"
    with xr.open_dataset(path) as dataset:
        assert dataset.time.values.tolist() == [0.0, 10.0, 20.0]
        assert dataset.time.attrs["units"] == "s"
        assert dataset.t_fs.values[:, 0].tolist() == [10.0] * 3
        assert "time_coverage_start" not in dataset.attrs


def test_a_rejected_block_without_a_time_stands_where_its_source_was(store: Store, tmp_path: Path) -> None:
    rejected = Record(source="s", sequence=2, name="b2", content_hash="", status="unreadable", reason="no text <b>")
    store.commit_many([(block(1, NOON), {}), (rejected, {}), (block(3, NOON + DAY), {})])
    first, second = publish(store, tmp_path)
    with xr.open_dataset(first) as dataset:
        assert dataset.status.values.tolist() == ["ok", "unreadable"]
        assert dataset.reason.values.tolist() == ["", "no text <b>"]
        assert words(dataset.time_status).tolist() == ["given", "carried"]
        assert np.isnan(dataset.rms.values[1, 0])
    assert second.name == "m-20231115.nc"


def test_a_file_of_rejected_blocks_alone(store: Store, tmp_path: Path) -> None:
    rejected = Record(source="s", sequence=1, name="b1", content_hash="", status="unreadable")
    store.commit(rejected, {})
    (path,) = publish(store, tmp_path)
    with xr.open_dataset(path) as dataset:
        assert dataset.sizes["channel"] == 0
        assert words(dataset.time_status).tolist() == ["unknown"]


def test_impossible_clocks_do_not_stop_the_publisher(store: Store, tmp_path: Path) -> None:
    times = (0.0, -5.0, 1e18, 253402300799.0)
    store.commit_many([(block(number, time), {}) for number, time in enumerate(times, start=1)])
    assert names(publish(store, tmp_path)) == ["m-19700101.nc", "m-99991231.nc"]
    assert [record.time for record in store.records()] == list(times)


def test_runs_that_differ_are_both_named(store: Store, tmp_path: Path) -> None:
    store.commit(block(1, NOON), {})
    store.describe({**ATTRIBUTES, "config_hash": "c2"})
    store.commit(block(2, NOON + 5), {})
    store.commit(block(3, NOON + DAY), {})
    first, second = publish(store, tmp_path)
    with xr.open_dataset(first) as dataset:
        assert dataset.attrs["config_hash"] == "c1; c2"
    with xr.open_dataset(second) as dataset:
        assert dataset.attrs["config_hash"] == "c2"


def test_several_bands_and_thresholds_have_dimensions(store: Store, tmp_path: Path) -> None:
    store.commit(block(1, NOON, band_lo=1000.0, band_hi=2000.0, tt=60.0, v_th=5e-8), {})
    more = {
        "band_lo": (1000.0, 3000.0),
        "band_hi": (2000.0, 4000.0),
        "tt": (60.0, None, 70.0),
        "v_th": (3e-8, 5e-8, 8e-8),
    }
    store.commit(block(2, NOON + 5, tt_status=("ok", "concave", "ok"), **more), {})
    (path,) = publish(store, tmp_path)
    with xr.open_dataset(path) as dataset:
        assert dataset.band_lo.dims == ("time", "channel", "band")
        np.testing.assert_array_equal(dataset.band_lo.values[:, 0], [[1000.0, np.nan], [1000.0, 3000.0]])
        np.testing.assert_array_equal(dataset.tt.values[:, 0], [[60.0, np.nan, np.nan], [60.0, np.nan, 70.0]])
        assert words(dataset.tt_status)[1, 0].tolist() == ["ok", "concave", "ok"]
        assert dataset.h_or.dims == ("time", "channel")


@pytest.mark.process
def test_a_reader_with_the_old_file_open_is_not_in_the_way(store: Store, tmp_path: Path) -> None:
    store.commit(block(1, NOON), {})
    (path,) = publish(store, tmp_path)
    with xr.open_dataset(path) as old:
        store.commit(block(2, NOON + 5), {})
        assert publish(store, tmp_path) == [path]
        assert old.rms.values[:, 0].tolist() == [2.0]
    count = "import sys, xarray; print(xarray.open_dataset(sys.argv[1]).sizes['time'])"
    output = subprocess.run([sys.executable, "-c", count, str(path)], capture_output=True, text=True, check=True)
    assert output.stdout == "2\n"


def test_a_read_only_store_publishes_too(store: Store, tmp_path: Path) -> None:
    store.commit(block(1, NOON), {})
    with Store.open(store.path, read_only=True) as reader:
        assert len(publish(reader, tmp_path)) == 1


def test_what_cannot_be_written_is_said_and_the_old_file_stays(store: Store, tmp_path: Path) -> None:
    store.commit(block(1, NOON), {})
    (path,) = publish(store, tmp_path)
    before = path.read_bytes()
    blocker = tmp_path / f".{path.name}.tmp"
    blocker.mkdir()
    store.commit(block(2, NOON + 5), {})
    with pytest.raises(PublishError, match=r"m-20231114\.nc: cannot be written"):
        publish(store, tmp_path)
    assert path.read_bytes() == before
    blocker.rmdir()
    assert publish(store, tmp_path) == [path]
    with pytest.raises(PublishError, match="cannot be written"):
        publish(store, path / "under_a_file")


def test_machine_names_that_do_not_fit_are_refused() -> None:
    with pytest.raises(PublishError, match="cannot be part of a file name"):
        file_name("../m", None)
