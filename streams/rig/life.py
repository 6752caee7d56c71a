"""The life of the bearing of a simulated rig: how its damage grows, and parameters that no map describes exactly."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from models.machine.rig import RigParameters
from models.machine.scene import Defect, Floor

T = TypeVar("T", bound=RigParameters)

_SPREAD = (0.02, 0.05)
"""Smallest and largest relative deviation of a rig parameter from its nominal value."""
THRESHOLD = 0.05e-6
"""V_eq to which the growth laws are scaled, m2 (thesis, section 5.4.3)."""


@dataclass(frozen=True)
class Life:
    """Growth of the damage after the onset, in m2 and s (thesis, Table 22).

    V = V_0 + b t + a t^2.

    Attributes:
        onset: number of the first block with damage.
        h_threshold: depth where V reaches 0.05 mm3/mm, m.
        depth_share: share of ln V that ln h_d takes, the rest is extent.
    """

    onset: int
    v_0: float
    a: float
    b: float
    h_threshold: float
    depth_share: float

    def v_eq(self, t: float) -> float:
        """Return the volume per width at ``t`` seconds after the onset, m2; 0 before it."""
        return 0.0 if t < 0.0 else self.v_0 + self.b * t + self.a * t * t

    def time_to(self, v: float) -> float:
        """Return the time from onset to a volume ``v``, s (Table 22: the root ahead)."""
        missing = max(v - self.v_0, 0.0)
        return 2.0 * missing / (self.b + math.sqrt(self.b * self.b + 4.0 * self.a * missing))

    def defect(self, t: float, outer_race_radius: float, floor: Floor) -> Defect | None:
        """Return the defect at ``t`` seconds after the onset, or None before it."""
        v = self.v_eq(t)
        if v <= 0.0:
            return None
        h_d = self.h_threshold * (v / THRESHOLD) ** self.depth_share
        return Defect(dphi_d=v / (outer_race_radius * h_d), h_d=h_d, floor=floor)


def draw_life(rng: np.random.Generator, onset: int) -> Life:
    """Draw a life in the range of Table 22: 257 to 705 minutes to the threshold."""
    duration = rng.uniform(257.0, 705.0) * 60.0
    v_0 = rng.uniform(0.0012, 0.0035) * 1e-6
    # Share of the quadratic term in the growth to the threshold; in Table 22 it is 0.56 to 0.98.
    curved = rng.uniform(0.56, 0.98)
    growth = THRESHOLD - v_0
    return Life(
        onset=onset,
        v_0=v_0,
        a=curved * growth / duration**2,
        b=(1.0 - curved) * growth / duration,
        h_threshold=rng.uniform(6e-6, 16e-6),
        depth_share=rng.uniform(0.3, 0.6),
    )


def perturbed(rig: T, rng: np.random.Generator) -> T:
    """Return the rig with each parameter that differs between machines of its kind 2 to 5 % off, up or down."""
    names = rig.uncertain
    factors = 1.0 + rng.choice([-1.0, 1.0], len(names)) * rng.uniform(*_SPREAD, len(names))
    return replace(rig, **{name: getattr(rig, name) * float(f) for name, f in zip(names, factors, strict=True)})
