"""What processes do that a test kills, where the module of the test loads more than they need."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from unittest.mock import patch

from monitor.config.load import load_config
from monitor.records import compact, rollup
from monitor.records.condense import condense
from monitor.records.events import EventLog
from monitor.records.ledger import StoreLedger
from monitor.records.published_folder import days_before, move_day
from monitor.records.recover.salvage import open_or_salvage
from monitor.records.store import Published, Store
from monitor.service.ingest import Ingest
from tests.support.forks import Messages
from tests.support.quota import Bounded
from tests.support.store_kill import block


def commit_and_condense(messages: Messages, path: Path) -> None:
    """Commit, roll up, condense and shorten without end, and send the number of the latest block."""
    compact.RESERVE_BYTES = 0
    with Store.open(path, machine="m") as store:
        messages.send("open")
        sequence = store.last("s")
        while True:
            for _ in range(16):
                sequence += 1
                store.commit(block(sequence), {"detect:x": {"seen": sequence}})
            messages.send(sequence)
            for day, last in store.rows("SELECT day, max(id) FROM blocks GROUP BY day"):
                store.note_published(Published(f"m-{day}.nc", day, last, 1))
            condense(store, 200.0, 24)
            compact.shorten(store, 8)


def salvage(messages: Messages, path: Path, records_dir: Path) -> None:
    """Open a store that is lost, and make it again from the published files."""
    messages.send("begins")
    open_or_salvage(path, machine="m", records_dir=records_dir)[0].close()


def move_days(messages: Messages, records_dir: Path, to: Path, database: Path, before: date) -> None:
    """Move the published days before a date, as ``archive-days`` does."""
    days = days_before(records_dir, "m", before)
    messages.send("begins")
    for path in days:
        move_day(path, "m", to, database, time.time())


def analyse_first(messages: Messages, config: Path) -> None:
    """Take the first block; send which file is noted during its analysis, and whether the transforms are loaded."""

    def noted(ledger: StoreLedger, source: str, paths: Sequence[str], size: int = 0) -> None:
        if paths:
            messages.send((paths[0], "pyfftw" in sys.modules))

    found = load_config(config)
    found.machine.state_dir.mkdir(parents=True, exist_ok=True)
    with (
        patch.object(StoreLedger, "analyse", noted),
        Store.open(found.machine.state_dir / "state.db", machine="m") as store,
        EventLog(store.path),
        Ingest.open(found, store) as ingest,
    ):
        while ingest.step(threading.Event()) is None:
            pass


def give_up_without_end(messages: Messages, path: Path) -> None:
    """Commit a block an hour of its clock under a small quota without end, and send the number of the latest block."""
    compact.RESERVE_BYTES, rollup.BATCH_BLOCKS = 0, 4
    bounded = Bounded(path, 1_500_000.0)
    bounded.time += 3600.0 * bounded.number
    while True:
        number = bounded.number + 1
        bounded.block("pinned" if number <= 10 else "kept", event=number % 10 == 0, forecast=True)
        messages.send(number)
        bounded.hour(ticks=3)
