"""``[notify]``: notification channels for events; docs/how-to/alarms.md explains them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from monitor.config.fields import Count, HttpUrl, MailAddress, Positive, Section, check_address, refuse_clear
from monitor.config.publish import BrokerSection


class SmtpSection(Section):
    """E-mail; with ``security = "none"`` nothing is encrypted and no password is sent."""

    host: Annotated[str, Field(min_length=1)]
    port: Annotated[int, Field(ge=1, le=65535)] = 587
    security: Literal["none", "starttls", "tls"] = "starttls"
    sender: MailAddress
    to: Annotated[tuple[MailAddress, ...], Field(min_length=1)]
    username_file: Path | None = None
    password_file: Path | None = None
    ca_file: Path | None = None

    @model_validator(mode="after")
    def _safe(self) -> Self:
        if (self.username_file is None) != (self.password_file is None):
            raise ValueError("username_file and password_file come together")
        if self.security == "none" and (self.password_file is not None or self.ca_file is not None):
            raise ValueError('a password or a ca_file needs security = "starttls" or "tls"')
        return self


class WebhookSection(Section):
    """A JSON object is posted; the content of ``token_file`` is sent as ``Authorization: Bearer``."""

    url: HttpUrl
    token_file: Path | None = None
    ca_file: Path | None = None

    @model_validator(mode="after")
    def _safe(self) -> Self:
        check_address(self.url)
        if self.token_file is not None:
            refuse_clear(self.url, "https", "token_file")
        if self.ca_file is not None and not self.url.startswith("https"):
            raise ValueError("ca_file belongs to https://")
        return self


class MqttSection(BrokerSection):
    """The same JSON object is published with QoS 1."""


class NotifySection(Section):
    """Notification channels, and the limit of messages; events beyond it go into one summary."""

    smtp: SmtpSection | None = None
    webhook: WebhookSection | None = None
    mqtt: MqttSection | None = None
    most_per_hour: Annotated[int, Field(ge=1, le=3600)] = 20
    give_up_hours: Positive = 24.0
    queue_events: Count = 1000
    """Limit of events in one message."""
    page_url: HttpUrl | None = None
    """Address of the page in messages, if it differs from the one under ``[web]``."""

    @model_validator(mode="after")
    def _no_secret(self) -> Self:
        if self.page_url is not None:
            check_address(self.page_url)
        return self
