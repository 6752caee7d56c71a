"""Damaged files of pulses: pulses that can be, or a refusal that names the file; never another error."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from streams.files.formats.hdf5 import read_hdf5
from streams.files.formats.mat import read_mat
from streams.files.formats.netcdf import read_netcdf
from streams.files.formats.pulse_text import pulse_column
from streams.files.formats.tdms import read_tdms
from streams.files.parse.child import isolated
from streams.turns.pulses import Pulses
from streams.types.samples import ReaderError, Samples
from tests.support.effort import effort_count
from tests.support.pulse_readers import FORMATS, TIMES

READERS = {"x.tdms": read_tdms, "x.h5": read_hdf5, "x.nc": read_netcdf, "x.mat": read_mat}
GOOD = {name: make(TIMES, "s", pulses_per_revolution=4) for name, (make, _) in FORMATS.items()}
TEXT = b"pulses_per_revolution: 4\nunit: ms\nTime [ms]\n" + b"".join(b"%f\n" % (1e3 * time) for time in TIMES)
DATES = b"2024-05-01T12:00:00.25Z\n2024-05-01T12:00:01.5Z\n"


def check(read: Callable[[], Samples]) -> None:
    refused: ReaderError | None = None
    pulses: Pulses | None = None
    try:
        pulses = read().pulses
    except ReaderError as error:
        refused = error
    assert refused is None or "some file" in str(refused)
    times = np.zeros(0) if pulses is None else pulses.times
    assert times.dtype == np.float64
    assert np.all(np.isfinite(times))
    assert np.all(np.diff(times) >= 0.0)


@pytest.mark.parametrize("name", READERS)
@settings(max_examples=effort_count(quick=12, full=1000))
@given(data=st.data())
def test_damaged_arrays(name: str, data: st.DataObject) -> None:
    changed = bytearray(GOOD[name])
    for place in data.draw(st.lists(st.integers(0, len(changed) - 1), max_size=5)):
        changed[place] = data.draw(st.integers(0, 255))
    cut = bytes(changed[: data.draw(st.sampled_from([len(changed), len(changed), len(changed) // 2]))])
    where = FORMATS[name][1]
    keys = ["*"] if name == "x.mat" else []
    read = isolated(READERS[name], keys, "UTC", where)
    check(lambda: read(cut, "some file"))


@settings(max_examples=effort_count(quick=100, full=5000))
@given(data=st.data(), good=st.sampled_from([TEXT, DATES, b""]), more=st.binary(max_size=60))
def test_damaged_texts(data: st.DataObject, good: bytes, more: bytes) -> None:
    changed = bytearray(good + more)
    for place in data.draw(st.lists(st.integers(0, max(0, len(changed) - 1)), max_size=4 if changed else 0)):
        changed[place] = data.draw(st.integers(0, 255))
    check(lambda: pulse_column(bytes(changed), "some file"))
