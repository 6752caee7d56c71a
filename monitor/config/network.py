"""Keys of ``[[source]]`` for streams over a network."""

from __future__ import annotations

import ipaddress
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, Field, field_validator

from streams.link.network import NetworkSpec

FILE_KEYS = ("ca_file", "cert_file", "key_file", "username_file", "password_file")
"""Names of files: relative ones are relative to the configuration."""


class NetworkKeys(BaseModel):
    """Who may connect over TCP, and how this machine proves itself to an MQTT broker; docs/wire.md explains them."""

    peers: tuple[str, ...] = ()
    max_connections: Annotated[int, Field(ge=1, le=1024)] = NetworkSpec.max_connections
    read_timeout_s: Annotated[float, Field(gt=0, allow_inf_nan=False)] = NetworkSpec.read_timeout
    client_id: Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{1,64}$")] | None = None
    ca_file: Path | None = None
    cert_file: Path | None = None
    key_file: Path | None = None
    username_file: Path | None = None
    password_file: Path | None = None

    @field_validator("peers")
    @classmethod
    def _networks(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        for peer in value:
            try:
                ipaddress.ip_network(peer)
            except ValueError:
                raise ValueError(f"{peer!r} is not a network such as 192.168.1.0/24") from None
        return value

    def to_network(self) -> NetworkSpec:
        """Return the settings.

        Raises:
            SourceError: certificate and key do not come together.
        """
        files = {key: getattr(self, key) for key in FILE_KEYS}
        return NetworkSpec(
            peers=self.peers,
            max_connections=self.max_connections,
            read_timeout=self.read_timeout_s,
            client_id=self.client_id,
            **files,
        )
