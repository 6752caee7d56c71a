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

from models.errors import SpallwatchError
from streams.block import Block
from streams.samples import Samples
from streams.spec import MAX_FRAME, UNITS

VERSION = 1
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
MAX_SEQUENCE = 2**63 - 1
MAX_REASON_BYTES = 500

_SPEED_HZ = (1e-3, 1e4)
_LOAD_NEWTON = (0.0, 1e9)
_RATE_HZ = (1.0, 1e8)
_ELAPSED_S = (0.0, 1e10)
_START_NS = (-2_208_988_800 * 10**9, 4_102_444_800 * 10**9)
"""From 1900 to 2100."""

SAMPLE_TYPES: Mapping[int, np.dtype[Any]] = {
    1: np.dtype("<i2"),
    2: np.dtype("<i4"),
    3: np.dtype("<f4"),
    4: np.dtype("<f8"),
}


class WireError(SpallwatchError):
    """Bytes break the protocol; the message states what was expected and received.

    ``status`` is a rejection status of the interface. ``sequence`` is the number of the frame where its checksum is
    right, else None: then not even its length is reliable, and a connection must be closed.
    """

    def __init__(self, reason: str, status: str = "unreadable", sequence: int | None = None) -> None:
        """Keep status and sequence beside the message."""
        super().__init__(reason)
        self.status = status
        self.sequence = sequence


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
    """

    sequence: int
    samples: Samples
    start: int | None = None
    scale: tuple[float, ...] = ()
    after: int | None = None

    def scaled(self) -> Samples:
        """Return the dated samples in their units, float32 where 24 bits hold their type."""
        values = self.samples.values
        kind = np.float32 if values.dtype.itemsize == 2 or values.dtype == np.float32 else np.float64
        scaled = values.astype(kind)
        if any(factor != 1.0 for factor in self.scale):
            # A value out of range becomes inf, which the quality stage names.
            with np.errstate(over="ignore", invalid="ignore"):
                scaled = (scaled * np.asarray(self.scale, dtype=np.float64)[:, np.newaxis]).astype(kind)
        return replace(self.samples, values=scaled, start=None if self.start is None else self.start * 1e-9)


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
    """Return the length of a whole frame from its first ``HEAD.size`` bytes.

    Raises:
        WireError: no frame of this version, an unknown sample type, or larger than allowed.
    """
    if len(data) < HEAD.size:
        raise WireError(f"a frame has at least {HEAD.size + _CRC.size} bytes, got {len(data)}")
    magic, version, channels, _, _, samples, kind, _, json_length = HEAD.unpack_from(data)
    _check_magic(magic, version, FRAME_MAGIC, "a frame")
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


def decode_frame(data: bytes | bytearray | memoryview, limit: int = MAX_FRAME) -> Frame:
    """Return the frame in bytes from magic to checksum; its samples are a view.

    Raises:
        WireError: with ``sequence`` where the checksum is right but the content is not.
    """
    view = memoryview(data)
    length = frame_length(bytes(view[: HEAD.size]), limit)
    if len(view) != length:
        raise WireError(f"the frame says {length} bytes, {len(view)} came")
    checksum, found = _CRC.unpack(view[-_CRC.size :])[0], crc32c(bytes(view[: -_CRC.size]))
    if checksum != found:
        raise WireError(f"the checksum is {checksum:08x}, of these bytes it is {found:08x}")
    _, _, channels, sequence, rate, count, kind, start, json_length = HEAD.unpack_from(view)
    if not 1 <= sequence <= MAX_SEQUENCE:
        raise WireError(f"a sequence is 1 to {MAX_SEQUENCE}, got {sequence}")
    try:
        _check_head(rate, start)
        if not channels or not count:
            raise WireError(f"no samples: {channels} channels of {count} samples", "empty")
        stated, scale, after = _json_header(bytes(view[HEAD.size : HEAD.size + json_length]), channels)
        _check_after(sequence, after)
    except WireError as error:
        raise WireError(str(error), error.status, sequence) from None
    values = np.frombuffer(view, SAMPLE_TYPES[kind], channels * count, HEAD.size + json_length)
    samples = Samples(values.reshape(channels, count), rate=rate, **stated)
    return Frame(sequence, samples, None if start == UNDATED else start, scale, after)


def _check_head(rate: float, start: int) -> None:
    if not _RATE_HZ[0] <= rate <= _RATE_HZ[1]:
        raise WireError(f"the rate must be {_RATE_HZ[0]:g} to {_RATE_HZ[1]:g} Hz, got {rate:g} Hz", "wrong_rate")
    if start != UNDATED and not _START_NS[0] <= start < _START_NS[1]:
        raise WireError(f"the start must be from 1900 to 2100, got {start * 1e-9:.0f} s since 1970")


def _check_after(sequence: int, after: int | None) -> None:
    if after is not None and after >= sequence:
        raise WireError(f"after must be below the sequence, got {after} in frame {sequence}")


def _refuse_constant(word: str) -> None:
    raise ValueError(f"{word} is not JSON")


def _json_header(text: bytes, channels: int) -> tuple[dict[str, Any], tuple[float, ...], int | None]:
    """Return what the JSON header states: fields of the samples, scale, frame before."""
    try:
        header = json.loads(text.decode(), parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise WireError(f"the header is not JSON: {type(error).__name__}: {error}") from None
    if not isinstance(header, dict):
        raise WireError(f"the header must be a JSON object, got {type(header).__name__}")
    names = _words(header, "channels", channels)
    if len(set(names)) != channels or not all(name and name.isprintable() for name in names):
        raise WireError(f"channels must be different printable names, got {names!a}", "wrong_shape")
    units = _words(header, "units", channels)
    unknown = [unit for unit in units if unit not in UNITS]
    if unknown:
        raise WireError(f"units must be of {', '.join(UNITS)}, got {unknown[0]!a}", "wrong_unit")
    rows: dict[str, Any] = {
        "channels": names,
        "units": units,
        "speed": _number(header, "speed_hz", _SPEED_HZ),
        "load": _number(header, "load_newton", _LOAD_NEWTON),
        "elapsed": _number(header, "elapsed_s", _ELAPSED_S),
    }
    return rows, _scale(header, channels), _whole(header, "after")


def _words(header: Mapping[str, Any], key: str, channels: int) -> tuple[str, ...]:
    values = header.get(key)
    if not isinstance(values, list) or len(values) != channels or not all(isinstance(value, str) for value in values):
        raise WireError(f"{key} must be a list of {channels} words", "wrong_shape")
    return tuple(values)


def _scale(header: Mapping[str, Any], channels: int) -> tuple[float, ...]:
    values = header.get("scale")
    if values is None:
        return (1.0,) * channels
    if not isinstance(values, list):
        values = [values] * channels
    if len(values) != channels or not all(_is_number(value) and float(value) != 0.0 for value in values):
        raise WireError(f"scale must be one number or {channels}, finite and not 0", "wrong_unit")
    return tuple(float(value) for value in values)


def _number(header: Mapping[str, Any], key: str, limits: tuple[float, float]) -> float | None:
    value = header.get(key)
    if value is None:
        return None
    if not _is_number(value) or not limits[0] <= value <= limits[1]:
        found = f"{value:g}" if _is_number(value) else type(value).__name__
        raise WireError(f"{key} must be a number from {limits[0]:g} to {limits[1]:g}, got {found}")
    return float(value)


def _whole(header: Mapping[str, Any], key: str) -> int | None:
    value = header.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= MAX_SEQUENCE:
        raise WireError(f"{key} must be a whole number from 0 to {MAX_SEQUENCE}")
    return value


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False


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
    _check_after(frame.sequence, _json_header(text, n_channels)[2])
    body = b"".join((head, text, np.ascontiguousarray(values, dtype=SAMPLE_TYPES[kind]).data))
    return body + _CRC.pack(crc32c(body))


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
    )
    return Frame(block.sequence, samples, None if block.start is None else _nanoseconds(block.start), after=after)


def _nanoseconds(seconds: float) -> int:
    # The product of a present date and 1e9 has more digits than a float.
    whole = math.floor(seconds)
    return whole * 10**9 + round((seconds - whole) * 1e9)
