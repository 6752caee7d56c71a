"""The files that a configuration names and a replay reads."""

from __future__ import annotations

from pathlib import Path

from monitor.config.load import Config


def files_of(config: Config) -> list[Path]:
    """Return maps and libraries of tracked channels and the library of the forecast, each once."""
    found: dict[Path, None] = {}
    for channel in config.channel:
        if channel.track:
            found |= dict.fromkeys((*channel.maps, *([] if channel.library is None else [channel.library])))
    if config.forecast.library is not None:
        found[config.forecast.library] = None
    return [*found]
