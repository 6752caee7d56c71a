"""Law of one ball of a self-aligning bearing and the influence of its rings, from bodies at full width.

Each contact is solved in its own frame, inclined by the contact angle. The ball is an eighth, so that the pressure is
taken as symmetric about the plane of the contact across rolling; the ring is not, and its compliance for such
pressures, and the mean gap of both sides, go with it. The part of the ring's displacement that this leaves open is
reported as ``asymmetry``. Rings are held by their seats: the bore and the outside do not move.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.fe.bearings.law import ElementLaw
from models.fe.bearings.oblique import ObliqueGeometry
from models.fe.bearings.oblique_mesh import contact_frame, largest_half_length, oblique_ring_mesh, race_profile
from models.fe.meshes.ball_mesh import ball_mesh
from models.fe.meshes.geometry import FeGeometry, Race
from models.fe.meshes.sizing import ContactGrid, MeshRule, contact_grid, half_sizes
from models.fe.solid.condense import ContactCells, ContactFrame, cell_loads
from models.fe.solid.contact import ContactState, press_to_force
from models.fe.solid.elastic import ElasticBody, FeError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.bearings.oblique_mesh import RaceProfile
    from models.fe.solid.condense import Slope
    from models.fe.solid.sparse import SparseMatrix

RULE = MeshRule(patch=1.4, size=0.35, growth=2.0, along=5, along_patch=1.25, coarse=0.8)
"""Rule of the meshes at full width: about 60,000 unknowns a ring."""
SHARES = (0.12, 0.25, 0.5, 1.0)
"""Loads that one mesh serves, as shares of the one that it was made for."""
MIN_SAMPLES = 3


@dataclass(frozen=True, eq=False)
class ObliqueContact:
    """Contact of one ball with one race on meshes that were made for one load.

    Attributes:
        race: "inner" or "outer".
        ring: half the ring, ready to be solved.
        cells: of the quarter x, z >= 0 of the contact's tangent plane.
        compliance: of ball and ring together for a quarter of a pressure that is symmetric about both axes, m^3/Pa.
        gap: mean of both sides, m, shape (cells,).
        loads: of the cells of both sides on the ring, N/Pa: (upper, lower), sparse (3 nodes, cells).
        unknowns: of ball and ring.
    """

    race: Race
    ring: ElasticBody
    cells: ContactCells
    compliance: NDArray[np.float64]
    gap: NDArray[np.float64]
    loads: tuple[SparseMatrix, SparseMatrix]
    unknowns: tuple[int, int]

    def press(self, force: float) -> ContactState:
        """Return the pressed contact under a force of the whole ball, N; forces of the result are of the quarter."""
        return press_to_force(self.compliance, self.gap, self.cells.area, 0.25 * force)

    def asymmetry(self, state: ContactState) -> float:
        """Return by how much the ring yields differently on both sides, as a share of the approach, root mean square.

        Weighted with the pressure, after its rolling part (proportional to z) is taken off, which the ball follows by
        rolling along the groove.
        """
        upper, lower = self.loads
        u = self.ring.solve((upper + lower) @ state.pressure)
        odd = 0.5 * ((upper - lower).T @ u) / self.cells.area
        weight, z = state.pressure * self.cells.area, self.cells.centre[1]
        odd = odd - z * float(weight @ (odd * z)) / float(weight @ z**2)
        return float(np.sqrt(weight @ odd**2 / weight.sum())) / state.approach


def single_row(geometry: ObliqueGeometry) -> FeGeometry:
    """Return the ball and its races as one radial row would have them: what sizes and the ball's mesh follow from."""
    return FeGeometry(
        designation="self-aligning",
        element="ball",
        n_elements=geometry.n_elements,
        rows=2,
        contact_angle=geometry.contact_angle,
        element_radius=geometry.ball_radius,
        inner_race_radius=geometry.inner_contact_distance,
        outer_race_radius=geometry.sphere_radius,
        bore_radius=geometry.bore_radius,
        outside_radius=geometry.outside_radius,
        width=geometry.width,
        inner_groove_radius=geometry.groove_radius,
        outer_groove_radius=geometry.sphere_radius,
        shoulder_height=geometry.land_radius - race_profile(geometry, "inner").contact_radius,
        modulus=geometry.modulus,
        poisson=geometry.poisson,
    )


def largest_ball_load(geometry: ObliqueGeometry, rule: MeshRule = RULE) -> float:
    """Return the load of a ball, N, whose patch reaches the edge of the inner groove; no mesh is made for more."""
    half_length, _ = half_sizes(single_row(geometry), "inner", 1.0)
    return (largest_half_length(geometry) / (rule.along_patch * half_length)) ** 3


def oblique_contact(geometry: ObliqueGeometry, race: Race, force: float, rule: MeshRule = RULE) -> ObliqueContact:
    """Return the contact of one ball with a race on meshes made for a force, N.

    Raises:
        WrongInputError: the contact reaches over the groove, or the body cannot hold its mesh.
    """
    row = single_row(geometry)
    grid = contact_grid(row, race, force, rule)
    profile = race_profile(geometry, race)
    back = "bore" if race == "inner" else "outside"
    steel = geometry.modulus, geometry.poisson
    ring = ElasticBody(oblique_ring_mesh(geometry, race, grid, rule), *steel, {back: (0, 1, 2), "x0": (0,)})
    ball = ElasticBody(ball_mesh(row, grid, rule), *steel, {"x0": (0,), "y0": (1,), "z0": (2,)})
    cells = _quarter(grid)
    frame = contact_frame(profile)
    lower_cells = ContactCells(cells.x0, cells.x1, -cells.z1, -cells.z0)
    slope = _slope(geometry, race)
    upper, lower = (cell_loads(ring, "race", part, frame, slope) for part in (cells, lower_cells))
    ball_frame = ContactFrame(np.array([0.0, geometry.ball_radius, 0.0]), np.eye(3))
    # The ball's normal is the ring's own at the outer race, and the opposite at the inner one.
    own = ball.flexibility(cell_loads(ball, "contact", cells, ball_frame, _slope(geometry, race, ball=True)))
    total = own + 0.5 * ring.flexibility(upper + lower)
    gaps = [part.mean(lambda x, z: _gap(geometry, profile, race, x, z)) for part in (cells, lower_cells)]
    gap = 0.5 * (gaps[0] + gaps[1])
    return ObliqueContact(race, ring, cells, total, gap, (upper, lower), (ball.unknowns, ring.unknowns))


def _quarter(grid: ContactGrid) -> ContactCells:
    """Return the cells of a contact, one about each node of its patch."""
    return ContactCells.about_nodes(grid.x[: grid.columns + 1], grid.z)


def _gap(
    geometry: ObliqueGeometry, profile: RaceProfile, race: Race, x: NDArray[np.float64], z: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the distance of ball and race along the normal in the tangent plane of their contact, m, exactly."""
    r_b = geometry.ball_radius
    ball = r_b - np.sqrt(r_b**2 - x**2 - z**2)
    if race == "outer":
        r_o = geometry.sphere_radius
        return ball - (r_o - np.sqrt(r_o**2 - x**2 - z**2))
    return ball - groove_height(profile, x, z)


def _slope(geometry: ObliqueGeometry, race: Race, *, ball: bool = False) -> Slope:
    """Return the slopes of the mean surface of ball and race, in the frame of the ring or of the ball."""
    r_b, inner = geometry.ball_radius, race == "inner"

    def slope(x: NDArray[np.float64], z: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        height = np.sqrt(r_b**2 - x**2 - z**2)
        if inner:
            across = 0.5 * x * (1.0 / height - 1.0 / geometry.inner_contact_distance)
            along = 0.5 * z * (1.0 / height + 1.0 / np.sqrt(geometry.groove_radius**2 - z**2))
        else:
            mean = -0.5 * (1.0 / height + 1.0 / np.sqrt(geometry.sphere_radius**2 - x**2 - z**2))
            across, along = mean * x, mean * z
        return (-across, -along) if inner and ball else (across, along)

    return slope


def groove_height(profile: RaceProfile, x: NDArray[np.float64], z: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far a groove rises above the tangent plane of its contact, m, by Newton's method on the torus."""
    radial, axial = np.cos(profile.angle), np.sin(profile.angle)
    height = profile.radius - np.sqrt(profile.radius**2 - z**2)
    for _ in range(8):
        plane = profile.contact_radius - z * axial + height * radial
        place = profile.contact_z + z * radial + height * axial
        radius = np.hypot(x, plane)
        across, along = radius - profile.centre[0], place - profile.centre[1]
        miss = across**2 + along**2 - profile.radius**2
        height = height - miss / (2.0 * (across * plane / radius * radial + along * axial))
    return height


@dataclass(frozen=True, eq=False)
class BallLaw:
    """Approach of both races over the force on a ball, A Q^(2/3) - B Q, fitted to computed samples.

    The first part is Hertz's for half spaces, the second what bodies of finite depth on a seat yield less: without
    friction it is proportional to the force. The fit takes the mesh noise of single loads, which the stiffness would
    magnify, out of the law.

    Attributes:
        loads, approach: samples, N and m, shape (n,).
        hertz: A, m/N^(2/3).
        depth: B, m/N.
        residual: largest relative difference of a sample and the fit: the mesh error of the law.
    """

    loads: NDArray[np.float64]
    approach: NDArray[np.float64]
    hertz: float
    depth: float
    residual: float

    @property
    def contact_stiffness(self) -> float:
        """k_c of Q = k_c delta^1.5 for small loads, N/m^1.5."""
        return self.hertz**-1.5

    def law(self) -> ElementLaw:
        """Return the law up to the highest sample; Hertz's exponent is reached at a hundredth of the lowest."""
        loads = np.geomspace(0.01 * float(self.loads.min()), float(self.loads.max()), 33)
        return ElementLaw(loads, self.hertz * loads ** (2.0 / 3.0) - self.depth * loads, self.residual)


def fitted_law(loads: NDArray[np.float64], approach: NDArray[np.float64]) -> BallLaw:
    """Return the law of a ball from samples of at least three loads, N, and the approach of both races, m.

    Raises:
        FeError: fewer than three loads.
    """
    if len(np.unique(loads)) < MIN_SAMPLES:
        raise FeError(f"law of a ball: expected {MIN_SAMPLES} loads at least, got {np.unique(loads).tolist()} N")
    terms = np.column_stack((loads ** (2.0 / 3.0), -loads)) / approach[:, None]
    (hertz, depth), *_ = np.linalg.lstsq(terms, np.ones(len(loads)), rcond=None)
    residual = float(np.abs(terms @ np.array([hertz, depth]) - 1.0).max())
    return BallLaw(loads, approach, float(hertz), float(depth), residual)


def race_displacement(
    geometry: ObliqueGeometry, contact: ObliqueContact
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return how far the race gives way at 0, 1, .. and at 0.5, 1.5, .. spacings in the rows, m/N."""
    count, spacing = geometry.n_elements, 2.0 * np.pi / geometry.n_elements
    profile = race_profile(geometry, contact.race)
    state = contact.press(1.0)
    upper, lower = contact.loads
    # The pressure of the quarter on both sides of the half ring is half of one newton.
    u = contact.ring.solve((upper + lower) @ state.pressure)
    size = 0.05 * geometry.ball_radius

    def away(step: float, *, mirrored: bool) -> float:
        turn = spacing * step
        # Within the half ring; at its end the patch lies on this side of it.
        low, high = (-size, 0.0) if turn > np.pi - 1e-9 else (-size, size)
        patch = ContactCells.grid(np.array([low, high]), np.array([-size, size]))
        read = cell_loads(contact.ring, "race", patch, contact_frame(profile, turn, mirrored=mirrored))
        return float((read.T @ u)[0] / patch.area[0])

    # Both sides of the ring are alike: those beyond half a turn mirror the others.
    near = np.array([0.0] + [away(float(k), mirrored=False) for k in range(1, count // 2 + 1)])
    across = np.array([away(k + 0.5, mirrored=True) for k in range((count + 1) // 2)])
    index = np.arange(count)
    return near[np.minimum(index, count - index)], across[np.minimum(index, count - 1 - index)]
