"""Elastic bodies: patch test, supports, factorisation against a dense one."""

from __future__ import annotations

import numpy as np
import pytest

from models.fe.solid.condense import ContactCells, cell_loads, compliance
from models.fe.solid.cost import MemoryBoundError, memory_bound
from models.fe.solid.elastic import ElasticBody, FeError, rigid_motions
from models.words.errors import WrongInputError
from tests.models.fe.bodies import KINDS, MODULUS, POISSON, block_mesh, cut_free, name_sides, skfem, unit_mesh


@pytest.mark.parametrize("kind", KINDS)
def test_uniform_pressure_makes_uniform_strain(kind: str) -> None:
    mesh = unit_mesh(kind)
    body = cut_free(mesh)
    # Cells that follow no facet: thirds of a face that is cut in halves.
    thirds = np.linspace(0.0, 1.0, 4)
    cells = ContactCells.grid(thirds, thirds if body.dim == 3 else None)
    loads = cell_loads(body, "contact", cells)
    pressure = 1e6
    u = body.solve(np.asarray(loads @ np.full(len(cells), pressure)))
    stretch = pressure / MODULUS * (1.0 if body.dim == 3 else 1.0 - POISSON**2)
    across = pressure / MODULUS * (POISSON if body.dim == 3 else POISSON * (1.0 + POISSON))
    expected = across * body.nodes
    expected[1] = -stretch * body.nodes[1]
    assert pytest.approx(expected, abs=1e-12 * stretch) == u.reshape(-1, body.dim).T
    assert np.asarray(loads.T @ u) / cells.area == pytest.approx(np.full(len(cells), stretch), rel=1e-11)
    reactions = np.asarray(body.stiffness @ u).reshape(-1, body.dim).sum(axis=0)
    assert reactions == pytest.approx(np.zeros(body.dim), abs=1e-5)


@pytest.mark.parametrize("order", [1, 2])
def test_the_order_of_the_displacement_is_chosen_apart_from_the_mesh(order: int) -> None:
    body = cut_free(unit_mesh("MeshHex1", 0), order=order)
    assert body.unknowns == {1: 12, 2: 54}[order]


def test_rigid_motions_make_no_force() -> None:
    mesh = unit_mesh("MeshTet2")
    body = cut_free(mesh)
    motions = rigid_motions(body.nodes)
    assert motions.shape == (3 * body.nodes.shape[1], 6)
    assert np.abs(body.stiffness @ motions).max() < 1e-13 * np.abs(body.stiffness.data).max()


@pytest.mark.parametrize(
    ("fixed", "left"),
    [({}, "rigid motion"), ({"x0": (0,), "z0": (2,)}, r"\(y\)"), ({"y0": (1,), "x0": (0,)}, r"\(z\)")],
)
def test_a_body_that_can_move_as_a_whole_is_refused(fixed: dict[str, tuple[int, ...]], left: str) -> None:
    with pytest.raises(FeError, match=left):
        ElasticBody(unit_mesh("MeshHex1"), MODULUS, POISSON, fixed)


def test_supports_at_an_angle_are_those_of_the_turned_body() -> None:
    straight = block_mesh(np.linspace(0.0, 1.0, 3), np.linspace(0.0, 1.0, 3))
    angle = 0.3
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turned = type(straight)(turn @ straight.doflocs, straight.t).with_boundaries(straight.boundaries)
    reference = ElasticBody(straight, MODULUS, POISSON, {"x0": (0,), "y0": (1,)})
    body = ElasticBody(turned, MODULUS, POISSON, {"x0": turn[:, :1].T, "y0": turn[:, 1:].T})
    assert body.unknowns == reference.unknowns
    load = np.random.default_rng(1).normal(size=reference.nodes.shape)
    expected = turn @ reference.solve(load.T.ravel()).reshape(-1, 2).T
    assert pytest.approx(expected, rel=1e-9, abs=1e-16) == body.solve((turn @ load).T.ravel()).reshape(-1, 2).T


def test_a_corner_held_along_both_its_planes_does_not_move() -> None:
    mesh = unit_mesh("MeshQuad1")
    body = ElasticBody(mesh, MODULUS, POISSON, {"x0": np.array([[1.0, 0.0]]), "y0": (1,)})
    corner = int(np.argmin(np.abs(body.nodes).sum(axis=0)))
    assert np.abs(body.admissible.toarray().reshape(-1, 2, body.unknowns)[corner]).max() == 0.0


@pytest.mark.parametrize("kind", ["MeshHex2", "MeshTet2", "MeshQuad1"])
def test_the_factorisation_is_that_of_a_dense_matrix_and_costs_what_was_planned(kind: str) -> None:
    body = cut_free(unit_mesh(kind, 1))
    planned = body.plan.entries
    assert body.factor_entries is None
    loads = np.random.default_rng(2).normal(size=(body.dim * body.nodes.shape[1], 3))
    matrix = (body.admissible.T @ body.stiffness @ body.admissible).toarray()
    expected = body.admissible @ np.linalg.solve(matrix, body.admissible.T @ loads)
    assert body.solve(loads) == pytest.approx(expected, rel=1e-9, abs=1e-9 * float(np.abs(expected).max()))
    assert body.solve(loads[:, 0]) == pytest.approx(body.solve(loads)[:, 0], rel=1e-9)
    assert body.flexibility(loads) == pytest.approx(loads.T @ expected, rel=1e-9)
    assert body.flexibility(loads[:, :1], at=loads) == pytest.approx(loads.T @ expected[:, :1], rel=1e-9)
    assert body.factor_entries == planned
    assert body.memory_bytes > 8 * planned


def test_fewer_entries_than_a_banded_order() -> None:
    # A slab of 16 x 16 x 1 elements: nested dissection must beat elimination row by row, n times the bandwidth.
    edges = np.linspace(0.0, 1.0, 17)
    mesh = name_sides(skfem.MeshHex1.init_tensor(edges, edges, np.array([0.0, 0.1])))
    body = cut_free(mesh)
    bandwidth = 3 * 2 * 18
    assert body.plan.entries < 0.7 * body.unknowns * bandwidth
    assert sorted(body.plan.order) == list(range(body.unknowns))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"modulus": 0.0}, "modulus"),
        ({"poisson": 0.5}, "poisson"),
        ({"order": 3}, "order"),
        ({"fixed": {"bore": (0,)}}, "no boundary 'bore'; it has contact, x0, y0"),
        ({"fixed": {"x0": (2,)}}, "components from 0 to 1"),
    ],
)
def test_bad_input_is_named(change: dict[str, object], says: str) -> None:
    arguments: dict[str, object] = {"modulus": MODULUS, "poisson": POISSON, "fixed": {"x0": (0,), "y0": (1,)}}
    with pytest.raises(WrongInputError, match=says):
        ElasticBody(unit_mesh("MeshQuad1"), **(arguments | change))  # type: ignore[arg-type]


def test_an_element_turned_inside_out_is_refused() -> None:
    mesh = unit_mesh("MeshHex1")
    places = mesh.doflocs.copy()
    middle = int(np.argmin(np.abs(places - 0.5).sum(axis=0)))
    places[:, middle] = 1.4
    bent = type(mesh)(places, mesh.t).with_boundaries(mesh.boundaries)
    with pytest.raises(FeError, match="inside out"):
        cut_free(bent)


def test_the_compliance_is_symmetric_to_the_last_digit_and_definite_where_cells_are_few() -> None:
    edges = np.linspace(0.0, 1.0, 3)
    matrix = compliance(cut_free(unit_mesh("MeshHex2")), "contact", ContactCells.grid(edges, edges))
    assert np.array_equal(matrix, matrix.T)
    assert np.linalg.eigvalsh(matrix)[0] > 0.0


def test_a_piece_that_is_not_held_is_refused() -> None:
    held = unit_mesh("MeshQuad1")
    places = np.hstack((held.p, held.p + 5.0))
    pieces = skfem.MeshQuad1(places, np.hstack((held.t, held.t + held.p.shape[1]))).with_boundaries(
        {"x0": lambda x: np.abs(x[0]) < 1e-9, "y0": lambda x: np.abs(x[1]) < 1e-9}
    )
    with pytest.raises(FeError, match="the hub: the stiffness is not positive definite"):
        ElasticBody(pieces, MODULUS, POISSON, {"x0": (0,), "y0": (1,)}, name="the hub").factorise()


def test_memory_is_refused_before_the_factorisation() -> None:
    body = ElasticBody(unit_mesh("MeshQuad1"), MODULUS, POISSON, {"x0": (0,), "y0": (1,)}, name="the hub")
    with memory_bound(1e6), pytest.raises(MemoryBoundError, match="the hub of 12 unknowns"):
        body.factorise()
    assert body.factor_entries is None
