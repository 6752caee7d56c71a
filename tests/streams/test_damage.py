"""Damaged files: whatever is wrong with one, a reader answers with a status and nothing else escapes."""

from __future__ import annotations

import io
from collections.abc import Callable

import numpy as np
import pytest
import scipy.io
import soundfile
from hypothesis import given, settings
from hypothesis import strategies as st

from streams.readers.child import isolated
from streams.readers.mat import read_mat
from streams.readers.npy import read_npy
from streams.readers.text import read_text
from streams.readers.wav import read_wav
from streams.samples import ReaderError, Samples
from tests.effort import effort_count

STATUSES = {"empty", "short", "unreadable", "wrong_shape", "incomplete", "refused", "reader_crashed"}


def _good() -> dict[str, bytes]:
    values = np.random.default_rng(0).normal(size=(40, 2)).round(3)
    npy, wav, mat = io.BytesIO(), io.BytesIO(), io.BytesIO()
    np.save(npy, values)
    soundfile.write(wav, values / 8, 1000, format="WAV", subtype="PCM_16")
    scipy.io.savemat(mat, {"a": values, "s": {"b": values}})
    text = "\n".join(f"{a},{b}" for a, b in values)
    return {"text": text.encode(), "npy": npy.getvalue(), "wav": wav.getvalue(), "mat": mat.getvalue()}


GOOD = _good()
READERS: dict[str, Callable[[bytes, str], Samples]] = {
    "text": read_text,
    "npy": read_npy,
    "wav": read_wav,
    # As it is used: scipy crashes on some damaged files.
    "mat": isolated(read_mat),
}


def answer(kind: str, data: bytes) -> str:
    try:
        reading = READERS[kind](data, "x")
    except ReaderError as error:
        return error.status
    assert reading.values.ndim == 2
    assert reading.values.shape[0] == len(reading.names) == len(reading.channels) == len(reading.columns)
    return "read"


@pytest.mark.parametrize("kind", READERS)
def test_undamaged_file_is_read(kind: str) -> None:
    assert answer(kind, GOOD[kind]) == "read"


@pytest.mark.parametrize("kind", READERS)
@settings(max_examples=effort_count(quick=60, full=2000), deadline=None)
@given(data=st.data())
def test_changed_bytes_and_cut_ends(kind: str, data: st.DataObject) -> None:
    good = GOOD[kind]
    changed = bytearray(good)
    positions = data.draw(st.lists(st.integers(0, len(good) - 1), max_size=5))
    for position in positions:
        changed[position] = data.draw(st.integers(0, 255))
    end = data.draw(st.integers(0, len(good)))
    assert answer(kind, bytes(changed[:end])) in STATUSES | {"read"}


@pytest.mark.parametrize("kind", READERS)
@settings(max_examples=effort_count(quick=60, full=2000), deadline=None)
@given(data=st.binary(max_size=300))
def test_anything_at_all(kind: str, data: bytes) -> None:
    head = GOOD[kind][:136] if kind != "text" else b""
    assert answer(kind, data) in STATUSES | {"read"}
    assert answer(kind, head + data) in STATUSES | {"read"}
