"""Which files of a watched folder wait, which are done, and in which order they are taken."""

from __future__ import annotations

import heapq
import itertools
import math
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

from streams.folder.listing import Stat, shown, unshown
from streams.ledger import ACCEPTED, PENDING, FileProgress, Ledger
from streams.samples import Origin
from streams.source import Backlog

INCOMPLETE_AFTER = 600.0
"""Seconds without a change after which a file that is not all there is given up."""

ARCHIVED = "\n"
"""Stands between a path and the digest of what it held before, in the key of a file that was replaced."""

_BULK = 8
_HOLD = 10.0

Order = tuple[object, ...]
Phase = Literal["queued", "aside", "held", "delivered"]


@dataclass(eq=False, kw_only=True)
class Entry(Origin):
    """A file that waits.

    Attributes:
        path: below the folder, as the file system gives it; ``key`` is the same in printable characters.
        stat: as last seen.
        order: sorts the files by acquisition.
        seen: when it was first seen waiting, by the monotonic clock, s; likewise the other times.
        changed: when it was last seen to change.
        closed: whether it was closed or moved in since then.
        whole: whether it counted as complete when its turn came.
        phase: "queued" for its turn, "aside" because it is not all there, "held" because samples of it wait for more,
            "delivered" entirely.
        due: when it is tried again although it does not change.
        base: what the ledger has of it.
        counted: the verdict under which it is counted already, None for a file not counted before.
        read: its progress as of the last reading, without samples.
        fed: number of samples of it that were taken.
        read_at: when it was last read.
        absent: since when it is not in the folder any more.
        outstanding: number of unacknowledged deliveries with samples of it.
        blocks: number of blocks with samples of it.
    """

    path: str
    stat: Stat
    order: Order
    seen: float
    changed: float
    closed: bool = False
    whole: bool = False
    phase: Phase = "queued"
    due: float = math.inf
    base: FileProgress | None = None
    counted: str | None = None
    read: FileProgress | None = None
    fed: int = 0
    read_at: float = -math.inf
    absent: float | None = None
    outstanding: int = 0
    blocks: int = 0


class Register:
    """The files of one folder. Pending ones wait on the disk; of each only its name and times are kept here."""

    def __init__(
        self, source: str, ledger: Ledger, settle_s: float, order_of: Callable[[str], Order | None], now: float
    ) -> None:
        """Begin with what the ledger has.

        Args:
            source: name of the source.
            ledger: what was committed.
            settle_s: how long a file must be unchanged.
            order_of: sorting key of a path, None for a file that is none of the source's.
            now: present time of the monotonic clock.
        """
        self.waiting: dict[str, Entry] = {}
        self.ignored: set[str] = set()
        self._source, self._ledger, self._settle = source, ledger, settle_s
        self._order_of = order_of
        self._done: dict[str, FileProgress] = {}
        self._heap: list[tuple[Order, int, Entry]] = []
        self._aside: dict[str, Entry] = {}
        self._tie = itertools.count()
        self._lock = threading.Lock()
        self._latest = now
        self._taken: Order | None = None
        counts = ledger.file_counts(source)
        self._accepted = counts.pop(ACCEPTED, 0)
        counts.pop(PENDING, None)
        self._rejected = sum(counts.values())
        for progress in ledger.pending_files(source):
            # Until a scan finds them they count as absent, so that one that is gone is not waited for in vain.
            entry = self._enter(unshown(progress.path), Stat(-1, 0, 0), now, progress)
            entry.absent = now

    def update(self, listing: Mapping[str, Stat], now: float) -> None:
        """Compare all files of the folder with what is known of them."""
        gone = [path for path in self._done if path not in listing]
        here = {path: stat.inode for path, stat in listing.items()}
        moved = {known.inode: path for path, known in self._done.items() if here.get(path) != known.inode}
        moved |= {entry.stat.inode: path for path, entry in self.waiting.items() if here.get(path) != entry.stat.inode}
        if moved:
            for path, stat in listing.items():
                if stat.inode in moved and path not in self._done and path not in self.waiting:
                    self._renamed(moved[stat.inode], path, stat)
        for path, stat in listing.items():
            self.look(path, stat, now)
        for path in gone:
            self._done.pop(path, None)
        self.ignored &= listing.keys()
        for path, entry in self.waiting.items():
            if path in listing:
                entry.absent = None
            elif entry.absent is None:
                entry.absent = now

    def look(self, path: str, stat: Stat, now: float, closed: bool = False) -> None:
        """Take note of what one file is like.

        Args:
            path: below the folder.
            stat: what the file system says of it.
            now: present time.
            closed: whether it was just closed after writing, or moved here.
        """
        entry = self.waiting.get(path)
        if entry is None:
            done = self._done.get(path)
            if path in self.ignored or (done is not None and _same(done, stat)):
                return
            known = done or self._ledger.file(self._source, shown(path))
            if known is not None and known.verdict != PENDING and _same(known, stat):
                self._done[path] = known
                return
            if known is None and self._order_of(path) is None:
                self.ignored.add(path)
                return
            self._done.pop(path, None)
            entry = self._enter(path, stat, now, known)
        if entry.absent is not None:
            entry.absent = None
            if entry.phase == "aside":
                self.queue(entry)
        if stat != entry.stat:
            entry.stat, entry.changed, entry.closed, entry.due = stat, now, False, math.inf
            if entry.phase in ("aside", "held"):
                self.queue(entry)
        if closed:
            entry.closed = True

    def reorder(self) -> None:
        """Sort anew, as it is known by now what kind of files these are."""
        self._heap.clear()
        self._taken = None
        for path, entry in list(self.waiting.items()):
            order = self._order_of(path)
            if order is None and entry.base is None:
                del self.waiting[path]
                self._aside.pop(path, None)
                self.ignored.add(path)
                continue
            entry.order = order or entry.order
            if entry.phase == "queued":
                self.queue(entry)

    def _enter(self, path: str, stat: Stat, now: float, known: FileProgress | None) -> Entry:
        order = self._order_of(path) or ()
        entry = Entry(shown(path), path=path, stat=stat, order=order, seen=now, changed=now, base=known)
        if known is not None and known.verdict != PENDING:
            entry.counted = known.verdict
        with self._lock:
            self._count(entry.counted, -1)
            self.waiting[path] = entry
        self._latest = now
        self.queue(entry)
        return entry

    def _renamed(self, before: str, path: str, stat: Stat) -> None:
        """Carry over what is known of a file that has another name now.

        A number may have gone to another file, so of one that has grown meanwhile the content is compared, as of any
        file that changes.
        """
        entry = self.waiting.get(before)
        known = self._done.get(before) if entry is None else entry.base
        if entry is not None:
            grown = entry.base is not None or entry.read is not None
            if not _may_be(entry.stat.size, entry.stat == stat, stat, grown) or self._order_of(path) is None:
                return
            with self._lock:
                self.waiting[path] = self.waiting.pop(before)
            self._aside.pop(before, None)
            entry.path, entry.key, entry.absent = path, shown(path), None
            entry.order = self._order_of(path) or ()
            if entry.phase in ("queued", "aside"):
                self.queue(entry)
        elif known is None or not _may_be(known.size, _same(known, stat), stat, True):
            return
        if known is not None:
            moved = self._restore(known, shown(path))
            if entry is None:
                del self._done[before]
                self._done[path] = moved
            else:
                entry.base = moved

    def _restore(self, known: FileProgress, key: str) -> FileProgress:
        """Store what is known of a file under another name."""
        moved = replace(known, path=key)
        self._ledger.move(self._source, known.path, moved)
        return moved

    def queue(self, entry: Entry) -> None:
        """Let a file wait for its turn."""
        self._aside.pop(entry.path, None)
        entry.phase = "queued"
        heapq.heappush(self._heap, (entry.order, next(self._tie), entry))

    def put_aside(self, entry: Entry, due: float) -> None:
        """Let the others pass until the file changes, or until ``due``."""
        entry.phase, entry.due = "aside", due
        self._aside[entry.path] = entry

    def settled(self, entry: Entry, now: float) -> bool:
        """Tell whether a file seems to be complete.

        That it was closed is enough only where files come one by one and in order: the first one may be the first of a
        crowd that is being copied in any order.
        """
        if now - entry.changed >= self._settle:
            return True
        return entry.closed and self._taken is not None and entry.order > self._taken

    def _whole(self, entry: Entry, now: float) -> bool:
        """Tell whether the end of a file is the end of what its writer had to say, rather than half a line.

        A writer with a buffer stops anywhere, and may pause for longer than the settling time; but it has closed a file
        that is done, or goes on in the next one.
        """
        if not self.settled(entry, now):
            return False
        later = bool(self._heap) and self._heap[0][0] > entry.order
        return entry.closed or later or now - entry.changed >= _HOLD * self._settle

    def await_end(self, entry: Entry) -> None:
        """Have a file whose last line is not all there read again, when it must be taken for whole."""
        self.put_aside(entry, entry.changed + _HOLD * self._settle)

    def take(self, now: float, period: float | None) -> Entry | None:
        """Return the file whose turn it is, or None where all have to wait.

        A file that is still being written holds back those after it, so that they stay in order, but not for ever; and
        so does a crowd of files that keeps growing, for a folder is copied in any order.

        Args:
            now: present time.
            period: how often a growing file is read while it is written, s, or None: never.
        """
        self._recall(now)
        if self._crowded(now):
            return None
        passed: list[tuple[Order, int, Entry]] = []
        found: Entry | None = None
        while self._heap:
            item = heapq.heappop(self._heap)
            entry = item[2]
            if entry.phase != "queued" or self.waiting.get(entry.path) is not entry:
                continue
            if entry.absent is not None and now - entry.absent < INCOMPLETE_AFTER:
                self.put_aside(entry, entry.absent + INCOMPLETE_AFTER)
            elif entry.stat.regular and entry.stat.size == 0 and now - entry.changed < INCOMPLETE_AFTER:
                self.put_aside(entry, entry.changed + INCOMPLETE_AFTER)
            elif self._ready(entry, now, period):
                found = entry
                entry.whole = self._whole(entry, now)
                entry.phase = "delivered"
                self._taken = entry.order
                break
            else:
                passed.append(item)
                if now - entry.seen < _HOLD * self._settle:
                    break
        for item in passed:
            heapq.heappush(self._heap, item)
        return found

    def _ready(self, entry: Entry, now: float, period: float | None) -> bool:
        if not entry.stat.regular or entry.absent is not None or self.settled(entry, now):
            return True
        return period is not None and now - max(entry.seen, entry.read_at) >= max(period, self._settle)

    def _recall(self, now: float) -> None:
        """Let those who waited aside for a time have their turn, and those whose end is there by now."""
        for entry in list(self._aside.values()):
            ended = not entry.whole and entry.read is not None and entry.read.is_part and self._whole(entry, now)
            if entry.due <= now or ended:
                self.queue(entry)

    def _crowded(self, now: float) -> bool:
        if len(self._heap) <= _BULK or now - self._latest >= self._settle:
            return False
        first = next(iter(self.waiting.values()), None)
        return first is not None and now - first.seen < _HOLD * self._settle

    def held(self) -> Iterator[Entry]:
        """Iterate over the files of which samples wait for more."""
        return (entry for entry in self.waiting.values() if entry.phase == "held")

    def settle(self, entry: Entry, progress: FileProgress) -> None:
        """File an entry under its verdict; if it has changed meanwhile, the next scan takes it up again."""
        if progress.path != entry.key:
            # It was renamed while its last block was on its way.
            progress = self._restore(progress, entry.key)
        self.leave(entry, progress.verdict)
        self._done[entry.path] = progress

    def leave(self, entry: Entry, verdict: str | None) -> None:
        """Let an entry wait no more, and count it under a verdict, None: not at all."""
        with self._lock:
            if self.waiting.get(entry.path) is entry:
                del self.waiting[entry.path]
                self._count(verdict, 1)
        self._aside.pop(entry.path, None)
        entry.phase = "delivered"

    def adopt(self, entry: Entry, known: FileProgress) -> None:
        """Find out that an entry is a file known by another name, which is gone: it was renamed, not offered."""
        self.leave(entry, None)
        self._done[entry.path] = self._restore(replace(known, mtime_ns=entry.stat.mtime_ns), entry.key)

    def renew(self, entry: Entry) -> None:
        """Take the content of a known name for another file: what it held before keeps its verdict."""
        base = entry.base
        if base is not None:
            verdict = ACCEPTED if base.verdict == PENDING else base.verdict
            self._restore(replace(base, verdict=verdict), f"{base.path}{ARCHIVED}{base.content_hash}")
            with self._lock:
                self._count(verdict, 1)
        entry.base = entry.counted = None
        entry.fed = entry.total = entry.blocks = 0

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
            accepted, rejected = self._accepted, self._rejected
        age = 0.0 if first is None else max(0.0, now - first.seen)
        return Backlog(accepted + rejected + pending, accepted, rejected, pending, age)


def _same(progress: FileProgress, stat: Stat) -> bool:
    return (progress.size, progress.mtime_ns, progress.inode) == (stat.size, stat.mtime_ns, stat.inode)


def _may_be(size: int, same: bool, stat: Stat, may_grow: bool) -> bool:
    return same or (may_grow and stat.size > size)
