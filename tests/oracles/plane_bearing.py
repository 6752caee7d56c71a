"""The assembled bearing against one direct solution with all contacts of a bearing on one mesh.

Plane strain of a NU 202 ECP 1 m long with hollow
rollers (a hole of 0.3 of the radius: a mesh of rings alone), one roller under the load, half of it by symmetry. The
direct solution has the rings refined at all loaded rollers, all rollers, and the pressures of all contacts in one
active set: pressures need not be symmetric about a roller, and rollers bend as they like. The assembled bearing has the
law of one roller and the influence of rings with one contact, on other meshes, as ``models.fe.bearings.bearing`` makes
them in space. Compared: loads, displacement, and stiffness along the load by a difference of two direct solutions.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from models.fe.bearings.assembly import AssembledBearing
from models.fe.bearings.law import ElementLaw
from models.fe.bearings.ring_bodies import BalancedBody, bore_traction
from models.fe.bearings.rings import BoreLoad, RingInfluence
from models.fe.solid.condense import ContactCells, ContactFrame, cell_loads, compliance
from models.fe.solid.contact import press_to_force
from models.fe.solid.elastic import ElasticBody
from tests.oracles.plane_rings import Fineness, annulus, depth_lines, lines_about

if TYPE_CHECKING:
    from numpy.typing import NDArray

MODULUS, POISSON = 210e9, 0.3
N_ELEMENTS = 11
BORE, INNER, OUTER, OUTSIDE, ROLLER = 7.5e-3, 9.65e-3, 15.15e-3, 17.5e-3, 2.75e-3
HOLE = 0.3 * ROLLER
PITCH = 2.0 * math.pi / N_ELEMENTS
# Rollers that carry load without clearance: at 0, 32.7 and 65.5 degrees.
LOADED = 3


def half_width(race: str, load: float) -> float:
    """Return Hertz' half width of a roller on a race under a load per length, m."""
    curvature = 1.0 / ROLLER + (1.0 / INNER if race == "inner" else -1.0 / OUTER)
    return math.sqrt(8.0 * load / (math.pi * curvature * MODULUS / (1.0 - POISSON**2)))


def ring(race: str, load: float, centres: NDArray[np.float64], fine: Fineness, *, held: bool = True) -> ElasticBody:
    """Return half a ring with patches at contacts, its back fixed, or held by one node for balanced loads."""
    radius, back = (INNER, BORE) if race == "inner" else (OUTER, OUTSIDE)
    patch = fine.patch * half_width(race, load)
    size = patch / fine.columns
    angles = lines_about(centres, 0.0, math.pi, size / radius, patch / radius, fine)
    mesh = annulus(angles, depth_lines(radius, back, size, fine))
    name = "low" if race == "inner" else "high"
    lonely = int(np.argmin(np.asarray(mesh.doflocs)[1]))
    support: dict[Any, Any] = {name: (0, 1)} if held else {lonely: (1,)}
    if not held:
        mesh = mesh.with_boundaries({"bore": mesh.boundaries["low"]})
    return ElasticBody(mesh, MODULUS, POISSON, {**support, "x0": (0,)})


def roller(load: float, kind: str, fine: Fineness) -> ElasticBody:
    """Return a quarter (both contacts alike), half (x >= 0) or whole hollow roller."""
    patch = fine.patch * half_width("outer", load)
    size = patch / fine.columns
    radii = depth_lines(ROLLER, HOLE, size, fine)
    if kind == "quarter":
        angles = lines_about(np.array([0.0]), 0.0, 0.5 * math.pi, size / ROLLER, patch / ROLLER, fine)
        return ElasticBody(annulus(angles, radii), MODULUS, POISSON, {"x0": (0,), "y0": (1,)})
    half = lines_about(np.array([0.0, math.pi]), 0.0, math.pi, size / ROLLER, patch / ROLLER, fine)
    if kind == "half":
        mesh = annulus(half, radii)
        return ElasticBody(mesh, MODULUS, POISSON, {"x0": (0,), _node(mesh, HOLE, 0.0): (1,)})
    mesh = annulus(np.concatenate((half, math.pi + half[1:])), radii, closed=True)
    # The cage holds the roller along the race; two nodes of the hole hold it against turning.
    return ElasticBody(mesh, MODULUS, POISSON, {_node(mesh, HOLE, 0.0): (0, 1), _node(mesh, -HOLE, 0.0): (1,)})


def _node(mesh: Any, x: float, y: float) -> int:
    return int(np.argmin(np.hypot(np.asarray(mesh.doflocs)[0] - x, np.asarray(mesh.doflocs)[1] - y)))


def frame(angle: float, *, mirrored: bool = False) -> ContactFrame:
    """Return the plane frame of a contact at an angle; mirrored: below the roller, with x as above it."""
    s, c = math.sin(angle), math.cos(angle)
    return ContactFrame(np.zeros(2), np.array([[c, -s], [s, c]]) * ([[1.0], [-1.0]] if mirrored else 1.0))


def edges(body_patch: float, fine: Fineness, *, whole: bool) -> NDArray[np.float64]:
    """Return lines of the cells of a contact, m."""
    lines = np.linspace(0.0, body_patch, fine.columns + 1)
    return np.concatenate((-lines[:0:-1], lines)) if whole else lines


def gap_of(race: str, cells: ContactCells) -> NDArray[np.float64]:
    """Return the mean gap of roller and race over cells, m."""
    points, weights = np.polynomial.legendre.leggauss(4)
    x = cells.x0 + np.multiply.outer(0.5 + 0.5 * points, cells.x1 - cells.x0)
    roller_drop = ROLLER - np.sqrt(ROLLER**2 - x**2)
    rise = INNER - np.sqrt(INNER**2 - x**2) if race == "inner" else -(OUTER - np.sqrt(OUTER**2 - x**2))
    return 0.5 * weights @ (roller_drop + rise)


def cells_of(race: str, load: float, fine: Fineness, *, whole: bool = False) -> ContactCells:
    """Return the pressure cells of a contact."""
    return ContactCells.about_nodes(edges(fine.patch * half_width(race, load), fine, whole=whole))


@dataclass(frozen=True)
class Direct:
    """Solution with all contacts: loads on the rollers, N/m, displacement and that of the bore's line, m."""

    loads: NDArray[np.float64]
    displacement: float
    bore_line: float
    exchanges: int
    unknowns: int


class DirectBearing:
    """All bodies and contacts of half a bearing, condensed to the pressures of all cells at once."""

    def __init__(self, load: float, fine: Fineness, *, sinusoidal: bool) -> None:
        """Make bodies with meshes for a load on the most loaded roller, N/m."""
        self.places: NDArray[np.float64] = np.linspace(0.0, (LOADED - 1) * PITCH, LOADED)
        self.rings = {
            "inner": ring("inner", load, self.places, fine, held=not sinusoidal),
            "outer": ring("outer", load, self.places, fine),
        }
        whole = roller(load, "whole", fine)
        rollers = [roller(load, "half", fine)] + [whole] * (LOADED - 1)
        self.unknowns = sum(body.unknowns for body in (*self.rings.values(), *rollers))
        cells = {race: [cells_of(race, load, fine, whole=k > 0) for k in range(LOADED)] for race in self.rings}
        self.area = np.concatenate([c.area for race in self.rings for c in cells[race]])
        self.centre = np.concatenate([c.centre[0] for race in self.rings for c in cells[race]])
        self.gap = np.concatenate([gap_of(race, c) for race in self.rings for c in cells[race]])
        counts = {race: [len(c) for c in cells[race]] for race in self.rings}
        half = sum(counts["inner"])
        self.compliance = np.zeros((len(self.area), len(self.area)))
        self.motion = np.zeros((len(self.area), 1 + LOADED))
        self.inner_loads = _columns(self.rings["inner"], "high", cells["inner"], self.places)
        outer_loads = _columns(self.rings["outer"], "low", cells["outer"], self.places)
        self.compliance[:half, :half] = self.rings["inner"].flexibility(self.inner_loads)
        self.compliance[half:, half:] = self.rings["outer"].flexibility(outer_loads)
        first = {"inner": 0, "outer": half}
        for k, body in enumerate(rollers):
            sides = [cell_loads(body, "high", cells[race][k], frame(0.0, mirrored=race == "inner")) for race in cells]
            places = [np.arange(first[race], first[race] + counts[race][k]) for race in cells]
            both = np.concatenate(places)
            self.compliance[np.ix_(both, both)] += body.flexibility(_stacked(sides))
            self.motion[places[0], 0] = self.area[places[0]] * math.cos(self.places[k])
            self.motion[places[0], 1 + k], self.motion[places[1], 1 + k] = -self.area[places[0]], self.area[places[1]]
            first = {race: first[race] + counts[race][k] for race in first}
        self.halves = np.repeat(np.arange(2 * LOADED), [n for race in counts for n in counts[race]])
        self.balanced = BalancedBody.ring(self.rings["inner"]) if sinusoidal else None

    def solve(self, load: float) -> Direct:
        """Return the equilibrium under a load on the bearing, N/m."""
        bore = np.zeros(self.rings["inner"].nodes.size)
        if self.balanced is not None:
            pressure = bore_traction(self.rings["inner"], np.cos, math.pi)
            bore = pressure * (0.5 * load / float(pressure @ self.balanced.shift))
        yielded = np.zeros(len(self.area))
        moved = self.rings["inner"].solve(bore) if self.balanced is not None else bore
        yielded[: self.inner_loads.shape[1]] = self.inner_loads.T @ moved
        right = np.zeros(1 + LOADED)
        right[0] = 0.5 * load
        pressure, motion, exchanges = _active_set(
            self.compliance, self.motion, self.area * self.gap + yielded, right, self.start(load)
        )
        forces: NDArray[np.float64] = np.asarray(np.bincount(self.halves, self.area * pressure)[:LOADED], float)
        forces[0] *= 2.0
        field = self.rings["inner"].solve(self.inner_loads @ pressure[: self.inner_loads.shape[1]]) + moved
        line = displacement = float(motion[0])
        if self.balanced is not None:
            cosine = self.balanced.cosine
            displacement += float(cosine @ field) / float(cosine @ self.balanced.shift)
            line += float(field[2 * _node(self.rings["inner"].mesh, 0.0, BORE) + 1])
        return Direct(forces, displacement, line, exchanges, self.unknowns)

    def start(self, load: float) -> NDArray[np.bool_]:
        """Return the cells within Hertz' half width at the loads of rigid rings."""
        share = np.cos(self.places) ** (10.0 / 9.0)
        loads = load * share / float(2.0 * share @ np.cos(self.places) - 1.0)
        widths = [half_width(race, float(one)) for race in self.rings for one in loads]
        return np.abs(self.centre) < np.array(widths)[self.halves]


def _columns(body: ElasticBody, surface: str, cells: list[ContactCells], places: NDArray[np.float64]) -> Any:
    pairs = zip(cells, places, strict=True)
    return _stacked([cell_loads(body, surface, c, frame(float(angle))) for c, angle in pairs])


def _stacked(columns: list[Any]) -> Any:
    from scipy.sparse import hstack

    return hstack(columns).tocsc()


def _active_set(
    compliance: NDArray[np.float64],
    motion: NDArray[np.float64],
    gap: NDArray[np.float64],
    right: NDArray[np.float64],
    active: NDArray[np.bool_],
) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """Return p, r and exchanges of C p - D r + g = w, p >= 0, w >= 0, p w = 0, D' p = f (all contacts at once)."""
    # In units in which all entries are about one: pivoting would else lose the compliance beside the areas.
    yields, area = float(np.mean(np.diag(compliance))), float(np.abs(motion).max())
    matrix, sides = compliance / yields, motion / area
    for exchange in range(1, 200):
        held = np.nonzero(active)[0]
        size = len(held) + motion.shape[1]
        block, known = np.zeros((size, size)), np.zeros(size)
        block[: len(held), : len(held)] = matrix[np.ix_(held, held)]
        block[: len(held), len(held) :], block[len(held) :, : len(held)] = -sides[held], -sides[held].T
        known[: len(held)], known[len(held) :] = -gap[held] / yields, -right / area
        solution = np.asarray(np.linalg.solve(block, known), float)
        pressure = np.zeros(len(gap))
        pressure[held], rigid = solution[: len(held)], solution[len(held) :]
        opening = matrix @ pressure - sides @ rigid + gap / yields
        opening[held] = 0.0
        after = pressure - opening > 0.0
        if np.array_equal(after, active):
            return pressure, rigid * yields / area, exchange
        active = after
    raise RuntimeError("the active set of all contacts did not settle")


def assembled(load: float, fine: Fineness, *, sinusoidal: bool) -> AssembledBearing:
    """Return the bearing of the law of one roller and rings with one contact, for a load on that, N/m."""
    centre = np.array([0.0])
    law_loads = load * np.geomspace(0.05, 1.3, 10)
    approach = np.zeros(len(law_loads))
    element = roller(load, "quarter", fine)
    held: dict[str, ElasticBody] = {race: ring(race, load, centre, fine) for race in ("inner", "outer")}
    influence: dict[str, RingInfluence] = {}
    angles = np.linspace(0.7 * PITCH, math.pi, 60)
    for race, body in held.items():
        surface, cells = "high" if race == "inner" else "low", cells_of(race, load, fine)
        together = compliance(body, surface, cells) + compliance(element, "high", cells)
        gap, state = gap_of(race, cells), None
        for i, force in enumerate(law_loads):
            state = press_to_force(together, gap, cells.area, 0.5 * float(force), start=state)
            approach[i] += state.approach
        unit = _hertz(body, surface, cells, half_width(race, load))
        readers = _readers(body, surface, angles, fine.patch * half_width(race, load))
        influence[race] = RingInfluence(angles, readers.T @ body.solve(unit))
    # Between its loads, not fitted: compared is how bodies are put together.
    law = ElementLaw(law_loads, approach)
    if not sinusoidal:
        return AssembledBearing(law, N_ELEMENTS, 0.0, influence["inner"], influence["outer"])
    cells = cells_of("inner", load, fine)
    free = BalancedBody.ring(ring("inner", load, centre, fine, held=False))
    unit = _hertz(free.body, "high", cells, half_width("inner", load))
    readers = _readers(free.body, "high", angles, fine.patch * half_width("inner", load))
    under = free.solve(unit)
    own = 2.0 * float(unit @ (under - held["inner"].solve(unit)))
    pressure = bore_traction(free.body, np.cos, math.pi)
    loaded = free.solve(pressure / (2.0 * float(pressure @ free.shift)))
    around = np.concatenate(([0.0], angles))
    race = np.concatenate(([2.0 * float(unit @ loaded)], readers.T @ loaded))
    line = _readers(free.body, "low", around, 0.01 * BORE)
    bore = BoreLoad(around, race, float(line[:, 0] @ loaded), line.T @ under)
    inner = RingInfluence(angles, readers.T @ under, own, "sinusoidal")
    return AssembledBearing(law, N_ELEMENTS, 0.0, inner, influence["outer"], bore)


def _hertz(body: ElasticBody, surface: str, cells: ContactCells, width: float) -> NDArray[np.float64]:
    """Return the load of one newton a metre on a roller, half of it on half a ring."""
    pressure = np.sqrt(np.maximum(1.0 - (cells.centre[0] / width) ** 2, 0.0))
    return cell_loads(body, surface, cells, frame(0.0)) @ (0.5 * pressure / float(pressure @ cells.area))


def _readers(body: ElasticBody, surface: str, angles: NDArray[np.float64], width: float) -> NDArray[np.float64]:
    columns: list[NDArray[np.float64]] = []
    for angle in angles:
        lines = [-width, 0.0, width]
        cells = ContactCells.grid(
            np.array(lines[1:] if angle < 1e-9 else lines[:2] if angle > math.pi - 1e-9 else lines)
        )
        share = np.full(len(cells), 1.0 / float(np.sum(cells.area)))
        columns.append(cell_loads(body, surface, cells, frame(float(angle))) @ share)
    return np.stack(columns, axis=1)


def compared(load: float, fine: Fineness, *, sinusoidal: bool) -> list[dict[str, Any]]:
    """Return loads, displacement and stiffness of both solutions under a load on the bearing, N/m."""
    largest = 0.375 * load
    begin = time.perf_counter()
    direct = DirectBearing(largest, fine, sinusoidal=sinusoidal)
    middle, step = direct.solve(load), 0.05 * load
    low, high = direct.solve(load - step), direct.solve(load + step)
    seconds = time.perf_counter() - begin
    bearing = assembled(largest, fine, sinusoidal=sinusoidal)
    state = bearing.state(load)
    assert state.converged
    support = "sinusoidal" if sinusoidal else "rigid shaft"
    pairs = [
        *((f"share of roller {k}", float(middle.loads[k]) / load, float(state.loads[k]) / load) for k in range(LOADED)),
        ("displacement, um", 1e6 * middle.displacement, 1e6 * float(state.displacement[0])),
        ("displacement of the bore's line, um", 1e6 * middle.bore_line, 1e6 * state.bore_line),
        (
            "stiffness, GN/m a metre",
            2e-9 * step / (high.displacement - low.displacement),
            1e-9 * float(state.stiffness[0, 0]),
        ),
        (
            "stiffness of the bore's line, GN/m a metre",
            2e-9 * step / (high.bore_line - low.bore_line),
            1e-9 * state.bore_line_stiffness,
        ),
    ]
    return [
        {
            "support": support,
            "quantity": name,
            "direct": one,
            "assembled": other,
            "difference_percent": 100.0 * (other / one - 1.0),
            "direct_unknowns": middle.unknowns,
            "direct_seconds": seconds,
        }
        for name, one, other in pairs
    ]
