"""The motion of a train of gears over time: rattle, loss of contact, forces of meshes and bearings.

``models/gears/train/parts.py`` states the train, ``models/gears/train/kernel.py`` the integration. Rotations are those
beside the mean motion; the phase of each mesh is that of the mean motion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.gears.train import kernel as kernels
from models.gears.train.bearings import RollingElements, rolling_course, rolling_of
from models.gears.train.kernel_forces import ENERGIES, T_SIZE, Course, TrainPlan, to_sample
from models.gears.train.linear import matrices, mean_state, natural_frequencies, support_forces
from models.words.checks import check_positive

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from models.gears.train.linear import Matrices
    from models.gears.train.parts import GearTrain, Mesh

    Array = NDArray[np.float64]

# Longest step over the shortest period of the linear motion, rad, and over its fastest decay.
_ANGLE = 0.3
_DECAY = 2.0
# Dropped at the beginning: time constants of the slowest decay, and limits in seconds.
_SETTLE_CONSTANTS = 7.0
_SETTLE_LEAST, _SETTLE_MOST = 0.02, 2.0
# Instants that are integrated at a time while the beginning is dropped.
_CHUNK = 4096


@dataclass(frozen=True, eq=False)
class TrainState:
    """Where a train is at an instant.

    Attributes:
        turns: of the drive since it was at turn 0, from which the phases of all meshes follow.
        displacement, velocity: of the degrees of freedom, (F,).
        touching: whether the flanks of each contact touch: of each mesh those that drive, then the others, (2 m,).
    """

    turns: float
    displacement: Array
    velocity: Array
    touching: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class TrainMotion:
    """N instants of the motion of a train.

    Attributes:
        train: that moved.
        rate: instants a second, Hz.
        names: of the F degrees of freedom: "BODY.x", "BODY.y", "BODY.angle".
        displacement, velocity, acceleration: beside the mean motion, SI, (N, F), at the instants, without
            a filter against aliasing.
        mesh_displacement: delta of the drive flanks, m, negative where they are apart, (N, m).
        drive_force, back_force: of the flanks that drive and of the others, N, (N, m).
        energy: J, (N, 4): stored in masses and springs; since the beginning, what the torques did beside the mean
            motion, what the dampers took, what the mean rotation gave through stiffness and error of the meshes.
        out_of_contact, back_contact: shares of the time without contact and on the other flanks, (m,).
        touches: how often the flanks that drive met anew, (m,).
        end: where it ended; a further run can begin there.
        finite: whether the state stayed finite.
        rolling_force: of the elements of the bearings that were described by them, on the casing, N, by name, (N, 2).
    """

    train: GearTrain
    rate: float
    names: tuple[str, ...]
    displacement: Array
    velocity: Array
    acceleration: Array
    mesh_displacement: Array
    drive_force: Array
    back_force: Array
    energy: Array
    out_of_contact: Array
    back_contact: Array
    touches: NDArray[np.int64]
    end: TrainState
    finite: bool
    rolling_force: dict[str, Array]

    def of(self, name: str, what: str = "displacement") -> Array:
        """Return displacement, velocity or acceleration of a degree of freedom, (N,).

        Raises:
            ValueError: if there is no such degree of freedom; the message names those that there are.
        """
        if name not in self.names:
            raise ValueError(f"no degree of freedom {name!r}; there are: {', '.join(self.names)}")
        found: Array = {
            "displacement": self.displacement,
            "velocity": self.velocity,
            "acceleration": self.acceleration,
        }[what]
        return found[:, self.names.index(name)]

    @property
    def mesh_force(self) -> Array:
        """Force that drives along the line of action, less that of the other flanks, N, (N, m)."""
        return self.drive_force - self.back_force

    @property
    def transmission_error(self) -> Array:
        """Way by which the driver is ahead of the driven wheel at the base circles, beside the mean, m, (N, m)."""
        angles = np.array([name.endswith(".angle") for name in self.names])
        return self.displacement @ (matrices(self.train).drive * angles).T

    @property
    def axial_force(self) -> Array:
        """Force of each mesh along the axes of helical wheels, to which no body yields, N, 0 of spur wheels, (N, m)."""
        return self.mesh_force * np.tan([mesh.base_helix for mesh in self.train.meshes])

    def speed(self, body: str) -> Array:
        """Return the speed of a body beside its mean speed, Hz, (N,); 0 where it turns at the mean speed exactly.

        Raises:
            ValueError: if there is no such body; the message names those that there are.
        """
        if not self.train.body(body).rotates:
            return np.zeros(len(self.velocity))
        return self.of(f"{body}.angle", "velocity") / (2.0 * math.pi)

    def bearing_forces(self) -> dict[str, Array]:
        """Return the forces of the supports on the casing, springs and dampers, N, by name: x and y, (N, 2)."""
        found = support_forces(self.train, self.displacement, self.velocity)
        springs = support_forces(self.train, self.displacement)
        # Of a rolling bearing the elements stand in the place of the springs.
        return found | {name: found[name] - springs[name] + force for name, force in self.rolling_force.items()}

    def energy_residual(self) -> float:
        """Return the largest failure of the energy balance over the energy that went through, dimensionless.

        The defect of a rolling element relieves it at once where it meets a race; what that frees is left out.
        """
        stored, did, took, gave = (self.energy - self.energy[0]).T
        scale = np.max(np.abs(self.energy[:, 0])) + np.max(np.abs(did)) + np.max(took) + np.max(np.abs(gave))
        return float(np.max(np.abs(stored - did + took - gave)) / scale)


def simulate_train(
    train: GearTrain,
    *,
    duration: float,
    rate: float = 51200.0,
    settle: float | None = None,
    step: float | None = None,
    start: TrainState | None = None,
    rolling: Sequence[RollingElements] = (),
) -> TrainMotion:
    """Return the motion of a train.

    Args:
        train: what moves.
        duration: that is returned, s.
        rate: instants a second, Hz.
        settle: time that is dropped before, s; by default what the slowest decay needs, or nothing after a ``start``.
        step: longest step, s; by default ``longest_step``.
        start: where the motion begins; by default at rest under the mean torques, at turn 0.
        rolling: bearings whose elements are described one by one, instead of the stiffness of the support of the same
            name, whose damper stays. They need a constant speed and the beginning at turn 0.

    Raises:
        ValueError: if an argument is unusable, or the drive would come to stand still; the message names it.
    """
    check_positive(duration=duration, rate=rate)
    if rolling and (train.acceleration != 0.0 or (start is not None and start.turns != 0.0)):
        raise ValueError("rolling: bearings with elements need a constant speed and a start at turn 0")
    longest = longest_step(train) if step is None else step
    check_positive(step=longest)
    dropped = (settling(train) if start is None else 0.0) if settle is None else settle
    if not (math.isfinite(dropped) and dropped >= 0.0):
        raise ValueError(f"settle must be finite and not negative, got {dropped!r}")
    skipped, count = math.ceil(dropped * rate - 1e-9), max(1, round(duration * rate))
    parts = matrices(train)
    plan = plan_of(train, parts, 0.0 if start is None else start.turns, rolling, (skipped + count) / rate)
    course = course_of(plan, at_rest(train) if start is None else start)
    status = _drop(plan, course, skipped, 1.0 / rate, longest)
    course.apart[:], course.changes[:] = 0.0, 0
    motion, contacts, energy, reactions = places = places_of(plan, count)
    if status == kernels.STATUS_OK:
        status = kernels.integrate(plan, course, 0.0, 1.0 / rate, skipped, longest, *places)
    if status == kernels.STATUS_STANDS_STILL:
        raise ValueError(f"train: with an acceleration of {train.acceleration!r} Hz/s the drive comes to stand still")
    # The first instant is that of the start where nothing is dropped, else it ends an interval that counts.
    n, span = len(parts.names), max(count - (skipped == 0), 1) / rate
    time = (skipped + count - 1) / rate
    turns = time * (plan.speed[0] + 0.5 * plan.speed[1] * time) + (0.0 if start is None else start.turns)
    return TrainMotion(
        train=train,
        rate=rate,
        names=parts.names,
        displacement=motion[:, 0],
        velocity=motion[:, 1],
        acceleration=motion[:, 2],
        mesh_displacement=contacts[:, 0, 0::2],
        drive_force=contacts[:, 1, 0::2],
        back_force=contacts[:, 1, 1::2],
        energy=energy,
        out_of_contact=course.apart[0] / span,
        back_contact=course.apart[1] / span,
        touches=course.changes[0::2].copy(),
        end=TrainState(turns, course.state[:n].copy(), course.state[n : 2 * n].copy(), course.touching.copy()),
        finite=status == kernels.STATUS_OK,
        rolling_force={one.support: -reactions[:, b] for b, one in enumerate(rolling)},
    )


def longest_step(train: GearTrain) -> float:
    """Return the longest step that is taken by default, s: 0.3 rad of the fastest mode, or its decay."""
    parts = matrices(train)
    k, c = parts.with_meshes(
        np.array([float(mesh.stiffness.base.max()) for mesh in train.meshes], dtype=np.float64),
        np.array([mesh.damping for mesh in train.meshes], dtype=np.float64),
    )
    root = 1.0 / np.sqrt(parts.mass)
    fastest = math.sqrt(float(np.linalg.eigvalsh(root[:, None] * k * root)[-1]))
    decay = float(np.linalg.eigvalsh(root[:, None] * c * root)[-1])
    return min(_ANGLE / fastest, _DECAY / decay if decay > 0.0 else math.inf)


def settling(train: GearTrain) -> float:
    """Return the time to drop at the beginning, s."""
    modes = natural_frequencies(train)
    rates = (2.0 * math.pi * modes.frequencies * modes.damping_ratios)[modes.frequencies > 0.0]
    slowest = float(rates.min(initial=math.inf))
    wished = _SETTLE_CONSTANTS / slowest if slowest > 0.0 else math.inf
    return min(max(wished, _SETTLE_LEAST), _SETTLE_MOST)


def at_rest(train: GearTrain) -> TrainState:
    """Return a train at rest under the mean torques, at turn 0; the flanks touch that then overlap."""
    rest = mean_state(train).displacement
    return TrainState(0.0, rest, np.zeros_like(rest), np.zeros(0, dtype=np.bool_))


def plan_of(
    train: GearTrain, parts: Matrices, turns: float, rolling: Sequence[RollingElements], duration: float
) -> TrainPlan:
    """Return what the kernel needs of a train whose drive is at a number of turns at time 0.

    Raises:
        ValueError: if a rolling bearing is at no support of the train.
    """
    ratios = train.ratios()
    count = len(train.meshes)
    table, values = np.zeros((count, T_SIZE, 2), dtype=np.int64), [np.zeros(0)]
    begin, per_turn, shift = np.zeros(count), np.zeros(count), np.zeros(count, dtype=np.int64)
    at = 0
    for m, mesh in enumerate(train.meshes):
        z1, z2, n = *(train.wheel(name).teeth for name in (mesh.driver, mesh.driven)), mesh.stiffness.samples
        per_turn[m] = ratios[train.wheel(mesh.driver).body] * z1 * n
        begin[m] = mesh.driver_start * z1 * n + per_turn[m] * turns
        shift[m] = round(mesh.driven_start * z2 - mesh.driver_start * z1) * n
        for which, values_here in enumerate(_tables(mesh)):
            table[m, which] = at, 0 if values_here is None else values_here.size
            if values_here is not None:
                values.append(values_here)
                at += values_here.size
    rows = np.empty((2 * count, len(parts.names)))
    rows[0::2], rows[1::2] = parts.drive, parts.back
    free = np.zeros(2 * count)
    free[1::2] = [mesh.backlash if mesh.backlash > 0.0 else math.inf for mesh in train.meshes]
    rise = train.acceleration
    return TrainPlan(
        inverse=1.0 / parts.mass,
        stiffness=_without(train, parts, rolling),
        damping=parts.damping,
        force=parts.force,
        row=rows,
        free=free,
        linear=np.array([mesh.backlash == 0.0 for mesh in train.meshes], dtype=np.bool_),
        film=np.array([mesh.damps_without_contact for mesh in train.meshes], dtype=np.bool_),
        mesh_damping=np.array([mesh.damping for mesh in train.meshes], dtype=np.float64),
        table=table,
        values=np.concatenate(values),
        begin=begin,
        per_turn=per_turn,
        shift=shift,
        speed=np.array([math.sqrt(max(train.speed**2 + 2.0 * rise * turns, 0.0)), rise]),
        **rolling_of(train, rolling, parts.names, duration)._asdict(),
    )


def _without(train: GearTrain, parts: Matrices, rolling: Sequence[RollingElements]) -> Array:
    """Return the stiffness without that of the supports that are rolling bearings."""
    stiffness, found = parts.stiffness.copy(), 0
    names = [one.support for one in rolling]
    for body in train.bodies:
        for support in body.supports:
            if support.name in names:
                k = parts.names.index(f"{body.name}.x")
                stiffness[k : k + 2, k : k + 2] -= np.asarray(support.stiffness)
                found += 1
    if found < len(names):
        known = ", ".join(support.name for body in train.bodies for support in body.supports)
        raise ValueError(f"rolling: supports must be different ones of {known}, got {', '.join(names)}")
    return stiffness


def course_of(plan: TrainPlan, start: TrainState) -> Course:
    """Return the beginning of a run; contacts that the start leaves open touch where their flanks overlap."""
    n, count = plan.inverse.size, plan.per_turn.size
    size = 2 * n + ENERGIES
    course = Course(
        state=np.zeros(size),
        touching=np.zeros(2 * count, dtype=np.bool_),
        at=np.zeros(count, dtype=np.int64),
        k=np.zeros(count),
        k_slope=np.zeros(count),
        e=np.zeros(count),
        e_slope=np.zeros(count),
        apart=np.zeros((2, count)),
        changes=np.zeros(2 * count, dtype=np.int64),
        slope=np.zeros((7, size)),
        trial=np.zeros(size),
        **rolling_course(len(plan.place), plan.slots.shape[1])._asdict(),
    )
    course.state[:n], course.state[n : 2 * n] = start.displacement, start.velocity
    for m in range(count):
        to_sample(plan, course, m, math.floor(plan.begin[m] + 1e-9))
    along = plan.begin - course.at
    error = course.e + along * course.e_slope
    for contact in range(2 * count):
        m, sign = contact // 2, 1.0 - 2.0 * (contact % 2)
        gap = float(plan.row[contact] @ start.displacement) - sign * error[m] - plan.free[contact]
        course.touching[contact] = gap > 0.0 or (plan.linear[m] and contact % 2 == 0)
    if start.touching.size:
        course.touching[:] = start.touching
    return course


def _tables(mesh: Mesh) -> tuple[Array | None, ...]:
    """Return the tables of a mesh in the order of the kernel."""
    k = mesh.stiffness
    return k.base, k.driver_loss, k.driven_loss, k.driver_error, k.driven_error


def places_of(plan: TrainPlan, count: int) -> tuple[Array, Array, Array, Array]:
    """Return places for what the kernel writes of a number of instants."""
    n, contacts = plan.inverse.size, plan.free.size
    bearings = len(plan.place)
    return (
        np.zeros((count, 3, n)),
        np.zeros((count, 2, contacts)),
        np.zeros((count, 1 + ENERGIES)),
        np.zeros((count, bearings, 2)),
    )


def _drop(plan: TrainPlan, course: Course, count: int, interval: float, longest: float) -> int:
    """Integrate to the instant ``count``, keep nothing, and return the status."""
    done = 0
    while done < count:
        places = places_of(plan, min(_CHUNK, count - done))
        status = kernels.integrate(plan, course, 0.0, interval, done, longest, *places)
        if status != kernels.STATUS_OK:
            return status
        done += len(places[0])
    return kernels.STATUS_OK
