"""The daemon as a process: killed at any moment, stopped in order, started twice; its files open all the while."""

from __future__ import annotations

import random
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from monitor.config.load import load_config
from monitor.health.record import Record
from monitor.records.ledger import StoreLedger
from monitor.records.store import Store
from monitor.service.ingest import Ingest
from tests.streams.folders import csv_bytes, noise
from tests.support.daemon_kill import published_blocks
from tests.support.daemons import ROOT, call, make_machine, start, start_program, status
from tests.support.effort import effort_count
from tests.support.folder_kill import write
from tests.support.waiting import Running, Stall, at_most, slowness, stop, wait_until

pytestmark = pytest.mark.process

KILLS = effort_count(quick=2, full=200)
FILES_A_KILL = 10


def undisturbed(folder: Path, inputs: Path, names: list[str]) -> list[Record]:
    """Return what one process, which nobody ends, says of the same files where they come in this order."""
    folder.mkdir()
    config = make_machine(folder)
    config.write_text(config.read_text().replace("settle_s = 0.2", "settle_s = 0.01"))
    never = threading.Event()
    with Store.open(folder / "state.db", machine="m") as store, Ingest.open(load_config(config), store) as ingest:
        stall = Stall(lambda: ingest.backlogs()["s0"].accepted)
        for number, name in enumerate(names, 1):
            temporary = folder / name
            shutil.copyfile(inputs / name, temporary)
            temporary.rename(folder / "in0" / name)
            while ingest.backlogs()["s0"].accepted < number:
                stall.check()
                ingest.step(never)
        return list(store.records())


@pytest.mark.timeout(effort_count(quick=900, full=7200))
def test_killed_at_random_nothing_is_lost_and_nothing_comes_twice(tmp_path: Path) -> None:
    generator = random.Random(20261121)
    config = make_machine(tmp_path)
    database = tmp_path / "state" / "state.db"
    number = blocks = committed = published = 0
    for _ in range(KILLS):
        daemon = start(config, "--quiet")
        for _ in range(FILES_A_KILL):
            number += 1
            blocks += write(tmp_path / "in0", number, generator)
        until = time.monotonic() + generator.uniform(0.5, 3.5)
        while time.monotonic() < until:
            now = published_blocks(config)
            assert now >= published
            published = now
            time.sleep(0.05)
        daemon.kill()
        _, said = daemon.communicate()
        assert "Traceback" not in said
        if database.exists():
            with Store.open(database, read_only=True) as store:
                kept = [record.sequence for record in store.records()]
            assert kept == list(range(1, len(kept) + 1))
            assert len(kept) >= committed
            committed = len(kept)
    daemon = start(config)
    wait_until(
        lambda: status(config).get("pid") == daemon.pid and status(config)["sources"]["s0"]["accepted"] == number
    )
    assert status(config)["sources"]["s0"]["pending"] == 0
    wait_until(lambda: published_blocks(config) == blocks)
    with at_most(5.0):
        said = stop(daemon)
    assert daemon.returncode == 0, said
    with Store.open(database, machine="m") as store, StoreLedger(store) as ledger:
        assert store.check() == []
        records = list(store.records())
        assert [record.sequence for record in records] == list(range(1, blocks + 1))
        assert all(record.accepted for record in records)
        assert len({record.content_hash for record in records}) == blocks
        assert store.counts().keys().isdisjoint({"duplicate", "changed"})
        assert ledger.file_counts("s0") == {"accepted": number}
    assert published_blocks(config) == blocks
    names = list(dict.fromkeys(record.name.split("[")[0] for record in records))
    assert records == undisturbed(tmp_path / "again", tmp_path / "in0", names)


@pytest.mark.parametrize(
    ("number", "begin"), [(signal.SIGTERM, start), (signal.SIGINT, start_program)], ids=["fork", "program"]
)
def test_a_stop_is_clean_and_publishes_what_there_is(
    tmp_path: Path, number: signal.Signals, begin: Callable[[Path], Running]
) -> None:
    config = make_machine(tmp_path)
    config.write_text(config.read_text().replace("interval_s = 0.3", "interval_s = 3600"))
    daemon = begin(config)
    wait_until(lambda: (tmp_path / "records").exists() or status(config).get("pid") == daemon.pid)
    for k in range(3):
        (tmp_path / "in0" / f"f{k}.csv").write_bytes(csv_bytes(noise(512, k)))
    wait_until(lambda: status(config).get("blocks") == 6)
    second = call("run", "--config", str(config))
    assert second.returncode == 2
    assert "another daemon" in second.stderr
    assert "Traceback" not in second.stderr
    assert "is running (since" in call("status", "--config", str(config)).stdout
    with at_most(5.0):
        said = stop(daemon, number)
    assert daemon.returncode == 0, said
    assert "stopped; 6 blocks" in said
    # The last publication is given three seconds, which may be too few on a busy machine.
    late = "will be at the next start" in said and slowness() > 1.5
    assert late or published_blocks(config) == 6
    assert "was stopped" in call("status", "--config", str(config)).stdout


def test_a_daemon_that_died_is_said_to_have(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    assert "has never run" in call("status", "--config", str(config)).stdout
    daemon = start(config)
    wait_until(lambda: status(config))
    daemon.kill()
    daemon.communicate()
    said = call("status", "--config", str(config), "--json")
    assert said.returncode == 0
    assert '"running": false' in said.stdout
    assert '"status": "died"' in said.stdout


@pytest.mark.parametrize(
    ("command", "reason"), [("run", "is a folder; run follows one machine"), ("page", "it holds no *.toml")]
)
def test_a_folder_without_configurations_is_refused_in_words(tmp_path: Path, command: str, reason: str) -> None:
    done = call(command, "--config", str(tmp_path))
    assert done.returncode == 2
    assert reason in done.stderr


def test_the_daemon_loads_no_compiler_no_plotting_and_no_netcdf(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    (tmp_path / "in0" / "f.csv").write_bytes(csv_bytes(noise(512, 1)))
    code = """
import sys, threading
for name in ("numba", "dask", "pymoo", "matplotlib", "xarray", "netCDF4", "paho", "asyncua", "google.protobuf"):
    sys.modules[name] = None
from collections.abc import Callable
from pathlib import Path
from monitor.config.load import load_config
from monitor.service.daemon import Daemon
stop = threading.Event()
class Stopping(Daemon):
    def _note_record(self, record):
        super()._note_record(record)
        stop.set()
Stopping(load_config(Path(sys.argv[1]))).run(stop)
"""
    run = subprocess.run(
        [sys.executable, "-c", code, str(config)], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    machine = load_config(config).machine
    with Store.open(machine.state_dir / "state.db", read_only=True) as store:
        assert store.last("s0") >= 1
    # The publisher is another process, which may load what it needs. Its three seconds are few on a busy machine.
    assert published_blocks(config) >= 1 or slowness() > 1.5
