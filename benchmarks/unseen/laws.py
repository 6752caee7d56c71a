"""Growth of damage as published run-to-failure curves show it: the laws of the lives of ``benchmarks.unseen.judge``.

Written from the curves alone: the code here shares nothing with the laws of ``models.lives``, on which libraries are
fitted. Published curves are of a level (RMS) or, in the thesis, of V_eq; a shape of the level is taken as that of
ln V_eq, since the RMS rises with about a third power of it. Sources, by the names used below:

- Thesis: Gabrielli, doctoral thesis, University of Ferrara, 2022: Table 22 and what it says of Figs. 60 to 65 (E1 to
  E6, V_eq up to 0.05 mm3/mm).
- PRONOSTIA: Nectoux et al., IEEE PHM 2012; the RMS of eleven of its runs, read from plots of their histories.
- XJTU-SY: Wang et al., IEEE Trans. Reliability 69(1), 2020: gradual, two-stage and sudden ends. As described there
  and in later work on the set; no recording of it was at hand.
- Paris and Erdogan, J. Basic Eng. 85, 1963; Forman et al., J. Basic Eng. 89, 1967.
- Hoeprich, J. Tribology 114, 1992: spalls of rolling bearings spread in spurts.
- Williams et al., MSSP 15, 2001: levels fall again as the edges of a spall are rolled smooth.
- Rosado et al., Tribology Trans. 53, 2010: spalls spread along the race first, and are ground deeper later.

A law gives V_eq over the threshold on a grid of shares of the life: from its start, never falling, to 1 at the end.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Rng = np.random.Generator

THRESHOLD = 0.05e-6
"""V_th of the thesis, m2 (0.05 mm3/mm)."""
START = (0.6e-9, 4e-9)
"""Range of V_eq at the onset, m2: the constants c of Table 22."""
DURATIONS = (2.0 * 3600.0, 20.0 * 3600.0)
"""Range of the time from the onset to the threshold, s; those of Table 22 are 4.3 to 11.8 h."""
END_DEPTHS = (3.5e-6, 22e-6)
"""Range of the depth at the threshold, m: its extent is then 6 to 36 degrees (thesis: up to 50 degrees, 32 um)."""

# Rows of Table 22: a in 1e-7, b in 1e-5, c in 1e-3; V_eq in mm3/mm, time in minutes.
_TABLE_22 = (
    (3.42, 6.53, 1.35),
    (6.22, 1.28, 1.68),
    (1.49, 0.25, 3.48),
    (3.41, 2.99, 1.18),
    (6.62, 2.24, 0.63),
    (0.55, 3.05, 1.14),
)
_GRID = np.linspace(0.0, 1.0, 1501)


@dataclass(frozen=True, eq=False)
class Growth:
    """Growth of the damage of one life; arrays of shape (n,).

    Attributes:
        law: its name in ``LAWS`` or ``OTHER_LAWS``.
        t: time since the onset, s, from 0 to the end of the life.
        v_eq: volume per width, m2, never falling; ``THRESHOLD`` at the end, except where it was held.
        h_d: depth, m.
        edge: factor on measured levels by the state of the spall's edges.
    """

    law: str
    t: Floats
    v_eq: Floats
    h_d: Floats
    edge: Floats

    @property
    def crossing(self) -> float:
        """Time of the threshold, s since the onset; infinity where the damage was held below it."""
        return float(self.t[-1]) if self.v_eq[-1] >= THRESHOLD * (1.0 - 1e-9) else math.inf

    def at(self, t: Floats) -> tuple[Floats, Floats, Floats]:
        """Return V_eq (m2), depth (m) and factor on levels at times since the onset, s, each of the shape of ``t``."""
        v_eq, h_d, edge = (np.interp(t, self.t, values) for values in (self.v_eq, self.h_d, self.edge))
        return v_eq, h_d, edge

    def held_from(self, t: float, until: float) -> Growth:
        """Return the growth that stands still from ``t`` to ``until``, s since the onset."""
        kept = self.t < t
        last = (float(values[0]) for values in self.at(np.array([t])))
        ends = [(value, value) for value in last]
        arrays = ((self.v_eq, ends[0]), (self.h_d, ends[1]), (self.edge, ends[2]))
        v_eq, h_d, edge = (np.concatenate([values[kept], end]) for values, end in arrays)
        return replace(self, t=np.concatenate([self.t[kept], [t, until]]), v_eq=v_eq, h_d=h_d, edge=edge)


Law = Callable[[Rng, float], Floats]


def _powered(share: Floats, power: float) -> Floats:
    return np.asarray(share**power, dtype=np.float64)


def _ramp(low: float, high: float) -> Floats:
    """Return 0 before one share of the life, 1 after another, linear between."""
    return np.clip((_GRID - low) / (high - low), 0.0, 1.0)


def _table_22(rng: Rng, start: float) -> Floats:
    """Quadratics of Table 22 of the thesis, each coefficient drawn about one row's."""
    a, b, _ = np.array(_TABLE_22[rng.integers(len(_TABLE_22))]) * np.exp(0.2 * rng.standard_normal(3))
    a, b, c = 1e-7 * a, 1e-5 * b, start * THRESHOLD * 1e6
    x = _GRID * (-b + math.sqrt(b * b + 4.0 * a * (0.05 - c))) / (2.0 * a)
    return np.asarray((a * x * x + b * x + c) / 0.05)


def _gradual(rng: Rng, start: float) -> Floats:
    """PRONOSTIA 1_1 and 1_3 (horizontal), most of XJTU-SY: the level rises exponentially, at a steady pace."""
    bend = rng.uniform(0.85, 1.3)
    return start ** (1.0 - _powered(_GRID, bend))


def _paris(rng: Rng, start: float) -> Floats:
    """Paris and Erdogan for the volume, dV/dt ~ V^m: the steady run-up of thesis E4."""
    m = rng.uniform(1.2, 2.0)
    return np.asarray((start ** (1.0 - m) + _GRID * (1.0 - start ** (1.0 - m))) ** (1.0 / (1.0 - m)))


def _forman(rng: Rng, start: float) -> Floats:
    """Forman et al.: Paris with unstable growth at a critical size just above the threshold."""
    m, critical = rng.uniform(0.5, 1.4), rng.uniform(1.02, 1.6)
    v = np.geomspace(start, 1.0, 3000)
    time_per_volume = (1.0 - v / critical) * v**-m
    t = np.concatenate([[0.0], np.cumsum(0.5 * (time_per_volume[1:] + time_per_volume[:-1]) * np.diff(v))])
    return np.interp(_GRID, t / t[-1], v)


def _two_stage(rng: Rng, start: float) -> Floats:
    """XJTU-SY, PRONOSTIA 1_1 (horizontal, from 2700): slow growth at a steady rate, then a much faster stage."""
    change = rng.uniform(0.5, 0.9)
    between = start + (1.0 - start) * rng.uniform(0.06, 0.35)
    slow = start + (between - start) * _ramp(0.0, change)
    return slow * (1.0 / between) ** _powered(_ramp(change, 1.0), rng.uniform(0.8, 1.5))


def _plateau_end(rng: Rng, start: float) -> Floats:
    """PRONOSTIA 1_5, 2_4, 2_6, 2_7, part of XJTU-SY: nearly constant for most of the life, then a sudden end."""
    change = rng.uniform(0.7, 0.96)
    plateau = min(start * rng.uniform(1.2, 4.0), 0.4)
    slow = start * (plateau / start) ** _ramp(0.0, change)
    return slow * (1.0 / plateau) ** _powered(_ramp(change, 1.0), rng.uniform(0.6, 1.5))


def _steps(rng: Rng, start: float) -> Floats:
    """PRONOSTIA 3_1 and 3_2; Hoeprich: the spall spreads in spurts, with little growth between them."""
    count = int(rng.integers(3, 9))
    sizes = rng.exponential(size=count) + 0.1
    creep = rng.uniform(0.1, 0.4)
    ln_v = creep * _GRID
    # The last one ends the life.
    places = np.append(rng.uniform(0.03, 0.98, count - 1), 0.985)
    for size, at in zip(sizes / sizes.sum(), places, strict=True):
        ln_v = ln_v + (1.0 - creep) * size * _ramp(at, at + rng.uniform(0.004, 0.02))
    return start ** (1.0 - ln_v / ln_v[-1])


def _settling(rng: Rng, start: float) -> Floats:
    """PRONOSTIA 2_1: a quick rise that settles at a higher level; in half of the lives with a late end."""
    if rng.uniform() < 0.5:
        return _decelerating(rng, start)
    settled, late = rng.uniform(0.25, 0.6), rng.uniform(0.8, 0.95)
    rise = (1.0 - np.exp(-_GRID / rng.uniform(0.04, 0.15))) * (0.85 + 0.15 * _GRID)
    return (
        start
        + (settled - start) * rise
        + (1.0 - start - (settled - start) * rise[-1]) * _powered(_ramp(late, 1.0), rng.uniform(1.0, 2.0))
    )


def _decelerating(rng: Rng, start: float) -> Floats:
    """The rise of PRONOSTIA 2_1 and 1_7 alone: ever slower to the threshold, as a power of time below one."""
    return np.asarray(start + (1.0 - start) * _powered(_GRID, rng.uniform(0.3, 0.7)))


def _logistic(rng: Rng, start: float) -> Floats:
    """A spall that spreads over the loaded zone and slows as it fills it (PRONOSTIA 1_7, 800 to 1500, as an S)."""
    reached, middle = rng.uniform(0.75, 0.95), rng.uniform(0.3, 0.6)
    width = (1.0 - middle) / math.log(reached / (1.0 - reached))
    s = 1.0 / (1.0 + np.exp(-(_GRID - middle) / width))
    return np.asarray(start + (1.0 - start) * (s - s[0]) / (s[-1] - s[0]))


def _stall_jump(rng: Rng, start: float) -> Floats:
    """PRONOSTIA 1_1 (vertical, 1500 to 2500): growth, a standstill, a jump, growth again."""
    stop = rng.uniform(0.15, 0.5)
    resume = stop + rng.uniform(0.2, min(0.5, 0.9 - stop))
    stalled = start + (1.0 - start) * rng.uniform(0.05, 0.35)
    jumped = min(stalled * rng.uniform(1.5, 3.0), 0.9)
    grown = start + (stalled - start) * _powered(_ramp(0.0, stop), rng.uniform(0.7, 2.0))
    jump = (jumped - stalled) * _ramp(resume, resume + 0.02)
    return grown + jump + (1.0 - jumped) * _powered(_ramp(resume + 0.02, 1.0), rng.uniform(1.0, 2.5))


def _saw_tooth(rng: Rng, start: float) -> Floats:
    """Williams et al., PRONOSTIA 2_1 (200 to 500): fragments break off; between, the level falls (``_edges``)."""
    steady = start ** (1.0 - _powered(_GRID, rng.uniform(0.8, 1.6)))
    return np.asarray(0.5 * (steady + start + (1.0 - start) * _powered(_GRID, rng.uniform(1.0, 2.0))))


def _depth_after_extent(rng: Rng, start: float) -> Floats:
    """Rosado et al.: the spall spreads along the race, later only deepens; see ``_depths``."""
    return np.asarray(start + (1.0 - start) * _powered(_GRID, rng.uniform(1.2, 2.6)))


LAWS: dict[str, Law] = {
    "table_22": _table_22,
    "gradual": _gradual,
    "paris": _paris,
    "forman": _forman,
    "two_stage": _two_stage,
    "plateau_end": _plateau_end,
    "steps": _steps,
    "settling": _settling,
    "logistic": _logistic,
    "stall_jump": _stall_jump,
    "saw_tooth": _saw_tooth,
    "depth_after_extent": _depth_after_extent,
}
"""Laws of the judged lives, in a fixed order."""
OTHER_LAWS: dict[str, Law] = {"decelerating": _decelerating}
"""Laws of single questions."""
STAND_STILL = ("plateau_end", "steps", "settling", "stall_jump")
"""Laws under which the damage nearly stands still for a part of the life: ``no_growth`` may be right there."""


def draw_growth(law: str, rng: Rng, durations: tuple[float, float] = DURATIONS) -> Growth:
    """Return the growth of one life.

    Args:
        law: a name in ``LAWS`` or ``OTHER_LAWS``.
        rng: of all draws.
        durations: range of the time to the threshold, s, drawn in the logarithm.

    Raises:
        KeyError: a law that there is not.
    """
    shape = {**LAWS, **OTHER_LAWS}[law]
    start, duration = _uniform_ln(rng, START) / THRESHOLD, _uniform_ln(rng, durations)
    v = np.interp(_warped(rng), _GRID, shape(rng, start))
    # Rounding may not make it fall, or end beside the threshold.
    v = np.maximum.accumulate(v)
    v[-1] = 1.0
    h_d = _depths(law, rng, np.minimum(v, 1.0))
    return Growth(law, duration * _GRID, THRESHOLD * np.minimum(v, 1.0), h_d, _edges(law, rng))


def _uniform_ln(rng: Rng, limits: tuple[float, float]) -> float:
    return math.exp(rng.uniform(math.log(limits[0]), math.log(limits[1])))


def _warped(rng: Rng) -> Floats:
    """Return shares of the life at which a law is read: its pace varies, correlated over some per cent of the life."""
    sd, memory = rng.uniform(0.05, 0.5), rng.uniform(0.01, 0.1)
    decay = math.exp(-(_GRID[1] - _GRID[0]) / memory)
    pace = np.empty_like(_GRID)
    pace[0], noise = rng.standard_normal(), rng.standard_normal(_GRID.size)
    for i in range(1, pace.size):
        pace[i] = decay * pace[i - 1] + math.sqrt(1.0 - decay * decay) * noise[i]
    gone = np.concatenate([[0.0], np.cumsum(np.exp(sd * pace[1:]))])
    return np.asarray(gone / gone[-1])


def _depths(law: str, rng: Rng, v: Floats) -> Floats:
    """Return the depth, m, for V_eq over the threshold."""
    share = rng.uniform(0.2, 0.65)
    if law != "depth_after_extent":
        return np.asarray(_uniform_ln(rng, END_DEPTHS) * v**share)
    # The depth of the first layer, then a floor that is ground down at constant extent.
    spread = rng.uniform(0.15, 0.5)
    return np.asarray(_uniform_ln(rng, (8e-6, 30e-6)) * np.maximum(v, spread))


def _edges(law: str, rng: Rng) -> Floats:
    """Return the factor on levels: sharp edges after each fragment, rolled smooth until the next."""
    if law != "saw_tooth":
        return np.ones_like(_GRID)
    breaks = np.sort(rng.uniform(0.0, 1.0, int(rng.integers(5, 16))))
    sharp, smooth, memory = rng.uniform(0.1, 0.3), rng.uniform(0.1, 0.3), rng.uniform(0.03, 0.1)
    since = _GRID - np.concatenate([[-0.05], breaks])[np.searchsorted(breaks, _GRID, side="right")]
    return np.asarray(np.exp((sharp + smooth) * np.exp(-since / memory) - smooth))
