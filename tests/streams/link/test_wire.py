"""The wire: what is written is read back; whatever else comes is refused in words."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
import pytest
from google_crc32c import value as crc32c
from hypothesis import given, settings
from hypothesis import strategies as st

from streams.link.wire import (
    HEAD,
    Frame,
    WireError,
    block_frame,
    decode_frame,
    encode_frame,
    frame_length,
    hello,
    hello_length,
    hello_stream,
    hello_version,
    refusal,
)
from streams.types.block import Block
from streams.types.samples import Samples
from streams.types.spec import MAX_FRAME
from tests.oracles.crc32c_oracle import crc32c_bitwise
from tests.support.effort import effort_count

KINDS = ("<i2", "<i4", "<f4", "<f8")


OF_FRAME = ("sequence", "start", "scale", "after")
OF_SAMPLES = ("rate", "channels", "units", "speed", "load", "elapsed")


def make(kind: str = "<f4", **changes: Any) -> Frame:
    of_samples: dict[str, Any] = {
        "rate": 25600.0,
        "values": (np.arange(20).reshape(2, 10) - 7).astype(kind),
        "channels": ("a", "b"),
        "units": ("g", "V"),
    }
    of_samples |= {key: value for key, value in changes.items() if key not in OF_FRAME}
    of_frame: dict[str, Any] = {"sequence": 3} | {key: value for key, value in changes.items() if key in OF_FRAME}
    return Frame(samples=Samples(**of_samples), **of_frame)


def sealed(body: bytes) -> bytes:
    return body + struct.pack("<I", crc32c_bitwise(body))


def with_header(
    header: Any, count: int = 4, channels: int = 1, rate: float = 100.0, sequence: int = 9, start: int = 0
) -> bytes:
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    head = HEAD.pack(b"SPW1", 1, channels, sequence, rate, count, 1, start, len(text))
    return sealed(head + text + bytes(2 * channels * count))


@pytest.mark.parametrize(
    ("data", "value"),
    [
        (b"123456789", 0xE3069283),
        # RFC 3720, section B.4
        (bytes(32), 0x8A9136AA),
        (b"\xff" * 32, 0x62A8AB43),
        (bytes(range(32)), 0x46DD794E),
        (b"", 0),
    ],
)
def test_checksum_of_published_messages(data: bytes, value: int) -> None:
    assert crc32c(data) == value
    assert crc32c_bitwise(data) == value


@given(st.binary(max_size=200), st.integers(0, 300))
@settings(max_examples=effort_count(quick=20, full=2000))
def test_checksum_is_that_of_the_definition(data: bytes, more: int) -> None:
    data = data + bytes(range(256)) * (more // 4)
    assert crc32c(data) == crc32c_bitwise(data)


@given(
    kind=st.sampled_from(KINDS),
    shape=st.tuples(st.integers(1, 5), st.integers(1, 40)),
    sequence=st.integers(1, 2**63 - 1),
    rate=st.floats(1.0, 1e8),
    start=st.none() | st.integers(-2_208_988_800 * 10**9, 4_102_444_800 * 10**9 - 1),
    scale=st.floats(1e-6, 1e6),
    speed=st.none() | st.floats(1e-3, 1e4),
    load=st.none() | st.floats(0.0, 1e9),
    unit=st.sampled_from(["g", "m/s2", "V", "unknown"]),
    seed=st.integers(0, 1000),
)
def test_round_trip(
    kind: str,
    shape: tuple[int, int],
    sequence: int,
    rate: float,
    start: int | None,
    scale: float,
    speed: float | None,
    load: float | None,
    unit: str,
    seed: int,
) -> None:
    size = shape[0] * shape[1] * np.dtype(kind).itemsize
    values = np.frombuffer(np.random.default_rng(seed).bytes(size), dtype=kind).reshape(shape)
    names = tuple(f"\N{LATIN SMALL LETTER U WITH DIAERESIS}{i}" for i in range(shape[0]))
    units = (unit,) * shape[0]
    samples = Samples(values, names, units=units, rate=rate, speed=speed, load=load, elapsed=0.5)
    frame = Frame(sequence, samples, start, (scale,) * shape[0], sequence - 1)
    back = decode_frame(encode_frame(frame))
    assert back.samples.values.dtype == np.dtype(kind)
    assert back.samples.values.tobytes() == values.tobytes()
    assert back.samples.values.shape == shape
    for name in OF_FRAME:
        assert getattr(back, name) == getattr(frame, name)
    for name in OF_SAMPLES:
        assert getattr(back.samples, name) == getattr(samples, name)


def test_layout_is_that_of_the_interface() -> None:
    data = encode_frame(make("<i2", start=5, speed=30.0))
    assert data[:4] == b"SPW1"
    assert struct.unpack_from("<HHQdIBqH", data, 4)[:7] == (1, 2, 3, 25600.0, 10, 3 - 2, 5)
    (length,) = struct.unpack_from("<H", data, 37)
    assert json.loads(data[39 : 39 + length]) == {"channels": ["a", "b"], "units": ["g", "V"], "speed_hz": 30.0}
    assert struct.unpack_from("<10h", data, 39 + length) == tuple(range(-7, 3))
    assert len(data) == 39 + length + 40 + 4
    assert hello("press 4") == b"SPWH" + struct.pack("<HH", 1, 7) + b"press 4"


@pytest.mark.parametrize(("kind", "result"), [("<i2", "f4"), ("<i4", "f8"), ("<f4", "f4"), ("<f8", "f8")])
def test_scaling_keeps_all_bits_that_were_sampled(kind: str, result: str) -> None:
    frame = make(kind, scale=(0.5, 2.0))
    scaled = frame.scaled().values
    assert scaled.dtype == np.dtype(result)
    np.testing.assert_array_equal(scaled, frame.samples.values * np.array([[0.5], [2.0]]))


def test_scale_that_overflows_is_no_error() -> None:
    assert np.isinf(decode_frame(encode_frame(make("<f4", scale=(1e300, 1.0)))).scaled().values[0, 0])


@given(st.binary(max_size=120))
@settings(max_examples=effort_count(quick=60, full=20000))
def test_nonsense_is_refused(data: bytes) -> None:
    with pytest.raises(WireError):
        decode_frame(data)
    with pytest.raises(WireError):
        decode_frame(b"SPW1\x01\x00" + data)


@given(st.data())
@settings(max_examples=effort_count(quick=40, full=5000))
def test_any_damage_is_refused(data: st.DataObject) -> None:
    whole = bytearray(encode_frame(make()))
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(whole) - 1))
        whole[place] ^= data.draw(st.integers(1, 255))
    cut = data.draw(st.integers(0, len(whole)))
    if bytes(whole) != encode_frame(make()):
        with pytest.raises(WireError):
            decode_frame(bytes(whole))
    if cut < len(whole):
        with pytest.raises(WireError):
            decode_frame(bytes(whole[:cut]))


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)


@given(
    st.fixed_dictionaries(
        {},
        optional=dict.fromkeys(("channels", "units", "scale", "speed_hz", "load_newton", "elapsed_s", "after"), JSON),
    )
)
@settings(max_examples=effort_count(quick=60, full=10000))
def test_any_header_is_taken_or_refused(header: dict[str, Any]) -> None:
    data = with_header({"channels": ["x"], "units": ["g"], **header})
    sequence = None
    try:
        sequence = decode_frame(data).sequence
    except WireError as error:
        # The checksum is right, so the frame has a number and takes its place.
        sequence = error.sequence
    assert sequence == 9


@pytest.mark.parametrize(
    ("data", "status", "words"),
    [
        (with_header(b"[" * 60000), "unreadable", "JSON"),
        (with_header(b"\xff"), "unreadable", "JSON"),
        (with_header([1]), "unreadable", "object"),
        (with_header(b'{"channels": ["x"], "units": ["g"], "scale": NaN}'), "unreadable", "NaN"),
        (with_header(b'{"channels": ["x"], "units": ["g"], "scale": 1' + b"0" * 400 + b"}"), "wrong_unit", "scale"),
        (with_header({"channels": ["x"], "units": ["furlong"]}), "wrong_unit", "furlong"),
        (with_header({"channels": ["x\n"], "units": ["g"]}), "wrong_shape", "printable"),
        (with_header({"channels": ["x", "x"], "units": ["g", "g"]}, channels=2), "wrong_shape", "different"),
        (with_header({"channels": ["x"], "units": ["g"], "speed_hz": 0}), "unreadable", "speed_hz"),
        (with_header({"channels": ["x"], "units": ["g"]}, rate=float("nan")), "wrong_rate", "rate"),
        (with_header({"channels": ["x"], "units": ["g"]}, rate=-1.0), "wrong_rate", "rate"),
        (with_header({"channels": ["x"], "units": ["g"]}, count=0), "empty", "samples"),
        *(
            (with_header({"channels": ["x"], "units": ["g"], **more}), "unreadable", words)
            for more, words in (
                ({"speed_hz": 1e-308}, "speed_hz must be a number from 0.001 to 10000, got 1e-308"),
                ({"speed_hz": 12_000.0}, "got 12000"),
                ({"load_newton": -1.0}, "load_newton must be a number from 0 to 1e.09, got -1"),
                ({"load_newton": 1e300}, "got 1e.300"),
                ({"load_newton": "heavy"}, "got str"),
                ({"elapsed_s": 1e300}, "elapsed_s"),
                ({"after": 9}, "after must be below the sequence, got 9 in frame 9"),
                ({"after": 2**62}, "after must be below the sequence"),
            )
        ),
        *(
            (with_header({"channels": ["x"], "units": ["g"]}, rate=rate), "wrong_rate", "1 to 1e.08 Hz")
            for rate in (1e-300, 0.5, 1e300, float("inf"))
        ),
        *(
            (with_header({"channels": ["x"], "units": ["g"]}, start=start), "unreadable", "from 1900 to 2100")
            for start in (2**63 - 1, 1 - 2**63, 4_102_444_800 * 10**9)
        ),
    ],
)
def test_wrong_content_names_status_and_cause(data: bytes, status: str, words: str) -> None:
    with pytest.raises(WireError, match=words) as caught:
        decode_frame(data)
    assert (caught.value.status, caught.value.sequence) == (status, 9)


@pytest.mark.parametrize("sequence", [0, 2**63, 2**64 - 1])
def test_number_outside_the_range_is_no_number(sequence: int) -> None:
    with pytest.raises(WireError, match="sequence") as caught:
        decode_frame(with_header({"channels": ["x"], "units": ["g"]}, sequence=sequence))
    assert caught.value.sequence is None


def test_lying_lengths_are_refused_before_anything_is_allocated() -> None:
    head = HEAD.pack(b"SPW1", 1, 1024, 1, 1.0, 2**32 - 1, 4, 0, 0)
    with pytest.raises(WireError, match=f"at most {MAX_FRAME} bytes"):
        frame_length(head)
    with pytest.raises(WireError, match="at most 1024 channels"):
        frame_length(HEAD.pack(b"SPW1", 1, 1025, 1, 1.0, 1, 4, 0, 0))
    with pytest.raises(WireError, match="sample type"):
        frame_length(HEAD.pack(b"SPW1", 1, 1, 1, 1.0, 1, 9, 0, 0))
    with pytest.raises(WireError, match="version 3"):
        frame_length(HEAD.pack(b"SPW1", 3, 1, 1, 1.0, 1, 1, 0, 0))
    with pytest.raises(WireError, match="at most"):
        encode_frame(make(values=np.zeros((2, 1 << 21), dtype="<f8")))


def test_a_refusal_is_as_long_as_it_says() -> None:
    for reason in ("no", "\N{GREEK SMALL LETTER ALPHA}" * 400):
        answer = refusal(reason)
        (length,) = struct.unpack_from("<Q", answer)
        assert length >> 63 == 1
        assert len(answer) == 8 + (length ^ 2**63)
        assert reason.startswith(answer[8:].decode())


def test_hello_is_checked() -> None:
    whole = hello("rig-\N{GREEK SMALL LETTER ALPHA}")
    assert hello_length(whole[:8]) == len(whole)
    assert hello_stream(whole) == "rig-\N{GREEK SMALL LETTER ALPHA}"
    for name in ("", "x" * 65):
        with pytest.raises(WireError, match="64 bytes"):
            hello(name)
    assert hello_version(whole) == 1
    assert hello_version(hello("press", 2)) == 2
    assert hello_length(hello("press", 2)) == 13
    for bad in (b"SPWH" + struct.pack("<HH", 1, 0), b"SPWH" + struct.pack("<HH", 3, 3), b"GET / HT"):
        with pytest.raises(WireError):
            hello_length(bad)
    for bad in (whole[:8] + b"\xff\xfe", whole[:8] + b"a\nb"):
        with pytest.raises(WireError, match="stream id"):
            hello_stream(bad)


@pytest.mark.parametrize(
    "changes",
    [
        {"values": np.zeros((2, 3), dtype=np.uint8)},
        {"values": np.zeros((2, 0), dtype=np.float32)},
        {"sequence": 0},
        {"sequence": 2**70},
        {"rate": float("inf")},
        {"units": ("g", "parsec")},
        {"scale": (1.0,)},
        {"scale": (float("nan"), 1.0)},
        {"channels": ("a" * 40000, "b" * 40000)},
        {"speed": float("nan")},
        {"speed": 12_000.0},
        {"rate": 0.5},
        {"start": 2**62},
        {"after": 3},
    ],
)
def test_what_could_not_be_read_is_not_written(changes: dict[str, Any]) -> None:
    with pytest.raises(WireError):
        encode_frame(make(**changes))


def test_rows_that_do_not_fit_make_no_frame() -> None:
    with pytest.raises(ValueError, match="2 rows of samples"):
        make(channels=("a",))


def test_a_block_keeps_what_it_knows() -> None:
    block = Block(np.ones((1, 8)), 100.0, ("x",), ("g",), "s", 4, "n", start=1.5e9 + 0.25, elapsed=2.0, speed=30.0)
    frame = decode_frame(encode_frame(block_frame(block)))
    samples = frame.samples
    assert (frame.start, samples.elapsed, samples.speed, samples.load) == (1_500_000_000_250_000_000, 2.0, 30.0, None)
