# pyright: reportMissingTypeStubs=false
"""Combs of harmonics in a spectrum, and the noise floor under them.

A spectrum is prepared once (:func:`line_spectrum`): its power, the local noise floor, and the excess of each bin over
the floor. Every search for lines reads it: the fault families of the features, the naming with its rivals, and the
estimate of the speed. The lines of a family are sought with one common speed factor: rolling elements slip, and the
stated speed is never exact, but the fifth harmonic is always five times the first.

An amplitude is the root of the sum of squares over five Hann bins, divided by sqrt(1.5): right within 4 % wherever
between two bins the line stands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from models.numerics import f_quantile, gamma_quantile

HANN_POWER = 1.5
"""Sum of the squares of the Hann bins of a unit line (its equivalent noise bandwidth, in bins)."""

FALSE_ALARM = 1e-4
"""Probability that pure noise is called detected, for one family in one spectrum; ``fault_lines`` sets its threshold by
it. ``python -m benchmarks.features`` measures the rate on white noise.
"""

RELATIVE_FLOOR = 3e-4
"""Lowest floor, relative to the highest line of the spectrum: below it stand aliases of the envelope and roundings."""

MIN_FLOOR_BINS = 65
"""Least width of the windows from which the floor is taken."""

LINE_OVER_FLOOR = 8.0
"""Bins above this many times the first estimate of the floor are lines and take no part in the second."""

EXCESS_CAP = 6.0
"""What a line adds to a comb score above this counts a tenth only: a comb is several lines, not one tall one. It still
counts, or the sidebands of severe damage would reach the score of its own lines."""

SEARCH = 0.02
"""Half width of the search for the common speed factor: slip and nominal speeds are up to 2 % off."""

_BEYOND_CAP = 0.1
_FLOOR_EFFICIENCY = 0.35
_GRID_STEP = 0.25
_FINE = np.linspace(-1.0, 1.0, 41)
_NEAR = np.arange(-2, 3)[:, None, None]
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
        floor_bins: bins from which each value of the floor was taken.
        n_averages: spectra averaged in power.
    """

    resolution: float
    power: NDArray[np.float64]
    floor: NDArray[np.float64]
    excess: NDArray[np.float64]
    sought: NDArray[np.float64]
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
    step = _GRID_STEP * resolution / n_harmonics
    count = max(2, math.ceil((highest - lowest) / step) + 1)
    make = _kept_grid if count <= _KEPT_GRID_LINES else _make_grid
    return make(lowest, highest, resolution, count, n_harmonics)


def _make_grid(lowest: float, highest: float, resolution: float, count: int, n_harmonics: int) -> CombGrid:
    lines = np.linspace(lowest, highest, count)
    orders = np.arange(1.0, n_harmonics + 1.0)
    return CombGrid(lines, np.rint(np.multiply.outer(orders, lines / resolution)).astype(np.intp))


_kept_grid = lru_cache(maxsize=16)(_make_grid)


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
        """Root sum of squares of the amplitudes, the power of the noise taken off, in the unit of the spectrum.

        In a spectrum of the envelope over its mean it is a modulation depth.
        """
        power = np.square(self.amplitude).sum() - np.square(self.floor).sum()
        return math.sqrt(max(float(power), 0.0))

    def scaled(self, factor: float) -> FaultLines:
        """Return the lines of the same spectrum in a unit of which one is ``factor`` of the present unit."""
        return replace(self, amplitude=self.amplitude * factor, floor=self.floor * factor)


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
    floor = np.maximum(noise_floor(power, width, n_averages), least)
    excess = power / floor
    excess += 1.0
    np.log(excess, out=excess)
    np.minimum(excess, (1.0 - _BEYOND_CAP) * EXCESS_CAP + _BEYOND_CAP * excess, out=excess)
    excess[:2] = 0.0
    # At six bins a shaft turn or less, the lines of the shaft cannot be told from the rest.
    beside_shaft = speed is not None and speed > 6.0 * resolution
    sought = excess * _beside_shaft(excess.size, resolution, speed) if beside_shaft else excess
    return LineSpectrum(resolution, power, floor, excess, sought, width, n_averages)


def noise_floor(power: NDArray[np.float64], width: int, n_averages: int = 1) -> NDArray[np.float64]:
    """Return the local mean power of the noise under the lines, shape (bin,).

    The median of the power in windows that overlap by half, without what stands ``LINE_OVER_FLOOR`` times above a first
    median, joined linearly in log power. The power of a bin of Gaussian noise, averaged over K spectra, has the gamma
    distribution of shape K, whose median is a known part of its mean.

    Args:
        power: (bin,) squared amplitudes.
        width: of a window, in bins.
        n_averages: K.
    """
    windows, middles, bins = _floor_windows(power.size, min(width, power.size))
    rows = power.take(windows)
    rows.sort(axis=1)
    part = _median_of_mean(n_averages)
    first = _row_medians(rows, np.full(len(rows), rows.shape[1]))
    below = np.count_nonzero(rows <= (LINE_OVER_FLOOR / part) * first[:, None], axis=1)
    medians = np.log(np.maximum(_row_medians(rows, below), np.finfo(np.float64).tiny))
    floor = np.interp(bins, middles, medians)
    np.exp(floor, out=floor)
    floor /= part
    return floor


@lru_cache(maxsize=16)
def _floor_windows(n_bins: int, width: int) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.float64]]:
    """Return the bins of each window (window, bin), the middles of the windows, and all bins as numbers."""
    half = max(1, width // 2)
    starts = np.arange(0, max(1, n_bins - width + 1), half)
    if starts[-1] + width < n_bins:
        starts = np.append(starts, n_bins - width)
    windows = starts[:, None] + np.arange(width)
    return windows.astype(np.intp), (starts + half).astype(np.float64), np.arange(n_bins, dtype=np.float64)


@lru_cache(maxsize=256)
def _median_of_mean(n_averages: int) -> float:
    """Return the median of the gamma distribution of this shape over its mean: ln 2 for one spectrum."""
    return gamma_quantile(n_averages, 0.5) / n_averages


def _row_medians(rows: NDArray[np.float64], counts: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return the median of the first ``counts`` values of each sorted row."""
    row = np.arange(len(rows))
    return 0.5 * (rows[row, (counts - 1) // 2] + rows[row, counts // 2])


@lru_cache(maxsize=16)
def _beside_shaft(n_bins: int, resolution: float, speed: float) -> NDArray[np.float64]:
    """Return 0 in the bins of the harmonics of the shaft at its stated speed, else 1, shape (bin,)."""
    orders = np.arange(n_bins) * (resolution / speed)
    distance = np.abs(orders - np.rint(orders)) * speed
    return (distance >= max(1.5 * resolution, 0.01 * speed)).astype(np.float64)


def fault_lines(
    spectrum: LineSpectrum,
    fundamental: float,
    *,
    n_harmonics: int = 5,
    search: float = SEARCH,
    speed_factor: float | None = None,
    false_alarm: float = FALSE_ALARM,
) -> FaultLines:
    """Find the harmonics of one fault frequency.

    Args:
        spectrum: prepared.
        fundamental: nominal frequency of the first harmonic, Hz.
        n_harmonics: how many to seek.
        search: half width of the range of the speed factor.
        speed_factor: take this factor and do not search.
        false_alarm: probability that noise alone is called detected.

    Raises:
        ValueError: if a number is outside its range.
    """
    _check(fundamental, n_harmonics, search, speed_factor, false_alarm)
    spacing = fundamental / spectrum.resolution
    orders = np.arange(1.0, n_harmonics + 1.0)
    half = 2 if spacing >= 8.0 else 1
    widest = 1.0 + (search if speed_factor is None else abs(speed_factor - 1.0))
    resolved = (orders * spacing * widest + 3.0 <= spectrum.power.size - 1) & (spacing >= 4.0)
    if not resolved.any():
        zeros = np.zeros(n_harmonics)
        return FaultLines(zeros, zeros, resolved, fundamental)
    shown = orders[resolved]
    if speed_factor is None:
        factor, at_edge, comb_score = _search(spectrum, spacing, shown, search)
        # The highest line moves by so many bins in all.
        trials = 1.0 + 2.0 * search * spacing * float(shown[-1])
    else:
        factor, at_edge, trials = speed_factor, False, 1.0
        there = np.rint(shown * spacing * factor).astype(np.intp)
        comb_score = float(spectrum.sought[there].sum())
    bins = np.rint(shown * spacing * factor).astype(np.intp)[:, None] + np.arange(-half, half + 1)
    line_power: NDArray[np.float64] = spectrum.power[bins].sum(axis=1) / HANN_POWER
    floor_power: NDArray[np.float64] = spectrum.floor[bins].sum(axis=1) / HANN_POWER
    n_floor = min(shown.size * spectrum.floor_bins, float(bins[-1, -1] - bins[0, 0]) + spectrum.floor_bins)
    return FaultLines(
        _spread(np.sqrt(line_power), resolved),
        _spread(np.sqrt(floor_power), resolved),
        resolved,
        fundamental * factor,
        factor,
        at_edge,
        comb_score,
        score=math.sqrt(float(np.mean(line_power / floor_power))),
        threshold=noise_threshold(shown.size, half, spectrum.n_averages, n_floor, trials, false_alarm),
    )


@lru_cache(maxsize=256)
def noise_threshold(
    n_lines: int, half: int, n_averages: int, n_floor: float, trials: float, false_alarm: float
) -> float:
    """Return the score that the lines of pure noise exceed with the given probability.

    The power of Gaussian noise over the bins of one line is nearly gamma distributed. Neighbouring Hann bins correlate
    by 2/3, next neighbours by 1/6, which leaves 2.87 independent ones of five and 1.81 of three. The floor is itself an
    estimate, as uncertain as the mean of about a third as many independent bins: the ratio of the two has Fisher's
    F distribution. The search is a number of independent trials.

    Args:
        n_lines: lines in the score.
        half: bins on either side of a line that count to it (1 or 2).
        n_averages: spectra averaged in power.
        n_floor: bins that the floors were taken from.
        trials: number of independent places that the search has looked at.
        false_alarm: probability for all trials together.
    """
    n_bins = 2 * half + 1
    covariance = n_bins + 2.0 * (n_bins - 1) * (2.0 / 3.0) ** 2 + 2.0 * (n_bins - 2) * (1.0 / 6.0) ** 2
    freedom_lines = 2.0 * n_lines * n_averages * n_bins**2 / covariance
    freedom_floor = 2.0 * max(n_floor, 4.0) * n_averages * _FLOOR_EFFICIENCY
    quantile = 1.0 - false_alarm / max(trials, 1.0)
    return math.sqrt(f_quantile(freedom_lines, freedom_floor, quantile))


def _check(fundamental: float, n_harmonics: int, search: float, speed_factor: float | None, false_alarm: float) -> None:
    if not (fundamental > 0.0 and math.isfinite(fundamental)):
        raise ValueError(f"fundamental must be positive and finite, got {fundamental!r} Hz")
    if n_harmonics < 1:
        raise ValueError(f"n_harmonics must be at least 1, got {n_harmonics}")
    if not (0.0 <= search < 0.5 and 0.0 < false_alarm < 1.0):
        raise ValueError(f"need 0 <= search < 0.5 and 0 < false_alarm < 1, got {search} and {false_alarm}")
    if speed_factor is not None and not 0.5 < speed_factor < 1.5:
        raise ValueError(f"speed_factor must lie between 0.5 and 1.5, got {speed_factor!r}")


def _spread(values: NDArray[np.float64], resolved: NDArray[np.bool_]) -> NDArray[np.float64]:
    spread = np.zeros(resolved.size)
    spread[resolved] = values
    return spread


def _search(
    spectrum: LineSpectrum, spacing: float, orders: NDArray[np.float64], search: float
) -> tuple[float, bool, float]:
    """Return the speed factor of the highest comb score, whether it is at the edge of the search, and that score.

    The factor is refined to the tops of the lines, within a bin of the highest one. The refinement maximises the sum of
    the lines' heights over their floors: the root of the power around the place, weighted by a parabola that falls to
    zero two bins away, is highest at the centroid of the power, which for a Hann window is the line's place between the
    bins to a thousandth.
    """
    n_harmonics, fundamental = orders.size, spacing * spectrum.resolution
    reach = fundamental * search
    grid = comb_grid(fundamental - reach, fundamental + reach, spectrum.resolution, n_harmonics)
    scores = spectrum.comb_scores(spectrum.sought, grid)
    best = int(np.argmax(scores))
    if scores[best] <= 0.0 or search == 0.0:
        return 1.0, False, float(scores[best])
    coarse = float(grid.lines[best]) / fundamental
    reach = 1.0 / (n_harmonics * spacing)
    factors = np.minimum(np.maximum(coarse + reach * _FINE, 1.0 - search), 1.0 + search)
    places = np.multiply.outer(orders * spacing, factors)
    bins = np.rint(places).astype(np.intp) + _NEAR
    parabola = np.maximum(1.0 - 0.25 * np.square(bins - places), 0.0)
    weight = 1.0 / np.sqrt(spectrum.floor[np.rint(orders * spacing * coarse).astype(np.intp)])
    heights = weight @ np.sqrt((spectrum.power.take(bins) * parabola).sum(axis=0))
    factor = float(factors[int(np.argmax(heights))])
    return factor, search - abs(factor - 1.0) < 0.5 * _GRID_STEP * reach, float(scores[best])
