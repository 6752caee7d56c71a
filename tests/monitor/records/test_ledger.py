"""The ledger on the store's database answers as the one in memory does, from any thread, and survives."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.health.record import Record
from monitor.records.database import StoreError
from monitor.records.ledger import StoreLedger, write_progress
from monitor.records.store import Store
from streams.types.block import Block, Rejected
from streams.types.source import FileProgress, Ledger
from tests.support.effort import effort_count
from tests.support.memory_ledger import MemoryLedger

PATHS = st.sampled_from(["a.csv", "b.csv", "sub/c\\u000a.csv"])
PROGRESS = st.builds(
    FileProgress,
    path=PATHS,
    size=st.integers(0, 5),
    mtime_ns=st.just(1),
    inode=st.just((1 << 63) - 1),
    head_hash=st.sampled_from(["h", "k"]),
    content_hash=st.sampled_from(["x", "y", "z"]),
    read_bytes=st.integers(0, 3),
    samples=st.integers(0, 9),
    verdict=st.sampled_from(["pending", "accepted", "short"]),
)
BLOCKS = st.tuples(st.integers(1, 6), st.sampled_from(["x", "y", ""]), st.lists(PROGRESS, max_size=2))
STEPS = st.lists(st.one_of(BLOCKS, PROGRESS, st.tuples(PATHS, PROGRESS)), max_size=12)


def record(sequence: int, content_hash: str) -> Record:
    return Record(source="s", sequence=sequence, name="n", content_hash=content_hash)


def rejected(sequence: int, content_hash: str) -> Rejected:
    return Rejected("s", sequence, "n", "short", "", content_hash)


def answers(ledger: Ledger) -> list[object]:
    paths = ["a.csv", "b.csv", "sub/c\\u000a.csv", "none"]
    alike = [sorted(map(repr, ledger.files_like("s", head, "x"))) for head in ("h", "k", "none")]
    first = [[item.content_hash for item in ledger.files_like("s", head, "x")][:1] for head in ("h", "k")]
    return [
        ledger.committed("s"),
        ledger.committed("other"),
        [ledger.content_of("s", sequence) for sequence in range(8)],
        ledger.known("s", "x") is None,
        [ledger.file("s", path) for path in paths],
        ledger.file("other", "a.csv"),
        alike,
        [item == ["x"] for item in first],
        sorted(map(repr, ledger.pending_files("s"))),
        ledger.file_counts("s"),
    ]


@settings(max_examples=effort_count(quick=6, full=200))
@given(steps=STEPS)
def test_both_ledgers_say_the_same(tmp_path_factory: pytest.TempPathFactory, steps: list[object]) -> None:
    path = tmp_path_factory.mktemp("ledger") / "state.db"
    memory = MemoryLedger()
    with Store.open(path, machine="m") as store, StoreLedger(store) as ledger:
        for step in steps:
            match step:
                case FileProgress():
                    ledger.remember("s", [step])
                    memory.remember("s", [step])
                case (str(before), FileProgress() as progress):
                    ledger.move("s", before, progress)
                    memory.move("s", before, progress)
                case (int(sequence), str(content), list(progress)):
                    outcome = store.commit(
                        record(sequence, content), {}, lambda connection, p=progress: write_progress(connection, "s", p)
                    )
                    assert memory.commit(rejected(sequence, content), progress) == outcome
            assert answers(ledger) == answers(memory)
    with Store.open(path, machine="m") as store, StoreLedger(store) as ledger:
        assert answers(ledger) == answers(memory)


def test_a_commit_that_fails_leaves_neither_block_nor_progress(tmp_path: Path) -> None:
    with Store.open(tmp_path / "state.db", machine="m") as store, StoreLedger(store) as ledger:

        def fail(connection: object) -> None:
            ledger.committed("s")
            raise RuntimeError("no")

        with pytest.raises(RuntimeError):
            store.commit(record(1, "x"), {"stage": {"k": 1}}, fail)
        assert ledger.committed("s") == 0
        assert store.load_states() == {}


def test_questions_come_from_any_thread(tmp_path: Path) -> None:
    with Store.open(tmp_path / "state.db", machine="m") as store, StoreLedger(store) as ledger:
        store.commit(record(3, "x"), {})
        found: list[int] = []
        threads = [threading.Thread(target=lambda: found.append(ledger.committed("s"))) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert found == [3] * 4


def test_a_refusal_is_counted_and_the_block_stays(tmp_path: Path) -> None:
    progress = FileProgress("b.csv", 1, 2, 3, verdict="duplicate")
    with Store.open(tmp_path / "state.db", machine="m") as store, StoreLedger(store) as ledger:
        store.commit(record(1, "x"), {})
        for _ in range(2):
            ledger.refuse(Rejected("s", 1, "b.csv", "duplicate", "", "x"), [progress])
        assert store.counts() == {"ok": 1, "duplicate": 2}
        assert ledger.file("s", "b.csv") == progress


def test_a_closed_ledger_says_so(tmp_path: Path) -> None:
    with Store.open(tmp_path / "state.db", machine="m") as store:
        ledger = StoreLedger(store)
        ledger.close()
        with pytest.raises(StoreError, match=r"state\.db"):
            ledger.committed("s")


def test_a_source_began_with_its_first_dated_block(tmp_path: Path) -> None:
    with Store.open(tmp_path / "state.db", machine="m") as store, StoreLedger(store) as ledger:
        memory = MemoryLedger()
        for sequence, start in enumerate([None, 20.5, 30.0], 1):
            assert ledger.began("s") == memory.began("s") == (20.5 if sequence == 3 else None)
            store.commit(Record("s", sequence, "n", str(sequence), time=start), {})
            memory.commit(Block(np.zeros((1, 2)), 1.0, ("x",), ("g",), "s", sequence, "n", start=start))
        assert ledger.began("s") == memory.began("s") == 20.5
        assert ledger.began("other") is memory.began("other") is None
