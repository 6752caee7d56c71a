"""``[web]``: where the page listens, and who may read it; docs/how-to/page.md explains it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, model_validator

from monitor.config.fields import Section, is_loopback

HostName = Annotated[
    str, Field(pattern=r"^(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9]([A-Za-z0-9.-]{0,251}[A-Za-z0-9])?)(:\d{1,5})?$")
]


class WebSection(Section):
    """The page of a machine; without ``allow_remote`` only this computer reaches it."""

    enabled: bool = True
    host: Annotated[str, Field(min_length=1, max_length=253)] = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 8710
    """0: any free port."""
    token_file: Path | None = None
    """File whose first line is the token; by default ``web.token`` in the state folder, created when missing."""
    allow_remote: bool = False
    allowed_hosts: tuple[HostName, ...] = ()
    """Further names under which browsers reach the page, such as bearings.plant.example or the same with :443."""
    max_streams: Annotated[int, Field(ge=1, le=1000)] = 32
    cert_file: Path | None = None
    key_file: Path | None = None

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
