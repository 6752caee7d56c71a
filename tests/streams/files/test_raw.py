"""Samples without a header are read by the layout in a side-car, and by nothing else."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

import spallwatch as sw
from streams.files.formats.raw import layout_of, samples_of
from streams.files.load import ReaderError
from streams.open import open_source
from streams.recording.source import Recording
from streams.types import large
from streams.types.block import Block, Rejected
from streams.types.large import FileBytes
from streams.types.spec import SourceError, SourceSpec
from tests.streams.folders import Rig, csv_bytes, verdicts

RATE = 4096
LAYOUT = {"type": "int16", "order": "little", "channels": 3, "interleaved": True, "header_bytes": 512}
STATED = {"layout": LAYOUT, "rate_hz": RATE, "unit": "g", "scale": 0.25, "start_utc": "2024-05-01T12:00:00Z"}
COUNTS = np.random.default_rng(8).integers(-100, 100, (3, 900))


def stored(numbers: NDArray[Any], layout: dict[str, Any]) -> bytes:
    """Numbers of shape (channel, sample) as a logger would store them."""
    kind, order = str(layout["type"]), str(layout.get("order", "little"))
    frames = (numbers.T if layout.get("interleaved", True) else numbers).ravel()
    header = b"\xff" * int(layout.get("header_bytes", 0))
    if kind == "int24":
        return header + b"".join(
            int(x).to_bytes(3, "little" if order == "little" else "big", signed=True) for x in frames
        )
    return header + frames.astype(np.dtype(kind).newbyteorder("<" if order == "little" else ">")).tobytes()


def write(folder: Path, name: str, data: bytes, stated: dict[str, Any], beside: str | None = None) -> str:
    (folder / (beside or f"{name}.json")).write_text(json.dumps(stated), encoding="utf-8")
    (folder / name).write_bytes(data)
    return str(folder / name)


@pytest.mark.parametrize("interleaved", [True, False])
@pytest.mark.parametrize("order", ["little", "big"])
@pytest.mark.parametrize("kind", ["int8", "uint8", "int16", "uint16", "int24", "int32", "uint32", "float32", "float64"])
def test_every_type_and_order(kind: str, order: str, interleaved: bool, tmp_path: Path) -> None:
    numbers = np.abs(COUNTS) if kind.startswith("u") else COUNTS
    if kind in ("int24", "int32"):
        numbers = numbers * 80_000
    layout = {**LAYOUT, "type": kind, "order": order, "interleaved": interleaved}
    url = write(tmp_path, "a.bin", stored(numbers, layout), {**STATED, "layout": layout})
    (block,) = open_source(SourceSpec("s", url, block_s="file"))
    assert isinstance(block, Block)
    assert (block.rate, block.units, block.start) == (RATE, ("g",) * 3, 1714564800.0)
    assert_array_equal(block.samples, numbers * 0.25)


@pytest.mark.parametrize("name", ["a.bin", "a.raw", "a.dat", "a.pcm", "a.bin.gz"])
def test_any_ending_with_a_layout_of_its_own(name: str, tmp_path: Path) -> None:
    data = stored(COUNTS, LAYOUT)
    url = write(tmp_path, name, gzip.compress(data) if name.endswith(".gz") else data, STATED)
    found = sw.read(url)
    assert_allclose(found.values / 9.80665, COUNTS * 0.25, rtol=1e-6)


def test_a_layout_for_a_folder_in_toml(tmp_path: Path) -> None:
    lines = ["rate_hz = 4096", 'unit = "m/s2"', "[layout]", 'type = "float32"', 'order = "big"', "channels = 1"]
    (tmp_path / "spallwatch.toml").write_text("\n".join(lines), encoding="utf-8")
    layout = {"type": "float32", "order": "big", "channels": 1}
    for number in (1, 2):
        (tmp_path / f"{number}.dat").write_bytes(stored(COUNTS[:1] + number, layout))
    (tmp_path / "notes.md").write_text("# Notes\n", encoding="utf-8")
    found = open_source(SourceSpec("s", f"folder:{tmp_path}", block_s="file"))
    assert isinstance(found, Recording)
    first, second = found
    assert isinstance(first, Block)
    assert isinstance(second, Block)
    assert_array_equal(first.samples + 1, second.samples)
    assert set(found.ignored()) == {"notes.md"}


def test_large_files_are_read_piece_by_piece(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(large, "MAX_IN_MEMORY", 1 << 12)
    monkeypatch.setattr(large, "PIECE_BYTES", 1 << 10)
    for kind in ("int16", "int24", "float64"):
        for interleaved in (True, False):
            layout = {**LAYOUT, "type": kind, "interleaved": interleaved}
            (tmp_path / "a.bin").write_bytes(stored(COUNTS, layout))
            found = samples_of(FileBytes.opened(str(tmp_path / "a.bin")), "a.bin", list(layout.values()))
            assert_array_equal(found.values, COUNTS)
            assert all(row.flags.c_contiguous for row in found.values)


@pytest.mark.parametrize(
    ("more", "status", "words"),
    [
        (b"", "", ""),
        (
            b"\0",
            "wrong_shape",
            "5913 bytes are a header of 512 and 5401, which are no multiple of 6: 3 x int16 a sample",
        ),
        (b"\0\0\0\0", "wrong_shape", "512 and 5404, which are no multiple of 6"),
    ],
)
def test_a_size_that_does_not_fit_is_refused_with_both_numbers(
    more: bytes, status: str, words: str, tmp_path: Path
) -> None:
    url = write(tmp_path, "a.bin", stored(COUNTS, LAYOUT) + more, STATED)
    (item,) = open_source(SourceSpec("s", url, block_s="file"))
    if not status:
        assert isinstance(item, Block)
    else:
        assert isinstance(item, Rejected)
        assert item.status == status
        assert words in item.reason


def test_a_header_without_samples_is_empty(tmp_path: Path) -> None:
    (item,) = open_source(SourceSpec("s", write(tmp_path, "a.bin", bytes(512), STATED), block_s="file"))
    assert isinstance(item, Rejected)
    assert item.status == "empty"


def test_integers_without_a_scale_have_no_level(tmp_path: Path) -> None:
    stated = {key: value for key, value in STATED.items() if key != "scale"}
    (item,) = open_source(SourceSpec("s", write(tmp_path, "a.bin", stored(COUNTS, LAYOUT), stated), block_s="file"))
    assert isinstance(item, Rejected)
    assert item.status == "wrong_unit"
    assert "nothing states their level" in item.reason


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"type": "int17"}, "layout.type must be one of int8, uint8, int16"),
        ({"type": ["int16"]}, "layout.type must be one of"),
        ({"order": None}, "layout.order must be the order of bytes, little or big, got 'None'"),
        ({"channels": 0}, "layout.channels must be the number of channels, from 1, got '0'"),
        ({"channels": True}, "layout.channels"),
        ({"interleaved": None}, "layout.interleaved must be true"),
        ({"header_bytes": -1}, "layout.header_bytes must be a number of bytes up to 1048576, got '-1'"),
        ({"width": 2}, "unknown key layout.width; expected type, order"),
    ],
)
def test_a_layout_that_states_nonsense_names_its_key(change: dict[str, Any], words: str) -> None:
    with pytest.raises(ReaderError) as caught:
        layout_of({**LAYOUT, **change}, "a.bin.json")
    assert caught.value.status == "unreadable"
    assert words in str(caught.value)
    with pytest.raises(ReaderError, match="layout must be a table of keys, got 'int16'"):
        layout_of("int16", "a.bin.json")


@pytest.mark.parametrize("kind", ["auto", "raw"])
def test_without_a_layout_it_is_said_what_to_write(kind: str, tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(stored(COUNTS, LAYOUT))
    with pytest.raises((SourceError, sw.SpallwatchError)) as caught:
        sw.read(tmp_path / "a.bin", format=kind, rate_hz=RATE, unit="g", scale=1.0)
    assert '{"layout": {"type": "int16", "order": "little"' in str(caught.value)


def test_a_layout_beside_another_format_is_refused(tmp_path: Path) -> None:
    url = write(tmp_path, "a.csv", csv_bytes(np.zeros(50)), STATED)
    (item,) = open_source(SourceSpec("s", url, block_s="file"))
    assert isinstance(item, Rejected)
    assert 'a.csv.json states a layout, of format = "raw", not of csv' in item.reason


@pytest.mark.parametrize(
    ("wrong", "more"), [({"order": "little"}, 0), ({"type": "float64"}, 0), ({"header_bytes": 510}, 10), ({}, 0)]
)
def test_numbers_of_all_magnitudes_are_told_from_samples(wrong: dict[str, Any], more: int, tmp_path: Path) -> None:
    layout = {**LAYOUT, "type": "float32", "order": "big"}
    noise = np.random.default_rng(1).normal(size=(3, 900)) * 1e-3
    noise[:, :50] = 0.0
    data = stored(noise, layout) + bytes(more)
    url = write(tmp_path, "a.bin", data, {**STATED, "scale": 1.0, "layout": {**layout, **wrong}})
    (item,) = open_source(SourceSpec("s", url, block_s="file"))
    if not wrong:
        assert isinstance(item, Block)
        return
    assert isinstance(item, Rejected)
    assert item.status == "wrong_shape"
    assert "it holds numbers such as" in item.reason


def test_a_watched_folder_waits_for_whole_frames_and_names_what_it_leaves(tmp_path: Path) -> None:
    layout = {**LAYOUT, "channels": 1, "type": "float32"}
    (tmp_path / "spallwatch.json").write_text(json.dumps({"layout": layout, "unit": "g"}), encoding="utf-8")
    whole = [stored(COUNTS[:1] + 0.25 * number, layout) for number in (1, 2)]
    (tmp_path / "1.dat").write_bytes(whole[0])
    rig = Rig(tmp_path)
    assert verdicts(rig.run(10.0)) == [("1.dat", "accepted")]
    (tmp_path / "2.dat").write_bytes(whole[1][:-2])
    assert rig.run(5.0) == []
    (tmp_path / "2.dat").write_bytes(whole[1])
    (tmp_path / "3.wav").write_bytes(b"RIFF")
    assert verdicts(rig.run(10.0)) == [("2.dat", "accepted")]
    assert_array_equal(rig.samples(), np.concatenate([COUNTS[0] + 0.25, COUNTS[0] + 0.5]))
    assert "of another format than raw" in rig.source.ignored()["3.wav"]
