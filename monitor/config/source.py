"""``[[source]]`` and ``[[channel]]``: where blocks come from, and what of them is monitored."""

from __future__ import annotations

import ipaddress
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from monitor.config.fields import Band, Blocks, ConfigSection, Name, NotNegative, Positive, Scale
from monitor.health.signal.differentiate import USUAL_LIMIT
from monitor.health.signal.quality import bands_above_nyquist
from streams.files.statements import known_unit
from streams.types.block import VELOCITY
from streams.types.spec import UNITS, NetworkSpec, SourceSpec, dating_problem, files_problem, pulses_problem
from streams.types.stamps import Order

_DATING_KEYS = ("time_from", "time_name", "interval_s", "date_order")
_FILE_KEYS = (
    *("ca_file", "cert_file", "key_file", "username_file", "password_file"),
    *("stream_key_file", "tls_cert_file", "tls_key_file"),
)
_TCP_KEYS = ("stream_key_file", "tls_cert_file", "tls_key_file")


class SourceSection(ConfigSection):
    """Where blocks come from; docs/reference/wire.md explains the keys of TCP and MQTT."""

    name: Name
    url: str | None = None
    start_utc: datetime | None = None
    settle_s: NotNegative = 2.0
    block_s: Positive | Literal["file"] = 5.0
    block_revolutions: Annotated[
        Positive | None, Field(description="turns of the shaft in a block; block_s is the longest block then")
    ] = None
    format: str = "auto"
    time_from: Annotated[
        Literal["header", "name", "count", "mtime"] | None,
        Field(description="what dates files; by default the first of header, name, count that the first file has"),
    ] = None
    time_name: Annotated[str | None, Field(description="strptime pattern of the date in names of files")] = None
    interval_s: Annotated[
        Positive | None, Field(description="count: time between the starts of files; by default the length of one")
    ] = None
    date_order: Annotated[
        Order | None,
        Field(description="order of day, month and year in dates such as 03/04/24; by default told over all files"),
    ] = None
    pulses: Annotated[
        str | None,
        Field(description="times of the pulses of a tacho: name of an array, group or channel, or {stem}.pulses.csv"),
    ] = None
    files: Annotated[
        tuple[str, ...],
        Field(description="pattern of its files; several: of files recorded at the same time, a channel each"),
    ] = ()
    rate_hz: Positive | None = None
    disregard: Annotated[
        tuple[str, ...],
        Field(description="keys in the files that are not believed, where they contradict others, such as Start Time"),
    ] = ()
    range_g: Positive | None = None
    peers: tuple[str, ...] = ()
    max_connections: Annotated[int, Field(ge=1, le=1024)] = NetworkSpec.max_connections
    read_timeout_s: Positive = NetworkSpec.read_timeout
    client_id: Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{1,64}$")] | None = None
    ca_file: Path | None = None
    cert_file: Path | None = None
    key_file: Path | None = None
    username_file: Path | None = None
    password_file: Path | None = None
    stream_key_file: Path | None = None
    """TCP: file whose first line is the key that the sender must prove to have."""
    tls_cert_file: Path | None = None
    tls_key_file: Path | None = None
    max_gap_blocks: Annotated[int, Field(ge=1, le=10**9)] = SourceSpec.max_gap_blocks
    """A frame whose number is farther ahead of the last one is refused."""

    @field_validator("start_utc")
    @classmethod
    def _in_utc(cls, value: datetime | None) -> datetime | None:
        return value.replace(tzinfo=UTC) if value is not None and value.tzinfo is None else value

    @field_validator("files", mode="before")
    @classmethod
    def _one_pattern(cls, value: object) -> object:
        return [value] if isinstance(value, str) else value

    @field_validator("peers")
    @classmethod
    def _networks(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        for peer in value:
            try:
                ipaddress.ip_network(peer)
            except ValueError:
                raise ValueError(f"{peer!r} is not a network such as 192.168.1.0/24") from None
        return value

    @model_validator(mode="after")
    def _datable(self) -> Self:
        keys = {key: getattr(self, key) for key in _DATING_KEYS}
        given = [key for key, value in keys.items() if value is not None]
        if given and self.url is not None and self.url.startswith(("tcp:", "mqtt:", "rig:")):
            raise ValueError(
                f"{given[0]} is for sources of files; {self.url.partition(':')[0]} blocks state their time"
            )
        problem = dating_problem(self.start_utc, *keys.values())
        if problem is not None:
            raise ValueError(problem)
        return self

    @model_validator(mode="after")
    def _with_pulses(self) -> Self:
        problem = pulses_problem(self.pulses) or files_problem(self.files)
        if problem is not None:
            raise ValueError(problem)
        if self.url is not None and self.url.startswith(("tcp:", "mqtt:", "rig:")):
            kind = self.url.partition(":")[0]
            if self.files:
                raise ValueError(f"files is for sources of files; {kind} blocks have none")
            if self.pulses is not None:
                raise ValueError(f"pulses is for sources of files; {kind} blocks bring theirs with them")
            if self.block_revolutions is not None:
                raise ValueError(f"block_revolutions is for sources of files; {kind} blocks are taken as they come")
        if self.block_revolutions is not None and self.block_s == "file":
            raise ValueError('block_revolutions cuts files, block_s = "file" does not')
        return self

    @model_validator(mode="after")
    def _encrypted_as_it_can_be(self) -> Self:
        given = [key for key in _TCP_KEYS if getattr(self, key) is not None]
        if given and self.url is not None and not self.url.startswith("tcp://"):
            raise ValueError(f"{given[0]} belongs to tcp://; got url = {self.url!r}")
        if (self.tls_cert_file is None) != (self.tls_key_file is None):
            raise ValueError("tls_cert_file and tls_key_file come together")
        return self

    def to_network(self) -> NetworkSpec:
        """Return the settings of the receiver.

        Raises:
            SourceError: certificate and key are not given together.
        """
        return NetworkSpec(
            peers=self.peers,
            max_connections=self.max_connections,
            read_timeout=self.read_timeout_s,
            client_id=self.client_id,
            **{key: getattr(self, key) for key in _FILE_KEYS},
        )

    def with_absolute_paths(self, folder: Path) -> Self:
        """Return a copy in which relative paths, also the one in the URL, are taken from ``folder``."""
        source = super().with_absolute_paths(folder)
        return source.model_copy(update={"url": _absolute_url(self.url, folder)})


def _absolute_url(url: str | None, folder: Path) -> str | None:
    """Return a URL with the path in it relative to ``folder``; a URL without a path is returned as it is."""
    if url is None or "://" in url or url.startswith("rig:"):
        return url
    kind, colon, path = url.partition(":")
    if kind == "folder" and colon:
        return f"folder:{folder / Path(path).expanduser()}"
    if kind == "dataset" and path.count(":"):
        name, _, path = path.partition(":")
        return f"dataset:{name}:{folder / Path(path).expanduser()}"
    return str(folder / Path(url).expanduser()) if not colon else url


class ChannelSection(ConfigSection):
    """One sensor: its place in the source, its bearing, and the bands that are analysed."""

    name: Name
    source: Name
    column: int | str | None = None
    key: str | None = None
    unit: Literal["g", "m/s2", "V", "unknown", "mm/s"]
    sensitivity_mv_per_g: Positive | None = None
    sensor_max_hz: Annotated[
        Positive | None,
        Field(description="of a velocity, mm/s: up to which acceleration is its derivative; default 2000"),
    ] = None
    scale: Scale | None = None
    bearing: Name
    band_hz: tuple[Band, ...] | Literal["auto"] = "auto"
    rms_band_hz: Band | None = None
    average_blocks: Blocks = 1
    track: bool = False
    map: Path | tuple[Path, ...] | None = None
    library: Path | None = None

    @field_validator("unit", mode="before")
    @classmethod
    def _spelled(cls, value: object) -> object:
        known = known_unit(value)
        return known if known in UNITS else value

    @field_validator("band_hz", mode="before")
    @classmethod
    def _one_band(cls, value: object) -> object:
        """Take ``[lo, hi]`` for ``[[lo, hi]]``."""
        if not isinstance(value, list | tuple) or not any(isinstance(item, int | float) for item in value):
            return value
        if len(value) != 2:
            raise ValueError('expected [lo, hi], [[lo, hi], ...] or "auto"')
        return [value]

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if (self.unit == "V") != (self.sensitivity_mv_per_g is not None):
            raise ValueError('sensitivity_mv_per_g belongs to unit = "V", and "V" needs it')
        if self.sensor_max_hz is not None and not self.measures_velocity:
            raise ValueError(f'sensor_max_hz belongs to unit = "{VELOCITY}", a sensor of velocity')
        if self.column is not None and self.key is not None:
            raise ValueError("give column or key, not both")
        if self.band_hz == ():
            raise ValueError('band_hz is empty; give [[lo, hi]] or "auto"')
        if self.map == ():
            raise ValueError("map is empty; give a file, or a list of one file a part")
        bands = [("band_hz", band) for band in self._bands]
        if self.rms_band_hz is not None:
            bands.append(("rms_band_hz", self.rms_band_hz))
        for key, (low, high) in bands:
            if low >= high:
                raise ValueError(f"{key}: the lower edge {low:g} Hz must be below the upper edge {high:g} Hz")
            if self.sensor_max_hz is not None and high > self.sensor_max_hz:
                raise ValueError(f"{key}: the upper edge {high:g} Hz is above sensor_max_hz = {self.sensor_max_hz:g}")
        return self

    @property
    def measures_velocity(self) -> bool:
        """Whether its sensor measures a velocity."""
        return self.unit == VELOCITY

    @property
    def velocity_limit(self) -> float:
        """Frequency up to which acceleration is the derivative of a velocity, Hz: stated, or to hold the bands."""
        if self.sensor_max_hz is not None:
            return self.sensor_max_hz
        edges = [band[1] for band in (*self._bands, *filter(None, [self.rms_band_hz]))]
        return max(USUAL_LIMIT, *edges) if edges else USUAL_LIMIT

    @property
    def maps(self) -> tuple[Path, ...]:
        """Files of the RMS maps, one a damaged part."""
        if self.map is None:
            return ()
        return self.map if isinstance(self.map, tuple) else (self.map,)

    @property
    def _bands(self) -> tuple[Band, ...]:
        """Bands of the envelope that are given as numbers."""
        return () if self.band_hz == "auto" else self.band_hz

    def beyond_rate(self, rate: float) -> tuple[str, str] | None:
        """Return the key of a band that a sampling rate (Hz) cannot hold, with the reason; None where all fit."""
        for key, bands, rms_band in (("band_hz", self._bands, None), ("rms_band_hz", (), self.rms_band_hz)):
            reason = bands_above_nyquist(self.name, bands, rms_band, rate)
            if reason is not None:
                return key, reason
        return None
