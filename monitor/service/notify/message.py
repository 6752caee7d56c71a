"""The text of a notification, for a maintenance engineer on a phone, the same for programs, and the picture of a mail.

The picture is drawn by a short-lived child process; a mail without one is as good as before.
"""

from __future__ import annotations

import base64
import json
import logging
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from monitor.config.load import Config
from monitor.records.events import LoggedEvent
from monitor.service.children import Child
from monitor.service.notify.channels import Message
from monitor.words.advice import ADVICE, Statement, state_of
from monitor.words.events import badness, event_text, local_moment, utc_text
from monitor.words.features import columns, first
from monitor.words.numbers import Clock, count, duration, interval, times_first, volume
from monitor.words.situation import Situation
from monitor.words.statuses import STAGES

_LOG = logging.getLogger(__name__)
ENTRY = "monitor.report.mail_child:child"
MAX_S = 20.0
"""Time after which a mail goes out without its picture."""
MAX_BYTES = 2_000_000
_PNG = b"\x89PNG\r\n"
_POLL_S = 0.2
MAX_LISTED = 20
"""Events that a message lists; of more, the worst are listed and all are counted."""
_MAX_TITLE_CHARACTERS = 180
_VALUES = (
    *("rms", "rms_smoothed", "peak"),
    *("v_eq", "v_eq_lower", "v_eq_upper", "v_eq_relative", "tt", "tt_lower", "tt_upper"),
)


@dataclass(frozen=True)
class MessageSender:
    """What messages say of the machine.

    Attributes:
        zone: its time zone.
        page: address of its page, or None.
        bearings: name of the bearing of each channel.
        advice: what to do by state.
    """

    name: str
    zone: str = "UTC"
    page: str | None = None
    bearings: Mapping[str, str] = field(default_factory=dict[str, str])
    advice: Mapping[str, str] = field(default_factory=lambda: dict(ADVICE))

    @classmethod
    def of_config(cls, config: Config) -> MessageSender:
        """Return that of a configuration; without a fixed port, the page has no address."""
        web, page = config.web, config.notify.page_url
        if page is None and web.enabled and web.port:
            page = web.url(web.port)
        bearings = {section.name: section.bearing for section in config.channel}
        return cls(config.machine.name, config.machine.timezone, page, bearings, config.advice.texts)

    def said(self, item: MessageItem) -> Statement | None:
        """Return what is said of the channel of an event after its block; None where nothing is known of it."""
        body, channel = item.event.body, str(item.event.body.get("channel") or "")
        if body.get("kind") == "no_data":
            silent = state_of(Situation(channel=item.where, state="no_data"), self.advice)
            return Statement(silent.key, item.text, "", "", clean(silent.action))
        if not item.values.get("stage"):
            return None
        severity = body.get("severity") if body.get("kind") == "alarm_raised" else None
        found = Situation.of_record(channel, item.values, item.event.block, self.bearings.get(channel, ""), severity)
        if body.get("kind") == "condition" and body.get("to") == "bad_data":
            found = replace(found, state="bad_data")
        verdict = item.bearing or {}
        # What all channels say is of the present; it is added where it is about the same name.
        if (verdict.get("fault"), verdict.get("fault_basis")) == (found.fault, found.basis) or not found.fault:
            found = found.with_bearing(verdict)
        return state_of(found, self.advice)


@dataclass(frozen=True)
class MessageItem:
    """An event with the values of its channel in the record of its block, SI; empty where there is no record."""

    event: LoggedEvent
    values: Mapping[str, Any] = field(default_factory=dict)
    found: float | None = None
    """Time of detection, UTC s, shown where the block has no date."""
    bearing: Mapping[str, Any] | None = None
    """What all channels of its bearing say together, by the keys of the interface."""

    def when(self, zone: str) -> str:
        """Return its time in a time zone and in UTC; the time of detection if its block has no date."""
        dated = local_moment(self.event.utc, zone)
        if dated is not None:
            return dated
        found = local_moment(self.found, zone)
        return "" if found is None else f"found {found}"

    @property
    def where(self) -> str:
        """Channel, or source where no channel is named; may be empty."""
        return clean(self.event.body.get("channel") or self.event.body.get("source") or self.event.source or "")

    @property
    def text(self) -> str:
        """What happened, in one sentence."""
        return clean(event_text(self.event.body, absolute=self.values.get("absolute_level") != "no"))


def worst_of(items: Sequence[MessageItem]) -> MessageItem | None:
    """Return the worst of the events of a message, which gives it its title, what is said, and its picture."""
    return max(items, key=lambda item: badness(item.event.body), default=None)


def compose(machine: MessageSender, items: Sequence[MessageItem], left_out: int = 0) -> Message:
    """Return the message of events in the order of detection, at most :data:`MAX_LISTED`, and the number left out."""
    worst = worst_of(items)
    many = len(items) + left_out
    name = clean(machine.name) or "machine"
    if worst is None:
        title = f"{name}: {count(many, 'event')} not delivered in time"
    else:
        headline = f"{worst.where}: {worst.text}" if worst.where else worst.text
        title = f"{name}: " + (f"{many} events, worst: {headline}" if many > 1 else headline)
    title = clean(title)
    if len(title) > _MAX_TITLE_CHARACTERS:
        title = title[: _MAX_TITLE_CHARACTERS - 1].rstrip() + "…"
    lines = [title, ""]
    if many > 1:
        lines += [_line(machine, item) for item in items]
        if left_out:
            lines.append(f"- and {count(left_out, 'event')} not listed here; the event log has them all")
        lines.append("")
    said = None if worst is None else machine.said(worst)
    if worst is not None:
        lines += _details(machine, worst, said)
    if machine.page is not None:
        lines.append(f"Page     {machine.page}")
    values = {
        "machine": machine.name,
        "page": machine.page,
        **({} if said is None else said.to_dict()),
        "events": [_plain(machine, item) for item in items],
        "left_out": left_out,
    }
    return Message(title, "\n".join((*lines, "")), values)


def clean(text: object) -> str:
    """Return a text on one line without control characters, safe in a header."""
    return " ".join("".join(mark if mark.isprintable() else " " for mark in str(text)).split())


def _line(machine: MessageSender, item: MessageItem) -> str:
    return "- " + ", ".join(part for part in (item.when(machine.zone), item.where, item.text) if part)


def _details(machine: MessageSender, item: MessageItem, said: Statement | None) -> list[str]:
    """Return the lines of a single event: how it stands and what to do; then what, where and since when."""
    event, values = item.event, item.values
    block = None if event.block is None else f"block {event.block}"
    rows = [] if said is None else [("State", said.headline), ("How sure", said.sureness), ("Level", said.level)]
    rows += [] if said is None else [("To do", said.action)]
    rows += [("What", item.text), ("Machine", clean(machine.name))]
    channel = clean(event.body.get("channel", ""))
    source = clean(event.source or event.body.get("source") or "")
    rows.append(("Channel", channel + (f" (source {source})" if source else "")) if channel else ("Source", source))
    rows.append(("Since", ", ".join(part for part in (item.when(machine.zone), block) if part) or "no date"))
    rows += [("Stage", _stage(machine, event, values)), ("V_eq", _volume(values)), ("TT", _remaining(values))]
    rows.append(("Event", event.id))
    return [f"{key:8} {text}" for key, text in rows if text]


def _stage(machine: MessageSender, event: LoggedEvent, values: Mapping[str, Any]) -> str:
    stage = values.get("stage")
    if stage is None:
        return ""
    text: str = STAGES.get(stage, str(stage))
    t_fs = values.get("t_fs")
    if t_fs is not None:
        since = Clock(dated=False).moment(t_fs) if event.utc is None else local_moment(t_fs, machine.zone)
        text += f", final since {since}" if stage != "final" else f" since {since}"
    if values.get("t_fs_block") is not None:
        text += f" (block {values['t_fs_block']})"
    return text


def _volume(values: Mapping[str, Any]) -> str:
    if values.get("v_eq") is None:
        return ""
    relative = values.get("v_eq_relative")
    # Another status of V_eq does not say that the rig is not calibrated, that of its forecast does.
    if relative is not None and "uncalibrated" in (values.get("edv_status"), first(values.get("tt_status"))):
        return f"{times_first(relative)} (rig not calibrated)"
    low, high = values.get("v_eq_lower"), values.get("v_eq_upper")
    return volume(values["v_eq"]) + (f" ({low * 1e6:.3g} to {high * 1e6:.3g})" if low and high else "")


def _remaining(values: Mapping[str, Any]) -> str:
    time, low, high, threshold = (first(values.get(key)) for key in ("tt", "tt_lower", "tt_upper", "v_th"))
    if time is None:
        return ""
    text = duration(time)
    if low is not None:
        text += f" ({interval(low, math.nan if high is None else high, duration)})"
    return text + (f", until {volume(threshold)}" if threshold else "")


def _plain(machine: MessageSender, item: MessageItem) -> dict[str, Any]:
    """Return an event for programs: its log entry, its sentence, what is said of its channel, and its state."""
    event, values = item.event, item.values
    absolute = values.get("absolute_level") != "no"
    state: dict[str, Any] = {name: values.get(name) for name in ("stage", "fault", "fault_basis", "t_fs_block")}
    state |= {name: value for name, value in columns(_VALUES, values, absolute=absolute).items() if value is not None}
    found = {**event.body, "id": event.id, "block": event.block, "time_utc": utc_text(event.utc), "text": item.text}
    if event.source is not None:
        found["source"] = event.source
    if values:
        found["state"] = {**state, "unit": "g" if absolute else "unknown"}
    said = machine.said(item)
    return found if said is None else {**found, **said.to_dict()}


def picture_request(
    store: Path,
    source: str | None,
    block: int | None,
    utc: float | None,
    channel: str | None,
    values: Mapping[str, Any],
    status: Mapping[str, Any],
) -> dict[str, Any] | None:
    """Return what the child is asked to draw of the channel of an event, or None where there is nothing to draw.

    Args:
        utc: time of the block, None where it has no date.
        values: of the channel in the record of the block, SI.
        status: part of the channel in the status of the daemon, for the alarm levels.
    """
    if source is None or block is None or channel is None or not values:
        return None
    names = {"t_fs": "onset", "t_eol": "end of life"}
    rules = [rule for rule in status.get("levels") or () if rule.get("feature") == "rms"]
    levels = {
        severity: rule[f"{severity}_si"]
        for rule in rules[:1]
        for severity in ("alert", "danger")
        if rule.get(f"{severity}_si") is not None
    }
    return {
        "store": str(store),
        "source": source,
        "channel": channel,
        "dated": utc is not None,
        "fault": values.get("fault"),
        "marks": {label: values[name] for name, label in names.items() if values.get(name) is not None},
        "levels": levels if values.get("absolute_level") != "no" else {},
        "absolute": values.get("absolute_level") != "no",
        "block": block,
        "until": utc,
    }


def draw_picture(
    request: Mapping[str, Any],
    ending: Callable[[], bool] = lambda: False,
    *,
    entry: str = ENTRY,
    most_s: float | None = None,
) -> bytes | None:
    """Return a PNG, or None where it could not be drawn in time, which is logged; no exception.

    Args:
        ending: whether to give up at once.
        entry: function of the child.
        most_s: time for it, s; default ``MAX_S``.
    """
    most_s = MAX_S if most_s is None else most_s
    try:
        child = Child(entry, json.dumps(request))
    except OSError as error:
        _LOG.warning("a mail goes out without its picture: %s", error)
        return None
    until = time.monotonic() + most_s
    try:
        while not ending() and time.monotonic() < until:
            lines = child.read_lines(_POLL_S)
            if lines is None:
                break
            if lines:
                return _checked(lines[0])
    except OSError as error:
        _LOG.warning("a mail goes out without its picture: %s", error)
        return None
    finally:
        child.end()
    if not ending():
        _LOG.warning("a mail goes out without its picture: it was not drawn within %g s", most_s)
    return None


def _checked(line: bytes) -> bytes | None:
    try:
        picture = base64.b64decode(line, validate=True)
    except ValueError:
        picture = b""
    if not picture.startswith(_PNG) or len(picture) > MAX_BYTES:
        _LOG.warning("a mail goes out without its picture: what was drawn is none")
        return None
    return picture
