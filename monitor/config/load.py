"""config.toml -> frozen, validated settings."""

from __future__ import annotations

import hashlib
import tomllib
from pathlib import Path
from typing import Any, Self

from pydantic import Field, ValidationError, model_validator

from models.bearing import Bearing
from models.errors import WrongInputError
from monitor.config.alarms import AlarmsSection, NotifySection
from monitor.config.network import FILE_KEYS
from monitor.config.problems import explain_all
from monitor.config.publish import PublishSection
from monitor.config.sections import (
    BearingSection,
    ChannelSection,
    DetectSection,
    ForecastSection,
    MachineSection,
    OperatingSection,
    RigSection,
    Section,
    SourceSection,
    TrackSection,
)
from monitor.config.web import WebSection

__all__ = ["ChannelSection", "Config", "ConfigError", "SourceSection", "load_config", "validate"]


class ConfigError(WrongInputError):
    """The configuration cannot be used; the message names the file, the key, what came and what is allowed."""


class Config(Section):
    """A whole configuration, one machine."""

    machine: MachineSection = MachineSection()
    bearing: tuple[BearingSection, ...] = Field(min_length=1)
    rig: RigSection = RigSection()
    operating: OperatingSection = OperatingSection()
    source: tuple[SourceSection, ...] = Field(min_length=1)
    channel: tuple[ChannelSection, ...] = Field(min_length=1)
    detect: DetectSection = DetectSection()
    track: TrackSection = TrackSection()
    forecast: ForecastSection = ForecastSection()
    publish: PublishSection = PublishSection()
    alarms: AlarmsSection = AlarmsSection()
    notify: NotifySection = NotifySection()
    web: WebSection = WebSection()

    @model_validator(mode="after")
    def _connected(self) -> Self:
        for key in ("bearing", "source", "channel"):
            names = [item.name for item in getattr(self, key)]
            twice = sorted({name for name in names if names.count(name) > 1})
            if twice:
                raise ValueError(f"[[{key}]] name {twice[0]!r} is given twice")
        sources = {source.name: source for source in self.source}
        bearings = {bearing.name for bearing in self.bearing}
        for channel in self.channel:
            if channel.source not in sources:
                raise ValueError(
                    f"channel {channel.name!r}: source {channel.source!r} is not one of {', '.join(sorted(sources))}"
                )
            if channel.bearing not in bearings:
                raise ValueError(
                    f"channel {channel.name!r}: bearing {channel.bearing!r} is not one of {', '.join(sorted(bearings))}"
                )
            rate = sources[channel.source].rate_hz
            if rate is not None:
                channel.check_rate(rate)
        self.alarms.check_channels(tuple(channel.name for channel in self.channel))
        return self

    def bearing_of(self, channel: ChannelSection) -> Bearing:
        """Return the geometry of the bearing that a channel listens to."""
        return next(bearing.to_bearing() for bearing in self.bearing if bearing.name == channel.bearing)

    @property
    def hash(self) -> str:
        """Digest of what records are made under, stored with each; page, messages and publication make none."""
        text = self.model_dump_json(exclude={"web", "notify", "publish"})
        return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def load_config(path: Path) -> Config:
    """Read and validate a configuration file; relative paths in it are relative to it.

    Raises:
        ConfigError: naming the file, the key, what came and what is allowed.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from None
    try:
        values = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not valid TOML: {error}") from None
    return validate(values, path)


def validate(values: dict[str, Any], path: Path) -> Config:
    """Validate the tables of a configuration that came from ``path``.

    Raises:
        ConfigError: with one line a problem.
    """
    try:
        config = Config.model_validate(values)
    except ValidationError as error:
        raise ConfigError("\n".join(f"{path}: {line}" for line in explain_all(error, Config))) from None
    return _with_absolute_paths(config, path.resolve().parent)


def _with_absolute_paths(config: Config, folder: Path) -> Config:
    machine = config.machine.model_copy(
        update={
            "state_dir": folder / config.machine.state_dir,
            "records_dir": folder / config.machine.records_dir,
        }
    )
    channels = tuple(
        channel.model_copy(
            update={
                key: folder / getattr(channel, key) for key in ("map", "library") if getattr(channel, key) is not None
            }
        )
        for channel in config.channel
    )
    sources = tuple(
        source.model_copy(
            update={
                "url": _with_absolute_url(source.url, folder),
                **{key: folder / getattr(source, key) for key in FILE_KEYS if getattr(source, key) is not None},
            }
        )
        for source in config.source
    )
    beside = {name: getattr(config, name).with_absolute_paths(folder) for name in ("notify", "publish", "web")}
    return config.model_copy(update={"machine": machine, "source": sources, "channel": channels, **beside})


def _with_absolute_url(url: str | None, folder: Path) -> str | None:
    """Return a source's URL with the path in it relative to the configuration; what is no path stays as it is."""
    if url is None or "://" in url or url.startswith("rig:"):
        return url
    kind, colon, path = url.partition(":")
    if kind == "folder" and colon:
        return f"folder:{folder / Path(path).expanduser()}"
    if kind == "dataset" and path.count(":"):
        name, _, path = path.partition(":")
        return f"dataset:{name}:{folder / Path(path).expanduser()}"
    return str(folder / Path(url).expanduser()) if not colon else url
