"""A recording as a source: its files in the order of acquisition, each read, checked and cut to blocks."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from zoneinfo import ZoneInfo

from streams.block import Block, Rejected
from streams.blocks import TAIL, agreed_rate, choose_rows, content_hash
from streams.datasets.description import DataSet, FileFacts
from streams.files import Files, Item, open_files, unpack
from streams.readers.reading import ReaderError, Reading
from streams.reblock import Chunk, Cut, Reblocker, began_at, cut_item, elapsed_at
from streams.recognise import data_set_of
from streams.spec import SourceError, SourceSpec


@dataclass(frozen=True, eq=False)
class _Loaded:
    """A file that has been read, or why not."""

    path: str
    facts: FileFacts
    reading: Reading | None = None
    error: ReaderError | None = None
    digest: str = ""


@dataclass(frozen=True, eq=False)
class _Origin:
    """A file that samples are of: its path and the number of its samples."""

    path: str
    total: int


class Recording:
    """The blocks of a recording, the same as of a followed folder with the same files.

    A folder's files are sorted first. An archive is read in one pass: a file that comes before its turn is held back
    until those before it have come (where the files are numbered without gaps nothing else is needed; elsewhere the
    names are listed first, which decompresses the archive once more).
    """

    def __init__(self, spec: SourceSpec, files: Files, data_set: DataSet) -> None:
        """Take the files of a data set; :func:`open_recording` finds out both."""
        self.name = spec.name
        self._spec = spec
        self._files = files
        self._set = data_set
        self._zone = ZoneInfo(spec.timezone)
        self._count: int | None = None
        self._block_s = None if data_set.snapshot or spec.block_s == "file" else spec.block_s
        self._check()

    def __len__(self) -> int:
        """Return the number of blocks, rejected ones included; it is found by one pass over the recording."""
        if self._count is None:
            self._count = self._count_files() if self._block_s is None else sum(1 for _ in self._cuts(self._block_s))
        return self._count

    def _count_files(self) -> int:
        """Count one block a file: like an iteration, but without parsing."""
        count = 0
        try:
            for item in self._files:
                if self._facts(item.path) is None:
                    continue
                count += 1
                if self._files.sequential:
                    # An archive that is damaged ends at the member that cannot be read.
                    with contextlib.suppress(ReaderError):
                        item.read()
        except ReaderError:
            count += 1
        return count

    def __iter__(self) -> Iterator[Block | Rejected]:
        """Iterate over the blocks from the first one on."""
        sequence = 0
        began: float | None = None
        made: Iterable[Cut | Rejected | _Loaded] = self._in_order()
        if self._block_s is not None:
            made = self._cuts(self._block_s)
        for part in made:
            if isinstance(part, Rejected):
                item: Block | Rejected = replace(part, sequence=sequence + 1)
            elif isinstance(part, _Loaded):
                item = self._whole(part, sequence + 1, began)
            else:
                origin = part.first[0]
                path, total = (origin.path, origin.total) if isinstance(origin, _Origin) else ("", 0)
                item = cut_item(part, self.name, sequence + 1, path, total, began)
            sequence = max(sequence, item.sequence)
            began = began_at(began, item)
            yield item

    def _facts(self, path: str) -> FileFacts | None:
        return self._set.facts(path, str(self._files.root), self._zone)

    def _check(self) -> None:
        """Refuse at once what no block could come of."""
        where = f"[[source]] {self.name}"
        first: FileFacts | None = None
        reading: Reading | None = None
        try:
            for item in self._files:
                first = self._facts(item.path)
                if first is not None:
                    reading = self._peek(item, first)
                    break
        except ReaderError as error:
            raise SourceError(f"{where}: url: {error}") from error
        if first is None:
            place = "holds no file" if self._files.several else "is not a file"
            raise SourceError(f"{where}: url: {self._files.root} {place} of {self._set.name} ({self._set.files})")
        states_rate = self._set.states_rate and (reading is None or reading.rate is not None)
        if first.rate is None and not states_rate and self._spec.rate is None:
            raise SourceError(f"{where}: rate_hz is missing: neither the files nor {self._set.name} state a rate")
        states_unit = self._set.states_unit and (
            reading is None or reading.unit is not None or any(unit is not None for unit in reading.units)
        )
        if self._set.unit is None and not states_unit and not self._spec.channels:
            raise SourceError(f"{where}: a [[channel]] with its unit is missing: these files do not state one")
        for channel in self._spec.channels:
            stated = self._set.unit
            if stated is None and channel.unit is None and not states_unit:
                raise SourceError(f"[[channel]] {channel.name}: unit is missing: the files of {self.name} state none")
            if channel.unit is not None and stated not in (None, "unknown", channel.unit):
                raise SourceError(
                    f"[[channel]] {channel.name}: unit is {channel.unit!r}, but {self._set.name} is in {stated}"
                )

    def _peek(self, item: Item, facts: FileFacts) -> Reading | None:
        """Read the first file where only it can state rate or unit; None where there is no need or no sense in it."""
        configured = bool(self._spec.channels) and all(channel.unit is not None for channel in self._spec.channels)
        rate_known = facts.rate is not None or self._spec.rate is not None or not self._set.states_rate
        unit_known = self._set.unit is not None or configured or not self._set.states_unit
        return None if rate_known and unit_known else self._load(item, facts).reading

    def _in_order(self) -> Iterator[_Loaded]:
        if not self._files.sequential:
            known = [(facts, item) for item in self._files if (facts := self._facts(item.path)) is not None]
            _one_run([item.path for _, item in known], self.name, self._set)
            known.sort(key=lambda pair: pair[0].order)
            seen: set[tuple[object, ...]] = set()
            for facts, item in known:
                yield self._load(item, facts, facts.order in seen and self._set.snapshot)
                seen.add(facts.order)
            return
        yield from self._in_order_of_archive()

    def _in_order_of_archive(self) -> Iterator[_Loaded]:
        wanted: Iterator[tuple[object, ...]] = (
            ((number,) for number in itertools.count(1)) if self._set.counted else iter(self._listed_orders())
        )
        following = next(wanted, None)
        held: dict[tuple[object, ...], _Loaded] = {}
        done: set[tuple[object, ...]] = set()
        paths: list[str] = []
        trouble: _Loaded | None = None
        stream = iter(self._files)
        while True:
            try:
                item = next(stream, None)
            except ReaderError as error:
                trouble = _Loaded(self._files.root.name, FileFacts(()), error=error)
                break
            if item is None:
                break
            facts = self._facts(item.path)
            if facts is None:
                continue
            paths = _one_run([*paths[:1], item.path], self.name, self._set)
            if facts.order in done or facts.order in held:
                yield self._load(item, facts, repeated=True)
                continue
            held[facts.order] = self._load(item, facts)
            while following is not None and following in held:
                done.add(following)
                yield held.pop(following)
                following = next(wanted, None)
        for order in sorted(held):
            yield held[order]
        if trouble is not None:
            yield trouble

    def _listed_orders(self) -> list[tuple[object, ...]]:
        orders: set[tuple[object, ...]] = set()
        # The pass that reads meets any damage again and reports it.
        with contextlib.suppress(ReaderError):
            for item in self._files:
                facts = self._facts(item.path)
                if facts is not None:
                    orders.add(facts.order)
        return sorted(orders)

    def _load(self, item: Item, facts: FileFacts, repeated: bool = False) -> _Loaded:
        """Read a file; whatever is wrong with it becomes a status."""
        if repeated:
            error = ReaderError("duplicate", f"{item.path}: another file of the same number or time came before")
            return _Loaded(item.path, facts, error=error)
        digest = ""
        try:
            raw = item.read()
            digest = content_hash(raw)
            data = unpack(raw, item.path)
            if not data:
                raise ReaderError("empty", f"{item.path}: the file has 0 bytes")
            return _Loaded(item.path, facts, self._set.read(data, item.path), digest=digest)
        except ReaderError as error:
            return _Loaded(item.path, facts, error=error, digest=digest)

    def _chunk(self, loaded: _Loaded) -> Chunk:
        """Return the samples of a file and what is known of them.

        Raises:
            ReaderError: it could not be read, or is not what was configured.
        """
        reading, facts = loaded.reading, loaded.facts
        if reading is None:
            raise loaded.error or ReaderError("unreadable", f"{loaded.path}: was not read")
        self._check_length(reading, loaded.path)
        rows = choose_rows(reading, self._spec.channels, self._set.unit, loaded.path)
        rate = agreed_rate((reading.rate, facts.rate), self._spec.rate, loaded.path)
        start, elapsed = self._times(loaded)
        return Chunk(
            samples=reading.samples[[row.index for row in rows]],
            rate=rate,
            channels=tuple(row.channel for row in rows),
            units=tuple(row.unit for row in rows),
            start=start,
            origin=_Origin(loaded.path, reading.samples.shape[1]),
            elapsed=elapsed,
            speed=reading.speed if reading.speed is not None else facts.speed,
            load=reading.load if reading.load is not None else facts.load,
        )

    def _cuts(self, block_s: float) -> Iterator[Cut | Rejected]:
        """Give what the files are cut to, and the rejections of those that cannot be read, numbered by the caller."""
        cutter = Reblocker(block_s)
        for loaded in self._in_order():
            try:
                chunk = self._chunk(loaded)
            except ReaderError as error:
                # Nothing may be joined over a file that could not be read.
                yield from cutter.flush()
                yield Rejected(self.name, 0, loaded.path, error.status, str(error), loaded.digest)
                continue
            yield from cutter.feed(chunk)
            if chunk.start is None:
                yield from cutter.flush()
        yield from cutter.flush()

    def _whole(self, loaded: _Loaded, sequence: int, began: float | None) -> Block | Rejected:
        """Return the one block of a file, under its own number where it has one, or the rejection in its place."""
        number = sequence if loaded.facts.number is None else loaded.facts.number
        try:
            chunk = self._chunk(loaded)
        except ReaderError as error:
            return Rejected(self.name, number, loaded.path, error.status, str(error), loaded.digest)
        return Block(
            samples=chunk.samples,
            rate=chunk.rate,
            channels=chunk.channels,
            units=chunk.units,
            source=self.name,
            sequence=number,
            name=loaded.path,
            start=chunk.start,
            elapsed=elapsed_at(chunk.start, chunk.elapsed, began),
            speed=chunk.speed,
            load=chunk.load,
            content_hash=loaded.digest,
        )

    def _check_length(self, reading: Reading, path: str) -> None:
        expected, found = self._set.samples, reading.samples.shape[1]
        if expected is None:
            return
        if found < TAIL * expected:
            raise ReaderError("short", f"{path}: {found} samples, {expected} were expected")
        if found > expected:
            raise ReaderError("wrong_shape", f"{path}: {found} samples, {expected} were expected")

    def _times(self, loaded: _Loaded) -> tuple[float | None, float | None]:
        """Return (start, elapsed) of the first sample of a file; of a dated one elapsed is for the start to say.

        The stamp of a file goes before the configured start. Without stamps and without numbers in known intervals
        nothing says how much time lies between two files, so only a recording of one file has times then.
        """
        facts, stamp = loaded.facts, _start_of(loaded)
        if stamp is not None:
            return stamp, None
        if facts.elapsed is None and self._files.several:
            return None, None
        elapsed = facts.elapsed or 0.0
        return None if self._spec.start is None else self._spec.start + elapsed, elapsed


def _start_of(loaded: _Loaded) -> float | None:
    """Return when a file begins: by its name, else by what it or its side-car states."""
    if loaded.facts.start is not None or loaded.reading is None:
        return loaded.facts.start
    return loaded.reading.start


def _one_run(paths: Iterable[str], name: str, data_set: DataSet) -> list[str]:
    """Refuse the files of several runs at once: their numbers or times would be mixed."""
    kept = list(paths)
    if data_set.snapshot:
        folders = sorted({path.rpartition("/")[0] or "." for path in kept})
        if len(folders) > 1:
            shown = ", ".join(folders[:5])
            raise SourceError(f"[[source]] {name}: url: holds several runs ({shown}); name the folder of one of them")
    return kept


def open_recording(spec: SourceSpec, path: str, kind: str, must_be_folder: bool = False) -> Recording:
    """Open a recording.

    Args:
        spec: the configuration of the source.
        path: a file, a folder or a tar archive.
        kind: name of a data set or of a format, or "auto": recognised by what is there.
        must_be_folder: whether nothing but a folder will do.

    Returns:
        The recording.

    Raises:
        SourceError: as :func:`streams.source.open_source`.
    """
    files = open_files(spec.name, path, must_be_folder)
    return Recording(spec, files, data_set_of(spec, files, kind))
