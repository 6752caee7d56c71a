"""From the bytes of a file to samples, for followed folders and recordings alike."""

from __future__ import annotations

import logging
import re
from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

from streams.files.claims import check_claims
from streams.files.columns import refuse_running, vibration_rows, with_times
from streams.files.container import changed_error, first_of
from streams.files.contradictions import doubts_of
from streams.files.foreign import HEAD_BYTES, seen_in, with_hint
from streams.files.judge import agreed_rate, opened_rate
from streams.files.levels import (
    check_unit,
    factor_of,
    in_own_units,
    level_in_words,
    refuse_open,
    rows_as_stored,
    scaled_by,
    unit_of,
)
from streams.files.parse.complete import declared_size
from streams.files.pulse_times import fitting_pulses
from streams.files.successive import check_order
from streams.reblock import MIN_BLOCK_SHARE, Reblocker
from streams.types.large import Data, FileBytes, NoRoomError
from streams.types.limits import max_blocks
from streams.types.samples import ReaderError, Samples
from streams.types.spec import ChannelSpec, SourceSpec
from streams.types.stamps import repeated_by, resolution_of
from streams.types.times import TimeStatement

if TYPE_CHECKING:
    # At run time the receivers of frames, which call this module too, need no parser.
    from streams.dates.dater import Dater
    from streams.files.datasets import DataSet, FileFacts

_LOG = logging.getLogger(__name__)
_MAX_TOLD = 100
"""Doubts of which each is logged."""
_MAX_LISTED = 1000
"""Characters of names in a message."""


def is_dated_by_choice(spec: SourceSpec, data_set: DataSet) -> bool:
    """Return whether files of a data set are dated by the choice for their source.

    Those of published data sets are unrelated recordings unless the configuration says otherwise.
    """
    return data_set.plain or any(
        value is not None for value in (spec.start, spec.time_from, spec.time_name, spec.interval)
    )


def is_cut(spec: SourceSpec, data_set: DataSet) -> bool:
    """Return whether files are cut into blocks of one length, not taken as one block each."""
    return not (data_set.snapshot or spec.block_s == "file")


def cutter_of(spec: SourceSpec, data_set: DataSet) -> Reblocker | None:
    """Return what cuts the samples of a source into blocks, None where each file is one."""
    if not is_cut(spec, data_set) or spec.block_s == "file":
        return None
    return Reblocker(spec.block_s, spec.block_revolutions)


class Loader:
    """Loads the files of one source.

    ``root`` is the resolved folder or archive that holds them; its name may state run and condition.
    """

    def __init__(
        self, spec: SourceSpec, data_set: DataSet, root: Path, *, several: bool = True, dater: Dater | None = None
    ) -> None:
        """Prepare.

        Args:
            several: there may be more than one file: undated ones have no known distance in time then.
            dater: dates the files of which the data set states no date; None: they have none.
        """
        self.root, self.data_set, self.dater = root, data_set, dater
        self._spec, self._several = spec, several
        self._zone = ZoneInfo(spec.timezone)
        self._told: set[str] = set()

    def facts(self, path: str) -> FileFacts | None:
        """Return what the path of a file states; None for a file of another kind."""
        facts = self.data_set.facts(path, str(self.root), self._zone)
        place = None if facts is None or self.dater is None else self.dater.name_order(path)
        return facts if facts is None or place is None else replace(facts, order=((0, place, ""), *facts.order))

    @property
    def ignored(self) -> str:
        """Why files without :meth:`facts` are ignored."""
        return f"of another format than {self.data_set.name} ({self.data_set.files})"

    def reason_to_ignore(self, path: str, root: Path | None) -> str:
        """Return :attr:`ignored`, and what the file is that is ignored; ``root``: None where it cannot be looked at."""
        found = seen_in(path, b"" if root is None else first_of(root, path, HEAD_BYTES))
        return self.ignored if found is None else f"{self.ignored}: it is {found}"

    def load(
        self,
        raw: Data,
        path: str,
        facts: FileFacts,
        name: str | None = None,
        *,
        changed: float | None = None,
        whole: bool = True,
    ) -> Samples:
        """Return the configured channels of a file, with rate, units and times settled, of each of its recordings.

        Args:
            raw: the bytes of the file as stored.
            path: of the file below the root.
            facts: stated by its path.
            name: of the file in messages, default the path.
            changed: time of the last change of the file, s since 1970 UTC.
            whole: the file will not grow.

        Raises:
            ReaderError: with a sentence that names the file; ``unreadable`` for any other exception of a parser.
            UndatedError: see :meth:`streams.dates.dater.Dater.date`.
        """
        samples = self.load_undated(raw, path, facts, name or path)
        return self.date(samples, path, facts, changed, whole=whole)

    def date(
        self, samples: Samples, path: str, facts: FileFacts, changed: float | None, *, whole: bool = True
    ) -> Samples:
        """Return what :meth:`load_undated` gave with its times; arguments and errors as :meth:`load`."""
        if samples.following:
            return self._date_each(samples, path, facts, changed, whole=whole)
        if self.dater is None or facts.start is not None or facts.elapsed is not None:
            start, elapsed = self._times(samples, facts)
            if start is not None:
                stated = self._stated(start, counted=elapsed is not None, named=facts.start is not None)
                samples = samples.changed(stated=stated)
            if self.dater is not None:
                self.dater.note_own(self.data_set.name, start if elapsed is None else None)
            samples = samples.changed(start=start, elapsed=elapsed)
        else:
            samples = self.dater.date(samples, path, changed, whole=whole)
        samples = fitting_pulses(samples, path)
        return self._doubted(samples, path) if samples.unlisted else samples

    def _doubted(self, samples: Samples, path: str) -> Samples:
        """Return samples with what unlisted values contradict; each is logged once."""
        doubts = doubts_of(samples, self._spec.channels, self._spec.timezone)
        for one in doubts:
            if len(self._told) < _MAX_TOLD and (said := one.partition(", ")[0]) not in self._told:
                self._told.add(said)
                _LOG.warning("source %s: %s: %s", self._spec.name, path, one)
        return samples.changed(doubts=doubts) if doubts else samples

    def _date_each(
        self, samples: Samples, path: str, facts: FileFacts, changed: float | None, *, whole: bool
    ) -> Samples:
        """Date the recordings of a file: each by its own start or, where that of the file is by its name, a count or
        its last change, the later ones by how far their starts are behind that of the first.
        """
        first, *others = samples.recordings
        last = others[-1]
        begun = first.start or 0.0
        span = (last.time_of(last.end) or 0.0) - (first.time_of(first.end) or 0.0)
        dated = self.date(first, path, facts, None if changed is None else changed - span, whole=whole)
        if dated.start is not None and dated.stated is not None and dated.stated.source in ("header", "header_local"):
            found = [self.date(one, path, facts, None, whole=whole) for one in others]
        else:
            found = [_later(one, dated, (one.start or 0.0) - begun) for one in others]
        return dated.changed(following=tuple(found))

    def _stated(self, start: float, *, counted: bool, named: bool) -> TimeStatement:
        """Return what the start of a file of a data set is by: a count, a local time in its name, or its header."""
        if counted:
            return TimeStatement("count")
        if not named:
            return TimeStatement("header", resolution_of(start))
        return TimeStatement("name_local", resolution_of(start), repeated_by(start, self._spec.timezone))

    def load_undated(self, raw: Data, path: str, facts: FileFacts, name: str) -> Samples:
        """Return the same without times but those that the file states; ReaderError as :meth:`load`."""
        samples = self.read(raw, path, name)
        if not samples.following:
            return self._settled(samples, facts, len(raw), name)
        samples = samples.of_each(lambda one: self._settled(one, facts, len(raw), name))
        told = f"{name}: holds {len(samples.recordings)} recordings"
        check_order([(f"recording {one.number}", one) for one in samples.recordings], told, self._spec.timezone)
        return samples

    def _settled(self, samples: Samples, facts: FileFacts, stored: int, name: str) -> Samples:
        """Return the configured channels of a recording with rate and units, of a file of so many bytes."""
        self._check_length(samples, name)
        check_claims(self.data_set, facts, samples, name)
        samples = choose_channels(samples, self._spec.channels, self.data_set.unit, name, self._spec.range_g)
        if self.data_set.plain and self._spec.channels:
            refuse_running(samples, self._spec.channels, name)
        rate = agreed_rate((samples.rate, facts.rate), self._spec.rate, name, opened_rate(samples))
        self._check_blocks(samples.values.shape[1], rate, stored, name)
        return samples.changed(
            rate=rate,
            speed=samples.speed if samples.speed is not None else facts.speed,
            load=samples.load if samples.load is not None else facts.load,
        )

    def read(self, raw: Data, path: str, name: str) -> Samples:
        """Return all rows of a file and what the file itself states; ReaderError as :meth:`load`."""
        try:
            promised = declared_size(raw, path)
            # The reader of TDMS tells which segments are whole.
            if promised is not None and promised > len(raw) and raw[:4] != b"TDSm":
                raise ReaderError("incomplete", f"{path}: {len(raw)} bytes are there, its header promises {promised}")
            if not raw:
                raise ReaderError("empty", f"{path}: the file has 0 bytes")
            samples = self.data_set.read(raw, path)
            samples = samples.of_each(lambda one: with_times(one, path)) if self.data_set.plain else samples
            if isinstance(raw, FileBytes) and raw.is_changed:
                raise changed_error(path)
            return samples
        except NoRoomError:
            raise
        except MemoryError as error:
            raise ReaderError("refused", f"{name}: there is not enough memory for its {len(raw)} bytes") from error
        except Exception as error:
            if isinstance(raw, FileBytes) and raw.is_changed:
                raise changed_error(name) from error
            if isinstance(error, ReaderError):
                told = renamed(error, path, name)
                raise ReaderError(told.status, with_hint(str(told), path, raw)) from error
            # Third-party parsers raise any exception on damaged files; one file must not stop the others.
            _LOG.warning("%s: the reader failed", name, exc_info=True)
            raise ReaderError("unreadable", f"{name}: the reader failed ({type(error).__name__})") from error

    def levels(self, raw: Data, path: str) -> dict[str, str]:
        """Return in words what states the level of each channel of a file; ReaderError as :meth:`load`."""
        samples, unit = self.read(raw, path, path), self.data_set.unit
        samples = samples.changed(units=tuple(stated or unit for stated in samples.units))
        written = samples.units
        samples, _ = in_own_units(samples)
        found = {}
        for channel in self._spec.channels:
            row = _row_of(samples, channel, path)
            found[channel.name] = level_in_words(
                samples, row, channel, unit_of(samples, row, channel, path), self._spec.range_g
            )
            if written[row] != samples.units[row] and channel.scale is None:
                found[channel.name] += f", from {written[row]}"
        return found

    def _check_length(self, samples: Samples, name: str) -> None:
        expected, found = self.data_set.samples, samples.values.shape[1]
        if expected is None:
            return
        if found < MIN_BLOCK_SHARE * expected:
            raise ReaderError("short", f"{name}: {found} samples, {expected} were expected")
        if found > expected:
            raise ReaderError("wrong_shape", f"{name}: {found} samples, {expected} were expected")

    def _check_blocks(self, length: int, rate: float, stored: int, name: str) -> None:
        if self.data_set.snapshot or self._spec.block_s == "file":
            return
        count, allowed = length / max(1, round(self._spec.block_s * rate)), max_blocks(stored)
        if count > allowed:
            reason = f"{count:.0f} blocks of {self._spec.block_s:g} s, {allowed} are allowed for {stored} bytes"
            raise ReaderError("refused", f"{name}: {reason}")

    def _times(self, samples: Samples, facts: FileFacts) -> tuple[float | None, float | None]:
        """Return (start, elapsed) of the first sample of a file of a data set, None where not stated.

        A stamp precedes the configured start, and leaves no elapsed. Without stamps or numbers in known intervals only
        a recording of one file has times: nothing states the time between two files.
        """
        stamp = facts.start if facts.start is not None else samples.start
        if stamp is not None:
            return stamp, None
        if facts.elapsed is None and self._several:
            return None, None
        elapsed = facts.elapsed or 0.0
        return None if self._spec.start is None else self._spec.start + elapsed, elapsed


def _later(samples: Samples, first: Samples, seconds: float) -> Samples:
    """Return a recording with the times of the first one of its file, so much later."""
    start, elapsed = (None if time is None else time + seconds for time in (first.start, first.elapsed))
    return samples.changed(start=start, elapsed=elapsed, joins=first.joins, stated=first.stated)


def renamed(error: ReaderError, path: str, name: str) -> ReaderError:
    """Return an error that calls a file by its printable name instead of its path."""
    return error if path == name else ReaderError(error.status, str(error).replace(path, name))


def choose_channels(
    samples: Samples, channels: Sequence[ChannelSpec], unit: str | None, where: str, range_g: float | None = None
) -> Samples:
    """Select the rows of the configured channels, with their names and units.

    Args:
        channels: none: every row of vibration (:mod:`streams.files.columns`), by the data set's names.
        unit: of every row by the data set, or None.
        range_g: full scale in g of rows that are stored as fractions of it, where no scale is given.

    Raises:
        ReaderError: ``wrong_shape`` where a channel matches no row or several, or no row is vibration; ``wrong_unit``
            where the file states another unit than the configuration, or neither states one, or nothing states the
            level of integers.
    """
    if unit is not None:
        samples = samples.changed(units=tuple(stated or unit for stated in samples.units))
    rows = [_row_of(samples, channel, where) for channel in channels]
    as_stored = rows_as_stored(samples, channels, rows, where, range_g)
    for row, channel in zip(rows, channels, strict=True):
        refuse_open(samples, row, channel, f"{where}: channel {channel.name}")
    written = samples
    samples, multiples = in_own_units(samples, as_stored)
    if not channels:
        kept = vibration_rows(samples, where, is_ours=unit is not None)
        left = tuple(name for row, name in enumerate(samples.names) if row not in kept)
        samples = samples.select(kept).changed(beside=(*samples.beside, *left))
        multiples = tuple(multiples[row] for row in kept)
        for row, (name, stated) in enumerate(zip(samples.names, samples.units, strict=True)):
            refuse_open(written, kept[row], None, where)
            check_unit(stated, name, where)
            factor_of(samples, row, ChannelSpec(name, unit=stated), stated, None, f"{where}: {name}")
        return scaled_by(samples, multiples)
    units = tuple([unit_of(samples, row, channel, where) for row, channel in zip(rows, channels, strict=True)])
    both = zip(rows, channels, units, strict=True)
    factors = [
        factor_of(samples, row, channel, unit, range_g, f"{where}: channel {channel.name}")
        * (multiples[row] if channel.scale is None and not channel.any_unit else 1.0)
        for row, channel, unit in both
    ]
    return scaled_by(samples.select(rows, tuple([channel.name for channel in channels]), units), factors)


def _row_of(samples: Samples, channel: ChannelSpec, where: str) -> int:
    both = list(zip(samples.names, samples.channels, strict=True))
    if channel.key is not None:
        wanted = f"key {channel.key!r}"
        keys = [channel.key]
        if samples.following or samples.number > 1:
            # The rows of recordings are named without their groups.
            keys.append(re.split(r"[/.]", channel.key)[-1])
        found = [i for i, names in enumerate(both) if any(fnmatchcase(name, key) for name in names for key in keys)]
    elif isinstance(channel.column, int):
        wanted = f"column {channel.column}"
        found = [i for i, column in enumerate(samples.columns) if column == channel.column]
    elif channel.column is not None:
        wanted = f"column {channel.column!r}"
        found = [i for i, names in enumerate(both) if channel.column in names]
    else:
        wanted = "its name"
        found = [i for i, names in enumerate(both) if channel.name in names]
        if not found and len(both) == 1:
            found = [0]
    if len(found) != 1:
        count = "no column" if not found else f"{len(found)} columns"
        pairs = (f"{title} ({name})" for name, title in both)
        held = ", ".join(samples.names if samples.names == samples.channels else pairs)[:_MAX_LISTED]
        raise ReaderError("wrong_shape", f"{where}: channel {channel.name}: {count} by {wanted}; the file has {held}")
    return found[0]
