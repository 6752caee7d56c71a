"""Compare what came of a recording with the truth: each fact is right, asked, refused, missed or silently wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import PurePosixPath

import numpy as np

from benchmarks.loggers.plan import LoggerTruth, TrueFile
from benchmarks.loggers.ways import FACT_OF, BlockRead, Came

RIGHT, ASKED, MISSED, REFUSED, WRONG = "right", "asked", "missed", "refused", "wrong"
WORDS = (RIGHT, ASKED, MISSED, REFUSED, WRONG)
"""From the best to the worst. Missed: stated and not read, and nothing false is said. Wrong: silently."""

FACTS = ("channels", "rate", "level", "times")
TOLERANCE, _OF_DERIVATIVE = 1e-3, 0.05
"""Relative, of rates and levels, and of the acceleration of a velocity, whose ends are uncertain."""

TOLERANCE_S = 2e-3
_OF_CLOCK = frozenset({"clock", "late", "out_of_order"})
_NO_LOSS = _OF_CLOCK | {"clipped"}
"""Flags that do not say that samples are missing."""


@dataclass
class Verdict:
    """What one way made of a logger.

    Attributes:
        facts: word of each fact.
        details: what was expected and came, of those that are not right.
        names_file: whether a refusal names a file.
        flagged: blocks with a flag although nothing is wrong with them.
    """

    facts: dict[str, str] = field(default_factory=lambda: dict.fromkeys(FACTS, RIGHT))
    details: list[str] = field(default_factory=list)
    names_file: bool = True
    flagged: int = 0

    def say(self, fact: str, word: str, detail: str) -> None:
        """Give a fact a word unless it has a worse one."""
        if WORDS.index(word) > WORDS.index(self.facts[fact]):
            self.facts[fact] = word
        if detail and detail not in self.details:
            self.details.append(f"{fact} {word}: {detail}")

    @property
    def word(self) -> str:
        """The worst of all facts."""
        return max(self.facts.values(), key=WORDS.index)


def judge(truth: LoggerTruth, came: Came) -> Verdict:
    """Return the verdict on what came of a whole logger."""
    found = Verdict()
    for option in came.asked:
        fact = FACT_OF.get(option)
        if fact in found.facts:
            found.say(fact, ASKED, f"asks for {option}")
    if came.refused or not any(block.accepted for block in came.blocks):
        reason = (
            came.refused
            or "; ".join({f"{block.name}: {block.status}: {block.reason}" for block in came.blocks})
            or came.said
        )
        found.names_file = any(
            PurePosixPath(path).name in reason + came.said for each in truth.files for path in each.paths
        )
        for fact in FACTS:
            found.say(fact, REFUSED, "")
        found.details.append(reason[-600:])
        return found
    _channels(truth, came, found)
    if came.rate is not None and abs(came.rate / truth.rate_hz - 1.0) > TOLERANCE:
        found.say("rate", WRONG, f"expected {truth.rate_hz:g} Hz, came {came.rate:g}")
    pairs, unread = paired(truth, came.blocks)
    for block in unread:
        found.say("times", WRONG, f"{block.name} at {block.time}: a block more than were recorded")
    for file, blocks in pairs:
        _file(truth, file, blocks, came, found)
    return found


def _channels(truth: LoggerTruth, came: Came, found: Verdict) -> None:
    if len(came.channels) != len(truth.channels):
        names = ", ".join(str(each.get("name")) for each in came.channels)
        named = sum(any(str(each.get("name")) in str(text) for text in came.problems) for each in came.channels)
        doubted = 0 < len(came.channels) - len(truth.channels) <= named
        found.say(
            "channels",
            ASKED if doubted else WRONG,
            f"expected {len(truth.channels)} of vibration, came {len(came.channels)}: {names}",
        )


def paired(
    truth: LoggerTruth, blocks: Sequence[BlockRead]
) -> tuple[list[tuple[TrueFile, list[BlockRead]]], list[BlockRead]]:
    """Return the blocks of each recording, and those of none."""
    left = list(blocks)
    pairs: list[tuple[TrueFile, list[BlockRead]]] = []
    for file in truth.files:
        own: list[BlockRead] = []
        for path in file.paths:
            fitting = [block for block in left if _is_of(block.name, path, truth)]
            if fitting:
                own.append(fitting[0])
                left.remove(fitting[0])
        pairs.append((file, own))
    return pairs, [block for block in left if block.accepted]


def _is_of(name: str, path: str, truth: LoggerTruth) -> bool:
    last = PurePosixPath(path).name
    alone = sum(PurePosixPath(each).name == last for file in truth.files for each in file.paths) == 1
    return path in name or (name in path and "/" in name) or (alone and last in name)


def _file(truth: LoggerTruth, file: TrueFile, blocks: Sequence[BlockRead], came: Came, found: Verdict) -> None:
    """Judge the blocks of a recording."""
    accepted = [block for block in blocks if block.accepted]
    if not accepted:
        if not file.lost and file.clock:
            reason = "; ".join(f"{block.status}: {block.reason}" for block in blocks) or "no block"
            found.say("channels", REFUSED, f"{file.paths[0]}: {reason}")
        return
    for block in accepted:
        _level(truth, file, block, came, found)
        _time(truth, file, block, found)
        if block.flags and not file.lost and file.clock:
            found.flagged += 1


def _level(truth: LoggerTruth, file: TrueFile, block: BlockRead, came: Came, found: Verdict) -> None:
    names = [name for name, value in block.rms.items() if np.isfinite(value)]
    order = aligned([str(each.get("column") or each.get("key") or each["name"]) for each in came.channels], truth)
    where = {str(each["name"]): position for each, position in zip(came.channels, order, strict=True)}
    own = [number for number, path in enumerate(file.paths) if _is_of(block.name, path, truth)]
    for name in names:
        position = own[0] if len(file.paths) > 1 and len(names) == 1 and own else where.get(name)
        if position is None or position >= len(truth.channels):
            continue
        channel, expected, came_rms = truth.channels[position], file.rms[position], block.rms[name]
        unknown = str(came.channels[0].get("unit")) in ("unknown", "")
        velocity = file.velocity[position] if file.velocity else None
        near = abs(came_rms / expected - 1.0) <= (TOLERANCE if velocity is None else _OF_DERIVATIVE)
        near = near or (velocity is not None and abs(came_rms / velocity - 1.0) <= TOLERANCE)
        if near or unknown or (file.lost and block.flags - _NO_LOSS):
            continue
        detail = f"{block.name}, {channel.name} in {channel.unit}{' with lost samples' if file.lost else ''}: "
        found.say("level", WRONG, f"{detail}expected RMS {expected:.4f} m/s2, came {came_rms:.4f}")


def aligned(labels: Sequence[str], truth: LoggerTruth) -> list[int | None]:
    """Return which channel of the truth each label means: by name where all are found, else by order."""

    def plain(text: str) -> str:
        return "".join(letter for letter in text.partition("[")[0].partition("(")[0].lower() if letter.isalnum())

    names = [[plain(each.key), plain(each.name)] for each in truth.channels]
    found = [next((i for i, known in enumerate(names) if plain(label) in known), None) for label in labels]
    if len(labels) == len(names) and (None in found or len(set(found)) < len(names)):
        return list(range(len(names)))
    return found


def _time(truth: LoggerTruth, file: TrueFile, block: BlockRead, found: Verdict) -> None:
    if file.start_utc is None:
        why = "not stated" if file.clock else "wrong"
        if block.time is not None and not (block.flags & _OF_CLOCK) and found.facts["times"] != ASKED:
            found.say("times", WRONG, f"{block.name}: the start is {why}, came {_date(block.time)} without a flag")
        return
    if block.time is None:
        found.say("times", MISSED, f"{block.name}: expected {_date(file.start_utc)}, came no date")
    elif abs(block.time - file.start_utc) > TOLERANCE_S and not (block.flags & _OF_CLOCK):
        found.say("times", WRONG, f"{block.name}: expected {_date(file.start_utc)}, came {_date(block.time)}")


def _date(seconds: float) -> str:
    return str(np.datetime64(round(1e3 * seconds), "ms"))


def configuration_of(truth: LoggerTruth) -> str | None:
    """Return the least configuration that a person writes who knows the logger; None where one source is not enough."""
    if any(len(each.paths) > 1 for each in truth.files):
        return None
    source = ['name = "acq"', 'url = "folder:data"', 'block_s = "file"']
    if "rate" in truth.unknowable:
        source.append(f"rate_hz = {truth.rate_hz:g}")
    tables = [f"[[source]]\n{chr(10).join(source)}"]
    keyed = truth.format in ("tdms", "hdf5", "mat", "uff", "netcdf")
    for number, each in enumerate(truth.channels, start=1):
        if keyed and each.column == number and len(truth.channels) > 1 and each.key == truth.channels[0].key:
            return None  # several rows of one matrix: which is which is said by no key
        place = (
            f'key = "{each.key}"'
            if keyed
            else f'column = "{each.name}"'
            if truth.format == "lvm"
            else f"column = {each.column}"
        )
        unit = {"m/s²": "m/s2", "m/s^2": "m/s2", "mg": "g", "mV": "V", "counts": "g", "mm/s": "m/s2"}.get(
            each.unit, each.unit
        )
        rows = [f'name = "c{number}"', 'source = "acq"', 'bearing = "b"', place, f'unit = "{unit}"']
        if each.sensitivity_mv_per_g is not None:
            rows.append(f"sensitivity_mv_per_g = {each.sensitivity_mv_per_g:g}")
        if each.scale is not None:
            rows.append(f"scale = {each.scale!r}")
        elif each.unit in ("mV", "mg") and truth.chosen.get("unit_in") == "none":
            rows.append("scale = 1e-3")
        tables.append("[[channel]]\n" + "\n".join(rows))
    head = '[machine]\nname = "m"\nstate_dir = "state"\nrecords_dir = "records"\n'
    return (
        f'{head}[[bearing]]\nname = "b"\ndesignation = "6205"\n[operating]\nspeed_hz = 24.8\n'
        + "\n".join(tables)
        + "\n"
    )


def words_for_read(truth: LoggerTruth, came: Came) -> Mapping[str, object]:
    """Return what ``sw.read`` is told: what ``init`` asked for, in the same words."""
    how: dict[str, object] = {}
    for option in came.asked:
        value = truth.answers.get(option)
        if value is None or option in ("--start-utc", "--interval-s", "--time-name", "--date-order"):
            continue
        name = option.removeprefix("--").replace("-", "_")
        how[name] = value if name == "unit" else float(value)
    if "unit" in how and "--scale" in truth.answers:
        how["scale"] = float(truth.answers["--scale"])
    if how.get("unit") == "mV":
        how |= {"unit": "V", "scale": 1e-3}
    return how
