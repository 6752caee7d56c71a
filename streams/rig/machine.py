"""The machine that a simulated rig is, and the life of its bearing: how its damage grows."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np

from models.machine.bearing import Bearing, CatalogueEntry, catalogue_entry, from_catalogue
from models.machine.rig import Rig, RigParameters
from models.machine.scene import Defect, Floor
from models.solve.nominal_rigs import nominal_rig
from models.solve.registry import IGNORES_DEPTH, RIGS
from models.solve.response import CASING
from models.words.request import Sensor

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


BEARING = "1205 ETN9"
"""The bearing of the bench."""
RADIAL_BEARING = "6205"
"""One with the same bore, for models that do not take the contact angle of the bench's."""


@dataclass(frozen=True)
class RigMachine:
    """What a rig simulates.

    Attributes:
        nominal: parameters from which the true ones deviate; they name the model.
        bearing: that wears out.
        sensor: of the model, whose acceleration the accelerometer shows, or None for the model's first.
        gain: share of that acceleration which reaches the accelerometer.
    """

    nominal: RigParameters
    bearing: Bearing
    sensor: Sensor | None = None
    gain: float = 1.0

    @property
    def model(self) -> str:
        """Name of the model."""
        return self.nominal.model

    @property
    def is_bench(self) -> bool:
        """Whether it is the bench of the thesis."""
        return self == RigMachine(Rig(), from_catalogue(BEARING))

    @cached_property
    def effects(self) -> frozenset[str]:
        """What the model describes, names in ``models.machine.scene.EFFECTS``."""
        from models.solve.registry import solvers

        return frozenset().union(*(solver.effects for solver in solvers(self.model)))

    def limits(self, sensor: Sensor) -> Iterator[str]:
        """Yield what is different from the bench of the thesis, in sentences; ``sensor`` is the one that is shown."""
        if self.bearing.designation != BEARING:
            yield f"its bearing is a {self.bearing.designation}"
        if sensor not in CASING:
            yield f"its accelerometer shows sensor {sensor} of {self.model}, which has no casing"
        if "rough_floor" not in self.effects:
            yield "the floor of its defect is smooth"
        if self.model in IGNORES_DEPTH:
            yield f"no map gives its V_eq: {IGNORES_DEPTH[self.model]}"


def machine_of(
    model: str = Rig.model, bearing: str | None = None, sensor: Sensor | None = None, gain: float = 1.0
) -> RigMachine:
    """Return a machine by the name of its model and the designation of its bearing.

    Without a designation the bearing is that of the bench, or ``RADIAL_BEARING`` where the model does not take it.

    Raises:
        ValueError: model or bearing are unknown, or the model does not take the bearing.
    """
    if model not in RIGS:
        raise ValueError(f"unknown model {model!r}; known are: {', '.join(RIGS)}")
    kind = RIGS[model]
    if bearing is None:
        bearing = BEARING if _refusal(kind, catalogue_entry(BEARING)) is None else RADIAL_BEARING
    try:
        entry = catalogue_entry(bearing)
    except KeyError as error:
        raise ValueError(f"bearing: {error.args[0]}") from None
    if (refusal := _refusal(kind, entry)) is not None:
        others = ", ".join(name for name, other in RIGS.items() if _refusal(other, entry) is None)
        raise ValueError(f"{refusal}; models that take it: {others or 'none'}")
    own = kind is Rig and entry.bearing.designation == BEARING
    return RigMachine(Rig() if own else nominal_rig(kind, entry), entry.bearing, sensor, gain)


def _refusal(kind: type[RigParameters], entry: CatalogueEntry) -> str | None:
    """Return why a model does not take a bearing, None where it does."""
    try:
        nominal_rig(kind, entry).check_bearing(entry.bearing)
    except ValueError as error:
        return str(error)
    return None
