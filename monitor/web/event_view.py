"""The event logs of all machines as one, newest first."""

from __future__ import annotations

import json
import re
import sqlite3
from collections.abc import Mapping
from typing import Any, NamedTuple

from monitor.records.database import StoreError
from monitor.records.events import Acknowledgement, LoggedEvent, count_unacknowledged, tables_of
from monitor.web.answers import Query, RequestError, whole_number, without_folders
from monitor.web.machines import Machine, Machines
from monitor.words.events import event_text

_SHOWN_APART = ("kind", "channel", "severity", "block")
_NAME = re.compile(r"^(?P<machine>[^:]+):(?P<event>n?[1-9][0-9]{0,17})$")
_WITH_BLOCKS = """
SELECT axis_time AS moment, 0 AS kind, events.id AS id, source, sequence, day IS NOT NULL AS dated, body
FROM events JOIN blocks ON blocks.id = block
"""
_WITHOUT = "SELECT utc, 1, id, NULL, NULL, 1, body FROM notices"


class Place(NamedTuple):
    """Sort key of an event among those of all machines."""

    moment: float
    machine: str
    kind: int
    id: int


def events(site: Machines, query: Query) -> dict[str, Any]:
    """Return the newest events of all machines or of one, and the number of unacknowledged ones."""
    limit = whole_number(query, "limit", 200, 1, 1000)
    chosen = [site.machine(query["machine"])] if query.get("machine") else list(site)
    before = _place_of(site, query["before"]) if query.get("before") else None
    found: list[tuple[Place, dict[str, Any]]] = []
    failing: dict[str, str] = {}
    waiting = 0
    for machine in chosen:
        try:
            if machine.store.identity() is not None:
                found += _read(machine, limit, before)
                waiting += unacknowledged(machine)
        except StoreError as error:
            # The events of the other machines are returned.
            failing[machine.name] = without_folders(str(error))
    found.sort(key=lambda item: item[0], reverse=True)
    return {"unacknowledged": waiting, "failing": failing, "events": [event for _, event in found[:limit]]}


def unacknowledged(machine: Machine) -> int:
    """Return the number of unacknowledged events of a machine."""
    if machine.store.identity() is None:
        return 0
    with machine.store.connection() as connection:
        return count_unacknowledged(connection)


def marker(machine: Machine) -> tuple[int, ...]:
    """Return numbers that change with each event, notice and acknowledgement."""
    if machine.store.identity() is None:
        return (0, 0, 0)
    with machine.store.connection() as connection:
        tables = tables_of(connection)
        return tuple(
            connection.execute(f"SELECT coalesce(max(id), 0) FROM {table}").fetchone()[0] if table in tables else 0
            for table in ("events", "notices", "acknowledgements")
        )


def find_event(site: Machines, name: str) -> dict[str, Any]:
    """Return an event by its name with the machine; :class:`RequestError` 404 where there is none."""
    machine, event = split_name(site, name)
    found = _find(machine, event)
    if not found:
        raise RequestError(404, "there is no such event")
    return found[0][1]


def split_name(site: Machines, name: str) -> tuple[Machine, str]:
    """Return machine and name in its log of an event; :class:`RequestError` 404 where the name is none."""
    found = _NAME.match(name)
    if found is None:
        raise RequestError(404, "there is no such event")
    return site.machine(found["machine"]), found["event"]


def _place_of(site: Machines, name: str) -> Place:
    machine, event = split_name(site, name)
    found = _find(machine, event)
    if not found:
        raise RequestError(404, "there is no such event to begin before")
    return found[0][0]


def _find(machine: Machine, event: str) -> list[tuple[Place, dict[str, Any]]]:
    """Return the event of a name in the log, or none."""
    return _read(machine, 1, None, "kind = ? AND id = ?", (int(event.startswith("n")), int(event.lstrip("n"))))


def _read(
    machine: Machine, limit: int, before: Place | None, where: str = "1", values: tuple[Any, ...] = ()
) -> list[tuple[Place, dict[str, Any]]]:
    """Return events of one machine with their places, the newest first."""
    with machine.store.connection() as connection:
        tables = tables_of(connection)
        log = _WITH_BLOCKS + (f" UNION ALL {_WITHOUT}" if "notices" in tables else "")
        query = f"SELECT * FROM ({log}) WHERE {where}"
        if before is not None:
            query += " AND (moment, ?, kind, id) < (?, ?, ?, ?)"
            values = (*values, machine.name, *before)
        query += " ORDER BY moment DESC, kind DESC, id DESC LIMIT ?"
        rows = connection.execute(query, (*values, limit)).fetchall()
        given = _acknowledgements(connection, [_log_name(row[1], row[2]) for row in rows], tables)
    found = []
    for moment, kind, number, source, sequence, dated, body in rows:
        name = _log_name(kind, number)
        event = LoggedEvent(name, source, sequence, moment if dated else None, json.loads(body), given.get(name, ()))
        found.append((Place(moment, machine.name, kind, number), _plain(machine, event, moment, bool(dated))))
    return found


def _acknowledgements(
    connection: sqlite3.Connection, names: list[str], tables: set[str]
) -> dict[str, tuple[Acknowledgement, ...]]:
    found: dict[str, tuple[Acknowledgement, ...]] = {}
    if "acknowledgements" in tables:
        query = "SELECT event, who, utc, note FROM acknowledgements WHERE event IN (SELECT value FROM json_each(?))"
        for event, who, utc, note in connection.execute(f"{query} ORDER BY id", (json.dumps(names),)):
            found[event] = (*found.get(event, ()), Acknowledgement(who, utc, note))
    return found


def _plain(machine: Machine, event: LoggedEvent, moment: float, dated: bool) -> dict[str, Any]:
    body: Mapping[str, Any] = event.body
    channel = body.get("channel")
    return {
        "id": f"{machine.name}:{event.id}",
        "machine": machine.name,
        "source": event.source or body.get("source"),
        "channel": channel,
        "block": event.block,
        "time_s": moment,
        "dated": dated,
        "kind": body.get("kind"),
        "severity": body.get("severity"),
        "text": without_folders(event_text(body, absolute=machine.absolute(channel))),
        "details": {
            key: without_folders(value) if isinstance(value, str) else value
            for key, value in body.items()
            if key not in _SHOWN_APART
        },
        "open": event.open,
        "acknowledgements": [
            {"who": item.who, "time_s": item.utc, "note": item.note} for item in event.acknowledgements
        ],
    }


def _log_name(kind: int, number: int) -> str:
    return f"n{number}" if kind else str(number)
