"""The independent oracle held against its equations, a second integrator, another oracle and published figures."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from reference.periodic import kernel, period, tableau
from reference.periodic.path import pieces_of
from reference.periodic.rig import OracleScene, Pit, Wave, from_dict
from reference.periodic.scenes import DEVELOPMENT, HELD_OUT, scenes
from reference.periodic.settle import Caps, History, Problem, is_averaged, other_levels, simulate_oracle
from tests.oracles import six_dof_oracle
from tests.support.effort import effort_count
from tests.support.periodic_oracle import ROLLERS, ROUGH, SPALL, thesis_scene

STORED = json.loads((Path(__file__).parents[2] / "data" / "engine_oracle.json").read_text())

PIT = thesis_scene(30.0, 2000.0, 1.3, 1e-3)
BOUNCING = thesis_scene(24.3, 38.6, 34.0, 18.6e-6, clearance=11.8e-6, rough=replace(ROUGH, seed=0))
# Two defects and two waves on a light load: contacts open and close at both.
SEVERAL = replace(
    thesis_scene(40.0, 300.0, 3.0, 1e-3, clearance=5e-6),
    position=-0.2,
    more=(Pit(0.1, 10e-6, 0.3, 2),),
    waves=(Wave(5e-7, 9, 0.4), Wave(2e-7, 17, -1.0)),
)
PARTING = replace(ROLLERS, load=200.0, clearance=5e-6)


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
    (pieces,), model = pieces_of(scene), Problem(scene).model
    cosine = model.p[kernel.P_COSINE]
    g = scene.geometry
    for x in np.linspace(-0.4999, 0.4999, 501) * scene.extent:
        branch, x = pieces.branch(float(x))
        assert branch != kernel.ON_RACE
        d, slope = kernel.path_at(branch, x, model)
        edge = kernel.edge_depth(0.5 * scene.extent - abs(x), g.outer_race_radius, g.element_radius)[0]
        if 0.5 * scene.extent - abs(x) > math.asin(g.element_radius / g.outer_race_radius):
            edge = math.inf
        floor = kernel.floor_depth(x, 0, model)[0]
        assert d == pytest.approx(cosine * min(edge, floor), rel=1e-9, abs=1e-15)
        after, before = (kernel.path_at(branch, x + e, model)[0] for e in (1e-6, -1e-6))
        assert slope == pytest.approx((after - before) / 2e-6, rel=1e-5, abs=1e-8)


def pieces_by_scipy(problem: Problem, y: np.ndarray) -> Iterator[tuple[kernel.Piece, float, Any]]:
    """Yield each interval of a ball period from a state (13, the last the integral of a_o squared), its first cage
    angle and its solution by scipy with the same equations.
    """
    omega = problem.scene.omega_c
    for i, (a, b) in enumerate(pairwise(problem.bounds)):
        piece = kernel.Piece(0.5 * (a + b), problem.codes[i], problem.middles[i])

        def rates(t: float, y: np.ndarray, a: float = a, piece: kernel.Piece = piece) -> np.ndarray:
            dy = np.empty(13)
            dy[12] = kernel.derivative(a + omega * t, y, dy, piece, problem.model)[0] ** 2
            return dy

        scale = np.array([1e-6] * 6 + [1e-2] * 6 + [1e-3])
        found = solve_ivp(rates, (0.0, (b - a) / omega), y, "DOP853", rtol=1e-10, atol=1e-10 * scale, dense_output=True)
        y = found.y[:, -1]
        yield piece, a, found


def by_scipy(problem: Problem, periods: int) -> float:
    """Return the mean square of a_o in the last of some periods."""
    y = np.zeros(13)
    for _ in range(periods):
        y[12] = 0.0
        *_, (_, _, last) = pieces_by_scipy(problem, y)
        y = last.y[:, -1]
    return y[12] / problem.scene.period


@pytest.mark.parametrize("scene", [SPALL, PIT, SEVERAL, replace(ROLLERS, rough=None)])
def test_a_second_integrator_gives_the_same_motion(scene: OracleScene) -> None:
    problem, periods = Problem(scene), effort_count(quick=1, full=3)
    history = problem.run(1e-9, Caps(periods=periods))
    assert history.power[-1] == pytest.approx(by_scipy(problem, periods), rel=1e-6)


def test_instants_are_those_of_a_fine_scan() -> None:
    problem = Problem(SEVERAL)
    state = problem.run(1e-9, Caps(periods=40)).state
    counted = problem.run(1e-9, Caps(periods=1), state).instants[0]
    signs: list[np.ndarray] = []
    for piece, a, found in pieces_by_scipy(problem, np.append(state, 0.0)):
        for t in np.linspace(0.0, found.t[-1], 400):
            gaps = np.empty((24, 2))
            kernel.gaps(a + SEVERAL.omega_c * t, found.sol(t)[:12], piece, problem.model, gaps)
            signs.append(gaps[:, 0] > 0.0)
    assert counted == np.sum(np.diff(signs, axis=0)) > 0


@pytest.mark.parametrize("scene", [PARTING, SEVERAL, replace(ROLLERS, extent=0.017, depth=16e-6, rough=None)])
def test_coarse_steps_miss_no_contact(scene: OracleScene) -> None:
    problem = Problem(scene)
    fine, coarse = (problem.run(tolerance, Caps(periods=60)).instants[-1] for tolerance in (1e-9, 1e-4))
    assert fine == coarse > 0


@pytest.mark.parametrize(("height", "looked_at"), [(0.3, False), (0.01, True), (-0.1, True)])
def test_an_extremum_that_may_be_beyond_zero_is_looked_at(height: float, looked_at: bool) -> None:
    """The gap is a parabola over the step, with its least value at 0.3 of it."""
    q0, q1 = height + 0.09, height + 0.49
    assert period.dip(q0, -0.6, q1, 1.4, 1e-12) == pytest.approx(0.3 if looked_at else 0.0)
    assert period.dip(q0, -0.6, q1, 1.4, 0.3) == 0.0
    assert period.dip(-q0, 0.6, -q1, -1.4, 1e-12) == 0.0


def test_the_rate_of_a_gap_is_its_derivative_in_time() -> None:
    problem, y = Problem(SEVERAL), 1e-6 * np.random.default_rng(0).uniform(-1.0, 1.0, 12)
    y[6:] *= 1e3
    for i, (a, b) in enumerate(pairwise(problem.bounds)):
        found, e = [np.empty((24, 2)) for _ in range(3)], 1e-3 * (b - a) / SEVERAL.omega_c
        piece = kernel.Piece(0.5 * (a + b), problem.codes[i], problem.middles[i])
        for gaps, t in zip(found, (-e, 0.0, e), strict=True):
            moved = np.concatenate((y[:6] + t * y[6:], y[6:]))
            kernel.gaps(piece.place + SEVERAL.omega_c * t, moved, piece, problem.model, gaps)
        slope = (found[2][:, 0] - found[0][:, 0]) / (2.0 * e)
        assert found[1][:, 1] == pytest.approx(slope, rel=1e-5, abs=1e-8)


def test_a_wave_of_order_zero_is_a_clearance() -> None:
    model = Problem(replace(SEVERAL, waves=(Wave(1e-6, 0, 0.0),))).model
    p = model.p.copy()
    p[kernel.P_CLEARANCE] += 1e-6 * p[kernel.P_COSINE]
    problem, found = Problem(SEVERAL), np.empty((2, 12))
    piece = kernel.Piece(0.1, problem.codes[0], problem.middles[0])
    for dy, same in zip(found, (model, model._replace(p=p, waves=np.empty((0, 3)))), strict=True):
        kernel.derivative(0.1, np.zeros(12), dy, piece, same)
    assert found[0] == pytest.approx(found[1], rel=1e-9)


def test_another_oracle_with_its_own_equations_agrees() -> None:
    case = six_dof_oracle.Case(40.0, 4000.0, SPALL.extent, SPALL.depth)
    other = six_dof_oracle.simulate_oracle(case, periods=16, rtol=1e-6, samples=1500)
    assert simulate_oracle(SPALL, estimate=False).rms == pytest.approx(other.rms, rel=3e-4)


@pytest.mark.parametrize("scene", [SPALL, PIT, ROLLERS, PARTING, SEVERAL])
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
        y, work, h = begin.copy(), period.work_for(24), 4e-4 / steps
        for i in range(steps):
            where = 0.1 + problem.scene.omega_c * h * i
            piece = kernel.Piece(0.0, problem.codes[0], problem.middles[0])
            period.attempt(where, h, y, still, piece, problem.model, work)
            y[:] = work.trial
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
