"""Lines of a comb that another sensor shows louder: they are set to the noise before a channel's own are sought.

The casing carries the impacts of one bearing to the sensors of its neighbours. What they show of it has the
frequencies of the bearing that is damaged, which may lie where a family of theirs is sought. Where it comes from shows
in how loud it is: a comb has twice the power and more at the sensor of the bearing that sends it. Own lines between
those of the comb stay.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.comb import NEAR_BINS, LineSpectrum, combs_depth
from monitor.health.signal.interference import MIN_SPACING_BINS
from monitor.health.signal.settings import N_HARMONICS

LOUDER = 2.0
"""Power of a comb at the sensor of the bearing that sends it over that at another's: half way between a transmission
of a half and equal sensors, in the logarithm."""
_SIDEBANDS = 3
_STANDS_OUT = 3.0
"""Mean power of three bins over the noise from which a sideband, or the skirt of a line, is one."""
_WANDER = 0.01
"""Half width of the skirts over the frequency: slip widens a line in proportion to it."""


@dataclass(frozen=True, eq=False)
class ForeignComb:
    """A comb in the spectrum of another channel.

    Attributes:
        fundamental: Hz.
        spacing: of its sidebands, Hz.
        spectrum: of the envelope over its mean, with the comb in it.
        mean: of the envelope, m/s2, or None where the unit is unknown.
    """

    fundamental: float
    spacing: float
    spectrum: LineSpectrum
    mean: float | None

    def is_louder(self, spectrum: LineSpectrum, mean: float | None) -> bool:
        """Return whether the comb has ``LOUDER`` times the power that it has in another spectrum of such a mean."""
        here, there = (self._depth(found) for found in (self.spectrum, spectrum))
        return here * here * self._over(mean) >= LOUDER * there * there

    def bins_in(self, spectrum: LineSpectrum, mean: float | None) -> NDArray[np.bool_]:
        """Return which bins of another spectrum are of the comb, shape (bin,).

        They are the lines themselves, two bins to each side, and of their skirts and sidebands what is louder here.
        None are where the lines are closer than ``MIN_SPACING_BINS``.

        Args:
            spectrum: of the same resolution.
            mean: of its envelope, m/s2, or None where the unit is unknown: then depths are compared.
        """
        resolution, spacing = spectrum.resolution, self.fundamental / spectrum.resolution
        size = min(spectrum.power.size, self.spectrum.power.size)
        found = np.zeros(spectrum.power.size, dtype=bool)
        if spacing < MIN_SPACING_BINS:
            return found
        sides = _SIDEBANDS if self.spacing >= MIN_SPACING_BINS * resolution else 0
        least = min(self.spacing / resolution, spacing) if sides else spacing
        lines = spacing * np.arange(0.0, math.floor(size / spacing) + 1.0)
        places = np.add.outer(lines, self.spacing / resolution * np.arange(-sides, sides + 1)).ravel()
        places = places[(places >= 1.0) & (places < size)]
        reach = np.minimum(np.maximum(NEAR_BINS[-1], _WANDER * places), 0.25 * least)
        offsets = np.arange(-int(reach.max(initial=0.0)), int(reach.max(initial=0.0)) + 1)
        around = np.rint(places).astype(np.intp)[:, None] + offsets
        around = around[(np.abs(offsets) <= reach[:, None]) & (around >= 1) & (around < size)]
        here, there = (_smooth(one.power[:size]) for one in (self.spectrum, spectrum))
        loud = (here > _STANDS_OUT * self.spectrum.floor[:size]) & (here * self._over(mean) >= LOUDER * there)
        found[around[loud[around]]] = True
        core = np.add.outer(np.rint(lines[1:]).astype(np.intp), NEAR_BINS)
        found[core[core < size]] = True
        return found

    def _over(self, mean: float | None) -> float:
        """Return what relative power in this spectrum is in one of such a mean."""
        return 1.0 if mean is None or self.mean is None else (self.mean / max(mean, np.finfo(np.float64).tiny)) ** 2

    def _depth(self, spectrum: LineSpectrum) -> float:
        places = self.fundamental / spectrum.resolution * np.arange(1.0, N_HARMONICS + 1.0)
        return float(combs_depth(spectrum, np.rint(places).astype(np.intp)[:, None])[0])


def beside_combs(spectrum: LineSpectrum, mean: float | None, combs: Sequence[ForeignComb]) -> LineSpectrum:
    """Return a spectrum with the lines of combs at the level of the noise under them; ``mean`` is of its envelope."""
    foreign = np.zeros(spectrum.power.size, dtype=bool)
    for comb in combs:
        foreign |= comb.bins_in(spectrum, mean)
    noise = math.log(2.0)
    return replace(
        spectrum,
        power=np.where(foreign, spectrum.floor, spectrum.power),
        excess=np.where(foreign, np.minimum(spectrum.excess, noise), spectrum.excess),
        sought=np.where(foreign, np.minimum(spectrum.sought, noise), spectrum.sought),
    )


def _smooth(power: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean of three neighbouring bins."""
    return np.convolve(power, np.full(3, 1.0 / 3.0), mode="same")
