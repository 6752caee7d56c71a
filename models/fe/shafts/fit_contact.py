"""How a shaft lies in the bore of an inner ring under the forces of the elements: pressures that do not pull.

Ring, shaft and outer ring come as matrices; the elements stand symmetrically about the load, so that one side stands
for both (``models.fe.shafts.solid_shaft`` makes them).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from models.fe.bearings.balance import Balance, settle

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.bearings.assembly import AssembledBearing

Fit = Literal["touching", "held", "sinusoidal"]
"""The shaft may part from the bore; or holds it where it would; or a pressure cos(angle) stands for it (Fig. 21)."""
_TOLERANCE = 1e-9
_EXCHANGES = 200


@dataclass(frozen=True, eq=False)
class FitProblem:
    """What is to be solved; P points of the bore, Z elements of one side.

    Attributes:
        many: elements that stand for each: 2, and 1 on the plane of the load, shape (Z,).
        cosine: of the angle of each point from the load, shape (P,).
        resultant: force along y of a unit pressure at each point on a quarter of the bore, m2, shape (P,).
        bodies: by how much ring and shaft make room at the points, weighted, by unit pressures, m3/Pa, (P, P).
        bore_by_elements, elements_by_bore: the same by unit forces on elements, (P, Z); inwards yield of the race under
            elements by unit pressures, m/Pa, (Z, P).
        elements: inwards yield of both races under elements by unit forces, beyond the element law, m/N, (Z, Z).
        centre: room that a newton at the shaft's centre takes, m3/N, (P,).
        line: shift of the bore's line on the plane of the load by unit pressures and by unit forces.
    """

    bearing: AssembledBearing
    load: float
    angles: NDArray[np.float64]
    many: NDArray[np.float64]
    cosine: NDArray[np.float64]
    resultant: NDArray[np.float64]
    bodies: NDArray[np.float64]
    bore_by_elements: NDArray[np.float64]
    elements_by_bore: NDArray[np.float64]
    elements: NDArray[np.float64]
    centre: NDArray[np.float64]
    line: tuple[NDArray[np.float64], NDArray[np.float64]]

    def fitted(self, active: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return pressures and the shaft's shift against the ring over the forces, with the bore closed where active.

        Both (P + 1,) without forces on elements, and (P + 1, Z) by each of them; linear between.
        """
        on = np.nonzero(active)[0]
        count = len(on)
        matrix = np.zeros((count + 1, count + 1))
        unit = float(np.abs(self.bodies).max()) / float(np.abs(self.resultant).max())
        matrix[:count, :count] = self.bodies[np.ix_(on, on)]
        matrix[:count, count] = -unit * self.resultant[on]
        matrix[count, :count] = unit * 4.0 * self.resultant[on]
        right = np.zeros((count + 1, 1 + len(self.many)))
        right[:count, 0] = self.load * self.centre[on]
        right[:count, 1:] = -self.bore_by_elements[on]
        right[count, 0] = unit * self.load
        found = np.linalg.solve(matrix, right)
        whole = np.zeros((len(active) + 1, right.shape[1]))
        whole[on], whole[-1] = found[:count], unit * found[count]
        return whole[:, 0], whole[:, 1:]

    def given(self, pressure: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return what ``fitted`` does for a pressure of a given shape that carries the load, shape (P,)."""
        alone = np.append(pressure * (self.load / (4.0 * float(self.resultant @ pressure))), 0.0)
        return alone, np.zeros((len(alone), len(self.many)))

    def room(self, pressure: NDArray[np.float64], shift: float, forces: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far shaft and bore are apart at the points, weighted, m3, shape (P,)."""
        taken = self.load * self.centre + shift * self.resultant
        return self.bodies @ pressure + self.bore_by_elements @ forces - taken


@dataclass(frozen=True, eq=False)
class FitFound:
    """Pressures, Pa, (P,), forces on elements, N, (Z,), their balance, exchanges of the active set, and its end."""

    pressure: NDArray[np.float64]
    forces: NDArray[np.float64]
    balance: Balance
    exchanges: int
    settled: bool


def settle_fit(problem: FitProblem, fit: Fit = "touching") -> FitFound:
    """Return the state in which no pressure pulls and nothing overlaps, by exchange of the closed points."""
    if fit == "sinusoidal":
        fixed = problem.given(np.maximum(problem.cosine, 0.0))
        pressure, _, forces, balance = _balanced(problem, *fixed)
        return FitFound(pressure, forces, balance, 0, True)
    active = np.ones(len(problem.resultant), dtype=bool) if fit == "held" else problem.resultant > 0.0
    exchanges = 0
    while True:
        pressure, shift, forces, balance = _balanced(problem, *problem.fitted(active))
        room = problem.room(pressure, shift, forces)
        pulls = active & (pressure < -_TOLERANCE * float(np.abs(pressure).max()))
        overlaps = ~active & (room < -_TOLERANCE * float(np.abs(problem.load * problem.centre).max()))
        settled = fit == "held" or not (pulls.any() or overlaps.any())
        if settled or exchanges == _EXCHANGES:
            return FitFound(pressure, forces, balance, exchanges, settled)
        active = (active & ~pulls) | overlaps
        exchanges += 1


def _balanced(
    problem: FitProblem, alone: NDArray[np.float64], by_forces: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float, NDArray[np.float64], Balance]:
    """Return pressures, shift of the shaft, forces on elements and their balance.

    Pressures and shift are those of ``FitProblem.fitted``: without forces, and by each of them.
    """
    influence = problem.elements + problem.elements_by_bore @ by_forces[:-1]
    # Each pair of elements has one row and two columns.
    pairs = np.repeat(np.arange(len(problem.many)), problem.many.astype(int))
    balance = settle(
        np.cos(problem.angles[pairs])[:, None],
        problem.bearing.law,
        np.array([problem.load]),
        influence=(influence / problem.many)[np.ix_(pairs, pairs)],
        clearance=problem.bearing.clearance + (problem.elements_by_bore @ alone[:-1])[pairs],
    )
    forces = balance.forces[np.searchsorted(pairs, np.arange(len(problem.many)))]
    state = alone + by_forces @ forces
    return state[:-1], float(state[-1]), forces, balance
