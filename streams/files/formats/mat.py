"""MATLAB files with guarded sizes: to version 7.2 through scipy, 7.3 as HDF5."""

from __future__ import annotations

import struct
import warnings
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import datetime, timedelta
from fnmatch import fnmatchcase
from functools import partial
from math import prod
from typing import Any

import numpy as np
import scipy.io
from numpy.typing import NDArray

from streams.files.formats.hdf5 import SIGNATURE, Budget, attributes, join_arrays, load_unpacked, open_hdf5, walk
from streams.files.judge import stated_start
from streams.files.keys import KEYS, STEPS, TIME_UNITS
from streams.files.parse.worker import check_claim, from_disk
from streams.files.pulse_times import matches_pulses, only_one, own_facts, sought, with_pulses
from streams.files.statements import STORED, Facts, add_fact, nearest, plain_key, plain_unit
from streams.files.unlisted import is_stating
from streams.types.large import Data, stream_of
from streams.types.samples import ReaderError, Samples, may_be_rows, rows_of, stored_as

_DATENUM_OF_1970 = 719529.0
_DATENUMS = (693962.0, 767011.0)
"""Serial dates of MATLAB for 1900 and 2100."""
_EPOCH = datetime(1970, 1, 1)
_COMPRESSED = 15
_ABSCISSAE = ("xvalues", "xaxis", "xdata", "abscissa")
"""Plain names of structures that describe the times of their neighbours."""
_MAX_RECORDS = 256
_ITEM_BYTES = {"int8": 1, "uint8": 1, "logical": 1, "int16": 2, "uint16": 2}
_ITEM_BYTES |= {"char": 4, "int32": 4, "uint32": 4, "single": 4}

MatValues = Mapping[str, "NDArray[np.generic]"]


@from_disk
def mat_variables(data: Data, name: str) -> dict[str, tuple[tuple[int, ...], str]]:
    """Return shape and MATLAB class ("double", "struct", ...) of each variable.

    Raises:
        ReaderError: ``unreadable`` where it is not a MAT file of version 5 to 7.3, ``incomplete`` where it breaks off,
            ``refused`` where it claims more than it may have when loaded.
    """
    if not data:
        raise ReaderError("empty", f"{name}: the file has 0 bytes")
    if _is_hdf5(data):
        return _hdf5_variables(data, name)
    if not data.startswith(b"MATLAB 5.0 MAT-file") or len(data) < 136 or data[126:128] not in (b"IM", b"MI"):
        raise ReaderError("unreadable", f"{name}: not a MAT file of version 5 to 7.3")
    declared = _declared_bytes(data, name)
    found = _by_scipy(data, name, scipy.io.whosmat)
    declared = max(declared, sum(prod(shape) * _ITEM_BYTES.get(kind, 8) for _, shape, kind in found))
    check_claim(declared, len(data), name)
    return {variable: (tuple(shape), kind) for variable, shape, kind in found}


def _by_scipy(data: Data, name: str, call: Callable[..., Any]) -> Any:
    try:
        with warnings.catch_warnings(), stream_of(data) as stream:
            warnings.simplefilter("ignore")
            return call(stream)
    except Exception as error:  # Any exception may come of corrupt input.
        raise ReaderError("unreadable", f"{name}: not a readable MAT file ({error})") from error


def _is_hdf5(data: Data) -> bool:
    return data.startswith((b"MATLAB 7.3", SIGNATURE)) or data[512:520] == SIGNATURE


def _hdf5_variables(data: Data, name: str) -> dict[str, tuple[tuple[int, ...], str]]:
    """List the variables of a version 7.3 file; its arrays are stored transposed."""
    with open_hdf5(data, name) as file:
        found: dict[str, tuple[tuple[int, ...], str]] = {}
        for key in sorted(file):
            if key.startswith("#") or type(file.get(key, getlink=True)).__name__ != "HardLink":
                continue
            item = file[key]
            kind = str(attributes(item).get("matlabclass", "struct" if hasattr(item, "keys") else "unknown"))
            shape = tuple(int(n) for n in reversed(getattr(item, "shape", None) or (1, 1)))
            found[key] = ((1, 1) if kind == "struct" else shape), kind
        return found


def _load_hdf5(data: Data, name: str, patterns: Sequence[str]) -> dict[str, NDArray[np.generic]]:
    with open_hdf5(data, name) as file:
        values: dict[str, NDArray[np.generic]] = {}
        budget = Budget(name, len(data))
        for item in walk(file, name, patterns, separator="."):
            if item.dataset.dtype.hasobject or "matlabempty" in item.own:
                continue
            array, _ = load_unpacked(replace(item, facts=item.own), name, budget)
            if item.own.get("matlabclass") == "char":
                # Text is stored as UTF-16 units.
                array = np.array([[array.T.astype("<u2").tobytes("F").decode("utf-16-le", "replace")]])
            values[item.path] = (array.astype(np.bool) if item.own.get("matlabclass") == "logical" else array).T
        return values


def _declared_bytes(data: Data, name: str) -> int:
    """Sum the unpacked sizes of the top-level elements; whosmat skips structures."""
    order = "<" if data[126:128] == b"IM" else ">"
    position, total = 128, 0
    while position + 8 <= len(data):
        kind, size = struct.unpack(order + "II", data[position : position + 8])
        start, position = position + 8, position + 8 + size
        if position > len(data):
            raise ReaderError("incomplete", f"{name}: breaks off after {len(data)} bytes, {position} are declared")
        if kind == _COMPRESSED:
            try:
                tag = zlib.decompressobj().decompress(data[start : start + min(size, 4096)], 8)
                _, size = struct.unpack(order + "II", tag)
            except (zlib.error, struct.error) as error:
                raise ReaderError("unreadable", f"{name}: a compressed variable is damaged ({error})") from error
        total += size
    return total


def load_mat(data: Data, name: str, patterns: Sequence[str]) -> dict[str, NDArray[np.generic]]:
    """Load the variables, or fields of structures, that match any of some patterns.

    ``X*_DE_time`` is the pattern of a variable, ``bearing.gs`` that of the field of a structure. The arrays come under
    their full names in the order of the file. ReaderError as for :func:`mat_variables`.
    """
    if _is_hdf5(data):
        return _load_hdf5(data, name, patterns)
    variables = mat_variables(data, name)
    wanted = [v for v in variables if any(fnmatchcase(v, _variable(pattern)) for pattern in patterns)]
    if not wanted:
        return {}
    # MATLAB stores doubles that are whole numbers as integers: mat_dtype restores their class.
    options = {"variable_names": wanted, "squeeze_me": False, "mat_dtype": True}
    loaded = _by_scipy(data, name, partial(scipy.io.loadmat, **options))
    values: dict[str, NDArray[np.generic]] = {}
    for variable in wanted:
        if variable in loaded:
            values.update(_flat(variable, loaded[variable]))
    return {key: array for key, array in values.items() if any(fnmatchcase(key, pattern) for pattern in patterns)}


def _variable(pattern: str) -> str:
    """Return the variable of a pattern: the part before the first field or index."""
    return pattern.partition(".")[0].partition("(")[0]


def _flat(key: str, value: object) -> dict[str, NDArray[np.generic]]:
    """Name fields ``key.field``, in arrays of structures ``key(1).field``, nested likewise."""
    array = np.asarray(value)
    if array.dtype.names is None or not 1 <= array.size <= _MAX_RECORDS:
        return {key: array}
    flat: dict[str, NDArray[np.generic]] = {}
    for index, record in enumerate(array.reshape(-1), start=1):
        place = key if array.size == 1 else f"{key}({index})"
        for field in array.dtype.names:
            flat.update(_flat(f"{place}.{field}", record[field]))
    return flat


def scalar(values: MatValues, key: str) -> float | None:
    """Return a value that holds one finite number, also as text, or None."""
    array = values.get(key)
    if array is None or array.size != 1:
        return None
    try:
        number = float(array.reshape(-1)[0])
    except (TypeError, ValueError):
        return None
    return number if np.isfinite(number) else None


def text(values: MatValues, key: str) -> str | None:
    """Return a value that is a text, or None where there is none such."""
    array = values.get(key)
    if array is None or array.size != 1 or array.dtype.kind not in "U":
        return None
    return str(array.reshape(-1)[0])


@from_disk
def read_mat(
    data: Data,
    name: str,
    patterns: Sequence[str] = ("*",),
    zone: str | None = None,
    pulses: str | None = None,
    wanted: Sequence[str] = (),
    slow: Sequence[str] = (),
    disregard: Sequence[str] = (),
) -> Samples:
    """Read the numeric vectors of a MAT file that match some patterns.

    A matrix gives a row for each vector of it, named ``NAME_1`` and so on.

    Args:
        zone: IANA name of the zone of stamps that name none. With it, scalars and texts such as ``fs``, ``dt``,
            ``unit`` and ``t0`` (also a ``datenum``) state rate, unit and start; of a field of a structure its
            neighbours do so first.
        pulses: pattern of the variable, field or structure of times of pulses, see :mod:`.pulse_times`; what states
            its unit is a field beside it. Only with ``zone``.
        wanted, slow: see :func:`streams.files.lengths.of_one_length`.
        disregard: patterns of the variables and fields that are not believed.

    Raises:
        ReaderError: as :func:`mat_variables`; ``wrong_shape`` where no vector matches or their lengths differ,
            ``wrong_rate`` where they state contradictory rates.
    """
    if zone is None:
        return _joined(load_mat(data, name, patterns), data, name, patterns, {}, "UTC", wanted, slow)
    variables = mat_variables(data, name)
    if not any(fnmatchcase(variable, _variable(pattern)) for variable in variables for pattern in patterns):
        # Structures that are recordings hold them.
        patterns = [f"*.{pattern}" for pattern in patterns]
    stating = [key for key in variables if is_stating(plain_key(key))]
    parents = {pattern.rpartition(".")[0] for pattern in patterns if "." in pattern}
    # Of ``signal.y_values.values`` the step stands in ``signal.x_values``.
    parents |= {parent.rpartition(".")[0] for parent in parents if "." in parent}
    parents |= {pulses.rpartition(".")[0] or pulses} if pulses is not None else set()
    asked = [*sought(patterns, pulses, "."), *stating, *(f"{parent}.*" for parent in parents)]
    values = load_mat(data, name, asked)
    marks = [key for key, array in values.items() if _is_pulses(key, array, pulses)]
    beside = {key.rpartition(".")[0] for key in marks} - {""}
    vectors = {
        key: array
        for key, array in values.items()
        if key not in marks
        and key.rpartition(".")[0] not in beside
        and any(fnmatchcase(key, pattern) for pattern in patterns)
    }
    facts = _stated(values)
    separator = "." if pulses is None else ""
    samples = _joined(vectors, data, name, patterns, facts, zone, wanted, slow, disregard, separator)
    tacho = None if pulses is None else only_one(marks, pulses, name)
    if tacho is None:
        return samples
    parent = tacho.rpartition(".")[0]
    own = own_facts(facts.get(parent, {}) if parent else {}, facts.get("", {}))
    return with_pulses(samples, values[tacho], own, zone, f"{name}: variable {tacho}", stated_start(own, zone, name))


def _is_pulses(key: str, array: NDArray[np.generic], pulses: str | None) -> bool:
    """Return whether a variable holds the times of pulses, and does not state something of them."""
    stating = plain_key(key.rpartition(".")[2]) in KEYS
    return not stating and array.dtype.kind in "fiub" and matches_pulses(pulses, key, key.rpartition(".")[0])


def _stated(values: MatValues) -> dict[str, dict[str, object]]:
    """Return what scalars and texts state under plain keys, by the structure that holds them, "" for none."""
    facts: dict[str, dict[str, object]] = {}
    for key in values:
        parent, _, last = key.rpartition(".")
        outer, _, axis = parent.rpartition(".")
        if plain_key(axis) in _ABSCISSAE and outer:
            step = scalar(values, key) if plain_key(last) in STEPS else None
            size = TIME_UNITS.get(plain_unit(text(values, f"{parent}.quantity.label") or ""))
            if step is not None and size is not None:
                add_fact(facts.setdefault(outer, {}), "dt", step * size, key)
            continue
        if plain_key(axis) == "quantity" and plain_key(last) == "label":
            # With a factor the numbers may be in this unit, or in what it is a multiple of.
            is_plain = scalar(values, f"{parent}.unit_transformation.factor") in (None, 1.0)
            of_times = plain_key(outer.rpartition(".")[2]) in _ABSCISSAE
            if is_plain and not of_times and (label := text(values, key)) is not None:
                add_fact(facts.setdefault(outer, {}), "unit", label, key)
            continue
        if not is_stating(plain_key(last)):
            continue
        value = text(values, key) or scalar(values, key)
        if isinstance(value, float) and _DATENUMS[0] < value < _DATENUMS[1]:
            value = _EPOCH + timedelta(seconds=round((value - _DATENUM_OF_1970) * 86400.0, 3))
        if value is not None:
            add_fact(facts.setdefault(parent, {}), plain_key(last), value, key)
    return facts


def _around(facts: Mapping[str, Facts], structure: str) -> Facts:
    """Return what a structure states, and what those around it and the file do."""
    found = facts.get(structure, {})
    while structure:
        structure = structure.rpartition(".")[0]
        found = nearest(facts.get(structure, {}), found, f"in {structure}" if structure else "beside the structures")
    return found


def _joined(
    values: MatValues,
    data: Data,
    name: str,
    patterns: Sequence[str],
    facts: Mapping[str, Facts],
    zone: str,
    wanted: Sequence[str] = (),
    slow: Sequence[str] = (),
    disregard: Sequence[str] = (),
    separator: str = "",
) -> Samples:
    """Join the vectors; ``facts`` are stated by the structure of that name, those of "" for all."""
    arrays = [
        (
            key,
            rows_of(array, f"{name}: variable {key}"),
            {**_around(facts, key.rpartition(".")[0]), STORED: stored_as(array.dtype)},
        )
        for key, array in values.items()
        if array.size > 1 and may_be_rows(array.dtype, array.shape)
    ]
    held: list[str] = []
    if not arrays:
        held = [f"{variable} {kind}{list(shape)}" for variable, (shape, kind) in mat_variables(data, name).items()]
    none = f"no vector matches {', '.join(patterns)}; it holds {', '.join(held[:12]) or 'no variable'}"
    return join_arrays(arrays, name, zone, none, wanted, slow, disregard, separator)
