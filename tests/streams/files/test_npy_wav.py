from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
import pytest
import soundfile
from numpy.testing import assert_array_equal
from numpy.typing import NDArray

from streams.files.formats.npy_wav import read_npy, read_wav
from streams.files.parse.complete import declared_size
from streams.files.parse.riff import is_open_wav
from streams.types.large import FileBytes
from streams.types.samples import ReaderError
from tests.support.streams_levels import open_wav


def npy_bytes(array: np.ndarray, pickled: bool = False) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=pickled)
    return stream.getvalue()


def wav_bytes(samples: np.ndarray, subtype: str, rate: int = 25600, kind: str = "WAV") -> bytes:
    stream = io.BytesIO()
    soundfile.write(stream, samples, rate, format=kind, subtype=subtype)
    return stream.getvalue()


@pytest.mark.parametrize("version", [(1, 0), (2, 0)])
def test_npy_versions(version: tuple[int, int]) -> None:
    stream = io.BytesIO()
    np.lib.format.write_array(stream, np.arange(6.0), version=version)
    assert_array_equal(read_npy(stream.getvalue(), "x.npy").values, [np.arange(6.0)])


@pytest.mark.parametrize("dtype", ["f4", "f8", ">f8", "i2", "i4", "u1"])
def test_npy_longer_axis_is_time(dtype: str) -> None:
    array = np.arange(30).reshape(3, 10).astype(dtype)
    wide, tall = read_npy(npy_bytes(array), "x.npy"), read_npy(npy_bytes(array.T), "x.npy")
    assert_array_equal(wide.values, array)
    assert_array_equal(tall.values, array)
    assert tall.values.flags.c_contiguous
    assert wide.values.dtype == (np.float64 if dtype in ("f8", ">f8", "i4") else np.float32)
    assert wide.rate is None
    assert wide.units == (None,) * 3


def test_npy_pickles_are_never_loaded() -> None:
    with pytest.raises(ReaderError, match="pickled") as caught:
        read_npy(npy_bytes(np.array([{"a": 1}, None], dtype=object), pickled=True), "x.npy")
    assert caught.value.status == "unreadable"


def test_npy_that_lies_about_its_size() -> None:
    huge = npy_bytes(np.zeros(1000)).replace(b"(1000,)", b"(10**99").replace(b"(10**99", b"(9999,)")
    with pytest.raises(ReaderError, match="promises 79992 bytes, 8000 are there") as caught:
        read_npy(huge, "x.npy")
    assert caught.value.status == "incomplete"


@pytest.mark.parametrize(
    ("data", "status"),
    [
        (b"", "empty"),
        (b"PK\x03\x04", "unreadable"),
        (b"1,2,3\n4,5,6\n", "unreadable"),
        (npy_bytes(np.zeros(100))[:-8], "incomplete"),
        (npy_bytes(np.zeros(100)) + b"tail", "unreadable"),
        (npy_bytes(np.zeros((4, 4))), "wrong_shape"),
        (npy_bytes(np.zeros((2, 3, 4))), "wrong_shape"),
        (npy_bytes(np.zeros(0)), "empty"),
        (npy_bytes(np.zeros(4, dtype=complex)), "unreadable"),
        (npy_bytes(np.array(["a", "b"])), "unreadable"),
    ],
)
def test_npy_wrong_inputs(data: bytes, status: str) -> None:
    with pytest.raises(ReaderError, match=r"x\.npy") as caught:
        read_npy(data, "x.npy")
    assert caught.value.status == status


@pytest.mark.parametrize(("subtype", "exact"), [("PCM_16", 2**15), ("PCM_24", 2**23), ("PCM_32", 2**31)])
def test_wav_integers_are_fractions_of_full_scale(subtype: str, exact: int) -> None:
    counts = np.array([[-exact, 1], [exact - 1, -1], [exact // 2, 0]])
    reading = read_wav(wav_bytes(counts / exact, subtype), "x.wav")
    assert reading.rate == 25600
    assert_array_equal(reading.values * exact, counts.T)
    assert reading.values.dtype == (np.float64 if subtype == "PCM_32" else np.float32)


def test_wav_floats_stand_as_they_are_and_flac_is_read() -> None:
    samples = np.array([0.5, -30.0, 17.25])
    assert_array_equal(read_wav(wav_bytes(samples, "FLOAT"), "x.wav").values, [samples])
    assert_array_equal(read_wav(wav_bytes(samples / 64, "PCM_24", kind="FLAC"), "x.flac").values, [samples / 64])


@pytest.mark.parametrize("claimed", [4_000_000_000, 0xFFFFFFFF, 402])
def test_wav_header_that_lies(claimed: int) -> None:
    data = bytearray(wav_bytes(np.zeros(200), "PCM_16"))
    position = data.index(b"data") + 4
    assert int.from_bytes(data[position : position + 4], "little") == 400
    data[position : position + 4] = claimed.to_bytes(4, "little")
    with pytest.raises(ReaderError, match=f"promises {claimed} bytes, 400 are there") as caught:
        read_wav(bytes(data), "x.wav")
    assert caught.value.status == "incomplete"


@pytest.mark.parametrize(
    ("data", "status"),
    [
        (b"", "empty"),
        (b"garbage that is no sound", "unreadable"),
        (wav_bytes(np.zeros(0), "PCM_16"), "empty"),
        (wav_bytes(np.zeros(100), "PCM_16")[:30], "incomplete"),
        (wav_bytes(np.zeros(100), "PCM_16")[:-20], "incomplete"),
    ],
)
def test_wav_wrong_inputs(data: bytes, status: str) -> None:
    with pytest.raises(ReaderError, match=r"x\.wav") as caught:
        read_wav(data, "x.wav")
    assert caught.value.status == status


COUNTS = np.arange(-500, 500, dtype=np.int16) * 3
LIST = b"LIST" + struct.pack("<I", 26) + b"INFOISFT" + struct.pack("<I", 14) + b"Lavf58.29.100\0"
ID3 = b"id3 " + struct.pack("<I", 5) + b"abcde"


@pytest.mark.parametrize("tail", [b"", LIST, LIST + ID3, LIST + ID3 + b"\0", ID3 + b"\0" + LIST])
@pytest.mark.parametrize("size", [0xFFFFFFFF, 0x7FFFFFFF, 0x7FFFF000, 0x80000000])
def test_sound_of_a_stream_ends_where_its_last_chunks_begin(size: int, tail: bytes, tmp_path: Path) -> None:
    data = open_wav(COUNTS, size, tail)
    assert declared_size(data, "x.wav") is None
    assert is_open_wav(data)
    assert_array_equal(read_wav(data, "x.wav").values, [COUNTS / np.float32(2**15)])
    (tmp_path / "x.wav").write_bytes(data)
    assert_array_equal(read_wav(FileBytes.opened(str(tmp_path / "x.wav")), "x.wav").values[0] * 2**15, COUNTS)


@pytest.mark.parametrize("tail", [b"", LIST])
def test_sound_that_was_never_closed_is_incomplete(tail: bytes) -> None:
    with pytest.raises(
        ReaderError, match=r"states no samples, 20\d\d bytes follow: its writer never closed it"
    ) as caught:
        read_wav(open_wav(COUNTS, 0, tail), "x.wav")
    assert caught.value.status == "incomplete"
    # Other chunks behind no samples are no samples.
    with pytest.raises(ReaderError, match="holds no samples"):
        read_wav(open_wav(COUNTS[:0], 0, tail), "x.wav")


def test_flac_without_a_length_is_refused() -> None:
    data = bytearray(wav_bytes(COUNTS / 2**15, "PCM_16", kind="FLAC"))
    # The last 36 bits before the sum of its samples.
    data[21] &= 0xF0
    data[22:26] = bytes(4)
    with pytest.raises(ReaderError, match=r"x\.flac: the header does not state how many samples there are") as caught:
        read_wav(bytes(data), "x.flac")
    assert caught.value.status == "incomplete"


def rf64(samples: int, there: NDArray[np.int16], tail: bytes = LIST) -> bytes:
    sizes = struct.pack("<4sIQQQI", b"ds64", 28, 72 + samples + len(tail), samples, samples // 2, 0)
    return open_wav(there, 0xFFFFFFFF, tail, b"RF64", sizes)


def test_sizes_of_64_bits() -> None:
    data = rf64(2 * COUNTS.size, COUNTS)
    assert declared_size(data, "x.wav") == len(data)
    assert_array_equal(read_wav(data, "x.wav").values[0] * 2**15, COUNTS)
    assert declared_size(data[:-50], "x.wav") == len(data)
    for broken, words in ((data[:-50], "promises 2000 bytes, 1984 are there"), (rf64(0, COUNTS), "never closed it")):
        with pytest.raises(ReaderError, match=words):
            read_wav(broken, "x.wav")
