"""Turn the files of a register into deliveries of blocks and rejections."""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Iterable, Iterator
from copy import copy
from dataclasses import replace

from streams.dates.order import UndatedError
from streams.files.datasets import FileFacts
from streams.files.load import Loader, cutter_of, renamed
from streams.files.parse.riff import is_open_wav
from streams.folder.copying import Order
from streams.folder.life import (
    MAX_INCOMPLETE_S,
    BlockDelivered,
    ChangedMeanwhile,
    Committed,
    Continued,
    Drained,
    Emitted,
    FileEntry,
    Postponed,
    ReadingBegun,
    ReadingEnded,
    Retried,
    next_attempt,
)
from streams.folder.reading import Background, FileTask, Raw, Result, UnfinishedError, count_block, read_file
from streams.folder.register import Register
from streams.reblock import Cut, Numbering
from streams.types.block import Block, Rejected
from streams.types.listing import unpacked_name
from streams.types.samples import ReaderError, Samples
from streams.types.source import ACCEPTED, PENDING, POISONED, Delivery, FileProgress, Ledger
from streams.types.spec import SourceSpec

_LOG = logging.getLogger(__name__)
_MAX_AHEAD_FILES = 8
_MAX_AHEAD_BYTES = 1 << 26
_MAX_SORTED_S = 30 * 86400.0
"""Files read ahead whose times are farther apart are of a clock that was wrong."""
_GROWS = ("csv", "tdms")
"""Formats whose files are appended to while they are read."""

_Loaded = tuple[FileEntry, Raw, FileFacts, Samples]


class Intake:
    """Takes files in order; ``ready`` holds deliveries not yet returned."""

    def __init__(
        self,
        spec: SourceSpec,
        loader: Loader,
        ledger: Ledger,
        register: Register,
        background: Background,
        patience_s: float,
    ) -> None:
        """Continue after the last committed block of the ledger; wait for ``background`` at most ``patience_s``."""
        self.ready: deque[Delivery] = deque()
        self.undated: dict[FileEntry, str] = {}
        """The files whose date cannot be told yet, with the reasons; the first of them is ``waits``."""
        self.waits: str | None = None
        self._spec, self._loader, self._register, self._inquiry = spec, loader, register, register.inquiry
        self._reblocker = cutter_of(spec, loader.data_set)
        # Pulses and other channels may be written after the samples.
        alone = spec.pulses is None and len(spec.files) < 2
        self._grows = self._reblocker is not None and alone and loader.data_set.name in _GROWS
        self._period = spec.block_s if self._grows and spec.block_s != "file" else None
        highest, began, dater = ledger.committed(spec.name), ledger.began(spec.name), loader.dater
        self._dated_by = None if dater is None else (dater.choice.by, dater.choice.order)
        self._numbers = Numbering(spec.name, highest, began, None if dater is None else dater.place_time)
        self._batch: list[_Loaded] = []
        self._background, self._patience = background, patience_s
        self._reading: tuple[FileEntry, FileFacts, FileTask] | None = None
        self._emission: Iterator[None] = iter(())
        self._latest_order: Order | None = None
        self._files = self._delivered = self._emitting = 0

    def queued_blocks(self) -> float:
        """Return about how many blocks wait: a file counts as many as the files so far gave on average."""
        begun = len(self._batch) + self._emitting + (self._reading is not None)
        return len(self.ready) + (self._register.queued + begun) * max(self._delivered, 1) / max(self._files - begun, 1)

    def advance(self, now: float) -> bool:
        """Take the next files; return whether there was any.

        Names need not sort by time, but the files often state it, so a few of them are read ahead and sorted. A file
        that takes long is left to the background, and the blocks of a long one are cut one by one.
        """
        if next(self._emission, self) is not self:
            return True
        began, happened, most = time.monotonic(), False, 1 if self._reblocker is None else _MAX_AHEAD_FILES
        while len(self._batch) < most and sum(loaded[3].values.nbytes for loaded in self._batch) < _MAX_AHEAD_BYTES:
            patience = 0.0
            if self._reading is None:
                entry = self._register.take(now, self._period)
                if entry is None:
                    break
                happened = True
                with self._register.queued_again(entry):
                    self._reading = self._begin(entry, now)
                if self._background.last_s <= self._patience:
                    patience = began + self._patience - time.monotonic()
            if self._reading is not None:
                if not self._reading[2].is_done(patience):
                    return happened
                reading, self._reading = self._reading, None
                happened = True
                with self._register.queued_again(reading[0]):
                    loaded = self._load(*reading, now)
                if loaded is not None:
                    self._batch.append(loaded)
                    continue
                if reading[0] in self.undated:
                    break
            if self.ready:
                break
        self._emission = self._emit_batch()
        emitted = next(self._emission, self) is not self
        self.waits = next(iter(self.undated.values()), None)
        return emitted or self._flush_late(now) or happened

    def _emit_batch(self) -> Iterator[None]:
        """Deliver the files read ahead, in order of time; yield after each block."""
        batch, self._batch = self._batch, []
        starts = [loaded[3].start for loaded in batch if loaded[3].start is not None and loaded[3].joins]
        # Where a clock is doubtful, the names are more certain than the times.
        repeated = any(loaded[3].stated is not None and loaded[3].stated.repeated_s for loaded in batch)
        if starts and len(starts) == len(batch) and not repeated and max(starts) - min(starts) <= _MAX_SORTED_S:
            batch.sort(key=lambda loaded: loaded[3].start or 0.0)
        self._emitting = len(batch)
        try:
            for loaded in batch:
                yield from self._emit(*loaded)
                self._emitting -= 1
        except Exception:
            for entry, *_ in batch[len(batch) - self._emitting :]:
                if entry.state.phase in ("taken", "held"):
                    self._register.tell(entry, Retried())
            raise

    def acknowledge(self, delivery: Delivery) -> None:
        """Record that a delivery is committed."""
        item = delivery.item
        if not (isinstance(item, Rejected) and item.is_repetition):
            self._inquiry.uncommitted.pop(item.sequence, None)
        entries: tuple[FileEntry, ...] = delivery.token
        for entry, progress in zip(entries, delivery.progress, strict=True):
            self._register.tell(entry, Committed(progress))

    def _begin(self, entry: FileEntry, now: float) -> tuple[FileEntry, FileFacts, FileTask] | None:
        """Begin to read a file; None where it is gone, or of another kind by now."""
        facts = self._loader.facts(entry.path)
        self.undated.pop(entry, None)
        if facts is None:
            self._register.remove(entry, entry.state.counted)
            return None
        if entry.state.absent is not None:
            reason = f"{entry.key}: is gone, before all of it could be read"
            self._reject(entry, None, facts, ReaderError("unreadable", reason))
            return None
        if self._inquiry.is_poisoned(entry.key):
            reason = f"{entry.key}: the monitor died repeatedly while it handled this file; it is set aside"
            self._reject(entry, None, facts, ReaderError(POISONED, reason))
            return None
        self._register.tell(entry, ReadingBegun(now))
        self._files += 1
        base = entry.state.base
        last = entry.state.read or base
        done = base is not None and base.verdict != PENDING
        known = last.content_hash if last is not None and done else None
        # The thread must not see later changes of the entry.
        seen, loader = copy(entry), self._loader
        kind = loader.data_set.name if self._is_growing(entry) else None
        task = self._background.start(
            lambda: read_file(loader, seen, facts, kind, known), (entry.key,), entry.state.stat.size
        )
        return entry, facts, task

    def _load(self, entry: FileEntry, facts: FileFacts, task: FileTask, now: float) -> _Loaded | None:
        """Return a file that was read; None where it waits, is known already or is rejected."""
        raw: Raw | None = None
        self._register.tell(entry, ReadingEnded())
        try:
            read: tuple[Raw, Result] = task.future.result()
            raw, result = read
            if self._resolve_known(entry, raw, facts, result):
                return None
            if isinstance(result, ReaderError):
                raise result
            if result is None:
                self._register.tell(entry, Retried())
                return None
            self._check_written(entry, raw, result, now)
            changed, growing = raw.progress.mtime_ns / 1e9, self._is_growing(entry)
            samples = self._loader.date(result, entry.path, facts, changed, whole=not growing)
        except UnfinishedError as error:
            self._register.tell(entry, ChangedMeanwhile(error.stat, now))
            return None
        except UndatedError as error:
            self.undated[entry] = str(error)
            if self._is_growing(entry):
                self._register.await_end(entry)
            else:
                self._register.tell(entry, Postponed(now + MAX_INCOMPLETE_S))
            return None
        except ReaderError as error:
            due = next_attempt(entry.state, error, self._spec.settle_s, now)
            if due is None:
                self._reject(entry, raw, facts, error)
            else:
                if error.may_pass:
                    _LOG.warning("source %s: %s; it is tried again", self._spec.name, error)
                self._register.tell(entry, Postponed(due))
            return None
        if self._is_reordered(entry):
            return None
        self._inquiry.add(raw.progress.content_hash, entry)
        return entry, raw, facts, samples

    def _check_written(self, entry: FileEntry, raw: Raw, samples: Samples, now: float) -> None:
        """Raise ReaderError ``incomplete`` where what is missing may still be written."""
        if now - entry.state.changed < MAX_INCOMPLETE_S and not entry.state.closed and is_open_wav(raw.data):
            raise ReaderError("incomplete", f"{entry.path}: its header does not state where its samples end")
        if samples.torn:
            broken = ReaderError("incomplete", samples.torn[0])
            waits = self._is_growing(entry) or next_attempt(entry.state, broken, self._spec.settle_s, now) is not None
            # Nor is a recording left out of which blocks came while it was written.
            if waits or entry.state.fed > samples.total:
                raise broken

    def _is_growing(self, entry: FileEntry) -> bool:
        """Return whether a file may get longer, and is read before it is whole."""
        return self._grows and not entry.state.whole and unpacked_name(entry.path) == entry.path

    def _is_reordered(self, entry: FileEntry) -> bool:
        """Return whether this file settled what dates the files, and others may come before it now."""
        dater = self._loader.dater
        if dater is None or self._dated_by == (dater.choice.by, dater.choice.order):
            return False
        self._dated_by = (dater.choice.by, dater.choice.order)
        if dater.choice.by != "name" and not self.undated:
            return False
        self._register.tell(entry, Retried())
        self._retry_undated()
        self._register.reorder()
        return True

    def _retry_undated(self) -> None:
        for waiting in self.undated:
            if waiting.state.phase == "deferred":
                self._register.tell(waiting, Retried())
        self.undated.clear()

    def _reject(self, entry: FileEntry, raw: Raw | None, facts: FileFacts, error: ReaderError) -> None:
        self._deliver_batch()
        if self._loader.dater is not None and self._loader.dater.order.forget(entry.path):
            self._retry_undated()
        if self._latest_order is None or entry.order >= self._latest_order:
            # Samples are not joined across a file that could not be read, unless later ones were taken already.
            self._flush()
        digest = "" if raw is None else raw.progress.content_hash
        number, status = self._number_of(entry, facts), error.status
        if not self._inquiry.is_free(number):
            status = "changed"
        stat = entry.state.stat
        known = entry.state.base or (raw.progress if raw is not None else FileProgress(entry.key, 0, 0, 0))
        progress = replace(
            known, path=entry.key, size=stat.size, mtime_ns=stat.mtime_ns, inode=stat.inode, verdict=status
        )
        error = renamed(ReaderError(status, str(error)), entry.path, entry.key)
        self._deliver(self._numbers.rejected(entry.key, error, digest, number), [(entry, progress)])

    def _resolve_known(self, entry: FileEntry, raw: Raw, facts: FileFacts, result: Result) -> bool:
        """Compare with known content; return whether the file has nothing new."""
        base = entry.state.base
        last = entry.state.read or base
        if last is not None:
            touched = last.content_hash == raw.progress.content_hash
            if touched and base is not None and base.verdict != PENDING:
                self._register.remember(entry, replace(raw.progress, samples=base.samples, verdict=base.verdict))
                return True
            done = 0 if base is None else base.samples
            if not touched and entry.state.outstanding and self._reblocker is None:
                done = entry.state.total
            if touched or self._is_continued(raw, last, result, done):
                self._register.tell(entry, Continued(done))
                return False
            self._deliver_batch()
            self._flush()
            self._register.renew(entry)
        number, root = self._number_of(entry, facts), str(self._loader.root)
        match = self._inquiry.match(entry, raw, result, number, root=root, grows=self._grows)
        if match is None:
            return False
        if match.renamed is not None:
            self._register.adopt(entry, match.renamed)
        elif match.error is None:
            # A log that was copied and continued in the copy: its beginning is committed.
            self._register.tell(entry, Continued(match.samples))
            return False
        else:
            # The original comes first, though it may have been read ahead only.
            self._deliver_batch()
            again = match.number or max(1, self._numbers.highest)
            rejected = self._numbers.rejected(entry.key, match.error, raw.progress.content_hash, again)
            progress = replace(raw.progress, samples=match.samples, verdict=match.error.status)
            self._deliver(rejected, [(entry, progress)])
        return True

    def _is_continued(self, raw: Raw, last: FileProgress, result: Result, done: int) -> bool:
        """Return whether a file that was read before is longer by samples, or by recordings behind those done."""
        if not self._grows:
            following = result.following if isinstance(result, Samples) else ()
            if not following or (self._reblocker is None and done not in [one.begin for one in following]):
                return False
        return raw.is_more_of(last)

    def _number_of(self, entry: FileEntry, facts: FileFacts) -> int | None:
        """Return the number that a file states for its block, if blocks have such.

        That of a released file is taken by its rejection, so it gets the next one.
        """
        return facts.number if self._reblocker is None and not entry.state.released else None

    def _emit(self, entry: FileEntry, raw: Raw, facts: FileFacts, samples: Samples) -> Iterator[None]:
        """Deliver the blocks of a file; yield after each."""
        done = min(entry.state.fed, samples.total)
        # Behind its samples a file with recordings that broke off has their rejection.
        total = samples.total + bool(samples.torn)
        self._register.tell(entry, Emitted(raw.progress, total, self._reblocker is not None))
        self._latest_order = entry.order if self._latest_order is None else max(self._latest_order, entry.order)
        if self._reblocker is None:
            number = self._number_of(entry, facts)
            several = bool(samples.following or samples.torn)
            for one in samples.recordings:
                if not several or one.end > done:
                    verdict = ACCEPTED if one.end == total else PENDING
                    progress = replace(raw.progress, samples=one.end, verdict=verdict)
                    digest = raw.progress.content_hash
                    block = self._numbers.whole(one, entry.key, digest, number, of_several=several)
                    self._deliver(block, [(entry, progress)])
            if samples.torn:
                self._deliver_torn(entry, raw, samples)
            return
        for one in samples.recordings:
            if one.end > done or one.end == samples.total:
                skipped = max(done - one.begin, 0)
                rest = one.changed(values=one.values[:, skipped:], origin=entry, offset=one.begin + skipped)
                yield from self._deliver_cuts(self._reblocker.feed(rest))
        if (samples.start is None or not samples.joins) and not self._grows:
            # The start of the next file is unknown, so it cannot be joined to this one.
            yield from self._deliver_cuts(self._reblocker.flush())
        if samples.torn:
            self._flush()
            self._deliver_torn(entry, raw, samples)
        if raw.progress.is_part:
            self._register.await_end(entry)
        else:
            self._mark_delivered(entry)

    def _deliver_torn(self, entry: FileEntry, raw: Raw, samples: Samples) -> None:
        """Deliver the rejections of recordings that broke off, with the last of which the file is done."""
        base, left = entry.state.base, len(samples.torn)
        verdict = ACCEPTED if self._reblocker is None or entry.state.blocks or (base and base.samples) else "short"
        for item in self._numbers.torn(samples, entry.key):
            left -= 1
            progress = replace(raw.progress, samples=samples.total, verdict=PENDING if left else verdict)
            self._deliver(item, [(entry, progress)])

    def _flush_late(self, now: float) -> bool:
        """Cut off samples that have waited too long for more."""
        if self._reblocker is None or not self._reblocker.held:
            return False
        if any(
            now - entry.state.changed < MAX_INCOMPLETE_S
            for entry in self._reblocker.origins
            if isinstance(entry, FileEntry)
        ):
            return False
        self._flush()
        return True

    def _mark_delivered(self, entry: FileEntry) -> None:
        """Mark a file whose samples are all delivered, acknowledged or not."""
        if self._reblocker is not None and entry in self._reblocker.origins:
            return
        self._register.tell(entry, Drained())

    def _deliver_batch(self) -> None:
        """Deliver all blocks of the files read ahead."""
        for _ in self._emit_batch():
            pass

    def _flush(self) -> None:
        """Deliver what is left over."""
        for _ in self._deliver_cuts(() if self._reblocker is None else self._reblocker.flush()):
            pass

    def _deliver_cuts(self, cuts: Iterable[Cut]) -> Iterator[None]:
        for cut in cuts:
            pairs = list(count_block(cut))
            self._deliver(self._numbers.cut(cut), pairs, blocks=not cut.missing)
            for entry, _ in pairs:
                self._mark_delivered(entry)
            yield

    def _deliver(
        self, item: Block | Rejected, pairs: list[tuple[FileEntry, FileProgress]], *, blocks: bool = False
    ) -> None:
        if not (isinstance(item, Rejected) and item.is_repetition):
            self._inquiry.uncommitted[item.sequence] = item.content_hash
            self._numbers.note(item)
        self._delivered += 1
        for entry, _ in pairs:
            self._register.tell(entry, BlockDelivered(int(blocks)))
        self.ready.append(Delivery(item, tuple(entry for entry, _ in pairs), tuple(progress for _, progress in pairs)))
