"""The mesh of a casing: volumes, areas, boundaries, and what it refuses."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from models.fe.casing.mesh import casing_mesh
from models.fe.casing.model import radiating_surface
from models.fe.casing.shape import STEEL, CasingMeshRule, CasingShape, Foot, Material, Seat
from models.fe.solid.traction import boundary_points
from models.gears.sound.surface import Surface
from tests.models.fe.casing.casings import box, box_shape

pytest.importorskip("skfem", reason="needs the extra fe")


# The bores of this mesh have eight cells around.
def test_mass_and_bores_are_those_of_the_drawing() -> None:
    casing = box()
    outside, inside = 0.2 * 0.16 * 0.12, 0.18 * 0.14 * 0.10
    bosses = 2 * 0.02 * math.pi / 4 * (0.06**2 - 0.04**2)
    bores = 2 * 0.006 * math.pi / 4 * 0.04**2
    assert casing.total_mass == pytest.approx(STEEL.density * (outside - inside + bosses - bores), rel=1e-3)
    for name in ("seat1", "seat2"):
        points = boundary_points(casing.body, name)
        assert points.weights.sum() == pytest.approx(math.pi * 0.04 * 0.026, rel=6e-3)
        radius = np.hypot(points.places[0] - 0.1, points.places[1] - 0.08)
        assert np.abs(radius - 0.02).max() < 2e-4


def test_cells_are_upright_and_named() -> None:
    mesh: Any = casing_mesh(box_shape(), CasingMeshRule(0.06, through=2))
    assert {"x0", "x1", "y0", "y1", "z0", "z1", "seat1", "seat2", "foot1", "foot2"} == set(mesh.boundaries)
    walls = np.unique(np.round(mesh.doflocs[2], 9))
    assert np.isin([0.0, 0.01, 0.11, 0.12], walls).all()


@pytest.mark.parametrize("rule", [CasingMeshRule(0.1), CasingMeshRule(0.03)])
def test_seats_of_different_sizes_share_an_axis(rule: CasingMeshRule) -> None:
    seats = (
        Seat("left", "z0", (0.1, 0.08), 0.02, 0.05, 0.01),
        Seat("right", "z1", (0.1, 0.08), 0.03, 0.06, 0.0, 0.002),
    )
    mesh = casing_mesh(CasingShape.box((0.2, 0.16, 0.1), 0.01, seats), rule)
    assert len(mesh.boundaries["left"])
    assert len(mesh.boundaries["right"])


def test_the_outside_is_closed_over_its_plane() -> None:
    casing = box()
    surface = radiating_surface(casing)
    corners = surface.corners[surface.elements]
    area = 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    # The sum of the area vectors of a closed surface is zero; the underside is missing.
    np.testing.assert_allclose(area.sum(axis=0), [0.0, 0.0, 0.2 * 0.12], atol=1e-12)
    # The divergence theorem: anticlockwise from outside.
    assert np.einsum("ei,ei->", area, corners.mean(axis=1)) / 3.0 == pytest.approx(0.2 * 0.16 * 0.12)
    edges = np.sort(np.stack((surface.elements, np.roll(surface.elements, -1, axis=1)), axis=-1).reshape(-1, 2), axis=1)
    single, count = np.unique(edges, axis=0, return_counts=True)
    assert set(count) == {1, 2}
    assert np.abs(surface.corners[single[count == 1]][:, :, 2]).max() == 0.0


def test_the_outside_is_a_surface_that_radiates() -> None:
    casing = box()
    surface = radiating_surface(casing)
    sides = 2.0 * (0.16 * 0.12 + 0.2 * 0.16) + 0.2 * 0.12
    assert Surface(surface.corners, surface.elements, over_plane=True).area.sum() == pytest.approx(sides)


def test_a_motion_as_a_whole_moves_elements_by_their_normals() -> None:
    casing = box()
    surface = radiating_surface(casing)
    for axis, turned in enumerate(([1, 0, 0], [0, 0, 1], [0, -1, 0])):
        motion = np.zeros((casing.body.nodes.shape[1], 3))
        motion[:, axis] = 1.0
        # In the unknowns; held nodes cannot move, so that only elements away from the feet count.
        q = _unknowns(casing, motion.ravel())
        found = np.array([column @ q for column in surface.columns.values()])
        corners = surface.corners[surface.elements]
        area = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        normal = area / np.linalg.norm(area, axis=1, keepdims=True)
        away = corners[:, :, 2].min(axis=1) > 1e-9
        assert np.count_nonzero(away) > 20
        np.testing.assert_allclose(found[away], (normal @ turned)[away], atol=1e-9)


def _unknowns(casing: Any, motion: np.ndarray) -> np.ndarray:
    """Unknowns whose displacement is nearest to a motion: exact where nothing is held."""
    t = casing.transform
    return np.asarray(spsolve((t.T @ t).tocsc(), t.T @ motion))


SEAT = Seat("a", "z0", (0.1, 0.08), 0.04, 0.06)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seats": (SEAT, SEAT)}, "seats must have different names"),
        ({"seats": (SEAT, Seat("b", "z0", (0.15, 0.08), 0.02, 0.06))}, "boss needs 0.0315 m in x or y .* are 0.025 m"),
        ({"seats": (Seat("b", "z0", (0.03, 0.08), 0.02, 0.06),)}, "seat 'b': its boss needs"),
        ({"seats": (Seat("b", "z0", (0.1, 0.08), 0.02, 0.06, 0.11),)}, "boss_length 0.11 m has no room"),
        ({"seats": (Seat("b", "z1", (0.1, 0.08), 0.02, 0.06, cover=0.01),)}, "cover must be thinner than the wall"),
        ({"walls": {"y0": 0.01}, "seats": (SEAT,)}, "seat 'a': the casing has no wall z0"),
        ({"walls": {}}, "one wall at least"),
        ({"walls": {"up": 0.01}}, "side of a wall must be one of"),
        ({"walls": {"z0": 0.2}}, "wall z0 must be above 0 and up to 0.12"),
        ({"walls": {"z0": 0.08, "z1": 0.08}}, "walls z0 and z1 are 0.16 m thick together"),
        ({"feet": (Foot((0.1, 0.05), (0.0, 0.1)),)}, "foot: x must ascend within 0 to 0.2 m"),
        ({"length": -1.0}, "casing.length must be positive"),
    ],
)
def test_shapes_that_cannot_be_are_named(change: dict[str, Any], message: str) -> None:
    fields: dict[str, Any] = {
        "length": 0.2, "height": 0.16, "depth": 0.12, "walls": dict.fromkeys(("x0", "y0", "z0", "z1"), 0.01)
    }  # fmt: skip
    with pytest.raises(ValueError, match=message):
        CasingShape(**(fields | change))


def test_seats_materials_and_rules_that_cannot_be_are_named() -> None:
    with pytest.raises(ValueError, match=r"seat 'a': boss must be wider than the bore of 0.04 m"):
        Seat("a", "z0", (0.0, 0.0), 0.04, 0.03)
    with pytest.raises(ValueError, match=r"without a point and no side, got 'a.b'"):
        Seat("a.b", "z0", (0.0, 0.0), 0.04, 0.05)
    with pytest.raises(ValueError, match="seat 'a': spider must be one of 'rigid', 'mean'"):
        Seat("a", "z0", (0.0, 0.0), 0.04, 0.05, spider="soft")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"material.poisson"):
        Material(1e9, 0.5, 1000.0)
    with pytest.raises(ValueError, match=r"rule.through must be a whole number"):
        CasingMeshRule(0.1, 0)
