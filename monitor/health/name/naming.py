"""Which part of the bearing is damaged: outer race, inner race, rolling element, cage, or unknown.

The evidence is the envelope spectrum alone; nothing is learned, so a single recording gets a name too. Every comb of
lines in it, of a fault family or not, is measured in the same way: by its depth of modulation, whose error follows from
the noise under its lines and the number of spectra averaged (``FaultLines.depth_error``). The deepest family is named
if

* it is there: its comb stands clear of the local noise floor (``comb_score``), and its depth of the least depth by
  ``SURE`` errors: the balls of a healthy bearing pass the load zone too, and varying compliance and waviness put weak
  lines at the same frequencies;
* no other comb explains the spectrum better: none is ``MUCH_DEEPER``, none that is unrelated to the families has
  at least its score and ``HALF_AS_DEEP``, and none of which it would be the sidebands is as deep. A machine with many
  lines lifts every family at once, and a speed that is stated wrongly leaves the true comb outside all families; and
* it is not the shaft's own: four times the shaft is within half a percent of the ball frequency of some bearings with
  eight balls; if the harmonics between its lines stand at the same speed, the comb is that of the shaft.

Families that the resolution or the search cannot separate are named together (``inner|ball``); where the geometry of
the bearing is an estimate, the search of each family is as wide as the estimate is uncertain. At a speed that is not
known the families are sought as far as its tolerance and slip together take them, and the name is undecided where three
times the tolerance would make it another part. A comb at the rate of the
cage alone is ``ball|cage``: a damaged ball that hits once a turn of the cage makes it as well.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from models.machine.bearing import Kinematics
from monitor.health.gears.lines import Wheels
from monitor.health.name.sidebands import TURNS, own_lines, parent_depth
from monitor.health.signal.comb import FaultLines, LineSpectrum, comb_grid, combs_depth
from monitor.health.signal.features import N_HARMONICS, fundamentals, highest_rival
from monitor.health.signal.lines import SEARCH, CombQuery, find_lines
from monitor.health.signal.search import UNVERIFIED_SLIP, FamilySearch, stated_searches
from monitor.health.signal.shaft import ACCEPTED
from monitor.words.parts import FAULTS, PART_OF
from monitor.words.statuses import UNDECIDED

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
NEARLY_AS_DEEP = 0.8
"""The same of a comb of which the family may be sidebands."""
_NEAR = 0.07
"""How far from the family a comb at a multiple of the stated speed may be damage, the speed being wrong."""
_SHARED_BINS = 2.5
"""Bins within which two lines are one."""
_BESIDE_BINS = 2.0
"""Bins by which a family may miss the place of the sidebands of another: both are drawn aside by lines of the shaft
that are left out."""
_LEAST_LINES = 3
_SIDEBANDS = (-3, -2, -1, 1, 2, 3)
_SAME_SLIP = 0.01
"""Departures from pure rolling that differ by less are equally likely."""
MIN_SPACING_BINS = 8.0
"""Bins between the lines of a family that may be named: of closer ones, the five bins of each leave no room between
them, and a few lines of shaft and gears pass for the cage."""
_MEASURED_ERROR = 0.005
"""Relative error up to which a measured speed is right; of 20 turns it is 0.24 % (root mean square)."""
DOUBT = 3.0
"""Tolerances of a stated speed within which a comb may be of another part: then the name is undecided."""
_SUPPLY_HZ, _SUPPLY_ERROR = (50.0, 60.0), 0.002
_MIN_BINS = 40
_LONE = {"cage": "ball|cage"}
_NO_SEARCHES: Mapping[str, FamilySearch] = MappingProxyType({})
_SIMPLE_RATIOS = sorted({p / q for p in range(1, N_HARMONICS + 1) for q in range(1, N_HARMONICS + 1)})


@dataclass(frozen=True)
class Naming:
    """The verdict on one (averaged) envelope spectrum.

    Attributes:
        fault: "outer", "inner", "ball", "cage", two of them joined by "|", ``UNDECIDED``, or None: not detected.
        best: the deepest family that stands clear of the noise, named or not, else that with the highest comb score;
            None where none is resolvable.
        rival: depth of the comb that takes the place of the best family, 0 where there is none; NaN where it was not
            sought because the family did not stand clear by itself.
        threshold: the comb score that a family had to reach.
        families: lines of each family, relative to the mean envelope; a family that the resolution cannot show is
            absent.
        verified: whether the speed of the shaft is known; otherwise the name rests on the stated one.
        candidates: the parts between which the stated speed cannot decide, where ``fault`` is ``UNDECIDED``.
    """

    fault: str | None
    best: str | None
    rival: float
    threshold: float
    families: Mapping[str, FaultLines] = field(default_factory=dict[str, FaultLines])
    verified: bool = False
    candidates: tuple[str, ...] = ()

    @property
    def part(self) -> str | None:
        """The damaged part, None where none is named or the speed cannot decide."""
        return None if self.fault == UNDECIDED else self.fault

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
    *,
    verified: bool = False,
    tolerance: float = SEARCH,
    wheels: Wheels | None = None,
) -> Naming:
    """Name the damaged part from one envelope spectrum.

    Args:
        spectrum: of the envelope over its mean, prepared at the shaft speed; of several neighbouring blocks their mean
            in power.
        kinematics: kinematic frequencies at that speed.
        families: lines of each fault family in it; at a speed that is not known they are sought anew, as far as slip
            takes them besides.
        searches: range in which each family was sought, of those whose frequency is an estimate.
        verified: whether the shaft speed is known.
        tolerance: relative error of a speed that is not.
        wheels: of gears beside the bearing: families that may be theirs are not named.
    """
    threshold = score_threshold(spectrum.n_averages)
    if not (verified or searches):
        families = _with_slip(spectrum, fundamentals(kinematics), stated_searches(tolerance))
    least = MIN_SPACING_BINS * spectrum.resolution
    shown = {name: lines for name, lines in families.items() if lines.resolved.all() and lines.fundamental >= least}
    if wheels is not None:
        shown = wheels.leave(shown, spectrum.resolution)
    if spectrum.power.size < _MIN_BINS or not spectrum.power.any() or not shown:
        return Naming(None, None, math.nan, threshold, verified=verified)
    inside = verified or searches
    clear = [name for name, lines in shown.items() if lines.comb_score >= threshold and (inside or not lines.at_edge)]
    if not clear:
        best = max(shown, key=lambda name: shown[name].comb_score)
        return Naming(None, best, math.nan, threshold, shown, verified)
    best = _deepest({name: shown[name] for name in clear}, spectrum.resolution)
    if verified:
        best = damaged_family(best, {name: shown[name] for name in clear}, kinematics, spectrum.resolution)
    found = shown[best]
    if found.depth < MIN_DEPTH + SURE * found.depth_error:
        return Naming(None, best, math.nan, threshold, shown, verified)
    rival = _rival_depth(spectrum, kinematics, found, [shown[name].fundamental for name in clear], threshold)
    if rival == 0.0:
        error, share = (_MEASURED_ERROR, 1.0) if verified else (ACCEPTED, NEARLY_AS_DEEP)
        whole, score = replace(spectrum, beside=None), min(threshold, found.comb_score)
        rival = parent_depth(whole, kinematics, found, error, score, share * found.depth)
    if rival > 0.0 or not (verified or _may_be_bearing(spectrum, kinematics.speed, found.fundamental)):
        return Naming(None, best, rival, threshold, shown, verified)
    possible = _Possible(found.fundamental, fundamentals(kinematics), shown, spectrum.resolution)
    if verified:
        names = possible.at_known_speed(best, searches)
        fault = "|".join(names)
        return Naming(_LONE.get(fault, fault), names[0], rival, threshold, shown, verified)
    joined = possible.joined(best, searches)
    candidates = possible.at_stated_speed(DOUBT * tolerance)
    if not searches and set(candidates) - set(joined):
        return Naming(UNDECIDED, best, rival, threshold, shown, verified, candidates)
    fault = "|".join(joined)
    return Naming(_LONE.get(fault, fault), best, rival, threshold, shown, verified)


def _with_slip(
    spectrum: LineSpectrum, lines: Mapping[str, float], searches: Mapping[str, FamilySearch]
) -> dict[str, FaultLines]:
    queries = [CombQuery(line, searches[name].width, centre=searches[name].centre) for name, line in lines.items()]
    return dict(zip(lines, find_lines(spectrum, queries, N_HARMONICS), strict=True))


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


def damaged_family(best: str, families: Mapping[str, FaultLines], kinematics: Kinematics, resolution: float) -> str:
    """Return the family of which the deepest one is sidebands, at a known speed, or else the deepest.

    The lines of the shaft take different shares of the two: the one of the higher score is the damage.

    Args:
        best: name of the deepest.
        families: lines of those that stand clear of the noise.
        kinematics: kinematic frequencies at that speed.
        resolution: of the spectrum, Hz.
    """
    found = families[best]
    for name, lines in families.items():
        carrier = PART_OF[name].sidebands(kinematics)
        if carrier is None:
            continue
        between = (lines.fundamental - found.fundamental) / carrier
        turns = round(between)
        beside = turns != 0 and abs(turns) <= max(TURNS) and abs(between - turns) * carrier <= _BESIDE_BINS * resolution
        deep = lines.depth >= NEARLY_AS_DEEP * found.depth and lines.comb_score > found.comb_score
        if beside and deep:
            return name
    return best


def _may_be_bearing(spectrum: LineSpectrum, speed: float, fundamental: float) -> bool:
    """Tell whether a comb is neither the shaft's, whose speed is not known, nor that of the supply."""
    width = max(_SUPPLY_ERROR * fundamental, spectrum.resolution / N_HARMONICS)
    supply = any(abs(fundamental - order * hz) <= width for hz in _SUPPLY_HZ for order in (1, 2))
    return not (supply or _is_of_shaft(spectrum, speed, fundamental))


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
    turns the load; close to the family, where it may be damage at a speed that is stated wrongly, it does always. A
    comb of at least the same score does if it is half as deep; of one at a simple ratio to the family, only the lines
    that are not the family's count. The lines of a shaft whose speed is not known stay in: at a stated speed that is
    wrong, lines of damage would go with them.

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
    excess = spectrum.excess if spectrum.beside is None else spectrum.sought
    scores = spectrum.comb_scores(excess, grid)
    candidates = np.flatnonzero(scores >= min(threshold, found.comb_score))
    if candidates.size == 0:
        return 0.0
    line = found.fundamental
    tolerance = math.exp(max(SEARCH, resolution / line))
    related = _within(grid.lines, [(ratio * line, tolerance) for ratio in _SIMPLE_RATIOS])[candidates]
    others = [n * other for other in families for n in range(1, N_HARMONICS + 1)]
    shaft = [order * speed for order in (0.5, 1.5, *range(1, math.ceil(highest / speed) + 1))]
    # At a known speed it is sure which combs are sidebands.
    sidebands = [] if spectrum.beside is None else [line + n * kinematics.ftf for n in _SIDEBANDS]
    sidebands += [] if spectrum.beside is None else [line + n * speed for n in _SIDEBANDS]
    reach = [
        (place, 1.0 + max(SEARCH, 2.0 * resolution / place)) for place in (*others, *shaft, *sidebands) if place > 0
    ]
    explained = _within(grid.lines, reach)[candidates]
    lines, bins = grid.lines[candidates], grid.bins[:, candidates]
    close = np.abs(lines / line - 1.0) <= _NEAR
    own = own_lines(lines, line, N_HARMONICS, _SHARED_BINS * resolution) | ~related
    strength = _mean_excess(excess, bins, own) * N_HARMONICS
    strong = ~explained & (strength >= found.comb_score)
    least = np.where(strong, HALF_AS_DEEP, np.where(close | ~explained, MUCH_DEEPER, math.inf)) * found.depth
    depths = combs_depth(spectrum, bins, own)
    return float(depths.max(where=depths >= least, initial=0.0))


def _mean_excess(excess: NDArray[np.float64], bins: NDArray[np.intp], own: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the mean excess of the lines of combs that are their own, 0 where there are fewer than three."""
    count = own.sum(axis=0)
    heights = np.append(excess, 0.0).take(np.minimum(bins, excess.size)) * own
    return np.where(count >= _LEAST_LINES, heights.sum(axis=0) / np.maximum(count, 1), 0.0)


def _within(lines: NDArray[np.float64], ranges: Sequence[tuple[float, float]]) -> NDArray[np.bool_]:
    """Return which of the rising frequencies lie in any range, (centre, factor) either way."""
    inside = np.zeros(lines.size, dtype=bool)
    for first, last in np.searchsorted(lines, [(centre / reach, centre * reach) for centre, reach in ranges]).tolist():
        inside[first:last] = True
    return inside


@dataclass(frozen=True)
class _Possible:
    """The parts of which one comb may be.

    Attributes:
        fundamental: of the comb, Hz.
        lines: nominal frequency of each family, Hz.
        families: lines found of each.
        resolution: of the spectrum, Hz.
    """

    fundamental: float
    lines: Mapping[str, float]
    families: Mapping[str, FaultLines]
    resolution: float

    def joined(self, best: str, searches: Mapping[str, FamilySearch]) -> tuple[str, ...]:
        """Return the families that cannot be separated from ``best``, by the resolution or the geometry."""
        return tuple(
            name
            for name in FAULTS
            if name == best
            or (
                name in self.families
                and (
                    abs(self.lines[name] - self.lines[best]) < self.resolution
                    or (name in searches and searches[name].holds(self.fundamental / self.lines[name]))
                )
            )
        )

    def at_stated_speed(self, tolerance: float) -> tuple[str, ...]:
        """Return the families of which the comb can be, with the slip of a cage, at a speed with such an error."""
        return tuple(
            name
            for name in FAULTS
            if name in self.families
            and UNVERIFIED_SLIP[name][0] - tolerance
            <= self.fundamental / self.lines[name] - 1.0
            <= UNVERIFIED_SLIP[name][1] + tolerance
        )

    def at_known_speed(self, best: str, searches: Mapping[str, FamilySearch]) -> tuple[str, ...]:
        """Return the families of which the comb can be at a known speed: those that need the least slip for it."""
        same = [
            name
            for name, lines in self.families.items()
            if name == best or abs(lines.fundamental - self.fundamental) < self.resolution
        ]
        best = min(same, key=self._departure)
        likely = self._departure(best) + _SAME_SLIP
        unsure = self.joined(best, searches)
        return tuple(name for name in FAULTS if name in unsure or (name in same and self._departure(name) <= likely))

    def _departure(self, name: str) -> float:
        return abs(self.fundamental / self.lines[name] - 1.0)
