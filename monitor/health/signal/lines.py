# pyright: reportMissingTypeStubs=false
"""The lines of fault families in a spectrum.

The lines of a family are sought with one common speed factor: rolling elements slip, and the stated speed is never
exact, but the fifth harmonic is always five times the first. An amplitude is the root of the sum of squares over five
Hann bins, divided by sqrt(1.5): right within 4 % wherever between two bins the line stands.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from models.words.numerics import f_quantile
from monitor.health.signal.comb import GRID_STEP, HANN_POWER, NEAR_BINS, FaultLines, LineSpectrum, comb_grid

FALSE_ALARM = 1e-4
"""Probability that pure noise is called detected, for one family in one spectrum; ``fault_lines`` sets its threshold by
it. ``python -m benchmarks.features`` measures the rate on white noise.
"""

SEARCH = 0.02
"""Half width of the search for the common speed factor: slip and nominal speeds are up to 2 % off."""

_FLOOR_EFFICIENCY = 0.35
_FINE = np.linspace(-1.0, 1.0, 41)


@dataclass(frozen=True)
class CombQuery:
    """What is sought in a spectrum: the harmonics of one fault frequency.

    Attributes:
        fundamental: nominal frequency of the first harmonic, Hz.
        search: half width of the range of the speed factor.
        speed_factor: take this factor and do not search.
        false_alarm: probability that noise alone is called detected.
        centre: middle of the range of the speed factor.

    Raises:
        ValueError: if a number is outside its range.
    """

    fundamental: float
    search: float = SEARCH
    speed_factor: float | None = None
    false_alarm: float = FALSE_ALARM
    centre: float = 1.0

    def __post_init__(self) -> None:
        """Refuse numbers outside their range."""
        if not (self.fundamental > 0.0 and math.isfinite(self.fundamental)):
            raise ValueError(f"fundamental must be positive and finite, got {self.fundamental!r} Hz")
        if not (0.0 <= self.search < 0.5 and 0.0 < self.false_alarm < 1.0):
            limits = f"{self.search} and {self.false_alarm}"
            raise ValueError(f"need 0 <= search < 0.5 and 0 < false_alarm < 1, got {limits}")
        if self.speed_factor is not None and not 0.5 < self.speed_factor < 1.5:
            raise ValueError(f"speed_factor must lie between 0.5 and 1.5, got {self.speed_factor!r}")

    @property
    def widest(self) -> float:
        """The highest speed factor at which a line may stand."""
        return self.centre + self.search if self.speed_factor is None else 1.0 + abs(self.speed_factor - 1.0)


@dataclass(frozen=True, eq=False)
class _Places:
    """Where the lines of some families stand in a spectrum, and which of them it can show.

    Attributes:
        spacing: (family,) distance of the nominal lines, bins.
        nominal: (family, harmonic) nominal places, bins; 0 where the spectrum cannot show the line.
        resolved: (family, harmonic) whether it can: the line is inside it, and apart from its neighbours.
        counts: how many lines of each family are resolved.
        halves: (family,) bins on either side of a line that count to it.
        counted: (family, harmonic, bin) which of the five bins about each line count.
    """

    spacing: NDArray[np.float64]
    nominal: NDArray[np.float64]
    resolved: NDArray[np.bool_]
    counts: list[int]
    halves: NDArray[np.intp]
    counted: NDArray[np.bool_]

    def bins(self, factors: Sequence[float]) -> NDArray[np.intp]:
        """Return the nearest bin of each line at the speed factors of the families, shape (family, harmonic)."""
        return np.rint(self.nominal * np.array(factors)[:, None]).astype(np.intp)

    def line_power(
        self, power: NDArray[np.float64], bins: NDArray[np.intp], weight: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        """Return the power of lines at such bins, shape (family, harmonic), 0 where unresolved."""
        near = bins[:, :, None] + NEAR_BINS
        counted = self.counted if weight is None else self.counted * weight.take(near)
        return (power.take(near) * counted).sum(axis=2) / HANN_POWER


@lru_cache(maxsize=64)
def _places_of(queries: tuple[CombQuery, ...], resolution: float, n_bins: int, n_harmonics: int) -> _Places:
    """Return the places in a spectrum of so many bins; ValueError if ``n_harmonics`` is below 1.

    They are kept, and cannot be written to: while a speed stands still, each block asks for the same ones.
    """
    if n_harmonics < 1:
        raise ValueError(f"n_harmonics must be at least 1, got {n_harmonics}")
    spacing = np.array([query.fundamental for query in queries]) / resolution
    nominal = spacing[:, None] * np.arange(1.0, n_harmonics + 1.0)
    widest = np.array([query.widest for query in queries])
    resolved = (nominal * widest[:, None] + 3.0 <= n_bins - 1) & (spacing >= 4.0)[:, None]
    nominal *= resolved
    halves = np.where(spacing >= 8.0, 2, 1)
    counted = resolved[:, :, None] & (np.abs(NEAR_BINS) <= halves[:, None])[:, None, :]
    for shared in (spacing, nominal, resolved, halves, counted):
        shared.flags.writeable = False
    return _Places(spacing, nominal, resolved, resolved.sum(axis=1).tolist(), halves, counted)


def line_amplitudes(
    amplitude: NDArray[np.floating], resolution: float, fundamental: float, speed_factor: float, n_harmonics: int
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the amplitudes of the harmonics of one frequency at a known speed factor, without a floor under them.

    Args:
        amplitude: (bin,) spectrum, bin 0 at 0 Hz.
        resolution: spacing of its bins, Hz.
        fundamental: nominal frequency of the first harmonic, Hz.
        speed_factor: of the lines.
        n_harmonics: how many to read.

    Returns:
        Amplitude and whether it is resolved, as in :class:`FaultLines`, both (n_harmonics,).

    Raises:
        ValueError: as :class:`CombQuery`.
    """
    query = CombQuery(fundamental, speed_factor=speed_factor)
    places = _places_of((query,), resolution, amplitude.size, n_harmonics)
    power = places.line_power(np.square(amplitude, dtype=np.float64), places.bins([speed_factor]))
    return np.sqrt(power[0]), places.resolved[0]


def fault_lines(
    spectrum: LineSpectrum,
    fundamental: float,
    *,
    n_harmonics: int = 5,
    search: float = SEARCH,
    speed_factor: float | None = None,
    false_alarm: float = FALSE_ALARM,
    centre: float = 1.0,
) -> FaultLines:
    """Find the harmonics of one fault frequency; arguments as of :class:`CombQuery` and :func:`find_lines`."""
    return find_lines(spectrum, [CombQuery(fundamental, search, speed_factor, false_alarm, centre)], n_harmonics)[0]


def find_lines(spectrum: LineSpectrum, queries: Sequence[CombQuery], n_harmonics: int = 5) -> list[FaultLines]:
    """Find the harmonics of several fault frequencies, each at its own speed factor.

    All families go through each step together: the arrays are small, and their number is what costs time.

    Args:
        spectrum: prepared.
        queries: at least one.
        n_harmonics: how many of each to seek.

    Raises:
        ValueError: if ``n_harmonics`` is below 1.
    """
    places = _places_of(tuple(queries), spectrum.resolution, spectrum.power.size, n_harmonics)
    found = _search(spectrum, queries, places)
    bins = places.bins([factor for factor, _, _ in found])
    line_power, floor_power = places.line_power(spectrum.power, bins), places.line_power(spectrum.floor, bins)
    amplitude, floor = np.sqrt(line_power), np.sqrt(floor_power)
    own_power, own_noise = line_power, floor_power
    if spectrum.beside is not None:
        own_power = places.line_power(spectrum.power, bins, spectrum.beside)
        own_noise = places.line_power(spectrum.floor, bins, spectrum.beside)
    ratio = np.divide(line_power, floor_power, out=np.zeros_like(floor), where=places.resolved).sum(axis=1).tolist()
    lines: list[FaultLines] = []
    for row, (query, count, (factor, at_edge, comb_score)) in enumerate(
        zip(queries, places.counts, found, strict=True)
    ):
        if count == 0:
            lines.append(FaultLines(amplitude[row], floor[row], places.resolved[row], query.fundamental))
            continue
        half = int(places.halves[row])
        span = float(bins[row, count - 1] - bins[row, 0] + 2 * half)
        n_floor = min(count * spectrum.floor_bins, span + spectrum.floor_bins)
        # The highest line moves by so many bins in all.
        moved = 0.0 if query.speed_factor is not None else 2.0 * query.search * float(places.spacing[row]) * count
        lines.append(
            FaultLines(
                amplitude[row],
                floor[row],
                places.resolved[row],
                query.fundamental * factor,
                factor,
                at_edge,
                comb_score,
                score=math.sqrt(ratio[row] / count),
                threshold=noise_threshold(count, half, spectrum.n_averages, n_floor, 1.0 + moved, query.false_alarm),
                power=own_power[row],
                noise=own_noise[row],
                n_averages=spectrum.n_averages,
            )
        )
    return lines


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


def _search(spectrum: LineSpectrum, queries: Sequence[CombQuery], places: _Places) -> list[tuple[float, bool, float]]:
    """Return the speed factor of the highest comb score of each family, whether it is at an edge, and that score.

    Args:
        spectrum: prepared.
        queries: one for each family.
        places: of their lines.
    """
    found: list[tuple[float, bool, float]] = []
    refined: list[int] = []
    for row, (query, count) in enumerate(zip(queries, places.counts, strict=True)):
        if query.speed_factor is not None:
            there = np.rint(places.nominal[row, :count] * query.speed_factor).astype(np.intp)
            found.append((query.speed_factor, False, float(spectrum.sought[there].sum())))
        elif count == 0:
            found.append((1.0, False, 0.0))
        else:
            reach = query.fundamental * query.search
            middle = query.fundamental * query.centre
            lowest, highest = middle - reach, middle + reach
            grid = comb_grid(lowest, highest, spectrum.resolution, count)
            scores = spectrum.comb_scores(spectrum.sought, grid)
            best = int(np.argmax(scores))
            score = float(scores[best])
            if score > 0.0 and query.search > 0.0:
                refined.append(row)
                found.append((float(grid.lines[best]) / query.fundamental, False, score))
            else:
                found.append((1.0, False, score))
    if refined:
        width = np.array([queries[row].search for row in refined])
        centre = np.array([queries[row].centre for row in refined])
        coarse = np.array([found[row][0] for row in refined])
        count = np.array([places.counts[row] for row in refined])
        factors, edges = _refined(spectrum, places.nominal[refined], count, coarse, width, centre)
        for row, factor, edge in zip(refined, factors.tolist(), edges.tolist(), strict=True):
            found[row] = (factor, edge, found[row][2])
    return found


def _refined(
    spectrum: LineSpectrum,
    places: NDArray[np.float64],
    counts: NDArray[np.intp],
    coarse: NDArray[np.float64],
    width: NDArray[np.float64],
    centre: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the speed factor of each family refined to the tops of its lines, and whether it is at an edge.

    It stays within a bin of the highest line. The refinement maximises the sum of the lines' heights over their floors:
    the root of the power around the place, weighted by a parabola that falls to zero two bins away, is highest at the
    centroid of the power, which for a Hann window is the line's place between the bins to a thousandth.

    Args:
        spectrum: prepared.
        places: (family, harmonic) nominal places of the lines, bins; 0 where unresolved.
        counts: (family,) resolved lines.
        coarse: (family,) factors of the highest comb scores.
        width: (family,) half widths of the search.
        centre: (family,) middles of the search.
    """
    reach = 1.0 / (counts * places[:, 0])
    factors = coarse[:, None] + reach[:, None] * _FINE
    factors = np.minimum(np.maximum(factors, (centre - width)[:, None]), (centre + width)[:, None])
    tried = places[:, :, None] * factors[:, None, :]
    nearest = np.rint(tried)
    parabola = (nearest - tried) + NEAR_BINS[:, None, None, None]
    np.square(parabola, out=parabola)
    parabola *= -0.25
    parabola += 1.0
    np.maximum(parabola, 0.0, out=parabola)
    parabola *= spectrum.power.take(nearest.astype(np.intp) + NEAR_BINS[:, None, None, None])
    heights = np.sqrt(parabola.sum(axis=0))
    floor = spectrum.floor.take(np.rint(places * coarse[:, None]).astype(np.intp))
    weight = np.divide(1.0, np.sqrt(floor), out=np.zeros_like(floor), where=places > 0.0)
    best = np.argmax((weight[:, None, :] @ heights)[:, 0], axis=1)
    factor = factors[np.arange(best.size), best]
    return factor, width - np.abs(factor - centre) < 0.5 * GRID_STEP * reach
