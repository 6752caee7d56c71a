"""The benchmark of stretched intervals: its samples are the forecaster's, and it finds a factor that is there."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.library_stretch import (
    BOUND,
    GRID,
    KNOTS,
    Moments,
    by_band,
    factors,
    fitted_factor,
    moments_of,
)
from monitor.health.size.library.fit import FitSettings, fit_library
from monitor.health.size.library.model import SPREAD, FeatureFit
from monitor.health.size.library.scores import crps
from tests.oracles.toy_lives import INTERVAL, THRESHOLD, toy_lives
from tests.support.effort import effort_count

LIVES = effort_count(quick=70, full=600)
NEIGHBOURS = effort_count(quick=60, full=300)
"""As many alike moments as a library of so many lives has at least."""


@cache
def fit() -> FeatureFit:
    library = fit_library(
        toy_lives(LIVES),
        thresholds=[THRESHOLD],
        interval=INTERVAL,
        prior="toy lives",
        made_of={},
        settings=FitSettings(columns=20, moments=16),
    )
    return library.fit_for("rms")


def normal_moments(spread: float, count: int = 4000) -> Moments:
    """Moments whose errors are drawn from a normal distribution, and true errors from one wider by a factor."""
    draw = np.random.default_rng(5)
    share = draw.uniform(0.05, 0.95, count)
    said = np.log(200.0 * (1.0 - share))
    return Moments(
        said=said,
        truth=said + spread * draw.normal(0.0, 0.1, count),
        errors=draw.normal(0.0, 0.1, (count, 100)),
        crossed=np.zeros((count, 100), dtype=bool),
        predicted=share,
        true=share,
        life=draw.integers(0, 50, count),
    )


def test_without_a_factor_samples_are_those_of_the_regression(monkeypatch: pytest.MonkeyPatch) -> None:
    # The forecaster adds lifetimes and accelerations to them.
    monkeypatch.setattr("benchmarks.library_stretch.NEIGHBOURS", NEIGHBOURS)
    monkeypatch.setattr("monitor.health.size.library.acceleration.ACCELERATION", 0.0)
    moments = moments_of(fit())
    samples = moments.samples(np.full(len(moments.said), SPREAD))
    rows = np.flatnonzero(~fit().crossed[:, 0])
    assert samples.shape == (len(rows), NEIGHBOURS)
    scores = moments.crps(samples)
    for place in range(0, len(rows), effort_count(quick=100, full=100)):
        row = int(rows[place])
        expected = replace(fit(), pool=np.zeros(1)).sample_tt(
            1, float(fit().said[row, 1]), float(fit().ln_elapsed[row]), NEIGHBOURS, int(fit().life[row])
        )
        np.testing.assert_allclose(INTERVAL * samples[place], expected, rtol=1e-9, atol=1e-6)
        truth = float(np.exp(moments.truth[place])) - 6.0
        assert scores[place] == pytest.approx(crps(samples[place], truth), rel=1e-9)


@pytest.mark.parametrize("spread", [0.75, 1.0, 1.35])
def test_a_spread_that_is_wrong_throughout_is_found(spread: float) -> None:
    moments = normal_moments(spread)
    found = factors(moments)
    for name in ("predicted", "true", "half way"):
        stretch, at_knots = found[name]
        assert np.median(stretch) == pytest.approx(spread, rel=0.08)
        assert np.exp(at_knots[1:3]) == pytest.approx(np.full(2, spread), rel=0.15)
        assert moments.covered(moments.samples(stretch)).mean() == pytest.approx(0.8, abs=0.02)
    np.testing.assert_array_equal(found["none"][0], 1.0)


def test_where_coverage_is_right_already_nothing_is_changed() -> None:
    share = np.linspace(0.0, 1.0, 1001)
    covered = np.zeros((len(share), round(2.0 * BOUND / GRID) + 1), dtype=bool)
    covered[np.arange(len(share)) % 5 > 0] = True
    np.testing.assert_array_equal(fitted_factor(covered, share, share), np.zeros(len(KNOTS)))


def test_means_by_band_are_those_of_its_members() -> None:
    share, values = np.array([0.05, 0.15, 0.12, 0.35, 0.4]), np.array([9.0, 1.0, 3.0, 5.0, 7.0])
    np.testing.assert_allclose(by_band(share, values, np.array([0.1, 0.2, 0.3, 0.4])), [2.0, 0.8, 5.0])
