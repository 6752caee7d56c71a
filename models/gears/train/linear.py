"""Matrices of a train, its state under the mean torques, natural frequencies, and dampers in proportion (Rayleigh).

Degrees of freedom go body by body: x, y where the body translates, then its angle where it rotates. SI units.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from models.gears.train.parts import Body, GearTrain, Mesh, Support, Torsion, total

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

# A frequency below this share of the highest is that of a motion that no spring resists.
_FREE = 1e-6


@dataclass(frozen=True, eq=False)
class Matrices:
    """A train on its drive flanks: M q'' + (C + sum c w w^T) q' + (K + sum k w w^T) q = f + sum (k e + c e') w.

    Attributes:
        names: of the F degrees of freedom: "BODY.x", "BODY.y", "BODY.angle".
        mass: kg and kg m2, (F,).
        stiffness, damping: of supports, torsion springs and speed damping, without the meshes, (F, F).
        force: forces, N, and torques beside the mean motion, N m, (F,).
        drive: w of each mesh: its displacement per unit of each degree of freedom, m or m/rad, (meshes, F).
        back: the same of the displacement of the other flanks towards each other, (meshes, F).
    """

    names: tuple[str, ...]
    mass: Array
    stiffness: Array
    damping: Array
    force: Array
    drive: Array
    back: Array

    def with_meshes(self, stiffness: Array, damping: Array) -> tuple[Array, Array]:
        """Return stiffness and damping with those of the meshes, N/m and N s/m, each (meshes,), as (F, F)."""
        return (
            self.stiffness + self.drive.T @ (stiffness[:, None] * self.drive),
            self.damping + self.drive.T @ (damping[:, None] * self.drive),
        )


@dataclass(frozen=True, eq=False)
class TrainModes:
    """Undamped natural frequencies of a train at the mean stiffness of its meshes.

    Attributes:
        frequencies: Hz, ascending, 0 where no spring resists, (F,).
        shapes: columns of unit modal mass, (F, F).
        damping_ratios: of each mode alone, from the diagonal of the modal damping matrix; NaN at 0 Hz, (F,).
        names: of the rows of ``shapes``.
    """

    frequencies: Array
    shapes: Array
    damping_ratios: Array
    names: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class MeanState:
    """A train at rest beside its mean motion, with the mean stiffness of its meshes.

    Attributes:
        displacement: of each degree of freedom, m or rad; no rotation as a whole, (F,).
        mesh_force: along the lines of action, N, (meshes,).
        support_force: on the casing, N, by name of the support: x and y.
        names: of the degrees of freedom.
    """

    displacement: Array
    mesh_force: Array
    support_force: dict[str, Array]
    names: tuple[str, ...]


def freedoms(train: GearTrain) -> tuple[str, ...]:
    """Return the names of the degrees of freedom, in their order."""
    names: list[str] = []
    for body in train.bodies:
        names += [f"{body.name}.x", f"{body.name}.y"] if body.translates else []
        names += [f"{body.name}.angle"] if body.rotates else []
    return tuple(names)


def matrices(train: GearTrain) -> Matrices:
    """Return the matrices of a train."""
    names = freedoms(train)
    place = {name: k for k, name in enumerate(names)}
    count, torques = len(names), train.torques()
    mass, force = np.zeros(count), np.zeros(count)
    stiffness, damping = np.zeros((count, count)), np.zeros((count, count))
    for body in train.bodies:
        if body.translates:
            k = place[f"{body.name}.x"]
            mass[k : k + 2], force[k : k + 2] = body.mass, body.force
            stiffness[k : k + 2, k : k + 2] = total(support.stiffness for support in body.supports)
            damping[k : k + 2, k : k + 2] = total(support.damping for support in body.supports)
        if body.rotates:
            k = place[f"{body.name}.angle"]
            mass[k], force[k] = body.inertia, torques[body.name]
            damping[k, k] = body.speed_damping
    for spring in train.torsions:
        w = np.zeros(count)
        for name, sign in ((spring.first, 1.0), (spring.second, -1.0)):
            if f"{name}.angle" in place:
                w[place[f"{name}.angle"]] = sign
        stiffness += spring.stiffness * np.outer(w, w)
        damping += spring.damping * np.outer(w, w)
    drive = np.array([_row(train, mesh, place, back=False) for mesh in train.meshes]).reshape(-1, count)
    back = np.array([_row(train, mesh, place, back=True) for mesh in train.meshes]).reshape(-1, count)
    return Matrices(names, mass, stiffness, damping, force, drive, back)


def mean_stiffness(train: GearTrain) -> Array:
    """Return the mean stiffness of each mesh, N/m, (meshes,)."""
    return np.array([mesh.stiffness.mean for mesh in train.meshes], dtype=np.float64)


def natural_frequencies(train: GearTrain, stiffness: Array | None = None) -> TrainModes:
    """Return the modes of a train without damping and without loss of contact.

    Args:
        stiffness: of the meshes, N/m, (meshes,); their means by default.
    """
    parts = matrices(train)
    k_mesh = mean_stiffness(train) if stiffness is None else stiffness
    k, c = parts.with_meshes(k_mesh, np.array([mesh.damping for mesh in train.meshes], dtype=np.float64))
    root = 1.0 / np.sqrt(parts.mass)
    values, vectors = np.linalg.eigh(root[:, None] * k * root[None, :])
    speeds = np.sqrt(np.maximum(values, 0.0))
    speeds[speeds < _FREE * speeds.max(initial=0.0)] = 0.0
    shapes = root[:, None] * vectors
    modal = np.einsum("im,ij,jm->m", shapes, c, shapes)
    ratios = np.full(speeds.shape, math.nan)
    np.divide(modal, 2.0 * speeds, out=ratios, where=speeds > 0.0)
    return TrainModes(speeds / (2.0 * math.pi), shapes, ratios, parts.names)


def mean_state(train: GearTrain, stiffness: Array | None = None) -> MeanState:
    """Return a train at rest beside its mean motion, its errors left out.

    Args:
        stiffness: of the meshes, N/m, (meshes,); their means by default.

    Raises:
        ValueError: if the torques would part the drive flanks of a mesh with backlash; the message names it.
    """
    parts = matrices(train)
    k_mesh = mean_stiffness(train) if stiffness is None else stiffness
    k, _ = parts.with_meshes(k_mesh, np.zeros(len(train.meshes)))
    # Scaled by the masses, so that the rotation as a whole, which nothing resists, has no part in the solution.
    root = 1.0 / np.sqrt(parts.mass)
    displacement = root * (
        np.linalg.pinv(root[:, None] * k * root[None, :], rcond=_FREE**2, hermitian=True) @ (root * parts.force)
    )
    force = k_mesh * (parts.drive @ displacement)
    rounding = _FREE * k_mesh * (np.abs(parts.drive) @ np.abs(displacement))
    for mesh, value, least in zip(train.meshes, force, rounding, strict=True):
        if value < -least and mesh.backlash > 0.0:
            raise ValueError(
                f"{mesh.name}: the torques press the flanks that do not drive with {-value:g} N; swap driver and driven"
            )
    return MeanState(displacement, force, support_forces(train, displacement), parts.names)


def support_forces(train: GearTrain, displacement: Array, velocity: Array | None = None) -> dict[str, Array]:
    """Return the forces of the supports on the casing, N, by name.

    Args:
        displacement: of the degrees of freedom, (..., F).
        velocity: the same, or None where the dampers have no part.

    Returns:
        x and y of each support, (..., 2).
    """
    place = {name: k for k, name in enumerate(freedoms(train))}
    found: dict[str, Array] = {}
    for body in train.bodies:
        if not body.translates:
            continue
        k = place[f"{body.name}.x"]
        for support in body.supports:
            force = displacement[..., k : k + 2] @ np.asarray(support.stiffness).T
            if velocity is not None:
                force = force + velocity[..., k : k + 2] @ np.asarray(support.damping).T
            found[support.name] = force
    return found


def _row(train: GearTrain, mesh: Mesh, place: Mapping[str, int], *, back: bool) -> Array:
    """Return the displacement of a mesh per unit of each degree of freedom, (F,)."""
    row = np.zeros(len(place))
    angle = mesh.line_of_action
    if back:
        angle = mesh.line_of_action + math.pi if mesh.back_line is None else mesh.back_line
    for name, sign in ((mesh.driver, 1.0), (mesh.driven, -1.0)):
        wheel = train.wheel(name)
        if f"{wheel.body}.x" in place:
            k = place[f"{wheel.body}.x"]
            row[k], row[k + 1] = sign * math.cos(angle), sign * math.sin(angle)
        if f"{wheel.body}.angle" in place:
            row[place[f"{wheel.body}.angle"]] = (-sign if back else sign) * wheel.base_radius
    return row


def with_rayleigh(train: GearTrain, alpha: float, beta: Mapping[str, float], *, default: float = 0.0) -> GearTrain:
    """Return a train with dampers c = alpha m + beta k, each with a beta of its own (thesis, Eq. 39 and Table 24).

    Of the supports, ``m`` is the mass of the body, shared among them as their stiffness is; of a mesh, the two inertias
    seen along the line of action, J1 J2 / (J1 r2^2 + J2 r1^2), and ``k`` its mean stiffness; of a torsion spring
    J1 J2 / (J1 + J2). The thesis prints the coefficients without these masses (its Eqs. 98 and 99 are missing).

    Args:
        train: its dampers are replaced.
        alpha: 1/s.
        beta: s, by name of a body (for its supports), a mesh or a torsion spring ("first-second").
        default: beta of those that are not named, s.

    Raises:
        ValueError: if a name is none of the train.
    """
    known = {b.name for b in train.bodies} | {m.name for m in train.meshes} | {t.name for t in train.torsions}
    unknown = sorted(set(beta) - known)
    if unknown:
        raise ValueError(f"beta: {unknown[0]!r} is none of {', '.join(sorted(known))}")
    bodies = tuple(_damped(body, alpha, beta.get(body.name, default)) for body in train.bodies)
    meshes: list[Mesh] = []
    for mesh in train.meshes:
        k = float(mesh.stiffness.mean)
        meshes.append(replace(mesh, damping=alpha * mesh_mass(train, mesh) + beta.get(mesh.name, default) * k))
    torsions: list[Torsion] = []
    for spring in train.torsions:
        inertia = _reduced(train.body(spring.first), 1.0, train.body(spring.second), 1.0)
        b = beta.get(spring.name, default)
        torsions.append(replace(spring, damping=alpha * inertia + b * spring.stiffness))
    return replace(train, bodies=bodies, meshes=tuple(meshes), torsions=tuple(torsions))


def mesh_mass(train: GearTrain, mesh: Mesh) -> float:
    """Return the inertias of both bodies as one mass along the line of action, kg."""
    first, second = train.wheel(mesh.driver), train.wheel(mesh.driven)
    return _reduced(train.body(first.body), first.base_radius, train.body(second.body), second.base_radius)


def _damped(body: Body, alpha: float, beta: float) -> Body:
    (a, _), (_, d) = total(support.stiffness for support in body.supports)
    supports: list[Support] = []
    for support in body.supports:
        (kxx, kxy), (kyx, kyy) = support.stiffness
        mass = alpha * body.mass * (kxx + kyy) / (a + d)
        supports.append(replace(support, damping=((mass + beta * kxx, beta * kxy), (beta * kyx, mass + beta * kyy))))
    return replace(body, supports=tuple(supports))


def _reduced(first: Body, first_radius: float, second: Body, second_radius: float) -> float:
    """Return the mass of two rotations along a line at both radii; one that does not yield counts as infinite."""
    yields = [r * r / body.inertia for body, r in ((first, first_radius), (second, second_radius)) if body.rotates]
    return 1.0 / math.fsum(yields) if yields else 0.0
