"""``backup`` and ``restore`` as a user meets them: beside a daemon, in the status, and refused in words."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from monitor.records.store import Store
from monitor.service.system import StatusFile
from tests.support.commands import run_command
from tests.support.daemon import last, put, running
from tests.support.daemons import make_machine
from tests.support.waiting import wait_until


def backed_up(config: Path, *options: object) -> dict[str, object]:
    done = run_command("backup", config.parent / "backups", "--config", config, "--json", *options)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def store_of(config: Path, records: int = 0) -> Path:
    """Make a store without blocks, and published files in number."""
    state, folder = config.parent / "state", config.parent / "records"
    state.mkdir()
    folder.mkdir()
    Store.open(state / "state.db", machine="m").close()
    for number in range(records):
        (folder / f"m-2026010{number}.nc").write_bytes(b"x")
    return state / "state.db"


@pytest.mark.process
def test_a_backup_beside_a_running_daemon_is_put_back_and_the_daemon_goes_on(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    config.write_text(config.read_text().replace("settle_s = 0.2\n", "settle_s = 0.2\ninterval_s = 0.2\n"))
    put(config, 1)
    with running(config):
        wait_until(lambda: last(config) == 2 and (tmp_path / "records" / "m-undated.nc").exists())
        values = backed_up(config)
        assert (values["blocks"], values["removed"]) == (2, [])
        said = json.loads(run_command("status", "--config", config, "--json").stdout)
        assert said["last_backup_age_s"] < 3600.0
        assert "last backup " in run_command("status", "--config", config).stdout
        refused = run_command("restore", tmp_path / "backups", "--config", config, "--replace")
        assert refused.returncode == 2
        assert "another daemon is running" in refused.stderr
        assert "stop it first" in refused.stderr
    shutil.rmtree(tmp_path / "state")
    shutil.rmtree(tmp_path / "records")
    done = run_command("restore", tmp_path / "backups", "--config", config, "--json")
    assert done.returncode == 0, done.stderr
    values = json.loads(done.stdout)
    assert (values["blocks"], values["files"], values["aside"]) == (2, ["m-undated.nc"], None)
    assert values["same_configuration"]
    with running(config):
        put(config, 2)
        # The first file is known already.
        wait_until(lambda: last(config) == 4)
    with Store.open(tmp_path / "state" / "state.db", read_only=True) as store:
        assert [record.sequence for record in store.records()] == [1, 2, 3, 4]
        assert store.check() == []


def test_configuration_maps_and_libraries_are_in_it_and_secrets_are_not(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    (tmp_path / "maps").mkdir()
    (tmp_path / "inner").mkdir()
    for folder in ("maps", "inner"):
        (tmp_path / folder / "m.nc").write_bytes(folder.encode())
    (tmp_path / "password").write_bytes(b"secret")
    text = config.read_text() + 'map = ["maps/m.nc", "inner/m.nc"]\n'
    mail = '[notify.smtp]\nhost = "h"\nsender = "a@b"\nto = ["a@b"]\n'
    config.write_text(f'{text}{mail}username_file = "password"\npassword_file = "password"\n')
    store_of(config)
    folder = Path(str(backed_up(config)["out"]))
    assert sorted(path.name for path in (folder / "config").iterdir()) == ["m.toml", "x0-2-m.nc", "x0-m.nc"]
    assert (folder / "config" / "x0-2-m.nc").read_bytes() == b"inner"
    assert (folder / "config" / "m.toml").read_text() == config.read_text()


def test_the_words_of_both(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    database = store_of(config, records=2)
    done = run_command("backup", tmp_path / "backups", "--config", config, "--keep", 1)
    assert done.returncode == 0
    assert ": 0 blocks, 4 files, " in done.stdout
    assert "verified" in done.stdout
    refused = run_command("restore", tmp_path / "backups", "--config", config)
    assert refused.returncode == 2
    assert "there is a store already; --replace keeps it as state.db.before-restore-..." in refused.stderr
    (tmp_path / "records" / "m-20260100.nc").unlink()
    done = run_command("restore", tmp_path / "backups", "--config", config, "--replace")
    assert done.returncode == 0, done.stderr
    assert "put back: m-20260100.nc\n" in done.stdout
    assert f"the store before is kept as {database}.before-restore-" in done.stdout
    assert "made with another configuration" in done.stdout


def test_a_backup_that_fails_is_said_by_the_status(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    store_of(config)
    made = backed_up(config)
    (tmp_path / "file").write_bytes(b"")
    failed = run_command("backup", tmp_path / "file" / "backups", "--config", config)
    assert failed.returncode == 1
    assert "no backup can be written" in failed.stderr
    said = json.loads(run_command("status", "--config", config, "--json").stdout)
    assert "no backup can be written" in said["problems"]["backup"]
    assert said["last_backup_utc"] is not None
    assert backed_up(config)["out"] != made["out"]
    assert "problems" not in json.loads(run_command("status", "--config", config, "--json").stdout)


def test_a_damaged_backup_is_refused_and_the_others_are_named(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    database = store_of(config)
    first, second = (Path(str(backed_up(config)["out"])) for _ in range(2))
    (second / "state.db").write_bytes(b"")
    database.unlink()
    refused = run_command("restore", tmp_path / "backups", "--config", config)
    assert refused.returncode == 1
    assert "is not as it was written" in refused.stderr
    assert f"others are: {first.name}" in refused.stderr
    assert not database.exists()
    assert run_command("restore", first, "--config", config).returncode == 0


def test_a_machine_without_a_store_or_a_backup_is_refused(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    refused = run_command("backup", tmp_path / "backups", "--config", config)
    assert refused.returncode == 2
    assert "nothing to back up before the daemon has run" in refused.stderr
    refused = run_command("restore", tmp_path / "backups", "--config", config)
    assert refused.returncode == 2
    assert "expected a backup of machine 'm'" in refused.stderr


def test_a_state_of_another_daemon_is_not_replaced(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    store_of(config)
    backed_up(config)
    with StatusFile.open(tmp_path / "state"):
        refused = run_command("restore", tmp_path / "backups", "--config", config, "--replace")
    assert refused.returncode == 2
    assert "stop it first" in refused.stderr
