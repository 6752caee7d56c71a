"""The problems of ``check`` as they are printed: entries of the JSON object, lines for people, refusals of ``run``."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from models.work.redact import redact
from monitor.config.load import Config
from monitor.config.plausible.doubt import Doubt
from monitor.config.plausible.rules import JudgedConfig
from monitor.config.positions import Place, find_lines
from monitor.desk.judge.problems import is_recording
from monitor.service.system import is_running
from monitor.words.numbers import count

_LINE = re.compile(r":(\d+): ")
_OF_ENTRY = re.compile(
    r"(?:\[\[(?P<of>source|channel)\]\]|(?P<plain>source|channel)) '?(?P<name>[\w.-]+)'?: (?P<key>\w+)"
)
_OF_TABLE = re.compile(r"([a-z]+)\.([a-z_0-9]+)\b")


def entries(doubts: Iterable[Doubt], path: Path) -> list[dict[str, Any]]:
    """Return doubts of a configuration file as plain values, problems first, each with the line of its key."""
    lines = find_lines(path.read_text(encoding="utf-8-sig"))
    found = [
        {
            "severity": doubt.severity,
            "file": str(path),
            "line": lines.get(doubt.place),
            "key": doubt.key,
            "expected": doubt.expected,
            "came": doubt.came,
        }
        for doubt in dict.fromkeys(doubts)
    ]
    return sorted(found, key=lambda entry: (entry["severity"], entry["line"] or 0))


def problem_lines(problems: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield a line for each problem and warning, and one that sums up."""
    for entry in problems:
        where = entry["file"] if entry["line"] is None else f"{entry['file']}:{entry['line']}"
        yield f"{entry['severity']}: {where}: {entry['key']}: {entry['came']}; expected {entry['expected']}"
    number = sum(entry["severity"] == "problem" for entry in problems)
    yield f"{count(number, 'problem')}, {count(len(problems) - number, 'warning')}"


def invalid_entries(message: str, path: Path) -> list[dict[str, Any]]:
    """Return the lines of a ConfigError on a file that is not valid as entries, with file, line and key."""
    found: list[dict[str, Any]] = []
    for text in message.splitlines():
        rest = text.removeprefix(str(path))
        line = _LINE.match(rest)
        said = rest.removeprefix(line[0] if line else ": ")
        came, word, expected = said.partition("expected ")
        found.append(
            {
                "severity": "problem",
                "file": str(path),
                "line": int(line[1]) if line else None,
                "key": re.split(r"[\s:=]", said, maxsplit=1)[0],
                "expected": expected if word else "a valid configuration",
                "came": came.rstrip(" :;,") if word else said,
            }
        )
    return found


def run_refusals(config: Config) -> list[str]:
    """Return all reasons why a daemon cannot start with a configuration, or cannot publish.

    A source without a URL or with that of a recording is left to ``replay``.
    """
    from monitor.service.start import inspect, records_refusals, store_refusals

    sources = [source for source in config.source if not is_recording(source)]
    found = inspect(config, sources, running=is_running(config.machine.state_dir))
    return list(dict.fromkeys([*found.refusals, *store_refusals(config, found), *records_refusals(config)]))


def refused_doubts(config: Config, reasons: Sequence[str]) -> Iterator[Doubt]:
    """Yield the reasons of a refusal as problems, with the key where it is named."""
    subject = JudgedConfig(config)
    for reason in reasons:
        place: Place = ("machine",)
        if match := _OF_ENTRY.search(reason):
            section = match["of"] or match["plain"]
            names = [entry.name for entry in getattr(config, section)]
            if match["name"] in names:
                place = (section, names.index(match["name"]), match["key"])
        elif (match := _OF_TABLE.match(reason)) and hasattr(getattr(config, match[1], None), match[2]):
            place = (match[1], match[2])
        yield subject.doubt("refused", "problem", place, "a configuration that run can start", reason)


def redacted(value: Any) -> Any:
    """Return plain values without the credentials in their texts."""
    if isinstance(value, str):
        return redact(value)
    if isinstance(value, Mapping):
        return {key: redacted(entry) for key, entry in value.items()}
    return [redacted(entry) for entry in value] if isinstance(value, list | tuple) else value
