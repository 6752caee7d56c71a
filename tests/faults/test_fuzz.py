"""Mutated files: no crash of this process, no hang, and each ends in a verdict."""

from __future__ import annotations

import os
import struct
from collections import Counter

import numpy as np
import pytest
from google_crc32c import value as crc32c

from streams.block import Block, Rejected
from streams.digest import content_hash
from streams.link.wire import WireError, block_frame, decode_frame, encode_frame
from streams.open import open_source
from streams.readers.child import shared_process
from streams.spec import ChannelSpec, SourceSpec
from tests.streams.format_makers import MAKERS, RATE, signal
from tests.support.effort import effort_count

BINARY = [name for name in MAKERS if name != "x.csv"]
COLUMN_OF: dict[str, int | str] = dict.fromkeys(("x.npy", "x.wav", "x.flac"), 2)
"""The second channel by number where the format has no names, else by ``acc_2``."""
VERDICTS = {
    "empty", "short", "nan", "out_of_range", "wrong_rate", "wrong_shape", "wrong_unit", "unreadable", "incomplete",
    "refused", "reader_crashed",
}  # fmt: skip
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


@pytest.mark.parametrize("name", MAKERS)
def test_mutated_files_end_in_a_verdict(name: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    count = effort_count(quick=110, full=11_000) // len(MAKERS) + 1
    folder = tmp_path_factory.mktemp("fuzz")
    whole = MAKERS[name](signal(2, 600))
    rng = np.random.default_rng([*BINARY, "x.csv"].index(name))
    # Some damage gives the same bytes twice, or none; these copies would be duplicates.
    damaged: set[bytes] = set()
    while len(damaged) < count:
        damaged |= {mutate(whole, rng)} - {whole}
    for number, data in enumerate(sorted(damaged, key=content_hash)):
        (folder / f"{number:04d}_{name}").write_bytes(data)
    (folder / f"9999_{name}").write_bytes(whole)
    channel = ChannelSpec("a", column=COLUMN_OF.get(name, "acc_2"), unit="g", scale=1.0)
    items = list(open_source(SourceSpec("s", f"folder:{folder}", block_s="file", rate=RATE, channels=(channel,))))
    assert len(items) == count + 1
    rejected = Counter(item.status for item in items if isinstance(item, Rejected))
    assert set(rejected) <= VERDICTS
    assert all(item.reason and len(item.reason) < 2000 for item in items if isinstance(item, Rejected))
    # The file behind all the damaged ones is read as if nothing had been.
    last = items[-1]
    assert isinstance(last, Block)
    np.testing.assert_allclose(last.samples[0], signal(2, 600)[1], atol=1e-9)
    assert shared_process().pid != os.getpid()


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


def test_mutated_frames_are_decoded_or_refused_in_words() -> None:
    verdicts: Counter[str] = Counter()
    longest = 0
    for frame in mutated_frames(effort_count(quick=200, full=2000)):
        try:
            decode_frame(frame)
            verdicts["read"] += 1
        except WireError as error:
            verdicts[error.status] += 1
            longest = max(longest, len(str(error)))
    assert verdicts["read"] > 0
    assert verdicts["unreadable"] > 0
    assert 0 < longest < 2000
