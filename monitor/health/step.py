"""One block of one source through all stages: one state and the block in, one state and one record out.

The stages in order: place in the stream, quality, speed and load, features, onset, name of the damaged part, damage,
forecast, wheels, kept spectra, alarms, what the channels of a bearing say together. Nothing here reads a clock or a
file, so that a daemon, a restarted one and a replay give the same records, and to roll a block back is to go on with
the state before it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from monitor.health.alarms import AlarmAcknowledgement, AlarmInput, AlarmState, acknowledged
from monitor.health.alarms import step as alarms_step
from monitor.health.block_time import TimedBlock, timed
from monitor.health.channel import analyse, check_channel, check_level, conclude
from monitor.health.gears.stage import gears_step
from monitor.health.later_stages import ChannelBlock
from monitor.health.name.crosstalk import beside_neighbours
from monitor.health.name.evidence import evidence_of_record
from monitor.health.name.machine import BearingVerdict
from monitor.health.name.machine import step as machine_step
from monitor.health.onset import DetectState
from monitor.health.output import (
    ChannelOutput,
    Events,
    alarm_events,
    channel_events,
    issued_forecasts,
    name_events,
    release_events,
)
from monitor.health.record import Record, storable
from monitor.health.record_values import record_values, spectrum_row
from monitor.health.signal.condition import ConditionSettings, load_of, speed_flags, speed_of
from monitor.health.signal.indicators import span_of
from monitor.health.signal.interference import all_combs
from monitor.health.signal.kurtogram import kurtogram
from monitor.health.signal.quality import (
    Verdict,
    bands_above_nyquist,
    check_order,
    check_rate,
    rejected,
    verdict_of_block,
    with_flags,
)
from monitor.health.signal.rotation.ias import with_ias
from monitor.health.signal.rotation.shaft_angle import FoundRotation, find_rotation, with_phase
from monitor.health.signal.spectra import WAVEFORM_SAMPLES, BlockView
from monitor.health.signal.transform import MIN_SAMPLES
from monitor.health.signal.waterfall import SpectrumChange, WaterfallState
from monitor.health.signal.waterfall import step as waterfall_step
from monitor.health.state import ChannelSettings, ChannelState, SourceSettings, SourceState
from streams.types.block import Block, Rejected, to_si

_MAX_REASON = 500
"""Characters of a reason that comes from outside."""
_BAD_FLAGS = {"flat", "clipped", "clock", "filled"}


@dataclass(frozen=True)
class SourceOutput:
    """What one block gives for its source.

    Attributes:
        record: to be committed with the state after the block.
        spectra: changes of the kept spectra, to be committed with them.
        channels: by channel, what the stages found; {} where the block was rejected as a whole.
        bearings: what the channels of this source say together, by bearing.
        misfit: why the block does not fit the configuration; in a recording, no later block will fit better.
    """

    record: Record
    spectra: tuple[SpectrumChange, ...] = ()
    channels: Mapping[str, ChannelOutput] = field(default_factory=dict[str, ChannelOutput])
    bearings: Mapping[str, BearingVerdict] = field(default_factory=dict[str, BearingVerdict])
    misfit: str | None = None


def step(
    state: SourceState,
    item: Block | Rejected,
    settings: SourceSettings,
    *,
    now: float | None = None,
    latest: float | None = None,
    acknowledgements: Sequence[AlarmAcknowledgement] = (),
    truth: Mapping[str, Any] | None = None,
) -> tuple[SourceState, SourceOutput]:
    """Take one block of a source into its state.

    A block that does not fit the configuration is rejected. What several sources say of one bearing is weighed above
    this function, from their states (:func:`monitor.health.name.machine.weigh`).

    Args:
        item: the block, or the rejection that takes its place.
        now: present UTC where the stream is live, None in a replay; ``latest`` a time that no block can have by then.
        acknowledgements: of alarms, since the block before.
        truth: true values of the block, of a simulated rig.
    """
    misfit: str | None = None
    if isinstance(item, Block) and (unfit := _misfit(item, settings)) is not None:
        item, misfit = rejection_of(item, unfit.status, unfit.reason), unfit.reason
    elif isinstance(item, Block) and 0 < (length := item.samples.shape[1]) < MIN_SAMPLES:
        reason = f"{item.name}: {length} samples, the analysis needs at least {MIN_SAMPLES}"
        item = rejection_of(item, "short", reason)
    if isinstance(item, Rejected):
        order, _, _ = check_order(state.order, item.sequence, None)
        state, output = replace(state, order=order), SourceOutput(rejected_record(item), misfit=misfit)
    else:
        order, placed = timed(state.order, item, now, latest)
        state, output = _analyse(replace(state, order=order), placed, settings, truth)
    verdicts = {name: channel.block.verdict for name, channel in output.channels.items()}
    state, events, bearings = take_record(state, output.record, verdicts, settings, acknowledgements)
    record = output.record
    if events:
        record = replace(record, events=(*record.events, *events))
    after = replace(state, latest=record if output.channels else state.latest)
    return after, replace(output, record=record, bearings=bearings)


def take_record(
    state: SourceState,
    record: Record,
    verdicts: Mapping[str, Verdict],
    settings: SourceSettings,
    acknowledgements: Sequence[AlarmAcknowledgement] = (),
) -> tuple[SourceState, Events, Mapping[str, BearingVerdict]]:
    """Take a record into the alarms and into what the channels of a bearing say together.

    An acknowledgement takes effect before the block, whose record says so: the same blocks and the same
    acknowledgements before them give the same records.

    Args:
        state: its channels as they are after the block.
        record: without events of alarms and bearings.
        verdicts: by channel, none where the block was rejected as a whole.
    """
    alarms, events = alarm_step(state, record, verdicts, settings, acknowledgements)
    heard = evidence_of_record(record.channels, record.time)
    machine, bearings = machine_step(state.machine, heard, settings.bearings, settings.persist_blocks)
    events += name_events(record.sequence, bearings)
    return replace(state, alarms=alarms, machine=machine), events, bearings


def _misfit(block: Block, settings: SourceSettings) -> Verdict | None:
    """Return why a block does not fit the configuration, or None.

    A channel is missing, the speed is unknown, or a band reaches above the Nyquist frequency. A wrong sampling rate is
    a matter of the block and not reported here.
    """
    if not check_rate(block.rate, settings.rate).accepted:
        return None
    missing = sorted(set(settings.channels) - set(block.channels))
    if missing:
        found = ", ".join(block.channels)
        reason = f"source {settings.name!r}, {block.name}: channel {missing[0]!r} is not in it; it has {found}"
        return rejected("wrong_shape", reason)
    for channel in settings.channels.values():
        given = block.speed is not None or block.pulses is not None
        if not given and channel.condition.speed is None and not channel.condition.varies:
            return rejected(
                "incomplete",
                f"operating.speed_hz is missing, and {block.name} does not state the shaft speed: the fault "
                "frequencies cannot be computed",
            )
        reason = bands_above_nyquist(channel.name, channel.bands or (), channel.rms_band, block.rate)
        if reason is not None:
            return rejected("wrong_rate", reason)
    return None


def rejection_of(item: Block | Rejected, status: str, reason: str) -> Rejected:
    """Return the rejection that takes the place of a block, its texts such that a database takes them."""
    text = storable(" ".join(reason.split())[:_MAX_REASON])
    return Rejected(item.source, item.sequence, storable(item.name), status, text, item.content_hash)


def rejected_record(item: Rejected) -> Record:
    """Return the record of a rejected block."""
    return Record(
        source=item.source,
        sequence=item.sequence,
        name=item.name,
        content_hash=item.content_hash,
        status=item.status,
        reason=item.reason,
    )


def _analyse(
    state: SourceState,
    placed: TimedBlock,
    settings: SourceSettings,
    truth: Mapping[str, Any] | None,
) -> tuple[SourceState, SourceOutput]:
    """Take a block through all stages but the alarms."""
    block, flags = placed.block, placed.flags
    verdict = check_rate(block.rate, settings.rate)
    if not verdict.accepted:
        return state, SourceOutput(_record(block, verdict))
    states: dict[str, ChannelState] = {}
    outputs: dict[str, ChannelOutput] = {}
    # The channels of a machine share a shaft and mostly a condition: its angle is found once.
    conditions = dict.fromkeys(channel.condition for channel in settings.channels.values())
    angles = {condition: find_rotation(block, condition, state.encoder, learn=not flags) for condition in conditions}
    encoder = next((found.encoder for found in angles.values() if found.encoder is not None), state.encoder)
    blocks = {
        name: _channel_block(placed, state.channels[name], channel, angles[channel.condition])
        for name, channel in settings.channels.items()
    }
    analysed = {name: analyse(state.channels[name], blocks[name], one) for name, one in settings.channels.items()}
    for name, found in beside_neighbours(analysed).items():
        states[name], outputs[name] = conclude(state.channels[name], blocks[name], settings.channels[name], found)
    gears, outputs = gears_step(state.gears, outputs)
    verdict = verdict_of_block({name: output.block.verdict for name, output in outputs.items()}, flags)
    forecasts: list[dict[str, Any]] = []
    events: list[dict[str, Any]] = []
    for name, output in outputs.items():
        forecasts += issued_forecasts(output)
        events += channel_events(states[name].detect, output)
    record = _record(
        block,
        replace(verdict, reason=placed.reason_with(verdict.reason)),
        channels={
            name: record_values(states[name].detect, output, truth) | placed.values for name, output in outputs.items()
        },
        forecasts=tuple(forecasts),
        events=tuple(events),
    )
    waterfalls, spectra = _spectra(state.waterfalls, block, states, outputs, settings, angles)
    after = replace(state, channels=states, waterfalls=waterfalls, encoder=encoder, gears=gears)
    return after, SourceOutput(record, spectra, outputs)


def _record(block: Block, verdict: Verdict, **results: Any) -> Record:
    """Return the record of a block: its identity, the verdict on it, and results by attribute."""
    return Record(
        source=block.source,
        sequence=block.sequence,
        name=block.name,
        content_hash=block.content_hash,
        status=verdict.status,
        flags=verdict.flags,
        reason=verdict.reason,
        time=block.start,
        elapsed=block.elapsed,
        **results,
    )


def _channel_block(
    placed: TimedBlock, state: ChannelState, settings: ChannelSettings, found: FoundRotation
) -> ChannelBlock:
    """Return one channel of a block in SI, with the verdict on it, its speed and its load."""
    block = placed.block
    row = block.channels.index(settings.name)
    unit = block.units[row]
    samples, si_unit = to_si(block.samples[row], unit, settings.scale, settings.sensitivity_mv_per_g)
    span = span_of(samples) if samples.size else None
    if si_unit != settings.si_unit:
        verdict = rejected("wrong_unit", f"unit {unit!r}, configured is {settings.unit!r}")
    else:
        verdict = check_channel(samples, state, settings, span)
    if settings.measures_velocity and verdict.accepted:
        samples = settings.acceleration_of(samples, block.rate)
        span = span_of(samples)
        verdict = verdict if verdict.flags else check_level(samples, state, settings, span)
    condition = settings.condition
    others = {name: block.samples[block.channels.index(name)] for name in condition.channels if name in block.channels}
    usable = samples if verdict.accepted else None
    found = with_phase(found, usable, block.rate, settings.bearing, condition)
    speed = speed_of(
        block.speed,
        others,
        usable,
        block.rate,
        settings.bearing,
        condition,
        block.speed_source,
        rotation=found.rotation,
    )
    if verdict.accepted and speed.value is None:
        read = ", and not read over OPC UA at the time of the block" if condition.speed_read else ""
        reason = f"the shaft speed is not known: neither stated nor found in the signal{read}"
        verdict = rejected("incomplete", reason)
    return ChannelBlock(
        samples=samples,
        rate=block.rate,
        sequence=block.sequence,
        time=placed.time,
        verdict=with_flags(verdict, (*placed.flags, *speed_flags(speed, condition.limits, found.rotation))),
        speed=speed,
        load=load_of(block.load, others, condition, block.load_source),
        span=span,
        found=found,
        judged=placed.judged,
    )


def _spectra(
    waterfalls: Mapping[str, WaterfallState],
    block: Block,
    states: Mapping[str, ChannelState],
    outputs: Mapping[str, ChannelOutput],
    settings: SourceSettings,
    angles: Mapping[ConditionSettings, FoundRotation],
) -> tuple[dict[str, WaterfallState], tuple[SpectrumChange, ...]]:
    """Return the waterfall states after a block, and the changes of the kept spectra."""
    after = dict(waterfalls)
    changes: list[SpectrumChange] = []
    for name, waterfall in waterfalls.items():
        channel, output = settings.channels[name], outputs[name]
        row = spectrum_row(block, output)
        if row is None:
            continue
        row = replace(row, view=_view(output))
        found = output.detection
        onset = found is not None and found.alarm
        after[name], kind, thin = waterfall_step(
            waterfall,
            row.time,
            channel.waterfall,
            clock_valid="clock" not in output.block.verdict.flags,
            onset=onset,
            end=found is not None and found.end,
        )
        if kind != "newest":
            # Over time the lines of a shaft of varying speed are no lines.
            combs = all_combs(channel.interference, row.speed if row.domain == "hertz" else None)
            row = replace(row, kurtogram=kurtogram(output.block.samples, block.rate, combs))
            if not changes:
                # The speed is that of the source: its first channel has it.
                angle, tacho = angles[channel.condition], channel.condition.tacho
                view = with_ias(row.view, angle.repaired, tacho.ratio, channel.bearing, angle.mark_error)
                row = replace(row, view=view)
        began = states[name].detect.t_fs if onset else None
        changes.append(SpectrumChange(row, kind, thin, None if began is None else began.sequence))
    return after, tuple(changes)


def _view(output: ChannelOutput) -> BlockView | None:
    """Return what is kept of a block to be looked at."""
    spectra, samples = None if output.features is None else output.features.view, output.block.samples
    if spectra is None:
        return None
    return BlockView(output.block.rate, samples.size, spectra, samples[:WAVEFORM_SAMPLES].copy())


def alarm_step(
    state: SourceState,
    record: Record,
    verdicts: Mapping[str, Verdict],
    settings: SourceSettings,
    acknowledgements: Sequence[AlarmAcknowledgement],
) -> tuple[dict[str, AlarmState], Events]:
    """Take a record into the alarm states of all channels."""
    states, events = dict(state.alarms), Events()
    for given in acknowledgements:
        if given.channel in states:
            before = states[given.channel]
            states |= acknowledged({given.channel: before}, (given,))
            rules = settings.channels[given.channel].alarms
            events += release_events(given, record.sequence, before, states[given.channel], rules)
    for name, channel in settings.channels.items():
        block = _alarm_input(record, name, state.channels[name].detect, verdicts.get(name))
        states[name], output = alarms_step(states[name], block, channel.alarms)
        events += alarm_events(name, record.sequence, output)
    return states, events


def _alarm_input(record: Record, channel: str, detector: DetectState, verdict: Verdict | None) -> AlarmInput:
    learned, closed = detector.baseline, detector.episodes[-1:]
    values = record.channels.get(channel, {})
    at_reference: dict[str, float | None] = {}
    if learned is not None and "rms" in learned.by:
        level = values.get("level_rms")
        at_reference["rms"] = None if level is None else level * math.exp(learned.ln_rms)
    return AlarmInput(
        sequence=record.sequence,
        usable=verdict is not None and verdict.for_baseline,
        bad=verdict is None or not verdict.accepted or bool(_BAD_FLAGS & set(verdict.flags)),
        stage=detector.stage,
        values=values,
        baselines={} if learned is None else {"rms": (learned.ln_rms, learned.ln_rms_sd)},
        closed=any(episode.closed.sequence == record.sequence for episode in closed),
        at_reference=at_reference,
    )
