"""Samples recordings: milliseconds a file beside the error of the numbers, and whole archives.

Run as ``python -m benchmarks.readers [--quick] [--json FILE]``. Three tables:

1. one file of each kind, read by its reader and in other ways (a textbook split of lines, numpy.loadtxt), with the
   largest difference from the slow parse as a share of the largest sample: single precision rounds at 6e-8;
2. a block of 128,000 samples of one channel in each format: the bare library (no check of anything), our reader in this
   process, our reader as it is used (through the child process where the format is parsed there). The lowest wall-clock
   times, as two processes take turns; ``cpu_ms`` is the mean processor time of both together, which another load on
   the machine does not stretch; ``first_ms`` is the first file of a new child, with its start and the imports;
3. the PRONOSTIA archives of the recordings folder (SPALLWATCH_DATA, by default ../shared/data), each read in one pass;
   ``unpack_s`` is what decompression alone costs. Where the recordings are missing the table is left out.
"""

from __future__ import annotations

import io
import os
import time
from collections.abc import Callable
from pathlib import Path

import h5py
import nptdms
import numpy as np
import pandas as pd
import pyuff
import scipy.io
import soundfile
from numpy.typing import NDArray

from benchmarks.common import arguments, calibration_kernel, interleaved_ms, print_table, write_json
from streams.block import Block
from streams.datasets import DATA_SETS
from streams.files import Archive
from streams.open import open_source
from streams.readers.child import ReaderProcess, isolated, shared_process
from streams.readers.hdf5 import read_hdf5
from streams.readers.mat import read_mat
from streams.readers.netcdf import read_netcdf
from streams.readers.npy_wav import read_npy, read_wav
from streams.readers.tdms import read_tdms
from streams.readers.text import read_layout, read_text
from streams.readers.uff import read_uff
from streams.readers.worker import memory_file
from streams.samples import Samples
from streams.spec import SourceSpec
from tests.oracles.text_oracle import parse_slowly
from tests.streams.format_makers import MAKERS
from tests.streams.makers import ims_text, pronostia_csv

SAMPLES = 128_000

Floats = NDArray[np.floating]
Row = dict[str, float | str | None]
Reader = Callable[[bytes, str], Samples]
Way = tuple[str, str, Callable[[], Floats], Floats]
"""What is read, in which way, how, and the exact samples."""


def text_ways() -> list[Way]:
    """Text files: each kind by its reader, by numpy.loadtxt and by splitting lines."""
    pronostia, ims = pronostia_csv(1), ims_text(4)
    rng = np.random.default_rng(0)
    plain = "\n".join(f"{a!r},{b!r}" for a, b in rng.normal(size=(SAMPLES // 2, 2)).tolist()).encode() + b"\n"
    exact = parse_slowly(pronostia, ",")[4:], parse_slowly(ims, "\t"), parse_slowly(plain, ",")
    return [
        ("PRONOSTIA csv, 2560 x 6", "reader", lambda: DATA_SETS["pronostia"].read(pronostia, "x").values, exact[0]),
        (
            "PRONOSTIA csv, 2560 x 6",
            "numpy.loadtxt",
            lambda: np.loadtxt(io.BytesIO(pronostia), delimiter=",", usecols=(4, 5), dtype=np.float32).T,
            exact[0],
        ),
        ("PRONOSTIA csv, 2560 x 6", "split lines", lambda: parse_slowly(pronostia, ",")[4:], exact[0]),
        ("IMS text, 20480 x 4", "reader", lambda: DATA_SETS["ims"].read(ims, "x").values, exact[1]),
        ("IMS text, 20480 x 4", "numpy.loadtxt", lambda: np.loadtxt(io.BytesIO(ims), dtype=np.float32).T, exact[1]),
        ("csv of 17 digits, 64000 x 2", "reader", lambda: read_text(plain, "x").values, exact[2]),
        (
            "csv of 17 digits, 64000 x 2",
            "numpy.loadtxt",
            lambda: np.loadtxt(io.BytesIO(plain), delimiter=",").T,
            exact[2],
        ),
    ]  # fmt: skip


def binary_ways() -> list[Way]:
    """Binary files of 128,000 samples, one channel."""
    exact = np.round(np.random.default_rng(1).uniform(-1, 1, (1, SAMPLES)) * 2**22) / 2**23
    npy, wav, mat, packed = io.BytesIO(), io.BytesIO(), io.BytesIO(), io.BytesIO()
    np.save(npy, exact)
    soundfile.write(wav, exact.T, 25600, format="WAV", subtype="PCM_24")
    scipy.io.savemat(mat, {"x": exact})
    scipy.io.savemat(packed, {"x": exact}, do_compression=True)
    return [
        ("npy float64, 128000", "reader", lambda: read_npy(npy.getvalue(), "x").values, exact),
        ("wav 24 bit, 128000", "reader", lambda: read_wav(wav.getvalue(), "x").values, exact),
        ("mat, 128000", "reader", lambda: read_mat(mat.getvalue(), "x").values, exact),
        ("mat compressed, 128000", "reader", lambda: read_mat(packed.getvalue(), "x").values, exact),
    ]


def files_table(rounds: int) -> list[Row]:
    """Time every way and compare its numbers with the exact ones."""
    ways = [*text_ways(), *binary_ways()]
    times = interleaved_ms({f"{kind}|{way}": function for kind, way, function, _ in ways}, rounds)
    rows: list[Row] = []
    for kind, way, function, exact in ways:
        error = float(np.max(np.abs(function() - exact)) / np.max(np.abs(exact)))
        rows.append({"file": kind, "way": way, "ms": times[f"{kind}|{way}"], "error": error})
    return rows


def bare_ways(data: dict[str, bytes]) -> dict[str, Callable[[], object]]:
    """Each format by the library alone, as a short script would do it."""
    return {
        "x.npy": lambda: np.load(io.BytesIO(data["x.npy"]), allow_pickle=False),
        "x.wav": lambda: soundfile.read(io.BytesIO(data["x.wav"]), dtype="float32"),
        "x.flac": lambda: soundfile.read(io.BytesIO(data["x.flac"]), dtype="float32"),
        "x.csv": lambda: pd.read_csv(io.BytesIO(data["x.csv"]), skiprows=[0, 2], engine="c", dtype=np.float64),
        "x.mat": lambda: scipy.io.loadmat(io.BytesIO(data["x.mat"])),
        "x73.mat": lambda: _bare_hdf5(data["x73.mat"], "acc_1"),
        "x.h5": lambda: _bare_hdf5(data["x.h5"], "run/acc_1"),
        "x.nc": lambda: _bare_hdf5(data["x.nc"], "acc_1"),
        "x3.nc": lambda: scipy.io.netcdf_file(io.BytesIO(data["x3.nc"]), mmap=False).variables["acc_1"][:],
        "x.tdms": lambda: nptdms.TdmsFile.read(io.BytesIO(data["x.tdms"]))["run"]["acc_1"][:],
        "x.uff": lambda: _bare_uff(data["x.uff"]),
        "xb.uff": lambda: _bare_uff(data["xb.uff"]),
    }


def _bare_hdf5(data: bytes, key: str) -> object:
    with h5py.File(io.BytesIO(data), "r") as file:
        return file[key][()]  # pyright: ignore[reportIndexIssue]


def _bare_uff(data: bytes) -> object:
    with memory_file(data) as path:
        return pyuff.UFF(path).read_sets()


def our_ways() -> dict[str, tuple[Reader, bool]]:
    """The reader of each format, and whether it runs in the child process."""
    return {
        "x.npy": (read_npy, False),
        "x.wav": (read_wav, False),
        "x.flac": (read_wav, False),
        "x.csv": (read_layout, False),
        "x.mat": (read_mat, True),
        "x73.mat": (read_mat, True),
        "x.h5": (read_hdf5, True),
        "x.nc": (read_netcdf, True),
        "x3.nc": (read_netcdf, True),
        "x.tdms": (read_tdms, True),
        "x.uff": (read_uff, True),
        "xb.uff": (read_uff, True),
    }


FORMAT_NAMES = {
    "x.npy": "npy float64", "x.wav": "wav 24 bit", "x.flac": "flac 24 bit", "x.csv": "csv, times and 1 column",
    "x.mat": "mat v5", "x73.mat": "mat v7.3", "x.h5": "hdf5 float64", "x.nc": "netcdf-4 float32 and times",
    "x3.nc": "netcdf-3 float32 and times", "x.tdms": "tdms float64", "x.uff": "uff58 text", "xb.uff": "uff58b binary",
}  # fmt: skip


def formats_table(rounds: int) -> list[Row]:
    """Time every format in three ways, by the wall clock, the ways taking turns."""
    exact = np.round(np.random.default_rng(2).uniform(-0.9, 0.9, (1, SAMPLES)) * 1024) / 1024
    data = {name: make(exact) for name, make in MAKERS.items()}
    bare, ours = bare_ways(data), our_ways()
    rows: list[Row] = []
    for name, (reader, apart) in ours.items():
        ways: dict[str, Callable[[], object]] = {
            "library_ms": bare[name],
            "in_process_ms": lambda reader=reader, name=name: reader(data[name], name),
        }
        row: Row = {"format": FORMAT_NAMES[name], "child": "yes" if apart else "no", "megabytes": len(data[name]) / 1e6}
        used = isolated(reader) if apart else reader
        first: float | None = None
        if apart:
            with ReaderProcess() as fresh:
                began = time.perf_counter()
                fresh.call(reader, data[name], name)
                first = 1e3 * (time.perf_counter() - began)
            ways["as_used_ms"] = lambda used=used, name=name: used(data[name], name)
        count = max(3, rounds // 4) if name.endswith((".uff", ".csv")) else rounds
        times = wall_ms(ways, count)
        times.setdefault("as_used_ms", times["in_process_ms"])
        error = float(np.max(np.abs(used(data[name], name).values - exact)))
        cpu = cpu_ms(lambda used=used, name=name: used(data[name], name), count)
        over = times["as_used_ms"] - times["library_ms"]
        rows.append({**row, **times, "over_library_ms": over, "cpu_ms": cpu, "first_ms": first, "error": error})
    return rows


def wall_ms(functions: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Return the lowest wall-clock time of each function, ms; they take turns."""
    for function in functions.values():
        function()
    times: dict[str, list[float]] = {name: [] for name in functions}
    for _ in range(rounds):
        for name, function in functions.items():
            began = time.perf_counter()
            function()
            times[name].append(time.perf_counter() - began)
    return {name: 1e3 * min(values) for name, values in times.items()}


def cpu_ms(function: Callable[[], object], rounds: int) -> float:
    """Return the mean processor time of a call, ms, that of the shared child process included."""
    began = time.process_time() + _child_seconds()
    for _ in range(rounds):
        function()
    return 1e3 * (time.process_time() + _child_seconds() - began) / rounds


def _child_seconds() -> float:
    """Return the processor time of the child process so far, by the scheduler's own count in ns."""
    pid = shared_process().pid
    return 0.0 if pid is None else int(Path(f"/proc/{pid}/schedstat").read_text().split()[0]) * 1e-9


def archives_table(folder: Path, names: list[str]) -> list[Row]:
    """Read whole archives, and unpack them without reading their files."""
    rows: list[Row] = []
    for name in names:
        start = time.thread_time()
        for item in Archive(folder / name):
            item.read()
        unpacked = time.thread_time() - start
        start = time.thread_time()
        blocks = sum(isinstance(item, Block) for item in open_source(SourceSpec("bench", str(folder / name))))
        total = time.thread_time() - start
        per_file = 1e3 * (total - unpacked) / blocks
        rows.append(
            {"archive": name, "blocks": blocks, "s": total, "unpack_s": unpacked, "other_ms_per_file": per_file}
        )
    return rows


def main() -> None:
    """Print both tables and write them where asked."""
    options = arguments("Samples recordings: speed and error.")
    rounds = 7 if options.quick else 31
    calibration = interleaved_ms({"kernel": calibration_kernel()}, 101)["kernel"]
    print(f"calibration: one planned float32 real FFT of 128,000 samples takes {calibration:.3f} ms")
    files = files_table(rounds)
    print_table(f"one file, median thread time of {rounds}", files)
    formats = formats_table(rounds)
    print_table(f"one block of 128,000 samples, lowest wall-clock time of {rounds} (text formats fewer)", formats)
    folder = (
        Path(os.environ.get("SPALLWATCH_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data") / "femto"
    )
    names = ["Bearing2_7.tar.xz", "Bearing3_1.tar.xz", "Bearing2_4.tar.bz2", "Bearing1_1.tar.bz2"]
    present = [name for name in names[: 2 if options.quick else 4] if (folder / name).is_file()]
    archives = archives_table(folder, present)
    if archives:
        print_table("whole archives, thread time", archives)
    else:
        print("\nno recordings: SPALLWATCH_DATA names no folder with femto archives")
    write_json(
        options.json, {"calibration_ms": {"ms": calibration}, "files": files, "formats": formats, "archives": archives}
    )


if __name__ == "__main__":
    main()
