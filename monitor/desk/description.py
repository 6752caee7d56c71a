"""What a recording is read as: each column and fact with its reading, its evidence, and what is open."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from zoneinfo import ZoneInfo

from monitor.desk.answers import AnsweredBearing, bearing_sections, channel_names
from monitor.desk.desk import ImportDesk
from monitor.desk.questions import name_readings, speed_row, tacho_of, unit_of
from monitor.desk.text import level_in_g, scale_of
from streams.files.container import first_of
from streams.files.foreign import HEAD_BYTES, seen_in
from streams.files.survey import Survey, SurveyedRow
from streams.types.listing import shown
from streams.types.stamps import day_in_folders, hour_folder, stamp_in_name, utc_text

STATED, ANSWERED, ASSUMED, OPEN = "stated", "answered", "assumed", "open"
"""Where a reading comes from: the files, an answer, the default of a question; or it is still open."""


@dataclass(frozen=True)
class ColumnReading:
    """A column of the files as it is read.

    Attributes:
        name: of the channel, or of the row where it is left out.
        title, number: by which the file knows it.
        kind: "vibration", "speed", "load", "time", "tacho" or "other".
        taken: whether it becomes a channel.
        unit: in which its samples are read, None where that is open; ``origin`` says by what.
        written: the unit as the file spells it, "" where it states none.
        place: column and file.
        evidence: why it is no vibration, in words, or "".
        sensitivity_mv_per_g: answered of a column in V, None where it is open or needs none.
        rms: without the mean, ``peak`` and ``mean`` in the stored numbers times ``scale``.
        scale: from the stored numbers to ``unit``.
        rms_g, peak_g: None where the unit does not give them.
    """

    name: str
    title: str
    number: int
    kind: str
    taken: bool
    unit: str | None
    origin: str
    written: str
    place: str
    evidence: str
    sensitivity_mv_per_g: float | None
    rms: float
    peak: float
    mean: float
    scale: float
    rms_g: float | None
    peak_g: float | None


@dataclass(frozen=True)
class FactReading:
    """A fact of a recording as it is read.

    Attributes:
        key: as that of its question.
        words: what it is called.
        value: in words with its unit, None where it is open.
        origin: by what it is known.
        place: what states it, "" where an answer does.
    """

    key: str
    words: str
    value: str | None
    origin: str
    place: str = ""


def columns_of(desk: ImportDesk) -> tuple[ColumnReading, ...]:
    """Return the columns of the first file, those of other lengths last."""
    draft, vibration = desk.draft(), desk.seen.vibration
    names = dict(zip((row.column for row in vibration), channel_names(vibration), strict=True))

    def read(row: SurveyedRow) -> ColumnReading:
        taken = row.kind == "vibration"
        answers = desk.answers.of(row, desk.seen)
        unit = (unit_of(row, answers) or ("g" if answers.range_g else None)) if taken else row.unit
        stated = row.unit not in (None, "unknown")
        scale = (scale_of(row, draft) if taken else None) or 1.0
        level, in_g = row.level.times(scale), level_in_g(row, draft) if taken else None
        return ColumnReading(
            name=names.get(row.column, row.name) if taken else row.name,
            title=row.title,
            number=row.column,
            kind=row.kind,
            taken=taken,
            unit=unit,
            origin=STATED if stated or not taken else OPEN if unit is None else ANSWERED,
            written=row.written,
            place=f"column {row.column} of {shown(desk.seen.first)}",
            evidence=row.evidence,
            sensitivity_mv_per_g=answers.sensitivity_mv_per_g if unit == "V" and taken else None,
            rms=level.rms,
            peak=level.peak,
            mean=level.mean,
            scale=scale,
            rms_g=None if in_g is None else in_g.rms,
            peak_g=None if in_g is None else in_g.peak,
        )

    return tuple(read(row) for row in desk.seen.all_rows)


def facts_of(desk: ImportDesk) -> tuple[FactReading, ...]:
    """Return what holds of all columns: format, files, rate, dates, speed, load, bearings, pulses."""
    return tuple(_facts(desk))


def _facts(desk: ImportDesk) -> Iterator[FactReading]:
    seen, answers = desk.seen, desk.answers
    yield FactReading("format", "Format", seen.data_set.name, STATED, taken_words(seen) or shown(seen.first))
    ends = shown(seen.first) if seen.first == seen.last else f"{shown(seen.first)} to {shown(seen.last)}"
    if (several := len(seen.values.recordings)) > 1:
        ends += f", {several} recordings in {shown(seen.first)}"
    yield FactReading("files", "Files", str(len(seen.paths)), STATED, ends)
    if seen.ignored:
        yield FactReading(
            "ignored", "Left out", str(len(seen.ignored)), STATED, f"another format: {left_out_words(seen)}"
        )
    if seen.refused:
        more = f" and {len(seen.refused) - 3} more" if len(seen.refused) > 3 else ""
        yield FactReading(
            "refused", "Cannot be read", str(len(seen.refused)), STATED, "; ".join(seen.refused[:3]) + more
        )
    yield _rate(desk)
    yield _date(desk)
    yield _speed(desk)
    row = next((row for row in seen.all_rows if row.kind == "load"), None)
    if answers.load_newton is not None:
        yield FactReading("load_newton", "Radial load", f"{answers.load_newton:g} N", ANSWERED)
    elif row is not None and not answers.no_load:
        yield FactReading("load_newton", "Radial load", "of each block", STATED, f"column {shown(row.title)}")
    elif seen.load is not None and not answers.no_load:
        yield FactReading("load_newton", "Radial load", f"{seen.load:g} N", STATED, shown(seen.first))
    else:
        origin = OPEN if not answers.no_load else _given(desk, "load_newton")
        yield FactReading("load_newton", "Radial load", "unknown" if answers.no_load else None, origin)
    sections = bearing_sections(seen, answers)
    words = "; ".join(_bearing_words(name, one, several=len(sections) > 1) for name, one in sections.items())
    yield FactReading("bearing", "Bearing", words or None, ANSWERED if words else OPEN)
    tacho = tacho_of(seen, answers)
    if tacho is not None or seen.pulses is not None:
        count, place = answers.pulses_per_revolution, seen.pulses or (tacho.title if tacho else "")
        origin = OPEN if count is None else _given(desk, "pulses_per_revolution")
        value = None if count is None else f"{count} a revolution"
        yield FactReading("pulses_per_revolution", "Pulses of a tacho", value, origin, shown(place))


def taken_words(seen: Survey) -> str:
    """Return what is believed of files because a published data set has such names, "" for those of any origin."""
    if seen.data_set.plain:
        return ""
    facts = seen.data_set.facts(seen.first, str(seen.place), ZoneInfo("UTC"))
    words = [] if seen.data_set.unit in (None, "unknown") else [str(seen.data_set.unit)]
    if facts is not None:
        words += [] if facts.rate is None else [f"{facts.rate:g} Hz"]
        words += [] if facts.speed is None else [f"a shaft of {60.0 * facts.speed:.6g} rpm"]
        words += [] if facts.load is None else [f"{facts.load:.6g} N"]
    by = f"; {', '.join(words)} hold for the data set, no file states them" if words else ""
    return f"taken for {seen.data_set.name} by names and content ({seen.data_set.files}){by}; else give --format"


def left_out_words(seen: Survey) -> str:
    """Return the files of another format, at most three by name, with what was seen in them."""
    more = f" and {len(seen.ignored) - 3} more" if len(seen.ignored) > 3 else ""

    def named(name: str) -> str:
        found = seen_in(name, first_of(seen.place, name, HEAD_BYTES) if seen.is_folder else b"")
        return shown(name) if found is None else f"{shown(name)} ({found})"

    return ", ".join(map(named, seen.ignored[:3])) + more


def _given(desk: ImportDesk, key: str) -> str:
    return ASSUMED if key in desk.assumed else ANSWERED


def _bearing_words(name: str, bearing: AnsweredBearing, *, several: bool) -> str:
    words = bearing.designation or (
        f"{bearing.n_elements} elements of {bearing.element_diameter_mm:g} mm on {bearing.pitch_diameter_mm:g} mm"
    )
    return f"{name}: {words}" if several else words


def _rate(desk: ImportDesk) -> FactReading:
    seen, answered = desk.seen, desk.answers.rate_hz
    if seen.rate is not None:
        place = f"the times of {shown(seen.rate_from)}" if seen.rate_from else shown(seen.first)
        if seen.values.rate_written:
            place = f"{place}: {seen.values.rate_written}"
        return FactReading("rate_hz", "Sampling rate", f"{seen.rate:.8g} Hz", STATED, place)
    if answered is None:
        return FactReading("rate_hz", "Sampling rate", None, OPEN, seen.rate_words)
    return FactReading("rate_hz", "Sampling rate", f"{answered:.8g} Hz", _given(desk, "rate_hz"))


def _date(desk: ImportDesk) -> FactReading:
    start, words = desk.answers.start_utc, date_words(desk.seen, desk.timezone, desk.now)
    if start is None:
        known = not any(one.key in ("start_utc", "time_name", "date_order") for one in desk.questions())
        return FactReading("start_utc", "Dates", words if known else None, STATED if known else OPEN, "")
    said = {"mtime": "the last change of each file", "none": "none: times count from the first block"}
    value = said[start] if isinstance(start, str) else f"{utc_text(start.timestamp())}, the first file"
    return FactReading("start_utc", "Dates", value, _given(desk, "start_utc"))


def _speed(desk: ImportDesk) -> FactReading:
    seen, answers, row = desk.seen, desk.answers, speed_row(desk.seen)
    name = "Speed of the shaft"
    if answers.speed_hz is not None:
        value = f"{answers.speed_hz:.6g} Hz ({60 * answers.speed_hz:.7g} rpm)"
        return FactReading("speed_hz", name, value, _given(desk, "speed_hz"))
    if row is not None:
        return FactReading("speed_hz", name, "of each block", STATED, f"column {shown(row.title)}")
    tacho = tacho_of(seen, answers)
    if tacho is not None or seen.pulses is not None:
        return FactReading("speed_hz", name, "by the pulses", STATED, shown(seen.pulses or str(tacho and tacho.title)))
    if answers.estimate:
        return FactReading("speed_hz", name, "estimated of every block, 5 to 100 Hz", _given(desk, "speed_hz"))
    if seen.speed is not None and seen.speed_from == "stated by the files":
        return FactReading("speed_hz", name, f"{seen.speed:.6g} Hz", STATED, shown(seen.first))
    return FactReading("speed_hz", name, None, OPEN)


@dataclass(frozen=True)
class FileDate:
    """A file and the time of its first sample, s since 1970 UTC; None where it is not known."""

    file: str
    time: float | None


def dates_of(desk: ImportDesk, limit: int = 200) -> tuple[FileDate, ...]:
    """Return the dates of at most so many files, evenly chosen, the first and the last among them."""
    seen, answers = desk.seen, desk.answers
    pattern, order = desk.draft().time_name, answers.date_order
    count = len(seen.paths)
    places = sorted({round(at * (count - 1) / max(1, min(limit, count) - 1)) for at in range(min(limit, count))})
    ends = {seen.first: seen.starts[0], seen.last: seen.starts[1]}

    def found(at: int) -> float | None:
        path, start = seen.paths[at], answers.start_utc
        if isinstance(start, datetime):
            step = answers.interval_s or 0.0
            return start.astimezone(UTC).timestamp() + at * step if step or at == 0 else None
        if start == "mtime":
            return {seen.first: seen.changed[0], seen.last: seen.changed[1]}.get(path)
        if start == "none":
            return None
        if ends.get(path) is not None:
            return ends[path]
        full = seen.in_folders(path)
        stamp = None if seen.start is not None else stamp_in_name(full, desk.timezone, pattern)
        if stamp is None and seen.start is None and not seen.is_folder:
            stamp = day_in_folders(full, desk.timezone)
        return None if stamp is None else stamp.fixed if order is None else stamp.at(order)

    return tuple(FileDate(seen.paths[at], found(at)) for at in places)


def date_words(seen: Survey, timezone: str, now: float) -> str:
    """Return what dates the first file, in words; ``timezone`` of dates that name none, ``now`` s since 1970 UTC."""
    zone = f", {timezone} unless it states a zone"
    if not seen.data_set.plain:
        return f"as {seen.data_set.name} states it"
    if seen.start is not None:
        return f"{utc_text(seen.start)} in the header of {shown(seen.first)}{zone}"
    if seen.stamp is not None:
        return f"{seen.stamp!r} in the header of {shown(seen.first)}{zone}"
    stamp = stamp_in_name(seen.in_folders(seen.first), timezone)
    if stamp is not None:
        hour = hour_folder(stamp.text)
        taken = f", its folder {hour} taken for the hour" if hour else ""
        return f"{stamp.text!r} in the name of {shown(seen.first)}{taken}{zone}"
    readings = name_readings(seen, timezone, now)
    if readings:
        return f"{readings[0].pattern} in the names ({utc_text(readings[0].first)}){zone}"
    return "none in headers or names"
