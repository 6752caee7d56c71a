"""The table of a file's life against random orders of events."""

from __future__ import annotations

from dataclasses import dataclass, field

from hypothesis import given, settings
from hypothesis import strategies as st

from streams.folder.life import (
    PHASES,
    TABLE,
    BlockDelivered,
    ChangedMeanwhile,
    Committed,
    Continued,
    Drained,
    Emitted,
    FileEntry,
    FileEvent,
    FileState,
    Missing,
    Observed,
    Postponed,
    ReadingBegun,
    ReadingEnded,
    Removed,
    Renamed,
    Replaced,
    Retried,
    Taken,
    advance,
)
from streams.types.listing import Stat
from streams.types.source import ACCEPTED, PENDING, FileProgress

FILES = 2
STEPS = ("grow", "scan", "take", "end", "cut", "commit", "rename", "retry", "postpone", "log", "read")
"""A log grows by some samples and is read at once, or waits for its turn."""
PROGRESS = FileProgress("f", 9, 1, 1, read_bytes=9, samples=9, verdict=ACCEPTED)
EVENTS: tuple[FileEvent, ...] = (
    *(Observed(Stat(9, 1, 1), 1.0), Observed(Stat(8, 2, 1), 2.0, closed=True), Missing(3.0), Renamed(None), Retried()),
    *(Postponed(4.0), Taken(whole=True), ReadingBegun(5.0), ReadingEnded(), ChangedMeanwhile(None, 6.0), Continued(3)),
    *(Replaced(), Emitted(PROGRESS, 9, cut=True), Emitted(PROGRESS, 9, cut=False), BlockDelivered(1), Drained()),
    *(Committed(PROGRESS), Removed()),
)


@dataclass
class Disk:
    """A log on the disk, a byte a sample, and what happened to its samples."""

    size: int = 3
    version: int = 1
    entry: FileEntry | None = None
    done: FileProgress | None = None
    read: tuple[int, int, bool] = (0, 0, False)
    buffer: list[tuple[int, int]] = field(default_factory=list)
    emitted: int = 0
    outstanding: list[FileProgress] = field(default_factory=list)

    @property
    def stat(self) -> Stat:
        return Stat(self.size, self.version, 1)


def tell(disk: Disk, event: FileEvent) -> tuple[str, ...]:
    assert disk.entry is not None
    return disk.entry.happen(event)


def finish(disk: Disk, progress: FileProgress) -> None:
    assert progress.samples == disk.emitted, "a file is finished with all of its samples"
    tell(disk, Removed())
    disk.entry, disk.done = None, progress


def scan(disk: Disk) -> None:
    if disk.entry is None:
        if disk.done is not None and disk.done.is_of(disk.stat):
            return
        counted = None if disk.done is None else disk.done.verdict
        state = FileState(stat=disk.stat, changed=0.0, base=disk.done, counted=counted)
        disk.entry, disk.done = FileEntry("f", path="f", order=(), seen=0.0, state=state), None
    before = disk.entry.state
    tell(disk, Observed(disk.stat, 1.0))
    if before.phase in ("deferred", "held") and before.stat != disk.stat:
        assert disk.entry.state.phase == "queued", "a changed file is noticed"
    assert before.phase == "reading" or disk.entry.state.stat == disk.stat


def end(disk: Disk) -> None:
    """Hand the result of a reading over, as the intake does."""
    assert disk.entry is not None
    size, version, whole = disk.read
    tell(disk, ReadingEnded())
    state = disk.entry.state
    if whole and version != state.stat.mtime_ns:
        tell(disk, ChangedMeanwhile(disk.stat, 2.0))
        assert disk.entry.state.phase == "queued"
        return
    total = size if whole else size - 1
    progress = FileProgress("f", size, version, 1, content_hash=str(total), read_bytes=total)
    if state.base is not None and state.base.verdict != PENDING and state.base.content_hash == str(total):
        finish(disk, FileProgress("f", size, version, 1, "", str(total), total, state.base.samples, ACCEPTED))
        return
    tell(disk, Continued(0 if state.base is None else state.base.samples))
    begin = min(disk.entry.state.fed, total)
    assert begin == min(disk.emitted, total), "no sample is lost or goes into two blocks"
    tell(disk, Emitted(progress, total, cut=True))
    if total > begin:
        disk.buffer.append((begin, total))
    disk.emitted = max(disk.emitted, total)
    if progress.is_part:
        tell(disk, Postponed(9.0, awaits_end=True))
    else:
        drain(disk)


def drain(disk: Disk) -> None:
    if disk.entry is None or disk.buffer:
        return
    if "remember" in tell(disk, Drained()):
        read = disk.entry.state.read
        assert read is not None
        samples = disk.entry.state.total
        finish(disk, FileProgress("f", read.size, read.mtime_ns, 1, "", str(samples), samples, samples, ACCEPTED))


def cut(disk: Disk) -> None:
    assert disk.entry is not None
    begin, last = disk.buffer.pop(0)
    stop = begin + 1
    if stop < last:
        disk.buffer.insert(0, (stop, last))
    state = disk.entry.state
    assert state.read is not None
    verdict = ACCEPTED if stop >= state.total and not state.read.is_part else PENDING
    read = state.read
    disk.outstanding.append(
        FileProgress("f", read.size, read.mtime_ns, 1, "", read.content_hash, read.read_bytes, stop, verdict)
    )
    tell(disk, BlockDelivered(1))
    drain(disk)


def commit(disk: Disk) -> None:
    progress = disk.outstanding.pop(0)
    if "finish" in tell(disk, Committed(progress)):
        assert not disk.outstanding
        finish(disk, progress)


def step(disk: Disk, name: str, whole: bool) -> None:
    phase = None if disk.entry is None else disk.entry.state.phase
    if name in ("log", "read"):
        for part in ("grow", "scan", "retry", "take", "end")[name == "read" :]:
            step(disk, part, whole)
    elif name == "grow":
        disk.size, disk.version = disk.size + 2, disk.version + 1
    elif name == "scan":
        scan(disk)
    elif name == "take" and phase == "queued":
        tell(disk, Taken(whole))
        tell(disk, ReadingBegun(1.0))
        disk.read = (disk.size, disk.version, whole)
    elif name == "end" and phase == "reading":
        end(disk)
    elif name == "cut" and disk.buffer:
        cut(disk)
    elif name == "commit" and disk.outstanding:
        commit(disk)
    elif name == "rename" and disk.entry is not None:
        tell(disk, Renamed(disk.entry.state.base))
    elif name == "retry" and phase == "deferred":
        tell(disk, Retried())
    elif name == "postpone" and phase == "queued":
        tell(disk, Postponed(5.0))


def check(disks: list[Disk]) -> None:
    """Check that each file is in one phase, and that the counts add up."""
    pending = [disk.entry for disk in disks if disk.entry is not None]
    accepted = [disk for disk in disks if disk.done is not None]
    unseen = [disk for disk in disks if disk.entry is None and disk.done is None]
    assert len(pending) + len(accepted) + len(unseen) == len(disks)
    assert all(entry.state.phase in PHASES[:-1] for entry in pending)
    for disk in disks:
        known = 0 if disk.entry is None else disk.entry.state.outstanding
        assert known == len(disk.outstanding), "each delivery is acknowledged once"


moves = st.lists(st.tuples(st.integers(0, FILES - 1), st.sampled_from(STEPS), st.booleans()), min_size=20, max_size=120)


@given(moves)
@settings(max_examples=200, deadline=None)
def test_in_any_order_of_events_no_sample_is_lost_or_delivered_twice_and_counts_add_up(order):
    disks = [Disk() for _ in range(FILES)]
    for index, name, whole in order:
        step(disks[index], name, whole)
        check(disks)
    for disk in disks:
        for _ in range(3):
            for name in ("scan", "end", "cut", "cut", "commit", "commit", "retry", "take", "end"):
                step(disk, name, whole=True)
            while disk.buffer or disk.outstanding:
                step(disk, "cut", whole=True)
                step(disk, "commit", whole=True)
        scan(disk)
        assert disk.done is not None, "a file that no longer changes comes to its end"
        assert disk.done.samples == disk.size == disk.emitted
    check(disks)


@given(st.lists(st.sampled_from(EVENTS), max_size=60))
def test_any_event_in_any_phase_gives_a_phase_of_the_table(events):
    state = FileState(stat=Stat(9, 1, 1), changed=0.0)
    for event in events:
        before = state
        state, actions = advance(state, event)
        assert state.phase in PHASES
        assert set(actions) <= {"queue", "defer", "remember", "finish"}
        assert (state.phase == "queued" and before.phase != "queued") <= ("queue" in actions)
        assert (state.phase == "deferred") >= ("defer" in actions)
        if before.phase == "finished":
            assert state.phase == "finished"
            assert not actions


def test_the_table_knows_each_event_in_some_phase_and_no_row_is_of_another_event():
    assert {row.event for row in TABLE} == {type(event) for event in EVENTS}
    assert {phase for row in TABLE for phase in row.phases} == set(PHASES)


def test_a_change_while_a_block_is_delivered_is_read():
    state = FileState(stat=Stat(9, 1, 1), changed=0.0, phase="held", read=PROGRESS)
    state, actions = advance(state, Observed(Stat(12, 2, 1), 1.0))
    assert actions == ("queue",)
    state, _ = advance(state, BlockDelivered(1))
    assert state.phase == "queued"
    state, actions = advance(state, Committed(PROGRESS))
    assert (state.phase, actions) == ("queued", ())
