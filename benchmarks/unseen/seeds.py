"""Seeds of the lives of ``benchmarks.unseen.judge``: ranges that share no life."""

from __future__ import annotations

JUDGED_FIRST_SEED = 2_808_000
"""Lives of the judged score: they are not used in work on the library, and nothing is fitted or chosen on them."""
DEVELOPMENT_FIRST_SEED = 1_808_000
"""Lives of an earlier judged score, whose figures were seen: what is chosen since is chosen on them."""
TEST_FIRST_SEED = 1_908_000
"""Lives with which this code is tried, and on which a baseline is scored."""


def seed_of(*, judged: bool, development: bool) -> int:
    """Return the first seed of the lives that a benchmark is asked for."""
    if judged:
        return JUDGED_FIRST_SEED
    return DEVELOPMENT_FIRST_SEED if development else TEST_FIRST_SEED
