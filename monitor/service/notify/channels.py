"""What a way of telling must do, and the message that it is given."""

from __future__ import annotations

import json
import ssl
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from models.errors import SpallwatchError

TIMEOUT = 10.0
"""Seconds that any connection may take."""
_LONGEST_SECRET = 4096


class NotifyError(SpallwatchError):
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

    def check(self) -> None:
        """Look whether the files that it needs can be read; :class:`NotifyError` where not."""
        ...

    def send(self, message: Message) -> str | None:
        """Deliver one message; :class:`NotifyError` where that fails.

        Returns:
            What is wrong although it is delivered, in one sentence, or None.
        """
        ...


def tls_context(ca_file: Path | None) -> ssl.SSLContext:
    """Return what verifies a server's certificate and name: by the public authorities, or by those in a file.

    Raises:
        NotifyError: the file cannot be used.
    """
    try:
        return ssl.create_default_context(cafile=None if ca_file is None else str(ca_file))
    except OSError as error:
        raise NotifyError(f"{ca_file} cannot be used: {error.strerror or type(error).__name__}") from None


def check_files(ca_file: Path | None, *secrets: Path | None) -> None:
    """Read what a way needs, to know early that it is not there.

    Raises:
        NotifyError: a file cannot be read, or is none of certificates.
    """
    for path in secrets:
        if path is not None:
            read_secret(path)
    if ca_file is not None:
        tls_context(ca_file)


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
