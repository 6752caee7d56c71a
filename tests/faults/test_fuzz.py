"""Mutated files: no crash of this process, no hang, and each ends in a verdict."""

from __future__ import annotations

import os
from collections import Counter

import numpy as np
import pytest

from streams.files.container import content_hash
from streams.files.parse.child import shared_process
from streams.link.wire import WireError, decode_frame
from streams.open import open_source
from streams.types.block import Block, Rejected
from streams.types.spec import ChannelSpec, SourceSpec
from tests.streams.format_makers import MAKERS, RATE, signal
from tests.support.effort import effort_count
from tests.support.fuzz import BINARY, COLUMN_OF, mutate, mutated_frames

VERDICTS = {
    "empty", "short", "nan", "out_of_range", "wrong_rate", "wrong_shape", "wrong_unit", "unreadable", "incomplete",
    "refused", "reader_crashed",
}  # fmt: skip


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
