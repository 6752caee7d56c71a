"""Record: the result of one block for each channel, and its exact JSON form."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np

from models.words.errors import SpallwatchError
from monitor.health.schema import (
    DIMENSION_SIZES,
    FLAGS,
    OPTIONAL_DIMENSIONS,
    REJECTIONS,
    SCHEMA_VERSION,
    STATUSES,
    VARIABLES,
    Variable,
)


class RecordError(SpallwatchError, ValueError):
    """A record breaks the schema; the message names the block, the key, what was expected and what came."""


def plain(value: Any) -> Any:
    """Return a value as records hold it: Python numbers, tuples for sequences and arrays, None for NaN and infinity."""
    # Nearly all values are of one of two exact types, which are told sooner than their classes.
    if type(value) is float:
        return value if math.isfinite(value) else None
    if type(value) is list:
        return tuple(map(plain, cast("list[object]", value)))
    if isinstance(value, str | bool) or value is None:
        return value
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in cast("Mapping[object, object]", value).items()}
    if isinstance(value, Iterable):
        return tuple(plain(item) for item in cast("Iterable[object]", value))
    return value


def storable(text: str) -> str:
    """Return a text for a database, in which bytes of a file name that are not UTF-8 are escaped."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


@dataclass(frozen=True)
class Record:
    """The result of one block of one source. Equal records are equal bit for bit.

    An absent value is None, also one of several numbers that are all absent; NaN and infinities are refused. Sequences
    become tuples, so that a record equals the one read back from its JSON. :func:`plain` converts arrays.

    Attributes:
        sequence: number of the block in its source, from 1.
        name: where the block came from, for people.
        content_hash: digest of the block's bytes; with source and sequence it is the block's identity.
        status: "ok", a flag, or a rejection status of the interface.
        reason: one sentence where the status is not "ok".
        time: UTC seconds since 1970 of the first sample, None if undated.
        elapsed: seconds since the first sample of the source, None if unknown.
        channels: values by channel and variable (``VARIABLES``), SI. A variable may be left out.
        forecasts: as issued with this block.

    Raises:
        RecordError: naming the block, the key, what was expected and what came.
    """

    source: str
    sequence: int
    name: str
    content_hash: str
    status: str = "ok"
    flags: tuple[str, ...] = ()
    reason: str = ""
    time: float | None = None
    elapsed: float | None = None
    channels: Mapping[str, Mapping[str, Any]] = field(default_factory=dict[str, Mapping[str, Any]])
    forecasts: tuple[Mapping[str, Any], ...] = ()
    events: tuple[Mapping[str, Any], ...] = ()

    def __post_init__(self) -> None:
        """Check every value against the schema and bring it into the form that JSON gives back."""
        where = f"record of block {self.sequence} of {self.source!r}"
        sequence = cast("object", self.sequence)
        if isinstance(sequence, bool) or not isinstance(sequence, int) or sequence < 1:
            raise RecordError(
                f"record of {self.source!r}: sequence must be a whole number from 1, got {self.sequence!r}"
            )
        if self.status not in STATUSES:
            raise RecordError(f"{where}: status must be one of {', '.join(STATUSES)}, got {self.status!r}")
        flags = tuple(self.flags)
        unknown = [flag for flag in flags if flag not in FLAGS]
        if unknown:
            raise RecordError(f"{where}: flags may be {', '.join(FLAGS)}, got {unknown[0]!r}")
        object.__setattr__(self, "flags", flags)
        for key in ("time", "elapsed"):
            object.__setattr__(self, key, _number(getattr(self, key), f"{where}: {key}"))
        channels: dict[str, dict[str, Any]] = {}
        for channel, values in self.channels.items():
            place = f"{where}: channel {channel!r}"
            channels[channel] = {name: _value(name, value, place) for name, value in values.items()}
        object.__setattr__(self, "channels", channels)
        for key in ("forecasts", "events"):
            object.__setattr__(self, key, tuple(_free(item, f"{where}: {key}") for item in getattr(self, key)))

    @property
    def accepted(self) -> bool:
        """Whether the block was kept (with or without flags) rather than rejected."""
        return self.status not in REJECTIONS

    def to_json(self) -> str:
        """Return the record as JSON on one line; floats are written so that they come back bit for bit."""
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return json.dumps(values, ensure_ascii=False, allow_nan=False, separators=(",", ":"))

    @classmethod
    def from_json(cls, text: str | bytes) -> Record:
        """Return the record that :meth:`to_json` wrote; raise RecordError for a text that is none."""
        try:
            values = json.loads(text)
            return cls(**values)
        except (TypeError, ValueError) as error:
            raise RecordError(f"not a record of schema version {SCHEMA_VERSION}: {error}") from error


def mask_names(variable: Variable, value: int) -> tuple[str, ...]:
    """Return the words whose bits are set, in the order of the variable's values."""
    return tuple(name for bit, name in enumerate(variable.values) if value >> bit & 1)


def _value(name: str, value: Any, where: str) -> Any:
    """Check one value of one channel and return it normalised."""
    variable = VARIABLES.get(name)
    if variable is None:
        raise RecordError(f"{where}: unknown variable {name!r}; docs/reference/records.md lists those there are")
    if value is None:
        return None
    where = f"{where}: {name}"
    if not variable.dims:
        return _scalar(variable, value, where)
    if isinstance(value, np.ndarray | np.generic):
        value = cast("object", value.tolist())
    if _is_absent(value):
        return None
    depth = _depth(value)
    dims = variable.dims
    if depth < len(dims):
        dims = tuple(dim for dim in dims if dim not in OPTIONAL_DIMENSIONS)
    if depth != len(dims):
        raise RecordError(f"{where}: expected values over ({', '.join(variable.dims)}), got {depth} dimensions")
    return _nested(variable, value, dims, where)


def _nested(variable: Variable, value: Any, dims: tuple[str, ...], where: str) -> Any:
    """Check a value over ``dims``; a None that stands for a whole row becomes a row of None."""
    if not dims:
        return None if value is None else _scalar(variable, value, where)
    size = DIMENSION_SIZES.get(dims[0])
    if value is None:
        if size is None:
            raise RecordError(f"{where}: a whole {dims[0]} cannot be None beside others")
        return (_nested(variable, None, dims[1:], where),) * size
    if size is not None and len(value) != size:
        raise RecordError(f"{where}: expected {size} values over {dims[0]}, got {len(value)}")
    if len(dims) == 1 and variable.kind == "float":
        return tuple([_number(item, where) for item in value])
    return tuple([_nested(variable, item, dims[1:], where) for item in value])


def _is_absent(value: object) -> bool:
    """Return whether all of several numbers are None."""
    return all(map(_is_absent, cast("Sequence[object]", value))) if isinstance(value, list | tuple) else value is None


def _depth(value: object) -> int:
    """Return how deeply sequences are nested in a value."""
    if not isinstance(value, list | tuple):
        return 0
    items = cast("Sequence[object]", value)
    return 1 + max([_depth(cast("object", item)) for item in items if isinstance(item, list | tuple)], default=0)


def _scalar(variable: Variable, value: Any, where: str) -> float | int | str | None:
    """Check one number or word."""
    if variable.kind == "float":
        return _number(value, where)
    if variable.kind == "int":
        if isinstance(value, bool) or not isinstance(value, int | np.integer):
            raise RecordError(f"{where}: expected a whole number, got {value!r}")
        return int(cast("int", value))
    if variable.kind == "mask":
        return _mask(variable, value, where)
    if value not in variable.values:
        raise RecordError(f"{where}: expected one of {', '.join(variable.values)}, got {value!r}")
    return str(value)


def _mask(variable: Variable, value: Any, where: str) -> str | None:
    """Return words, given as text joined by "|", as a sequence or as bits, in the order of the schema."""
    if isinstance(value, bool) or not isinstance(value, int | str | list | tuple):
        raise RecordError(f"{where}: expected words joined by '|', a sequence of them or bits, got {value!r}")
    if isinstance(value, int):
        if not 0 <= value < 1 << len(variable.values):
            raise RecordError(f"{where}: {value} has bits beyond those of {', '.join(variable.values)}")
        names = mask_names(variable, value)
    else:
        names = tuple(value.split("|")) if isinstance(value, str) else tuple(cast("Sequence[str]", value))
    unknown = [name for name in names if name and name not in variable.values]
    if unknown:
        raise RecordError(f"{where}: expected any of {', '.join(variable.values)}, got {unknown[0]!r}")
    return "|".join(name for name in variable.values if name in names) or None


def _number(value: Any, where: str) -> float | None:
    """Return a finite float or None."""
    if value is None or (type(value) is float and math.isfinite(value)):
        return value
    if isinstance(value, bool) or not isinstance(value, float | int | np.floating | np.integer):
        raise RecordError(f"{where}: expected a number or null, got {value!r}")
    number = float(cast("float", value))
    if not math.isfinite(number):
        raise RecordError(f"{where}: {value!r} is refused; an absent value is null, with its status beside it")
    return number


def _free(value: Any, where: str) -> Any:
    """Return a forecast or an event, with any keys, in the form that JSON gives back."""
    if isinstance(value, Mapping):
        mapping = cast("Mapping[object, object]", value)
        return {str(key): _free(item, f"{where}.{key}") for key, item in mapping.items()}
    if isinstance(value, list | tuple):
        return tuple(_free(item, where) for item in cast("Sequence[object]", value))
    if value is None or isinstance(value, bool | str | int):
        return value
    if isinstance(value, float) and math.isfinite(value):
        return float(value)
    raise RecordError(f"{where}: expected finite numbers, words, null, or objects of them, got {value!r}")
