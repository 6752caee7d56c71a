"""Health checks: whether daemons run, sources deliver and stores can be used."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from monitor.records.database import StoreError
from monitor.web.answers import without_folders
from monitor.web.machines import Machine, Machines

_MAX_STATUS_AGE_S = 15.0
_SAID = {
    "never_ran": "has never run",
    "died": "does not run: it died",
    "stopped": "does not run: it was stopped",
    "starting": "is starting",
}


def health(site: Machines) -> tuple[int, dict[str, Any]]:
    """Return the HTTP status, and ``ok`` or ``failing`` with the reasons.

    It fails where a daemon does not run or says nothing, a source has no data, or a store cannot be read or written.
    """
    reasons = [f"machine {machine.name}: {reason}" for machine in site for reason in _reasons(machine)]
    return (503 if reasons else 200), {"status": "failing" if reasons else "ok", "reasons": reasons}


def ready() -> dict[str, Any]:
    """Return that the page answers."""
    return {"status": "ready"}


def _reasons(machine: Machine) -> Iterator[str]:
    status = machine.status()
    values = status.values
    if not values.get("running") or values.get("status") == "starting":
        yield f"the daemon {_SAID.get(str(values.get('status')), 'does not run')}"
        return
    if status.age is None or status.age > _MAX_STATUS_AGE_S:
        yield f"the daemon said nothing for {status.age or 0.0:.0f} s"
    try:
        machine.store.rows("SELECT max(id) FROM blocks")
    except StoreError as error:
        yield f"the store cannot be read: {without_folders(str(error))}"
    for what in ("store", "disk"):
        if what in values["problems"]:
            yield values["problems"][what]
    silent: dict[str, str] = {}
    for channel in values["channels"].values():
        if channel["state"] == "no_data":
            silent.setdefault(channel["source"], channel["reason"])
    for source, reason in silent.items():
        yield f"source {source}: {reason}"
