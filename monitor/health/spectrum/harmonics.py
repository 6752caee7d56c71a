"""Amplitudes of a family of harmonics in a spectrum, the noise under them, and whether there is anything at all.

The lines of a family are sought with one common speed factor: rolling elements slip, and the stated speed is never
exact, but the fifth harmonic is always five times the first. The search maximises the sum of the harmonics' heights
over their local noise floors. An amplitude is the root of the sum of squares over five Hann bins, divided by sqrt(1.5):
right within 4 % wherever between two bins the line stands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtri

HANN_POWER = 1.5
"""Sum of the squares of the Hann bins of a unit line (its equivalent noise bandwidth, in bins)."""

FALSE_ALARM = 1e-4
"""Probability that pure noise is called detected, for one family in one spectrum; ``fault_lines`` sets its threshold by
it. Measured on white noise through the whole way by ``python -m benchmarks.features``: 5 of 48,000, where it should be
4.8.
"""

RELATIVE_FLOOR = 3e-4
"""Lowest floor, relative to the highest line of the spectrum: below it stand aliases of the envelope and roundings."""

_COARSE_STEP = 0.25
_FINE_STEPS = 10
_FLOOR_HALF_WIDTH = 200
_FLOOR_LEAST = 32
_FLOOR_EFFICIENCY = 0.35


@dataclass(frozen=True, eq=False)
class FaultLines:
    """The harmonics of one fault frequency in one spectrum; arrays of shape (n_harmonics,).

    Attributes:
        amplitude: amplitude of each line in the unit of the spectrum; noise adds to it in power. 0 where unresolved.
        floor: what noise alone reads in the same measure (root mean square); 0 where unresolved.
        snr: amplitude over floor: about 1 in noise at a given place, more at the place that a search has chosen. The
            floor counts as at least ``RELATIVE_FLOOR`` of the spectrum's highest bin.
        resolved: whether the spectrum can show the line: inside it, and apart from its neighbours by four bins or more.
        speed_factor: found over nominal frequency, common to all lines; 1 where none is resolved.
        at_edge: whether the search ended at its limit: the line that it follows may stand outside.
        score: root mean square of ``snr`` over the resolved lines; 0 where there is none.
        threshold: the score that noise exceeds with the stated false-alarm probability, the search included.
        detected: whether ``score`` exceeds ``threshold``.
    """

    amplitude: NDArray[np.float64]
    floor: NDArray[np.float64]
    snr: NDArray[np.float64]
    resolved: NDArray[np.bool_]
    speed_factor: float
    at_edge: bool
    score: float
    threshold: float
    detected: bool

    @property
    def total(self) -> float:
        """Sum of the amplitudes (Eq. 96 for the first five lines of the envelope), in the unit of the spectrum."""
        return float(self.amplitude.sum())


def fault_lines(
    spectrum_amplitude: NDArray[np.floating],
    resolution: float,
    fundamental: float,
    *,
    n_harmonics: int = 5,
    search: float = 0.02,
    speed_factor: float | None = None,
    n_averages: int = 1,
    false_alarm: float = FALSE_ALARM,
) -> FaultLines:
    """Find the harmonics of one fault frequency.

    Args:
        spectrum_amplitude: (n_bins,) single-sided amplitude spectrum of the Hann-windowed signal, bin 0 at 0 Hz.
        resolution: spacing of its bins, Hz.
        fundamental: nominal frequency of the first harmonic, Hz.
        n_harmonics: how many to seek.
        search: half width of the range of the speed factor.
        speed_factor: take this factor and do not search.
        n_averages: how many spectra were averaged in power; noise is smoother then, and the threshold lower.
        false_alarm: probability that noise alone is called detected.

    Raises:
        ValueError: if the spectrum is not one-dimensional, or a number is outside its range.
    """
    _check(spectrum_amplitude, resolution, fundamental, n_harmonics, search, n_averages, false_alarm)
    if speed_factor is not None and not 0.5 < speed_factor < 1.5:
        raise ValueError(f"speed_factor must lie between 0.5 and 1.5, got {speed_factor!r}")
    spacing = fundamental / resolution
    orders = np.arange(1.0, n_harmonics + 1.0)
    half = 2 if spacing >= 8.0 else 1
    widest = 1.0 + (search if speed_factor is None else abs(speed_factor - 1.0))
    resolved = (orders * spacing * widest + 3.0 <= spectrum_amplitude.size - 1) & (spacing >= 4.0)
    if not resolved.any():
        return _nothing(n_harmonics, resolved)
    top = float(orders[resolved][-1])
    n_needed = min(spectrum_amplitude.size, math.ceil(top * spacing * widest) + _FLOOR_HALF_WIDTH + 2)
    power = np.square(spectrum_amplitude[:n_needed], dtype=np.float64)
    least = (RELATIVE_FLOOR * float(spectrum_amplitude.max())) ** 2
    lines = orders[resolved] * spacing
    factor, at_edge, trials = 1.0, False, 1.0
    if speed_factor is not None:
        factor = speed_factor
    elif least > 0.0:
        floor, _ = _floor_power(power, lines, spacing, half, n_averages)
        factor, at_edge = _search(power, lines, 1.0 / np.maximum(floor, least), search)
        # The highest line moves by so many bins in all.
        trials = 1.0 + 2.0 * search * float(lines[-1])
    line_power = _line_power(power, lines * factor, half)
    floor, n_floor = _floor_power(power, lines * factor, spacing * factor, half, n_averages)
    floor *= (2 * half + 1) / HANN_POWER
    snr_power = line_power / np.maximum(floor, least) if least > 0.0 else np.zeros(lines.size)
    score = math.sqrt(float(snr_power.mean()))
    threshold = noise_threshold(lines.size, half, n_averages, n_floor, trials, false_alarm)
    amplitude, floor, snr = (_spread(np.sqrt(values), resolved) for values in (line_power, floor, snr_power))
    return FaultLines(amplitude, floor, snr, resolved, factor, at_edge, score, threshold, score > threshold)


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
    return math.sqrt(float(fdtri(freedom_lines, freedom_floor, quantile)))


def _check(
    amplitude: NDArray[np.floating],
    resolution: float,
    fundamental: float,
    n_harmonics: int,
    search: float,
    n_averages: int,
    false_alarm: float,
) -> None:
    if amplitude.ndim != 1 or amplitude.size < 2:
        raise ValueError(f"expected a spectrum of shape (n_bins,), n_bins >= 2, got shape {amplitude.shape}")
    if not (resolution > 0.0 and math.isfinite(resolution)):
        raise ValueError(f"resolution must be positive and finite, got {resolution!r} Hz")
    if not (fundamental > 0.0 and math.isfinite(fundamental)):
        raise ValueError(f"fundamental must be positive and finite, got {fundamental!r} Hz")
    if n_harmonics < 1 or n_averages < 1:
        raise ValueError(f"n_harmonics and n_averages must be at least 1, got {n_harmonics} and {n_averages}")
    if not (0.0 <= search < 0.5 and 0.0 < false_alarm < 1.0):
        raise ValueError(f"need 0 <= search < 0.5 and 0 < false_alarm < 1, got {search} and {false_alarm}")


def _nothing(n_harmonics: int, resolved: NDArray[np.bool_]) -> FaultLines:
    zeros = np.zeros(n_harmonics)
    return FaultLines(
        zeros, zeros, zeros, resolved, speed_factor=1.0, at_edge=False, score=0.0, threshold=math.inf, detected=False
    )


def _spread(values: NDArray[np.float64], resolved: NDArray[np.bool_]) -> NDArray[np.float64]:
    spread = np.zeros(resolved.size)
    spread[resolved] = values
    return spread


def _line_power(power: NDArray[np.float64], lines: NDArray[np.float64], half: int) -> NDArray[np.float64]:
    """Squared amplitude of lines at (n_lines,) positions in bins."""
    bins = np.rint(lines).astype(np.intp)[:, None] + np.arange(-half, half + 1)
    return power[bins].sum(axis=1) / HANN_POWER


def _floor_power(
    power: NDArray[np.float64], lines: NDArray[np.float64], spacing: float, half: int, n_averages: int
) -> tuple[NDArray[np.float64], float]:
    """Mean noise power of one bin near each line: the median of the bins around it that are of no line of the family.

    The median of chi-squared noise of 2 K degrees of freedom is its mean times about (1 - 1/(9 K))^3 (Wilson and
    Hilferty). The second result is the number of bins that all lines together looked at.
    """
    reach = int(min(max(0.45 * spacing, _FLOOR_LEAST), _FLOOR_HALF_WIDTH))
    centres = np.rint(lines).astype(np.intp)[:, None]
    bins = centres + np.arange(-reach, reach + 1)
    distance = np.abs(bins - np.rint(bins / spacing) * spacing)
    # With few bins between two lines, the innermost of them are needed although some leakage reaches them.
    usable = (distance > min(half + 1.0, 0.3 * spacing)) & (bins >= 2) & (bins < power.size)
    values = np.where(usable, power[np.clip(bins, 0, power.size - 1)], np.inf)
    values.sort(axis=1)
    count = usable.sum(axis=1)
    middle = np.maximum(count - 1, 0)
    rows = np.arange(lines.size)
    median = 0.5 * (values[rows, middle // 2] + values[rows, (middle + 1) // 2])
    floor = np.where(count > 0, median, 0.0) / (1.0 - 1.0 / (9.0 * n_averages)) ** 3
    span = float(lines[-1] - lines[0]) + 2.0 * reach + 1.0
    return floor, float(count.sum()) * min(1.0, span / usable.size)


def _search(
    power: NDArray[np.float64], lines: NDArray[np.float64], weight: NDArray[np.float64], search: float
) -> tuple[float, bool]:
    """Return the speed factor with the highest sum of line heights over their floors, and whether it is at the limit.

    A height is the root of the power around the place, weighted by a parabola that falls to zero two bins away: it is
    highest at the centroid of the power, which for a Hann window is the line's place between the bins to a thousandth.
    """
    root_weight = np.sqrt(weight)
    around = np.arange(-2, 3)[:, None, None]

    def heights(factors: NDArray[np.float64]) -> NDArray[np.float64]:
        places = lines[:, None] * factors
        bins = np.rint(places).astype(np.intp) + around
        parabola = np.maximum(1.0 - 0.25 * np.square(bins - places), 0.0)
        return root_weight @ np.sqrt((power[bins] * parabola).sum(axis=0))

    n_coarse = max(2, math.ceil(2.0 * search * float(lines[-1]) / _COARSE_STEP))
    coarse = np.linspace(1.0 - search, 1.0 + search, n_coarse + 1)
    best = int(np.argmax(heights(coarse)))
    step = 2.0 * search / n_coarse
    fine = np.clip(coarse[best] + step * np.linspace(-1.0, 1.0, 2 * _FINE_STEPS + 1), 1.0 - search, 1.0 + search)
    factor = float(fine[int(np.argmax(heights(fine)))])
    at_edge = search > 0.0 and search - abs(factor - 1.0) < 0.5 * step
    return factor, at_edge
