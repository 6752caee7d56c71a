"""States as plain values for JSON, by the declared fields of their dataclasses; every number comes back as it was."""

from __future__ import annotations

import base64
import math
import types
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from functools import cache
from typing import Annotated, Any, ClassVar, Literal, Self, Union, cast, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

_Decoder = Callable[[Any], Any]
_PLAIN = frozenset({bool, int, float, str, type(None)})


@dataclass(frozen=True)
class Packed:
    """How an array is written: its bytes, little-endian, in base64.

    Attributes:
        kind: of the numbers; with a shape also the key of the bytes.
        shaped: whether the shape is written as well; without it, the array has one dimension.
    """

    kind: Literal["float32", "float64"]
    shaped: bool = True

    def encode(self, array: NDArray[np.floating]) -> Any:
        """Return an array as plain values for JSON; it is rounded to the kind."""
        packed = np.ascontiguousarray(array, dtype=np.dtype(self.kind).newbyteorder("<")).tobytes()
        text = base64.b64encode(packed).decode("ascii")
        return {"shape": list(array.shape), self.kind: text} if self.shaped else text

    def decode(self, stored: Any) -> NDArray[np.float64]:
        """Return what :meth:`encode` wrote."""
        text, shape = (stored[self.kind], stored["shape"]) if self.shaped else (stored, -1)
        numbers = np.frombuffer(base64.b64decode(text), dtype=np.dtype(self.kind).newbyteorder("<"))
        return numbers.reshape(shape).astype(np.float64)


@dataclass(frozen=True)
class _Unset:
    """How a number is written that may not be known yet: NaN as None. Any other NaN is refused by the store."""

    @staticmethod
    def encode(value: float) -> float | None:
        return None if math.isnan(value) else value

    @staticmethod
    def decode(stored: float | None) -> float:
        return math.nan if stored is None else stored


FLOAT32 = Packed("float32")
Float32Array = Annotated[NDArray[np.float64], FLOAT32]
Float64Array = Annotated[NDArray[np.float64], Packed("float64")]
Float32Row = Annotated[NDArray[np.float64], Packed("float32", shaped=False)]
"""Types of the fields of a state that are arrays."""
FloatOrNan = Annotated[float, _Unset()]
"""Type of the fields that are NaN as long as nothing is known."""


class StoredState:
    """A frozen dataclass that a store keeps; the order of its fields is that of the keys.

    Attributes:
        VERSIONS: layouts that are read, the present one last; () where the state that holds it has the version.
        LATER: fields that a readable layout may lack; they take their defaults.
    """

    VERSIONS: ClassVar[tuple[int, ...]] = ()
    LATER: ClassVar[frozenset[str]] = frozenset()

    def to_dict(self) -> dict[str, Any]:
        """Return the state as plain values for JSON, bit for bit."""
        return _written(self)

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> Self:
        """Restore a state that :meth:`to_dict` gave, in any of ``VERSIONS``.

        Raises:
            ValueError: another version.
            KeyError, TypeError: fields are missing or unknown.
        """
        version = stored.get("version")
        if cls.VERSIONS and version not in cls.VERSIONS:
            words = "".join(f" {letter.lower()}" if letter.isupper() else letter for letter in cls.__name__).strip()
            raise ValueError(f"{words}: version {cls.VERSIONS[-1]} expected, got {version!r}")
        values = {name: value for name, value in cls.upgraded(stored).items() if name != "version"}
        missing = set(_names(cls)) - {"version"} - values.keys() - cls.LATER
        if missing:
            raise KeyError(f"{cls.__name__}: {', '.join(sorted(missing))}")
        return _restored(cls, values)

    @classmethod
    def upgraded(cls, stored: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the values of an earlier version as the present one has them."""
        return stored


def _plain(value: Any) -> Any:
    kind = cast("type[Any]", type(value))
    if kind in _PLAIN or isinstance(value, float | str):
        return value
    if kind is tuple:
        return [one if type(one) in _PLAIN else _plain(one) for one in value]
    if isinstance(value, Mapping):
        return {name: _plain(one) for name, one in value.items()}  # pyright: ignore[reportUnknownVariableType]
    own = getattr(value, "to_dict", None) or getattr(value, "to_list", None)
    if own is not None:
        return own()
    # What is of no such kind the store refuses, with the name of the state.
    return _written(value) if is_dataclass(kind) else value


def _written(value: Any) -> dict[str, Any]:
    return {name: encode(getattr(value, name)) for name, encode in _encoders(cast("type[Any]", type(value))).items()}


@cache
def _encoders(kind: type[Any]) -> dict[str, Callable[[Any], Any]]:
    hints = get_type_hints(kind, include_extras=True)
    found = {name: _packing(hints[name]) for name in _names(kind)}
    return {name: _plain if packing is None else packing.encode for name, packing in found.items()}


def _packing(kind: Any) -> Packed | _Unset | None:
    """Return how values of a declared type are written, None for a type that says nothing of it."""
    return next((one for one in get_args(kind)[1:] if isinstance(one, Packed | _Unset)), None)


@cache
def _names(kind: type[Any]) -> tuple[str, ...]:
    return tuple(field.name for field in fields(kind))


@cache
def _decoders(kind: type[Any]) -> dict[str, _Decoder]:
    hints = get_type_hints(kind, include_extras=True)
    return {name: _decoder(hints[name]) for name in _names(kind)}


def _restored(kind: type[Any], values: Mapping[str, Any]) -> Any:
    decoders = _decoders(kind)
    unknown = values.keys() - decoders.keys()
    if unknown:
        raise TypeError(f"{kind.__name__} has no {', '.join(sorted(unknown))}")
    return kind(**{name: decoders[name](value) for name, value in values.items()})


def _decoder(kind: Any) -> _Decoder:
    """Return the function that brings back a value of a declared type from JSON."""
    packing = _packing(kind)
    if packing is not None:
        return packing.decode
    origin, parts = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        inner = next((_decoder(part) for part in parts if part is not types.NoneType), _same)
        return lambda value: None if value is None else inner(value)
    if origin is tuple and parts[-1] is Ellipsis:
        each = _decoder(parts[0])
        return tuple if each is _same else lambda value: tuple(map(each, value))
    if origin is tuple:
        each_of = tuple(_decoder(part) for part in parts)
        return lambda value: tuple(decode(one) for decode, one in zip(each_of, value, strict=True))
    if isinstance(origin, type) and issubclass(origin, Mapping):
        one_of = _decoder(parts[1])
        return lambda value: {name: one_of(one) for name, one in value.items()}
    own = getattr(kind, "from_dict", None) or getattr(kind, "from_list", None)
    if own is not None:
        return own
    if isinstance(kind, type) and is_dataclass(kind):
        return lambda value: _restored(kind, value)
    return kind if isinstance(kind, type) and issubclass(kind, Enum) else _same


def _same(value: Any) -> Any:
    return value
