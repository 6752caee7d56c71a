"""Several machines in a folder: conflicts between their configurations are refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from monitor.config.fleet import load_fleet
from monitor.config.load import ConfigError
from tests.support.daemons import call
from tests.support.fleet import add_machine

pytestmark = pytest.mark.process


def test_all_problems_are_named_file_by_file(tmp_path: Path) -> None:
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
    lines = str(caught.value).splitlines()
    assert [line.removeprefix(f"{tmp_path}/").split(":")[0] for line in lines] == [
        "d.toml",
        "e.toml",
        "b.toml",
        "c.toml",
        "c.toml",
    ]
    assert lines[2].endswith("machine.name: a is also machine.name of a.toml; expected one of its own")
    assert f"machine.records_dir: {tmp_path}/a/state is also machine.state_dir of a.toml" in lines[3]
    assert "web: port, max_streams differ from those of a.toml" in lines[4]
    for command in ("page", "status"):
        done = call(command, "--config", str(tmp_path))
        assert done.returncode == 2
        assert [line in done.stderr for line in lines] == [True] * 5
    assert not (tmp_path / "a" / "state").exists()


def test_default_folders_that_two_machines_share_are_refused(tmp_path: Path) -> None:
    for name in ("a", "b"):
        path = add_machine(tmp_path, name)
        text = path.read_text()
        path.write_text(text.replace(f'state_dir = "{name}/state"\nrecords_dir = "{name}/records"\n', ""))
    with pytest.raises(
        ConfigError,
        match=r"state is also machine\.state_dir of a\.toml(.|\n)*records is also machine\.records_dir",
    ):
        load_fleet(tmp_path)


def test_two_machines_that_listen_at_one_address_are_refused(tmp_path: Path) -> None:
    for name in ("a", "b"):
        path = add_machine(tmp_path, name)
        path.write_text(path.read_text().replace(f'url = "folder:{tmp_path}/{name}/in0"', 'url = "tcp://:8720"'))
    with pytest.raises(ConfigError, match=r"b\.toml: source\.s0\.url: tcp://:8720 is also source\.s0\.url of a\.toml"):
        load_fleet(tmp_path)


def test_a_web_section_in_one_file_counts_for_all(tmp_path: Path) -> None:
    add_machine(tmp_path, "a", web=None)
    add_machine(tmp_path, "b", web="port = 9000")
    add_machine(tmp_path, "c", web="port = 9000")
    fleet = load_fleet(tmp_path)
    assert [machine.config.machine.name for machine in fleet.machines] == ["a", "b", "c"]
    assert fleet.web.port == 9000
    assert fleet.page_dir == tmp_path / "a" / "state"


def test_invalid_files_are_left_out_on_request(tmp_path: Path) -> None:
    add_machine(tmp_path, "a")
    (tmp_path / "b.toml").write_text("[machine\n")
    fleet = load_fleet(tmp_path, strict=False)
    assert [machine.path.name for machine in fleet.machines] == ["a.toml"]
    assert "b.toml:1: not valid TOML" in fleet.problems[0]
    assert call("status", "--config", str(tmp_path)).returncode == 2
    (tmp_path / "a.toml").unlink()
    with pytest.raises(ConfigError, match=r"b\.toml:1: not valid TOML"):
        load_fleet(tmp_path, strict=False)


def test_a_folder_without_configurations_is_refused(tmp_path: Path) -> None:
    (tmp_path / ".hidden.toml").touch()
    with pytest.raises(ConfigError, match=r"it holds no \*\.toml"):
        load_fleet(tmp_path)
