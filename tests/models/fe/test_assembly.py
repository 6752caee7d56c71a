"""The assembled bearing with laws and influences that are written down; those of meshes have tests of their own."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.fe.bearings import assembly, balance
from models.fe.bearings.assembly import AssembledBearing
from models.fe.bearings.law import ElementLaw
from models.fe.bearings.rings import BoreLoad, RingInfluence
from models.machine.bearing import from_catalogue
from models.machine.hertz import bearing_stiffness, contact_exponent, contact_stiffness
from models.machine.load_distribution import load_distribution, stiffness_against_load, stiffness_over_passage
from models.words.errors import WrongInputError

ANGLE = np.linspace(0.0, math.pi, 25)


def hertzian(designation: str, clearance: float) -> AssembledBearing:
    bearing = from_catalogue(designation)
    law = ElementLaw.from_power(contact_stiffness(bearing), contact_exponent(bearing), 1.0, 1e5)
    return AssembledBearing(law, bearing.n_elements, clearance)


def flexible(*, clearance: float = 0.0, bore_load: bool = False, highest: float = 1e5) -> AssembledBearing:
    """Return a bearing whose rings bend as a thin ring does in kind: with the second harmonic."""
    law = ElementLaw.from_power(8e9, 1.5, 1.0, highest)
    outer = RingInfluence(ANGLE, 4e-10 * np.cos(2.0 * ANGLE) + 1e-10 * np.exp(-ANGLE))
    inner = RingInfluence(ANGLE, 2e-10 * np.cos(2.0 * ANGLE), own=3e-10, support="sinusoidal")
    bore = BoreLoad(ANGLE, -2e-10 * np.cos(2.0 * ANGLE), 5e-11, -1e-10 * (1.0 + np.cos(ANGLE)))
    return AssembledBearing(law, 10, clearance, inner, outer, bore if bore_load else None)


@pytest.mark.parametrize("designation", ["6210", "NU 202 ECP"])
@pytest.mark.parametrize("clearance", [0.0, 2e-5])
@pytest.mark.parametrize(("load", "turn"), [(50.0, 0.0), (5000.0, 0.07), (5000.0, 0.5)])
def test_rings_that_do_not_yield_give_the_analytic_bearing(
    designation: str, clearance: float, load: float, turn: float
):
    bearing, k_c = from_catalogue(designation), contact_stiffness(from_catalogue(designation))
    turn *= 2.0 * math.pi / bearing.n_elements
    state = hertzian(designation, clearance).state(load, cage_angle=turn)
    expected = load_distribution(bearing, load, k_c, clearance=clearance, cage_angle=turn)
    assert state.converged
    np.testing.assert_allclose(state.displacement, expected.displacement, atol=1e-9 * expected.displacement[0])
    np.testing.assert_allclose(state.loads, expected.loads, atol=1e-9 * load)
    np.testing.assert_allclose(state.angles, expected.angles, atol=1e-12)
    stiffness = bearing_stiffness(bearing, load, k_c, clearance=clearance, cage_angle=turn)
    np.testing.assert_allclose(state.stiffness, stiffness, atol=1e-6 * stiffness[0, 0])


def test_a_passage_and_a_series_of_loads_are_the_analytic_ones():
    bearing, k_c = from_catalogue("6210"), contact_stiffness(from_catalogue("6210"))
    found = hertzian("6210", 1e-5)
    passage = found.stiffness_over_passage(2000.0, points=12)
    expected = stiffness_over_passage(bearing, 2000.0, k_c, clearance=1e-5, points=12)
    assert passage.converged
    np.testing.assert_allclose(passage.cage_angle, expected.cage_angle)
    np.testing.assert_allclose(passage.matrix, expected.matrix, atol=1e-6 * expected.mean[0, 0])
    np.testing.assert_allclose(passage.swing, expected.swing, rtol=1e-5)
    displacement, stiffness = found.stiffness_against_load([500.0, 2000.0], points=8)
    wanted = stiffness_against_load(bearing, [500.0, 2000.0], k_c, clearance=1e-5, points=8)
    np.testing.assert_allclose(displacement, wanted[0], rtol=1e-8)
    np.testing.assert_allclose(stiffness, wanted[1], atol=1e-6 * wanted[1].max())
    np.testing.assert_allclose(found.load_distribution(500.0).loads, found.state(500.0).loads)


def test_linear_contacts_on_rings_that_yield_solve_the_linear_complementarity():
    # Exponent one: the loads follow from the one set of elements in contact that fits, found by trying all.
    k, load, clearance = 3e8, 4000.0, 5e-6
    outer = RingInfluence(ANGLE, 6e-10 * np.cos(2.0 * ANGLE), own=1e-9)
    found = AssembledBearing(ElementLaw.from_power(k, 1.0, 1.0, 1e5), 7, clearance, None, outer)
    state = found.state(load, cage_angle=0.2)
    angles = found.angles(0.2)
    normals = np.stack((np.cos(angles), np.sin(angles)))
    compliance = outer.matrix(angles) + np.eye(7) / k
    fitting = list[np.ndarray]()
    for count in range(2, 8):
        for chosen in map(list, itertools.combinations(range(7), count)):
            block = np.zeros((count + 2, count + 2))
            block[:count, :count] = compliance[np.ix_(chosen, chosen)]
            block[:count, count:], block[count:, :count] = -normals[:, chosen].T, normals[:, chosen]
            solution = np.linalg.solve(block, np.concatenate((np.full(count, -clearance), [load, 0.0])))
            forces, u = np.zeros(7), solution[count:]
            forces[chosen] = solution[:count]
            if forces.min() >= 0.0 and np.max(u @ normals - clearance - compliance @ forces) <= 1e-12:
                fitting.append(forces)
    assert len(fitting) == 1
    assert state.converged
    np.testing.assert_allclose(state.loads, fitting[0], atol=1e-7 * load)


@pytest.mark.parametrize("bore_load", [False, True])
@given(turn=st.floats(0.0, 0.6), load=st.floats(100.0, 20000.0), clearance=st.floats(-5e-6, 2e-5))
def test_equilibrium_holds_and_the_stiffness_is_the_derivative(
    bore_load: bool, turn: float, load: float, clearance: float
):
    bearing = flexible(bore_load=bore_load, clearance=clearance)
    state = bearing.state(load, cage_angle=turn)
    assert state.converged
    normals = np.stack((np.cos(state.angles), np.sin(state.angles)))
    np.testing.assert_allclose(normals @ state.loads, [load, 0.0], atol=1e-8 * load)
    step = 1e-4 * load
    low, high = (bearing.state(load + sign * step, cage_angle=turn, start=state) for sign in (-1.0, 1.0))
    change = (high.displacement - low.displacement) / (2.0 * step)
    np.testing.assert_allclose(state.stiffness @ change, [1.0, 0.0], atol=2e-3)
    slope = 2.0 * step / (high.bore_line - low.bore_line)
    assert state.bore_line_stiffness == pytest.approx(slope, rel=2e-3)


@pytest.mark.parametrize("bore_load", [False, True])
def test_the_stiffness_across_is_that_of_a_load_that_turns(bore_load: bool):
    # Turning the load by an angle is turning the cage the other way, and all displacements with the load.
    bearing, load, turn, small = flexible(bore_load=bore_load, clearance=3e-6), 3000.0, 0.21, 1e-4
    state = bearing.state(load, cage_angle=turn)
    changes = list[np.ndarray]()
    for sign in (-1.0, 1.0):
        c, s = math.cos(sign * small), math.sin(sign * small)
        turned = bearing.state(load, cage_angle=turn - sign * small)
        changes.append(np.array([[c, -s], [s, c]]) @ turned.displacement)
    across = (changes[1] - changes[0]) / (2.0 * small * load)
    np.testing.assert_allclose(state.stiffness @ across, [0.0, 1.0], atol=1e-4)


def test_a_stiffness_on_a_shaft_is_symmetric_and_less_than_on_rings_that_do_not_yield():
    soft, law = flexible(), flexible().law
    state, rigid = soft.state(3000.0, cage_angle=0.1), AssembledBearing(law, 10).state(3000.0, cage_angle=0.1)
    assert state.stiffness[0, 1] == pytest.approx(state.stiffness[1, 0], rel=1e-9)
    assert np.linalg.eigvalsh(state.stiffness)[0] > 0.0
    assert state.displacement[0] > rigid.displacement[0]


def test_an_element_over_a_pit_carries_less():
    bearing, gaps = flexible(), np.zeros(10)
    gaps[0] = 5e-6
    healthy, damaged = bearing.state(3000.0), bearing.state(3000.0, gaps=gaps)
    assert damaged.converged
    assert damaged.loads[0] < healthy.loads[0]
    assert damaged.loads[1] > healthy.loads[1]
    # A pit that no load reaches the bottom of leaves the element free.
    gaps[0] = 1e-3
    assert bearing.state(3000.0, gaps=gaps).loads[0] == 0.0


def test_no_load_leaves_a_loose_bearing_without_stiffness():
    state = flexible(clearance=1e-5).state(0.0)
    assert state.converged
    assert state.loads.tolist() == [0.0] * 10
    assert state.stiffness.tolist() == [[0.0, 0.0], [0.0, 0.0]]


def test_a_load_beyond_the_law_is_not_called_converged():
    bearing = flexible(highest=500.0)
    assert bearing.state(1000.0).status == "converged"
    beyond = bearing.state(4000.0)
    assert beyond.status == "outside_law"
    assert not beyond.converged
    assert np.all(np.isnan(bearing.load_distribution(4000.0).loads))
    displacement, stiffness = bearing.stiffness_against_load([1000.0, 4000.0], points=4)
    assert np.isfinite(displacement).tolist() == [True, False]
    assert np.isfinite(stiffness[:, 0, 0]).tolist() == [True, False]
    assert not bearing.stiffness_over_passage(4000.0, points=2).converged


def test_forces_that_do_not_balance_the_load_are_not_called_converged(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(balance, "_OUTER_STEPS", 1)
    assert flexible().state(3000.0).status == "not_in_equilibrium"


def test_contacts_that_do_not_close_are_not_called_converged(monkeypatch: pytest.MonkeyPatch):
    # An approach off by a millionth between displacement and forces, which the forces alone do not show.
    bearing, inverse = flexible(), ElementLaw.approach_of
    start = bearing.state(3000.0)
    monkeypatch.setattr(ElementLaw, "approach_of", lambda law, force: (1.0 + 1e-6) * inverse(law, force))
    state = bearing.state(3000.0, start=start)
    assert state.imbalance <= assembly.EQUILIBRIUM_TOLERANCE
    assert state.contact_error > 0.0
    assert state.status == "contact_violated"


def test_what_elements_below_the_tables_carry_is_said():
    bearing = AssembledBearing(ElementLaw.from_power(8e9, 1.5, 500.0, 1e5), 10)
    state = bearing.state(3000.0)
    weak = state.loads < 500.0
    share = float(np.cos(state.angles[weak]) @ state.loads[weak]) / 3000.0
    assert state.below_law == pytest.approx(share)
    assert 0.0 < share < 0.5


def test_wrong_input_is_refused_by_name():
    bearing = flexible()
    with pytest.raises(WrongInputError, match="load"):
        bearing.state(-1.0)
    with pytest.raises(WrongInputError, match="gap of each of 10"):
        bearing.state(1.0, gaps=np.zeros(3))
    with pytest.raises(WrongInputError, match="n_elements 2"):
        AssembledBearing(bearing.law, 2)
    with pytest.raises(WrongInputError, match="clearance"):
        AssembledBearing(bearing.law, 9, math.nan)
    with pytest.raises(WrongInputError, match=r"expected elements 0\.9 rad apart"):
        RingInfluence(np.linspace(0.9, math.pi, 9), np.zeros(9)).matrix(bearing.angles())
    with pytest.raises(WrongInputError, match="up to pi"):
        RingInfluence(np.linspace(0.1, 3.0, 9), np.zeros(9))
