"""Several machines in a folder: their statuses in one table."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from monitor.commands.run import _channel, present_state
from monitor.service.system import StatusFile
from tests.support.daemons import call
from tests.support.fleet import add_machine

pytestmark = pytest.mark.process


def test_the_table_has_the_worst_first_and_says_why(tmp_path: Path) -> None:
    channel = {"state": "normal", "reason": "healthy", "last_block_age_s": 3.0}
    given_states: dict[str, dict[str, Any]] = {
        "fine": {"state": "normal", "channels": {"x": channel}},
        "ill": {"state": "failure", "alarms": 2, "channels": {"x": channel | {"state": "failure", "reason": "danger"}}},
        "odd": {"state": "normal", "problems": {"disk": "full", "page": "gone"}, "channels": {"x": channel}},
        "young": {"state": "check_function", "channels": {"x": channel | {"state": "check_function", "reason": "new"}}},
    }
    opened = []
    for name, status in given_states.items():
        add_machine(tmp_path, name)
        file = StatusFile.open(tmp_path / name / "state")
        file.write({"status": "running", "pid": 1, "blocks": 5, **status})
        opened.append(file)
    add_machine(tmp_path, "new")
    add_machine(tmp_path, "dead")
    with StatusFile.open(tmp_path / "dead" / "state") as file:
        file.write({"status": "running", "pid": 1, "state": "normal", "updated_utc": "2026-11-21T08:00:00.000Z"})
    try:
        table = call("status", "--config", str(tmp_path))
        listed = call("status", "--json", "--config", str(tmp_path))
    finally:
        for file in opened:
            file.close()
    assert (table.returncode, listed.returncode) == (0, 0), table.stderr + listed.stderr
    rows = [line.split(maxsplit=1) for line in table.stdout.splitlines()]
    assert [row[0] for row in rows] == ["machine", "ill", "dead", "new", "young", "odd", "fine"]
    words = dict(rows)
    assert words["ill"].split() == ["failure", "running", "5", "3", "s", "ago", "2", "x:", "danger"]
    assert words["dead"].split()[:3] == ["no", "data", "died"]
    assert words["dead"].endswith("no daemon since 2026-11-21T08:00:00.000Z")
    assert words["new"].split() == ["no", "data", "never", "ran", "no", "daemon", "has", "run"]
    assert words["odd"].endswith("disk: full (and 1 more)")
    found = json.loads(listed.stdout)["machines"]
    assert [status["machine"] for status in found] == [row[0] for row in rows[1:]]
    assert found[0]["file"] == "ill.toml"


def test_without_a_daemon_no_machine_is_healthy() -> None:
    assert present_state({"running": False, "state": "normal"}) == "no_data"
    assert present_state({"running": False, "state": "failure"}) == "failure"
    assert present_state({"running": True, "state": "normal"}) == "normal"
    assert present_state({"running": True}) == "no_data"
    assert present_state({"running": True, "state": "a state of another version"}) == "no_data"


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"calibrated": False, "v_eq_relative": 2.5}, "V_eq 2.5 times the first tracked value (rig not calibrated)"),
        ({"calibrated": True, "v_eq_relative": 2.5}, "V_eq 0.02 mm3/mm"),
        ({}, "V_eq 0.02 mm3/mm"),
    ],
    ids=["uncalibrated", "calibrated", "of an earlier version"],
)
def test_the_status_says_v_eq_as_it_may_be_read(values: dict[str, Any], text: str) -> None:
    channel: dict[str, Any] = {"state": "normal", "reason": "healthy", "stage": "final", "fault": None}
    channel |= {"v_eq_mm2": 0.02, "tt_s": None, "last_block": None}
    assert text in list(_channel(channel | values))
