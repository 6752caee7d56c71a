"""Limits of the unknown parameters and the constraints between them (thesis, Eqs. 59 to 80 and Table 16)."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

Interval = tuple[float, float]

# Eq. 73 asks for alpha_c > 0; this is as good as zero beside the 1000 1/s that the contact damping can reach.
LEAST_ALPHA_C = 1e-6


@dataclass(frozen=True)
class AdmissibleLimits:
    """Admissible intervals of Eq. 80, SI units; damping ratios are pure numbers.

    The defaults are Table 16 and section 4.4.1.

    Attributes:
        m_r, k_r: Eqs. 67 and 68.
        f_r: highest natural frequency of the linearised rig, Hz (Eq. 66), at each load and in both directions.
        zeta_1, zeta_2: damping ratios of the contact at ``f_1`` and ``f_2`` (Eqs. 70 to 72).
        beta_c: Eq. 74.
        alpha_c: Eq. 73 is its lower end.
        zeta_i, zeta_r: damping ratios of shaft and resonator at ``f_i`` and ``f_d`` (Eqs. 75 to 78).
        c_i, c_r: additional limits of these coefficients.
        clearance: Eq. 79, m.
        known: the other parameters (m_i, m_o, m_b, k_i, k_c), which the study takes as known: where one is freed, its
            interval over its configured value.
        f_1, f_2, f_i, f_d: frequencies of the damping ratios, Hz (section 4.4.1).
    """

    m_r: Interval = (0.1, 5.0)
    k_r: Interval = (0.1e9, 10e9)
    f_r: Interval = (4500.0, 9500.0)
    zeta_1: Interval = (1e-3, 0.15)
    zeta_2: Interval = (1e-3, 0.15)
    beta_c: Interval = (0.25e-5, 2.5e-5)
    alpha_c: Interval = (LEAST_ALPHA_C, math.inf)
    zeta_i: Interval = (1e-3, 0.15)
    zeta_r: Interval = (1e-3, 0.15)
    c_i: Interval = (0.0, math.inf)
    c_r: Interval = (0.0, math.inf)
    clearance: Interval = (0.0, 20e-6)
    known: Interval = (0.5, 2.0)
    f_1: float = 400.0
    f_2: float = 1500.0
    f_i: float = 400.0
    f_d: float = 8000.0

    def __post_init__(self) -> None:
        """Raise a ValueError that names an interval whose ends are negative or do not ascend."""
        for name in INTERVALS:
            low, high = getattr(self, name)
            if not 0.0 <= low < high:
                raise ValueError(f"limits of {name}: expected 0 <= LO < HI, got {low!r} and {high!r}")
        if not 0.0 < self.f_1 < self.f_2:
            raise ValueError(f"f_1 and f_2 must be positive and ascend, got {self.f_1!r} and {self.f_2!r} Hz")

    def with_intervals(self, intervals: dict[str, Interval]) -> AdmissibleLimits:
        """Return these limits with some intervals replaced; ValueError for a name that has none."""
        for name in intervals:
            if name not in INTERVALS:
                raise ValueError(f"{name!r} has no limits; expected one of {', '.join(INTERVALS)}")
        return replace(self, **intervals)


INTERVALS = (*(field.name for field in fields(AdmissibleLimits) if not field.name.startswith("f_")), "f_r")
"""Names of the limits that are intervals."""


def intersection(*intervals: Interval) -> Interval:
    """Return what intervals have in common; its ends do not ascend where that is nothing."""
    return max(low for low, _ in intervals), min(high for _, high in intervals)


def beta_c_interval(limits: AdmissibleLimits, alpha_c: float | None) -> Interval:
    """Return the beta_c that keep zeta_1 and zeta_2 within their limits, s, for a known or an unknown alpha_c, 1/s."""
    w_1, w_2 = 2.0 * math.pi * limits.f_1, 2.0 * math.pi * limits.f_2
    ratios = ((w_1, limits.zeta_1), (w_2, limits.zeta_2))
    if alpha_c is not None:
        return intersection(
            limits.beta_c, *(((2.0 * lo - alpha_c / w) / w, (2.0 * hi - alpha_c / w) / w) for w, (lo, hi) in ratios)
        )
    # The intervals that either ratio leaves to alpha_c must overlap, and reach its own.
    (lo_1, hi_1), (lo_2, hi_2), span = limits.zeta_1, limits.zeta_2, w_2**2 - w_1**2
    crossing = 2.0 * (w_2 * lo_2 - w_1 * hi_1) / span, 2.0 * (w_2 * hi_2 - w_1 * lo_1) / span
    low, high = limits.alpha_c
    own = (((2.0 * lo * w - high) / w**2, (2.0 * hi * w - low) / w**2) for w, (lo, hi) in ratios)
    return intersection(limits.beta_c, crossing, *own)


def alpha_c_interval(limits: AdmissibleLimits, beta_c: float) -> Interval:
    """Return the alpha_c that keep zeta_1 and zeta_2 within their limits, 1/s, for a beta_c, s."""
    ratios = ((2.0 * math.pi * limits.f_1, limits.zeta_1), (2.0 * math.pi * limits.f_2, limits.zeta_2))
    return intersection(
        limits.alpha_c, *((2.0 * lo * w - beta_c * w**2, 2.0 * hi * w - beta_c * w**2) for w, (lo, hi) in ratios)
    )


def wide_limits() -> AdmissibleLimits:
    """Return limits for a machine of which nothing is known but that it is made of steel: Table 16 is of one bench."""
    return AdmissibleLimits(
        m_r=(1e-3, 100.0),
        k_r=(1e7, 1e11),
        f_r=(500.0, 50e3),
        zeta_1=(0.0, 1.0),
        zeta_2=(0.0, 1.0),
        beta_c=(1e-7, 1e-4),
        zeta_i=(1e-4, 1.0),
        zeta_r=(1e-4, 1.0),
        known=(0.02, 50.0),
    )
