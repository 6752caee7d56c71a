"""A rolling element pressed between a sector of the inner ring and one of the outer: section 3.3 of the thesis.

A quarter of the element (x >= 0, z >= 0) touches half a sector of both rings. The bore of the inner one carries a
sinusoidal pressure along y, the outside of the outer one is fixed, the radial cuts are free. Loads in equilibrium alone
hold element and inner sector: each is supported at one node, whose reaction is zero, and moves as a whole besides. The
bodies are condensed to their contacts, which are coupled through the element; their elements may be of any kind. Where
hexahedra serve, ``models.fe.submodel.sector`` does the same with an eighth of the element at each contact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from models.fe.solid.condense import ContactFrame, cell_loads
from models.fe.solid.contact import ContactState, press_to_force
from models.fe.solid.shape import boundary_facets
from models.fe.solid.traction import boundary_points, traction_loads

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.solid.condense import ContactCells, Slope
    from models.fe.solid.elastic import ElasticBody

# How the pressure on the bore falls off with the angle from the load: its cosine, or a cosine that is zero at the cut.
BoreSpread = Literal["cosine", "sector"]

# A quarter of the element carries a quarter of the force.
SHARE = 0.25
# Largest change of the approach between rounds, as a share of it, and rounds at most.
COUPLING_TOLERANCE = 1e-9
MAX_ROUNDS = 50
# Share of the diagonal that is added to it: where cells are finer than the facets, their compliance is singular. It
# moves the approach by 1e-5 of itself.
FOUNDATION = 1e-3


@dataclass(frozen=True)
class GappedCells:
    """Cells of one contact in the quarter x >= 0, z >= 0.

    Attributes:
        gap: mean over each cell, along y, m, shape (cells,).
        slopes: of the common surface in the frames of element and race, from ``common_slopes``; by default flat.
    """

    cells: ContactCells
    gap: NDArray[np.float64]
    slopes: tuple[Slope, Slope] | None = None

    def loads(self, body: ElasticBody, surface: str, frame: ContactFrame | None = None) -> Any:
        """Return ``cell_loads`` on the element (a surface of its own name) or a race ("race")."""
        slope = None if self.slopes is None else self.slopes[1 if surface == "race" else 0]
        return cell_loads(body, surface, self.cells, frame, slope)


@dataclass(frozen=True)
class TwoContactState:
    """The sub-model under a force.

    Attributes:
        force: on the whole element, N.
        approach: mean displacement along y of the bore's line on the plane of the load, m.
        inner, outer: contacts of the quarter; the force of each is a quarter of ``force``.
        rounds: of the coupling through the element.
        converged: whether both contacts and the coupling are within their tolerances.
    """

    force: float
    approach: float
    inner: ContactState
    outer: ContactState
    rounds: int
    converged: bool

    def contact_stiffness(self, exponent: float) -> float:
        """Return k_c of ``force = k_c approach^exponent``, N/m^exponent (Eq. 14)."""
        return self.force / self.approach**exponent


class TwoContacts:
    """The condensed sub-model: bodies are factorised once, each force then takes milliseconds.

    Args:
        element: with the boundaries ``contact_inner`` (y < 0) and ``contact_outer``, supported on x = 0 and z = 0 and
            at one node along y.
        inner: sector with the boundaries ``race``, ``bore`` and ``x0``, supported likewise.
        outer: sector with the boundary ``race``, held at its outside.
        contacts: cells of the inner and the outer contact.
        spread: of the pressure on the bore.

    Raises:
        FeError: cells reach beyond a surface.
    """

    def __init__(
        self,
        element: ElasticBody,
        inner: ElasticBody,
        outer: ElasticBody,
        contacts: tuple[GappedCells, GappedCells],
        *,
        spread: BoreSpread = "cosine",
    ) -> None:
        """Factorise and condense the bodies."""
        self.contacts = contacts
        below = ContactFrame(np.zeros(3), np.diag([1.0, -1.0, 1.0]))
        cells = [contact.cells for contact in contacts]
        on_element = (
            contacts[0].loads(element, "contact_inner", below),
            contacts[1].loads(element, "contact_outer"),
        )
        c = element.flexibility(_dense(*on_element))
        on_inner = (contacts[0].loads(inner, "race"), bore_pressure(inner, spread), bore_reader(inner))
        ring = inner.flexibility(_dense(*on_inner))
        n = len(cells[0])
        self._cross = c[:n, n:]
        self._inner = _on_foundation(c[:n, :n] + ring[:n, :n], cells[0].area)
        on_outer = c[n:, n:] + outer.flexibility(contacts[1].loads(outer, "race"))
        self._outer = _on_foundation(on_outer, cells[1].area)
        # Per newton on the quarter of the bore: yield of the race, m^3, and displacement of the bore's line, m.
        self._race_under_bore, self._line_under_bore = ring[:n, n], float(ring[n + 1, n])
        self._line_under_cells = ring[n + 1, :n]

    def solve(self, force: float) -> TwoContactState:
        """Return the state under a force on the whole element, N.

        Raises:
            FeError: the force is not positive.
        """
        quarter = SHARE * force
        inner, outer = self.contacts
        inner_state = outer_state = None
        on_outer = np.zeros(len(outer.cells))
        total = 0.0
        for rounds in range(1, MAX_ROUNDS + 1):
            gap = inner.gap + (self._cross @ on_outer + quarter * self._race_under_bore) / inner.cells.area
            inner_state = press_to_force(self._inner, gap, inner.cells.area, quarter, start=inner_state)
            gap = outer.gap + inner_state.pressure @ self._cross / outer.cells.area
            outer_state = press_to_force(self._outer, gap, outer.cells.area, quarter, start=outer_state)
            on_outer = outer_state.pressure
            before, total = total, inner_state.approach + outer_state.approach
            settled = abs(total - before) <= COUPLING_TOLERANCE * abs(total)
            if settled or rounds == MAX_ROUNDS:
                line = quarter * self._line_under_bore + float(self._line_under_cells @ inner_state.pressure)
                converged = settled and inner_state.converged and outer_state.converged
                return TwoContactState(force, total + line, inner_state, outer_state, rounds, converged)
        raise AssertionError("unreachable")


def bore_pressure(inner: ElasticBody, spread: BoreSpread = "cosine") -> NDArray[np.float64]:
    """Return the loads, N, shape (3 * nodes, 1), of an outward pressure on the boundary "bore", in all 1 N along y."""
    points = boundary_points(inner, "bore")
    corners = np.asarray(inner.mesh.p, np.float64)[
        :, np.unique(inner.mesh.facets[:, boundary_facets(inner.mesh, "bore")])
    ]
    slower = 1.0 if spread == "cosine" else 0.5 * np.pi / float(np.max(np.arctan2(corners[0], corners[1])))
    pressure = np.cos(slower * np.arctan2(points.places[0], points.places[1]))
    loads = traction_loads(inner, points, -pressure * points.normals)
    return (loads / loads[1::3].sum()).reshape(-1, 1)


def bore_reader(inner: ElasticBody) -> NDArray[np.float64]:
    """Return the weights, (3 * nodes, 1), of the mean displacement along y of the bore's line on x = 0.

    Each node counts with its share of the line: the plain mean of the nodes, as in the thesis, moves by 2 % of the
    whole approach with their density, which falls away from the contact.
    """
    on = [
        np.asarray(inner.dofs.get_facet_dofs(boundary_facets(inner.mesh, name)).flatten(), np.int64)
        for name in ("bore", "x0")
    ]
    nodes = np.unique(on[0][np.isin(on[0], on[1])])
    nodes = nodes[np.argsort(inner.nodes[2, nodes])]
    gaps = np.diff(inner.nodes[2, nodes], prepend=inner.nodes[2, nodes[0]], append=inner.nodes[2, nodes[-1]])
    reader = np.zeros((inner.nodes.size, 1))
    reader[inner.dim * nodes + 1, 0] = (gaps[1:] + gaps[:-1]) / (2.0 * gaps.sum())
    return reader


def nearest_node(nodes: NDArray[np.float64], place: tuple[float, float, float]) -> int:
    """Return the index of the node of (3, nodes) nearest to a place, m."""
    return int(np.argmin(np.sum((nodes - np.asarray(place)[:, None]) ** 2, axis=0)))


def _on_foundation(compliance: NDArray[np.float64], area: NDArray[np.float64]) -> NDArray[np.float64]:
    """Add a share of each cell's own compliance, m^3/Pa, measured by pairs of opposite forces.

    So taken it does not depend on the node at which a body is supported, which drops out of every equilibrium.
    """
    per_force = compliance / np.outer(area, area)
    own = np.diag(per_force)
    pairs = own[:, None] + own[None, :] - 2.0 * per_force
    return compliance + FOUNDATION * np.diag(0.5 * pairs.max(axis=1) * area**2)


def _dense(*columns: Any) -> NDArray[np.float64]:
    return np.hstack([c.toarray() if hasattr(c, "toarray") else c for c in columns])
