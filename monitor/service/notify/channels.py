"""The interface of a notification channel, and the message that it delivers."""

from __future__ import annotations

import json
import ssl
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from models.errors import SpallwatchError

TIMEOUT_S = 10.0
"""Seconds that any connection may take."""
_MAX_SECRET_CHARACTERS = 4096


class NotifyError(SpallwatchError):
    """A message could not be delivered; the text holds no secret."""


@dataclass(frozen=True)
class Message:
    """A notification: one line, the whole for people, and plain values for programs."""

    title: str
    text: str
    values: Mapping[str, Any] = field(default_factory=dict)

    def to_json(self) -> str:
        """Return it as one JSON object."""
        return json.dumps({"title": self.title, "text": self.text, **self.values}, allow_nan=False)


class NotificationChannel(Protocol):
    """One channel of delivery, such as e-mail."""

    name: str

    def check(self) -> None:
        """Read the configured files; raise :class:`NotifyError` where one cannot be used."""
        ...

    def send(self, message: Message) -> str | None:
        """Deliver one message, or raise :class:`NotifyError`; return a problem in spite of the delivery, or None."""
        ...


def tls_context(ca_file: Path | None) -> ssl.SSLContext:
    """Return a context that verifies servers by public authorities or those in a file; NotifyError without it."""
    try:
        return ssl.create_default_context(cafile=None if ca_file is None else str(ca_file))
    except OSError as error:
        raise NotifyError(f"{ca_file} cannot be used: {error.strerror or type(error).__name__}") from None


def check_files(ca_file: Path | None, *secrets: Path | None) -> None:
    """Read the files of a channel, so that a missing one raises NotifyError before the first alarm."""
    for path in secrets:
        if path is not None:
            read_secret(path)
    if ca_file is not None:
        tls_context(ca_file)


def read_secret(path: Path) -> str:
    """Return the first line of a file, read for each message, as secrets change; NotifyError where there is none."""
    try:
        with path.open(encoding="utf-8") as file:
            line = file.readline(_MAX_SECRET_CHARACTERS).strip()
    except (OSError, UnicodeDecodeError) as error:
        raise NotifyError(f"{path} cannot be read: {type(error).__name__}") from None
    if not line:
        raise NotifyError(f"the first line of {path} is empty")
    return line
