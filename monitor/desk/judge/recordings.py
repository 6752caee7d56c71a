"""What the first and the last files of a source show, read as the daemon reads them."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from monitor.config.load import Config, ConfigError
from monitor.config.plausible import find_doubts
from monitor.config.plausible.doubt import Doubt
from monitor.config.plausible.levels import alternates, doubts, same_signals, shape_of
from monitor.config.plausible.machine import load_doubts, speed_doubt
from monitor.config.plausible.rules import JudgedConfig, SourceFacts, key_words, place_of
from monitor.config.positions import Place
from monitor.config.source import ChannelSection, SourceSection
from monitor.health.block_time import timed
from monitor.health.signal.quality import OrderState, check_samples
from streams.dates.best import latest_of
from streams.files.plausible import SignalLevel, level_of, of_one_g
from streams.types.block import VELOCITY, Block, Rejected, to_si
from streams.types.samples import Samples
from streams.types.spec import SourceError
from streams.types.stamps import utc_text

if TYPE_CHECKING:
    from streams.recording.repeats import Loaded
    from streams.recording.source import Recording

MAX_OPENED = 100
"""Items of a recording that are read until one is a block."""
_MAX_COMPARED, _MAX_COMPARED_S = 8, 5.0
"""Files that are compared for sensors that alternate, and the time for it."""
_MAX_SAMPLES = 1 << 21
"""Samples of a row that are judged."""
_MAX_SAME_SAMPLES = 1 << 16
"""The same where each row is compared with all others."""
_SPEED_TOLERANCE = 0.25
_MAX_LAG_CHANGE_S = 300.0
_SHAPES = ("RMS", "mean frequency", "crest factor")
_REJECTED_KEYS = {"wrong_rate": "rate_hz", "out_of_range": "range_g"}


@dataclass(frozen=True)
class RecordingView:
    """What the files of a source hold.

    Attributes:
        ends: the first and the last file in words.
        first: the first block, and ``refused`` the first rejection before it.
        facts: what they state where the configuration does not.
        doubts: about them.
    """

    ends: tuple[str, ...]
    first: Block | None
    refused: Rejected | None
    facts: SourceFacts
    doubts: tuple[Doubt, ...]


def look_at(recording: Recording, config: Config, section: SourceSection) -> RecordingView:
    """Read the first and the last file of a recording, its first block, and some files to compare them.

    Raises:
        SourceError: files contradict each other.
    """
    subject = JudgedConfig(config)
    begun = _FirstBlocks.read(recording, subject)
    first = begun.first
    loaded = recording.ends()
    found = [*_rejections(subject, section, loaded), *_levels(subject, section, loaded)]
    found += _unlisted(subject, section, loaded)
    if first is not None:
        found += [*_same(subject, first), *_speeds(subject, first), *_load(subject, first), *begun.clock(section)]
    shapes = begun.shapes
    if len(loaded) > 1:
        shapes, between = _first_files(recording, config)
        ends = {file.path for file in loaded}
        found += _rejections(subject, section, [file for file in between if file.path not in ends])
    found += _alternating(subject, shapes)
    facts = SourceFacts()
    if first is not None:
        facts = SourceFacts(first.rate, first.duration, _speed_of(config, first), *_clock_of(loaded))
    return RecordingView(tuple(_end_words(config, loaded)), first, begun.refused, facts, tuple(found))


def _clock_of(loaded: Sequence[Loaded]) -> tuple[tuple[float, float] | None, float | None]:
    """Return the starts of the first and the last file, and how far the last change of both is behind their ends."""
    both = [file.result for file in loaded if isinstance(file.result, Samples)]
    starts = [samples.start for samples in both if samples.start is not None]
    if len(starts) < len(both) or not both:
        return None, None
    witnesses = (() if samples.stated is None else samples.stated.witnesses for samples in both)
    lags = [lag for found in witnesses for source, lag in found if source == "mtime"]
    agree = len(lags) == len(both) and max(lags) - min(lags) <= _MAX_LAG_CHANGE_S
    return (min(starts), max(starts)), lags[0] if agree else None


def recording_doubts(config: Config, section: SourceSection, path: str | None) -> list[Doubt]:
    """Return what is doubtful in a configuration and a recording that is replayed with it, but its dates.

    What cannot be opened is not judged: the replay says why.
    """
    from monitor.service.setup import open_configured
    from streams.recording.source import Recording

    try:
        recording = open_configured(config, section, path)
        if not isinstance(recording, Recording):
            return find_doubts(config)
        view = look_at(recording, config, section)
    except (ConfigError, SourceError, OSError):
        return find_doubts(config)
    facts = {} if view.first is None else {section.name: view.facts}
    return [*find_doubts(config, facts), *(doubt for doubt in view.doubts if doubt.rule != "file")]


Shapes = dict[str, list[tuple[float, ...]]]
"""Of each channel, what tells sensors apart in consecutive files or blocks, as :func:`shape_of` gives it."""


def _note_shapes(shapes: Shapes, config: Config, names: Sequence[str], rows: NDArray[Any]) -> None:
    channels = {channel.name for channel in config.channel}
    for name, row in zip(names, rows, strict=True):
        if name in channels:
            shapes.setdefault(name, []).append(shape_of(row[:_MAX_SAMPLES]))


@dataclass
class _FirstBlocks:
    """The first block, the first rejection before it, and what some blocks show together."""

    subject: JudgedConfig
    first: Block | None = None
    refused: Rejected | None = None
    shapes: Shapes = field(default_factory=dict)
    doubted: list[tuple[str, str]] = field(default_factory=list)
    count: int = 0

    @classmethod
    def read(cls, recording: Recording, subject: JudgedConfig) -> _FirstBlocks:
        """Read blocks for at most ``_MAX_COMPARED_S``, but until one comes."""
        found, order, began = cls(subject), OrderState(), time.monotonic()
        for item in islice(recording, MAX_OPENED):
            if isinstance(item, Rejected):
                found.refused = item if found.refused is None and found.first is None else found.refused
                continue
            found.first = found.first or item
            order, judged = timed(order, item, None, latest_of(time.time()))
            if judged.judged.doubt:
                found.doubted.append((item.name, judged.judged.doubt))
            _note_shapes(found.shapes, subject.config, item.channels, item.samples)
            found.count += 1
            if found.count >= _MAX_COMPARED or time.monotonic() - began > _MAX_COMPARED_S:
                break
        return found

    def clock(self, section: SourceSection) -> Iterator[Doubt]:
        """Yield that the clock of blocks is doubted, with the first of them."""
        if self.doubted:
            name, why = self.doubted[0]
            came = f"{len(self.doubted)} of the first {self.count} blocks have the flag clock; {name}: {why}"
            place = place_of(self.subject.config, "source", section.name, "url")
            yield self.subject.doubt("clock", "warning", place, "times that follow each other", came)


def _rows(config: Config, file: Loaded) -> Iterator[tuple[ChannelSection, NDArray[Any]]]:
    """Yield the rows of the channels of a file; none of one that would be rejected."""
    channels = {channel.name: channel for channel in config.channel}
    if isinstance(file.result, Samples):
        for name, row in zip(file.result.channels, file.result.values, strict=True):
            if name in channels:
                yield channels[name], row[:_MAX_SAMPLES]


def _level(channel: ChannelSection, row: NDArray[Any]) -> SignalLevel:
    return level_of(row).times(channel.scale or 1.0)


def _end_words(config: Config, loaded: Sequence[Loaded]) -> Iterator[str]:
    """Yield rate, length, date and levels of files in words."""
    for file in loaded:
        samples = file.result
        if not isinstance(samples, Samples):
            continue
        levels = []
        for channel, row in _rows(config, file):
            level = _level(channel, row)
            one_g = of_one_g(channel.unit, channel.sensitivity_mv_per_g)
            levels.append(f"{channel.name} RMS {_level_words(level.rms, channel.unit, one_g)}")
        when = "no date" if samples.start is None else utc_text(samples.start)
        length = samples.values.shape[1] / samples.known_rate
        yield f"{file.name}: {samples.known_rate:g} Hz, {length:.4g} s, {when}, {', '.join(levels)}"


def _level_words(level: float, unit: str, one_g: float | None) -> str:
    if one_g is not None:
        return f"{level / one_g:.3g} g"
    return f"{level:.3g} {VELOCITY}" if unit == VELOCITY else f"{level:.3g}"


def _rejections(subject: JudgedConfig, section: SourceSection, loaded: Sequence[Loaded]) -> Iterator[Doubt]:
    for file in loaded:
        if not isinstance(file.result, Samples):
            key = _REJECTED_KEYS.get(file.result.status, "url")
            came = f"would be rejected, {file.result.status}: {file.result}"
            place = place_of(subject.config, "source", section.name, key)
            yield subject.doubt("file", "problem", place, "files that fit the configuration", came)
        for reason in file.result.torn if isinstance(file.result, Samples) else ():
            place, came = place_of(subject.config, "source", section.name, "url"), f"is left out, incomplete: {reason}"
            yield subject.doubt("file", "warning", place, "whole recordings", came)


def _unlisted(subject: JudgedConfig, section: SourceSection, loaded: Sequence[Loaded]) -> Iterator[Doubt]:
    """Yield what values under keys of no table contradict, each once."""
    place = place_of(subject.config, "source", section.name, "url")
    told: set[str] = set()
    for file in loaded:
        for came in file.result.doubts if isinstance(file.result, Samples) else ():
            if came not in told:
                told.add(came)
                yield subject.doubt("unlisted", "warning", place, "statements that agree", f"{file.name}: {came}")


def _levels(subject: JudgedConfig, section: SourceSection, loaded: Sequence[Loaded]) -> Iterator[Doubt]:
    """Yield what is doubtful in the levels of files, each once a channel; in one of two, a low one is a warning."""
    config = subject.config
    seen: dict[tuple[str, str], list[tuple[str, Doubt]]] = {}
    files = 0
    for file in loaded:
        files += isinstance(file.result, Samples)
        for channel, row in _rows(config, file):
            level = _level(channel, row)
            of_level = doubts(level, channel.unit, channel.sensitivity_mv_per_g)
            for doubt in (*of_level, *_peaks(subject, section, channel, level), *_flags(subject, channel, row)):
                seen.setdefault((channel.name, doubt.rule), []).append((file.name, doubt))
    for (name, _), (*_, (file_name, doubt)) in seen.items():
        number = len(seen[name, doubt.rule])
        severity = "warning" if doubt.rule == "low_level" and number < files else doubt.severity
        place = doubt.place if doubt.key else place_of(config, "channel", name, *map(str, doubt.place))
        came = f"channel {name!r}: {doubt.came} ({file_name})"
        yield replace(doubt, severity=severity, came=came, place=place, key=key_words(config, place))


def _flags(subject: JudgedConfig, channel: ChannelSection, row: NDArray[Any]) -> Iterator[Doubt]:
    """Yield the flags that the samples would have in the record, but those of levels that are judged themselves."""
    values, unit = to_si(row, channel.unit, channel.scale or 1.0, channel.sensitivity_mv_per_g)
    if not np.isfinite(values).all() or np.ptp(values) == 0.0:
        return
    verdict = check_samples(values, absolute=unit == "m/s2")
    flags = [flag for flag in verdict.flags if flag not in ("stopped", "clipped")]
    if flags:
        place = place_of(subject.config, "channel", channel.name)
        came = f"has the flag {', '.join(flags)}: {verdict.reason}"
        yield subject.doubt("flagged", "warning", place, "samples without a flag", came)


def _peaks(
    subject: JudgedConfig, section: SourceSection, channel: ChannelSection, level: SignalLevel
) -> Iterator[Doubt]:
    """Yield that a peak ends a life at once, or lies beyond the range."""
    one_g = of_one_g(channel.unit, channel.sensitivity_mv_per_g)
    if one_g is None or level.constant:
        return
    peak, limit = level.peak / one_g, subject.config.detect.end_of_life_peak_g
    if section.range_g is not None and peak > section.range_g:
        place = place_of(subject.config, "source", section.name, "range_g")
        came = f"a peak of {peak:.3g} g is beyond range_g, so that the block is rejected"
        yield subject.doubt("high_level", "problem", place, f"peaks up to {section.range_g:g} g", came)
    elif peak >= limit:
        came = f"a peak of {peak:.3g} g, as at the end of a life"
        place: Place = ("detect", "end_of_life_peak_g")
        yield subject.doubt("end_of_life", "warning", place, f"peaks below {limit:g} g", came)


def _same(subject: JudgedConfig, block: Block) -> Iterator[Doubt]:
    """Yield the channels of a block that are one signal, though they name different columns."""
    config = subject.config
    channels = {channel.name: channel for channel in config.channel}
    rows = {name: block.samples[row, :_MAX_SAME_SAMPLES] for row, name in enumerate(block.channels) if name in channels}
    for first, second, factor in same_signals(rows):
        one, other = channels[first], channels[second]
        if (one.column, one.key) == (other.column, other.key) != (None, None):
            continue
        times = "" if math.isclose(factor, 1.0, rel_tol=1e-3) else f", times {factor:.4g}"
        came = f"the same signal as channel {first!r} in {block.name}{times}"
        place = place_of(config, "channel", second)
        yield subject.doubt("same_signal", "problem", place, "a sensor of its own", came)


def _speed_of(config: Config, block: Block) -> float | None:
    """Return the speed that a block states itself or by its channel, Hz; None where it is no speed."""
    operating, speed = config.operating, block.speed
    name = str(operating.speed_channel)
    if speed is None and operating.speed_channel is not None and name in block.channels:
        row = block.samples[block.channels.index(name)]
        speed = float(np.mean(row[np.isfinite(row)] if np.isfinite(row).any() else 0.0)) * operating.speed_channel_scale
    return speed if speed is not None and math.isfinite(speed) and speed > 0.0 else None


def _speeds(subject: JudgedConfig, block: Block) -> Iterator[Doubt]:
    """Yield what is doubtful in the speed of a block, by itself and against the configured one."""
    operating = subject.config.operating
    found, configured = _speed_of(subject.config, block), operating.speed_hz
    if found is None:
        return
    by_channel = block.speed is None
    place: Place = ("operating", "speed_channel_scale" if by_channel else "speed_hz")
    doubt = None if _is_close(found, configured) else speed_doubt(subject, place, found)
    if doubt is not None:
        whose = "speed_channel" if by_channel else "the file"
        yield replace(doubt, came=f"by {whose} in {block.name}, {doubt.came}")
    if configured is None or abs(found / configured - 1.0) <= _SPEED_TOLERANCE:
        return
    ratio = max(found / configured, configured / found)
    severity = "problem" if abs(ratio / 60.0 - 1.0) < _SPEED_TOLERANCE else "warning"
    came = f"{configured:g} Hz is configured, {block.name} states {found:.5g} Hz"
    expected = "the speed of the file, which takes precedence" + (
        ": one of both is rpm" if severity == "problem" else ""
    )
    yield subject.doubt("file_speed", severity, ("operating", "speed_hz"), expected, came)


def _load(subject: JudgedConfig, block: Block) -> Iterator[Doubt]:
    """Yield what is doubtful in the load of a block, by itself or its channel."""
    operating = subject.config.operating
    stated, key, load = block.load is not None, "load_newton", block.load
    if not stated and operating.load_channel is not None and str(operating.load_channel) in block.channels:
        row = block.samples[block.channels.index(str(operating.load_channel))]
        load, key = float(np.mean(row)) * operating.load_channel_scale, "load_channel_scale"
    if load is None or not load > 0.0 or _is_close(load, operating.load_newton):
        return
    for doubt in load_doubts(subject, ("operating", key), load):
        yield replace(doubt, came=f"by {'the file' if stated else 'load_channel'} in {block.name}, {doubt.came}")


def _is_close(stated: float, configured: float | None) -> bool:
    """Return whether a file states what is configured, which is judged there."""
    return configured is not None and math.isclose(stated, configured, rel_tol=1e-3)


def _first_files(recording: Recording, config: Config) -> tuple[Shapes, list[Loaded]]:
    """Return the shapes of the first files, and those that would be rejected."""
    shapes: Shapes = {}
    refused: list[Loaded] = []
    began = time.monotonic()
    for file in recording.first_files(_MAX_COMPARED):
        if isinstance(file.result, Samples):
            _note_shapes(shapes, config, file.result.channels, file.result.values)
        else:
            refused.append(file)
        if time.monotonic() - began > _MAX_COMPARED_S:
            break
    return shapes, refused


def _alternating(subject: JudgedConfig, shapes: Shapes) -> Iterator[Doubt]:
    """Yield the channels whose files, or blocks, alternate between two levels or spectra, as two sensors do."""
    config = subject.config
    for name, found in shapes.items():
        for what, values in zip(_SHAPES, zip(*found, strict=True), strict=True):
            ratio = alternates(values)
            if ratio is not None:
                came = f"every second block has {ratio:.3g} times the {what} of those between, over {len(found)}"
                place = place_of(config, "channel", name)
                yield subject.doubt("alternating", "problem", place, "blocks of one sensor", came)
                break
