"""Lost samples that were filled with a constant: 0, the last value, the mean, any other.

Neighbours are equal by chance, too: with a share p of them, of which the steps to the next value tell (twice p are up
or down by one), runs of n hold n p^(n-1) of the samples. And where a signal turns slowly, runs of one value begin and
end at a neighbouring value. Runs that were filled are longer or more than chance gives, and at both ends of one the
signal jumps over values that it has elsewhere. Values are counted by rank, so that steps need not be equal (text of few
digits, float16, mu-law). Of a signal of few values nothing can be told, nor of runs at the ends of a block alone.

Measured by ``benchmarks/onset/filled.py``; docs/reference/statuses.md has what follows.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

MIN_SHARE = 0.002
"""From this share of samples on, those of a block count as filled. There H_or of a signal with a strong tone, and RMS
of one about another level than the constant, begin to change by more than they scatter; that of noise, by 0.1 %."""
_PROBES = 2048
_MIN_RUN, _MAX_RUN = 3, 40
_MIN_LEVELS = 24
_BY_CHANCE = (3e-3, 1e-5)
"""Largest shares of the samples that runs of the lengths that are counted may hold by chance: short ones, long ones."""
_TIMES_CHANCE, _MORE_RUNS, _UNLIKELY = 4.0, 6, 1e-3
"""Runs count where their share is so many times that by chance, and their number so much more; or where the longest is
expected less often than this in a block."""
_MAX_STEP = 2
"""Ranks by which a signal that turns slowly leaves a run."""
_ABRUPT = 0.25
"""Least share of the samples in runs that is in runs with a jump at both ends."""
_RAIL, _APART = 0.005, 0.2
"""A run this near to an extreme, in spans, is clipped, unless there are no samples up to so far from it."""


def filled_runs(samples: NDArray[np.floating], low: float, high: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the runs of samples that were filled: their first ones, and those behind them; none below ``MIN_SHARE``.

    Args:
        samples: shape (sample,), finite.
        low: least of them.
        high: largest of them.
    """
    none = np.empty(0, np.intp), np.empty(0, np.intp)
    if not _may_be_filled(samples):
        return none
    begins, ends = _runs(samples)
    if (ends - begins).sum() < MIN_SHARE * samples.size:
        return none
    levels = np.unique(samples)
    kept = ~_at_rails(samples[begins], levels, low, high)
    begins, ends = begins[kept], ends[kept]
    inside = (begins > 0) & (ends < samples.size)
    sizes, rank = ends - begins, np.searchsorted(levels, samples[begins])
    before = np.abs(np.searchsorted(levels, samples[np.maximum(begins - 1, 0)]) - rank)
    behind = np.abs(np.searchsorted(levels, samples[np.minimum(ends, samples.size - 1)]) - rank)
    abrupt = ((before > _MAX_STEP) | (begins == 0)) & ((behind > _MAX_STEP) | (ends == samples.size))
    chance = _chance(samples, levels)
    for by_chance in _BY_CHANCE:
        length = next((n for n in range(_MIN_RUN, _MAX_RUN) if n * chance ** (n - 1) <= by_chance), _MAX_RUN)
        long = sizes >= length
        if _exceed_chance(sizes[long & abrupt & inside], int(sizes[long & inside].sum()), length, chance, samples.size):
            found = long & (abrupt | inside)
            return begins[found], ends[found]
    return none


def _exceed_chance(abrupt: NDArray[np.intp], total: int, length: int, chance: float, size: int) -> bool:
    """Return whether a block has more or longer runs than chance gives.

    Args:
        abrupt: samples of each run with a jump at both ends, shape (run,).
        total: samples of all runs.
        length: least of a run that is counted.
        chance: share of samples that equal the next one by chance.
        size: of the block.
    """
    expected = size * chance ** (length - 1)
    if not abrupt.size or abrupt.sum() < max(MIN_SHARE * size, _TIMES_CHANCE * length * expected, _ABRUPT * total):
        return False
    return bool(
        size * chance ** float(abrupt.max() - 1) < _UNLIKELY or abrupt.size >= _TIMES_CHANCE * expected + _MORE_RUNS
    )


@lru_cache(maxsize=8)
def _probes(size: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return random places in a block, and those behind them: a constant step might be that of the gaps."""
    places = np.sort(np.random.default_rng(size).integers(1, size - 2, _PROBES))
    return places, places + 1


def _may_be_filled(samples: NDArray[np.floating]) -> bool:
    """Return False where no or few samples equal the next one, or most values are equal.

    Of blocks with 0.2 % filled, at most 1 in 14 is missed; with 0.5 %, 1 in 900.
    """
    if samples.size > 4 * _PROBES:
        first, second = _probes(samples.size)
        hits = first[samples.take(first) == samples.take(second)]
        if not hits.size or not np.any((samples[hits - 1] == samples[hits]) | (samples[hits + 2] == samples[hits])):
            return False
    same = samples[1:] == samples[:-1]
    if np.count_nonzero(same[1:] & same[:-1]) * _MIN_RUN < MIN_SHARE * samples.size:
        return False
    return np.unique(samples[:: max(1, samples.size // _PROBES)]).size >= _MIN_LEVELS


def _runs(samples: NDArray[np.floating]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return begins and ends of runs of one value."""
    changes = np.flatnonzero(samples[1:] != samples[:-1]) + 1
    begins, ends = np.concatenate(([0], changes)), np.concatenate((changes, [samples.size]))
    kept = ends - begins >= _MIN_RUN
    return begins[kept], ends[kept]


def _chance(samples: NDArray[np.floating], levels: NDArray[np.floating]) -> float:
    """Return the share of samples that equal the next one by chance, by the steps to the next value up or down."""
    places = np.arange(0, samples.size - 1, max(1, samples.size // 4096))
    steps = np.abs(np.searchsorted(levels, samples[places + 1]) - np.searchsorted(levels, samples[places]))
    changed = np.count_nonzero(steps)
    return 0.5 * (np.count_nonzero(steps == 1) + 1) / changed if changed else 1.0


def _at_rails(values: NDArray[np.floating], levels: NDArray[np.floating], low: float, high: float) -> NDArray[np.bool]:
    """Return which values are those of a clipped signal: near an extreme to which it comes close."""
    span = float(high) - float(low)
    bottom, top = low + _RAIL * span, high - _RAIL * span
    above, below = levels[levels > bottom], levels[levels < top]
    at_bottom = (values <= bottom) & bool(above.size and above[0] - low < _APART * span)
    at_top = (values >= top) & bool(below.size and high - below[-1] < _APART * span)
    return at_bottom | at_top
