"""A Zarr store of an archive as it is read: all its chunks are there, and none is larger than an archive has.

To zarr, a chunk that is missing holds fill values, and the size of an unpacked chunk is the one that its file states.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any, Self, cast

import numpy as np
from zarr.abc.store import ByteRequest, Store
from zarr.core.buffer import Buffer, BufferPrototype
from zarr.storage import WrapperStore

from models.words.errors import SpallwatchError
from monitor.fleet.arrays import METADATA

MAX_CHUNK_BYTES = 1 << 28
"""Of a chunk of one array, unpacked; an archive has less than 32 MB."""
_MAX_CHUNKS = 1_000_000
_NUMBERS, _TEXTS = ["bytes", "blosc"], ["vlen-utf8", "zstd"]
_CHECKSUM = "crc32c"
_TYPES = ("string", "bool", *(f"{kind}{bits}" for kind in ("int", "uint", "float") for bits in (8, 16, 32, 64)))


class DamagedArchiveError(SpallwatchError):
    """A Zarr store is not as an archive is written, or files of it are missing or were changed."""


class WholeStore(WrapperStore[Store]):
    """A store that raises DamagedArchiveError where a chunk is missing or states another size than its array has."""

    def __init__(self, store: Store, place: str = "", sizes: Mapping[str, int] | None = None) -> None:
        """Read from ``store``; ``sizes`` are bytes of the chunks of arrays, as of :func:`chunk_sizes`."""
        super().__init__(store)
        self._place, self._sizes = place, dict(sizes or {})

    def _with_store(self, store: Store) -> Self:
        return type(self)(store, self._place, self._sizes)

    async def get(self, key: str, prototype: BufferPrototype, byte_range: ByteRequest | None = None) -> Buffer | None:
        """Return a file, or None where it is no chunk and not there."""
        found = await super().get(key, prototype, byte_range)
        array, _, name = key.rpartition("/")
        if array not in self._sizes or name == METADATA:
            return found
        if found is None:
            raise DamagedArchiveError(f"{self._place}/{key} is missing; archive replay --resume writes it again")
        stated = _stated_size(cast("Any", found).as_numpy_array()[:18].tobytes())
        expected = self._sizes[array]
        if stated is None or (stated != expected if expected else stated > MAX_CHUNK_BYTES):
            raise DamagedArchiveError(
                f"{self._place}/{key} states {stated} bytes, expected {expected or f'at most {MAX_CHUNK_BYTES}'}"
            )
        return found


def chunk_sizes(place: str, root: bytes) -> dict[str, int]:
    """Return the bytes of a chunk of each array by the metadata of a whole archive, 0 for texts.

    Raises:
        DamagedArchiveError: an array is of another kind than an archive has, or a chunk of it does not fit the memory.
    """
    name = ""
    try:
        arrays: dict[str, Any] = json.loads(root)["consolidated_metadata"]["metadata"]
        sizes: dict[str, int] = {}
        for name, array in arrays.items():
            sizes[name] = _chunk_bytes(array)
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        reason = str(error) if type(error) is ValueError else f"{type(error).__name__}: {error}"
        raise DamagedArchiveError(f"{place}/{name}: is no array of an archive: {reason}") from None
    return sizes


def _chunk_bytes(array: Mapping[str, Any]) -> int:
    kind, codecs = array["data_type"], [codec["name"] for codec in array["codecs"]]
    shape, chunk = array["shape"], array["chunk_grid"]["configuration"]["chunk_shape"]
    texts = kind == "string"
    if kind not in _TYPES or [name for name in codecs if name != _CHECKSUM] != (_TEXTS if texts else _NUMBERS):
        raise ValueError(f"data type {kind!r} by {', '.join(map(str, codecs))}")
    if any(type(size) is not int or size < 0 for size in (*shape, *chunk)) or 0 in chunk:
        raise ValueError(f"shape {shape} in chunks of {chunk}")
    size = math.prod(chunk) * (1 if texts else np.dtype(kind).itemsize)
    if size > MAX_CHUNK_BYTES:
        raise ValueError(f"chunks of {size} bytes, expected at most {MAX_CHUNK_BYTES}")
    if (count := math.prod(-(-one // other) for one, other in zip(shape, chunk, strict=True))) > _MAX_CHUNKS:
        raise ValueError(f"{count} chunks, expected at most {_MAX_CHUNKS}")
    return 0 if texts else size


def _stated_size(head: bytes) -> int | None:
    """Return the unpacked size by the first bytes of a chunk of Blosc or Zstandard, None where they state none."""
    if head[:4] != b"\x28\xb5\x2f\xfd":
        return int.from_bytes(head[4:8], "little") if len(head) >= 16 else None
    flags = head[4]
    single, width = flags >> 5 & 1, (0, 2, 4, 8)[flags >> 6]
    start = 5 + (1 - single) + (0, 1, 2, 4)[flags & 3]
    if width == 0:
        return head[start] if single else None
    return int.from_bytes(head[start : start + width], "little") + (256 if width == 2 else 0)
