"""The inner ring cut at 90 degrees from the load, as in the thesis' model (section 3.4.2), against the whole ring.

Used by ``benchmarks.fe_bearing``. The thesis removes the unloaded halves of the rings; an inner ring whose ends are
free bends otherwise under a pressure on its bore. The outer ring is fixed at its outside, so that the cut matters
little there and is not modelled. The load is along the middle of the ring, the elements stand symmetrically about it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from models.fe.bearings.assembled import AssembledBearing
from models.fe.bearings.ring_bodies import INFLUENCE_RULE, BalancedBody, bore_traction, influence_load
from models.fe.bearings.rings import RingInfluence
from models.fe.meshes.ring_mesh import ring_mesh
from models.fe.meshes.sizing import contact_grid
from models.fe.solid.condense import ContactCells, ContactFrame, cell_loads
from models.fe.solid.elastic import ElasticBody

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.meshes.geometry import FeGeometry

_STEP = 0.01


@dataclass(frozen=True, eq=False)
class CutRing:
    """What half a ring with free ends moves beyond one that is held at its bore.

    Attributes:
        angles: of the elements on one side, from the load, rad, shape (n,).
        change: of the race at each under a newton on each (and its mirror image), m/N, shape (n, n).
        line: how far the bore on the plane of the load moves along it under these, m/N, shape (n,).
        race: how far the race moves inwards under a newton of load on the bore, m/N, shape (n,).
        line_at_load: how far the bore on the plane of the load does, m/N.
    """

    angles: NDArray[np.float64]
    change: NDArray[np.float64]
    line: NDArray[np.float64]
    race: NDArray[np.float64]
    line_at_load: float


@dataclass(frozen=True, eq=False)
class _Bent(RingInfluence):
    bent: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))

    def matrix(self, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        return super().matrix(angles) + self.bent


def cut_ring(geometry: FeGeometry, angles: NDArray[np.float64], extent: float = math.pi) -> CutRing:
    """Return the cut inner ring for elements at angles from 0 to below 90 degrees, and a pressure over an extent."""
    grid = contact_grid(geometry, "inner", influence_load(geometry), INFLUENCE_RULE)
    mesh = ring_mesh(geometry, "inner", grid, INFLUENCE_RULE, angle=0.5 * math.pi)
    supports = {"x0": (0,), "z0": (2,)}
    held = ElasticBody(mesh, geometry.modulus, geometry.poisson, {"bore": (0, 1, 2), **supports})
    lonely = int(np.argmin(np.abs(np.asarray(mesh.doflocs)[1])))
    free = BalancedBody.ring(ElasticBody(mesh, geometry.modulus, geometry.poisson, {lonely: (1,), **supports}))
    width = float(grid.x[-1])
    readers = np.stack([_reader(held, float(angle), width, grid.z) for angle in angles], axis=1)
    # A quarter of the ring carries a quarter of a force on the plane of the load, half of one beside it.
    loads = readers * np.where(angles < 1e-9, 0.25, 0.5)
    bent = np.stack([free.solve(load) for load in loads.T], axis=1)
    strip = ContactCells.grid(np.array([0.0, 0.01 * geometry.bore_radius]), np.array([0.0, 0.5 * geometry.width]))
    line = cell_loads(held, "bore", strip, ContactFrame.rotated(0.0)) @ np.full(1, 1.0 / float(strip.area[0]))
    pressure = bore_traction(free.body, lambda angle: np.maximum(np.cos(np.pi / extent * angle), 0.0), extent)
    pressed = free.solve(pressure / (4.0 * float(pressure @ free.shift)))
    change = readers.T @ (bent - held.solve(loads))
    return CutRing(angles, change, line @ bent, readers.T @ pressed, float(line @ pressed))


@cache
def _kept(geometry: FeGeometry, angles: tuple[float, ...], extent: float) -> CutRing:
    return cut_ring(geometry, np.array(angles), extent)


def _reader(body: ElasticBody, angle: float, width: float, lines: NDArray[np.float64]) -> NDArray[np.float64]:
    here = angle < 1e-9
    cells = ContactCells.grid(np.array([0.0, width] if here else [-width, 0.0, width]), lines)
    share = np.full(len(cells), 1.0 / float(np.sum(cells.area)))
    return cell_loads(body, "contact" if here else "race", cells, ContactFrame.rotated(angle)) @ share


def cut_stiffness(bearing: AssembledBearing, geometry: FeGeometry, load: float, position: int, extent: float) -> float:
    """Return dF/d delta of the bore on the plane of the load, N/m, of a bearing whose inner ring is cut.

    Args:
        bearing: on a rigid shaft.
        position: 1, an element under the load, or 2, the load between two.
        extent: angle that the pressure on the bore spans, rad.
    """
    assert bearing.inner is not None
    turn = (position - 1) * 0.5 * bearing.spacing
    angles = bearing.angles(turn)
    around = np.abs((angles + math.pi) % (2.0 * math.pi) - math.pi)
    loaded = around[around < 0.5 * math.pi - 0.02]
    ring = _kept(geometry, tuple(sorted({round(float(angle), 9) for angle in loaded})), extent)
    side = ring.angles
    place = np.array([int(np.argmin(np.abs(side - angle))) for angle in around])
    within = around < 0.5 * math.pi - 0.02
    pair = np.where(side < 1e-9, 1.0, 0.5)
    bent = np.where(within[:, None] & within[None, :], (ring.change * pair)[np.ix_(place, place)], 0.0)
    inner = _Bent(bearing.inner.angle, bearing.inner.race, bearing.inner.own, bearing.inner.support, bent)
    cut = replace(bearing, inner=inner)
    race = np.where(within, ring.race[place], 0.0)

    def line(force: float) -> float:
        state = cut.state(force, cage_angle=turn, gaps=race * force)
        if not state.converged:
            raise RuntimeError(f"cut ring at {force:g} N, position {position}: {state.status}")
        moved = float(np.where(within, (ring.line * pair)[place], 0.0) @ state.loads)
        return float(state.displacement[0]) + ring.line_at_load * force + moved

    step = _STEP * load
    return 2.0 * step / (line(load + step) - line(load - step))
