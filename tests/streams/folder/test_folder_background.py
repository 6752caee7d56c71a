"""Files that take long are read in the background: the other sources go on, and the order stays."""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from streams.files.datasets import DATA_SETS, DataSet, FileFacts
from streams.files.parse.child import isolated
from streams.folder.intake import Intake
from streams.folder.source import FolderSource
from streams.types.block import Block
from streams.types.listing import natural_key
from streams.types.spec import ChannelSpec, SourceSpec
from tests.streams import misbehave
from tests.streams.folders import CHANNELS, RATE, Rig, csv_bytes, noise, verdicts
from tests.support.memory_ledger import MemoryLedger
from tests.support.waiting import Stall, wait_until

pytestmark = pytest.mark.process


@pytest.fixture(autouse=True)
def _slow() -> Iterator[None]:
    """A kind of file that is read as soon as another file of its name, with ``.go``, is there."""

    def facts(path: str, place: str, zone: object) -> FileFacts | None:
        return FileFacts(natural_key(path)) if path.endswith(".slow") else None

    DATA_SETS["slow"] = DataSet("slow", "*.slow", facts, isolated(misbehave.read_when_told))
    yield
    del DATA_SETS["slow"]


def source(root: Path, kind: str, name: str, ledger: MemoryLedger) -> FolderSource:
    channel = ChannelSpec("x", column=1, unit="g")
    spec = SourceSpec(name, f"folder:{root}", rate=RATE, channels=(channel,), block_s="file", settle_s=0.0, format=kind)
    found = FolderSource(spec, str(root))
    found.open(ledger)
    return found


def test_a_slow_file_does_not_hold_up_another_source(tmp_path: Path) -> None:
    ledger, order, seen = MemoryLedger(), [], False
    for name in ("slow", "quick"):
        (tmp_path / name).mkdir()
    (tmp_path / "slow" / "1.slow").write_text(str(tmp_path / "go"))
    for number in range(5):
        np.save(tmp_path / "quick" / f"{number}.npy", np.arange(100.0) + number)
    stall = Stall()
    with (
        source(tmp_path / "slow", "slow", "a", ledger) as slow,
        source(tmp_path / "quick", "npy", "b", ledger) as quick,
    ):
        while len(order) < 6:
            stall.check()
            for found in (slow, quick):
                delivery = found.next(0.0)
                if delivery is not None:
                    ledger.commit(delivery.item, delivery.progress)
                    found.acknowledge(delivery)
                    order.append(delivery.item.source)
            if order.count("b") == 5 and ledger.handled:
                (tmp_path / "go").touch()
            seen = seen or slow.backlog().pending == 1
            assert slow.backlog().pending == (seen and "a" not in order)
    assert order == ["b"] * 5 + ["a"]
    # It took long, so it was noted as being handled, and then not any more.
    assert ledger.handled == [("a", ("1.slow",)), ("a", ())]


def test_closing_abandons_what_is_read(tmp_path: Path) -> None:
    ledger = MemoryLedger()
    (tmp_path / "1.slow").write_text(str(tmp_path / "go"))
    with source(tmp_path, "slow", "a", ledger) as slow:
        wait_until(lambda: slow.next(0.0) is None and bool(ledger.handled))
    (tmp_path / "go").touch()
    with source(tmp_path, "slow", "a", ledger) as again:
        found = again.next(20.0)
        assert found is not None
        assert isinstance(found.item, Block)


def test_a_file_that_changes_while_it_is_read_is_read_again(tmp_path: Path) -> None:
    ledger = MemoryLedger()
    (tmp_path / "1.slow").write_text(str(tmp_path / "go"))
    with source(tmp_path, "slow", "a", ledger) as slow:
        wait_until(lambda: slow.next(0.0) is None and bool(ledger.handled))
        (tmp_path / "1.slow").write_text(f"{tmp_path / 'go'}\n7")
        (tmp_path / "go").touch()
        values = []
        stall = Stall()
        while len(values) < 2:
            stall.check()
            delivery = slow.next(0.1)
            if delivery is not None:
                assert isinstance(delivery.item, Block)
                values.append(float(delivery.item.samples[0, 0]))
                ledger.commit(delivery.item, delivery.progress)
                slow.acknowledge(delivery)
    assert values == [0.0, 7.0]


def test_the_blocks_of_a_long_file_are_cut_one_by_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "1.csv").write_bytes(csv_bytes(noise(1000)))
    most: list[int] = []
    advance = Intake.advance

    def counted(intake: Intake, now: float) -> bool:
        done = advance(intake, now)
        most.append(len(intake.ready))
        return done

    monkeypatch.setattr(Intake, "advance", counted)
    rig = Rig(tmp_path, block_s=0.1, channels=CHANNELS)
    assert len(rig.run(30.0)) == 10
    assert max(most) == 1
    assert rig.source.backlog().accepted == 1
    np.testing.assert_array_equal(rig.samples(), noise(1000))


def test_a_poisoned_file_is_set_aside_and_released(tmp_path: Path) -> None:
    ledger = MemoryLedger()
    ledger.died = {("s", "2.csv"): 2.0, ("s", "3.csv"): 1.5}
    for number in (1, 2, 3):
        (tmp_path / f"{number}.csv").write_bytes(csv_bytes(noise(100, number)))
    rig = Rig(tmp_path, ledger)
    assert verdicts(rig.run()) == [("1.csv", "accepted"), ("2.csv", "poisoned"), ("3.csv", "accepted")]
    assert rig.source.backlog().rejected == 1
    rig.restart()
    assert rig.run() == []
    ledger.died.clear()
    ledger.release("s", "2.csv")
    assert verdicts(rig.run()) == [("2.csv", "accepted")]
    assert (rig.source.backlog().accepted, rig.source.backlog().rejected) == (3, 0)
    rig.restart()
    assert rig.run() == []
    assert ledger.file_counts("s") == {"accepted": 3}


def test_a_poisoned_file_of_an_unknown_kind_is_a_problem(tmp_path: Path) -> None:
    ledger = MemoryLedger()
    ledger.died = {("s", "1.csv"): 2.0}
    (tmp_path / "1.csv").write_bytes(csv_bytes(noise(100)))
    rig = Rig(tmp_path, ledger, format="auto")
    assert rig.run() == []
    assert "1.csv: the monitor died repeatedly" in (rig.source.problem() or "")
    (tmp_path / "2.csv").write_bytes(csv_bytes(noise(100, 2)))
    assert verdicts(rig.run()) == [("1.csv", "poisoned"), ("2.csv", "accepted")]


@pytest.mark.parametrize("question", ["deaths", "files_like", "known", "content_of", "remember"])
def test_a_file_is_read_again_where_the_ledger_failed_while_it_was_handled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, question: str
) -> None:
    for number in (1, 3):
        rows = b"".join(b"0,0,0,0,%.3f,0\n" % value for value in noise(2560, number))
        (tmp_path / f"acc_0000{number}.csv").write_bytes(rows)
    (tmp_path / "acc_00003.csv").rename(tmp_path / "later")
    rig = Rig(tmp_path, format="pronostia", rate=None, channels=())
    rig.run()
    shutil.copy(tmp_path / "acc_00001.csv", tmp_path / "acc_00002.csv")
    os.utime(tmp_path / "acc_00001.csv", (0.0, 0.0))
    (tmp_path / "later").rename(tmp_path / "acc_00003.csv")

    def failing(*arguments: object) -> None:
        raise sqlite3.OperationalError("the disk is full")

    with monkeypatch.context() as patch:
        patch.setattr(rig.ledger, question, failing)
        with pytest.raises(sqlite3.OperationalError):
            rig.run()
    assert rig.source.backlog().pending
    rig.run(100.0)
    backlog = rig.source.backlog()
    assert (backlog.accepted, backlog.rejected, backlog.pending) == (2, 1, 0)
