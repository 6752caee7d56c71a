"""The event logs of all machines as one, newest first.

One event is acknowledged, or many with one note; each by itself, with a result of its own.
"""

from __future__ import annotations

import re
import time
from collections.abc import Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass
from typing import Any

from monitor.records.database import StoreError
from monitor.records.events import EventLog, LoggedEvent, count_unacknowledged
from monitor.records.queries import EventPlace, LogMarks, log_marks, newest_events
from monitor.web.answers import Query, RequestError, json_object, whole_number, without_folders
from monitor.web.machines import Machines, WatchedMachine
from monitor.words.events import event_text

MAX_EVENTS = 200
"""Events of one request; a page sends several for more."""


@dataclass(frozen=True)
class _Given:
    """Who acknowledges, with which note, and the events of a request for many."""

    who: str
    note: str
    events: tuple[str, ...] = ()


def acknowledge(site: Machines, name: str, body: bytes, user: str | None = None) -> dict[str, Any]:
    """Acknowledge an event, by its name with the machine, and return it.

    Args:
        body: JSON with ``who`` and ``note``.
        user: name of the signed-in user, which takes the place of ``who``.

    Raises:
        RequestError: there is no such event, ``who`` is empty, or a text is too long.
    """
    machine, event = split_name(site, name)
    given = _given(body, user)
    with closing(EventLog(machine.store.path)) as log:
        if log.event(event) is None:
            raise RequestError(404, "there is no such event")
        _write(log, event, given)
    return find_event(site, name)


def acknowledge_many(site: Machines, body: bytes, user: str | None = None) -> dict[str, Any]:
    """Acknowledge events with one note; return a result for each, in their order.

    A failure leaves the other acknowledgements as they are. An event that is not open, because it was acknowledged
    meanwhile or needs no acknowledgement, is left unchanged.

    Args:
        body: JSON with ``events``, names with their machines, ``who`` and ``note``.
        user: name of the signed-in user, which takes the place of ``who``.

    Raises:
        RequestError: the body is not that, ``who`` is empty, or a text is too long; then nothing is acknowledged.
    """
    given = _given(body, user, many=True)
    results: list[dict[str, Any]] = []
    with ExitStack() as opened:
        logs: dict[str, EventLog] = {}
        results += (
            {"id": name, **_one_of_many(site, name, given, logs, opened)} for name in dict.fromkeys(given.events)
        )
    waiting = 0
    for machine in site:
        try:
            waiting += unacknowledged(machine)
        except StoreError:
            continue
    done = sum(result["result"] == "acknowledged" for result in results)
    return {"acknowledged": done, "unacknowledged": waiting, "results": results}


def _one_of_many(
    site: Machines, name: str, given: _Given, logs: dict[str, EventLog], opened: ExitStack
) -> dict[str, Any]:
    """Return the result of one event: acknowledged, not_open, unknown or failed; with it, or with the error."""
    try:
        machine, event = split_name(site, name)
        if machine.store.identity() is None:
            raise RequestError(404, "there is no such event")
        if machine.name not in logs:
            logs[machine.name] = opened.enter_context(closing(EventLog(machine.store.path)))
        found = logs[machine.name].event(event)
        if found is None:
            raise RequestError(404, "there is no such event")
        if found.open:
            _write(logs[machine.name], event, given)
        return {"result": "acknowledged" if found.open else "not_open", "event": find_event(site, name)}
    except RequestError as error:
        return {"result": "unknown" if error.status == 404 else "failed", "error": error.sentence}
    except StoreError as error:
        return {"result": "failed", "error": without_folders(str(error))}


def _write(log: EventLog, event: str, given: _Given) -> None:
    try:
        log.acknowledge(event, given.who, given.note, time.time())
    except ValueError as error:
        raise RequestError(400, str(error)) from None


def _given(body: bytes, user: str | None, *, many: bool = False) -> _Given:
    """Return what a body holds; :class:`RequestError` 400 where it is not what it should be."""
    found = json_object(body)
    wanted = "events, who and note" if many else "who and note"
    if found is None or not all(isinstance(found.get(key, ""), str) for key in ("who", "note")):
        raise RequestError(400, f"the body must be a JSON object with {wanted}")
    who = user or found.get("who", "")
    if any(not character.isprintable() for character in who):
        raise RequestError(400, "who must be one line of text")
    if not many:
        return _Given(who, found.get("note", ""))
    events = found.get("events")
    if not isinstance(events, list) or not all(isinstance(name, str) for name in events):
        raise RequestError(400, "events must be a list of names of events, such as press:17")
    if not 0 < len(events) <= MAX_EVENTS:
        raise RequestError(400, f"events must name 1 to {MAX_EVENTS} events")
    given = _Given(who, found.get("note", ""), tuple(events))
    try:
        EventLog.check_words(given.who, given.note)
    except ValueError as error:
        raise RequestError(400, str(error)) from None
    return given


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


def unacknowledged(machine: WatchedMachine) -> int:
    """Return the number of unacknowledged events of a machine."""
    return 0 if machine.store.identity() is None else count_unacknowledged(machine.store)


def marker(machine: WatchedMachine) -> LogMarks:
    """Return numbers that change with each event, notice and acknowledgement."""
    return LogMarks() if machine.store.identity() is None else log_marks(machine.store)


def find_event(site: Machines, name: str) -> dict[str, Any]:
    """Return an event by its name with the machine; :class:`RequestError` 404 where there is none."""
    machine, event = split_name(site, name)
    found = newest_events(machine.store, machine.name, 1, name=event)
    if not found:
        raise RequestError(404, "there is no such event")
    return _plain(machine, *found[0])


def split_name(site: Machines, name: str) -> tuple[WatchedMachine, str]:
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


def _plain(machine: WatchedMachine, place: EventPlace, event: LoggedEvent) -> dict[str, Any]:
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
