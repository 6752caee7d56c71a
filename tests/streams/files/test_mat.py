from __future__ import annotations

import io
import struct
import zlib
from typing import Any

import numpy as np
import pytest
import scipy.io
from numpy.testing import assert_array_equal

from streams.files.formats.mat import load_mat, mat_variables, read_mat, scalar
from streams.files.parse import worker
from streams.types.samples import ReaderError

EIGHT = 1793520000.0
"""2026-11-01 08:00 UTC."""


def mat_bytes(values: dict[str, Any], compressed: bool = False) -> bytes:
    stream = io.BytesIO()
    scipy.io.savemat(stream, values, do_compression=compressed)
    return stream.getvalue()


@pytest.mark.parametrize("compressed", [False, True])
def test_vectors_matrices_and_fields_of_structures(compressed: bool) -> None:
    vector = np.linspace(-1, 1, 50)
    data = mat_bytes(
        {"a": vector, "m": np.arange(100.0).reshape(50, 2), "s": {"gs": vector[:, None], "sr": 48828, "load": "200"}},
        compressed,
    )
    assert mat_variables(data, "x.mat")["m"] == ((50, 2), "double")
    assert_array_equal(read_mat(data, "x.mat", ["a"]).values, [vector])
    reading = read_mat(data, "x.mat", ["m", "s.gs"])
    assert reading.names == ("m_1", "m_2", "s.gs")
    assert_array_equal(reading.values, [np.arange(0, 100, 2), np.arange(1, 100, 2), vector])
    values = load_mat(data, "x.mat", ["s.*"])
    assert scalar(values, "s.sr") == 48828
    assert scalar(values, "s.load") == 200
    assert scalar(values, "s.gs") is None
    assert scalar(values, "s.none") is None


def test_missing_variable_names_what_is_there() -> None:
    with pytest.raises(ReaderError, match=r"no vector matches b\*; it holds a double\[1, 5\]") as caught:
        read_mat(mat_bytes({"a": np.arange(5.0)}), "x.mat", ["b*"])
    assert caught.value.status == "wrong_shape"


def test_vectors_of_different_lengths_are_refused() -> None:
    with pytest.raises(ReaderError, match="different lengths: a 5, b 6"):
        read_mat(mat_bytes({"a": np.arange(5.0), "b": np.arange(6.0)}), "x.mat")


def test_square_matrix_is_refused() -> None:
    with pytest.raises(ReaderError, match="cannot tell samples from channels"):
        read_mat(mat_bytes({"a": np.eye(5)}), "x.mat")


@pytest.mark.parametrize(
    ("data", "status"),
    [
        (b"", "empty"),
        (b"MATLAB 5.0 MAT-file", "unreadable"),
        (b"\x89HDF\r\n\x1a\n" + bytes(200), "unreadable"),
        (b"MATLAB 7.3 MAT-file" + bytes(200), "unreadable"),
        (b"1,2,3\n" * 100, "unreadable"),
    ],
)
def test_what_is_no_mat_file(data: bytes, status: str) -> None:
    with pytest.raises(ReaderError) as caught:
        mat_variables(data, "x.mat")
    assert caught.value.status == status


@pytest.mark.parametrize("compressed", [False, True])
def test_truncated_file_is_incomplete(compressed: bool) -> None:
    data = mat_bytes({"a": np.random.default_rng(1).normal(size=1000)}, compressed)
    with pytest.raises(ReaderError) as caught:
        read_mat(data[: len(data) // 2], "x.mat")
    assert caught.value.status == "incomplete"


def test_claims_are_checked_before_anything_is_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker, "max_loaded_bytes", lambda stored: 100_000)
    # Zeros compress a thousandfold, and whosmat does not look into a structure.
    data = mat_bytes({"s": {"gs": np.zeros(200_000)}}, compressed=True)
    assert len(data) < 10_000
    with pytest.raises(ReaderError, match="claims") as caught:
        read_mat(data, "x.mat", ["s.gs"])
    assert caught.value.status == "refused"


def test_lying_size_of_a_compressed_variable() -> None:
    data = bytearray(mat_bytes({"a": np.zeros(4)}))
    packed = zlib.compress(struct.pack("<II", 14, 1 << 31) + bytes(64))
    lying = bytes(data[:128]) + struct.pack("<II", 15, len(packed)) + packed
    with pytest.raises(ReaderError) as caught:
        mat_variables(lying, "x.mat")
    assert caught.value.status in ("refused", "unreadable")


def test_random_damage_never_escapes() -> None:
    rng = np.random.default_rng(3)
    good = mat_bytes({"a": rng.normal(size=200), "s": {"gs": rng.normal(size=50)}})
    outcomes = set()
    for _ in range(150):
        data = bytearray(good)
        for position in rng.integers(128, len(good), 5):
            data[position] = rng.integers(256)
        try:
            read_mat(bytes(data), "x.mat", ["a"])
            outcomes.add("read")
        except ReaderError as error:
            outcomes.add(error.status)
    assert outcomes <= {"read", "unreadable", "incomplete", "refused", "wrong_shape", "empty"}
    assert len(outcomes) > 1


@pytest.mark.parametrize(
    ("values", "rate", "unit", "start"),
    [
        ({"a": np.arange(9.0), "fs": 25600.0, "unit": "m/s^2", "t0": "2026-11-01 08:00:00"}, 25600.0, "m/s2", EIGHT),
        ({"a": np.arange(9.0), "dt": 1e-3, "t0": 740287 + 1 / 3}, 1000.0, None, EIGHT),
        (
            {"day": {"a": np.arange(9.0), "Fs": 2000.0, "Einheit": "mV", "Datum": "01.11.2026 08:00:00"}},
            2e3,
            "mV",
            EIGHT,
        ),
        ({"a": np.arange(9.0), "n": 3.0}, None, None, None),
    ],
)
def test_scalars_and_texts_state_rate_unit_and_start(
    values: dict[str, Any], rate: float | None, unit: str | None, start: float | None
) -> None:
    for patterns in (["*"], ["a", "day.a"]):
        found = read_mat(mat_bytes(values), "x.mat", patterns, "UTC")
        assert (found.rate, found.units, found.start) == (rate, (unit,), start)
        assert_array_equal(found.values, [np.arange(9.0)])


def test_contradictory_rates_are_refused() -> None:
    with pytest.raises(ReaderError, match="several sampling rates: fs 1000 Hz, dt 500 Hz"):
        read_mat(mat_bytes({"a": np.arange(9.0), "fs": 1000.0, "dt": 2e-3}), "x.mat", zone="UTC")
