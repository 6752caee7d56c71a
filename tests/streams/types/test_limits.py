"""What a file may hold and cost: beyond a limit it is rejected, with both numbers, and not by this process."""

from __future__ import annotations

import gzip
import json
import re
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from streams.files import container as files
from streams.files.formats import hdf5, netcdf, npy_wav, numbers
from streams.files.formats.text import read_layout
from streams.files.parse import worker
from streams.open import open_source
from streams.types import large, limits
from streams.types.block import Block, Rejected
from streams.types.samples import ReaderError
from streams.types.spec import ChannelSpec, SourceSpec
from tests.streams.format_makers import MAKERS, RATE, signal
from tests.support.attacks import ATTACKS, hdf5_of, row_text, wide_text
from tests.support.effort import effort_count

SHARE = effort_count(quick=7, full=100) / 100
NUMBERS = re.compile(r"\d{3,}.*\d{2,}")


def verdict(path: Path, kind: str, **spec: object) -> Block | Rejected:
    """Return the first block of a recording of one file."""
    channels = (ChannelSpec("a", column=1, unit="g"),)
    values: dict[str, object] = {"block_s": "file", "rate": RATE, "channels": channels, "format": kind, **spec}
    return next(iter(open_source(SourceSpec("s", str(path), **values))))  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("name", ATTACKS)
def test_a_file_made_to_cost_much_gets_a_verdict(name: str, tmp_path: Path) -> None:
    kind, make, verdicts = ATTACKS[name]
    (tmp_path / name).write_bytes(make(SHARE))
    found = verdict(tmp_path / name, kind)
    status = found.status if isinstance(found, Rejected) else "read"
    assert status in verdicts, found
    if isinstance(found, Rejected):
        assert name in found.reason
        assert len(found.reason) < 2000
        assert status != "refused" or NUMBERS.search(found.reason.replace(name, "")), found.reason


def test_nothing_but_plain_arrays_is_parsed_in_this_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*arguments: object, **more: object) -> None:
        raise AssertionError("called in the parent")

    names = ("x.csv", "x.wav", "x.flac")
    for name in names:
        (tmp_path / name).write_bytes(MAKERS[name](signal(2, 600)))
    for module, function in ((numbers, "_parse_with_pandas"), (npy_wav, "read_wav"), (npy_wav, "read_npy")):
        monkeypatch.setattr(module, function, never)
    monkeypatch.setattr(npy_wav.soundfile, "SoundFile", never)
    monkeypatch.setattr(files, "unpack", never)
    for name in names:
        channels = (ChannelSpec("a", column=2 if name != "x.csv" else "acc_2", unit="g", scale=1.0),)
        kind = name.partition(".")[2].replace("flac", "wav")
        assert isinstance(verdict(tmp_path / name, kind, channels=channels), Block)


def test_a_block_as_one_row(tmp_path: Path) -> None:
    data = row_text()
    (tmp_path / "row.csv").write_bytes(data)
    found = verdict(tmp_path / "row.csv", "csv")
    assert isinstance(found, Block)
    assert_allclose(found.samples, np.sin(np.arange(128_000) * 0.1)[np.newaxis], atol=1e-4)
    np.save(tmp_path / "row.npy", found.samples)
    array = verdict(tmp_path / "row.npy", "npy")
    assert isinstance(array, Block)
    assert_array_equal(array.samples, found.samples)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (";".join(["1,5"] * 300), 1.5),
        ("rate_hz: 25600\nx\n" + "\t".join(["-2.5"] * 300) + "\r\n", -2.5),
        (" ".join(["3"] * 300) + "\n\n", 3.0),
    ],
)
def test_rows_of_other_dialects(text: str, expected: float) -> None:
    samples = read_layout(text.encode(), "x.csv")
    assert_array_equal(samples.values, np.full((1, 300), expected))


def test_a_row_is_not_guessed() -> None:
    assert read_layout(b"1,2,3\n", "x.csv").values.shape == (3, 1)
    assert read_layout(wide_text(1.0, lines=2, columns=300), "x.csv").values.shape == (300, 2)
    with pytest.raises(ReaderError, match="5000 columns, 4096 are allowed") as caught:
        read_layout(wide_text(1.0, lines=2, columns=5000), "x.csv")
    assert caught.value.status == "refused"
    with pytest.raises(ReaderError, match="line 1, column 300: expected a number, found ''"):
        read_layout(wide_text(1.0, lines=1, columns=299)[:-1] + b",,1.0\n", "x.csv")


def test_blocks_of_one_file_are_limited(tmp_path: Path) -> None:
    zeros = hdf5_of(lambda file: file.create_dataset("x", data=np.zeros(2_000_000), compression="gzip"))
    (tmp_path / "x.h5").write_bytes(zeros)
    found = verdict(tmp_path / "x.h5", "hdf5", block_s=0.01)
    assert isinstance(found, Rejected)
    assert found.status == "refused"
    assert f"7812 blocks of 0.01 s, 1000 are allowed for {len(zeros)} bytes" in found.reason
    assert isinstance(verdict(tmp_path / "x.h5", "hdf5", block_s=0.1), Block)


def test_too_many_vectors_are_refused_before_any_is_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    looked: list[object] = []
    attributes = hdf5.attributes

    def noted(item: Any) -> dict[str, object]:
        looked.append(item)
        return attributes(item)

    monkeypatch.setattr(hdf5, "attributes", noted)
    monkeypatch.setattr(hdf5, "load", lambda *_: pytest.fail("a vector was loaded"))
    monkeypatch.setattr("streams.types.samples.MAX_ROWS", 10)

    def fill(file: Any) -> None:
        for number in range(40):
            file[f"d{number:02d}"] = np.array([0.5, 1.5])

    with pytest.raises(ReaderError, match="11 vectors, 10 are allowed"):
        hdf5.read_hdf5(hdf5_of(fill), "x.h5")
    # Those of the file, and of eleven data sets.
    assert len(looked) == 12


def test_a_large_sidecar_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_bytes(MAKERS["x.csv"](signal(2, 600)))
    (tmp_path / "x.csv.json").write_text(json.dumps({"speed_hz": 30, "unit": "g" + " " * 70_000}))
    found = verdict(tmp_path / "x.csv", "csv")
    assert isinstance(found, Rejected)
    assert (found.status, "65536 are allowed" in found.reason) == ("refused", True)


def rows_of_counts() -> bytes:
    def fill(file: Any) -> None:
        for number in range(4):
            file[f"d{number}"] = np.arange(1000, dtype=np.int16)

    return hdf5_of(fill)


def scaled_counts() -> bytes:
    file = netCDF4.Dataset("a.nc", "w", format="NETCDF3_CLASSIC", memory=1024)
    file.createDimension("time", 4000)
    item = file.createVariable("d", "i2", ("time",))
    item.set_auto_maskandscale(False)
    item[:] = np.arange(4000)
    item.scale_factor = 0.5
    return bytes(file.close())


@pytest.mark.parametrize(
    ("reader", "make", "size"),
    [(hdf5.read_hdf5, rows_of_counts, 4 * 1000 * 4), (netcdf.read_netcdf, scaled_counts, 4000 * 8)],
)
@pytest.mark.parametrize("in_memory", [1000, 1 << 20])
def test_samples_beyond_what_the_child_may_write_are_refused(
    reader: Any, make: Any, size: int, in_memory: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(large, "MAX_IN_MEMORY", in_memory)
    for module in (large, worker):
        monkeypatch.setattr(module, "MAX_BYTES", size - 1)
    reserved, reserve = [0], large.reserve
    monkeypatch.setattr(large, "reserve", lambda handle, room: (reserved.append(room), reserve(handle, room)))
    monkeypatch.setattr(worker, "write_at", lambda *_: pytest.fail("it was written"))
    path = tmp_path / "a"
    path.write_bytes(make())
    request = {"module": reader.__module__, "function": reader.__name__, "name": "a", "arguments": [], "memory": 1}
    answer = worker._answer({**request, "size": path.stat().st_size, "path": str(path)}, -1, -1)
    assert answer == {"status": "refused", "reason": f"a: {size} bytes when loaded, {size - 1} are allowed"}
    assert max(reserved) < size


def test_no_more_is_unpacked_to_disk_than_is_allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(large, "MAX_IN_MEMORY", 1000)
    written: list[int] = []
    write = large.write_whole
    monkeypatch.setattr(large, "write_whole", lambda handle, part: (written.append(len(part)), write(handle, part)))
    packed = gzip.compress(np.random.default_rng(1).bytes(5000))
    with pytest.raises(ReaderError, match="become more than 4999 when unpacked") as caught:
        files.unpack(packed, "a.gz", 4999)
    assert caught.value.status == "refused"
    assert sum(written) == 4999
    assert len(files.unpack(packed, "a.gz", 5000)) == 5000


def test_limits_grow_with_the_file() -> None:
    assert [limits.max_loaded_bytes(size) for size in (1, 1 << 20, 1 << 30)] == [64 << 20, 100 << 20, 1 << 30]
    assert [limits.max_blocks(size) for size in (1, 2 << 20, 1 << 30)] == [1000, 2048, 20_000]
    assert limits.ChildLimits().cpu_s_for(64 << 20) == 8
    assert limits.ChildLimits().memory_for(1) == (1 << 30) + 6 * (64 << 20)
