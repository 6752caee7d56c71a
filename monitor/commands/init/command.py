"""``spallwatch init``: look at files, ask what they do not state, write a configuration."""

from __future__ import annotations

import textwrap
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from models.machine.bearing import kinematics
from monitor.commands import option
from monitor.commands.common import InputError, input_errors, output_errors, say
from monitor.config.load import Config, load_config
from monitor.desk import answers as read
from monitor.desk.answers import Answers, bearing_of, channel_names, check_bearings
from monitor.desk.questions import (
    Question,
    interval_question,
    name_readings,
    needs_interval,
    open_questions,
    period_of,
)
from monitor.desk.text import Draft, configuration_text, machine_name
from monitor.health.signal.quality import check_samples
from monitor.words.numbers import duration
from streams.files.container import first_of
from streams.files.foreign import HEAD_BYTES, seen_in
from streams.files.sidecar import is_beside
from streams.files.survey import Survey, SurveyedRow, survey
from streams.types.listing import shown
from streams.types.samples import ReaderError
from streams.types.spec import SourceError
from streams.types.stamps import stamp_in_name, utc_text

if TYPE_CHECKING:
    from monitor.config.plausible.doubt import Doubt
    from monitor.desk.judge.dating import DatingPreview


def _words(reader: Callable[[str], dict[str, Any]]) -> Callable[[Any, Any, str | None], dict[str, Any]]:
    """Return a callback of an option whose words a reader understands."""

    def convert(ctx: click.Context, param: click.Parameter, value: str | None) -> dict[str, Any]:
        if value is None:
            return {}
        try:
            return reader(value)
        except ValueError as error:
            raise click.BadParameter(str(error), ctx, param) from None

    return convert


_WIDTH = 88


@click.command("init")
@click.argument("path", default=".", type=option.PLACE)
@click.option(
    "--bearing", callback=_words(read.read_bearing), help="Designation (6205-2RS), or geometry: 9 7.94 39.04."
)
@click.option("--speed-hz", callback=_words(read.read_speed), help='29.5, "1770 rpm" or "estimate".')
@click.option("--speed-unit", callback=_words(read.read_speed_unit), help="rpm or Hz, of a speed in the files.")
@click.option("--load-newton", callback=_words(read.read_load), help='400, "0.4 kN" or "unknown".')
@click.option("--unit", callback=_words(read.read_unit), help="Of the vibration: g, m/s2, V, mV or unknown.")
@click.option(
    "--sensitivity-mv-per-g", callback=_words(read.read_sensitivity), help="Of the sensor, where the unit is V."
)
@click.option("--scale", type=click.FloatRange(), help="The unit of one count, or at full scale (WAV).")
@click.option("--range-g", type=option.POSITIVE, help="The g at full scale (WAV).")
@click.option("--rate-hz", callback=_words(read.read_rate), help="Sampling rate, where the files state none.")
@click.option("--start-utc", callback=_words(read.read_start), help="Start of the first file, mtime, or none.")
@click.option("--interval-s", callback=_words(read.read_interval), help="Between the starts of files that are counted.")
@click.option("--time-name", callback=_words(read.read_pattern), help="strptime pattern of the dates in names.")
@click.option("--date-order", callback=_words(read.read_order), help="day_first or month_first.")
@click.option("--pulses-per-revolution", callback=_words(read.read_pulses), help="Of a tacho in the files.")
@click.option("--files", callback=_words(read.read_files), help="together or sequence, where names fall into groups.")
@click.option("--timezone", default="UTC", help="Zone of dates that state none.")
@click.option("--format", "kind", default="auto", help="Format or data set, where it is not recognised.")
@click.option("--name", help="Of the machine. Default: the folder's.")
@click.option("--out", type=option.OUT_FILE, default="config.toml", help="The configuration to write.")
@click.option("--force", is_flag=True, help="Replace the file that is there.")
@click.option(
    "--yes", is_flag=True, help="Ask nothing: take defaults, or list the answers that are missing (exit code 2)."
)
@option.output
def command(
    path: str, scale: float | None, range_g: float | None, timezone: str, kind: str, name: str | None, out: Path,
    force: bool, yes: bool, as_json: bool, quiet: bool, **given: dict[str, Any],
) -> option.Result:  # fmt: skip
    """Look at the files of PATH, ask what they do not state, and write a configuration that `check` accepts.

    PATH is a folder into which a logger writes, or one recording. Options answer questions in advance.
    """
    answers = Answers(scale=scale, range_g=range_g)
    for found in given.values():
        answers = replace(answers, **found)
    _check_out(out, force=force, ask=not yes, to_stderr=as_json)
    try:
        seen = survey(path, kind, timezone)
    except ReaderError as error:
        raise InputError(f"{shown(path)}: {error}") from None
    except SourceError as error:
        raise InputError(
            str(error).replace("[[source]] survey: url: ", "").replace("[[source]] survey: ", "")
        ) from None
    if not seen.vibration:
        found = "; ".join(f"{shown(row.title)} {row.evidence}" for row in seen.all_rows)
        raise InputError(f"{shown(path)}: no row of {shown(seen.first)} is vibration: {found}")
    with input_errors("--bearing"):
        check_bearings(seen, answers.bearings)
    talk = _Talk(ask=not yes, to_stderr=as_json, quiet=quiet)
    for line in survey_lines(seen, path, timezone):
        talk.say(line)
    conversation = _Conversation(seen, answers, talk, timezone, name or machine_name(seen.place.resolve()), out)
    conversation.group_files()
    config, doubts = conversation.settle()
    conversation.write(out)
    problems = [doubt.text for doubt in doubts]
    values = {"out": str(out), "problems": problems, "machine": config.machine.name, "hash": config.hash}
    lines = [f"wrote {out}", *(f"{doubt.severity}: {doubt.text}" for doubt in doubts), *_next_steps(seen, out)]
    return values, lines


def _check_out(out: Path, *, force: bool, ask: bool, to_stderr: bool) -> None:
    """Refuse to replace a file without being told."""
    if not out.exists() or force:
        return
    if ask and click.confirm(f"{out} is there already. Replace it?", default=False, err=to_stderr):
        return
    raise InputError(f"--out {out}: is there already; give another --out FILE, or --force to replace it")


def _next_steps(seen: Survey, out: Path) -> Iterator[str]:
    config = "" if out == Path("config.toml") else f" --config {out}"
    yield f"next: spallwatch check{config}"
    yield f"then: spallwatch {'run' if seen.is_folder else 'replay'}{config}"


@dataclass
class _Talk:
    """How questions are asked and what was found is said."""

    ask: bool
    to_stderr: bool
    quiet: bool

    def say(self, line: str) -> None:
        if self.to_stderr or self.quiet:
            say(line, quiet=self.quiet)
        else:
            click.echo(line)

    def answer(self, question: Question) -> dict[str, Any]:
        """Ask until the words are an answer.

        Raises:
            click.Abort: the input ends.
        """
        self.say(f"\n{wrapped(question.why)}")
        while True:
            words = click.prompt(
                question.words, default=question.default or "", show_default=question.default is not None,
                err=self.to_stderr,
            )  # fmt: skip
            try:
                if not words.strip():
                    raise ValueError("an answer is needed")
                return question.read(words)
            except ValueError as error:
                click.echo(f"  {error}", err=True)


@dataclass
class _Conversation:
    """Questions and answers about one recording, until a configuration can be written."""

    seen: Survey
    answers: Answers
    talk: _Talk
    timezone: str
    machine: str
    out: Path
    text: str = ""

    def settle(self) -> tuple[Config, list[Doubt]]:
        """Return the configuration, and what remains doubtful in it and in the files.

        Raises:
            InputError: answers are missing; it lists all of them with their options.
        """
        last_problem = ""
        while True:
            self._answer_all(last_problem)
            config, preview = self._drafted()
            dates = [] if preview is None else [doubt.came for doubt in preview.doubts if doubt.rule == "dating"]
            last_problem = "; ".join(dates)
            if "date_order" not in last_problem or self.answers.date_order is not None:
                return config, self._doubts(config, preview)

    def _answer_all(self, last_problem: str) -> None:
        missing: list[Question] = []
        asked: set[str] = set()
        while True:
            questions = open_questions(self.seen, self.answers, self.timezone, time.time(), last_problem)
            question = next((found for found in (*questions, *self._interval()) if found.option not in asked), None)
            if question is None:
                break
            asked.add(question.option)
            if self.talk.ask:
                try:
                    self.answers = replace(self.answers, **self.talk.answer(question))
                    self.group_files()
                except click.Abort:
                    self.talk.ask = False
                    asked.discard(question.option)
            elif question.default is not None:
                self.answers = replace(self.answers, **question.read(question.default))
            else:
                missing.append(question)
        if missing:
            listed = (f"  {question.option}: {question.words}. {question.why}" for question in missing)
            lines = "\n".join(wrapped(line, "    ") for line in listed)
            raise InputError(f"these answers are missing; give them as options:\n{lines}")

    def group_files(self) -> None:
        """Look again at files whose names fall into groups, once it is answered how they are read."""
        groups = self.seen.groups
        if groups is not None and self.answers.files is not None:
            together = self.answers.files == "together"
            patterns = groups.patterns if together else ("*",)
            self.seen = survey(str(self.seen.place), self.seen.data_set.name, self.timezone, patterns)

    def _interval(self) -> Iterator[Question]:
        rate = self.seen.rate or self.answers.rate_hz
        if rate is not None and needs_interval(self.seen, self.answers):
            yield interval_question(self.seen, rate)

    def _drafted(self) -> tuple[Config, DatingPreview | None]:
        """Write the text, and return its configuration with what `check` sees in the files."""
        self.text = configuration_text(self.draft())
        config = self._read_back()
        from monitor.desk.judge.dating import preview_dating

        return config, preview_dating(config, config.source[0])

    def draft(self) -> Draft:
        """Return what the configuration is written of."""
        answers, seen = self.answers, self.seen
        pattern = answers.time_name
        if pattern is None and answers.start_utc is None:
            readings = name_readings(seen, self.timezone, time.time())
            pattern = readings[0].pattern if len(readings) == 1 else None
        draft = Draft(
            seen, answers, self.machine, self.out, answers.rate_hz or seen.rate or 1.0, self.timezone, pattern
        )
        return replace(
            draft, bands=tuple(_proposed_bands(draft)), period=period_of(seen, answers, pattern, self.timezone)
        )

    def _read_back(self) -> Config:
        """Return the configuration of the text, read where it will stand, so that paths are right."""
        place = self.out.with_name(f".{self.out.name}.draft")
        with output_errors("--out", self.out):
            self.out.parent.mkdir(parents=True, exist_ok=True)
            place.write_text(self.text, encoding="utf-8")
        try:
            return load_config(place)
        finally:
            place.unlink()

    def write(self, out: Path) -> None:
        """Write the configuration."""
        with output_errors("--out", out):
            out.write_text(self.text, encoding="utf-8")

    def _doubts(self, config: Config, preview: DatingPreview | None) -> list[Doubt]:
        """Return what `check` will doubt, but that a recording is one."""
        from monitor.desk.judge.problems import find_problems

        known = preview is not None and preview.file is not None
        facts = {config.source[0].name: preview.facts} if known and preview is not None else {}
        found = [*find_problems(config, facts), *(() if preview is None else preview.doubts)]
        return [doubt for doubt in found if self.seen.is_folder or doubt.rule != "place"]


def _proposed_bands(draft: Draft) -> Iterator[tuple[str, tuple[float, float]]]:
    """Yield the band that the first file alone shows for each channel, where it is long enough to tell."""
    from monitor.health.signal.bands import find_band
    from monitor.health.signal.settings import fundamentals

    speed = draft.answers.speed_hz or draft.survey.speed
    if speed is None:
        return
    rows = draft.survey.vibration
    for row, name in zip(rows, channel_names(rows), strict=True):
        bearing = bearing_of(row, name, draft.answers)[1]
        if bearing is None:
            continue
        lines = fundamentals(kinematics(bearing.geometry(), speed))
        try:
            low, high = find_band([draft.survey.values.values[draft.survey.rows.index(row)]], draft.rate, lines)
        except ValueError:
            continue
        yield name, (low, high)


def wrapped(text: str, indent: str = "") -> str:
    """Return a text in lines for a terminal, with an indent of all lines but the first."""
    return textwrap.fill(
        text, _WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False, drop_whitespace=True
    )


def survey_lines(seen: Survey, path: str, timezone: str) -> Iterator[str]:
    """Yield what the files of a path state."""
    count = f"{len(seen.paths)} {'file' if len(seen.paths) == 1 else 'files'} of {seen.data_set.name}"
    ends = seen.first if seen.first == seen.last else f"{seen.first} to {seen.last}"
    yield f"{shown(path)}: {count}, {ends}"
    if len(seen.files) > 1:
        yield f"  read together, a channel each: {', '.join(map(shown, seen.files))}"
    if seen.ignored:
        more = f" and {len(seen.ignored) - 3} more" if len(seen.ignored) > 3 else ""
        named = (f"{shown(name)}{_seen_words(seen, name)}" for name in seen.ignored[:3])
        yield f"  left out, of another format: {', '.join(named)}{more}"
    yield from (f"  cannot be read: {reason}" for reason in seen.refused[:3])
    if seen.rate is None:
        yield f"  rate: not stated; {seen.samples[0]} samples in a row"
    else:
        lengths = " and ".join(dict.fromkeys(duration_words(length) for length in seen.seconds(seen.rate)))
        by = "" if seen.rate_from is None else f" by the row {seen.rate_from}"
        yield f"  rate: {seen.rate:g} Hz{by}; first and last file of {lengths}"
    for row in seen.all_rows:
        place = f"row {row.column}" if row.samples is None else f"of {row.samples} samples"
        yield f"  {place}, {row.title}: {_row_words(row)}{_lost_words(seen, row)}"
    if seen.pulses is not None:
        place = "beside the files" if is_beside(seen.pulses) else "in the files"
        yield f"  pulses of a tacho: {shown(seen.pulses)} {place}"
    yield f"  date: {_date_words(seen, timezone)}"


def _seen_words(seen: Survey, name: str) -> str:
    found = seen_in(name, first_of(seen.place, name, HEAD_BYTES) if seen.is_folder else b"")
    return "" if found is None else f" ({found})"


def duration_words(seconds: float) -> str:
    """Return a length of a file, s."""
    return f"{seconds:.3g} s" if seconds < 90.0 else duration(seconds)


def _row_words(row: SurveyedRow) -> str:
    if row.kind != "vibration":
        tacho = "" if row.tacho is None else f"a tacho, {row.tacho.pulses} pulses in the first file"
        words = {"time": "times, no channel", "tacho": tacho}
        mean = f", mean {row.level.mean:.4g} {row.written}".rstrip()
        left = f"left out: it {row.evidence}" if row.evidence else "left out"
        return words.get(row.kind, f"the {row.kind}{mean}" if row.kind in ("speed", "load") else left)
    unit = "" if row.unit in (None, "unknown") else f" {row.unit}"
    spelled = f"unit {row.written}" if row.written else "no unit"
    stored = "" if row.stored == "values" else f", stored as {row.stored}"
    mean = row.level.mean if abs(row.level.mean) > 1e-3 * row.level.rms else 0.0
    return f"{spelled}{stored}, RMS {row.level.rms:.3g}{unit}, mean {mean:.3g}{unit}"


def _lost_words(seen: Survey, row: SurveyedRow) -> str:
    """Return how many samples of a row of the first file are missing, or were filled with a constant; else ""."""
    place = next((place for place, own in enumerate(seen.rows) if own is row), None)
    if place is None or row.kind != "vibration":
        return ""
    verdict = check_samples(seen.values.values[place], absolute=False)
    return f"; {verdict.reason}" if {verdict.status, *verdict.flags} & {"nan", "filled"} else ""


def _date_words(seen: Survey, timezone: str) -> str:
    zone = f", {timezone} unless it states a zone"
    if not seen.data_set.plain:
        return f"as {seen.data_set.name} states it"
    if seen.start is not None:
        return f"{utc_text(seen.start)} in the header of {shown(seen.first)}{zone}"
    if seen.stamp is not None:
        return f"{seen.stamp!r} in the header of {shown(seen.first)}{zone}"
    stamp = stamp_in_name(seen.first, timezone)
    if stamp is not None:
        return f"{stamp.text!r} in the name of {shown(seen.first)}{zone}"
    readings = name_readings(seen, timezone, time.time())
    if readings:
        return f"{readings[0].pattern} in the names ({utc_text(readings[0].first)}){zone}"
    return "none in headers or names"
