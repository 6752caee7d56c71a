"""Values of stored numbers by the conventions of their format: fill values, valid range, sign, scale and offset.

The order is that of the netCDF User Guide: fill values and limits are of the stored numbers; then the sign, the scale,
the offset. A missing sample is NaN; the quality stage rejects a block with such samples and says how many they are.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from streams.files.statements import STORED, Facts, add_fact, plain_key
from streams.types.large import elementwise, is_any
from streams.types.samples import COUNTS, SCALED, ReaderError, stored_as

_MAX_VALUES = 64
_MAX_TEXT_BYTES = 4096
_NAMES = {
    "fillvalue": "_FillValue", "missingvalue": "missing_value", "unsigned": "_Unsigned",
    "validrange": "valid_range", "validmin": "valid_min", "validmax": "valid_max",
}  # fmt: skip
"""Attributes that count where an array states them itself, by their plain keys."""
_FACTORS, _OFFSETS = ("scalefactor", "scale", "slope"), ("addoffset", "offset", "intercept")
"""Plain keys of scale and offset. The first ones are those of the conventions; the others hold for integers, since
beside floating numbers they may say what was done to them, and such an offset only beside a scale."""
_NETCDF_FILLS = {
    "i2": -(2**15) + 1, "u2": 2**16 - 1, "i4": -(2**31) + 1, "u4": 2**32 - 1, "i8": -(2**63) + 2, "u8": 2**64 - 2,
    "f4": 9.969209968386869e36, "f8": 9.969209968386869e36,
}  # fmt: skip
_CODES = frozenset(sign * code for sign in (-1.0, 1.0) for code in (999.0, 9999.0, 99999.0, 999999.0))
"""Numbers that loggers write for missing samples."""
_IMPOSSIBLE = 1e15
"""Of no sensor in any unit: instruments write such for a missing sample, an overload or an undefined value."""
_NETCDF_BYTES = (-127, 255)
_USER_DEFINED = 2
"""H5D_FILL_VALUE_USER_DEFINED."""


def attribute_facts(attributes: Iterable[tuple[str, Any]]) -> dict[str, object]:
    """Return attributes under plain keys: those of one number or text; of packing all values of one, as an array."""
    found: dict[str, object] = {}
    for name, value in attributes:
        key, array = plain_key(name), np.asarray(value).reshape(-1)
        if array.dtype.hasobject and all(isinstance(item, str) for item in array):
            array = array.astype(str)
        if key in _NAMES and array.size <= _MAX_VALUES and array.dtype.kind in "fiubSU":
            found[key] = array
        elif array.size == 1 and array.dtype.kind in "fiu":
            add_fact(found, key, float(array[0]), str(name))
        elif array.size == 1 and array.dtype.kind in "SU":
            add_fact(found, key, _text(array[0]), str(name))
    return found


def _text(value: Any) -> str:
    text = value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
    return text[:_MAX_TEXT_BYTES]


def netcdf_fill(dtype: np.dtype[Any]) -> float | None:
    """Return the number that netCDF writes where nothing was written; None for bytes, which by it have none."""
    return _NETCDF_FILLS.get(dtype.str[1:])


def property_fill(dataset: Any) -> float | None:
    """Return the fill value that was defined with an h5py data set, None where none was.

    0 is none: libraries define it for arrays whose samples may be 0. So are the numbers that netCDF defines for bytes.
    """
    kind, width = dataset.dtype.kind, dataset.dtype.itemsize
    if kind not in "fiu" or dataset.id.get_create_plist().fill_value_defined() != _USER_DEFINED:
        return None
    fill = dataset.fillvalue.item()
    return None if fill == 0 or (width == 1 and fill in _NETCDF_BYTES) else fill


def without_codes(rows: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return rows with NaN for the numbers that loggers write for a missing sample where nothing states one.

    Such as -9999 count where they are an end of the range and ten times as large as all other samples of the row, as do
    all finite numbers that no sensor gives, such as 9.91e37 for none (SCPI 1999, 7.2.1.5) or the largest of a type.
    """
    found = rows
    for place, row in enumerate(rows):
        for end in (float(row.min()), float(row.max())):
            beyond = _IMPOSSIBLE <= abs(end) < math.inf
            if not beyond and end not in _CODES:
                continue
            coded = np.abs(row) >= _IMPOSSIBLE if beyond else row == end
            others = np.abs(row[~coded])
            if others.size and 10.0 * float(others.max()) < abs(end):
                found = np.array(rows) if found is rows else found
                found[place, coded] = np.nan
    return found


@dataclass(frozen=True)
class Packing:
    """How the numbers of an array are stored.

    Attributes:
        fills: stored numbers that are no samples.
        limits: least and largest number that is a sample, None for no limit.
        of_values: whether the limits are of the values; else they are of the stored numbers.
        scale: the values are so many times the stored numbers, and ``offset``; None: they are the stored ones.
    """

    fills: tuple[float, ...] = ()
    limits: tuple[float | None, float | None] = (None, None)
    of_values: bool = False
    scale: float | None = None
    offset: float = 0.0

    @property
    def may_miss(self) -> bool:
        """Whether it says of any number that it is no sample."""
        return bool(self.fills) or self.limits != (None, None)

    def values(self, part: NDArray[Any]) -> NDArray[Any]:
        """Return the values of stored numbers."""
        return part if self.scale is None else part * np.float64(self.scale) + self.offset

    def missing(self, part: NDArray[Any]) -> NDArray[np.bool]:
        """Return which stored numbers are no samples."""
        found = np.zeros(part.shape, np.bool)
        for fill in self.fills:
            found |= part == fill
        (low, high), measured = self.limits, self.values(part) if self.of_values else part
        if low is not None:
            found |= measured < low
        if high is not None:
            found |= measured > high
        return found

    def samples(self, part: NDArray[Any]) -> NDArray[np.floating]:
        """Return the values of stored numbers, NaN for missing samples."""
        values = self.values(part)
        if values.dtype.kind != "f":
            values = values.astype(np.float32 if values.dtype.itemsize <= 2 else np.float64)
        return np.where(self.missing(part), values.dtype.type(np.nan), values)


def unpacked(
    array: NDArray[Any], own: Facts, around: Facts, where: str, fills: Iterable[float | None] = ()
) -> tuple[NDArray[Any], Facts]:
    """Return the values of an array, NaN for missing samples, and what is stated of it with how it is stored.

    An array of which nothing of this is stated, or of whose numbers it says nothing, is returned as it is.

    Args:
        array: real numbers as stored; truth values are returned as they are.
        own: what is stated of the array itself, as :func:`attribute_facts` gives it.
        around: the same with what is stated around it: a scale may be stated for a group.
        where: names file and array in messages.
        fills: of the format, for missing samples where the array itself states no fill value.

    Raises:
        ReaderError: ``wrong_unit`` for statements that contradict each other or have two meanings, with both;
            ``unreadable`` for those that are none.
    """
    stored = stored_as(array.dtype)
    if array.dtype.kind not in "fiu":
        return array, {**around, STORED: stored}
    unsigned = _is_unsigned(array.dtype, own, where)
    if unsigned:
        array = array.view(array.dtype.str.replace("i", "u"))
    packing = _packing(array, own, around, where, unsigned)
    if "fillvalue" not in own and not unsigned:
        packing = replace(packing, fills=(*packing.fills, *(fill for fill in fills if fill is not None)))
    if packing.scale is not None and stored == COUNTS:
        stored = SCALED
    facts = {**around, STORED: stored}
    if packing.may_miss and is_any(packing.missing, array):
        return elementwise(packing.samples, array), facts
    return (array if packing.scale is None else elementwise(packing.values, array)), facts


def _packing(array: NDArray[Any], own: Facts, around: Facts, where: str, unsigned: bool) -> Packing:
    """Return what is stated of the packing of an array, which is of the unsigned type where its bytes are unsigned."""
    dtype, (scale, offset) = array.dtype, (None, 0.0)
    for facts in (own, around):
        if scale is None:
            scale, offset = _scale(facts, dtype, where)
    fills: list[float] = []
    for key in ("fillvalue", "missingvalue"):
        for number in _numbers(own, key):
            fill = _as_stored(number, dtype, unsigned)
            if fill is not None:
                fills.append(fill)
            elif scale is not None and dtype.kind != "f" and math.isfinite(number):
                packed = round((number - offset) / scale)
                if _as_stored(packed, dtype, unsigned) is not None:
                    reason = f"{_NAMES[key]} {number:g} is no number of the stored type {dtype}, where it should be one"
                    raise ReaderError("wrong_unit", f"{where}: {reason}; as a value it would be the stored {packed}")
    packing = Packing(tuple(dict.fromkeys(fills)), scale=scale, offset=offset)
    return _with_limits(packing, array, own, where, unsigned)


def _with_limits(packing: Packing, array: NDArray[Any], own: Facts, where: str, unsigned: bool) -> Packing:
    """Add the limits of samples; ``wrong_unit`` where it matters whether they are stored numbers or values."""
    written = _limits(own, where)
    as_stored = [None if number is None else _as_stored(number, array.dtype, unsigned) for number in written]
    low, high = (
        number if stored is None or number is None else stored
        for number, stored in zip(written, as_stored, strict=True)
    )
    stored = replace(packing, limits=(low, high))
    # By the convention, limits of the wider type of the scale are of the values; many writers do not keep to that.
    if packing.scale is None or array.dtype.kind == "f" or not any(isinstance(number, float) for number in written):
        return stored
    values = replace(packing, limits=written, of_values=True)
    if any(number is not None and whole is None for number, whole in zip(written, as_stored, strict=True)):
        return values
    if is_any(lambda part: stored.missing(part) != values.missing(part), array):
        said = f"valid_range {written[0]} to {written[1]}"
        raise ReaderError("wrong_unit", f"{where}: {said} leaves other samples as values than as stored {array.dtype}")
    return stored


def _limits(own: Facts, where: str) -> tuple[float | None, float | None]:
    """Return the least and largest number that is a sample; ``unreadable`` where two statements differ."""
    both = _numbers(own, "validrange")
    if len(both) not in (0, 2):
        raise ReaderError("unreadable", f"{where}: valid_range is of 2 numbers, found {len(both)}")
    found: list[float | None] = []
    for place, key in enumerate(("validmin", "validmax")):
        limits = (*both[place : place + 1], *_numbers(own, key))
        if len(set(limits)) > 1:
            said = " and ".join(f"{limit:g}" for limit in limits)
            raise ReaderError("unreadable", f"{where}: valid_range and {_NAMES[key]} contradict each other: {said}")
        found.append(limits[0] if limits and not math.isnan(limits[0]) else None)
    return found[0], found[1]


def _numbers(own: Facts, key: str) -> tuple[float, ...]:
    """Return the numbers of an attribute, also as text; any other text states none."""
    found: list[float] = []
    for value in np.asarray(own.get(key, ())).reshape(-1):
        try:
            found.append(float(_text(value)) if value.dtype.kind in "SU" else value.item())
        except ValueError:
            continue
    return tuple(found)


def _as_stored(number: float, dtype: np.dtype[Any], unsigned: bool) -> float | None:
    """Return a number as one of a type, None where that has none such; a signed integer may stand for an unsigned."""
    if dtype.kind == "f":
        return None if math.isnan(number) or np.finfo(dtype).max < abs(number) < math.inf else number
    if not math.isfinite(number) or number != int(number):
        return None
    whole, limits = int(number), np.iinfo(dtype)
    if unsigned and isinstance(number, int) and -(2 ** (limits.bits - 1)) <= whole < 0:
        whole += 2**limits.bits
    return whole if limits.min <= whole <= limits.max else None


def _is_unsigned(dtype: np.dtype[Any], own: Facts, where: str) -> bool:
    if dtype.kind == "f" or "unsigned" not in own:
        return False
    text = " ".join(_text(value) for value in np.asarray(own["unsigned"]).reshape(-1)).strip().lower()
    if text not in ("true", "false", "1", "0"):
        raise ReaderError("unreadable", f"{where}: _Unsigned is true or false, found {text[:40]!r}")
    unsigned = text in ("true", "1")
    if dtype.kind == "u" and not unsigned:
        reason = f"the numbers are of the unsigned type {dtype}, _Unsigned says {text}"
        raise ReaderError("wrong_unit", f"{where}: {reason}")
    return unsigned and dtype.kind == "i"


def _scale(facts: Facts, dtype: np.dtype[Any], where: str) -> tuple[float | None, float]:
    """Return the scale and the offset of numbers of a type; None without one, as is 0 for a scale.

    Raises:
        ReaderError: ``wrong_unit`` where two spellings have different values.
    """
    spellings = 1 if dtype.kind == "f" else len(_FACTORS)
    scale = _common(facts, _FACTORS[:spellings], where)
    offset = _common(facts, _OFFSETS[: 1 if scale is None else spellings], where)
    if scale is None and (offset is None or any(key in facts for key in _FACTORS[:spellings])):
        return None, 0.0
    return 1.0 if scale is None else scale, offset or 0.0


def _common(facts: Facts, keys: Sequence[str], where: str) -> float | None:
    """Return the number that some keys state, None without one; a scale of 0 is none."""
    found: dict[str, float] = {}
    for key in keys:
        number = _numbers(facts, key)
        if number and math.isfinite(number[0]) and (number[0] or keys[0] in _OFFSETS):
            found[key] = number[0]
    if any(not math.isclose(number, next(iter(found.values())), rel_tol=1e-6) for number in found.values()):
        said = ", ".join(f"{key} {number:g}" for key, number in found.items())
        raise ReaderError("wrong_unit", f"{where}: states several scales or offsets of its numbers: {said}")
    return next(iter(found.values()), None)
