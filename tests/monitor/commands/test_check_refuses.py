"""``check`` refuses in the same words whatever ``run`` refuses at its start, and leaves no trace."""

from __future__ import annotations

import json
import os
import socket
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from monitor.records.ledger import StoreLedger, keep_dating
from monitor.records.store import Store
from streams.dates.dating import Dating
from tests.support.commands import run_command
from tests.support.daemons import RATE, ROOT, free_port
from tests.support.folder_permissions import BOUND
from tests.support.store_kill import block

_PLACES = 'state_dir = "state"\nrecords_dir = "records"\n'
_SOURCE = 'url = "folder:in"\nformat = "csv"\n'


def text_of(
    places: str = _PLACES, source: str = _SOURCE, channel: str = "", more: str = "", other: str | None = None
) -> str:
    """Return a configuration; ``other`` is the text of a second source."""
    parts = [f'[machine]\nname = "m"\nmin_free_mb = 1\n{places}[web]\nenabled = false\n']
    parts.append('[[bearing]]\nname = "b"\ndesignation = "1205 ETN9"\n[operating]\nspeed_hz = 40.0\n')
    for number, text in enumerate([source] if other is None else [source, other]):
        parts.append(f'[[source]]\nname = "s{number}"\nrate_hz = {RATE}\n{text}')
        parts.append(f'[[channel]]\nname = "x{number}"\nsource = "s{number}"\nunit = "g"\nbearing = "b"\n{channel}')
    return "".join([*parts, more])


def refused_by(command: str, config: Path) -> list[str]:
    done = run_command(command, "--config", config)
    assert done.returncode == 2, (command, done.stdout, done.stderr)
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    # The log may come before it.
    return done.stderr.partition("spallwatch: ")[2].splitlines()


def names_in(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def url(text: str) -> dict[str, str]:
    return {"source": f'url = "{text}"\n'}


def mqtt(more: str) -> dict[str, str]:
    return {"source": f'url = "mqtt://127.0.0.1:{free_port()}/press"\n{more}'}


_CONFIGURED: list[tuple[dict[str, str], str]] = [
    (url("ftp://files.plant.example/in"), "'ftp://files.plant.example/in': is not a source that goes on for ever"),
    (url("ftp://me:secret@files.plant.example/in"), "user name and password belong into username_file"),
    (url("tcp://me:secret@127.0.0.1:9000"), "user name and password belong into username_file"),
    (url("tcp://me:secret@127.0.0.1:port"), "user name and password belong into username_file"),
    (url("mqtt://me:secret@broker/press"), "user name and password belong into username_file"),
    (url("tcp://127.0.0.1"), "expected tcp://HOST:PORT"),
    (url("tcp://192.0.2.1:9000"), "192.0.2.1 can be reached by other machines"),
    ({"source": 'url = "tcp://192.0.2.1:9000"\npeers = ["192.0.2.0/24"]\n'}, "192.0.2.1:9000 cannot be listened to"),
    (url("tcp://no.such.host.invalid:9000"), "cannot be listened to"),
    (url("mqtt://broker/press/%23"), "the topic must be one topic"),
    (url("mqtt://broker/press/+"), "the topic must be one topic"),
    (mqtt('ca_file = "none.pem"\n'), "ca_file, cert_file or key_file cannot be used"),
    (mqtt('username_file = "none"\n'), "none cannot be read"),
    (mqtt('username_file = "empty"\n'), "the first line of"),
    (mqtt('cert_file = "one.pem"\n'), "cert_file and key_file belong together"),
    (
        {"source": 'url = "mqtt://127.0.0.1:1/press"\n', "other": 'url = "mqtt://127.0.0.1:1/press"\n'},
        "several sources have the same topic",
    ),
    (url("folder:file"), "expected a folder"),
    ({"source": _SOURCE.replace("csv", "nonsense")}, "format or data set 'nonsense' is not known"),
    ({"places": 'state_dir = "file"\n'}, "machine.state_dir = "),
    ({"places": 'state_dir = "file/state"\n'}, "machine.state_dir = "),
    ({"channel": 'track = true\nmap = "none.nc"\n'}, "none.nc"),
    ({"channel": 'track = true\nmap = "file"\n'}, "file"),
    ({"channel": "track = true\nmap = []\n"}, "map is empty"),
    ({"channel": 'track = true\nlibrary = "none.npz"\n'}, "none.npz"),
    ({"channel": "band_hz = [[600, 500]]\n"}, "band_hz"),
    ({"more": "[detekt]\n"}, "detekt"),
]


@pytest.mark.parametrize(("changed", "words"), _CONFIGURED, ids=range(len(_CONFIGURED)))
def test_what_a_configuration_cannot_mean_is_refused_by_both(
    tmp_path: Path, changed: dict[str, str], words: str
) -> None:
    (tmp_path / "in").mkdir()
    for name in ("file", "empty"):
        (tmp_path / name).write_bytes(b"")
    config = tmp_path / "m.toml"
    config.write_text(text_of(**changed))
    before = names_in(tmp_path)
    said = refused_by("check", config)
    assert any(words in line for line in said), said
    assert "secret" not in "".join(said)
    assert names_in(tmp_path) == before
    assert refused_by("run", config) == said
    assert names_in(tmp_path) == before


def test_programs_get_an_object_where_run_refuses_or_the_file_is_not_valid(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    config = tmp_path / "m.toml"
    for changed, key, line, words in (
        ({"channel": 'track = true\nmap = "none.nc"\n'}, "channel[x0].map", 24, "none.nc"),
        (url("tcp://me:secret@127.0.0.1:9000"), "source[s0].url", 16, "user name and password belong into"),
        ({"more": "[detekt]\n"}, "detekt", 23, "unknown key"),
    ):
        config.write_text(text_of(**changed))
        done = run_command("check", "--config", config, "--json")
        assert (done.returncode, "secret" in done.stdout) == (2, False)
        problems = json.loads(done.stdout)["problems"]
        found = {(entry["severity"], entry["key"], entry["line"]) for entry in problems if words in entry["came"]}
        assert ("problem", key, line) in found, problems


def store_of(path: Path, machine: str = "m") -> None:
    path.parent.mkdir()
    with Store.open(path, machine=machine) as store:
        store.commit(block(1), {})


def another_program(path: Path) -> None:
    path.parent.mkdir()
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("CREATE TABLE mine (x)")


def newer(path: Path) -> None:
    store_of(path)
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        connection.execute("UPDATE meta SET value = '99' WHERE key = 'schema_version'")


def another_state(path: Path) -> None:
    path.parent.mkdir()
    with Store.open(path, machine="m") as store:
        store.commit(block(1), {"channel:s0:x0": {"version": 99}})


def dated_by_name(path: Path) -> None:
    store_of(path)
    with Store.open(path) as store, StoreLedger(store):
        keep_dating(store, "s0", Dating("name", "%Y%m%d").to_dict())


def no_database(path: Path) -> None:
    path.parent.mkdir()
    path.write_bytes(b"words and no database" * 10)


_STORES: list[tuple[Callable[[Path], None], str]] = [
    (lambda path: store_of(path, "other"), "belongs to machine 'other', not to 'm'"),
    (another_program, "is a database of another program"),
    (newer, "schema version 99"),
    (another_state, "a state in it is of another version"),
    (dated_by_name, "spallwatch redate s0"),
    (no_database, "is not a database"),
    (lambda path: path.mkdir(parents=True), "is a folder"),
]


@pytest.mark.parametrize(("make", "words"), _STORES, ids=range(len(_STORES)))
def test_a_store_that_cannot_be_continued_is_refused_by_both(
    tmp_path: Path, make: Callable[[Path], None], words: str
) -> None:
    (tmp_path / "in").mkdir()
    config, database = tmp_path / "m.toml", tmp_path / "state" / "state.db"
    config.write_text(text_of())
    make(database)
    said = refused_by("check", config)
    assert len(said) == 1
    assert words in said[0]
    assert refused_by("run", config) == said


def test_a_port_that_another_program_has_is_refused_by_both(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        config = tmp_path / "m.toml"
        config.write_text(text_of(**url(f"tcp://127.0.0.1:{taken.getsockname()[1]}")))
        said = refused_by("check", config)
        assert "cannot be listened to" in said[0]
        assert refused_by("run", config) == said


def test_all_reasons_are_given_at_once(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    config = tmp_path / "m.toml"
    places = 'state_dir = "file"\nrecords_dir = "file"\n'
    config.write_text(text_of(places, **url("ftp://host/in"), other='url = "folder:file"\n'))
    said = refused_by("check", config)
    assert [
        part in line for part, line in zip(("state_dir", "ftp", "expected a folder", "records_dir"), said, strict=True)
    ]
    assert refused_by("run", config) == said[:3]


def test_a_folder_of_records_that_cannot_be_written_is_refused_by_check_alone(tmp_path: Path) -> None:
    """``run`` follows its sources without it, and its status says so."""
    (tmp_path / "in").mkdir()
    (tmp_path / "records").write_bytes(b"")
    config = tmp_path / "m.toml"
    config.write_text(text_of())
    said = refused_by("check", config)
    assert len(said) == 1
    assert said[0].startswith("machine.records_dir = ")


@pytest.mark.parametrize("path", ["recording", "dataset:ims:archive", "rig:ferrara?seed=1"])
def test_a_recording_is_a_problem_for_the_daemon_alone(tmp_path: Path, path: str) -> None:
    config = tmp_path / "m.toml"
    for name in ("recording", "archive"):
        (tmp_path / name).mkdir()
    config.write_text(text_of(**url(path)))
    done = run_command("check", "--config", config, "--json")
    assert done.returncode == 0
    problems = json.loads(done.stdout)["problems"]
    assert {problem["severity"] for problem in problems} == {"warning"}
    (problem,) = (problem for problem in problems if problem["key"] == "source[s0].url")
    assert problem["came"].endswith("is a recording: replay reads it, run refuses it")
    assert "is not a source that goes on for ever" in refused_by("run", config)[0]


def test_the_limits_of_a_simulated_rig_are_said(tmp_path: Path) -> None:
    config = tmp_path / "m.toml"
    config.write_text(text_of(**url("rig:ferrara?seed=1&model=rotor")))
    done = run_command("check", "--config", config, "--json")
    assert done.returncode == 0, done.stderr
    (limits,) = json.loads(done.stdout)["rigs"].values()
    assert "its accelerometer shows sensor a of rotor, which has no casing" in limits
    config.write_text(text_of(**url("rig:ferrara?seed=1&model=rotor&bearing=1205")))
    assert "models that take it: six_dof, ring_impact" in run_command("check", "--config", config).stdout


def test_a_missing_recording_is_a_problem(tmp_path: Path) -> None:
    config = tmp_path / "m.toml"
    config.write_text(text_of(**url("recordings")))
    done = run_command("check", "--config", config)
    assert done.returncode == 2, done.stderr
    assert f"recording {str(tmp_path / 'recordings')!r} does not exist (yet)" in done.stdout
    (tmp_path / "recordings").mkdir()
    done = run_command("check", "--config", config)
    assert "does not exist" not in done.stdout
    assert "is a recording: replay reads it, run refuses it" in done.stdout


def test_a_missing_folder_is_a_problem_and_a_damaged_store_no_refusal(tmp_path: Path) -> None:
    config, database = tmp_path / "m.toml", tmp_path / "state" / "state.db"
    config.write_text(text_of())
    store_of(database)
    data = bytearray(database.read_bytes())
    data[4096:8192] = bytes(4096)
    database.write_bytes(data)
    done = run_command("check", "--config", config)
    assert done.returncode == 2, done.stderr
    line = config.read_text().splitlines().index('url = "folder:in"') + 1
    assert f"problem: {config}:{line}: source[s0].url: folder" in done.stdout
    assert "does not exist (yet)" in done.stdout
    assert done.stderr == ""
    assert database.read_bytes() == data


_AS_USER = """
import json, sys
from pathlib import Path
from tests.support.commands import run_command

for command in ("check", "run"):
    done = run_command(command, "--config", sys.argv[1])
    print(json.dumps([done.returncode, done.stderr]))
"""


@pytest.mark.process
@pytest.mark.parametrize("place", ["state", "in", "."])
def test_what_may_not_be_used_is_refused_by_both(tmp_path: Path, place: str) -> None:
    folder = tmp_path / "machine"
    (folder / "in").mkdir(parents=True)
    if place != ".":
        (folder / "state").mkdir()
    (folder / "m.toml").write_text(text_of())
    mode = 0o300 if place == "in" else 0o555
    (folder / place).chmod(mode)
    child = [*BOUND, sys.executable, "-c", _AS_USER, str(folder / "m.toml")]
    try:
        made = subprocess.run(child, cwd=ROOT, capture_output=True, text=True, check=True, env={**os.environ})
    finally:
        (folder / place).chmod(0o755)
    check, run = (json.loads(line) for line in made.stdout.splitlines())
    assert (check[0], run[0]) == (2, 2)
    assert "Permission denied" in run[1]
    assert set(run[1].splitlines()) <= set(check[1].splitlines())


def test_run_and_replay_refuse_an_impossible_speed_in_the_words_of_check(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    config = tmp_path / "m.toml"
    config.write_text(text_of().replace("speed_hz = 40.0", "speed_hz = 2400.0"))
    done = run_command("check", "--config", config, "--json")
    assert done.returncode == 2
    came = [entry["came"] for entry in json.loads(done.stdout)["problems"] if entry["key"] == "operating.speed_hz"]
    assert came[0].startswith("2400 Hz is 144000 rpm; 40 Hz if rpm was meant")
    (said,) = refused_by("run", config)
    assert said.startswith(f"operating.speed_hz: {came[0]}; expected ")
    done = run_command("replay", tmp_path / "in", "--config", config, "--out", tmp_path / "out", "--no-report")
    assert done.returncode == 2
    assert f"spallwatch: {said}" in done.stderr
