"""A self-aligning ball bearing as the others are asked: states, passage of the elements, stiffness against the load.

Both rows stand at a contact angle. See ``models.fe.bearings.oblique``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from models.fe.bearings.assembled import CONTACT_TOLERANCE, EQUILIBRIUM_TOLERANCE, FePassage, FeState, FeStatus
from models.fe.bearings.balance import condensed
from models.fe.bearings.oblique import Axial, ObliqueBearing, RowInfluence
from models.fe.bearings.oblique_bodies import RULE, BallLaw, largest_ball_load, oblique_bearing
from models.fe.cache import FeCache, Kept
from models.path.defect import wrap
from models.words.errors import WrongInputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.bearings.element import FeContact, Progress
    from models.fe.bearings.law import ElementLaw
    from models.fe.bearings.oblique import ObliqueGeometry
    from models.fe.meshes.geometry import Race

# Meshes are made for these powers, N: each serves loads down to an eighth of its own.
LOAD_STEP = 8.0
# Load of the most loaded ball of all Z of both rows by F / (Z cos alpha): Stribeck's 4.37, and rings that yield.
_LARGEST_SHARE = 1.3 * 4.37
VALID_SHARE = 4.0


@dataclass(frozen=True, eq=False)
class SelfAligning:
    """Two rows between a spherical outer race and an inner ring on rigid seats.

    Attributes:
        axial: whether the inner ring is held along the shaft, as the analytic answer has it, or free.
        oblique: the assembled rows.
        law: of one ball between both races; its mesh error is the largest difference of its samples.
        contacts_converged: whether all contacts of its samples are.
    """

    oblique: ObliqueBearing
    law: ElementLaw
    contacts_converged: bool
    axial: Axial = "held"

    def state(self, load: float, *, cage_angle: float = 0.0) -> FeState:
        """Return the equilibrium under a radial load, N, at a cage angle, rad."""
        balance = self.oblique.state(load, cage_angle=cage_angle, axial=self.axial)
        stiffness = condensed(balance.stiffness, 2) if len(balance.stiffness) == 3 else balance.stiffness
        # The approach of the law's inverse, and the one that the displacements leave: no part of the iteration.
        gap = balance.approach - self.law.approach_of(balance.forces)
        wrong = np.where(balance.forces > 0.0, np.abs(gap), np.maximum(gap, 0.0))
        imbalance, contact_error = balance.residual / load, float(wrong.max())
        status: FeStatus = "converged"
        if not self.law.covers(float(balance.forces.max())):
            status = "outside_law"
        elif not (imbalance <= EQUILIBRIUM_TOLERANCE and self.contacts_converged):
            status = "not_in_equilibrium"
        elif not contact_error <= CONTACT_TOLERANCE * float(np.abs(balance.approach).max()):
            status = "contact_violated"
        weak = np.where(balance.forces < self.law.lowest, balance.forces, 0.0)
        along = self.oblique.normals(cage_angle)[:, 0]
        return FeState(
            load=load,
            displacement=balance.displacement[:2],
            stiffness=stiffness,
            bore_line=float(balance.displacement[0]),
            bore_line_stiffness=float(1.0 / np.linalg.inv(stiffness)[0, 0]),
            angles=wrap(self.oblique.angles(cage_angle)),
            loads=balance.forces,
            status=status,
            imbalance=imbalance,
            contact_error=contact_error,
            below_law=float(along @ weak) / load,
            mesh_error=self.law.mesh_error,
        )

    def stiffness_over_passage(self, load: float, *, points: int = 96) -> FePassage:
        """Return the stiffness while the cage turns by one spacing of a row; NaN where a state is not converged."""
        turns = np.asarray(self.oblique.spacing / points * np.arange(points), dtype=np.float64)
        states = tuple(self.state(load, cage_angle=float(turn)) for turn in turns)
        matrix = [state.stiffness if state.converged else np.full((2, 2), math.nan) for state in states]
        return FePassage(turns, np.array(matrix), states)

    def stiffness_against_load(
        self, loads: Sequence[float], *, points: int = 64
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return displacement along the load, m, (loads,), and stiffness, N/m, (loads, 2, 2): means over a passage."""
        passages = [self.stiffness_over_passage(load, points=points) for load in loads]
        displacement = [
            float(np.mean([state.displacement[0] if state.converged else math.nan for state in passage.states]))
            for passage in passages
        ]
        return np.array(displacement), np.array([passage.mean for passage in passages])


@dataclass(frozen=True, eq=False)
class SelfAligningBearing:
    """The bearing with what it was made of, as ``models.fe.bearings.bearing.FeBearing``; its contacts are not kept."""

    assembled: SelfAligning
    load: float
    unknowns: Mapping[str, int]
    contacts: Mapping[Race, FeContact] = field(default_factory=dict["Race", "FeContact"])


def self_aligning_bearing(
    geometry: ObliqueGeometry,
    load: float,
    *,
    clearance: float = 0.0,
    cache: FeCache | None = None,
    progress: Progress | None = None,
) -> SelfAligningBearing:
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
    done = 0

    def step(what: str) -> None:
        nonlocal done
        if progress is not None:
            progress(what, done, 2 * len(loads))
        done += 1

    def make() -> Kept:
        found = oblique_bearing(geometry, loads, progress=step)
        law, influence = found.law, found.bearing.influence
        arrays = {"loads": law.loads, "approach": law.approach, "same": influence.same, "other": influence.other}
        numbers = {"hertz": law.hertz, "depth": law.depth, "residual": law.residual}
        return Kept(arrays, {"law": numbers, "unknowns": dict(found.unknowns), "converged": found.converged})

    key: dict[str, Any] = {"kind": "oblique", "geometry": asdict(geometry), "rule": asdict(RULE), "loads_newton": loads}
    entry = (cache or FeCache(None)).get(key, make)
    law = BallLaw(entry.arrays["loads"], entry.arrays["approach"], **entry.values["law"]).law()
    influence = RowInfluence(entry.arrays["same"], entry.arrays["other"])
    rows = ObliqueBearing(geometry.n_elements, geometry.contact_angle, law, influence, clearance * radial)
    return SelfAligningBearing(SelfAligning(rows, law, entry.values["converged"]), load, entry.values["unknowns"])
