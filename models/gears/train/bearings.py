"""Rolling bearings of a train: as supports with their stiffness at the mean force, or element by element over time.

Depths of defects and the contact law of elements are those of the rotor (``models.solve.rotor.plan``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from models.gears.train.kernel_forces import L_SIZE, Rolling, RollingCourse
from models.gears.train.linear import matrices, mean_state
from models.machine.bearing import kinematics
from models.machine.hertz import contact_exponent, contact_forces, element_angles
from models.solve.engine.passages import half_wave_meetings, in_intervals
from models.words.checks import check_numbers

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from models.gears.train.parts import Body, GearTrain, Matrix2
    from models.machine.bearing import Bearing
    from models.machine.scene import Defect

    Array = NDArray[np.float64]

_POINTS = 32
_NEWTON_STEPS = 200
_ROUNDS = 30
_SETTLED = 1e-9


@dataclass(frozen=True)
class RollingSupport:
    """The rolling bearing that a support of a train is.

    Attributes:
        support: name of the support.
        bearing: its geometry.
        k_c: contact stiffness of an element between both rings, N/m^1.5 (balls) or N/m^(10/9) (rollers).
        clearance: radial clearance h, m.
    """

    support: str
    bearing: Bearing
    k_c: float
    clearance: float = 0.0

    def __post_init__(self) -> None:
        """Raise a ValueError that names an unusable field."""
        check_numbers(self, f"support {self.support}: ", "positive", "k_c")
        check_numbers(self, f"support {self.support}: ", "not negative", "clearance")


def with_bearings(train: GearTrain, bearings: Sequence[RollingSupport]) -> GearTrain:
    """Return a train whose named supports have the stiffness of their bearings at the mean force.

    The stiffness is the slope of force over displacement there, the mean over a passage of the elements (Eq. 61 of the
    thesis). The bearings of one body share its mean force so that all are displaced alike. Dampers stay as they are.

    Args:
        train: the stiffness of these supports in it matters only where the forces of the meshes depend on it.
        bearings: of supports; others stay linear.

    Raises:
        ValueError: if a name is none of the train, or a bearing has no load, which leaves it no stiffness.
    """
    known = {support.name for body in train.bodies for support in body.supports}
    for rolling in bearings:
        if rolling.support not in known:
            raise ValueError(f"no support {rolling.support!r} in the train; there are: {', '.join(sorted(known))}")
    rolling_of = {rolling.support: rolling for rolling in bearings}
    before = mean_state(train).mesh_force
    outside = max((math.hypot(*body.force) for body in train.bodies), default=0.0)
    for _ in range(_ROUNDS):
        bodies = tuple(_carried(train, body, rolling_of, before) for body in train.bodies)
        train = replace(train, bodies=bodies)
        after = mean_state(train).mesh_force
        if np.abs(after - before).max(initial=0.0) <= _SETTLED * np.abs(after).max(initial=outside):
            return train
        before = after
    raise RuntimeError(f"the forces of the meshes and the stiffness of the bearings did not settle in {_ROUNDS} rounds")


def _carried(
    train: GearTrain,
    body: Body,
    rolling_of: dict[str, RollingSupport],
    mesh_force: Array,
) -> Body:
    """Return a body with the stiffness of its supports at its mean force."""
    here = [rolling_of[support.name] for support in body.supports if support.name in rolling_of]
    if not here:
        return body
    parts = matrices(train)
    k = parts.names.index(f"{body.name}.x")
    force = np.asarray(body.force) - parts.drive[:, k : k + 2].T @ mesh_force
    if not np.linalg.norm(force) > 0.0:
        raise ValueError(f"body {body.name}: no mean force loads its bearings, which have no stiffness without one")
    linear = np.sum([s.stiffness for s in body.supports if s.name not in rolling_of] or [np.zeros((2, 2))], axis=0)
    found = {rolling.support: np.zeros((2, 2)) for rolling in here}
    for point in range(_POINTS):
        displacement = _balance(here, linear, force, point / _POINTS)
        for rolling in here:
            found[rolling.support] += _reaction(rolling, displacement, point / _POINTS)[1] / _POINTS
    supports = tuple(
        replace(support, stiffness=_matrix(found[support.name])) if support.name in found else support
        for support in body.supports
    )
    return replace(body, supports=supports)


def _reaction(rolling: RollingSupport, displacement: Array, part: float) -> tuple[Array, Array]:
    """Return force and stiffness of a bearing, its cage turned by a part of the spacing of its elements."""
    bearing = rolling.bearing
    angles = element_angles(bearing, part * 2.0 * math.pi / (bearing.n_elements * bearing.rows))
    return contact_forces(displacement, angles, rolling.k_c, rolling.clearance, contact_exponent(bearing))


def _balance(here: Sequence[RollingSupport], linear: Array, force: Array, part: float) -> Array:
    """Return the displacement at which bearings and springs carry a force, m, (2,): a damped Newton iteration."""
    size, unit = float(np.linalg.norm(force)), force / np.linalg.norm(force)
    # About twice the displacement at which one of the bearings carries the whole force.
    starts: list[float] = []
    for one in here:
        elements = one.bearing.n_elements * one.bearing.rows
        squeeze = (5.0 * size / (elements * one.k_c)) ** (1.0 / contact_exponent(one.bearing))
        starts.append(one.clearance + squeeze)
    u: Array = 2.0 * max(starts) * unit
    damping = 1e-3
    missing, tangent = _missing(here, linear, force, u, part)
    for _ in range(_NEWTON_STEPS):
        if np.abs(missing).max() <= 1e-11 * size:
            return u
        damped = tangent + damping * float(np.trace(tangent)) * np.eye(2)
        move: Array = np.asarray(np.linalg.solve(damped, missing), dtype=np.float64)
        trial, slope = _missing(here, linear, force, u + move, part)
        if np.linalg.norm(trial) < np.linalg.norm(missing) and np.trace(slope) > 0.0:
            u, missing, tangent, damping = u + move, trial, slope, max(0.1 * damping, 1e-14)
        else:
            damping *= 10.0
    if np.abs(missing).max() <= 1e-6 * size:
        return u
    raise RuntimeError(f"the bearings {', '.join(one.support for one in here)} found no balance with {size:g} N")


def _missing(
    here: Sequence[RollingSupport], linear: Array, force: Array, displacement: Array, part: float
) -> tuple[Array, Array]:
    """Return what the reactions lack of a force, N, (2,), and their slope, N/m, (2, 2)."""
    missing, tangent = force - linear @ displacement, linear.copy()
    for rolling in here:
        reaction, slope = _reaction(rolling, displacement, part)
        missing, tangent = missing - reaction, tangent + slope
    return missing, tangent


def _matrix(values: Array) -> Matrix2:
    cross = 0.5 * float(values[0, 1] + values[1, 0])
    return ((float(values[0, 0]), cross), (cross, float(values[1, 1])))


@dataclass(frozen=True)
class RollingElements(RollingSupport):
    """The rolling bearing of a support, element by element; the outer ring stands still in the casing.

    Attributes:
        damping: of one loaded element, N s/m.
        cage_angle: angle of the first element from x at the beginning, rad.
        defects: of its parts; ``position`` is the angle from x at the beginning.
        counterclockwise: whether the body turns from x towards y.
    """

    damping: float = 0.0
    cage_angle: float = 0.0
    defects: tuple[Defect, ...] = ()
    counterclockwise: bool = True

    def __post_init__(self) -> None:
        """Raise a ValueError that names an unusable field."""
        super().__post_init__()
        check_numbers(self, f"support {self.support}: ", "not negative", "damping")
        check_numbers(self, f"support {self.support}: ", "finite", "cage_angle")
        for defect in self.defects:
            if defect.first_row + defect.rows > self.bearing.rows:
                raise ValueError(f"support {self.support}: a defect lies on a row that the bearing does not have")


def rolling_of(train: GearTrain, elements: Sequence[RollingElements], names: Sequence[str], duration: float) -> Rolling:
    """Return what the kernel needs of the bearings of a run of ``duration`` seconds.

    Args:
        names: of the degrees of freedom.
    """
    body_of = {support.name: body.name for body in train.bodies for support in body.supports}
    speeds = train.speeds()
    laws, slots, begin = np.zeros((len(elements), L_SIZE)), [np.zeros(0)], [0]
    columns: list[tuple[NDArray[np.float64], ...]] = [tuple(np.zeros(0) for _ in range(6))]
    for b, one in enumerate(elements):
        speed = speeds[body_of[one.support]] * (1.0 if one.counterclockwise else -1.0)
        cage = math.copysign(2.0 * math.pi * kinematics(one.bearing, abs(speed)).ftf, speed)
        power = contact_exponent(one.bearing)
        laws[b] = one.k_c, power, one.clearance, one.damping, cage, 1.0 / (power + 1.0)
        angles = element_angles(one.bearing, one.cage_angle)
        for defect in one.defects:
            if defect.moves_balls:
                found = half_wave_meetings(one.bearing, speed, angles, defect, duration)
                number = (found.element + begin[-1]).astype(np.float64)
                columns.append((found.begin, found.end, number, found.depth, found.rate, found.offset))
        slots.append(angles)
        begin.append(begin[-1] + len(angles))
    first, last, number, depth, rate, offset = (np.concatenate(column) for column in zip(*columns, strict=True))
    cut, angle = in_intervals(first, last, duration), np.concatenate(slots)
    return Rolling(
        place=np.array([names.index(f"{body_of[one.support]}.x") for one in elements], dtype=np.int64),
        elements=np.array(begin, dtype=np.int64),
        law=laws,
        slots=np.stack([np.cos(angle), np.sin(angle)]),
        bounds=cut.bounds,
        first=cut.first,
        element=number[cut.record].astype(np.int64),
        depth=depth[cut.record],
        rate=rate[cut.record],
        offset=offset[cut.record],
    )


def rolling_course(bearings: int, elements: int) -> RollingCourse:
    """Return the beginning of a run."""
    return RollingCourse(
        interval=np.zeros(1, dtype=np.int64),
        relief=np.zeros(elements),
        sinking=np.zeros(elements),
        reaction=np.zeros((bearings, 2)),
        contact_energy=np.zeros(3),
    )
