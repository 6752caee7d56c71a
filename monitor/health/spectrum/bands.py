"""Find a band to demodulate in, for rigs whose resonance nobody knows (``band_hz = "auto"``).

The recordings of a learning window are cut into candidate bands, a tree of halves and thirds of the range up to the
Nyquist frequency, each overlapping its neighbour by half. In the range where the lines of the bearing can stand, two
things are asked of the envelope of a band: how deep the periodic modulations are, and how far they stand above the
noise. Only impulsive bands count (spectral kurtosis): a pair of steady tones beats as periodically as a bearing does,
but its envelope is not impulsive. Which periods modulate is not asked: a band chosen because it shows one family of
lines best would make that family look like a fault in a healthy machine.

Healthy recordings often have no such band; then it is the widest one above the lines of the shaft and of the races,
which misses no resonance. Medians over blocks and segments keep a single burst from choosing the band.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.health.spectrum.comb import MIN_FLOOR_BINS, noise_floor
from monitor.health.spectrum.indicators import sample_range
from monitor.health.spectrum.plans import envelope_length
from monitor.health.spectrum.transform import Band, band_bins, fast_length

_PARTS = (2, 3, 4, 6, 8, 12)
_TOP = 0.98
_LINES = 5.0
_LEAST_WIDTH = 6.0
_LINE_OVER_FLOOR = 12.0
_LEAST_KURTOSIS = 0.5
_SEGMENT = 0.25
_MAX_SAMPLES = 2_000_000
ENOUGH_VOTES = 20
"""Blocks that decide. They are the first ones, in which the bearing runs in and nothing is learned yet: the choice
looks at no later block, and costs the learning of the baseline no time."""


@dataclass(frozen=True)
class BandScore:
    """What a candidate band is worth.

    Attributes:
        band: (lo, hi), Hz.
        depth: root of the sum of squares of the modulation depths of the lines that stand above the noise.
        contrast: sum over those lines of their power over the floor's.
        kurtosis: <|z|^4>/<|z|^2>^2 - 2 of the analytic signal z: 0 in Gaussian noise, negative for tones.
        score: contrast * depth * k / (1 + k) with k the positive part of the kurtosis: the candidate with the highest
            is the best.
    """

    band: Band
    depth: float
    contrast: float
    kurtosis: float
    score: float


def find_band(blocks: Sequence[NDArray[np.number]], rate: float, fundamentals: Mapping[str, float]) -> Band:
    """Return the band to demodulate, chosen on these blocks alone; the same blocks give the same band.

    Args:
        blocks: the learning window (or a single recording), each (n_samples,) of the same length.
        rate: sampling rate, Hz.
        fundamentals: first line of each fault family, Hz.

    Raises:
        ValueError: as ``rank_bands``.
    """
    ranked = rank_bands(blocks, rate, fundamentals)
    best = max(ranked, key=lambda candidate: candidate.score)
    return best.band if best.score > 0.0 and best.kurtosis >= _LEAST_KURTOSIS else ranked[0].band


def rank_bands(
    blocks: Sequence[NDArray[np.number]], rate: float, fundamentals: Mapping[str, float]
) -> tuple[BandScore, ...]:
    """Return all candidate bands with their scores, the widest first.

    Args:
        blocks: each (n_samples,) of the same length; of very many, some two million samples are used, evenly spread.
        rate: sampling rate, Hz.
        fundamentals: first line of each fault family, Hz.

    Raises:
        ValueError: if there is no block, their lengths differ, a sample is not finite, or the rate is too low to
            demodulate five harmonics of the highest fundamental anywhere.
    """
    if not blocks:
        raise ValueError("no block to find a band from")
    if len({block.shape for block in blocks}) > 1:
        raise ValueError(f"blocks of different lengths: {sorted({block.size for block in blocks})}")
    n_used = fast_length(blocks[0].size)
    stride = max(1, math.ceil(len(blocks) * n_used / _MAX_SAMPLES))
    # Odd strides keep clear of alternating machine states.
    chosen = blocks[:: stride + 1 - stride % 2] if stride > 1 else blocks
    spectra = [_spectrum(block[:n_used]) for block in chosen]
    races = [fundamentals[fault] for fault in fundamentals if fault != "cage"]
    return tuple(
        _score(spectra, n_used, rate, band, (0.8 * min(races), (_LINES + 0.1) * max(races)))
        for band in candidate_bands(rate, max(races))
    )


def candidate_bands(rate: float, highest: float) -> tuple[Band, ...]:
    """Return the candidates: the whole range first, then halves, thirds, quarters, sixths, eighths and twelfths.

    Each is at least six times as wide as the ``highest`` fundamental (Hz), so that its envelope holds five harmonics,
    and begins above the fifth harmonic itself, where shafts and races are heard directly.

    Raises:
        ValueError: if not even the whole range is that wide.
    """
    nyquist = 0.5 * rate
    lowest, top, least = float(_LINES * highest), float(_TOP * nyquist), float(_LEAST_WIDTH * highest)
    if top - lowest < least:
        raise ValueError(
            f"a rate of {rate:g} Hz leaves no band of {least:g} Hz between {lowest:g} and {top:g} Hz: "
            "it is too low for five harmonics of the fault frequencies"
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
    """Unnormalised transform of a block in units of its own range, in single precision."""
    low, high = sample_range(x)
    unit = high - low if high > low else 1.0
    return np.fft.rfft(((x - float(x.mean())) / unit).astype(np.float32))


def _score(
    spectra: Sequence[NDArray[np.complexfloating]], n_used: int, rate: float, band: Band, lines: tuple[float, float]
) -> BandScore:
    """Score one band over all blocks."""
    resolution = rate / n_used
    first, last = band_bins(band, n_used, rate)
    length = envelope_length(last - first + 1, n_used, 2.0)
    low = max(2, round(lines[0] / resolution))
    high = min(math.ceil(lines[1] / resolution), last - first, length // 2)
    n_segments = max(1, int(n_used / rate / max(_SEGMENT, 16.0 / lines[0])))
    hann = (0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)).astype(np.float32)
    powers, kurtoses = [], []
    for spectrum in spectra:
        analytic = np.fft.ifft(spectrum[first : last + 1], length, norm="forward")
        envelope = np.abs(analytic)
        mean = float(envelope.mean())
        if mean == 0.0:
            continue
        envelope /= np.float32(mean)
        square = np.square(envelope[: length - length % n_segments]).reshape(n_segments, -1)
        kurtoses.extend(np.mean(np.square(square), axis=1) / np.mean(square, axis=1) ** 2 - 2.0)
        amplitude = np.abs(np.fft.rfft((envelope - np.float32(1.0)) * hann)[low:high]) * (4.0 / length)
        powers.append(np.square(amplitude))
    if not powers or high - low < 8:
        return BandScore(band, 0.0, 0.0, 0.0, 0.0)
    power = np.median(powers, axis=0).astype(np.float64) if len(powers) > 2 else np.mean(powers, axis=0)
    floor = noise_floor(power, MIN_FLOOR_BINS)
    stands_out = power > floor * (1.0 + _LINE_OVER_FLOOR / math.sqrt(len(powers)))
    excess = np.where(stands_out, power - floor, 0.0)
    depth = math.sqrt(float(excess.sum()) / 1.5)
    contrast = float(np.divide(excess, floor, out=np.zeros_like(floor), where=floor > 0.0).sum())
    kurtosis = float(np.median(kurtoses))
    impulsive = max(kurtosis, 0.0)
    return BandScore(band, depth, contrast, kurtosis, contrast * depth * impulsive / (1.0 + impulsive))


@dataclass(frozen=True)
class BandVotes:
    """How many blocks found each band the best.

    Attributes:
        counts: (lo, hi) in Hz and the number of blocks that chose it, in the order in which they were first chosen.
    """

    counts: tuple[tuple[Band, int], ...] = ()

    @property
    def total(self) -> int:
        """How many blocks have voted."""
        return sum(count for _, count in self.counts)

    @property
    def enough(self) -> bool:
        """Whether enough blocks have voted."""
        return self.total >= ENOUGH_VOTES

    def add(self, samples: NDArray[np.floating], rate: float, fundamentals: Mapping[str, float]) -> BandVotes:
        """Return the votes with that of one more block: the band that would be chosen on it alone."""
        choice = find_band([samples], rate, fundamentals)
        counts = dict(self.counts)
        counts[choice] = counts.get(choice, 0) + 1
        return BandVotes(tuple(counts.items()))

    def best(self) -> Band:
        """Return the band with most votes, of equals the widest.

        Raises:
            ValueError: if nobody has voted.
        """
        if not self.counts:
            raise ValueError("no block has voted for a band")
        return max(self.counts, key=lambda item: (item[1], item[0][1] - item[0][0]))[0]

    def to_dict(self) -> dict[str, Any]:
        """Return the votes as plain values for JSON."""
        return {"counts": [[list(band), count] for band, count in self.counts]}

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> BandVotes:
        """Return what :meth:`to_dict` gave."""
        counts: Sequence[Any] = stored["counts"]
        return cls(tuple(((float(low), float(high)), int(count)) for (low, high), count in counts))
