"""Which part of the bearing is damaged: outer race, inner race, rolling element, cage, or unknown.

The evidence is the envelope spectrum alone; nothing is learned, so a single recording gets a name too. A part is named
only if its comb of lines

* stands clear of the local noise floor (``comb_score``),
* is a strong modulation and not a trace of one (``depth``): the balls of a healthy bearing pass the load zone too, and
  varying compliance and waviness put weak lines at the same frequencies,
* stands higher than every unrelated comb of the same spectrum (``rival``): a machine with many lines lifts every
  family at once, and a speed that is stated wrongly leaves the true comb outside all families, as a rival; and
* is not the shaft's own: four times the shaft is within half a percent of the ball frequency of some bearings with
  eight balls; if the harmonics between its lines stand at the same speed, the comb is that of the shaft.

Families that the resolution or the search cannot separate are named together (``inner|ball``); where the geometry of
the bearing is an estimate, the search of each family is as wide as the estimate is uncertain.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from models.bearing import Kinematics
from monitor.health.spectrum.comb import LineSpectrum, comb_grid
from monitor.health.spectrum.features import FAULTS, N_HARMONICS, fundamentals, highest_rival
from monitor.health.spectrum.lines import SEARCH, FaultLines
from monitor.health.spectrum.search import PLAIN, FamilySearch

_SPEED_ERROR = 0.025
"""How far from the stated speed the shaft is sought: a little beyond the search, which slip and geometry widen."""
_SHAFT_ORDERS, _SHAFT_CAP, _SHAFT_SCORE = 20, 2.0, 1.3
"""Harmonics of the shaft that are examined, the most that one of them adds, and the mean that separates them from
noise, of which it is 0.6."""
_LONG_AVERAGE_SCORE = 4.9
"""Comb score that a family must reach in a long average, where five lines of pure noise read 5 ln 2 = 3.5."""
_CLEARANCE = 9.1
"""How far above it a single spectrum must stand; falls with the square root of the spectra averaged, as noise does."""
MIN_DEPTH = 0.2
"""Least root sum of squares of the five lines over the mean envelope, without the noise under them."""
_MIN_BINS = 40
_NO_SEARCHES: Mapping[str, FamilySearch] = MappingProxyType({})
_SIMPLE_RATIOS = sorted({p / q for p in range(1, N_HARMONICS + 1) for q in range(1, N_HARMONICS + 1)})


@dataclass(frozen=True)
class Naming:
    """The verdict on one (averaged) envelope spectrum.

    Attributes:
        fault: "outer", "inner", "ball", "cage", two of them joined by "|", or None: not detected.
        best: the family with the highest comb score, named or not; None where none is resolvable.
        rival: the highest score of a comb that is not related to the best family's; NaN where it was not sought
            because the family did not stand clear by itself.
        threshold: the comb score that a family had to reach.
        families: lines of each family, relative to the mean envelope; a family that the resolution cannot show is
            absent.
    """

    fault: str | None
    best: str | None
    rival: float
    threshold: float
    families: Mapping[str, FaultLines] = field(default_factory=dict[str, FaultLines])

    @property
    def evidence(self) -> FaultLines | None:
        """Lines of the best family."""
        return None if self.best is None else self.families[self.best]

    @property
    def relative_score(self) -> float:
        """Comb score of the best family over the one that it had to reach; 0 where there is none."""
        return 0.0 if self.evidence is None else self.evidence.comb_score / self.threshold


def score_threshold(n_averages: int) -> float:
    """Return the comb score that a family must reach in the mean of ``n_averages`` spectra."""
    return _LONG_AVERAGE_SCORE + _CLEARANCE / math.sqrt(n_averages)


def name_fault(
    spectrum: LineSpectrum,
    kinematics: Kinematics,
    families: Mapping[str, FaultLines],
    searches: Mapping[str, FamilySearch] = _NO_SEARCHES,
) -> Naming:
    """Name the damaged part from one envelope spectrum.

    Args:
        spectrum: of the envelope over its mean, prepared at the stated shaft speed; of several neighbouring blocks
            their mean in power.
        kinematics: kinematic frequencies at the stated shaft speed.
        families: lines of each fault family in it.
        searches: range in which each family was sought, of those whose frequency is an estimate.
    """
    threshold = score_threshold(spectrum.n_averages)
    shown = {name: lines for name, lines in families.items() if lines.resolved.all()}
    if spectrum.power.size < _MIN_BINS or not spectrum.power.any() or not shown:
        return Naming(None, None, math.nan, threshold)
    best = max(shown, key=lambda name: shown[name].comb_score)
    found = shown[best]
    if found.comb_score < threshold or found.depth < MIN_DEPTH:
        return Naming(None, best, math.nan, threshold, shown)
    rival = _best_rival(spectrum, kinematics, found.fundamental)
    if found.comb_score <= rival or _is_of_shaft(spectrum, kinematics.speed, found.fundamental):
        return Naming(None, best, rival, threshold, shown)
    joined = _joined(best, shown, spectrum.resolution, fundamentals(kinematics), searches)
    return Naming(joined, best, rival, threshold, shown)


def _is_of_shaft(spectrum: LineSpectrum, speed: float, fundamental: float) -> bool:
    """Tell whether a comb is one of every n-th harmonic of the shaft, whose stated speed is not exact.

    It is if it could be, and if the harmonics between stand at the same speed of the shaft rather than at another.
    """
    order = round(fundamental / speed)
    excess, resolution = spectrum.excess, spectrum.resolution
    if order == 0 or abs(fundamental / (order * speed) - 1.0) > _SPEED_ERROR or speed <= 6.0 * resolution:
        return False
    others = [n for n in range(1, _SHAFT_ORDERS + 1) if _is_between(n, order)]
    reach = 1.0 + _SPEED_ERROR
    speeds = comb_grid(speed / reach, speed * reach, resolution, _SHAFT_ORDERS).lines
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


def _best_rival(spectrum: LineSpectrum, kinematics: Kinematics, fundamental: float) -> float:
    """Return the best score of a comb that shares no simple ratio with ``fundamental`` nor with the shaft.

    The lines of the shaft stay in: at a stated speed that is wrong, lines of damage would go with them. Higher
    multiples are rivals: the comb of a damaged outer race is that of the cage times the number of elements.
    """
    resolution, speed = spectrum.resolution, kinematics.speed
    lowest, highest = max(0.3 * speed, 4.0 * resolution), highest_rival(fundamentals(kinematics), speed)
    grid = comb_grid(lowest, highest, resolution)
    tolerance = max(SEARCH, resolution / fundamental)
    of_family = [(ratio * fundamental, math.exp(tolerance)) for ratio in _SIMPLE_RATIOS]
    of_shaft = [(order * speed, 1.0 + SEARCH) for order in range(1, math.ceil(highest / speed) + 1)]
    related = [(centre / reach, centre * reach) for centre, reach in (*of_family, *of_shaft)]
    scores = spectrum.comb_scores(spectrum.excess, grid)
    for first, last in np.searchsorted(grid.lines, related).tolist():
        scores[first:last] = 0.0
    return float(scores.max())


def _joined(
    best: str,
    families: Mapping[str, FaultLines],
    resolution: float,
    lines: Mapping[str, float],
    searches: Mapping[str, FamilySearch],
) -> str:
    """Join the names of the families that cannot be separated from ``best``; ``lines`` are the nominal ones, Hz."""
    found = families[best].fundamental
    names = [
        name
        for name in FAULTS
        if name == best
        or (
            name in families
            and (abs(lines[name] - lines[best]) < resolution or searches.get(name, PLAIN).holds(found / lines[name]))
        )
    ]
    return "|".join(names)
