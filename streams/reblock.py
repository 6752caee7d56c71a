"""Cut samples that come in pieces into blocks of one length, whatever the pieces."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from streams.turns.pulses import BlockRevolutions, Pulses
from streams.types.block import Block, Rejected
from streams.types.large import forget_pages
from streams.types.samples import RATE_TOLERANCE, Origin, ReaderError, Samples
from streams.types.times import MIN_TIME, TimeStatement

MIN_BLOCK_SHARE = 0.9
"""A last block of at least this part of the full length is kept."""

_TIME_TOLERANCE_S = 1e-3

PlaceTime = Callable[[int, float], tuple[float | None, float] | None]
"""Gives start and elapsed time of a block by number and length, see :meth:`streams.dates.dater.Dater.place_time`."""


@dataclass(frozen=True, eq=False)
class Cut:
    """A block that was cut, or what is left over before a gap.

    ``samples`` have origin, offset, speed and load of the first piece; ``used`` has for each origin, in order, the
    index behind its last used sample; ``missing`` is the number of samples short of a block, 0 where it is one.
    """

    samples: Samples
    used: tuple[tuple[Hashable, int], ...]
    missing: int = 0


@dataclass(frozen=True, eq=False)
class HeldSamples:
    """What a :class:`Reblocker` holds, so that another one goes on.

    Attributes:
        pieces: samples that wait for more, in order.
        last: the latest samples without their values, which the next ones may continue; None at a gap.
        rate: of the block under way, Hz.
    """

    pieces: tuple[Samples, ...]
    last: Samples | None
    rate: float


class Reblocker:
    """Cuts a stream into blocks of equal length, or of so many turns of the shaft.

    Blocks are counted from the first sample after a gap. More of the same origin is joined; other samples are if both
    are dated and they start within 1 ms, or half a sample, of the end of those before (stamps are not finer). A change
    of rate (by more than 1e-4 of it), channels, units or sample type is a gap. What is left over stays until more
    comes. Before a gap, and on :meth:`flush`, it is a block if it has at least 0.9 of the length, else it comes with
    what it lacks, for a rejection ``short``.

    Where turns count, a block is the first ``block_s`` seconds of what is held, or less where these hold its turns: so
    the pieces do not matter here either. Of what is left over then, 0.9 of the turns are a block as well.
    """

    def __init__(self, block_s: float, turns: BlockRevolutions | None = None) -> None:
        """Begin empty; ``block_s`` is the length of a block in s, of the longest where ``turns`` count."""
        self._block_s, self._turns = block_s, turns
        self._held: list[Samples] = []
        self._last: Samples | None = None
        self._rate = 0.0

    @property
    def held(self) -> int:
        """Number of samples of each channel that wait for more."""
        return sum(piece.values.shape[1] for piece in self._held)

    @property
    def origins(self) -> frozenset[Hashable]:
        """The origins of the samples that wait."""
        return frozenset(piece.origin for piece in self._held)

    def held_samples(self) -> HeldSamples:
        """Return what it holds."""
        last = self._last
        if last is not None:
            last = last.changed(values=last.values[:, :0], offset=last.end, pulses=None)
        return HeldSamples(tuple(self._held), last, self._rate)

    def restore(self, held: HeldSamples) -> None:
        """Go on where another one stood."""
        self._held, self._last, self._rate = [*held.pieces], held.last, held.rate

    def feed(self, samples: Samples) -> Iterator[Cut]:
        """Take the next samples; yield what a gap leaves over, then the complete blocks."""
        if self._last is not None and not _follows(self._last, samples):
            yield from self.flush()
        if self._last is None:
            self._rate = samples.known_rate
        elif samples.rate != self._rate:
            # Rates that are computed from stamps differ in the last digits; a run has one.
            samples = samples.changed(rate=self._rate)
        self._last = samples
        if samples.values.shape[1]:
            self._held.append(samples)
        while self.held >= self._length:
            yield self._cut(self._end_by_turns(self._length) or self._length)

    def flush(self) -> Iterator[Cut]:
        """Yield what is left over and begin anew: nothing follows it."""
        self._last = None
        while self._turns is not None and self._held and (end := self._end_by_turns(self.held)) is not None:
            yield self._cut(end)
        if self._held:
            enough = self._turns is not None and self._turns.is_enough(self._counted(self.held))
            yield self._cut(self.held, whole=enough or self.held >= MIN_BLOCK_SHARE * self._length)

    @property
    def _length(self) -> int:
        return max(1, round(self._block_s * self._rate))

    def _end_by_turns(self, count: int) -> int | None:
        """Return the number of samples of the next block by its turns, which ``count`` samples must hold, or None."""
        pulses = None if self._turns is None else self._counted(count)
        return None if self._turns is None or pulses is None else self._turns.end(pulses, self._rate, self._length)

    def _counted(self, count: int) -> Pulses | None:
        """Return the pulses in the next ``count`` samples, from the first of them on; None where none are known."""
        if self._turns is None:
            return None
        rows: list[NDArray[np.floating]] = []
        times: list[Pulses | None] = []
        done = 0
        for piece in self._held:
            taken = min(count - done, piece.values.shape[1])
            if self._turns.channel is not None:
                rows.append(piece.values[piece.channels.index(self._turns.channel), :taken])
            else:
                times.append(self._pulses_of(piece, taken, done))
            done += taken
            if done == count:
                break
        if self._turns.channel is None:
            return _joined(times)
        row = rows[0] if len(rows) == 1 else np.concatenate(rows)
        return Pulses(self._turns.times_in(row, self._rate), self._held[0].pulses_per_revolution)

    def _cut(self, count: int, *, whole: bool = True) -> Cut:
        """Take ``count`` samples from what is held, a ``whole`` block or not."""
        first = self._held[0]
        parts: list[NDArray[np.floating]] = []
        used: list[tuple[Hashable, int]] = []
        times: list[Pulses | None] = []
        left = count
        while left:
            piece = self._held.pop(0)
            taken = min(left, piece.values.shape[1])
            parts.append(piece.values[:, :taken])
            times.append(self._pulses_of(piece, taken, first.offset + count - left))
            if used and used[-1][0] == piece.origin:
                used.pop()
            used.append((piece.origin, piece.offset + taken))
            left -= taken
            if taken < piece.values.shape[1]:
                self._held.insert(0, piece.changed(values=piece.values[:, taken:], offset=piece.offset + taken))
        values = np.ascontiguousarray(parts[0]) if len(parts) == 1 else np.concatenate(parts, axis=1)
        forget_pages(parts[-1])
        missing = 0 if whole else max(1, self._length - count)
        samples = first.changed(values=values, pulses=_joined(times))
        return Cut(samples, tuple(used), missing)

    def _pulses_of(self, piece: Samples, taken: int, place: int) -> Pulses | None:
        """Return the pulses of the first ``taken`` samples of a piece, which stands at a ``place`` after the first one.

        A time is moved once and by whole samples, so that the sum does not depend on how a file came in pieces.
        """
        if piece.pulses is None:
            return None
        pulses = piece.pulses.in_samples(self._rate, piece.offset, piece.offset + taken)
        return pulses.shifted((place - piece.offset) / self._rate)


def _joined(parts: Sequence[Pulses | None]) -> Pulses | None:
    """Return the pulses of pieces that follow each other; None where those of a piece are not known."""
    known = [part for part in parts if part is not None]
    if len(known) < len(parts) or len({part.per_revolution for part in known}) > 1:
        return None
    if len(known) == 1:
        return known[0]
    # The last digit of a time that was moved may put it before one that was not.
    return Pulses(np.maximum.accumulate(np.concatenate([part.times for part in known])), known[0].per_revolution)


def _follows(before: Samples, after: Samples) -> bool:
    """Return whether a piece continues the one before, of one kind and without a gap."""
    alike = (
        before.channels == after.channels
        and before.units == after.units
        and before.values.dtype == after.values.dtype
        and math.isclose(before.known_rate, after.known_rate, rel_tol=RATE_TOLERANCE)
    )
    if not alike:
        return False
    if before.origin == after.origin and before.begin == after.begin:
        return after.offset == before.end
    if not (before.joins and after.joins):
        return False
    end, begin = before.time_of(before.end), after.time_of(after.offset)
    if end is None or begin is None:
        return False
    repeated_s = 0.0 if after.stated is None else after.stated.repeated_s
    # The local hour that occurs twice is read as the first one.
    apart = min(abs(begin - end), abs(begin + repeated_s - end))
    return apart <= max(_TIME_TOLERANCE_S, 0.5 / before.known_rate)


def samples_hash(
    samples: NDArray[np.floating], rate: float, channels: tuple[str, ...], pulses: Pulses | None = None
) -> str:
    """Return the digest of a block cut from a stream.

    It depends on samples (channel, sample), rate in Hz, channels and pulses alone; with its sequence number it
    identifies the block, however the samples were divided before.
    """
    digest = hashlib.blake2b(digest_size=16)
    digest.update(repr((float(rate), channels, samples.shape, samples.dtype.kind, samples.dtype.itemsize)).encode())
    for row in samples:
        digest.update(np.ascontiguousarray(row, dtype=row.dtype.newbyteorder("<")).data)
    if pulses is not None:
        digest.update(repr(("pulses", pulses.times.size, pulses.per_revolution)).encode())
        digest.update(np.ascontiguousarray(pulses.times, dtype="<f8").data)
    return digest.hexdigest()


def name_of_recording(name: str, number: int) -> str:
    """Return the name of a recording by that of its file: ``FILE``, the second one in it ``FILE#2``."""
    return name if number == 1 else f"{name}#{number}"


class Numbering:
    """Makes the blocks and rejections of one source, numbered in order."""

    def __init__(
        self,
        source: str,
        highest: int = 0,
        began: float | None = None,
        place_time: PlaceTime | None = None,
    ) -> None:
        """Continue after the number ``highest``.

        ``began`` is the start of the first dated block of the source, seconds since 1970 UTC, or None. ``place_time``
        dates the blocks that have no time of their own.
        """
        self._source, self.highest, self.began = source, highest, began
        self._place_time = place_time

    def note(self, item: Block | Rejected) -> None:
        """Count an item; the next one has a higher number."""
        self.highest = max(self.highest, item.sequence)
        if self.began is None and isinstance(item, Block) and (item.start or 0.0) >= MIN_TIME:
            self.began = item.start

    def block(self, samples: Samples, name: str, digest: str, number: int | None = None) -> Block:
        """Return the block of all samples, under the next number by default."""
        number = self.highest + 1 if number is None else number
        block = samples.block(self._source, number, name, digest, samples.elapsed_since(self.began))
        if self._place_time is None or block.start is not None or block.elapsed is not None:
            return block
        placed = self._place_time(number, block.duration)
        return (
            block
            if placed is None
            else replace(block, start=placed[0], elapsed=placed[1], stated=TimeStatement("count"))
        )

    def whole(
        self, samples: Samples, name: str, digest: str, number: int | None = None, *, of_several: bool = False
    ) -> Block:
        """Return a file, or one of its several recordings, as one block.

        ``digest`` is that of the file, which may grow by further recordings; so a block of several has that of its own
        samples.
        """
        if not of_several:
            return self.block(samples, name, digest, number)
        own = samples_hash(samples.values, samples.known_rate, samples.channels)
        return self.block(samples, name_of_recording(name, samples.number), own)

    def torn(self, samples: Samples, name: str) -> Iterator[Rejected]:
        """Yield a rejection for each recording of a file that broke off, to be noted before the next."""
        for number, reason in enumerate(samples.torn, len(samples.recordings) + 1):
            yield self.rejected(name_of_recording(name, number), ReaderError("incomplete", reason), "")

    def rejected(self, name: str, error: ReaderError, digest: str, number: int | None = None) -> Rejected:
        """Return a rejection, under the next number by default."""
        number = self.highest + 1 if number is None else number
        # Messages quote what files hold; characters that cannot be printed become question marks.
        reason = "".join(character if character.isprintable() else "?" for character in str(error))
        return Rejected(self._source, number, name, error.status, reason, digest)

    def cut(self, cut: Cut) -> Block | Rejected:
        """Return the block that was cut, or the rejection ``short`` of what is left over.

        Its name states the recording of its first sample, and the time from the start of that where it is not the
        first sample there. Its content hash is :func:`samples_hash`.
        """
        samples, origin = cut.samples, cut.samples.origin
        name, total = (origin.key, origin.total) if isinstance(origin, Origin) else (str(origin), 0)
        rate, length = samples.known_rate, samples.values.shape[1]
        name = name_of_recording(name, samples.number)
        if samples.offset != samples.begin:
            name = f"{name}[{round((samples.offset - samples.begin) / rate, 3):.15g} s]"
        digest = samples_hash(samples.values, rate, samples.channels, samples.block_pulses)
        if not cut.missing:
            return self.block(samples, name, digest)
        reason = f"{name}: {length / rate:g} s are left, a block has {(length + cut.missing) / rate:g} s"
        if length == total and len(cut.used) == 1:
            reason += '; block_s = "file" takes the file as one block'
        return self.rejected(name, ReaderError("short", reason), digest)
