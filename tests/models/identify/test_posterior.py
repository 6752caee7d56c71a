"""Draws of posteriors that are known: of models that are linear in the coordinates, flat in one, or of two valleys."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models.identify import posterior
from models.identify.evidence import Evidence, Prior
from models.identify.intervals import profile_intervals, threshold
from models.identify.limits import AdmissibleLimits
from models.identify.posterior import Drawn, draw_posterior
from models.identify.problem import Problem
from tests.support.posterior import COUNT, NOISE, Law, fitted, toy
from tests.support.space import broken


@pytest.fixture(autouse=True)
def counts_of_the_product(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw as many candidates as without quick effort: shares of valleys are counted."""
    for name, count in (("_ROUND", 64), ("_ROUND_PER_FREE", 40), ("ENOUGH", 200.0)):
        monkeypatch.setattr(posterior, name, count)


def points_of(problem: Problem, drawn: Drawn) -> np.ndarray:
    """Return the coordinates of draws."""
    space = problem.evaluator.space
    return np.array([space.encode(dict(zip(space.free, row, strict=True))) for row in drawn.rows.tolist()])


def linear(slopes: np.ndarray) -> Law:
    return lambda point: slopes @ point


SLOPES = np.random.default_rng(5).standard_normal((2 * COUNT, 3)) * np.array([1.0, 0.6, 0.8])
SLOPES[:, 1] += 0.8 * SLOPES[:, 0]
FREE = ("m_r", "beta_c", "c_i")


def test_of_a_linear_model_they_are_students_t_as_the_profiles_are() -> None:
    problem = toy(linear(SLOPES), (0.5, 0.5, 0.5), *FREE)
    best = fitted(problem, (0.4, 0.6, 0.5))
    limit = threshold(problem, best.cost, 0.95)
    intervals = profile_intervals(problem, best, limit)
    drawn = draw_posterior(problem, best, limit, seed=1, count=4000)
    assert drawn.effective > 200.0
    points = points_of(problem, drawn)
    freedom = 2 * COUNT - 3
    measured = np.log(problem.trials.mean.ravel())
    centre = np.linalg.lstsq(SLOPES, measured, rcond=None)[0]
    scatter = float(np.sum((measured - SLOPES @ centre) ** 2)) / freedom
    covariance = scatter * freedom / (freedom - 2) * np.linalg.inv(SLOPES.T @ SLOPES)
    sd = np.sqrt(np.diag(covariance))
    # Of 200 independent draws the mean has a standard error of 7 % of the standard deviation.
    assert np.all(np.abs(np.mean(points, axis=0) - centre) < 0.25 * sd)
    assert np.std(points, axis=0) == pytest.approx(sd, rel=0.2)
    assert np.corrcoef(points.T) == pytest.approx(covariance / np.outer(sd, sd), abs=0.15)
    # m_r, beta_c and c_i are searched by their logarithms, nearly linear over such intervals.
    for column, name in zip(drawn.rows.T, problem.evaluator.space.free, strict=True):
        low, high = np.quantile(column, (0.025, 0.975))
        width = intervals[name].high - intervals[name].low
        assert low == pytest.approx(intervals[name].low, abs=0.15 * width)
        assert high == pytest.approx(intervals[name].high, abs=0.15 * width)


def test_the_scatter_of_the_tests_widens_them() -> None:
    widths: list[float] = []
    for noise in (0.01, 0.04):
        problem = toy(linear(SLOPES[:, :1]), (0.5,), "m_r", noise=noise)
        best = fitted(problem, (0.4,))
        drawn = draw_posterior(problem, best, threshold(problem, best.cost, 0.95), seed=1)
        widths.append(float(np.std(points_of(problem, drawn))))
    # The draws of the noise are the same four times as large; what is assumed of the tests, 3 %, does not matter.
    assert widths[1] == pytest.approx(4.0 * widths[0], rel=0.1)


def test_what_is_not_told_spans_its_limits() -> None:
    slopes = SLOPES.copy()
    slopes[:, 2] = 0.0
    problem = toy(linear(slopes), (0.5, 0.5, 0.3), *FREE)
    best = fitted(problem, (0.4, 0.6, 0.3))
    limit = threshold(problem, best.cost, 0.95)
    interval = profile_intervals(problem, best, limit)["c_i"]
    drawn = draw_posterior(problem, best, limit, seed=1)
    assert interval.reason == "within its limits"
    assert interval.at_limit == (True, True)
    points, c_i = points_of(problem, drawn)[:, 2], drawn.rows[:, 2]
    # Uniform: every tenth of its interval holds about a tenth of the draws.
    shares = np.histogram(points, bins=10, range=(0.0, 1.0))[0] / len(points)
    assert np.all((shares > 0.04) & (shares < 0.18))
    assert np.min(c_i) < interval.low * 1.1
    assert np.max(c_i) > interval.high * 0.9


@pytest.mark.parametrize("noise", [0.5 * NOISE, 3.0 * NOISE])
def test_what_only_a_prior_tells_has_its_stated_uncertainty(noise: float) -> None:
    slopes = SLOPES.copy()
    slopes[:, 2] = 0.0
    evidence = Evidence(priors=(Prior("c_i", 1500.0, 0.1, "made up"),))
    problem = toy(linear(slopes), (0.5, 0.5, 0.3), *FREE, noise=noise, evidence=evidence)
    best = fitted(problem, (0.4, 0.6, 0.3))
    limit = threshold(problem, best.cost, 0.95)
    logarithms = np.log(draw_posterior(problem, best, limit, seed=1, count=4000).rows[:, 2])
    # Residuals of the tests that are smaller than assumed do not narrow it, larger ones widen it.
    assert (limit.variance > 1.5) == (noise > NOISE)
    assert np.std(logarithms) == pytest.approx(0.1 * math.sqrt(limit.variance), rel=0.15)
    assert np.mean(logarithms) == pytest.approx(math.log(1500.0), abs=0.05)


def test_two_valleys_have_their_shares() -> None:
    def law(point: np.ndarray) -> np.ndarray:
        # The square is the same on both sides of 1/2, but three times as steep above: a third of the mass.
        away = point[0] - 0.5
        return SLOPES[:, 0] * 4.0 * (away if away < 0.0 else 3.0 * away) ** 2

    problem = toy(law, (0.2,), "m_r")
    best = fitted(problem, (0.25,), (0.65,))
    assert sorted(round(float(fit.point[0]), 1) for fit in problem.fits) == [0.2, 0.6]
    points = points_of(problem, draw_posterior(problem, best, threshold(problem, best.cost, 0.95), seed=1))[:, 0]
    assert np.mean(points > 0.5) == pytest.approx(0.25, abs=0.08)
    assert not np.any((points > 0.35) & (points < 0.55))


def test_every_draw_is_admissible_and_the_limits_cut_it() -> None:
    limits = AdmissibleLimits(f_r=(7000.0, 7600.0), zeta_2=(0.05, 0.14))
    # The truth lies in a corner of the space.
    problem = toy(linear(SLOPES[:, :2]), (0.02, 0.99), "m_r", "k_r", limits=limits, noise=0.1)
    best = fitted(problem, (0.2, 0.8))
    drawn = draw_posterior(problem, best, threshold(problem, best.cost, 0.95), seed=1)
    space = problem.evaluator.space
    rows = [{**space.known, **dict(zip(space.free, row, strict=True))} for row in drawn.rows.tolist()]
    assert [row for row in rows if space.violations(row)] == []
    assert [row for row in rows[::16] if broken(space, row)] == []
    assert np.max(points_of(problem, drawn)[:, 1]) <= 1.0
    assert np.max(points_of(problem, drawn)[:, 1]) > 0.97


def test_a_seed_gives_the_same_draws_again() -> None:
    problem = toy(linear(SLOPES), (0.5, 0.5, 0.5), *FREE)
    best = fitted(problem, (0.4, 0.6, 0.5))
    limit = threshold(problem, best.cost, 0.95)
    first, again, other = (draw_posterior(problem, best, limit, seed=seed) for seed in (3, 3, 4))
    assert np.array_equal(first.rows, again.rows)
    assert not np.array_equal(first.rows, other.rows)
    assert first.rows.shape == (256, 3)
    # The assumed level of the intervals moves where components begin, not the posterior.
    wide = draw_posterior(problem, best, threshold(problem, best.cost, 0.5), seed=3)
    assert np.mean(wide.rows, axis=0) == pytest.approx(np.mean(first.rows, axis=0), rel=0.02)
