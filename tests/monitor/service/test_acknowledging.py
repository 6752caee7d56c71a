"""Acknowledgements reach a running daemon, one that was down and one that was killed, each once; replays agree."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.config.alarms import AlarmLevel, AlarmsSection
from monitor.health.alarms import AlarmAcknowledgement
from monitor.health.record import Record
from monitor.health.state import SourceSettings
from monitor.records.events import EventLog
from monitor.records.ledger import StoreLedger
from monitor.records.store import Store
from monitor.service.acknowledgements import Acknowledgements
from monitor.service.ingest import Ingest
from monitor.service.machine_status import channel_condition, shown_alarms
from monitor.service.setup import source_settings
from reference.steps import Steps
from streams.types.block import Block, Rejected
from tests.streams.folders import csv_bytes, noise
from tests.support.daemon import last, running
from tests.support.daemons import call, make_machine, start, status
from tests.support.effort import effort_count
from tests.support.folder_kill import config
from tests.support.ingest import Queue, steps
from tests.support.waiting import wait_until

RATE = 2560.0
LEVEL = AlarmLevel(
    name="loud", feature="rms", alert_g=3.0, danger_g=6.0, on_delay_blocks=1, off_delay_blocks=1, latch=True
)


def block(sequence: int, level: float) -> Block:
    samples = level * np.random.default_rng(sequence).normal(size=(1, 256))
    return Block(samples, RATE, ("x",), ("g",), "s", sequence, f"b{sequence}", content_hash=str(sequence))


def source() -> SourceSettings:
    machine = config("nowhere").model_copy(update={"alarms": AlarmsSection(level=(LEVEL,))})
    return source_settings(machine, machine.source[0])


class Machine:
    """A store, its event log, and an ingest that can be killed and started anew."""

    def __init__(self, path: Path, blocks: list[Block | Rejected]) -> None:
        self.store = Store.open(path, machine="m")
        self.log = EventLog(path)
        self.source = Queue(self.store, blocks)
        self.ledger = StoreLedger(self.store)
        self.start()

    def start(self) -> None:
        """Begin where the store ends, as a daemon does."""
        self.ledger.close()
        self.ledger = StoreLedger(self.store)
        self.ingest = Ingest(self.store, self.ledger, [self.source], {"s": source()}, clock=lambda: 1.7e9)
        self.acknowledgements = Acknowledgements(self.store, self.log, self.ingest)

    def poll(self) -> None:
        self.acknowledgements.poll()

    def step(self) -> None:
        steps(self.ingest, 1)

    def acknowledge_all(self) -> int:
        """Acknowledge every open alarm; return how many."""
        found = [event for _, event in self.log.events() if event.open and event.body["kind"] == "alarm_raised"]
        for event in found:
            self.log.acknowledge(event.id, "Ada", "seen", 1.7e9)
        return len(found)

    def waiting(self) -> int:
        """Look, and return how many events wait for somebody; they are counted anew now and then only."""
        self.poll()
        return self.acknowledgements.unacknowledged

    @property
    def alarms(self) -> list[tuple[str, bool, bool]]:
        shown = shown_alarms(self.ingest.state("s").alarms["x"], source().channels["x"].alarms)
        return [(alarm["severity"], alarm["active"], alarm["latched"]) for alarm in shown]

    def condition(self) -> str:
        return channel_condition(self.ingest.state("s"), "x", source().channels["x"].alarms)

    def close(self) -> None:
        self.log.close()
        self.ingest.close()
        self.store.close()


@pytest.fixture
def machine(tmp_path: Path) -> Iterator[Machine]:
    found = Machine(tmp_path / "state.db", [block(n, 8.0 if n in (3, 4) else 1.0) for n in range(1, 10)])
    yield found
    found.close()


def said(records: list[Record], kind: str) -> list[tuple[int, str]]:
    return [
        (record.sequence, event["severity"]) for record in records for event in record.events if event["kind"] == kind
    ]


def test_what_is_latched_is_let_go_with_the_next_block_and_shown_at_once(machine: Machine) -> None:
    for _ in range(5):
        machine.step()
    machine.poll()
    assert machine.alarms == [("danger", False, True), ("alert", False, True)]
    assert machine.condition() == "failure"
    wait_until(lambda: machine.waiting() == 2)
    assert machine.acknowledge_all() == 2
    machine.poll()
    assert machine.alarms == []
    assert machine.condition() == "check_function"
    wait_until(lambda: machine.waiting() == 0)
    machine.step()
    machine.poll()
    machine.step()
    records = list(machine.store.records())
    assert sorted(said(records, "alarm_released")) == [(6, "alert"), (6, "danger")]
    released = [event for event in records[5].events if event["kind"] == "alarm_released"]
    assert {event["since_block"] for event in released} == {3}
    assert {event["acknowledged_utc_s"] for event in released} == {1.7e9}


def test_it_holds_when_it_was_given_while_nothing_ran_and_after_a_kill(machine: Machine) -> None:
    for _ in range(5):
        machine.step()
    machine.acknowledge_all()
    machine.start()
    assert len(machine.alarms) == 2
    machine.poll()
    assert machine.alarms == []
    # Killed before the next block: what was handed on is handed on again.
    machine.start()
    machine.poll()
    machine.step()
    # And after it: nothing is let go of twice.
    machine.start()
    machine.poll()
    machine.step()
    assert len(said(list(machine.store.records()), "alarm_released")) == 2


def test_an_alarm_that_goes_on_is_known_and_still_stands(machine: Machine) -> None:
    for _ in range(3):
        machine.step()
    machine.acknowledge_all()
    machine.poll()
    machine.step()
    assert machine.alarms == [("danger", True, False), ("alert", True, False)]
    machine.step()
    assert machine.alarms == []
    assert machine.condition() == "check_function"


def test_who_knows_of_an_alert_does_not_know_of_the_danger(machine: Machine) -> None:
    for _ in range(5):
        machine.step()
    raised = [event for _, event in reversed(machine.log.events()) if event.body["kind"] == "alarm_raised"]
    alert = next(event for event in raised if event.body["severity"] == "alert")
    machine.log.acknowledge(alert.id, "Ada", "", 1.7e9)
    machine.poll()
    machine.step()
    assert machine.alarms == [("danger", False, True)]


def test_a_new_alarm_after_the_acknowledgement_is_held_again(machine: Machine) -> None:
    blocks: list[Block | Rejected] = [block(10, 8.0), block(11, 1.0)]
    for _ in range(5):
        machine.step()
    machine.acknowledge_all()
    for _ in range(4):
        machine.poll()
        machine.step()
    machine.source = Queue(machine.store, blocks)
    machine.start()
    for _ in range(2):
        machine.step()
        machine.poll()
    assert machine.alarms == [("danger", False, True), ("alert", False, True)]


def test_notices_and_events_of_other_kinds_let_go_of_nothing(machine: Machine) -> None:
    for _ in range(5):
        machine.step()
    name = machine.log.notice(1.7e9, {"kind": "no_data", "source": "s", "text": "words"})
    machine.log.acknowledge(name, "Ada", "", 1.7e9)
    cleared = next(event for _, event in reversed(machine.log.events()) if event.body["kind"] == "alarm_cleared")
    machine.log.acknowledge(cleared.id, "Ada", "", 1.7e9)
    machine.poll()
    assert len(machine.alarms) == 2


@settings(max_examples=effort_count(quick=10, full=500))
@given(
    loud=st.lists(st.sampled_from([1.0, 4.0, 8.0]), min_size=4, max_size=14),
    acts=st.lists(st.sampled_from(["", "ack", "kill", "ack+kill"]), min_size=14, max_size=14),
)
def test_given_the_same_acknowledgements_before_the_same_blocks_records_are_the_same(
    tmp_path_factory: pytest.TempPathFactory, loud: list[float], acts: list[str]
) -> None:
    blocks = [block(n, level) for n, level in enumerate(loud, 1)]
    machine = Machine(tmp_path_factory.mktemp("m") / "state.db", list(blocks))
    for act in acts[: len(blocks)]:
        if "ack" in act:
            machine.acknowledge_all()
        if "kill" in act:
            machine.start()
        machine.poll()
        machine.step()
    live, states = list(machine.store.records()), machine.ingest.state("s").to_stored()
    machine.close()
    # The replay: no log, but what the records themselves say was let go of before which block.
    again = Steps(source())
    replayed = []
    for item, record in zip(blocks, live, strict=True):
        given = [
            AlarmAcknowledgement(
                *(event[key] for key in ("channel", "rule", "severity", "since_block", "acknowledged_utc_s"))
            )
            for event in record.events
            if event["kind"] == "alarm_released"
        ]
        replayed.append(again.take(item, now=1.7e9, acknowledgements=given))
    assert replayed == live
    assert again.stored() == states


def loud_machine(folder: Path) -> Path:
    path = make_machine(folder)
    level = (
        '[[alarms.level]]\nname = "loud"\nfeature = "rms"\nalert_g = 3.0\non_delay_blocks = 1\noff_delay_blocks = 1\n'
    )
    path.write_text(f"{path.read_text()}{level}latch = true\n")
    return path


def put(path: Path, number: int, loud: float) -> None:
    """Give the source a file of two blocks."""
    file = path.parent / "in0" / f"f{number}.csv"
    file.with_suffix(".tmp").write_bytes(csv_bytes(loud * noise(512, number)))
    file.with_suffix(".tmp").rename(file)


def acknowledge(path: Path) -> None:
    """Do what the page does, in this process: the daemon's connection is another one."""
    with EventLog(path.parent / "state" / "state.db") as log:
        found = next(event for _, event in reversed(log.events()) if event.body["kind"] == "alarm_raised")
        log.acknowledge(found.id, "Ada <b>", "bearing ordered", 1.7e9)


@pytest.mark.process
def test_the_status_of_a_running_daemon_shows_alarms_levels_and_what_is_open(tmp_path: Path) -> None:
    path = loud_machine(tmp_path)
    path.write_text(f'{path.read_text()}[[alarms.level]]\nfeature = "kurtosis"\ndanger_factor = 9\n')
    with running(path):
        put(path, 1, 1.0)
        wait_until(lambda: last(path) == 2)
        put(path, 2, 5.0)
        wait_until(lambda: status(path)["alarms"] == 1 and status(path)["unacknowledged"] == 1)
        channel = status(path)["channels"]["x0"]
        assert (channel["state"], channel["reason"]) == ("maintenance_required", "alert of loud since block 3")
        assert channel["alarms"] == [
            {
                "rule": "loud",
                "feature": "rms",
                "severity": "alert",
                "active": True,
                "latched": True,
                "since_block": 3,
            }
        ]
        assert channel["levels"] == [
            {
                "rule": "loud",
                "feature": "rms",
                "side": "above",
                "alert_si": pytest.approx(3 * 9.80665),
                "danger_si": None,
            },
            # Not learned yet.
            {"rule": "kurtosis", "feature": "kurtosis", "side": "above", "alert_si": None, "danger_si": None},
        ]
        printed = call("status", "--config", str(path)).stdout
        assert "1 event waits to be acknowledged\n" in printed
        assert "; alert, still learning what healthy is; look at the trends of channel x0 at the" in printed
        assert "channel x0, in figures: alert of loud since block 3, last block" in printed
        put(path, 3, 1.0)
        wait_until(lambda: "waits to be acknowledged" in status(path)["channels"]["x0"]["reason"])
        assert status(path)["state"] == "maintenance_required"
        acknowledge(path)
        wait_until(lambda: status(path)["alarms"] == 0 and status(path)["unacknowledged"] == 0)
        assert status(path)["channels"]["x0"]["state"] == "check_function"
        put(path, 4, 1.0)
        wait_until(lambda: last(path) == 8)
    with Store.open(tmp_path / "state" / "state.db", read_only=True) as store:
        assert said(list(store.records()), "alarm_released") == [(7, "alert")]


@pytest.mark.process
def test_a_daemon_that_is_killed_after_hearing_of_it_lets_go_once(tmp_path: Path) -> None:
    path = loud_machine(tmp_path)
    for number, loud in ((1, 5.0), (2, 1.0)):
        put(path, number, loud)
    daemon = start(path, "--quiet")
    wait_until(lambda: status(path).get("alarms") == 1 and last(path) == 4)
    acknowledge(path)
    wait_until(lambda: status(path)["alarms"] == 0)
    daemon.kill()
    daemon.communicate()
    for number in (3, 4):
        put(path, number, 1.0)
        daemon = start(path, "--quiet")
        try:
            wait_until(lambda blocks=2 * number: last(path) == blocks)
        finally:
            daemon.kill()
            daemon.communicate()
    with Store.open(tmp_path / "state" / "state.db", read_only=True) as store:
        assert said(list(store.records()), "alarm_released") == [(5, "alert")]
