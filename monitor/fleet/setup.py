"""What workers need of a machine: its configuration with its maps and libraries, sent once through a store.

Records name the digest of the configuration as it is; only the paths of the files that are read are other ones on the
worker.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from models.words.errors import SpallwatchError
from models.work.codec import decode, digest_of, encode
from models.work.folder_store import open_store
from models.work.task import FileStore
from monitor.config.load import Config, ConfigError, files_of, load_config, read_toml
from monitor.health.signal.waterfall import WaterfallSettings
from monitor.health.state import SourceSettings
from monitor.service.setup import source_settings
from monitor.service.start import refuse_implausible

_NOT_SENT = ("notify", "web")


class ArchiveError(SpallwatchError):
    """An archive cannot be written or continued; the message says what is missing."""


@dataclass(frozen=True)
class Setup:
    """A configuration as it is sent.

    Attributes:
        tables: of the file, as JSON; without those that a replay does not need and that may hold secrets.
        path: of the file, to which the paths in it are relative.
        files: digests of the files that a replay reads, by absolute path.
    """

    tables: str
    path: str
    files: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class LoadedSetup:
    """A configuration with the settings of its one source, loaded."""

    config: Config
    settings: SourceSettings

    def named(self, name: str) -> Config:
        """Return the configuration under the name of a machine."""
        section = self.config.machine
        return self.config.model_copy(update={"machine": section.model_copy(update={"name": name})})


def send_setup(path: Path, store: FileStore) -> str:
    """Write a configuration with the files that a replay reads into a store; return its digest.

    Raises:
        ConfigError: it cannot be used, has several sources or none, or takes its condition from elsewhere.
    """
    config = load_config(path)
    if len(config.source) != 1:
        raise ConfigError(f"{path}: an archive takes configurations with one [[source]], this has {len(config.source)}")
    if config.operating.opcua is not None:
        raise ConfigError(f"{path}: operating.opcua: an archive takes speed and load from the recordings alone")
    try:
        # Refused here, before anything is replayed.
        refuse_implausible(config)
        source_settings(config, config.source[0])
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None
    files: list[tuple[str, str]] = []
    for file in files_of(config):
        data = file.read_bytes()
        files.append((str(file), digest_of(data)))
        _write_once(store, f"inputs/{files[-1][1]}", data)
    tables = {name: table for name, table in read_toml(path)[1].items() if name not in _NOT_SENT}
    data = encode(Setup(json.dumps(tables, default=str), str(path.resolve()), tuple(files)))
    _write_once(store, f"inputs/{digest_of(data)}", data)
    return digest_of(data)


def _write_once(store: FileStore, name: str, data: bytes) -> None:
    if store.read(name) != data:
        store.write(name, data)


@lru_cache(maxsize=4)
def load_setup(url: str, digest: str) -> LoadedSetup:
    """Return the machine of a digest from the store at a URL; each process reads it once.

    Raises:
        ArchiveError: the store lacks it.
    """
    store = open_store(url)
    setup: Setup = decode(_read(store, digest))
    # Without the posterior of an identification, which the sender has checked.
    config = Config.model_validate(json.loads(setup.tables)).with_absolute_paths(Path(setup.path).parent)
    with tempfile.TemporaryDirectory(prefix="spallwatch-setup-") as folder:
        places: dict[Path, Path] = {}
        for number, (path, of) in enumerate(setup.files):
            places[Path(path)] = Path(folder) / f"{number}-{Path(path).name}"
            places[Path(path)].write_bytes(_read(store, of))
        settings = source_settings(_moved(config, places), config.source[0])
    # The spectra for the page of a machine are in no record.
    channels = {name: replace(one, waterfall=WaterfallSettings(rows=0)) for name, one in settings.channels.items()}
    return LoadedSetup(config, replace(settings, channels=channels))


def _read(store: FileStore, digest: str) -> bytes:
    data = store.read(f"inputs/{digest}")
    if data is None:
        raise ArchiveError(f"{store.url}: inputs/{digest} is missing; begin the archive again in another folder")
    return data


def _moved(config: Config, places: Mapping[Path, Path]) -> Config:
    """Return a configuration whose files are read from other places."""
    channels: list[Any] = []
    for channel in config.channel:
        if channel.track:
            maps = tuple(places[path] for path in channel.maps)
            library = None if channel.library is None else places[channel.library]
            channels.append(channel.model_copy(update={"map": maps or None, "library": library}))
        else:
            channels.append(channel)
    changed: dict[str, Any] = {"channel": tuple(channels)}
    if config.forecast.library is not None:
        changed["forecast"] = config.forecast.model_copy(update={"library": places[config.forecast.library]})
    return config.model_copy(update=changed)
