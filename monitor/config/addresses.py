"""Addresses of other computers in the configuration; no secret may stand in one or be sent in the clear."""

from __future__ import annotations

import ipaddress
from typing import Annotated
from urllib.parse import urlsplit

from pydantic import Field

HttpUrl = Annotated[str, Field(pattern=r"^https?://[^\s/]+")]
MailAddress = Annotated[str, Field(pattern=r"^[^@\s]+@[^@\s]+$")]


def check_address(url: str) -> None:
    """Refuse a URL that holds a name or password, no host, or an invalid port; the message does not repeat it.

    Raises:
        ValueError: saying what to do instead.
    """
    try:
        parts = urlsplit(url)
        _ = parts.port
    except ValueError as error:
        raise ValueError(f"url: {error}") from None
    if parts.username is not None or parts.password is not None:
        raise ValueError("url: a name or password does not belong here; give a file that holds it")
    if not parts.hostname:
        raise ValueError("url: names no host")


def refuse_clear(url: str, scheme: str, key: str) -> None:
    """Refuse to send the secret of ``key`` to another computer under any scheme but the encrypted ``scheme``.

    Raises:
        ValueError: naming the key.
    """
    parts = urlsplit(url)
    if parts.scheme != scheme and not is_loopback(parts.hostname or ""):
        raise ValueError(f"{key} needs {scheme}://, for {parts.scheme}:// would send the secret in the clear")


def is_loopback(host: str) -> bool:
    """Return whether a host is this computer."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
