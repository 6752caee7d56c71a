"""The integrators that the project's own is compared with: right-hand side, order, and what the page makes of them."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from benchmarks import opponents as op
from benchmarks.common import Row
from benchmarks.speed_page import reach_table, reference_table, renew, settled_table, time_to_reach
from benchmarks.work_precision import (
    DT0,
    SCALE,
    SCENES,
    Problem,
    multistep_weights,
    propagators,
    run_dormand_prince,
    run_lawson,
    run_multistep,
    run_product,
    run_rk4,
)
from models.machine.scene import Scene
from tests.oracles import six_dof_oracle as oracle

ROOT = Path(__file__).resolve().parents[4]
SPAN = 0.6e-3
STEPS = (48, 96, 192)
Ends = tuple[NDArray[np.float64], NDArray[np.float64]]


@pytest.fixture(scope="module")
def problem() -> Problem:
    return Problem(SCENES["20 deg, 20 um, rough"])


@pytest.fixture(scope="module")
def healthy() -> Problem:
    # The clearance puts the instants at which balls meet and leave their contact outside SPAN.
    return Problem(Scene(40.0, 4000.0, clearance=2.2e-6))


def start_of(problem: Problem) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return one start far from rest in both coordinates (explicit, exponential)."""
    y = problem.from_rest()
    y[[1, 3, 5, 7, 9, 11]] += 4e-4, -2e-4, 1e-3, 2e-4, 6e-4, -8e-4
    problem_state, problem.state = problem.state, y.reshape(2, 6)
    x = problem.from_zero_load()
    problem.state = problem_state
    return x, y


def contacts(problem: Problem, t: float, x: NDArray[np.float64]) -> int:
    return op.contact(t, t, x[0] - x[2], x[1] - x[3], x[6] - x[8], x[7] - x[9], problem.arrays)[2]


@pytest.fixture(scope="module")
def exact_end(healthy: Problem) -> Ends:
    """The healthy state after SPAN in both coordinates; no ball meets or leaves its contact within."""

    def rhs(t: float, x: NDArray[np.float64]) -> NDArray[np.float64]:
        out = np.empty(12)
        op.derivative(t, t, x, out, healthy.arrays)
        return out

    times = np.linspace(0.0, SPAN, 49)
    found = solve_ivp(rhs, (0.0, SPAN), start_of(healthy)[0], "DOP853", times, rtol=1e-12, atol=1e-14 * SCALE)
    assert len({contacts(healthy, t, x) for t, x in zip(times, found.y.T, strict=True)}) == 1
    x = found.y[:, -1] - healthy.rest
    return found.y[:, -1], to_exponential(x)


def to_exponential(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return deviations from rest in the coordinates of exponential methods, written out."""
    mass = oracle.M_O + oracle.M_R
    y = np.empty(12)
    for axis in range(2):
        for part in range(2):
            inner, outer, resonator = x[6 * part + axis :: 2][:3]
            centre = (oracle.M_O * outer + oracle.M_R * resonator) / mass
            y[6 * axis + part :: 2][:3] = inner, centre, outer - resonator
    return y


def orders(errors: list[float]) -> NDArray[np.float64]:
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


def distance(a: NDArray[np.float64], b: NDArray[np.float64], scale: NDArray[np.float64]) -> float:
    return float(np.max(np.abs(a - b) / scale))


@pytest.mark.parametrize("scene", ["problem", "healthy"])
def test_the_right_hand_side_is_that_of_the_oracle(scene: str, request: pytest.FixtureRequest) -> None:
    problem: Problem = request.getfixturevalue(scene)
    rng = np.random.default_rng(3)
    worst = 0.0
    for t in rng.uniform(0.0, 2.0 * problem.period, 40):
        x = problem.from_zero_load() + rng.standard_normal(12) * SCALE
        ours, swapped = np.empty(12), x.reshape(6, 2)[:, ::-1].ravel()
        op.derivative(float(t), float(t), x, ours, problem.arrays)
        theirs = problem.exact.rhs(float(t), swapped, float(t)).reshape(6, 2)[:, ::-1].ravel()
        worst = max(worst, float(np.max(np.abs(ours - theirs)) / np.max(np.abs(theirs))))
    assert worst < 1e-6


def test_both_coordinates_describe_one_motion(healthy: Problem) -> None:
    x, y = start_of(healthy)
    assert to_exponential(x - healthy.rest) == pytest.approx(y, rel=1e-9, abs=1e-15)


def test_order_of_explicit_runge_kutta(healthy: Problem, exact_end: Ends) -> None:
    exact, _ = exact_end
    errors = []
    for steps in STEPS:
        x = start_of(healthy)[0]
        op.runge_kutta_4(np.linspace(0.0, SPAN, steps + 1), False, x, np.empty(steps), healthy.arrays)
        errors.append(distance(x, exact, SCALE))
    assert orders(errors) == pytest.approx(4.0, abs=0.4)


@pytest.mark.parametrize("sided", [False, True])
def test_order_of_lawson(healthy: Problem, exact_end: Ends, sided: bool) -> None:
    _, exact = exact_end
    errors = []
    for steps in (12, 24, 48):
        y, segment = start_of(healthy)[1], np.zeros(steps, dtype=np.int64)
        nodes, flow = np.linspace(0.0, SPAN, steps + 1), propagators(0.5 * SPAN / steps)[None]
        op.lawson(nodes, segment, flow, flow, sided, False, y, np.empty(steps), healthy.arrays)
        errors.append(distance(y, exact, np.tile([1e-6, 1e-2], 6)))
    assert orders(errors) == pytest.approx(4.0, abs=0.5)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_order_of_exponential_multistep(healthy: Problem, exact_end: Ends, order: int) -> None:
    _, exact = exact_end
    errors = []
    for steps in (96, 192, 384):
        h, y = SPAN / steps, start_of(healthy)[1]
        history, fine = np.zeros((order, 2)), propagators(0.5 * h / 32)[None]
        for k in range(order - 1):
            history[order - 1 - k] = op.excess(k * h, k * h, y, healthy.arrays)[:2]
            nodes = np.linspace(k * h, (k + 1) * h, 33)
            op.lawson(nodes, np.zeros(32, dtype=np.int64), fine, fine, False, False, y, np.empty(32), healthy.arrays)
        weights, wave = multistep_weights(h, order), np.empty(steps - order + 1)
        op.exponential_multistep(h, order - 1, propagators(h), weights, history, y, wave, healthy.arrays)
        errors.append(distance(y, exact, np.tile([1e-6, 1e-2], 6)))
    assert orders(errors) == pytest.approx(float(order), abs=0.4)


def test_a_constant_force_moves_to_its_equilibrium_exactly() -> None:
    """The weights of a step, summed, are the exact response to a constant force from rest, whatever the order."""
    one = multistep_weights(DT0, 1).sum(axis=0)
    for order in (2, 3, 4):
        assert multistep_weights(DT0, order).sum(axis=0) == pytest.approx(one, rel=1e-9)
    flow = propagators(DT0)
    static = np.array([[-1.0 / oracle.K_I, 0.0]])
    assert one[:2] == pytest.approx((static - static @ flow[0].T).ravel(), rel=1e-9)


def test_order_of_dormand_prince(healthy: Problem, exact_end: Ends) -> None:
    """The error falls with the fifth power of the mean step while the tolerance is tightened."""
    exact, _ = exact_end
    points = []
    for rtol in (1e-5, 1e-7, 1e-9):
        x = start_of(healthy)[0]
        count, evaluations = op.dormand_prince(
            SPAN, rtol, rtol * SCALE, x, np.empty(9999), np.empty(9999), healthy.arrays
        )
        assert evaluations >= 6 * count
        points.append((math.log(count), math.log(distance(x, exact, SCALE))))
    (n0, e0), _, (n1, e1) = points
    assert (e0 - e1) / (n1 - n0) == pytest.approx(5.0, abs=0.8)


def test_coefficients_of_dormand_prince_are_consistent() -> None:
    assert op.DP_A.sum(axis=1) == pytest.approx(op.DP_C, abs=1e-14)
    assert op.DP_E.sum() == pytest.approx(0.0, abs=1e-14)
    for power in range(1, 5):
        assert op.DP_A[6] @ op.DP_C[:6] ** power == pytest.approx(1.0 / (power + 1), abs=1e-14)


def test_too_short_arrays_are_reported(healthy: Problem) -> None:
    x = start_of(healthy)[0]
    count, _ = op.dormand_prince(SPAN, 1e-6, 1e-6 * SCALE, x, np.empty(3), np.empty(3), healthy.arrays)
    assert count == -1


def test_what_each_ingredient_buys_over_a_floor(problem: Problem) -> None:
    """Landing without one-sided slopes gains nothing; with them it is fourth order."""

    def wave_error(step: float, landed: bool, sided: bool) -> float:
        return problem.judge(run_lawson(problem, step, landed=landed, sided=sided, refined=False), 1).wave_error

    equal, landed, sided = (wave_error(0.5 * DT0, *flags) for flags in ((False, False), (True, False), (True, True)))
    assert landed > 0.3 * equal
    assert sided < 0.01 * landed
    assert math.log2(wave_error(DT0, True, True) / sided) == pytest.approx(4.0, abs=0.5)


def test_the_kernel_of_the_project_is_lawson_with_all_ingredients(problem: Problem) -> None:
    ours = problem.judge(run_product(problem, math.ceil(problem.period / DT0)), 1)
    theirs = problem.judge(run_lawson(problem, DT0, landed=True, sided=True, refined=True), 1)
    assert ours.rms_error == pytest.approx(theirs.rms_error, rel=0.1)
    assert ours.wave_error == pytest.approx(theirs.wave_error, rel=0.1)


def test_every_method_comes_near_the_reference(problem: Problem) -> None:
    for work in (
        run_rk4(problem, 0.25 * DT0, landed=True),
        run_multistep(problem, 0.25 * DT0, 3),
        run_multistep(problem, 0.25 * DT0, 4),
        run_dormand_prince(problem, 1e-5, 1e-5 * SCALE),
    ):
        assert problem.judge(work, 1).wave_error < 3e-2


def test_the_reference_is_the_motion_of_dop853(problem: Problem) -> None:
    rms, wave = problem.against_oracle()
    assert abs(rms) < 1e-6
    assert wave < 1e-5


def test_time_to_reach_interpolates_and_ignores_luck() -> None:
    def rows(*points: tuple[float, float]) -> list[Row]:
        return [{"setting": "x", "ms a second": t, "waveform error": e} for t, e in points]

    assert time_to_reach(rows((1.0, 1e-1), (144.0, 1e-3)), 1e-2) == "12"
    assert time_to_reach(rows((1.0, 1e-4), (10.0, 1e-1), (1440.0, 1e-3)), 1e-2) == "120"
    assert time_to_reach(rows((2.0, 1e-3), (4.0, 1e-4)), 1e-2) == "≤ 2.0"
    assert time_to_reach(rows((2.0, 1e-1), (4.0, 2e-2)), 1e-2) == "–"


def stored() -> dict[str, list[Row]]:
    return json.loads((ROOT / "benchmarks" / "results" / "integrators.json").read_text(encoding="utf-8"))


@pytest.mark.process
def test_a_page_without_marks_is_refused(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("nothing\n", encoding="utf-8")
    with pytest.raises(ValueError, match="lacks the lines"):
        renew(page, stored())


def test_the_page_shows_the_stored_figures() -> None:
    page, tables = (ROOT / "docs" / "evidence" / "speed-against-error.md").read_text(encoding="utf-8"), stored()
    for table in (
        reach_table(tables["runs"]),
        reference_table(tables["references"]),
        settled_table(tables["settled"]),
    ):
        assert table in page
