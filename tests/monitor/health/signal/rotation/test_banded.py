"""Slopes of splines, banded systems and running medians against SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.ndimage import rank_filter

from monitor.health.signal.rotation.banded import running_median, solved, spline_slopes


@pytest.mark.parametrize("points", [4, 5, 60])
def test_slopes_are_those_of_the_spline_of_scipy(points: int) -> None:
    rng = np.random.default_rng(points)
    x, y = np.cumsum(rng.uniform(0.5, 1.5, points)), rng.standard_normal(points)
    assert np.allclose(spline_slopes(x, y), CubicSpline(x, y)(x, 1), rtol=1e-9, atol=1e-12)


def test_a_banded_system_is_solved() -> None:
    rng = np.random.default_rng(1)
    bands = np.stack((np.r_[0.0, rng.uniform(-1.0, 1.0, 7)], np.full(8, 3.0)))
    full = np.diag(bands[1]) + np.diag(bands[0, 1:], 1) + np.diag(bands[0, 1:], -1)
    right = rng.standard_normal(8)
    assert np.allclose(full @ solved(bands, right), right)


@pytest.mark.parametrize(("size", "above"), [(1, 0), (3, 0), (9, 0), (9, 2)])
def test_medians_are_those_of_scipy(size: int, above: int) -> None:
    values = np.random.default_rng(2).standard_normal(40)
    expected = rank_filter(values, rank=size // 2 + above, size=size, mode="reflect")
    assert np.array_equal(running_median(values, size, above), expected)
