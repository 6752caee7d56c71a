"""A watched folder as a live source.

A periodic scan is compared with the ledger; events only trigger it early. Pending files stay on the disk.
"""

from __future__ import annotations

import logging
import stat
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from models.platform.supervision import Restarts
from streams.dates.dater import Dater
from streams.dates.dating import Dating, kept_dating
from streams.files.container import Folder, check_readable
from streams.files.datasets import DataSet
from streams.files.groups import FilesBeside, is_member, name_groups
from streams.files.load import Loader, is_cut, is_dated_by_choice
from streams.files.recognise import data_set_of
from streams.files.sidecar import is_pulse_file
from streams.folder.copying import Order
from streams.folder.intake import Intake
from streams.folder.reading import Background, FileTask
from streams.folder.register import MAX_INCOMPLETE_S, Register
from streams.folder.watch import FolderWatch
from streams.types.listing import CLOSED, Stat, is_skipped, natural_key, shown, stat_file, walk_files
from streams.types.source import MAX_IGNORED_NAMES, Backlog, Delivery, Ledger, LiveSource
from streams.types.spec import SourceError, SourceSpec
from streams.types.stamps import date_folders

_LOG = logging.getLogger(__name__)
_MAX_NOTED = 8
_MIN_PAUSE_SCANS = 20.0
"""Pause after a scan, in durations of its listing: what the store delays must not delay the next."""
_RETRY_S = 30.0
"""Time after which files of no known format are read again though they have not changed."""
_OVERFLOW_SHOWN_S = 60.0
"""Time for which lost events are shown as a problem."""


class FolderClock:
    """The clock of the machine; tests set their own."""

    def monotonic(self) -> float:
        """Return seconds that never decrease."""
        return time.monotonic()

    patience_s = 0.02
    """Time for which a source waits for a file before it lets the others go on."""

    def wait(self, event: threading.Event, seconds: float) -> None:
        """Wait until an event is set, at most ``seconds``."""
        event.wait(seconds)


class FolderSource(LiveSource):
    """The files of a folder, each accepted, rejected with a reason, or pending.

    A file is taken when it was closed after writing or moved in, or has not changed for the settling time, and is as
    long as its header declares. A data set of snapshots gives one block a file, under its own number if any; other
    files are cut into blocks that continue over files whose times do. A CSV or TDMS file that grows is continued.
    """

    def __init__(self, spec: SourceSpec, root: str, clock: FolderClock | None = None) -> None:
        """Prepare; the folder is not read before :meth:`open`."""
        self.name = spec.name
        self._spec = spec
        self._root = Path(root).expanduser()
        self._real = self._root
        self._clock = clock or FolderClock()
        self._loader: Loader | None = None
        self._intake: Intake | None = None
        self._recognition: FileTask | None = None
        self._wake = threading.Event()
        self._background = Background(self._wake.set, self._note, f"the reader of {self.name}")
        self._watch = FolderWatch(self._wake.set, f"the watch of {self.name}")
        self._identity: tuple[int, int] | None = None
        self._problem: str | None = None
        self._unknown: str | None = None
        self._named: list[str] = []
        self._judged = -1
        self._tried: dict[str, Stat] = {}
        self._retry = 0.0
        self._next_scan = 0.0
        self._scanning: Iterator[bool] | None = None
        self._scan_began = self._scan_s = 0.0
        self._unscanned = 0
        self._overflows = 0
        self._overflowed: float | None = None
        self._ledger: Ledger
        self._kept: Dating | None = None
        self._register: Register

    def check(self, *, taken: bool = False) -> None:
        """Raise SourceError where :meth:`open` would; ``taken`` has no meaning for folders."""
        self._look()

    def open(self, ledger: Ledger) -> None:
        """Begin with the pending files of the ledger.

        A missing folder may be created later, and is a :meth:`problem`.

        Raises:
            SourceError: the folder is a file or may not be read, or the configuration names no known format.
        """
        self._real, data_set = self._look()
        self._ledger = ledger
        self._kept = kept_dating(self._spec, ledger)
        if self._kept is not None and self._kept.by == "nothing":
            unused = "" if self._spec.start is None else "start_utc is not used: "
            _LOG.warning(
                "source %s: %sits blocks have no date; to date later ones: spallwatch redate", self.name, unused
            )
        if data_set is not None:
            self._load_as(data_set)
        self._intake = None
        now = self._clock.monotonic()
        spec = self._spec
        beside = FilesBeside(spec.pulses, spec.files)
        self._register = Register(self.name, ledger, spec.settle_s, self._order_of, now, beside)
        self._next_scan = now

    def _look(self) -> tuple[Path, DataSet | None]:
        """Return the folder without links and the data set of the configured format, None for "auto"."""
        where = f"[[source]] {self.name}"
        try:
            if not stat.S_ISDIR(self._root.stat().st_mode):
                raise SourceError(f"{where}: url: expected a folder, {str(self._root)!r} is a file")
            check_readable(self._root, f"{where}: url")
            real = self._root.resolve()
        except PermissionError as error:
            raise SourceError(f"{where}: url: {str(self._root)!r} may not be read ({error.strerror})") from error
        except OSError:
            # The scan reports it as a problem.
            real = self._root.absolute()
        if self._spec.format.strip().lower() == "auto":
            return real, None
        return real, data_set_of(self._spec, Folder(real, ()), self._spec.format)

    def next(self, timeout: float) -> Delivery | None:
        """Return the next delivery, or None after ``timeout`` seconds without one."""
        deadline = self._clock.monotonic() + timeout
        while True:
            now = self._clock.monotonic()
            if self._intake is not None and self._intake.ready:
                return self._intake.ready.popleft()
            self._wake.clear()
            self._poll(now)
            if self._scanning is not None:
                # The order of the files is known at the end of the scan.
                if now < deadline:
                    continue
                return None
            # Files that wait for a date give nothing, however many there are: other sources must have their turn.
            if self._advance(now) and (now < deadline or (self._intake is not None and self._intake.ready)):
                continue
            if now >= deadline:
                return None
            left = min(deadline, self._next_scan) - now
            self._clock.wait(self._wake, max(0.01, min(left, self._spec.settle_s / 4)))

    def acknowledge(self, delivery: Delivery) -> None:
        """Record that a delivery is committed."""
        if self._intake is not None:
            self._intake.acknowledge(delivery)

    def queued_blocks(self) -> float:
        """Return about how many blocks wait to be delivered: a file counts as many as the files before gave.

        All files of a scan that takes long count, until they are compared with the ledger.
        """
        waiting = self._register.queued if self._intake is None else self._intake.queued_blocks()
        return waiting + self._unscanned

    def ready_blocks(self) -> int:
        """Return how many blocks :meth:`next` gives at once."""
        return 0 if self._intake is None else len(self._intake.ready)

    def tend(self) -> None:
        """Start the background again where its thread has ended."""
        self._background.tend()

    def restarts(self) -> tuple[Restarts, ...]:
        """Return what is known of the failures of its threads."""
        return self._background.restarts, self._watch.restarts

    def backlog(self) -> Backlog:
        """Return the counts of files."""
        return self._register.backlog(self._clock.monotonic())

    def ignored(self) -> dict[str, str]:
        """Return why files of another format are ignored, by name; at most ``MAX_IGNORED_NAMES``."""
        names = self._register.ignored[:MAX_IGNORED_NAMES]
        return {
            shown(path): "" if self._loader is None else self._loader.reason_to_ignore(path, None) for path in names
        }

    def problem(self) -> str | None:
        """Return why the folder gives nothing, or that events were lost, or None."""
        waits = None if self._intake is None else self._intake.waits
        background = self._background.problem() or self._watch.restarts.problem()
        return self._problem or self._unknown or waits or background or self._lost_events(self._clock.monotonic())

    def close(self) -> None:
        """Stop watching; unacknowledged files are delivered again."""
        self._watch.stop()
        self._background.close()
        self._background = Background(self._wake.set, self._note, f"the reader of {self.name}")
        self._intake = self._recognition = self._scanning = None
        self._identity, self._unscanned = None, 0

    def _poll(self, now: float) -> None:
        """Go on with the scan, for a short time; begin one where due, or where events were lost.

        Files that events name are observed between two scans: a scan has an older status of them.
        """
        if self._scanning is None:
            self._take_events(now)
            if now < self._next_scan:
                return
            self._scanning, self._scan_began, self._scan_s = self._scan(now), now, 0.0
        began = before = self._clock.monotonic()
        try:
            for lists in self._scanning:
                now = self._clock.monotonic()
                if lists:
                    self._scan_s += now - before
                before = now
                if now - began >= self._clock.patience_s:
                    return
        except BaseException:
            self._scanning, self._unscanned = None, 0
            raise
        self._scanning, self._unscanned = None, 0
        self._next_scan = self._scan_began + max(self._spec.settle_s / 2, _MIN_PAUSE_SCANS * self._scan_s, 0.1)

    def _take_events(self, now: float) -> None:
        """Observe the files that events name; have a scan where events were lost."""
        if self._watch.overflows != self._overflows:
            self._overflows, self._overflowed = self._watch.overflows, now
            self._next_scan = now
            _LOG.warning("source %s: %s", self.name, self._lost_events(now))
        for path in self._watch.finished():
            found = stat_file(str(self._real), path)
            if found is not None and not any(map(is_skipped, path.split("/"))):
                self._register.observe(path, found, now, closed=True)

    def _scan(self, now: float) -> Iterator[bool]:
        """Watch the folder where it is new, then compare it with the ledger; yield after each file whether it lists."""
        try:
            status = self._root.stat()
            if self._watch.tend() or (status.st_dev, status.st_ino) != self._identity:
                if self._identity is not None:
                    _LOG.warning(
                        "source %s: %s was replaced or sends no more events; watched again", self.name, self._root
                    )
                self._real = self._root.resolve()
                if self._loader is not None:
                    self._loader.root = self._real
                self._watch.start(self._real)
                self._identity = (status.st_dev, status.st_ino)
            closed: list[str] = []
            listing: dict[str, Stat] = {}
            for path, found in walk_files(str(self._real), closed):
                listing[path] = found
                self._unscanned += 1
                yield True
        except OSError as error:
            self._set_problem(f"{self._root}: cannot be read ({error.strerror})")
            self._identity = None
            return
        self._set_problem(f"{self._root / closed[0]}: {CLOSED}" if closed else None)
        for key in self._ledger.released(self.name):
            self._register.release(key)
        for _ in self._register.update(listing, now):
            self._unscanned -= 1
            yield False

    def _note(self, keys: tuple[str, ...]) -> None:
        """Note the files that the background handles."""
        self._ledger.handle(self.name, keys)

    def _lost_events(self, now: float) -> str | None:
        """Return that the kernel dropped events, for some time after it did."""
        if self._overflowed is None or now - self._overflowed >= _OVERFLOW_SHOWN_S:
            return None
        times = f" ({self._overflows} times since the start)" if self._overflows > 1 else ""
        return f"{self._root}: more events than the system keeps, some were lost{times}; files are found by scanning"

    def assumes_interval(self) -> bool:
        """Return whether its files are counted and no ``interval_s`` states how far they are apart."""
        dater = None if self._loader is None else self._loader.dater
        return dater is not None and dater.choice.by == "count" and dater.choice.interval is None

    def _set_problem(self, problem: str | None) -> None:
        if problem != self._problem:
            _LOG.warning("source %s: %s", self.name, problem or f"{self._root} can be read again")
        self._problem = problem

    def _load_as(self, data_set: DataSet) -> None:
        dater = None
        if is_dated_by_choice(self._spec, data_set):
            dater = Dater(
                self._spec,
                self._kept,
                cut=is_cut(self._spec, data_set),
                keep=lambda choice: self._ledger.keep_dating(self.name, choice.to_dict()),
                names=lambda: self._register.paths(),
                above=date_folders(str(self._real)),
            )
        self._loader = Loader(self._spec, data_set, self._real, dater=dater)

    def _order_of(self, path: str) -> Order | None:
        if is_pulse_file(self._spec.pulses, path) or is_member(self._spec.files, path):
            return None
        if self._loader is None:
            return natural_key(path)
        facts = self._loader.facts(path)
        return None if facts is None else facts.order

    def _recognise(self, now: float) -> bool:
        """Recognise the kind of the first files; return whether that succeeded."""
        register = self._register
        for entry in [entry for entry in register.waiting.values() if entry.state.absent is not None]:
            if now - (entry.state.absent or 0.0) >= MAX_INCOMPLETE_S:
                _LOG.warning("source %s: %s is gone before it could be recognised", self.name, entry.key)
                register.remove(entry, None)
        patience = 0.0
        if self._recognition is None:
            self._recognition, patience = self._begin_recognition(now), self._clock.patience_s
        if self._recognition is None or not self._recognition.is_done(patience):
            return False
        task, self._recognition = self._recognition, None
        try:
            self._load_as(task.future.result())
        except SourceError as error:
            self._unknown, self._retry = str(error), now + _RETRY_S
            return False
        self._unknown = None
        register.reorder()
        return True

    def _is_mixed(self, data_set: DataSet) -> bool:
        """Return whether the names of the files are those of several channels, which is a problem then."""
        if self._spec.files or not data_set.plain:
            return False
        register = self._register
        if self._unknown is None and register.entered == self._judged:
            return False
        self._judged, paths = register.entered, register.recent_paths(sampled=True)
        if paths != self._named:
            self._named, groups = paths, name_groups(paths)
            if groups is not None:
                # A sample of a long row has names without their counterparts.
                groups = name_groups(register.recent_paths())
            mixed = None if groups is None or not groups.is_certain else f"{self._root}: {groups.words}"
            if groups is not None and self._unknown is None:
                _LOG.warning("source %s: %s: %s", self.name, self._root, groups.words)
            self._unknown = mixed
        return self._unknown is not None

    def _begin_recognition(self, now: float) -> FileTask | None:
        """Begin to read the first settled files; None where there are none."""
        register = self._register
        ready = {
            entry.path: entry.state.stat
            for entry in register.waiting.values()
            if register.is_settled(entry, now)
            and entry.state.absent is None
            and (
                (entry.state.stat.regular and entry.state.stat.size > 0)
                or now - entry.state.changed >= MAX_INCOMPLETE_S
            )
        }
        poisoned = [path for path in ready if register.inquiry.is_poisoned(shown(path))]
        if poisoned and len(poisoned) == len(ready):
            self._unknown = f"{shown(poisoned[0])}: the monitor died repeatedly while it handled this file"
        if len(poisoned) == len(ready) or (ready == self._tried and now < self._retry):
            return None
        self._tried = ready
        # After a restart the format is that of the blocks so far.
        paths = sorted(register.taken_paths() or ready.keys() - poisoned, key=natural_key)
        files, size = Folder(self._real, paths), sum(ready[path].size for path in paths if path in ready)
        keys = tuple(map(shown, paths[:_MAX_NOTED]))
        return self._background.start(lambda: data_set_of(self._spec, files, "auto"), keys, size)

    def _advance(self, now: float) -> bool:
        """Take the next files; return whether anything happened."""
        if self._loader is None and not self._recognise(now):
            return False
        if self._loader is not None and self._is_mixed(self._loader.data_set):
            return False
        if self._intake is None and self._loader is not None:
            self._intake = Intake(
                *(self._spec, self._loader, self._ledger, self._register),
                *(self._background, self._clock.patience_s),
            )
        return self._intake is not None and self._intake.advance(now)
