from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from streams.files.datasets import POUND_FORCE
from streams.open import open_source
from streams.types.block import Block, Rejected
from streams.types.spec import ChannelSpec, SourceSpec
from tests.oracles.text_oracle import parse_slowly
from tests.streams.makers import ims_text, mat_file, packed, pronostia_csv


def blocks(path: Path | str, **settings: Any) -> list[Block | Rejected]:
    return list(open_source(SourceSpec("test", str(path), **settings)))


def good(items: list[Block | Rejected]) -> list[Block]:
    kept = [item for item in items if isinstance(item, Block)]
    assert len(kept) == len(items), [item for item in items if isinstance(item, Rejected)]
    return kept


@pytest.mark.parametrize("separator", [",", ";"])
def test_pronostia_folder(tmp_path: Path, separator: str) -> None:
    folder = tmp_path / "Bearing2_9"
    folder.mkdir()
    for number in (1, 2, 3, 10):
        (folder / f"acc_{number:05d}.csv").write_bytes(pronostia_csv(number, separator))
    (folder / "temp_00001.csv").write_text("9,10,1,0,65.2\n")
    found = good(blocks(folder, start=1e9))
    assert [block.sequence for block in found] == [1, 2, 3, 10]
    assert [block.elapsed for block in found] == [0, 10, 20, 90]
    assert [block.start for block in found] == [1e9, 1e9 + 10, 1e9 + 20, 1e9 + 90]
    last = found[-1]
    assert (last.rate, last.speed, last.load) == (25600, 27.5, 4200)
    assert (last.channels, last.units, last.name) == (("horizontal", "vertical"), ("g", "g"), "acc_00010.csv")
    assert last.samples.dtype == np.float32
    expected = parse_slowly(pronostia_csv(10, separator), separator)[4:]
    assert_array_equal(last.samples, expected.astype(np.float32))
    assert len({block.content_hash for block in found}) == 4
    assert {len(block.content_hash) for block in found} == {32}


def test_pronostia_without_a_date_has_no_utc(tmp_path: Path) -> None:
    (tmp_path / "acc_00007.csv").write_bytes(pronostia_csv(7))
    (block,) = good(blocks(tmp_path / "acc_00007.csv", block_s="file"))
    assert (block.sequence, block.start, block.elapsed, block.speed) == (7, None, 60, None)


def test_columns_of_the_file_and_names_of_the_set_find_the_same_row(tmp_path: Path) -> None:
    (tmp_path / "acc_00001.csv").write_bytes(pronostia_csv(1))
    channels = (ChannelSpec("vertical"), ChannelSpec("v2", column=6), ChannelSpec("h", key="column_5", unit="g"))
    (block,) = good(blocks(tmp_path, channels=channels))
    assert block.channels == ("vertical", "v2", "h")
    assert_array_equal(block.samples[0], block.samples[1])
    assert block.samples[2, 0] == 1


@pytest.mark.parametrize(
    ("data", "status", "words"),
    [
        (b"", "empty", "0 bytes"),
        (b"\n\n", "empty", "no line"),
        (pronostia_csv(2, rows=2000), "short", "2000 samples, 2560 were expected"),
        (pronostia_csv(2, rows=2561), "wrong_shape", "2561 samples"),
        (pronostia_csv(2)[:-9], "incomplete", "line 2560"),
        (b"h,m,s,us,x,y\n" + pronostia_csv(2), "unreadable", "line 1, column 1"),
        (b"garbage\n" * 2560, "unreadable", "line 1, column 1: expected a number, found 'garbage'"),
        (pronostia_csv(2).replace(b"\n", b",1\n"), "wrong_shape", "expected 6 columns, found 7"),
        (pronostia_csv(2)[:40000] + b"\n1,2\n" + pronostia_csv(2)[40000:], "wrong_shape", "line"),
        (bytes(range(256)) * 100, "unreadable", "binary"),
    ],
)
def test_pronostia_wrong_file_is_rejected_in_its_place(tmp_path: Path, data: bytes, status: str, words: str) -> None:
    for number in (1, 2, 3):
        (tmp_path / f"acc_{number:05d}.csv").write_bytes(data if number == 2 else pronostia_csv(number))
    source = open_source(SourceSpec("test", str(tmp_path)))
    first, wrong, last = list(source)
    assert isinstance(first, Block)
    assert isinstance(last, Block)
    assert isinstance(wrong, Rejected)
    assert (wrong.sequence, wrong.status, wrong.source) == (2, status, "test")
    assert words in wrong.reason
    assert "acc_00002.csv" in wrong.reason
    assert len(source) == 3


def test_nearly_whole_snapshot_and_not_a_number_are_passed_on(tmp_path: Path) -> None:
    text = pronostia_csv(1, rows=2400).replace(b"9,10,1,0.0000e+00,1.000,", b"9,10,1,0.0000e+00,nan,")
    (tmp_path / "acc_00001.csv").write_bytes(text)
    (block,) = good(blocks(tmp_path))
    assert block.samples.shape == (2, 2400)
    assert np.isnan(block.samples[0, 0])
    assert np.isfinite(block.samples[0, 1:]).all()


def test_ims_stamps_are_local_times(tmp_path: Path) -> None:
    (tmp_path / "2004.02.12.10.42.39").write_bytes(ims_text(4))
    packed(tmp_path / "2004.02.12.10.32.39.xz", ims_text(4))
    (tmp_path / "2004.99.12.10.32.39").write_bytes(b"no such month, so no recording")
    utc = good(blocks(tmp_path))
    stamp = datetime(2004, 2, 12, 10, 32, 39, tzinfo=UTC).timestamp()
    assert [block.start for block in utc] == [stamp, stamp + 600]
    assert [block.elapsed for block in utc] == [0, 600]
    assert [block.sequence for block in utc] == [1, 2]
    assert (utc[0].rate, utc[0].load, utc[0].units) == (20000, 6000 * POUND_FORCE, ("g",) * 4)
    assert_array_equal(utc[1].samples, parse_slowly(ims_text(4), None).astype(np.float32))
    cincinnati = good(blocks(f"dataset:IMS:{tmp_path}", timezone="America/New_York"))
    assert cincinnati[0].start == stamp + 5 * 3600


def test_ims_has_four_or_eight_columns(tmp_path: Path) -> None:
    (tmp_path / "2003.10.22.12.06.24").write_bytes(ims_text(8))
    (tmp_path / "2003.10.22.12.09.13").write_bytes(ims_text(5))
    first, second = blocks(tmp_path, channels=(ChannelSpec("b4", column=8),))
    assert isinstance(first, Block)
    assert first.samples.shape == (1, 20480)
    assert isinstance(second, Rejected)
    assert (second.status, second.sequence) == ("wrong_shape", 2)


def cwru_values(number: int, samples: int = 24000) -> dict[str, Any]:
    rng = np.random.default_rng(number)
    values: dict[str, Any] = {f"X{number:03d}_{end}_time": rng.normal(size=(samples, 1)) for end in ("DE", "FE")}
    return values | {f"X{number:03d}RPM": np.array([[1797]], dtype=np.uint16)}


@pytest.mark.parametrize(
    ("file_name", "rate"),
    [("97_Normal_0.mat", 48000), ("105_0.mat", 12000), ("130@6_0.mat", 12000), ("109.mat", 48000), ("3001.mat", 12000)],
)
def test_cwru_rate_is_in_the_table_and_speed_in_the_file(tmp_path: Path, file_name: str, rate: float) -> None:
    number = int(file_name.split("_")[0].split("@")[0].split(".")[0])
    values = cwru_values(number)
    (block,) = good(blocks(mat_file(tmp_path / file_name, values), block_s="file"))
    assert (block.rate, block.speed, block.units) == (rate, 1797 / 60, ("g", "g"))
    assert block.channels == ("drive_end", "fan_end")
    assert_array_equal(block.samples[1], np.ravel(values[f"X{number:03d}_FE_time"]))


def test_cwru_key_pattern_and_blocks(tmp_path: Path) -> None:
    path = mat_file(tmp_path / "105_0.mat", cwru_values(105))
    items = blocks(path, block_s=0.6, channels=(ChannelSpec("de", key="X*_DE_time", unit="g"),))
    assert [type(item).__name__ for item in items] == ["Block", "Block", "Block", "Rejected"]
    assert [item.name for item in items] == ["105_0.mat", *(f"105_0.mat[{0.6 * i:g} s]" for i in (1, 2, 3))]
    assert [item.elapsed for item in items if isinstance(item, Block)] == [0, 0.6, 1.2]
    assert isinstance(items[3], Rejected)
    assert items[3].status == "short"
    assert len({item.content_hash for item in items}) == 4


def test_cwru_file_that_holds_a_second_recording_too(tmp_path: Path) -> None:
    both = cwru_values(98) | cwru_values(99)
    (block,) = good(blocks(mat_file(tmp_path / "99_2.mat", both), block_s="file"))
    assert_array_equal(block.samples[0], np.ravel(cwru_values(99)["X099_DE_time"]))
    (other,) = blocks(f"dataset:CWRU:{mat_file(tmp_path / '100_2.mat', both)}", block_s="file")
    assert isinstance(other, Rejected)
    assert "X098, X099" in other.reason


def test_cwru_channel_that_the_file_lacks(tmp_path: Path) -> None:
    path = mat_file(tmp_path / "105_0.mat", cwru_values(105))
    (item,) = blocks(path, channels=(ChannelSpec("base"),))
    assert isinstance(item, Rejected)
    assert item.status == "wrong_shape"
    assert "channel base: no column by its name; the file has drive_end (X105_DE_time)" in item.reason


def mfpt_values(**fields: Any) -> dict[str, Any]:
    gs = np.sin(np.arange(5000.0))[:, None]
    return {"bearing": {"gs": gs, "sr": 48828, "rate": 25, "load": "200"} | fields, "BPFO": 81.125}


def test_mfpt_states_its_rate_speed_and_load(tmp_path: Path) -> None:
    (block,) = good(blocks(mat_file(tmp_path / "x.mat", mfpt_values()), block_s="file"))
    assert (block.rate, block.speed, block.units) == (48828, 25, ("g",))
    assert block.load == pytest.approx(200 * 4.4482216)
    assert block.channels == ("acceleration",)


def test_mfpt_rate_must_agree_with_the_configuration(tmp_path: Path) -> None:
    path = mat_file(tmp_path / "x.mat", mfpt_values())
    assert isinstance(blocks(path, rate=48828.125, block_s="file")[0], Block)
    (item,) = blocks(path, rate=97656.0, block_s="file")
    assert isinstance(item, Rejected)
    assert item.status == "wrong_rate"
    assert "48828 Hz and 97656 Hz" in item.reason
    (silent,) = blocks(mat_file(tmp_path / "y.mat", mfpt_values(sr="?")), block_s="file")
    assert isinstance(silent, Rejected)
    assert silent.status == "wrong_rate"


def test_hit_sm_has_no_unit(tmp_path: Path) -> None:
    vector = np.random.default_rng(0).normal(size=(262144, 1))
    (block,) = good(blocks(mat_file(tmp_path / "OR8_1200.mat", {"z20_4": vector}), block_s="file"))
    assert (block.rate, block.speed, block.units) == (51200, 20, ("unknown",))
    (named,) = good(blocks(tmp_path / "OR8_1200.mat", block_s="file", channels=(ChannelSpec("x", unit="m/s2"),)))
    assert (named.channels, named.units) == (("x",), ("m/s2",))


def test_uestc_states_its_rate(tmp_path: Path) -> None:
    values = {"Data": np.arange(1000.0)[:, None], "SampleFrequency": 20000}
    (block,) = good(blocks(mat_file(tmp_path / "x.mat", values), block_s="file"))
    assert (block.rate, block.speed, block.units, block.elapsed) == (20000, None, ("unknown",), 0)


def test_uestc_states_its_nominal_speed_in_the_name(tmp_path: Path) -> None:
    values = {"Data": np.arange(1000.0)[:, None], "SampleFrequency": 20000}
    (block,) = good(blocks(mat_file(tmp_path / "O_1200_2.mat", values), block_s="file"))
    assert block.speed == 20.0


def test_xjtu_sy_is_recognised_by_its_header(tmp_path: Path) -> None:
    folder = tmp_path / "37.5Hz11kN" / "Bearing2_1"
    folder.mkdir(parents=True)
    for number in (2, 10):
        rows = "\n".join(f"{i / 8},{-i * number / 16}" for i in range(32768))
        (folder / f"{number}.csv").write_text(f"Horizontal_vibration_signals,Vertical_vibration_signals\n{rows}\n")
    found = good(blocks(folder))
    assert [block.sequence for block in found] == [2, 10]
    assert [block.elapsed for block in found] == [60, 540]
    assert (found[0].rate, found[0].speed, found[0].load) == (25600, 37.5, 11000)
    assert_array_equal(found[0].samples[:, 2], [0.25, -0.25])
