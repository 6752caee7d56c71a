import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.fe.bearings.law import ElementLaw, LawError, LawTable


def hertz_and_ring(loads: np.ndarray) -> np.ndarray:
    """Approach of a ball, m, with a share that grows with the force itself."""
    return 1.7e-8 * loads ** (2.0 / 3.0) + 2e-10 * loads


def test_a_power_law_is_reproduced_at_any_load():
    law = ElementLaw.from_power(8e9, 1.5, 10.0, 1e4)
    approach = np.geomspace(1e-8, 1e-3, 41)
    force, slope = law.force(approach)
    np.testing.assert_allclose(force, 8e9 * approach**1.5, rtol=1e-12)
    np.testing.assert_allclose(slope, 1.5 * 8e9 * approach**0.5, rtol=1e-12)
    assert law.mesh_error == 0.0


def test_nothing_presses_without_approach():
    force, slope = ElementLaw.from_power(8e9, 1.5, 10.0, 1e4).force(np.array([-1e-5, 0.0]))
    assert force.tolist() == slope.tolist() == [0.0, 0.0]


def test_a_smooth_law_is_met_between_its_loads_and_continued_below_them():
    loads = np.geomspace(10.0, 1e4, 13)
    law = ElementLaw(loads, hertz_and_ring(loads))
    inside = np.geomspace(10.0, 1e4, 100)
    np.testing.assert_allclose(law.approach_of(inside), hertz_and_ring(inside), rtol=2e-6)
    below = np.geomspace(1.0, 10.0, 20)
    np.testing.assert_allclose(law.approach_of(below), hertz_and_ring(below), rtol=6e-3)


@given(st.floats(1e-3, 1e6), st.floats(0.0, 1e-9))
def test_force_and_approach_invert_each_other_and_rise(load: float, ring: float):
    loads = np.geomspace(10.0, 1e4, 7)
    law = ElementLaw(loads, 1.7e-8 * loads ** (2.0 / 3.0) + ring * loads)
    approach = law.approach_of(np.array([load, 1.001 * load]))
    force, slope = law.force(approach)
    np.testing.assert_allclose(force, [load, 1.001 * load], rtol=1e-10)
    assert approach[1] > approach[0]
    assert slope[0] == pytest.approx(np.diff(force)[0] / np.diff(approach)[0], rel=2e-3)


def test_the_slope_is_continuous_at_both_ends_of_the_tables():
    loads = np.geomspace(10.0, 1e4, 7)
    approach = hertz_and_ring(loads)
    law = ElementLaw(loads, approach)
    for end in (approach[0], approach[-1]):
        slope = law.force(end * np.array([1.0 - 1e-9, 1.0 + 1e-9]))[1]
        assert slope[0] == pytest.approx(slope[1], rel=1e-7)


def test_the_largest_difference_of_two_meshes_is_the_error_of_the_mesh():
    first, second = np.geomspace(10.0, 200.0, 5), np.geomspace(100.0, 2000.0, 5)
    fine = LawTable(first, hertz_and_ring(first), 50.0)
    off = LawTable(second, 1.01 * hertz_and_ring(second), 500.0)
    law = ElementLaw.from_tables([fine, off])
    assert law.mesh_error == pytest.approx(0.01, rel=1e-2)
    middle = np.array([math.sqrt(100.0 * 200.0)])
    assert law.approach_of(middle)[0] == pytest.approx(1.005 * hertz_and_ring(middle)[0], rel=2e-3)
    assert (law.lowest, law.highest) == (10.0, 2000.0)


def test_the_waves_of_a_mesh_are_no_part_of_the_law_but_of_its_error():
    tables = list[LawTable]()
    for made_for in (50.0, 250.0, 1250.0):
        loads = made_for * np.geomspace(0.2, 1.3, 8)
        waves = 1.0 + 1e-3 * np.cos(np.arange(8) * math.pi)
        tables.append(LawTable(loads, hertz_and_ring(loads) * waves, made_for))
    law = ElementLaw.from_tables(tables)
    assert 1e-3 < law.mesh_error < 3e-3
    approach = hertz_and_ring(np.array([99.0, 100.0, 101.0]))
    slope = 2.0 / (approach[2] - approach[0])
    assert law.force(approach[1:2])[1][0] == pytest.approx(slope, rel=2e-3)


def test_tables_that_share_one_load_are_compared_there():
    first, second = np.geomspace(10.0, 100.0, 4), np.geomspace(100.0, 1000.0, 4)
    tables = [LawTable(first, hertz_and_ring(first), 50.0), LawTable(second, 1.002 * hertz_and_ring(second), 500.0)]
    assert ElementLaw.from_tables(tables).mesh_error == pytest.approx(0.002, rel=0.01)


@pytest.mark.parametrize("second", [None, np.geomspace(300.0, 1000.0, 4)])
def test_the_error_of_the_mesh_is_unknown_where_no_two_meshes_meet(second: np.ndarray | None):
    first = np.geomspace(10.0, 100.0, 4)
    tables = [LawTable(first, hertz_and_ring(first), 50.0)]
    if second is not None:
        tables.append(LawTable(second, hertz_and_ring(second), 500.0))
    assert math.isnan(ElementLaw.from_tables(tables).mesh_error)


def test_a_law_is_valid_up_to_its_highest_load():
    law = ElementLaw.from_power(8e9, 1.5, 10.0, 1e4)
    assert law.covers(1e-6)
    assert law.covers(1e4)
    assert not law.covers(1.001e4)


@pytest.mark.parametrize(
    ("loads", "approach", "message"),
    [
        ([10.0], [1e-6], "two or more"),
        ([10.0, 20.0], [1e-6, 2e-6, 3e-6], "as many approaches"),
        ([20.0, 10.0], [1e-6, 2e-6], "loads that are finite, positive and strictly ascending"),
        ([10.0, 20.0], [2e-6, 1e-6], "approach that are finite"),
        ([10.0, math.nan], [1e-6, 2e-6], "loads that are finite"),
        ([10.0, 20.0], [1e-6, 9e-6], "local exponent"),
        ([10.0, 20.0], [1e-6, 1.1e-6], "local exponent"),
    ],
)
def test_what_is_no_law_is_refused(loads: list[float], approach: list[float], message: str):
    with pytest.raises(LawError, match=message):
        ElementLaw(np.array(loads), np.array(approach))


def test_tables_out_of_order_are_refused():
    wide, narrow = np.geomspace(10.0, 1000.0, 4), np.geomspace(50.0, 500.0, 4)
    tables = [LawTable(wide, hertz_and_ring(wide), 100.0), LawTable(narrow, hertz_and_ring(narrow), 100.0)]
    with pytest.raises(LawError, match="ascending order"):
        ElementLaw.from_tables(tables)
    with pytest.raises(LawError, match="one table"):
        ElementLaw.from_tables([])
