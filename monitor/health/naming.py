"""Which part of the bearing is damaged: outer race, inner race, rolling element, cage, or unknown.

The evidence is the envelope spectrum alone; nothing is learned, so a single recording gets a name too. Every comb of
lines in it, of a fault family or not, is measured in the same way: by its depth of modulation, whose error follows from
the noise under its lines and the number of spectra averaged (``FaultLines.depth_error``). The deepest family is named
if

* it is there: its comb stands clear of the local noise floor (``comb_score``), and its depth of the least depth by
  ``SURE`` errors: the balls of a healthy bearing pass the load zone too, and varying compliance and waviness put weak
  lines at the same frequencies;
* no other comb explains the spectrum better: none is ``MUCH_DEEPER``, and none that is unrelated to the families has
  at least its score and ``HALF_AS_DEEP``. A machine with many lines lifts every family at once, and a speed that is
  stated wrongly leaves the true comb outside all families; and
* it is not the shaft's own: four times the shaft is within half a percent of the ball frequency of some bearings with
  eight balls; if the harmonics between its lines stand at the same speed, the comb is that of the shaft.

Families that the resolution or the search cannot separate are named together (``inner|ball``); where the geometry of
the bearing is an estimate, the search of each family is as wide as the estimate is uncertain. A comb at the rate of the
cage alone is ``ball|cage``: a damaged ball that hits once a turn of the cage makes it as well.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from models.bearing import Kinematics
from monitor.health.spectrum.comb import LineSpectrum, comb_grid
from monitor.health.spectrum.family import FaultLines, combs_depth
from monitor.health.spectrum.features import FAULTS, N_HARMONICS, fundamentals, highest_rival
from monitor.health.spectrum.lines import SEARCH
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
MIN_DEPTH = 0.25
"""Least depth of a damaged part: root sum of squares of the five lines over the mean envelope, without the noise."""
SURE = 2.0
"""Errors of the depth by which it must exceed the least one."""
MUCH_DEEPER, HALF_AS_DEEP = 1.5, 0.5
"""Depth of another comb over that of the family at which it takes its place: any comb, or an unrelated one."""
_NEAR = 0.07
"""How far from the family a comb at a multiple of the stated speed may be damage, the speed being wrong."""
_MIN_BINS = 40
_LONE = {"cage": "ball|cage"}
_NO_SEARCHES: Mapping[str, FamilySearch] = MappingProxyType({})
_SIMPLE_RATIOS = sorted({p / q for p in range(1, N_HARMONICS + 1) for q in range(1, N_HARMONICS + 1)})


@dataclass(frozen=True)
class Naming:
    """The verdict on one (averaged) envelope spectrum.

    Attributes:
        fault: "outer", "inner", "ball", "cage", two of them joined by "|", or None: not detected.
        best: the deepest family that stands clear of the noise, named or not, else that with the highest comb score;
            None where none is resolvable.
        rival: depth of the comb that takes the place of the best family, 0 where there is none; NaN where it was not
            sought because the family did not stand clear by itself.
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
    clear = [name for name, lines in shown.items() if lines.comb_score >= threshold]
    if not clear:
        best = max(shown, key=lambda name: shown[name].comb_score)
        return Naming(None, best, math.nan, threshold, shown)
    best = _deepest({name: shown[name] for name in clear}, spectrum.resolution)
    found = shown[best]
    if found.depth < MIN_DEPTH + SURE * found.depth_error:
        return Naming(None, best, math.nan, threshold, shown)
    rival = _rival_depth(spectrum, kinematics, found, [shown[name].fundamental for name in clear], threshold)
    if rival > 0.0 or _is_of_shaft(spectrum, kinematics.speed, found.fundamental):
        return Naming(None, best, rival, threshold, shown)
    joined = _joined(best, shown, spectrum.resolution, fundamentals(kinematics), searches)
    return Naming(_LONE.get(joined, joined), best, rival, threshold, shown)


def _deepest(families: Mapping[str, FaultLines], resolution: float) -> str:
    """Return the deepest family; the comb of the cage gives way to one of half its depth that is no multiple of it.

    The cage turns a damaged ball through the load zone: its rate is often deeper than that of the impacts.
    """
    best = max(families, key=lambda name: families[name].depth)
    if best != "cage":
        return best
    cage = families["cage"]
    apart = {
        name: lines.depth
        for name, lines in families.items()
        if abs(lines.fundamental - round(lines.fundamental / cage.fundamental) * cage.fundamental) > resolution
        and lines.depth >= HALF_AS_DEEP * cage.depth
    }
    return max(apart, key=apart.__getitem__, default="cage")


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


def _rival_depth(
    spectrum: LineSpectrum, kinematics: Kinematics, found: FaultLines, families: Sequence[float], threshold: float
) -> float:
    """Return the depth of the deepest comb that takes the place of the family found, 0 where there is none.

    A much deeper comb does, unless it is that of another family, whose depth has been weighed, or of the shaft, which
    turns the load; close to the family, where it may be damage at a speed that is stated wrongly, it does always. An
    unrelated comb of at least the same score does if it is half as deep. The lines of the shaft stay in: at a stated
    speed that is wrong, lines of damage would go with them.

    Args:
        spectrum: of the envelope.
        kinematics: kinematic frequencies at the stated shaft speed.
        found: the family.
        families: fundamentals of all families that stand clear.
        threshold: comb score from which a comb is one.
    """
    resolution, speed = spectrum.resolution, kinematics.speed
    lowest, highest = max(0.3 * speed, 4.0 * resolution), highest_rival(fundamentals(kinematics), speed)
    grid = comb_grid(lowest, highest, resolution)
    tolerance = math.exp(max(SEARCH, resolution / found.fundamental))
    of_family = [(ratio * found.fundamental, tolerance) for ratio in _SIMPLE_RATIOS]
    of_others = [n * line for line in families for n in range(1, N_HARMONICS + 1)]
    of_shaft = [order * speed for order in (0.5, 1.5, *range(1, math.ceil(highest / speed) + 1))]
    explaining = [(line, 1.0 + max(SEARCH, 2.0 * resolution / line)) for line in (*of_others, *of_shaft)]
    scores = spectrum.comb_scores(spectrum.excess, grid)
    candidates = np.flatnonzero(scores >= min(threshold, found.comb_score))
    if candidates.size == 0:
        return 0.0
    explained = _within(grid.lines, explaining)
    related = explained | _within(grid.lines, of_family)
    close = np.abs(grid.lines / found.fundamental - 1.0) <= _NEAR
    strong = ~related[candidates] & (scores[candidates] >= found.comb_score)
    deeper = (close | ~explained)[candidates]
    least = np.where(strong, HALF_AS_DEEP, np.where(deeper, MUCH_DEEPER, math.inf)) * found.depth
    depths = combs_depth(spectrum, grid.bins[:, candidates])
    return float(depths.max(where=depths >= least, initial=0.0))


def _within(lines: NDArray[np.float64], ranges: Sequence[tuple[float, float]]) -> NDArray[np.bool_]:
    """Return which of the rising frequencies lie in any range, (centre, factor) either way."""
    inside = np.zeros(lines.size, dtype=bool)
    for first, last in np.searchsorted(lines, [(centre / reach, centre * reach) for centre, reach in ranges]).tolist():
        inside[first:last] = True
    return inside


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
