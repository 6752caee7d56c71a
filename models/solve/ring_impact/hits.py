"""When a defect is hit, how hard and where: the pulses that drive the model of impacts on rings.

A hit begins when the centre of an element is at the centre of the defect, or a defect of an element in a contact; both
contacts of an element hit in turn. Its force is that of Eq. 16, the load of an element there times
1 + K_imp (d / B)^2. The defect's depth does not enter: it is deep enough for an element to span it without touching
its bottom. The hits on a rolling element all act on its mass with the same sign (Eq. 26-b).

Stiffness and damping of an oil film, from the theory of short journal bearings, in the direction of the load.

Source: Sassi, Badri and Thomas 2007, Eqs. 19-23. The dimensionless factors are lost in print; they follow from the
theory itself. The clearance is radial there: the printed "diametral clearance" would make the eccentricity wrong.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.machine.bearing import kinematics
from models.machine.load_distribution import LoadZone, conforming, load_zones
from models.path.contour import part_radius
from models.solve.ring_impact.rig import RingImpactRig

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.scene import Defect, Scene


MOST_HITS = 1_000_000
_TURN = 2.0 * math.pi


@dataclass(frozen=True, eq=False)
class Hits:
    """The hits on one defect in one row.

    Attributes:
        start: times, ascending, s, (hits,).
        force: largest force of each, N, (hits,).
        angle: place of the defect, or of the element that has it, at t = 0, from the load direction then, rad.
        rate: how fast that place turns, rad/s.
    """

    start: NDArray[np.float64]
    force: NDArray[np.float64]
    angle: float
    rate: float


def zones_of(scene: Scene) -> tuple[LoadZone, ...]:
    """Return how the elements of each row share the load of a scene."""
    rig = scene.rig_as(RingImpactRig)
    return load_zones(
        conforming(scene.bearing),
        scene.load,
        scene.axial_load,
        clearance=scene.clearance,
        k_c=rig.k_c,
        factor=rig.load_factor,
    )


def defect_size(scene: Scene, defect: Defect) -> float:
    """Return the width of a defect along the rolling direction, m.

    Raises:
        ValueError: if it is wider than an element, for which Eq. 10 does not hold.
    """
    size = defect.dphi_d * part_radius(scene.bearing, defect.part)
    if size > scene.bearing.element_diameter:
        raise ValueError(
            f"dphi_d {defect.dphi_d!r} rad of the {defect.part} is {size:.4g} m wide, more than an element "
            f"({scene.bearing.element_diameter:.4g} m): its impact is not described"
        )
    return size


def hits_on(scene: Scene, number: int, begin: float, end: float, row: int | None = None) -> Hits:
    """Return the hits on one of a scene's defects in one row, by default its first, between two times, s.

    Raises:
        ValueError: if the defect is too wide, or there are more than MOST_HITS.
    """
    defect, rig = scene.defects[number], scene.rig_as(RingImpactRig)
    row = defect.first_row if row is None else row
    scale = rig.gain * (1.0 + rig.k_impact * (defect_size(scene, defect) / scene.bearing.element_diameter) ** 2)
    lines = kinematics(scene.bearing, scene.speed)
    turns = scene.speed if (defect.part == "outer") == (scene.bearing.rotating_ring == "outer") else 0.0
    if defect.part == "ball":
        turns = lines.ftf
    offset = _TURN / scene.bearing.n_elements / scene.bearing.rows * row
    phase, rate = _passages(scene, defect, offset, turns)
    start = _times(phase, rate, begin, end)
    late = np.zeros_like(start)
    if scene.slip is not None and scene.slip.redraws:
        draw = np.random.default_rng([scene.slip.seed, number, row])
        late = scene.slip.phi_slip * draw.uniform(-1.0, 1.0, len(start))
    place = offset if defect.part == "ball" else defect.position
    if defect.part == "ball":
        psi = place + late + _TURN * turns * start
    else:
        start = start - late / (_TURN * (lines.ftf - turns))
        psi = place + _TURN * turns * start
    if scene.load_turns:
        psi = psi - _TURN * scene.speed * start
    force = scale * zones_of(scene)[row].load(psi)
    order = np.argsort(start, kind="stable")
    order = order[force[order] > 0.0]
    return Hits(start[order], force[order], place, _TURN * turns)


def _passages(scene: Scene, defect: Defect, offset: float, turns: float) -> tuple[float, float]:
    """Return phase and rate, Hz, of the hits on a row: they happen where rate * t + phase is whole."""
    lines = kinematics(scene.bearing, scene.speed)
    if defect.part == "ball":
        return -defect.position / math.pi, 2.0 * lines.bsf
    count = scene.bearing.n_elements
    return count * (offset - defect.position) / _TURN, count * (lines.ftf - turns)


def _times(phase: float, rate: float, begin: float, end: float) -> NDArray[np.float64]:
    """Return the times between two at which rate * t + phase is whole, ascending.

    Raises:
        ValueError: if there are more than MOST_HITS.
    """
    if (end - begin) * abs(rate) > MOST_HITS:
        raise ValueError(
            f"the hits of {end - begin:.3g} s, in which the motion settles and is recorded, are more than {MOST_HITS}: "
            f"the films damp it too little, or the duration is too long"
        )
    low, high = sorted((rate * begin + phase, rate * end + phase))
    whole = np.arange(math.ceil(low), math.floor(high) + 1, dtype=np.float64)
    return np.sort((whole - phase) / rate)


@dataclass(frozen=True)
class Film:
    """Stiffness, N/m, and damping, N s/m, of a film along the load."""

    stiffness: float
    damping: float


def short_bearing_film(load: float, speed: float, *, thickness: float, clearance: float) -> Film:
    """Return the film that carries a load between surfaces which turn against each other.

    With e = 1 - thickness / clearance and tan(a) = pi sqrt(1 - e^2) / (4 e), in units of load / clearance:
    K w = e s^2 / (1 - e^2)^2 + 3 pi e^2 s c / (4 (1 - e^2)^2.5) + 2 e (1 + e^2) c^2 / (1 - e^2)^3, and divided by the
    angular speed C w = pi s^2 / (2 (1 - e^2)^1.5) + 4 e s c / (1 - e^2)^2 + pi (1 + 2 e^2) c^2 / (2 (1 - e^2)^2.5),
    where s and c are sine and cosine of a and w = e sqrt(16 e^2 + pi^2 (1 - e^2)) / (4 (1 - e^2)^2).

    Args:
        load: N, positive.
        speed: angular speed of the surfaces, rad/s, positive.
        thickness: least thickness of the film, m.
        clearance: radial clearance, m, more than the thickness.

    Raises:
        ValueError: if load or speed is not positive, or the thickness not between zero and the clearance.
    """
    if not (load > 0.0 and speed > 0.0):
        raise ValueError(f"a film needs a load and a speed, got {load!r} N and {speed!r} rad/s")
    if not 0.0 < thickness < clearance:
        raise ValueError(f"film_thickness must lie between 0 and film_clearance, got {thickness!r} and {clearance!r} m")
    e = 1.0 - thickness / clearance
    # 1 - e^2 without cancellation where the film is thin.
    gap = thickness / clearance * (2.0 - thickness / clearance)
    angle = math.atan2(math.pi * math.sqrt(gap), 4.0 * e)
    s, c = math.sin(angle), math.cos(angle)
    carried = e * math.sqrt(16.0 * e * e + math.pi**2 * gap) / (4.0 * gap**2)
    stiffness = (
        e / gap**2 * s * s + 3.0 * math.pi * e * e / (4.0 * gap**2.5) * s * c + 2.0 * e * (1.0 + e * e) / gap**3 * c * c
    )
    damping = (
        math.pi / (2.0 * gap**1.5) * s * s
        + 4.0 * e / gap**2 * s * c
        + math.pi * (1.0 + 2.0 * e * e) / (2.0 * gap**2.5) * c * c
    )
    return Film(load / clearance * stiffness / carried, load / (clearance * speed) * damping / carried)
