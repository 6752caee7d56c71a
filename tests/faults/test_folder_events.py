"""The watched folder with the events and the clock of the machine: woken at once, and recovered where they fail."""

from __future__ import annotations

import math
import os
import shutil
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from streams.folder.source import FolderSource
from streams.folder.watch import FolderWatch
from streams.open import open_live
from streams.types.listing import file_system_type
from streams.types.source import LiveSource
from streams.types.spec import SourceError, SourceSpec
from tests.streams.folders import CHANNELS, RATE, csv_bytes, noise
from tests.support.effort import effort_count
from tests.support.memory_ledger import MemoryLedger
from tests.support.waiting import Stall, at_most

SETTLE = 1.0
SHORT_SETTLE = 0.2


def spec(root: Path, **more: Any) -> SourceSpec:
    values: dict[str, Any] = {
        "rate": RATE,
        "channels": CHANNELS,
        "block_s": "file",
        "format": "csv",
        "settle_s": SETTLE,
    }
    return SourceSpec(name="s", url=f"folder:{root}", **(values | more))


class Collector:
    """A source and the names of what it delivered; everything is committed."""

    def __init__(self, root: Path, settle_s: float) -> None:
        self.ledger = MemoryLedger()
        self.source = FolderSource(spec(root, settle_s=settle_s), str(root))
        self.source.open(self.ledger)
        self.names: list[str] = []

    def collect(self, until: int) -> None:
        """Collect until so many have come."""
        stall = Stall(lambda: len(self.names))
        while len(self.names) < until:
            stall.check()
            self._step()

    def collect_for(self, seconds: float) -> None:
        """Collect for a while."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._step()

    def _step(self) -> None:
        delivery = self.source.next(0.05)
        if delivery is not None:
            assert self.ledger.commit(delivery.item, delivery.progress) == "committed"
            self.source.acknowledge(delivery)
            self.names.append(delivery.item.name)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    root = tmp_path / "in"
    root.mkdir()
    return root


@pytest.fixture
def collector(folder: Path) -> Iterator[Collector]:
    found = Collector(folder, SETTLE)
    yield found
    found.source.close()


@pytest.fixture
def prompt(folder: Path) -> Iterator[Collector]:
    """One whose files settle soon, where events are not what is shown."""
    found = Collector(folder, SHORT_SETTLE)
    yield found
    found.source.close()


def write(folder: Path, name: str, seed: int) -> None:
    (folder / name).write_bytes(csv_bytes(noise(50, seed)))


def test_it_is_a_live_source(collector: Collector) -> None:
    assert isinstance(collector.source, LiveSource)
    assert collector.source.next(0.0) is None


def test_closed_files_are_taken_before_they_settle(folder: Path, collector: Collector) -> None:
    write(folder, "f1.csv", 1)
    collector.collect(1)
    for number in range(2, 6):
        write(folder, f"f{number}.csv", number)
        with at_most(SETTLE):
            collector.collect(number)
    assert collector.names == [f"f{number}.csv" for number in range(1, 6)]


def test_moved_in_files_and_new_folders_are_found(folder: Path, prompt: Collector, tmp_path: Path) -> None:
    write(folder, "f1.csv", 1)
    prompt.collect(1)
    write(tmp_path, "f2.csv", 2)
    (tmp_path / "f2.csv").rename(folder / "f2.csv")
    prompt.collect(2)
    (folder / "sub").mkdir()
    count = 50
    for number in range(count):
        write(folder / "sub", f"f{number}.csv", 100 + number)
    prompt.collect(2 + count)
    assert len(set(prompt.names)) == 2 + count


def test_a_dead_observer_and_a_root_made_anew_are_recovered(folder: Path, prompt: Collector) -> None:
    write(folder, "f1.csv", 1)
    prompt.collect(1)
    shutil.rmtree(folder)
    stall = Stall()
    while prompt.source.problem() is None:
        stall.check()
        prompt.collect_for(0.1)
    folder.mkdir()
    write(folder, "f2.csv", 2)
    prompt.collect(2)
    assert prompt.source.problem() is None
    source = prompt.source
    for emitter in source._watch._observer.emitters:
        emitter.stop()
        emitter.join()
    assert not source._watch.alive()
    write(folder, "f3.csv", 3)
    prompt.collect(3)
    assert source._watch.alive()


def test_events_that_the_kernel_dropped_are_told_and_no_file_is_lost_by_it(
    folder: Path, collector: Collector, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("streams.folder.source._OVERFLOW_SHOWN_S", math.inf)
    write(folder, "f1.csv", 1)
    collector.collect(1)
    most = int(Path("/proc/sys/fs/inotify/max_queued_events").read_text())
    # Two names in turn, as the kernel keeps one of several equal events.
    hidden = [folder / ".a", folder / ".b"]
    with collector.source._watch._observer._inotify_fd._lock:
        for number in range(2 * most):
            os.close(os.open(hidden[number % 2], os.O_WRONLY | os.O_CREAT))
            if number % 2 == 0:
                hidden[1].unlink(missing_ok=True)
        write(folder, "f2.csv", 2)
    collector.collect(2)
    assert collector.names == ["f1.csv", "f2.csv"]
    # A scan may have found the file before the report of the lost events was read.
    stall = Stall(collector.source.problem)
    while collector.source.problem() is None:
        stall.check()
        collector.collect_for(0.1)
    said = f"{folder}: more events than the system keeps, some were lost; files are found by scanning"
    assert collector.source.problem() == said
    assert f"source s: {said}" in caplog.messages
    # Events are heard as before.
    write(folder, "f3.csv", 3)
    collector.collect(3)
    monkeypatch.setattr("streams.folder.source._OVERFLOW_SHOWN_S", 0.0)
    assert collector.source.problem() is None


def test_more_files_than_the_kernel_keeps_events_for(folder: Path, prompt: Collector) -> None:
    count = effort_count(quick=500, full=30_000)

    def produce() -> None:
        for number in range(count):
            write(folder, f"f{number:06d}.csv", number)

    producer = threading.Thread(target=produce)
    producer.start()
    # Nobody listens for a while, so that events pile up.
    time.sleep(0.5)
    prompt.collect(count)
    producer.join()
    assert sorted(prompt.names) == [f"f{number:06d}.csv" for number in range(count)]
    prompt.collect_for(4 * SHORT_SETTLE)
    backlog = prompt.source.backlog()
    assert (backlog.offered, backlog.accepted, backlog.pending) == (count, count, 0)


def test_a_network_share_is_not_watched(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    watch = FolderWatch(lambda: None)
    watch.start(folder)
    assert watch.listening
    monkeypatch.setattr("streams.folder.watch.file_system_type", lambda path: "cifs")
    watch.start(folder)
    assert not watch.listening
    assert watch.alive()
    watch.stop()
    assert file_system_type(folder) is not None


def test_names_beyond_the_room_for_them_are_left_to_the_scan(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("streams.folder.watch._MAX_NAMES", 3)
    woken = []
    watch = FolderWatch(lambda: woken.append(1))
    for number in range(5):
        watch.note(str(folder / f"{number}"), finished=True)
    watch.note(str(folder / "6"), finished=False)
    assert len(watch.finished()) == 3
    assert watch.finished() == set()
    assert len(woken) == 6


def test_a_url_opens_it(folder: Path) -> None:
    write(folder, "f1.csv", 1)
    (source,) = open_live([spec(folder)], MemoryLedger())
    with source:
        delivery = source.next(20.0)
        assert delivery is not None
        assert delivery.item.name == "f1.csv"


def test_what_is_no_live_source_is_refused(folder: Path) -> None:
    for url in ("folder:", str(folder), "dataset:ims:x", "ftp://x"):
        with pytest.raises(SourceError, match="goes on for ever"):
            open_live([SourceSpec(name="s", url=url)], MemoryLedger())
    with pytest.raises(SourceError, match="not known"):
        open_live([spec(folder, format="nonsense")], MemoryLedger())
