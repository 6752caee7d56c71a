"""Loads of pressure cells on surfaces: exact integrals, frames, refusals."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.fe.solid.condense import ContactCells, ContactFrame, cell_loads, compliance
from models.fe.solid.elastic import ElasticBody
from models.words.errors import WrongInputError
from tests.models.fe.bodies import MODULUS, POISSON, block_mesh, cut_free, name_sides, skfem, unit_mesh


@settings(max_examples=15, deadline=None)
@given(
    x=st.lists(st.floats(0.05, 0.95), min_size=1, max_size=3, unique_by=lambda v: round(v, 2)),
    kind=st.sampled_from(["MeshHex2", "MeshTet2", "MeshHex1", "MeshTet1"]),
)
def test_loads_of_any_cells_have_the_force_and_moments_of_their_pressure(x: list[float], kind: str) -> None:
    body = _body(kind)
    cells = ContactCells.grid(np.array([0.0, *sorted(x), 1.0]), np.array([0.0, 0.37, 1.0]))
    loads = cell_loads(body, "contact", cells).toarray().reshape(-1, 3, len(cells))
    assert np.abs(loads[:, [0, 2]]).max() == 0.0
    assert -loads[:, 1].sum(axis=0) == pytest.approx(cells.area, rel=1e-12)
    for axis, centre in zip((0, 2), cells.centre, strict=True):
        moment = -np.einsum("n,nm->m", body.nodes[axis], loads[:, 1])
        assert moment == pytest.approx(cells.area * centre, rel=1e-11)


@functools.cache
def _body(kind: str) -> ElasticBody:
    return cut_free(unit_mesh(kind))


def test_loads_of_a_quadratic_facet_are_the_exact_integrals() -> None:
    body = cut_free(unit_mesh("MeshQuad2", 0))
    loads = -cell_loads(body, "contact", ContactCells.grid(np.array([0.0, 0.25, 1.0]))).toarray()[1::2]
    on = body.nodes[1] == 1.0
    places = body.nodes[0][on]
    # Antiderivatives of (1 - x)(1 - 2 x), 4 x (1 - x) and x (2 x - 1).
    whole = {0.0: (1.0, -1.5, 2 / 3), 0.5: (0.0, 2.0, -4 / 3), 1.0: (0.0, -0.5, 2 / 3)}
    for x, row in zip(places, loads[on], strict=True):
        value = np.polyval([*whole[float(x)][::-1], 0.0], [0.25, 1.0])
        assert row == pytest.approx([value[0], value[1] - value[0]], rel=1e-13, abs=1e-15)


def test_cells_finer_than_the_facets_leave_the_compliance_singular() -> None:
    matrix = compliance(cut_free(unit_mesh("MeshQuad1")), "contact", ContactCells.grid(np.linspace(0.0, 1.0, 9)))
    sizes = np.linalg.eigvalsh(matrix)
    assert sizes[0] > -1e-12 * sizes[-1]
    assert np.sum(sizes > 1e-10 * sizes[-1]) == 3


def _ring(inward: bool) -> ElasticBody:
    """Half a ring of radii 0.8 and 1 m, held on the other surface; the contact surface is the inner or outer one."""
    flat = skfem.MeshQuad1.init_tensor(np.linspace(0.8, 1.0, 3), np.linspace(0.0, np.pi, 25))
    mesh = skfem.MeshQuad2.from_mesh(flat)
    radius, angle = mesh.doflocs
    bent = type(mesh)(np.stack((radius * np.sin(angle), radius * np.cos(angle))), mesh.t)
    bent = bent.with_boundaries(
        {
            "race": lambda x: np.abs(np.hypot(*x) - (0.8 if inward else 1.0)) < 5e-3,
            "back": lambda x: np.abs(np.hypot(*x) - (1.0 if inward else 0.8)) < 5e-3,
        }
    )
    return ElasticBody(bent, MODULUS, POISSON, {"back": (0, 1)})


@pytest.mark.parametrize("inward", [True, False])
def test_frames_turn_with_the_ring_and_find_the_outward_side(inward: bool) -> None:
    body = _ring(inward)
    # Whole facets about angles of which the mesh is symmetric, so that all see the same neighbourhood.
    radius = 0.8 if inward else 1.0
    half = radius * np.sin(np.pi / 24)
    cells = ContactCells.grid(np.array([-half, 0.0, half]))
    frames = [
        ContactFrame(np.zeros(2), ContactFrame.rotated(angle).axes[:2, :2]) for angle in np.pi / 24 * np.array([8, 12])
    ]
    first, second = (compliance(body, "race", cells, frame) for frame in frames)
    assert first == pytest.approx(second, rel=2e-4)
    assert np.all(np.diag(first) > 0.0)
    loads = [cell_loads(body, "race", cells, frame) for frame in frames]
    pushed = np.asarray(loads[1].sum(axis=1)).reshape(-1, 2).sum(axis=0)
    # The contact at 90 degrees is at +x; the body yields away from it.
    assert pushed == pytest.approx([2.0 * half * (1.0 if inward else -1.0), 0.0], abs=1e-12)
    far = body.flexibility(loads[0], at=loads[1])
    assert far == pytest.approx(body.flexibility(loads[1], at=loads[0]).T, rel=1e-9)
    assert np.abs(far).max() < 0.2 * first.max()


def test_the_far_side_of_a_closed_surface_takes_no_load() -> None:
    mesh = block_mesh(np.linspace(0.0, 1.0, 3), np.linspace(0.0, 1.0, 3))
    mesh = mesh.with_boundaries({"contact": lambda x: (x[1] < 1e-9) | (x[1] > 1 - 1e-9)})
    body = ElasticBody(mesh, MODULUS, POISSON, {"x0": (0, 1)})
    loads = cell_loads(body, "contact", ContactCells.grid(np.array([0.0, 1.0]))).toarray().reshape(-1, 2)
    assert np.abs(loads[body.nodes[1] < 0.5]).max() == 0.0


@pytest.mark.parametrize(
    ("x", "says"),
    [([0.0, 0.5, 1.5], "covers 0.500000 of cell 1"), ([2.0, 3.0], "no facet of 'contact'"), ([0.5, 0.0], "increase")],
)
def test_cells_that_do_not_lie_on_the_surface_are_refused(x: list[float], says: str) -> None:
    with pytest.raises(WrongInputError, match=says):
        cell_loads(cut_free(unit_mesh("MeshQuad2")), "contact", ContactCells.grid(np.array(x)))


def test_an_unknown_surface_is_named() -> None:
    with pytest.raises(WrongInputError, match="no boundary 'race'"):
        cell_loads(cut_free(unit_mesh("MeshQuad2")), "race", ContactCells.grid(np.array([0.0, 1.0])))


@pytest.mark.parametrize(("order", "edges"), [(1, [0.0, 0.1, 0.6, 1.0]), (2, [0.0, 0.05, 0.15, 0.4, 0.8, 1.0])])
def test_cells_about_nodes(order: int, edges: list[float]) -> None:
    cells = ContactCells.about_nodes(np.array([0.0, 0.2, 1.0]), np.array([0.0, 1.0]), order=order)
    assert np.unique(cells.x0) == pytest.approx(edges[:-1])
    assert cells.area.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("kind", ["MeshHex1", "MeshHex2"])
def test_cells_about_nodes_are_as_many_as_the_surface_tells_apart(kind: str) -> None:
    thirds = np.linspace(0.0, 1.0, 4)
    mesh = skfem.MeshHex1.init_tensor(thirds, np.array([0.0, 1.0]), thirds)
    body = cut_free(name_sides(mesh if kind == "MeshHex1" else skfem.MeshHex2.from_mesh(mesh)))
    cells = ContactCells.about_nodes(thirds, thirds, order=int(kind[-1]))
    sizes = np.linalg.eigvalsh(compliance(body, "contact", cells) / np.sqrt(np.outer(cells.area, cells.area)))
    assert sizes[0] > 1e-3 * sizes[-1]
    halves = np.linspace(0.0, 1.0, 7)
    if kind == "MeshHex2":
        alternating = ContactCells.grid(halves, halves)
        worse = np.linalg.eigvalsh(compliance(body, "contact", alternating) / alternating.area[0])
        assert worse[0] < 0.3 * sizes[0]


@pytest.mark.parametrize("kind", ["MeshHex2", "MeshQuad1"])
def test_a_pressure_acts_at_right_angles_to_the_common_surface(kind: str) -> None:
    mesh = unit_mesh(kind)
    places = mesh.doflocs.copy()
    tilt = np.array([0.2, -0.1])
    places[1] *= 1.0 + tilt[0] * places[0] + (tilt[1] * places[2] if mesh.dim() == 3 else 0.0)
    body = cut_free(type(mesh)(places, mesh.t).with_boundaries(mesh.boundaries))
    edges = np.array([0.0, 0.3, 1.0])
    cells = ContactCells.grid(edges, edges if body.dim == 3 else None)

    def slope(x: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.full(x.shape, tilt[0]), np.full(z.shape, tilt[-1])

    loads = cell_loads(body, "contact", cells, slope=slope)
    force = loads.toarray().reshape(-1, body.dim, len(cells)).sum(axis=0)
    along_x = np.array([1.0, tilt[0], 0.0])[: body.dim]
    assert along_x @ force == pytest.approx(np.zeros(len(cells)), abs=1e-15)
    assert -force[1] == pytest.approx(cells.area, rel=1e-12)
    if body.dim == 3:
        assert np.array([0.0, tilt[1], 1.0]) @ force == pytest.approx(np.zeros(len(cells)), abs=1e-15)
    matrix = compliance(body, "contact", cells, slope=slope)
    assert np.array_equal(matrix, matrix.T)
    # A tilted plane that slides along itself opens no gap.
    slide = np.zeros((body.nodes.shape[1], body.dim))
    slide[:, :2] = along_x[:2]
    assert loads.T @ slide.ravel() == pytest.approx(np.zeros(len(cells)), abs=1e-15)
