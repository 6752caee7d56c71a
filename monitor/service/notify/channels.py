"""What a way of telling must do, and the message that it is given."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

TIMEOUT = 10.0
"""Seconds that any connection may take."""
_LONGEST_SECRET = 4096


class NotifyError(Exception):
    """A message could not be delivered, this time; no secret is in the text."""


@dataclass(frozen=True)
class Message:
    """What is told; :func:`monitor.service.notify.message.compose` makes it.

    Attributes:
        title: one line.
        text: the whole, for people.
        values: the same for programs, plain values.
    """

    title: str
    text: str
    values: Mapping[str, Any] = field(default_factory=dict)

    def to_json(self) -> str:
        """Return it as one JSON object."""
        return json.dumps({"title": self.title, "text": self.text, **self.values}, allow_nan=False)


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
