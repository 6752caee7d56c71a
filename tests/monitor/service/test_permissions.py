"""What the program writes is for its owner and group: every file of a machine's life, under a umask that allows all."""

from __future__ import annotations

import os
import signal
import stat
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from models.platform import portable
from monitor.records.store import Store
from tests.support.commands import run_command
from tests.support.daemon import last, put
from tests.support.daemons import free_port, make_machine, start_program, status
from tests.support.store_kill import block
from tests.support.waiting import PATIENCE_S, wait_until

pytestmark = pytest.mark.skipif(portable._fcntl is None, reason="permissions are those of POSIX")


@pytest.fixture(autouse=True)
def open_umask() -> Iterator[None]:
    before = os.umask(0)
    yield
    os.umask(before)


def call(*words: object) -> None:
    ended = run_command(*words)
    assert ended.returncode == 0, ended.stderr


def modes(folder: Path) -> dict[str, int]:
    """Return the permissions of all below a folder; sockets and links have none of their own."""
    found = {path: path.lstat() for path in folder.rglob("*")}
    return {
        str(path.relative_to(folder)): stat.S_IMODE(is_.st_mode)
        for path, is_ in found.items()
        if stat.S_ISREG(is_.st_mode) or stat.S_ISDIR(is_.st_mode)
    }


@pytest.mark.process
def test_no_file_of_a_life_is_for_others(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    config.write_text(config.read_text().replace("enabled = false", f"port = {free_port()}"))
    given = {*modes(tmp_path)}
    put(config, 1)
    np.save(tmp_path / "in0.npy", np.random.default_rng(5).standard_normal(8000))
    asked = ("--rate-hz", 4000, "--unit", "g", "--bearing", "6205", "--speed-hz", 30, "--yes")
    call("init", tmp_path / "in0.npy", *asked, "--out", tmp_path / "made" / "n.toml")
    call("user", "add", "Ada", "--invite", "--config", config)
    process = start_program(config)
    try:
        wait_until(lambda: status(config).get("page") and last(config) >= 1)
        wait_until(lambda: any((tmp_path / "records").glob("*.nc")))
        live = modes(tmp_path)
        call("backup", tmp_path / "backups", "--config", config)
    finally:
        process.send_signal(signal.SIGTERM)
        _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, said
    call("replay", tmp_path / "in0", "--config", config, "--out", tmp_path / "again")
    call("report", tmp_path / "again", "--out", tmp_path / "report.html")
    found = {name: mode for name, mode in (live | modes(tmp_path)).items() if name not in given | {"in0.npy"}}
    found = {name: mode for name, mode in found.items() if not name.startswith("in0/")}
    made = {"state/state.db", "state/state.db-wal", "state/state.db-shm", "state/status.json", "state/web.token"}
    made |= {"state/daemon.lock", "report.html", "made/n.toml", "backups", "again/state.db"}
    assert made <= set(found)
    assert {name: oct(mode) for name, mode in found.items() if mode & 0o027} == {}
    secrets = [name for name in found if "token" in name or "users" in name]
    assert len(secrets) >= 2
    assert {oct(found[name]) for name in secrets} == {"0o600"}
    # Read by the group, as docs/how-to/deployment.md promises.
    assert found["state/state.db"] == found["state/status.json"] == 0o640
    assert all(found[name] == 0o640 for name in found if name.endswith(".nc"))


def test_a_stricter_umask_stays(tmp_path: Path) -> None:
    os.umask(0o077)
    call("examples", "sender.py", "--out", tmp_path / "all")
    assert {oct(mode & 0o077) for mode in modes(tmp_path).values()} == {"0o0"}
    assert os.umask(0o077) == 0o077


def test_a_store_made_by_a_library_is_for_owner_and_group(tmp_path: Path) -> None:
    with Store.open(tmp_path / "new" / "state.db", machine="m") as store:
        store.commit(block(1), {})
        found = {name: oct(mode) for name, mode in modes(tmp_path).items() if not name.endswith(".lock")}
    assert found == {
        "new": "0o750",
        **{f"new/state.db{end}": "0o640" for end in ("", "-wal", "-shm")},
    }
    # Importing a package changes nothing of the process that does so.
    assert os.umask(0) == 0
