"""The angle of the shaft over a block from what the block holds, or why it has none."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from models.machine.bearing import Bearing
from monitor.health.signal.condition import ConditionSettings
from monitor.health.signal.rotation.encoder import EncoderState, encoder_step
from monitor.health.signal.rotation.fit import rotation_of, rotation_of_speed
from monitor.health.signal.rotation.repair import Repaired, repaired
from monitor.health.signal.rotation.ridge import angle_from_vibration
from monitor.health.signal.rotation.rotation import PulseCounts, Rotation, TachoSettings
from streams.turns.tacho import directions, edge_times
from streams.types.block import Block

_WRONG_WAY = 0.02
"""Share of edges in the other direction from which on the shaft counts as one that turned back."""


@dataclass(frozen=True, eq=False)
class FoundRotation:
    """The angle of the shaft over a block.

    Attributes:
        rotation: None where it was not found.
        status: "ok", or why there is none, of the first of its sources; None where there is no source.
        pulses: what was repaired, None where there are no pulses.
        repaired: the pulses themselves.
        encoder: what is known of the wheel after the block, None where it was not asked for.
        mark_error: shape (per_revolution,), revolutions by which each mark of ``repaired`` stands ahead of its place;
            None where it is not known.
    """

    rotation: Rotation | None = None
    status: str | None = None
    pulses: PulseCounts | None = None
    repaired: Repaired | None = None
    encoder: EncoderState | None = None
    mark_error: NDArray[np.float64] | None = None


def find_rotation(
    block: Block, condition: ConditionSettings, encoder: EncoderState | None = None, *, learn: bool = True
) -> FoundRotation:
    """Find the angle of the shaft over a block.

    The first of these gives it: the pulses that come with the block, a channel of pulses, the speed over time.

    Args:
        block: with its channels and pulses.
        condition: where its angle comes from.
        encoder: what is known of the wheel, or None: its errors are not removed.
        learn: whether the errors of the marks may be learned from the block.
    """
    found = FoundRotation()
    pulses = pulses_of(block, condition.tacho)
    if pulses is not None:
        found = _of_pulses(pulses, block.duration, condition.tacho.ratio, encoder, learn)
    elif condition.tacho.channel is not None or condition.tacho.of_source:
        found = FoundRotation(None, "none")
    if found.rotation is None and condition.speed_over_time:
        row = _row(block, condition.speed_channel)
        rotation, status = (None, "none") if row is None else rotation_of_speed(row * condition.speed_scale, block.rate)
        found = _next(found, rotation, status)
    return found


def with_phase(
    found: FoundRotation,
    samples: NDArray[np.floating] | None,
    rate: float,
    bearing: Bearing,
    condition: ConditionSettings,
) -> FoundRotation:
    """Return what was found of a block, where that is no angle with the one in the vibration of a channel.

    Args:
        found: of the block.
        samples: shape (sample,), of the channel, or None where they are not usable.
        rate: Hz.
        bearing: of the channel.
        condition: ``phase`` says whether the angle is sought at all.
    """
    if found.rotation is not None or not condition.phase or condition.speed_limits is None or samples is None:
        return found
    rotation, status = angle_from_vibration(
        samples,
        rate,
        bearing,
        condition.speed_limits,
        condition.phase_orders,
        condition.limits.acceleration,
    )
    return _next(found, rotation, status)


def _next(found: FoundRotation, rotation: Rotation | None, status: str) -> FoundRotation:
    """Return what was found after another source was tried; without an angle, the first reason stays."""
    if rotation is None and found.status not in (None, "none"):
        return found
    return replace(found, rotation=rotation, status=status)


def pulses_of(block: Block, tacho: TachoSettings) -> Repaired | None:
    """Return the repaired pulses of a block, or None where it has no source of pulses."""
    if block.pulses is not None:
        marks = block.pulses.per_revolution or tacho.per_revolution
        return repaired(block.pulses.times, block.duration, marks, _missing(tacho, marks))
    row = _row(block, tacho.channel)
    if row is None:
        return None
    marks = block.pulses_per_revolution or tacho.per_revolution
    times = edge_times(row, block.rate, tacho.level, falling=tacho.edge == "falling")
    second = _row(block, tacho.channel_b)
    wrong = 0
    if second is not None:
        other_way = directions(times, second, block.rate)
        wrong = int(np.count_nonzero(other_way))
        if wrong > _WRONG_WAY * times.size:
            return Repaired("reversed")
        times = times[~other_way]
    found = repaired(times, block.duration, marks, _missing(tacho, marks), resolution=1.0 / block.rate)
    return replace(found, extra=found.extra + wrong)


def _missing(tacho: TachoSettings, marks: int) -> int:
    """Return the missing teeth of the configured wheel; none where the source states another wheel."""
    return tacho.missing_teeth if marks == tacho.per_revolution else 0


def _row(block: Block, channel: str | None) -> NDArray[np.floating] | None:
    """Return the samples of a channel, shape (sample,), or None where the block does not have it."""
    return block.samples[block.channels.index(channel)] if channel in block.channels else None


def _of_pulses(
    pulses: Repaired, duration: float, ratio: float, encoder: EncoderState | None, learn: bool
) -> FoundRotation:
    counts = PulseCounts(pulses.missing, pulses.extra)
    if pulses.train is None:
        return FoundRotation(None, pulses.status, counts, pulses)
    error = None
    if encoder is not None:
        encoder, reading = encoder_step(encoder, pulses.train, learn=learn)
        error = reading.error
        if error is not None and reading.rms is not None:
            counts = replace(counts, encoder_error=2.0 * math.pi * reading.rms)
    found = FoundRotation(None, "irregular", counts, pulses, encoder, error)
    try:
        rotation = rotation_of(pulses.train, duration, ratio, error, slips=pulses.slips)
    except ValueError:  # The spline turns back between two pulses.
        return found
    return replace(found, rotation=rotation, status="ok")
