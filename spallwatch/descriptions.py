"""How a recording is read, before it is monitored."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from os import PathLike, fspath
from pathlib import Path
from typing import Literal, TypedDict, Unpack

from monitor.desk.recording import RecordingDescription
from monitor.desk.recording import describe as described
from streams.types.stamps import Order


class DeskAnswers(TypedDict, total=False):
    """Answers to what files leave open: words or numbers, as the options of ``spallwatch init``.

    Attributes:
        bearing: "6205-2RS", a geometry such as "9 7.94 39.04", or by channel "DE=6205; NDE=6203". So may be unit,
            sensitivity, full scale and scale; or {"DE": "mV", "NDE": "g"}, that of all other channels under "".
        speed_hz: 29.5, "1770 rpm" or "estimate".
        speed_unit: "rpm" or "Hz", of a column of the speed that states none.
        load_newton: 400, "0.4 kN" or "unknown".
        rate_hz: sampling rate.
        unit: of the vibration: "g", "m/s2", "mV", "V" or "unknown".
        sensitivity_mv_per_g: 100 or "10.2 mV/(m/s2)".
        full_scale: of integers: "50 g", "10 V at 100 mV/g".
        scale: factor from the stored numbers to the unit.
        range_g: g at full scale.
        start_utc: of the first file; "mtime"; "none".
        interval_s: from the start of a file to that of the next, where they are counted.
        time_name: strptime pattern of dates in names.
        date_order: of day, month and year.
        pulses_per_revolution: of a tacho.
        files: how files are read whose names fall into groups.
        columns: titles of those that are vibration; by default those that seem so.
        format: format or data set, where it is not recognised.
        timezone: IANA name of the zone of dates that state none.
        name: of the machine, by default that of the folder.
    """

    bearing: str | Mapping[str, str]
    speed_hz: float | str
    speed_unit: Literal["rpm", "Hz"]
    load_newton: float | str
    rate_hz: float | str
    unit: str | Mapping[str, str]
    sensitivity_mv_per_g: float | str | Mapping[str, float | str]
    full_scale: str | Mapping[str, str]
    scale: float | str | Mapping[str, float | str]
    range_g: float | str
    start_utc: datetime | str
    interval_s: float | str
    time_name: str
    date_order: Order
    pulses_per_revolution: int | str
    files: Literal["together", "sequence"]
    columns: Sequence[str]
    format: str
    timezone: str
    name: str


def describe(
    path: str | PathLike[str],
    *,
    out: str | PathLike[str] = "config.toml",
    **answers: Unpack[DeskAnswers],
) -> RecordingDescription:
    """Describe how a recording is read: columns, facts and their evidence, and the questions that they leave open.

    ``configuration()`` is what ``spallwatch init`` and the page write, ``preview()`` shows levels, fault lines and what
    ``check`` says. Nothing is written, but by ``save()``.

    Args:
        path: a file, a folder into which a logger writes, or an archive.
        out: where the configuration will stand; its paths are relative to that.
        answers: see ``DeskAnswers``.

    Raises:
        DeskError: nothing there can be read, or an answer is none or contradicts the files; ``key`` names it.
        TypeError: there is no such answer.
    """
    wrong = sorted(set(answers) - set(DeskAnswers.__annotations__))
    if wrong:
        raise TypeError(f"{wrong[0]!r} is no answer; expected one of {', '.join(DeskAnswers.__annotations__)}")
    kind, timezone, name = answers.get("format", "auto"), answers.get("timezone", "UTC"), answers.get("name")
    words = {key: value for key, value in answers.items() if key not in ("format", "timezone", "name")}
    return described(fspath(path), words, out=Path(out), kind=kind, timezone=timezone, name=name)
