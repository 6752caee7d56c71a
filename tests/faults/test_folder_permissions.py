"""A folder that may not be read: said at the start, and while the daemon runs, and taken up when it may be again."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from streams.types.listing import list_files
from tests.streams.folders import csv_bytes, noise
from tests.support.daemons import ROOT, call, make_machine, start_program, status
from tests.support.folder_permissions import BOUND
from tests.support.waiting import finish, stop, wait_until

# Permissions bind the superuser, too, once these are taken away.

pytestmark = pytest.mark.process


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    make_machine(tmp_path)
    found = tmp_path / "in0"
    yield found
    for path in (tmp_path, found, found / "sub"):
        if path.is_dir():
            path.chmod(0o755)


# One process without these permissions for all modes and commands.
_COMMANDS_BY_MODE = """
import json, sys
from pathlib import Path
from tests.support.commands import run_command

folder, commands = Path(sys.argv[1]), json.loads(sys.argv[2])
for mode in (0o000, 0o300, 0o600):  # nothing, no list, no look
    folder.chmod(mode)
    for command in commands:
        done = run_command(*command)
        print(json.dumps([mode, command[0], done.returncode, done.stderr]))
"""


def test_it_is_named_at_the_start(folder: Path) -> None:
    config = ("--config", str(folder.parent / "m.toml"))
    commands = [("run", *config), ("replay", str(folder), *config, "--out", str(folder.parent / "out"))]
    child = [*BOUND, sys.executable, "-c", _COMMANDS_BY_MODE, str(folder), json.dumps(commands)]
    made = subprocess.run(child, cwd=ROOT, capture_output=True, text=True, check=True)
    found = [json.loads(line) for line in made.stdout.splitlines()]
    assert [(mode, name) for mode, name, *_ in found] == [
        (mode, name) for mode in (0o000, 0o300, 0o600) for name in ("run", "replay")
    ]
    for mode, name, code, said in found:
        assert code == 2, (mode, name)
        assert f"[[source]] s0: url: '{folder}' may not be read (Permission denied)" in said
        assert "Traceback" not in said


def test_so_is_one_below_a_folder_that_may_not_be_searched(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "hidden" / "in").mkdir(parents=True)
    config = tmp_path / "m.toml"
    config.write_text(config.read_text().replace(str(folder), str(tmp_path / "hidden" / "in")))
    (tmp_path / "hidden").chmod(0o600)
    try:
        daemon = start_program(config, prefix=BOUND)
        said = finish(daemon)
    finally:
        (tmp_path / "hidden").chmod(0o755)
    assert daemon.returncode == 2
    assert "may not be read (Permission denied)" in said


def test_it_is_a_problem_while_the_daemon_runs(folder: Path, tmp_path: Path) -> None:
    config = tmp_path / "m.toml"
    (folder / "f1.csv").write_bytes(csv_bytes(noise(512, 1)))

    def problem() -> str | None:
        return status(config).get("problems", {}).get("s0")

    def accepted() -> int:
        return status(config).get("sources", {}).get("s0", {}).get("accepted", 0)

    daemon = start_program(config, prefix=BOUND)
    try:
        wait_until(lambda: accepted() == 1)
        for mode in (0o000, 0o600):
            folder.chmod(mode)
            wait_until(lambda: problem() == f"{folder}: cannot be read (Permission denied)")
            folder.chmod(0o755)
            wait_until(lambda: problem() is None)
        (folder / "sub").mkdir(mode=0o000)
        wait_until(lambda: problem() == f"{folder}/sub: may not be read (Permission denied)")
        (folder / "f2.csv").write_bytes(csv_bytes(noise(512, 2)))
        wait_until(lambda: accepted() == 2)
        (folder / "sub").chmod(0o755)
        wait_until(lambda: problem() is None)
        folder.rename(tmp_path / "gone")
        wait_until(lambda: problem() == f"{folder}: cannot be read (No such file or directory)")
        (tmp_path / "gone").rename(folder)
        wait_until(lambda: problem() is None)
        assert accepted() == 2
        said = stop(daemon)
    finally:
        daemon.kill()
        daemon.communicate()
    assert daemon.returncode == 0, said
    assert "can be read again" in said


def test_a_replay_goes_on_beside_it_as_the_daemon_does(folder: Path, tmp_path: Path) -> None:
    for number in (1, 2):
        (folder / f"f{number}.csv").write_bytes(csv_bytes(noise(512, number)))
    (folder / "sub").mkdir()
    (folder / "sub" / "f3.csv").write_bytes(csv_bytes(noise(512, 3)))
    (folder / "sub").chmod(0o000)
    config = ("--config", str(tmp_path / "m.toml"))

    def said_by(*command: str) -> str:
        done = call(*command, *config, prefix=BOUND)
        assert done.returncode == 0, done.stderr
        return done.stdout

    summary = json.loads(said_by("replay", str(folder), "--out", str(tmp_path / "out"), "--no-report", "--json"))
    assert (summary["files"]["accepted"], summary["closed"]) == (2, {"sub": "may not be read (Permission denied)"})
    assert "folder sub may not be read (Permission denied): its files are in no count" in said_by(
        "replay", str(folder), "--out", str(tmp_path / "again"), "--no-report"
    )
    assert f"folder {folder}/sub may not be read (Permission denied)" in said_by("check")


def test_a_folder_that_is_not_there_is_waited_for(folder: Path, tmp_path: Path) -> None:
    folder.rmdir()
    config = tmp_path / "m.toml"
    daemon = start_program(config, prefix=BOUND)
    try:
        wait_until(lambda: "No such file" in status(config).get("problems", {}).get("s0", ""))
        folder.mkdir()
        wait_until(lambda: status(config).get("problems") == {})
    finally:
        daemon.kill()
        daemon.communicate()


def test_what_is_closed_is_told_beside_what_is_open(folder: Path) -> None:
    (folder / "sub").mkdir()
    (folder / "a.csv").write_bytes(b"1\n")
    closed: list[str] = []
    assert set(list_files(str(folder), closed)) == {"a.csv"}
    assert closed == []
