"""Samples without a header, whose layout a side-car states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from streams.files.foreign import HOW_TO_STATE
from streams.files.parse.child import isolated
from streams.files.parse.worker import from_disk
from streams.types import large
from streams.types.large import Data, FileBytes, contiguous, empty_rows, forget_pages
from streams.types.limits import MAX_BYTES
from streams.types.listing import packed_suffix
from streams.types.samples import COUNTS, VALUES, ReaderError, Samples, check_rows

_MAX_LOOKED, _MAX_ABSURD = 1 << 14, 0.05
_MAGNITUDES = (1e-30, 1e20)
"""Amounts between which the numbers of a sensor are in any unit."""
RAW_ENDINGS = (".bin", ".raw", ".dat")
_ORDERS = {"little": "<", "big": ">"}
_TYPES = {
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int24": "", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
_MAX_HEADER_BYTES = 1 << 20


@dataclass(frozen=True)
class Layout:
    """How samples are stored.

    Attributes:
        type: of a number: a key of ``_TYPES``.
        order: of its bytes, "little" or "big".
        channels: numbers of a frame.
        interleaved: whether the numbers of a frame follow each other, or those of a channel.
        header_bytes: before the first number.
    """

    type: str
    order: str
    channels: int
    interleaved: bool
    header_bytes: int = 0

    @property
    def number_bytes(self) -> int:
        """Bytes of a number."""
        return 3 if self.type == "int24" else int(_TYPES[self.type][1])


def layout_of(values: object, path: str) -> Layout:
    """Return the layout that a side-car states.

    Raises:
        ReaderError: ``unreadable``, which names the key, what was expected and what came.
    """

    def refused(key: str, expected: str) -> ReaderError:
        got = str(values.get(key.partition(".")[2])) if isinstance(values, dict) and "." in key else str(values)
        return ReaderError("unreadable", f"{path}: {key} must be {expected}, got {got[:60]!r}")

    if not isinstance(values, dict):
        raise refused("layout", "a table of keys")
    known = ("type", "order", "channels", "interleaved", "header_bytes")
    unknown = [key for key in values if key not in known]
    if unknown:
        raise ReaderError("unreadable", f"{path}: unknown key layout.{unknown[0][:40]}; expected {', '.join(known)}")
    if str(values.get("type")) not in _TYPES:
        raise refused("layout.type", f"one of {', '.join(_TYPES)}")
    channels, header = values.get("channels"), values.get("header_bytes", 0)
    if not isinstance(channels, int) or isinstance(channels, bool) or channels < 1:
        raise refused("layout.channels", "the number of channels, from 1")
    if not isinstance(header, int) or isinstance(header, bool) or not 0 <= header <= _MAX_HEADER_BYTES:
        raise refused("layout.header_bytes", f"a number of bytes up to {_MAX_HEADER_BYTES}")
    order = values.get("order", "little" if values["type"] in ("int8", "uint8") else None)
    if str(order) not in _ORDERS:
        raise refused("layout.order", "the order of bytes, little or big")
    interleaved = values.get("interleaved", True if channels == 1 else None)
    if not isinstance(interleaved, bool):
        raise refused("layout.interleaved", "true (sample by sample) or false (channel by channel)")
    return Layout(values["type"], order, channels, interleaved, header)


def described_samples(data: Data, name: str, layout: Layout) -> Samples:
    """Read samples by their layout, in this process where a file is small: nothing of it is interpreted.

    Raises:
        ReaderError: as :func:`samples_of`.
    """
    stated = list(asdict(layout).values())
    if isinstance(data, FileBytes) or packed_suffix(name):
        return isolated(samples_of, stated)(data, name)
    return samples_of(data, name, stated)


def undescribed(data: Data, name: str) -> Samples:
    """Refuse a file whose layout nothing states.

    Raises:
        ReaderError: ``empty``, ``unreadable`` with what to write.
    """
    if not data:
        raise ReaderError("empty", f"{name}: the file has 0 bytes")
    how = HOW_TO_STATE.format(name=name.rpartition("/")[2])
    raise ReaderError("unreadable", f"{name}: {len(data)} bytes whose layout nothing states; {how}")


@from_disk
def samples_of(data: Data, name: str, stated: Sequence[Any]) -> Samples:
    """Return the samples of a file as (channel, sample): float32 of up to 24 bits, else float64.

    ``stated``: the attributes of its :class:`Layout` in order.

    Raises:
        ReaderError: ``empty``; ``wrong_shape`` where its size is no multiple of a frame; ``refused`` beyond the limits.
    """
    layout = Layout(*stated)
    body, frame = len(data) - layout.header_bytes, layout.number_bytes * layout.channels
    check_rows(layout.channels, name, "channels")
    if not data or body == 0:
        raise ReaderError("empty", f"{name}: {len(data)} bytes, of them {layout.header_bytes} of a header")
    if body < 0 or body % frame:
        raise ReaderError(
            "wrong_shape",
            f"{name}: {len(data)} bytes are a header of {layout.header_bytes} and {body}, which are no multiple of "
            f"{frame}: {layout.channels} x {layout.type} a sample, by the layout in its side-car",
        )
    count = body // frame
    is_single = layout.number_bytes <= 3 or layout.type == "float32"
    size = count * layout.channels * (4 if is_single else 8)
    if size > MAX_BYTES:
        raise ReaderError("refused", f"{name}: {size} bytes when loaded, {MAX_BYTES} are allowed")
    held = data.mapped() if isinstance(data, FileBytes) else data
    shape = (count, layout.channels) if layout.interleaved else (layout.channels, count)
    if layout.type == "int24":
        values = _of_three_bytes(np.frombuffer(held, np.uint8, body, layout.header_bytes), shape, layout)
    else:
        dtype = np.dtype(_ORDERS[layout.order] + _TYPES[layout.type])
        stored = np.frombuffer(held, dtype, offset=layout.header_bytes).reshape(shape)
        if dtype.kind == "f":
            _check_magnitudes(stored.reshape(-1)[:_MAX_LOOKED], layout, name)
        values = contiguous(stored.T if layout.interleaved else stored, np.float32 if is_single else np.float64)
    kind = VALUES if layout.type.startswith("float") else COUNTS
    return Samples(values, stored=(kind,) * layout.channels)


def _check_magnitudes(numbers: NDArray[np.floating], layout: Layout, name: str) -> None:
    """Raise ``wrong_shape`` for numbers that bytes of another type, order or place give: of all magnitudes."""
    sizes = np.abs(numbers[np.isfinite(numbers) & (numbers != 0.0)])
    absurd = sizes[(sizes < _MAGNITUDES[0]) | (sizes > _MAGNITUDES[1])]
    if absurd.size > _MAX_ABSURD * numbers.size:
        raise ReaderError(
            "wrong_shape",
            f"{name}: as {layout.type}, {layout.order}, behind {layout.header_bytes} bytes it holds numbers such as "
            f"{float(absurd[0]):.3g}; expected those of a sensor: another type, order or header_bytes",
        )


def _of_three_bytes(stored: NDArray[np.uint8], shape: tuple[int, int], layout: Layout) -> NDArray[np.float32]:
    """Return integers of 24 bits, piece by piece."""
    frames = stored.reshape(*shape, 3)
    frames = frames.transpose(1, 0, 2) if layout.interleaved else frames
    low, middle, high = (0, 1, 2) if layout.order == "little" else (2, 1, 0)
    values = empty_rows(frames.shape[:2], np.float32)
    step = max(1, large.PIECE_BYTES // (4 * layout.channels))
    for begin in range(0, values.shape[1], step):
        part = frames[:, begin : begin + step].astype(np.int32)
        # The sign is that of the highest byte.
        whole = (part[..., high] << 24) | (part[..., middle] << 16) | (part[..., low] << 8)
        values[:, begin : begin + step] = whole >> 8
        forget_pages(values)
    return values
