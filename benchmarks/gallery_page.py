"""How a page of the gallery is written: a table of all figures of a source, and a section for each counterpart."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.gallery_plate import Plate, save_plate

_SINGULAR = {"close": "is close", "in part": "holds in part"}
_PLURAL = {"agrees": "agree", "close": "are close", "in part": "hold in part", "differs": "differ"}
_VERDICTS = ("agrees", "close", "in part", "differs", "not comparable")


@dataclass(frozen=True)
class Entry:
    """A figure of a source.

    Attributes:
        number: in the source.
        title: what it shows.
        why: why it has no counterpart, "" where it has one.
        like: numbers of figures that show what is most like it.
    """

    number: str
    title: str
    why: str = ""
    like: tuple[str, ...] = ()


@dataclass(frozen=True)
class Source:
    """A document whose figures the gallery lists.

    Attributes:
        anchor: begins the anchors of its figures.
        entries: all its figures that are listed.
        figures: what makes each counterpart, by its number.
        kept: file names of the pictures that the page shows, by number.
        folder: of these pictures, beside the page.
        machine: what is said in the table of counterparts from another machine than the source's.
        word: what a figure is called.
    """

    anchor: str
    entries: Sequence[Entry]
    figures: Mapping[str, Callable[[], Plate]]
    kept: Mapping[str, str] = field(default_factory=dict)
    folder: str = ""
    machine: str = "another machine"
    word: str = "Fig. "

    def link(self, number: str) -> str:
        """Return the anchor of a figure."""
        return f"{self.anchor}-{number.replace('.', '-')}"

    def stored(self, data: Path) -> dict[str, Any]:
        """Return what the JSON files of all counterparts hold; raise an OSError where one is missing."""
        names = {number: data / f"fig{number}.json" for number in sorted(self.figures)}
        return {number: json.loads(path.read_text(encoding="utf-8")) for number, path in names.items()}


def make(source: Source, pictures: Path, data: Path, only: Sequence[str]) -> None:
    """Write pictures and data of some figures of a source, of all where ``only`` is empty.

    Raises:
        ValueError: a figure has no counterpart.
    """
    unknown = [number for number in only if number not in source.figures]
    if unknown:
        raise ValueError(f"--only {' '.join(unknown)}: expected numbers among {', '.join(source.figures)}")
    for number in only or source.figures:
        path = save_plate(source.figures[number](), number, pictures, data)
        print(f"{source.word}{number}: {path} ({path.stat().st_size / 1000:.0f} kB)")


def table(source: Source, stored: Mapping[str, Any]) -> list[str]:
    """Return the table of all figures of a source as lines."""
    head = ["", "| Fig. | shows | counterpart | verdicts |", "| --- | --- | --- | --- |"]
    return [*head, *(_row(source, entry, stored) for entry in source.entries)]


def counted(stored: Mapping[str, Any]) -> str:
    """Return how many statements have each verdict."""
    found = [claim["verdict"] for figure in stored.values() for claim in figure["claims"]]
    counts = {verdict: found.count(verdict) for verdict in _VERDICTS}
    words = ", ".join(f"{count} {_verb(verdict, count)}" for verdict, count in counts.items())
    return f"Of {len(found)} statements of the print: {words}."


def _verb(verdict: str, count: int) -> str:
    """Return a verdict as a verb that agrees with the count."""
    return (_SINGULAR if count == 1 else _PLURAL).get(verdict, verdict)


def _row(source: Source, entry: Entry, stored: Mapping[str, Any]) -> str:
    if entry.number not in stored:
        like = " ".join(f"[{source.word}{number}](#{source.link(number)})" for number in entry.like)
        text = f"none: {entry.why}" + (f"; see {like}" if like else "")
        return f"| {entry.number} | {entry.title} | {text} |  |"
    found = [claim["verdict"] for claim in stored[entry.number]["claims"]]
    numbers = {verdict: found.count(verdict) for verdict in found}
    counts = ", ".join(f"{count} {_verb(verdict, count)}" for verdict, count in numbers.items())
    kind = source.machine if stored[entry.number]["machine"] else "made"
    return f"| {entry.number} | {entry.title} | [{kind}](#{source.link(entry.number)}) | {counts} |"


def section(source: Source, entry: Entry, stored: Mapping[str, Any]) -> list[str]:
    """Return the section of a counterpart as lines."""
    number = entry.number
    lines = ["", f'<a id="{source.link(number)}"></a>', "", f"### {source.word}{number}: {entry.title}", ""]
    if number in source.kept:
        lines += [f"![{stored['label']}]({source.folder}/{source.kept[number]})", ""]
    lines.append(stored["caption"])
    if stored["machine"]:
        lines[-1] += f" Another machine: {stored['machine']}."
    if not stored["claims"]:
        return lines
    lines += ["", "| what the print says | print | here | verdict |", "| --- | --- | --- | --- |"]
    lines += [f"| {c['what']} | {c['printed']} | {c['obtained']} | {c['verdict']} |" for c in stored["claims"]]
    return lines
