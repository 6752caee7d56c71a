"""The least of many valleys: thresholds that are widened for the choice among them cover, others do not."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models.identify.intervals import ONE_VALLEY, ValleyChoice, threshold, valley_choice
from models.words.numerics import f_quantile
from tests.support.posterior import COUNT, NOISE, fitted, toy

WAVES, TRUTH = 12, 0.52
_BASIS = np.linalg.qr(np.random.default_rng(8).standard_normal((2 * COUNT, 3)))[0].T
CHI_SQUARED_95 = f_quantile(1.0, 1e9, 0.95)


def wavy(point: np.ndarray) -> np.ndarray:
    """Return features that come back nearly where they were with each wave of the coordinate."""
    turn, along = 2.0 * math.pi * WAVES * point[0], 2.0 * NOISE * WAVES * point[0] / 5.0
    return 0.3 * (math.cos(turn) * _BASIS[0] + math.sin(turn) * _BASIS[1]) + along * _BASIS[2]


def straight(point: np.ndarray) -> np.ndarray:
    return 4.0 * (point[0] - 0.5) * _BASIS[2]


def test_one_valley_changes_nothing() -> None:
    problem = toy(straight, (TRUTH,), "m_r")
    best = fitted(problem, (0.4,), (0.6,))
    choice = valley_choice(problem, best, seed=1)
    assert choice.freedom == 0.0
    assert choice.widening(0.95) == pytest.approx(1.0, abs=1e-6)
    assert threshold(problem, best.cost, 0.95, choice) == threshold(problem, best.cost, 0.95, ONE_VALLEY)


def test_a_known_excess_is_added_whole() -> None:
    assert ValleyChoice(np.full(9, 3.0)).widening(0.95) * CHI_SQUARED_95 == pytest.approx(3.0 + CHI_SQUARED_95)


def test_with_many_valleys_it_is_the_distribution_of_the_least_cost() -> None:
    """Against all valleys of a wavy model on a fine grid, for noise that is drawn anew."""
    problem = toy(wavy, (TRUTH,), "m_r")
    best = fitted(problem, *((start,) for start in np.arange(0.02, 1.0, 0.5 / WAVES)))
    choice = valley_choice(problem, best, seed=1)
    grid = np.array([wavy(np.array([place])) for place in np.linspace(0.0, 1.0, 6001)]) / NOISE
    truth = wavy(np.array([TRUTH])) / NOISE
    noise = np.random.default_rng(4).standard_normal((2000, 2 * COUNT))
    least = np.array([np.min(np.sum((grid - truth - drawn) ** 2, axis=1)) for drawn in noise])
    excess = np.sum(noise**2, axis=1) - least
    assert np.mean(excess > CHI_SQUARED_95) > 0.09
    assert np.mean(excess > CHI_SQUARED_95 * choice.widening(0.95)) == pytest.approx(0.05, abs=0.025)
    assert choice.freedom > 0.2


def test_the_draws_are_those_of_their_seed() -> None:
    problem = toy(wavy, (TRUTH,), "m_r")
    best = fitted(problem, *((start,) for start in np.arange(0.02, 1.0, 0.5 / WAVES)))
    first, again, other = (valley_choice(problem, best, seed).excess for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
