"""A recording as a source: files in order of acquisition, cut into blocks."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterable, Iterator

from streams.dates.dater import Dater
from streams.dates.dating import Dating
from streams.dates.excursions import Steps
from streams.dates.order import UndatedError
from streams.files.container import Files, Item, hash_of_file, open_files
from streams.files.datasets import DataSet, FileFacts
from streams.files.groups import check_names, not_read
from streams.files.load import Loader, cutter_of, is_cut, is_dated_by_choice, renamed
from streams.files.recognise import check_stated, data_set_of, one_run
from streams.files.sidecar import is_pulse_file, is_sidecar
from streams.reblock import Cut, Reblocker
from streams.recording.repeats import Loaded, Met, reordered
from streams.recording.state import VERSION, ReadingState, RecordingPass, names_digest
from streams.types.block import Block, Rejected
from streams.types.listing import CLOSED, natural_key, shown
from streams.types.samples import Origin, ReaderError, Samples
from streams.types.source import MAX_IGNORED_NAMES, Backlog
from streams.types.spec import SourceError, SourceSpec
from streams.types.stamps import date_folders


class Recording:
    """The blocks of a recording, equal to those of a folder with the same files.

    A folder's files are sorted first. An archive is read in one pass: a file stored too early is held back until those
    before it are read. Where the files are not numbered without gaps, a pass before lists the names.
    """

    def __init__(
        self,
        spec: SourceSpec,
        files: Files,
        data_set: DataSet,
        kept: Dating | None = None,
        begin: ReadingState | None = None,
    ) -> None:
        """Take the files of a data set, ``kept`` what dates them; SourceError where no block can come of them.

        Each iteration goes on from ``begin``, and opens none of the files behind it.
        """
        self.name = spec.name
        self._spec = spec
        self._files = files
        self._set = data_set
        self._dater: Dater | None = None
        cut = is_cut(spec, data_set)
        if is_dated_by_choice(spec, data_set):
            above = date_folders(str(files.root.parent if files.sequential else files.root))
            self._dater = Dater(
                spec, kept, cut=cut, several=files.several, names=self._listed, changes=self._changes, above=above
            )
            self._dater.remarks |= {} if begin is None else begin.remarks
        self._loader = Loader(spec, data_set, files.root, several=files.several, dater=self._dater)
        self._count: int | None = None
        self._met: Met | None = None
        self._block_s = spec.block_s if cut and spec.block_s != "file" else None
        self._begin = begin
        self._knows_starts = False
        self._reading = self._new_reading()
        if begin is None:
            self._check()
        self._settle_dating()

    @property
    def dating(self) -> Dating | None:
        """What dates the blocks; None before it is chosen, and where the data set states it."""
        return None if self._dater is None or self._dater.choice.by is None else self._dater.choice

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences about what has no date, and what of the configuration is not used for it."""
        return () if self._dater is None else tuple(self._dater.remarks.values())

    def _listed(self) -> list[str]:
        """Return the paths of the files of the data set, listed once."""
        return list(self._met_files().known)

    def _changes(self) -> dict[str, float]:
        """Return the times of the last changes of the files, s since 1970 UTC."""
        with contextlib.suppress(ReaderError):
            changed = {item.path: item.changed() for _, item in self._known()}
            return {path: time for path, time in changed.items() if time is not None}
        return {}

    def _settle_dating(self) -> None:
        """Choose what dates the files by the first that can be read, and the order of day and month by all.

        Raises:
            SourceError: the order stays open, or files disagree.
        """
        if self._dater is None or not self._files.several:
            return
        first: Samples | None = None
        try:
            if self._dater.choice.by is None:
                # The iteration reports where an archive breaks off.
                with contextlib.suppress(ReaderError):
                    first = self._first_readable(self._dater)
            self._dater.check_names()
        except UndatedError as error:
            raise self._undated(error) from error
        if first is not None and self._dater.depends_on_order(first):
            self._settle_order(self._dater)

    def _first_readable(self, dater: Dater) -> Samples | None:
        """Load the first file that can be read, for which the choice is made; None where there is none."""
        known = iter(sorted(self._known(), key=lambda pair: pair[0].order)) if not self._files.sequential else None
        for facts, item in known or self._known():
            if facts.start is not None or facts.elapsed is not None:
                return None
            try:
                samples = self._loader.load_undated(item.read(), item.path, facts, item.path)
            except ReaderError:
                continue
            with contextlib.suppress(UndatedError):
                dater.date(samples, item.path, item.changed())
            return samples
        return None

    def _settle_order(self, dater: Dater) -> None:
        """Read the dates in the headers of all files."""
        failed: dict[str, UndatedError] = {}
        with contextlib.suppress(ReaderError):
            for facts, item in self._known():
                try:
                    self._loader.load(item.read(), item.path, facts, changed=item.changed())
                except ReaderError:
                    continue
                except UndatedError as error:
                    failed[item.path] = error
        wrong = dater.order.conflicts or (tuple(failed) if dater.choice.order is None else ())
        if wrong:
            raise self._undated(failed[wrong[0]])

    def _undated(self, error: UndatedError) -> SourceError:
        return SourceError(f"[[source]] {self.name}: {error}")

    def __len__(self) -> int:
        """Return the number of blocks and rejections, found by one pass; where each file is a block, that of files,

        until an iteration has found which of them hold several recordings.
        """
        if self._count is None:
            one_a_file = self._block_s is None
            self._count = self._count_files() if one_a_file else sum(1 for _ in self._parts(self._new_reading()))
        return self._count

    def has_blocks(self, count: int) -> bool:
        """Return whether there are so many blocks and rejections, without reading on behind them."""
        known = self._count is not None or self._block_s is None
        # Files of a plain format may hold several recordings.
        if known and (len(self) >= count or self._block_s is not None or not self._set.plain):
            return len(self) >= count
        return sum(1 for _ in itertools.islice(self._items(self._new_reading()), count)) >= count

    def state(self) -> ReadingState | None:
        """Return the state after the latest item, from which another :class:`Recording` goes on.

        None before the first item, and where the files come in the order of an archive.
        """
        return self._reading.state(self._set.name, self._set.endings)

    def levels(self) -> dict[str, str]:
        """Return in words what states the level of each channel in the first file that can be read."""
        for _, item in self._known():
            with contextlib.suppress(ReaderError):
                return self._loader.levels(item.read(), item.path)
        return {}

    def ends(self) -> list[Loaded]:
        """Load the first and the last recording of all files, of an archive, which is read in its order, the first."""
        if self._files.sequential:
            return list(self.first_files(1))
        known = sorted(self._known(), key=_in_order_of_name)
        loaded = [self._load(item, facts) for facts, item in (known if len(known) < 2 else (known[0], known[-1]))]
        found = [recording for file in loaded for recording in file.recordings]
        return found if len(found) < 2 else [found[0], found[-1]]

    def first_files(self, count: int) -> Iterator[Loaded]:
        """Load the first files, or recordings where a file holds several, at most ``count``."""
        known = self._known() if self._files.sequential else sorted(self._known(), key=_in_order_of_name)
        loaded = (self._load(item, facts) for facts, item in itertools.islice(known, count))
        yield from itertools.islice(itertools.chain.from_iterable(each.recordings for each in loaded), count)

    def files(self) -> Backlog:
        """Return the counts of files: those that the latest iteration has not given are pending."""
        met, given = self._met_files(), self._reading.given
        ignored = len(self._ignored_paths())
        offered = len(met.known) + ignored + met.damaged
        return Backlog(
            offered=offered,
            accepted=given.accepted,
            rejected=given.rejected,
            pending=offered - ignored - given.accepted - given.rejected,
            oldest_age_s=0.0,
            ignored=ignored,
        )

    def ignored(self) -> dict[str, str]:
        """Return why files are ignored, by name, at most ``MAX_IGNORED_NAMES``."""
        root = None if self._files.sequential else self._files.root
        return {shown(p): self._loader.reason_to_ignore(p, root) for p in self._ignored_paths()[:MAX_IGNORED_NAMES]}

    def closed(self) -> dict[str, str]:
        """Return why folders below it are left out, by name."""
        return {shown(path): CLOSED for path in self._files.closed}

    def _ignored_paths(self) -> list[str]:
        met = self._met_files()
        if self._files.sequential:
            return sorted(met.others, key=natural_key)
        others = not_read(self._spec.files, met.others, met.known)
        return [
            path for path in others if not is_pulse_file(self._spec.pulses, path) and not is_sidecar(path, met.known)
        ]

    def _met_files(self) -> Met:
        if self._met is None:
            with contextlib.suppress(ReaderError):
                for _ in self._known():
                    pass
        return self._met or Met()

    def _known(self) -> Iterator[tuple[FileFacts, Item]]:
        """Yield the files of the data set; ReaderError where an archive breaks off."""
        met = Met()
        try:
            for item in self._files:
                facts = self._loader.facts(item.path)
                if facts is None:
                    met.others.append(item.path)
                else:
                    met.known[item.path] = None
                    yield facts, item
        except ReaderError:
            met.damaged = 1
            self._met = met
            raise
        self._met = met

    def _count_files(self) -> int:
        """Count one block a file, without parsing."""
        if not self._files.sequential:
            return len(self._met_files().known)
        count = 0
        try:
            for _, item in self._known():
                count += 1
                # An archive that is damaged ends at the member that cannot be read.
                with contextlib.suppress(ReaderError):
                    item.read()
        except ReaderError:
            count += 1
        return count

    def __iter__(self) -> Iterator[Block | Rejected]:
        """Iterate over the blocks from the first one on, or from the state given; repetitions before it come first."""
        reading = self._reading = self._new_reading()
        yield from tuple(reading.repetitions)
        known = 0 if self._begin is None else self._begin.items
        count = 0
        for count, item in enumerate(self._items(reading), 1):
            if count > known:
                if isinstance(item, Rejected) and item.is_repetition:
                    reading.repetitions.append(item)
                yield item
        if self._begin is None:
            self._count = count

    def _new_reading(self) -> RecordingPass:
        return RecordingPass(self.name, self._dater, cutter_of(self._spec, self._set), self._begin)

    def _items(self, reading: RecordingPass) -> Iterator[Block | Rejected]:
        for part in self._parts(reading):
            if isinstance(part, Cut):
                reading.given.note_cut(part)
                items: Iterable[Block | Rejected] = (reading.numbers.cut(part),)
            else:
                number = part.facts.number if self._block_s is None else None
                if isinstance(part.result, Samples) and reading.cutter is not None:
                    items = reading.numbers.torn(part.result, part.name)
                elif isinstance(part.result, ReaderError):
                    again = part.repeats or number
                    items = (reading.numbers.rejected(part.name, part.result, part.digest, again),)
                else:
                    items = self._blocks_of(part, reading, number)
            for place, item in enumerate(items):
                if isinstance(part, Loaded) and not place and (reading.cutter is None or part.is_refused):
                    reading.given.note_file(part, item)
                reading.note(item)
                yield item

    def _blocks_of(self, loaded: Loaded, reading: RecordingPass, number: int | None) -> Iterator[Block | Rejected]:
        if isinstance(loaded.result, Samples):
            several, name = bool(loaded.result.following or loaded.result.torn), loaded.name
            for one in loaded.result.recordings:
                yield reading.numbers.whole(one, name, loaded.digest, number, of_several=several)
            if loaded.result.torn:
                yield from reading.numbers.torn(loaded.result, name)

    def _parts(self, reading: RecordingPass) -> Iterator[Cut | Loaded]:
        """Yield the files in order or, unless each is a block, their cuts and those that give none."""
        given, numbers = reading.given, reading.numbers
        files = (
            given.unrepeated(loaded, loaded.facts.number if self._block_s is None else None, numbers.highest)
            for loaded in self._in_order(reading)
        )
        return files if reading.cutter is None else self._cuts(files, reading.cutter)

    def _check(self) -> None:
        """Raise SourceError where files, rate or unit are missing."""
        where = f"[[source]] {self.name}"
        known = self._known()  # An archive is open as long as this is.
        try:
            found = next(known, None)
            samples = None if found is None else self._peek(*found)
        except ReaderError as error:
            raise SourceError(f"{where}: url: {error}") from error
        if found is None:
            place = "holds no file" if self._files.several else "is not a file"
            text = f"{where}: url: {self._files.root} {place} of {self._set.name} ({self._set.files})"
            raise SourceError("; ".join((text, *(f"{name} {reason}" for name, reason in self.closed().items()))))
        check_stated(self._spec, self._set, found[0], samples)
        doubt = check_names(self._spec, self._set, self._listed) if self._files.several else None
        if doubt is not None and self._dater is not None:
            self._dater.remarks["names"] = doubt

    def _peek(self, facts: FileFacts, item: Item) -> Samples | None:
        """Read the first file if only it can state rate or unit; None if it is unreadable."""
        configured = bool(self._spec.channels) and all(channel.unit is not None for channel in self._spec.channels)
        rate_known = facts.rate is not None or self._spec.rate is not None or not self._set.states_rate
        unit_known = self._set.unit is not None or configured or not self._set.states_unit
        if rate_known and unit_known:
            return None
        try:
            return self._loader.read(item.read(), item.path, item.path)
        except ReaderError:
            return None

    def _in_order(self, reading: RecordingPass) -> Iterator[Loaded]:
        """Yield the files in order of acquisition, without those behind the state that the pass began from."""
        if self._files.sequential:
            yield from self._in_order_of_archive()
            return
        known = sorted(self._known(), key=_in_order_of_name)
        paths = one_run([item.path for _, item in known], self.name, self._set)
        first, begin = reading.files, self._begin
        if begin is not None and names_digest(paths[: first + 1]) != begin.names:
            raise SourceError(
                f"[[source]] {self.name}: url: {self._files.root}: the names of its first {first + 1} files are others "
                "than when they were read"
            )
        reading.begin_files(paths)
        self._files.expect(paths)
        dater = None if self._knows_starts else self._dater
        steps = Steps(looked=dater is None or not {"wrong", "undated"} & set(dater.remarks))
        for number, (facts, item) in enumerate(known[first:], first):
            reading.begin_file(number)
            loaded = self._load(item, facts)
            if dater is not None and steps.is_odd(loaded.result):
                # What is behind shows whether the clock was wrong for a while.
                dater.take_starts(self._undated_files(known))
                self._knows_starts = True
                loaded = self._load(item, facts)
            yield loaded

    def _undated_files(self, known: Iterable[tuple[FileFacts, Item]]) -> Iterator[tuple[str, Samples, float | None]]:
        """Yield the files that can be read, with what they state, and the times of their last changes."""
        for facts, item in known:
            if facts.start is None and facts.elapsed is None:
                with contextlib.suppress(ReaderError):
                    samples = self._loader.load_undated(item.read(), item.path, facts, item.path)
                    yield item.path, samples, item.changed()

    def _in_order_of_archive(self) -> Iterator[Loaded]:
        wanted: Iterator[tuple[object, ...]] = (
            ((number,) for number in itertools.count(1)) if self._set.counted else iter(self._listed_orders())
        )
        paths: list[str] = []

        def loaded() -> Iterator[Loaded]:
            for facts, item in self._known():
                paths[1:] = [item.path]
                one_run(paths, self.name, self._set)
                yield self._load(item, facts)

        yield from reordered(loaded(), wanted, self._files.root.name)

    def _listed_orders(self) -> list[tuple[object, ...]]:
        orders: set[tuple[object, ...]] = set()
        # The pass that reads finds any damage again and reports it.
        with contextlib.suppress(ReaderError):
            orders.update(facts.order for facts, _ in self._known())
        return sorted(orders)

    def _load(self, item: Item, facts: FileFacts) -> Loaded:
        """Load a file; a failure becomes a rejection status."""
        digest, name = "", shown(item.path)
        try:
            raw = item.read()
            digest = hash_of_file(raw, item.path)
            samples = self._loader.load(raw, item.path, facts, name, changed=item.changed())
        except UndatedError as error:
            raise self._undated(error) from error
        except ReaderError as error:
            return Loaded(item.path, facts, renamed(error, item.path, name), digest)
        origin = Origin(name, samples.total)
        return Loaded(item.path, facts, samples.of_each(lambda one: one.changed(origin=origin)), digest)

    def _cuts(self, files: Iterable[Loaded], cutter: Reblocker) -> Iterator[Cut | Loaded]:
        """Yield the cuts of files in order, and files that give none, or of which recordings broke off."""
        for loaded in files:
            samples = loaded.result
            if isinstance(samples, ReaderError):
                if not loaded.repeats:
                    # Samples are not joined across a file that could not be read.
                    yield from cutter.flush()
                yield loaded
                continue
            for recording in samples.recordings:
                yield from cutter.feed(recording)
            if samples.torn:
                yield from cutter.flush()
                yield loaded
        yield from cutter.flush()


def _in_order_of_name(pair: tuple[FileFacts, Item]) -> tuple[tuple[object, ...], str]:
    return pair[0].order, pair[1].path


def open_recording(
    spec: SourceSpec,
    path: str,
    kind: str,
    must_be_folder: bool = False,
    kept: Dating | None = None,
    begin: ReadingState | None = None,
    files: Files | None = None,
) -> Recording:
    """Open a recording: a file, a folder or a tar archive; arguments and errors as :func:`streams.open.open_source`.

    ``kind`` is the name of a data set or format, or "auto".
    """
    if files is None:
        files = open_files(spec.name, path, must_be_folder)
    if begin is None or begin.version != VERSION or files.sequential:
        return Recording(spec, files, data_set_of(spec, files, kind), kept)
    data_set = data_set_of(spec, files, begin.data_set, begin.endings)
    return Recording(spec, files, data_set, begin.dating or kept, begin)
