"""Writer of text: CSV with every kind of head."""

from __future__ import annotations

import gzip
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path

import numpy as np

from benchmarks.loggers.names import of_channel, paths_of
from benchmarks.loggers.plan import Plan, Samples, TrueChannel, with_lost
from benchmarks.loggers.words import Spelling, rate_line, speed_line, start_lines

FILLS = ("", "NaN", "-9999")
"""What stands in place of a lost sample in text."""


@dataclass(frozen=True)
class Written:
    """What a writer has made: channels, paths of each recording, and what can be known of it.

    Attributes:
        channels: of vibration.
        paths: of each recording, relative to the folder of data.
        zone_stated: whether the starts state their zone.
        unknowable, ambiguous: as those of the truth.
        answers: what a person says who is asked.
    """

    channels: list[TrueChannel]
    paths: list[list[str]]
    zone_stated: bool
    unknowable: list[str]
    ambiguous: list[str]
    answers: dict[str, str]


@dataclass(frozen=True)
class _Column:
    """A column of text: name, unit, and the texts of its cells."""

    name: str
    unit: str
    cells: list[str]


def write_csv(plan: Plan, folder: Path) -> Written:
    """Write the files of a logger of text."""
    draw = plan.draw
    language = draw.one("language", ["en", "de", "fr"], [4, 3, 2])
    separator = draw.one(
        "separator",
        [",", ";", "\t", " "] if language == "en" else [";", "\t"],
        [5, 3, 2, 1][: 4 if language == "en" else 2],
    )
    decimal = "." if language == "en" else draw.one("decimal", [",", "."], [4, 1])
    joins = [": ", " = ", "\t"] + ([separator] if separator in ",;" else [])
    spelling = Spelling(language, decimal, draw.one("join", joins), draw.one("mark", ["", "# ", "% "], [4, 2, 1]))
    head = draw.yes("head", 0.85) or plan.dating == "head"
    channels, unit_in, unknowable, answers, scale_lines = _levels(plan, spelling, head, separator)
    rate_in = draw.one(
        "rate_in",
        ["head", "column", "both", "none"] if head else ["column", "none"],
        [5, 3, 2, 0.5][: 4 if head else 2],
    )
    if plan.dating == "rows":
        rate_in = draw.fix("rate_in", draw.one("rate_beside_rows", ["column", "both"] if head else ["column"]))
        axis = draw.one("axis", ["epoch_ms", "epoch_s", "iso", "date_time"], [3, 2, 4, 2])
    else:
        axis = draw.one("axis", _AXES if rate_in in ("column", "both") else ["", "index"])
    extras = draw.one("extras", [(), ("temperature",), ("rpm", "temperature"), ("tacho",)], [6, 2, 1, 1])
    extras = extras if unit_in in ("brackets", "parens", "row") else ()
    ambiguous: list[str] = []
    lines: list[tuple[str, str]] = []
    if head:
        lines.append((spelling.word(draw, "device"), draw.one("device", ["VibroLog 3", "DAQ-8", "SX200 Rev. 4"])))
        if rate_in in ("head", "both"):
            key, value, confused = rate_line(draw, spelling, plan.rate)
            lines.append((key, value))
            ambiguous += ["rate"] if confused and rate_in == "head" else []
        lines += scale_lines
        if plan.speed_in == "head":
            lines.append(speed_line(draw, spelling))
    if rate_in == "none":
        unknowable.append("rate")
        answers["--rate-hz"] = f"{plan.rate:g}"
    return _files(
        plan,
        folder,
        channels,
        _Text(spelling, separator, head, lines, axis, extras, unit_in),
        unknowable,
        ambiguous,
        answers,
    )


_AXES = ("seconds", "ms", "us", "s_bracket", "ms_paren", "us_paren")


@dataclass(frozen=True)
class _Text:
    """The form of a logger's text."""

    spelling: Spelling
    separator: str
    head: bool
    lines: list[tuple[str, str]]
    axis: str
    extras: tuple[str, ...]
    unit_in: str


def _levels(
    plan: Plan, spelling: Spelling, head: bool, separator: str
) -> tuple[list[TrueChannel], str, list[str], dict[str, str], list[tuple[str, str]]]:
    """Draw names, units and what states the level; return them with the lines of the head that do."""
    draw, count = plan.draw, len(plan.signals[0])
    unit = draw.one(
        "unit", ["g", "m/s2", "m/s²", "m/s^2", "mg", "mV", "V", "counts", "mm/s"], [8, 4, 5, 1, 2, 3, 1, 1, 1]
    )
    places = ["brackets", "parens", "row", "head"] if head else ["brackets", "parens", "row"]
    unit_in = draw.one("unit_in", [*places, "none"], [5, 3, 3, 3, 0.6] if head else [5, 3, 3, 0.6])
    names = draw.one("labels", [("X", "Y", "Z"), ("1", "2", "3"), ("DE", "NDE", "M")])
    pattern = spelling.word(draw, "velocity" if unit == "mm/s" else "acceleration")
    pattern = pattern.replace(" ", "_") if separator == " " or draw.yes("joined", 0.3) else pattern
    channels = [TrueChannel(pattern.format(label), unit=unit, acceleration=unit != "mm/s") for label in names[:count]]
    unknowable: list[str] = []
    answers: dict[str, str] = {}
    lines: list[tuple[str, str]] = []
    if unit == "counts":
        scale = draw.one("scale", [0.000488, 0.0039])
        stated = head and draw.yes("scale_stated", 0.7)
        for each in channels:
            each.scale = scale
        answers.update({"--unit": "g", "--scale": f"{scale:g}"})
        if stated:
            lines.append((spelling.word(draw, "scale"), f"{spelling.number(1e3 * scale)} mg/LSB"))
        else:
            unknowable.append("level")
    elif unit in ("mV", "V"):
        value = draw.one("sensitivity", [100.0, 10.0, 500.0, 98.6])
        for each in channels:
            each.sensitivity_mv_per_g = value
        answers.update({"--unit": unit, "--sensitivity-mv-per-g": f"{value:g}"})
        if head and draw.yes("sensitivity_stated", 0.75):
            lines.append((spelling.word(draw, "sensitivity"), f"{spelling.number(value)} mV/g"))
        else:
            unknowable.append("level")
    if unit_in == "none" and unit == "mm/s":
        unknowable.append("level")
    elif unit_in == "none":
        unknowable.append("level")
        answers.setdefault("--unit", {"m/s²": "m/s2", "m/s^2": "m/s2"}.get(unit, unit))
    if unit_in == "head":
        lines.insert(0, (spelling.word(draw, "unit"), unit))
    return channels, unit_in, unknowable, answers, lines


def _files(
    plan: Plan,
    folder: Path,
    channels: list[TrueChannel],
    form: _Text,
    unknowable: list[str],
    ambiguous: list[str],
    answers: dict[str, str],
) -> Written:
    draw = plan.draw
    ending = draw.one("ending", ["csv", "txt", "dat"], [4, 2, 0.5])
    squeezed = draw.yes("gz", 0.12)
    encoding = draw.one("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16"], [6, 2, 2, 0.5])
    newline = draw.one("newline", ["\n", "\r\n"])
    style = draw.one("channel_files", ["suffix", "folder"]) if plan.grouping == "channels" else ""
    paths: list[list[str]] = []
    alone = len(channels) == 1 and form.axis == ""
    fill = draw.one("fill", FILLS[1:] if alone else FILLS) if plan.lost == "fill" else ""
    stems = paths_of(plan, ending + (".gz" if squeezed else ""))
    zone_stated = plan.dating == "name" and draw.chosen.get("stamp") == "epoch"
    for index, path in enumerate(stems):
        lines = list(form.lines)
        if plan.dating == "head":
            dated, zone_stated, confused = start_lines(draw, form.spelling, plan.wall(index))
            lines += dated
            ambiguous += ["start"] if confused and "start" not in ambiguous else []
        last = index == len(plan.signals) - 1
        values, lost = with_lost(plan.signals[index], plan.lost if last else "")
        axis, stated = _axis(plan, form, index)
        zone_stated = stated if plan.dating == "rows" else zone_stated
        body = [
            _Column(each.name, each.unit, cells_of(each.stored(row), form.spelling.decimal, each.scale))
            for each, row in zip(channels, values, strict=True)
        ]
        if last and plan.lost == "fill":
            for column in body:
                column.cells[:] = [fill if gone else cell for cell, gone in zip(column.cells, lost, strict=True)]
        groups = [[column] for column in body] if style else [body]
        found: list[str] = []
        for number, group in enumerate(groups, start=1):
            place = path if not style else _marked(path, number, style)
            text = newline.join(_rows(form, lines, [*axis, *group, *_extras(plan, form, values.shape[1])])) + newline
            data = text.encode(encoding, "replace")
            target = folder / place
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(gzip.compress(data, 1, mtime=0) if squeezed else data)
            found.append(place)
        paths.append(found)
    before = len(_axis(plan, form, 0)[0])
    for number, each in enumerate(channels, start=1):
        each.column = before + (1 if style else number)
    return Written(channels, paths, zone_stated, unknowable, ambiguous, answers)


def _marked(path: str, number: int, style: str) -> str:
    if path.endswith(".gz"):
        return of_channel(path.removesuffix(".gz"), number, style) + ".gz"
    return of_channel(path, number, style)


def cells_of(values: Samples, decimal: str, scale: float | None) -> list[str]:
    """Return numbers as text, with six digits of their level; counts as whole numbers."""
    if scale is not None:
        return [str(int(value)) for value in np.round(values)]
    digits = max(1, 5 - int(np.floor(np.log10(np.nanstd(values)))))
    cells = [f"{value:.{digits}f}" for value in values]
    return [cell.replace(".", ",") for cell in cells] if decimal == "," else cells


def _extras(plan: Plan, form: _Text, count: int) -> list[_Column]:
    random, decimal = np.random.default_rng(7), form.spelling.decimal
    columns: list[_Column] = []
    for what in form.extras:
        name = form.spelling.word(plan.draw, what).replace(" ", "_")
        if what == "temperature":
            values, unit = 48.0 + 0.05 * random.standard_normal(count), "°C"
        elif what == "rpm":
            values, unit = (
                1488.0 + 0.3 * random.standard_normal(count),
                "1/min" if form.spelling.language == "de" else "rpm",
            )
        else:
            phase = np.arange(count) / plan.rate * 24.8 % 1.0
            values, unit = np.where(phase < 0.1, 4.8, 0.1) + 0.01 * random.standard_normal(count), "V"
        columns.append(_Column(name, unit, [f"{value:.3f}".replace(".", decimal) for value in values]))
    return columns


def _axis(plan: Plan, form: _Text, index: int) -> tuple[list[_Column], bool]:
    """Return the columns of time before the channels, and whether they state a zone."""
    count, spelling, draw = plan.signals[index].shape[1], form.spelling, plan.draw
    t = np.arange(count) / plan.rate
    if form.axis == "":
        return [], True
    if form.axis == "index":
        first = draw.one("first_index", [0, 1])
        return [_Column(spelling.word(draw, "index"), "", [str(i + first) for i in range(count)])], True
    if form.axis in ("iso", "date_time"):
        return _stamps(plan, form, index)
    if form.axis.startswith("epoch"):
        unit = form.axis.removeprefix("epoch_")
        name = draw.one("epoch_name", [f"epoch_{unit}", f"timestamp_{unit}", "time" if unit == "ms" else "unix_time"])
        begin, factor = plan.wall(index).timestamp(), 1e3 if unit == "ms" else 1.0
        digits = 3 if unit == "ms" else 6
        return [
            _Column(name, "", [f"{factor * (begin + each):.{digits}f}".replace(".", spelling.decimal) for each in t])
        ], True
    unit = {"seconds": "s", "ms": "ms", "us": "us", "s_bracket": "s", "ms_paren": "ms", "us_paren": "us"}[form.axis]
    factor = {"s": 1.0, "ms": 1e3, "us": 1e6}[unit]
    digits = {"s": 7, "ms": 4, "us": 2}[unit]
    name = spelling.word(draw, "seconds")
    if form.axis in ("ms", "us"):
        name = f"{name}_{unit}"
    elif form.axis != "seconds" and form.unit_in != "row":
        name += {"s_bracket": " [s]", "ms_paren": " (ms)", "us_paren": " (us)"}[form.axis]
    cells = [f"{factor * each:.{digits}f}".replace(".", spelling.decimal) for each in t]
    return [
        _Column(name.replace(" ", "_") if form.separator == " " else name, unit if form.unit_in == "row" else "", cells)
    ], True


def _stamps(plan: Plan, form: _Text, index: int) -> tuple[list[_Column], bool]:
    count, decimal, draw = plan.signals[index].shape[1], form.spelling.decimal, plan.draw
    begin = plan.wall(index)
    stamps = [begin + timedelta(microseconds=round(1e6 * i / plan.rate)) for i in range(count)]
    zone = draw.yes("rows_zone", 0.4) if form.axis == "iso" else False
    if form.axis == "iso":
        join = "_" if form.separator == " " else draw.one("iso_join", ["T", " "])
        join = "T" if join == "_" else join
        offset = begin.strftime("%z")
        suffix = ("Z" if offset == "+0000" else f"{offset[:3]}:{offset[3:]}") if zone else ""
        cells = [f"{each:%Y-%m-%d}{join}{each:%H:%M:%S}{decimal}{each.microsecond:06d}{suffix}" for each in stamps]
        return [_Column(draw.one("iso_name", ["timestamp", "time", "DateTime"]), "", cells)], zone
    date = "%d.%m.%Y" if form.spelling.language == "de" else "%Y-%m-%d"
    names = (form.spelling.word(draw, "date"), form.spelling.word(draw, "time"))
    clock = [f"{each:%H:%M:%S}{decimal}{each.microsecond:06d}" for each in stamps]
    return [_Column(names[0], "", [each.strftime(date) for each in stamps]), _Column(names[1], "", clock)], False


def _rows(form: _Text, lines: list[tuple[str, str]], columns: list[_Column]) -> list[str]:
    mark, join, separator = form.spelling.mark, form.spelling.join, form.separator
    quoted = [f'"{value}"' if join in value else value for _, value in lines]
    rows = [f"{mark}{key}{join}{value}" for (key, _), value in zip(lines, quoted, strict=True)]
    if form.unit_in == "brackets":
        names = [f"{each.name} [{each.unit}]" if each.unit else each.name for each in columns]
    elif form.unit_in == "parens":
        names = [f"{each.name} ({each.unit})" if each.unit else each.name for each in columns]
    else:
        names = [each.name for each in columns]
    if separator == " ":
        names = [name.replace(" ", "_").replace("_[", "[").replace("_(", "(") for name in names]
    rows.append(separator.join(names))
    if form.unit_in == "row":
        rows.append(separator.join(each.unit or "-" for each in columns))
    rows += [separator.join(cells) for cells in zip(*(each.cells for each in columns), strict=True)]
    return rows
