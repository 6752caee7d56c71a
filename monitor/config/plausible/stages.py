"""Doubts of what is done with the signal: sources and channels given twice, learning, levels, thresholds."""

from __future__ import annotations

from collections.abc import Iterator

from monitor.config.alarms import AlarmLevel
from monitor.config.load import Config
from monitor.config.plausible.doubt import Doubt
from monitor.config.plausible.rules import JudgedConfig
from monitor.config.positions import Place
from monitor.words.features import LEVELS

_MAX_LEARNING_S, _MIN_LEARN_BLOCKS = 90 * 86400.0, 10
_MAX_SETTLE_S = 600.0
_END_OF_LIFE_G = (1.0, 150.0)
"""The usual 20 g in m/s2 is beyond it."""
_MAX_LEVELS = {"_g": (500.0, "g", "m/s2"), "_mm_s": (500.0, "mm/s", "um/s")}


def stage_doubts(subject: JudgedConfig) -> Iterator[Doubt]:
    """Yield what is doubtful in the choice of channels, in learning, levels and thresholds."""
    yield from _twice(subject)
    yield from _settling(subject)
    yield from _learning(subject)
    yield from _end_of_life(subject)
    yield from _alarm_levels(subject)
    yield from _threshold(subject)


def _twice(subject: JudgedConfig) -> Iterator[Doubt]:
    """Yield channels of one bearing that read one signal, and sources that read one place."""
    config = subject.config
    seen: dict[tuple[object, ...], str] = {}
    for at, channel in enumerate(config.channel):
        where = channel.key if channel.column is None else str(channel.column)
        if where is None:
            continue
        first = seen.setdefault((channel.source, where, channel.bearing), channel.name)
        if first != channel.name:
            key = "key" if channel.column is None else "column"
            came = f"{where!r} of channel {first!r} of the same bearing, which would count twice"
            yield subject.doubt("duplicate", "problem", ("channel", at, key), "a signal of its own", came)
    places: dict[object, str] = {}
    for at, source in enumerate(config.source):
        if source.url is None or not source.url.startswith("folder:"):
            continue
        first = places.setdefault((source.url.rstrip("/"), source.files), source.name)
        if first != source.name and _shares_channel(config, first, source.name):
            came = f"{source.url}, with the signals of source {first!r}, which would count twice"
            yield subject.doubt("duplicate", "problem", ("source", at, "url"), "a place of its own", came)


def _shares_channel(config: Config, first: str, second: str) -> bool:
    """Return whether two sources give a signal of one column to one bearing."""
    read = [
        {(channel.column, channel.key, channel.bearing) for channel in config.channel if channel.source == name}
        for name in (first, second)
    ]
    return bool(read[0] & read[1])


def _settling(subject: JudgedConfig) -> Iterator[Doubt]:
    for at, section in enumerate(subject.config.source):
        if section.settle_s > _MAX_SETTLE_S:
            came = f"{section.settle_s:g} s; {1e-3 * section.settle_s:g} s if ms was meant"
            place: Place = ("source", at, "settle_s")
            yield subject.doubt("settle", "warning", place, f"up to {_MAX_SETTLE_S:g} s", came)


def _learning(subject: JudgedConfig) -> Iterator[Doubt]:
    config, detect = subject.config, subject.config.detect
    periods = [
        section.interval_s or (None if section.url is None or section.url.startswith("folder:") else facts.duration)
        for section in config.source
        for facts in (subject.facts_of(section.name),)
    ]
    known = [period for period in periods if period]
    blocks = detect.to_settings().learn_blocks
    key = "learn_blocks" if blocks is not None else "learn_hours"
    place: Place = ("detect", key)
    if detect.learn_hours is not None:
        learned = 3600.0 * detect.learn_hours
        shortest = max(
            known, default=max((subject.facts_of(s.name).duration or 0.0 for s in config.source), default=0.0)
        )
        if shortest and learned / shortest < _MIN_LEARN_BLOCKS:
            came = f"{detect.learn_hours:g} h: {learned / shortest:.2g} blocks of {shortest:g} s"
            yield subject.doubt("learning", "warning", place, f"at least {_MIN_LEARN_BLOCKS} blocks", came)
    else:
        learned = (blocks or 0) * max(known, default=0.0)
    if learned > _MAX_LEARNING_S:
        yield subject.doubt("learning", "warning", place, "up to 90 days", f"{learned / 86400.0:.4g} days of learning")


def _ranges(subject: JudgedConfig, channels: tuple[str, ...] = ()) -> list[float]:
    """Return the ranges of the sensors of channels, g; () are all."""
    config = subject.config
    named = {channel.source for channel in config.channel if not channels or channel.name in channels}
    return [section.range_g for section in config.source if section.name in named and section.range_g is not None]


def _end_of_life(subject: JudgedConfig) -> Iterator[Doubt]:
    detect = subject.config.detect
    place: Place = ("detect", "end_of_life_peak_g")
    peak, ranges = detect.end_of_life_peak_g, _ranges(subject)
    given = "end_of_life_peak_g" in detect.model_fields_set
    if ranges and peak > max(ranges):
        expected = f"up to {max(ranges):g} g, the range of the sensors: no block reaches more"
        yield subject.doubt("end_of_life", "problem" if given else "warning", place, expected, f"{peak:g} g")
    elif not _END_OF_LIFE_G[0] <= peak <= _END_OF_LIFE_G[1]:
        came = f"{peak:g} g" + (f"; {peak / 9.80665:.3g} g if m/s2 was meant" if peak > _END_OF_LIFE_G[1] else "")
        expected = f"{_END_OF_LIFE_G[0]:g} to {_END_OF_LIFE_G[1]:g} g"
        yield subject.doubt("end_of_life", "warning", place, expected, came)


def _alarm_levels(subject: JudgedConfig) -> Iterator[Doubt]:
    for at, level in enumerate(subject.config.alarms.level):
        yield from _never(subject, at, level)
        ending = LEVELS[level.feature].level[0]
        if ending not in _MAX_LEVELS:
            continue
        most, unit, other = _MAX_LEVELS[ending]
        ranges = _ranges(subject, level.channels)
        for severity in ("alert", "danger"):
            key = f"{severity}{ending}"
            value = getattr(level, key)
            if value is None:
                continue
            place: Place = ("alarms", "level", at, key)
            if ending == "_g" and ranges and value > max(ranges):
                expected = f"up to {max(ranges):g} g, the range of the sensors"
                yield subject.doubt("alarm_level", "problem", place, expected, f"{value:g} g")
            elif value > most:
                came = f"{value:g} {unit}: is it {other}?"
                yield subject.doubt("alarm_level", "warning", place, f"up to {most:g} {unit}", came)


def _never(subject: JudgedConfig, at: int, level: AlarmLevel) -> Iterator[Doubt]:
    """Yield that the constant speed or load of a machine lies outside the range of a level, which always waits."""
    operating = subject.config.operating
    varies = operating.to_condition().varies
    for key, value, of in (
        ("speed_range_hz", operating.speed_hz, "speed_hz"),
        ("load_range_newton", operating.load_newton, "load_newton"),
    ):
        span = getattr(level, key)
        if span is None or value is None or varies or span[0] <= value <= span[1]:
            continue
        came = f"[{span[0]:g}, {span[1]:g}], so that the level waits for ever"
        yield subject.doubt(
            "alarm_level", "problem", ("alarms", "level", at, key), f"a range with {of} = {value:g}", came
        )


def _threshold(subject: JudgedConfig) -> Iterator[Doubt]:
    """Yield that a threshold is the cross-section of no spall, for the smallest bearing that is tracked."""
    config = subject.config
    sizes = [1e3 * config.bearing_of(channel).element_diameter for channel in config.channel if channel.track]
    if not sizes:
        return
    highest, area = 1e6 * max(config.forecast.thresholds), min(sizes) ** 2
    if highest <= 0.1 * area:
        return
    severity = "problem" if highest > area else "warning"
    expected = (
        f"up to {0.1 * area:.3g} mm2, a tenth of the square of an element's diameter; a spall of 5 mm and 10 um is 0.05"
    )
    yield subject.doubt("threshold", severity, ("forecast", "threshold_mm2"), expected, f"{highest:g} mm2")
