"""A process that commits, rolls up, condenses and shortens is killed at any moment: each block is there once."""

from __future__ import annotations

import random
import time
from pathlib import Path

import pytest

from monitor.records import rollup
from monitor.records.ledger import StoreLedger
from monitor.records.store import Store
from tests.support.daemon_kill import published_blocks
from tests.support.daemons import make_machine, start, status
from tests.support.effort import effort_count
from tests.support.folder_kill import write
from tests.support.forks import Fork
from tests.support.store_kill import block
from tests.support.victims import commit_and_condense
from tests.support.waiting import stop, wait_until

pytestmark = pytest.mark.process

KILLS = effort_count(quick=4, full=200)
DAEMON_KILLS = effort_count(quick=1, full=40)


def test_each_block_is_there_once_through_kills_during_rollup_and_retention(tmp_path: Path) -> None:
    generator = random.Random(20261122)
    path = tmp_path / "state.db"
    acknowledged = 0
    for kill in range(KILLS):
        child = Fork(commit_and_condense, path)
        messages = [child.receive() for _ in range(20 if kill == 0 else 2)]
        time.sleep(generator.uniform(0.0, 0.2))
        messages += child.kill()
        acknowledged = max([acknowledged, *(number for number in messages if number != "open")])
    with Store.open(path, machine="m") as store, StoreLedger(store) as ledger:
        count = store.last("s")
        assert count >= acknowledged > 100
        assert store.check() == []
        full = [number for (number,) in store.rows("SELECT sequence FROM blocks")]
        condensed = [number for (number,) in store.rows("SELECT sequence FROM identities")]
        assert len(condensed) > 0.4 * count
        assert sorted(full + condensed) == list(range(1, count + 1))
        assert store.counts() == {"ok": count}
        assert [event["n"] for event in store.events()] == list(range(3, count + 1, 3))
        assert [row.block for row in store.forecasts()] == list(range(1, count + 1))
        assert store.load_states() == {"detect:x": {"seen": count}}
        assert [ledger.content_of("s", number) for number in condensed] == [f"{number:08x}" for number in condensed]
        with store.transaction() as connection:
            rollup.roll_up(connection, 60.0)
            last = rollup.rolled_up_to(connection)
        query = "SELECT sum(records) FROM rollup WHERE level = 60 AND channel = 'x'"
        pending = store.rows("SELECT count(*) FROM blocks WHERE id > ?", last)[0][0]
        assert store.rows(query)[0][0] + pending == count
        assert store.commit_many([(block(number), {}) for number in range(1, count + 1)]) == ["duplicate"] * count


@pytest.mark.timeout(effort_count(quick=900, full=7200))
def test_a_daemon_killed_while_it_condenses_has_each_block_once_in_store_and_files(tmp_path: Path) -> None:
    generator = random.Random(20261123)
    config = make_machine(tmp_path)
    # Blocks last 0.1 s: all but the newest nine are old.
    config.write_text(config.read_text() + "[retention]\nfull_days = 1e-5\n")
    number = blocks = 0
    for _ in range(DAEMON_KILLS):
        daemon = start(config, "--quiet")
        for _ in range(40):
            number += 1
            blocks += write(tmp_path / "in0", number, generator)
        time.sleep(generator.uniform(1.0, 3.5))
        daemon.kill()
        _, said = daemon.communicate()
        assert "Traceback" not in said
    daemon = start(config)
    wait_until(
        lambda: status(config).get("pid") == daemon.pid and status(config)["sources"]["s0"]["accepted"] == number
    )
    wait_until(lambda: condensed(config) >= (blocks // 64) * 64 - 10)
    (tmp_path / "in0" / "copy.csv").write_bytes((tmp_path / "in0" / "f00001.csv").read_bytes())
    wait_until(lambda: published_blocks(config) == blocks + 1 or published_blocks(config) == blocks)
    said = stop(daemon)
    assert daemon.returncode == 0, said
    with Store.open(tmp_path / "state" / "state.db", machine="m") as store:
        assert store.check() == []
        numbers = store.rows("SELECT sequence FROM blocks UNION ALL SELECT sequence FROM identities")
        assert sorted(row[0] for row in numbers) == list(range(1, blocks + 1))
    assert published_blocks(config) == blocks


def condensed(config: Path) -> int:
    """Return how many blocks have left the store as full records."""
    with Store.open(config.parent / "state" / "state.db", read_only=True) as store:
        return store.rows("SELECT count(*) FROM identities")[0][0]
