"""The pipeline over a recording, as fast as it goes or at a given pace."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.bearing import kinematics
from models.maps.data import RmsMap
from monitor.config.load import Config, ConfigError
from monitor.health.damage.library.model import Library
from monitor.health.quality import FLAGS, REJECTIONS
from monitor.health.record import Record
from monitor.health.spectrum.bands import find_band
from monitor.health.spectrum.features import fundamentals
from monitor.health.spectrum.votes import ENOUGH_VOTES
from monitor.health.waterfall import SpectrumChange
from monitor.records.publish import publish
from monitor.records.store import Store, StoreError
from monitor.service.setup import ChannelSetup, channel_setups, open_configured
from monitor.service.summary import channel_summary, run_attributes
from monitor.service.watcher import Watcher
from streams.block import STANDARD_GRAVITY, Block, Rejected
from streams.source import Source

_BATCH = 64
"""Blocks to a transaction: a replay that is cut off begins again at the last batch, as the recording is still there."""


Drawable = tuple[NDArray[np.float64], NDArray[np.float64], dict[str, float], str]
"""An envelope spectrum as :class:`Replay` keeps it."""


@dataclass
class Replay:
    """What a replay left behind.

    Attributes:
        summary: for ``--json``, keys as in the interface.
        store_path: the truth.
        spectra: by channel, frequency (Hz) and amplitude (g, or the channel's unknown unit) of an envelope spectrum
            worth drawing, the fundamentals of the families (Hz), and which block it is of.
    """

    summary: dict[str, Any]
    store_path: Path
    spectra: dict[str, tuple[NDArray[np.float64], NDArray[np.float64], dict[str, float], str]] = field(
        default_factory=dict
    )


def replay(
    config: Config,
    path: str | None,
    out: Path,
    *,
    pace: float | None = None,
    limit: int | None = None,
    resume: bool = False,
    maps: Mapping[str, RmsMap] | None = None,
    libraries: Mapping[str, Library] | None = None,
    progress: Callable[[Iterable[Any], int], Iterable[Any]] | None = None,
) -> Replay:
    """Replay a recording into a store and records under ``out``.

    Args:
        config: the machine; it must have one source.
        path: what to replay in place of the configured URL: a path or a source URL.
        out: folder for ``state.db`` and the records.
        pace: times real time, or None for as fast as it goes.
        limit: most blocks to take.
        resume: continue the store under ``out`` after its last block.
        maps: RMS maps by channel that take the place of the configured files.
        libraries: libraries of simulated lives by channel, likewise.
        progress: wraps the iteration over so many blocks, to show it.

    Raises:
        ConfigError: the configuration does not fit the recording, or ``out`` holds a store already.
    """
    if len(config.source) != 1:
        raise ConfigError(f"replay takes a configuration with one [[source]], this one has {len(config.source)}")
    section = config.source[0]
    setups = channel_setups(config, section, maps, libraries)
    source = open_configured(config, section, path)
    watcher = Watcher(section.name, setups, section.rate_hz)
    store = _open_store(out, config, resume)
    with store:
        store.describe(run_attributes(config, setups))
        if resume:
            watcher.restore(store.load_states(), _last_record(store, section.name))
        done = store.last(section.name) if resume else 0
        _settle_short(source, watcher, setups)
        began = time.perf_counter()
        taken, spectra, reasons = _run(source, watcher, store, pace, limit, done, progress)
        seconds = time.perf_counter() - began
        files = publish(store, out / "records", config.machine.name)
        summary = _summary(store, watcher, len(source), taken, seconds, files) | {"reasons": reasons}
    return Replay(summary, out / "state.db", spectra)


def _open_store(out: Path, config: Config, resume: bool) -> Store:
    database = out / "state.db"
    if resume and not database.exists():
        raise ConfigError(f"--resume: there is no store under --out {out} to continue")
    if database.exists() and not resume:
        raise ConfigError(f"--out {out}: holds a store already; use --resume to continue it, or another folder")
    try:
        out.mkdir(parents=True, exist_ok=True)
        return Store.open(database, machine=config.machine.name, create=not resume)
    except (StoreError, OSError) as error:
        raise ConfigError(f"--out {out}: {error}") from None


def _last_record(store: Store, source: str) -> Record | None:
    """Return the record of the block that was committed last."""
    return store.record(source, store.last(source))


def _settle_short(source: Source, watcher: Watcher, setups: Mapping[str, ChannelSetup]) -> None:
    """Choose the band of a recording too short to learn it from, from the recording itself; the records say so."""
    automatic = [name for name, setup in setups.items() if setup.settings.bands is None]
    if not automatic or len(source) >= ENOUGH_VOTES:
        return
    blocks = [item for item in source if isinstance(item, Block)]
    for name in automatic:
        rows = [(block, block.samples[block.channels.index(name)]) for block in blocks if name in block.channels]
        usable = [(block, row) for block, row in rows if np.all(np.isfinite(row))]
        settings = setups[name].settings
        if not usable:
            continue
        block = usable[0][0]
        speed = block.speed if block.speed is not None else settings.speed
        if speed is None:
            continue
        same = [row for _, row in usable if row.size == usable[0][1].size]
        try:
            band = find_band(same, block.rate, fundamentals(kinematics(settings.bearing, speed)))
        except ValueError as error:
            raise ConfigError(f'channel {name!r}: band_hz = "auto": {error}') from None
        watcher.settle_band(name, band)


def _run(
    source: Source,
    watcher: Watcher,
    store: Store,
    pace: float | None,
    limit: int | None,
    done: int,
    progress: Callable[[Iterable[Any], int], Iterable[Any]] | None,
) -> tuple[int, dict[str, Any], dict[str, str]]:
    """Take the blocks; return how many, the envelope spectra worth drawing, the first reason of each rejection."""
    total = len(source) if limit is None else min(len(source), limit)
    items: Iterable[Block | Rejected] = _limited(source, done, limit)
    if progress is not None:
        items = progress(items, total)
    truth_of = getattr(source, "truth", None)
    thresholds = watcher.thresholds
    batch: list[tuple[Record, dict[str, Any]]] = []
    changes: list[SpectrumChange] = []
    spectra: dict[str, Any] = {}
    standing: dict[str, float] = {}
    reasons: dict[str, str] = {}
    taken = 0
    started = time.monotonic()
    first: float | None = None
    for item in items:
        if pace is not None and isinstance(item, Block) and item.elapsed is not None:
            first = item.elapsed if first is None else first
            time.sleep(max(0.0, started + (item.elapsed - first) / pace - time.monotonic()))
        truth = None if truth_of is None else truth_of(item.sequence, thresholds)
        record = watcher.process(item, truth=truth)
        batch.append((record, {}))
        changes += watcher.spectra
        if not record.accepted:
            reasons.setdefault(record.status, f"block {record.sequence}: {record.reason}")
        taken += 1
        _keep_spectra(watcher, spectra, standing)
        if len(batch) >= (_BATCH if pace is None else 1):
            _commit(store, batch, watcher, changes)
    _commit(store, batch, watcher, changes)
    return taken, spectra, reasons


def _limited(source: Source, done: int, limit: int | None) -> Iterator[Block | Rejected]:
    taken = 0
    for item in source:
        if item.sequence <= done:
            continue
        if limit is not None and taken >= limit:
            return
        taken += 1
        yield item


def _commit(
    store: Store, batch: list[tuple[Record, dict[str, Any]]], watcher: Watcher, changes: list[SpectrumChange]
) -> None:
    """Commit a batch: the records, and the states after the last of them."""
    if batch:
        batch[-1] = (batch[-1][0], watcher.states())
        store.commit_many(batch, spectra=changes)
        batch.clear()
        changes.clear()


def _keep_spectra(watcher: Watcher, spectra: dict[str, Any], standing: dict[str, float]) -> None:
    """Keep of each channel the envelope spectrum that named its fault best, or the latest while nothing is named."""
    for name, output in watcher.outputs.items():
        if output.features is None or output.speed is None:
            continue
        named = watcher.channel(name).named
        reached = 0.0 if named is None else named.standing
        if reached < standing.get(name, 0.0):
            continue
        if named is not None and reached == standing.get(name, 0.0) and reached > 0.0:
            continue
        standing[name] = reached
        envelope = output.features.envelopes[0]
        amplitude = np.asarray(envelope.amplitude, dtype=np.float64)
        averaged = watcher.channel(name).spectra
        if averaged.count > 1:
            amplitude = averaged.averages()[0] * envelope.mean
        lines = fundamentals(kinematics(watcher.channels[name].settings.bearing, output.speed))
        if watcher.channels[name].settings.absolute:
            amplitude = amplitude / STANDARD_GRAVITY
        keep = min(amplitude.size, int(6.5 * max(lines.values()) / envelope.resolution))
        label = f"block {watcher.sequence}" + (f", mean of {averaged.count}" if averaged.count > 1 else "")
        spectra[name] = (np.arange(keep) * envelope.resolution, amplitude[:keep].copy(), lines, label)


def _summary(
    store: Store, watcher: Watcher, offered: int, taken: int, seconds: float, files: list[Path]
) -> dict[str, Any]:
    """Return the keys of the interface; the counts are those of the whole store, earlier stretches included."""
    counts = store.counts()
    rejected = {status: number for status, number in counts.items() if status in REJECTIONS}
    flagged = {status: number for status, number in counts.items() if status in FLAGS}
    accepted = sum(counts.values()) - sum(rejected.values())
    offered = max(offered, sum(counts.values()))
    return {
        "blocks": sum(counts.values()),
        "accepted": accepted,
        "flagged": flagged,
        "rejected": rejected,
        "pending": offered - sum(counts.values()),
        "seconds": seconds,
        "blocks_per_second": taken / seconds if seconds > 0 else None,
        "records": [str(file) for file in files],
        "channels": {name: channel_summary(watcher, name) for name in watcher.channels},
    }
