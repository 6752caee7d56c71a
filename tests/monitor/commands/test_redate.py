"""What dates a folder: shown by ``check``, stored by a replay, kept until ``redate``."""

from __future__ import annotations

import json
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from monitor.config.load import load_config
from monitor.health.record import Record
from monitor.records.events import EventLog
from monitor.records.ledger import StoreLedger, read_dating
from monitor.records.store import Store
from monitor.service.ingest import Ingest
from monitor.web.api import is_dated
from streams.dates.dating import Dating
from streams.types.stamps import utc_text
from tests.streams.folders import RATE, noise
from tests.support.commands import run_command
from tests.support.waiting import wait_until

CONFIG = """
[machine]
name = "m"
[[bearing]]
name = "b"
designation = "6205"
[operating]
speed_hz = 30
[[source]]
name = "s"
url = "folder:in"
rate_hz = {rate}
block_s = "file"
{keys}
[[channel]]
name = "x"
source = "s"
column = 1
unit = "g"
bearing = "b"
band_hz = [[100, 400]]
"""
START = "2024-01-31T23:00:00Z"


def machine(folder: Path, keys: str = "", **files: bytes) -> Path:
    """Write a configuration and its folder: ``files``, else three of .npy."""
    (folder / "in").mkdir(exist_ok=True)
    for number in range(1, 4) if not files else ():
        np.save(folder / "in" / f"rec_{number}.npy", noise(500, number))
    for name, data in files.items():
        (folder / "in" / name.replace("__", ".")).write_bytes(data)
    config = folder / "m.toml"
    config.write_text(CONFIG.format(rate=RATE, keys=keys))
    return config


def checked(config: Path, *options: str) -> dict[str, Any]:
    done = run_command("check", "--config", config, "--json", *options)
    found: dict[str, Any] = json.loads(done.stdout)
    assert done.returncode == (2 if "problem" in {entry["severity"] for entry in found["problems"]} else 0)
    return found


def warnings_of(found: dict[str, Any]) -> list[str]:
    return [entry["came"] for entry in found["problems"] if entry["severity"] == "warning"]


def csv(head: str, seed: int) -> bytes:
    return f"{head}\n".encode() + "".join(f"{value:.4f}\n" for value in noise(500, seed)).encode()


def test_check_opens_a_waiting_file_and_says_what_dates_it(tmp_path: Path) -> None:
    config = machine(tmp_path, f'start_utc = "{START}"\ninterval_s = 60')
    found = checked(config)["dating"]["s"]
    assert (found["by"], found["file"], found["time_utc"]) == ("count", "rec_1.npy", START)
    assert "60 s" in found["text"]
    assert f"rec_1.npy: {START}" in run_command("check", "--config", config).stdout


def test_check_keeps_the_choice_that_it_shows_where_it_is_asked_to(tmp_path: Path) -> None:
    config = machine(
        tmp_path, f'start_utc = "{START}"\ninterval_s = 60', rec_1__csv=csv("0.0", 1), rec_2__csv=csv("0", 2)
    )
    assert checked(config)["dating"]["s"]["kept"] is False
    assert not (tmp_path / "state").exists()
    assert checked(config, "--keep")["dating"]["s"]["kept"] is True
    # A file that would have been the first comes before the start.
    (tmp_path / "in" / "a.csv").write_bytes(csv("Datum: 01.02.2024\nUhrzeit: 10:00:00", 3))
    (tmp_path / "in" / "rec_1.csv").unlink()
    found = checked(config)["dating"]["s"]
    assert (found["by"], found["kept"]) == ("count", True)
    assert "this choice is kept" in run_command("check", "--config", config).stdout
    with (
        Store.open(tmp_path / "state" / "state.db", machine="m") as store,
        EventLog(store.path),
        Ingest.open(load_config(config), store) as ingest,
    ):
        wait_until(lambda: ingest.step(threading.Event()) is None and ingest.backlogs()["s"].pending == 0)
        times = {record.name: utc_text(record.time) for record in store.records() if record.time is not None}
    assert times == {"rec_2.csv": "2024-01-31T23:01:00Z"}
    config.write_text(config.read_text().replace("interval_s = 60", "interval_s = 30"))
    done = run_command("check", "--config", config)
    assert done.returncode == 2
    assert "spallwatch redate s" in done.stderr


def test_check_keeps_no_step_of_a_file_that_may_grow(tmp_path: Path) -> None:
    config = machine(tmp_path, f'start_utc = "{START}"', rec_3__csv=csv("0.0", 1))
    checked(config, "--keep")
    with Store.open(tmp_path / "state" / "state.db", read_only=True) as store:
        kept = read_dating(store, "s")
    assert kept is not None
    assert (kept["by"], kept["step"], kept["first"]) == ("count", None, 1)


@pytest.mark.usefixtures("refused_at_once")
def test_check_keeps_nothing_beside_a_daemon_or_where_the_store_is_lost(tmp_path: Path) -> None:
    config = machine(tmp_path, f'start_utc = "{START}"')
    (tmp_path / "records").mkdir()
    (tmp_path / "records" / "m-20240131.nc").write_bytes(b"")
    done = run_command("check", "--config", config, "--keep")
    assert done.returncode == 2
    assert "is missing beside published records" in done.stderr
    (tmp_path / "records" / "m-20240131.nc").unlink()
    (tmp_path / "state").mkdir()
    with Store.open(tmp_path / "state" / "state.db", machine="m"):
        done = run_command("check", "--config", config, "--keep")
    assert done.returncode != 0
    assert "another process is writing to it" in done.stderr


def test_check_warns_where_nothing_dates_the_blocks(tmp_path: Path) -> None:
    found = checked(machine(tmp_path))
    assert (found["dating"]["s"]["time_utc"], found["dating"]["s"]["elapsed_s"]) == (None, 0.0)
    assert any("nothing dates its blocks" in came and "start_utc" in came for came in warnings_of(found))


def test_check_says_that_start_utc_is_not_used(tmp_path: Path) -> None:
    config = machine(tmp_path, f'start_utc = "{START}"', a__csv=csv("Datum: 01.02.2024\nUhrzeit: 10:00:00", 1))
    found = checked(config)
    assert found["dating"]["s"]["time_utc"] == "2024-02-01T10:00:00Z"
    assert any("start_utc is not used" in came for came in warnings_of(found))


def test_check_names_both_readings_of_a_date(tmp_path: Path) -> None:
    config = machine(tmp_path, a__csv=csv("Date: 03/04/2024 10:00:00", 1))
    (problem,) = (entry["came"] for entry in checked(config)["problems"] if "03/04/2024" in entry["came"])
    for words in ("2024-04-03T10:00:00Z", "2024-03-04T10:00:00Z", "date_order", "no file decides"):
        assert words in problem
    config = machine(tmp_path, 'date_order = "month_first"', a__csv=csv("Date: 03/04/2024 10:00:00", 1))
    assert checked(config)["dating"]["s"]["time_utc"] == "2024-03-04T10:00:00Z"


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ('time_from = "count"', "needs start_utc"),
        ('time_from = "clock"', "time_from"),
        ('time_name = "%H"', "expected year, month and day"),
        ('interval_s = 5\ntime_from = "name"', "interval_s belongs to"),
        ('date_order = "dmy"', "date_order"),
    ],
)
def test_keys_that_date_nothing_are_refused(tmp_path: Path, keys: str, words: str) -> None:
    done = run_command("check", "--config", machine(tmp_path, keys))
    assert done.returncode == 2
    assert words in done.stderr


def test_a_replay_stores_the_dates_and_what_gave_them(tmp_path: Path) -> None:
    config = machine(tmp_path, f'start_utc = "{START}"\ninterval_s = 60')
    arguments = ("replay", f"folder:{tmp_path / 'in'}", "--config", config, "--out", tmp_path / "out", "--no-report")
    done = run_command(*arguments, "--json", "--limit", 2)
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert summary["time_from"] == "count"
    assert "60 s each" in summary["dating"][0]
    with Store.open(tmp_path / "out" / "state.db", read_only=True) as store:
        times = [record.time for record in store.records()]
        assert [time - times[0] for time in times if time is not None and times[0] is not None] == [0.0, 60.0]
        assert read_dating(store, "s") is not None
    machine(tmp_path, "interval_s = 30")
    done = run_command(*arguments, "--resume")
    assert done.returncode == 2
    assert "start_utc is not set" in done.stderr
    assert "spallwatch redate s" in done.stderr
    machine(tmp_path, f'start_utc = "{START}"\ninterval_s = 60')
    assert run_command(*arguments, "--resume").returncode == 0
    done = run_command("replay", tmp_path / "in", "--config", machine(tmp_path), "--out", tmp_path / "b", "--no-report")
    assert "nothing dates its blocks" in done.stdout


def test_redate_makes_a_changed_configuration_valid(tmp_path: Path) -> None:
    config = machine(tmp_path, f'start_utc = "{START}"')
    (tmp_path / "state").mkdir()
    with Store.open(tmp_path / "state" / "state.db", machine="m") as store, StoreLedger(store) as ledger:
        assert ledger.dating("s") is None
        ledger.keep_dating("s", Dating("name", example="a.npy").to_dict())
        assert Dating.from_dict(ledger.dating("s") or {}) == Dating("name", example="a.npy")
    config = machine(tmp_path, f'start_utc = "{START}"\ntime_from = "count"')
    done = run_command("check", "--config", config)
    assert done.returncode == 2
    assert "spallwatch redate s" in done.stderr
    assert run_command("redate", "other", "--config", config).returncode == 2
    done = run_command("redate", "s", "--config", config, "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["before"]["by"] == "name"
    assert checked(config)["dating"]["s"]["by"] == "count"


@pytest.mark.usefixtures("refused_at_once")
def test_redate_needs_a_store_without_a_writer(tmp_path: Path) -> None:
    config = machine(tmp_path)
    assert run_command("redate", "s", "--config", config).returncode == 2
    with Store.open(tmp_path / "state" / "state.db", machine="m"):
        done = run_command("redate", "s", "--config", config)
        assert done.returncode == 2
        assert "another process" in done.stderr


def test_a_page_does_not_draw_blocks_without_time_at_zero(tmp_path: Path) -> None:
    with Store.open(tmp_path / "state.db", machine="m") as store:
        assert is_dated(store, "s") is False
        store.commit(Record(source="s", sequence=1, name="a", content_hash="1"), {})
        assert is_dated(store, "s") is None
        store.commit(Record(source="s", sequence=2, name="b", content_hash="2", elapsed=5.0), {})
        assert is_dated(store, "s") is False
        store.commit(Record(source="s", sequence=3, name="c", content_hash="3", time=1.7e9), {})
        assert is_dated(store, "s") is True
