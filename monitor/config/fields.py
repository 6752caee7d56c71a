"""The base of all sections, the types that their keys share, and the checks of addresses."""

from __future__ import annotations

import ipaddress
import math
from pathlib import Path
from typing import Annotated, Any, Self
from urllib.parse import urlsplit

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=1, le=100000)]
Blocks = Annotated[int, Field(ge=1, le=1000)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]
Band = tuple[NotNegative, Positive]
ColumnName = str | int
HttpUrl = Annotated[str, Field(pattern=r"^https?://[^\s/]+")]
MailAddress = Annotated[str, Field(pattern=r"^[^@\s]+@[^@\s]+$")]


def _check_scale(value: float) -> float:
    if not math.isfinite(value) or value == 0.0:
        raise ValueError("must be a finite number other than 0")
    return value


Scale = Annotated[float, AfterValidator(_check_scale)]


class Section(BaseModel):
    """A table of the configuration: frozen, and unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, str_strip_whitespace=True)

    def with_absolute_paths(self, folder: Path) -> Self:
        """Return a copy in which relative paths, also those of sections inside, are taken from ``folder``."""
        return self.model_copy(update={key: _absolute(value, folder) for key, value in self})


def _absolute(value: Any, folder: Path) -> Any:
    if isinstance(value, Path):
        return folder / value
    if isinstance(value, Section):
        return value.with_absolute_paths(folder)
    return tuple(_absolute(item, folder) for item in value) if isinstance(value, tuple) else value


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
