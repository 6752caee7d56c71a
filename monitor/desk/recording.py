"""A description of a recording: how it is read, what is open, the configuration and what it shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from monitor.config.plausible.doubt import Doubt
from monitor.desk.description import ColumnReading, FactReading, FileDate, columns_of, dates_of, facts_of
from monitor.desk.desk import DeskError, DraftedConfig, ImportDesk, open_desk
from monitor.desk.preview import ChannelPreview, channels_of
from monitor.desk.questions import Question


@dataclass(frozen=True)
class RecordingPreview:
    """What a configuration makes of a recording.

    Attributes:
        channels: levels, fault lines and curves of each in the first file.
        ends: the first and the last file in words, as they are read.
        doubts: problems and warnings of ``check``, problems first.
    """

    channels: tuple[ChannelPreview, ...]
    ends: tuple[str, ...]
    doubts: tuple[Doubt, ...]


@dataclass(frozen=True)
class RecordingDescription:
    """How files are read by what they state, by answers, and by the defaults of questions.

    Attributes:
        columns: of the first file.
        facts: what holds of all columns.
        questions: that the files leave open; those with a default are answered by it.
    """

    columns: tuple[ColumnReading, ...]
    facts: tuple[FactReading, ...]
    questions: tuple[Question, ...]
    desk: ImportDesk = field(repr=False)

    @property
    def missing(self) -> tuple[Question, ...]:
        """The questions that need an answer before there is a configuration."""
        return tuple(question for question in self.questions if question.default is None)

    @property
    def dates(self) -> tuple[FileDate, ...]:
        """The dates of at most 200 files."""
        return dates_of(self.desk)

    @cached_property
    def _drafted(self) -> DraftedConfig:
        """The configuration; :class:`DeskError` where answers are missing."""
        if self.missing:
            listed = "; ".join(f"{question.key}: {question.words}. {question.why}" for question in self.missing)
            raise DeskError("", f"these answers are missing: {listed}")
        return self.desk.drafted()

    def configuration(self) -> str:
        """Return the configuration as TOML.

        Raises:
            DeskError: answers are missing; it names all of them.
            ConfigError: the configuration is not valid.
        """
        return self._drafted.text

    def preview(self) -> RecordingPreview:
        """Return what the configuration makes of the first file, and what ``check`` says; raises as configuration."""
        drafted = self._drafted
        ends = () if drafted.dating is None else drafted.dating.ends
        doubts = tuple(sorted(drafted.doubts, key=lambda doubt: doubt.severity))
        return RecordingPreview(channels_of(self.desk), ends, doubts)

    def save(self) -> Path:
        """Write the configuration to the file for which it was made, and return that.

        Raises:
            DeskError: there is a file already, or it cannot be written; and as configuration.
        """
        text, out = self.configuration(), self.desk.out
        try:
            with out.open("x", encoding="utf-8") as file:
                file.write(text)
        except FileExistsError:
            raise DeskError("out", f"{out.name} is there already; expected a new name") from None
        except OSError as error:
            raise DeskError("out", f"{out.name} cannot be written ({error.strerror or error})") from None
        return out


def describe(
    path: str,
    words: Mapping[str, object],
    *,
    out: Path,
    kind: str = "auto",
    timezone: str = "UTC",
    name: str | None = None,
) -> RecordingDescription:
    """Describe the files of a path; arguments and errors as :func:`monitor.desk.desk.open_desk`."""
    desk, questions = open_desk(path, words, out=out, kind=kind, timezone=timezone, name=name).with_defaults()
    found = RecordingDescription(columns_of(desk), facts_of(desk), tuple(questions), desk)
    if found.missing or desk.answers.date_order is not None:
        return found
    # Only reading several files shows that the order of day and month is open.
    problem = found._drafted.date_problem
    if "date_order" not in problem:
        return found
    desk, more = desk.with_defaults(problem)
    return RecordingDescription(columns_of(desk), facts_of(desk), (*questions, *more), desk)
