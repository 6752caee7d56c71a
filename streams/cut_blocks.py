"""What a block that was cut is called, known by and dated: one rule, for a followed folder and for a recording."""

from __future__ import annotations

from streams.block import Block, Rejected
from streams.reblock import Cut, samples_hash


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
