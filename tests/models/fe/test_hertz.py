"""A contact in plane strain against Hertz and Johnson, its order of convergence, and the references themselves."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import tests.oracles.elastic_references as references
from tests.models.fe.bodies import skfem
from tests.oracles.elastic_references import boussinesq, flamant, half_plane_to_depth, hertz_line, hertz_point
from tests.oracles.hertz_contacts import LINE_LOAD, POINT_FORCE, RADIUS, row

assert skfem


def test_a_line_contact_meets_hertz_and_its_approach_the_closed_form() -> None:
    coarse, fine = (row("half plane to depth 25 b", count) for count in (3, 8))
    for found in (coarse, fine):
        assert found["converged"] == "True"
        assert found["unique"] == "True"
    assert value(coarse, "worst approach %") < 0.3
    assert value(fine, "worst approach %") < 0.1
    assert value(fine, "worst half width %") < 1.0
    assert value(fine, "worst peak %") < 0.5
    # Elements 2.7 times smaller: more than the error of first order.
    assert value(fine, "approach %") < value(coarse, "approach %") / 2.7


def test_cells_that_halve_the_facets_scatter_more() -> None:
    halves, about = (row("half plane to depth 25 b", 6, kind) for kind in ("halves", "about nodes"))
    assert value(halves, "scatter %") > 3.0 * value(about, "scatter %")


def value(found: dict[str, Any], name: str) -> float:
    number = found[name]
    assert isinstance(number, float)
    return number


def test_the_modes_of_a_sphere_are_reciprocal() -> None:
    n = np.array([2.0, 4.0, 100.0])
    modes = references._sphere_modes(n)
    assert modes[:, 0, 1] / (n * (n + 1.0)) == pytest.approx(modes[:, 1, 0], rel=1e-9)
    # A short wave is one of a half space: u = (1 - nu) p / (G k).
    k = np.array([4000.0])
    expected = (1.0 - references.POISSON) / (references.SHEAR * k)
    assert references._sphere_modes(k)[:, 0, 0] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("plane", [True, False])
def test_far_fields_are_in_equilibrium(plane: bool) -> None:
    # Navier: (1 - 2 nu) laplace u + grad div u = 0, by central differences at a point within.
    place, step = np.array([0.3, -0.7] if plane else [0.3, -0.7, 0.2]), 1e-3
    dim = len(place)

    def field(x: np.ndarray) -> np.ndarray:
        return (flamant(x[:, None], 1.0) if plane else boussinesq(x[:, None]))[:, 0]

    def second(i: int, j: int) -> np.ndarray:
        e, f = step * np.eye(dim)[i], step * np.eye(dim)[j]
        total = field(place + e + f) - field(place + e - f) - field(place - e + f) + field(place - e - f)
        return total / (4.0 * step**2)

    laplace = np.sum([second(i, i) for i in range(dim)], axis=0)
    graddiv = np.array([sum(second(i, j)[j] for j in range(dim)) for i in range(dim)])
    rest = (1.0 - 2.0 * references.POISSON) * laplace + graddiv
    assert np.abs(rest).max() < 1e-4 * np.abs(graddiv).max()


def test_hertz_of_a_circle_and_of_a_line() -> None:
    circle = hertz_point(RADIUS, RADIUS, POINT_FORCE)
    assert circle.half_width == pytest.approx(0.02 * RADIUS, rel=1e-9)
    assert circle.approach == pytest.approx(circle.half_width**2 / RADIUS, rel=1e-9)
    line = hertz_line(RADIUS, LINE_LOAD, half_plane_to_depth(1.0))
    assert line.half_width == pytest.approx(0.02 * RADIUS, rel=1e-9)
    assert line.peak == pytest.approx(references.PLANE_MODULUS * line.half_width / (2.0 * RADIUS), rel=1e-9)
