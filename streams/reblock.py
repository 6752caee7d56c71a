"""From samples in pieces of any length to blocks of one length: the same blocks however the samples were cut."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Hashable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from streams.block import Block, Rejected
from streams.blocks import RATE_TOLERANCE, TAIL

_TIME_TOLERANCE = 1e-3


@dataclass(frozen=True, eq=False)
class Chunk:
    """Consecutive samples as they come: a file, what a file has grown by, a frame.

    Attributes:
        samples: shape (channel, sample), float32 or float64.
        rate: sampling rate in Hz.
        channels: name of each row.
        units: unit of each row.
        start: seconds since 1970 UTC of the first sample of the origin, or None.
        origin: what the samples are of, a path or the number of a frame; blocks say how much of it they used.
        offset: index of the first sample in its origin.
        number: place of the origin in a stream without gaps, or None where it has none: what is undated is joined
            where these follow each other.
        elapsed: seconds from the first sample of the source to that of the origin, or None.
        speed, load: shaft speed in Hz and radial load in N that the origin states, or None.
    """

    samples: NDArray[np.floating]
    rate: float
    channels: tuple[str, ...]
    units: tuple[str, ...]
    start: float | None
    origin: Hashable
    offset: int = 0
    number: int | None = None
    elapsed: float | None = None
    speed: float | None = None
    load: float | None = None

    @property
    def end(self) -> int:
        """Index behind the last sample in the origin."""
        return self.offset + self.samples.shape[1]

    def time_of(self, index: int) -> float | None:
        """Return the time of a sample of the origin; it does not depend on how the origin was taken apart."""
        return None if self.start is None else self.start + index / self.rate


@dataclass(frozen=True, eq=False)
class Cut:
    """A block that was cut, or what is left over before a gap.

    Attributes:
        samples: shape (channel, sample), rows contiguous.
        rate, channels, units: as of the chunks.
        start: seconds since 1970 UTC of the first sample, or None.
        used: of each origin that the samples came from, in order, the index behind its last used sample.
        first: origin and index in it of the first sample.
        missing: number of samples that it lacks to be a block, 0 where it is one.
        elapsed: seconds from the first sample of the source, where the first origin knows it, or None.
        speed, load: as the origin of the first sample states them.
    """

    samples: NDArray[np.floating]
    rate: float
    channels: tuple[str, ...]
    units: tuple[str, ...]
    start: float | None
    used: tuple[tuple[Hashable, int], ...]
    first: tuple[Hashable, int]
    missing: int = 0
    elapsed: float | None = None
    speed: float | None = None
    load: float | None = None


class Reblocker:
    """Cuts a stream into blocks of equal length.

    Blocks are counted from the first sample after a gap. Where both neighbours are dated, they are joined if the second
    starts within 1 ms, or half a sample, of where the first ends (stamps are not finer); where neither is, if their
    numbers follow each other; more of the same origin always is. A change of rate (by more than 1e-4 of it), channels,
    units or sample type is a gap.
    What is left over stays until more comes. Before a gap, and on :meth:`flush`, it is a block if it has at least 0.9
    of the length (as in a recording), else it comes with what it lacks, for a rejection ``short``.
    """

    def __init__(self, block_s: float) -> None:
        """Begin empty; ``block_s`` is the length of a block in s."""
        self._block_s = block_s
        self._held: list[Chunk] = []
        self._last: Chunk | None = None
        self._rate = 0.0

    @property
    def held(self) -> int:
        """Number of samples of each channel that wait for more."""
        return sum(chunk.samples.shape[1] for chunk in self._held)

    @property
    def origins(self) -> frozenset[Hashable]:
        """The origins of the samples that wait."""
        return frozenset(chunk.origin for chunk in self._held)

    def feed(self, chunk: Chunk) -> Iterator[Cut]:
        """Take samples and give the blocks that are complete with them.

        Args:
            chunk: the samples that came next.

        Yields:
            What was left over before a gap, then the blocks in order.
        """
        if self._last is not None and not _follows(self._last, chunk):
            yield from self.flush()
        if self._last is None:
            self._rate = chunk.rate
        elif chunk.rate != self._rate:
            # Rates that are computed from stamps differ in the last digits; a run has one.
            chunk = replace(chunk, rate=self._rate)
        self._last = chunk
        if chunk.samples.shape[1]:
            self._held.append(chunk)
        while self.held >= self._length:
            yield self._cut(self._length)

    def flush(self) -> Iterator[Cut]:
        """Give what is left over and begin anew: nothing will follow it."""
        self._last = None
        if self._held:
            yield self._cut(self.held)

    @property
    def _length(self) -> int:
        return max(1, round(self._block_s * self._rate))

    def _cut(self, count: int) -> Cut:
        """Take ``count`` samples from what is held."""
        first = self._held[0]
        parts: list[NDArray[np.floating]] = []
        used: list[tuple[Hashable, int]] = []
        left = count
        while left:
            chunk = self._held.pop(0)
            taken = min(left, chunk.samples.shape[1])
            parts.append(chunk.samples[:, :taken])
            if used and used[-1][0] == chunk.origin:
                used.pop()
            used.append((chunk.origin, chunk.offset + taken))
            left -= taken
            if taken < chunk.samples.shape[1]:
                self._held.insert(0, _rest(chunk, taken))
        samples = np.ascontiguousarray(parts[0]) if len(parts) == 1 else np.concatenate(parts, axis=1)
        missing = self._length - count if count < TAIL * self._length else 0
        return Cut(
            samples=samples,
            rate=first.rate,
            channels=first.channels,
            units=first.units,
            start=first.time_of(first.offset),
            used=tuple(used),
            first=(first.origin, first.offset),
            missing=missing,
            elapsed=None if first.elapsed is None else first.elapsed + first.offset / first.rate,
            speed=first.speed,
            load=first.load,
        )


def _rest(chunk: Chunk, taken: int) -> Chunk:
    return replace(chunk, samples=chunk.samples[:, taken:], offset=chunk.offset + taken)


def _follows(before: Chunk, after: Chunk) -> bool:
    """Tell whether nothing lies between two chunks and both are of one kind."""
    alike = (
        before.channels == after.channels
        and before.units == after.units
        and before.samples.dtype == after.samples.dtype
        and math.isclose(before.rate, after.rate, rel_tol=RATE_TOLERANCE)
    )
    if not alike:
        return False
    if before.origin == after.origin:
        return after.offset == before.end
    end, begin = before.time_of(before.end), after.time_of(after.offset)
    if end is not None and begin is not None:
        return abs(begin - end) <= max(_TIME_TOLERANCE, 0.5 / before.rate)
    if end is not None or begin is not None or before.number is None or after.number is None:
        return False
    return after.number == before.number + 1 and after.offset == 0


def samples_hash(samples: NDArray[np.floating], rate: float, channels: tuple[str, ...]) -> str:
    """Return the digest of a block that was cut from a stream: of its samples, rate and channels, and of nothing else.

    The place in the stream is the block's sequence number; together they are the identity of the block, however the
    samples were cut before.

    Args:
        samples: shape (channel, sample).
        rate: sampling rate in Hz.
        channels: name of each row.
    """
    digest = hashlib.blake2b(digest_size=16)
    digest.update(repr((float(rate), channels, samples.shape, samples.dtype.kind, samples.dtype.itemsize)).encode())
    for row in samples:
        digest.update(np.ascontiguousarray(row, dtype=row.dtype.newbyteorder("<")).data)
    return digest.hexdigest()


def cut_name(file: str, offset: int, rate: float) -> str:
    """Return the name of a block: the file that its first sample is in, and how far into it where it is not the first.

    Args:
        file: path of the file.
        offset: index of the block's first sample in it.
        rate: sampling rate in Hz.
    """
    return f"{file}[{round(offset / rate, 3):.15g} s]" if offset else file


def elapsed_at(start: float | None, elapsed: float | None, began: float | None) -> float | None:
    """Return the seconds from the first sample of the source to that of a block, None where nothing says.

    Args:
        start: seconds since 1970 UTC of the block's first sample, or None.
        elapsed: what the file's own place in the run says, or None.
        began: start of the first dated block of the source, or None where this is it.
    """
    if elapsed is not None or start is None:
        return elapsed
    return 0.0 if began is None else start - began


def began_at(began: float | None, item: Block | Rejected) -> float | None:
    """Return the start of the first dated block of a source.

    Args:
        began: the same before the item came.
        item: the next block or rejection of the source.
    """
    return item.start if began is None and isinstance(item, Block) else began


def cut_item(cut: Cut, source: str, sequence: int, file: str, total: int, began: float | None) -> Block | Rejected:
    """Return the block that was cut, or the rejection ``short`` of what was left over.

    Its content hash is that of its samples, rate and channels; its name says where its first sample was found.

    Args:
        cut: what was cut.
        source: name of the source.
        sequence: 1-based number of the block.
        file: path of the file that the first sample is in.
        total: number of samples of that file.
        began: start of the first dated block of the source, seconds since 1970 UTC, or None.
    """
    offset, length = cut.first[1], cut.samples.shape[1]
    name = cut_name(file, offset, cut.rate)
    digest = samples_hash(cut.samples, cut.rate, cut.channels)
    if cut.missing:
        whole = (length + cut.missing) / cut.rate
        reason = f"{name}: {length / cut.rate:g} s are left, a block has {whole:g} s"
        if length == total and len(cut.used) == 1:
            reason += '; block_s = "file" takes the file as one block'
        return Rejected(source, sequence, name, "short", reason, digest)
    return Block(
        samples=cut.samples,
        rate=cut.rate,
        channels=cut.channels,
        units=cut.units,
        source=source,
        sequence=sequence,
        name=name,
        start=cut.start,
        elapsed=elapsed_at(cut.start, cut.elapsed, began),
        speed=cut.speed,
        load=cut.load,
        content_hash=digest,
    )
