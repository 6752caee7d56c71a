from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.machine.bearing import from_catalogue
from models.machine.hertz import (
    bearing_stiffness,
    contact_forces,
    element_angles,
    mean_bearing_stiffness,
    static_equilibrium,
)
from models.machine.load_distribution import (
    elements_in_zone,
    largest_element_load,
    load_distribution,
    load_integral,
    load_zone,
    ring_approach,
    stiffness_against_load,
    stiffness_over_passage,
)
from models.machine.scene import Defect
from tests.support.effort import effort_count

BEARING = from_catalogue("1205 ETN9")
ROLLER = from_catalogue("NU 202 ECP")
K_C = 5927e6
clearances = st.one_of(st.just(0.0), st.floats(-7.0, -4.0).map(lambda x: 10.0**x))


@given(st.floats(0.001, 0.5), st.sampled_from([1.5, 10.0 / 9.0]))
def test_load_integral_is_the_mean_over_the_ring(extent: float, exponent: float) -> None:
    count = effort_count(quick=100_000, full=400_000)
    psi = (np.arange(count) + 0.5) * (2.0 * math.pi / count) - math.pi
    share = np.maximum(1.0 - (1.0 - np.cos(psi)) / (2.0 * extent), 0.0) ** exponent * np.cos(psi)
    assert load_integral(extent, exponent) == pytest.approx(float(np.mean(share)), rel=1e-6)


@pytest.mark.parametrize("extent", [0.0, -0.1, 0.6, math.nan])
def test_load_integral_refuses_what_no_ring_has(extent: float) -> None:
    with pytest.raises(ValueError, match="load factor"):
        load_integral(extent, 1.5)


@given(st.floats(0.0, 5.0), clearances)
def test_smeared_elements_carry_the_load(log_load: float, clearance: float) -> None:
    load = 10.0**log_load
    approach = ring_approach(BEARING, load, K_C, clearance)
    count = effort_count(quick=50_000, full=200_000)
    psi = (np.arange(count) + 0.5) * (2.0 * math.pi / count) - math.pi
    delta = np.maximum(approach * np.cos(psi) - clearance, 0.0)
    assert 24 * float(np.mean(K_C * delta**1.5 * np.cos(psi))) == pytest.approx(load, rel=1e-4)
    largest = largest_element_load(BEARING, load, K_C, clearance)
    assert largest == pytest.approx(K_C * (approach - clearance) ** 1.5, rel=1e-12)


def test_many_elements_are_as_good_as_smeared_ones() -> None:
    # 24 staggered balls without clearance: sum and integral agree to a fraction of a percent.
    found = load_distribution(BEARING, 2000.0, K_C)
    assert found.loads.max() == pytest.approx(largest_element_load(BEARING, 2000.0, K_C), rel=1e-3)
    assert found.displacement[0] == pytest.approx(ring_approach(BEARING, 2000.0, K_C), rel=1e-3)


@pytest.mark.parametrize(("load", "clearance"), [(0.0, 0.0), (math.nan, 0.0), (1.0, -1e-6), (1.0, math.inf)])
def test_impossible_loads_are_refused(load: float, clearance: float) -> None:
    with pytest.raises(ValueError, match="must be finite and"):
        ring_approach(BEARING, load, K_C, clearance)


def test_load_zone() -> None:
    assert load_zone(1e-5) == pytest.approx(math.pi)
    assert load_zone(2e-5, 1e-5) == pytest.approx(2.0 * math.pi / 3.0)
    assert load_zone(1e-5, 1e-5) == 0.0
    assert [elements_in_zone(ROLLER, math.radians(x)) for x in (10.0, 66.0, 138.0)] == [1, 2, 3]


@given(st.floats(0.0, 4.5), clearances, st.floats(-7.0, 7.0))
def test_element_loads_balance(log_load: float, clearance: float, turn: float) -> None:
    load = 10.0**log_load
    for bearing in (BEARING, ROLLER):
        found = load_distribution(bearing, load, K_C, clearance=clearance, cage_angle=turn)
        assert np.all(np.abs(found.angles) <= math.pi * (1.0 + 1e-12))
        assert np.all(found.loads >= 0.0)
        assert float(found.loads @ np.cos(found.angles)) == pytest.approx(load, rel=1e-6)
        assert float(found.loads @ np.sin(found.angles)) == pytest.approx(0.0, abs=1e-6 * load)


def test_healthy_passage_is_the_stiffness_of_each_angle() -> None:
    found = stiffness_over_passage(BEARING, 1000.0, K_C, points=24)
    for turn, matrix in zip(found.cage_angle, found.matrix, strict=True):
        expected = bearing_stiffness(BEARING, 1000.0, K_C, cage_angle=float(turn))
        assert matrix == pytest.approx(expected, rel=1e-9, abs=1.0)
    # The stiffness across has a kink wherever a ball gains contact, so 24 points leave some of a mean over 64.
    assert found.mean == pytest.approx(mean_bearing_stiffness(BEARING, 1000.0, K_C), rel=3e-3, abs=1e3)
    # The rows are staggered by half a spacing, so the passage repeats after that.
    assert found.matrix[:12] == pytest.approx(found.matrix[12:], rel=1e-6, abs=1e3)


def test_a_ball_over_a_deep_defect_is_missing() -> None:
    defect = Defect(math.radians(8.0), 1e-3)
    found = stiffness_over_passage(BEARING, 1000.0, K_C, defect=defect, points=12)
    angles = element_angles(BEARING)[1:]
    u = static_equilibrium(angles, 1000.0, K_C)
    delta = np.maximum(u[0] * np.cos(angles) + u[1] * np.sin(angles), 0.0)
    k_yy = float(np.sum(1.5 * K_C * np.sqrt(delta) * np.cos(angles) ** 2))
    assert found.matrix[0, 0, 0] == pytest.approx(k_yy, rel=1e-6)
    assert found.swing[0] > 0.1
    assert found.largest_coupling > 0.0


def test_a_defect_without_depth_or_out_of_the_load_changes_nothing() -> None:
    healthy = stiffness_over_passage(BEARING, 1000.0, K_C, points=12).matrix
    for defect in (Defect(0.1, 0.0), Defect(0.0, 1e-5), Defect(0.1, 1e-4, position=math.pi)):
        damaged = stiffness_over_passage(BEARING, 1000.0, K_C, defect=defect, points=12).matrix
        assert damaged == pytest.approx(healthy, rel=1e-9, abs=1.0)


def test_both_rows_damaged_lose_twice() -> None:
    one = stiffness_over_passage(BEARING, 1000.0, K_C, defect=Defect(0.3, 5e-6), points=24)
    both = stiffness_over_passage(BEARING, 1000.0, K_C, defect=Defect(0.3, 5e-6, rows=2), points=24)
    assert both.mean[0, 0] < one.mean[0, 0]
    assert both.matrix[:12] == pytest.approx(both.matrix[12:], rel=1e-6, abs=1e3)


def test_a_roller_in_a_deep_pit_carries_nothing() -> None:
    passage = stiffness_over_passage(ROLLER, 1000.0, 3.7e8, defect=Defect(0.1, 1e-3), points=12)
    angles = element_angles(ROLLER)
    others = angles[np.abs(angles) > 0.1]
    assert len(others) == ROLLER.n_elements - 1
    u = static_equilibrium(others, 1000.0, 3.7e8, exponent=10.0 / 9.0)
    assert passage.matrix[0] == pytest.approx(contact_forces(u, others, 3.7e8, 0.0, 10.0 / 9.0)[1], rel=1e-6, abs=1e3)
    healthy = stiffness_over_passage(ROLLER, 1000.0, 3.7e8, points=12)
    assert passage.matrix[6] == pytest.approx(healthy.matrix[6], rel=1e-6, abs=1e3)


def test_defects_that_a_bearing_cannot_have_are_refused() -> None:
    for wrong in (Defect(0.1, 1e-5, rows=3), Defect(0.1, 1e-5, rows=2, first_row=1)):
        with pytest.raises(ValueError, match="has 2 rows"):
            stiffness_over_passage(BEARING, 1000.0, K_C, defect=wrong)
    with pytest.raises(ValueError, match=r"defect\.part must be 'outer'"):
        stiffness_over_passage(BEARING, 1000.0, K_C, defect=Defect(0.1, 1e-5, part="inner"))


def test_the_second_row_passes_half_a_spacing_later() -> None:
    first = stiffness_over_passage(BEARING, 1000.0, K_C, defect=Defect(0.3, 5e-6), points=24)
    second = stiffness_over_passage(BEARING, 1000.0, K_C, defect=Defect(0.3, 5e-6, first_row=1), points=24)
    assert np.roll(second.matrix, 12, axis=0) == pytest.approx(first.matrix, rel=1e-6, abs=1e3)


def test_stiffness_along_the_load_is_the_slope_of_load_and_displacement() -> None:
    """Eq. 28: k = dF / d delta, here by central differences; k_yy alone where the arrangement is symmetric."""
    angles = element_angles(ROLLER)
    step = 1e-4

    def displacement(load: float) -> float:
        return float(static_equilibrium(angles, load, 3.7e8, clearance=5e-6, exponent=10.0 / 9.0)[0])

    for load in (100.0, 1000.0):
        slope = 2.0 * step * load / (displacement(load * (1.0 + step)) - displacement(load * (1.0 - step)))
        k_yy = bearing_stiffness(ROLLER, load, 3.7e8, clearance=5e-6)[0, 0]
        assert k_yy == pytest.approx(slope, rel=1e-5)


def test_stiffness_against_load() -> None:
    loads = [250.0, 1000.0, 4000.0]
    displacement, stiffness = stiffness_against_load(BEARING, loads, K_C)
    # Without clearance the law is exact: delta ~ F^(2/3), k ~ F^(1/3).
    assert displacement[1:] / displacement[:-1] == pytest.approx([4.0 ** (2.0 / 3.0)] * 2, rel=1e-6)
    assert stiffness[1:, 0, 0] / stiffness[:-1, 0, 0] == pytest.approx([4.0 ** (1.0 / 3.0)] * 2, rel=1e-6)
    assert stiffness[1] == pytest.approx(mean_bearing_stiffness(BEARING, 1000.0, K_C), rel=1e-9, abs=1e3)
    _, loose = stiffness_against_load(BEARING, loads, K_C, clearance=1e-5)
    assert np.all(loose[:, 1, 1] < stiffness[:, 1, 1])
