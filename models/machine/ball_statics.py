"""Statics of a ball bearing, ball by ball, under radial and axial load, tilt and centrifugal force.

Source: Thibault, Bourdon, Remond and Lecouvreur 2022 (Tribology International), Eqs. 3-14, with the corrections that
the functions name. The rings are rigid but for their contacts, the cage spaces the balls evenly, and each ball is in
equilibrium in the plane of the axis and its own radius. Deep-groove and angular-contact bearings of one row; shoulders
of the races do not end the contact. SI units and radians; the shaft turns about z, displacements and tilts are those of
the inner against the outer ring.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from models.machine import hertz
from models.machine import kernel_ball_statics as kernels
from models.words.checks import check_numbers

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from models.machine.bearing import Bearing

COORDINATES = ("x", "y", "z", "tilt_x", "tilt_y")
"""Displacements of the ring, and, with forces and moments, the loads that go with them."""
WITHOUT_TILT: Mapping[str, float] = {"tilt_x": 0.0, "tilt_y": 0.0}
UNSETTLED = 1e-6
"""Largest unbalanced load in equilibrium, N; of moments, divided by the radius of the inner groove's centres."""
_ENERGY_STEPS = 300
_SPEED_STEPS = 50
_SAME_FORCE = 1e-12


@dataclass(frozen=True)
class BallStatics:
    """A bearing and what its statics take besides its geometry.

    Attributes:
        bearing: of one row of balls, with both groove radii. Races lie a ball's radius from the pitch circle.
        clearance: play c between the rings across, m (diametral), a quarter of it at each contact; None takes that
            which the nominal contact angle needs, none where this is zero.
        modulus, poisson: of balls and rings, Pa and 1.
        density: of the balls, kg/m3.
        resistance: coefficient of rolling resistance C_r; the normal force acts C_r times a ball's radius ahead.
    """

    bearing: Bearing
    clearance: float | None = None
    modulus: float = 210e9
    poisson: float = 0.3
    density: float = 7800.0
    resistance: float = 0.0015

    def __post_init__(self) -> None:
        """Raise a ValueError that names an unusable value."""
        bearing = self.bearing
        if bearing.element != "ball" or bearing.rows != 1:
            raise ValueError(f"bearing must have one row of balls, {bearing.designation} has not")
        if bearing.rotating_ring != "inner":
            raise ValueError(f"bearing must have an inner ring that turns, that of {bearing.designation} does not")
        check_numbers(self, "", "positive", "modulus", "density")
        check_numbers(self, "", "not negative", "resistance", *(["clearance"] if self.clearance is not None else []))
        if not 0.0 <= self.poisson <= 0.5:
            raise ValueError(f"poisson must lie between 0 and 0.5, got {self.poisson!r}")
        for name in ("inner_groove_radius", "outer_groove_radius"):
            if hertz.known_length(bearing, name) <= self.ball_radius:
                raise ValueError(f"{bearing.designation}: {name} must exceed the ball's radius")

    @property
    def ball_radius(self) -> float:
        """R, m."""
        return 0.5 * self.bearing.element_diameter

    @property
    def pitch_radius(self) -> float:
        """R_m, m."""
        return 0.5 * self.bearing.pitch_diameter

    @property
    def ball_mass(self) -> float:
        """Mass of a ball, kg."""
        return self.density * 4.0 / 3.0 * math.pi * self.ball_radius**3

    @property
    def effective_modulus(self) -> float:
        """E' of models.machine.hertz: E / (1 - nu^2), which is twice the reduced modulus E* of Eq. 10."""
        return self.modulus / (1.0 - self.poisson**2)

    @property
    def groove_distance(self) -> float:
        """Radial distance of both grooves' centres of curvature with coaxial rings, R_ci + R_co - 2 R, m."""
        grooves = hertz.known_length(self.bearing, "inner_groove_radius") + hertz.known_length(
            self.bearing, "outer_groove_radius"
        )
        return grooves - self.bearing.element_diameter

    @property
    def play(self) -> float:
        """c, m; that of the nominal contact angle is 2 A (1 / cos - 1), where A is the distance of the grooves."""
        if self.clearance is not None:
            return self.clearance
        return 2.0 * self.groove_distance * (1.0 / math.cos(self.bearing.contact_angle) - 1.0)

    @property
    def free_angle(self) -> float:
        """Contact angle at which the balls touch both races without load, rad."""
        return math.acos(self.groove_distance / (self.groove_distance + 0.5 * self.play))

    @property
    def conforming_radii(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Relative radii (rolling, across) of a ball on the inner and on the outer race, m."""
        return hertz.relative_radii(
            replace(
                self.bearing,
                inner_race_radius=self.pitch_radius - self.ball_radius,
                outer_race_radius=self.pitch_radius + self.ball_radius,
            )
        )

    def races(self) -> kernels.Races:
        """Return what the kernels take of the bearing (Eq. 10, elliptic integrals without approximation)."""
        stiffness = [
            hertz.point_contact_stiffness(*radii, "elliptic", modulus=self.effective_modulus)
            for radii in self.conforming_radii
        ]
        r_gi, r_go = self.bearing.inner_groove_radius, self.bearing.outer_groove_radius
        assert r_gi is not None
        assert r_go is not None
        quarter = 0.25 * self.play
        return kernels.Races(
            inner_radius=self.pitch_radius - self.ball_radius + r_gi,
            offset=self.groove_distance,
            inner_gap=r_gi - self.ball_radius + quarter,
            outer_gap=r_go - self.ball_radius + quarter,
            k_i=stiffness[0],
            k_o=stiffness[1],
        )

    def cage_ratio(self, angle: float) -> float:
        """Return FTF over shaft speed at a mean contact angle, rad: (1 - D / D_m cos) / 2."""
        return 0.5 * (1.0 - self.bearing.element_diameter / self.bearing.pitch_diameter * math.cos(angle))

    def centrifugal_force(self, speed: float, angle: float = 0.0) -> float:
        """Return C_f = m R_m w_c^2 on a ball, N, at a shaft speed, Hz, and the mean contact angle of the balls, rad."""
        return self.ball_mass * self.pitch_radius * (2.0 * math.pi * speed * self.cage_ratio(angle)) ** 2

    def angles(self, cage_angle: float = 0.0) -> NDArray[np.float64]:
        """Return the angles of the balls from x towards y, rad, (balls,)."""
        return hertz.element_angles(self.bearing, cage_angle)


@dataclass(frozen=True, eq=False)
class RingState:
    """The balls in equilibrium at one displacement of the inner ring, one cage angle and one speed.

    Attributes:
        statics: of the bearing.
        displacement: x, y, z, m, tilt about x and about y, rad, (5,).
        speed: of the shaft, Hz.
        centrifugal: force on a ball, N.
        angles: of the balls from x towards y, rad, (balls,).
        inner_force, outer_force: normal forces N_i and N_o, N, (balls,).
        inner_angle, outer_angle: contact angles, rad, (balls,), zero where a ball does not touch the inner race.
        load: forces, N, and moments, N m, that the balls carry from the inner to the outer ring, (5,).
        tangent: derivatives of the load by the displacement at this centrifugal force, symmetric, (5, 5).
        energy: elastic energy less the work of the centrifugal force, J.
        residual: largest sum of the forces on a ball, N.
    """

    statics: BallStatics
    displacement: NDArray[np.float64]
    speed: float
    centrifugal: float
    angles: NDArray[np.float64]
    inner_force: NDArray[np.float64]
    outer_force: NDArray[np.float64]
    inner_angle: NDArray[np.float64]
    outer_angle: NDArray[np.float64]
    load: NDArray[np.float64]
    tangent: NDArray[np.float64]
    energy: float
    residual: float

    @property
    def mean_angle(self) -> float:
        """Mean over both contacts of each ball, and over the balls by their inner force, rad (Eq. 13).

        Zero where no ball touches the inner race.
        """
        total = float(self.inner_force.sum())
        if total == 0.0:
            return 0.0
        return float(self.inner_force @ (0.5 * (self.inner_angle + self.outer_angle))) / total

    @property
    def ftf(self) -> float:
        """Turns of the cage per turn of the shaft."""
        return self.statics.cage_ratio(self.mean_angle)

    @property
    def bpfo(self) -> float:
        """Balls that pass a point of the outer race per turn of the shaft."""
        return self.statics.bearing.n_elements * self.ftf

    def resistance_torque(self, acceleration: float = 0.0) -> tuple[float, float]:
        """Return the moments about z on inner and outer ring, N m, by rolling resistance and the balls' inertia.

        The shaft turns in the positive sense; ``acceleration`` is its own, rad/s2. Source: Eqs. 12 and 14, b = R C_r;
        the moments, which are not printed, are -sum T_i (R_m - R cos beta_i) and sum T_o (R_m + R cos beta_o). As in
        Eq. 12, a ball that does not touch the inner race resists by its outer force: the torque has no jumps.
        """
        s, bearing = self.statics, self.statics.bearing
        ratio = bearing.element_diameter / bearing.pitch_diameter * math.cos(self.mean_angle)
        spin = -0.5 * bearing.pitch_diameter / bearing.element_diameter * (1.0 - ratio**2) * acceleration
        cage = 0.5 * (1.0 - ratio) * acceleration
        roll = 0.5 * s.resistance * (self.inner_force + self.outer_force)
        orbit = 0.5 * s.ball_mass * s.pitch_radius * cage
        turn = 0.5 * (0.4 * s.ball_mass * s.ball_radius**2) * spin / s.ball_radius
        inner_arm = s.pitch_radius - s.ball_radius * np.cos(self.inner_angle)
        outer_arm = s.pitch_radius + s.ball_radius * np.cos(self.outer_angle)
        return -float((roll + orbit + turn) @ inner_arm), float((roll + orbit - turn) @ outer_arm)


def ring_state(
    statics: BallStatics,
    displacement: NDArray[np.float64],
    speed: float = 0.0,
    *,
    cage_angle: float = 0.0,
    centrifugal: float | None = None,
) -> RingState:
    """Return the equilibrium of all balls at a displacement (5,) of the inner ring.

    Args:
        speed: of the shaft, Hz, not negative.
        centrifugal: force on a ball, N; None is that of the speed, at the mean contact angle that it leads to.

    Raises:
        ValueError: if a value is not finite, or speed or force are negative.
    """
    return _settled_force(
        statics, speed, centrifugal, lambda force: _evaluate(statics, displacement, speed, cage_angle, force)
    )


def _settled_force(
    statics: BallStatics, speed: float, centrifugal: float | None, solve: Callable[[float], RingState]
) -> RingState:
    """Return the state at a given centrifugal force, or at that of its own mean contact angle."""
    if not (math.isfinite(speed) and speed >= 0.0):
        raise ValueError(f"speed must be finite and not negative, got {speed!r} Hz")
    if centrifugal is not None:
        return solve(centrifugal)
    # The cage turns by 4 % faster at 25 degrees than at none: each round removes more than nine tenths of the error.
    state = solve(statics.centrifugal_force(speed))
    for _ in range(_SPEED_STEPS):
        force = statics.centrifugal_force(speed, state.mean_angle)
        if abs(force - state.centrifugal) <= _SAME_FORCE * force:
            break
        state = solve(force)
    return state


def _evaluate(
    statics: BallStatics, displacement: NDArray[np.float64], speed: float, cage_angle: float, centrifugal: float
) -> RingState:
    q = np.array(displacement, dtype=np.float64)
    if q.shape != (5,) or not np.all(np.isfinite(q)):
        raise ValueError(f"displacement must hold 5 finite numbers, got {displacement!r}")
    if not (math.isfinite(centrifugal) and centrifugal >= 0.0):
        raise ValueError(f"centrifugal must be finite and not negative, got {centrifugal!r} N")
    angles = statics.angles(cage_angle)
    balls = np.empty((len(angles), kernels.COLUMNS))
    load, tangent = np.empty(5), np.empty((5, 5))
    energy, residual = kernels.settle_balls(q, angles, centrifugal, statics.races(), balls, load, tangent)
    return RingState(
        statics,
        q,
        speed,
        centrifugal,
        angles,
        balls[:, kernels.N_I],
        balls[:, kernels.N_O],
        balls[:, kernels.BETA_I],
        balls[:, kernels.BETA_O],
        load,
        tangent,
        energy,
        residual,
    )


def equilibrium(
    statics: BallStatics,
    load: NDArray[np.float64],
    speed: float = 0.0,
    *,
    cage_angle: float = 0.0,
    held: Mapping[str, float] = WITHOUT_TILT,
    centrifugal: float | None = None,
    begin: NDArray[np.float64] | None = None,
) -> RingState:
    """Return the state in which the balls carry a load on the inner ring.

    The minimum of a convex energy, by a damped Newton method: all begins lead to it. Within the play, or where the load
    leaves a direction without stiffness, it is one of the equilibria.

    Args:
        load: F_x, F_y, F_z, N, and M_x, M_y, N m, on the inner ring, (5,).
        speed: of the shaft, Hz, not negative.
        held: displacements that are kept, m or rad by name of COORDINATES; their loads have no effect.
        centrifugal: as of ``ring_state``.
        begin: displacement with which to begin, (5,).

    Raises:
        ValueError: if a value is not finite, a name unknown, or speed or force are negative.
        RuntimeError: if the iteration does not settle.
    """
    wanted = np.array(load, dtype=np.float64)
    if wanted.shape != (5,) or not np.all(np.isfinite(wanted)):
        raise ValueError(f"load must hold 5 finite numbers, got {load!r}")
    unknown = set(held) - set(COORDINATES)
    if unknown:
        raise ValueError(f"held must name some of {', '.join(COORDINATES)}, got {', '.join(sorted(unknown))}")
    start = np.zeros(5) if begin is None else np.array(begin, dtype=np.float64)
    for name, value in held.items():
        start[COORDINATES.index(name)] = value
    free = np.array([name not in held for name in COORDINATES])
    latest = start

    def solve(force: float) -> RingState:
        nonlocal latest
        state = _minimum(statics, wanted, free, latest, speed, cage_angle, force)
        latest = state.displacement
        return state

    return _settled_force(statics, speed, centrifugal, solve)


def _minimum(
    statics: BallStatics,
    load: NDArray[np.float64],
    free: NDArray[np.bool_],
    start: NDArray[np.float64],
    speed: float,
    cage_angle: float,
    centrifugal: float,
) -> RingState:
    """Return the equilibrium at one centrifugal force: energy less the work of the load is least."""
    races = statics.races()
    # Tilts as displacements of the groove's centres, moments as forces there.
    scale = np.array([1.0, 1.0, 1.0, 1.0 / races.inner_radius, 1.0 / races.inner_radius])[free]
    # Of a ball pressed by a micrometre: what gives a step its length where nothing touches.
    usual = 1.5 * races.k_o * 1e-3
    state = _evaluate(statics, start, speed, cage_angle, centrifugal)
    level, damping = state.energy - float(load @ state.displacement), 1e-3
    for _ in range(_ENERGY_STEPS):
        missing = (load - state.load)[free] * scale
        size = float(np.abs(missing).max(initial=0.0))
        if size <= 0.1 * UNSETTLED:
            return state
        matrix = state.tangent[np.ix_(free, free)] * np.outer(scale, scale)
        strength = damping * (float(np.trace(matrix)) + usual)
        step = np.linalg.solve(matrix + strength * np.eye(len(scale)), missing)
        q = state.displacement.copy()
        q[free] += scale * step
        tried = _evaluate(statics, q, speed, cage_angle, centrifugal)
        reached = tried.energy - float(load @ q)
        left = float(np.abs((load - tried.load)[free] * scale).max(initial=0.0))
        # Near the minimum the energy is flat to rounding, and the loads tell what is better.
        if reached < level - 1e-4 * float(step @ missing) or left <= 0.9 * size:
            state, level, damping = tried, reached, max(0.1 * damping, 1e-14)
        else:
            damping *= 10.0
        if damping > 1e12:
            break
    missing = (load - state.load)[free] * scale
    if float(np.abs(missing).max(initial=0.0)) <= UNSETTLED:
        return state
    raise RuntimeError(f"ball statics: no equilibrium found for load {load.tolist()!r} at {speed!r} Hz")
