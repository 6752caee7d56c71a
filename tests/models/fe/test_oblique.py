"""Two oblique rows of balls: against the radial statics, against balls with grooves, and the refusals."""

import math
from dataclasses import replace

import numpy as np
import pytest

from models.fe.bearings.balance import condensed
from models.fe.bearings.law import ElementLaw
from models.fe.bearings.oblique import ObliqueError, oblique_geometry
from models.fe.bearings.self_aligning import Axial, RowInfluence, SelfAligning
from models.machine import ball_statics, hertz
from models.machine.bearing import Bearing, catalogue_entry
from models.machine.load_distribution import stiffness_over_passage

K_C = 5410.29e6
ENTRY = catalogue_entry("1205 ETN9")
GEOMETRY = oblique_geometry(ENTRY)
LAW = ElementLaw.from_power(K_C, 1.5, 1e-3, 1e9)


NONE = RowInfluence.none(12)


def rigid(angle: float = GEOMETRY.contact_angle, axial: Axial = "free") -> SelfAligning:
    return SelfAligning(LAW, 12, angle, NONE, axial=axial)


def test_without_a_contact_angle_it_is_the_radial_bearing() -> None:
    ours = rigid(0.0).stiffness_over_passage(2000.0, points=8)
    theirs = stiffness_over_passage(ENTRY.bearing, 2000.0, K_C, points=8)
    np.testing.assert_allclose(ours.cage_angle, theirs.cage_angle)
    np.testing.assert_allclose(ours.matrix, theirs.matrix, rtol=1e-6, atol=1.0)


def test_swing_of_the_self_aligning_bearing() -> None:
    held = rigid(axial="held").stiffness_over_passage(1000.0, points=24)
    # The angle takes the power 5/3 of its cosine from the stiffness and leaves the swing: 7.55 and 0.0134 %.
    radial = rigid(0.0).stiffness_over_passage(1000.0, points=24)
    np.testing.assert_allclose(
        held.mean[0, 0] / radial.mean[0, 0], math.cos(GEOMETRY.contact_angle) ** (5 / 3), rtol=1e-6
    )
    np.testing.assert_allclose(held.swing, radial.swing, rtol=1e-5)
    assert held.swing[1] == pytest.approx(0.0755, abs=2e-4)
    assert held.swing[0] == pytest.approx(1.34e-4, rel=0.05)


def test_free_axial_place_softens_and_leaves_no_axial_force() -> None:
    bearing = rigid()
    free, held = bearing.balance(1000.0, 0.03), rigid(axial="held").balance(1000.0, 0.03)
    assert free.displacement.shape == (3,)
    assert held.displacement.shape == (2,)
    assert abs(free.displacement[2]) > 1e-9
    assert abs(float(free.forces @ bearing.normals(0.03)[:, 2])) < 1e-6
    assert bearing.state(1000.0, cage_angle=0.03).stiffness[0, 0] <= held.stiffness[0, 0] * (1 + 1e-9)


def test_one_row_agrees_with_balls_in_grooves() -> None:
    # ball_statics solves the balls' places and angles; a sphere is a groove whose centre lies on the axis.
    g = GEOMETRY
    bearing = Bearing(
        "row", g.n_elements, 2 * g.ball_radius, 2 * g.centre_distance, contact_angle=g.contact_angle,
        inner_groove_radius=g.groove_radius, outer_groove_radius=g.sphere_radius,
    )  # fmt: skip
    statics = ball_statics.BallStatics(bearing)
    distance = statics.groove_distance / math.cos(statics.free_angle)
    start = np.array([0.0, 0.0, distance * math.sin(statics.free_angle), 0.0, 0.0])
    push = np.array([6e-6, 2e-6, 3e-6, 0.0, 0.0])
    theirs = ball_statics.ring_state(statics, start + push, centrifugal=0.0)
    races = statics.races()
    law = ElementLaw.from_power(hertz.in_series(races.k_i, races.k_o, 1.5), 1.5, 1e-3, 1e9)
    normals = rigid().normals()[: g.n_elements]
    forces, tangent = law.force(normals @ push[:3])
    np.testing.assert_allclose(forces, theirs.inner_force, rtol=0.02, atol=0.02 * forces.max())
    stiffness = (normals.T * tangent) @ normals
    np.testing.assert_allclose(stiffness, theirs.tangent[:3, :3], rtol=0.02, atol=0.02 * stiffness.max())
    # No moment about the sphere's centre, so none holds the tilt.
    tilt = np.linalg.eigvalsh(theirs.tangent)
    assert tilt[0] < 1e-2 * tilt[-1]


def test_influence_depends_on_the_angle_between_elements_only() -> None:
    angles = rigid().angles()
    spacing = 2 * math.pi / 12
    same = 1e-10 * np.cos(spacing * np.arange(12))
    other = 3e-10 * np.cos(spacing * (np.arange(12) + 0.5))
    matrix = RowInfluence(same, other).matrix()
    strength = np.kron(np.array([[1.0, 3.0], [3.0, 1.0]]), np.ones((12, 12)))
    expected = 1e-10 * strength * np.cos(angles[:, None] - angles[None, :])
    np.fill_diagonal(expected, 0.0)
    np.testing.assert_allclose(matrix, expected, atol=1e-22)
    bearing = SelfAligning(LAW, 12, GEOMETRY.contact_angle, RowInfluence(same, other), axial="free")
    np.testing.assert_allclose(condensed(bearing.balance(500.0).stiffness, 2), bearing.state(500.0).stiffness)


def test_geometry_of_the_1205() -> None:
    g = GEOMETRY
    assert g.centre_distance == pytest.approx(19.35e-3)
    assert g.inner_contact_distance == pytest.approx(15.79e-3)
    # The outer contact is round; the lands lie within the groove.
    assert g.relative_radii[1][0] == g.relative_radii[1][1]
    assert (g.bore_radius, g.outside_radius, g.width) == pytest.approx((12.5e-3, 26e-3, 15e-3))
    k_i, k_o = (hertz.point_contact_stiffness(*radii, "elliptic") for radii in g.relative_radii)
    k_c = hertz.in_series(k_i, k_o, 1.5)
    # The printed 16.64 mm in the place of 15.79 mm make 0.2 % of the stiffness.
    assert k_c == pytest.approx(K_C, rel=5e-3)


@pytest.mark.parametrize(
    ("designation", "reason"),
    [
        ("6210", "contact angle is zero"),
        ("30206", "lean on a flange"),
        ("22207", "profile of its barrel rollers"),
        ("7208", "needs an axial load"),
        ("2205", "outer_race_radius is unknown"),
    ],
)
def test_other_bearings_are_refused_with_the_reason(designation: str, reason: str) -> None:
    with pytest.raises(ObliqueError, match=f"^{designation}.*{reason}"):
        oblique_geometry(catalogue_entry(designation))


def test_what_does_not_fit_is_refused() -> None:
    bearing = ENTRY.bearing
    with pytest.raises(ObliqueError, match=r"no sphere.*22\.91 mm.*7 mm"):
        oblique_geometry(replace(ENTRY, bearing=replace(bearing, outer_groove_radius=7e-3)))
    with pytest.raises(ObliqueError, match="groove_radius must exceed ball_radius"):
        oblique_geometry(replace(ENTRY, bearing=replace(bearing, inner_groove_radius=3e-3)))
    with pytest.raises(ObliqueError, match="inner_groove_radius is unknown"):
        oblique_geometry(replace(ENTRY, bearing=replace(bearing, inner_groove_radius=None)))
    with pytest.raises(ObliqueError, match="bore, outside diameter and width"):
        oblique_geometry(replace(ENTRY, dimensions=None))
    with pytest.raises(ValueError, match="land_radius must lie within"):
        replace(GEOMETRY, land_radius=30e-3)
    with pytest.raises(ValueError, match="influence must have 12 values"):
        SelfAligning(LAW, 12, 0.1, RowInfluence.none(11))
    with pytest.raises(ValueError, match="load must be finite and positive"):
        rigid().state(0.0)
    with pytest.raises(ValueError, match="axial must be one of"):
        rigid(axial="loose")  # type: ignore[arg-type]
