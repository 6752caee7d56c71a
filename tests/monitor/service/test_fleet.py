"""Several machines in a folder: what is refused, and how they stand in one table."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from monitor.commands.fleet_status import standing
from monitor.config.load import ConfigError
from monitor.service.fleet import load_fleet
from monitor.service.status_file import StatusFile
from monitor.service.supervision import Supervision
from tests.faults.daemons import call
from tests.fleet import add_machine


def test_all_that_is_wrong_is_said_file_by_file(tmp_path: Path) -> None:
    add_machine(tmp_path, "a", web="port = 9000")
    twin = add_machine(tmp_path, "b", web=None)
    twin.write_text(twin.read_text().replace('name = "b"\n', 'name = "a"\n', 1))
    other = add_machine(tmp_path, "c", web="port = 9001\nmax_streams = 3")
    other.write_text(other.read_text().replace('records_dir = "c/records"', 'records_dir = "a/state"'))
    (tmp_path / "d.toml").write_text("[machine\n")
    odd = add_machine(tmp_path, "e", web=None)
    odd.write_text(odd.read_text() + "\n[odd]\n")
    with pytest.raises(ConfigError) as caught:
        load_fleet(tmp_path)
    told = str(caught.value).splitlines()
    assert [line.removeprefix(f"{tmp_path}/").split(":")[0] for line in told] == [
        "d.toml",
        "e.toml",
        "b.toml",
        "c.toml",
        "c.toml",
    ]
    assert told[2].endswith("machine.name: 'a' is the name of the machine of a.toml, too")
    assert f"machine.records_dir: {tmp_path}/a/state is state_dir of a.toml, too" in told[3]
    assert "web: port, max_streams differ from those of a.toml" in told[4]
    done = call("run", "--config", str(tmp_path))
    assert done.returncode == 2
    assert [line in done.stderr for line in told] == [True] * 5
    assert not (tmp_path / "a" / "state").exists()


def test_machines_that_say_nothing_of_the_folders_share_them_and_are_refused(tmp_path: Path) -> None:
    for name in ("a", "b"):
        path = add_machine(tmp_path, name)
        text = path.read_text()
        path.write_text(text.replace(f'state_dir = "{name}/state"\nrecords_dir = "{name}/records"\n', ""))
    with pytest.raises(
        ConfigError, match=r"state is state_dir of a\.toml, too(.|\n)*records is records_dir of a\.toml"
    ):
        load_fleet(tmp_path)


def test_a_section_on_the_page_in_one_file_is_that_of_all(tmp_path: Path) -> None:
    add_machine(tmp_path, "a", web=None)
    add_machine(tmp_path, "b", web="port = 9000")
    add_machine(tmp_path, "c", web="port = 9000")
    fleet = load_fleet(tmp_path)
    assert [machine.name for machine in fleet.machines] == ["a", "b", "c"]
    assert fleet.web.port == 9000
    assert fleet.page_dir == tmp_path / "a" / "state"


def test_a_folder_without_configurations_is_refused(tmp_path: Path) -> None:
    (tmp_path / ".hidden.toml").touch()
    with pytest.raises(ConfigError, match=r"it holds no \*\.toml"):
        load_fleet(tmp_path)


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
    watching = Supervision(tmp_path / "dead" / "state")
    watching.say({"pid": 1, "starts": 3, "problem": "ended with exit code 1", "page": "http://127.0.0.1:8710/"})
    try:
        table = call("status", "--config", str(tmp_path))
        listed = call("status", "--json", "--config", str(tmp_path))
    finally:
        watching.close()
        for file in opened:
            file.close()
    assert (table.returncode, listed.returncode) == (0, 0), table.stderr + listed.stderr
    *lines, page = table.stdout.splitlines()
    assert page == "page: http://127.0.0.1:8710/"
    rows = [line.split(maxsplit=1) for line in lines]
    assert [row[0] for row in rows] == ["machine", "ill", "dead", "new", "young", "odd", "fine"]
    words = dict(rows)
    assert words["ill"].split() == ["failure", "running", "5", "3", "s", "ago", "2", "x:", "danger"]
    assert words["dead"].split()[:3] == ["no", "data", "died"]
    assert words["dead"].endswith("the daemon ended with exit code 1")
    assert words["new"].split() == ["no", "data", "never", "ran", "nobody", "listens"]
    assert words["odd"].endswith("disk: full (and 1 more)")
    values = json.loads(listed.stdout)
    found, page = values["machines"], values["page"]
    assert page == "http://127.0.0.1:8710/"
    assert [status["machine"] for status in found] == [row[0] for row in rows[1:]]
    assert found[1]["supervisor"]["starts"] == 3
    assert found[0]["file"] == "ill.toml"


def test_without_a_daemon_nothing_is_called_healthy() -> None:
    assert standing({"running": False, "state": "normal"}) == "no_data"
    assert standing({"running": False, "state": "failure"}) == "failure"
    assert standing({"running": True, "state": "normal"}) == "normal"
    assert standing({"running": True}) == "no_data"
    assert standing({"running": True, "state": "a state of another version"}) == "no_data"
