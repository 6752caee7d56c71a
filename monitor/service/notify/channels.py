"""What a way of telling must do, and the message that it is given."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

TIMEOUT = 10.0
"""Seconds that any connection may take."""
_LONGEST_SECRET = 4096


class NotifyError(Exception):
    """A message could not be delivered, this time; no secret is in the text."""


@dataclass(frozen=True)
class Message:
    """What is told.

    Attributes:
        machine: name of the machine.
        events: plain values, each with at least ``kind``.
        left_out: how many more there were than the rate limit lets through.
    """

    machine: str
    events: tuple[Mapping[str, Any], ...]
    left_out: int = 0

    @property
    def title(self) -> str:
        """One line."""
        first = self.events[0] if self.events else {"kind": "events"}
        words = [str(first[key]) for key in ("severity", "kind", "rule", "channel") if first.get(key)]
        more = len(self.events) - 1 + self.left_out
        text = f"{self.machine}: {' '.join(words)}" + (f" and {more} more" if more > 0 else "")
        # A line break in a name must not become a header of its own.
        return " ".join(text.split())[:200]

    @property
    def text(self) -> str:
        """The whole, a line an event."""
        lines = [", ".join(f"{key}: {value}" for key, value in event.items()) for event in self.events]
        if self.left_out:
            lines.append(f"{self.left_out} more events were left out by the rate limit; the event log has them all.")
        return "\n".join((self.title, "", *lines, ""))

    def to_json(self) -> str:
        """Return it as one JSON object."""
        values = {"machine": self.machine, "title": self.title, "events": self.events, "left_out": self.left_out}
        return json.dumps(values, allow_nan=False)


class Way(Protocol):
    """A way of telling."""

    name: str

    def send(self, message: Message) -> None:
        """Deliver one message; :class:`NotifyError` where that fails."""
        ...


def read_secret(path: Path) -> str:
    """Return the first line of a file, read each time, so that a secret can be changed without a restart.

    Raises:
        NotifyError: it cannot be read or is empty.
    """
    try:
        with path.open(encoding="utf-8") as file:
            line = file.readline(_LONGEST_SECRET).strip()
    except (OSError, UnicodeDecodeError) as error:
        raise NotifyError(f"{path} cannot be read: {type(error).__name__}") from None
    if not line:
        raise NotifyError(f"the first line of {path} is empty")
    return line
