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
from streams.files.notes import note_paths
from streams.files.sidecar import is_pulse_file, pulse_file_of, sidecar_paths
from streams.types.large import Data
from streams.types.listing import natural_key, unpacked_name
from streams.types.samples import ReaderError, Samples, one_after_another, stack_rows
from streams.types.spec import WILD, SourceError, SourceSpec

_SEPARATORS = "/_-. ()[]{}+@,=#&~"
_SPLIT = re.compile(
    rf"([{re.escape(_SEPARATORS)}]+|(?<=\d)(?=(?:n?de|n?ds|[xyz]|hor|ver)(?:[{re.escape(_SEPARATORS)}]|$)))",
    re.IGNORECASE,
)
"""What divides a path into words: separators, and a digit before the word of a place or an axis, as in ``vib1DE``."""
_DIGIT = "[0-9]"
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
    split = [_SPLIT.split(path) for path in paths]
    if len(split) < 2 or len({tuple(parts[1::2]) for parts in split}) > 1:
        return None
    places = [place for place in range(0, len(split[0]), 2) if len({parts[place] for parts in split}) > 1]
    stems = [unpacked_name(path).rpartition(".")[0] or path for path in paths]
    ending = len(_SPLIT.split(stems[0].rstrip(_SEPARATORS))) if stems[0] != paths[0] else len(split[0])
    places = [place for place in places if place < ending]
    words = {place: {parts[place].lower() for parts in split} for place in places}
    named = [place for place in places if _is_named(words[place], alone=ending == 1)]

    def others(place: int) -> int:
        """Return how many names there are without the word at a place and those that name channels."""
        left = [other for other in places if other != place and other not in named]
        return len({tuple(parts[other] for other in left) for parts in split})

    told: dict[int, bool | None] = {}
    for place in places:
        before = {parts[place - 2].lower() for parts in split} if place else set[str]()
        is_end = place + 1 >= ending and place > 0 and "/" not in split[0][place - 1]
        by_count = None if place in named else _told_by_count(words[place], before, is_end, lambda at=place: others(at))
        told[place] = True if place in named else by_count
    if ending == 1 and words.get(0) == set("xyz"):
        # Whole names of one letter may be anything.
        told[0] = False
    for certain in (True, False):
        chosen = [place for place in places if told[place] is certain]
        found = _grouped(split, chosen, ending, certain) if chosen else None
        if found is not None:
            return found
    return None


def _is_named(low: set[str], *, alone: bool) -> bool:
    """Return whether words at a place of names are those of channels or axes; ``alone``: they are whole names."""
    if len(low) > _MAX_GROUPS:
        return False
    if low <= _PLACES or any(low <= known for known in (*_DIRECTIONS, set("abcd"))):
        return not (alone and all(len(word) == 1 for word in low))
    head, rests, short = _parted(low)
    return bool(head) and (any(rests <= known for known in _DIRECTIONS) or (head in _CHANNELS and short))


def _parted(low: set[str]) -> tuple[str, set[str], bool]:
    """Return with what words begin, their ends, and whether these are short: numbers of more digits count files."""
    head = _shared(low).rstrip("0123456789")
    rests = {word.removeprefix(head) for word in low}
    return head, rests, all(len(rest) < 3 if rest.isdecimal() else len(rest) == 1 for rest in rests)


def _told_by_count(low: set[str], before: set[str], is_end: bool, others: Callable[[], int]) -> bool | None:
    """Return whether words that name no channel are those of channels: None they are not, False they may be.

    Args:
        before: the words before them.
        is_end: whether a name of several words ends with them.
        others: gives how many names there are without them.
    """
    if len(low) > _MAX_GROUPS:
        return None
    head, _, short = _parted(low)
    if head:
        return None if head in _SEQUENCES or not short or others() < 2 else head in _WEAK
    if len(low) > _MAX_NUMBERED or not all(word.isdecimal() and len(word) < 3 for word in low):
        return None
    if before and before <= _CHANNELS and others() > 1:
        return True
    run = sorted(map(int, low)) in (list(range(len(low))), list(range(1, len(low) + 1)))
    return False if run and is_end and others() >= _MIN_NUMBERED else None


def _grouped(split: Sequence[Sequence[str]], places: Sequence[int], ending: int, certain: bool) -> NameGroups | None:
    """Return the groups of names by the words at some places; None where one word alone is left."""
    keys: dict[tuple[str, ...], set[str]] = defaultdict(set)
    first: dict[str, str] = {}
    samples: list[str] = []
    counts: Counter[str] = Counter()
    for parts in split:
        label = "_".join(parts[place] for place in places)
        keys[tuple(part for place, part in enumerate(parts) if place not in places)].add(label)
        counts[label] += 1
        if label not in first:
            first[label] = _pattern(parts, places, ending)
            samples.append("".join(parts))
    labels = sorted(counts, key=natural_key)
    whole = sum(len(found) == len(labels) for found in keys.values())
    exact = whole > 0 and whole >= 0.8 * len(keys)
    if len(labels) < 2 or (not certain and not exact):
        return None
    patterns = tuple(first[label] for label in labels)
    # A pattern that takes the names of another group cannot tell them apart.
    exact &= all(sum(fnmatchcase(path, pattern) for pattern in patterns) == 1 for path in samples)
    return NameGroups(tuple(labels), patterns, max(counts.values()), certain, exact)


def _shared(words: Iterable[str]) -> str:
    """Return with what all words begin."""
    low, high = min(words := list(words)), max(words)
    return low[: next((place for place, letter in enumerate(low) if letter != high[place]), len(low))]


def _pattern(parts: Sequence[str], places: Sequence[int], ending: int) -> str:
    """Return the pattern of names that have the words of one at some places, and its ending."""
    text = ""
    # A number means nothing without the word before it.
    places = [
        *places,
        *(place - 2 for place in places if place > 1 and parts[place].isdecimal() and parts[place - 2].isalpha()),
    ]
    for place, part in enumerate(parts):
        is_kept = place % 2 and (place + 1 in places or place + 1 >= ending or not text.endswith("*"))
        if is_kept and not part and place + 1 in places and text.endswith("*"):
            text += _DIGIT
        elif place >= ending or place in places or is_kept:
            text += re.sub(r"([*?\[])", r"[\1]", part)
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
    signs = {"*": "(.*)", _DIGIT: "([0-9])"}
    return "".join(signs.get(part) or re.escape(_plain(part)) for part in WILD.split(pattern))


def _filled(pattern: str, parts: Sequence[str]) -> str:
    constant = [_plain(part) for part in WILD.split(pattern)[::2]]
    return constant[0] + "".join(part + rest for part, rest in zip(parts, constant[1:], strict=True))


def _plain(text: str) -> str:
    return re.sub(r"\[([*?\[])\]", r"\1", text)


@dataclass(frozen=True)
class FilesBeside:
    """Which files are read with another, wherever they are: the patterns of a source.

    Attributes:
        pulses: of its files of pulses, None: there are none.
        files: of those that are read together.
    """

    pulses: str | None = None
    files: Sequence[str] = ()

    def awaited(self, path: str) -> tuple[str, ...]:
        """Return those without which a file is not read at once: of other channels, and of pulses."""
        marks = pulse_file_of(self.pulses, path)
        return (*members_of(self.files, path), *(() if marks is None else (marks,)))

    def all(self, path: str) -> list[str]:
        """Return all that may be there, with the side-cars and notes of each."""
        together = (path, *members_of(self.files, path))
        beside = [(*sidecar_paths(one), *note_paths(one), *self.awaited(one)) for one in together]
        return list(dict.fromkeys(name for names in beside for name in names if name != path))

    def has(self, path: str) -> bool:
        """Return whether a file is read with another: one of pulses, or of another channel."""
        return is_pulse_file(self.pulses, path) or is_member(self.files, path)


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
    plain = [_plain(pattern) for pattern in patterns]
    head = _shared(plain)
    head = head[: max(map(head.rfind, f"{_SEPARATORS}*")) + 1]
    rests = [pattern.removeprefix(head) for pattern in plain]
    tail = _shared([rest[::-1] for rest in rests])[::-1]
    begins = [place for place in map(tail.find, f"{_SEPARATORS}*") if place >= 0]
    tail = tail[min(begins) :] if begins else ""
    found = tuple(rest.removesuffix(tail).strip(f"{_SEPARATORS}*").replace("*", "") for rest in rests)
    return found if all(found) and len(set(found)) == len(found) else tuple(map(str, range(1, len(rests) + 1)))


def joined(parts: Sequence[Samples], labels: Sequence[str], paths: Sequence[str]) -> Samples:
    """Return the rows of files that were recorded at the same time as those of one.

    Raises:
        ReaderError: ``wrong_rate`` or ``wrong_shape`` where rates, lengths or starts differ; it quotes both.
    """
    if any(part.following or part.torn for part in parts):
        counts = {len(part.recordings) for part in parts}
        if len(counts) > 1:
            reason = f"files that are read together hold different numbers of recordings: {sorted(counts)}"
            raise ReaderError("wrong_shape", f"{paths[0]}: {reason}")
        both = zip(*([replace(one, torn=()) for one in part.recordings] for part in parts), strict=True)
        torn = [f"{path}: {reason}" for path, part in zip(paths, parts, strict=True) for reason in part.torn]
        return one_after_another([joined(of_one_time, labels, paths) for of_one_time in both], torn)
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
        open_gain=next((part.open_gain for part in parts if part.open_gain), None),
        open_multiplier=next((part.open_multiplier for part in parts if part.open_multiplier), ""),
        unlisted=tuple(dict.fromkeys(one for part in parts for one in part.unlisted)),
        rate=rate,
        start=next((part.start for part in parts if part.start is not None), None),
        speed=next((part.speed for part in parts if part.speed is not None), None),
        load=next((part.load for part in parts if part.load is not None), None),
        pulses=next((part.pulses for part in parts if part.pulses is not None), None),
        hashed=len(first.names),
    )
