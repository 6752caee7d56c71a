"""The six-degree-of-freedom model against an independent integration, and its parts against obvious formulas."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from models.machine.bearing import from_catalogue
from models.machine.rig import Rig
from models.machine.scene import Defect, Floor, Scene
from models.path.defect import ball_path, race_profile
from models.solve.simulate import simulate
from models.solve.six_dof.kernels import period as kernels
from models.solve.six_dof.kernels.parts import path_within
from models.solve.six_dof.kernels.path import NUDGE
from models.solve.six_dof.kernels.period import blank_trace, mean_square
from models.solve.six_dof.kernels.period_setup import add_quadrature
from models.solve.six_dof.kernels.step import P_OMEGA, P_PITCH, StepNodes, oscillator
from reference.periods import period_of, run
from tests.oracles.six_dof_oracle import R_O, Case, OracleResponse, simulate_oracle
from tests.support.effort import effort_count

SCENE = Scene(40.0, 4000.0, defect=Defect(math.radians(20.0), 20e-6))
SEED = 5


def random_scenes(count: int) -> list[Scene]:
    """Return scenes over the range that the accuracy is promised for, half of them localised, a third rough."""
    rng = np.random.default_rng(SEED)
    scenes = []
    for i in range(count):
        extent = rng.uniform(0.8, 50.0) if i % 2 else rng.uniform(0.8, 8.0)
        floor = Floor("rough" if i % 3 == 2 else "smooth", seed=i)
        defect = Defect(math.radians(extent), rng.uniform(1.0, 32.0) * 1e-6, floor, rows=1 + (i % 5 == 4))
        clearance = 8e-6 if i % 7 == 6 else 0.0
        scenes.append(Scene(rng.uniform(15.0, 50.0), rng.uniform(500.0, 5000.0), defect=defect, clearance=clearance))
    return scenes


def oracle_of(scene: Scene) -> OracleResponse:
    """Return the oracle's answer; the realisation of a rough floor is handed over as numbers."""
    defect = scene.defect
    assert defect is not None
    path = ball_path(scene.bearing, defect)
    assert path is not None

    def roughness(angle: float) -> float:
        assert path is not None
        assert path.profile is not None
        return path.roughness * float(path.profile(np.array([angle]))[0][0])

    rough = roughness if path.profile is not None else None
    case = Case(scene.speed, scene.load, defect.dphi_d, defect.h_d, scene.clearance, defect.rows, rough)
    settled = effort_count(quick=12, full=24)
    rtol = 10.0 ** -effort_count(quick=6, full=9)
    return simulate_oracle(case, periods=settled if scene.clearance == 0.0 else 40, rtol=rtol)


@pytest.mark.parametrize("scene", random_scenes(effort_count(quick=1, full=30)))
def test_against_the_oracle(scene: Scene) -> None:
    response, truth = simulate(scene), oracle_of(scene)
    assert response.status == "converged"
    assert response.rms == pytest.approx(truth.rms, rel=3e-3)
    # The first forty lines of the spectrum, phases included, are the waveform up to 3 kHz at least.
    period = truth.time[-1]
    lines = np.array(
        [
            np.trapezoid(truth.acceleration * np.exp(-2j * np.pi * k * truth.time / period), truth.time) / period
            for k in range(1, 41)
        ]
    )
    error = np.sqrt(2.0 * np.sum(np.abs(response.coefficients[0, 1:41] - lines) ** 2)) / truth.rms
    assert error < 1e-2


def test_order_of_the_integrator() -> None:
    """Steps that land on kinks keep the fourth order of Runge and Kutta where no contact opens or closes hard."""
    exact = simulate(SCENE, steps_per_period=4096, tolerance=1e-10).rms
    errors = [abs(simulate(SCENE, steps_per_period=n, tolerance=1e-10).rms - exact) for n in (256, 512, 1024)]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(orders > 3.3)
    assert np.all(orders < 5.5)


def test_error_of_the_default_steps() -> None:
    errors = []
    for scene in random_scenes(effort_count(quick=15, full=200)):
        fine = simulate(scene, steps_per_period=4096, tolerance=1e-7).rms
        errors.append(simulate(scene).rms / fine - 1.0)
    assert np.max(np.abs(errors)) < 3e-3
    assert np.sqrt(np.mean(np.square(errors))) < 1e-3


@given(st.floats(0.0, 1e10), st.floats(0.0, 1e5), st.floats(1e-7, 1e-4))
def test_oscillator_propagator_is_the_matrix_exponential(omega_squared: float, damping: float, h: float) -> None:
    scale = np.diag([1.0, 1.0 / max(1.0, math.sqrt(omega_squared))])
    exact = expm(np.array([[0.0, 1.0], [-omega_squared, -damping]]) * h)
    ours = np.array(oscillator(omega_squared, damping, h)).reshape(2, 2)
    inverse = np.diag(1.0 / np.diag(scale))
    assert scale @ ours @ inverse == pytest.approx(scale @ exact @ inverse, abs=1e-9)


@pytest.mark.parametrize("steps", range(1, 30))
def test_quadrature_is_exact_for_its_degree(steps: int) -> None:
    x = np.linspace(0.0, 1.0, steps + 1)
    weights = np.empty(steps + 1)
    add_quadrature(weights, 1.0 / steps)
    for degree in range({1: 2, 2: 4}.get(steps, 4)):
        assert weights @ x**degree == pytest.approx(1.0 / (degree + 1), rel=1e-12)


def duration_of(period: kernels.Period) -> float:
    return float(period.parameter[P_PITCH] / period.parameter[P_OMEGA])


def test_a_period_has_its_length_whatever_the_kinks() -> None:
    for scene in random_scenes(12):
        period = period_of(scene)
        lengths = period.flow[:, 0] * np.diff(period.first)
        assert lengths.sum() == pytest.approx(duration_of(period), rel=1e-12)
        assert period.time[-1] == pytest.approx(duration_of(period), rel=1e-12)
        assert period.weight.sum() == pytest.approx(1.0, rel=1e-12)
        # The ends of neighbouring segments are the same instant, to rounding.
        assert np.all(np.diff(period.time) > -1e-15)


def test_tables_hold_the_path_and_its_one_sided_slopes() -> None:
    path = ball_path(SCENE.bearing, SCENE.defect)
    assert path is not None
    period = period_of(SCENE)
    nodes, omega = period.nodes, float(period.parameter[P_OMEGA])
    positions = np.arctan2(period.balls.moved[1], period.balls.moved[0])
    cage = np.arctan2(nodes.turn[..., 1], nodes.turn[..., 0])
    # Between kinks; at the ends of segments the slope is the limit from within.
    cage[:, 0] += NUDGE
    cage[:, 2] -= NUDGE
    depth, slope = path(cage[..., None] + positions)
    assert nodes.depth == pytest.approx(depth, abs=1e-11)
    assert nodes.rate == pytest.approx(omega * slope, abs=1e-6)
    # At every inner boundary the slope jumps or the curvature does; inside, the ends of neighbouring steps agree.
    gaps = np.abs(nodes.rate[1:, 0] - nodes.rate[:-1, 2]).max(axis=1)
    inner = np.ones(len(gaps), dtype=bool)
    inner[period.first[1:-1] - 1] = False
    assert gaps[inner].max() < 1e-4
    assert gaps[~inner].max() > 0.1


def test_interpolation_within_a_step_is_that_of_a_quintic() -> None:
    rng = np.random.default_rng(0)
    coefficients = rng.standard_normal((6, 3))
    span = 0.37

    def at(fraction: float) -> tuple[np.ndarray, np.ndarray]:
        t = fraction * span
        powers = np.array([t**k for k in range(6)])
        slopes = np.array([k * t ** max(k - 1, 0) for k in range(6)])
        return powers @ coefficients, slopes @ coefficients

    nodes = [at(f) for f in (0.0, 0.5, 1.0)]
    depth, rate = (np.array([[node[i] for node in nodes]]) for i in (0, 1))
    for place in np.linspace(0.0, 1.0, 9):
        within = StepNodes(np.empty((1, 3, 2)), np.empty((1, 3, 3)), np.empty((1, 3, 3)), None)
        path_within(place, np.int64(1), span, StepNodes(within.turn, depth, rate, None), np.int64(0), within)
        value, slope = at(place)
        assert within.depth[0, 1] == pytest.approx(value, abs=1e-12)
        assert within.rate[0, 1] == pytest.approx(slope, abs=1e-10)


def test_the_bound_on_far_balls_changes_nothing() -> None:
    for scene in (SCENE, replace(SCENE, defect=None), replace(SCENE, clearance=1e-5, load=100.0)):
        period = period_of(scene)
        balls = period.balls
        everything = period._replace(balls=balls._replace(near=balls.plain.shape[1]))
        state, trace = np.zeros((2, 6)), blank_trace(period)
        for _ in range(5):
            a, b = run(period, state, trace), run(everything, state, trace)
            assert a == pytest.approx(b, rel=1e-9, abs=1e-15)
            state = a


def test_the_acceleration_is_that_of_the_equation_of_motion() -> None:
    """Newton for everything that hangs on the outer ring: its momentum over a period is the contact force's impulse."""
    period = period_of(SCENE, 1024)
    state, trace, duration = np.zeros((2, 6)), blank_trace(period), duration_of(period)
    for _ in range(3):
        after = run(period, state, trace)
        rig = SCENE.rig_as(Rig)
        gained = (after[0, 3] - state[0, 3]) * (rig.m_o + rig.m_r)
        mean = trace.weight @ trace.wave + trace.parts[:, :2].sum(axis=0, where=trace.changed[:, None])
        impulse = duration * float(rig.m_o * mean[0] + rig.m_r * mean[1])
        scale = duration * rig.m_o * math.sqrt(mean_square(trace, 0))
        assert gained == pytest.approx(impulse, abs=1e-4 * scale)
        state = after


def test_a_defect_on_the_other_side_of_the_load_is_silent() -> None:
    assert SCENE.defect is not None
    opposite = replace(SCENE, defect=replace(SCENE.defect, position=math.pi))
    # Its kinks lead to other steps, the error of which is asked to be as small.
    healthy = simulate(replace(SCENE, defect=None), accuracy=1e-6).rms
    assert simulate(opposite, accuracy=1e-6).rms == pytest.approx(healthy, rel=1e-6)
    assert simulate(SCENE).rms > 100.0 * healthy


def test_mirror_images_sound_alike_up_to_the_sense_of_rotation() -> None:
    assert SCENE.defect is not None
    left, right = (replace(SCENE, defect=replace(SCENE.defect, position=x)) for x in (0.2, -0.2))
    assert simulate(left).rms != pytest.approx(simulate(right).rms, rel=1e-6)
    assert simulate(left).rms == pytest.approx(simulate(right).rms, rel=0.3)


def test_a_full_turn_of_the_position_changes_nothing() -> None:
    assert SCENE.defect is not None
    turned = replace(SCENE, defect=replace(SCENE.defect, position=2.0 * math.pi))
    assert simulate(turned).rms == pytest.approx(simulate(SCENE).rms, rel=1e-6)


def test_both_rows_are_staggered_by_half_a_spacing() -> None:
    """With both rows damaged alike the motion repeats twice a ball period: odd lines vanish."""
    assert SCENE.defect is not None
    response = simulate(replace(SCENE, defect=replace(SCENE.defect, rows=2)), tolerance=1e-8)
    assert response.harmonics[[0, 2, 4]].max() < 1e-4 * response.harmonics[1]


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"load": -1.0}, "load"),
        ({"load": math.nan}, "load"),
        ({"clearance": -1e-6}, "clearance"),
        ({"speed": 0.0}, "speed"),
        ({"bearing": from_catalogue("NU 202 ECP")}, "roller"),
        ({"bearing": replace(from_catalogue("6205"), rotating_ring="outer")}, "outer_ring_turns"),
        ({"rig": Rig(element="roller")}, "roller"),
        ({"defect": Defect(0.1, 1e-5, rows=3)}, "defect.rows"),
        ({"defect": Defect(0.1, 1e-5, first_row=2)}, "defect.first_row"),
        ({"unbalance": -1e-3}, "unbalance"),
        ({"model": "none"}, "model"),
    ],
)
def test_what_the_model_cannot_describe_is_refused(change: dict[str, object], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        simulate(replace(SCENE, **change))


def test_a_single_row_bearing_is_modelled_too() -> None:
    scene = replace(SCENE, bearing=from_catalogue("6205"))
    response = simulate(scene)
    assert response.status == "converged"
    assert response.bpfo == pytest.approx(3.585 * 40.0, rel=1e-3)


def test_rough_floor_scales_from_the_smooth_one() -> None:
    """Roughness of no deviation is a smooth floor, and the response depends on it continuously."""
    assert SCENE.defect is not None
    smooth = simulate(SCENE).rms
    for sd, tolerance in ((0.0, 1e-12), (1e-9, 1e-2)):
        rough = replace(SCENE, defect=replace(SCENE.defect, floor=Floor("rough", sd=sd)))
        assert simulate(rough).rms == pytest.approx(smooth, rel=tolerance)
    assert race_profile(1e-9, 2e-3, 840.0, 0, R_O).highest < 1e-8
