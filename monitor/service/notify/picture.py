"""The picture of a mail, drawn by a short-lived child process; a mail without one is as good as before."""

from __future__ import annotations

import base64
import json
import logging
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from monitor.service.child_process import Child

_LOG = logging.getLogger(__name__)
ENTRY = "monitor.report.mail_child:child"
MAX_S = 20.0
"""Time after which a mail goes out without its picture."""
MAX_BYTES = 2_000_000
_PNG = b"\x89PNG\r\n"
_POLL_S = 0.2


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
