"""Samples from a file or frame to a block, with provenance; the error of readers."""

from __future__ import annotations

import errno
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.words.errors import SpallwatchError
from streams.turns.pulses import Pulses
from streams.types.block import Block
from streams.types.large import chosen_rows, contiguous, copy_into, empty_rows
from streams.types.limits import MAX_BYTES, MAX_DIMENSIONS, MAX_ROWS
from streams.types.times import TimeStatement

VALUES, SCALED, COUNTS, FRACTIONS = "values", "scaled integers", "integers", "fractions of full scale"
DIGITAL = "on and off"
"""How the numbers of a row are stored: as they are meant; as integers that the file or its side-car scales; as integers
without a scale, which are read as counts, or as -1 to 1 where the format defines a full scale (WAV, FLAC); as truth
values, read as 0 and 1."""

RATE_TOLERANCE = 1e-4
"""Rates that differ by no more than this part are the same rate, written or measured differently."""


_PASSING = frozenset(
    (
        *(errno.EAGAIN, errno.EBUSY, errno.EINTR, errno.EIO, errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOLCK),
        *(errno.ENOMEM, errno.ESTALE, errno.ETIMEDOUT),
    )
)


class Sensitivity(NamedTuple):
    """What a sensor gives: mV per ``unit``, "g" or "mm/s"."""

    millivolts: float
    unit: str = "g"

    @property
    def words(self) -> str:
        """The same in words."""
        return f"{self.millivolts:g} mV/{'g' if self.unit == 'g' else f'({self.unit})'}"


class OpenGain(NamedTuple):
    """An amplifier that a sensitivity may contain or not: where it is stated, and its factor, None for no number."""

    words: str
    factor: float | None = None


class ReaderError(SpallwatchError):
    """A file cannot be read; ``status`` is a rejection status of the interface."""

    def __init__(self, status: str, reason: str) -> None:
        """Keep the rejection status beside the message."""
        super().__init__(reason)
        self.status = status

    @property
    def may_pass(self) -> bool:
        """Whether the system refused what it may give a moment later, so that it says nothing of the file."""
        return isinstance(self.__cause__, OSError) and self.__cause__.errno in _PASSING


@dataclass(eq=False)
class Origin:
    """The file of some samples: its path in messages, and its samples when last read."""

    key: str
    total: int = 0


class UnlistedStatement(NamedTuple):
    """What a value under a key of no table may state of a ``fact``; it is offered or doubted, never believed.

    ``place`` and ``written`` are as messages quote them; ``readings`` are in SI or as the fact is counted, each within
    ``resolution``; ``text`` is what no number is.
    """

    fact: str
    place: str
    written: str
    readings: tuple[float, ...] = ()
    resolution: float = 0.0
    text: str = ""


_OF_ROWS = frozenset(("values", "columns", "channels", "names", "units", "stored", "sensitivities", "count_scales"))
"""Fields of samples that must fit each other."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Consecutive samples of one or several rows, and what is known about them.

    Attributes:
        values: shape (row, sample), float32 or float64, each row contiguous; in a frame of the wire as it was sampled.
        channels: name of each row by the data set or the configuration; default ``column_1`` and so on.
        names: name of each row in the file (header, variable); default the channels.
        columns: 1-based number of each row in the file; default from 1 on.
        units: of each row: "g", "m/s2", "V", "unknown", None where not stated (the default), or as the file spells it.
        rate: Hz, None where not stated; likewise None in what follows.
        rate_readings: Hz, what a rate may mean whose way of writing leaves it open; rate is None then.
        rate_resolution: Hz by which each of them is uncertain.
        rate_written: where it stands and how it is written.
        sensitivities: of each row, as the file states it; with an ``open_gain`` it tells no level.
        count_scales: of each row, the g of one count, as the file states it.
        open_gain: of an amplifier that the file states, None for none.
        open_multiplier: what it states of a factor that may have been applied or not, in words.
        stated_speed: of the shaft, Hz, as a head states it among other things: offered, not used for the block.
        stated_load: likewise the radial load, N.
        unlisted: what values under keys of no table may state.
        doubts: those of them that contradict what was judged, in words.
        start: seconds since 1970 UTC of the first sample of the origin.
        stamp: a date of the file whose order of day and month is open, as it is written; start is None then.
        written: the start as it is written, where it names no zone.
        stated: what states the start, and how exactly; None before the file is dated.
        joins: whether samples of another origin may be joined by their start.
        elapsed: seconds from the first sample of the source to that of the origin.
        speed: of the shaft, Hz.
        load: radial, N.
        scaled: whether a side-car has scaled the values, so that the configuration must not scale them again.
        stored: of each row, how its numbers are stored; by default ``VALUES``, numbers in its unit.
        origin: what the values were read from; blocks state how much of each origin they used.
        offset: index of the first value in its origin.
        pulses: of a tacho or an encoder over the whole origin, their times counted from its first sample.
        pulse_epoch: s since 1970 UTC from which the times of pulses count until the origin is dated, else None.
        pulses_per_revolution: pulses of a whole turn in a row that is a tacho.
        hashed: rows of the file whose content is compared, where others come from files beside it; None: all.
        beside: names of rows of the file that are left out: of another length or, where no channel is configured, no
            vibration.
        number: of the recording in its file, from 1.
        begin: index of its first value in the file, which is the origin of all its recordings.
        following: the other recordings of the file, in order of time.
        torn: of each recording of the file that broke off and is left out, where it is, and why.
    """

    values: NDArray[Any]
    channels: tuple[str, ...] = ()
    names: tuple[str, ...] = ()
    columns: tuple[int, ...] = ()
    units: tuple[str | None, ...] = ()
    rate: float | None = None
    start: float | None = None
    elapsed: float | None = None
    speed: float | None = None
    load: float | None = None
    scaled: bool = False
    stored: tuple[str, ...] = ()
    origin: Hashable = None
    offset: int = 0
    stamp: str | None = None
    joins: bool = True
    pulses: Pulses | None = None
    pulse_epoch: float | None = None
    pulses_per_revolution: int | None = None
    beside: tuple[str, ...] = ()
    hashed: int | None = None
    written: str | None = None
    stated: TimeStatement | None = None
    rate_readings: tuple[float, ...] = ()
    rate_resolution: float = 0.0
    rate_written: str = ""
    sensitivities: tuple[Sensitivity | None, ...] = ()
    count_scales: tuple[float | None, ...] = ()
    open_gain: OpenGain | None = None
    open_multiplier: str = ""
    stated_speed: float | None = None
    stated_load: float | None = None
    unlisted: tuple[UnlistedStatement, ...] = ()
    doubts: tuple[str, ...] = ()
    number: int = 1
    begin: int = 0
    following: tuple[Samples, ...] = ()
    torn: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Fill in the defaults of the rows; ValueError where parts do not fit."""
        if self.values.ndim != 2:
            raise ValueError(f"samples must have shape (row, sample), got {self.values.shape}")
        rows = self.values.shape[0]
        object.__setattr__(self, "columns", self.columns or tuple(range(1, rows + 1)))
        object.__setattr__(self, "channels", self.channels or tuple(f"column_{column}" for column in self.columns))
        object.__setattr__(self, "names", self.names or self.channels)
        none = (None,) * rows
        object.__setattr__(self, "units", self.units or none)
        object.__setattr__(self, "stored", self.stored or (VALUES,) * rows)
        object.__setattr__(self, "sensitivities", self.sensitivities or none)
        object.__setattr__(self, "count_scales", self.count_scales or none)
        counts = {len(self.columns), len(self.channels), len(self.names), len(self.units), len(self.stored)}
        counts |= {len(self.sensitivities), len(self.count_scales)}
        if counts != {rows}:
            raise ValueError(f"{rows} rows of samples, but {sorted(counts)} columns, channels, names and units")

    def changed(self, **fields: Any) -> Samples:
        """Return the same with other fields, as :func:`dataclasses.replace`, in a fifth of its time.

        Raises:
            TypeError: there is no such field.
            ValueError: parts do not fit.
        """
        if not fields.keys() <= self.__dict__.keys():
            raise TypeError(f"samples have no {', '.join(sorted(fields.keys() - self.__dict__.keys()))}")
        found = object.__new__(type(self))
        found.__dict__.update(self.__dict__, **fields)
        if not _OF_ROWS.isdisjoint(fields):
            found.__post_init__()
        return found

    @property
    def known_rate(self) -> float:
        """The sampling rate in Hz; ValueError before it is settled."""
        if self.rate is None:
            raise ValueError(f"the sampling rate of {self.origin} is not known")
        return self.rate

    @property
    def is_constant(self) -> bool:
        """Whether all samples of each row whose content is compared are equal, as those of a dead sensor."""
        rows = self.values[: self.hashed]
        return bool(np.all(rows == rows[:, :1])) and all(one.is_constant for one in self.following)

    @property
    def end(self) -> int:
        """Index behind the last sample in the origin."""
        return self.offset + self.values.shape[1]

    @property
    def block_pulses(self) -> Pulses | None:
        """The pulses with times counted from the first of these samples, which must have all of them."""
        return None if self.pulses is None else self.pulses.shifted((self.begin - self.offset) / self.known_rate)

    @property
    def recordings(self) -> tuple[Samples, ...]:
        """The recordings of the file, each without the others."""
        return (self.changed(following=()), *self.following) if self.following else (self,)

    @property
    def total(self) -> int:
        """Number of samples of all recordings of the file."""
        return (self.following[-1] if self.following else self).end

    def of_each(self, change: Callable[[Samples], Samples]) -> Samples:
        """Return what a change makes of each recording of the file."""
        if not self.following:
            return change(self)
        first, *others = map(change, self.recordings)
        return first.changed(following=tuple(others))

    def time_of(self, index: int) -> float | None:
        """Return the time of a sample of the recording by its index in the origin, however that was divided."""
        return None if self.start is None else self.start + (index - self.begin) / self.known_rate

    def elapsed_since(self, began: float | None) -> float | None:
        """Return the seconds from the first sample of the source to these, or None.

        ``began``: start of the first dated block of the source, s since 1970 UTC; None where this is the first.
        """
        if self.elapsed is not None:
            return self.elapsed + (self.offset - self.begin) / self.known_rate
        start = self.time_of(self.offset)
        if start is None:
            return None
        return 0.0 if began is None else start - began

    def select(
        self,
        rows: Sequence[int],
        channels: tuple[str, ...] | None = None,
        units: tuple[str | None, ...] | None = None,
    ) -> Samples:
        """Return some rows in the order given; all rows in order are not copied.

        Args:
            rows: places of the rows.
            channels: their names, by default as they are.
            units: their units, by default as they are.
        """
        if list(rows) == list(range(len(self.columns))):
            whole = contiguous(self.values, self.values.dtype)
            return self.changed(values=whole, channels=channels or self.channels, units=units or self.units)
        return self.changed(
            values=chosen_rows(self.values, rows),
            channels=tuple(self.channels[row] for row in rows) if channels is None else channels,
            names=tuple(self.names[row] for row in rows),
            columns=tuple(self.columns[row] for row in rows),
            units=tuple(self.units[row] for row in rows) if units is None else units,
            stored=tuple(self.stored[row] for row in rows),
            sensitivities=tuple(self.sensitivities[row] for row in rows),
            count_scales=tuple(self.count_scales[row] for row in rows),
        )

    def block(self, source: str, sequence: int, name: str, content_hash: str, elapsed: float | None) -> Block:
        """Return the block of all these samples; its start is that of the first one."""
        return Block(
            samples=self.values,
            rate=self.known_rate,
            channels=self.channels,
            units=tuple(unit or "unknown" for unit in self.units),
            source=source,
            sequence=sequence,
            name=name,
            start=self.time_of(self.offset),
            elapsed=elapsed,
            speed=self.speed,
            load=self.load,
            content_hash=content_hash,
            pulses=self.block_pulses,
            pulses_per_revolution=self.pulses_per_revolution,
            stated=self.stated,
            left_out=self.beside,
        )


def one_after_another(recordings: Sequence[Samples], torn: Sequence[str] = ()) -> Samples:
    """Return the first of the recordings of a file, followed by the others; ``torn``: of those that are left out."""
    placed: list[Samples] = []
    begin = 0
    for number, one in enumerate(recordings, 1):
        placed.append(one.changed(number=number, begin=begin, offset=begin, following=()))
        begin += one.values.shape[1]
    return placed[0].changed(following=tuple(placed[1:]), torn=tuple(torn))


def stack_rows(rows: Sequence[NDArray[np.floating]]) -> NDArray[np.floating]:
    """Join rows of equal length to shape (row, sample); a single one is not copied."""
    if len(rows) == 1:
        return contiguous(rows[0], rows[0].dtype)[np.newaxis]
    found = empty_rows((len(rows), rows[0].size), np.result_type(*rows))
    for target, row in zip(found, rows, strict=True):
        copy_into(target, row)
    return found


def stored_as(dtype: np.dtype[Any]) -> str:
    """Return ``COUNTS`` for an integer type, ``DIGITAL`` for truth values, else ``VALUES``."""
    return {"i": COUNTS, "u": COUNTS, "b": DIGITAL}.get(dtype.kind, VALUES)


def check_rows(count: int, where: str, kind: str = "rows") -> None:
    """Raise ``refused`` for more than ``MAX_ROWS`` of a ``kind`` ("columns", "channels")."""
    if count > MAX_ROWS:
        raise ReaderError("refused", f"{where}: {count} {kind}, {MAX_ROWS} are allowed")


def may_be_rows(dtype: np.dtype[Any], shape: Sequence[int]) -> bool:
    """Return whether an array holds rows of samples: real numbers, or a single row of truth values."""
    return dtype.kind in "fiu" or (dtype.kind == "b" and max(shape, default=0) == prod(shape))


def rows_of(array: NDArray[np.generic], where: str) -> NDArray[np.floating]:
    """Return a stored array of real numbers in shape (row, sample); its longer axis is time.

    It is float32 for float32, for truth values and for integers of at most 16 bits, else float64.

    Raises:
        ReaderError: ``wrong_shape`` for other dimensions or a square array, ``empty``, ``unreadable`` for other types,
            ``refused`` for more than ``MAX_ROWS`` rows.
    """
    if array.dtype.kind not in "fiub":
        raise ReaderError("unreadable", f"{where}: expected real numbers, got type {array.dtype}")
    if not 1 <= array.ndim <= MAX_DIMENSIONS:
        shape = f"{array.ndim} (shape {str(array.shape)[:60]})"
        raise ReaderError("wrong_shape", f"{where}: expected 1 or {MAX_DIMENSIONS} dimensions, got {shape}")
    squeezed = array[np.newaxis, :] if array.ndim == 1 else array
    if squeezed.size == 0:
        raise ReaderError("empty", f"{where}: holds no samples (shape {array.shape})")
    if squeezed.shape[0] == squeezed.shape[1] > 1:
        raise ReaderError("wrong_shape", f"{where}: cannot tell samples from channels in shape {array.shape}")
    rows = squeezed.T if squeezed.shape[0] > squeezed.shape[1] else squeezed
    check_rows(len(rows), where)
    exact = array.dtype.itemsize <= (4 if array.dtype.kind == "f" else 2)
    size = array.size * (4 if exact else 8)
    if size > MAX_BYTES:
        raise ReaderError("refused", f"{where}: {array.size} numbers of {size} bytes, {MAX_BYTES} bytes are allowed")
    return contiguous(rows, np.float32 if exact else np.float64)
