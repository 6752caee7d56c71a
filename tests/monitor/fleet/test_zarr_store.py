"""An archive as one Zarr store: what is read from it is what the files of the recordings hold."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

import spallwatch as sw
from models.fleet.lease import LeaseLostError
from models.fleet.object_store import ObjectStore
from models.words.errors import WrongInputError
from models.work.folder_store import FolderStore
from models.work.pool import SerialExecutor
from models.work.runner import Runner
from monitor.fleet import arrays
from monitor.fleet.result import RecordingResult, RecordsFile, Shape
from monitor.fleet.setup import ArchiveError
from monitor.fleet.zarr_store import RowsError, row_ranges
from tests.monitor.fleet.recordings import FEW, replayed, trimmed
from tests.support.object_storage import use_account

zarr_store = pytest.importorskip("monitor.fleet.zarr_store")
write_archive = zarr_store.write_archive
BANDS = [[100, 400], [500, 900]]
FAILED = RecordingResult("press", "bad", "s3://archive/bad.npy", status="failed", reason="no such recording")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("archive")
    night = datetime(2026, 3, 1, 23, 59, 59, tzinfo=UTC)
    results = [
        replayed(folder, "press/one", 3, channels=2),
        FAILED,
        replayed(folder, "fan/one", 5, start=night, band_hz=BANDS),
        replayed(folder, "press/two", 4, start=night),
    ]
    return folder, results


@pytest.fixture(scope="module")
def archive(whole):
    return whole[0], trimmed(whole[1])


@pytest.fixture(scope="module")
def read(archive, tmp_path_factory):
    """Return the folder of an archive with a store of three chunks; do not write into it."""
    folder = tmp_path_factory.mktemp("read")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(arrays, "MAX_CHUNK_ROWS", 4)
        patch.setattr(arrays, "MIN_CHUNK_ROWS", 2)
        write(archive, folder / "records.zarr")
    return folder


@pytest.fixture
def small_chunks(monkeypatch):
    monkeypatch.setattr(arrays, "MIN_CHUNK_ROWS", 2)
    monkeypatch.setattr(arrays, "MAX_CHUNK_ROWS", 4)


def write(archive, out, runner=None):
    folder, results = archive
    more = {} if runner is None else {"runner": runner}
    return write_archive(results, FolderStore(folder), str(out), **more)


def content(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_recording_is_what_its_files_hold(whole, tmp_path):
    folder, results = whole[0], [FAILED, whole[1][2]]
    written = write((folder, results), tmp_path / "a.zarr")
    assert (written.recordings, written.rows) == (2, 5)
    of_files = sw.open_records(folder / "fan" / "one")
    of_archive = sw.open_archive(tmp_path / "a.zarr", machine="fan", recording="one")
    assert of_archive.sizes == of_files.sizes
    xr.testing.assert_identical(of_archive.drop_attrs(), of_files.drop_attrs())
    assert of_archive.rms.attrs == of_files.rms.attrs


@pytest.mark.parametrize(("machine", "recording"), [("press", "one"), ("press", "two"), ("fan", "one")])
def test_recordings_side_by_side_are_what_their_files_hold(archive, read, machine, recording):
    of_files = sw.open_records(archive[0] / machine / recording, variables=sorted(FEW))
    of_archive = sw.open_archive(read, machine=machine, recording=recording, variables=sorted(FEW))
    for name in FEW:
        np.testing.assert_array_equal(of_archive[name].values, of_files[name].values)
        assert of_archive[name].dims == of_files[name].dims
    assert of_archive.channel.values.tolist() == of_files.channel.values.tolist()


def test_a_channel_of_a_recording(archive, read):
    found = sw.open_archive(read, machine="press", recording="one", variables=["rms"], channels=["column_2"])
    of_files = sw.open_records(archive[0] / "press" / "one", variables=["rms"], channels=["column_2"])
    xr.testing.assert_identical(found.drop_attrs(), of_files.drop_attrs())


def test_xarray_reads_all_of_it_lazily(archive, read):
    with xr.open_dataset(read / "records.zarr", engine="zarr", chunks={}) as found:
        assert found.rms.chunks is not None
        assert found.rms.chunks[0] == (4, 4, 4)
        assert dict(found.sizes)["band"] == 2
        assert found.part.values.tolist() == ["outer", "inner", "ball", "cage"]
        names = found.recording_name.isel(recording=found.recording_index).compute().values.tolist()
        assert names == ["one"] * 8 + ["two"] * 4
        assert found.row_size.values.tolist() == [3, 0, 5, 4]
        assert found.recording_reason.values.tolist() == ["", "no such recording", "", ""]
        assert found.channel_name.values.tolist() == [
            ["column_1", "column_2"],
            ["", ""],
            ["column_1", ""],
            ["column_1", ""],
        ]
        dates = found.time.values
        assert np.isnat(dates[:3]).all()
        assert dates[3] == np.datetime64("2026-03-01T23:59:59")
        assert found.time_undated.values[:4].tolist()[:3] == [0.0, 0.5, 1.0]
        of_fan = sw.open_records(archive[0] / "fan" / "one").rms.values[:, 0]
        np.testing.assert_array_equal(found.rms.isel(row=slice(3, 8), channel=0).values, of_fan)
        # Words are integers with flag attributes, and missing whole numbers are missing.
        assert found.stage.dtype == np.int8
        assert set(found.stage.values[:, 0].tolist()) <= set(found.stage.attrs["flag_values"])
        assert found.stage.values[3:, 1].tolist() == [-1] * 9


def test_rows_of_a_machine(archive, read):
    press = sw.open_archive(read, machine="press", variables=["rms"])
    assert press.rms.chunks is not None
    assert "kurtosis" not in press
    assert press.recording_index.values.tolist() == [0] * 3 + [2] * 4
    assert press.first_row.values.tolist() == [0, 3, 3]
    np.testing.assert_array_equal(
        press.rms.values[3:, 0], sw.open_records(archive[0] / "press" / "two").rms.values[:, 0]
    )


def test_a_store_that_is_not_complete_does_not_open(archive, tmp_path):
    write(archive, tmp_path / "records.zarr")
    (tmp_path / "records.zarr" / "zarr.json").unlink()
    with pytest.raises(FileNotFoundError):
        xr.open_zarr(tmp_path / "records.zarr")
    with pytest.raises(sw.SpallwatchError, match="is not complete; archive replay --resume"):
        sw.open_archive(tmp_path)


def test_results_that_cannot_be_read_leave_the_store_whole(archive, read, tmp_path):
    def missing():
        yield archive[1][0]
        raise ArchiveError("press/two/result.json is missing")

    shutil.copytree(read / "records.zarr", tmp_path / "records.zarr")
    with pytest.raises(ArchiveError, match="is missing"):
        write((archive[0], missing()), tmp_path / "records.zarr")
    assert content(tmp_path / "records.zarr") == content(read / "records.zarr")


def test_the_bytes_are_the_same_through_a_store_of_chunks_and_again(archive, read, tmp_path, small_chunks):
    first = content(read / "records.zarr")
    chunks = FolderStore(tmp_path / "chunks")
    with Runner(SerialExecutor(), chunks) as runner:
        write(archive, tmp_path / "a.zarr", runner)
    assert content(tmp_path / "a.zarr") == first
    # Chunks that are known as done are found missing, and written again.
    lost = next(name for name in first if name.startswith("rms/c.1"))
    (tmp_path / "a.zarr" / lost).unlink()
    with Runner(SerialExecutor(), chunks, resume=True) as runner:
        write(archive, tmp_path / "a.zarr", runner)
        assert runner.tally.kept == 3
    assert content(tmp_path / "a.zarr") == first


def test_chunks_of_an_earlier_writing_do_not_count_where_another_one_came_between(archive, tmp_path, small_chunks):
    folder, results = archive
    for writing, listed in (("1", results), ("2", [results[3], *results[:3]]), ("3", results)):
        with Runner(SerialExecutor(), FolderStore(tmp_path / "chunks"), resume=True) as runner:
            write_archive(listed, FolderStore(folder), str(tmp_path / "a.zarr"), runner, writing=writing)
            assert runner.tally.kept == 0
    write(archive, tmp_path / "b.zarr")
    assert content(tmp_path / "a.zarr") == content(tmp_path / "b.zarr")


@pytest.mark.parametrize(("dtype", "fill"), [("float64", np.nan), ("int32", -1), (arrays.TEXT, "")])
def test_chunks_without_any_value_are_written_too(dtype, fill):
    array = arrays.Array("x", ("row", "channel"), (5, 2), (4, 2), dtype, fill)
    files = zarr_store.encoded(array, zarr_store.metadata_of(array), 0, array.empty(5))
    assert set(files) == set(array.chunk_names()) == {"x/c.0.0", "x/c.1.0"}


def test_a_smaller_archive_leaves_nothing_of_a_larger_one(archive, read, tmp_path, small_chunks):
    folder, results = archive
    shutil.copytree(read / "records.zarr", tmp_path / "a.zarr")
    (tmp_path / "a.zarr" / "notes.txt").write_text("mine")
    (tmp_path / "a.zarr" / "notes").mkdir()
    (tmp_path / "a.zarr" / "notes" / "more.txt").write_text("mine")
    (tmp_path / "a.zarr" / "rms" / "0.0").write_text("mine")
    (tmp_path / "a.zarr" / "time" / "notes").mkdir(parents=True)
    (tmp_path / "a.zarr" / "time" / "notes" / "c.9").write_text("mine")
    before = content(tmp_path / "a.zarr")
    write((folder, results[3:]), tmp_path / "a.zarr")
    found = content(tmp_path / "a.zarr")
    assert {name for name in before if name.startswith("rms/c")} == {"rms/c.0.0", "rms/c.1.0", "rms/c.2.0"}
    assert {name for name in found if name.startswith("rms/c")} == {"rms/c.0.0"}
    assert found["notes.txt"] == found["notes/more.txt"] == b"mine"
    assert found["rms/0.0"] == found["time/notes/c.9"] == b"mine"
    one = sw.open_archive(tmp_path / "a.zarr", machine="press", recording="two", variables=["rms"])
    xr.testing.assert_identical(
        one.drop_attrs(), sw.open_records(folder / "press" / "two", variables=["rms"]).drop_attrs()
    )


def test_an_archive_without_any_records_opens(tmp_path):
    write((tmp_path, [FAILED]), tmp_path / "a.zarr")
    with sw.open_archive(tmp_path / "a.zarr") as found:
        assert found.sizes["row"] == 0
        assert found.recording_status.values.tolist() == [1]
    with pytest.raises(sw.SpallwatchError, match="press/bad: holds no records: no such recording"):
        sw.open_archive(tmp_path / "a.zarr", machine="press", recording="bad")


def test_another_zarr_store_is_left_as_it_is(archive, tmp_path):
    xr.Dataset({"x": ("y", [1.0])}).to_zarr(tmp_path / "a.zarr", consolidated=False)
    before = content(tmp_path / "a.zarr")
    with pytest.raises(WrongInputError, match=r"a\.zarr: is a Zarr store, but no archive of spallwatch"):
        write(archive, tmp_path / "a.zarr")
    assert content(tmp_path / "a.zarr") == before
    with pytest.raises(sw.SpallwatchError, match="is a Zarr store, but no archive of spallwatch"):
        sw.open_archive(tmp_path / "a.zarr")


def test_a_newer_archive_is_refused(tmp_path):
    write((tmp_path, [FAILED]), tmp_path / "a.zarr")
    root = json.loads((tmp_path / "a.zarr" / "zarr.json").read_text())
    root["attributes"]["spallwatch_archive"] = 2
    (tmp_path / "a.zarr" / "zarr.json").write_text(json.dumps(root))
    with pytest.raises(sw.SpallwatchError, match="archive version 2; known are versions up to 1"):
        sw.open_archive(tmp_path / "a.zarr")
    with pytest.raises(WrongInputError, match="up to version 1"):
        write((tmp_path, [FAILED]), tmp_path / "a.zarr")


def test_records_that_are_missing_or_others_than_planned_are_named(archive, tmp_path):
    folder, results = archive
    gone = replace(results[0], files=(replace(results[0].files[0], name="press/one/gone.nc"),))
    with pytest.raises(RowsError, match=r"has no records press/one/gone\.nc"):
        write((folder, [gone]), tmp_path / "a.zarr")
    longer = replace(results[0], files=(replace(results[0].files[0], rows=9),))
    with pytest.raises(RowsError, match="expected 9 rows of column_1, column_2, got 3 of column_1, column_2"):
        write((folder, [longer]), tmp_path / "a.zarr")
    (folder / "torn.nc").write_bytes(b"CDF")
    torn = replace(results[0], files=(replace(results[0].files[0], name="torn.nc"),))
    with pytest.raises(RowsError, match=r"torn\.nc: cannot be read as records"):
        write((folder, [torn]), tmp_path / "a.zarr")
    assert not (tmp_path / "a.zarr" / "zarr.json").exists()


def test_what_is_not_there_is_named(archive, read):
    with pytest.raises(sw.SpallwatchError, match="has no machine 'pump'; it has fan, press"):
        sw.open_archive(read, machine="pump")
    with pytest.raises(sw.SpallwatchError, match="has no recording 'three' of press; it has bad, one, two"):
        sw.open_archive(read, machine="press", recording="three")
    with pytest.raises(sw.SpallwatchError, match="name its machine too"):
        sw.open_archive(read, recording="one")
    with pytest.raises(sw.SpallwatchError, match="'loudness' is not a variable"):
        sw.open_archive(read, variables=["loudness"])
    with pytest.raises(sw.SpallwatchError, match="holds no records with dates"):
        sw.open_archive(read, machine="press", recording="one", dated=True)
    with pytest.raises(sw.SpallwatchError, match="of an archive of days, name machine and recording"):
        sw.open_archive(archive[0])


def test_a_recording_of_an_archive_of_days(archive):
    found = sw.open_archive(archive[0], machine="fan", recording="one")
    xr.testing.assert_identical(found, sw.open_records(archive[0] / "fan" / "one"))


def test_a_recording_of_days_is_the_files_that_its_result_names(archive, tmp_path):
    shutil.copytree(archive[0] / "fan", tmp_path / "fan")
    folder = tmp_path / "fan/one/records"
    of_files = sw.open_records(folder)
    shutil.copy(next(folder.glob("*.nc")), folder / "fan-20000101.nc")
    shutil.copy(next(folder.glob("*.nc")), tmp_path / "fan/one/fan-20000102.nc")
    xr.testing.assert_identical(sw.open_archive(tmp_path, machine="fan", recording="one"), of_files)
    failed = replace(FAILED, machine="fan", recording="one")
    (tmp_path / "fan/one/result.json").write_bytes(failed.to_json())
    with pytest.raises(sw.SpallwatchError, match="holds no records of fan/one: no such recording"):
        sw.open_archive(tmp_path, machine="fan", recording="one")
    (tmp_path / "fan/one/result.json").unlink()
    with pytest.raises(sw.SpallwatchError, match=r"holds no records of fan/one: there is no result\.json"):
        sw.open_archive(tmp_path, machine="fan", recording="one")


@given(st.lists(st.lists(st.integers(0, 9), max_size=3), max_size=6), st.integers(1, 7))
def test_each_row_is_written_once_and_in_order(recordings, chunk):
    results = [
        RecordingResult(
            "m", str(i), "u", files=tuple(RecordsFile(f"{i}/{day}", day, n, 1) for day, n in enumerate(counts))
        )
        for i, counts in enumerate(recordings)
    ]
    ranges = list(row_ranges(results, chunk))
    rows = [
        (piece.file, piece.begin + k, piece.recording)
        for part in ranges
        for piece in part.pieces
        for k in range(piece.rows)
    ]
    expected = [
        (file.name, k, i) for i, result in enumerate(results) for file in result.files for k in range(file.rows)
    ]
    assert rows == expected
    assert [part.first for part in ranges] == list(range(0, len(rows), chunk))
    assert all(sum(piece.rows for piece in part.pieces) == chunk for part in ranges[:-1])


@given(st.integers(0, 10**8), st.integers(1, 100), st.integers(1, 5))
def test_a_chunk_fits_its_bytes_or_is_as_small_as_may_be(rows, channels, bands):
    shape = {"rms": ("channel",), "envelope_snr": ("channel", "band", "fault", "harmonic"), "stage": ("channel",)}
    extent = arrays.ArchiveExtent(rows, 1, channels, shape, {"band": bands, "fault": 4, "harmonic": 5})
    found = arrays.arrays_of_rows(extent)
    chunk = found[0].chunks[0]
    assert {array.chunks[0] for array in found} == {chunk}
    assert chunk & (chunk - 1) == 0
    assert arrays.MIN_CHUNK_ROWS <= chunk <= arrays.MAX_CHUNK_ROWS
    assert chunk * arrays.row_bytes(found) <= arrays.MAX_CHUNK_BYTES or chunk == arrays.MIN_CHUNK_ROWS
    assert chunk < 2 * max(rows, arrays.MIN_CHUNK_ROWS)


def test_extents_join_shapes():
    one = RecordingResult(
        "m", "a", "u", files=(RecordsFile("a", None, 3, 1),), shape=Shape(("x",), {"h_or": ("channel",)})
    )
    two = RecordingResult(
        "m",
        "b",
        "u",
        files=(RecordsFile("b", 5, 2, 1),),
        shape=Shape(("x", "y"), {"h_or": ("channel", "band"), "tt": ("channel",)}, {"band": 3}),
    )
    found = arrays.ArchiveExtent.of([one, two])
    assert (found.rows, found.recordings, found.channels, found.undated) == (5, 2, 2, True)
    assert found.variables == {"h_or": ("channel", "band"), "tt": ("channel",)}
    assert not arrays.ArchiveExtent.of([two]).undated


@pytest.mark.cluster
def test_an_archive_in_object_storage(whole, storage, monkeypatch):
    use_account(storage.environment, monkeypatch)
    folder, results = whole[0], trimmed(whole[1][2:3], {"rms"})
    write_archive(results, FolderStore(folder), storage.url("rows/records.zarr"))
    of_files = sw.open_records(folder / "fan" / "one", variables=["rms"])
    lazy = sw.open_archive(storage.url("rows"), machine="fan", variables=["rms"])
    assert lazy.rms.chunks is not None
    np.testing.assert_array_equal(lazy.rms.values, of_files.rms.values)
    days = ObjectStore(storage.url("days"))
    for file in results[0].files:
        days.write(file.name, (folder / file.name).read_bytes())
    days.write("fan/one/fan-20000101.nc", b"of a replay that was interrupted")
    days.write("fan/one/result.json", results[0].to_json())
    one = sw.open_archive(days.url, machine="fan", recording="one", variables=["rms"])
    xr.testing.assert_identical(one, of_files)
    with pytest.raises(sw.SpallwatchError, match="holds no records of fan/two"):
        sw.open_archive(days.url, machine="fan", recording="two")


def test_one_that_was_overtaken_does_not_complete_the_store(archive, tmp_path, small_chunks):
    folder, results = archive
    asked = []

    def confirm():
        asked.append((tmp_path / "a.zarr" / "zarr.json").exists())
        if len(asked) == 2:
            raise LeaseLostError("overtaken")

    with pytest.raises(LeaseLostError):
        write_archive(results, FolderStore(folder), str(tmp_path / "a.zarr"), confirm=confirm)
    assert asked == [False, False]
    assert not (tmp_path / "a.zarr" / "zarr.json").exists()
    assert content(tmp_path / "a.zarr")


def spoil(folder: Path, name: str, change) -> None:
    """Change the metadata of an array, in its own file and in those of the whole."""
    for path, places in (
        (folder / name / "zarr.json", ()),
        (folder / "zarr.json", ("consolidated_metadata", "metadata", name)),
    ):
        whole = json.loads(path.read_text())
        part = whole
        for place in places:
            part = part[place]
        change(part)
        path.write_text(json.dumps(whole))


LIES = {
    "another shape": ("rms", {"shape": [10**15, 2]}, "chunks, expected at most"),
    "a negative shape": ("rms", {"shape": [-1, 2]}, "shape"),
    "a giant chunk": (
        "rms",
        {"chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [10**9, 2]}}},
        "bytes, expected at most",
    ),
    "another type": ("rms", {"data_type": "float32"}, "states 64 bytes, expected 32"),
    "objects": ("rms", {"data_type": "object"}, "data type 'object'"),
    "another codec": ("rms", {"codecs": [{"name": "numcodecs.pickle"}]}, "by numcodecs.pickle"),
    "a list": ("rms", {"codecs": 7}, "TypeError"),
    "fewer dimensions": ("rms", {"shape": [4]}, "zip"),
}


@pytest.mark.parametrize("kind", LIES)
def test_metadata_that_lie_are_named_with_their_array(kind, read, tmp_path):
    name, values, words = LIES[kind]
    shutil.copytree(read / "records.zarr", tmp_path / "a.zarr")
    spoil(tmp_path / "a.zarr", name, lambda part: part.update(values))
    with pytest.raises(sw.SpallwatchError) as caught:
        sw.open_archive(tmp_path / "a.zarr", machine="press").compute()
    assert words in str(caught.value)
    assert str(tmp_path / "a.zarr") in str(caught.value)


def blosc_bomb(data: bytes) -> bytes:
    return data[:4] + (2**31 - 17).to_bytes(4, "little") + data[8:]


def zstd_bomb(data: bytes) -> bytes:
    return b"\x28\xb5\x2f\xfd\xe0" + (2**40).to_bytes(8, "little") + data[9:]


FILES = {
    "missing numbers": ("rms/c.2.0", None, "rms/c.2.0 is missing; archive replay --resume"),
    "missing texts": ("machine/c.0", None, "machine/c.0 is missing"),
    "empty": ("rms/c.2.0", lambda data: b"", "states None bytes"),
    "half": ("rms/c.2.0", lambda data: data[: len(data) // 2], "checksum"),
    "a changed bit": ("rms/c.2.0", lambda data: data[:40] + bytes([data[40] ^ 1]) + data[41:], "checksum"),
    "a bomb of numbers": ("rms/c.2.0", blosc_bomb, "states 2147483631 bytes, expected 64"),
    "a bomb of texts": ("machine/c.0", zstd_bomb, "states 1099511627776 bytes, expected at most"),
}


@pytest.mark.parametrize("kind", FILES)
def test_chunks_that_are_missing_changed_or_bombs_are_no_values(kind, read, tmp_path):
    file, change, words = FILES[kind]
    shutil.copytree(read / "records.zarr", tmp_path / "a.zarr")
    path = tmp_path / "a.zarr" / file
    data = path.read_bytes()
    path.unlink()
    if change is not None:
        path.write_bytes(change(data))
    with pytest.raises((sw.SpallwatchError, ValueError), match=words):
        sw.open_archive(tmp_path / "a.zarr").compute()
    with pytest.raises(sw.SpallwatchError, match=words):
        sw.open_archive(tmp_path / "a.zarr", machine="press", recording="two")


def test_a_table_that_names_rows_that_are_not_there_is_refused(archive, tmp_path, monkeypatch):
    real = zarr_store._row
    monkeypatch.setattr(zarr_store, "_row", lambda result, first: {**real(result, first), "row_size": 10**12})
    write(archive, tmp_path / "a.zarr")
    with pytest.raises(sw.SpallwatchError, match="the rows of press are not among the 12 that there are"):
        sw.open_archive(tmp_path / "a.zarr", machine="press")


def test_a_result_that_names_files_outside_is_refused(archive, tmp_path):
    shutil.copytree(archive[0] / "fan", tmp_path / "fan")
    result = json.loads((tmp_path / "fan/one/result.json").read_text())
    result["files"][0]["name"] = "../../secret.nc"
    (tmp_path / "fan/one/result.json").write_text(json.dumps(result))
    with pytest.raises(sw.SpallwatchError, match="leads out of the archive"):
        sw.open_archive(tmp_path, machine="fan", recording="one")
