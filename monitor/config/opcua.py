"""``[operating.opcua]``: the nodes of a PLC that give speed and load."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Self
from urllib.parse import urlsplit

from pydantic import Field, model_validator

from monitor.config.fields import Positive, Scale, Section
from monitor.config.outputs import check_address, is_loopback

NodeId = Annotated[str, Field(pattern=r"^(ns=\d{1,5};)?[isgb]=.+$")]


class OpcUaCondition(Section):
    """An OPC UA server whose nodes give speed and load; they are read at intervals, each value times its scale."""

    url: Annotated[str, Field(pattern=r"^opc\.tcp://[^\s/]+(/\S*)?$")]
    speed_node: NodeId | None = None
    """Such as "ns=2;s=Drive.Speed"."""
    speed_scale: Scale = 1.0
    """Hz per unit of the node; 0.016666667 for rpm."""
    load_node: NodeId | None = None
    load_scale: Scale = 1.0
    """N per unit of the node."""
    interval_s: Annotated[float, Field(ge=0.05, le=60.0)] = 1.0
    max_age_s: Positive = 10.0
    """Greatest age of a reading at the middle of a block; an older one is unknown."""
    username_file: Path | None = None
    password_file: Path | None = None
    cert_file: Path | None = None
    """Certificate of this client, PEM or DER; with it, the connection is signed and encrypted."""
    key_file: Path | None = None
    server_cert_file: Path | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        check_address(self.url)
        if self.speed_node is None and self.load_node is None:
            raise ValueError("expected speed_node, load_node or both")
        if (self.username_file is None) != (self.password_file is None):
            raise ValueError("username_file and password_file come together")
        if len({key is None for key in (self.cert_file, self.key_file, self.server_cert_file)}) > 1:
            raise ValueError("cert_file, key_file and server_cert_file come together")
        if self.password_file is not None and self.cert_file is None and not is_loopback(self.host):
            raise ValueError("password_file needs cert_file, key_file and server_cert_file: else nothing is encrypted")
        return self

    @property
    def ways(self) -> set[str]:
        """Names of the keys that say how is read, and not what."""
        return {"interval_s", "username_file", "password_file", "cert_file", "key_file", "server_cert_file"}

    @property
    def host(self) -> str:
        """Name or address of the server."""
        return urlsplit(self.url).hostname or ""
