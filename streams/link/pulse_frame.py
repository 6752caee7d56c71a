"""Frames of version 2: the times of the pulses of a block, sent before the frame of its samples.

The layout is that of a frame of samples, with one channel of float64: times in s from the first sample of the block.
"""

from __future__ import annotations

import json
import struct
from collections import OrderedDict
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from streams.files.judge import agreed_rate
from streams.files.load import choose_channels
from streams.files.pulse_times import checked_pulses, fitting_pulses
from streams.link.header import WireError, header_of, per_revolution_of
from streams.link.wire import (
    FRAME_MAGIC,
    HEAD,
    PULSES,
    UNDATED,
    Frame,
    block_frame,
    encode_frame,
    frame_length,
    sealed,
    whole_frame,
)
from streams.reblock import samples_hash
from streams.turns.pulses import Pulses
from streams.types.block import Block, Rejected
from streams.types.samples import ReaderError, Samples
from streams.types.spec import MAX_FRAME, SourceSpec


def item_of_frame(spec: SourceSpec, frame: Frame, held: Held | None, name: str, number: int) -> Block | Rejected:
    """Return the block of a frame of samples and its pulses, None where it has none, under a name and a number.

    What does not fit the configuration, or in itself, is a rejection.
    """
    samples = frame.scaled()
    if held is not None:
        samples = replace(samples, pulses=held.frame.pulses)
    digest = samples_hash(samples.values, samples.known_rate, samples.channels, samples.pulses)
    try:
        _check_pulses(frame, held, name)
        chosen = fitting_pulses(_chosen(spec, samples, name), name)
    except ReaderError as error:
        return Rejected(spec.name, number, name, error.status, str(error), digest)
    return chosen.block(spec.name, number, name, digest, chosen.elapsed)


def _check_pulses(frame: Frame, held: Held | None, name: str) -> None:
    """Raise ReaderError where pulses are wrong in themselves, or not those that the frame of samples states."""
    if held is None:
        return
    if held.frame.problem is not None:
        raise ReaderError(held.frame.problem.status, f"{name}: {held.frame.problem}")
    count = held.frame.pulses.times.size
    if frame.pulses != count:
        stated = "no pulses" if frame.pulses is None else f"pulses = {frame.pulses}"
        raise ReaderError("wrong_shape", f"{name}: {count} pulses came before a frame that states {stated}")


def _chosen(spec: SourceSpec, samples: Samples, name: str) -> Samples:
    """Return the samples of the configured channels; a frame may hold more."""
    unstated = replace(samples, units=("unknown",) * len(samples.units))
    chosen = choose_channels(unstated, spec.channels, None, name)
    units: list[str | None] = []
    for channel, column, unit in zip(chosen.channels, chosen.columns, chosen.units, strict=True):
        stated = samples.units[column - 1]
        wanted = unit if spec.channels and unit != "unknown" else stated
        if stated not in ("unknown", wanted):
            reason = f"{name}: channel {channel}: the frame is in {stated}, unit = {wanted!r}"
            raise ReaderError("wrong_unit", reason)
        units.append(wanted)
    return replace(chosen, units=tuple(units), rate=agreed_rate((samples.rate,), spec.rate, name))


_FLOAT64 = 4
_MAX_HELD = 32
"""Frames of pulses of a stream that wait for their samples; the oldest go first."""


@dataclass(frozen=True, eq=False)
class PulseFrame:
    """The pulses of a block, by its number; ``problem``: what is wrong with them though the checksum is right."""

    sequence: int
    pulses: Pulses
    problem: WireError | None = None


def encode_pulses(sequence: int, rate: float, pulses: Pulses) -> bytes:
    """Return the frame of the pulses of a block.

    Raises:
        WireError: it breaks a limit of the protocol.
    """
    header = {} if pulses.per_revolution is None else {"pulses_per_revolution": pulses.per_revolution}
    text = json.dumps(header, separators=(",", ":")).encode()
    try:
        head = HEAD.pack(*(FRAME_MAGIC, PULSES, 1, sequence, rate, pulses.times.size, _FLOAT64, UNDATED, len(text)))
    except struct.error as error:
        raise WireError(f"the frame cannot be written: {error}") from None
    frame_length(head)
    data = sealed(head + text + np.ascontiguousarray(pulses.times, dtype="<f8").tobytes())
    problem = decode_pulses(data).problem
    if problem is not None:
        raise problem
    return data


def decode_pulses(data: bytes | bytearray | memoryview, limit: int = MAX_FRAME) -> PulseFrame:
    """Return the frame of pulses in bytes from magic to checksum; rate and start are not looked at.

    Raises:
        WireError: as :func:`streams.link.wire.whole_frame`; where only the content is wrong, it is the ``problem``.
    """
    view = whole_frame(data, PULSES, limit)
    _, _, channels, sequence, _, count, kind, _, json_length = HEAD.unpack_from(view)
    empty = Pulses(np.empty(0))
    try:
        if channels != 1 or kind != _FLOAT64:
            raise WireError(f"pulses are one channel of float64 (4), got {channels} of type {kind}", "wrong_shape")
        revolution = per_revolution_of(header_of(bytes(view[HEAD.size : HEAD.size + json_length])))
        times = np.frombuffer(view, "<f8", count, HEAD.size + json_length).astype(np.float64)
        return PulseFrame(sequence, checked_pulses(times, revolution, "the frame of pulses"))
    except (WireError, ReaderError) as error:
        return PulseFrame(sequence, empty, WireError(str(error), error.status, sequence))


def block_frames(block: Block, after: int | None = None) -> tuple[bytes, ...]:
    """Return the frames of a block in the order in which they are sent: that of its pulses, if any, and its samples.

    Raises:
        WireError: one of them breaks a limit of the protocol.
    """
    samples = encode_frame(block_frame(block, after))
    if block.pulses is None:
        return (samples,)
    return encode_pulses(block.sequence, block.rate, block.pulses), samples


@dataclass(frozen=True, eq=False)
class Held:
    """Pulses that wait for their samples; size of their frame in bytes, and what the transport acknowledges it by."""

    frame: PulseFrame
    size: int
    token: Any = None


class HeldPulses:
    """The frames of pulses of one stream whose samples have not come, by number.

    ``spent`` collects the tokens of those that are not waited for any more.
    """

    def __init__(self) -> None:
        """Begin empty."""
        self._held: OrderedDict[int, Held] = OrderedDict()
        self.spent: list[Any] = []

    def put(self, held: Held) -> None:
        """Hold a frame in place of an earlier one of its number; the oldest give way where there are too many."""
        self._drop(held.frame.sequence)
        self._held[held.frame.sequence] = held
        while len(self._held) > 1 and (len(self._held) > _MAX_HELD or self._bytes() > MAX_FRAME):
            self._drop(next(iter(self._held)))

    def get(self, number: int) -> Held | None:
        """Return the pulses of a number, or None."""
        return self._held.get(number)

    def take(self, number: int) -> Held | None:
        """Return the pulses of a number and hold them no longer."""
        return self._held.pop(number, None)

    def _drop(self, number: int) -> None:
        dropped = self._held.pop(number, None)
        if dropped is not None and dropped.token is not None:
            self.spent.append(dropped.token)

    def _bytes(self) -> int:
        return sum(held.size for held in self._held.values())
