"""The text of a notification, for a maintenance engineer on a phone, and the same for programs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from monitor.config.load import Config
from monitor.records.events import LoggedEvent
from monitor.service.notify.channels import Message
from monitor.service.record_message import first
from monitor.words.events import badness, event_text, local_moment, utc_text
from monitor.words.features import FEATURES
from monitor.words.numbers import count, duration, interval, moment, times_first, volume
from monitor.words.statuses import STAGES, named_words

MAX_LISTED = 20
"""Events that a message lists; of more, the worst are listed and all are counted."""
_MAX_TITLE_CHARACTERS = 180
_VALUES = (
    *("rms", "rms_smoothed", "peak"),
    *("v_eq", "v_eq_lower", "v_eq_upper", "v_eq_relative", "tt", "tt_lower", "tt_upper"),
)


@dataclass(frozen=True)
class Sender:
    """Name of the machine, its time zone, and the address of its page, or None."""

    name: str
    zone: str = "UTC"
    page: str | None = None

    @classmethod
    def of_config(cls, config: Config) -> Sender:
        """Return that of a configuration; without a fixed port, the page has no address."""
        web, page = config.web, config.notify.page_url
        if page is None and web.enabled and web.port:
            page = web.url(web.port)
        return cls(config.machine.name, config.machine.timezone, page)


@dataclass(frozen=True)
class Item:
    """An event with the values of its channel in the record of its block, SI; empty where there is no record."""

    event: LoggedEvent
    values: Mapping[str, Any] = field(default_factory=dict)
    found: float | None = None
    """Time of detection, UTC s, shown where the block has no date."""

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


def compose(machine: Sender, items: Sequence[Item], left_out: int = 0) -> Message:
    """Return the message of events in the order of detection, at most :data:`MAX_LISTED`, and the number left out."""
    worst = max(items, key=lambda item: badness(item.event.body), default=None)
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
    if worst is not None:
        lines += _details(machine, worst)
    if machine.page is not None:
        lines.append(f"Page     {machine.page}")
    values = {
        "machine": machine.name,
        "page": machine.page,
        "events": [_plain(item) for item in items],
        "left_out": left_out,
    }
    return Message(title, "\n".join((*lines, "")), values)


def clean(text: object) -> str:
    """Return a text on one line without control characters, safe in a header."""
    return " ".join("".join(mark if mark.isprintable() else " " for mark in str(text)).split())


def _line(machine: Sender, item: Item) -> str:
    return "- " + ", ".join(part for part in (item.when(machine.zone), item.where, item.text) if part)


def _details(machine: Sender, item: Item) -> list[str]:
    """Return the lines of a single event: what, where, since when, and the state of its bearing."""
    event, values = item.event, item.values
    block = None if event.block is None else f"block {event.block}"
    rows = [("What", item.text), ("Machine", clean(machine.name))]
    channel = clean(event.body.get("channel", ""))
    source = clean(event.source or event.body.get("source") or "")
    rows.append(("Channel", channel + (f" (source {source})" if source else "")) if channel else ("Source", source))
    rows.append(("Since", ", ".join(part for part in (item.when(machine.zone), block) if part) or "no date"))
    rows += [("Stage", _stage(machine, event, values)), ("V_eq", _volume(values)), ("TT", _remaining(values))]
    rows.append(("Event", event.id))
    return [f"{key:8} {text}" for key, text in rows if text]


def _stage(machine: Sender, event: LoggedEvent, values: Mapping[str, Any]) -> str:
    stage = values.get("stage")
    if stage is None:
        return ""
    text: str = STAGES.get(stage, str(stage))
    t_fs = values.get("t_fs")
    if t_fs is not None:
        since = moment(t_fs, dated=False) if event.utc is None else local_moment(t_fs, machine.zone)
        text += f", final since {since}" if stage != "final" else f" since {since}"
    if values.get("t_fs_block") is not None:
        text += f" (block {values['t_fs_block']})"
    return text + (f"; {named_words(values['fault'], values.get('fault_basis'))}" if values.get("fault") else "")


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


def _plain(item: Item) -> dict[str, Any]:
    """Return an event for programs: its log entry, its sentence, and the state of its channel."""
    event, values = item.event, item.values
    absolute = values.get("absolute_level") != "no"
    state: dict[str, Any] = {name: values.get(name) for name in ("stage", "fault", "fault_basis", "t_fs_block")}
    for feature in (FEATURES[name] for name in _VALUES):
        value = first(values.get(feature.name))
        if value is not None:
            state[feature.column] = value * feature.of_si(absolute=absolute)
    found = {**event.body, "id": event.id, "block": event.block, "time_utc": utc_text(event.utc), "text": item.text}
    if event.source is not None:
        found["source"] = event.source
    if values:
        found["state"] = {**state, "unit": "g" if absolute else "unknown"}
    return found
