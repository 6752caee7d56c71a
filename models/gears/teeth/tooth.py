"""Compliance of a tooth, of the body under it and of its contact, for a face of unit width, m^2/N.

The tooth is a beam from the root circle along the true involute and fillet: bending, shear and axial energy (Yang and
Lin 1987; Tian 2004). The body below it yields as fitted by Sainsot, Velex and Duverger (J. Mech. Des. 126 (2004) 748,
coefficients for plane stress as printed by Chaari, Fakhfakh and Haddar, Eur. J. Mech. A 28 (2009) 461), or as the half
plane of Weber and Banaschek (1953). Most of the body's deflection is that of the neighbouring teeth too:
``shared_compliance`` is that part. Contact: constant by Yang and Sun (1985), or with the logarithm of the load by Weber
and Banaschek.

A helix is allowed for in the normal section: thickness times cos(beta), pressure angles likewise; compliances are then
along the normal, for unit length of the contact line.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from models.words.checks import check_choice, check_whole

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.gears.teeth.geometry import ToothedWheel
    from models.gears.teeth.rack import ToothProfile

    Array = NDArray[np.float64]

Contact = Literal["linear", "weber"]
Plane = Literal["stress", "strain"]
Foundation = Literal["sainsot", "weber"]
Level = Literal["secant", "tangent"]

SHEAR_FACTOR = 1.2
_NODES = 24
_STEP = 1e-6
_CRACK_LIMIT = 0.9
# Of a crack's compliance times E, see ``crack_compliance``: (a, b) for arm^2, arm * cos and cos^2. Fitted with 10
# elements a module; the 6 of the benchmark give the same to 1 %.
_CRACK = ((1.026, 1.546), (0.542, -1.491), (-0.001, 0.068))
# Constant of a neighbour's displacement, times E: see ``shared_compliance``.
_NEIGHBOUR = 0.57

# L*, M*, P*, Q* = A / theta^2 + B h^2 + C h / theta + D / theta + E h + F, h = root over hub radius.
_SAINSOT = np.array(
    [
        (-5.574e-5, -1.9986e-3, -2.3015e-4, 4.7702e-3, 0.0271, 6.8045),
        (60.111e-5, 28.100e-3, -83.431e-4, -9.9256e-3, 0.1624, 0.9086),
        (-50.952e-5, 185.50e-3, 0.0538e-4, 53.300e-3, 0.2895, 0.9236),
        (-6.2042e-5, 9.0889e-3, -4.0964e-4, 7.8297e-3, -0.1472, 0.6904),
    ]
)


@dataclass(frozen=True)
class StiffnessMethod:
    """How the stiffness of a mesh is computed.

    Attributes:
        contact: "weber" (with the logarithm of the load) or "linear" (Yang and Sun).
        plane: "stress" (thin wheels; Young's modulus as published for this method) or "strain" (wide ones).
        foundation: "sainsot" (ring, fits for plane stress) or "weber" (half plane).
        shared_body: whether the teeth in contact share the body's deflection, or, as published, each has its own.
        level: "secant": k = force over deflection, e the transmission error without load; "tangent": k = the slope at
            the force, e such that the deflection under the force is right.
        slices: of the face of helical wheels; a spur tooth is stiff along its face.
    """

    contact: Contact = "weber"
    plane: Plane = "stress"
    foundation: Foundation = "sainsot"
    shared_body: bool = True
    level: Level = "secant"
    slices: int = 24

    def __post_init__(self) -> None:
        """Raise a ValueError that names a field which is none of its choices."""
        check_choice(self.contact, "contact", ("linear", "weber"))
        check_choice(self.plane, "plane", ("stress", "strain"))
        check_choice(self.foundation, "foundation", ("sainsot", "weber"))
        check_choice(self.level, "level", ("secant", "tangent"))
        check_whole(self.slices, "slices", 1)


@dataclass(frozen=True)
class LoadedPoint:
    """Where a force acts on a tooth, all arrays of one shape.

    Attributes:
        x, y: along and across the tooth's centre line, m.
        angle: of the force from the perpendicular to the centre line, rad.
    """

    x: Array
    y: Array
    angle: Array

    @property
    def depth(self) -> Array:
        """Distance from the contact to the tooth's centre line along the force, m."""
        return self.y / np.cos(self.angle)


def loaded_point(profile: ToothProfile, roll: Array) -> LoadedPoint:
    """Return the point of the involute at roll angles, rad, in the normal section of a helical tooth."""
    x, y = profile.flank(roll)
    helix = math.cos(profile.helix_angle)
    return LoadedPoint(x, helix * y, np.arctan(helix * np.tan(roll - profile.base_half_angle)))


def plane_modulus(wheel: ToothedWheel, plane: Plane) -> float:
    """Return E, or E / (1 - nu^2) for plane strain, Pa."""
    return wheel.modulus / (1.0 - wheel.poisson**2 if plane == "strain" else 1.0)


def beam_compliance(profile: ToothProfile, wheel: ToothedWheel, roll: Array, plane: Plane) -> Array:
    """Return bending, shear and axial compliance above the root circle, shape (3, *roll.shape), m^2/N.

    Integrated by Gauss's rule along the fillet and along the involute below the load.
    """
    loads = loaded_point(profile, roll[..., np.newaxis])
    places, weights = np.polynomial.legendre.leggauss(_NODES)
    share, weights = 0.5 * (places + 1.0), 0.5 * weights
    low = profile.roll(profile.form_radius)
    phi = low + (roll[..., np.newaxis] - low) * share
    above = np.stack(profile.flank(phi))
    # dx / dphi of the involute is r_b phi cos(phi - psi_b).
    above_dx = (
        weights * (roll[..., np.newaxis] - low) * profile.base_radius * phi * np.cos(phi - profile.base_half_angle)
    )
    below = np.stack(profile.fillet(share))
    below_dx = weights * (profile.fillet(share + _STEP)[0] - profile.fillet(share - _STEP)[0]) / (2.0 * _STEP)
    helix = math.cos(profile.helix_angle)
    shape = (*roll.shape, _NODES)
    x = np.concatenate((np.broadcast_to(below[0], shape), above[0]), axis=-1)
    y = helix * np.concatenate((np.broadcast_to(below[1], shape), above[1]), axis=-1)
    dx = np.concatenate((np.broadcast_to(below_dx, shape), above_dx), axis=-1)
    across, along = np.cos(loads.angle), np.sin(loads.angle)
    arm = across * (loads.x - x) - along * loads.y
    modulus = plane_modulus(wheel, plane)
    shear = wheel.modulus / (2.0 * (1.0 + wheel.poisson))
    return np.stack(
        (
            np.sum(arm**2 * dx / (modulus * (2.0 * y) ** 3 / 12.0), axis=-1),
            np.sum(SHEAR_FACTOR * across**2 * dx / (shear * 2.0 * y), axis=-1),
            np.sum(along**2 * dx / (modulus * 2.0 * y), axis=-1),
        )
    )


def wind_up(profile: ToothProfile, wheel: ToothedWheel) -> float:
    """Return the compliance on the line of action of the ring between hub and root in torsion, m^2/N.

    Lame's ring under shear: the turn is T / (4 pi G b) (1 / r_hub^2 - 1 / r_f^2).
    """
    shear = wheel.modulus / (2.0 * (1.0 + wheel.poisson))
    opened = 1.0 / wheel.hub_radius**2 - 1.0 / profile.root_radius**2
    return profile.base_radius**2 * opened / (4.0 * math.pi * shear)


def shared_compliance(profile: ToothProfile, wheel: ToothedWheel, plane: Plane) -> float:
    """Return how far the body of a neighbour yields along its line of action by a force on a tooth, m^2/N.

    The ring's torsion, and the displacement around a line force, which falls with the logarithm of the distance
    (Flamant: 2 / (pi E) ln), from the ring's thickness to one pitch. Its constant is fitted to finite elements
    (``benchmarks.gears.stiffness``). Taken for all teeth in contact.
    """
    thickness = profile.root_radius - wheel.hub_radius
    pitch = math.tau * profile.root_radius / profile.teeth
    logarithm = max(2.0 / math.pi * math.log(thickness / pitch) + _NEIGHBOUR, 0.0)
    return wind_up(profile, wheel) + logarithm / plane_modulus(wheel, plane)


def sainsot_factors(half_angle: float, ratio: float) -> tuple[float, float, float, float]:
    """Return L*, M*, P*, Q* at half the root's angle, rad, and root over hub radius.

    The fits hold for 0.01 to 0.12 rad and 1.4 to 7; beyond, they go on smoothly but nothing is claimed.
    """
    terms = (half_angle**-2, ratio**2, ratio / half_angle, 1.0 / half_angle, ratio, 1.0)
    first, second, third, fourth = (float(value) for value in _SAINSOT @ np.array(terms))
    return first, second, third, fourth


def foundation_compliance(
    profile: ToothProfile, wheel: ToothedWheel, roll: Array, *, plane: Plane, foundation: Foundation
) -> Array:
    """Return the compliance of the body below the tooth, its wind-up included, m^2/N, in the shape of the rolls."""
    angle = loaded_point(profile, roll).angle
    helix = math.cos(profile.helix_angle)
    width = 2.0 * profile.root_radius * profile.root_half_angle * helix
    transverse = roll - profile.base_half_angle
    height = (profile.base_radius / np.cos(transverse) - profile.root_radius) / width
    modulus = plane_modulus(wheel, plane)
    if foundation == "sainsot":
        l_f, m_f, p_f, q_f = sainsot_factors(profile.root_half_angle, profile.root_radius / wheel.hub_radius)
        return np.cos(angle) ** 2 / modulus * (l_f * height**2 + m_f * height + p_f * (1.0 + q_f * np.tan(angle) ** 2))
    nu = wheel.poisson
    half_plane = (
        18.0 / math.pi * height**2
        + 2.0 * (1.0 - 2.0 * nu) / (1.0 - nu) * height
        + 4.8 / math.pi * (1.0 + (1.0 - nu) / 2.4 * np.tan(angle) ** 2)
    )
    strain = wheel.modulus / (1.0 - nu**2)
    return np.cos(angle) ** 2 / strain * half_plane + wind_up(profile, wheel)


def tooth_compliance(profile: ToothProfile, wheel: ToothedWheel, roll: Array, method: StiffnessMethod) -> Array:
    """Return the compliance of a tooth and what of its body is its own, m^2/N, in the shape of the rolls."""
    beam = beam_compliance(profile, wheel, roll, method.plane).sum(axis=0)
    body = foundation_compliance(profile, wheel, roll, plane=method.plane, foundation=method.foundation)
    return beam + body - (shared_compliance(profile, wheel, method.plane) if method.shared_body else 0.0)


def critical_section(profile: ToothProfile) -> tuple[float, float]:
    """Return x and y, m, where the fillet's tangent is at 30 deg to the centre line (ISO 6336-3)."""
    share = np.linspace(0.0, 1.0, 512)
    x, y = profile.fillet(share)
    slope = np.arctan2(-np.gradient(y), np.gradient(x))
    # The slope falls from the root circle's tangent to the flank's; take the flank's end where it stays above 30 deg.
    place = float(np.interp(-math.pi / 6.0, -slope, share))
    at = profile.fillet(place)
    return float(at[0]), float(at[1])


def crack_compliance(
    profile: ToothProfile, wheel: ToothedWheel, roll: Array, depth: float, angle: float, plane: Plane
) -> Array:
    """Return what a crack in the root of the loaded side adds to the compliance, m^2/N, in the shape of the rolls.

    A form of second degree in moment and shear force at the crack, as K^2 is, fitted to plane finite elements of cracks
    straight across (``benchmarks.gears.stiffness``, which has its errors): with the share xi of the section that is
    cracked and the arm over the section's width, E C = 24 xi^1.5 / (1 - xi) * sum (a + b xi) (arm^2, arm cos, cos^2).
    Of an inclined crack its depth across the tooth counts, and the arm to its middle: a rough guess. A crack that the
    force presses together is closed.

    Args:
        profile, wheel: of the tooth.
        roll: roll angles of the contact, rad.
        depth: length of the crack from the fillet's surface, m.
        angle: between the crack and the tooth's centre line, rad; 90 deg is straight across, less goes to the body.
        plane: of stress or strain.

    Raises:
        ValueError: where the crack takes more than 0.9 of the section; the fit holds to 0.5, deeper is extrapolated.
    """
    x, y = critical_section(profile)
    width = 2.0 * y * math.cos(profile.helix_angle)
    share = depth * math.sin(angle) / width
    if not 0.0 <= share <= _CRACK_LIMIT:
        raise ValueError(
            f"crack depth must be from 0 to {1e3 * _CRACK_LIMIT * width / math.sin(angle):.4g} mm, "
            f"got {1e3 * depth:.4g} mm"
        )
    loads = loaded_point(profile, roll)
    across = np.cos(loads.angle)
    middle = x - 0.5 * depth * math.cos(angle)
    arm = (across * (loads.x - middle) - np.sin(loads.angle) * loads.y) / width
    shape = sum((a + b * share) * term for (a, b), term in zip(_CRACK, (arm**2, arm * across, across**2), strict=True))
    opened = np.where(arm > 0.0, np.maximum(shape, 0.0), 0.0)
    return 24.0 * share**1.5 / (1.0 - share) * opened / plane_modulus(wheel, plane)
