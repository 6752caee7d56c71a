from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import soundfile
from numpy.testing import assert_array_equal

from streams.open import open_source
from streams.types.block import Block, Rejected
from streams.types.source import Source
from streams.types.spec import ChannelSpec, SourceError, SourceSpec
from tests.streams.makers import mat_file, pronostia_csv

A = (ChannelSpec("a", column=1, unit="g"),)


def open_at(path: object, **settings: Any) -> Source:
    return open_source(SourceSpec("test", str(path), **settings))


def test_plain_text_is_cut_to_blocks(tmp_path: Path) -> None:
    values = np.arange(1090.0) % 7.0
    (tmp_path / "x.csv").write_text("t,acc\n" + "".join(f"{i / 100},{v}\n" for i, v in enumerate(values)))
    channels = (ChannelSpec("acc", unit="m/s2"),)
    source = open_at(tmp_path / "x.csv", rate=100.0, start=50.0, channels=channels)
    assert isinstance(source, Source)
    found = [item for item in source if isinstance(item, Block)]
    assert [block.samples.shape for block in found] == [(1, 500), (1, 500)]
    assert_array_equal(found[1].samples, [values[500:1000]])
    assert [(block.sequence, block.start, block.elapsed) for block in found] == [(1, 50, 0), (2, 55, 5)]
    (*_, tail) = source
    assert isinstance(tail, Rejected)
    assert (tail.sequence, tail.status, tail.name) == (3, "short", "x.csv[10 s]")
    assert "0.9 s are left, a block has 5 s" in tail.reason
    assert len(source) == 3


def test_tail_of_nine_tenths_is_kept(tmp_path: Path) -> None:
    np.save(tmp_path / "x.npy", np.sin(np.arange(950.0)))
    found = list(open_at(tmp_path / "x.npy", rate=100.0, channels=A))
    assert [item.samples.shape[1] for item in found if isinstance(item, Block)] == [500, 450]
    assert len(found) == 2


def test_folder_of_sound_files_in_natural_order(tmp_path: Path) -> None:
    for number in (9, 10):
        soundfile.write(tmp_path / f"r{number}.wav", np.full((2000, 2), number / 64), 1000, subtype="PCM_16")
    (tmp_path / "README.txt").write_text("how this was recorded\n")
    channels = (ChannelSpec("x", column=2, unit="V", sensitivity_mv_per_g=100.0, scale=10.0),)
    found = list(open_at(f"folder:{tmp_path}", block_s=1.0, channels=channels, start=0.0))
    assert [item.name for item in found] == ["r9.wav", "r9.wav[1 s]", "r10.wav", "r10.wav[1 s]"]
    assert [item.sequence for item in found] == [1, 2, 3, 4]
    for item, time in zip(found, (16.0, 17.0, 18.0, 19.0), strict=True):
        assert isinstance(item, Block)
        assert (item.rate, item.units, item.samples.dtype) == (1000, ("V",), np.float32)
        # The eight files before them are missing.
        assert (item.start, item.elapsed) == (time, time)
    assert [item.samples[0, 0] * 64 for item in found if isinstance(item, Block)] == [9, 9, 10, 10]


def test_header_rate_and_configured_rate_must_agree(tmp_path: Path) -> None:
    soundfile.write(tmp_path / "x.wav", np.zeros(100), 8000, subtype="FLOAT")
    (item,) = list(open_at(tmp_path / "x.wav", rate=16000.0, block_s="file", channels=A))
    assert isinstance(item, Rejected)
    assert item.status == "wrong_rate"


def test_plain_mat_by_key(tmp_path: Path) -> None:
    mat_file(tmp_path / "x.mat", {"acc_h": np.arange(50.0) % 7.0, "acc_v": np.arange(70.0), "note": "text"})
    channels = (ChannelSpec("h", key="acc_h", unit="g"),)
    (item,) = list(open_at(tmp_path / "x.mat", rate=10.0, block_s="file", channels=channels))
    assert isinstance(item, Block)
    assert_array_equal(item.samples, [np.arange(50.0) % 7.0])


def test_named_format_for_a_file_of_any_name(tmp_path: Path) -> None:
    (tmp_path / "measured.abc").write_text("1 2\n3 4\n5 6\n")
    with pytest.raises(SourceError, match="nothing that is recognised"):
        open_at(tmp_path / "measured.abc", rate=1.0, channels=A)
    (item,) = list(open_at(tmp_path / "measured.abc", format="csv", rate=1.0, block_s="file", channels=A))
    assert isinstance(item, Block)
    assert_array_equal(item.samples, [[1, 3, 5]])


def test_folder_of_text_files_leaves_the_readme_out(tmp_path: Path) -> None:
    (tmp_path / "README.txt").write_text("how this was recorded\nand by whom\n")
    (tmp_path / "run1.dat").write_text("1\n2\n3\n")
    (item,) = list(open_at(tmp_path, rate=1.0, block_s="file", channels=A))
    assert isinstance(item, Block)


def test_binary_called_csv_is_rejected(tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_bytes(b"\x7fELF\x00\x01" * 50)
    (item,) = list(open_at(tmp_path / "x.csv", rate=1.0, channels=A))
    assert isinstance(item, Rejected)
    assert (item.status, item.sequence) == ("unreadable", 1)
    assert item.content_hash


@pytest.mark.parametrize(
    ("url", "settings", "words"),
    [
        ("{tmp}/none", {}, "there is no"),
        ("", {}, "there is no"),
        ("{tmp}/empty", {}, "holds no files"),
        ("folder:{tmp}/x.csv", {}, "expected a folder"),
        ("folder:{tmp}/none", {}, "there is no"),
        ("dataset:pronostia", {}, "expected dataset:NAME:PATH"),
        ("dataset:femto:{tmp}/x.csv", {}, "'femto' is not known; expected one of auto, csv"),
        ("dataset:pronostia:{tmp}/x.csv", {}, r"is not a file of pronostia \(acc_NNNNN.csv\)"),
        ("dataset:ims:{tmp}", {}, r"holds no file of ims \(YYYY.MM.DD.hh.mm.ss\)"),
        ("{tmp}/x.csv", {"format": "dwg"}, "'dwg' is not known"),
        ("{tmp}/x.csv", {"channels": A}, "rate_hz is missing"),
        ("{tmp}/x.csv", {"rate": 10.0}, r"a \[\[channel\]\] with its unit is missing"),
        (
            "{tmp}/x.csv",
            {"rate": 10.0, "channels": (ChannelSpec("a", column=1),)},
            r"\[\[channel\]\] a: unit is missing",
        ),
        ("{tmp}/acc_00001.csv", {"channels": (ChannelSpec("a", unit="m/s2"),)}, "pronostia is in g"),
        ("{tmp}/cwru/7777.mat", {}, "rate_hz is missing"),
        ("tcp://127.0.0.1:9000", {}, "tcp:// is not a kind of source"),
    ],
)
def test_what_cannot_be_opened(tmp_path: Path, url: str, settings: dict[str, Any], words: str) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "cwru").mkdir()
    (tmp_path / "x.csv").write_text("1,2\n3,4\n")
    (tmp_path / "acc_00001.csv").write_bytes(pronostia_csv(1))
    mat_file(tmp_path / "cwru" / "7777.mat", {"X7777_DE_time": np.arange(10.0)})
    with pytest.raises(SourceError, match=words) as caught:
        open_at(url.format(tmp=tmp_path), **settings)
    assert "[[source]] test" in str(caught.value) or "[[channel]]" in str(caught.value)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"block_s": 0.0}, "block_s"),
        ({"block_s": float("nan")}, "block_s"),
        ({"rate": -1.0}, "rate_hz"),
        ({"timezone": "Mars/Base"}, "timezone 'Mars/Base'"),
        ({"channels": A + A}, "channel names must differ"),
    ],
)
def test_settings_no_recording_could_have(settings: dict[str, Any], words: str) -> None:
    with pytest.raises(SourceError, match=words):
        SourceSpec("test", "x.csv", **settings)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"unit": "mm"}, "unit must be one of g, m/s2, V, unknown, mm/s, got 'mm'"),
        ({"column": 0}, "counted from 1"),
        ({"column": 1, "key": "a*"}, "either column or key"),
        ({"scale": 0.0}, "scale"),
        ({"unit": "V"}, "sensitivity_mv_per_g"),
    ],
)
def test_channels_that_mean_nothing(settings: dict[str, Any], words: str) -> None:
    with pytest.raises(SourceError, match=words):
        ChannelSpec("a", **settings)


@pytest.mark.process
def test_importing_the_protocol_loads_no_parser() -> None:
    code = "import sys, streams.open; sys.exit(bool({'pandas', 'scipy', 'numba', 'soundfile'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.process
def test_reading_a_recording_loads_no_compiler(tmp_path: Path) -> None:
    (tmp_path / "acc_00001.csv").write_bytes(pronostia_csv(1))
    code = (
        "import sys; from streams.types.spec import SourceSpec; from streams.open import open_source; "
        f"blocks = list(open_source(SourceSpec('x', {str(tmp_path)!r}))); "
        "sys.exit(len(blocks) != 1 or bool({'numba', 'xarray', 'netCDF4', 'matplotlib'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_rig_is_opened_by_its_own_module(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[tuple[str, str]] = []

    class Rig:
        name = "test"

        def __iter__(self) -> Iterator[Block | Rejected]:
            return iter(())

        def __len__(self) -> int:
            return 0

    def open_rig(url: str, name: str) -> Rig:
        calls.append((url, name))
        return Rig()

    module = ModuleType("streams.rig.bench")
    monkeypatch.setattr(module, "open_rig", open_rig, raising=False)
    monkeypatch.setitem(sys.modules, "streams.rig.bench", module)
    assert isinstance(open_at("rig:ferrara?seed=3"), Rig)
    assert calls == [("rig:ferrara?seed=3", "test")]
