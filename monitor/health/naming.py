"""Which part of the bearing is damaged: outer race, inner race, rolling element, cage, or unknown.

The evidence is the envelope spectrum alone; nothing is learned, so a single recording gets a name too. A part is named
only if its comb of lines

* is well above the local noise floor (``score``),
* is a strong modulation and not a trace of one (``depth``): the balls of a healthy bearing pass the load zone too, and
  varying compliance and waviness put weak lines at the same frequencies, and
* is higher than every unrelated comb of the same spectrum (``rival``): a machine with many lines lifts every
  family at once, and a speed that is stated wrongly leaves the true comb outside all families, as a rival; and
* is not the shaft's own: four times the shaft is within half a percent of the ball frequency of some bearings with
  eight balls, and if the harmonics between its lines are at the same speed, they are lines of the shaft.

Two families that the resolution or the search cannot tell apart are named together (``inner|ball``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from models.bearing import Kinematics
from monitor.health.spectrum.features import FAULTS, fundamentals

N_HARMONICS = 5
SEARCH = 0.02
"""Half width of the search for the common speed factor: slip and nominal speeds are up to 2 % off."""
_SPEED_ERROR = 0.025
"""How far from the stated speed the shaft is looked for: a little beyond the search, which slip and geometry widen."""

_LINE_CAP = 6.0
"""What a line adds to a score above this counts a tenth only: a comb is several lines, not one tall one. It still
counts, or the sidebands of severe damage would reach the score of its own lines and be rivals of equal standing."""
_BEYOND_CAP = 0.1
_SHAFT_ORDERS, _SHAFT_CAP, _SHAFT_SCORE = 20, 2.0, 1.3
"""Harmonics of the shaft that are looked at, most that one of them adds, and the mean that tells them from noise, of
which it is 0.6."""
_NULL_SCORE = 3.5
"""About the best score over the search that five lines of pure noise reach, whatever is averaged."""
_CLEARANCE = 10.5
"""How far above it a single spectrum must stand; falls with the square root of the spectra averaged, as noise does."""
LEAST_DEPTH = 0.2
"""Least root sum of squares of the five lines over the mean envelope, without the noise under them."""


@dataclass(frozen=True)
class Evidence:
    """What the spectrum says for one family.

    Attributes:
        score: sum over five harmonics of ln(1 + power / floor power), what exceeds 6 counting a tenth.
        depth: root sum of squares of the five line amplitudes over the mean envelope (a modulation depth), the power
            of the noise under them taken off.
        snr: root sum of squares of the line amplitudes over that of the floor under them.
        fundamental: frequency at which the comb is highest, Hz.
        speed_factor: that frequency over the kinematic one.
    """

    score: float
    depth: float
    snr: float
    fundamental: float
    speed_factor: float


@dataclass(frozen=True)
class Naming:
    """The verdict on one (averaged) envelope spectrum.

    Attributes:
        fault: "outer", "inner", "ball", "cage", two of them joined by "|", or None: not detected.
        best: the family with the highest score, named or not; None where none is resolvable.
        rival: the highest score of a comb that is not related to the best family's; NaN where it was not sought
            because the family did not stand clear by itself.
        threshold: the score that a family had to reach.
        families: evidence by family; a family that the resolution cannot show is absent.
    """

    fault: str | None
    best: str | None
    rival: float
    threshold: float
    families: Mapping[str, Evidence] = field(default_factory=dict)

    @property
    def evidence(self) -> Evidence | None:
        """Evidence of the best family."""
        return None if self.best is None else self.families[self.best]


def score_threshold(n_averaged: int) -> float:
    """Return the score that a family must reach in the mean of ``n_averaged`` spectra."""
    return _NULL_SCORE + _CLEARANCE / math.sqrt(n_averaged)


def bins_needed(kinematics: Kinematics, resolution: float) -> int:
    """Return how many bins of the envelope spectrum :func:`name_fault` looks at, rivals included."""
    return math.ceil(N_HARMONICS * _highest_rival(kinematics) * 1.05 / resolution) + 10


def name_fault(
    amplitude: NDArray[np.floating], resolution: float, kinematics: Kinematics, n_averaged: int = 1
) -> Naming:
    """Name the damaged part from one envelope spectrum.

    Args:
        amplitude: single-sided amplitude spectrum of the Hann-windowed envelope over the mean envelope, shape (bin,);
            of several neighbouring records the root of the mean power.
        resolution: spacing of the bins, Hz.
        kinematics: kinematic frequencies at the (nominal) shaft speed.
        n_averaged: how many spectra the mean was taken of.

    Raises:
        ValueError: if the spectrum has another shape than (bin,) or the resolution is not positive.
    """
    if amplitude.ndim != 1 or resolution <= 0:
        raise ValueError(f"expected a spectrum of shape (bin,) and resolution > 0, got {amplitude.shape}, {resolution}")
    threshold = score_threshold(n_averaged)
    power = np.square(amplitude[: bins_needed(kinematics, resolution)], dtype=np.float64)
    if power.size < 40 or not np.any(power):
        return Naming(None, None, math.nan, threshold)
    floor = noise_floor(power, resolution, kinematics.speed)
    excess = _excess(power, floor)
    cleared = _without_shaft(excess, resolution, kinematics.speed)
    families = {
        name: _evidence(power, floor, cleared, resolution, line)
        for name, line in fundamentals(kinematics).items()
        if line >= 4.0 * resolution and N_HARMONICS * line * (1.0 + SEARCH) < (power.size - 2) * resolution
    }
    if not families:
        return Naming(None, None, math.nan, threshold)
    best = max(families, key=lambda name: families[name].score)
    found = families[best]
    if found.score < threshold or found.depth < LEAST_DEPTH:
        return Naming(None, best, math.nan, threshold, families)
    rival = _best_rival(excess, resolution, kinematics, found.fundamental)
    if found.score <= rival or _is_of_shaft(excess, resolution, kinematics.speed, found.fundamental):
        return Naming(None, best, rival, threshold, families)
    return Naming(_joined(best, families, resolution, kinematics), best, rival, threshold, families)


def noise_floor(power: NDArray[np.float64], resolution: float, speed: float) -> NDArray[np.float64]:
    """Return the local mean power of the noise under the lines, shape (bin,).

    The median of the power in overlapping windows about two shaft frequencies wide (at least 31 bins), joined linearly
    in log power; the median of exponentially distributed noise power is ln 2 of its mean.
    """
    width = max(31, 2 * round(speed / resolution) + 1)
    width = min(width, power.size)
    half = max(1, width // 2)
    starts = np.arange(0, max(1, power.size - width + 1), half)
    if starts[-1] + width < power.size:
        starts = np.append(starts, power.size - width)
    windows = np.lib.stride_tricks.sliding_window_view(power, width)[starts]
    medians = np.log(np.maximum(np.median(windows, axis=1), np.finfo(np.float64).tiny))
    return np.exp(np.interp(np.arange(power.size), starts + half, medians)) / math.log(2.0)


def _excess(power: NDArray[np.float64], floor: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ln(1 + power / floor), compressed, shape (bin,)."""
    excess = np.log1p(power / floor)
    excess = np.minimum(excess, _LINE_CAP + _BEYOND_CAP * (excess - _LINE_CAP))
    excess[: min(2, excess.size)] = 0.0
    return excess


def _without_shaft(excess: NDArray[np.float64], resolution: float, speed: float) -> NDArray[np.float64]:
    """Return the excess without the bins of the harmonics of the shaft at its stated speed, where resolvable."""
    if speed <= 6.0 * resolution:
        return excess
    orders = np.arange(excess.size) * (resolution / speed)
    near = np.abs(orders - np.rint(orders)) * speed
    return np.where(near < max(1.5 * resolution, 0.01 * speed), 0.0, excess)


def _is_of_shaft(excess: NDArray[np.float64], resolution: float, speed: float, fundamental: float) -> bool:
    """Tell whether a comb is one of every n-th harmonic of the shaft, whose stated speed is not exact.

    It is if it could be, and if the harmonics between stand at the same speed of the shaft rather than at another.
    """
    order = round(fundamental / speed)
    if order == 0 or abs(fundamental / (order * speed) - 1.0) > _SPEED_ERROR or speed <= 6.0 * resolution:
        return False
    others = [n for n in range(1, _SHAFT_ORDERS + 1) if _is_between(n, order)]
    reach = 1.0 + _SPEED_ERROR
    speeds = _grid(speed / reach, speed * reach, resolution * N_HARMONICS / _SHAFT_ORDERS)
    score = np.zeros(speeds.size)
    for n in others:
        bins = np.minimum(np.rint(n * speeds / resolution).astype(np.intp), excess.size - 1)
        score += np.minimum(excess[bins], _SHAFT_CAP)
    here = np.abs(speeds - fundamental / order) <= resolution / order
    found = float(score[here].max(initial=0.0))
    return found > _SHAFT_SCORE * len(others) and found >= float(score.max())


def _is_between(n: int, order: int) -> bool:
    """Tell whether the n-th harmonic is no line of the comb of every ``order``-th, nor a sideband of one."""
    rest = n % order
    return rest != 0 and (order < 4 or rest not in (1, order - 1))


def _comb_scores(excess: NDArray[np.float64], resolution: float, lines: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the score of the comb of each fundamental in ``lines``, shape (line,)."""
    total = np.zeros(lines.size)
    for harmonic in range(1, N_HARMONICS + 1):
        bins = np.rint(lines * (harmonic / resolution)).astype(np.intp)
        total += np.where(bins < excess.size, excess[np.minimum(bins, excess.size - 1)], 0.0)
    return total


def _grid(lowest: float, highest: float, resolution: float) -> NDArray[np.float64]:
    """Return fundamentals so close that the fifth harmonic moves by a quarter of a bin."""
    step = 0.25 * resolution / N_HARMONICS
    return np.linspace(lowest, highest, max(2, math.ceil((highest - lowest) / step) + 1))


def _evidence(
    power: NDArray[np.float64],
    floor: NDArray[np.float64],
    excess: NDArray[np.float64],
    resolution: float,
    line: float,
) -> Evidence:
    """Return the evidence for the family whose kinematic fundamental is ``line``, at its best common speed factor."""
    lines = _grid(line * (1.0 - SEARCH), line * (1.0 + SEARCH), resolution)
    scores = _comb_scores(excess, resolution, lines)
    place = int(np.argmax(scores))
    bins = np.rint(lines[place] * np.arange(1, N_HARMONICS + 1) / resolution).astype(np.intp)
    spread = bins[:, None] + np.arange(-2, 3)
    spread = np.clip(spread, 0, power.size - 1)
    # Five bins of a Hann line hold its power times the equivalent noise bandwidth of 1.5 bins.
    lines_power = float(power[spread].sum()) / 1.5
    floor_power = float(floor[spread].sum()) / 1.5
    return Evidence(
        score=float(scores[place]),
        depth=math.sqrt(max(lines_power - floor_power, 0.0)),
        snr=math.sqrt(lines_power / floor_power),
        fundamental=float(lines[place]),
        speed_factor=float(lines[place] / line),
    )


def _highest_rival(kinematics: Kinematics) -> float:
    """Return the highest fundamental that competes: ten shaft speeds, or a tenth above the highest family."""
    return max(10.0 * kinematics.speed, 1.1 * max(fundamentals(kinematics).values()))


def _best_rival(excess: NDArray[np.float64], resolution: float, kinematics: Kinematics, fundamental: float) -> float:
    """Return the best score of a comb that shares no simple ratio with ``fundamental`` nor with the shaft.

    The lines of the shaft stay in: at a stated speed that is wrong, lines of damage would go with them. Higher
    multiples are rivals: the comb of a damaged outer race is that of the cage times the number of elements.
    """
    lines = _grid(max(0.3 * kinematics.speed, 4.0 * resolution), _highest_rival(kinematics), resolution)
    tolerance = max(SEARCH, resolution / fundamental)
    ratios = np.unique([p / q for p in range(1, N_HARMONICS + 1) for q in range(1, N_HARMONICS + 1)])
    edges = np.log(ratios * fundamental)
    place = np.clip(np.searchsorted(edges, np.log(lines)), 1, edges.size - 1)
    distance = np.minimum(np.abs(np.log(lines) - edges[place - 1]), np.abs(np.log(lines) - edges[place]))
    orders = np.maximum(np.rint(lines / kinematics.speed), 1.0)
    unrelated = lines[(distance > tolerance) & (np.abs(lines / (orders * kinematics.speed) - 1.0) > SEARCH)]
    return float(_comb_scores(excess, resolution, unrelated).max()) if unrelated.size else 0.0


def _joined(best: str, families: Mapping[str, Evidence], resolution: float, kinematics: Kinematics) -> str:
    """Join the names of the families that cannot be distinguished from ``best``."""
    lines = fundamentals(kinematics)
    found = families[best].fundamental
    names = [
        name
        for name in FAULTS
        if name == best
        or (
            name in families
            and (abs(lines[name] - lines[best]) < resolution or abs(found / lines[name] - 1.0) <= SEARCH)
        )
    ]
    return "|".join(names)
