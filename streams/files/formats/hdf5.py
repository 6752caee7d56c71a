"""HDF5 files through h5py, guarded against links out of the file and wrong sizes.

netCDF-4 and MAT files of version 7.3 are HDF5 files with conventions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from streams.files.judge import StatedRow, judged, stated_start
from streams.files.lengths import of_one_length, with_beside
from streams.files.packing import attribute_facts, property_fill, unpacked
from streams.files.parse.complete import hdf5_size
from streams.files.parse.worker import check_claim, from_disk, library, readable
from streams.files.pulse_times import matches_pulses, only_one, own_facts, sought, with_pulses
from streams.files.statements import STORED, Facts, nearest, plain_key
from streams.files.successive import recordings_of
from streams.files.unlisted import is_stating
from streams.types import large
from streams.types.large import Data, FileBytes, array_on_disk, forget_pages, longest_axis, parts_along
from streams.types.samples import DIGITAL, ReaderError, Samples, check_rows, may_be_rows, rows_of

SIGNATURE = b"\x89HDF\r\n\x1a\n"
_HIDDEN = "#"
"""Beginning of the names under which MATLAB keeps its own data."""
_MAX_DEPTH = 16
_MAX_OBJECTS = 10_000
_MAX_ATTRIBUTES = 256
_MAX_ATTRIBUTE_BYTES = 4096
_MAX_LISTED = 400


@dataclass(frozen=True)
class Found:
    """An h5py data set under its path.

    ``facts`` are the attributes of file, groups and data set, as :func:`streams.files.statements.nearest` joins them;
    ``own`` those of the data set alone.
    """

    path: str
    dataset: Any
    facts: Facts
    own: Facts = field(default_factory=dict)


@from_disk
def read_hdf5(
    data: Data,
    name: str,
    patterns: Sequence[str] = (),
    zone: str = "UTC",
    pulses: str | None = None,
    wanted: Sequence[str] = (),
    slow: Sequence[str] = (),
    disregard: Sequence[str] = (),
) -> Samples:
    """Read the numeric data sets of an HDF5 file.

    Rate, unit and time of the first sample are taken from the attributes of the data set, of the groups that hold it
    and of the file, and from data sets of one value in them, which must agree. Each vector gives a row, a matrix one
    for each vector of it, named ``PATH_1`` and so on.

    Args:
        patterns: of the paths of the wanted data sets, such as ``run1/acc*``, or of their names in groups; none: all.
        zone: IANA name of the zone of stamps that name none.
        pulses: pattern of the path of the times of pulses; see :mod:`.pulse_times`.
        wanted, slow: see :func:`streams.files.lengths.of_one_length`.
        disregard: patterns of the attributes that are not believed.

    Raises:
        ReaderError: ``empty``; ``refused`` for links, external storage, virtual data sets and more than
            :mod:`streams.types.limits` allows; ``incomplete`` where the file breaks off or samples were never written;
            ``wrong_shape`` where nothing matches or lengths differ; ``wrong_rate`` where rates differ; ``unreadable``.
    """
    with open_hdf5(data, name) as file:
        found: list[Found] = []
        vectors: list[Found] = []
        marks: list[Found] = []
        for item in _walked(file, name, patterns, pulses):
            if matches_pulses(pulses, item.path, item.path.rpartition("/")[0]):
                marks.append(item)
                continue
            found.append(item)
            shape = item.dataset.shape
            if shape and max(shape) >= 2 and may_be_rows(item.dataset.dtype, shape):
                vectors.append(item)
                # Before any is loaded, and before the rest is listed.
                check_rows(len(vectors), name, "vectors")
        arrays: list[tuple[str, NDArray[np.floating], Facts]] = []
        budget, torn = Budget(name, len(data)), dict[str, str]()
        for item in vectors:
            try:
                array, facts = load_unpacked(item, name, budget)
            except ReaderError as error:
                if error.status != "incomplete" or pulses is not None:
                    raise
                torn.setdefault(item.path.rpartition("/")[0], str(error))
                rows = min(item.dataset.shape) if item.dataset.ndim > 1 else 1
                arrays.append((item.path, np.empty((rows, 0)), item.facts))
                continue
            arrays.append((item.path, rows_of(array, f"{name}: data set {item.path}"), facts))
            budget.add_rows(len(arrays[-1][1]))
        held = ", ".join(f"{item.path}{list(item.dataset.shape or ())}"[:60] for item in found[:12]) or "no data set"
        none = f"no vector matches {', '.join(patterns) or '*'}; {held}"
        separator = "/" if pulses is None else ""
        samples = join_arrays(arrays, name, zone, none, wanted, slow, disregard, separator, torn)
        tacho = None if pulses is None else only_one(marks, pulses, name)
        if tacho is None:
            return samples
        own, where = own_facts(tacho.own, tacho.facts), f"{name}: data set {tacho.path}"
        times = load_unpacked(replace(tacho, facts=tacho.own), name, budget)[0]
        return with_pulses(samples, times, own, zone, where, stated_start(tacho.own, zone, where))


def _walked(file: Any, name: str, patterns: Sequence[str], pulses: str | None) -> Iterator[Found]:
    """Yield the data sets that match; where none does, those in groups, as recordings are."""
    none = True
    for item in walk(file, name, sought(patterns, pulses)):
        none = False
        yield item
    if none and patterns:
        yield from walk(file, name, sought([f"*/{pattern}" for pattern in patterns], pulses))


class Budget:
    """Rows and bytes that the arrays of one file may have together."""

    def __init__(self, name: str, stored: int) -> None:
        """Take the name of the file and its size in bytes."""
        self._name, self._stored = name, stored
        self._bytes = self._rows = 0

    def add_bytes(self, count: int) -> None:
        """Count an array before it is loaded; ``refused`` where all are too large."""
        self._bytes += count
        check_claim(self._bytes, self._stored, self._name)

    def add_rows(self, count: int) -> None:
        """Count the rows of an array; ``refused`` where there are too many."""
        self._rows += count
        check_rows(self._rows, self._name, "vectors")


def join_arrays(
    arrays: Sequence[tuple[str, NDArray[np.floating], Facts]],
    name: str,
    zone: str,
    none: str,
    wanted: Sequence[str] = (),
    slow: Sequence[str] = (),
    disregard: Sequence[str] = (),
    separator: str = "",
    torn: Mapping[str, str] | None = None,
) -> Samples:
    """Join arrays of shape (row, sample), with their names and what is stated of each.

    A row is named as its array, ``NAME_1`` and so on where it has several. ``zone`` is the IANA name of the zone of
    stamps that name none, ``none`` the reason to give where there is no array, ``disregard`` names the keys that are
    not believed; ``wanted`` and ``slow`` as in :func:`streams.files.lengths.of_one_length`; ``separator`` divides the
    name of a group that may be a recording from those of its arrays, "" where none can be; ``torn`` as in
    :func:`streams.files.successive.recordings_of`.

    Raises:
        ReaderError: ``wrong_shape`` without rows or for different lengths, ``wrong_rate`` for different rates.
    """
    if not arrays:
        raise ReaderError("wrong_shape", f"{name}: {none}")
    numbers = [item for item in arrays if item[2].get(STORED) != DIGITAL]
    lengths = {item[1].shape[1] for item in numbers if item[1].size}
    # Truth values come last, so that they do not move the numbers of the others; some are flags of something else.
    digital = [item for item in arrays if item[2].get(STORED) == DIGITAL and lengths <= {item[1].shape[1]}]
    rows: list[StatedRow] = []
    for key, array, stated in (*numbers, *digital):
        names = [key] if len(array) == 1 else [f"{key}_{i}" for i in range(1, len(array) + 1)]
        rows += [
            StatedRow(values, row, row.rpartition("/")[2], stated) for row, values in zip(names, array, strict=True)
        ]

    def joined(some: Sequence[StatedRow]) -> Samples:
        kept, beside = of_one_length(some, wanted, slow, name, "vectors", max_listed=_MAX_LISTED)
        of_rows = judged(kept, name, "vectors", zone, max_listed=_MAX_LISTED, disregard=disregard)
        return with_beside(of_rows, beside)

    def parted(row: StatedRow) -> tuple[str, str]:
        group, _, short = row.name.rpartition(separator)
        return group, short

    several = recordings_of(rows, name, zone, joined, parted=parted, torn=torn) if separator else None
    if several is None and torn:
        raise ReaderError("incomplete", next(iter(torn.values())))
    return joined(rows) if several is None else several


@contextmanager
def open_hdf5(data: Data, name: str) -> Iterator[Any]:
    """Open an HDF5 file in memory; while it is open any failure is a ReaderError."""
    if not data:
        raise ReaderError("empty", f"{name}: the file has 0 bytes")
    # The library does not check for bytes in memory that the file is as long as its superblock says.
    base = next((place for place in (0, 512, 1024, 2048) if data[place : place + 8] == SIGNATURE), None)
    if base is None:
        raise ReaderError("unreadable", f"{name}: not an HDF5 file")
    declared = hdf5_size(data, base)
    if declared is not None and declared > len(data):
        raise ReaderError("incomplete", f"{name}: {declared} bytes are declared, {len(data)} are there")
    h5py = library("h5py", "hdf5", f"{name}: needs")
    with (
        readable(name, "a readable HDF5 file", lambda error: str(error)[:200]),
        h5py.File(data.path, "r") if isinstance(data, FileBytes) else h5py.File(h5py.h5f.open_file_image(data)) as file,
    ):
        yield file


def walk(file: Any, name: str, patterns: Sequence[str] = (), separator: str = "/") -> Iterator[Found]:
    """Yield the data sets whose paths match a pattern (none: all), along hard links.

    Raises:
        ReaderError: ``refused`` where a matching path is a soft or external link, or the file has too many objects.
    """
    count = 0
    seen: set[Any] = set()
    stack: list[tuple[str, Any, Facts]] = [("", file, attributes(file))]
    while stack:
        prefix, group, outer = stack.pop()
        inherited = nearest(outer, _scalars(group), _around(prefix))
        below: list[tuple[str, Any, Facts]] = []
        for key in sorted(group):
            if key.startswith(_HIDDEN):
                continue
            count += 1
            path = f"{prefix}{separator}{key}" if prefix else key
            if count > _MAX_OBJECTS or path.count(separator) > _MAX_DEPTH:
                raise ReaderError("refused", f"{name}: more than {_MAX_OBJECTS} objects or {_MAX_DEPTH} levels")
            matches = not patterns or any(fnmatchcase(path, pattern) for pattern in patterns)
            kind = type(group.get(key, getlink=True)).__name__
            if kind != "HardLink":
                if matches:
                    raise ReaderError("refused", f"{name}: {path[:100]} is a link ({kind}), which are never followed")
                continue
            item = group[key]
            own = attributes(item)
            if hasattr(item, "keys"):
                if hash(item.id) not in seen:
                    seen.add(hash(item.id))
                    below.append((path, item, nearest(inherited, own, _around(prefix))))
            elif hasattr(item, "shape") and matches:
                yield Found(path, item, nearest(inherited, own, _around(prefix)), own)
        stack.extend(reversed(below))


def _scalars(group: Any) -> dict[str, object]:
    """Return what data sets of one value in a group state, as attributes do."""
    stating = [key for key in sorted(group)[:_MAX_OBJECTS] if is_stating(plain_key(key))]
    found: list[tuple[str, Any]] = []
    for key in stating[:_MAX_ATTRIBUTES]:
        item = group[key] if type(group.get(key, getlink=True)).__name__ == "HardLink" else None
        shape = getattr(item, "shape", None)
        if item is None or shape is None or prod(shape) != 1 or item.external or item.is_virtual:
            continue
        if item.dtype.kind in "fiuSO" and item.dtype.itemsize <= _MAX_ATTRIBUTE_BYTES:
            found.append((key, item[()]))
    return attribute_facts(found)


def _around(group: str) -> str:
    return f"of {group or 'the file'}"


def attributes(item: Any) -> dict[str, object]:
    """Return the attributes as :func:`streams.files.packing.attribute_facts` does, without large ones."""

    def small() -> Iterator[tuple[str, Any]]:
        for key in list(item.attrs)[:_MAX_ATTRIBUTES]:
            attribute = item.attrs.get_id(key)
            if prod(attribute.shape or ()) * attribute.dtype.itemsize <= _MAX_ATTRIBUTE_BYTES:
                yield key, item.attrs[key]

    return attribute_facts(small())


def load_unpacked(item: Found, name: str, budget: Budget) -> tuple[NDArray[Any], Facts]:
    """Read the values of a data set, NaN for missing samples, and what is stated of it; ReaderError."""
    fill = property_fill(item.dataset)
    return unpacked(load(item, name, budget), item.own, item.facts, f"{name}: data set {item.path[:100]}", (fill,))


def load(item: Found, name: str, budget: Budget) -> NDArray[Any]:
    """Read a data set once its claims are checked; ReaderError as :func:`read_hdf5`."""
    dataset, where = item.dataset, f"{name}: data set {item.path[:100]}"
    if dataset.external:
        raise ReaderError("refused", f"{where} lies in other files, which are never read")
    if dataset.is_virtual:
        raise ReaderError("refused", f"{where} is virtual, made of other files, which are never read")
    if dataset.dtype.hasobject or dataset.dtype.names is not None:
        raise ReaderError("unreadable", f"{where}: expected numbers, got type {dataset.dtype}")
    shape = dataset.shape or ()
    declared = prod(shape) * dataset.dtype.itemsize
    budget.add_bytes(declared)
    if dataset.chunks is None:
        stored = dataset.id.get_storage_size()
        if stored < declared:
            raise ReaderError("incomplete", f"{where} claims {declared} bytes, {stored} are there")
    else:
        expected = prod(-(-size // chunk) for size, chunk in zip(shape, dataset.chunks, strict=True))
        written = dataset.id.get_num_chunks()
        if written < expected:
            raise ReaderError("incomplete", f"{where}: {expected} chunks are promised, {written} were written")
    return np.asarray(dataset[()]) if declared < large.MAX_IN_MEMORY else _on_disk(dataset)


def _on_disk(dataset: Any) -> NDArray[Any]:
    """Read a data set in pieces of whole chunks, so that each is unpacked once."""
    found = array_on_disk(dataset.shape, dataset.dtype)
    axis = longest_axis(dataset.shape)
    least = 1 if dataset.chunks is None else dataset.chunks[axis]
    for part in parts_along(dataset.shape, dataset.dtype.itemsize, axis, least):
        found[part] = dataset[part]
        forget_pages(found)
    return found
