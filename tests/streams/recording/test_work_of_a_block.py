"""What a block of a recording costs in calls, and that what is saved hides no change of what later files state."""

from __future__ import annotations

import itertools
import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest
import soundfile
from nptdms import ChannelObject, TdmsWriter

from streams.files.parse.child import ReaderProcess
from streams.open import open_source
from streams.types.block import Block, Rejected
from streams.types.samples import Samples
from streams.types.spec import ChannelSpec, SourceSpec

ROOT = Path(__file__).parents[3]
FLOORS = tuple(f"{ROOT / floor}/" for floor in ("models", "streams", "spallwatch"))
RATE = 1000.0
MAX_CALLS = {"npy": 166, "wav": 187, "tdms": 176, "csv": 174}
"""Of functions and generators of the program for a block of a folder, the child that parses it apart, by ending."""
MAX_PARSER_CALLS = {"wav": 24, "tdms": 186, "csv": 345}
"""The same of the child, but for what is between the processes."""


def write(folder: Path, ending: str, number: int, rate: float = RATE, unit: str = "g") -> Path:
    """Write a file of the same kind as all others but for its samples."""
    values = np.random.default_rng(number).standard_normal(64)
    path = folder / f"rec_20240501_{number // 3600:02}{number // 60 % 60:02}{number % 60:02}.{ending}"
    if ending == "npy":
        np.save(path, values)
    elif ending == "wav":
        soundfile.write(path, 0.1 * values, round(rate), subtype="FLOAT")
    elif ending == "tdms":
        with TdmsWriter(path) as writer:
            words = {"wf_increment": 1.0 / rate, "unit_string": unit}
            writer.write_segment([ChannelObject("run", "acc", values, properties=words)])
    else:
        rows = "\n".join(f"{value:.6f}" for value in values)
        path.write_text(f"Sample Rate: {rate:g} Hz\nUnit: {unit}\nacc\n{rows}\n")
    return path


def items(folder: Path, ending: str) -> Iterator[Block | Rejected]:
    name = {"tdms": "acc", "csv": "acc"}.get(ending, "channel_1")
    rate = RATE if ending == "npy" else None
    channel = ChannelSpec(name, unit="g", scale=8.0 if ending == "wav" else None)
    return iter(open_source(SourceSpec("s", str(folder), block_s="file", rate=rate, channels=(channel,))))


@pytest.mark.process
@pytest.mark.parametrize("ending", MAX_CALLS)
def test_the_calls_that_a_block_takes(tmp_path: Path, ending: str) -> None:
    for number in range(12):
        write(tmp_path, ending, number)
    blocks, calls = items(tmp_path, ending), 0

    def count(frame: FrameType, event: str, argument: Any) -> None:
        nonlocal calls
        calls += event == "call" and frame.f_code.co_filename.startswith(FLOORS)

    assert all(isinstance(item, Block) for item in itertools.islice(blocks, 2))
    sys.setprofile(count)
    try:
        rest = list(blocks)
    finally:
        sys.setprofile(None)
    assert [item.sequence for item in rest] == list(range(3, 13))
    assert calls / len(rest) <= MAX_CALLS[ending]


@pytest.mark.parametrize("ending", MAX_PARSER_CALLS)
def test_the_calls_that_parsing_takes(tmp_path: Path, ending: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for number in range(12):
        write(tmp_path, ending, number)
    calls: list[int] = []

    def count(frame: FrameType, event: str, argument: Any) -> None:
        calls[-1] += event == "call" and frame.f_code.co_filename.startswith(FLOORS)

    def call(process: object, read: Callable[..., Samples], data: bytes, name: str, *arguments: Any) -> Samples:
        calls.append(0)
        sys.setprofile(count)
        try:
            return read(data, name, *arguments)
        finally:
            sys.setprofile(None)

    monkeypatch.setattr(ReaderProcess, "call", call)
    assert all(isinstance(item, Block) for item in items(tmp_path, ending))
    assert sum(calls[-10:]) / 10 <= MAX_PARSER_CALLS[ending]


@pytest.mark.process
@pytest.mark.parametrize("ending", ["wav", "tdms", "csv"])
def test_a_later_file_of_another_rate_is_no_block_of_the_first(tmp_path: Path, ending: str) -> None:
    for number in range(4):
        write(tmp_path, ending, number, rate=RATE * (2.0 if number == 2 else 1.0))
    assert [item.rate for item in items(tmp_path, ending) if isinstance(item, Block)] == [RATE, RATE, 2.0 * RATE, RATE]


@pytest.mark.process
@pytest.mark.parametrize("ending", ["tdms", "csv"])
@pytest.mark.parametrize("place", [1, 7])
def test_a_later_file_of_another_unit_is_refused(tmp_path: Path, ending: str, place: int) -> None:
    for number in range(9):
        write(tmp_path, ending, number, unit="m/s2" if number == place else "g")
    found = list(items(tmp_path, ending))
    assert [isinstance(item, Rejected) for item in found] == [number == place for number in range(9)]
    assert getattr(found[place], "status", "") == "wrong_unit"


@pytest.mark.parametrize("place", [1, 999])
@pytest.mark.parametrize("beside", ["side-car", "note"])
def test_what_stands_beside_the_second_or_the_thousandth_file_is_seen(tmp_path: Path, place: int, beside: str) -> None:
    paths = [write(tmp_path, "npy", number) for number in range(place + 2)]
    blocks = items(tmp_path, "npy")
    assert isinstance(next(blocks), Block)
    # It comes while the recording is read.
    if beside == "note":
        paths[place].with_suffix(".txt").write_text(f"Sample Rate: {RATE * 1.5:g} Hz\n")
    else:
        paths[place].with_name(f"{paths[place].name}.json").write_text(json.dumps({"rate_hz": RATE * 1.5}))
    found = list(blocks)
    assert [item.sequence for item in found if isinstance(item, Rejected)] == [place + 1]
    assert getattr(found[place - 1], "status", "") == "wrong_rate"


def test_changed_samples_are_those_that_are_built_anew() -> None:
    before = Samples(np.ones((2, 5)), names=("a", "b"), rate=10.0)
    for field, value in {"rate": 20.0, "units": ("g", None), "columns": (3, 7), "names": (), "stamp": "x"}.items():
        ours, theirs = before.changed(**{field: value}), replace(before, **{field: value})
        for each in fields(Samples):
            assert getattr(ours, each.name) is getattr(theirs, each.name) or getattr(ours, each.name) == getattr(
                theirs, each.name
            ), each.name
    assert before.rate == 10.0
    assert before.units == (None, None)


def test_samples_are_not_changed_into_what_does_not_fit() -> None:
    samples = Samples(np.ones((2, 5)))
    with pytest.raises(ValueError, match="2 rows"):
        samples.changed(units=("g",))
    with pytest.raises(ValueError, match="1 rows"):
        samples.changed(values=np.ones((1, 5)))
    with pytest.raises(TypeError, match="rates"):
        samples.changed(rates=5.0)
