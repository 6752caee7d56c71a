"""Indicators of a damaged wheel, from its synchronous average.

With the average x of a turn, its lines A_k at orders k, and the teeth z:

- FM0 (Stewart, Univ. of Southampton MHM/R/10/77, 1977): peak to peak of x over the sum of the mesh lines, sum A_hz.
- FM4 (Stewart): the kurtosis N sum d^4 / (sum d^2)^2 of the difference d: x without what is regular.
- M6A (Martin, Nat. Center of Tribology TR 1989): N^2 sum d^6 / (sum d^2)^3.
- NA4 (Zakrajsek, Townsend, Decker, NASA TM 105950, 1993): N sum r^4 / (m)^2 of the residual r, with m the mean of
  sum r^2 over the blocks so far. It is held once the baseline is learned, as in NA4* (Decker, Handschuh, Zakrajsek,
  NASA TM 106671, 1994): a running mean follows the damage.
- Sideband level (Lebold et al., 54th MFPT, 2000): (A_z-1 + A_z+1) over the standard deviation of x.

Regular are the mean, orders 1 and 2, the mesh with its harmonics, and all orders that another wheel has too. The
difference also lacks the first sideband on both sides of each mesh harmonic; the residual keeps it. A sum of squares is
over the samples of one turn, without a mean.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.health.gears.average import WheelAverage

SHAFT_ORDERS = 2
"""Orders of the wheel itself that are regular: unbalance, misalignment."""
_WHOLE = 1e-5
"""Distance from a whole order at which an order of another wheel is one of this wheel, times the order."""


@dataclass(frozen=True)
class GearIndicators:
    """What the average of one wheel says; None where it has no value, such as of a silent mesh.

    Attributes:
        variance: mean square of the residual, which NA4 is relative to, (unit of the samples)^2.
        residual: power of the residual over that of what does not repeat with the wheel, at the same orders.
        sideband: power of the first sidebands of all mesh harmonics over that of the harmonics, with the noise in both.
        unlike: fourth moment of the residual over its variance squared, by which NA4 exceeds the ratio of variances.
    """

    fm0: float | None
    fm4: float | None
    m6a: float | None
    sideband_level: float | None
    variance: float | None
    residual: float | None
    sideband: float | None
    unlike: float | None

    def na4(self, learned: float | None) -> float | None:
        """Return NA4 relative to the mean of ``variance`` over the blocks so far, or None."""
        if self.unlike is None or self.variance is None or not learned:
            return None
        return self.unlike * (self.variance / learned) ** 2


def shared_orders(turns: float, count: int, others: Iterable[float]) -> NDArray[np.bool_]:
    """Return which orders of a wheel are orders of another wheel too, shape (count,).

    Args:
        turns: of the wheel in one turn of the bearing's shaft.
        count: orders from 0.
        others: turns of the other wheels.
    """
    orders = np.arange(count, dtype=np.float64)
    found = np.zeros(count, dtype=bool)
    for other in others:
        theirs = orders * (turns / other)
        found |= np.abs(theirs - np.rint(theirs)) <= _WHOLE * np.maximum(theirs, 1.0)
    return found


def beside_mesh(count: int, teeth: Iterable[int], distance: int) -> NDArray[np.bool_]:
    """Return which orders stand so many orders beside a mesh harmonic, on either side, shape (count,)."""
    found = np.zeros(count, dtype=bool)
    for each in teeth:
        for sign in (-1, 1):
            places = np.arange(each, count + distance, each) + sign * distance
            found[places[(places > 0) & (places < count)]] = True
    return found


def gear_indicators(
    average: WheelAverage, teeth: tuple[int, ...], shared: NDArray[np.bool_] | None = None
) -> GearIndicators:
    """Return the indicators of a wheel.

    Args:
        average: of the wheel.
        teeth: of it, or of all wheels that turn with it.
        shared: (order,) orders that another wheel has too.
    """
    count = average.lines.size
    mesh = beside_mesh(count, teeth, 0)
    first = beside_mesh(count, teeth, 1) & ~mesh
    regular = mesh if shared is None else mesh | (shared[:count] & ~first)
    regular[: SHAFT_ORDERS + 1] = True
    power, noise = np.square(np.abs(average.lines)), average.noise
    turn = average.signal()
    residual, difference = average.signal(~regular), average.signal(~(regular | first))
    meshing = float(np.abs(average.lines[mesh]).sum())
    sides = float(np.abs(average.lines[beside_mesh(count, (min(teeth),), 1)][:2]).sum())
    variance = float(np.mean(np.square(residual)))
    return GearIndicators(
        fm0=_over(float(np.ptp(turn)), meshing),
        fm4=_moment(difference, 4),
        m6a=_moment(difference, 6),
        sideband_level=_over(sides, float(np.std(turn))),
        variance=variance or None,
        residual=_over(float(power[~regular].sum()), float(noise[~regular].sum())),
        sideband=_over(float(power[first].sum()), float(power[mesh].sum())),
        unlike=_moment(residual, 4),
    )


def _moment(signal: NDArray[np.float64], degree: int) -> float | None:
    """Return the mean of a power over that of the mean square, or None of a silent signal."""
    square = float(np.mean(np.square(signal)))
    return _over(float(np.mean(signal**degree)), square ** (degree / 2))


def _over(value: float, other: float) -> float | None:
    found = value / other if other > 0.0 else math.nan
    return found if math.isfinite(found) and found > 0.0 else None
