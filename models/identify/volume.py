"""What an identification says about V_eq, and whether it may vouch for the rig.

The level of a defect depends on more than resonances: frequencies and damping ratios shape the response to a shallow
defect, but from which depth on a ball is unloaded follows from the static compression (load / k_c)^(1 / n), which needs
the scale. So for the level that the best rig has at defects of a volume, the least volume is read from the map of each
draw of the posterior.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from models.identify.evidence import SCALES
from models.identify.intervals import MAX_FACTOR
from models.machine.scene import Defect, Scene
from models.path.defect import race_radius
from models.solve.six_dof.rows import simulate_row
from models.work.runner import SERIAL
from models.work.task import Work

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.identify.run import Identification
    from models.machine.bearing import Bearing
    from models.machine.rig import Rig
    from models.work.runner import Runner

# Extents, rad, and depths, m, of the small map; and the steps between its nodes at which it is read.
_EXTENTS = tuple(math.radians(float(x)) for x in np.linspace(0.0, 30.0, 13))
_DEPTHS = tuple(5e-6 * i for i in range(8))
_FINER = 8
REFERENCES = (0.005e-6, 0.015e-6, 0.05e-6)
"""Damaged volumes per width at whose level the spread of V_eq is judged, m2."""
# Defects count as of a volume up to this factor off it.
_NEAR = 1.15
MAX_MISFIT = 3.0
"""Residuals of a calibration without tests, over their standard uncertainty, root mean square."""
# Rigs that are taken of those that the data leave possible, and the accuracy of their maps.
_RIGS, _ACCURACY = 64, 1e-2
_CENTRAL = (0.025, 0.975)
# Bytes of a small map beside the program, at most.
_MEMORY = 64_000_000
# Seconds of a small map, roughly, and of a chunk of them.
_SECONDS, _CHUNK_SECONDS = 0.1, 0.5
# Effective draws of a posterior that the spread can rest on.
_EFFECTIVE = 30.0


@dataclass(frozen=True)
class VolumePoint:
    """Where the volume is judged: load, N; speed, Hz; band of the RMS, Hz, or None; clearance, m."""

    load: float
    speed: float
    band: tuple[float, float] | None = None
    clearance: float = 0.0


@dataclass(frozen=True, eq=False)
class SmallMap:
    """RMS of a rig on a coarse grid, m/s2, shape (depths, extents), finely interpolated."""

    rms: NDArray[np.float64]
    volume: NDArray[np.float64]

    def least_volume(self, level: float) -> float:
        """Return the least extent times depth at which a level is reached, rad m; infinite where it is not."""
        reached = self.rms >= level
        return float(np.min(self.volume[reached])) if np.any(reached) else math.inf

    def level_of(self, volume: float) -> float:
        """Return the median level of the defects of about a volume, rad m: some are long, some deep."""
        near = np.abs(np.log(np.maximum(self.volume, 1e-30) / volume)) < math.log(_NEAR)
        return float(np.median(self.rms[near])) if np.any(near) else math.nan


def small_map(rig: Rig, bearing: Bearing, point: VolumePoint) -> SmallMap:
    """Simulate a coarse map; a motion that does not repeat counts as its neighbour with less depth."""
    rows = [np.zeros(len(_EXTENTS))]
    for depth in _DEPTHS[1:]:
        found = levels(rig, bearing, point, np.array(_EXTENTS), depth)
        rows.append(np.where(np.isfinite(found), found, rows[-1]))
    extents, depths = (_refined(np.array(axis)) for axis in (_EXTENTS, _DEPTHS))
    along = np.empty((len(_DEPTHS), len(extents)))
    for row, values in zip(along, rows, strict=True):
        row[:] = np.interp(extents, _EXTENTS, values)
    fine = np.empty((len(depths), len(extents)))
    for i in range(len(extents)):
        fine[:, i] = np.interp(depths, _DEPTHS, along[:, i])
    return SmallMap(fine, np.outer(depths, extents))


def levels(
    rig: Rig, bearing: Bearing, point: VolumePoint, extents: NDArray[np.float64], depth: float
) -> NDArray[np.float64]:
    """Return the RMS at defects of one depth (m), extents in rad; NaN where the motion was not found to repeat."""
    defect = Defect(float(extents[-1]), depth)
    scene = Scene(point.speed, point.load, bearing, rig, defect, point.clearance)
    row = simulate_row(scene, extents, accuracy=_ACCURACY, band=point.band)
    return np.where(row.settled, row.rms, np.nan)


def _refined(axis: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.interp(np.linspace(0.0, len(axis) - 1.0, _FINER * (len(axis) - 1) + 1), np.arange(len(axis)), axis)


@dataclass(frozen=True)
class VolumeSpread:
    """Central 95 % of V_eq over that of the best rig, of draws of the posterior, for one level.

    Attributes:
        volume: of which the level is, for the best rig, m2.
        low, high: factors; infinite where a rig reaches the level nowhere on its map.
    """

    volume: float
    low: float
    high: float

    @property
    def factor(self) -> float:
        """The largest over the least."""
        return self.high / self.low if self.low > 0.0 else math.inf


def _map_of(bearing: Bearing, drawn: tuple[Rig, VolumePoint]) -> SmallMap:
    return small_map(drawn[0], bearing, drawn[1])


_SMALL_MAPS = Work("small maps of drawn rigs", _map_of, memory=_MEMORY, threads=True)


def volume_spread(found: Identification, point: VolumePoint, runner: Runner = SERIAL) -> tuple[VolumeSpread, ...]:
    """Return how far the rigs that the data leave possible agree on V_eq at some levels."""
    space, draws = found.space, found.posterior.draws
    clearance = found.best.values["clearance"]
    rigs = [(space.rig_of(found.best.values), replace(point, clearance=clearance))]
    for number in range(min(_RIGS, len(draws.rows))):
        drawn = draws.rig(rigs[0][0], number)
        rigs.append((drawn, replace(point, clearance=draws.clearance(clearance, number))))
    maps = list(runner.run(_SMALL_MAPS.sized(_SECONDS, chunk=_CHUNK_SECONDS), space.bearing, rigs))
    radius, spreads = race_radius(space.bearing), list[VolumeSpread]()
    for reference in REFERENCES:
        level = maps[0].level_of(reference / radius)
        if math.isfinite(level) and level > 0.0:
            volumes = np.array([each.least_volume(level) for each in maps]) / maps[0].least_volume(level)
            # Order statistics: between a finite one and one beyond the map nothing is interpolated.
            low, high = np.quantile(volumes[1:], _CENTRAL, method="nearest")
            spreads.append(VolumeSpread(reference, float(low), float(high)))
    return tuple(spreads)


def objections(found: Identification, spread: Sequence[VolumeSpread], configured: Collection[str]) -> list[str]:
    """Return in words why a rig may not be called calibrated; nothing where it may.

    Args:
        found: the identification.
        spread: of V_eq.
        configured: parameters whose values a person gave, those of a default bench not among them.
    """
    if np.any(found.problem.trials.damaged):
        # Tests at known defects hold the level itself, so that they tell the scale; what speaks against their fit is
        # said beside (monitor/identify/rig_table.py).
        return _disagreement(found, spread)
    evidence, free = found.problem.evidence, found.space.free
    words: list[str] = []
    foreign = [name for name in SCALES if name not in free and name not in configured]
    if foreign:
        words.append(f"{', '.join(foreign)} neither free nor given in [rig]: values of the default test bench")
    levels_known = any(peak.accelerance is not None for peak in evidence.peaks)
    known = {prior.name for prior in evidence.priors if not prior.at_least}
    known |= {name for name in configured if name not in free}
    if not levels_known and not known & set(SCALES):
        words.append(
            "nothing tells the scale: frequencies and damping ratios stay the same with all masses, stiffnesses and "
            "dampings times a factor"
        )
    missed = math.sqrt(found.limit.variance)
    if missed > MAX_MISFIT:
        words.append(
            f"the model misses resonances and priors by {missed:.3g} times their uncertainty, at most {MAX_MISFIT:g} "
            "is allowed: their uncertainties are too small, or the machine has resonances of other parts"
        )
    return words + _disagreement(found, spread)


def _disagreement(found: Identification, spread: Sequence[VolumeSpread]) -> list[str]:
    """Return in words why the rigs that the data leave possible do not agree on V_eq; nothing where they do."""
    words: list[str] = []
    if found.posterior.effective < _EFFECTIVE:
        words.append(
            f"the posterior has {found.posterior.effective:.0f} effective draws, too few for the spread of V_eq"
        )
    worst = max((each.factor for each in spread), default=math.inf)
    if not worst <= MAX_FACTOR:
        known_factor = f"by a factor of {worst:.3g}" if math.isfinite(worst) else "without limit"
        words.append(
            f"rigs that explain the data differ {known_factor} in V_eq for one level; at most {MAX_FACTOR:g} is allowed"
        )
    return words
