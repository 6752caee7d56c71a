"""``[publish]``, ``[notify]``, ``[web]``: to whom records, events and the page go, and with which secrets."""

from __future__ import annotations

import ipaddress
from pathlib import Path
from typing import Annotated, Literal, Self
from urllib.parse import unquote, urlsplit

from pydantic import Field, model_validator

from monitor.config.fields import ConfigSection, Count, Positive
from monitor.config.webhook import WebhookTemplate

HttpUrl = Annotated[str, Field(pattern=r"^https?://[^\s/]+")]
SecretUrl = Annotated[str, Field(pattern=r"^https?://[^\s/]+(/\S*)?$")]
MailAddress = Annotated[str, Field(pattern=r"^[^@\s]+@[^@\s]+$")]
HostName = Annotated[
    str, Field(pattern=r"^(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9]([A-Za-z0-9.-]{0,251}[A-Za-z0-9])?)(:\d{1,5})?$")
]


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


class BrokerSection(ConfigSection):
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


class SparkplugSection(BrokerSection):
    """MQTT Sparkplug B, ``mqtt://HOST[:PORT]/GROUP``: the machine is an edge node, its channels are devices."""

    most_per_s: Count = 1000
    """Limit of records a second while those of an outage are sent."""

    @model_validator(mode="after")
    def _one_group(self) -> Self:
        if "/" in self.topic:
            raise ValueError(f"url: expected one group after the host, mqtt://HOST/GROUP, found {self.topic!r}")
        return self


class OpcUaSection(ConfigSection):
    """An OPC UA server of the daemon, for reading alone; other computers need a password or ``anonymous = true``."""

    url: Annotated[str, Field(pattern=r"^opc\.tcp://[^\s/]+(/\S*)?$")] = "opc.tcp://127.0.0.1:4840/spallwatch"
    """Address on which the server listens; 0.0.0.0: on all of this computer."""
    cert_file: Path | None = None
    """Certificate of the server, PEM or DER; with it, only signed and encrypted connections are accepted."""
    key_file: Path | None = None
    username_file: Path | None = None
    password_file: Path | None = None
    trusted_dir: Path | None = None
    """Folder of the certificates of the clients, or of their authorities, that may connect; by default any."""
    anonymous: bool = False
    """Whether other computers may read without a password."""

    @model_validator(mode="after")
    def _safe(self) -> Self:
        check_address(self.url)
        if (self.cert_file is None) != (self.key_file is None):
            raise ValueError("cert_file and key_file come together")
        if (self.username_file is None) != (self.password_file is None):
            raise ValueError("username_file and password_file come together")
        for key in ("password_file", "trusted_dir"):
            if getattr(self, key) is not None and self.cert_file is None:
                raise ValueError(f"{key} needs cert_file and key_file, for without them nothing is encrypted")
        if self.anonymous and self.username_file is not None:
            raise ValueError("anonymous = true and username_file: give one of them")
        if not is_loopback(self.host) and not self.anonymous and self.username_file is None:
            raise ValueError(
                f"url: {self.host} lets other computers in, which needs username_file and password_file, "
                "or anonymous = true where each of them may read"
            )
        return self

    @property
    def host(self) -> str:
        """Name or address on which the server listens."""
        return urlsplit(self.url).hostname or ""

    @property
    def port(self) -> int:
        """Port of the server."""
        return urlsplit(self.url).port or 4840


class PublishSection(ConfigSection):
    """How often the daemon writes the files of records, and the control systems that records are published to."""

    interval_s: Annotated[float, Field(ge=0.1, le=86400.0)] = 60.0
    mqtt: RecordMqttSection | None = None
    sparkplug: SparkplugSection | None = None
    opcua: OpcUaSection | None = None


class SmtpSection(ConfigSection):
    """E-mail; with ``security = "none"`` nothing is encrypted and no password is sent."""

    host: Annotated[str, Field(min_length=1)]
    port: Annotated[int, Field(ge=1, le=65535)] = 587
    security: Literal["none", "starttls", "tls"] = "starttls"
    sender: MailAddress
    picture: bool = True
    """Whether a mail has a picture of the trends and the spectrum."""
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


class WebhookSection(ConfigSection):
    """A JSON object is posted; the content of ``token_file`` is sent as ``Authorization: Bearer``."""

    url: HttpUrl | None = None
    url_file: Path | None = None
    """File whose first line is the address, where the address itself is the secret."""
    token_file: Path | None = None
    ca_file: Path | None = None
    template: str | None = None
    """Name of a ready template (slack, mattermost, teams, apprise), or Jinja that renders the JSON to post."""

    @model_validator(mode="after")
    def _safe(self) -> Self:
        if (self.url is None) == (self.url_file is None):
            raise ValueError("expected one of url and url_file")
        if self.url is not None:
            self.check_url(self.url)
        if self.template is not None:
            WebhookTemplate(self.template)
        return self

    def check_url(self, url: str) -> None:
        """Refuse an address that would send a secret in the clear, as that in ``url_file`` itself is.

        Raises:
            ValueError: saying what to do instead.
        """
        check_address(url)
        if self.token_file is not None:
            refuse_clear(url, "https", "token_file")
        if self.url_file is not None:
            refuse_clear(url, "https", "url_file")
        if self.ca_file is not None and not url.startswith("https"):
            raise ValueError("ca_file belongs to https://")


class MqttSection(BrokerSection):
    """The same JSON object is published with QoS 1."""


class NotifySection(ConfigSection):
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
    heartbeat_url: SecretUrl | None = None
    """Address that is requested (GET) at intervals for as long as blocks can be committed."""
    heartbeat_interval_s: Annotated[float, Field(ge=1.0, le=86400.0)] = 60.0

    @model_validator(mode="after")
    def _no_secret(self) -> Self:
        for url in (self.page_url, self.heartbeat_url):
            if url is not None:
                check_address(url)
        return self


class WebSection(ConfigSection):
    """The page of a machine; without ``allow_remote`` only this computer reaches it."""

    enabled: bool = True
    host: Annotated[str, Field(min_length=1, max_length=253)] = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 8710
    """0: any free port."""
    token_file: Path | None = None
    """File whose first line is the token; by default ``web.token`` in the state folder, created when missing."""
    users_file: Path | None = None
    """File of names, roles and passwords; by default ``web.users`` in the state folder, where it exists."""
    allow_remote: bool = False
    allowed_hosts: tuple[HostName, ...] = ()
    """Further names under which browsers reach the page, such as bearings.plant.example or the same with :443."""
    max_streams: Annotated[int, Field(ge=1, le=1000)] = 32
    cert_file: Path | None = None
    key_file: Path | None = None
    import_folders: tuple[Path, ...] = ()
    """Folders of recordings that admins may look at and configure on the page; by default none."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if not self.loopback and not self.allow_remote:
            raise ValueError(
                f"host = {self.host!r} lets other computers in, which needs allow_remote = true; a token is then asked "
                "for everything"
            )
        if (self.cert_file is None) != (self.key_file is None):
            raise ValueError("cert_file and key_file come together")
        return self

    @property
    def loopback(self) -> bool:
        """Whether only this computer can reach the page."""
        return is_loopback(self.host)

    @property
    def url_host(self) -> str:
        """The host as addresses have it: IPv6 in brackets."""
        return f"[{self.host}]" if ":" in self.host else self.host

    def url(self, port: int) -> str:
        """Return the address of the page on a port."""
        return f"http{'' if self.cert_file is None else 's'}://{self.url_host}:{port}/"

    @property
    def reading_needs_token(self) -> bool:
        """Whether reading needs a token too, not acknowledgements alone."""
        return self.allow_remote or bool(self.allowed_hosts)
