"""The replay of an archive: planned once, replayed by the workers of a runner, noted in the index as results come."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from models.work.folder_store import FolderStore
from models.work.redact import redact
from models.work.runner import Runner
from models.work.stores import open_store
from models.work.task import Failure, Store
from monitor.archive.history import Position
from monitor.archive.index import DONE, FAILED, SET_ASIDE, Counts, Index, Outcome, Waiting
from monitor.archive.manifest import ManifestError
from monitor.archive.part import (
    MAX_PART_RECORDINGS,
    PART_BLOCKS,
    REPLAYS,
    Part,
    PartResult,
    Shared,
    read_result,
    write_result,
)
from monitor.archive.plan import Planner, check_unchanged, signed_urls
from monitor.archive.result import RecordingResult

Records = Literal["days", "zarr"]
_NOTED_TOGETHER = 64
_NOTED_AFTER_S = 2.0


@dataclass(frozen=True)
class Plan:
    """What is asked for.

    Attributes:
        manifest: file of the manifest.
        out: folder or URL of the archive, which all workers reach.
        records: "days": a netCDF file a UTC day; "zarr": one store.
        part_blocks: blocks of a history after which its state is kept.
        resume: whether an archive that was begun is continued.
    """

    manifest: Path
    out: str
    records: Records = "days"
    part_blocks: int = PART_BLOCKS
    resume: bool = False

    @property
    def work(self) -> str:
        """URL of what is needed until the archive is complete."""
        return f"{self.out.rstrip('/')}/work"

    @property
    def zarr_url(self) -> str:
        """URL of the one Zarr store."""
        return f"{self.out.rstrip('/')}/records.zarr"

    @property
    def records_url(self) -> str:
        """URL of the store of the daily files."""
        return self.out if self.records == "days" else f"{self.work}/records"


@dataclass(frozen=True)
class Results:
    """The results of an archive in the order of its manifest, read anew at each iteration."""

    index: Index
    records: Store

    def __iter__(self) -> Iterator[RecordingResult]:
        """Yield the result of each recording that does not wait; ArchiveError where one is missing."""
        for machine, name in self.index.folders():
            yield read_result(self.records, f"{machine}/{name}")


@dataclass
class _UnderWay:
    """A recording of which a part is being replayed: its row, the state that the part began from, the parts before."""

    row: Waiting
    state: str | None
    before: RecordingResult | None = None


def prepare(plan: Plan, index: Index) -> Shared:
    """Plan an archive, or check that one goes on as it was planned; return what its tasks share.

    Raises:
        ManifestError: the manifest cannot be used or has changed; there is an archive already, and it is not resumed.
        ConfigError: a configuration cannot be used.
    """
    meta = index.meta()
    work = open_store(plan.work)
    if "manifest" in meta and not plan.resume:
        raise ManifestError(f"--out {plan.out}: holds an archive; --resume continues it, or take another --out")
    if "manifest" not in meta:
        index.set_meta(archive=secrets.token_hex(8), records=plan.records, part_blocks=str(plan.part_blocks))
        Planner(index, work).plan(plan.manifest)
        meta = index.meta()
    else:
        check_unchanged(index, plan.manifest, work)
        index.wait_again()
    if meta["records"] != plan.records:
        raise ManifestError(f"--out {plan.out}: was begun with --records {meta['records']}, got {plan.records}")
    return Shared(meta["archive"], open_store(plan.records_url).url, work.url, int(meta["part_blocks"]))


@dataclass
class Replaying:
    """Replays the recordings of an index that wait.

    Attributes:
        signed: URLs with what must not be written, by the URL without it.
        noted: called after outcomes were noted.
    """

    index: Index
    shared: Shared
    runner: Runner
    signed: dict[str, str] = field(default_factory=dict[str, str])
    noted: Callable[[], None] = lambda: None
    _numbers: dict[int, int] = field(default_factory=dict[int, int])
    _under_way: dict[int, _UnderWay] = field(default_factory=dict[int, _UnderWay])
    _outcomes: list[Outcome] = field(default_factory=list[Outcome])

    def run(self) -> None:
        """Replay all; what was done is noted, also where this is interrupted."""
        records, work = open_store(self.shared.records), open_store(self.shared.work)
        total = self.index.left()
        since = time.monotonic()
        try:
            for number, found in self.runner.outcomes(
                REPLAYS, self.shared, self._parts(), total=total, follow=self._following
            ):
                self._take(number, found, records, work)
                if len(self._outcomes) >= _NOTED_TOGETHER or time.monotonic() - since >= _NOTED_AFTER_S:
                    since = time.monotonic()
                    self._note()
        finally:
            self._note()

    def _note(self) -> None:
        outcomes, self._outcomes = self._outcomes, []
        if outcomes:
            self.index.note(outcomes)
            self.noted()

    def _parts(self) -> Iterator[Part]:
        for number, row in enumerate(self.index.waiting()):
            self._numbers[number] = row.id
            kept = self.index.checkpoint(row.id)
            position, state, before = (Position(), None, None) if kept is None else kept
            self._under_way[row.id] = _UnderWay(row, state, before)
            yield self._part(row, position, state)

    def _part(self, row: Waiting, begin: Position, state: str | None) -> Part:
        most = min(MAX_PART_RECORDINGS, self.shared.part_blocks)
        first = [] if begin.recording else [row.url]
        urls = [*first, *self.index.links(row.id, max(begin.recording - 1, 0), most - len(first))]
        more = self.index.last_link(row.id) >= begin.recording + len(urls)
        return Part(
            row.id,
            row.machine,
            row.name,
            row.setup,
            tuple(self.signed.get(url, url) for url in urls),
            row.url,
            more=more,
            begin=begin,
            state=state,
            attempt=row.attempt,
        )

    def _following(self, part: Part, done: PartResult) -> Part | None:
        if done.following is None:
            return None
        return self._part(self._under_way[part.recording].row, done.following, done.state)

    def _take(self, number: int, found: PartResult | Failure, records: Store, work: Store) -> None:
        """Note a part: where its recording ends, the outcome; else from where it goes on."""
        row_id = self._numbers[number]
        under_way = self._under_way[row_id]
        row, before = under_way.row, under_way.before
        if isinstance(found, Failure):
            message, log = redact(found.message), redact(found.log)
            result = RecordingResult(row.machine, row.name, row.url, "failed", message)
            result = result if before is None else before.followed_by(result)
            write_result(records, result)
            chunk = self._chunk_of(number)
            self._end(number, _outcome(row_id, SET_ASIDE, result)._replace(chunk=chunk, log=log))
            return
        result = found.result if before is None else before.followed_by(found.result)
        if found.following is not None:
            self.index.keep_checkpoint(row_id, (found.following, found.state, result))
            self._under_way[row_id] = _UnderWay(row, found.state, result)
        else:
            if before is not None:
                write_result(records, result)
            self._end(number, _outcome(row_id, DONE if result.status == "done" else FAILED, result))
        # A history that failed goes on from its latest state once its recording is repaired.
        if under_way.state is not None and result.status == "done" and under_way.state != found.state:
            work.delete(under_way.state)

    def _end(self, number: int, outcome: Outcome) -> None:
        self._outcomes.append(outcome)
        del self._under_way[self._numbers.pop(number)]

    def _chunk_of(self, number: int) -> str | None:
        """Return the key of the latest chunk of a task that was set aside."""
        label = f"{REPLAYS.name} {number + 1}"
        chunks = (one for one in reversed(self.runner.tally.failed) if one.label.partition(",")[0] == label)
        return next((one.chunk for one in chunks), None)


def _outcome(row_id: int, status: int, result: RecordingResult) -> Outcome:
    reason = result.reason or None
    return Outcome(row_id, status, result.rows, result.first, result.last, result.seconds, reason=reason)


def replay_waiting(plan: Plan, index: Index, runner: Runner, noted: Callable[[], None] = lambda: None) -> Counts:
    """Plan an archive unless that is done, replay what waits, and return the counts.

    Raises:
        ManifestError, ConfigError: as :func:`prepare`.
    """
    shared = prepare(plan, index)
    noted()
    signed = signed_urls(plan.manifest) if index.meta()["signed"] == "yes" else {}
    Replaying(index, shared, runner, signed, noted).run()
    return index.counts()


def delete_work(plan: Plan) -> None:
    """Delete what an archive needs no more once it is complete."""
    work = open_store(plan.work)
    for name in [*work.names()]:
        work.delete(name)
    if isinstance(work, FolderStore):
        work.remove_if_empty()
