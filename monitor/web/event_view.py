"""The event logs of all machines as one, newest first."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from monitor.records.database import StoreError
from monitor.records.events import LoggedEvent, count_unacknowledged
from monitor.records.queries import EventPlace, LogMarks, log_marks, newest_events
from monitor.web.answers import Query, RequestError, whole_number, without_folders
from monitor.web.machines import Machine, Machines
from monitor.words.events import event_text

_SHOWN_APART = ("kind", "channel", "severity", "block")
_NAME = re.compile(r"^(?P<machine>[^:]+):(?P<event>n?[1-9][0-9]{0,17})$")


def events(site: Machines, query: Query) -> dict[str, Any]:
    """Return the newest events of all machines or of one, and the number of unacknowledged ones."""
    limit = whole_number(query, "limit", 200, 1, 1000)
    chosen = [site.machine(query["machine"])] if query.get("machine") else list(site)
    before = _place_of(site, query["before"]) if query.get("before") else None
    found: list[tuple[EventPlace, dict[str, Any]]] = []
    failing: dict[str, str] = {}
    waiting = 0
    for machine in chosen:
        try:
            if machine.store.identity() is not None:
                logged = newest_events(machine.store, machine.name, limit, before)
                found += [(place, _plain(machine, place, event)) for place, event in logged]
                waiting += unacknowledged(machine)
        except StoreError as error:
            # The events of the other machines are returned.
            failing[machine.name] = without_folders(str(error))
    found.sort(key=lambda item: item[0], reverse=True)
    return {"unacknowledged": waiting, "failing": failing, "events": [event for _, event in found[:limit]]}


def unacknowledged(machine: Machine) -> int:
    """Return the number of unacknowledged events of a machine."""
    return 0 if machine.store.identity() is None else count_unacknowledged(machine.store)


def marker(machine: Machine) -> LogMarks:
    """Return numbers that change with each event, notice and acknowledgement."""
    return LogMarks() if machine.store.identity() is None else log_marks(machine.store)


def find_event(site: Machines, name: str) -> dict[str, Any]:
    """Return an event by its name with the machine; :class:`RequestError` 404 where there is none."""
    machine, event = split_name(site, name)
    found = newest_events(machine.store, machine.name, 1, name=event)
    if not found:
        raise RequestError(404, "there is no such event")
    return _plain(machine, *found[0])


def split_name(site: Machines, name: str) -> tuple[Machine, str]:
    """Return machine and name in its log of an event; :class:`RequestError` 404 where the name is none."""
    found = _NAME.match(name)
    if found is None:
        raise RequestError(404, "there is no such event")
    return site.machine(found["machine"]), found["event"]


def _place_of(site: Machines, name: str) -> EventPlace:
    machine, event = split_name(site, name)
    found = newest_events(machine.store, machine.name, 1, name=event)
    if not found:
        raise RequestError(404, "there is no such event to begin before")
    return found[0][0]


def _plain(machine: Machine, place: EventPlace, event: LoggedEvent) -> dict[str, Any]:
    body: Mapping[str, Any] = event.body
    channel = body.get("channel")
    return {
        "id": f"{machine.name}:{event.id}",
        "machine": machine.name,
        "source": event.source or body.get("source"),
        "channel": channel,
        "block": event.block,
        "time_s": place.moment,
        "dated": event.utc is not None,
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
