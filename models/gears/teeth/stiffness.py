"""Mesh stiffness and transmission error of a pair of gears, sound or faulty, from its geometry.

At each station of a pitch the force along the line of action is shared by the tooth pairs in contact (spur: teeth stiff
along the face, contact by slices where faults need them; helical: independent slices of the face). What follows is a
static deflection under one force: no friction, no contact off the line of action before A and after E, no deflection
of shafts. Faulty teeth are met by sound ones of the other wheel, see ``models.gears.teeth.mesh``.

ISO 6336-1, method B, is an approximation for steel gears, against which the models are held: c' is the largest
stiffness of a single pair, c_gamma the mean stiffness of the mesh, both for a face of unit width and in the transverse
section along the line of action. Valid for 100 N/mm and more of specific load; below it the standard lets both fall
with the fourth root.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.gears.teeth.contacts import Springs, share_force
from models.gears.teeth.faults import Eccentricity, Effect, Flank
from models.gears.teeth.mesh import DEFAULT_SAMPLES, MeshStiffness
from models.gears.teeth.tooth import StiffnessMethod, loaded_point, shared_compliance, tooth_compliance
from models.words.checks import check_positive

if TYPE_CHECKING:
    from models.gears.teeth.geometry import GearPair

# N/(mm um) to N/m per m of face.
_UNIT = 1e9
_LIMIT_LOAD = 100e3
_STEEL = 206e9
# Theory against measurement, c' over c'_th.
_MEASURED = 0.8


@dataclass(frozen=True)
class IsoStiffness:
    """Stiffness a unit of face width, N/m^2.

    Attributes:
        single: c'.
        mesh: c_gamma_alpha, the mean of the mesh.
        valid: whether the standard's ranges of profile shift and of load are kept.
    """

    single: float
    mesh: float
    valid: bool


def iso_stiffness(pair: GearPair, tangential_force: float | None = None) -> IsoStiffness:
    """Return c' and c_gamma_alpha of solid wheels with the pair's rack and modulus.

    Args:
        pair: the gears; the smaller wheel counts as the standard's first.
        tangential_force: F_t K_A at the reference circle, N; None for a load within the standard's range.

    Raises:
        ValueError: where the force is not positive.
    """
    first, second = sorted(pair.wheels, key=lambda wheel: wheel.teeth)
    helix = math.cos(pair.base_helix_angle) ** 2 * math.cos(pair.helix_angle)
    z1, z2 = first.teeth / helix, second.teeth / helix
    x1, x2 = first.profile_shift, second.profile_shift
    compliance = (0.04723 + 0.15551 / z1 + 0.25791 / z2 - 0.00635 * x1 - 0.11654 * x1 / z1) + (
        -0.00193 * x2 - 0.24188 * x2 / z2 + 0.00529 * x1**2 + 0.00182 * x2**2
    )
    rack = (1.0 + 0.5 * (1.2 - pair.rack.dedendum)) * (1.0 - 0.02 * (20.0 - math.degrees(pair.pressure_angle)))
    moduli = 2.0 * first.modulus * second.modulus / (first.modulus + second.modulus)
    single = _UNIT * _MEASURED * rack * math.cos(pair.helix_angle) * moduli / _STEEL / compliance
    valid = x1 >= x2 and -0.5 <= x1 + x2 <= 2.0
    if tangential_force is not None:
        check_positive(tangential_force=tangential_force)
        load = tangential_force / pair.face_width
        single *= min(load / _LIMIT_LOAD, 1.0) ** 0.25
        valid = valid and load >= _LIMIT_LOAD
    return IsoStiffness(single, single * (0.75 * pair.transverse_contact_ratio + 0.25), valid)


if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from models.gears.teeth.faults import GearFault, ToothFault
    from models.gears.teeth.geometry import GearPair

    Array = NDArray[np.float64]
# Positions of a mesh with faults that are solved at once.
_MAX_POSITIONS = 4096


@dataclass(frozen=True)
class LoadedMesh:
    """A mesh under a force at its stations.

    Attributes:
        stiffness: secant or tangent, as the method says, N/m, shape (n,).
        error: e of ``models.gears.teeth.mesh``, m, shape (n,).
        no_load_error: transmission error without load, m, shape (n,).
        loaded_error: approach of the base circles under the force, m, shape (n,): the loaded transmission error.
        forces: of the tooth pairs, N, shape (n, pairs); pair j has been in contact for j pitches.
    """

    stiffness: Array
    error: Array
    no_load_error: Array
    loaded_error: Array
    forces: Array


def mesh_stiffness(
    pair: GearPair,
    force: float,
    *,
    samples: int = DEFAULT_SAMPLES,
    method: StiffnessMethod | None = None,
    driver_faults: Sequence[GearFault] = (),
    driven_faults: Sequence[GearFault] = (),
) -> MeshStiffness:
    """Return stiffness and error of a mesh under a mean force.

    Args:
        pair: the gears.
        force: mean force along the line of action in the transverse section, N: torque over base radius.
        samples: stations of a pitch.
        method: how the stiffness is computed.
        driver_faults, driven_faults: of the two wheels.

    Raises:
        ValueError: where the force is not positive, or a fault does not fit its wheel; the field is named.
    """
    faults = (tuple(driver_faults), tuple(driven_faults))
    grid = _Grid.of(pair, samples, method or StiffnessMethod(), faults)
    base = grid.solve(grid.springs(), force)
    tables = [_fault_tables(grid, side, faults[side], base, force) for side in (0, 1)]
    errors = [error for _, error in tables]
    if base.error.any():
        repeated = np.tile(base.error, pair.driver.teeth)
        errors[0] = repeated if errors[0] is None else errors[0] + repeated
    losses = [loss for loss, _ in tables]
    return MeshStiffness(pair.driver.teeth, pair.driven.teeth, base.stiffness, *losses, *errors)


def loaded_mesh(
    pair: GearPair, force: float, *, samples: int = DEFAULT_SAMPLES, method: StiffnessMethod | None = None
) -> LoadedMesh:
    """Return a sound mesh under a force; arguments and errors as in ``mesh_stiffness``."""
    grid = _Grid.of(pair, samples, method or StiffnessMethod(), ((), ()))
    return grid.solve(grid.springs(), force)


@dataclass(frozen=True)
class _Grid:
    """Where sound teeth touch: arrays of shape (n, pairs, slices).

    Attributes:
        pair, method: what is computed.
        edges: of the slices along the face, m.
        cover: share of each slice that is on the path of contact.
        flanks: places of the contacts on driver and driven wheel.
        compliance: of the teeth of driver and driven wheel, m^2/N.
        gap: tip relief of both, m.
        depths, radius: of the contacts, see ``Springs``.
    """

    pair: GearPair
    method: StiffnessMethod
    edges: Array
    cover: Array
    flanks: tuple[Flank, Flank]
    compliance: tuple[Array, Array]
    gap: Array
    depths: Array
    radius: Array

    @classmethod
    def of(
        cls, pair: GearPair, samples: int, method: StiffnessMethod, faults: tuple[tuple[GearFault, ...], ...]
    ) -> _Grid:
        edges = _edges(pair, method, [fault for side in faults for fault in side])
        path, cover = _paths(pair, samples, edges)
        begin, end = pair.contact_path
        lengths = (path, pair.tangent_length - path)
        rolls = [length / radius for length, radius in zip(lengths, pair.base_radii, strict=True)]
        sides = list(zip(pair.profiles, pair.wheels, rolls, strict=True))
        flanks = [Flank(profile, wheel, roll, edges, method.plane) for profile, wheel, roll in sides]
        compliance = [tooth_compliance(profile, wheel, roll, method) for profile, wheel, roll in sides]
        gap = np.zeros(path.shape)
        for wheel, below_tip in ((pair.driver, end - path), (pair.driven, path - begin)):
            if wheel.tip_relief is not None:
                gap += wheel.tip_relief.removed(below_tip)
        return cls(
            pair=pair,
            method=method,
            edges=edges,
            cover=cover,
            flanks=(flanks[0], flanks[1]),
            compliance=(compliance[0], compliance[1]),
            gap=gap,
            depths=np.stack([loaded_point(profile, roll).depth for profile, _, roll in sides]),
            radius=lengths[0] * lengths[1] / pair.tangent_length / math.cos(pair.base_helix_angle),
        )

    @property
    def coupled(self) -> bool:
        """Whether the slices of a tooth share its deflection."""
        return self.pair.helix_angle == 0.0

    def springs(self, added: Effect | None = None, where: NDArray[np.int64] | None = None) -> Springs:
        """Return the springs of sound teeth, or of teeth with an effect of faults at chosen stations."""
        chosen = slice(None) if where is None else where
        width = np.diff(self.edges) * self.cover[chosen]
        gap, compliance = self.gap[chosen], (self.compliance[0] + self.compliance[1])[chosen]
        if added is not None:
            gap, compliance = gap + added.gap, compliance + added.compliance
        factor = math.cos(self.pair.base_helix_angle)
        carrying = width if added is None else width * added.cover
        depths, radius = self.depths[:, chosen], self.radius[chosen]
        if self.coupled:
            teeth = 1.0 / np.where(width > 0.0, width / compliance, 0.0).sum(axis=2, initial=1e-300)
            return Springs(gap, carrying, np.minimum(teeth, 1.0), depths, radius, factor)
        flat = (len(gap), -1, 1)
        teeth = np.where(width > 0.0, compliance / np.where(width > 0.0, width * factor, 1.0), 1.0)
        return Springs(
            gap.reshape(flat),
            carrying.reshape(flat),
            teeth.reshape(flat[:2]),
            depths.reshape(2, *flat),
            radius.reshape(flat),
            factor,
        )

    def solve(self, springs: Springs, force: float) -> LoadedMesh:
        """Return what a force does, the deflection of the bodies that all teeth share included."""
        check_positive(force=force)
        pair, method = self.pair, self.method
        shared = share_force(springs, pair.wheels, force, method.contact)
        body = 0.0
        if method.shared_body:
            sides = zip(pair.profiles, pair.wheels, strict=True)
            body = sum(shared_compliance(p, w, method.plane) / w.face_width for p, w in sides)
        approach = shared.approach + body * force
        if method.level == "secant":
            stiffness, error = force / (approach - shared.contact), shared.contact
        else:
            stiffness = 1.0 / (1.0 / shared.slope + body)
            error = approach - force / stiffness
        forces = shared.forces.reshape(len(approach), self.cover.shape[1], -1).sum(axis=2)
        return LoadedMesh(stiffness, error, shared.contact, approach, forces)


def _edges(pair: GearPair, method: StiffnessMethod, faults: Sequence[GearFault]) -> Array:
    face = pair.face_width
    count = 1 if pair.helix_angle == 0.0 else method.slices
    edges = {float(edge) for edge in np.linspace(0.0, face, count + 1)}
    for fault in faults:
        if not isinstance(fault, Eccentricity):
            edges.update(fault.edges(face))
    return np.array(sorted(edges))


def _paths(pair: GearPair, samples: int, edges: Array) -> tuple[Array, Array]:
    """Return the mean place on the path of contact, m from T1, and the share of each slice that is on the path."""
    begin, end = pair.contact_path
    lag = math.tan(pair.base_helix_angle) * edges
    pairs = math.ceil(pair.contact_ratio - 1e-12)
    phase = pair.stations(samples)[:, np.newaxis, np.newaxis] + np.arange(pairs)[:, np.newaxis]
    first = begin + pair.base_pitch * phase
    high, low = first - lag[:-1], first - lag[1:]
    if pair.helix_angle == 0.0:
        # The end of the path belongs to it no more: the tooth that leaves makes room for the one that enters.
        inside = (low >= begin) & (low < end - 1e-12 * pair.base_pitch)
        return np.clip(low, begin, end), inside.astype(np.float64)
    covered_low, covered_high = np.clip(low, begin, end), np.clip(high, begin, end)
    return 0.5 * (covered_low + covered_high), (covered_high - covered_low) / (high - low)


def _fault_tables(
    grid: _Grid, side: int, faults: tuple[GearFault, ...], base: LoadedMesh, force: float
) -> tuple[Array | None, Array | None]:
    """Return stiffness lost and error over a turn of one wheel, or None for none."""
    teeth, samples = grid.pair.wheels[side].teeth, len(base.stiffness)
    loss, error = np.zeros((teeth, samples)), np.zeros((teeth, samples))
    for fault in faults:
        if isinstance(fault, Eccentricity):
            error += fault.errors(teeth * samples).reshape(teeth, samples)
    effects = _tooth_effects(grid, side, [fault for fault in faults if not isinstance(fault, Eccentricity)])
    pairs = grid.cover.shape[1]
    touched = sorted({(tooth + age) % teeth for tooth in effects for age in range(pairs)})
    chunk = max(1, _MAX_POSITIONS // samples)
    for begin in range(0, len(touched), chunk):
        pitches = touched[begin : begin + chunk]
        added = _gathered(effects, pitches, teeth, grid.cover.shape)
        where = np.tile(np.arange(samples), len(pitches))
        found = grid.solve(grid.springs(added, where), force)
        loss[pitches] += base.stiffness - found.stiffness.reshape(-1, samples)
        error[pitches] += found.error.reshape(-1, samples) - base.error
    return loss.ravel() if loss.any() else None, error.ravel() if error.any() else None


def _tooth_effects(grid: _Grid, side: int, faults: Sequence[ToothFault]) -> dict[int, Effect]:
    effects: dict[int, Effect] = {}
    for fault in faults:
        for tooth in fault.teeth(grid.pair.wheels[side].teeth):
            effect = fault.effect(grid.flanks[side], tooth)
            effects[tooth] = effects[tooth] + effect if tooth in effects else effect
    return effects


def _gathered(effects: dict[int, Effect], pitches: list[int], teeth: int, shape: tuple[int, ...]) -> Effect:
    """Return the effects on all pairs at pitches of the wheel, shape (len(pitches) * n, pairs, slices)."""
    whole = (len(pitches), *shape)
    gap, cover, compliance = np.zeros(whole), np.ones(whole), np.zeros(whole)
    for place, pitch in enumerate(pitches):
        for age in range(shape[1]):
            effect = effects.get((pitch - age) % teeth)
            if effect is not None:
                gap[place, :, age] = effect.gap[:, age]
                cover[place, :, age] = effect.cover[:, age]
                compliance[place, :, age] = effect.compliance[:, age]
    flat = (-1, *shape[1:])
    return Effect(gap.reshape(flat), cover.reshape(flat), compliance.reshape(flat))
