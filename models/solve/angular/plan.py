"""What the kernel of the shaft on two bearings needs: equilibrium at rest, modes, bearings, and the state it begins in.

The lateral modes are those of the shaft on the tangent stiffness of its bearings in equilibrium, so that damping ratios
apply to the assembly (section I.1: "a classic modal approach"). Modes beyond ``AngularRig.mode_limit`` are slowed to it
at the same stiffness: their static share of each displacement is kept, whatever the number of elements.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.machine.ball_statics import BallStatics, RingState, ring_state
from models.machine.hertz import point_contact_semi_axes
from models.machine.shaft_beam import PER_NODE, TURN_X, TURN_Y, TURN_Z, X, Y, Z, add_disc, shaft_matrices
from models.solve.angular import ball_ring_kernel as spall
from models.solve.angular import kernel as kernels
from models.solve.angular.ball_ring_kernel import BallRing
from models.solve.angular.rig import AngularRig
from models.words.numerics import generalised_modes

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.bearing import Bearing
    from models.machine.scene import Defect, Scene
    from models.machine.speed_profile import SpeedProfile

# Coordinates of a bearing in the order of models.machine.ball_statics.
_RING = (X, Y, Z, TURN_X, TURN_Y)
SLOWED_RATIO = 0.5
"""Damping ratio of modes that are slowed."""
GOVERNOR_RATIO = 0.7
_UNSETTLED = 1e-6
_STEPS, _FORCE_STEPS = 200, 30
_SAME_FORCE = 1e-12
# Least stiffness along the shaft by which the floating ring's damping is measured, N/m.
_LEAST_STIFFNESS = 1e4
# Deflection, m, whose contact counts as that of an edge, and parts of a step there.
_EDGE_DEFLECTION, _EDGE_PARTS = 5e-6, 4
_WHOLE_WIDTH = 1e3


@dataclass(frozen=True, eq=False)
class Assembly:
    """The matrices of a scene's shaft, its bearings, and its equilibrium at rest.

    Attributes:
        rig: parameters.
        statics: of both bearings.
        mass, stiffness: of all lateral and axial coordinates of the free shaft.
        rows: coordinates of both bearings there, (2, 5), and x, y, z of the disc.
        displacement: in equilibrium; its last element is the place of the floating outer ring, m.
        rings: both bearings in equilibrium.
    """

    rig: AngularRig
    statics: tuple[BallStatics, BallStatics]
    mass: NDArray[np.float64]
    stiffness: NDArray[np.float64]
    rows: tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]
    displacement: NDArray[np.float64]
    rings: tuple[RingState, RingState]

    @property
    def floating(self) -> int:
        """The bearing whose outer ring floats."""
        return 0 if self.rig.located == "b" else 1


def bearings_of(scene: Scene) -> tuple[Bearing, Bearing]:
    """Return the bearings at A and B; they are alike where the scene has no second one."""
    return scene.bearing, scene.bearing if scene.second_bearing is None else scene.second_bearing


def statics_of(scene: Scene) -> tuple[BallStatics, BallStatics]:
    """Return the statics of both bearings; raise a ValueError that names what they do not describe."""
    rig = scene.rig_as(AngularRig)

    def of(bearing: Bearing) -> BallStatics:
        play = 2.0 * scene.clearance if scene.clearance > 0.0 else rig.play if bearing.contact_angle == 0.0 else None
        return BallStatics(rig.grooved(bearing), play, rig.modulus, rig.poisson, rig.density, rig.resistance)

    a, b = bearings_of(scene)
    return of(a), of(b)


def assemble(scene: Scene) -> Assembly:
    """Return the assembly of a scene at rest, without its defects.

    Raises:
        ValueError: if a bearing is not described.
        RuntimeError: if no equilibrium is found.
    """
    rig, statics = scene.rig_as(AngularRig), statics_of(scene)
    stiffness, mass = shaft_matrices(rig.shaft)
    add_disc(mass, rig.disc)
    kept = [row for row in range(len(mass)) if row % PER_NODE != TURN_Z]
    place = {row: number for number, row in enumerate(kept)}
    nodes = (0, rig.elements, rig.elements // 2)
    rows = [np.array([place[PER_NODE * node + row] for row in _RING]) for node in nodes]
    force = np.zeros(len(kept))
    force[rows[2][0]] = scene.load
    # z points from A to B.
    force[rows[2][2]] = -scene.axial_load
    inside = np.ix_(kept, kept)
    found = _equilibrium(scene, rig, statics, stiffness[inside], (rows[0], rows[1]), force)
    return Assembly(rig, statics, mass[inside], stiffness[inside], (rows[0], rows[1], rows[2][:3]), *found)


def _equilibrium(
    scene: Scene,
    rig: AngularRig,
    statics: tuple[BallStatics, BallStatics],
    stiffness: NDArray[np.float64],
    rows: tuple[NDArray[np.intp], NDArray[np.intp]],
    force: NDArray[np.float64],
) -> tuple[NDArray[np.float64], tuple[RingState, RingState]]:
    """Return displacement and bearings where the elastic energy less the loads' work is least.

    The centrifugal forces are those of the contact angles that they lead to.
    """
    at, loads = np.zeros(len(force) + 1), np.append(force, 0.0)
    flung = [s.centrifugal_force(scene.speed) for s in statics]
    for _ in range(_FORCE_STEPS):
        at, rings = _least_energy(scene, rig, statics, stiffness, rows, loads, at, flung)
        meant = [s.centrifugal_force(scene.speed, ring.mean_angle) for s, ring in zip(statics, rings, strict=True)]
        if all(abs(new - old) <= _SAME_FORCE * new for new, old in zip(meant, flung, strict=True)):
            return at, rings
        flung = meant
    raise RuntimeError(f"angular: the centrifugal force at {scene.speed!r} Hz does not settle")


def _least_energy(
    scene: Scene,
    rig: AngularRig,
    statics: tuple[BallStatics, BallStatics],
    stiffness: NDArray[np.float64],
    rows: tuple[NDArray[np.intp], NDArray[np.intp]],
    loads: NDArray[np.float64],
    begin: NDArray[np.float64],
    flung: list[float],
) -> tuple[NDArray[np.float64], tuple[RingState, RingState]]:
    """Return the minimum by Newton's method with damping; the energy is convex."""
    cages = (rig.cage_angle_a, rig.cage_angle_b)
    size, floating = len(loads), 0 if rig.located == "b" else 1
    # Displacements of each bearing by the coordinates and the floating ring.
    select = np.zeros((2, 5, size))
    for side in range(2):
        select[side, np.arange(5), rows[side]] = 1.0
    select[floating, 2, -1] = -1.0
    elastic = np.zeros((size, size))
    elastic[:-1, :-1] = stiffness

    def evaluate(at: NDArray[np.float64]) -> tuple[float, NDArray[np.float64], tuple[RingState, RingState]]:
        a, b = (
            ring_state(statics[k], select[k] @ at, scene.speed, cage_angle=cages[k], centrifugal=flung[k])
            for k in range(2)
        )
        missing = loads - elastic @ at - select[0].T @ a.load - select[1].T @ b.load
        return 0.5 * float(at @ elastic @ at) + a.energy + b.energy - float(loads @ at), missing, (a, b)

    scale = np.sqrt(np.maximum(np.diag(elastic), 1.0))
    at, (level, missing, rings), damping = begin, evaluate(begin), 1e-3
    for _ in range(_STEPS):
        left = float(np.abs(missing).max())
        if left <= 0.1 * _UNSETTLED:
            break
        matrix = elastic + sum(select[k].T @ rings[k].tangent @ select[k] for k in range(2))
        strength = damping * (np.diag(matrix) + 1e-6 * scale**2 + 1.0)
        tried = at + np.linalg.solve(matrix + np.diag(strength), missing)
        reached, remains, states = evaluate(tried)
        # Near the minimum the energy is flat to rounding, and the forces tell what is better.
        if reached < level or float(np.abs(remains).max()) <= 0.9 * left:
            at, level, missing, rings, damping = tried, reached, remains, states, max(0.1 * damping, 1e-15)
        elif damping < 1e12:
            damping *= 10.0
        else:
            break
    if float(np.abs(missing).max()) > _UNSETTLED:
        raise RuntimeError(f"angular: no equilibrium found for {scene.load!r} N and {scene.axial_load!r} N along")
    return at, rings


def tangents(assembly: Assembly) -> NDArray[np.float64]:
    """Return the stiffness of both bearings in equilibrium, (2, 5, 5), one of them free along the shaft."""
    found = np.stack([ring.tangent for ring in assembly.rings])
    floating = found[assembly.floating]
    if floating[2, 2] > 0.0:
        floating -= np.outer(floating[:, 2], floating[2]) / floating[2, 2]
    floating[2, :], floating[:, 2] = 0.0, 0.0
    return found


def lateral_modes(assembly: Assembly, tangent: NDArray[np.float64], scene: Scene) -> kernels.ShaftModes:
    """Return the modes of the shaft on its bearings, with the scene's loads as steady forces."""
    a, b, disc = assembly.rows
    stiffness, steady = assembly.stiffness.copy(), np.zeros(len(assembly.mass))
    stiffness[np.ix_(a, a)] += tangent[0]
    stiffness[np.ix_(b, b)] += tangent[1]
    steady[disc[0]], steady[disc[2]] = scene.load, -scene.axial_load
    values, vectors = generalised_modes(stiffness, assembly.mass)
    ratios = np.full(len(values), assembly.rig.damping)
    return _modes(values, vectors, ratios, np.concatenate((a, b, disc[:2])), steady, assembly.rig.mode_limit)


def torsion_modes(assembly: Assembly, scene: Scene) -> tuple[kernels.ShaftModes, NDArray[np.float64]]:
    """Return the modes of torsion between the couplings, the drive held to the nominal rotation by its governor.

    The first one is the rotation as a whole. Steady is the drive's torque, which balances load and bearings. Returned
    beside them is what an acceleration of the nominal rotation by 1 rad/s2 does: the inertia of all nodes, and the
    torque of the drive that balances its sum.
    """
    rig, nodes = assembly.rig, assembly.rig.shaft.nodes
    k, m = shaft_matrices(rig.shaft)
    add_disc(m, rig.disc)
    size = nodes + 2
    stiffness, mass = np.zeros((size, size)), np.zeros((size, size))
    stiffness[:nodes, :nodes] = k[TURN_Z::PER_NODE, TURN_Z::PER_NODE]
    mass[:nodes, :nodes] = m[TURN_Z::PER_NODE, TURN_Z::PER_NODE]
    for end, coupling in enumerate(rig.couplings, nodes):
        both = np.ix_([coupling.node, end], [coupling.node, end])
        stiffness[both] += coupling.stiffness * np.array([[1.0, -1.0], [-1.0, 1.0]])
        mass[end, end] = coupling.inertia
    if rig.ball_inertia:
        for node, ring in zip((0, rig.elements), assembly.rings, strict=True):
            mass[node, node] += ring.resistance_torque(0.0)[0] - ring.resistance_torque(1.0)[0]
    drive, load = nodes, nodes + 1
    whole = float(mass.sum())
    stiffness[drive, drive] += whole * (2.0 * math.pi * rig.governor * scene.speed) ** 2
    resisted = -sum(ring.resistance_torque()[0] for ring in assembly.rings)
    steady, inertia = np.zeros(size), -mass.sum(axis=1)
    inertia[drive] += whole
    steady[drive] += rig.load_torque + resisted
    steady[load] -= rig.load_torque
    values, vectors = generalised_modes(stiffness, mass)
    ratios = np.full(len(values), rig.damping)
    ratios[0] = GOVERNOR_RATIO
    encoder = {"a": 0, "b": rig.elements, "c": rig.elements // 2}[rig.encoder]
    rows = np.array([0, rig.elements, rig.elements // 2, encoder, load])
    modes = _modes(values, vectors, ratios, rows, steady, rig.mode_limit)
    return modes, _modes(values, vectors, ratios, rows, inertia, rig.mode_limit).steady


def _modes(
    values: NDArray[np.float64],
    vectors: NDArray[np.float64],
    ratios: NDArray[np.float64],
    rows: NDArray[np.intp],
    steady: NDArray[np.float64],
    limit: float,
) -> kernels.ShaftModes:
    """Return modes at some rows, those beyond a limit, Hz, slowed to it at the same stiffness."""
    square, most = np.maximum(values, 0.0), (2.0 * math.pi * limit) ** 2
    slowed = square > most
    gain = np.where(slowed, most / np.maximum(square, most), 1.0)
    square = np.minimum(square, most)
    return kernels.ShaftModes(
        square=square,
        damping=2.0 * np.where(slowed, SLOWED_RATIO, ratios) * np.sqrt(square),
        shape=np.ascontiguousarray(vectors[rows]),
        push=np.ascontiguousarray(vectors[rows] * gain),
        steady=gain * (vectors.T @ steady),
    )


def prepare_plan(
    scene: Scene, assembly: Assembly, direction: float = 0.0, profile: SpeedProfile | None = None
) -> kernels.AngularPlan:
    """Return everything the kernel needs.

    Args:
        direction: angle of the sensors of acceleration from the load, rad.
        profile: the nominal rotation from the beginning on; None is that at the speed of the scene.
    """
    tangent, (torsion, inertia) = tangents(assembly), torsion_modes(assembly, scene)
    rings = [ring_of(statics, scene, side) for statics, side in zip(assembly.statics, ("a", "b"), strict=True)]
    begin, nominal = np.zeros(1), np.array([[0.0, scene.speed, 0.0, 0.0]])
    if profile is not None:
        begin, nominal = profile.pieces
    nominal = 2.0 * math.pi * nominal
    return kernels.AngularPlan(
        parameter=_parameters(
            scene, assembly, torsion, _twisted(torsion, assembly, _beginning(nominal) * inertia), direction
        ),
        lateral=lateral_modes(assembly, tangent, scene),
        torsion=torsion,
        tangent=tangent,
        ring_a=rings[0],
        ring_b=rings[1],
        begin=begin,
        nominal=nominal,
        inertia=inertia,
    )


def _beginning(nominal: NDArray[np.float64]) -> float:
    """Return the nominal acceleration at t = 0, rad/s2: of the second piece, whose first ends there."""
    return 2.0 * float(nominal[min(1, len(nominal) - 1), 2])


def _parameters(
    scene: Scene, assembly: Assembly, torsion: kernels.ShaftModes, twisted: NDArray[np.float64], direction: float
) -> NDArray[np.float64]:
    rig, p = assembly.rig, np.zeros(kernels.P_SIZE)
    p[kernels.P_SPEED] = 2.0 * math.pi * scene.speed
    p[kernels.P_LOSS] = rig.load_torque / p[kernels.P_SPEED]
    p[kernels.P_UNBALANCE] = scene.unbalance
    along = float(assembly.rings[assembly.floating].tangent[2, 2])
    p[kernels.P_SLIDE] = max(along, _LEAST_STIFFNESS) * rig.slide_time
    p[kernels.P_FLOATING] = assembly.floating
    p[kernels.P_DIRECTION_1], p[kernels.P_DIRECTION_2] = math.cos(direction), math.sin(direction)
    p[kernels.P_EDGE], p[kernels.P_PARTS] = _EDGE_DEFLECTION, _EDGE_PARTS
    twist = torsion.shape @ twisted
    for side, statics in enumerate(assembly.statics):
        at = kernels.P_BEARING + side * kernels.B_SIZE
        p[at + kernels.B_CENTRIFUGAL] = statics.ball_mass * statics.pitch_radius
        p[at + kernels.B_RATIO] = statics.ball_radius / statics.pitch_radius
        p[at + kernels.B_BALLS] = statics.bearing.n_elements
        p[at + kernels.B_TURNED] = twist[side]
    return p


def _twisted(torsion: kernels.ShaftModes, assembly: Assembly, inertia: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the modes of torsion under the steady torques, those of inertia, and those of the bearings at rest."""
    torques = [ring.resistance_torque()[0] for ring in assembly.rings]
    push = torsion.steady + inertia + torques[0] * torsion.push[kernels.T_A] + torques[1] * torsion.push[kernels.T_B]
    return push / torsion.square


def ring_of(statics: BallStatics, scene: Scene, support: str) -> BallRing:
    """Return a bearing for the kernel, with the scene's defects at a support."""
    races = statics.races()
    surfaces = np.zeros((2, spall.R_SIZE))
    grooves = statics.bearing.inner_groove_radius, statics.bearing.outer_groove_radius
    for place, (side, k) in enumerate(((-1.0, races.k_i), (1.0, races.k_o))):
        # The longer semi-axis lies across the race, whose groove conforms to the ball.
        across, along = point_contact_semi_axes(
            *statics.conforming_radii[place], 1.0, "elliptic", modulus=statics.effective_modulus
        )
        surfaces[place, spall.R_STIFFNESS] = k
        surfaces[place, spall.R_ALONG], surfaces[place, spall.R_ACROSS] = along * k ** (1 / 3), across * k ** (1 / 3)
        surfaces[place, spall.R_RADIUS] = statics.pitch_radius + side * statics.ball_radius
        surfaces[place, spall.R_GROOVE] = grooves[place]
    angles = statics.angles()
    defects = [defect for defect in scene.defects if defect.moves_balls and defect.support == support]
    return BallRing(
        races=races,
        surfaces=surfaces,
        spalls=np.array([_spall(defect, surfaces) for defect in defects]).reshape(len(defects), spall.S_SIZE),
        angles=angles,
        slots=np.stack([np.cos(angles), np.sin(angles)]),
        pitch_radius=statics.pitch_radius,
        ball_radius=statics.ball_radius,
        half_resistance=0.5 * statics.resistance,
    )


def _spall(defect: Defect, surfaces: NDArray[np.float64]) -> NDArray[np.float64]:
    row, place = np.zeros(spall.S_SIZE), spall.INNER if defect.part == "inner" else spall.OUTER
    race = surfaces[place]
    row[spall.S_RACE], row[spall.S_DEPTH], row[spall.S_POSITION] = place, defect.h_d, defect.position
    row[spall.S_HALF_LENGTH] = 0.5 * race[spall.R_RADIUS] * defect.dphi_d
    row[spall.S_HALF_WIDTH] = _WHOLE_WIDTH if defect.width is None else 0.5 * race[spall.R_GROOVE] * defect.width
    return row


def at_rest(plan: kernels.AngularPlan, assembly: Assembly) -> NDArray[np.float64]:
    """Return the state at the beginning: the equilibrium at the scene's speed, turning at the first nominal one."""
    n, m = len(plan.lateral.square), len(plan.torsion.square)
    state = np.zeros(1 + 2 * n + 2 * m + 5)
    push = plan.lateral.steady.copy()
    for side, (rows, ring) in enumerate(zip(assembly.rows[:2], assembly.rings, strict=True)):
        force = plan.tangent[side] @ assembly.displacement[rows] - ring.load
        push += plan.lateral.push[5 * side : 5 * side + 5].T @ force
    free = plan.lateral.square <= 0.0
    state[1 : 1 + n] = np.where(free, 0.0, push / np.where(free, 1.0, plan.lateral.square))
    state[1 + 2 * n : 1 + 2 * n + m] = _twisted(plan.torsion, assembly, _beginning(plan.nominal) * plan.inertia)
    rig = assembly.rig
    cosines = [math.cos(ring.mean_angle) for ring in assembly.rings]
    state[-5:] = rig.cage_angle_a, rig.cage_angle_b, *cosines, assembly.displacement[-1]
    return state
