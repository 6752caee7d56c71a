"""The library and the filter beside each other: who is issued, and what is said where they disagree."""

from __future__ import annotations

import math

import pytest

from monitor.health.size import Damage, EdvStatus
from monitor.health.size.calibration import beside

OK = EdvStatus.OK
LIBRARY = Damage(OK, 2e-8, 1.5e-8, 2.6e-8, p_no_growth=0.1)


def test_where_they_agree_the_library_is_issued_with_the_filter_beside_it() -> None:
    found = beside(LIBRARY, Damage(OK, 1.8e-8, 1e-8, 3e-8, p_no_growth=0.4))
    assert (found.status, found.v_eq, found.v_eq_lower, found.v_eq_upper) == (OK, 2e-8, 1.5e-8, 2.6e-8)
    assert (found.v_eq_filter, found.v_eq_filter_lower, found.v_eq_filter_upper) == (1.8e-8, 1e-8, 3e-8)
    assert found.p_no_growth == 0.1


@pytest.mark.parametrize(
    ("tracked", "issued"),
    [
        (Damage(OK, 6e-8, 3e-8, 9e-8), 6e-8),
        (Damage(OK, 6e-8, 5.5e-8, 6.5e-8), 2e-8),
        (Damage(OK, 1e-8, 0.4e-8, 1.4e-8), 1e-8),
    ],
)
def test_where_their_intervals_are_apart_the_wider_is_ambiguous(tracked: Damage, issued: float) -> None:
    found = beside(LIBRARY, tracked)
    assert (found.status, found.v_eq) == (EdvStatus.AMBIGUOUS, issued)
    assert found.v_eq_filter == tracked.v_eq


@pytest.mark.parametrize("status", ["implausible", "outside_library", "bad_block"])
def test_a_refusal_of_the_library_stays_and_the_filter_is_told(status: str) -> None:
    found = beside(Damage(EdvStatus(status)), Damage(OK, 6e-8, 5e-8, 7e-8, p_no_growth=0.2))
    assert (found.status, found.v_eq_filter, found.p_no_growth) == (status, 6e-8, 0.2)
    assert math.isnan(found.v_eq)


def test_a_refusal_of_the_filter_changes_nothing() -> None:
    found = beside(LIBRARY, Damage(EdvStatus.ABOVE_MAP))
    assert (found.status, found.v_eq) == (OK, 2e-8)
    assert math.isnan(found.v_eq_filter)


def test_another_part_than_the_librarys_is_the_filters() -> None:
    tracked = Damage(OK, 6e-8, 5e-8, 7e-8)
    assert beside(Damage(EdvStatus.NOT_THIS_PART), tracked).v_eq == 6e-8
    assert beside(Damage(EdvStatus.NOT_THIS_PART), Damage(EdvStatus.NO_MAP)).status is EdvStatus.NOT_THIS_PART
