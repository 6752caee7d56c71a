"""From what files state and what was answered to a configuration, and what ``check`` says of it; nothing is written."""

from __future__ import annotations

import math
import re
import time
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from models.machine.bearing import kinematics
from models.words.errors import WrongInputError
from monitor.config.fields import NAME_PATTERN, plain_name
from monitor.config.load import Config, validate
from monitor.config.plausible.doubt import Doubt
from monitor.config.positions import find_lines
from monitor.desk.answers import READERS, Answers, OwnAnswer, bearing_of, channel_names, check_own, read_answer
from monitor.desk.judge.dating import DatingPreview, preview_dating
from monitor.desk.questions import (
    Question,
    columns_question,
    interval_question,
    name_readings,
    needs_interval,
    open_questions,
    period_of,
)
from monitor.desk.text import Draft, configuration_text, machine_name
from streams.files.survey import Survey, SurveyedRow, survey
from streams.types.listing import shown
from streams.types.samples import RATE_TOLERANCE, ReaderError
from streams.types.spec import SourceError


class DeskError(WrongInputError):
    """Files cannot be read, or an answer is none or contradicts them; ``key`` names the answer, "" for the files."""

    def __init__(self, key: str, sentence: str) -> None:
        """Keep the key beside the message, which begins with it."""
        super().__init__(f"{key}: {sentence}" if key else sentence)
        self.key, self.sentence = key, sentence


@dataclass(frozen=True)
class DraftedConfig:
    """A configuration, and what is doubtful in it and in the files.

    Attributes:
        text: as it is written.
        dating: what dates the blocks, None where the folder has no file any more.
    """

    text: str
    config: Config
    dating: DatingPreview | None
    doubts: tuple[Doubt, ...]

    @property
    def date_problem(self) -> str:
        """Why the dates of files cannot be told, "" where they can."""
        found = () if self.dating is None else self.dating.doubts
        return "; ".join(doubt.came for doubt in found if doubt.rule == "dating")


@dataclass(frozen=True)
class ImportDesk:
    """Files, the answers so far and the place of the configuration.

    Attributes:
        machine: name of the machine.
        out: where the configuration will stand; its paths are relative to that.
        timezone: IANA name of the zone of dates that name none.
        now: s since 1970 UTC; later dates in names are other numbers.
        assumed: keys that were answered by their defaults.
    """

    seen: Survey
    answers: Answers
    machine: str
    out: Path
    timezone: str = "UTC"
    now: float = field(default_factory=time.time)
    assumed: tuple[str, ...] = ()

    def answered(self, found: Mapping[str, Any]) -> ImportDesk:
        """Return the desk after fields of :class:`Answers` were found; files in groups are read again."""
        answers = self.answers.answered(found)
        groups, seen = self.seen.groups, self.seen
        if groups is not None and answers.files is not None:
            patterns = groups.patterns if answers.files == "together" else ("*",)
            seen = survey(str(seen.place), seen.data_set.name, self.timezone, patterns)
        return replace(self, answers=answers, seen=with_columns(seen, answers.columns))

    def questions(self, last_problem: str = "") -> Iterator[Question]:
        """Yield the questions that are open; ``last_problem`` is why dates could not be told by the answers so far."""
        if not self.seen.vibration:
            yield columns_question(self.seen)
            return
        yield from open_questions(self.seen, self.answers, self.timezone, self.now, last_problem)
        rate = self.seen.rate or self.answers.rate_hz
        if rate is not None and needs_interval(self.seen, self.answers):
            yield interval_question(self.seen, rate)

    def with_defaults(self, last_problem: str = "") -> tuple[ImportDesk, list[Question]]:
        """Return the desk with each question answered by its default, and all questions, those without one open."""
        desk, asked = self, dict[str, Question]()
        while (found := next((one for one in desk.questions(last_problem) if one.key not in asked), None)) is not None:
            asked[found.key] = found
            if found.default is not None:
                desk = replace(desk.answered(found.read(found.default)), assumed=(*desk.assumed, found.key))
        return desk, [*asked.values()]

    def draft(self) -> Draft:
        """Return what the configuration is written of."""
        answers, seen, pattern = self.answers, self.seen, self.answers.time_name
        if pattern is None and answers.start_utc is None:
            readings = name_readings(seen, self.timezone, self.now)
            pattern = readings[0].pattern if len(readings) == 1 else None
        rate = answers.rate_hz or seen.rate or 1.0
        draft = Draft(seen, answers, self.machine, self.out, rate, self.timezone, pattern)
        period = period_of(seen, answers, pattern, self.timezone)
        return replace(draft, bands=tuple(_proposed_bands(draft)), period=period)

    def drafted(self) -> DraftedConfig:
        """Return the configuration, all needed answers given, with what `check` sees in the files.

        Raises:
            ConfigError: the configuration is not valid.
        """
        text = configuration_text(self.draft())
        config = validate(tomllib.loads(text), self.out, find_lines(text))
        dating = preview_dating(config, config.source[0])
        return DraftedConfig(text, config, dating, tuple(self._doubts(config, dating)))

    def _doubts(self, config: Config, dating: DatingPreview | None) -> Iterator[Doubt]:
        """Yield what `check` will doubt, but that a recording is one."""
        from monitor.desk.judge.problems import find_problems

        known = dating is not None and dating.file is not None
        facts = {config.source[0].name: dating.facts} if known and dating is not None else {}
        found = [*find_problems(config, facts), *(() if dating is None else dating.doubts)]
        yield from (doubt for doubt in found if self.seen.is_folder or doubt.rule != "place")


def open_desk(
    path: str,
    words: Mapping[str, object],
    *,
    out: Path,
    kind: str = "auto",
    timezone: str = "UTC",
    name: str | None = None,
) -> ImportDesk:
    """Look at the files of a path, and take the answers that are given in words.

    Args:
        path: a file, a folder or an archive.
        words: answers by the keys of ``READERS``: words, numbers, for ``columns`` a list of titles.
        out: where the configuration will stand.
        kind: format or data set; "auto": recognised.
        timezone: IANA name of the zone of dates that name none.
        name: of the machine; None: by the folder.

    Raises:
        DeskError: nothing there can be read, or an answer is none or contradicts the files.
    """
    if name is not None and re.fullmatch(NAME_PATTERN, name) is None:
        raise DeskError(
            "name", f"expected up to 64 letters, digits, _ . and -, not first of them - . or _; got {name!r}"
        )
    answers = answers_of(words)
    seen = look(path, kind, timezone)
    desk = ImportDesk(seen, Answers(), name or machine_name(seen.place.resolve()), out, timezone)
    desk = desk.answered(answers)
    check_answers(desk.seen, desk.answers)
    return desk


def look(path: str, kind: str = "auto", timezone: str = "UTC") -> Survey:
    """Return what the files of a path state; arguments as :func:`streams.files.survey.survey`.

    Raises:
        DeskError: there is no such path, nothing in it is recognised, or no file that was tried can be read.
    """
    try:
        return survey(path, kind, timezone)
    except ReaderError as error:
        raise DeskError("", f"{shown(path)}: {error}") from None
    except SourceError as error:
        sentence = str(error).replace("[[source]] survey: url: ", "").replace("[[source]] survey: ", "")
        raise DeskError("", sentence) from None


def answers_of(words: Mapping[str, object]) -> dict[str, Any]:
    """Return the fields of :class:`Answers` that words or numbers stand for; blank words are no answer.

    Raises:
        DeskError: a key or an answer is none; all readers say what they expect.
    """
    found: dict[str, Any] = {}
    own: tuple[OwnAnswer, ...] = ()
    for key, value in words.items():
        if key not in READERS:
            raise DeskError(key, f"is no question; expected one of {', '.join(READERS)}")
        if isinstance(value, list | tuple) and key == "columns" and all(isinstance(name, str) for name in value):
            found |= {"columns": tuple(value)} if value else {}
            continue
        if isinstance(value, bool) or not isinstance(value, str | int | float | datetime | Mapping):
            raise DeskError(key, f"expected words or a number; got {value!r}")
        text = value.isoformat() if isinstance(value, datetime) else value if isinstance(value, Mapping) else str(value)
        if not text or (isinstance(text, str) and not text.strip()):
            continue
        try:
            read = read_answer(key, text)
        except ValueError as error:
            raise DeskError(key, str(error)) from None
        found |= read
        own += read.get("own", ())
    return {**found, "own": own}


def check_answers(seen: Survey, answers: Answers) -> None:
    """Compare answers with what the files hold and state.

    Raises:
        DeskError: there is no such channel, or they differ; an answer is for what the files leave open.
    """
    for one in answers.own:
        try:
            check_own(seen, [one])
        except ValueError as error:
            raise DeskError(one.key, str(error)) from None
    rate = answers.rate_hz
    if rate is not None and seen.rate is not None and not math.isclose(rate, seen.rate, rel_tol=RATE_TOLERANCE):
        where = seen.first if seen.rate_from is None else f"the times of {shown(seen.rate_from)} in {seen.first}"
        raise DeskError(
            "rate_hz",
            f"{rate:g} Hz is answered, {shown(where)} states {seen.rate:.8g} Hz; expected no answer, or the same. "
            "Keys of a file that are not to be believed are named by [[source]] disregard",
        )
    stated = [row for row in seen.vibration if row.unit not in (None, "unknown")]
    for row in stated:
        unit = answers.of(row, seen).unit
        # An answer for all channels is that of those that state none.
        is_other = unit == answers.unit and len(stated) < len(seen.vibration)
        if unit not in (None, "unknown", row.unit) and not is_other:
            raise DeskError(
                "unit",
                f"{unit} is answered, column {shown(row.title)} of {shown(seen.first)} states "
                f"{shown(row.written)}; expected no answer, or the same",
            )


def with_columns(seen: Survey, columns: Sequence[str] | None) -> Survey:
    """Return a survey in which the columns of these titles or names, else numbers, are vibration, and no others.

    Raises:
        DeskError: there is no such column.
    """
    if columns is None:
        return seen
    taken = {column for name in columns for column in _columns_called(seen, name)}

    def as_chosen(row: SurveyedRow) -> SurveyedRow:
        if row.column in taken:
            return replace(row, kind="vibration", tacho=None, evidence="")
        return replace(row, kind="other", evidence="is not chosen") if row.kind == "vibration" else row

    return replace(seen, rows=tuple(as_chosen(row) for row in seen.rows))


def _columns_called(seen: Survey, name: str) -> list[int]:
    word = name.strip().lower()
    found = [
        row.column for row in seen.rows if word in (row.title.lower(), row.name.lower(), plain_name(row.name).lower())
    ]
    found = found or [row.column for row in seen.rows if word == str(row.column)]
    if not found:
        known = ", ".join(shown(row.title) for row in seen.rows)
        raise DeskError("columns", f"{name!r} is no column of {shown(seen.first)}; expected some of {known}")
    return found


def _proposed_bands(draft: Draft) -> Iterator[tuple[str, tuple[float, float]]]:
    """Yield the band that the first file alone shows for each channel, where it is long enough to tell."""
    from monitor.health.signal.bands import find_band
    from monitor.health.signal.settings import fundamentals

    speed = draft.answers.speed_hz or draft.survey.speed
    if speed is None:
        return
    rows = draft.survey.vibration
    for row, name in zip(rows, channel_names(rows), strict=True):
        bearing = bearing_of(draft.survey, row, name, draft.answers)[1]
        if bearing is None:
            continue
        lines = fundamentals(kinematics(bearing.geometry(), speed))
        try:
            low, high = find_band([draft.survey.values.values[draft.survey.rows.index(row)]], draft.rate, lines)
        except ValueError:
            continue
        yield name, (low, high)
