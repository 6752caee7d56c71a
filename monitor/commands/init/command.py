"""``spallwatch init``: look at files, ask what they do not state, write a configuration."""

from __future__ import annotations

import textwrap
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from monitor.commands import option
from monitor.commands.common import InputError, output_errors, say
from monitor.desk.answers import Answers, read_answer
from monitor.desk.description import date_words, left_out_words, taken_words
from monitor.desk.desk import DeskError, DraftedConfig, ImportDesk, check_answers, look
from monitor.desk.questions import Question, no_vibration_words
from monitor.desk.text import machine_name
from monitor.health.signal.quality import check_samples
from monitor.words.numbers import duration
from streams.files.sidecar import is_beside
from streams.files.survey import Survey, SurveyedRow
from streams.types.listing import shown


def _words(ctx: click.Context, param: click.Parameter, value: str | None) -> dict[str, Any]:
    """Return the fields of an answer in words: the callback of an option."""
    if value is None:
        return {}
    try:
        return read_answer(str(param.name), value)
    except ValueError as error:
        raise click.BadParameter(str(error), ctx, param) from None


_WIDTH = 88


@click.command("init")
@click.argument("path", default=".", type=option.PLACE)
@click.option("--bearing", callback=_words, help="Designation (6205-2RS), or geometry: 9 7.94 39.04.")
@click.option("--speed-hz", callback=_words, help='29.5, "1770 rpm" or "estimate".')
@click.option("--speed-unit", callback=_words, help="rpm or Hz, of a speed in the files.")
@click.option("--load-newton", callback=_words, help='400, "0.4 kN" or "unknown".')
@click.option("--unit", callback=_words, help='g, m/s2, V, mV or unknown; of each channel "mV; NDE=g".')
@click.option(
    "--sensitivity-mv-per-g",
    callback=_words,
    help='Of the sensor, where the unit is V: 100, or "100; NDE=10.2 mV/(m/s2)".',
)
@click.option("--scale", callback=_words, help="The unit of one count, or at full scale (WAV).")
@click.option("--range-g", type=option.POSITIVE, help="The g at full scale (WAV).")
@click.option("--rate-hz", callback=_words, help="Sampling rate, where the files state none.")
@click.option("--start-utc", callback=_words, help="Start of the first file, mtime, or none.")
@click.option("--interval-s", callback=_words, help="Between the starts of files that are counted.")
@click.option("--time-name", callback=_words, help="strptime pattern of the dates in names.")
@click.option("--date-order", callback=_words, help="day_first, month_first or year_first.")
@click.option("--pulses-per-revolution", callback=_words, help="Of a tacho in the files.")
@click.option("--files", callback=_words, help="together or sequence, where names fall into groups.")
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
    path: str, range_g: float | None, timezone: str, kind: str, name: str | None, out: Path,
    force: bool, yes: bool, as_json: bool, quiet: bool, **given: dict[str, Any],
) -> option.Result:  # fmt: skip
    """Look at the files of PATH, ask what they do not state, and write a configuration that `check` accepts.

    PATH is a folder into which a logger writes, or one recording. Options answer questions in advance. Exit code 2
    where nothing is written, or what is written has a problem.
    """
    # The factor of a unit such as mV takes precedence.
    answers = Answers(range_g=range_g).answered(given.pop("scale"))
    for found in given.values():
        answers = answers.answered(found)
    _check_out(out, force=force, ask=not yes, to_stderr=as_json)
    seen = look(path, kind, timezone)
    if not seen.vibration:
        raise InputError(f"{shown(path)}: {no_vibration_words(seen)}")
    try:
        check_answers(seen, answers)
    except DeskError as error:
        raise InputError(f"--{error.key.replace('_', '-')}: {error.sentence}") from None
    talk = _Talk(ask=not yes, to_stderr=as_json, quiet=quiet)
    for line in survey_lines(seen, path, timezone):
        talk.say(line)
    desk = ImportDesk(seen, answers, name or machine_name(seen.place.resolve()), out, timezone)
    found = _Conversation(desk.answered({}), talk).settle()
    with output_errors("--out", out):
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(found.text, encoding="utf-8")
    problems = [f"{doubt.severity}: {doubt.text}" for doubt in found.doubts]
    values = {"out": str(out), "problems": problems, "machine": found.config.machine.name, "hash": found.config.hash}
    is_wrong = any(doubt.severity == "problem" for doubt in found.doubts)
    return values, [f"wrote {out}", *problems, *_next_steps(seen, out)], option.WRONG if is_wrong else option.DONE


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
        shown_one = question.proposed or question.default
        while True:
            words = click.prompt(
                question.words, default=shown_one or "", show_default=shown_one is not None, err=self.to_stderr
            )
            try:
                if not words.strip():
                    raise ValueError("an answer is needed")
                return question.read(words)
            except ValueError as error:
                click.echo(f"  {error}", err=True)


@dataclass
class _Conversation:
    """Questions and answers about one recording, until a configuration can be written."""

    desk: ImportDesk
    talk: _Talk

    def settle(self) -> DraftedConfig:
        """Return the configuration, and what remains doubtful in it and in the files.

        Raises:
            InputError: answers are missing; it lists all of them with their options.
        """
        last_problem = ""
        while True:
            self._answer_all(last_problem)
            found = self.desk.drafted()
            last_problem = found.date_problem
            if "date_order" not in last_problem or self.desk.answers.date_order is not None:
                return found

    def _answer_all(self, last_problem: str) -> None:
        asked: set[tuple[str, str]] = set()
        while self.talk.ask:
            # A question for the channels that were left open has other words.
            open_ones = self.desk.questions(last_problem)
            question = next((one for one in open_ones if (one.key, one.why) not in asked), None)
            if question is None:
                return
            asked.add((question.key, question.why))
            try:
                self.desk = self.desk.answered(self.talk.answer(question))
            except click.Abort:
                self.talk.ask = False
        self.desk, questions = self.desk.with_defaults(last_problem)
        missing = [question for question in questions if question.default is None]
        if missing:
            listed = (f"  {question.option}: {question.words}. {question.why}" for question in missing)
            lines = "\n".join(wrapped(line, "    ") for line in listed)
            raise InputError(f"these answers are missing; give them as options:\n{lines}")


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
    if taken := taken_words(seen):
        yield f"  {taken}"
    if len(seen.files) > 1:
        yield f"  read together, a channel each: {', '.join(map(shown, seen.files))}"
    if seen.ignored:
        yield f"  left out, of another format: {left_out_words(seen)}"
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
    yield f"  date: {date_words(seen, timezone, time.time())}"


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
