"""The stages over a recording, as fast as they go or at a given pace."""

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
from monitor.health.recording_bands import recording_bands
from monitor.health.spectrum.average import RecentSpectra
from monitor.health.spectrum.bands import VOTES_NEEDED
from monitor.health.spectrum.features import SPECTRUM_LINES, fundamentals
from monitor.health.spectrum.transform import EnvelopeSpectrum
from monitor.health.state import ChannelSettings, SourceSettings, SourceState
from monitor.health.step import SourceOutput, step
from monitor.health.waterfall import SpectrumChange
from monitor.records.database import StoreError
from monitor.records.filing import published_files
from monitor.records.ledger import keep_dating, read_dating
from monitor.records.publish import publish
from monitor.records.recover.salvage import open_or_salvage
from monitor.records.store import Store
from monitor.service.calibration import uncalibrated_lines
from monitor.service.neighbours.condition import RecordedCondition
from monitor.service.resume import resumed_state
from monitor.service.setup import open_configured, source_settings
from monitor.service.summary import bearing_summaries, channel_summary, run_attributes, with_words
from streams.block import STANDARD_GRAVITY, Block, Rejected
from streams.dating import Dating
from streams.reading import ResumableSource
from streams.source import FileSource, Source

_FILE_COUNTS = ("offered", "accepted", "rejected", "ignored", "pending")
_BATCH_BLOCKS = 64
"""Blocks to a transaction: a replay that is cut off begins again at the last batch, as the recording is still there."""

Drawable = tuple[NDArray[np.floating], NDArray[np.floating], dict[str, float], str, float, str, str]
"""An envelope spectrum to draw: frequency (Hz), amplitude, the fundamentals of the families (Hz), of which block it is,
speed of the shaft (Hz), unit, and domain."""


@dataclass
class Replay:
    """Results of a replay: the keys of ``--json``, the database, and the best envelope spectrum of each channel."""

    summary: dict[str, Any]
    store_path: Path
    spectra: dict[str, Drawable] = field(default_factory=dict)
    taken: int = 0
    """Number of blocks that were replayed now."""


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
    """Replay a recording of a machine with one source into ``state.db`` and records under ``out``.

    Args:
        path: path or URL in place of the configured URL.
        pace: times real time, or None for full speed.
        limit: greatest number of blocks.
        resume: continue the store under ``out`` after its last block.
        maps, libraries: by channel, in place of the configured files.
        progress: wraps the iteration over so many blocks, to show it.

    Raises:
        ConfigError: the configuration does not fit the recording, or ``out`` holds a store already.
    """
    if len(config.source) != 1:
        raise ConfigError(f"replay takes a configuration with one [[source]], this one has {len(config.source)}")
    section = config.source[0]
    settings = source_settings(config, section, maps, libraries)
    source = open_configured(config, section, path, kept_dating(out, section.name) if resume else None)
    return replay_source(
        config, settings, source, out, Extent(pace=pace, limit=limit), resume=resume, progress=progress
    )


@dataclass(frozen=True)
class Extent:
    """How much of a source is replayed, and how fast.

    Attributes:
        pace: times real time, or None for full speed.
        limit: greatest number of blocks.
        whole: False where parts before were replayed: what the source offers is not counted, and its bands are chosen.
        in_parts: whether another part follows where the limit is reached; this one then counts its own blocks alone.
    """

    pace: float | None = None
    limit: int | None = None
    whole: bool = True
    in_parts: bool = False


def replay_source(
    config: Config,
    settings: SourceSettings,
    source: Source,
    out: Path,
    extent: Extent,
    *,
    resume: bool = False,
    progress: Callable[[Iterable[Any], int], Iterable[Any]] | None = None,
    before_publishing: Callable[[Store], None] | None = None,
) -> Replay:
    """Replay an open source as :func:`replay` does; ``before_publishing`` is called when all blocks are committed."""
    limit = extent.limit
    with _open_store(out, config, resume) as store:
        _keep_dating(store, source)
        store.describe(run_attributes(config, settings.channels))
        last = store.last(settings.name)
        state = resumed_state(store, settings)
        condition = None
        if config.operating.opcua is not None:
            condition = RecordedCondition(config.machine.state_dir / "state.db", settings.name)
        if extent.whole:
            state = _fix_bands(source, state, settings, condition)
        run = _Run(source, store, settings, state, whole=extent.whole, condition=condition)
        items: Iterable[Block | Rejected] = run.unrepeated(last, limit)
        if progress is not None:
            items = progress(items, len(source) if limit is None else min(len(source), limit))
        began = time.perf_counter()
        run.take_all(items, extent.pace)
        _keep_dating(store, source)
        seconds = time.perf_counter() - began
        run.whole = extent.whole and not (extent.in_parts and run.taken == limit)
        if before_publishing is not None:
            before_publishing(store)
        files = publish(store, out / "records")
        summary = run.summary(seconds, files)
        summary["channels"] = with_words(config, summary["channels"], summary["bearings"])
        summary["condition"] = None if condition is None else condition.sentence
        summary["uncalibrated"] = list(uncalibrated_lines(config, settings.channels))
    spectra = {name: drawn.spectrum(settings.channels[name]) for name, drawn in run.drawn.items()}
    return Replay(summary, out / "state.db", spectra, run.taken)


def kept_dating(out: Path, source: str) -> Dating | None:
    """Return what dates the files of a replay that is continued, or None."""
    if not (out / "state.db").exists():
        return None
    try:
        with Store.open(out / "state.db", read_only=True) as store:
            values = read_dating(store, source)
    except (StoreError, OSError) as error:
        raise ConfigError(f"--out {out}: {error}") from None
    return None if values is None else Dating.from_dict(values)


def _keep_dating(store: Store, source: Source) -> None:
    dating: Dating | None = getattr(source, "dating", None)
    if dating is not None:
        keep_dating(store, source.name, dating.to_dict())


def _open_store(out: Path, config: Config, resume: bool) -> Store:
    database, records = out / "state.db", out / "records"
    published = bool(published_files(records, config.machine.name))
    if resume and not database.exists() and not published:
        raise ConfigError(f"--resume: there is no store under --out {out} to continue")
    if database.exists() and not resume:
        raise ConfigError(f"--out {out}: holds a store already; use --resume to continue it, or another folder")
    if published and not resume:
        raise ConfigError(
            f"--out {out}: holds records whose store is lost; use --resume to make it again and continue it, "
            "or another folder"
        )
    try:
        out.mkdir(parents=True, exist_ok=True)
        return open_or_salvage(database, machine=config.machine.name, records_dir=records)[0]
    except (StoreError, OSError) as error:
        raise ConfigError(f"--out {out}: {error}") from None


def _fix_bands(
    source: Source, state: SourceState, settings: SourceSettings, condition: RecordedCondition | None
) -> SourceState:
    """Choose the bands of a recording too short to learn them from the recording as a whole; its records say so."""
    automatic = any(channel.bands is None for channel in settings.channels.values())
    if not automatic or _has_blocks(source, VOTES_NEEDED):
        return state
    try:
        blocks = [item for item in source if isinstance(item, Block)]
        found = recording_bands([condition(block) for block in blocks] if condition else blocks, settings)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    for name, band in found.items():
        state = state.with_band(name, band)
    return state


def _has_blocks(source: Source, count: int) -> bool:
    return source.has_blocks(count) if isinstance(source, ResumableSource) else len(source) >= count


@dataclass(frozen=True)
class _Drawn:
    """The envelope spectrum of a channel to draw.

    Attributes:
        envelope: of the block itself.
        recent: spectra of the latest blocks, whose average is drawn where there are several.
        speed: of the shaft, Hz.
        sequence: number of the block.
        domain: of the spectrum.
        score: relative score of the fault named by then, 0 without a name.
    """

    envelope: EnvelopeSpectrum
    recent: RecentSpectra
    speed: float
    sequence: int
    domain: str
    score: float

    def spectrum(self, channel: ChannelSettings) -> Drawable:
        """Return what is drawn of it."""
        lines = fundamentals(kinematics(channel.bearing, self.speed))
        count, resolution = self.recent.count, self.envelope.resolution
        amplitude = np.asarray(self.envelope.amplitude, dtype=np.float64)
        if count > 1:
            amplitude = self.recent.averages()[0] * self.envelope.mean
        if channel.absolute:
            amplitude = amplitude / STANDARD_GRAVITY
        keep = min(amplitude.size, int(SPECTRUM_LINES * max(lines.values()) / resolution))
        mean = f", mean of {count}" if count > 1 else ""
        label, unit = f"block {self.sequence}{mean}", "g" if channel.absolute else "sensor unit"
        return np.arange(keep) * resolution, amplitude[:keep].copy(), lines, label, self.speed, unit, self.domain


@dataclass
class _Run:
    """One replay under way: the state after the latest block, and the records since the latest commit."""

    source: Source
    store: Store
    settings: SourceSettings
    state: SourceState
    whole: bool = True
    taken: int = 0
    reasons: dict[str, str] = field(default_factory=dict)
    drawn: dict[str, _Drawn] = field(default_factory=dict)
    condition: RecordedCondition | None = None
    _repetitions: list[Rejected] = field(default_factory=list)
    _records: list[Record] = field(default_factory=list)
    _changes: list[SpectrumChange] = field(default_factory=list)

    def unrepeated(self, last: int, limit: int | None) -> Iterator[Block | Rejected]:
        """Yield the items after the number ``last``, at most ``limit``; keep the repetitions among all that come."""
        left = limit
        for item in self.source:
            if isinstance(item, Rejected) and item.is_repetition:
                self._repetitions.append(item)
                self.reasons.setdefault(item.status, item.reason)
            elif item.sequence > last:
                yield item
                left = None if left is None else left - 1
            if left == 0:
                return

    def take_all(self, items: Iterable[Block | Rejected], pace: float | None) -> None:
        """Take and commit all items at ``pace``; raise ConfigError for a block that does not fit."""
        started = time.monotonic()
        first: float | None = None
        for item in items:
            if pace is not None and isinstance(item, Block) and item.elapsed is not None:
                first = item.elapsed if first is None else first
                time.sleep(max(0.0, started + (item.elapsed - first) / pace - time.monotonic()))
            self._take(item)
            if len(self._records) >= (_BATCH_BLOCKS if pace is None else 1):
                self._commit()
        self._commit()
        self.store.recount_refusals(self.settings.name, self._repetitions)

    def _take(self, item: Block | Rejected) -> None:
        if self.condition is not None and isinstance(item, Block):
            item = self.condition(item)
        truth_of = getattr(self.source, "truth", None)
        truth = None if truth_of is None else truth_of(item.sequence, self.settings.thresholds)
        self.state, output = step(self.state, item, self.settings, truth=truth)
        if output.misfit is not None:
            raise ConfigError(output.misfit)
        record = output.record
        self._records.append(record)
        self._changes += output.spectra
        self.taken += 1
        if not record.accepted:
            self.reasons.setdefault(record.status, f"block {record.sequence}: {record.reason}")
        self._draw(output)

    def _commit(self) -> None:
        """Commit the records since the latest commit, and the state after the last of them."""
        if self._records:
            batch: list[tuple[Record, dict[str, Any]]] = [(record, {}) for record in self._records]
            batch[-1] = (self._records[-1], self.state.to_stored())
            self.store.commit_many(batch, spectra=self._changes)
            self._records.clear()
            self._changes.clear()

    def _draw(self, output: SourceOutput) -> None:
        """Keep of each channel the envelope spectrum that named its fault best, or the latest while none is named."""
        for name, found in output.channels.items():
            if found.features is None or found.speed.value is None:
                continue
            state = self.state.channels[name]
            score = 0.0 if state.named is None else state.named.standing
            best = self.drawn[name].score if name in self.drawn else 0.0
            if score < best or score == best > 0.0:
                continue
            envelope, sequence = found.features.envelopes[0], output.record.sequence
            domain = found.features.domain
            self.drawn[name] = _Drawn(envelope, state.spectra, found.speed.value, sequence, domain, score)

    def summary(self, seconds: float, files: list[Path]) -> dict[str, Any]:
        """Return the keys of the interface; the counts are those of the whole store, earlier replays included."""
        counts = self.store.counts()
        blocks = sum(counts.values())
        rejected = {status: number for status, number in counts.items() if status in REJECTIONS}
        flagged = {status: number for status, number in counts.items() if status in FLAGS}
        dating: Dating | None = getattr(self.source, "dating", None)
        met = self.source.files() if isinstance(self.source, FileSource) else None
        ignored = 0 if met is None else met.ignored
        # Blocks, files that gave none, and files of another format.
        offered = (max(len(self.source), blocks) if self.whole else blocks) + ignored
        return {
            "blocks": blocks,
            "accepted": blocks - sum(rejected.values()),
            "flagged": flagged,
            "rejected": rejected,
            "ignored": self.source.ignored() if isinstance(self.source, FileSource) else {},
            "closed": self.source.closed() if isinstance(self.source, FileSource) else {},
            "offered": offered,
            "pending": offered - blocks - ignored,
            "files": None if met is None else {key: getattr(met, key) for key in _FILE_COUNTS},
            "seconds": seconds,
            "blocks_per_second": self.taken / seconds if seconds > 0 else None,
            "records": [str(file) for file in files],
            "bearings": bearing_summaries([(self.state, self.settings)]),
            "channels": {
                name: channel_summary(self.state, channel) for name, channel in self.settings.channels.items()
            },
            "reasons": self.reasons,
            "time_from": None if dating is None else dating.by,
            "dating": [*([] if dating is None else [dating.describe()]), *getattr(self.source, "remarks", ())],
        }
