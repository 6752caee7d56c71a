"""What the sections that send to other computers share: an MQTT broker, and that no secret goes out in the clear."""

from __future__ import annotations

import ipaddress
from pathlib import Path
from typing import Annotated, Self
from urllib.parse import unquote, urlsplit

from pydantic import BaseModel, ConfigDict, Field, model_validator


class OutwardSection(BaseModel):
    """A table with an address and files of secrets: frozen, and unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, str_strip_whitespace=True)

    def with_absolute_paths(self, folder: Path) -> Self:
        """Return it with relative names of files taken from ``folder``."""
        return self.model_copy(update={key: folder / value for key, value in self if isinstance(value, Path)})


class BrokerSection(OutwardSection):
    """An MQTT broker, ``mqtt://HOST[:PORT]/TOPIC`` or ``mqtts://...``, and how this machine proves who it is."""

    url: Annotated[str, Field(pattern=r"^mqtts?://[^\s/]+/.+")]
    username_file: Path | None = None
    password_file: Path | None = None
    ca_file: Path | None = None

    @model_validator(mode="after")
    def _safe(self) -> Self:
        check_address(self.url)
        if self.password_file is not None and self.username_file is None:
            raise ValueError("password_file needs username_file")
        if self.password_file is not None:
            refuse_clear(self.url, "mqtts", "password_file")
        if self.ca_file is not None and not self.url.startswith("mqtts"):
            raise ValueError("ca_file belongs to mqtts://")
        topic = self.topic
        if any(character in topic for character in "+#\0") or topic.startswith("$") or len(topic.encode()) > 1024:
            raise ValueError("url: a topic to publish under has no + # and does not begin with $")
        return self

    @property
    def host(self) -> str:
        """Name or address of the broker."""
        return urlsplit(self.url).hostname or ""

    @property
    def encrypted(self) -> bool:
        """Whether the connection is encrypted."""
        return self.url.startswith("mqtts")

    @property
    def port(self) -> int:
        """Port of the broker."""
        return urlsplit(self.url).port or (8883 if self.encrypted else 1883)

    @property
    def topic(self) -> str:
        """What stands behind the host, without the slash between them; never a part of a name alone."""
        return unquote(self.url.split("/", 3)[3]).strip("/")


def check_address(url: str) -> None:
    """Refuse an address with a secret in it or a port that is none; the message does not repeat it.

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
    """Refuse to send a secret over a connection that is not encrypted, other than within this computer.

    Args:
        url: where to.
        scheme: the one that encrypts.
        key: which names the secret.

    Raises:
        ValueError: naming the key.
    """
    parts = urlsplit(url)
    if parts.scheme != scheme and not is_loopback(parts.hostname or ""):
        raise ValueError(f"{key} needs {scheme}://, for {parts.scheme}:// would send the secret in the clear")


def is_loopback(host: str) -> bool:
    """Tell whether a host is this computer."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
