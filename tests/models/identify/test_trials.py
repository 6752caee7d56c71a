"""Eqs. 54 to 58 of the thesis, against numbers worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models.identify.trials import (
    Condition,
    Trial,
    a_star,
    a_star_above_noise,
    average,
    deviations,
    gather,
    global_deviation,
    root_mean_square,
)

FIRST, SECOND = Condition(1000.0, 40.0, 0.04, 5e-4), Condition(2000.0, 40.0, 0.04, 5e-4)


def test_the_mean_over_repetitions_has_its_divisor() -> None:
    assert average([1.0, 2.0, 6.0]) == 3.0


def test_deviations_are_percent_of_the_test_without_sign() -> None:
    found = deviations(np.array([1.1, 1.6, 3.0]), np.array([1.0, 2.0, 3.0]))
    assert found == pytest.approx([10.0, 20.0, 0.0])
    assert global_deviation(np.array([1.1, 1.6, 3.0]), np.array([1.0, 2.0, 3.0])) == pytest.approx(10.0)


def test_a_condition_without_a_feature_does_not_count() -> None:
    assert global_deviation(np.array([1.1, 7.0]), np.array([1.0, np.nan])) == pytest.approx(10.0)


def test_a_star_is_the_root_sum_of_squares_of_five_lines() -> None:
    lines = np.array([1.0, 2.0, 2.0, 4.0, 0.0, 100.0])
    assert float(a_star(lines)) == 5.0
    assert a_star(np.array([lines, 2.0 * lines])).tolist() == [5.0, 10.0]


def test_noise_is_taken_off_in_power() -> None:
    lines, floor = np.array([3.0, 4.0, 0.0, 0.0, 0.0]), np.array([0.0, 3.0, 0.0, 0.0, 0.0])
    assert a_star_above_noise(lines, floor) == 4.0
    assert math.isnan(a_star_above_noise(floor, lines))


def test_rms_of_a_signal() -> None:
    assert root_mean_square(np.array([1.0, -7.0])) == 5.0


def test_repetitions_are_gathered_with_their_scatter() -> None:
    trials = gather([Trial(FIRST, 0.9, 2.0), Trial(SECOND, 4.0, 5.0), Trial(FIRST, 1.1, math.nan)])
    assert trials.conditions == (FIRST, SECOND)
    assert trials.mean.tolist() == [[1.0, 2.0], [4.0, 5.0]]
    assert trials.count.tolist() == [[2, 1], [1, 1]]
    assert trials.freedom.tolist() == [1, 0]
    # (0.1^2 + 0.1^2) / 1 degree of freedom.
    assert trials.scatter[0] == pytest.approx(math.sqrt(0.02))
    assert math.isnan(trials.scatter[1])


@pytest.mark.parametrize("value", [0.0, -1.0, math.inf])
def test_a_feature_is_positive(value: float) -> None:
    with pytest.raises(ValueError, match="a_star must be positive and finite"):
        gather([Trial(FIRST, 1.0, value)])


def test_no_tests_are_refused() -> None:
    with pytest.raises(ValueError, match="there are no tests"):
        gather([])
