"""Chunks of WAV files: where the samples begin, and where they end; also of RF64 and BW64, with their 64-bit sizes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from streams.types.large import Data

_MAGICS = (b"RIFF", b"RIFX", b"RF64", b"BW64")
_LARGE = (b"RF64", b"BW64")
_MAX_CHUNKS = 10_000
_MAX_TAIL_BYTES = 1 << 20
_LARGEST = 2**64 - 1
_LEAST_OPEN = 0x7FFFEF00
_OPEN = (0xFFFFFFFF, 0x80000000, 0x7FFFFFFF, 0x7FFFF000)
"""Sizes that writers to a pipe state, which never come back to the header; the other one is at least the one above."""


@dataclass(frozen=True)
class WavSizes:
    """What the header of a WAV file states.

    Attributes:
        whole: bytes of the file; None where the header leaves it open.
        begin: place of the first sample; None where the file ends before its samples.
        samples: bytes of the samples; None where the header leaves it open.
    """

    whole: int | None
    begin: int | None
    samples: int | None


def wav_sizes(data: Data) -> WavSizes | None:
    """Return what the header of a WAV file states, None for another file."""
    magic = data[:4]
    if magic not in _MAGICS or data[8:12] not in (b"WAVE", b""):
        return None
    riff = _number(data, 4, 4, magic)
    large: tuple[int, int] | None = None
    whole = None if riff in (0, *_OPEN) else riff + 8
    position = 12
    for _ in range(_MAX_CHUNKS):
        if position + 8 > len(data):
            break
        kind, size = data[position : position + 4], _number(data, position + 4, 4, magic)
        if kind == b"ds64" and magic in _LARGE:
            large = _number(data, position + 8, 8, magic), _number(data, position + 16, 8, magic)
            whole = None if large[0] in (0, _LARGEST) else large[0] + 8
        if kind == b"data":
            begin = position + 8
            if large is not None:
                # Of an open one libsndfile gives no samples.
                return WavSizes(whole, begin, 0 if large[1] == _LARGEST else large[1])
            numbers = [number for number in (riff, size) if number]
            is_open = any(number in _OPEN for number in numbers) and min(numbers) >= _LEAST_OPEN
            return WavSizes(None, begin, None) if is_open and size else WavSizes(whole, begin, size)
        position += 8 + size + size % 2
    return WavSizes(whole, None, None)


def is_open_wav(data: Data) -> bool:
    """Return whether the header of a WAV file leaves open where its samples end: nothing tells whether they are all."""
    sizes = wav_sizes(data)
    return sizes is not None and sizes.begin is not None and sizes.samples is None


def end_of_samples(data: Data, begin: int) -> int:
    """Return where samples of open length end: at the chunks that fill the rest of the file, else at its end.

    A chunk has a name of four printable characters and a size that leads to the next one, or to the end.
    """
    start = begin + max(0, len(data) - begin - _MAX_TAIL_BYTES) // 2 * 2
    tail = data[start:]
    chunks: list[tuple[np.ndarray, np.ndarray]] = []
    for phase in (0, 2):
        words = np.frombuffer(tail[phase : phase + (len(tail) - phase) // 4 * 4], np.uint8).reshape(-1, 4)
        if len(words) > 1:
            sizes = words[1:].copy().view(">u4" if data[:4] == b"RIFX" else "<u4")[:, 0].astype(np.int64)
            places = start + phase + 4 * np.arange(len(sizes))
            named = ((words[:-1] >= 0x20) & (words[:-1] <= 0x7E)).all(axis=1)
            chunks.append((places[named], (places + 8 + sizes + sizes % 2)[named]))
    end = len(data)
    while True:
        # A list holds chunks that end where it does: the first that leads there is the list.
        last = (end, end + 1) if end == len(data) else (end,)
        found = [int(places[leads][0]) for places, ends in chunks if (leads := np.isin(ends, last)).any()]
        if not found:
            return end
        end = min(found)


def _number(data: Data, place: int, width: int, magic: bytes) -> int:
    return int.from_bytes(data[place : place + width], "big" if magic == b"RIFX" else "little")
