"""Combs of harmonics in a spectrum, and the noise floor under them.

A spectrum is prepared once (:func:`line_spectrum`): its power, the local noise floor, and the excess of each bin over
the floor. Every search for lines reads it: the fault families of the features, the naming with its rivals, and the
estimate of the speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.floor import MIN_FLOOR_BINS, noise_floor

HANN_POWER = 1.5
"""Sum of the squares of the Hann bins of a unit line (its equivalent noise bandwidth, in bins)."""
MOST_OF_ONE_LINE = 4.0
"""The highest line of a comb counts in its depth as at most this many times the others together: one line that
happens to stand at a harmonic of a fault frequency is no comb."""
_INDEPENDENT_BINS = 2.87
"""Independent bins among five neighbouring ones of a Hann-windowed spectrum."""
NEAR_BINS = np.arange(-2, 3)
"""Bins about a line that count to it."""


@dataclass(frozen=True, eq=False)
class FaultLines:
    """The harmonics of one fault frequency in one spectrum; arrays of shape (n_harmonics,).

    Attributes:
        amplitude: amplitude of each line in the unit of the spectrum; noise adds to it in power. 0 where unresolved.
        floor: what noise alone reads in the same measure (root mean square); 0 where unresolved.
        resolved: whether the spectrum can show the line: inside it, and apart from its neighbours by four bins or more.
        fundamental: frequency at which the comb stands, Hz.
        speed_factor: that frequency over the nominal one, common to all lines; 1 where none is resolved.
        at_edge: whether the search ended at its limit: the line that it follows may stand outside.
        comb_score: sum of the excess over the lines, as the search maximises it.
        score: root mean square of ``snr`` over the resolved lines; 0 where there is none.
        threshold: the score that noise exceeds with the stated false-alarm probability, the search included.
        power, noise: power of each line and of the noise under it beside the harmonics of the shaft: what stands at
            one of them is no evidence of the bearing. None: as ``amplitude`` and ``floor`` say.
        n_averages: spectra averaged in power.
    """

    amplitude: NDArray[np.float64]
    floor: NDArray[np.float64]
    resolved: NDArray[np.bool_]
    fundamental: float
    speed_factor: float = 1.0
    at_edge: bool = False
    comb_score: float = 0.0
    score: float = 0.0
    threshold: float = math.inf
    power: NDArray[np.float64] | None = None
    noise: NDArray[np.float64] | None = None
    n_averages: int = 1

    @property
    def detected(self) -> bool:
        """Whether ``score`` exceeds ``threshold``."""
        return self.score > self.threshold

    @property
    def total(self) -> float:
        """Sum of the amplitudes (Eq. 96 for the first five lines of the envelope), in the unit of the spectrum."""
        return float(self.amplitude.sum())

    @property
    def snr(self) -> NDArray[np.float64]:
        """Amplitude of each line over its floor; 0 where unresolved."""
        return np.divide(self.amplitude, self.floor, out=np.zeros_like(self.amplitude), where=self.floor > 0.0)

    @property
    def family_snr(self) -> float:
        """Root sum of squares of the amplitudes over that of the floors; 0 where no line is resolved."""
        noise = float(np.square(self.floor).sum())
        return math.sqrt(float(np.square(self.amplitude).sum()) / noise) if noise > 0.0 else 0.0

    @property
    def depth(self) -> float:
        """Root sum of squares of the lines beside those of the shaft, the power of the noise taken off.

        The highest line counts as at most ``MOST_OF_ONE_LINE`` times the others. In the unit of the spectrum; in a
        spectrum of the envelope over its mean it is a modulation depth.
        """
        power, noise = self._evidence
        return float(comb_depth(power - noise))

    @property
    def depth_error(self) -> float:
        """Standard deviation of ``depth`` due to the noise under the lines, which averaging lowers.

        The noise adds its own scatter and the product of line and noise. Where there is no depth, it is the depth of
        noise that is one standard deviation above its mean.
        """
        power, noise = self._evidence
        lines = np.maximum(power - noise, 0.0)
        variance = float((noise * (noise + 2.0 * lines)).sum()) / (_INDEPENDENT_BINS * self.n_averages)
        depth = self.depth
        scatter = math.sqrt(variance)
        return scatter / (2.0 * depth) if depth * depth > scatter else math.sqrt(scatter)

    @property
    def _evidence(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        if self.power is None or self.noise is None:
            return np.square(self.amplitude), np.square(self.floor)
        return self.power, self.noise

    def scaled(self, factor: float) -> FaultLines:
        """Return the lines of the same spectrum in a unit of which one is ``factor`` of the present unit."""
        power, noise = (None if value is None else value * factor**2 for value in (self.power, self.noise))
        return replace(self, amplitude=self.amplitude * factor, floor=self.floor * factor, power=power, noise=noise)


def comb_depth(lines: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the depth of combs from the power of their lines without noise, shape (line, ...) to (...).

    Negative powers, of lines below the floor, take off what noise added to the others. The highest line counts as at
    most ``MOST_OF_ONE_LINE`` times the root sum of squares of the others.
    """
    highest = lines.max(axis=0)
    others = np.maximum(lines.sum(axis=0) - highest, 0.0)
    return np.sqrt(others + np.minimum(np.maximum(highest, 0.0), MOST_OF_ONE_LINE**2 * others))


def combs_depth(
    spectrum: LineSpectrum, bins: NDArray[np.intp], counted: NDArray[np.bool_] | None = None
) -> NDArray[np.float64]:
    """Return the depth of combs whose lines stand at such bins, of those counted, shape (harmonic, comb) to (comb,).

    As :attr:`FaultLines.depth`; what lies beyond the spectrum adds nothing.
    """
    net = spectrum.power - spectrum.floor
    if spectrum.beside is not None:
        net *= spectrum.beside
    net = np.pad(net, 3)
    near = np.minimum(bins[:, :, None] + (NEAR_BINS + 3), net.size - 1)
    lines = net.take(near).sum(axis=2) / HANN_POWER
    return comb_depth(lines if counted is None else lines * counted)


RELATIVE_FLOOR = 3e-4
"""Lowest floor, relative to the highest line of the spectrum: below it stand aliases of the envelope and roundings."""
EXCESS_CAP = 6.0
"""What a line adds to a comb score above this counts a tenth only: a comb is several lines, not one tall one. It still
counts, or the sidebands of severe damage would reach the score of its own lines."""
GRID_STEP = 0.25
"""Step of the fundamentals of a grid, in bins of the highest harmonic."""
_BEYOND_CAP = 0.1
_WIDEST_SHAFT_LINE = 0.1
_KEPT_GRID_LINES = 50_000


@dataclass(frozen=True, eq=False)
class LineSpectrum:
    """A spectrum prepared for the search of lines; arrays of shape (bin,).

    Attributes:
        resolution: spacing of the bins, Hz; bin 0 stands at 0 Hz.
        power: square of the amplitude.
        floor: local mean power of the noise, at least the square of ``RELATIVE_FLOOR`` of the highest bin.
        excess: ln(1 + power / floor); what exceeds ``EXCESS_CAP`` counts a tenth; 0 in the first two bins.
        sought: the excess in which families are sought: without the bins at harmonics of the shaft.
        beside: 0 in the bins of the harmonics of a shaft that was found in the signal, else 1; None where none was.
        floor_bins: bins from which each value of the floor was taken.
        n_averages: spectra averaged in power.
    """

    resolution: float
    power: NDArray[np.float64]
    floor: NDArray[np.float64]
    excess: NDArray[np.float64]
    sought: NDArray[np.float64]
    beside: NDArray[np.float64] | None
    floor_bins: int
    n_averages: int

    def comb_scores(self, excess: NDArray[np.float64], grid: CombGrid) -> NDArray[np.float64]:
        """Return the sum of an excess over the harmonics of each fundamental of a grid, shape (line,)."""
        if grid.bins[-1, -1] < excess.size:
            return excess.take(grid.bins).sum(axis=0)
        # What lies beyond the spectrum adds nothing.
        beyond = np.append(excess, 0.0)
        return beyond.take(np.minimum(grid.bins, excess.size)).sum(axis=0)


@dataclass(frozen=True, eq=False)
class CombGrid:
    """Candidate fundamentals and where their harmonics stand.

    Attributes:
        lines: (line,) fundamentals, Hz, rising.
        bins: (harmonic, line) the nearest bin of each harmonic.
    """

    lines: NDArray[np.float64]
    bins: NDArray[np.intp]


def comb_grid(lowest: float, highest: float, resolution: float, n_harmonics: int = 5) -> CombGrid:
    """Return fundamentals (Hz) so close that the highest harmonic moves by a quarter of a bin.

    Small grids are kept: while a speed stands still, each block asks for the same ones.
    """
    step = GRID_STEP * resolution / n_harmonics
    count = max(2, math.ceil((highest - lowest) / step) + 1)
    make = _kept_grid if count <= _KEPT_GRID_LINES else _make_grid
    return make(lowest, highest, resolution, count, n_harmonics)


def _make_grid(lowest: float, highest: float, resolution: float, count: int, n_harmonics: int) -> CombGrid:
    lines = np.linspace(lowest, highest, count)
    orders = np.arange(1.0, n_harmonics + 1.0)
    return CombGrid(lines, np.rint(np.multiply.outer(orders, lines / resolution)).astype(np.intp))


_kept_grid = lru_cache(maxsize=16)(_make_grid)


def line_spectrum(
    amplitude: NDArray[np.floating], resolution: float, *, speed: float | None = None, n_averages: int = 1
) -> LineSpectrum:
    """Prepare a spectrum for the search of lines.

    Args:
        amplitude: (bin,) single-sided amplitude spectrum of the Hann-windowed signal, bin 0 at 0 Hz.
        resolution: spacing of its bins, Hz.
        speed: stated shaft speed, Hz: the floor is taken over two shaft frequencies, and families are sought beside the
            harmonics of the shaft. None: over the least width, and everywhere.
        n_averages: how many spectra were averaged in power; noise is smoother then, and thresholds are lower.

    Raises:
        ValueError: if the spectrum is not one-dimensional, or a number is outside its range.
    """
    if amplitude.ndim != 1 or amplitude.size < 2:
        raise ValueError(f"expected a spectrum of shape (bin,) of at least 2 bins, got shape {amplitude.shape}")
    if not (resolution > 0.0 and math.isfinite(resolution)):
        raise ValueError(f"resolution must be positive and finite, got {resolution!r} Hz")
    if n_averages < 1:
        raise ValueError(f"n_averages must be at least 1, got {n_averages}")
    power = np.square(amplitude, dtype=np.float64)
    width = MIN_FLOOR_BINS if speed is None else max(MIN_FLOOR_BINS, 2 * round(speed / resolution) + 1)
    width = min(width, power.size)
    least = max(RELATIVE_FLOOR**2 * float(power.max()), np.finfo(np.float64).tiny)
    floor = np.maximum(noise_floor(amplitude, width, n_averages), least)
    excess = power / floor
    excess += 1.0
    np.log(excess, out=excess)
    np.minimum(excess, (1.0 - _BEYOND_CAP) * EXCESS_CAP + _BEYOND_CAP * excess, out=excess)
    excess[:2] = 0.0
    # At six bins a shaft turn or less, the lines of the shaft cannot be told from the rest.
    beside_shaft = speed is not None and speed > 6.0 * resolution
    sought = excess * _beside_shaft(excess.size, resolution, speed) if beside_shaft else excess
    return LineSpectrum(resolution, power, floor, excess, sought, None, width, n_averages)


@lru_cache(maxsize=16)
def _beside_shaft(n_bins: int, resolution: float, speed: float) -> NDArray[np.float64]:
    """Return 0 in the bins of the harmonics of the shaft at its stated speed, else 1, shape (bin,)."""
    orders = np.arange(n_bins) * (resolution / speed)
    distance = np.abs(orders - np.rint(orders)) * speed
    return (distance >= max(1.5 * resolution, 0.01 * speed)).astype(np.float64)


def beside_shaft(spectrum: LineSpectrum, speed: float, sd: float) -> LineSpectrum:
    """Return a spectrum in which families are sought beside the harmonics of a shaft whose speed is known.

    A line of constant frequency reaches two bins to either side; ``sd`` (Hz) is the standard deviation of the speed.
    Lines of the bearing that come close to a harmonic are broader, because the elements slip.
    """
    resolution = spectrum.resolution
    orders = np.arange(spectrum.power.size) * (resolution / speed)
    nearest = np.rint(orders)
    distance = np.abs(orders - nearest) * speed
    reach = np.minimum(2.0 * resolution + sd * nearest, _WIDEST_SHAFT_LINE * speed)
    beside = (distance > reach - 1e-6 * resolution).astype(np.float64)
    return replace(spectrum, sought=spectrum.excess * beside, beside=beside)


def over_shaft(spectrum: LineSpectrum, speed: float) -> LineSpectrum:
    """Return a spectrum without the lines of the shaft in which what exceeds them at their harmonics counts again.

    Each harmonic counts as far as it exceeds the two on either side: few turns do not separate a comb at three times
    the shaft from it, but only lines of the comb stand above their neighbours. The first two harmonics, where a shaft
    itself is strongest, never count.
    """
    if spectrum.beside is None:
        raise ValueError("expected a spectrum beside the lines of the shaft, got one in which they count")
    nearest = np.rint(np.arange(spectrum.power.size) * (spectrum.resolution / speed)).astype(np.intp)
    at = spectrum.beside == 0.0
    heights = np.zeros(int(nearest[-1]) + 1)
    np.maximum.at(heights, nearest[at], spectrum.power[at])
    padded = np.pad(heights, 2)
    own = np.max([padded[k : k + heights.size] for k in (0, 1, 3, 4)], axis=0)
    shares = np.clip(1.0 - own / np.maximum(heights, np.finfo(np.float64).tiny), 0.0, 1.0)
    shares[:3] = 0.0
    beside = np.where(at, shares[nearest], 1.0)
    return replace(spectrum, sought=spectrum.excess * beside, beside=beside)
