"""The stages over a recording, as fast as they go or at a given pace."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.machine.bearing import kinematics
from models.maps.data import RmsMap
from monitor.config.load import Config, ConfigError
from monitor.health.signal.average import RecentSpectra
from monitor.health.signal.bands import VOTES_NEEDED
from monitor.health.signal.features import SPECTRUM_LINES, fundamentals
from monitor.health.signal.quality import FLAGS, REJECTIONS
from monitor.health.signal.transform import EnvelopeSpectrum
from monitor.health.size.library.model import Library
from monitor.health.state import ChannelSettings, SourceSettings, SourceState
from monitor.pipeline import Pipeline, PipelineOptions, RecordingStep, SourceOutput
from monitor.records.database import StoreError
from monitor.records.filing import published_files
from monitor.records.ledger import keep_dating, read_dating
from monitor.records.publish import publish
from monitor.records.queries import refused_files
from monitor.records.recover.salvage import open_or_salvage
from monitor.records.store import Store
from monitor.service.block_times import BlockTimes
from monitor.service.neighbours.condition import RecordedCondition
from monitor.service.setup import only_source, open_configured, source_settings
from monitor.service.start import refuse_implausible
from monitor.service.summary import bearing_summaries, channel_summary, run_attributes, uncalibrated_lines, with_words
from streams.dates.dating import Dating
from streams.recording.state import ResumableSource
from streams.types.block import STANDARD_GRAVITY, Block
from streams.types.source import MAX_IGNORED_NAMES, FileSource, Source

_FILE_COUNTS = ("offered", "accepted", "rejected", "ignored", "pending")

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
        ConfigError: the configuration is implausible or does not fit the recording, or ``out`` holds a store already.
    """
    refuse_implausible(config)
    section = only_source(config, "replay")
    settings = source_settings(config, section, maps, libraries)
    source = open_configured(config, section, path, kept_dating(out, section.name) if resume else None)
    return replay_source(
        config, settings, source, out, ReplayExtent(pace=pace, limit=limit), resume=resume, progress=progress
    )


@dataclass(frozen=True)
class ReplayExtent:
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
    extent: ReplayExtent,
    *,
    resume: bool = False,
    progress: Callable[[Iterable[Any], int], Iterable[Any]] | None = None,
    before_publishing: Callable[[Store], None] | None = None,
) -> Replay:
    """Replay an open source as :func:`replay` does; ``before_publishing`` is called when all blocks are committed."""
    limit, name = extent.limit, settings.name
    drawn: dict[str, _Drawn] = {}
    with _open_store(out, config, resume) as store:
        _keep_dating(store, source)
        store.describe(run_attributes(config, settings.channels))
        condition = None
        if config.operating.opcua is not None:
            condition = RecordedCondition(config.machine.state_dir / "state.db", name)
        pipeline = Pipeline({name: settings}, store, PipelineOptions(condition=condition, refuse_misfits=True))
        if extent.whole:
            _fix_bands(pipeline, source, condition)
        outputs: Iterable[RecordingStep] = pipeline.play(source, limit, extent.pace)
        if progress is not None:
            outputs = progress(outputs, len(source) if limit is None else min(len(source), limit))
        times = BlockTimes()
        for record in store.records() if resume else ():
            times.add(record)
        began, taken = time.perf_counter(), 0
        for _, output, state in outputs:
            taken += 1
            times.add(output.record)
            _draw(drawn, output, state)
        _keep_dating(store, source)
        seconds = time.perf_counter() - began
        whole = extent.whole and not (extent.in_parts and taken == limit)
        if before_publishing is not None:
            before_publishing(store)
        files = publish(store, out / "records")
        state = pipeline.state(name)
        bearings = bearing_summaries([(state, settings)])
        channels = {channel: channel_summary(state, found) for channel, found in settings.channels.items()}
        counts = _counts(store, source, whole=whole)
        summary = {
            **counts,
            "warnings": list(warning_lines(counts, pipeline.reasons)),
            "seconds": seconds,
            "blocks_per_second": taken / seconds if seconds > 0 else None,
            "records": [str(file) for file in files],
            "bearings": bearings,
            "channels": with_words(config, channels, bearings),
            "reasons": pipeline.reasons,
            **_dating_words(source, times.sentences(state.order.clock, config.machine.timezone)),
            **times.values,
            "condition": None if condition is None else condition.sentence,
            "uncalibrated": list(uncalibrated_lines(config, settings.channels)),
        }
    spectra = {channel: found.spectrum(settings.channels[channel]) for channel, found in drawn.items()}
    return Replay(summary, out / "state.db", spectra, taken)


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


def _fix_bands(pipeline: Pipeline, source: Source, condition: RecordedCondition | None) -> None:
    """Choose the bands of a recording too short to learn them from the recording as a whole; its records say so."""
    channels = pipeline.settings[source.name].channels.values()
    if all(channel.bands is not None for channel in channels) or _has_blocks(source, VOTES_NEEDED):
        return
    blocks = [item for item in source if isinstance(item, Block)]
    try:
        pipeline.fix_bands(source.name, blocks if condition is None else [condition(block) for block in blocks])
    except ValueError as error:
        raise ConfigError(str(error)) from None


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


def _draw(drawn: dict[str, _Drawn], output: SourceOutput, state: SourceState) -> None:
    """Keep of each channel the envelope spectrum that named its fault best, or the latest while none is named."""
    for name, found in output.channels.items():
        if found.features is None or found.block.speed.value is None:
            continue
        channel = state.channels[name]
        score = 0.0 if channel.named is None else channel.named.standing
        best = drawn[name].score if name in drawn else 0.0
        if score < best or score == best > 0.0:
            continue
        envelope, sequence = found.features.envelopes[0], output.record.sequence
        drawn[name] = _Drawn(envelope, channel.spectra, found.block.speed.value, sequence, found.features.domain, score)


def _counts(store: Store, source: Source, *, whole: bool) -> dict[str, Any]:
    """Return the numbers of blocks and files: those of the whole store, earlier replays included."""
    counts = store.counts()
    blocks = sum(counts.values())
    rejected = {status: number for status, number in counts.items() if status in REJECTIONS}
    flagged = {status: number for status, number in counts.items() if status in FLAGS}
    files = source if isinstance(source, FileSource) else None
    met = None if files is None else files.files()
    ignored = 0 if met is None else met.ignored
    # Blocks, files that gave none, and files of another format.
    offered = (max(len(source), blocks) if whole else blocks) + ignored
    return {
        "blocks": blocks,
        "accepted": blocks - sum(rejected.values()),
        "flagged": flagged,
        "rejected": rejected,
        "ignored": {} if files is None else files.ignored(),
        "refused": {} if files is None else refused_files(store, source.name, MAX_IGNORED_NAMES),
        "closed": {} if files is None else files.closed(),
        "offered": offered,
        "pending": offered - blocks - ignored,
        "files": None if met is None else {key: getattr(met, key) for key in _FILE_COUNTS},
    }


def is_all_rejected(summary: Mapping[str, Any]) -> bool:
    """Return whether a replay has accepted nothing, although files were there that it had not met before."""
    return not summary["accepted"] and any(status != "duplicate" for status in summary["rejected"])


def warning_lines(counts: Mapping[str, Any], reasons: Mapping[str, str]) -> Iterator[str]:
    """Yield what a replay as a whole is warned of: that it accepted nothing; ``reasons``: first ones, by status."""
    if not is_all_rejected(counts):
        return
    listed = ", ".join(f"{number} {status}" for status, number in counts["rejected"].items())
    first = next((f"; first {status}, {reason}" for status, reason in reasons.items()), "")
    yield f"no block was accepted: {listed}{first}"


def _dating_words(source: Source, of_times: Iterable[str]) -> dict[str, Any]:
    """Return what dates the blocks, and what is said of it."""
    dating: Dating | None = getattr(source, "dating", None)
    return {
        "time_from": None if dating is None else dating.by,
        "dating": [*([] if dating is None else [dating.describe()]), *getattr(source, "remarks", ()), *of_times],
    }
