"""The files of a watched folder, waiting or done, and their order."""

from __future__ import annotations

import heapq
import itertools
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace

from streams.files.groups import FilesBeside
from streams.files.sidecar import is_sidecar
from streams.folder.copying import HOLD, Awaited, CopyDetector, Order
from streams.folder.inquiry import ARCHIVED, Inquiry
from streams.folder.life import (
    MAX_INCOMPLETE_S,
    Committed,
    FileEntry,
    FileEvent,
    FileState,
    Missing,
    Observed,
    Postponed,
    Removed,
    Renamed,
    Replaced,
    Retried,
    Taken,
)
from streams.types.listing import Stat, is_likely_same, natural_key, shown, unshown
from streams.types.source import ACCEPTED, PENDING, POISONED, RELEASED, Backlog, FileProgress, Ledger

MAX_COMPARED = 512
"""Files that are done, and of those that wait first and last, whose names are compared at first."""


class Register:
    """The files of one folder: names, times and counts; contents stay on the disk.

    All events are told here, and what the table of a file's life asks for is done here.
    """

    def __init__(
        self,
        source: str,
        ledger: Ledger,
        settle_s: float,
        order_of: Callable[[str], Order | None],
        now: float,
        beside: FilesBeside,
    ) -> None:
        """Begin with the pending files of the ledger.

        ``settle_s`` is the time for which a file must be unchanged; ``order_of`` gives the sorting key of a path, None
        for a file of another kind; ``beside`` tells the files that are read with others.
        """
        self._awaited = Awaited(beside, settle_s)
        self.waiting: dict[str, FileEntry] = {}
        self.inquiry = Inquiry(source, ledger, self.waiting)
        self._others: set[str] = set()
        self.ignored: list[str] = []
        """The paths of the files that are ignored, as of the latest listing, in natural order."""
        self._source, self._ledger, self._settle = source, ledger, settle_s
        self._order_of = order_of
        self._done: dict[str, FileProgress] = {}
        self._heap: list[tuple[Order, str, int, FileEntry]] = []
        self._deferred: dict[str, FileEntry] = {}
        self._tie = itertools.count()
        self._lock = threading.Lock()
        self._copying = CopyDetector(settle_s, now)
        self._taken: Order | None = None
        self.entered = 0
        """How many files have come, those of before the start included: their names are judged when more have."""
        counts = ledger.file_counts(source)
        self._accepted = counts.pop(ACCEPTED, 0)
        for waits in (PENDING, RELEASED):
            counts.pop(waits, None)
        self._rejected = sum(counts.values())
        for progress in ledger.pending_files(source):
            # Absent until a scan finds them, so that a removed one is given up in time.
            self.tell(self._enter(unshown(progress.path), Stat(-1, 0, 0), now, progress), Missing(now))

    def update(self, listing: Mapping[str, Stat], now: float) -> Iterator[None]:
        """Compare a listing of the whole folder with the files known; yield after each file of it."""
        gone = [path for path in self._done if path not in listing]
        here = {path: stat.inode for path, stat in listing.items()}
        moved = {known.inode: path for path, known in self._done.items() if here.get(path) != known.inode}
        moved |= {e.state.stat.inode: path for path, e in self.waiting.items() if here.get(path) != e.state.stat.inode}
        if moved:
            for path, stat in listing.items():
                if stat.inode in moved and path not in self._done and path not in self.waiting:
                    self._renamed(moved[stat.inode], path, stat)
        for path, stat in listing.items():
            self.observe(path, stat, now)
            yield
        for path in gone:
            self._done.pop(path, None)
        self._others &= listing.keys()
        self._awaited.keep(listing)
        self._note_ignored()
        for path, entry in self.waiting.items():
            if path not in listing:
                self.tell(entry, Missing(now))

    def observe(self, path: str, stat: Stat, now: float, closed: bool = False) -> None:
        """Record the status of a file; ``closed``: just closed after writing or moved in."""
        self._awaited.note(path, stat, now)
        entry = self.waiting.get(path)
        if entry is None:
            done = self._done.get(path)
            if path in self._others or (done is not None and done.is_of(stat)):
                return
            known = done or self.inquiry.file(path)
            released = known is not None and known.verdict == RELEASED
            if released:
                known = None
            if known is not None and known.verdict != PENDING and known.is_of(stat):
                self._done[path] = known
                return
            if known is None and self._order_of(path) is None:
                self._others.add(path)
                return
            self._done.pop(path, None)
            entry = self._enter(path, stat, now, known, released=released)
        self.tell(entry, Observed(stat, now, closed))

    def tell(self, entry: FileEntry, event: FileEvent) -> None:
        """Let an event happen to a file, and do what the table of its life asks for."""
        actions = entry.happen(event)
        if "queue" in actions:
            self._deferred.pop(entry.path, None)
            heapq.heappush(self._heap, (entry.order, entry.path, next(self._tie), entry))
        elif "defer" in actions:
            self._deferred[entry.path] = entry
        elif "finish" in actions and isinstance(event, Committed):
            self._finish(entry, event.progress)
        elif "remember" in actions and entry.state.read is not None:
            # A growing file was read and had nothing new.
            progress = replace(entry.state.read, path=entry.key, samples=entry.total, verdict=ACCEPTED)
            with self.queued_again(entry):
                self.remember(entry, progress)

    @contextmanager
    def queued_again(self, entry: FileEntry) -> Iterator[None]:
        """Queue a file again where the ledger fails while it is handled."""
        try:
            yield
        except BaseException:
            self.tell(entry, Retried())
            raise

    def paths(self) -> list[str]:
        """Return the paths of the files that wait or are done."""
        return [*self.waiting, *self._done]

    def recent_paths(self, *, sampled: bool = False) -> list[str]:
        """Return the paths of the files that wait, ``sampled`` of some of them, and of some that are done."""
        waiting = self.waiting.items()
        if sampled and len(waiting) > 2 * MAX_COMPARED:
            last = itertools.islice(reversed(waiting), MAX_COMPARED)
            waiting = [*itertools.islice(waiting, MAX_COMPARED), *last]
        here = (path for path, entry in waiting if entry.state.absent is None)
        return [*here, *itertools.islice(reversed(self._done), MAX_COMPARED)]

    def taken_paths(self) -> list[str]:
        """Return the paths of the files that are there and of which samples are in blocks."""
        done = (path for path, known in self._done.items() if known.samples)
        waiting = ((path, entry.state) for path, entry in self.waiting.items())
        begun = (path for path, state in waiting if state.base and state.base.samples and state.absent is None)
        return [*done, *begun]

    def reorder(self) -> None:
        """Sort and filter again, once the kind of the files is recognised."""
        self._heap.clear()
        self._copying.forget_order()
        self._taken = None
        for path, entry in list(self.waiting.items()):
            order = self._order_of(path)
            if order is None and entry.state.base is None:
                del self.waiting[path]
                self._deferred.pop(path, None)
                self._others.add(path)
                continue
            entry.order = order or entry.order
            if entry.state.phase == "queued":
                self.tell(entry, Retried())
        self._note_ignored()

    def _note_ignored(self) -> None:
        """List the files of another format that are no side-cars, where that has changed."""
        named = {path.removesuffix(".json") for path in self._others}
        recordings = {path for path in named if path in self.waiting or path in self._done}
        others = (path for path in self._others if not self._awaited.has(path))
        ignored = {path for path in others if not is_sidecar(path, recordings)}
        if len(ignored) != len(self.ignored) or not ignored.issuperset(self.ignored):
            self.ignored = sorted(ignored, key=natural_key)

    @property
    def queued(self) -> int:
        """About how many files are not taken yet and not deferred."""
        return len(self._heap)

    def _enter(self, path: str, stat: Stat, now: float, base: FileProgress | None, released: bool = False) -> FileEntry:
        order = self._order_of(path) or ()
        counted = base.verdict if base is not None and base.verdict != PENDING else None
        state = FileState(stat=stat, changed=now, base=base, counted=counted, released=released)
        entry = FileEntry(shown(path), path=path, order=order, seen=now, state=state)
        with self._lock:
            self._count(counted, -1)
            self.waiting[path] = entry
        self.entered += 1
        if order:
            self._copying.note(order, now)
        self.tell(entry, Retried())
        return entry

    def _renamed(self, before: str, path: str, stat: Stat) -> None:
        """Carry over the progress of a renamed file.

        The inode may belong to another file by now, so a file that has grown meanwhile is compared by content, like
        any file that changes.
        """
        entry = self.waiting.get(before)
        known = self._done.get(before) if entry is None else entry.state.base
        if entry is not None:
            state, order = entry.state, self._order_of(path)
            grown = state.base is not None or state.read is not None
            if not is_likely_same(state.stat.size, state.stat == stat, stat, grown) or order is None:
                return
            with self._lock:
                self.waiting[path] = self.waiting.pop(before)
            self._deferred.pop(before, None)
            entry.path, entry.key, entry.order = path, shown(path), order
            self.tell(entry, Renamed(None if known is None else self._restore(known, entry.key)))
        elif known is None or not is_likely_same(known.size, known.is_of(stat), stat, True):
            return
        else:
            del self._done[before]
            self._done[path] = self._restore(known, shown(path))

    def _restore(self, known: FileProgress, key: str) -> FileProgress:
        """Store the progress of a file under another name."""
        moved = replace(known, path=key)
        self._ledger.move(self._source, known.path, moved)
        return moved

    def is_settled(self, entry: FileEntry, now: float) -> bool:
        """Return whether a file seems to be complete.

        That it was closed is enough only after another file in order: many may be copied in any order.
        """
        if now - entry.state.changed >= self._settle:
            return True
        return entry.state.closed and self._taken is not None and entry.order > self._taken

    def _is_whole(self, entry: FileEntry, now: float) -> bool:
        """Return whether the last line of a file counts as complete.

        A buffered writer stops anywhere, and may pause; but it closes a finished file, or continues in the next one.
        """
        if not self.is_settled(entry, now):
            return False
        later = bool(self._heap) and self._heap[0][0] > entry.order
        return entry.state.closed or later or now - entry.state.changed >= HOLD * self._settle

    def await_end(self, entry: FileEntry) -> None:
        """Defer a file that is read before its end until it counts as whole."""
        self.tell(entry, Postponed(entry.state.changed + HOLD * self._settle, awaits_end=True))

    def take(self, now: float, period: float | None) -> FileEntry | None:
        """Return the next file in order, or None where all have to wait.

        A file that is still being written holds back those after it, to keep the order, for a limited time; so does a
        number of files that keeps growing, because a folder is copied in any order. ``period`` is the time between
        readings of a growing file, s; None: it is not read before it is complete.
        """
        self._requeue_due(now)
        first = next(iter(self.waiting.values()), None)
        if first is not None and self._copying.is_copying(len(self._heap), first.seen, now):
            return None
        passed: list[tuple[Order, str, int, FileEntry]] = []
        found: FileEntry | None = None
        while self._heap:
            item = heapq.heappop(self._heap)
            entry, state = item[3], item[3].state
            if state.phase != "queued" or self.waiting.get(entry.path) is not entry:
                continue
            if state.absent is not None and now - state.absent < MAX_INCOMPLETE_S:
                self.tell(entry, Postponed(state.absent + MAX_INCOMPLETE_S))
            elif state.stat.regular and state.stat.size == 0 and now - state.changed < MAX_INCOMPLETE_S:
                self.tell(entry, Postponed(state.changed + MAX_INCOMPLETE_S))
            elif self._is_ready(entry, now, period):
                found = entry
                self.tell(entry, Taken(self._is_whole(entry, now)))
                self._taken = entry.order
                break
            else:
                passed.append(item)
                if now - entry.seen < HOLD * self._settle:
                    break
        for item in passed:
            heapq.heappush(self._heap, item)
        return found

    def _is_ready(self, entry: FileEntry, now: float, period: float | None) -> bool:
        state = entry.state
        if not state.stat.regular or state.absent is not None:
            return True
        if self.is_settled(entry, now):
            return not self._awaited.holds(entry.path, state.changed, now)
        return period is not None and now - max(entry.seen, state.read_at) >= max(period, self._settle)

    def _requeue_due(self, now: float) -> None:
        """Queue the deferred files that are due, and those that count as whole by now."""
        for entry in list(self._deferred.values()):
            state = entry.state
            if state.due <= now or (state.awaits_end and not state.whole and self._is_whole(entry, now)):
                self.tell(entry, Retried())

    def remember(self, entry: FileEntry, progress: FileProgress) -> None:
        """Store the progress of a file without a commit, and count it."""
        self._ledger.remember(self._source, [progress])
        self._finish(entry, progress)

    def _finish(self, entry: FileEntry, progress: FileProgress) -> None:
        """Count a file under its verdict; a later change enters it again."""
        self.inquiry.remove(progress.content_hash, entry)
        if progress.path != entry.key:
            # It was renamed before its last block was committed.
            progress = self._restore(progress, entry.key)
        self.remove(entry, progress.verdict)
        self._done[entry.path] = progress

    def remove(self, entry: FileEntry, verdict: str | None) -> None:
        """Remove a file from those that wait; count it unless the verdict is None."""
        with self._lock:
            if self.waiting.get(entry.path) is entry:
                del self.waiting[entry.path]
                self._count(verdict, 1)
        self._deferred.pop(entry.path, None)
        self.tell(entry, Removed())

    def release(self, key: str) -> None:
        """Forget a poisoned file, so that the next scan enters it."""
        done = self._done.get(unshown(key))
        if done is not None and done.verdict == POISONED:
            del self._done[unshown(key)]
            with self._lock:
                self._count(POISONED, -1)

    def adopt(self, entry: FileEntry, known: FileProgress) -> None:
        """Record that a file is a known one that was renamed."""
        self.remove(entry, None)
        self._done[entry.path] = self._restore(replace(known, mtime_ns=entry.state.stat.mtime_ns), entry.key)

    def renew(self, entry: FileEntry) -> None:
        """Treat the content as another file; the former content keeps its verdict."""
        base = entry.state.base
        if base is not None:
            verdict = ACCEPTED if base.verdict == PENDING else base.verdict
            self._restore(replace(base, verdict=verdict), f"{base.path}{ARCHIVED}{base.content_hash}")
            with self._lock:
                self._count(verdict, 1)
        self.tell(entry, Replaced())

    def _count(self, verdict: str | None, by: int) -> None:
        if verdict == ACCEPTED:
            self._accepted += by
        elif verdict is not None:
            self._rejected += by

    def backlog(self, now: float) -> Backlog:
        """Return the counts; from any thread."""
        with self._lock:
            pending = len(self.waiting)
            first = next(iter(self.waiting.values()), None)
            accepted, rejected, ignored = self._accepted, self._rejected, len(self.ignored)
        age = 0.0 if first is None else max(0.0, now - first.seen)
        return Backlog(accepted + rejected + ignored + pending, accepted, rejected, pending, age, ignored)
