"""A file of which the daemon dies twice is set aside; the others go on, and a command releases it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from monitor.records.events import EventLog
from monitor.records.store import Store
from tests.streams.folders import csv_bytes, noise
from tests.support.attacks import wide_text
from tests.support.daemons import call, make_machine, start, status
from tests.support.forks import Fork
from tests.support.victims import analyse_first
from tests.support.waiting import stop, wait_until

pytestmark = pytest.mark.process


def reasons(config: Path) -> list[str]:
    """Return why blocks were rejected."""
    with Store.open(config.parent / "state" / "state.db", read_only=True) as store:
        return [record.reason or "" for record in store.records()]


def test_the_first_file_is_not_blamed_for_what_loads_with_it(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    (tmp_path / "in0" / "1.csv").write_bytes(csv_bytes(noise(512)))
    ((name, loaded),) = Fork(analyse_first, config).finish()
    assert (name, loaded) == ("1.csv", True)


def test_a_file_of_which_the_daemon_dies_twice(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    config.write_text(config.read_text().replace("block_s = 0.1\n", "block_s = 0.1\ninterval_s = 1\n"))
    notes = tmp_path / "state" / "handling"
    # To find the one word among two million numbers takes a second.
    (tmp_path / "in0" / "1.csv").write_bytes(wide_text(1.0, lines=1, columns=2_000_000)[:-1] + b",x\n")
    for _ in range(2):
        daemon = start(config, "--quiet")
        wait_until(lambda pid=daemon.pid: status(config).get("pid") == pid and b"1.csv" in notes.read_bytes())
        daemon.kill()
        daemon.communicate()
    (tmp_path / "in0" / "2.csv").write_bytes(csv_bytes(noise(256)))
    daemon = start(config)
    wait_until(lambda: status(config).get("sources", {}).get("s0", {}).get("accepted") == 1)
    assert status(config)["poisoned"] == {"1.csv": "source s0: the monitor died while it handled it"}
    assert "poisoned, 1.csv: source s0" in call("status", "--config", str(config)).stdout
    done = call("release", "other.csv", "--config", str(config))
    assert (done.returncode, "poisoned are: 1.csv (s0)" in done.stderr) == (1, True)
    done = call("release", "1.csv", "--config", str(config), "--json")
    assert json.loads(done.stdout) == {"released": [{"source": "s0", "file": "1.csv"}]}
    # The count of rejected files is the same before the file is read again.
    wait_until(lambda: any("column 2000001" in reason for reason in reasons(config)), every=0.05)
    wait_until(lambda: not status(config)["poisoned"] and status(config)["sources"]["s0"]["pending"] == 0)
    counts = status(config)["sources"]["s0"]
    assert [counts[name] for name in ("offered", "accepted", "rejected")] == [2, 1, 1]
    said = stop(daemon)
    assert daemon.returncode == 0, said
    assert "rejected: poisoned: 1.csv: the monitor died repeatedly" in said
    assert "rejected: unreadable: 1.csv: line 1, column 2000001: expected a number, found 'x'" in said
    with EventLog(tmp_path / "state" / "state.db") as log:
        kinds = [notice.body["kind"] for _, notice in log.notices()]
    assert "file_poisoned" in kinds
