"""What three models share: an inner ring on the massless balls of one bearing whose outer ring stands still.

    m u'' + c_g u' + sum_i [k_c d_i^n + c d_i'] e_i = W + U Omega^2 (cos Omega t, sin Omega t),
    d_i = u.e_i - clearance - depth of the defect, while d_i > 0.

``ring_of`` returns it for a scene of one of these models, or says which assumption is not shared; ``rotor_of`` and
``casing_of`` return a scene of the rotor and of the six-degree-of-freedom model that moves as it does.

* Rotor (rigid): with a disc in the middle and two bearings alike whose balls stand alike, nothing tilts it: each
  bearing carries half of the mass, load, unbalance and damping against the ground. Exact, but for the rate of
  compression, which is there that of the ring alone (Ceruti): the part c w_cage (u x e_i) is left out.
* Balls with inertia: as a ball's mass goes to zero both its contacts stand in a row, k_c = (k_i^-2/3 + k_o^-2/3)^-3/2
  and c = (c_i k_o'^2 + c_o k_i'^2) / (k_i' + k_o')^2 with the tangents k', whose ratio (k_i / k_o)^2/3 is that of every
  load. To first order they lack what ``with_balls`` adds.
* Six degrees of freedom: without a spring to the ground, and with a resonator that follows the casing, ring (m_i) and
  casing (m_o + m_r = M) move against each other as one mass m_i M / (m_i + M); the casing accelerates by
  -m_i / (m_i + M) times u''. Only alpha_c m_b of its contact damping is a constant: beta_c must be zero.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from models.machine.bearing import kinematics
from models.machine.hertz import BALL_EXPONENT, contact_exponent, in_series
from models.machine.rig import Rig
from models.solve.ball_inertia.rig import BallInertiaRig
from models.solve.ring_impact.rig import RingImpactRig
from models.solve.rotor.rig import RotorRig

if TYPE_CHECKING:
    from models.machine.scene import Defect, Scene
    from models.words.request import Sensor

# Relative difference of two parameters that count as alike, and of angles, rad.
_ALIKE = 1e-9
# The rig of the six-degree-of-freedom model that stands for a ring: mass of the heavier part over the ring's, and
# frequency of a heavy inner ring on its spring over the ball rate; or that spring over the stiffness of the bearing.
# Mass of the resonator over that of the casing, and its frequency over the ball rate, damped critically.
_HEAVY, _HELD = 1e4, 0.25
_HEAVY_CASING = 300.0
_SOFT = 1e-6
_LIGHT = 1e-7
_RESONATOR = 3.0
# Load of the most loaded ball over the mean of all (Stribeck, no clearance).
_STRIBECK = 4.37
# A spring to the ground, over the stiffness of the contacts, that counts as none.
MOST_GROUND = 0.1


@dataclass(frozen=True)
class Ring:
    """The ring that scenes have in common.

    Attributes:
        mass: kg.
        k_c: contact stiffness of an element between both rings, N/m^n.
        damping: of a loaded element, N s/m.
        ground: damping against the ground, N s/m.
        force: steady force: along the load + i across it, N.
        unbalance: kg m.
        cage_angle: of the first element from the load at the beginning, rad.
        sensors: for each sensor of the model that it comes from, acceleration there over that of the ring.
        cage_in_rate: whether the turn of the cage enters d_i'; the rotor leaves it out.
    """

    mass: float
    k_c: float
    damping: float
    ground: float
    force: complex
    unbalance: float
    cage_angle: float
    sensors: tuple[tuple[Sensor, float], ...]
    cage_in_rate: bool = True


@dataclass(frozen=True)
class _StillCageRig(Rig):
    """The rig whose contacts damp the motion of the ring alone, as those of the rotor do."""

    cage_in_rate: ClassVar[bool] = False


def ring_of(scene: Scene) -> Ring:
    """Return the ring that a scene is.

    Raises:
        ValueError: if an assumption is not shared; the message names it.
    """
    _refuse(scene)
    if isinstance(scene.rig, RotorRig):
        found = _of_rotor(scene, scene.rig)
    elif isinstance(scene.rig, BallInertiaRig):
        found = _of_balls(scene, scene.rig)
    elif isinstance(scene.rig, Rig):
        found = _of_casing(scene, scene.rig)
    else:
        found = None
    if found is not None and found.force == 0.0:
        raise ValueError(
            "load: without one the ring rests on no ball, and where it goes depends on each model's beginning"
        )
    if found is not None:
        return found
    if isinstance(scene.rig, RingImpactRig):
        raise ValueError(
            f"rig: {scene.rig.model} bends its rings under impacts, which do not depend on the depth of a defect; only "
            f"the frequencies of its lines are those of other models"
        )
    raise ValueError(
        f"rig: {scene.rig.model} shows the angular speed of a shaft, which turns evenly in all other models"
    )


def _refuse(scene: Scene) -> None:
    if scene.bearing.rotating_ring == "outer":
        raise ValueError(
            "rotating_ring: a ring on balls whose outer ring stands still has no counterpart of one that turns"
        )
    if scene.bow != 0.0 or scene.couple_unbalance != 0.0:
        raise ValueError("bow and couple_unbalance: a ring on one bearing does not tilt and has no shaft")


def _of_rotor(scene: Scene, rig: RotorRig) -> Ring:
    pitch = 2.0 * math.pi / scene.bearing.n_elements
    if not math.isclose(rig.a, rig.b, rel_tol=_ALIKE):
        raise ValueError(f"rig.a: the disc must stand in the middle, got {rig.a!r} of {rig.length!r} m")
    if rig.k_c_b is not None and not math.isclose(rig.k_c, rig.k_c_b, rel_tol=_ALIKE):
        raise ValueError(f"rig.k_c_b: both bearings must be alike, got {rig.k_c!r} and {rig.k_c_b!r}")
    if scene.second_bearing is not None and scene.second_bearing != scene.bearing:
        raise ValueError(f"second_bearing: both bearings must be alike, got {scene.second_bearing.designation}")
    if abs(math.remainder(rig.cage_angle_a - rig.cage_angle_b, pitch)) > _ALIKE:
        raise ValueError("rig.cage_angle_a and rig.cage_angle_b: the balls of both bearings must stand alike")
    if any(defect.moves_balls for defect in scene.defects):
        raise ValueError("defect: what happens at one support tilts the rotor")
    return Ring(
        mass=0.5 * rig.m + rig.end_mass,
        k_c=rig.k_c,
        damping=rig.c_b,
        ground=0.5 * rig.c_n,
        force=0.5 * scene.load + 0.0j,
        unbalance=0.5 * scene.unbalance,
        cage_angle=rig.cage_angle_a,
        sensors=(("a", 1.0), ("b", 1.0), ("c", 1.0)),
        cage_in_rate=False,
    )


def _of_balls(scene: Scene, rig: BallInertiaRig) -> Ring:
    if rig.defect_shape != "half_sine" and any(defect.moves_balls for defect in scene.defects):
        raise ValueError(
            "rig.defect_shape: a rectangle's edges release a ball at once, whose mass then decides; only a half sine "
            "can do without it"
        )
    k_in, k_out = rig.k_ci ** (1.0 / BALL_EXPONENT), rig.k_co ** (1.0 / BALL_EXPONENT)
    return Ring(
        mass=rig.mass,
        k_c=in_series(rig.k_ci, rig.k_co, BALL_EXPONENT),
        damping=(rig.c_ci * k_out**2 + rig.c_co * k_in**2) / (k_in + k_out) ** 2,
        ground=0.0,
        force=scene.load + scene.gravity * rig.mass * cmath.exp(1j * scene.gravity_angle),
        unbalance=scene.unbalance,
        cage_angle=rig.cage_angle,
        sensors=(("a", 1.0),),
    )


def _of_casing(scene: Scene, rig: Rig) -> Ring:
    if rig.beta_c != 0.0:
        raise ValueError(
            f"rig.beta_c: damping that grows with the load of a ball has no counterpart, got {rig.beta_c!r}"
        )
    if scene.waviness:
        raise ValueError("waviness: no other model describes it")
    if any(defect.moves_balls for defect in scene.defects):
        raise ValueError("defect: its path (a ball that rolls over edges) is not the half sine of other models")
    if scene.unbalance != 0.0:
        raise ValueError("unbalance: a force on the shaft is not that on the casing")
    outer = rig.m_o + rig.m_r
    # The tangent stiffness of a bearing under its load is some n Q / delta.
    size = abs(scene.load + scene.gravity * outer * cmath.exp(1j * scene.gravity_angle))
    mass = rig.m_i * outer / (rig.m_i + outer)
    # What of the spring acts on the motion of ring against casing.
    if not rig.k_i * (mass / rig.m_i) ** 2 <= MOST_GROUND * bearing_stiffness(scene, rig.k_c, size):
        raise ValueError(
            f"rig.k_i: the spring from shaft to ground must be much softer than the bearing, got {rig.k_i!r}"
        )
    moved = -rig.m_i / (rig.m_i + outer)
    return Ring(
        mass=mass,
        k_c=rig.k_c,
        damping=rig.alpha_c * rig.m_b,
        ground=rig.c_i * (mass / rig.m_i) ** 2,
        force=scene.load + scene.gravity * outer * cmath.exp(1j * scene.gravity_angle),
        unbalance=scene.unbalance * mass / rig.m_i,
        cage_angle=0.0,
        sensors=(("mo", moved), ("mr", moved)),
    )


def with_balls(scene: Scene, ring: Ring, share: float = 1.0) -> tuple[Scene, Ring]:
    """Return scene and ring with what massless balls lack to first order; ``share``: of the clearance.

    A loaded ball moves by the outer contact's share of the approach, s = k_i^2/3 / (k_i^2/3 + k_o^2/3), with the ring:
    m_b s^2 cos^2 theta of added mass, averaged over the loaded zone. Centrifugal force and weight press a ball against
    the outer race before the inner one meets it, and the direction of a contact turns as the ring moves across it by u:
    a clearance of up to ((m_b r w_cage^2 + m_b g) / k_o)^2/3 + u^2 / 2 r, which acts in full where a ball is hardly
    loaded.
    """
    rig = scene.rig_as(BallInertiaRig)
    k_in, k_out = rig.k_ci ** (1.0 / BALL_EXPONENT), rig.k_co ** (1.0 / BALL_EXPONENT)
    moved, balls = k_in / (k_in + k_out), scene.bearing.n_elements * scene.bearing.rows
    size = scene.clearance + approach_of(scene, ring)
    half = math.acos(min(scene.clearance / size, 1.0))
    loaded = (half + 0.5 * math.sin(2.0 * half)) / (2.0 * math.pi)
    ball, radius = rig.ball_mass(scene.bearing), 0.5 * scene.bearing.pitch_diameter
    cage = 2.0 * math.pi * kinematics(scene.bearing, scene.speed).ftf
    pressed = ball * (radius * cage**2 + scene.gravity)
    gap = (pressed / rig.k_co) ** (1.0 / BALL_EXPONENT) + size**2 / (2.0 * radius)
    mass = ring.mass + ball * moved**2 * balls * loaded
    return replace(scene, clearance=scene.clearance + share * gap), replace(ring, mass=mass)


def approach_of(scene: Scene, ring: Ring) -> float:
    """Return the approach of the most loaded ball under the steady force, m (Stribeck)."""
    balls = scene.bearing.n_elements * scene.bearing.rows
    return float((_STRIBECK * abs(ring.force) / (balls * ring.k_c)) ** (1.0 / contact_exponent(scene.bearing)))


def bearing_stiffness(scene: Scene, k_c: float, load: float) -> float:
    """Return an estimate of the stiffness of a bearing along its load, N/m: n times load over approach (Stribeck)."""
    exponent, balls = contact_exponent(scene.bearing), scene.bearing.n_elements * scene.bearing.rows
    approach = (_STRIBECK * max(load, 1e-9) / (balls * k_c)) ** (1.0 / exponent)
    return exponent * load / (approach + scene.clearance)


def rotor_of(scene: Scene, ring: Ring) -> Scene:
    """Return the rotor that moves as a ring; its sensor "a" is that of the ring.

    Raises:
        ValueError: if the rotor lacks what the scene has; the message names it.
    """
    if abs(ring.force.imag) > _ALIKE * abs(ring.force):
        raise ValueError("gravity_angle: the rotor's weight acts along the load")
    rig = RotorRig(
        m=2.0 * ring.mass,
        j_p=ring.mass * 1e-2,
        j_t=ring.mass * 1e-2,
        length=0.2,
        a=0.1,
        k_c=ring.k_c,
        c_b=ring.damping,
        c_n=2.0 * ring.ground,
        cage_angle_a=ring.cage_angle,
        cage_angle_b=ring.cage_angle,
        element=scene.bearing.element,
    )
    defects = [one for defect in scene.defects for one in _at_both(defect)]
    return replace(
        scene,
        rig=rig,
        load=2.0 * ring.force.real,
        gravity=0.0,
        gravity_angle=0.0,
        unbalance=2.0 * ring.unbalance,
        defect=defects[0] if defects else None,
        more_defects=tuple(defects[1:]),
        second_bearing=scene.bearing if defects else None,
    )


def _at_both(defect: Defect) -> tuple[Defect, Defect]:
    """Return the defect at both supports, so that nothing tilts."""
    return defect, replace(defect, support="b")


def casing_of(scene: Scene, ring: Ring) -> Scene:
    """Return a scene of the six-degree-of-freedom model that moves as a ring, its first ball at the load.

    The acceleration of the ring is ``gain_of`` times that at its sensor "mo". A soft spring keeps them in place.

    Raises:
        ValueError: if that model lacks what the scene has; the message names it.
    """
    if any(defect.moves_balls for defect in scene.defects):
        raise ValueError("defect: the path of a ball over edges is not a half sine")
    passage = 2.0 * math.pi * kinematics(scene.bearing, scene.speed).bpfo
    if ring.ground == 0.0:
        # The heavy inner ring hardly moves: what holds it, damped critically, is not felt.
        inner, held = _HEAVY * ring.mass, _HELD * passage
        outer = inner * ring.mass / (inner - ring.mass)
        k_i, c_i = inner * held**2, 2.0 * inner * held
    else:
        # The casing is so heavy that only the ring moves against the ground, which the damper needs.
        outer = _HEAVY_CASING * ring.mass
        inner = outer * ring.mass / (outer - ring.mass)
        k_i = _SOFT * bearing_stiffness(scene, ring.k_c, abs(ring.force))
        c_i = ring.ground * (inner / ring.mass) ** 2
    light, resonator = _LIGHT * outer, _RESONATOR * passage
    kind = Rig if ring.cage_in_rate else _StillCageRig
    rig = kind(
        m_i=inner,
        m_o=outer - light,
        m_r=light,
        m_b=1.0,
        k_i=k_i,
        k_r=light * resonator**2,
        k_c=ring.k_c,
        c_i=c_i,
        c_r=2.0 * light * resonator,
        alpha_c=ring.damping,
        beta_c=0.0,
        element=scene.bearing.element,
    )
    size, angle = abs(ring.force), cmath.phase(ring.force)
    return replace(
        scene,
        rig=rig,
        load=0.0 if angle else size,
        gravity=size / outer if angle else 0.0,
        gravity_angle=angle,
        unbalance=ring.unbalance * inner / ring.mass,
    )


def gain_of(scene: Scene) -> float:
    """Return the acceleration of ring against casing over that of the casing, where nothing else moves them."""
    rig = scene.rig_as(Rig)
    return -(rig.m_i + rig.m_o + rig.m_r) / rig.m_i
