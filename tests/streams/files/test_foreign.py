"""What is not read is named with what was seen in it; refusals and warnings of whole recordings."""

from __future__ import annotations

import bz2
import gzip
import io
import json
import sqlite3
import warnings
import zipfile
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

import spallwatch as sw
from monitor.commands.replay import command
from spallwatch.recordings import Reading
from streams.files.foreign import described, seen_in
from streams.open import open_source
from streams.recording.source import Recording
from streams.types.spec import ChannelSpec, SourceError, SourceSpec
from tests.streams.folders import csv_bytes, noise


def workbook() -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as packed:
        packed.writestr("[Content_Types].xml", "<Types/>")
        packed.writestr("xl/workbook.xml", "<workbook/>")
    return stream.getvalue()


def database(folder: Path) -> bytes:
    place = folder / "made.db"
    with sqlite3.connect(place) as made:
        made.execute("create table samples (x real)")
    made.close()
    data = place.read_bytes()
    place.unlink()
    return data


def frames() -> bytes:
    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        file["x"] = np.zeros(10)
    return stream.getvalue()


def arrays() -> bytes:
    stream = io.BytesIO()
    np.savez(stream, a=np.zeros(3), b=np.zeros(4))
    return stream.getvalue()


TABLE = b"1.0\n2.0\n" * 100
FILES = {
    "log.xlsx": (workbook(), "a file of xlsx", 'format = "xlsx"'),
    "log.csv": (workbook(), "Excel workbook", "end in .xlsx"),
    "old.xls": (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(500), "old or protected Office", "save it as .xlsx"),
    "log.feather": (b"ARROW1" + bytes(40), "Feather", "read_feather"),
    "log.txt": (b"PAR1" + bytes(40) + b"PAR1", "a file of parquet", 'format = "parquet"'),
    "run.raw": (b"|CF,2,1,1;|CK,", "imc FAMOS", "MAT"),
    "report.pdf": (b"%PDF-1.7\n%\xe2\xe3", "PDF", "recording that it is of"),
    "a.txt": (gzip.compress(TABLE), "gzip", "let its name end in .gz"),
    "b.csv": (bz2.compress(TABLE), "bzip2", ".bz2"),
    "run.d7d": (bytes(range(64)), "Dewesoft", "MAT"),
    "run.tdm": (b'<?xml version="1.0"?><usi:tdm/>', ".tdx", "export both as TDMS"),
    "run.dif": (b"TABLE\n0,1\n", "Data Interchange", "CSV"),
    "run.sie": (b"\x00\x00\x00\x6e\x00\x01", "SoMat", "InField"),
    "run.mf4": (b"MDF     4.10    ", "ASAM MDF", "asammdf"),
    "run.dat": (frames(), "hdf5", 'format = "hdf5"'),
    "arrays.npz": (arrays(), "arrays of numpy", "numpy.save"),
    "samples.bin": (noise(50).tobytes(), "without a header", 'side-car with their "layout"'),
}


@pytest.mark.parametrize("name", FILES)
def test_a_foreign_file_is_told_by_its_bytes_and_its_name(name: str) -> None:
    data, what, how = FILES[name]
    found = seen_in(name, data[:2048])
    assert found is not None
    assert what in found
    assert how in found
    words = described(name, len(data), data[:2048])
    assert words.startswith(f"{len(data)} bytes that begin with ")


@pytest.mark.parametrize("name", ["x.csv", "x.txt", "notes", "x.mat", "x.csv.gz"])
def test_what_says_nothing_else_is_left_to_its_reader(name: str) -> None:
    assert seen_in(name, gzip.compress(TABLE) if name.endswith(".gz") else TABLE) is None
    assert seen_in(name, b"") is None


def test_a_database_is_named(tmp_path: Path) -> None:
    assert "SQLite" in (seen_in("x.dat", database(tmp_path)) or "")


def test_a_folder_of_foreign_files_is_refused_with_what_was_seen(tmp_path: Path) -> None:
    for name in ("old.xls", "run.d7d", "a.txt"):
        (tmp_path / name).write_bytes(FILES[name][0])
    (tmp_path / "README.txt").write_text("Notes of the test\n", encoding="utf-8")
    with pytest.raises(SourceError) as refused:
        open_source(SourceSpec("s", f"folder:{tmp_path}"))
    for words in (
        "old or protected Office",
        "Dewesoft",
        "64 bytes that begin with 00 01 02",
        "Notes of the test",
        "text",
    ):
        assert words in str(refused.value)


def test_a_file_under_a_wrong_name_is_refused_with_what_it_is(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_bytes(workbook())
    with pytest.raises(sw.SpallwatchError, match=r"Excel workbook; let its name end in \.xlsx"):
        sw.read(tmp_path / "log.csv", unit="g", rate_hz=1000)


def test_ignored_files_say_what_they_are(tmp_path: Path) -> None:
    (tmp_path / "1.csv").write_bytes(csv_bytes(noise(100)))
    (tmp_path / "log.xlsx").write_bytes(workbook())
    (tmp_path / "notes.md").write_text("# Notes\n", encoding="utf-8")
    spec = SourceSpec("s", f"folder:{tmp_path}", rate=1000.0, block_s="file", channels=(ChannelSpec("x", unit="g"),))
    found = open_source(spec)
    assert isinstance(found, Recording)
    assert len(list(found)) == 1
    reasons = found.ignored()
    assert reasons["log.xlsx"].endswith('a file of xlsx, which a [[source]] with format = "xlsx" reads')
    assert reasons["notes.md"] == "of another format than csv (*.csv)"


def machine(folder: Path) -> Path:
    place = folder / "machine.toml"
    place.write_text(
        '[machine]\nname = "m"\nstate_dir = "state"\nrecords_dir = "records"\n\n[[bearing]]\nname = "b"\n'
        'designation = "6205"\n\n[operating]\nspeed_hz = 29.5\n\n[[source]]\nname = "s"\nurl = "folder:data"\n'
        'rate_hz = 4096\nblock_s = 1.0\n\n[[channel]]\nname = "c"\nsource = "s"\nbearing = "b"\ncolumn = 1\n'
        'unit = "g"\n',
        encoding="utf-8",
    )
    return place


def test_a_replay_says_why_the_reader_refused_each_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    data = tmp_path / "data"
    data.mkdir()
    (data / "a.lvm").write_bytes(b"".join(csv_bytes(noise(50)) + b"***End_of_Header***\n" for _ in range(2)))
    (data / "b.lvm").write_bytes(workbook())
    options = ["data", "--config", str(machine(tmp_path)), "--out", "o", "--no-report", "--json"]
    result = CliRunner().invoke(command, options)
    assert result.exit_code == 1, result.output
    told = json.loads(result.stdout)
    assert set(told["refused"]) == {"a.lvm", "b.lvm"}
    assert "line 51" in told["refused"]["a.lvm"]
    assert "Excel workbook" in told["refused"]["b.lvm"]
    assert told["warnings"][0].startswith("no block was accepted: ")
    assert "warning: no block was accepted" in result.stderr


def test_a_replay_of_files_that_are_too_short_warns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data").mkdir()
    for number in range(3):
        (tmp_path / f"data/{number}_{number}.csv").write_bytes(csv_bytes(noise(40, number)))
    with pytest.warns(sw.NothingAcceptedWarning, match="no block was accepted: .* short"):
        records = sw.replay(config=machine(tmp_path))
    assert set(records.status.values) == {"short"}
    rejected = sw.blocks(tmp_path / "data", unit="g", rate_hz=4096, block_s="file", skip_rejected=True)
    assert len(list(rejected)) == 3
    (tmp_path / "data/0_0.csv").write_bytes(workbook())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rest = sw.blocks(tmp_path / "data", unit="g", rate_hz=4096, block_s="file", skip_rejected=True)
        assert len(list(rest)) == 2
    for number in (1, 2):
        (tmp_path / f"data/{number}_{number}.csv").write_bytes(workbook())
    with pytest.warns(sw.NothingAcceptedWarning, match="Excel workbook"):
        assert list(sw.blocks(tmp_path / "data", channels=["x"], unit="g", rate_hz=4096, skip_rejected=True)) == []


@pytest.mark.parametrize(("unit", "factor"), [("mV", 1e-2), ("V", 10.0), ("mg", 1e-3), ("m/s^2", 1 / 9.80665)])
def test_units_are_read_in_the_words_of_init(unit: str, factor: float, tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_bytes(csv_bytes(noise(100)))
    how: Reading = {"unit": unit, "rate_hz": 1000.0}
    if unit.endswith("V"):
        how["sensitivity_mv_per_g"] = 100.0
    found = sw.read(tmp_path / "x.csv", **how)
    np.testing.assert_allclose(found.values[0] / 9.80665, noise(100) * factor, rtol=1e-6)


def test_a_table_of_pandas_with_speed_and_temperature_is_read_without_words(tmp_path: Path) -> None:
    table = pd.DataFrame({"Zeit [s]": np.arange(500) / 500.0, "Beschl. [g]": noise(500)})
    table["Drehzahl"], table["Temperatur"] = 1488.0, 61.5
    table.to_csv(tmp_path / "x.csv", sep=";", decimal=",", index=True, index_label="Nr.")
    found = sw.read(tmp_path / "x.csv")
    assert list(found.channel.values) == ["Beschl."]
    assert found.attrs["rate_hz"] == 500.0
