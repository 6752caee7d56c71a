"""The frames of TCP and MQTT: bytes to checked values and back.

Layout and rules are in docs/reference/wire.md. Each length is compared with its limit before memory is allocated; for
any bytes the only error is :class:`WireError`.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from google_crc32c import value as crc32c

from streams.link.header import MAX_SEQUENCE, WireError, header_of, stated_frame, stated_rows, time_keys
from streams.types.block import Block
from streams.types.samples import Samples
from streams.types.spec import MAX_FRAME

VERSION = 1
PULSES = 2
"""Version of a frame whose payload is times of pulses, see :mod:`streams.link.pulse_frame`."""
PROVEN = 2
"""Version of a hello whose sender proves that it has the key of the stream, and learns why it is refused."""
HELLO_MAGIC, FRAME_MAGIC = b"SPWH", b"SPW1"
HELLO = struct.Struct("<4sHH")
"""Magic, version, length of the stream id that follows."""
HEAD = struct.Struct("<4sHHQdIBqH")
"""Magic, version, channels, sequence, rate, samples a channel, sample type, start, length of the JSON header."""
ACK = struct.Struct("<Q")
"""The sequence committed last: the answer to a hello and to frames."""
REFUSED = 1 << 63
"""Set in an answer to a sender of version 2: the rest is the length of a reason in UTF-8, after which all ends."""
_CRC = struct.Struct("<I")

UNDATED = -(2**63)
"""In place of a start: the stream has no date."""
MAX_CHANNELS = 1024
MAX_STREAM_ID = 64
MAX_REASON_BYTES = 500

_RATE_HZ = (1.0, 1e8)
_START_NS = (-2_208_988_800 * 10**9, 4_102_444_800 * 10**9)
"""From 1900 to 2100."""

SAMPLE_TYPES: Mapping[int, np.dtype[Any]] = {
    1: np.dtype("<i2"),
    2: np.dtype("<i4"),
    3: np.dtype("<f4"),
    4: np.dtype("<f8"),
}


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame as sent.

    Attributes:
        sequence: of the block in its stream, from 1.
        samples: with rate and units stated, int16, int32, float32 or float64 values before scaling; without start.
        start: ns since 1970 UTC of the first sample, or None.
        scale: factor from the values to the unit, by row; empty: 1.
        after: number of the frame sent before this one (or committed), None where it is not stated; the sender skips
            the numbers between the two, but a missing ``after`` was lost on the way.
        pulses: number of pulses in the frame of pulses that was sent before this one, None where there is none.
    """

    sequence: int
    samples: Samples
    start: int | None = None
    scale: tuple[float, ...] = ()
    after: int | None = None
    pulses: int | None = None

    def scaled(self) -> Samples:
        """Return the dated samples in their units, float32 where 24 bits hold their type."""
        values = self.samples.values
        kind = np.float32 if values.dtype.itemsize == 2 or values.dtype == np.float32 else np.float64
        scaled = values.astype(kind)
        if any(factor != 1.0 for factor in self.scale):
            # A value out of range becomes inf, which the quality stage names.
            with np.errstate(over="ignore", invalid="ignore"):
                scaled = (scaled * np.asarray(self.scale, dtype=np.float64)[:, np.newaxis]).astype(kind)
        return replace(self.samples, values=scaled, start=None if self.start is None else self.start / 10**9)


class JumpError(WireError):
    """A frame is too far ahead of the last one; its number is not taken, and the sender is refused."""


def hello(stream: str, version: int = VERSION) -> bytes:
    """Return the first message of a sender; WireError for a stream id of a wrong length."""
    name = stream.encode()
    if not 1 <= len(name) <= MAX_STREAM_ID:
        raise WireError(f"a stream id has 1 to {MAX_STREAM_ID} bytes, got {len(name)}")
    return HELLO.pack(HELLO_MAGIC, version, len(name)) + name


def hello_length(data: bytes) -> int:
    """Return the length of a whole hello from its first ``HELLO.size`` bytes.

    Raises:
        WireError: no hello of a known version, or a stream id longer than allowed.
    """
    magic, version, length = HELLO.unpack_from(data)
    _check_magic(magic, version, HELLO_MAGIC, "a hello", (VERSION, PROVEN))
    if not 1 <= length <= MAX_STREAM_ID:
        raise WireError(f"a stream id has 1 to {MAX_STREAM_ID} bytes, got {length}")
    return HELLO.size + length


def hello_version(data: bytes) -> int:
    """Return the version of a whole hello."""
    return HELLO.unpack_from(data)[1]


def refusal(reason: str) -> bytes:
    """Return the last answer to a sender of version 2."""
    text = reason.encode()[:MAX_REASON_BYTES].decode(errors="ignore").encode()
    return ACK.pack(REFUSED | len(text)) + text


def hello_stream(data: bytes) -> str:
    """Return the stream id of a whole hello; WireError where it is not printable UTF-8."""
    try:
        stream = data[HELLO.size :].decode()
    except UnicodeDecodeError as error:
        raise WireError(f"the stream id is not UTF-8: {error}") from None
    if not stream.isprintable():
        raise WireError(f"the stream id holds characters that cannot be printed: {stream!a}")
    return stream


def frame_length(data: bytes, limit: int = MAX_FRAME) -> int:
    """Return the length of a whole frame, of samples or pulses, from its first ``HEAD.size`` bytes.

    Raises:
        WireError: no frame of these versions, an unknown sample type, or larger than allowed.
    """
    if len(data) < HEAD.size:
        raise WireError(f"a frame has at least {HEAD.size + _CRC.size} bytes, got {len(data)}")
    magic, version, channels, _, _, samples, kind, _, json_length = HEAD.unpack_from(data)
    _check_magic(magic, version, FRAME_MAGIC, "a frame", (VERSION, PULSES))
    if kind not in SAMPLE_TYPES:
        raise WireError(f"the sample type is 1 to 4, got {kind}")
    if channels > MAX_CHANNELS:
        raise WireError(f"a frame has at most {MAX_CHANNELS} channels, got {channels}")
    length = HEAD.size + json_length + channels * samples * SAMPLE_TYPES[kind].itemsize + _CRC.size
    if length > limit:
        raise WireError(f"a frame has at most {limit} bytes, this one says {length}")
    return length


def _check_magic(
    magic: bytes, version: int, expected: bytes, what: str, versions: tuple[int, ...] = (VERSION,)
) -> None:
    if magic != expected:
        raise WireError(f"{what} begins with {expected.decode()}, got {magic!r}")
    if version not in versions:
        known = " or ".join(map(str, versions))
        raise WireError(f"{what} of version {known} was expected, got version {version}")


def frame_version(data: bytes | bytearray | memoryview) -> int:
    """Return the version of a frame from its first bytes, 0 where there are not enough."""
    return HEAD.unpack_from(data)[1] if len(data) >= HEAD.size else 0


def whole_frame(data: bytes | bytearray | memoryview, version: int, limit: int = MAX_FRAME) -> memoryview:
    """Return the bytes from magic to checksum of a frame of one version, and of a right number.

    Raises:
        WireError: they are not, or the checksum is wrong.
    """
    view = memoryview(data)
    length = frame_length(bytes(view[: HEAD.size]), limit)
    if len(view) != length:
        raise WireError(f"the frame says {length} bytes, {len(view)} came")
    if frame_version(view) != version:
        raise WireError(f"a frame of version {version} was expected, got version {frame_version(view)}")
    checksum, found = _CRC.unpack(view[-_CRC.size :])[0], crc32c(bytes(view[: -_CRC.size]))
    if checksum != found:
        raise WireError(f"the checksum is {checksum:08x}, of these bytes it is {found:08x}")
    sequence = HEAD.unpack_from(view)[3]
    if not 1 <= sequence <= MAX_SEQUENCE:
        raise WireError(f"a sequence is 1 to {MAX_SEQUENCE}, got {sequence}")
    return view


def sealed(body: bytes) -> bytes:
    """Return a body with its checksum."""
    return body + _CRC.pack(crc32c(body))


def decode_frame(data: bytes | bytearray | memoryview, limit: int = MAX_FRAME) -> Frame:
    """Return the frame of samples in bytes from magic to checksum; its samples are a view.

    Raises:
        WireError: with ``sequence`` where the checksum is right but the content is not.
    """
    view = whole_frame(data, VERSION, limit)
    _, _, channels, sequence, rate, count, kind, start, json_length = HEAD.unpack_from(view)
    try:
        _check_head(rate, start)
        if not channels or not count:
            raise WireError(f"no samples: {channels} channels of {count} samples", "empty")
        header = header_of(bytes(view[HEAD.size : HEAD.size + json_length]))
        stated, of_frame = stated_rows(header, channels), stated_frame(header, channels)
        _check_after(sequence, of_frame["after"])
    except WireError as error:
        raise WireError(str(error), error.status, sequence) from None
    values = np.frombuffer(view, SAMPLE_TYPES[kind], channels * count, HEAD.size + json_length)
    samples = Samples(values.reshape(channels, count), rate=rate, **stated)
    return Frame(sequence, samples, None if start == UNDATED else start, **of_frame)


def _check_head(rate: float, start: int) -> None:
    if not _RATE_HZ[0] <= rate <= _RATE_HZ[1]:
        raise WireError(f"the rate must be {_RATE_HZ[0]:g} to {_RATE_HZ[1]:g} Hz, got {rate:g} Hz", "wrong_rate")
    if start != UNDATED and not _START_NS[0] <= start < _START_NS[1]:
        raise WireError(f"the start must be from 1900 to 2100, got {start * 1e-9:.0f} s since 1970")


def _check_after(sequence: int, after: int | None) -> None:
    if after is not None and after >= sequence:
        raise WireError(f"after must be below the sequence, got {after} in frame {sequence}")


def encode_frame(frame: Frame) -> bytes:
    """Return a frame as bytes.

    Raises:
        WireError: it breaks a limit of the protocol; what is encoded can be decoded.
    """
    samples, values = frame.samples, frame.samples.values
    n_channels, count = values.shape
    kind = next((key for key, kind in SAMPLE_TYPES.items() if kind == values.dtype.newbyteorder("<")), None)
    if kind is None:
        raise WireError(f"samples must be int16, int32, float32 or float64, got {values.dtype}")
    header: dict[str, Any] = {"channels": list(samples.channels), "units": list(samples.units)}
    if any(factor != 1.0 for factor in frame.scale):
        header["scale"] = list(frame.scale)
    known = {"speed_hz": samples.speed, "load_newton": samples.load, "elapsed_s": samples.elapsed, "after": frame.after}
    known |= {"pulses": frame.pulses, "pulses_per_revolution": samples.pulses_per_revolution}
    known |= {} if frame.start is None else time_keys(samples.stated)
    header |= {key: value for key, value in known.items() if value is not None}
    rate = samples.known_rate
    try:
        text = json.dumps(header, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode()
        start = UNDATED if frame.start is None else frame.start
        head = HEAD.pack(*(FRAME_MAGIC, VERSION, n_channels, frame.sequence, rate, count, kind, start, len(text)))
    except (struct.error, ValueError) as error:
        raise WireError(f"the frame cannot be written: {error}") from None
    frame_length(head)
    if not 1 <= frame.sequence <= MAX_SEQUENCE or not count:
        raise WireError(f"frame {frame.sequence}: {count} samples")
    if frame.scale and len(frame.scale) != n_channels:
        raise WireError(f"frame {frame.sequence}: {len(frame.scale)} scales for {n_channels} channels")
    _check_head(rate, start)
    stated_rows(read := header_of(text), n_channels)
    _check_after(frame.sequence, stated_frame(read, n_channels)["after"])
    return sealed(b"".join((head, text, np.ascontiguousarray(values, dtype=SAMPLE_TYPES[kind]).data)))


def block_frame(block: Block, after: int | None = None) -> Frame:
    """Return the frame that carries a block; see :class:`Frame` for ``after``."""
    samples = Samples(
        block.samples,
        block.channels,
        units=block.units,
        rate=block.rate,
        elapsed=block.elapsed,
        speed=block.speed,
        load=block.load,
        pulses_per_revolution=block.pulses_per_revolution,
        stated=block.stated,
    )
    start = None if block.start is None else nanoseconds(block.start)
    pulses = None if block.pulses is None else block.pulses.times.size
    return Frame(block.sequence, samples, start, after=after, pulses=pulses)


def nanoseconds(seconds: float) -> int:
    """Return whole nanoseconds since 1970."""
    # The product of a present date and 1e9 has more digits than a float.
    whole = math.floor(seconds)
    return whole * 10**9 + round((seconds - whole) * 1e9)
