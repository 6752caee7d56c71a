"""The configuration that ``init`` writes: TOML with comments."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from monitor.desk.answers import Answers, bearing_of, bearing_sections, channel_names
from monitor.desk.questions import needs_scale, speed_factor, speed_row, tacho_of, unit_of
from monitor.health.onset.state import DetectSettings
from monitor.health.signal.differentiate import USUAL_LIMIT
from streams.files.plausible import SignalLevel, of_one_g
from streams.files.recognise import FORMATS, as_pattern
from streams.files.survey import Survey, SurveyedRow
from streams.types.block import VELOCITY
from streams.types.listing import shown, unpacked_name
from streams.types.samples import COUNTS, FRACTIONS

_MAX_WHOLE_S = 30.0
"""Length of a file, s, up to which it is one block."""
_MAX_LEARNING_S, _MIN_LEARN_BLOCKS = 14 * 86400.0, 20
"""Time for which a baseline is learned by default, s, and the blocks that it needs in any case."""
_COLUMN = 44
_SOURCE = "logger"


@dataclass(frozen=True)
class Draft:
    """What a configuration is written of.

    Attributes:
        bands: proposed band of each channel by name, Hz.
        time_name: pattern of the dates in names, answered or the only one that reads them.
        timezone: of dates that name none.
        period: time between the starts of files, s, None where it is not known.
    """

    survey: Survey
    answers: Answers
    machine: str
    out: Path
    rate: float
    timezone: str = "UTC"
    time_name: str | None = None
    bands: tuple[tuple[str, tuple[float, float]], ...] = ()
    period: float | None = None


def machine_name(place: Path) -> str:
    """Return a name for the machine by its folder or file."""
    text = place.name.split(".")[0] if place.is_file() else place.name
    cleaned = re.sub(r"[^A-Za-z0-9_-]+", "_", text).strip("_-")
    return cleaned[:64] or "machine"


def level_in_g(row: SurveyedRow, draft: Draft) -> SignalLevel | None:
    """Return the level of a row in g, None where its unit does not give it."""
    answers = draft.answers.of(row, draft.survey)
    unit = unit_of(row, answers)
    if needs_scale(row, draft.survey) and answers.range_g is not None and answers.scale is None:
        return row.level.times(answers.range_g)
    one_g = None if unit is None else of_one_g(unit, answers.sensitivity_mv_per_g)
    return None if one_g is None else row.level.times((scale_of(row, draft) or 1.0) / one_g)


def scale_of(row: SurveyedRow, draft: Draft) -> float | None:
    """Return the scale of a channel, None where it needs none."""
    needed = needs_scale(row, draft.survey) or row.unit is None
    return draft.answers.of(row, draft.survey).scale if needed else None


def configuration_text(draft: Draft) -> str:
    """Return the whole configuration."""
    return "\n".join(
        [
            *_head(draft),
            *_machine(draft),
            *_bearings(draft),
            *_operating(draft),
            *_source(draft),
            *_channels(draft),
            *_further(draft),
            "",
        ]
    )


def _pair(key: str, value: object, comment: str = "", *, off: bool = False) -> str:
    """Return a line of a key, commented out where it is ``off``."""
    if isinstance(value, str | bool | list):
        # JSON leaves the one control character as it is that TOML does not allow.
        written = json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    else:
        written = f"{value:.10g}"
    line = f"{'# ' if off else ''}{key} = {written}"
    return f"{line:<{_COLUMN}} # {shown(comment)}" if comment else line


def _relative(path: Path, base: Path) -> str:
    """Return a path from the folder of the configuration where that is near, with "/"."""
    try:
        near = Path(os.path.relpath(path, base))
    except ValueError:
        # Another drive.
        return path.as_posix()
    return path.as_posix() if near.parts[:3] == ("..",) * 3 else near.as_posix()


def _head(draft: Draft) -> Iterator[str]:
    place = shown(_relative(draft.survey.place.resolve(), draft.out.resolve().parent))
    yield f"# Written by spallwatch init of {place}."
    yield f"# Look at it:  spallwatch check --config {draft.out.name}"
    yield f"# Start it:    spallwatch {'run' if draft.survey.is_folder else 'replay'} --config {draft.out.name}"


def _machine(draft: Draft) -> Iterator[str]:
    base, place = draft.out.resolve().parent, draft.survey.place.resolve()
    inside = draft.survey.is_folder and (base == place or place in base.parents)
    folder = f".{draft.machine}" if inside else f"{draft.machine}-monitor"
    yield from ("", "[machine]", _pair("name", draft.machine))
    hidden = " (the dot keeps it out of the watched folder)" if inside else ""
    yield _pair("state_dir", f"{folder}/state", f"store of the daemon{hidden}")
    yield _pair("records_dir", f"{folder}/records", "published records, one netCDF file a day")
    yield _pair("timezone", draft.timezone, "of dates in files and names that state no zone")


def _bearings(draft: Draft) -> Iterator[str]:
    for name, bearing in bearing_sections(draft.survey, draft.answers).items():
        yield from ("", "[[bearing]]", _pair("name", name))
        if bearing.designation is not None:
            yield _pair("designation", bearing.designation)
            continue
        yield _pair("n_elements", bearing.n_elements)
        yield _pair("element_diameter_mm", bearing.element_diameter_mm)
        yield _pair("pitch_diameter_mm", bearing.pitch_diameter_mm)
        yield _pair("contact_angle_deg", bearing.contact_angle_deg)


def _operating(draft: Draft) -> Iterator[str]:
    answers, survey = draft.answers, draft.survey
    yield from ("", "[operating]")
    row, tacho = speed_row(survey), tacho_of(survey, answers)
    if answers.speed_hz is not None:
        yield _pair("speed_hz", answers.speed_hz, f"{60 * answers.speed_hz:.4g} rpm")
    elif row is not None:
        yield _pair("speed_channel", row.title, "the files record the speed")
        if speed_factor(row, answers) != 1.0:
            yield _pair("speed_channel_scale", 1 / 60, "from rpm to Hz")
    elif survey.speed is not None and not answers.estimate:
        yield _pair("speed_hz", survey.speed, f"{survey.speed_from}; a speed in a file takes precedence")
    elif tacho is None and survey.pulses is None:
        yield _pair("speed", "estimate", "of every block, from 5 to 100 Hz; speed_range_hz narrows it")
    if tacho is not None:
        yield _pair("tacho_channel", tacho.title, "pulses of the shaft: its angle and speed")
    if tacho is not None or survey.pulses is not None:
        yield _pair("pulses_per_revolution", answers.pulses_per_revolution or 1)
    row = next((row for row in survey.all_rows if row.kind == "load"), None)
    if answers.load_newton is not None:
        yield _pair("load_newton", answers.load_newton, "radial")
    elif row is not None and not answers.no_load:
        yield _pair("load_channel", row.title, "the files record the load")
        if "kn" in f"{row.title} {row.written}".lower():
            yield _pair("load_channel_scale", 1000, "from kN to N")
    elif survey.load is not None and not answers.no_load:
        yield _pair("load_newton", survey.load, "as the files state it")
    else:
        yield _pair("load_newton", 1000, "radial; V_eq needs it", off=True)


def _source(draft: Draft) -> Iterator[str]:
    survey, answers = draft.survey, draft.answers
    place = _relative(survey.place.resolve(), draft.out.resolve().parent)
    url = f"folder:{place}" if survey.is_folder else place
    yield from ("", "[[source]]", _pair("name", _SOURCE))
    yield _pair("url", url)
    yield _pair("format", survey.data_set.name)
    if len(survey.files) > 1:
        yield _pair("files", list(survey.files), "a channel each")
    elif survey.files:
        yield _pair("files", survey.files[0], "one after the other")
    elif (pattern := _of_one_ending(survey)) is not None:
        yield _pair("files", pattern, "what else is there is left out")
    if not survey.data_set.plain and survey.rate is not None:
        yield _pair("rate_hz", survey.rate, "of the first file; each file states its own", off=True)
    elif survey.rate is None or survey.rate_from is not None:
        where = "answered" if survey.rate is None else f"by the row {survey.rate_from}"
        yield _pair("rate_hz", draft.rate, where)
    else:
        yield _pair("rate_hz", survey.rate, "as the files state it; other rates are rejected")
    longest = max(survey.seconds(draft.rate))
    if longest <= _MAX_WHOLE_S:
        yield _pair("block_s", "file", f"each file is one block of {longest:.4g} s")
    else:
        yield _pair("block_s", 5, f"files of {longest:.4g} s are cut into blocks")
    if survey.pulses is not None:
        yield _pair("pulses", survey.pulses, "times of the pulses of a tacho")
    if answers.range_g is not None:
        yield _pair("range_g", answers.range_g, "g at full scale of the integers")
    yield from _dates(draft)


def _of_one_ending(survey: Survey) -> str | None:
    """Return the pattern of the files, where others that were left out have another ending of their format."""
    data_set, kept = survey.data_set, survey.data_set.endings
    others = [ending for ending in FORMATS.get(data_set.name, ()) if ending not in kept]
    if len(kept) != 1 or not any(unpacked_name(path).lower().endswith(tuple(others)) for path in survey.ignored):
        return None
    pattern = f"*{kept[0]}"
    return pattern if all(fnmatchcase(path, pattern) for path in survey.paths) else None


def _dates(draft: Draft) -> Iterator[str]:
    answers = draft.answers
    if draft.time_name is not None:
        yield _pair("time_from", "name", "")
        yield _pair("time_name", draft.time_name, "the date in the names")
    if answers.date_order is not None:
        yield _pair("date_order", answers.date_order)
    if answers.start_utc == "mtime":
        yield _pair("time_from", "mtime", "the last change of each file, less its length")
    elif not isinstance(answers.start_utc, str | None):
        start = answers.start_utc.isoformat().replace("+00:00", "Z")
        if len(draft.survey.paths) > 1 or draft.survey.is_folder:
            yield _pair("time_from", "count", "")
        yield f"{f'start_utc = {start}':<{_COLUMN}} # of the first file"
        if answers.interval_s is not None:
            yield _pair("interval_s", answers.interval_s, "between the starts of files")


def _channels(draft: Draft) -> Iterator[str]:
    rows = draft.survey.vibration
    bands = dict(draft.bands)
    several = len(rows) > 1 and len(bearing_sections(draft.survey, draft.answers)) == 1
    for row, name in zip(rows, channel_names(rows), strict=True):
        answers = draft.answers.of(row, draft.survey)
        unit = unit_of(row, answers) or ("g" if answers.range_g is not None else "unknown")
        level = level_in_g(row, draft)
        yield from ("", "[[channel]]")
        factor = scale_of(row, draft) or 1.0
        words = f"{factor * row.level.rms:.3g} {unit}" if unit == VELOCITY else level and f"{level.rms:.3g} g"
        yield _pair("name", name, f"RMS {words} in {draft.survey.first}" if words else "")
        yield _pair("source", _SOURCE)
        yield from _place(row, draft.survey)
        stated = row.unit not in (None, "unknown")
        of_file = f"the files state {row.written}" if stated else ""
        yield _pair("unit", unit, of_file)
        if unit == VELOCITY:
            yield _pair("sensor_max_hz", USUAL_LIMIT, "acceleration is differentiated up to here", off=True)
        if unit == "V" and answers.sensitivity_mv_per_g is not None:
            yield _pair("sensitivity_mv_per_g", answers.sensitivity_mv_per_g)
        scale = scale_of(row, draft)
        if scale is not None and unit != "unknown":
            meant = {FRACTIONS: "at full scale", COUNTS: "of one count"}.get(row.stored, "of one in the file")
            yield _pair("scale", scale, f"{unit} {meant}")
        section = bearing_of(draft.survey, row, name, draft.answers)[0]
        yield _pair("bearing", section, "of all channels" if several else "")
        yield _pair("band_hz", "auto", "chosen on the first blocks")
        if name in bands:
            low, high = bands[name]
            yield _pair("band_hz", [round(low), round(high)], f"the choice on {draft.survey.first} alone", off=True)


def _place(row: SurveyedRow, survey: Survey) -> Iterator[str]:
    """Yield the key that finds a row in its file."""
    if len(survey.rows) == 1 and not survey.chosen:
        return
    if len(survey.files) > 1:
        yield _pair("column", row.name)
        return
    if survey.data_set.name in ("mat", "tdms", "hdf5", "uff", "netcdf"):
        yield _pair("key", as_pattern(row.title))
    elif survey.data_set.name == "csv" and row.title != f"column_{row.column}":
        yield _pair("column", row.title)
    else:
        yield _pair("column", row.column)


def _further(draft: Draft) -> Iterator[str]:
    learn, run_in = DetectSettings().learn_blocks or _MIN_LEARN_BLOCKS, DetectSettings().run_in_blocks
    words, period = "blocks that make the baseline", draft.period or 0.0
    slow = (learn + run_in) * period > _MAX_LEARNING_S
    if slow:
        words += f", instead of {learn}: files come slowly"
        learn = max(_MIN_LEARN_BLOCKS, round(_MAX_LEARNING_S / period))
        run_in = min(run_in, learn // 4)
    yield from ("", "[detect]")
    yield _pair("learn_blocks", learn, words, off=not slow)
    yield _pair("run_in_blocks", run_in, "blocks before them that are left out", off=not slow)
    yield from ("", "# [[alarms.level]]", _pair("feature", "rms", off=True))
    yield _pair("alert_sd", 6, "standard deviations above the baseline", off=True)
    yield _pair("danger_g", 3, "", off=True)
