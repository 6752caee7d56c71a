"""The alarm stage of a source: events are in the record, states are committed with it, a restart changes nothing."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from monitor.config.alarms import AlarmLevel, AlarmsSection
from monitor.config.load import Config
from monitor.desk.judge.problems import find_problems
from monitor.health.alarms import AlarmAcknowledgement, AlarmSettings, Level, Rule, acknowledged
from monitor.health.state import SourceSettings
from monitor.records.store import Store
from monitor.service.setup import source_settings
from reference.steps import Steps
from streams.types.block import Block, Rejected
from tests.support.folder_kill import config

RATE = 2560.0


def block(sequence: int, level: float) -> Block:
    samples = level * np.random.default_rng(sequence).normal(size=(1, 256))
    return Block(samples, RATE, ("x",), ("g",), "s", sequence, f"b{sequence}", content_hash=str(sequence))


def settings() -> SourceSettings:
    machine = config("nowhere")
    rule = Rule("rms", "rms", alert=Level(3 * 9.8), on_delay=2, off_delay=2, latch=True)
    found = source_settings(machine, machine.source[0])
    alarms = AlarmSettings((rule,), window=4)
    return replace(found, channels={name: replace(channel, alarms=alarms) for name, channel in found.channels.items()})


ITEMS = [
    *[block(n, 1.0) for n in range(1, 4)],
    *[block(n, 4.0) for n in range(4, 7)],
    *[Rejected("s", n, "b", "nan", "words", str(n)) for n in range(7, 11)],
    *[block(n, 1.0) for n in range(11, 16)],
]


def test_alarms_and_conditions_are_events_of_the_record() -> None:
    found = Steps(settings())
    events = [event for item in ITEMS for event in found.take(item).events]
    assert [(event["kind"], event["block"]) for event in events] == [
        ("alarm_raised", 5),
        ("condition", 8),
        ("alarm_cleared", 12),
        ("condition", 13),
    ]
    assert found.state.alarms["x"].condition == "maintenance_required"
    given = AlarmAcknowledgement("x", "rms", "alert", 5, 1.7e9)
    released = acknowledged(found.state.alarms, (given,))
    assert released != found.state.alarms
    assert acknowledged(released, (given,)) == released
    record = found.take(block(16, 1.0), acknowledgements=(given, given))
    assert found.state.alarms["x"].condition == "check_function"
    assert record.events == (
        {
            "kind": "alarm_released",
            "channel": "x",
            "block": 16,
            "rule": "rms",
            "feature": "rms",
            "severity": "alert",
            "since_block": 5,
            "acknowledged_utc_s": 1.7e9,
        },
    )


def test_a_restart_at_any_block_gives_the_same_records() -> None:
    undisturbed = Steps(settings())
    expected = [undisturbed.take(item) for item in ITEMS]
    for cut in (2, 4, 7, 9, 12):
        first = Steps(settings())
        records = [first.take(item) for item in ITEMS[:cut]]
        second = Steps(settings(), json.loads(json.dumps(first.stored())), records[-1])
        records += [second.take(item) for item in ITEMS[cut:]]
        assert records == expected
        assert second.stored() == undisturbed.stored()


def test_check_names_the_levels_that_came_too_late_to_learn(tmp_path: Path) -> None:
    given = config("nowhere")
    detect = given.detect.model_copy(update={"learn_blocks": 10, "run_in_blocks": 0})
    here = given.machine.model_copy(update={"state_dir": tmp_path})
    early = AlarmLevel(name="early", feature="h_or", alert_sd=6)
    fixed = AlarmLevel(name="fixed", feature="peak", alert_g=50, danger_g=80)
    machine = given.model_copy(
        update={"detect": detect, "machine": here, "alarms": AlarmsSection(level=(early, fixed))}
    )

    def said(found: Config) -> list[str]:
        return [doubt.came for doubt in find_problems(found) if "level" in doubt.came]

    later = machine.model_copy(
        update={
            "alarms": AlarmsSection(
                level=(
                    early,
                    fixed,
                    AlarmLevel(name="late", feature="kurtosis", alert_factor=2),
                    AlarmLevel(feature="rms", alert_sd=6),
                )
            )
        }
    )
    assert said(later) == []
    with Store.open(tmp_path / "state.db", machine="m") as store:
        found = Steps(source_settings(machine, machine.source[0]))
        for number in range(1, 6):
            store.commit(found.take(block(number, 1.0)), found.stored())
        assert said(later) == []
        for number in range(6, 16):
            store.commit(found.take(block(number, 1.0)), found.stored())
    assert found.state.channels["x"].detect.stage == "healthy"
    assert said(machine) == []
    (problem,) = said(later)
    assert problem.startswith("channel 'x': level 'late' has no effect")
    (tmp_path / "state.db").write_bytes(b"SQLite format 3")
    assert said(later)[0].startswith(str(tmp_path))
