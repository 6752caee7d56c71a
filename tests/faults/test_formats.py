"""The matrix of bad input times every format that can carry it: the verdict is as expected, and nothing stops.

One folder a format holds good files and one file for each fault. It goes through the whole pipeline twice, as a
recording and as a watched folder; every file must be in the ledger with its verdict, or still wait where it may.
"""

from __future__ import annotations

import io
import json
import struct
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

from monitor.config.load import Config, validate
from monitor.records.store import Store
from monitor.service.ingest import Ingest
from monitor.service.replay import replay
from streams.types.listing import unshown
from tests.streams.format_makers import (
    MAKERS,
    RATE,
    STATES_RATE,
    STATES_START,
    STATES_UNIT,
    csv_bytes,
    hdf5_bytes,
    netcdf_bytes,
    signal,
    sound_bytes,
    table_bytes,
    tdms_bytes,
    uff_bytes,
    xlsx_bytes,
)
from tests.streams.table_makers import parquet_bytes
from tests.support.effort import effort_count
from tests.support.waiting import Stall

LENGTH = 4096
SOUND = {"x.wav", "x.flac"}
FLOATS = [name for name in MAKERS if name not in SOUND]

Maker = Callable[[str, int], bytes]
"""From the name of a kind of file and a seed to the bytes of one."""


@dataclass(frozen=True)
class Case:
    """A fault: the formats that can carry it, how the file is made, and the verdicts that may be given."""

    formats: list[str]
    make: Maker
    verdicts: set[str]
    sidecar: str | None = None
    name: str | None = None


def good(name: str, seed: int = 3) -> bytes:
    return MAKERS[name](signal(2, LENGTH, seed))


def changed(change: Callable[[NDArray[np.floating]], object], length: int = LENGTH, rows: int = 2) -> Maker:
    def make(name: str, seed: int) -> bytes:
        samples = signal(rows, length, seed)
        change(samples)
        return MAKERS[name](samples)

    return make


def one(value: float) -> Callable[[NDArray[np.floating]], object]:
    return lambda samples: samples.__setitem__((1, 100), value)


def cut(share: float) -> Maker:
    return lambda name, seed: good(name, seed)[: int(share * len(good(name, seed)))]


def corrupt(name: str, seed: int) -> bytes:
    """Nonsense over the head, where the formats say what they are."""
    data = bytearray(good(name, seed))
    # In front of the HDF5 file that a MAT file of version 7.3 is, there is only a greeting.
    begin = 512 if name == "x73.mat" else 0
    data[begin : begin + 160] = np.random.default_rng(0).integers(0, 256, 160, dtype=np.uint8).tobytes()
    return bytes(data)


def huge(name: str, seed: int) -> bytes:
    """A header that claims far more than there is, and than anybody has memory for."""
    data = bytearray(good(name, seed))
    if name == "x.npy":
        return bytes(data).replace(b"'shape': (2, 4096), }        ", b"'shape': (2, 99999999999), } ", 1)
    if name == "x.wav":
        data[40:44] = struct.pack("<I", 0xFFFFFFF0)
    elif name == "x.flac":
        data[21] |= 0x0F
        data[22:26] = b"\xff\xff\xff\xff"
    elif name == "x.tdms":
        data[12:20] = struct.pack("<Q", 1 << 50)
    elif name.endswith(".uff"):
        return bytes(data).replace(f"{LENGTH:10d}".encode(), b"1999999999", 1)
    elif name in ("x.h5", "x.nc", "x73.mat"):
        return _huge_hdf5(name)
    elif name == "x.mat":
        data[132:136] = struct.pack("<I", 0x7FFFFFF0)
    elif name == "x.xlsx":
        place = data.index(b"PK\1\2") + 24
        data[place : place + 4] = struct.pack("<I", 0x7FFFFFFF)
    elif name == "x.parquet":
        return parquet_bytes({key: np.zeros(10_000_000, np.int8) for key in ("acc_1", "acc_2")})
    elif name == "x3.nc":
        place = data.index(b"\0\0\0\x0a") + 8
        place = data.index(struct.pack(">I", LENGTH), place)
        data[place : place + 4] = struct.pack(">I", 0x7FFFFFFF)
    return bytes(data)


def _huge_hdf5(name: str) -> bytes:
    stream = io.BytesIO()
    with h5py.File(stream, "w", userblock_size=512 if name == "x73.mat" else 0) as file:
        for key in ("acc_1", "acc_2"):
            file.create_dataset(key, (10**11,), "f8", chunks=(1000,)).attrs["MATLAB_class"] = np.bytes_("double")
    data = bytearray(stream.getvalue())
    if name == "x73.mat":
        data[:128] = b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM"
    return bytes(data)


MAKE_AT = {
    "x.tdms": tdms_bytes, "x.h5": hdf5_bytes, "x.uff": uff_bytes, "x.nc": netcdf_bytes, "x.csv": csv_bytes,
    "x.xlsx": xlsx_bytes, "x.parquet": table_bytes,
    "xb.uff": lambda samples, **how: uff_bytes(samples, binary=True, **how),
    "x3.nc": lambda samples, **how: netcdf_bytes(samples, kind="NETCDF3_CLASSIC", **how),
    "x.wav": lambda samples, rate: sound_bytes(samples, "WAV", rate),
    "x.flac": lambda samples, rate: sound_bytes(samples, "FLAC", rate),
}  # fmt: skip


def rewritten(change: Callable[[bytes], bytes]) -> Maker:
    return lambda name, seed: change(csv_bytes(signal(2, LENGTH, seed)))


def decimal_comma(data: bytes) -> bytes:
    return data.replace(b",", b";").replace(b".", b",")


def started(stamp: str) -> dict[str, str]:
    return {"sidecar": json.dumps({"start_utc": stamp})}


CSV = ["x.csv"]
UNDATED = [name for name in MAKERS if name not in STATES_START]
CASES: dict[str, Case] = {
    "empty": Case(list(MAKERS), lambda name, seed: b"", {"empty"}),
    "half": Case([n for n in MAKERS if n != "x.csv"], cut(0.45), {"incomplete", "unreadable"}),
    "half_a_text": Case(CSV, cut(0.5), {"incomplete", "short", "wrong_shape"}),
    "corrupt": Case(list(MAKERS), corrupt, {"unreadable", "incomplete", "empty"}),
    "huge": Case([n for n in MAKERS if n != "x.csv"], huge, {"refused", "incomplete", "unreadable"}),
    "nan": Case(FLOATS, changed(one(np.nan)), {"nan"}),
    "inf": Case(FLOATS, changed(one(np.inf)), {"nan"}),
    "e308": Case([n for n in FLOATS if n not in ("x.nc", "x3.nc")], changed(one(1e308)), {"nan", "out_of_range"}),
    "constant": Case(list(MAKERS), changed(lambda s: s.fill(0.25)), {"flat"}),
    "clipped": Case(FLOATS, changed(lambda s: np.clip(s * 100, -50, 50, out=s)), {"clipped"}),
    "too_large": Case(FLOATS, changed(lambda s: np.multiply(s, 1e4, out=s)), {"out_of_range"}),
    "wrong_rate": Case(
        sorted(STATES_RATE), lambda n, seed: MAKE_AT[n](signal(2, LENGTH, seed), rate=20000.0), {"wrong_rate"}
    ),
    "wrong_length": Case(list(MAKERS), changed(lambda s: None, LENGTH // 2), {"short"}),
    "wrong_channel_count": Case(list(MAKERS), changed(lambda s: None, rows=1), {"wrong_shape"}),
    "scale_overflow": Case(FLOATS, good, {"nan", "out_of_range"}, sidecar='{"scale": 1e307}'),
    "wrong_unit": Case(sorted(STATES_UNIT), lambda n, s: MAKE_AT[n](signal(2, LENGTH, s), unit="Pa"), {"wrong_unit"}),
    "wrong_unit_beside": Case(list(MAKERS), good, {"wrong_unit"}, sidecar='{"unit": "m/s2"}'),
    "bad_sidecar": Case(list(MAKERS), good, {"unreadable"}, sidecar='{"rate": 25600}'),
    "bom": Case(CSV, rewritten(lambda data: b"\xef\xbb\xbf" + data), {"ok"}),
    "decimal_comma": Case(CSV, rewritten(decimal_comma), {"ok"}),
    "crlf": Case(CSV, rewritten(lambda data: data.replace(b"\n", b"\r\n")), {"ok"}),
    "utf16": Case(CSV, rewritten(lambda data: data.decode().encode("utf-16")), {"ok"}),
    "utf16_without_mark": Case(CSV, rewritten(lambda data: data.decode().encode("utf-16-le")), {"unreadable"}),
    "future": Case(UNDATED, good, {"ok", "clock", "gap"}, **started("2099-01-01T00:00:00Z")),
    "year_1970": Case(UNDATED, good, {"clock"}, **started("1970-01-01T00:00:01Z")),
    "name": Case(list(MAKERS), good, {"ok"}, name="90_<img src=x onerror=alert(1)>\n&amp;"),
}  # fmt: skip
"""What is wrong, by its name."""


def test_every_fault_is_carried_by_some_format() -> None:
    assert all(case.formats for case in CASES.values())
    assert {name for case in CASES.values() for name in case.formats} == set(MAKERS)


def write_matrix(name: str, folder: Path) -> dict[str, set[str]]:
    """Write all files of a kind, no two of the same content, and return the verdicts that each may get."""
    folder.mkdir()
    ending = Path(name).suffix
    # All files of a kind that is dated bear the same date, which is a flag from the second on.
    fine = {"ok", "clock"} if name in STATES_START else {"ok"}
    expected: dict[str, set[str]] = {}

    def put(stem: str, data: bytes, verdicts: set[str], sidecar: str | None = None) -> None:
        if sidecar is not None:
            (folder / f"{stem}{ending}.json").write_text(sidecar)
        (folder / f"{stem}{ending}").write_bytes(data)
        expected[f"{stem}{ending}"] = fine if verdicts == {"ok"} else verdicts

    put("00_good", good(name, 100), {"ok"})
    for number, (fault, case) in enumerate(CASES.items(), start=1):
        if name in case.formats:
            put(case.name or f"{number:02d}_{fault}", case.make(name, number), case.verdicts, case.sidecar)
    put("99_good", good(name, 101), {"ok", "clock", "gap"})
    return expected


def configured(name: str, folder: Path, block_s: float | str) -> Config:
    source = {
        "name": "s",
        "url": f"folder:{folder}",
        "block_s": block_s,
        "rate_hz": RATE,
        "range_g": 50,
        "settle_s": 0.1,
    }
    column = "acc_2" if name not in ("x.npy", "x.wav", "x.flac") else 2
    channel = {
        "name": "de",
        "source": "s",
        "column": column,
        "unit": "g",
        "bearing": "b",
        "band_hz": [[2000, 6000]],
    }
    values = {
        "machine": {"name": "matrix"},
        "bearing": [{"name": "b", "designation": "6205"}],
        "operating": {"speed_hz": 30.0},
        "source": [source],
        "channel": [channel],
    }
    return validate(values, Path("machine.toml"))


@pytest.mark.parametrize("name", MAKERS)
def test_matrix_in_a_recording(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if name not in CSV and effort_count(quick=1, full=0):
        # A file of records takes as long as all the blocks, and does not depend on the format.
        monkeypatch.setattr("monitor.service.replay.publish", lambda store, folder: [])
    expected = write_matrix(name, tmp_path / "recording")
    config = configured(name, tmp_path / "recording", LENGTH / RATE)
    done = replay(config, None, tmp_path / "out")
    summary = done.summary
    assert summary["blocks"] == len(expected)
    assert summary["pending"] == 0
    assert summary["accepted"] + sum(summary["rejected"].values()) == len(expected)
    with Store.open(done.store_path, machine="matrix", create=False) as store:
        found = {unshown(record.name): record for record in store.records()}
    assert set(found) == set(expected)
    wrong = {
        key: f"{found[key].status}: {found[key].reason}" for key in expected if found[key].status not in expected[key]
    }
    assert wrong == {}


@pytest.mark.parametrize("name", MAKERS)
def test_matrix_in_a_watched_folder(name: str, tmp_path: Path) -> None:
    expected = write_matrix(name, tmp_path / "watched")
    # What may still become whole waits, and is given up after ten minutes only; a block is a file here, of any length.
    waiting = {"empty", "incomplete", "refused", "unreadable"}
    config = configured(name, tmp_path / "watched", "file")
    with Store.open(tmp_path / "state.db", machine="matrix") as store:
        with Ingest.open(config, store) as ingest:
            stall = Stall(lambda: (ingest.backlogs()["s"].accepted, ingest.backlogs()["s"].rejected))
            quiet = 0
            while quiet < 8:
                stall.check()
                quiet = 0 if ingest.step(threading.Event()) is not None else quiet + 1
            backlog = ingest.backlogs()["s"]
            assert ingest.problems() == {}
        found = {unshown(record.name): record for record in store.records()}
    assert backlog.offered == len(expected)
    assert backlog.offered == backlog.accepted + backlog.rejected + backlog.pending
    pending = set(expected) - set(found)
    assert len(pending) == backlog.pending
    assert {key: expected[key] for key in pending if not expected[key] & waiting} == {}
    wrong = {
        key: f"{record.status}: {record.reason}"
        for key, record in found.items()
        if record.status not in (expected[key] if expected[key] != {"short"} else {"ok", "clock"})
    }
    assert wrong == {}
    if name not in STATES_START:
        future = next(record for key, record in found.items() if "future" in key)
        assert "clock" in future.flags
