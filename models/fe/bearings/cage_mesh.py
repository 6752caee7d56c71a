"""Mesh of a steel cage, how its pockets open under pairs of forces, and how much a roller of finite elements bulges.

The cage is a ring with a rectangular window for each roller: two side rings and a bar between neighbours, whose faces
are parallel to the middle plane of the pocket and touch the roller along a line at the pitch radius. By symmetry half
of the ring, from the middle of pocket 0, and half of its width are meshed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from models.fe.meshes.grid import Chooser, FeMesh, HexBlock, build, extrude, lattice, on_surface
from models.fe.meshes.roller_mesh import roller_mesh
from models.fe.meshes.sizing import MeshRule, contact_grid
from models.fe.solid.condense import ContactCells, ContactFrame, cell_loads
from models.fe.solid.elastic import ElasticBody
from models.words.checks import check_numbers, check_whole

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from models.fe.meshes.geometry import FeGeometry


@dataclass(frozen=True)
class CageGeometry:
    """A window cage, m.

    Attributes:
        n_pockets: pockets around.
        pitch_radius: of the rollers' centres.
        roller_radius: half the width of a pocket, which has no play here.
        inner_radius, outer_radius: of the cage.
        pocket_length: along the shaft.
        width: of the cage along the shaft.
        modulus, poisson: Pa and 1.
    """

    n_pockets: int
    pitch_radius: float
    roller_radius: float
    inner_radius: float
    outer_radius: float
    pocket_length: float
    width: float
    modulus: float = 210e9
    poisson: float = 0.3

    def __post_init__(self) -> None:
        """Raise a ValueError that names a field with which there is no cage."""
        check_whole(self.n_pockets, "n_pockets", 3)
        check_numbers(self, "", "positive", *(f.name for f in fields(self) if f.name not in ("n_pockets", "poisson")))
        if not self.inner_radius < self.pitch_radius < self.outer_radius:
            raise ValueError(f"pitch_radius must lie between inner and outer radius, got {self.pitch_radius!r}")
        if not self.pocket_length < self.width:
            raise ValueError(f"pocket_length must be below width {self.width!r}, got {self.pocket_length!r}")
        if not self.roller_radius < self.inner_radius * math.sin(math.pi / self.n_pockets):
            raise ValueError(
                f"roller_radius {self.roller_radius!r} leaves no bar between pockets at inner_radius "
                f"{self.inner_radius!r}"
            )


@dataclass(frozen=True)
class CageRule:
    """Elements of a cage: across half a pocket, half a bar, the height, half a pocket's length and a side ring.

    The least that has a line at the pitch radius: 4,504 unknowns for 11 pockets, opening 5 % below that of 97,732.
    """

    pocket: int = 2
    bar: int = 1
    height: int = 2
    length: int = 2
    side: int = 1


def cage_mesh(cage: CageGeometry, rule: CageRule | None = None) -> FeMesh:
    """Return half a cage at half its width; pocket k lies at k spacings from the y axis towards x.

    Boundaries: x0, z0, "front k" and "back k" (the faces of pocket k at larger and smaller angle, as far as they lie in
    this half), rest.

    Raises:
        FeMeshError: the sizes do not fit.
    """
    rule = rule or CageRule()
    half_pitch = math.pi / cage.n_pockets
    half, end = 0.5 * cage.pocket_length, 0.5 * cage.width
    along_bar = np.linspace(0.0, half, rule.length + 1)
    along_side = np.linspace(half, end, rule.side + 1)
    # A line at the pitch radius, where the rollers touch.
    share = (cage.pitch_radius - cage.inner_radius) / (cage.outer_radius - cage.inner_radius)
    below = max(1, round(rule.height * share))
    height = np.concatenate(
        (np.linspace(0.0, share, below + 1), np.linspace(share, 1.0, max(1, rule.height - below) + 1)[1:])
    )
    sectors = range(cage.n_pockets)
    blocks: list[HexBlock] = []
    window = lattice(np.linspace(0.0, 1.0, rule.pocket + 1), height)
    bar = lattice(np.linspace(0.0, 1.0, rule.bar + 1), height)
    for sector in sectors:
        place = _sector(cage, half_pitch, sector)
        blocks.append(HexBlock(extrude(window, along_side), place(0.0)))
        blocks.append(HexBlock(extrude(bar, np.concatenate((along_bar, along_side[1:]))), place(1.0)))
    size = cage.outer_radius - cage.inner_radius
    boundaries: dict[str, Chooser] = {
        "x0": on_surface(lambda p: p[0], size),
        "z0": on_surface(lambda p: p[2], size),
    }
    for pocket in range(cage.n_pockets // 2 + 1):
        boundaries[f"front {pocket}"] = _face(cage, 2.0 * half_pitch * pocket, 1.0)
        boundaries[f"back {pocket}"] = _face(cage, 2.0 * half_pitch * pocket, -1.0)
    boundaries["rest"] = _any
    return build(blocks, boundaries, 2)


def _sector(
    cage: CageGeometry, half_pitch: float, sector: int
) -> Callable[[float], Callable[[NDArray[np.float64]], NDArray[np.float64]]]:
    """Return the maps of half a spacing: part 0 is beside the window, part 1 the half bar."""
    middle = half_pitch * (sector + sector % 2)
    side = 1.0 if sector % 2 == 0 else -1.0

    def of(part: float) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
        def place(point: NDArray[np.float64]) -> NDArray[np.float64]:
            radius = cage.inner_radius + point[1] * (cage.outer_radius - cage.inner_radius)
            face = np.arcsin(cage.roller_radius / radius)
            offset = point[0] * face if part == 0.0 else face + point[0] * (half_pitch - face)
            angle = middle + side * offset
            return np.stack((radius * np.sin(angle), radius * np.cos(angle), point[2]))

        return place

    return of


def _any(places: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.asarray(np.ones(places.shape[2]), dtype=np.bool_)


def _face(cage: CageGeometry, middle: float, side: float) -> Chooser:
    """Return the chooser of the face of a pocket at larger (1) or smaller (-1) angles."""
    s, c = math.sin(middle), math.cos(middle)
    flat = on_surface(lambda p: p[0] * c - p[1] * s - side * cage.roller_radius, cage.roller_radius)

    def choose(places: NDArray[np.float64]) -> NDArray[np.bool_]:
        near = np.all(places[0] * s + places[1] * c > 0.0, axis=0)
        return flat(places) & near & np.all(np.abs(places[2]) <= 0.5 * cage.pocket_length * (1 + 1e-9), axis=0)

    return choose


@dataclass(frozen=True, eq=False)
class CageOpening:
    """How the pockets of a cage open, m/N.

    Attributes:
        by_distance: opening of a pocket 0, 1, .. spacings from one that a pair of forces spreads, shape (n_pockets,).
        strip: half width of the strip on which the forces act and the opening is the mean, m.
        unknowns: of the mesh.
    """

    by_distance: NDArray[np.float64]
    strip: float
    unknowns: int

    def matrix(self) -> NDArray[np.float64]:
        """Return the opening of each pocket (row) per newton of the pair of forces in each (column), m/N."""
        index = np.arange(len(self.by_distance))
        return self.by_distance[(index[:, None] - index[None, :]) % len(index)]


def cage_opening(cage: CageGeometry, length: float, rule: CageRule | None = None) -> CageOpening:
    """Return how the pockets of a free cage open under a pair of opposite forces in one of them.

    Args:
        length: over which a roller touches the bars, m.

    Raises:
        ValueError: if the length exceeds that of the pocket.
        FeMeshError: the sizes do not fit.
    """
    if not 0.0 < length <= cage.pocket_length:
        raise ValueError(f"length must be positive, up to pocket_length {cage.pocket_length!r}, got {length!r}")
    mesh = cage_mesh(cage, rule)
    # The pair is in equilibrium: one node holds the ring along y, without a reaction.
    held = int(np.argmin(np.abs(mesh.p[0]) + np.abs(mesh.p[2]) - mesh.p[1]))
    body = ElasticBody(mesh, cage.modulus, cage.poisson, {"x0": (0,), "z0": (2,), held: (1,)})
    strip = 0.5 * min(cage.pitch_radius - cage.inner_radius, cage.outer_radius - cage.pitch_radius)
    cells = ContactCells.grid(np.array([-strip, strip]), np.array([0.0, 0.5 * length]))
    area = float(cells.area[0])
    spacing = 2.0 * math.pi / cage.n_pockets
    half = cage.n_pockets // 2
    front = [cell_loads(body, f"front {k}", cells, _bar_frame(cage, spacing * k, 1.0)) for k in range(half + 1)]
    # One newton on the whole face is a half on the half length.
    u = body.solve(front[0] * (0.5 / area))[:, 0]
    opening = np.zeros(cage.n_pockets)
    for k in range(half + 1):
        given = float((front[k].T @ u)[0]) / area
        # The middle of pocket 0 lies in the plane of symmetry, which has its other face.
        other = cage.n_pockets - k
        back = given
        if k > 0:
            read = cell_loads(body, f"back {k}", cells, _bar_frame(cage, spacing * k, -1.0))
            back = float((read.T @ u)[0]) / area
            opening[other] = given + back
        opening[k] = given + back
    return CageOpening(opening, strip, body.unknowns)


def _bar_frame(cage: CageGeometry, middle: float, side: float) -> ContactFrame:
    """Return the frame of a face of a pocket: x along its height, the normal away from the pocket's middle."""
    s, c = math.sin(middle), math.cos(middle)
    outward, tangent = np.array([s, c, 0.0]), side * np.array([c, -s, 0.0])
    origin = cage.pitch_radius * outward + cage.roller_radius * tangent
    return ContactFrame(origin, np.stack((outward, tangent, np.array([0.0, 0.0, 1.0]))))


def roller_bulge(
    geometry: FeGeometry, force: float, rule: MeshRule | None = None, *, plane: bool = False
) -> tuple[float, int]:
    """Return beta of a roller, m/N, and the unknowns of its mesh: how much wider it becomes per newton of the races.

    The races press with an even pressure over half width and effective length of the contact with the inner race at
    the force, N; the width is the mean over the effective length. With ``plane`` its ends do not move along the shaft.
    """
    rule = rule or MeshRule()
    grid = contact_grid(geometry, "inner", force, rule)
    mesh = roller_mesh(geometry, grid, rule)
    fixed = {"x0": (0,), "y0": (1,), "z0": (2,)} | ({"side": (2,)} if plane else {})
    body = ElasticBody(mesh, geometry.modulus, geometry.poisson, fixed)
    radius, half = geometry.element_radius, grid.half_length
    top = ContactFrame(np.array([0.0, radius, 0.0]), np.eye(3))
    patch = ContactCells.grid(np.array([0.0, grid.half_width]), np.array([0.0, half]))
    # The side: x of its frame runs down along -y, so that the quarter y >= 0 has negative coordinates.
    side = ContactFrame(np.array([radius, 0.0, 0.0]), np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    strip = ContactCells.grid(np.array([-0.05 * radius, 0.0]), np.array([0.0, half]))
    u = body.solve(cell_loads(body, "contact", patch, top) * (0.25 / float(patch.area[0])))
    read = cell_loads(body, "race", strip, side).T @ u
    return -2.0 * float(read[0, 0]) / float(strip.area[0]), body.unknowns
