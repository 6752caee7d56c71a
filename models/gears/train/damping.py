"""Dampers of a train in proportion to mass and stiffness, each with coefficients of its own (Rayleigh)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from models.gears.train.parts import Body, GearTrain, Mesh, Support, Torsion, total

if TYPE_CHECKING:
    from collections.abc import Mapping


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
