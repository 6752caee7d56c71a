"""A self-aligning ball bearing of finite elements: two rows, assembled from a law of one ball and the rings' influence.

See ``models.fe.bearings.oblique``. Axis 1 lies along the radial load, axis 2 across it, axis 3 along the shaft.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from models.fe.bearings.assembly import FeBearing, FeState, PassingElements
from models.fe.bearings.balance import Balance, condensed, settle
from models.fe.bearings.oblique_bodies import (
    RULE,
    SHARES,
    BallLaw,
    ObliqueContact,
    fitted_law,
    largest_ball_load,
    oblique_contact,
    race_displacement,
)
from models.fe.cache import CacheEntry, FeCache
from models.fe.meshes.geometry import Race
from models.fe.meshes.sizing import MeshRule
from models.path.defect import wrap
from models.words.checks import check_choice, check_numbers, check_whole
from models.words.errors import WrongInputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.bearings.element import Progress
    from models.fe.bearings.law import ElementLaw
    from models.fe.bearings.oblique import ObliqueGeometry

Axial = Literal["free", "held"]
# Meshes are made for these powers, N: each serves loads down to an eighth of its own.
LOAD_STEP = 8.0
# Load of the most loaded ball of all Z of both rows by F / (Z cos alpha): Stribeck's 4.37, and rings that yield.
_LARGEST_SHARE = 1.3 * 4.37
VALID_SHARE = 4.0


@dataclass(frozen=True, eq=False)
class RowInfluence:
    """Normal displacement at an element by a unit force on another one, both rings together, m/N.

    Both rings sit on rigid seats, so that only the angle between the two elements matters. Positive where the
    displacement takes the load off.

    Attributes:
        same: in the same row, at 0, 1, .. spacings, shape (n_elements,); the first is not used.
        other: in the other row, at 0.5, 1.5, .. spacings, shape (n_elements,).
    """

    same: NDArray[np.float64]
    other: NDArray[np.float64]

    @classmethod
    def none(cls, count: int) -> RowInfluence:
        """Return that of rings which are rigid but for their contacts."""
        return cls(np.zeros(count), np.zeros(count))

    def matrix(self) -> NDArray[np.float64]:
        """Return the influence of all elements on each other, row after row, zero on the diagonal."""
        count = len(self.same)
        step = (np.arange(count)[:, None] - np.arange(count)[None, :]) % count
        within = np.where(step == 0, 0.0, self.same[step])
        # Element k of row 1 stands half a spacing after element k of row 0.
        across = self.other[(np.arange(count)[None, :] - np.arange(count)[:, None]) % count]
        return np.block([[within, across], [across.T, within]])


@dataclass(frozen=True, eq=False)
class SelfAligning(PassingElements):
    """Two rows of balls at a contact angle between a spherical outer race and an inner ring, on rigid seats.

    Attributes:
        law: of one ball between both races along its normal.
        n_elements: in each row.
        contact_angle: rad; zero is two radial rows.
        influence: of the balls on each other through the rings.
        clearance: gap along the normals before the ring is displaced, m, not negative.
        axial: whether the inner ring is held along the shaft, as the analytic answer has it, or free: without an axial
            force it then finds its place between the rows.
        contacts_converged: whether all contacts of the law's samples are.
    """

    law: ElementLaw
    n_elements: int
    contact_angle: float
    influence: RowInfluence
    clearance: float = 0.0
    axial: Axial = "held"
    contacts_converged: bool = True

    def __post_init__(self) -> None:
        """Raise a ValueError that names an unusable value."""
        check_whole(self.n_elements, "n_elements", 3)
        check_numbers(self, "", "not negative", "clearance", "contact_angle")
        check_choice(self.axial, "axial", get_args(Axial))
        if len(self.influence.same) != self.n_elements or len(self.influence.other) != self.n_elements:
            raise ValueError(
                f"influence must have {self.n_elements} values in each row, got {len(self.influence.same)} and "
                f"{len(self.influence.other)}"
            )

    def angles(self, cage_angle: float = 0.0) -> NDArray[np.float64]:
        """Return the angles of the elements from the load, rad, row after row, shape (2 n_elements,)."""
        row = np.array([0.0, 0.5])[:, None] + np.arange(self.n_elements)[None, :]
        return np.asarray(cage_angle + self.spacing * row.ravel(), dtype=np.float64)

    def turns(self, points: int) -> NDArray[np.float64]:
        """Return cage angles that lie evenly over one spacing of a row, rad, as sums of one step."""
        return np.asarray(self.spacing / points * np.arange(points), dtype=np.float64)

    def normals(self, cage_angle: float = 0.0) -> NDArray[np.float64]:
        """Return the unit vectors from the bearing's centre to the contacts, shape (2 n_elements, 3)."""
        angles = self.angles(cage_angle)
        radial, axial = math.cos(self.contact_angle), math.sin(self.contact_angle)
        sides = np.repeat([axial, -axial], self.n_elements)
        return np.column_stack((radial * np.cos(angles), radial * np.sin(angles), sides))

    def balance(self, load: float, cage_angle: float = 0.0) -> Balance:
        """Return the equilibrium under a radial load, N; there is no third coordinate where the ring is held axially.

        Raises:
            ValueError: if the load is not positive.
            RuntimeError: if no equilibrium is found.
        """
        if not (math.isfinite(load) and load > 0.0):
            raise ValueError(f"load must be finite and positive, got {load!r} N")
        wanted = np.zeros(3 if self.axial == "free" and self.contact_angle > 0.0 else 2)
        wanted[0] = load
        normals = self.normals(cage_angle)[:, : len(wanted)]
        return settle(normals, self.law, wanted, influence=self.influence.matrix(), clearance=self.clearance)

    def state(self, load: float, *, cage_angle: float = 0.0, start: FeState | None = None) -> FeState:
        """Return the equilibrium under a radial load, N, at a cage angle, rad; a free axial displacement follows.

        Args:
            start: not needed: the iteration finds its own.
        """
        del start
        balance = self.balance(load, cage_angle)
        stiffness = condensed(balance.stiffness, 2) if len(balance.stiffness) == 3 else balance.stiffness
        # The approach of the law's inverse, and the one that the displacements leave: no part of the iteration.
        gap = balance.approach - self.law.approach_of(balance.forces)
        imbalance = balance.residual / load
        share = imbalance if self.contacts_converged else math.inf
        status, contact_error = self.check(balance.forces, balance.approach, gap, share)
        return FeState(
            load=load,
            displacement=balance.displacement[:2],
            stiffness=stiffness,
            bore_line=float(balance.displacement[0]),
            bore_line_stiffness=float(1.0 / np.linalg.inv(stiffness)[0, 0]),
            angles=wrap(self.angles(cage_angle)),
            loads=balance.forces,
            status=status,
            imbalance=imbalance,
            contact_error=contact_error,
            below_law=self.below_law(balance.forces, self.normals(cage_angle)[:, 0]) / load,
            mesh_error=self.law.mesh_error,
        )


@dataclass(frozen=True, eq=False)
class ObliqueResult:
    """A self-aligning bearing from finite elements.

    Attributes:
        bearing: assembled.
        law: of one ball, with its samples.
        unknowns: of each body that was factorised: "inner ball 60 N", "inner ring 60 N" and so on.
        asymmetry: largest of all samples, as of :class:`models.fe.bearings.oblique_bodies.ObliqueContact`; NaN where it
            was not asked for.
    """

    bearing: SelfAligning
    law: BallLaw
    unknowns: Mapping[str, int]
    asymmetry: float


def row_influence(geometry: ObliqueGeometry, inner: ObliqueContact, outer: ObliqueContact) -> RowInfluence:
    """Return what the force of one ball does to the others through both rings on rigid seats."""
    same, other = np.zeros(geometry.n_elements), np.zeros(geometry.n_elements)
    for contact in (inner, outer):
        one = race_displacement(geometry, contact)
        same, other = same + one[0], other + one[1]
    return RowInfluence(same, other)


def oblique_bearing(
    geometry: ObliqueGeometry,
    loads: Sequence[float],
    rule: MeshRule = RULE,
    *,
    clearance: float = 0.0,
    asymmetry: bool = True,
    progress: Progress | None = None,
) -> ObliqueResult:
    """Return the bearing assembled from meshes for given loads of a ball, N, ascending; the law ends at the last.

    Each mesh serves loads down to an eighth of its own; the rings' influence is that of the last.

    Args:
        clearance: gap along the normals before the ring is displaced, m.
        asymmetry: whether it is computed, which takes one more solution of a ring for each sample.
        progress: told before each step what is done, the steps done and their number.

    Raises:
        WrongInputError: as of ``oblique_contact``.
    """
    samples: list[tuple[float, float]] = []
    unknowns: dict[str, int] = {}
    largest, converged, done = 0.0 if asymmetry else math.nan, True, 0
    pair: list[ObliqueContact] = []
    for load in loads:
        pair = []
        approach = np.zeros(len(SHARES))
        for race in get_args(Race):
            if progress is not None:
                progress(f"{race} contact on meshes for {load:g} N", done, 2 * len(loads))
            done += 1
            contact = oblique_contact(geometry, race, load, rule)
            pair.append(contact)
            unknowns |= {
                f"{race} {body} {load:g} N": n for body, n in zip(("ball", "ring"), contact.unknowns, strict=True)
            }
            states = [contact.press(share * load) for share in SHARES]
            approach += [state.approach for state in states]
            if asymmetry:
                largest = max(largest, *(contact.asymmetry(state) for state in states))
            converged = converged and all(state.converged for state in states)
        samples += [(share * load, float(value)) for share, value in zip(SHARES, approach, strict=True)]
    law = fitted_law(*np.array(samples).T)
    influence = row_influence(geometry, pair[0], pair[1])
    bearing = SelfAligning(
        law.law(), geometry.n_elements, geometry.contact_angle, influence, clearance, contacts_converged=converged
    )
    return ObliqueResult(bearing, law, unknowns, largest)


def self_aligning_bearing(
    geometry: ObliqueGeometry,
    load: float,
    *,
    clearance: float = 0.0,
    cache: FeCache | None = None,
    progress: Progress | None = None,
) -> FeBearing:
    """Return a self-aligning ball bearing under a radial load, N, both rings on rigid seats.

    The law ends at the load of a ball whose contact reaches the edge of the inner groove.

    Args:
        clearance: radial clearance, m; along the contact normals it is less by the cosine of their angle.
        cache: where results are kept; nowhere if None.
        progress: told before each step what is done, the steps done and their number.

    Raises:
        WrongInputError: the load is not positive.
        FeError: meshes that fail; the message says why.
    """
    if not (math.isfinite(load) and load > 0.0):
        raise WrongInputError(f"expected a load that is finite and positive, got {load!r} N")
    radial = math.cos(geometry.contact_angle)
    largest = VALID_SHARE * _LARGEST_SHARE * load / (2.0 * geometry.n_elements * radial)
    last = math.ceil(math.log(largest) / math.log(LOAD_STEP) - 1e-9)
    limit = largest_ball_load(geometry)
    loads = (min(LOAD_STEP ** (last - 1), limit / LOAD_STEP), min(LOAD_STEP**last, limit))

    def make() -> CacheEntry:
        found = oblique_bearing(geometry, loads, asymmetry=False, progress=progress)
        law, influence = found.law, found.bearing.influence
        arrays = {"loads": law.loads, "approach": law.approach, "same": influence.same, "other": influence.other}
        fit = {"hertz": law.hertz, "depth": law.depth, "residual": law.residual}
        converged = found.bearing.contacts_converged
        return CacheEntry(arrays, {"law": fit, "unknowns": dict(found.unknowns), "converged": converged})

    key: dict[str, Any] = {
        "kind": "oblique",
        "geometry": asdict(geometry),
        "rule": RULE.key(),
        "loads_newton": list(loads),
    }
    entry = (cache or FeCache(None)).get(key, make)
    rows = SelfAligning(
        BallLaw(entry.arrays["loads"], entry.arrays["approach"], **entry.values["law"]).law(),
        geometry.n_elements,
        geometry.contact_angle,
        RowInfluence(entry.arrays["same"], entry.arrays["other"]),
        clearance * radial,
        contacts_converged=entry.values["converged"],
    )
    return FeBearing(rows, {}, entry.values["unknowns"])
