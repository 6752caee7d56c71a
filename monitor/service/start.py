"""What ``spallwatch run`` refuses at its start, and ``spallwatch check`` says without starting anything."""

from __future__ import annotations

import errno
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from models.platform.portable import is_read_only, may_write
from monitor.config.load import Config, ConfigError
from monitor.config.plausible import find_doubts
from monitor.config.plausible.rules import refusals
from monitor.config.source import SourceSection
from monitor.health.state import SourceSettings
from monitor.pipeline import resumed_state
from monitor.records.database import StoreError, refuse_network_share, refuse_unsuitable
from monitor.records.ledger import StoreLedger
from monitor.records.queries import has_ledger
from monitor.records.quota import HEADROOM, least_bytes
from monitor.records.recover.loss import damage_of
from monitor.records.store import Store
from monitor.service.retention import MIN_FULL_S
from monitor.service.setup import source_settings, source_spec
from streams.dates.dating import kept_dating
from streams.open import check_live
from streams.types.spec import SourceError, SourceSpec


@dataclass(frozen=True)
class Inspection:
    """Settings and specifications of usable sources, and why a daemon cannot start, one sentence each."""

    settings: Mapping[str, SourceSettings]
    specs: tuple[SourceSpec, ...]
    refusals: tuple[str, ...]


def inspect(config: Config, sources: Sequence[SourceSection] | None = None, *, running: bool = False) -> Inspection:
    """Look at the state folder and the sources, as far as that is possible without opening or making anything.

    Args:
        config: of the machine.
        sources: those to look at; by default all.
        running: whether its daemon runs, so that its addresses are in use by right.
    """
    state_dir = config.machine.state_dir
    refusals = list(_unwritable("machine.state_dir", state_dir))
    if not refusals:
        paths = [path for path in (state_dir / "daemon.lock", state_dir / "state.db") if path.exists()]
        locked = [path for path in paths if not os.access(path, os.W_OK, effective_ids=True)]
        refusals += [f"{path}: cannot be written ({os.strerror(errno.EACCES)})" for path in locked]
    settings: dict[str, SourceSettings] = {}
    specs = []
    for section in config.source if sources is None else sources:
        try:
            settings[section.name] = source_settings(config, section)
        except ConfigError as error:
            refusals.append(str(error))
        try:
            specs.append(source_spec(config, section))
        except (ConfigError, SourceError) as error:
            refusals.append(str(error))
    refusals += check_live(specs, taken=running)
    return Inspection(settings, tuple(specs), tuple(refusals))


def refuse_implausible(config: Config) -> list[str]:
    """Refuse a configuration under which every result would be wrong; return what else is doubtful, for a log.

    Raises:
        ConfigError: naming the keys, as that of a speed that no machine has; decision 25.
    """
    doubts = find_doubts(config)
    refused = refusals(doubts)
    if refused:
        raise ConfigError("\n".join(doubt.text for doubt in refused))
    return [f"{doubt.severity}: {doubt.text}" for doubt in doubts]


def store_refusals(config: Config, found: Inspection) -> Iterator[str]:
    """Yield why the store of a machine cannot be opened or continued; a damaged one can, and nothing is written."""
    path = config.machine.state_dir / "state.db"
    try:
        refuse_network_share(path, _existing(path.parent))
        if not os.path.lexists(path) or (path.is_file() and not path.stat().st_size):
            refuse_small_quota(config, None)
            return
        # A journal is left by a process that was killed while it made the tables; only a writer can roll it back.
        machine = config.machine
        if path.is_dir():
            refuse_unsuitable(path, create=False)
        if path.with_name(f"{path.name}-journal").exists() or damage_of(path, machine.name, machine.records_dir):
            return
        refuse_unsuitable(path, create=False)
        with Store.open(path, machine=config.machine.name, create=False, read_only=True) as store:
            refuse_small_quota(config, store)
            for settings in found.settings.values():
                resumed_state(store, settings)
            if not has_ledger(store):
                return
            with StoreLedger(store) as ledger:
                for spec in found.specs:
                    if spec.url.startswith("folder:"):
                        kept_dating(spec, ledger)
    except (ConfigError, StoreError, SourceError) as error:
        yield str(error)
    except OSError as error:
        yield f"{path}: {error.strerror or error}"


def refuse_small_quota(config: Config, store: Store | None) -> None:
    """Refuse a ``max_gb`` that what must stay in the store exceeds already; ConfigError, naming the number needed."""
    quota = config.retention.max_gb
    if quota is None:
        return
    least = least_bytes(store, len(config.channel), MIN_FULL_S) / (1.0 - HEADROOM)
    if quota * 1e9 < least:
        raise ConfigError(
            f"retention.max_gb = {quota:g}: too small for what never leaves (states, identities, coarse trends, "
            f"forecasts, the newest day); expected at least {math.ceil(least / 1e6) / 1e3:g}"
        )


def records_refusals(config: Config) -> Iterator[str]:
    """Yield why no files can be published; a daemon starts all the same, and its status says so."""
    yield from _unwritable("machine.records_dir", config.machine.records_dir)


def _unwritable(key: str, folder: Path) -> Iterator[str]:
    """Yield why a folder cannot be written, or made where it is missing."""
    place = _existing(folder)
    where = f"{key} = {str(folder)!r}"
    if not place.is_dir():
        found = "is no folder" if place == folder else f"{str(place)!r} is no folder"
        yield f"{where}: {found}; expected one, or a place where it can be made"
    elif not may_write(place):
        reason = os.strerror(errno.EROFS if is_read_only(place) else errno.EACCES)
        yield f"{where}: {'' if place == folder else f'{str(place)!r} '}cannot be written ({reason})"


def _existing(folder: Path) -> Path:
    """Return a folder, or the nearest one above it that exists."""
    while not os.path.lexists(folder) and folder != folder.parent:
        folder = folder.parent
    return folder
