"""Choice of the band to demodulate where none is configured (``band_hz = "auto"``).

The range up to the Nyquist frequency is divided into candidate bands, a tree of halves and thirds that overlap by half.
In the range of the bearing's lines, the envelope of a band is scored by the depth of its periodic modulations and their
height above the noise. Only impulsive bands count (spectral kurtosis): two steady tones beat as periodically as a
bearing does, but their envelope is not impulsive. The periods themselves are not scored: a band chosen because it shows
one family of lines best would make that family look like a fault in a healthy machine.

Without such a band the widest one above the lines of shaft and races is taken. Medians over blocks and segments keep a
single burst from choosing the band. :class:`BandVotes` makes the choice from a stream, block by block.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.health.codec import StoredState
from monitor.health.signal.floor import MIN_FLOOR_BINS, noise_floor
from monitor.health.signal.indicators import sample_range
from monitor.health.signal.interference import Comb, fixed_combs, remove_lines
from monitor.health.signal.orders import Warp, order_amplitude, warp_of
from monitor.health.signal.plans import envelope_length
from monitor.health.signal.rotation.rotation import Rotation
from monitor.health.signal.transform import Band, band_bins, fast_length

_PARTS = (2, 3, 4, 6, 8, 12)
_TOP_SHARE = 0.98
_LINES = 5.0
_MIN_WIDTH = 6.0
_LINE_OVER_FLOOR = 12.0
_MIN_KURTOSIS = 0.5
_MIN_SEGMENT_S = 0.25
_MAX_SAMPLES = 2_000_000
_SAME_EDGES = 0.1
VOTES_NEEDED = 20
"""Number of first blocks that decide; the bearing runs in, so no block is lost for the baseline."""


@dataclass(frozen=True)
class BandScore:
    """Score of a candidate band.

    Attributes:
        band: (lo, hi), Hz.
        depth: root sum of squares of the modulation depths of the lines above the noise.
        contrast: sum over those lines of their power over the floor.
        kurtosis: <|z|^4>/<|z|^2>^2 - 2 of the analytic signal z: 0 for Gaussian noise, negative for tones.
        score: contrast * depth * k / (1 + k) with k the positive part of the kurtosis.
    """

    band: Band
    depth: float
    contrast: float
    kurtosis: float
    score: float


def find_band(
    blocks: Sequence[NDArray[np.number]],
    rate: float,
    fundamentals: Mapping[str, float],
    interference: Sequence[Comb] = (),
    rotations: Sequence[Rotation | None] = (),
    limit: float = math.inf,
) -> Band:
    """Return the band to demodulate, chosen on these blocks alone.

    Args:
        blocks: each (n_samples,) of the same length.
        rate: sampling rate, Hz.
        fundamentals: first line of each fault family, Hz.
        interference: combs that are removed before; with a rotation, those that do not follow the shaft.
        rotations: angle of the shaft over each block, by which its envelopes are judged; () where none is known. Their
            mean speeds must be that of the fundamentals.
        limit: frequency beyond which the signal holds nothing, Hz.

    Raises:
        ValueError: as ``rank_bands``.
    """
    ranked = _ranked(blocks, rate, fundamentals, interference, rotations, complete=False, limit=limit)
    best = max(ranked, key=lambda candidate: candidate.score)
    return best.band if best.score > 0.0 and best.kurtosis >= _MIN_KURTOSIS else ranked[0].band


def rank_bands(
    blocks: Sequence[NDArray[np.number]],
    rate: float,
    fundamentals: Mapping[str, float],
    rotations: Sequence[Rotation | None] = (),
) -> tuple[BandScore, ...]:
    """Return all candidate bands with their scores, the widest first.

    Args:
        blocks: each (n_samples,) of the same length; at most some two million samples are used, evenly spread.
        rate: sampling rate, Hz.
        fundamentals: first line of each fault family, Hz.
        rotations: as for ``find_band``.

    Raises:
        ValueError: no block, different lengths, a sample that is not finite, or a rate too low to demodulate five
            harmonics of the highest fundamental.
    """
    return _ranked(blocks, rate, fundamentals, (), rotations, complete=True)


def _ranked(
    blocks: Sequence[NDArray[np.number]],
    rate: float,
    fundamentals: Mapping[str, float],
    interference: Sequence[Comb],
    rotations: Sequence[Rotation | None],
    *,
    complete: bool,
    limit: float = math.inf,
) -> tuple[BandScore, ...]:
    """Return all candidates as :func:`rank_bands`; see :func:`_score` for ``complete``."""
    if not blocks:
        raise ValueError("no block to find a band from")
    if len({block.shape for block in blocks}) > 1:
        raise ValueError(f"blocks of different lengths: {sorted({block.size for block in blocks})}")
    n_used = fast_length(blocks[0].size)
    stride = max(1, math.ceil(len(blocks) * n_used / _MAX_SAMPLES))
    # An odd stride does not alias with alternating machine states.
    every = stride + 1 - stride % 2 if stride > 1 else 1
    chosen = blocks[::every]
    given = (rotations or [None] * len(blocks))[::every]
    warps = [None if rotation is None else warp_of(rotation, n_used / rate) for rotation in given]
    spectra = [_spectrum(block[:n_used]) for block in chosen]
    for spectrum, warp in zip(spectra, warps, strict=True):
        combs = interference if warp is None else fixed_combs(interference)
        remove_lines(spectrum, rate / n_used, combs, 0.0, 0.5 * rate)
    races = [fundamentals[fault] for fault in fundamentals if fault != "cage"]
    return tuple(
        _score(spectra, warps, n_used, rate, band, (0.8 * min(races), (_LINES + 0.1) * max(races)), complete)
        for band in candidate_bands(rate, max(races), limit)
    )


def candidate_bands(rate: float, highest: float, limit: float = math.inf) -> tuple[Band, ...]:
    """Return the whole range up to a limit (Hz), then its halves, thirds, quarters, sixths, eighths and twelfths.

    Each is at least six times as wide as the ``highest`` fundamental (Hz), so that its envelope holds five harmonics,
    and begins above the fifth harmonic, below which shafts and races appear directly.

    Raises:
        ValueError: the whole range is narrower than that.
    """
    nyquist = min(0.5 * rate, limit / _TOP_SHARE)
    lowest, top, least = float(_LINES * highest), float(_TOP_SHARE * nyquist), float(_MIN_WIDTH * highest)
    if top - lowest < least:
        what = f"a rate of {rate:g} Hz" if limit >= 0.5 * rate else f"a sensor up to {limit:g} Hz"
        raise ValueError(
            f"{what} leaves no band of {least:g} Hz between {lowest:g} and {top:g} Hz: "
            "that is too low for five harmonics of the fault frequencies"
        )
    bands = [(lowest, top)]
    for parts in _PARTS:
        width = nyquist / parts
        if width < least:
            break
        for i in range(2 * parts - 1):
            lo, hi = max(0.5 * i * width, lowest), min((0.5 * i + 1.0) * width, top)
            if hi - lo >= max(least, 0.75 * width):
                bands.append((lo, hi))
    return tuple(bands)


def _spectrum(x: NDArray[np.number]) -> NDArray[np.complexfloating]:
    """Return the unnormalised transform of a block in units of its own range, in single precision."""
    low, high = sample_range(x)
    unit = high - low if high > low else 1.0
    return np.fft.rfft(((x - float(x.mean())) / unit).astype(np.float32))


def _score(
    spectra: Sequence[NDArray[np.complexfloating]],
    warps: Sequence[Warp | None],
    n_used: int,
    rate: float,
    band: Band,
    lines: tuple[float, float],
    complete: bool,
) -> BandScore:
    """Score one band over all blocks.

    Without ``complete``, depth and contrast are NaN where the kurtosis alone makes the score zero.
    """
    resolution = rate / n_used
    first, last = band_bins(band, n_used, rate)
    length = envelope_length(last - first + 1, n_used, 2.0)
    low = max(2, round(lines[0] / resolution))
    high = min(math.ceil(lines[1] / resolution), last - first, length // 2)
    n_segments = max(1, int(n_used / rate / max(_MIN_SEGMENT_S, 16.0 / lines[0])))
    envelopes: list[tuple[NDArray[np.float32], Warp | None]] = []
    kurtoses: list[float] = []
    for spectrum, warp in zip(spectra, warps, strict=True):
        analytic = np.fft.ifft(spectrum[first : last + 1], length, norm="forward")
        envelope = np.abs(analytic)
        mean = float(envelope.mean())
        if mean == 0.0:
            continue
        envelope /= np.float32(mean)
        square = np.square(envelope[: length - length % n_segments]).reshape(n_segments, -1)
        kurtoses.extend(np.mean(np.square(square), axis=1) / np.mean(square, axis=1) ** 2 - 2.0)
        envelopes.append((envelope, warp))
    if not envelopes or high - low < 8:
        return BandScore(band, 0.0, 0.0, 0.0, 0.0)
    kurtosis = float(np.median(kurtoses))
    if kurtosis <= 0.0 and not complete:
        return BandScore(band, math.nan, math.nan, kurtosis, 0.0)
    hann = (0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)).astype(np.float32)
    powers: list[NDArray[np.float32]] = []
    for envelope, warp in envelopes:
        envelope -= np.float32(1.0)
        if warp is None:
            amplitude = np.abs(np.fft.rfft(envelope * hann)[low:high]) * (4.0 / length)
        else:
            bins = np.fft.rfft(envelope)[: (length + 1) // 2]
            amplitude = order_amplitude(bins, length, warp, high * warp.resolution)[0][low:high]
        powers.append(np.square(amplitude))
    power = np.median(powers, axis=0).astype(np.float64) if len(powers) > 2 else np.mean(powers, axis=0)
    floor = noise_floor(np.sqrt(power), MIN_FLOOR_BINS)
    stands_out = power > floor * (1.0 + _LINE_OVER_FLOOR / math.sqrt(len(powers)))
    excess = np.where(stands_out, power - floor, 0.0)
    depth = math.sqrt(float(excess.sum()) / 1.5)
    contrast = float(np.divide(excess, floor, out=np.zeros_like(floor), where=floor > 0.0).sum())
    impulsive = max(kurtosis, 0.0)
    return BandScore(band, depth, contrast, kurtosis, contrast * depth * impulsive / (1.0 + impulsive))


def _same(one: Band, other: Band) -> bool:
    return max(abs(one[0] - other[0]), abs(one[1] - other[1])) < _SAME_EDGES * (one[1] - one[0])


@dataclass(frozen=True)
class BandVotes(StoredState):
    """How many blocks chose each band.

    Attributes:
        counts: (lo, hi) in Hz and its number of blocks, in the order in which they were first chosen.
    """

    counts: tuple[tuple[Band, int], ...] = ()

    @property
    def total(self) -> int:
        """Number of blocks so far."""
        return sum(count for _, count in self.counts)

    @property
    def enough(self) -> bool:
        """Whether enough blocks have been counted."""
        return self.total >= VOTES_NEEDED

    def add(
        self,
        samples: NDArray[np.floating],
        rate: float,
        fundamentals: Mapping[str, float],
        interference: Sequence[Comb] = (),
        rotation: Rotation | None = None,
        limit: float = math.inf,
    ) -> BandVotes:
        """Return the votes with the choice of one more block; ``limit`` as for ``find_band``.

        Candidates begin at a multiple of the highest fundamental: at other speeds, they count for the band that they
        are but for ``_SAME_EDGES`` of its width.
        """
        choice = find_band([samples], rate, fundamentals, interference, [rotation], limit)
        counts = dict(self.counts)
        if choice not in counts:
            choice = next((band for band in counts if _same(band, choice)), choice)
        counts[choice] = counts.get(choice, 0) + 1
        return BandVotes(tuple(counts.items()))

    def best(self) -> Band:
        """Return the band with most votes, of equals the widest.

        Raises:
            ValueError: there are no votes.
        """
        if not self.counts:
            raise ValueError("no block has voted for a band")
        return max(self.counts, key=lambda item: (item[1], item[0][1] - item[0][0]))[0]
