"""What ``status`` sees without the daemon: a full disk at once, and the age of the last backup."""

from __future__ import annotations

import errno
import json
from pathlib import Path
from typing import Any

import pytest

from monitor.config.load import load_config
from monitor.records.backup import NOTE
from monitor.service.progress import unhealthy
from monitor.service.system import StatusFile, present_status
from tests.support.commands import run_command
from tests.support.daemons import make_machine
from tests.support.fleet import add_machine

_WRITTEN = {
    "status": "running",
    "machine": "m",
    "pid": 1,
    "version": "0",
    "state": "normal",
    "since_utc": "2026-11-22T07:00:00.000Z",
    "updated_utc": "2026-11-22T07:00:00.000Z",
    "blocks": 3,
    "sources": {},
    "problems": {},
    "channels": {},
}


def status_of(folder: Path, free: int | OSError) -> dict[str, Any]:
    """Return the status where so many bytes are free; the minimum of the configuration is 1 MB."""

    def found(_: Path) -> int:
        if isinstance(free, OSError):
            raise free
        return free

    return present_status(load_config(folder / "m.toml"), free=found)


def test_a_full_disk_is_seen_although_the_daemon_could_not_write_its_status(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    config.write_text(config.read_text().replace("min_free_mb = 1\n", "min_free_mb = 200\n"))
    with StatusFile.open(tmp_path / "state") as file:
        file.write(_WRITTEN)
        found = status_of(tmp_path, 150_000_000)
        assert found["status"] == "degraded"
        assert "the disk is nearly full, 150 MB are free, 200 MB are needed" in found["problems"]["disk"]
        assert list(unhealthy(found)) == [found["problems"]["disk"]]
        roomy = status_of(tmp_path, 200_000_000)
        assert (roomy["status"], roomy["problems"]) == ("running", {})
        file.write({**_WRITTEN, "problems": {"store": "disk I/O error", "publisher": "no room"}})
        assert list(unhealthy(status_of(tmp_path, 200_000_000))) == ["disk I/O error"]
    stopped = status_of(tmp_path, 0)
    assert stopped["status"] == "died"
    assert "disk" in stopped["problems"]


def test_without_a_minimum_a_disk_is_full_where_no_commit_finds_room(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    config.write_text(config.read_text().replace("min_free_mb = 1\n", "min_free_mb = 0\n"))
    assert "disk" in status_of(tmp_path, 0)["problems"]
    assert "problems" not in status_of(tmp_path, 1_000_000)


def test_a_state_that_is_not_there_is_no_full_disk(tmp_path: Path) -> None:
    make_machine(tmp_path)
    found = status_of(tmp_path, FileNotFoundError(errno.ENOENT, "No such file"))
    assert found == {"running": False, "status": "never_ran", "last_backup_utc": None, "last_backup_age_s": None}


def test_the_command_says_it_for_people_programs_and_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = add_machine(tmp_path, "press")
    with StatusFile.open(tmp_path / "press" / "state") as file:
        file.write({**_WRITTEN, "machine": "press"})
        (tmp_path / "press" / "state" / NOTE).write_text(json.dumps({"utc": "2026-11-22T07:00:00Z"}))
        monkeypatch.setattr(present_status, "__kwdefaults__", {"free": lambda _: 10, "clock": lambda: 1795338000.0})
        said = run_command("status", "--config", config).stdout
        assert "problem, disk: " in said
        assert "last backup 2 h ago (2026-11-22T07:00:00Z)" in said
        values = json.loads(run_command("status", "--config", config, "--json").stdout)
        assert (values["last_backup_age_s"], list(values["problems"])) == (7200.0, ["disk"])
        (machine,) = json.loads(run_command("status", "--config", tmp_path, "--json").stdout)["machines"]
        assert machine["status"] == "degraded"
        assert "disk: " in run_command("status", "--config", tmp_path).stdout


def test_a_failed_backup_is_a_problem_until_one_succeeds(tmp_path: Path) -> None:
    make_machine(tmp_path)
    state = tmp_path / "state"
    state.mkdir()
    assert present_status(load_config(tmp_path / "m.toml"))["last_backup_age_s"] is None
    note = {"utc": "2026-11-20T07:00:00Z", "failed_utc": "2026-11-21T07:00:00Z", "problem": "the disk is gone"}
    (state / NOTE).write_text(json.dumps(note))
    found = present_status(load_config(tmp_path / "m.toml"))
    assert found["problems"] == {"backup": "the backup of 2026-11-21T07:00:00Z failed: the disk is gone"}
    assert found["last_backup_utc"] == "2026-11-20T07:00:00Z"


@pytest.mark.parametrize("text", ["", "[1]", '{"utc": 7}', '{"utc": "yesterday"}'])
def test_a_damaged_note_is_as_none(tmp_path: Path, text: str) -> None:
    make_machine(tmp_path)
    (tmp_path / "state").mkdir()
    (tmp_path / "state" / NOTE).write_text(text)
    assert present_status(load_config(tmp_path / "m.toml"))["last_backup_utc"] is None
