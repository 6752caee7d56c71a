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
from tests.support.daemons import ROOT, make_machine, start_program, status
from tests.support.folder_permissions import BOUND
from tests.support.waiting import stop, wait_until

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


# One process without these permissions for several commands, each with a mode that a folder has then.
_COMMANDS = """
import json, sys
from pathlib import Path
from tests.support.commands import run_command

for folder, mode, command in json.loads(sys.argv[1]):
    Path(folder).chmod(mode)
    done = run_command(*command)
    print(json.dumps([done.returncode, done.stdout, done.stderr]))
"""


def said_by(*commands: tuple[Path, int, tuple[str, ...]]) -> list[tuple[int, str, str]]:
    """Return exit code, output and errors of each command, run while its folder has that mode."""
    words = json.dumps([(str(folder), mode, command) for folder, mode, command in commands])
    child = [*BOUND, sys.executable, "-c", _COMMANDS, words]
    done = subprocess.run(child, cwd=ROOT, capture_output=True, text=True, check=True)
    return [json.loads(line) for line in done.stdout.splitlines()]


def test_it_is_named_at_the_start(folder: Path, tmp_path: Path) -> None:
    config = ("--config", str(tmp_path / "m.toml"))
    commands = (("run", *config), ("replay", str(folder), *config, "--out", str(tmp_path / "out")))
    modes = (0o000, 0o300, 0o600)  # nothing, no list, no look
    # The last one is below a folder that may not be searched.
    hidden, below = tmp_path / "hidden", tmp_path / "below.toml"
    (hidden / "in").mkdir(parents=True)
    below.write_text((tmp_path / "m.toml").read_text().replace(str(folder), str(hidden / "in")))
    asked = [(folder, mode, command) for mode in modes for command in commands]
    try:
        found = said_by(*asked, (hidden, 0o600, ("run", "--config", str(below))))
    finally:
        hidden.chmod(0o755)
    assert len(found) == 7
    for code, _, said in found:
        assert code == 2
        assert "may not be read (Permission denied)" in said
        assert "Traceback" not in said
    for _, _, said in found[:-1]:
        assert f"[[source]] s0: url: '{folder}' may not be read (Permission denied)" in said


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
    config = ("--config", str(tmp_path / "m.toml"))
    replay = ("replay", str(folder), *config, "--no-report", "--out")
    commands = ((*replay, str(tmp_path / "out"), "--json"), (*replay, str(tmp_path / "again")), ("check", *config))
    found = said_by(*((folder / "sub", 0o000, command) for command in commands))
    assert [code for code, *_ in found] == [0, 0, 0], found
    summary, replayed, checked = (said for _, said, _ in found)
    files = json.loads(summary)
    assert (files["files"]["accepted"], files["closed"]) == (2, {"sub": "may not be read (Permission denied)"})
    assert "folder sub may not be read (Permission denied): its files are in no count" in replayed
    assert f"folder {folder}/sub may not be read (Permission denied)" in checked


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
