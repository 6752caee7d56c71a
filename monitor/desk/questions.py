"""Which questions a recording leaves open: what was found, why it is asked, what the answer may be."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from monitor.config.plausible.levels import doubts
from monitor.config.plausible.machine import MAX_USUAL_SPEED_HZ
from monitor.desk import answers as read
from monitor.desk.answers import Answers, channel_names, check_own, has_all_bearings, read_answer
from monitor.words.numbers import duration
from streams.dates.dating import NameReading, find_readings, nearest_change
from streams.dates.order import evidence, orders_left
from streams.files.columns import hertz_in
from streams.files.groups import NameGroups
from streams.files.survey import Survey, SurveyedRow
from streams.files.unlisted import offers_for
from streams.turns.tacho import is_called_tacho
from streams.types.listing import shown
from streams.types.samples import COUNTS, FRACTIONS
from streams.types.stamps import Stamp, stamp_in_name, utc_text

_DAY = 86400.0
_WHOLE = 0.15
"""Part of it by which the pulses of a revolution may be off a whole number: a nominal speed is not exact."""


@dataclass(frozen=True)
class Question:
    """A question that the files leave open.

    Attributes:
        option: of the command, which answers it too.
        words: the question.
        why: what was found, and what the answer is for.
        default: taken where nothing is answered, None where an answer is needed.
        read: returns fields of :class:`Answers`; ValueError where the words are no answer.
        proposed: by a value under a key of no table; shown, and never taken without an answer.
    """

    option: str
    words: str
    why: str
    default: str | None
    read: Callable[[str], dict[str, Any]]
    proposed: str | None = None

    @property
    def key(self) -> str:
        """Name of the answer in :data:`monitor.desk.answers.READERS`."""
        level = self.option == "--scale" or self.option.startswith("--range-g")
        return "full_scale" if level else self.option.removeprefix("--").replace("-", "_")


def no_vibration_words(survey: Survey) -> str:
    """Return why no column of the first file is taken for vibration."""
    found = "; ".join(f"{shown(row.title)} {row.evidence}" for row in survey.all_rows)
    return f"no row of {shown(survey.first)} is vibration: {found}"


def columns_question(survey: Survey) -> Question:
    """Return the question which columns are vibration, where none seems so."""
    words = "Columns of vibration"
    return Question("--columns", words, f"{no_vibration_words(survey)}.", None, read.read_columns)


_OFFERED: dict[str, tuple[str, Callable[[float], str]]] = {
    "rate_hz": ("rate", lambda rate: f"{rate:.10g} Hz"),
    "full_scale": ("scale", lambda count: f"{count:.6g} g"),
    "unit": ("unit", str),
    "sensitivity_mv_per_g": ("sensitivity", lambda level: f"{level:.6g} mV/g"),
    "start_utc": ("start", utc_text),
    "speed_hz": ("speed", lambda speed: f"{60.0 * speed:.6g} rpm"),
    "load_newton": ("load", lambda load: f"{load:.6g} N"),
}
"""By the key of a question: the fact of the unlisted values that may answer it, and how such an answer is written."""


def _with_offers(question: Question, survey: Survey) -> Question:
    """Return a question with what unlisted values would answer; proposed where all of them mean one answer."""
    fact, written = _OFFERED.get(question.key, ("", str))
    offers = offers_for(survey.values, fact) if fact else ()
    if not offers:
        return question
    meant = [set(map(written, one.readings)) or {one.text} for one in offers]
    common = set.intersection(*meant)
    listed = ", ".join(f"{one.place} {one.written!r}" for one in offers[:4])
    why = f"{question.why} {listed} in {shown(survey.first)} may state it: {' or '.join(sorted(set.union(*meant)))}."
    return replace(question, why=why, proposed=common.pop() if len(common) == 1 else None)


def open_questions(
    survey: Survey, answers: Answers, zone: str, now: float, last_problem: str = ""
) -> Iterator[Question]:
    """Yield the questions that answers leave open, each with what unlisted values would answer; arguments as below."""
    yield from (_with_offers(one, survey) for one in _questions(survey, answers, zone, now, last_problem))


def _questions(survey: Survey, answers: Answers, zone: str, now: float, last_problem: str) -> Iterator[Question]:
    """Yield the questions that answers leave open.

    Args:
        zone: IANA name of the zone of dates that name none.
        now: s since 1970 UTC; later dates in names are other numbers.
        last_problem: why the dates could not be told by the answers so far, "" where they could.
    """
    if survey.groups is not None:
        yield Question(
            "--files",
            "Are these recorded at the same time",
            f"The names fall into groups, {', '.join(survey.groups.patterns[:4])}: read together (a channel each), "
            "or in sequence (one after the other).",
            None,
            _files_reader(survey.groups),
        )
    if not has_all_bearings(survey, answers):
        yield _bearing_question(survey)
    if answers.rate_hz is None and survey.rate is None:
        hint = survey.rate_hint
        states, seen = survey.rate_words or "nothing states its rate", ""
        running = next((row for row in survey.rows if row.kind == "index"), None)
        if running is not None:
            seen = f"; {shown(running.title)} {running.evidence}"
        if hint is not None:
            seen = f"; {shown(hint[1])} is rounded too coarsely, and allows {hint[0]:.6g} Hz"
        yield Question(
            "--rate-hz",
            "Sampling rate",
            f"{survey.first} has {survey.samples[0]} samples in a row, and {states}{seen}.",
            None if hint is None else f"{hint[0]:.6g} Hz",
            read.read_rate,
        )
    yield from _level_questions(survey, answers)
    yield from _date_questions(survey, answers, zone, now, last_problem)
    if (tacho_of(survey, answers) is not None or survey.pulses is not None) and answers.pulses_per_revolution is None:
        yield _pulses_question(survey, answers)
    if answers.speed_hz is None and not answers.estimate and not _states_speed(survey, answers):
        stated = None if survey.speed is None else f"{survey.speed:.8g} Hz"
        found = "The fault frequencies are multiples of it." if stated is None else f"{stated} {survey.speed_from}."
        yield Question(
            "--speed-hz",
            "Speed of the shaft",
            f"{found} 29.5 Hz, 1770 rpm, or estimate: by the signal of each block, which is rejected if it does not "
            "show the shaft.",
            stated,
            read.read_speed,
        )
    row = speed_row(survey)
    if (
        answers.speed_hz is None
        and answers.speed_unit is None
        and row is not None
        and speed_factor(row, answers) is None
    ):
        yield Question(
            "--speed-unit",
            "Unit of the speed in the files",
            f"{shown(row.title)} states none, and its mean is {row.level.mean:.6g}: rpm or Hz.",
            None,
            read.read_speed_unit,
        )
    if answers.load_newton is None and not answers.no_load and survey.load is None and not _has(survey, "load"):
        yield Question(
            "--load-newton",
            "Radial load of the bearing",
            "Only the size of damage (V_eq) needs it. 400 N, 0.4 kN, or unknown.",
            "unknown",
            read.read_load,
        )


def _files_reader(groups: NameGroups) -> Callable[[str], dict[str, Any]]:
    """Return a reader of the answer how files are read."""

    def parse(text: str) -> dict[str, Any]:
        found = read.read_files(text)
        if found["files"] == "together" and not groups.is_exact:
            raise ValueError("their files do not pair: each group needs a [[source]] of its own")
        return found

    return parse


def _bearing_question(survey: Survey) -> Question:
    return Question(
        "--bearing",
        "Bearing",
        "Its geometry gives the fault frequencies. What is printed on its ring, such as 6205-2RS, or number of "
        f"elements, their diameter and pitch diameter in mm: 9 7.94 39.04.{_each(survey, '6206', '6205')}",
        None,
        _reader(survey, "bearing"),
    )


def _each(survey: Survey, *examples: str) -> str:
    """Return in words how channels are answered one by one, "" where there is one."""
    names = channel_names(survey.vibration)
    return f" One for all channels, or {names[0]}={examples[0]}; {names[-1]}={examples[-1]}." if len(names) > 1 else ""


def _reader(
    survey: Survey, key: str, check: Callable[[dict[str, Any]], None] = lambda found: None
) -> Callable[[str], dict[str, Any]]:
    """Return a reader of an answer for all channels or some of them; ``check`` raises ValueError for what is none."""

    def parse(text: str) -> dict[str, Any]:
        found = read_answer(key, text)
        own = found.get("own", ())
        check_own(survey, own)
        for fields in (found, *(one.fields for one in own)):
            check(dict(fields))
        return found

    return parse


def _pulses_question(survey: Survey, answers: Answers) -> Question:
    row, speed = tacho_of(survey, answers), answers.speed_hz or survey.speed
    found = None if row is None or survey.rate is None else row.tacho
    per_second = 0.0 if found is None else found.per_second
    likely = _whole_pulses(per_second / speed) if speed and per_second else 1
    remark = "" if likely else f", no whole number of those of a shaft of {speed:.4g} Hz"
    seen = f"{survey.pulses} has times of pulses"
    if row is not None:
        regular = f"has about {per_second:.4g} pulses a second" if per_second else "shows no regular pulses"
        seen = f"{shown(row.title)} {regular}{remark}"
    return Question(
        "--pulses-per-revolution",
        "Pulses a revolution of the tacho",
        f"{seen}. They give the angle and the speed of the shaft, where it varies too; missing teeth count.",
        str(likely) if likely else None,
        read.read_pulses,
    )


def _states_speed(survey: Survey, answers: Answers) -> bool:
    """Return whether every file states its speed, or has a row of it or of pulses."""
    marks = tacho_of(survey, answers) is not None or survey.pulses is not None
    by_files = survey.speed is not None and survey.speed_from == "stated by the files"
    return _has(survey, "speed") or marks or by_files


def tacho_of(survey: Survey, answers: Answers) -> SurveyedRow | None:
    """Return the row of the tacho of the shaft, None where there is none.

    A row that only its regular pulses make one, of which there is no whole number a revolution, is a switch.
    """
    row, speed = survey.tacho, answers.speed_hz or survey.speed
    if row is None or row.tacho is None or is_called_tacho(f"{row.title} {row.written}"):
        return row
    return None if speed and survey.rate and not _whole_pulses(row.tacho.per_second / speed) else row


def _whole_pulses(pulses: float) -> int:
    """Return the whole number of pulses a revolution, 0 where these are near none."""
    count = round(pulses)
    return count if abs(pulses - count) <= _WHOLE * count else 0


def speed_row(survey: Survey) -> SurveyedRow | None:
    """Return the only row of the speed, or None."""
    rows = [row for row in survey.all_rows if row.kind == "speed"]
    return rows[0] if len(rows) == 1 else None


def speed_factor(row: SurveyedRow, answers: Answers) -> float | None:
    """Return the Hz in one of a row of the speed, by its unit, the answer, or its size alone; None where it is open."""
    stated = hertz_in(row.title, row.written)
    if stated is None and answers.speed_unit is not None:
        return {"rpm": 1.0 / 60.0, "Hz": 1.0}[answers.speed_unit]
    return 1.0 / 60.0 if stated is None and abs(row.level.mean) > MAX_USUAL_SPEED_HZ else stated


def _has(survey: Survey, kind: str) -> bool:
    return sum(row.kind == kind for row in survey.all_rows) == 1


def unit_of(row: SurveyedRow, answers: Answers) -> str | None:
    """Return the unit of a row as stated or answered, None where neither says."""
    return row.unit if row.unit not in (None, "unknown") else answers.unit or row.unit


def needs_scale(row: SurveyedRow, survey: Survey) -> bool:
    """Return whether a row holds integers whose level nothing states."""
    return row.stored in (COUNTS, FRACTIONS) and not survey.scaled


def _level_questions(survey: Survey, answers: Answers) -> Iterator[Question]:
    both = [(row, answers.of(row, survey)) for row in survey.vibration]
    integers = [
        row
        for row, own in both
        if needs_scale(row, survey) and own.scale is None and own.range_g is None and own.unit != "unknown"
    ]
    if integers:
        meant = "full scale" if integers[0].stored == FRACTIONS else "one count"
        yield Question(
            "--range-g, or --unit V --scale VOLTS --sensitivity-mv-per-g"
            if integers[0].stored == FRACTIONS
            else "--scale",
            f"Level of {meant}",
            f"{_names(integers)} holds integers, and nothing states what {meant} is: 50 g, or 10 V at 100 mV/g, or "
            f"unknown for naming and relative trends only.{_each(survey, '50 g', '10 V at 100 mV/g')}",
            None,
            _reader(survey, "full_scale", _unit_check(integers[0].unit)),
        )
        return
    bare = [row for row, own in both if unit_of(row, own) is None and own.range_g is None]
    if bare:
        words = f"{_unit_words(bare)}{_each(survey, 'mV', 'g')}"
        yield Question("--unit", "Unit of the vibration", words, None, _reader(survey, "unit"))
    volts = [row for row, own in both if unit_of(row, own) == "V" and own.sensitivity_mv_per_g is None]
    if volts:
        yield Question(
            "--sensitivity-mv-per-g",
            "Sensitivity of the sensor",
            f"{_names(volts)} is in V, with an RMS of {1e3 * volts[0].level.rms:.3g} mV: 100 mV/g, 10.2 mV/(m/s2)."
            f"{_each(survey, '100', '10.2 mV/(m/s2)')}",
            None,
            _reader(survey, "sensitivity_mv_per_g"),
        )


def _unit_check(unit: str | None) -> Callable[[dict[str, Any]], None]:
    """Return a check that levels are in the unit that the file states, if it states one."""

    def check(found: dict[str, Any]) -> None:
        if unit is not None and found.get("unit", unit) not in (unit, "unknown"):
            raise ValueError(f"the file states {unit}, got {found['unit']}")

    return check


def _names(rows: Sequence[SurveyedRow]) -> str:
    return ", ".join(row.title for row in rows[:4]) + (f" and {len(rows) - 4} more" if len(rows) > 4 else "")


def _unit_words(rows: Sequence[SurveyedRow]) -> str:
    """Return the levels of rows without a unit, and what each unit would make of them."""
    row = rows[0]
    level = row.level
    text = (
        f"{_names(rows)}: no unit is stated; {row.title} has an RMS of {level.rms:.3g} and a mean of {level.mean:.3g}."
    )
    unlikely = [
        f"{unit}: {found[0].came.partition(': ')[0]}." for unit in ("g", "m/s2") if (found := doubts(level, unit))
    ]
    return " ".join([text, *(f"If {words}" for words in unlikely), "Answer g, m/s2, mm/s, mV, V, or unknown."])


def name_readings(survey: Survey, zone: str, now: float) -> list[NameReading]:
    """Return the ways to read a date in all names where none of the usual ones is there."""
    if not survey.data_set.plain or survey.start is not None or survey.stamp is not None:
        return []
    paths = [survey.in_folders(path) for path in survey.paths]
    if all(stamp_in_name(path, zone) is not None for path in paths[:50]):
        return []
    return nearest_change(find_readings(paths, zone, now + _DAY), survey.changed[0])


def _date_questions(survey: Survey, answers: Answers, zone: str, now: float, last_problem: str) -> Iterator[Question]:
    if not survey.data_set.plain or survey.start is not None or answers.start_utc is not None:
        return
    if "date_order" in last_problem and answers.date_order is None:
        yield _order_question(survey, zone)
        return
    if survey.stamp is not None or answers.time_name is not None:
        return
    stamps = [stamp_in_name(survey.in_folders(path), zone) for path in survey.paths[:50]]
    if all(stamp is not None for stamp in stamps):
        named = ((path, stamp) for path, stamp in zip(survey.paths, stamps, strict=False) if stamp is not None)
        left, _ = orders_left(evidence(named, now))
        is_open = any(stamp is not None and stamp.fixed is None for stamp in stamps)
        if is_open and len(left) > 1 and answers.date_order is None:
            yield _order_question(survey, zone)
        return
    readings = name_readings(survey, zone, now)
    if len(readings) > 1:
        yield _reading_question(survey, readings)
    elif not readings:
        yield _start_question(survey)


def _order_question(survey: Survey, zone: str) -> Question:
    stamp: Stamp | None = None
    if survey.stamp is not None:
        from streams.types.stamps import read_stamp

        stamp = read_stamp(survey.stamp, zone)
    else:
        stamp = stamp_in_name(survey.in_folders(survey.first), zone)
    text, ways = ("the dates", "") if stamp is None else (f"{stamp.text!r}", f": {stamp.ways}")
    return Question(
        "--date-order",
        "Order of day, month and year",
        f"{text} of {survey.first} can be read in several ways, and no file decides{ways}.",
        None,
        read.read_order,
    )


def _reading_question(survey: Survey, readings: Sequence[NameReading]) -> Question:
    ways = "; ".join(f"{reading.pattern} is {utc_text(reading.first)}" for reading in readings[:6])
    return Question(
        "--time-name",
        "Pattern of the dates in names",
        f"{survey.paths[0]} can be read in several ways: {ways}.",
        None,
        read.read_pattern,
    )


def _start_question(survey: Survey) -> Question:
    changed = survey.changed[0]
    was = "" if changed is None else f" (it was last changed at {utc_text(changed)})"
    return Question(
        "--start-utc",
        "Start of the first file",
        f"Neither headers nor names state a date. 2026-01-31T08:00:00Z; mtime: the times of the last change date all "
        f"files, {survey.first}{was}; none: times count from the first block.",
        "none",
        read.read_start,
    )


def needs_interval(survey: Survey, answers: Answers) -> bool:
    """Return whether files are counted, so that the time between them has to be told."""
    return answers.start_utc not in (None, "mtime", "none") and len(survey.paths) > 1 and answers.interval_s is None


def interval_question(survey: Survey, rate: float) -> Question:
    """Return the question for the time between the starts of counted files; the times of change give a default."""
    length = survey.seconds(rate)[0]
    begin, end = survey.changed
    usual = 0.0 if begin is None or end is None else (end - begin) / (len(survey.paths) - 1)
    return Question(
        "--interval-s",
        "Time between the starts of files",
        f"Files are counted from the start; one is {duration(length)} long.",
        f"{usual if usual > 1.01 * length else length:.6g} s",
        read.read_interval,
    )


def period_of(survey: Survey, answers: Answers, pattern: str | None, zone: str) -> float | None:
    """Return the mean time between the starts of files by headers, names or answers, s; None where it is not known."""
    if answers.interval_s is not None:
        return answers.interval_s
    begin, end = survey.starts
    if begin is None or end is None:
        ends = [survey.in_folders(path) for path in (survey.paths[0], survey.paths[-1])]
        stamps = [stamp_in_name(path, zone, pattern) for path in ends]
        begin, end = (None if stamp is None else stamp.day_first for stamp in stamps)
    if begin is None or end is None or end <= begin or len(survey.paths) < 2:
        return None
    return (end - begin) / (len(survey.paths) - 1)
