"""Values as bytes: for digests, for what is sent to workers, and for what is kept of their results.

A value is written as a tag, a length and its content, so that equal values give equal bytes in every process. Floats
and arrays are exact: NaN, infinities, the sign of zero, the type, the order in memory and whether an array may be
written to. A checksum (CRC-32C) finds what was torn or changed. Nothing is pickled: reading imports only classes of
this project, and calls none of their code.
"""

from __future__ import annotations

import dataclasses
import enum
import hashlib
import importlib
import math
import struct
from collections.abc import Callable
from functools import cache, cached_property
from pathlib import Path
from typing import Any, cast

import numpy as np
from google_crc32c import extend
from google_crc32c import value as crc32c

from models.words.errors import SpallwatchError

ROOTS = ("models", "streams", "monitor", "spallwatch", "tests", "benchmarks")
"""Packages whose classes are encoded, by name."""
MAX_DEPTH = 100
"""Levels of containers in each other."""
_MAGIC = b"SWC1"
_LENGTH = struct.Struct("<Q")
_CHECKSUM = struct.Struct("<I")
_FLOAT = struct.Struct("<d")
_COMPLEX = struct.Struct("<dd")
# Booleans, numbers, text and times; objects and structures are refused.
_KINDS = "?biufcSUmM"
_DIGEST_BYTES = 20


_MALFORMED = (ArithmeticError, AttributeError, LookupError, MemoryError, RecursionError, TypeError, ValueError)
"""What reading raises on bytes that :func:`encode` never writes."""


class DamagedDataError(SpallwatchError):
    """Encoded bytes are incomplete, were changed, or name what this program does not have; the message says which."""


def encode(value: object) -> bytes:
    """Return a value as bytes that :func:`decode` reads.

    Values are None, bool, int, float, complex, str, bytes, Path, tuple, list, dict, set, frozenset, numpy arrays and
    scalars, and dataclasses, named tuples and enumerations of this project. Fields of dataclasses are taken as they
    are.

    Raises:
        TypeError: for any other type, and for a subclass of one of these; the message names the place in the value.
    """
    parts: list[bytes] = []
    _encode(value, parts, "value", 0)
    checksum = 0
    for part in parts:
        checksum = extend(checksum, part)
    return b"".join((_MAGIC, _CHECKSUM.pack(checksum), *parts))


def decode(data: bytes) -> Any:
    """Return the value of bytes from :func:`encode`; ``__init__`` of dataclasses is not called.

    Raises:
        DamagedDataError: the bytes are torn, were changed, or hold a class that this program does not have.
    """
    if data[:4] != _MAGIC or len(data) < 9:
        raise DamagedDataError(f"expected encoded data that begins with {_MAGIC!r}, got {bytes(data[:8])!r}")
    stated, found = _CHECKSUM.unpack(data[4:8])[0], crc32c(bytes(memoryview(data)[8:]))
    if stated != found:
        raise DamagedDataError(f"{len(data)} bytes have the checksum {found:08x}, expected {stated:08x}")
    reader = _Reader(data)
    try:
        value = reader.value()
    except _MALFORMED as error:
        # The checksum is right: they were written so on purpose.
        raise DamagedDataError(f"no value can be made of {len(data)} bytes: {type(error).__name__}: {error}") from None
    if reader.place != len(data):
        raise DamagedDataError(f"{len(data) - reader.place} bytes are left after the value")
    return value


def digest(value: object) -> str:
    """Return a hexadecimal digest of 160 bits, which is the same for equal values in every process.

    Raises:
        TypeError: as :func:`encode`.
    """
    return digest_of(encode(value))


def digest_of(data: bytes) -> str:
    """Return the digest of encoded bytes."""
    return hashlib.blake2b(data, digest_size=_DIGEST_BYTES).hexdigest()


def name_of(thing: Any) -> str:
    """Return "module:qualname" of a class or function of this project.

    Raises:
        TypeError: it belongs to another package, or cannot be found by its name.
    """
    name = f"{getattr(thing, '__module__', None)}:{getattr(thing, '__qualname__', thing)}"
    if name.partition(":")[0].partition(".")[0] not in ROOTS:
        raise TypeError(f"expected a class or function of {', '.join(ROOTS)}, got {name}")
    try:
        found = resolve(name)
    except DamagedDataError:
        found = None
    if found is not thing:
        raise TypeError(f"{name} is not found by its name; expected a class or function at the level of a module")
    return name


@cache
def resolve(name: str) -> Any:
    """Return the class or function of a name from :func:`name_of`.

    Raises:
        DamagedDataError: there is none.
    """
    module, _, path = name.partition(":")
    if module.partition(".")[0] not in ROOTS or not path:
        raise DamagedDataError(f"expected a name in one of {', '.join(ROOTS)}, got {name!r}")
    try:
        found: Any = importlib.import_module(module)
        for part in path.split("."):
            found = getattr(found, part)
    except (ImportError, AttributeError) as error:
        raise DamagedDataError(f"this program has no {name!r}: {error}") from None
    return found


def _sized(tag: bytes, content: bytes) -> bytes:
    return tag + _LENGTH.pack(len(content)) + content


def _text(text: str) -> bytes:
    return text.encode("utf-8", "surrogatepass")


def _whole(number: int) -> bytes:
    return number.to_bytes(number.bit_length() // 8 + 1, "little", signed=True)


_PLAIN: dict[type, Callable[[Any], bytes]] = {
    type(None): lambda _: b"N",
    bool: lambda value: b"T" if value else b"F",
    int: lambda value: _sized(b"i", _whole(value)),
    float: lambda value: b"f" + _FLOAT.pack(value),
    complex: lambda value: b"c" + _COMPLEX.pack(value.real, value.imag),
    str: lambda value: _sized(b"s", _text(value)),
    bytes: lambda value: _sized(b"b", value),
    type(Path()): lambda value: _sized(b"p", _text(str(value))),
}
_CONTAINERS: dict[type, bytes] = {tuple: b"t", list: b"l", dict: b"d", set: b"S", frozenset: b"Z"}


def _encode(value: Any, parts: list[bytes], place: str, depth: int) -> None:
    kind = cast("type[Any]", type(value))
    if (plain := _PLAIN.get(kind)) is not None:
        parts.append(plain(value))
        return
    if depth > MAX_DEPTH:
        raise TypeError(f"{place}: more than {MAX_DEPTH} levels of containers")
    tag = _CONTAINERS.get(kind)
    if tag is None:
        _encode_object(value, kind, parts, place, depth)
        return
    parts.append(tag + _LENGTH.pack(len(value)))
    if tag == b"d":
        for key, item in value.items():
            _encode(key, parts, f"key {key!r} of {place}", depth + 1)
            _encode(item, parts, f"{place}[{key!r}]", depth + 1)
    elif tag in b"SZ":
        # Their order depends on the hash seed of the process.
        parts.extend(sorted(_item(item, f"an item of {place}", depth + 1) for item in value))
    else:
        for number, item in enumerate(value):
            _encode(item, parts, f"{place}[{number}]", depth + 1)


def _item(value: Any, place: str, depth: int) -> bytes:
    parts: list[bytes] = []
    _encode(value, parts, place, depth)
    return b"".join(parts)


def _encode_object(value: Any, kind: type[Any], parts: list[bytes], place: str, depth: int) -> None:
    if kind is np.ndarray:
        parts.extend(_array(value, place))
    elif isinstance(value, np.generic):
        dtype = cast("np.dtype[Any]", value.dtype)
        _check_dtype(dtype, place)
        parts.extend((_sized(b"g", dtype.str.encode()), _sized(b"", value.tobytes())))
    elif isinstance(value, enum.Enum):
        parts.extend((_sized(b"E", _class(kind, place)), _sized(b"", _text(value.name))))
    elif isinstance(value, tuple) and hasattr(kind, "_fields"):
        items = cast("tuple[Any, ...]", value)
        parts.append(_sized(b"n", _class(kind, place)) + _LENGTH.pack(len(items)))
        for name, item in zip(cast("Any", kind)._fields, items, strict=True):
            _encode(item, parts, f"{place}.{name}", depth + 1)
    elif dataclasses.is_dataclass(kind):
        _encode_fields(value, kind, parts, place, depth)
    else:
        raise TypeError(f"{place}: {kind.__module__}.{kind.__qualname__} cannot be sent to a worker: {value!r:.80}")


def _encode_fields(value: Any, kind: type[Any], parts: list[bytes], place: str, depth: int) -> None:
    """Encode the fields of a dataclass that are set; what is kept elsewhere in the object would be lost."""
    names = _field_names(kind)
    for name in getattr(value, "__dict__", names).keys() - names.keys():
        # A cached property is computed anew.
        if not isinstance(getattr(kind, name, None), cached_property):
            raise TypeError(f"{place}: {kind.__qualname__} holds {name!r}, which is no field of it")
    fields = [name for name in names if hasattr(value, name)]
    parts.append(_sized(b"o", _class(kind, place)) + _LENGTH.pack(len(fields)))
    for name in fields:
        parts.append(names[name])
        _encode(getattr(value, name), parts, f"{place}.{name}", depth + 1)


@cache
def _field_names(kind: Any) -> dict[str, bytes]:
    """Return the names of a dataclass's fields, each also encoded."""
    return {field.name: _sized(b"", field.name.encode()) for field in dataclasses.fields(kind)}


def _class(kind: type, place: str) -> bytes:
    try:
        return _class_name(kind)
    except TypeError as error:
        raise TypeError(f"{place}: {error}") from None


@cache
def _class_name(kind: type) -> bytes:
    return name_of(kind).encode()


def _check_dtype(dtype: np.dtype[Any], place: str) -> None:
    # The padding of long doubles is arbitrary.
    if dtype.kind not in _KINDS or dtype.char in "gG":
        raise TypeError(f"{place}: values of the type {dtype} cannot be sent to a worker")


def _array(value: Any, place: str) -> list[bytes]:
    """Return the parts of an array: type, order, shape and content."""
    _check_dtype(value.dtype, place)
    flags = value.flags
    order = "F" if flags.f_contiguous and not flags.c_contiguous else "C"
    head = order.encode() + (b"w" if flags.writeable else b"r") + bytes([value.ndim])
    shape = b"".join(_LENGTH.pack(length) for length in value.shape)
    return [_sized(b"a", value.dtype.str.encode()), head, shape, _sized(b"", value.tobytes(order))]


class _Reader:
    """Reads values one after another; ``place`` is the next byte."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.place = 8

    def take(self, count: int) -> bytes:
        part = self.data[self.place : self.place + count]
        if len(part) < count:
            raise DamagedDataError(f"the data end at {len(self.data)} bytes, {self.place + count} were expected")
        self.place += count
        return part

    def length(self) -> int:
        return _LENGTH.unpack(self.take(8))[0]

    def sized(self) -> bytes:
        return self.take(self.length())

    def value(self) -> Any:
        tag = self.take(1)
        read = _READERS.get(tag)
        if read is None:
            raise DamagedDataError(f"no value begins with {tag!r}, as it does at byte {self.place - 1}")
        return read(self)

    def values(self) -> list[Any]:
        return [self.value() for _ in range(self.length())]

    def pairs(self) -> dict[Any, Any]:
        return {self.value(): self.value() for _ in range(self.length())}

    def array(self) -> Any:
        dtype = np.dtype(self.sized().decode())
        order, write, dimensions = self.take(1).decode(), self.take(1) == b"w", self.take(1)[0]
        shape = tuple(self.length() for _ in range(dimensions))
        size = self.length()
        _check_dtype(dtype, "array")
        if math.prod(shape) * dtype.itemsize != size:
            raise DamagedDataError(f"an array of {shape} {dtype} has {size} bytes")
        # A copy is aligned and may be written to.
        found = np.empty(shape, dtype, order="F" if order == "F" else "C")
        if size:
            found.reshape(-1, order="A").view(np.uint8)[:] = np.frombuffer(self.take(size), np.uint8)
        found.flags.writeable = write
        return found

    def scalar(self) -> Any:
        dtype = np.dtype(self.sized().decode())
        content = self.sized()
        return np.frombuffer(content, dtype)[0] if content else np.zeros((), dtype)[()]

    def member(self) -> Any:
        kind = resolve(self.sized().decode())
        return kind[self.sized().decode("utf-8", "surrogatepass")]

    def named_tuple(self) -> Any:
        kind: Any = resolve(self.sized().decode())
        make = getattr(kind, "_make", None)
        if make is None:
            raise DamagedDataError(f"expected a named tuple, got {kind!r}")
        return make(self.values())

    def dataclass(self) -> Any:
        kind = resolve(self.sized().decode())
        if not (isinstance(kind, type) and dataclasses.is_dataclass(kind)):
            raise DamagedDataError(f"expected a dataclass, got {kind!r}")
        found = cast("Any", object.__new__(kind))
        for _ in range(self.length()):
            object.__setattr__(found, self.sized().decode(), self.value())
        return found


_READERS: dict[bytes, Callable[[_Reader], Any]] = {
    b"N": lambda _: None,
    b"T": lambda _: True,
    b"F": lambda _: False,
    b"i": lambda reader: int.from_bytes(reader.sized(), "little", signed=True),
    b"f": lambda reader: _FLOAT.unpack(reader.take(8))[0],
    b"c": lambda reader: complex(*_COMPLEX.unpack(reader.take(16))),
    b"s": lambda reader: reader.sized().decode("utf-8", "surrogatepass"),
    b"b": lambda reader: reader.sized(),
    b"p": lambda reader: Path(reader.sized().decode("utf-8", "surrogatepass")),
    b"t": lambda reader: tuple(reader.values()),
    b"l": lambda reader: reader.values(),
    b"d": lambda reader: reader.pairs(),
    b"S": lambda reader: set(reader.values()),
    b"Z": lambda reader: frozenset(reader.values()),
    b"a": lambda reader: reader.array(),
    b"g": lambda reader: reader.scalar(),
    b"E": lambda reader: reader.member(),
    b"n": lambda reader: reader.named_tuple(),
    b"o": lambda reader: reader.dataclass(),
}
