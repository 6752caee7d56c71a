"""Faults of the teeth of one wheel: what they take from the flanks, and what they add to the compliance.

Teeth count from 0 in the order in which they mesh. Gaps are along the line of action, m, positive where material is
missing.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from models.gears.teeth.tooth import crack_compliance
from models.words.checks import check_numbers, check_whole

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.gears.teeth.geometry import ToothedWheel
    from models.gears.teeth.rack import ToothProfile
    from models.gears.teeth.tooth import Plane

    Array = NDArray[np.float64]


@dataclass(frozen=True)
class Flank:
    """The places of contact on the flank of one wheel.

    Attributes:
        profile, wheel: of the teeth.
        roll: roll angles of the contacts, rad, shape (..., slices).
        edges: of the slices along the face, m, shape (slices + 1,).
        plane: of stress or strain.
    """

    profile: ToothProfile
    wheel: ToothedWheel
    roll: Array
    edges: Array
    plane: Plane

    @property
    def radius(self) -> Array:
        """Radii of the contacts, m."""
        return self.profile.base_radius * np.hypot(1.0, self.roll)

    @property
    def height(self) -> Array:
        """Place on the path from the begin of the involute (0) to the tip (1)."""
        low, high = self.profile.roll(self.profile.form_radius), self.profile.roll(self.profile.tip_radius)
        return (self.roll - low) / (high - low)

    def within(self, begin: float, end: float) -> Array:
        """Return the share of each slice between two places along the face, m, shape (slices,)."""
        low, high = np.maximum(self.edges[:-1], begin), np.minimum(self.edges[1:], end)
        return np.clip(high - low, 0.0, None) / np.diff(self.edges)


@dataclass(frozen=True)
class Effect:
    """What faults do where a tooth is in contact; arrays in the shape of the contacts.

    Attributes:
        gap: missing material, m.
        cover: share of the slice that still carries.
        compliance: added to the tooth's, m^2/N.
    """

    gap: Array
    cover: Array
    compliance: Array

    def __add__(self, other: Effect) -> Effect:
        """Return both together."""
        return Effect(self.gap + other.gap, self.cover * other.cover, self.compliance + other.compliance)

    @classmethod
    def of_gap(cls, gap: Array) -> Effect:
        """Return missing material alone."""
        return cls(gap, np.ones_like(gap), np.zeros_like(gap))


class ToothFault(ABC):
    """A fault that single teeth have."""

    @abstractmethod
    def teeth(self, count: int) -> tuple[int, ...]:
        """Return the teeth of so many that have it."""

    def edges(self, face_width: float) -> tuple[float, ...]:
        """Return where it begins and ends along the face, m."""
        del face_width
        return ()

    @abstractmethod
    def effect(self, flank: Flank, tooth: int) -> Effect:
        """Return what it does to a tooth."""


@dataclass(frozen=True)
class FaultOfOneTooth(ToothFault):
    """A fault of one tooth, by its number."""

    kind: ClassVar[str]
    tooth: int

    def __post_init__(self) -> None:
        """Raise a ValueError where the number cannot be one."""
        check_whole(self.tooth, f"{self.kind} tooth", 0)

    def teeth(self, count: int) -> tuple[int, ...]:
        """Return the tooth that has it."""
        return _one_tooth(self.tooth, count, self.kind)


@dataclass(frozen=True)
class ToothCrack(FaultOfOneTooth):
    """A crack in the root of one tooth, at the fillet's 30 deg tangent on the loaded side.

    Attributes:
        depth: length of the crack from the fillet's surface, m.
        angle: between crack and centre line of the tooth, rad; 90 deg, straight across, is what was checked.
        extent: along the face from its begin, m; None for the whole face.
    """

    kind = "crack"
    depth: float
    angle: float = math.pi / 2.0
    extent: float | None = None

    def __post_init__(self) -> None:
        """Raise a ValueError that names a field which cannot be."""
        super().__post_init__()
        check_numbers(self, "crack ", "not negative", "depth")
        check_numbers(self, "crack ", "positive", "angle")
        if self.angle > math.pi / 2.0:
            raise ValueError(f"crack angle must be at most 90 deg, got {math.degrees(self.angle):.4g} deg")
        if self.extent is not None:
            check_numbers(self, "crack ", "positive", "extent")

    def edges(self, face_width: float) -> tuple[float, ...]:
        """Return where it ends along the face, m."""
        return () if self.extent is None else (min(self.extent, face_width),)

    def effect(self, flank: Flank, tooth: int) -> Effect:
        """Return what it adds to the compliance."""
        added = crack_compliance(flank.profile, flank.wheel, flank.roll, self.depth, self.angle, flank.plane)
        share = flank.within(0.0, math.inf if self.extent is None else self.extent)
        return Effect(np.zeros_like(added), np.ones_like(added), added * share)


@dataclass(frozen=True)
class ToothSpall(FaultOfOneTooth):
    """A spall with vertical walls on the flank of one tooth.

    Attributes:
        length: along the profile (difference of radii), m.
        width: along the face, m.
        depth: m.
        radius: of its middle, m; None for the reference circle.
        place: of its middle along the face, m; None for the middle.
    """

    kind = "spall"
    length: float
    width: float
    depth: float
    radius: float | None = None
    place: float | None = None

    def __post_init__(self) -> None:
        """Raise a ValueError that names a field which cannot be."""
        super().__post_init__()
        check_numbers(self, "spall ", "positive", "length", "width", "depth")

    def edges(self, face_width: float) -> tuple[float, ...]:
        """Return where it begins and ends along the face, m."""
        middle = 0.5 * face_width if self.place is None else self.place
        low, high = max(middle - 0.5 * self.width, 0.0), min(middle + 0.5 * self.width, face_width)
        if low >= high:
            raise ValueError(f"spall place must be on the face of {1e3 * face_width:.4g} mm, got {1e3 * middle:.4g} mm")
        return low, high

    def effect(self, flank: Flank, tooth: int) -> Effect:
        """Return what it takes from the flank."""
        middle = flank.profile.reference_radius if self.radius is None else self.radius
        if not flank.profile.form_radius <= middle <= flank.profile.tip_radius:
            raise ValueError(
                f"spall radius must be on the flank, {1e3 * flank.profile.form_radius:.5g} to "
                f"{1e3 * flank.profile.tip_radius:.5g} mm, got {1e3 * middle:.5g} mm"
            )
        across = np.abs(flank.radius - middle) <= 0.5 * self.length
        along = flank.within(*self.edges(float(flank.edges[-1]))) > 0.5
        return Effect.of_gap(np.where(across & along, self.depth, 0.0))


@dataclass(frozen=True)
class Pitting(FaultOfOneTooth):
    """Pits on a band of the flank of one tooth: they carry nothing, the rest of the face does.

    Attributes:
        share: of the band's area that is pitted.
        length: of the band along the profile (difference of radii), m.
        radius: of its middle, m; None for the reference circle.
    """

    kind = "pitting"
    share: float
    length: float
    radius: float | None = None

    def __post_init__(self) -> None:
        """Raise a ValueError that names a field which cannot be."""
        super().__post_init__()
        check_numbers(self, "pitting ", "not negative", "share")
        check_numbers(self, "pitting ", "positive", "length")
        if self.share >= 1.0:
            raise ValueError(f"pitting share must be below 1, got {self.share!r}")

    def effect(self, flank: Flank, tooth: int) -> Effect:
        """Return what no longer carries."""
        middle = flank.profile.reference_radius if self.radius is None else self.radius
        inside = np.abs(flank.radius - middle) <= 0.5 * self.length
        cover = np.where(inside, 1.0 - self.share, 1.0)
        return Effect(np.zeros_like(cover), cover, np.zeros_like(cover))


@dataclass(frozen=True)
class PitchError(ToothFault):
    """Teeth that are out of place.

    Attributes:
        positions: of the flanks of all teeth along the line of action, m; positive stands back, meets later.
    """

    positions: tuple[float, ...]

    def __post_init__(self) -> None:
        """Raise a ValueError where a position is not finite."""
        if not all(map(math.isfinite, self.positions)):
            raise ValueError(f"pitch error positions must be finite, got {self.positions!r}")

    @classmethod
    def of_tooth(cls, teeth: int, tooth: int, position: float) -> Self:
        """Return one tooth out of place among others in place."""
        _one_tooth(tooth, teeth, "pitch error")
        return cls(tuple(position if k == tooth else 0.0 for k in range(teeth)))

    @classmethod
    def drawn(cls, teeth: int, deviation: float, seed: int) -> Self:
        """Return single pitch deviations with a standard deviation, m, as positions that close after a turn."""
        single = np.random.default_rng(seed).normal(0.0, deviation, teeth)
        positions = np.cumsum(single - single.mean())
        return cls(tuple(float(value) for value in positions - positions.mean()))

    def teeth(self, count: int) -> tuple[int, ...]:
        """Return the teeth that have it."""
        if len(self.positions) != count:
            raise ValueError(f"pitch error positions must be {count}, one a tooth, got {len(self.positions)}")
        return tuple(k for k, position in enumerate(self.positions) if position != 0.0)

    def effect(self, flank: Flank, tooth: int) -> Effect:
        """Return what it does."""
        return Effect.of_gap(np.full_like(flank.roll, self.positions[tooth]))


@dataclass(frozen=True)
class ProfileError(ToothFault):
    """A deviation of the flanks of all teeth, or of one.

    Attributes:
        slope: missing at the tip, present at the root, m: grows evenly from -slope / 2 to slope / 2.
        crown: missing at tip and root, m: parabola about the middle of the flank.
        waviness: amplitude of waves along the path of contact, m.
        waves: their number over the flank.
        tooth: its number; None for all.
    """

    slope: float = 0.0
    crown: float = 0.0
    waviness: float = 0.0
    waves: float = 1.0
    tooth: int | None = None

    def __post_init__(self) -> None:
        """Raise a ValueError that names a field which cannot be."""
        check_numbers(self, "profile error ", "finite", "slope", "crown", "waviness", "waves")

    def teeth(self, count: int) -> tuple[int, ...]:
        """Return the teeth that have it."""
        return tuple(range(count)) if self.tooth is None else _one_tooth(self.tooth, count, "profile error")

    def effect(self, flank: Flank, tooth: int) -> Effect:
        """Return what it does."""
        height = flank.height
        curve = self.slope * (height - 0.5) + self.crown * (2.0 * height - 1.0) ** 2
        return Effect.of_gap(curve + self.waviness * np.sin(math.tau * self.waves * height))


@dataclass(frozen=True)
class Eccentricity:
    """A base circle whose centre is off the axis: the flanks come and go once a turn.

    The change of backlash and of the contact path is of second order and left out.

    Attributes:
        amount: distance of the centre from the axis, m.
        phase: turn of the wheel at which the flanks stand back most, rad.
    """

    amount: float
    phase: float = 0.0

    def __post_init__(self) -> None:
        """Raise a ValueError that names a field which cannot be."""
        check_numbers(self, "eccentricity ", "not negative", "amount")
        check_numbers(self, "eccentricity ", "finite", "phase")

    def errors(self, count: int) -> Array:
        """Return the displacement at equal steps of a turn, m, shape (count,)."""
        return self.amount * np.cos(math.tau * np.arange(count) / count - self.phase)


GearFault = ToothFault | Eccentricity


def _one_tooth(tooth: int, count: int, name: str) -> tuple[int, ...]:
    if not 0 <= tooth < count:
        raise ValueError(f"{name} tooth must be from 0 to {count - 1}, got {tooth}")
    return (tooth,)
