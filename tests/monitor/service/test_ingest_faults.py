"""A block on which the analysis raises costs that block and nothing else."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from monitor.health import step as stages
from monitor.health.record import Record
from monitor.records.failures import UnstorableError
from monitor.records.ledger import StoreLedger
from monitor.records.store import Store
from monitor.service.ingest import Ingest
from monitor.service.setup import source_settings
from streams.types.block import Block, Rejected
from streams.types.source import Delivery
from tests.support.daemon import last, put, running
from tests.support.daemons import make_machine, status
from tests.support.folder_kill import config
from tests.support.ingest import Queue, block, ingest_of, steps
from tests.support.waiting import wait_until

STEP, ALARMS = stages.conclude, stages.alarm_step
BAD = 5


def raises(error: Exception) -> Callable[..., Any]:
    def step(state: Any, block: Any, settings: Any, analysed: Any) -> Any:
        if block.sequence == BAD:
            raise error
        return STEP(state, block, settings, analysed)

    return step


def gives(change: Callable[[Any, Any], Any]) -> Callable[..., Any]:
    def step(state: Any, block: Any, settings: Any, analysed: Any) -> Any:
        after = STEP(state, block, settings, analysed)
        return change(*after) if block.sequence == BAD else after

    return step


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    with Store.open(tmp_path / "state.db", machine="m") as found:
        yield found


def kept(store: Store) -> list[Record]:
    return list(store.records())


@pytest.mark.parametrize(
    ("step", "said"),
    [
        (raises(ZeroDivisionError("division by zero")), "ZeroDivisionError: division by zero"),
        (raises(MemoryError("cannot allocate 9 GB")), "there is not enough memory to analyse its 2048 bytes"),
        (raises(KeyError("\udcff\nx")), "KeyError"),
        (gives(lambda state, output: (replace(state, running_time=float("nan")), output)), "UnstorableError: state of"),
        (gives(lambda state, output: (replace(state, last_time=object()), output)), "UnstorableError: state of"),
        (gives(lambda state, output: (state, replace(output, stage="nonsense"))), "RecordError: record of block 5"),
    ],
)
def test_the_block_is_as_one_that_could_not_be_read_and_all_others_as_if_nothing_was(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: Callable[..., Any], said: str
) -> None:
    blocks: list[Block | Rejected] = [block(number) for number in range(1, 10)]
    monkeypatch.setattr(stages, "conclude", step)
    source = Queue(store, blocks)
    with ingest_of(store, source) as ingest:
        steps(ingest, BAD)
        problem = ingest.problems()["s"]
        steps(ingest, 1)
        assert ingest.problems() == {}
        steps(ingest, 3)
        states = ingest.state("s").to_stored()
    found = kept(store)
    failed = found[BAD - 1]
    assert source.acknowledged == list(range(1, 10))
    lacks_memory = "memory" in said
    assert failed.status == ("refused" if lacks_memory else "unreadable")
    assert failed.reason.startswith("the analysis failed: ") != lacks_memory
    assert said in failed.reason
    assert problem == f"block {BAD}: {failed.reason}"
    # The oracle: a source that rejects that block itself.
    blocks[BAD - 1] = Rejected("s", BAD, f"b{BAD}", failed.status, failed.reason, failed.content_hash)
    with Store.open(tmp_path / "other.db", machine="m") as other:
        with ingest_of(other, Queue(other, blocks)) as undisturbed:
            steps(undisturbed, 9)
            assert undisturbed.state("s").to_stored() == states
        assert kept(other) == found
        spectra = "SELECT source, channel, sequence, time, header, hex(amplitude) FROM spectra ORDER BY sequence"
        assert store.rows(spectra) == other.rows(spectra) != []
    assert store.load_states() == {name: store.load_states()[name] for name in states}


def test_it_is_told_once_how_and_again_when_it_is_over(
    store: Store, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def step(state: Any, block: Any, settings: Any, analysed: Any) -> Any:
        if block.sequence < 4:
            raise RuntimeError("always")
        return STEP(state, block, settings, analysed)

    monkeypatch.setattr(stages, "conclude", step)
    caplog.set_level(logging.WARNING)
    with ingest_of(store, Queue(store, [block(number) for number in range(1, 6)])) as ingest:
        steps(ingest, 5)
    failures = [found for found in caplog.records if "analysis failed" in found.message]
    assert [found.exc_info is not None for found in failures] == [True, False, False]
    assert sum("analysed again" in found.message for found in caplog.records) == 1
    assert [record.status for record in kept(store)] == ["unreadable"] * 3 + ["ok"] * 2


def test_a_name_that_no_database_takes_is_escaped(store: Store) -> None:
    source = Queue(store, [block(1), block(2)])
    source.waiting[0] = replace(source.waiting[0], item=replace(block(1), name="f\udcff.csv"))
    with ingest_of(store, source) as ingest:
        steps(ingest, 2)
    first, second = kept(store)
    assert (first.name, first.status, second.status) == ("f\\udcff.csv", "unreadable", "ok")


def test_not_even_the_alarms_stop_it(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(state: Any, record: Record, *rest: Any) -> Any:
        if record.sequence == 2:
            raise ValueError("rules")
        return ALARMS(state, record, *rest)

    monkeypatch.setattr(stages, "alarm_step", fails)
    with ingest_of(store, Queue(store, [block(1), block(2), block(3)])) as ingest:
        steps(ingest, 1)
        before = ingest.state("s").to_stored()
        spectra = store.rows("SELECT sequence FROM spectra")
        assert spectra
        steps(ingest, 1)
        assert store.rows("SELECT sequence FROM spectra") == spectra
        assert ingest.state("s").to_stored() == before
        steps(ingest, 1)
    assert [record.status for record in kept(store)] == ["ok", "unreadable", "gap"]


def test_what_can_be_stored_in_no_form_is_kept_and_shown(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*values: Any) -> object:
        raise UnstorableError("s, block 1: its record cannot be stored")

    monkeypatch.setattr(store, "commit_many", never)
    stop = threading.Event()
    stop.set()
    source = Queue(store, [block(1)])
    with ingest_of(store, source) as ingest:
        assert ingest.step(stop) is None
        assert "cannot be stored" in ingest.problems()["store"]
    assert source.acknowledged == []


def test_a_block_that_does_not_fit_bears_the_status_that_fits(store: Store) -> None:
    machine = config("nowhere")
    channel = machine.channel[0].model_copy(update={"band_hz": ((300.0, 1200.0),)})
    section = machine.source[0].model_copy(update={"rate_hz": None})
    machine = machine.model_copy(
        update={
            "channel": (channel,),
            "source": (section,),
            "operating": machine.operating.model_copy(update={"speed_hz": None}),
        }
    )
    blocks: list[Block | Rejected] = [
        replace(block(1), speed=40.0),
        replace(block(2, channel="other"), speed=40.0),
        block(3),
        replace(block(4), rate=2000.0, speed=40.0),
        replace(block(5), rate=-1.0, speed=40.0),
        replace(block(6), speed=40.0),
    ]
    source = Queue(store, blocks)
    settings = {"s": source_settings(machine, section)}
    with Ingest(store, StoreLedger(store), [source], settings, clock=lambda: 1.7e9) as ingest:
        steps(ingest, len(blocks))
        assert ingest.problems() == {"s": "dry"}
    found = kept(store)
    statuses = [record.status for record in found]
    assert statuses == ["ok", "wrong_shape", "incomplete", "wrong_rate", "wrong_rate", "ok"]
    assert "'x'" in found[1].reason
    assert "speed" in found[2].reason
    assert "Nyquist" in found[3].reason


def test_a_block_too_short_for_the_analysis_is_short_and_the_log_has_no_traceback(
    store: Store, caplog: pytest.LogCaptureFixture
) -> None:
    lengths = [256, 1, 63, 64, 256]
    items: list[Block | Rejected] = [
        replace(block(number), samples=block(number).samples[:, :length], name=f"{number}.npy")
        for number, length in enumerate(lengths, 1)
    ]
    source, machine = Queue(store, items), config("nowhere")
    settings = {"s": source_settings(machine, machine.source[0].model_copy(update={"block_s": "file"}))}
    with Ingest(store, StoreLedger(store), [source], settings, clock=lambda: 1.7e9) as ingest:
        steps(ingest, len(items))
        assert ingest.problems() == {"s": "dry"}
    found = kept(store)
    assert [record.status for record in found] == ["ok", "short", "short", "ok", "ok"]
    assert [record.reason for record in found][1:3] == [
        "2.npy: 1 samples, the analysis needs at least 64",
        "3.npy: 63 samples, the analysis needs at least 64",
    ]
    assert caplog.records == []


def test_a_source_that_fails_is_shown_and_takes_no_other_with_it(
    store: Store, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    class Broken(Queue):
        mended = False

        def next(self, timeout: float) -> Delivery | None:
            if not self.mended:
                raise RuntimeError("a pump")
            return super().next(timeout)

    monkeypatch.setattr("monitor.service.ingest._RETRY_S", 0.01)
    monkeypatch.setattr("monitor.service.ingest._POLL_S", 0.02)
    broken, well = Broken(store, [block(1)]), Queue(store, [block(n, source="t") for n in range(1, 6)], name="t")
    with ingest_of(store, broken, well) as ingest:
        steps(ingest, 10)
        assert well.acknowledged == [1, 2, 3, 4, 5]
        assert "RuntimeError: a pump" in ingest.problems()["s"]
        assert sum(found.exc_info is not None for found in caplog.records) == 1
        broken.mended = True
        steps(ingest, 4)
        assert broken.acknowledged == [1]
        assert "a pump" not in ingest.problems()["s"]


@pytest.mark.process
def test_a_daemon_goes_on_is_degraded_and_recovers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def step(state: Any, block: Any, settings: Any, analysed: Any) -> Any:
        if block.sequence in (3, 4):
            raise FloatingPointError("overflow")
        return STEP(state, block, settings, analysed)

    monkeypatch.setattr(stages, "conclude", step)
    path = make_machine(tmp_path)
    with running(path):
        put(path, 1)
        put(path, 2)
        wait_until(lambda: "block 4" in status(path)["problems"].get("s0", ""))
        found = status(path)
        assert found["status"] == "degraded"
        assert found["problems"]["s0"] == "block 4: the analysis failed: FloatingPointError: overflow"
        assert found["channels"]["x0"]["state"] == "bad_data"
        put(path, 3)
        wait_until(lambda: status(path)["status"] == "running" and last(path) == 6)
        # The status is written between two blocks, too.
        wait_until(lambda: status(path)["sources"]["s0"]["accepted"] == 3)
    with Store.open(tmp_path / "state" / "state.db", read_only=True) as store:
        assert [record.status for record in kept(store)] == ["ok", "ok", "unreadable", "unreadable", "gap", "ok"]
