"""The independent oracle held against its equations, a second integrator, another oracle and published figures."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from reference.periodic import kernel, tableau
from reference.periodic.path import pieces_of
from reference.periodic.rig import OracleScene, from_dict
from reference.periodic.scenes import (
    DEVELOPMENT,
    HELD_OUT,
    scenes,
)
from reference.periodic.settle import Caps, History, Problem, is_averaged, other_levels, simulate_oracle
from tests.oracles import six_dof_oracle
from tests.support.effort import effort_count
from tests.support.periodic_oracle import ROLLERS, ROUGH, SPALL, thesis_scene

STORED = json.loads((Path(__file__).parents[2] / "data" / "engine_oracle.json").read_text())


PIT = thesis_scene(30.0, 2000.0, 1.3, 1e-3)
BOUNCING = thesis_scene(24.3, 38.6, 34.0, 18.6e-6, clearance=11.8e-6, rough=replace(ROUGH, seed=0))


def test_the_coefficients_satisfy_the_conditions_of_order_8() -> None:
    assert tableau.A.sum(axis=1) == pytest.approx(tableau.C, abs=1e-14)
    for power in range(8):
        assert np.sum(tableau.B * tableau.C**power) == pytest.approx(1.0 / (power + 1.0), abs=1e-14)
    # The weights of both error estimates vanish for every polynomial of their order.
    assert np.sum(tableau.ERROR_5) == pytest.approx(0.0, abs=1e-14)
    assert np.sum(tableau.ERROR_3 * tableau.C**2) == pytest.approx(0.0, abs=1e-14)


@pytest.mark.parametrize(("load", "displacement"), [(1000.0, 9.81e-6), (2000.0, 15.57e-6), (4000.0, 24.7e-6)])
def test_static_displacement_of_the_thesis(load: float, displacement: float) -> None:
    assert thesis_scene(40.0, load).approach == pytest.approx(displacement, rel=1e-3)


def test_the_elements_carry_the_load_at_rest() -> None:
    for scene in scenes(DEVELOPMENT, 40):
        c, s = np.cos(scene.angles), np.sin(scene.angles)
        pressed = np.maximum(scene.approach * c - scene.clearance, 0.0) ** scene.exponent * scene.parameters.k_c
        assert np.sum(pressed * c) == pytest.approx(scene.load, rel=1e-6)
        assert np.sum(pressed * s) == pytest.approx(0.0, abs=1e-6 * scene.load)


@pytest.mark.parametrize("scene", [SPALL, PIT, ROLLERS, replace(ROLLERS, extent=2.0 * math.pi, depth=2e-6)])
def test_the_path_is_the_shallower_of_edge_and_floor_with_its_own_slope(scene: OracleScene) -> None:
    pieces, p = pieces_of(scene), Problem(scene).p
    g = scene.geometry
    for x in np.linspace(-0.4999, 0.4999, 501) * scene.extent:
        branch, x = pieces.branch(float(x))
        assert branch != kernel.ON_RACE
        d, slope = kernel.path_at(branch, x, p, pieces.rough)
        edge = kernel.edge_depth(0.5 * scene.extent - abs(x), g.outer_race_radius, g.element_radius)[0]
        if 0.5 * scene.extent - abs(x) > math.asin(g.element_radius / g.outer_race_radius):
            edge = math.inf
        floor = kernel.floor_depth(x, p, pieces.rough)[0]
        assert d == pytest.approx(p[kernel.P_COSINE] * min(edge, floor), rel=1e-9, abs=1e-15)
        after, before = (kernel.path_at(branch, x + e, p, pieces.rough)[0] for e in (1e-6, -1e-6))
        assert slope == pytest.approx((after - before) / 2e-6, rel=1e-5, abs=1e-8)


def by_scipy(problem: Problem, periods: int) -> tuple[np.ndarray, float]:
    """Return the state after some periods and the mean square of a_o in the last, by scipy with the same equations."""
    p, scene = problem.p, problem.scene
    y, power = np.zeros(13), 0.0
    for _ in range(periods):
        y[12] = 0.0
        for i in range(len(problem.bounds) - 1):
            a, b = problem.bounds[i], problem.bounds[i + 1]

            def rates(t: float, y: np.ndarray, i: int = i, a: float = a, b: float = b) -> np.ndarray:
                dy = np.empty(13)
                where = a + scene.omega_c * t
                arguments = problem.codes[i], problem.middles[i], problem.directions, p, problem.rough
                dy[12] = kernel.derivative(where, y, dy, 0.5 * (a + b), *arguments)[0] ** 2
                return dy

            scale = np.array([1e-6] * 6 + [1e-2] * 6 + [1e-3])
            span = (0.0, (b - a) / scene.omega_c)
            y = solve_ivp(rates, span, y, "DOP853", rtol=1e-10, atol=1e-10 * scale).y[:, -1]
        power = y[12] / scene.period
    return y[:12], power


@pytest.mark.parametrize("scene", [SPALL, PIT, replace(ROLLERS, rough=None)])
def test_a_second_integrator_gives_the_same_motion(scene: OracleScene) -> None:
    problem, periods = Problem(scene), effort_count(quick=1, full=3)
    history = problem.run(1e-9, Caps(periods=periods))
    _, power = by_scipy(problem, periods)
    assert history.power[-1] == pytest.approx(power, rel=1e-6)


def test_another_oracle_with_its_own_equations_agrees() -> None:
    case = six_dof_oracle.Case(40.0, 4000.0, SPALL.extent, SPALL.depth)
    other = six_dof_oracle.simulate_oracle(case, periods=16, rtol=1e-6, samples=1500)
    assert simulate_oracle(SPALL, estimate=False).rms == pytest.approx(other.rms, rel=3e-4)


@pytest.mark.parametrize("scene", [SPALL, PIT, ROLLERS, replace(ROLLERS, load=200.0, clearance=5e-6)])
def test_the_shaft_puts_in_what_damping_takes_out(scene: OracleScene) -> None:
    result = simulate_oracle(scene, estimate=False)
    assert result.status == "settled"
    assert abs(result.imbalance) < 1e-6


def test_a_smooth_piece_is_integrated_with_order_8() -> None:
    """Half the step leaves a 2^8th of the error where no contact opens and the path is smooth."""
    problem = Problem(thesis_scene(40.0, 4000.0))
    begin = np.concatenate(([1e-6, 1e-7, 0.0, 0.0, 1e-8, 0.0], np.zeros(6)))
    still = np.full(7, 1.0)

    def after(steps: int) -> np.ndarray:
        y, trial, nodes, h = begin.copy(), np.empty(12), np.empty((tableau.STAGES, 3)), 4e-4 / steps
        for i in range(steps):
            where = 0.1 + problem.scene.omega_c * h * i
            arrays = 0.0, problem.codes[0], problem.middles[0], problem.directions, problem.p, problem.rough
            kernel.attempt(where, h, y, trial, nodes, still, *arrays)
            y[:] = trial
        return y[6:] / 1e-2

    truth = after(512)
    errors = [float(np.max(np.abs(after(n) - truth))) for n in (16, 32, 64)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(orders - 8.0) < 1.0), orders


@pytest.mark.parametrize("scene", [SPALL, PIT, ROLLERS])
def test_half_the_tolerance_changes_nothing(scene: OracleScene) -> None:
    rough, fine = (simulate_oracle(scene, tolerance=t, estimate=False) for t in (1e-9, 5e-10))
    assert fine.rms == pytest.approx(rough.rms, rel=1e-6)
    assert simulate_oracle(scene, tolerance=1e-5, estimate=False).rms == pytest.approx(fine.rms, rel=1e-3)


NOT_REPEATING = effort_count(quick=120, full=400)
"""Periods over which a motion that does not repeat is averaged."""


def test_a_motion_that_does_not_repeat_gets_a_mean_and_a_standard_error() -> None:
    result = simulate_oracle(BOUNCING, caps=Caps(periods=NOT_REPEATING), estimate=False)
    other = simulate_oracle(BOUNCING, caps=Caps(periods=NOT_REPEATING), tolerance=1e-8, estimate=False)
    assert (result.status, result.repeats, result.multiple) == ("not_periodic", False, 0)
    assert result.spread > 0.01 * result.rms
    assert other.rms == pytest.approx(result.rms, abs=5.0 * math.hypot(result.standard_error, other.standard_error))


def test_a_rig_with_clearance_may_have_two_motions() -> None:
    scene = next(s for s in scenes(DEVELOPMENT, 60) if s.key() == "d4837986f8ac85ca")
    levels = other_levels(scene, 3)
    assert {round(level, 3) for level in levels} == {0.593, 0.662}


def test_a_long_transient_is_not_averaged() -> None:
    """Half a thousand periods at twice the level come before the motion in which the run ends."""
    power = np.concatenate((np.full(450, 400.0), np.full(850, 100.0)))
    noise = np.random.default_rng(1).normal(1.0, 0.02, len(power))
    history = History(power=list(power * noise), distances=[0.3] * len(power))
    assert not is_averaged(History(history.power[:800], distances=[0.3] * 800), 1.0)
    assert is_averaged(history, 1.0)


def test_a_cap_is_said() -> None:
    assert simulate_oracle(SPALL, caps=Caps(steps=2000)).status == "unresolved"


def test_the_sets_are_fixed_disjoint_and_prolonged_at_the_end() -> None:
    drawn = scenes(DEVELOPMENT, 60)
    assert [s.key() for s in scenes(DEVELOPMENT, 20)] == [s.key() for s in drawn[:20]]
    assert not {s.key() for s in drawn} & {s.key() for s in scenes(HELD_OUT, 60)}
    assert all(from_dict(json.loads(json.dumps(s.as_dict()))) == s for s in drawn)
    # The results that are stored belong to the scenes that are drawn today.
    assert {entry["key"] for entry in STORED} <= {s.key() for s in scenes(DEVELOPMENT, 300)}


@pytest.mark.parametrize("entry", STORED[: effort_count(quick=2, full=30)], ids=lambda entry: entry["key"])
def test_stored_results_are_the_oracles_own(entry: dict) -> None:
    scene, stored = from_dict(entry["scene"]), entry["result"]
    assert scene.key() == entry["key"]
    result = simulate_oracle(scene, estimate=False)
    assert (result.status, result.repeats) == (stored["status"], stored["repeats"])
    slack = 1e-6 * stored["rms"] + 6.0 * stored["standard_error"]
    assert result.rms == pytest.approx(stored["rms"], rel=0.0, abs=slack)
    if stored["repeats"]:
        assert result.lines == pytest.approx(stored["lines"], rel=1e-4, abs=1e-4 * max(stored["lines"]))
        assert result.peak == pytest.approx(stored["peak"], rel=0.02)
