"""No candidate outside Eq. 80: the space, its limits and its inverse."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from models.identify import evaluate
from models.identify.evaluate import Evaluator
from models.identify.limits import AdmissibleLimits
from models.identify.space import DEFAULT_FREE, ORDER, SpaceError, contact_ratios
from models.machine.rig import Rig, contact_damping, stiffness_damping
from tests.models.identify.cases import BAND, CONDITIONS, space_of
from tests.support.space import broken

LOADS = (1000.0, 2000.0)
FREE = st.lists(st.sampled_from(ORDER), min_size=1, max_size=len(ORDER), unique=True)
PLACES = st.lists(st.floats(0.0, 1.0), min_size=len(ORDER), max_size=len(ORDER))
# Limits that leave more and that leave less than those printed.
LIMITS = st.sampled_from(
    [
        AdmissibleLimits(),
        AdmissibleLimits(beta_c=(0.25e-5, 5e-5), zeta_2=(1e-3, 0.3)),
        AdmissibleLimits(f_r=(7000.0, 7600.0), zeta_1=(0.02, 0.08), zeta_2=(0.05, 0.14), zeta_r=(1e-3, 0.02)),
    ]
)


@given(free=FREE, places=PLACES, limits=LIMITS)
def test_no_point_of_the_cube_is_outside_eq_80(free: list[str], places: list[float], limits: AdmissibleLimits) -> None:
    space = space_of(*free, rig=Rig(), limits=limits, loads=LOADS)
    values = space.decode(np.array(places[: len(free)]))
    assume(values is not None)
    assert values is not None
    assert broken(space, values) == []
    assert space.admits(values)


@given(places=PLACES, limits=LIMITS)
def test_the_default_unknowns_leave_no_hole_in_the_cube(places: list[float], limits: AdmissibleLimits) -> None:
    space = space_of(*DEFAULT_FREE, rig=Rig(), limits=limits, loads=LOADS)
    values = space.decode(np.array(places[: len(DEFAULT_FREE)]))
    assert values is not None
    assert broken(space, values) == []


@given(places=PLACES)
def test_encoding_is_the_inverse(places: list[float]) -> None:
    space = space_of(*DEFAULT_FREE, rig=Rig(), loads=LOADS)
    point = np.array(places[: len(DEFAULT_FREE)])
    values = space.decode(point)
    assert values is not None
    again = space.decode(space.encode(values))
    assert again == pytest.approx(values, rel=1e-9)


@given(places=PLACES, name=st.sampled_from(DEFAULT_FREE))
def test_a_parameter_that_is_held_keeps_the_rest_inside(places: list[float], name: str) -> None:
    whole = space_of(*DEFAULT_FREE, rig=Rig(), loads=LOADS)
    values = whole.decode(np.array(places[: len(DEFAULT_FREE)]))
    assert values is not None
    held = whole.fix(name, values[name])
    assert name not in held.free
    found = held.decode(held.encode(values))
    # Where only a point is left of an interval, rounding decides.
    assume(found is not None)
    assert found is not None
    assert found == pytest.approx(values, rel=1e-6)
    assert broken(held, found) == []


def test_the_truth_of_table_18_is_inside_but_at_its_edge() -> None:
    space = space_of(*DEFAULT_FREE, rig=Rig(), loads=LOADS)
    assert space.violations(space.known) == []
    assert space.bounds("beta_c")[1] == pytest.approx(Rig().beta_c)
    assert space.bounds("m_r") == (0.1, 5.0)


def test_what_is_outside_is_refused_before_anything_is_simulated(monkeypatch: pytest.MonkeyPatch) -> None:
    def simulated(*args: object) -> None:
        raise AssertionError("a candidate outside Eq. 80 was simulated")

    space = space_of("m_r", "k_r")
    evaluator = Evaluator(space, CONDITIONS, BAND)
    monkeypatch.setattr(evaluate, "CANDIDATES", replace(evaluate.CANDIDATES, function=simulated))
    with pytest.raises(ValueError, match=r"outside the constraints: .*f_r = 1[0-9]{4}.* is outside 4500 to 9500"):
        evaluator.levels([{**space.known, "m_r": 1.0, "k_r": 9e9}])


def test_where_the_resonator_is_known_other_masses_are_refused() -> None:
    space = space_of("m_o", limits=AdmissibleLimits(f_r=(7300.0, 9000.0)), rig=Rig())
    assert space.decode(np.array([0.0])) is not None
    assert space.decode(np.array([1.0])) is None


def test_damping_ratios_of_the_study() -> None:
    values = {"alpha_c": 154.9, "beta_c": 2.5e-5}
    assert contact_ratios(values, AdmissibleLimits()) == pytest.approx((0.0622, 0.126), rel=2e-3)
    assert contact_damping(*contact_ratios(values, AdmissibleLimits()), 400.0, 1500.0) == pytest.approx((154.9, 2.5e-5))
    # c_i and c_r at the limits of zeta_i and zeta_r.
    space = space_of("c_i", "c_r", rig=Rig())
    least, most = space.decode(np.zeros(2)), space.decode(np.ones(2))
    assert least is not None
    assert most is not None
    assert least["c_i"] == pytest.approx(stiffness_damping(1e-3, 400.0, 75e6))
    assert most["c_r"] == pytest.approx(stiffness_damping(0.15, 8000.0, 4.25e9))


def test_names_of_the_study_stand_for_coefficients() -> None:
    assert space_of("zeta_r", "zeta_1", "zeta_i", "zeta_2").free == ("beta_c", "alpha_c", "c_i", "c_r")


@pytest.mark.parametrize(
    ("free", "message"),
    [
        (("k_q",), "'k_q' cannot be free; expected names of m_i, m_o"),
        (("m_r", "m_r"), "'m_r' is free twice"),
        (("zeta_i", "c_i"), "'zeta_i' is free twice"),
    ],
)
def test_wrong_names_are_refused(free: tuple[str, ...], message: str) -> None:
    with pytest.raises(SpaceError, match=message):
        space_of(*free)


def test_limits_are_checked() -> None:
    with pytest.raises(ValueError, match=r"limits of f_r: expected 0 <= LO < HI, got 9000\.0 and 4500\.0"):
        AdmissibleLimits(f_r=(9000.0, 4500.0))
    with pytest.raises(ValueError, match="'f_9' has no limits"):
        AdmissibleLimits().with_intervals({"f_9": (1.0, 2.0)})


def test_contradicting_limits_name_the_parameter() -> None:
    space = space_of("m_r", "k_r", rig=Rig(), limits=AdmissibleLimits(m_r=(0.1, 0.2), k_r=(9e9, 10e9)))
    assert space.decode(np.full(2, 0.5)) is None
    with pytest.raises(SpaceError, match="no admissible value of m_r is left"):
        space.encode(space.known)


def test_an_interval_of_two_neighbouring_numbers_has_a_place() -> None:
    # Their logarithms are the same.
    space = space_of("c_i", limits=AdmissibleLimits(c_i=(1000.0, math.nextafter(1000.0, math.inf))))
    assert space.encode({"c_i": 1000.0}).tolist() == [0.5]
