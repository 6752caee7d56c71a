"""What the files of a recording state about themselves, before anything is configured."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import NDArray

from streams.files.abscissa import abscissa_called, rate_of_times
from streams.files.columns import ColumnKind, Kind, kinds_of
from streams.files.container import Files, Item, open_files
from streams.files.datasets import DataSet, FileFacts
from streams.files.groups import NameGroups, name_groups, not_read
from streams.files.judge import opened_rate
from streams.files.levels import in_own_units
from streams.files.load import Loader
from streams.files.plausible import SignalLevel, level_of
from streams.files.recognise import as_pattern, data_set_of
from streams.files.sidecar import is_pulse_file, is_sidecar, pulse_pattern
from streams.files.statements import nice_rate
from streams.turns.tacho import TachoRow, is_called_tacho, tacho_row
from streams.types.listing import natural_key, shown
from streams.types.samples import ReaderError, Samples
from streams.types.spec import UNITS, ChannelSpec, SourceError, SourceSpec
from streams.types.stamps import date_folders, epoch_seconds

_MAX_TRIED = 5
"""Files that are tried from each end until one can be read."""
_RPM_IN_NAME = re.compile(r"(?<![\d.])(\d{2,5}(?:\.\d+)?)[ _-]?(?:rpm|upm|u[_-]?min)", re.IGNORECASE)


@dataclass(frozen=True)
class SurveyedRow:
    """A row of the files.

    Attributes:
        name: short name by the file or its data set.
        title: name in the file, by which a channel finds it.
        column: its number, from 1.
        kind: what it seems to measure, ``evidence`` in words why; "" for vibration.
        unit: "g", "m/s2", "V" or "unknown" where the file states one of them, or a multiple; else None.
        written: the unit as the file spells it, "" where it states none.
        factor: from the stored numbers to ``unit``, of a multiple.
        stored: how the numbers are stored (:mod:`streams.types.samples`).
        level: of the first file that can be read, in ``unit``.
        tacho: its pulses in that file, None where it is no tacho.
        samples: their number where it is another one than that of the signals, else None.
    """

    name: str
    title: str
    column: int
    kind: Kind
    unit: str | None
    written: str
    factor: float
    stored: str
    level: SignalLevel
    tacho: TachoRow | None = None
    evidence: str = ""
    samples: int | None = None


@dataclass(frozen=True)
class Survey:
    """What is known of a recording.

    Attributes:
        place: the folder, file or archive.
        data_set: name of the format or data set; ``plain`` where it is a format of files of any origin.
        paths: of its files in natural order; ``ignored`` those of another format.
        first: path of the first file that can be read, ``last`` of the last one.
        rows: of the first file.
        rate: Hz, as the files state it, or ``rate_from`` a row of times alone; None where neither does.
        seconds: lengths of the first and the last file, None without a rate.
        starts: times that the headers of the first and the last file state, s since 1970 UTC, None where they do not.
        stamp: that of the first file, where its order of day and month is open, as it is written.
        speed: of the shaft as the first file or the names state it, Hz; ``speed_from`` says which.
        load: N, as the first file states it.
        scaled: whether a side-car scales the rows, ``has_sidecar`` whether there is one.
        changed: times of the last change of the first and the last file, s since 1970 UTC.
        refused: files that cannot be read, with the reason.
        values: samples of the first file, shape (row, sample).
        chosen: whether the files hold rows of other lengths than those of ``rows``; those are ``beside``.
        files: patterns of the files, of several each is that of a channel.
        rate_hint: the roundest rate, Hz, that a row of times too coarse to state it allows, and the name of the row.
        rate_words: what a rate may mean whose way of writing leaves it open, "" where it is not.
        groups: into which the names fall, where it is open whether their files are read together.
        pulses: pattern of the files of pulses beside the others, or name of an array of them; None: there are none.
    """

    place: Path
    data_set: DataSet
    paths: tuple[str, ...]
    ignored: tuple[str, ...]
    first: str
    last: str
    rows: tuple[SurveyedRow, ...]
    rate: float | None
    rate_from: str | None
    samples: tuple[int, int]
    starts: tuple[float | None, float | None]
    stamp: str | None
    speed: float | None
    speed_from: str
    load: float | None
    scaled: bool
    changed: tuple[float | None, float | None]
    refused: tuple[str, ...]
    values: Samples
    chosen: bool = False
    beside: tuple[SurveyedRow, ...] = ()
    pulses: str | None = None
    files: tuple[str, ...] = ()
    groups: NameGroups | None = None
    rate_hint: tuple[float, str] | None = None
    rate_words: str = ""

    @property
    def is_folder(self) -> bool:
        """Whether files may follow."""
        return self.place.is_dir()

    def in_folders(self, path: str) -> str:
        """Return the path of a file behind the folders above the recording that hold nothing but a date."""
        above = date_folders(str(self.place if self.is_folder else self.place.parent))
        return f"{above}/{path}" if above else path

    @property
    def start(self) -> float | None:
        """Time that the header of the first file states, s since 1970 UTC, or None."""
        return self.starts[0]

    @property
    def vibration(self) -> tuple[SurveyedRow, ...]:
        """The rows that seem to be vibration."""
        return tuple(row for row in self.rows if row.kind == "vibration")

    @property
    def all_rows(self) -> tuple[SurveyedRow, ...]:
        """The rows, and those of other lengths."""
        return *self.rows, *self.beside

    @property
    def tacho(self) -> SurveyedRow | None:
        """The row of a tacho, that with the most pulses; None where there is none."""
        rows = [row for row in self.rows if row.tacho is not None]
        return max(rows, key=lambda row: 0 if row.tacho is None else row.tacho.pulses, default=None)

    def seconds(self, rate: float) -> tuple[float, float]:
        """Return the lengths of the first and the last file at a rate, s."""
        return self.samples[0] / rate, self.samples[1] / rate


def survey(path: str, kind: str = "auto", zone: str = "UTC", patterns: tuple[str, ...] = ()) -> Survey:
    """Look at the files of a path.

    Files whose names are those of channels are read together.

    Args:
        path: a file, a folder or an archive.
        kind: name of a format or data set; "auto": recognised.
        zone: IANA name of the zone of times that name none.
        patterns: of its files, see :class:`streams.types.spec.SourceSpec`; none: told by the names.

    Raises:
        SourceError: there is no such path, or nothing in it is recognised.
        ReaderError: none of the files that were tried can be read; it names each reason.
    """
    spec = SourceSpec("survey", path, format=kind, timezone=zone)
    files = open_files("survey", path)
    spec = replace(spec, pulses=None if files.sequential else pulse_pattern([item.path for item in files]))
    spec = replace(spec, files=patterns)
    data_set = data_set_of(spec, files, kind)
    groups = None if patterns or not files.several or not data_set.plain else _groups(data_set, files)
    if groups is not None and groups.is_certain and groups.is_exact and not files.sequential:
        spec, groups = replace(spec, files=groups.patterns), None
        data_set = data_set_of(spec, files, kind)
    found = replace(_surveyed(spec, path, files, data_set), groups=groups)
    if not found.values.beside:
        return found
    tachos = [title for title in found.values.beside if is_called_tacho(title)]
    if len(tachos) == 1 and spec.pulses is None:
        with_pulses = replace(spec, pulses=as_pattern(tachos[0]))
        # What is called so may hold no times.
        with contextlib.suppress(ReaderError, SourceError):
            read = _surveyed(with_pulses, path, files, data_set_of(with_pulses, files, data_set.name))
            found = replace(read, groups=groups)
    beside = tuple(row for title in found.values.beside for row in _row_beside(spec, files, found, title))
    return replace(found, chosen=True, beside=beside)


def _groups(data_set: DataSet, files: Files) -> NameGroups | None:
    """Return the groups into which the names of the files of a format fall, None where they are one sequence."""
    zone = ZoneInfo("UTC")
    return name_groups([item.path for item in files if data_set.facts(item.path, str(files.root), zone) is not None])


def _row_beside(spec: SourceSpec, files: Files, found: Survey, title: str) -> Iterator[SurveyedRow]:
    """Yield the row of the first file that has another length than its signals, where it can be read."""
    alone = replace(spec, channels=(ChannelSpec(title, key=as_pattern(title)),))
    with contextlib.suppress(ReaderError, SourceError):
        item = next(item for item in files if item.path == found.first)
        samples = data_set_of(alone, files, found.data_set.name).read(item.read(), item.path)
        row = replace(surveyed_rows(samples, None)[0], samples=samples.values.shape[1])
        yield replace(row, kind="other") if row.kind == "vibration" else row


def _surveyed(spec: SourceSpec, path: str, files: Files, data_set: DataSet) -> Survey:
    loader = Loader(spec, data_set, files.root)
    known: list[tuple[Item, FileFacts]] = []
    others: list[str] = []
    read: dict[str, Samples] = {}
    refused: dict[str, str] = {}
    for item in files:
        facts = loader.facts(item.path)
        if facts is None:
            others.append(item.path)
        else:
            known.append((item, facts))
            if files.sequential and not read and len(refused) < _MAX_TRIED:
                # The members of an archive can be read in its order only.
                _try(loader, item, read, refused)
    if not files.sequential:
        known.sort(key=lambda entry: natural_key(entry[0].path))
        for ends in (known, known[::-1]):
            for item, _ in ends[:_MAX_TRIED]:
                if item.path in read or _try(loader, item, read, refused):
                    break
    paths = tuple(item.path for item, _ in known)
    if not read:
        reasons = "; ".join(refused.values()) or f"{shown(path)}: holds no file"
        raise ReaderError("unreadable", reasons)
    others = [other for other in others if not is_pulse_file(spec.pulses, other)]
    others = not_read(spec.files, others, paths)
    ignored = tuple(other for other in others if not is_sidecar(other, dict.fromkeys(paths)))
    place = files.root if files.several else Path(path)
    found = _found(place, data_set, {item.path: (item, facts) for item, facts in known}, read)
    return replace(found, ignored=ignored, refused=tuple(refused.values()), pulses=spec.pulses, files=spec.files)


def _try(loader: Loader, item: Item, read: dict[str, Samples], refused: dict[str, str]) -> bool:
    """Read a file into ``read``, or note in ``refused`` why it cannot be; return whether it was read."""
    try:
        read[item.path] = loader.read(item.read(), item.path, item.path)
    except ReaderError as error:
        refused[item.path] = str(error)
    return item.path in read


def _found(
    place: Path, data_set: DataSet, known: dict[str, tuple[Item, FileFacts]], read: dict[str, Samples]
) -> Survey:
    """Return what the first and the last file that were ``read`` state."""
    first, last = next(iter(read)), list(read)[-1]
    samples, ending, facts = read[first], read[last].recordings[-1], known[first][1]
    rate, rate_from = samples.rate if samples.rate is not None else facts.rate, None
    rows = surveyed_rows(samples, data_set.unit, rate)
    if rate is None:
        rate, rate_from = _rate_by_row(samples, rows)
    speed, speed_from = samples.speed if samples.speed is not None else facts.speed, "stated by the files"
    if speed is None:
        speed, speed_from = samples.stated_speed, "by the properties of the files"
    if speed is None:
        speed, speed_from = _speed_in_names([place.name, *known]), "by the names"
    return Survey(
        place=place,
        data_set=data_set,
        paths=tuple(known),
        ignored=(),
        first=first,
        last=last,
        rows=rows,
        rate=None if rate is None else nice_rate(rate, 1e-6),
        rate_from=rate_from,
        rate_hint=None if rate is not None else _coarse_rate(samples, rows),
        rate_words=f"{opened.written} may mean {opened.meant}" if (opened := opened_rate(samples)).readings else "",
        samples=(samples.values.shape[1], ending.values.shape[1]),
        starts=(samples.start, ending.start),
        stamp=samples.stamp,
        speed=speed,
        speed_from=speed_from if speed is not None else "",
        load=samples.load if samples.load is not None else samples.stated_load,
        scaled=samples.scaled,
        changed=(known[first][0].changed(), known[last][0].changed()),
        refused=(),
        values=samples,
    )


def surveyed_rows(samples: Samples, unit: str | None, rate: float | None = None) -> tuple[SurveyedRow, ...]:
    """Return what each row of a file is; ``unit`` is that of all rows by the data set, or None, ``rate`` in Hz."""
    written = tuple(stated or unit or "" for stated in samples.units)
    own, factors = in_own_units(replace(samples, units=tuple(text or None for text in written)))
    vibration = ColumnKind("vibration")
    meant = [given if given in UNITS else text for given, text in zip(own.units, written, strict=True)]
    kinds = kinds_of(samples.names, meant, list(samples.values)) if unit is None else [vibration] * len(written)
    rows = [
        SurveyedRow(
            name=name,
            title=title,
            column=column,
            kind=kind.kind,
            evidence=kind.evidence,
            unit=stated if stated in UNITS else None,
            written=text,
            factor=factor,
            stored=stored,
            level=level_of(row).times(factor),
        )
        for name, title, column, kind, row, text, stated, factor, stored in zip(
            samples.channels, samples.names, samples.columns, kinds, samples.values, written, own.units, factors,
            own.stored, strict=True,
        )
    ]  # fmt: skip
    if unit is None:
        told = [_with_tacho(row, values, rate) for row, values in zip(rows, samples.values, strict=True)]
        # Where nothing else is left, a row is no tacho.
        rows = told if any(row.kind == "vibration" for row in told) else rows
    return tuple(rows)


def _with_tacho(row: SurveyedRow, values: NDArray[np.floating], rate: float | None) -> SurveyedRow:
    """Return a row as that of a tacho where it is one."""
    if row.kind in ("time", "load"):
        return row
    found = tacho_row(values, f"{row.title} {row.written}", rate)
    return row if found is None else replace(row, kind="tacho", tacho=found)


def _rate_by_row(samples: Samples, rows: Sequence[SurveyedRow]) -> tuple[float | None, str | None]:
    """Return the rate that a row of times gives, and its title."""
    for row, values in zip(rows, samples.values, strict=True):
        if row.kind == "time":
            try:
                rate = rate_of_times(values, row.title)
            except ReaderError:
                continue
            if rate is not None:
                return rate, row.title
    return None, None


def _coarse_rate(samples: Samples, rows: Sequence[SurveyedRow]) -> tuple[float, str] | None:
    """Return the roundest rate in Hz that the rounding of a row of times allows, and its title, or None."""
    for row, values in zip(rows, samples.values, strict=True):
        if row.kind != "time":
            continue
        first, size = float(values[0]), abscissa_called(row.title, row.written).size
        by_size = epoch_seconds(first)
        times = np.asarray(values, np.float64) * (size or (by_size / first if by_size is not None else 1.0))
        steps = np.diff(times)
        span, unit = float(times[-1] - times[0]), float(np.min(steps[steps > 0.0], initial=np.inf))
        if span > 0.0 and unit < 0.1 * span:
            low, high = (times.size - 1) / (span + unit), (times.size - 1) / (span - unit)
            rounded = (float(f"{0.5 * (low + high):.{digits}g}") for digits in range(1, 7))
            return next((rate for rate in rounded if low <= rate <= high), 0.5 * (low + high)), row.title
    return None


def _speed_in_names(names: Sequence[str]) -> float | None:
    """Return the speed that names state in rpm, Hz; None where none does, or they differ."""
    found = {float(match[1]) / 60.0 for name in names for match in _RPM_IN_NAME.finditer(name)}
    return found.pop() if len(found) == 1 else None
