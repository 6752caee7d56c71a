"""Makers and checks that tests of security share."""

from __future__ import annotations

from pathlib import Path

from monitor.records.events import EventLog
from monitor.records.store import Store
from tests.support.daemons import make_machine

EVIL = "<img src=x onerror=alert(1)>\"'&"


def machine_with_event(folder: Path) -> Path:
    """Make a machine with a store that holds one notice, n1."""
    config = make_machine(folder)
    store = folder / "state" / "state.db"
    with Store.open(store, machine="m"), EventLog(store) as log:
        log.notice(1e9, {"kind": "test", "channel": EVIL, "text": EVIL})
    return config
