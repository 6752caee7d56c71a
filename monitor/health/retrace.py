"""The state after blocks of which only the records are left.

All that the stages carry follows from the values of records, bit for bit, but for two things that need samples: the
recent envelope spectra in whose mean a channel with ``average_blocks`` names the damaged part, and the votes of the
first blocks for a band. Kept spectra are no part of the state.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from monitor.health import onset as detect
from monitor.health.alarms import AlarmAcknowledgement
from monitor.health.block_time import retimed
from monitor.health.channel import is_for_detector, shallow_lines
from monitor.health.gears.naming import GearsInput, GearsState
from monitor.health.gears.naming import step as gears_step
from monitor.health.gears.stage import rules_of
from monitor.health.gears.values import recorded_readings
from monitor.health.later_stages import ChannelBlock, later_stages
from monitor.health.name.naming import score_threshold
from monitor.health.onset import LINES, DetectInput, DetectOutput
from monitor.health.record import Record
from monitor.health.signal.average import RecentSpectra
from monitor.health.signal.condition import Quantity
from monitor.health.signal.quality import Verdict
from monitor.health.signal.transform import Band
from monitor.health.signal.waterfall import step as waterfall_step
from monitor.health.state import ChannelSettings, ChannelState, Named, SourceSettings, SourceState
from monitor.health.step import take_record
from streams.dates.observed import JudgedTime

AVERAGED_SPECTRA, BAND_VOTES = "averaged_spectra", "band_votes"


@dataclass(frozen=True)
class Retraced:
    """A state after records.

    Attributes:
        blocks: number of records taken.
        missing: by channel, what of its state begins afresh: AVERAGED_SPECTRA, BAND_VOTES.
    """

    state: SourceState
    blocks: int = 0
    missing: Mapping[str, tuple[str, ...]] = field(default_factory=dict[str, tuple[str, ...]])


def retrace(state: SourceState, records: Iterable[Record], settings: SourceSettings) -> Retraced:
    """Take records of a source, in the order of commitment, into the state before them."""
    blocks = 0
    averaged = {name: channel.spectra.count for name, channel in state.channels.items()}
    missing: dict[str, set[str]] = {}
    for record in records:
        blocks += 1
        state = _retrace_one(state, record, settings, averaged)
        for name, values in record.channels.items():
            if name in settings.channels and _verdict(values).for_baseline:
                missing.setdefault(name, set()).update(_missing(values, settings.channels[name]))
    return Retraced(state, blocks, {name: tuple(sorted(parts)) for name, parts in missing.items() if parts})


def _missing(values: Mapping[str, Any], settings: ChannelSettings) -> set[str]:
    """Return what one more block would have added to the state of a channel and its record does not hold."""
    lost = {AVERAGED_SPECTRA: settings.average_blocks > 1, BAND_VOTES: values.get("band_source") == "provisional"}
    return {part for part, missing in lost.items() if missing}


def _retrace_one(state: SourceState, record: Record, settings: SourceSettings, averaged: dict[str, int]) -> SourceState:
    """Take one record; ``averaged`` counts the spectra that were averaged by channel, and is changed."""
    order, judged = retimed(state.order, record)
    state = replace(state, order=order)
    channels, waterfalls = dict(state.channels), dict(state.waterfalls)
    verdicts: dict[str, Verdict] = {}
    for name, channel in settings.channels.items():
        values = record.channels.get(name)
        if values is None:
            continue
        verdict = verdicts[name] = _verdict(values)
        if not verdict.accepted or values.get("rms") is None:
            continue
        before = channels[name]
        if verdict.for_baseline:
            begun = 0 if _chosen_since(before, values, channel) else averaged[name]
            averaged[name] = min(begun + 1, channel.average_blocks)
        channels[name], found = _channel(before, record, verdict, values, channel, averaged[name], judged)
        if name in waterfalls and verdict.for_baseline:
            waterfalls[name], _, _ = waterfall_step(
                waterfalls[name],
                _time_of(record),
                channel.waterfall,
                clock_valid="clock" not in verdict.flags,
                onset=found.alarm,
                end=found.end,
            )
    gears = {name: _gears(one, record, settings.channels[name]) for name, one in state.gears.items()}
    state = replace(state, channels=channels, waterfalls=waterfalls, gears=gears)
    state, _, _ = take_record(state, record, verdicts, settings, _acknowledgements(record))
    return replace(state, latest=record if record.channels else state.latest)


def _gears(state: GearsState, record: Record, settings: ChannelSettings) -> GearsState:
    """Take what a record says of the wheels of a channel through their stage."""
    values = record.channels.get(settings.name, {})
    if settings.gears is None or not _verdict(values).for_baseline:
        return state
    wheels = recorded_readings(settings.gears, values)
    if not wheels:
        return state
    learning = values.get("stage") == detect.LEARNING
    given = GearsInput(record.sequence, wheels, values.get("speed"), values.get("load"), learning)
    return gears_step(state, given, settings.gears, rules_of(settings))[0]


def _time_of(record: Record) -> float | None:
    return record.time if record.time is not None else record.elapsed


def _verdict(values: Mapping[str, Any]) -> Verdict:
    flags = values.get("quality_flags")
    return Verdict(values.get("quality_status") or "ok", tuple(flags.split("|")) if flags else ())


def _channel(
    state: ChannelState,
    record: Record,
    verdict: Verdict,
    values: Mapping[str, Any],
    settings: ChannelSettings,
    averaged: int,
    judged: JudgedTime,
) -> tuple[ChannelState, DetectOutput]:
    """Take the values of one channel through the stages, as ``monitor.health.channel.step`` takes samples."""
    block = ChannelBlock(
        samples=np.empty(0),
        rate=0.0,
        sequence=record.sequence,
        time=_time_of(record),
        verdict=verdict,
        speed=Quantity(values.get("speed")),
        load=Quantity(values.get("load")),
        recorded_range=_speed_range(values),
        judged=judged,
    )
    band_source = values.get("band_source") or "provisional"
    if _chosen_since(state, values, settings):
        bands = _bands(values)
        state = replace(state, bands=bands, band_source=band_source, votes=None, spectra=RecentSpectra())
    if verdict.for_baseline and averaged == settings.average_blocks > 1:
        # The spectrum of this block is lost; the oldest leaves the mean when it would have.
        state = replace(state, spectra=state.spectra.without_oldest())
    given = DetectInput(
        sequence=record.sequence,
        time=block.time,
        rms=values["rms"],
        prominence=_prominence(values),
        peak=values.get("peak") if settings.absolute else None,
        usable=is_for_detector(state, verdict, settings, band_source),
        shallow=_shallow(values),
        speed=values.get("speed"),
        speed_range=block.speed_range,
        load=values.get("load"),
    )
    lines = values.get("bpfo_amplitude")
    harmonics = None if lines is None or None in lines else tuple(lines)
    named = _named(values, record.sequence, averaged) if verdict.for_baseline else None
    state, found = later_stages(state, block, settings, given, harmonics, named)
    return state, found.detection


def _chosen_since(state: ChannelState, values: Mapping[str, Any], settings: ChannelSettings) -> bool:
    """Return whether a band was chosen between the state and the record."""
    return settings.bands is None and not state.bands and values.get("band_source") in ("learning", "recording")


def _bands(values: Mapping[str, Any]) -> tuple[Band, ...]:
    low, high = (_all_of(values[name]) for name in ("band_lo", "band_hi"))
    return tuple(zip(low, high, strict=True))


def _all_of(value: Any) -> tuple[Any, ...]:
    """Return the values of all bands, of which a single one is no tuple."""
    return cast("tuple[Any, ...]", value) if isinstance(value, tuple) else (value,)


def _first_band(values: Mapping[str, Any], name: str) -> Any:
    """Return a value of the first band."""
    return values[name][0] if isinstance(values.get("band_lo"), tuple) and values.get(name) else values.get(name)


def _prominence(values: Mapping[str, Any]) -> dict[str, float]:
    """Return the lines of each part over the floor under them; unresolved lines have neither."""
    found: dict[str, float] = {}
    for name, floor in zip(LINES, _first_band(values, "envelope_floor") or (), strict=False):
        summed = float(_numbers(floor).sum())
        if summed > 0.0:
            found[name] = (_first_band(values, name) or 0.0) / summed
    return found


def _speed_range(values: Mapping[str, Any]) -> tuple[float, float] | None:
    low, high = values.get("speed_min"), values.get("speed_max")
    return None if low is None or high is None else (low, high)


def _shallow(values: Mapping[str, Any]) -> frozenset[str]:
    """Return the lines that are not deep enough to count; none in a record of an earlier version."""
    mean = _first_band(values, "envelope_mean")
    if mean is None:
        return frozenset()
    lines = (_first_band(values, f"envelope_{what}") or ((),) * len(LINES) for what in ("amplitude", "floor"))
    numbers = {name: (_numbers(line), _numbers(floor)) for name, line, floor in zip(LINES, *lines, strict=True)}
    return shallow_lines(numbers, mean)


def _numbers(lines: Sequence[float | None] | None) -> NDArray[np.float64]:
    """Return the values of lines, 0 for those that are not resolved."""
    return np.array([line or 0.0 for line in lines or (0.0,)])


def _named(values: Mapping[str, Any], sequence: int, averaged: int) -> Named | None:
    if values.get("fault") is None:
        return None
    standing = values["fault_score"] / score_threshold(max(1, averaged))
    candidates, unverified = values.get("fault_candidates"), values.get("speed_unverified")
    return Named(
        values["fault"],
        values["fault_snr"],
        values["fault_depth"],
        standing,
        sequence,
        tuple(candidates.split("|")) if candidates else (),
        None if unverified is None else unverified == "yes",
    )


def _acknowledgements(record: Record) -> tuple[AlarmAcknowledgement, ...]:
    """Return the acknowledgements that released an alarm with the block."""
    return tuple(
        AlarmAcknowledgement(
            event["channel"], event["rule"], event["severity"], event["since_block"], event["acknowledged_utc_s"]
        )
        for event in record.events
        if event.get("kind") == "alarm_released"
    )
