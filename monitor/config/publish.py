"""``[publish]``: records as files and over MQTT; see docs/reference/records.md and docs/reference/wire.md."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Self
from urllib.parse import unquote, urlsplit

from pydantic import Field, model_validator

from monitor.config.fields import Count, Section, check_address, refuse_clear


class BrokerSection(Section):
    """An MQTT broker, ``mqtt://HOST[:PORT]/TOPIC`` or ``mqtts://...``, and the credentials of this machine."""

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
        """Path of the URL without slashes at its ends: the prefix of all topics."""
        return unquote(self.url.split("/", 3)[3]).strip("/")


class RecordMqttSection(BrokerSection):
    """Each record as JSON under ``TOPIC/MACHINE/SOURCE/CHANNEL``, with QoS 1."""

    retain: bool = True
    """Whether the broker keeps the newest record of each channel for later subscribers."""
    most_per_s: Count = 1000
    """Limit of messages a second while records of an outage are sent."""


class PublishSection(Section):
    """How often the daemon writes the files of records, and the broker that records are published to."""

    interval_s: Annotated[float, Field(ge=0.1, le=86400.0)] = 60.0
    mqtt: RecordMqttSection | None = None
