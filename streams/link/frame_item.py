"""From a frame of samples, and that of its pulses, to a block or its rejection."""

from __future__ import annotations

from dataclasses import replace

from streams.files.load import agreed_rate, choose_channels
from streams.files.pulse_times import fitting_pulses
from streams.link.pulse_frame import Held
from streams.link.wire import Frame
from streams.reblock import samples_hash
from streams.types.block import Block, Rejected
from streams.types.samples import ReaderError, Samples
from streams.types.spec import SourceSpec


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
