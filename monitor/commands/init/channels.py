"""Names of the channels that ``init`` configures, and the bearing of each."""

from __future__ import annotations

from collections.abc import Sequence

from monitor.commands.init.answers import AnsweredBearing, Answers
from monitor.config.fields import plain_name
from streams.files.survey import Survey, SurveyedRow

_BEARING = "bearing"


def channel_names(rows: Sequence[SurveyedRow]) -> list[str]:
    """Return a name for each row that the configuration takes, all different."""
    names: list[str] = []
    for row in rows:
        title = "sensor" if len(rows) == 1 and row.name == f"column_{row.column}" else row.name
        name = plain_name(title) or f"channel_{row.column}"
        names.append(name if name not in names else f"{name}_{row.column}")
    return names


def bearing_of(row: SurveyedRow, name: str, answers: Answers) -> tuple[str, AnsweredBearing | None]:
    """Return the bearing of a channel, and the name of its section; None where it was not answered."""
    for asked, bearing in answers.bearings:
        if asked.lower() in _spellings(row, name):
            return name, bearing
    return _BEARING, answers.bearing


def bearing_sections(survey: Survey, answers: Answers) -> dict[str, AnsweredBearing]:
    """Return the bearings of all channels by the names of their sections."""
    rows = survey.vibration
    found = (bearing_of(row, name, answers) for row, name in zip(rows, channel_names(rows), strict=True))
    return {name: bearing for name, bearing in found if bearing is not None}


def has_all_bearings(survey: Survey, answers: Answers) -> bool:
    """Return whether every channel has a bearing."""
    rows = survey.vibration
    return all(
        bearing_of(row, name, answers)[1] is not None for row, name in zip(rows, channel_names(rows), strict=True)
    )


def check_bearings(survey: Survey, bearings: Sequence[tuple[str, AnsweredBearing]]) -> None:
    """Raise ValueError where a bearing is that of no channel."""
    rows = survey.vibration
    known = {word for row, name in zip(rows, channel_names(rows), strict=True) for word in _spellings(row, name)}
    for asked, _ in bearings:
        if asked.lower() not in known:
            raise ValueError(f"{asked!r} is no channel; expected one of {', '.join(channel_names(rows))}")


def _spellings(row: SurveyedRow, name: str) -> set[str]:
    return {name.lower(), row.name.lower(), row.title.lower()}
