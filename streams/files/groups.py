"""Files that are recorded at the same time, one for each channel, told by their names; and how they are read as one.

Names such as ``081500_ch1.csv`` and ``081500_ch2.csv``, ``acc_h_0001`` and ``acc_v_0001``, ``DE/1`` and ``NDE/1`` are
equal but for one word. Read one after the other they would be a channel that alternates between two sensors.
"""

from __future__ import annotations

import os
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np

from streams.files.container import read_regular
from streams.files.datasets import DataSet, FileFacts
from streams.files.judge import joint_rate
from streams.types.large import Data
from streams.types.listing import natural_key, unpacked_name
from streams.types.samples import ReaderError, Samples, stack_rows
from streams.types.spec import SourceError, SourceSpec

_MAX_GROUPS = 32
_MIN_NUMBERED, _MAX_NUMBERED = 3, 16
"""Names that end in small numbers alone may count channels from so many pairs on, up to so many channels."""
_DIRECTIONS = ({"x", "y", "z"}, {"h", "v", "a"}, {"r", "t", "a"}, {"l", "r"})
_PLACES = frozenset((
    *("de", "nde", "ds", "nds", "as", "bs", "fe", "ba", "ode", "ide", "left", "right", "links", "rechts"),
    *("hor", "ver", "vert", "horiz", "horizontal", "vertical", "vertikal", "axial", "ax", "rad", "radial", "tan"),
    *("tangential", "top", "bottom", "front", "rear", "inboard", "outboard", "motor", "pump", "gearbox", "fan"),
))  # fmt: skip
_CHANNELS = {"ch", "chn", "chan", "channel", "kanal", "canale", "canal", "sensor", "ai", "input", "mic"}
_WEAK = {"acc", "accel", "a", "c", "k", "pos", "mp", "brg", "bearing", "lager", "axis", "achse", "vib"}
_SEQUENCES = frozenset((
    *("run", "day", "tag", "test", "part", "file", "rec", "record", "measurement", "messung", "versuch", "week"),
    *("seg", "segment", "block", "no", "nr", "data", "log", "set", "month", "session", "trial", "step", "try", "v"),
    *("jan", "feb", "mar", "apr", "may", "mai", "jun", "jul", "aug", "sep", "oct", "okt", "nov", "dec", "dez"),
    *("w", "kw", "h", "t", "year"),
))  # fmt: skip


@dataclass(frozen=True)
class NameGroups:
    """Groups into which names fall.

    Attributes:
        labels: the words in which they differ.
        patterns: of each group, with ``*`` for what its names do not share.
        count: of the files of the largest group.
        is_certain: whether the words are those of channels; else the files may be a sequence.
        is_exact: whether nearly every file has its counterparts, so that they can be read together.
    """

    labels: tuple[str, ...]
    patterns: tuple[str, ...]
    count: int
    is_certain: bool
    is_exact: bool

    @property
    def words(self) -> str:
        """What is found, and what the configuration may say."""
        listed = ", ".join(f'"{pattern}"' for pattern in self.patterns)
        way = f"if they are recorded at the same time, write files = [{listed}], a channel each"
        if not self.is_exact:
            way = f"their files do not pair: give each its own [[source]] with files = one of {listed}"
        groups = f"its names fall into {len(self.labels)} groups, which would alternate in one channel"
        return f'{groups}; {way}; if one after the other, files = "*"'


def name_groups(paths: Sequence[str]) -> NameGroups | None:
    """Return the groups of files of one format by their paths; None where they are a single sequence."""
    split = [re.split(r"([/_\-. ]+)", path) for path in paths]
    if len(split) < 2 or len({tuple(parts[1::2]) for parts in split}) > 1:
        return None
    places = [place for place in range(0, len(split[0]), 2) if len({parts[place] for parts in split}) > 1]
    stems = [unpacked_name(path).rpartition(".")[0] or path for path in paths]
    ending = len(re.split(r"([/_\-. ]+)", stems[0])) if stems[0] != paths[0] else len(split[0])
    places = [place for place in places if place < ending]
    told = {place: _told_by({parts[place].lower() for parts in split}, place, ending, split) for place in places}
    for certain in (True, False):
        chosen = [place for place in places if told[place] is certain]
        found = _grouped(split, chosen, ending, certain) if chosen else None
        if found is not None:
            return found
    return None


def _told_by(low: set[str], place: int, ending: int, split: Sequence[Sequence[str]]) -> bool | None:
    """Return whether words at a place of names certainly are those of channels, None where they are something else."""
    if len(low) > _MAX_GROUPS:
        return None
    if low <= _PLACES or any(low <= known for known in (*_DIRECTIONS, set("abcd"))):
        if place == 0 and ending == 1 and all(len(word) == 1 for word in low):
            # Whole names of one letter may be anything.
            return False if low == set("xyz") else None
        return True
    head = _shared(low).rstrip("0123456789")
    rests = {word.removeprefix(head) for word in low}
    if head and any(rests <= known for known in _DIRECTIONS):
        return True
    if not head:
        return _told_by_numbers(low, place, ending, split)
    # Numbers of more digits count files.
    short = all(len(rest) < 3 if rest.isdecimal() else len(rest) == 1 for rest in rests)
    if head in _SEQUENCES or not short:
        return None
    if head in _CHANNELS:
        return True
    return None if _others(place, ending, split) < 2 else head in _WEAK


def _told_by_numbers(low: set[str], place: int, ending: int, split: Sequence[Sequence[str]]) -> bool | None:
    """Return the same of numbers alone: the word before them tells, else that they end names of several others."""
    if not place or len(low) > _MAX_NUMBERED or not all(word.isdecimal() and len(word) < 3 for word in low):
        return None
    if {parts[place - 2].lower() for parts in split} <= _CHANNELS and _others(place, ending, split) > 1:
        return True
    last = place + 1 >= ending and "/" not in split[0][place - 1]
    run = sorted(map(int, low)) in (list(range(len(low))), list(range(1, len(low) + 1)))
    return False if run and last and _others(place, ending, split) >= _MIN_NUMBERED else None


def _others(place: int, ending: int, split: Sequence[Sequence[str]]) -> int:
    """Return how many names there are without the word at a place."""
    return len({(*parts[:place], *parts[place + 1 : ending]) for parts in split})


def _grouped(split: Sequence[Sequence[str]], places: Sequence[int], ending: int, certain: bool) -> NameGroups | None:
    """Return the groups of names by the words at some places; None where one word alone is left."""
    keys: dict[tuple[str, ...], set[str]] = defaultdict(set)
    first: dict[str, str] = {}
    counts: Counter[str] = Counter()
    for parts in split:
        label = "_".join(parts[place] for place in places)
        keys[tuple(part for place, part in enumerate(parts) if place not in places)].add(label)
        counts[label] += 1
        if label not in first:
            first[label] = _pattern(parts, places, ending)
    labels = sorted(counts, key=natural_key)
    whole = sum(len(found) == len(labels) for found in keys.values())
    exact = whole > 0 and whole >= 0.8 * len(keys)
    if len(labels) < 2 or (not certain and not exact):
        return None
    patterns = tuple(first[label] for label in labels)
    return NameGroups(tuple(labels), patterns, max(counts.values()), certain, exact)


def _shared(words: Iterable[str]) -> str:
    """Return with what all words begin."""
    low, high = min(words := list(words)), max(words)
    return low[: next((place for place, letter in enumerate(low) if letter != high[place]), len(low))]


def _pattern(parts: Sequence[str], places: Sequence[int], ending: int) -> str:
    """Return the pattern of names that have the words of one at some places, and its ending."""
    text = ""
    for place, part in enumerate(parts):
        if place >= ending or place in places or (place % 2 and not text.endswith("*")):
            text += re.sub(r"([*?\[])", r"[\1]", part)
        elif place % 2 and (place + 1 in places or place + 1 >= ending):
            text += part
        elif not text.endswith("*"):
            text += "*"
    return text


def check_names(spec: SourceSpec, data_set: DataSet, paths: Callable[[], Sequence[str]]) -> str | None:
    """Return what is doubtful of the names of the files of a source, None where nothing is.

    ``paths`` gives them.

    Raises:
        SourceError: they are those of several channels, and the source does not say how they are read.
    """
    groups = None if spec.files or not data_set.plain else name_groups(paths())
    if groups is not None and groups.is_certain:
        raise SourceError(f"[[source]] {spec.name}: url: {groups.words}")
    return None if groups is None else f"doubtful: {groups.words}"


def is_member(patterns: Sequence[str], path: str) -> bool:
    """Return whether a file is read with another one: it matches a pattern behind the first."""
    return len(patterns) > 1 and any(fnmatchcase(path, pattern) for pattern in patterns[1:])


def members_of(patterns: Sequence[str], path: str) -> tuple[str, ...]:
    """Return the paths of the files that are read with one that matches the first pattern, without itself."""
    if len(patterns) < 2:
        return ()
    found = re.fullmatch(_expression(patterns[0]), path)
    if found is None:
        return ()
    return tuple(_filled(pattern, found.groups()) for pattern in patterns[1:])


def _expression(pattern: str) -> str:
    return "(.*)".join(re.escape(_plain(part)) for part in _at_stars(pattern))


def _filled(pattern: str, parts: Sequence[str]) -> str:
    constant = [_plain(part) for part in _at_stars(pattern)]
    return constant[0] + "".join(part + rest for part, rest in zip(parts, constant[1:], strict=True))


def _at_stars(pattern: str) -> list[str]:
    return re.split(r"(?<!\[)\*(?!\])", pattern)


def _plain(text: str) -> str:
    return re.sub(r"\[([*?\[])\]", r"\1", text)


def not_read(patterns: Sequence[str], paths: Iterable[str], leads: Iterable[str]) -> list[str]:
    """Return those of some paths that are not read with a file among ``leads``."""
    read = {member for lead in leads for member in members_of(patterns, lead)}
    return [path for path in paths if path not in read]


def with_files(data_set: DataSet, spec: SourceSpec, root: Path) -> DataSet:
    """Return the data set with the files alone that match the patterns of a source; several are read as one.

    The file of the first pattern stands for all: its path names and dates them. Rows have the words in which the
    patterns differ for names.
    """

    def facts(path: str, place: str, zone: ZoneInfo) -> FileFacts | None:
        return data_set.facts(path, place, zone) if fnmatchcase(path, spec.files[0]) else None

    def read(data: Data, path: str) -> Samples:
        parts = [data_set.read(data, path)]
        members = members_of(spec.files, path)
        parts += [_read_member(data_set, root, member, path) for member in members]
        return joined(parts, labels_of(spec.files), (path, *members)) if members else parts[0]

    return replace(data_set, facts=facts, read=read, files=", ".join(spec.files))


def _read_member(data_set: DataSet, root: Path, member: str, path: str) -> Samples:
    if not os.path.lexists(f"{root}/{member}"):
        raise ReaderError("incomplete", f"{path}: {member}, which is recorded with it, is not there")
    try:
        return data_set.read(read_regular(root, member), member)
    except ReaderError as error:
        # These words are of the first file: it has neither changed nor broken off.
        status = "unreadable" if error.status in ("changed", "incomplete", "empty") else error.status
        raise ReaderError(status, f"{path}: {error}") from error


def labels_of(patterns: Sequence[str]) -> tuple[str, ...]:
    """Return the words in which patterns differ."""
    head = _shared(patterns)
    head = head[: max(map(head.rfind, "/_-. *")) + 1]
    rests = [pattern.removeprefix(head) for pattern in patterns]
    tail = _shared([rest[::-1] for rest in rests])[::-1]
    begins = [place for place in map(tail.find, "/_-. *") if place >= 0]
    tail = tail[min(begins) :] if begins else ""
    found = tuple(_plain(rest.removesuffix(tail)).strip("/_-. *").replace("*", "") for rest in rests)
    return found if all(found) and len(set(found)) == len(found) else tuple(map(str, range(1, len(rests) + 1)))


def joined(parts: Sequence[Samples], labels: Sequence[str], paths: Sequence[str]) -> Samples:
    """Return the rows of files that were recorded at the same time as those of one.

    Raises:
        ReaderError: ``wrong_rate`` or ``wrong_shape`` where rates, lengths or starts differ; it quotes both.
    """
    first, rate = parts[0], parts[0].rate
    for path, part in zip(paths[1:], parts[1:], strict=True):
        rate = joint_rate(((paths[0], rate), (path, part.rate)), paths[0])
        lengths = first.values.shape[1], part.values.shape[1]
        if lengths[0] != lengths[1]:
            reason = f"{lengths[0]} samples, {lengths[1]} in {path}, which is recorded with it"
            raise ReaderError("wrong_shape", f"{paths[0]}: {reason}")
        apart = 0.0 if first.start is None or part.start is None else abs(first.start - part.start)
        if apart > (1.0 / rate if rate else 0.0) + 1e-6:
            reason = f"begins {apart:.6g} s apart from {path}, which is read with it"
            raise ReaderError("wrong_shape", f"{paths[0]}: {reason}")
    names, channels = [], []
    for label, part in zip(labels, parts, strict=True):
        alone = len(part.names) == 1
        names += [f"{label}/{name}" for name in part.names]
        channels += [label] if alone else [f"{label}/{name}" for name in part.channels]
    wide = max((part.values.dtype for part in parts), key=lambda dtype: dtype.itemsize)
    rows = [row if row.dtype == wide else np.asarray(row, wide) for part in parts for row in part.values]
    return replace(
        first,
        values=stack_rows(rows),
        names=tuple(names),
        channels=tuple(channels),
        columns=tuple(range(1, len(rows) + 1)),
        units=tuple(unit for part in parts for unit in part.units),
        stored=tuple(stored for part in parts for stored in part.stored),
        sensitivities=tuple(level for part in parts for level in part.sensitivities),
        count_scales=tuple(scale for part in parts for scale in part.count_scales),
        rate=rate,
        start=next((part.start for part in parts if part.start is not None), None),
        speed=next((part.speed for part in parts if part.speed is not None), None),
        load=next((part.load for part in parts if part.load is not None), None),
        pulses=next((part.pulses for part in parts if part.pulses is not None), None),
        hashed=len(first.names),
    )
