"""The recordings of an index that wait, replayed by the workers of a runner and noted as their results come.

Short recordings are replayed several to a task, so that what a task costs beside the work is small; a task that fails
or loses its worker is taken apart, and each of its recordings tried alone.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from statistics import median

from models.work.folder_store import open_store
from models.work.redact import redact
from models.work.runner import Runner
from models.work.task import Failure, FileStore, Progress
from monitor.fleet.history import Position
from monitor.fleet.index import Index
from monitor.fleet.part import MAX_PART_RECORDINGS, REPLAYS, PartResult, RecordingPart, SharedPlaces, write_result
from monitor.fleet.result import DONE, FAILED, SET_ASIDE, Checkpoint, RecordingOutcome, RecordingResult, Waiting

TASK_SECONDS = 2.0
"""Work of a task, as far as short recordings make it up."""
MAX_GROUP = 64
_KNOWN_TIMES = 8
_NOTED_TOGETHER = 64
_NOTED_AFTER_S = 2.0

_Group = tuple[RecordingPart, ...]
_Done = tuple[PartResult | None, ...]


@dataclass
class _UnderWay:
    """A recording of which a part is being replayed: its row, the state that the part began from, the parts before."""

    row: Waiting
    state: str | None
    before: RecordingResult | None = None


@dataclass
class Replaying:
    """Replays the recordings of an index that wait.

    Attributes:
        signed: URLs with what must not be written, by the URL without it.
        noted: called after outcomes were noted; returns whether a later process will find them in the index.
    """

    index: Index
    shared: SharedPlaces
    runner: Runner
    signed: dict[str, str] = field(default_factory=dict[str, str])
    noted: Callable[[], bool] = lambda: True
    _tasks: list[tuple[int, ...]] = field(default_factory=list[tuple[int, ...]])
    _under_way: dict[int, _UnderWay] = field(default_factory=dict[int, _UnderWay])
    _alone: list[Waiting] = field(default_factory=list[Waiting])
    _outcomes: list[RecordingOutcome] = field(default_factory=list[RecordingOutcome])
    _passed: list[str] = field(default_factory=list[str])
    _states: frozenset[str] | None = None
    _moved: bool = False
    _seconds: deque[float] = field(default_factory=lambda: deque[float](maxlen=_NOTED_TOGETHER))
    _ended: int = 0
    _wrong: int = 0

    def run(self) -> None:
        """Replay all; what was done is noted, also where this is interrupted."""
        notify, total, began = self.runner.notify, self.index.left(), time.monotonic()

        def tell(progress: Progress) -> None:
            if notify is not None:
                done = self._ended
                left = (time.monotonic() - began) * (total - done) / done if done else None
                notify(replace(progress, done=done, total=total, kept=0, failed=self._wrong, seconds_left=left))

        self.runner.notify = None if notify is None else tell
        try:
            self._run(self._groups())
            # What has failed together is replayed alone, and long recordings go on.
            self._run(self._task([self._first_part(row)]) for row in self._alone)
        except KeyboardInterrupt as error:
            error.add_note(f"{self._ended} recordings more are in the index; --resume goes on with the others")
            raise
        finally:
            self.runner.notify = notify
            self._note()

    def _run(self, groups: Iterable[_Group]) -> None:
        records = open_store(self.shared.records)
        since = time.monotonic()
        self._tasks.clear()
        for number, found in self.runner.outcomes(REPLAYS, self.shared, groups, follow=self._following):
            self._take(number, found, records)
            if len(self._outcomes) >= _NOTED_TOGETHER or time.monotonic() - since >= _NOTED_AFTER_S:
                since = time.monotonic()
                self._note()

    def _note(self) -> None:
        """Note outcomes, and delete the states of which nothing can go on any more."""
        outcomes, self._outcomes = self._outcomes, []
        if outcomes:
            self.index.note(outcomes)
        if not outcomes and not self._moved:
            return
        self._moved = False
        # A process that is killed must find the states that the index names, as it was kept last.
        if self.noted():
            passed, self._passed = self._passed, []
            work = open_store(self.shared.work)
            for state in passed:
                work.delete(state)

    def _groups(self) -> Iterator[_Group]:
        """Yield the recordings that wait, short ones together; a history, and what failed before, is alone."""
        group: list[RecordingPart] = []
        for row in self.index.waiting():
            part = self._first_part(row)
            if part.is_history or part.state is not None or part.attempt:
                yield self._task([part])
                continue
            group.append(part)
            if len(group) >= self._size():
                yield self._task(group)
                group = []
        if group:
            yield self._task(group)

    def _size(self) -> int:
        if len(self._seconds) < _KNOWN_TIMES:
            return 1
        return max(1, min(MAX_GROUP, int(TASK_SECONDS / max(median(self._seconds), 1e-3))))

    def _task(self, parts: list[RecordingPart]) -> _Group:
        self._tasks.append(tuple(part.recording for part in parts))
        return tuple(parts)

    def _is_kept(self, state: str) -> bool:
        if self._states is None:
            self._states = frozenset(open_store(self.shared.work).names("states/"))
        return state in self._states

    def _first_part(self, row: Waiting) -> RecordingPart:
        """Return where a recording goes on, its beginning where the state is gone, as after a loss of power."""
        position, state, before = self.index.checkpoint(row.id) or (Position(), None, None)
        if state is not None and not self._is_kept(state):
            row, position, state, before = self.index.begin_anew(row), Position(), None, None
        self._under_way[row.id] = _UnderWay(row, state, before)
        return self._part(row, position, state)

    def _part(self, row: Waiting, begin: Position, state: str | None) -> RecordingPart:
        most = min(MAX_PART_RECORDINGS, self.shared.part_blocks)
        first = [] if begin.recording else [row.url]
        urls = [*first, *self.index.links(row.id, max(begin.recording - 1, 0), most - len(first))]
        return RecordingPart(
            row.id,
            row.machine,
            row.name,
            row.setup,
            tuple(self.signed.get(url, url) for url in urls),
            row.url,
            more=self.index.last_link(row.id) >= begin.recording + len(urls),
            continued=row.history == "continued",
            begin=begin,
            state=state,
            attempt=row.attempt,
        )

    def _following(self, parts: _Group, done: _Done) -> _Group | None:
        """Return the next part of a recording that is alone."""
        if len(parts) > 1:
            return None
        for part, one in zip(parts, done, strict=True):
            if one is not None and one.following is not None:
                return (self._part(self._under_way[part.recording].row, one.following, one.state),)
        return None

    def _take(self, number: int, found: _Done | Failure, records: FileStore) -> None:
        """Note the recordings of a task."""
        ids = self._tasks[number]
        if isinstance(found, Failure) and len(ids) == 1:
            self._set_aside(number, ids[0], found, records)
            return
        if isinstance(found, Failure):
            self._forget_failure(number)
            found = (None,) * len(ids)
        for row_id, done in zip(ids, found, strict=True):
            if done is None or (not self._take_one(row_id, done, records) and len(ids) > 1):
                self._alone.append(self._under_way.pop(row_id).row)

    def _take_one(self, row_id: int, done: PartResult, records: FileStore) -> bool:
        """Note a part: where its recording ends, the outcome; else from where it goes on. Return whether it ends."""
        under_way = self._under_way[row_id]
        row, before = under_way.row, under_way.before
        result = done.result if before is None else before.followed_by(done.result)
        self.index.keep_folders(row_id, done.folders)
        if done.following is not None:
            self.index.keep_checkpoint(row_id, Checkpoint(done.following, done.state, result))
            self._under_way[row_id] = _UnderWay(row, done.state, result)
            self._moved = True
        else:
            if before is not None:
                write_result(records, result, again=row.attempt > 0)
            self._seconds.append(result.seconds)
            outcome = _outcome(row_id, DONE if result.status == "done" else FAILED, result)
            end = None if done.end is None else Checkpoint(done.end, done.state, result)
            self._end(outcome._replace(end=end))
        # A history that failed goes on from its latest state once its recording is repaired.
        if under_way.state is not None and result.status == "done" and under_way.state != done.state:
            self._passed.append(under_way.state)
        return done.following is None

    def _set_aside(self, number: int, row_id: int, failure: Failure, records: FileStore) -> None:
        under_way = self._under_way[row_id]
        row, before = under_way.row, under_way.before
        result = RecordingResult(row.machine, row.name, row.url, "failed", redact(failure.message))
        result = result if before is None else before.followed_by(result)
        write_result(records, result)
        place = self._failed_at(number)
        chunk = None if place is None else self.runner.tally.failed[place].chunk
        self._end(_outcome(row_id, SET_ASIDE, result)._replace(chunk=chunk, log=redact(failure.log)))

    def _end(self, outcome: RecordingOutcome) -> None:
        self._outcomes.append(outcome)
        self._ended += 1
        self._wrong += outcome.status != DONE
        del self._under_way[outcome.id]

    def _failed_at(self, number: int) -> int | None:
        """Return the place of the latest failure of a task in the tally of the runner."""
        label, failed = f"{REPLAYS.name} {number + 1}", self.runner.tally.failed
        places = (at for at in reversed(range(len(failed))) if failed[at].label.partition(",")[0] == label)
        return next(places, None)

    def _forget_failure(self, number: int) -> None:
        """Take a task out of the tally whose recordings are tried alone."""
        place = self._failed_at(number)
        if place is not None:
            del self.runner.tally.failed[place]


def _outcome(row_id: int, status: int, result: RecordingResult) -> RecordingOutcome:
    reason = result.reason or None
    return RecordingOutcome(row_id, status, result.rows, result.first, result.last, result.seconds, reason=reason)
