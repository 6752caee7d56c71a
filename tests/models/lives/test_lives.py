"""Laws of growth and the paths drawn by them: where they begin and end, that they never fall, and crossings."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.lives.laws import LAWS, PATH_STEP, GrowthPath, draw_law, grow
from models.lives.life import LifeHistory, LifePlan, _grouped, _slow_changes, draw_life, simulate_life, simulate_lives
from models.lives.population import Population, Range
from models.machine.bearing import catalogue_entry, from_catalogue, kinematics
from models.machine.scene import Scene, Slip
from models.path.defect import race_radius
from models.solve.nominal_rigs import nominal_rig
from models.solve.ring_impact.rig import RingImpactRig
from models.solve.rotor.rig import RotorRig
from models.solve.simulate import simulate
from models.solve.six_dof.time_domain import simulate_time
from models.work.choose import local_runner
from monitor.health.signal.features import FeatureSettings, block_features, fundamentals
from tests.support.effort import effort_count

THRESHOLD = 0.05e-6
RATE = 25600.0
SHORT = Population(
    durations=(150 * 60.0, 200 * 60.0), interval=1800.0, laws=tuple((law, 1.0) for law in LAWS[:5]), load_steps=0.0
)
# Nothing between the model and what is measured but the bearing's own rig and floor.
PLAIN = replace(
    SHORT,
    gain_sd=0.0,
    gain_drift=0.0,
    harmonic_gain_sd=0.0,
    scatter=(0.0, 0.0),
    line_scatter=(0.0, 0.0),
    load_error=0.0,
    speed_error=0.0,
    load_jitter=0.0,
    speed_jitter=0.0,
    background_rms=(1e-9, 1e-9),
    background_harmonic=(1e-9, 1e-9),
    missing=0.0,
)


@cache
def life(population: Population, number: int) -> LifeHistory:
    return simulate_life(population, number)


def scenes(population: Population, plan: LifePlan, t: np.ndarray) -> list[Scene]:
    defects = plan.defects(t, population.threshold, race_radius(population.bearing))
    slip = Slip(plan.slip, seed=1) if plan.slip > 0.0 else None
    return [Scene(plan.speed, plan.load, population.bearing, plan.rig, defect, slip=slip) for defect in defects]


def same(a: LifeHistory, b: LifeHistory) -> bool:
    names = ("t", "load", "speed", "rms", "harmonics", "v_eq", "dphi_d", "h_d")
    return (a.number, a.law) == (b.number, b.law) and all(np.array_equal(getattr(a, n), getattr(b, n)) for n in names)


def test_half_of_the_lives_have_any_shape_and_some_stand_still() -> None:
    drawn = [draw_life(Population(), number) for number in range(300)]
    assert 0.3 < np.mean([plan.law == "monotone" for plan in drawn]) < 0.5
    still = [plan.path for plan in drawn if plan.law == "standstill"]
    assert 10 < len(still) < 80
    assert all(path.v_eq[-1] == path.v_eq[-30] for path in still)
    durations = Population().durations
    assert all(path.t[-1] <= 4.0 * durations[1] for path in still)


def test_a_population_survives_json_and_its_hash_knows_every_field() -> None:
    population = Population(laws=(("power", 2.0), ("quadratic", 1.0)), rms_band=None, slip=(0.001, 0.002), seed=7)
    assert Population.from_json(population.as_json()) == population
    assert Population.from_json(Population().as_json()) == Population()
    others = [
        replace(population, seed=8),
        replace(population, scatter=(0.03, 0.03)),
        replace(population, load=(3000.0, 4000.0)),
    ]
    assert len({p.hash() for p in [population, *others]}) == 4


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("load", (5000.0, 3000.0)),
        ("speed", (0.0, 40.0)),
        ("scatter", (-0.1, 0.1)),
        ("v_0", (0.01e-6, 0.06e-6)),
        ("laws", (("cubic", 1.0),)),
        ("laws", (("power", 0.0),)),
        ("rig_spread", (("calibrated", 0.1),)),
        ("rig_spread", (("k_x", 0.1),)),
        ("missing", 1.0),
        ("interval", 0.0),
    ],
)
def test_a_population_that_is_none_is_refused_by_name(field: str, value: object) -> None:
    with pytest.raises(ValueError, match=field):
        replace(Population(), **{field: value})


def test_lives_with_slip_have_one_speed() -> None:
    with pytest.raises(ValueError, match="speed_variation"):
        Population(slip=(0.0, 0.01), speed_variation=0.1)


def test_broken_json_of_a_population_is_refused() -> None:
    with pytest.raises(ValueError, match="population"):
        Population.from_json('{"seed": 1}')


@pytest.mark.parametrize("slip", [(0.0, 0.0), (0.004, 0.004)])
def test_a_life_depends_on_the_population_and_its_number_alone(slip: Range) -> None:
    population = replace(SHORT, slip=slip)
    numbers = [3, 0, 2]
    seen: list[tuple[int, int]] = []
    with local_runner(2) as runner:
        several = list(simulate_lives(population, numbers, runner, lambda done, total: seen.append((done, total))))
    assert [h.number for h in several] == numbers
    assert seen == [(1, 3), (2, 3), (3, 3)]
    assert all(same(a, b) for a, b in zip(several, simulate_lives(population, numbers), strict=True))
    assert same(several[1], simulate_life(population, 0))
    assert not same(several[1], simulate_life(replace(population, seed=1), 0))


def test_the_truth_is_consistent() -> None:
    for number in range(effort_count(quick=3, full=20)):
        history = life(SHORT, number)
        r_o = race_radius(SHORT.bearing)
        assert history.v_eq == pytest.approx(r_o * history.dphi_d * history.h_d, rel=1e-12)
        crossing = history.crossing(THRESHOLD)
        before = history.t < crossing
        assert np.all(history.v_eq[before] < THRESHOLD)
        assert np.all(history.v_eq[~before] >= THRESHOLD)
        assert crossing < history.t[-1] <= 1.35 * crossing
        assert np.all(np.diff(history.t) > 0.0)
        assert np.all(history.rms > 0.0)
        assert history.harmonics.shape == (history.t.size, 6)


def test_lives_go_beyond_the_largest_threshold_of_interest() -> None:
    history = life(replace(SHORT, until=0.1e-6, load_jitter=0.0), 1)
    assert history.v_eq[-1] > 0.1e-6
    assert history.crossing(0.03e-6) < history.crossing(0.05e-6) < history.crossing(0.1e-6) < history.t[-1]


def test_without_scatter_a_block_is_the_simulation_of_its_scene() -> None:
    history, plan = life(PLAIN, 4), draw_life(PLAIN, 4)
    for scene, rms, harmonics in zip(scenes(PLAIN, plan, history.t), history.rms, history.harmonics, strict=True):
        response = simulate(scene, band=PLAIN.rms_band)
        assert rms == pytest.approx(response.rms, rel=0.02)
        assert harmonics[:3] == pytest.approx(response.harmonics[:3], rel=0.02, abs=0.02)


def test_gains_background_and_scatter_act_as_said() -> None:
    population = replace(
        PLAIN, gain_sd=0.3, harmonic_gain_sd=0.3, background_rms=(2.0, 2.0), background_harmonic=(1.0, 1.0)
    )
    plain, history, plan = life(PLAIN, 4), life(population, 4), draw_life(population, 4)
    assert history.rms == pytest.approx(np.hypot(plan.gain * plain.rms, 2.0))
    assert history.harmonics == pytest.approx(np.hypot(plan.gain * plan.harmonic_gain * plain.harmonics, 1.0))
    noisy = life(replace(PLAIN, scatter=(0.02, 0.02), line_scatter=(0.02, 0.02), interval=300.0), 4)
    quiet = life(replace(PLAIN, interval=300.0), 4)
    spread = np.std(np.log(noisy.rms / quiet.rms))
    assert 0.012 < spread < 0.03


def test_the_gain_drifts_by_as_much_as_is_said_by_the_end() -> None:
    found = [_slow_changes(replace(PLAIN, gain_drift=0.05), draw_life(PLAIN, number), 100)[1] for number in range(200)]
    ends, middles = np.log([drift[-1] for drift in found]), np.log([drift[49] for drift in found])
    assert 0.04 < ends.std() < 0.06
    assert 0.6 < middles.std() / ends.std() < 0.85


def test_the_load_takes_known_steps_within_its_range() -> None:
    stepping = replace(PLAIN, load_steps=3.0)
    found = [_slow_changes(stepping, draw_life(stepping, number), 200)[0] for number in range(100)]
    assert 2.0 < np.mean([np.count_nonzero(np.diff(load)) for load in found]) < 4.0
    assert all(stepping.load[0] <= load.min() and load.max() <= stepping.load[1] for load in found)
    history = life(stepping, 1)
    assert len(np.unique(history.load)) > 1
    assert stepping.load[0] <= history.load.min() < history.load.max() <= stepping.load[1]


def test_blocks_with_slip_have_speeds_of_their_own_in_groups() -> None:
    factors = 1.0 + 0.004 * np.random.default_rng(0).standard_normal(130)
    grouped = _grouped(factors)
    speeds, counts = np.unique(grouped, return_counts=True)
    assert len(speeds) == 5
    assert counts.max() <= 32
    assert grouped.mean() == pytest.approx(factors.mean())
    assert 0.9 < grouped.std() / factors.std() <= 1.0
    assert np.all(np.diff(grouped[np.argsort(factors)]) >= 0.0)
    assert np.array_equal(_grouped(np.ones(50)), np.ones(50))


def test_a_population_of_version_1_had_neither_drift_nor_steps() -> None:
    stored = json.loads(Population().as_json())
    del stored["gain_drift"], stored["load_steps"]
    old = Population.from_json(json.dumps(stored))
    assert (old.gain_drift, old.load_steps) == (0.0, 0.0)
    assert replace(old, gain_drift=Population.gain_drift, load_steps=Population.load_steps) == Population()


def test_missing_blocks_are_absent_and_move_nothing_else() -> None:
    whole, holed = (
        life(replace(PLAIN, scatter=(0.02, 0.02), line_scatter=(0.02, 0.02)), 2),
        life(replace(PLAIN, scatter=(0.02, 0.02), line_scatter=(0.02, 0.02), missing=0.5), 2),
    )
    assert 0 < holed.t.size < whole.t.size
    kept = np.isin(whole.t, holed.t)
    assert np.array_equal(whole.rms[kept], holed.rms)


def test_known_conditions_vary_and_unknown_ones_stay_unknown() -> None:
    steady, varying = life(SHORT, 5), life(replace(SHORT, load_variation=0.2, speed_variation=0.1), 5)
    plan = draw_life(SHORT, 5)
    assert np.all(steady.load == plan.load)
    assert np.all(steady.speed == plan.speed)
    assert np.ptp(varying.load) > 0.0
    assert np.all(np.abs(varying.load / plan.load - 1.0) <= 0.2)
    assert np.all(np.abs(varying.speed / plan.speed - 1.0) <= 0.1)


def test_harmonics_outside_the_band_are_nought_as_in_the_features() -> None:
    population = replace(PLAIN, rms_band=(500.0, 9500.0), speed=(40.0, 40.0))
    bpfo = kinematics(population.bearing, 40.0).bpfo
    shown = bpfo * np.arange(1, 7) >= 500.0
    history = life(population, 1)
    assert np.all(history.harmonics[:, ~shown] == 0.0)
    assert np.all(history.harmonics[:, shown] > 0.0)


def measured(population: Population, scene: Scene, x: np.ndarray) -> tuple[float, np.ndarray]:
    lines = fundamentals(kinematics(population.bearing, scene.speed))
    settings = FeatureSettings(rate=RATE, bands=((7000.0, 9000.0),), fundamentals=lines, rms_band=population.rms_band)
    features = block_features(x, RATE, settings)
    return features.rms, features.bpfo_amplitude


def test_figures_mean_what_the_features_of_a_sampled_block_give() -> None:
    noise = 0.5
    share = math.sqrt(9500.0 / (RATE / 2.0))
    population = replace(PLAIN, background_rms=(noise * share, noise * share))
    rng = np.random.default_rng(1)
    for number in range(effort_count(quick=3, full=12)):
        history, plan = life(population, number), draw_life(population, number)
        for k in (0, history.t.size // 2, history.t.size - 1):
            scene = scenes(population, plan, history.t)[k]
            x = simulate(scene, band=(0.0, 12000.0)).acceleration(RATE, 5.0, phase=float(rng.uniform(0.0, 6.0)))
            x = x + noise * rng.standard_normal(x.size)
            rms, harmonics = measured(population, scene, x)
            assert history.rms[k] == pytest.approx(rms, rel=0.02)
            assert history.harmonics[k, :3] == pytest.approx(harmonics[:3], rel=0.03, abs=0.02)


def test_figures_with_slip_mean_what_the_features_of_a_sampled_block_give() -> None:
    population = replace(PLAIN, slip=(0.004, 0.004), speed=(38.0, 42.0))
    plan = draw_life(population, 1)
    history = life(population, 1)
    for k in (history.t.size // 2, history.t.size - 1):
        scene = scenes(population, plan, history.t)[k]
        rms, harmonics = measured(population, scene, simulate_time(scene, 2.0, RATE).acceleration(RATE, 2.0))
        # Two finite records of one random motion: 42 ball periods against some 400.
        assert history.rms[k] == pytest.approx(rms, rel=0.1)
        assert history.harmonics[k, :2] == pytest.approx(harmonics[:2], rel=0.1, abs=0.03)


def test_a_depth_follows_its_share_of_the_volume() -> None:
    plan = draw_life(SHORT, 6)
    t = np.array([0.0, 3600.0, 7200.0])
    found = plan.defects(t, THRESHOLD, 0.02)
    v_eq = plan.path.at(t)
    for (a, v_a), (b, v_b) in pairwise(zip(found, v_eq, strict=True)):
        assert math.log(b.h_d / a.h_d) == pytest.approx(plan.depth_share * math.log(v_b / v_a), rel=1e-9)


@pytest.mark.process
def test_a_population_loads_no_kernels() -> None:
    code = (
        "import sys; from models.lives.life import Population, draw_life; draw_life(Population(), 1); "
        "assert 'numba' not in sys.modules and 'xarray' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


OTHER = replace(
    PLAIN,
    bearing=from_catalogue("6205"),
    rig=nominal_rig(RotorRig, catalogue_entry("6205")),
    rig_spread=(("m", 0.035), ("k_c", 0.035)),
    interval=3600.0,
    speed=(40.0, 40.0),
)


def test_lives_of_another_model_are_its_scenes() -> None:
    plan, history = draw_life(OTHER, 0), simulate_life(OTHER, 0)
    assert isinstance(plan.rig, RotorRig)
    assert plan.rig != OTHER.rig
    assert plan.floor.kind == "smooth"
    assert len(history.t) > 1
    for k in (0, -1):
        defect = plan.defects(history.t[[k]], OTHER.threshold, race_radius(OTHER.bearing))[0]
        scene = Scene(plan.speed, plan.load, OTHER.bearing, plan.rig, defect, model="rotor")
        found = simulate(scene, accuracy=1e-4, band=OTHER.rms_band, duration=1.0)
        assert history.rms[k] == pytest.approx(found.rms, rel=5e-3)
        assert history.harmonics[k, 0] == pytest.approx(found.harmonics[0], abs=0.02 * found.rms)


def test_a_population_names_its_model_and_has_a_hash_of_its_own() -> None:
    assert Population.from_json(OTHER.as_json()) == OTHER
    assert '"model": "rotor"' in OTHER.as_json()
    assert "model" not in PLAIN.as_json()
    assert OTHER.hash() != PLAIN.hash()


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"rig": RingImpactRig(), "rig_spread": ()}, "V_eq cannot be told by the model ring_impact"),
        ({"slip": (0.0, 0.01)}, "population slip is one of six_dof, the rig is that of rotor"),
        ({"rig_spread": (("k_r", 0.01),)}, "rig_spread names k_r"),
    ],
)
def test_what_lives_of_another_model_lack_is_refused(changed: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        replace(OTHER, **changed)


GROWTH_LAWS_THRESHOLD = 0.05e-6
GROWING = tuple(law for law in LAWS if law != "standstill")


@given(st.sampled_from(GROWING), st.integers(0, 10**6), st.floats(2.0, 100.0))
def test_a_law_rises_from_nought_to_one_and_on(law: str, seed: int, ratio: float) -> None:
    curve = draw_law(law, np.random.default_rng(seed), ratio)
    w = curve(np.linspace(0.0, 2.0, 801))
    assert w[0] == pytest.approx(0.0, abs=1e-12)
    assert w[400] == pytest.approx(1.0, rel=1e-9)
    assert np.all(np.diff(w) >= 0.0)
    assert w[800] > 1.0


@given(st.integers(0, 10**6))
def test_a_standstill_grows_to_a_level_below_the_threshold_and_then_no_more(seed: int) -> None:
    w = draw_law("standstill", np.random.default_rng(seed), 20.0)(np.linspace(0.0, 2.0, 801))
    assert w[0] == 0.0
    assert 0.0 < w[400] <= 0.9
    assert np.all(w[400:] == w[400])


def test_an_unknown_law_is_named() -> None:
    with pytest.raises(ValueError, match="cubic"):
        draw_law("cubic", np.random.default_rng(0), 20.0)


def path_of(law: str, seed: int, roughness: float, until: float = GROWTH_LAWS_THRESHOLD) -> GrowthPath:
    rng = np.random.default_rng(seed)
    curve = draw_law(law, rng, 20.0)
    return grow(
        curve, rng, duration=18000.0, v_0=0.0025e-6, threshold=GROWTH_LAWS_THRESHOLD, until=until, roughness=roughness
    )


@given(st.sampled_from(LAWS), st.integers(0, 10**6), st.floats(0.05, 1.5))
def test_a_path_never_falls_and_its_crossing_is_the_first(law: str, seed: int, roughness: float) -> None:
    path = path_of(law, seed, roughness)
    assert np.all(np.diff(path.v_eq) >= 0.0)
    assert path.v_eq[0] == 0.0025e-6
    for threshold in (0.01e-6, 0.03e-6, GROWTH_LAWS_THRESHOLD):
        t = path.crossing(threshold)
        first = next((i for i, v in enumerate(path.v_eq.tolist()) if v >= threshold), None)
        if first is None:
            assert t == math.inf
        else:
            assert path.t[first] - PATH_STEP <= t <= path.t[first]
            assert float(path.at(np.array(t))) == pytest.approx(threshold, rel=1e-9)


@pytest.mark.parametrize("law", GROWING)
def test_a_smooth_path_is_the_law_and_a_rough_one_is_so_on_average(law: str) -> None:
    smooth = path_of(law, 5, 0.0)
    assert smooth.crossing(GROWTH_LAWS_THRESHOLD) == pytest.approx(18000.0, rel=1e-3)
    rng = np.random.default_rng(5)
    curve = draw_law(law, rng, 20.0)
    rough = np.array(
        [
            grow(
                curve,
                rng,
                duration=18000.0,
                v_0=0.0025e-6,
                threshold=GROWTH_LAWS_THRESHOLD,
                until=GROWTH_LAWS_THRESHOLD,
                roughness=0.5,
            ).v_eq
            for _ in range(200)
        ]
    )
    half = len(smooth.t) // 4
    assert rough[:, half].mean() == pytest.approx(smooth.v_eq[half], rel=0.03)


def test_a_path_tells_of_thresholds_behind_and_beyond_it() -> None:
    path = path_of("quadratic", 1, 0.5)
    assert path.crossing(0.001e-6) == 0.0
    assert path.crossing(1.0) == math.inf
