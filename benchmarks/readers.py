"""Reading recordings: milliseconds a file beside the error of the numbers, and whole archives.

Run as ``python -m benchmarks.readers [--quick] [--json FILE]``. Two tables:

1. one file of each kind, read by its reader and in other ways (a textbook split of lines, numpy.loadtxt), with the
   largest difference from the slow parse as a share of the largest sample: single precision rounds at 6e-8;
2. the PRONOSTIA archives of the recordings folder (SPALLWATCH_DATA, by default ../shared/data), each read in one pass;
   ``unpack_s`` is what decompression alone costs. Where the recordings are missing the table is left out.
"""

from __future__ import annotations

import io
import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import scipy.io
import soundfile
from numpy.typing import NDArray

from benchmarks.common import arguments, calibration_kernel, interleaved_ms, print_table, write_json
from streams.block import Block
from streams.dataset import DATA_SETS
from streams.files import Archive
from streams.readers.mat import read_mat
from streams.readers.npy import read_npy
from streams.readers.text import read_text
from streams.readers.wav import read_wav
from streams.source import SourceSpec, open_source
from tests.oracles.text_oracle import parse_slowly
from tests.streams.makers import ims_text, pronostia_csv

SAMPLES = 128_000

Floats = NDArray[np.floating]
Row = dict[str, float | str | None]
Way = tuple[str, str, Callable[[], Floats], Floats]
"""What is read, in which way, how, and the exact samples."""


def text_ways() -> list[Way]:
    """Text files: each kind by its reader, by numpy.loadtxt and by splitting lines."""
    pronostia, ims = pronostia_csv(1), ims_text(4)
    rng = np.random.default_rng(0)
    plain = "\n".join(f"{a!r},{b!r}" for a, b in rng.normal(size=(SAMPLES // 2, 2)).tolist()).encode() + b"\n"
    exact = parse_slowly(pronostia, ",")[4:], parse_slowly(ims, "\t"), parse_slowly(plain, ",")
    return [
        ("PRONOSTIA csv, 2560 x 6", "reader", lambda: DATA_SETS["pronostia"].read(pronostia, "x").samples, exact[0]),
        (
            "PRONOSTIA csv, 2560 x 6",
            "numpy.loadtxt",
            lambda: np.loadtxt(io.BytesIO(pronostia), delimiter=",", usecols=(4, 5), dtype=np.float32).T,
            exact[0],
        ),
        ("PRONOSTIA csv, 2560 x 6", "split lines", lambda: parse_slowly(pronostia, ",")[4:], exact[0]),
        ("IMS text, 20480 x 4", "reader", lambda: DATA_SETS["ims"].read(ims, "x").samples, exact[1]),
        ("IMS text, 20480 x 4", "numpy.loadtxt", lambda: np.loadtxt(io.BytesIO(ims), dtype=np.float32).T, exact[1]),
        ("csv of 17 digits, 64000 x 2", "reader", lambda: read_text(plain, "x").samples, exact[2]),
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
        ("npy float64, 128000", "reader", lambda: read_npy(npy.getvalue(), "x").samples, exact),
        ("wav 24 bit, 128000", "reader", lambda: read_wav(wav.getvalue(), "x").samples, exact),
        ("mat, 128000", "reader", lambda: read_mat(mat.getvalue(), "x").samples, exact),
        ("mat compressed, 128000", "reader", lambda: read_mat(packed.getvalue(), "x").samples, exact),
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
    options = arguments("Reading recordings: speed and error.")
    rounds = 7 if options.quick else 31
    calibration = interleaved_ms({"kernel": calibration_kernel()}, 101)["kernel"]
    print(f"calibration: one planned float32 real FFT of 128,000 samples takes {calibration:.3f} ms")
    files = files_table(rounds)
    print_table(f"one file, median thread time of {rounds}", files)
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
    write_json(options.json, {"calibration_ms": {"ms": calibration}, "files": files, "archives": archives})


if __name__ == "__main__":
    main()
