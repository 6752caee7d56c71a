"""The vote of the first blocks for a band."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.health.signal.bands import VOTES_NEEDED, BandVotes, candidate_bands, find_band
from monitor.health.signal.features import fundamentals
from reference.signals import RESONANCE, bearing_lines, impacts

RATE = 25600.0
_, LINES = bearing_lines("6205", 30.0)
FAMILIES = fundamentals(LINES)
BANDS = candidate_bands(RATE, max(FAMILIES.values()))


def block(seed: int) -> np.ndarray:
    return impacts(np.random.default_rng(seed), "outer", LINES, duration=0.5, height=15.0).astype(np.float32)


def test_each_block_votes_for_the_band_that_it_alone_would_choose() -> None:
    votes = BandVotes()
    for seed in range(4):
        before = votes
        votes = votes.add(block(seed), RATE, FAMILIES)
        assert votes.total == before.total + 1
        chosen = find_band([block(seed)], RATE, FAMILIES)
        assert dict(votes.counts)[chosen] == dict(before.counts).get(chosen, 0) + 1
    low, high = votes.best()
    assert low < RESONANCE < high


def test_enough_is_enough() -> None:
    votes = BandVotes(((BANDS[1], VOTES_NEEDED - 1),))
    assert not votes.enough
    assert votes.add(block(0), RATE, FAMILIES).enough


@given(st.lists(st.sampled_from(BANDS[:8]), min_size=1, max_size=30))
def test_the_band_with_most_votes_wins_of_equals_the_widest(chosen: list[tuple[float, float]]) -> None:
    counts: dict[tuple[float, float], int] = {}
    for band in chosen:
        counts[band] = counts.get(band, 0) + 1
    best = BandVotes(tuple(counts.items())).best()
    most = max(counts.values())
    assert counts[best] == most
    assert best[1] - best[0] == max(high - low for (low, high), count in counts.items() if count == most)


def test_nobody_has_voted() -> None:
    assert not BandVotes().enough
    with pytest.raises(ValueError, match="no block has voted"):
        BandVotes().best()


@given(st.lists(st.tuples(st.sampled_from(BANDS), st.integers(1, 30)), unique_by=lambda item: item[0]))
def test_votes_come_back_from_json(counts: list[tuple[tuple[float, float], int]]) -> None:
    votes = BandVotes(tuple(counts))
    assert BandVotes.from_dict(json.loads(json.dumps(votes.to_dict()))) == votes
