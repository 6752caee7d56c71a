"""The contract of every reader: consistent samples from a good file, a ReaderError that names it from any other bytes.

Readers are found, not listed: each function ``read_...`` of ``streams.files.formats`` that returns Samples. A new
reader needs a file of its format in ``tests/streams/format_makers.py``.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import streams.files.formats
from streams.files.parse.child import isolated
from streams.types.samples import ReaderError, Samples
from tests.streams.format_makers import MAKERS, signal
from tests.support.effort import effort_count

Reader = Callable[[bytes, str], Samples]

STATUSES = {"empty", "short", "nan", "unreadable", "wrong_shape", "wrong_rate", "incomplete", "refused"}
CRASHED = {"reader_crashed"}
IN_PROCESS = ("layout", "npy", "plain_npy", "text", "wav")
"""Readers that are called here, some of them otherwise than in use; the others run in the child process."""
MAKER_OF = {"hdf5": "x.h5", "plain_npy": "x.npy", "layout": "x.csv", "netcdf": "x.nc"}


def found_readers() -> Iterator[tuple[str, Reader]]:
    for module in pkgutil.iter_modules(streams.files.formats.__path__, "streams.files.formats."):
        for name, function in inspect.getmembers(importlib.import_module(module.name), inspect.isfunction):
            own = function.__module__ == module.name
            if own and name.startswith("read_") and function.__annotations__.get("return") == "Samples":
                kind = name.removeprefix("read_")
                yield kind, function if kind in IN_PROCESS else isolated(function)


READERS = dict(found_readers())
each_reader = pytest.mark.parametrize("kind", sorted(READERS))


def good(kind: str) -> bytes:
    if kind == "text":
        return "\n".join(",".join(f"{value:.4f}" for value in row) for row in signal(2, 40).T).encode()
    return MAKERS[MAKER_OF.get(kind, f"x.{kind}")](signal(2, 40))


GOOD = {kind: good(kind) for kind in READERS}


def outcome(kind: str, data: bytes) -> str:
    """Read bytes; return "read" or the status of the refusal, after the checks that hold for both."""
    refused: ReaderError | None = None
    samples = Samples(np.empty((1, 0)))
    try:
        samples = READERS[kind](data, "folder/some file")
    except ReaderError as error:
        refused = error
    if refused is not None:
        assert "folder/some file" in str(refused)
        assert refused.status in STATUSES | (set() if kind in IN_PROCESS else CRASHED)
        return refused.status
    rows, length = samples.values.shape
    assert rows >= 1
    assert length >= 1
    assert samples.values.dtype in (np.float32, np.float64)
    assert all(row.flags.c_contiguous for row in samples.values)
    assert {len(part) for part in (samples.channels, samples.names, samples.columns, samples.units)} == {rows}
    assert samples.rate is None or samples.rate > 0.0
    assert (samples.origin, samples.offset) == (None, 0)
    return "read"


def test_all_formats_are_found() -> None:
    assert set(READERS) >= {"hdf5", "layout", "mat", "netcdf", "npy", "tdms", "text", "uff", "wav"}


@each_reader
def test_a_good_file_is_read(kind: str) -> None:
    assert outcome(kind, GOOD[kind]) == "read"


@each_reader
def test_an_empty_file_is_empty(kind: str) -> None:
    assert outcome(kind, b"") == "empty"


@each_reader
def test_noise_is_refused(kind: str) -> None:
    assert outcome(kind, np.random.default_rng(0).bytes(4096)) == "unreadable"


@each_reader
@settings(max_examples=effort_count(quick=24, full=2000))
@given(data=st.data())
def test_changed_bytes_and_cut_ends(kind: str, data: st.DataObject) -> None:
    changed = bytearray(GOOD[kind])
    for position in data.draw(st.lists(st.integers(0, len(changed) - 1), max_size=5)):
        changed[position] = data.draw(st.integers(0, 255))
    outcome(kind, bytes(changed[: data.draw(st.integers(0, len(changed)))]))


@each_reader
@settings(max_examples=effort_count(quick=24, full=2000))
@given(data=st.binary(max_size=300))
def test_any_bytes(kind: str, data: bytes) -> None:
    outcome(kind, data)
    outcome(kind, GOOD[kind][:136] + data)
