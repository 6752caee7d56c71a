"""The active set: contact conditions, an oracle, claims that are withheld."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

from models.fe.solid.condense import ContactCells, compliance
from models.fe.solid.contact import FORCE_TOLERANCE, TOLERANCE, ContactState, press, press_to_force
from models.fe.solid.elastic import FeError
from tests.models.fe.bodies import MODULUS, POISSON, block_mesh, cut_free, unit_mesh
from tests.support.effort import effort_count

Problem = tuple[np.ndarray, np.ndarray, np.ndarray]


def _random(seed: int, cells: int, rank: int) -> Problem:
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(cells, rank))
    return factor @ factor.T * 1e-18, rng.uniform(0.0, 2e-5, cells), rng.uniform(1e-9, 4e-9, cells)


@settings(max_examples=effort_count(quick=30, full=500), deadline=None)
@given(seed=st.integers(0, 2**32 - 1), cells=st.integers(1, 25), approach=st.floats(-1e-5, 4e-5))
def test_the_conditions_of_contact_hold(seed: int, cells: int, approach: float) -> None:
    matrix, gap, area = _random(seed, cells, cells)
    state = press(matrix, gap, area, approach)
    assert state.converged
    assert state.residual <= TOLERANCE
    assert np.all(state.pressure >= 0.0)
    assert np.all(state.opening >= -TOLERANCE * 4e-5)
    assert np.all((state.pressure == 0.0) | (np.abs(state.opening) <= TOLERANCE * 4e-5))
    assert state.force == pytest.approx(float(area @ state.pressure))
    assert np.array_equal(state.active, state.pressure > 0.0)


@settings(max_examples=effort_count(quick=15, full=200), deadline=None)
@given(seed=st.integers(0, 2**32 - 1), cells=st.integers(2, 15))
def test_pressures_are_those_of_non_negative_least_squares(seed: int, cells: int) -> None:
    matrix, gap, area = _random(seed, cells, cells + 3)
    state = press(matrix, gap, area, 1.5e-5)
    lower = np.linalg.cholesky(matrix * 1e18)
    expected, _ = nnls(lower.T, np.linalg.solve(lower, area * (1.5e-5 - gap) * 1e9))
    assert state.pressure == pytest.approx(expected * 1e9, rel=1e-5, abs=1e-6 * max(float(expected.max()), 1e-9) * 1e9)


def test_force_and_tangent_grow_as_the_tangent_says() -> None:
    matrix, gap, area = _random(5, 30, 30)
    state = press(matrix, gap, area, 1.5e-5)
    near = press(matrix, gap, area, 1.5e-5 + 1e-13, start=state.active)
    assert (near.force - state.force) / 1e-13 == pytest.approx(state.stiffness, rel=1e-4)
    assert near.iterations == 1


def _singular() -> Problem:
    """A block of two quadratic facets under 16 cells, pressed by a cylinder."""
    body = cut_free(block_mesh(np.linspace(0.0, 2e-3, 3), np.linspace(0.0, 2e-3, 3)))
    cells = ContactCells.grid(np.linspace(0.0, 2e-3, 17))
    gap = (cells.x1**3 - cells.x0**3) / (6.0 * 0.02 * (cells.x1 - cells.x0))
    return compliance(body, "contact", cells), gap, cells.area


def test_more_cells_than_the_surface_tells_apart_give_force_and_approach_but_not_the_pressure() -> None:
    matrix, gap, area = _singular()
    state = press_to_force(matrix, gap, area, 6e6)
    assert state.converged
    assert state.active.sum() > 6
    assert not state.pressure_unique
    # Other pressures, started from elsewhere, with the same force: only the sum is fixed.
    other = press(matrix, gap, area, state.approach, start=~state.active)
    assert other.force == pytest.approx(6e6, rel=1e-7)
    coarse = press_to_force(*_random(5, 6, 9), 1e3)
    assert coarse.pressure_unique


@settings(max_examples=effort_count(quick=15, full=200), deadline=None)
@given(seed=st.integers(0, 2**32 - 1), cells=st.integers(1, 20), force=st.floats(1e-3, 1e6))
def test_the_force_asked_for_is_met_from_any_start(seed: int, cells: int, force: float) -> None:
    matrix, gap, area = _random(seed, cells, cells)
    state = press_to_force(matrix, gap, area, force)
    assert state.converged
    assert abs(state.force / force - 1.0) <= FORCE_TOLERANCE
    again = press_to_force(matrix, gap, area, force, start=press(matrix, gap, area, 5e-5))
    assert again.approach == pytest.approx(state.approach, rel=1e-6, abs=1e-12)


@settings(max_examples=effort_count(quick=10, full=300), deadline=None)
@given(seed=st.integers(0, 2**32 - 1), nodes=st.integers(2, 8), parts=st.integers(1, 6))
def test_a_singular_compliance_does_not_break_the_active_set(seed: int, nodes: int, parts: int) -> None:
    # Facets of linear trace between nodes, each under several cells: pressures of no load exist, but none that is
    # positive, as of any body.
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(nodes, nodes))
    edges = np.linspace(0.0, nodes - 1.0, parts * (nodes - 1) + 1)
    centre, width = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
    loads = np.maximum(0.0, 1.0 - np.abs(centre - np.arange(nodes)[:, None])) * width
    gap = rng.uniform(0.0, 2e-5, len(centre))
    state = press(loads.T @ (factor @ factor.T) @ loads * 1e-15, gap, width, 1.5e-5)
    assert state.converged
    assert state.pressure_unique or parts > 1


@pytest.mark.parametrize(
    ("one", "other"), [("MeshHex2", "MeshTet1"), ("MeshTet2", "MeshHex1"), ("MeshQuad2", "MeshTri2")]
)
def test_a_uniform_pressure_passes_between_unequal_meshes(one: str, other: str) -> None:
    bodies = [cut_free(unit_mesh(kind)) for kind in (one, other)]
    edges = np.array([0.0, 0.3, 0.6, 1.0])
    cells = ContactCells.grid(edges, edges if bodies[0].dim == 3 else None)
    both = sum((compliance(body, "contact", cells) for body in bodies), np.zeros((len(cells), len(cells))))
    state = press(both, np.zeros(len(cells)), cells.area, 2e-6)
    modulus = MODULUS if bodies[0].dim == 3 else MODULUS / (1.0 - POISSON**2)
    assert state.converged
    assert state.pressure == pytest.approx(np.full(len(cells), 1e-6 * modulus), rel=1e-9)
    assert state.stiffness == pytest.approx(0.5 * modulus, rel=1e-9)


def test_bodies_apart_carry_nothing() -> None:
    matrix, gap, area = _random(3, 5, 5)
    state = press(matrix, gap + 1e-6, area, 1e-6)
    assert (state.force, state.stiffness, state.converged) == (0.0, 0.0, True)
    assert not np.any(state.active)
    assert np.all(state.opening >= 0.0)


def test_too_few_exchanges_are_no_result() -> None:
    matrix, gap, area = _singular()
    assert press(matrix, gap, area, 1e-4).converged
    short = press(matrix, gap, area, 1e-4, start=np.arange(len(area)) > 8, max_iterations=1)
    assert not short.converged
    assert short.residual > TOLERANCE
    limited: ContactState = press_to_force(matrix, gap, area, 1e5, max_iterations=2)
    assert not limited.converged


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"gap": np.zeros(4)}, "expected compliance"),
        ({"gap": np.array([0.0, np.nan, 0.0])}, "gap is not finite"),
        ({"area": np.array([1.0, 0.0, 1.0])}, "areas must be positive"),
        ({"compliance": np.triu(np.ones((3, 3)))}, "symmetric"),
        ({"compliance": -np.eye(3)}, "semi-definite"),
    ],
)
def test_bad_data_are_named(change: dict[str, np.ndarray], says: str) -> None:
    data = {"compliance": np.eye(3), "gap": np.zeros(3), "area": np.ones(3)} | change
    with pytest.raises(FeError, match=says):
        press(data["compliance"], data["gap"], data["area"], 1.0)


@pytest.mark.parametrize("force", [0.0, -1.0, np.inf, np.nan])
def test_a_force_must_press(force: float) -> None:
    with pytest.raises(FeError, match="force must be positive"):
        press_to_force(np.eye(2), np.zeros(2), np.ones(2), force)
