"""Mutated files: what becomes of them, by format.

Run as ``python -m benchmarks.fuzz [--quick] [--json FILE]``: 1000 (quick: 100) mutated files of each binary format go
through the readers as in a recording; the table counts the verdicts and how often the parser's process died. A file
that is ``read`` was damaged where nothing checks: in its samples, or in bytes without meaning. ``slowest_s`` is the
longest time from one verdict to the next, that of starting a new child process included.
"""

from __future__ import annotations

import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

from benchmarks.common import arguments, print_table, write_json
from streams.block import Block
from streams.open import open_source
from streams.spec import ChannelSpec, SourceSpec
from tests.faults.test_fuzz import BINARY, mutate
from tests.streams.format_makers import MAKERS, RATE, signal

SEED = 1000
_COUNTED = (
    "read",
    "incomplete",
    "unreadable",
    "refused",
    "empty",
    "wrong_shape",
    "wrong_rate",
    "nan",
    "reader_crashed",
)

Row = dict[str, float | str | None]


def fuzz(name: str, count: int) -> Row:
    """Mutate one kind of file ``count`` times and count the verdicts."""
    whole, rng = MAKERS[name](signal(2, 600)), np.random.default_rng(SEED + BINARY.index(name))
    channel = ChannelSpec("a", column=2 if name in ("x.npy", "x.wav", "x.flac") else "acc_2", unit="g", scale=1.0)
    verdicts: Counter[str] = Counter()
    slowest = 0.0
    with tempfile.TemporaryDirectory() as folder:
        for number in range(count):
            (Path(folder) / f"{number:05d}_{name}").write_bytes(mutate(whole, rng))
        last = time.perf_counter()
        for item in open_source(SourceSpec("fuzz", f"folder:{folder}", block_s="file", rate=RATE, channels=(channel,))):
            verdicts["read" if isinstance(item, Block) else item.status] += 1
            slowest, last = max(slowest, time.perf_counter() - last), time.perf_counter()
    others = sum(verdicts.values()) - sum(verdicts[status] for status in _COUNTED)
    counts: Row = {status: verdicts[status] for status in _COUNTED}
    return {"file": name, "files": sum(verdicts.values()), **counts, "other": others, "slowest_s": slowest}


def main() -> None:
    """Print the table and write it where asked."""
    options = arguments("Mutated files: what becomes of them.")
    rows = [fuzz(name, 100 if options.quick else 1000) for name in BINARY]
    print_table("verdicts on mutated files", rows)
    write_json(options.json, {"fuzz": rows})


if __name__ == "__main__":
    main()
