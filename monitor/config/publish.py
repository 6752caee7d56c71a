"""``[publish]``: how records leave the store, as files and over MQTT; docs/records.md and docs/wire.md explain it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field

from monitor.config.broker import BrokerSection


class RecordMqttSection(BrokerSection):
    """Each record as JSON under ``TOPIC/MACHINE/SOURCE/CHANNEL``, with QoS 1."""

    retain: bool = True
    """Whether the broker keeps the newest record of each channel for those who come later."""
    most_per_s: Annotated[int, Field(ge=1, le=100000)] = 1000
    """Messages a second at most, while what was missed is made up for."""


class PublishSection(BaseModel):
    """How the daemon writes the files of records, and where else they go."""

    model_config = ConfigDict(extra="forbid", frozen=True, str_strip_whitespace=True)

    interval_s: Annotated[float, Field(ge=0.1, le=86400.0)] = 60.0
    mqtt: RecordMqttSection | None = None

    def with_absolute_paths(self, folder: Path) -> Self:
        """Return it with relative names of files taken from ``folder``."""
        if self.mqtt is None:
            return self
        return self.model_copy(update={"mqtt": self.mqtt.with_absolute_paths(folder)})
