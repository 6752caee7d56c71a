"""Makers and checks that tests of fuzz share."""

from __future__ import annotations

import struct

import numpy as np
from google_crc32c import value as crc32c

from streams.link.wire import block_frame, encode_frame
from streams.types.block import Block
from tests.streams.format_makers import MAKERS, RATE, signal

BINARY = [name for name in MAKERS if name != "x.csv"]


COLUMN_OF: dict[str, int | str] = dict.fromkeys(("x.npy", "x.wav", "x.flac"), 2)


"""The second channel by number where the format has no names, else by ``acc_2``."""


_NUMBERS = (
    0,
    1,
    0x7F,
    0x80,
    0xFF,
    0x7FFF,
    0xFFFF,
    0x7FFFFFFF,
    0x80000000,
    0xFFFFFFFF,
    1 << 40,
    (1 << 63) - 1,
    (1 << 64) - 1,
)


def mutate(data: bytes, rng: np.random.Generator) -> bytes:
    """Damage a file in one of the ways that find most: in its head, by telling numbers, by cutting and repeating."""
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 6))):
        # Half of the damage goes to the first kilobyte, where the formats keep their structure.
        reach = min(len(changed), 1024) if rng.random() < 0.5 else len(changed)
        if not reach:
            break
        place = int(rng.integers(reach))
        kind = int(rng.integers(6))
        if kind == 0:
            changed[place] = int(rng.integers(256))
        elif kind == 1:
            changed[place] ^= 1 << int(rng.integers(8))
        elif kind == 2:
            width, form = ((2, "H"), (4, "I"), (8, "Q"))[int(rng.integers(3))]
            number = _NUMBERS[int(rng.integers(len(_NUMBERS)))] & ((1 << 8 * width) - 1)
            changed[place : place + width] = struct.pack(("<", ">")[int(rng.integers(2))] + form, number)
        elif kind == 3:
            del changed[place : place + int(rng.integers(1, 64))]
        elif kind == 4:
            begin = int(rng.integers(len(changed)))
            changed[place:place] = changed[begin : begin + int(rng.integers(1, 256))]
        else:
            del changed[place:]
    return bytes(changed)


def mutated_frames(count: int, seed: int = 0) -> list[bytes]:
    """Return damaged frames, half of them with the right checksum."""
    rng = np.random.default_rng(seed)
    samples = signal(2, 600).astype(np.float32)
    whole = encode_frame(block_frame(Block(samples, RATE, ("a", "b"), ("g", "g"), "s", 1, "1", start=1.7e9)))
    frames = []
    for number in range(count):
        body = mutate(whole[:-4], rng)
        frames.append(body + struct.pack("<I", crc32c(body)) if number % 2 else body + whole[-4:])
    return frames
