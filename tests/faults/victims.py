"""What processes do that a test kills, where the module of the test loads more than they need."""

from __future__ import annotations

import time
from datetime import date
from pathlib import Path

from monitor.records import compact
from monitor.records.condense import condense
from monitor.records.moved_days import days_before, move_day
from monitor.records.recover.salvage import open_or_salvage
from monitor.records.store import Published, Store
from tests.faults.test_store_kill import block
from tests.forks import Messages


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
            with store.transaction() as connection:
                condense(connection, 200.0, 24)
            with store.maintenance() as connection:
                compact.shorten(connection, 8)


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
