"""The harmonic balance that the solver of gear trains is held against, itself held against scipy and closed forms."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.oracles.gear_harmonic_balance import Array, Balance, Motion, Pair, out_of_contact, root_mean_square
from tests.oracles.gear_jumps import CASES, nearest_stable, oracle, sweep

JUMPING = Pair(0.05, 0.1, ((0.05, 0.0),))
"""F_m, F_ah and zeta of an example commonly attributed to Kahraman & Singh (1990)."""


def varying(phase: Array) -> Array:
    return 1.0 + 0.2 * np.cos(2.0 * math.pi * phase)


@cache
def jumping() -> tuple[Balance, list[Motion]]:
    balance = Balance(JUMPING, harmonics=24)
    return balance, balance.branch(balance.motion(0.6), (0.55, 1.1), step=0.1)


def test_without_backlash_the_motion_is_that_of_a_linear_oscillator() -> None:
    zeta, frequency, amplitude = 0.05, 0.9, 0.02
    found = Balance(Pair(zeta, 1.0, ((amplitude, 0.3),)), 3, samples=32).motion(frequency)
    transfer = frequency**2 * amplitude / (1.0 - frequency**2 + 2j * zeta * frequency)
    expected = transfer * np.exp(-0.3j)
    assert found.coefficients[0] == pytest.approx(1.0)
    assert found.coefficients[1] - 1j * found.coefficients[2] == pytest.approx(expected)
    decay = math.exp(-zeta * 2.0 * math.pi / frequency)
    np.testing.assert_allclose(np.abs(found.multipliers), decay, rtol=1e-12)


@pytest.mark.parametrize(
    ("pair", "frequency", "periods"),
    [
        (JUMPING, 1.0, 1),
        (Pair(0.05, 0.1, ((0.05, 0.0), (0.01, 1.0)), varying), 1.0, 1),
        (Pair(0.02, 0.05, ((0.2, 0.0),), varying, backlash=0.3), 0.7, 1),
    ],
    ids=["one flank", "varying stiffness", "both flanks"],
)
def test_scipy_comes_back_to_where_the_balance_starts(pair: Pair, frequency: float, periods: int) -> None:
    balance = Balance(pair, 60, periods)
    start = balance.branch(balance.motion(0.5), (0.45, frequency), step=0.2)[-1]
    terms = balance.motion(frequency, start.coefficients).coefficients
    speed = frequency * (balance.derivative @ terms)
    span = 2.0 * math.pi * periods / frequency

    def rate(time: float, state: Array) -> Array:
        d, phase = state[:1], np.array([frequency * time / (2.0 * math.pi)])
        force = pair.excitation(phase, frequency) - pair.stiffness(phase) * pair.elastic(d)
        return np.append(state[1:], force - 2.0 * pair.zeta * state[1:])

    expected = balance.signal(terms)[::64]
    first = np.array([expected[0], balance.signal(speed)[0]])
    times = span * np.arange(64) / 64.0
    found = solve_ivp(rate, (0.0, span), first, "DOP853", t_eval=times, rtol=1e-7, atol=1e-9, max_step=span / 50)
    assert out_of_contact(balance, balance.motion(frequency, start.coefficients)) > 0.1
    np.testing.assert_allclose(found.y[0], expected, atol=1e-5 * float(np.ptp(expected)))


def test_a_branch_turns_back_where_a_multiplier_leaves_the_unit_circle() -> None:
    balance, branch = jumping()
    upper, lower = balance.folds(branch)
    assert upper.frequency > lower.frequency
    for fold in (upper, lower):
        assert np.abs(fold.multipliers - 1.0).min() < 2e-3
    turns = np.diff([m.frequency for m in branch]) > 0.0
    assert all(m.stable for m, forward in zip(branch, turns, strict=False) if forward and _away(m, upper, lower))
    assert not any(
        m.stable for m, forward in zip(branch, turns, strict=False) if not forward and _away(m, upper, lower)
    )


def _away(motion: Motion, *folds: Motion) -> bool:
    return all(abs(motion.frequency - fold.frequency) > 2e-3 for fold in folds)


def test_more_harmonics_leave_the_balance_as_it_is() -> None:
    balance, branch = jumping()
    fine, near = Balance(JUMPING, 40), min(branch, key=lambda motion: abs(motion.frequency - 1.0)).coefficients
    coarse = balance.motion(1.0, near)
    found = fine.motion(1.0, np.append(coarse.coefficients, np.zeros(32)))
    assert root_mean_square(found) == pytest.approx(root_mean_square(coarse), rel=1e-6)


def test_the_solver_in_time_lies_on_the_stable_motions_of_both_branches() -> None:
    case = replace(CASES[0], settle=30)
    balance = Balance(oracle(case), harmonics=16, samples=1024)
    branch = balance.branch(balance.motion(0.68), (0.65, 0.9), step=0.1)
    low, high = sorted(fold.frequency for fold in balance.folds(branch))
    assert low < 0.75 < high
    points, _ = sweep(case, np.array([0.69, 0.75, high + 0.01, 0.75]))
    for point, motion in zip(points, nearest_stable(balance, branch, points), strict=True):
        assert motion is not None
        assert point.spread < 1e-3
        assert point.rms == pytest.approx(root_mean_square(motion), rel=1e-4)
        assert point.apart == pytest.approx(out_of_contact(balance, motion), abs=2e-3)
    assert [point.apart > 0.0 for point in points] == [False, False, True, True]


def test_where_a_multiplier_is_minus_one_the_shorter_period_gives_way_to_the_longer() -> None:
    balance = Balance(Pair(0.1, 0.5, ((0.8, 0.0),)), harmonics=12, samples=1024)
    branch = balance.branch(balance.motion(0.6), (0.59, 1.02), step=0.1)
    (flip,) = balance.flips(branch)
    assert flip.multipliers.real.min() == pytest.approx(-1.0)
    double, start = balance.doubled(flip)
    last = double.branch(start, (flip.frequency - 1e-3, flip.frequency + 0.02), step=0.1)[-1]
    assert np.abs(last.coefficients[1::4]).max() > 0.1
    assert last.stable
    assert not balance.motion(last.frequency, branch[-1].coefficients).stable
