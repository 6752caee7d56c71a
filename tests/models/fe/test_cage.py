"""A cage as spacer and as elastic body: against closed forms, reciprocity, and limits."""

import math
from dataclasses import replace

import numpy as np
import pytest

from models.fe.bearings.balance import PowerLaw
from models.fe.bearings.cage import (
    CageCoupling,
    caged_state,
    drawn_angles,
    even_angles,
    plane_bulge,
    spaced_state,
    spacing_bound,
    squeeze_law,
)
from models.fe.bearings.cage_mesh import CageGeometry, cage_opening, roller_bulge
from models.fe.extra import has_extra
from models.fe.meshes.geometry import fe_geometry
from models.fe.meshes.sizing import MeshRule
from models.machine.bearing import catalogue_entry
from models.machine.hertz import bearing_stiffness, contact_stiffness
from tests.oracles.plane_roller import plane_check

ENTRY = catalogue_entry("NU 202 ECP")
LOAD_ON_ROLLER = 3706.0
K_C = contact_stiffness(ENTRY.bearing)
LAW = PowerLaw(K_C, 10 / 9)
STEEL = (210e9, 0.3)
CAGE = CageGeometry(11, 12.4e-3, 2.75e-3, 11.3e-3, 13.5e-3, 6.2e-3, 10e-3)
SQUEEZE = squeeze_law(2.75e-3, 5.6e-3, *STEEL, 0.55e-3, highest=2000.0)
BULGE = plane_bulge(5.6e-3, *STEEL)
needs_extra = pytest.mark.skipif(not has_extra(), reason="needs the extra fe (scikit-fem)")


def coupling(stiffening: float = 1.0, play: float = 0.0) -> CageCoupling:
    """Bars that bend between their neighbours: a pocket that opens closes both."""
    index = np.arange(11)
    near = np.abs((index[:, None] - index + 5) % 11 - 5)
    opening = np.where(near == 0, 3.5e-8, np.where(near == 1, -1.2e-8, 0.0)) / stiffening
    return CageCoupling(BULGE, SQUEEZE, opening, play)


def test_even_spacing_is_the_analytic_bearing_and_uneven_stays_within_its_bound() -> None:
    angles = even_angles(11, 0.1)
    expected = bearing_stiffness(ENTRY.bearing, 1000.0, K_C, cage_angle=0.1)
    even = spaced_state(LAW, angles, 1000.0).stiffness
    np.testing.assert_allclose(even, expected, rtol=1e-6, atol=1e-6 * expected.max())
    play, pitch = 2e-5, 12.4e-3
    bound = spacing_bound(LAW, angles, 1000.0, 0.5 * play / pitch)
    rng = np.random.default_rng(5)
    for _ in range(5):
        drawn = drawn_angles(11, play, pitch, rng, 0.1)
        assert 0.0 < np.abs(drawn - angles).max() <= 0.5 * play / pitch
        moved = spaced_state(LAW, drawn, 1000.0).stiffness
        assert np.all(np.abs(np.diagonal(moved) / np.diagonal(even) - 1.0) <= 1.05 * bound)
    np.testing.assert_array_equal(drawn_angles(11, 0.0, pitch, rng, 0.1), angles)


def test_stiffness_with_a_cage_is_the_derivative_of_the_load() -> None:
    angles, loads = even_angles(11), np.array([999.0, 1000.0, 1001.0])
    states = [caged_state(LAW, coupling(), angles, float(load)) for load in loads]
    moved = [state.balance.displacement[0] for state in states]
    assert states[1].balance.stiffness[0, 0] == pytest.approx(2.0 / (moved[2] - moved[0]), rel=1e-5)
    assert states[1].change <= 1e-10


def test_a_cage_stiffens_more_the_less_it_yields_and_not_at_all_with_play() -> None:
    angles = even_angles(11)
    free = spaced_state(LAW, angles, 5000.0)
    found = [caged_state(LAW, coupling(s), angles, 5000.0) for s in (1.0, 10.0, 1e6)]
    gains = [state.balance.stiffness[0, 0] / free.stiffness[0, 0] - 1.0 for state in found]
    assert 0.0 < gains[0] < gains[1] < gains[2] < 0.01
    # Bars of loaded rollers push those of unloaded neighbours: more bars carry than rollers.
    assert int(np.sum(found[0].bars > 0.0)) > int(np.sum(free.forces > 0.0))
    loose = caged_state(LAW, coupling(play=1.01 * BULGE * float(free.forces.max())), angles, 5000.0)
    assert not loose.bars.any()
    np.testing.assert_array_equal(loose.balance.stiffness, free.stiffness)


def test_squeeze_grows_with_the_force_and_softens_with_the_strip() -> None:
    radius, length, strip = 2.75e-3, 5.6e-3, 0.55e-3
    force = np.array([20.0])
    modulus = STEEL[0] / (1 - STEEL[1] ** 2)
    b = math.sqrt(8 * radius * 20.0 / (math.pi * length * modulus))
    share = 2 * 20.0 / (math.pi * modulus * length)
    expected = share * (2 * math.log(4 * radius / b) - 1 + 2 * math.log(4 * strip / b) - 2)
    assert SQUEEZE.approach_of(force)[0] == pytest.approx(expected, rel=1e-4)
    wider = squeeze_law(radius, length, *STEEL, 2 * strip, highest=2000.0)
    assert wider.approach_of(force)[0] - expected == pytest.approx(2 * share * math.log(2), rel=1e-3)
    rigid = squeeze_law(radius, length, *STEEL, None, highest=2000.0)
    assert rigid.approach_of(force)[0] == pytest.approx(
        share * (2 * math.log(4 * radius / (b / math.sqrt(2))) - 1), rel=1e-4
    )
    with pytest.raises(ValueError, match="must exceed the half width"):
        squeeze_law(radius, length, *STEEL, 0.05e-3, highest=2000.0)


@needs_extra
def test_bulge_of_a_roller_between_rigid_ends_is_that_of_the_plane() -> None:
    geometry = replace(fe_geometry(ENTRY), roller_length=5.6e-3)
    rule = MeshRule(patch=1.6, size=0.8, growth=2.5, along=2)
    found, unknowns = roller_bulge(geometry, 200.0, rule, plane=True)
    assert unknowns < 4000
    assert found == pytest.approx(BULGE, rel=0.03)


@needs_extra
def test_pockets_open_symmetrically_and_by_more_than_their_neighbours_close() -> None:
    opening = cage_opening(CAGE, 5.6e-3)
    assert opening.by_distance[0] > 0.0 > opening.by_distance[1]
    np.testing.assert_allclose(opening.by_distance[1:], opening.by_distance[:0:-1])
    matrix = opening.matrix()
    np.testing.assert_allclose(matrix, matrix.T)
    assert np.linalg.eigvalsh(matrix)[0] > 0.0
    # A bar is a beam of 6.2 mm between the side rings: it bends by micrometres under 100 N.
    assert 1e-8 < opening.by_distance[0] < 1e-7


def test_what_is_no_cage_is_refused() -> None:
    with pytest.raises(ValueError, match="leaves no bar"):
        replace(CAGE, roller_radius=3.5e-3)
    with pytest.raises(ValueError, match="pocket_length must be below width"):
        replace(CAGE, width=6e-3)
    with pytest.raises(ValueError, match="pitch_radius must lie between"):
        replace(CAGE, pitch_radius=14e-3)
    with pytest.raises(ValueError, match="length must be positive"):
        cage_opening(CAGE, 7e-3)
    with pytest.raises(ValueError, match="expected 5 pockets"):
        caged_state(LAW, coupling(), even_angles(5), 1000.0)
    with pytest.raises(ValueError, match="opening must be symmetric"):
        CageCoupling(BULGE, SQUEEZE, np.array([[1.0, 0.0, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 1.0]]))
    with pytest.raises(ValueError, match="play must be finite"):
        drawn_angles(11, -1e-6, 12e-3, np.random.default_rng(0))


@needs_extra
def test_model_of_the_bars_agrees_with_both_contacts_of_one_disc() -> None:
    row = plane_check(LOAD_ON_ROLLER, 5, 2)
    assert row["bars_by_load"] == pytest.approx(row["model_bars_by_load"], rel=0.01)
    assert row["less_approach_percent"] == pytest.approx(row["model_less_approach_percent"], rel=0.01)
