"""The model over a stretch of time: against the periodic solver, its order, its filter and its bookkeeping."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from models.machine.bearing import from_catalogue, kinematics
from models.machine.rig import Rig
from models.machine.scene import Defect, Floor, Part, Scene, Slip, Waviness
from models.platform.jit import compiling
from models.solve.engine.motion import SILENCE, anti_alias_filter
from models.solve.simulate import choose, simulate
from models.solve.six_dof.kernels import time_domain as kernels
from models.solve.six_dof.periodic import solve
from models.solve.six_dof.time_domain import prepare_plan, simulate_time
from models.solve.six_dof.time_domain import solve as solve_time
from models.words.request import Request
from reference.signals import record_of, recorded
from tests.support.effort import effort_count

SPALL = Defect(math.radians(20.0), 20e-6)
PIT = Defect(math.radians(4.0), 500e-6)
SCENE = Scene(40.0, 4000.0, defect=SPALL)


def waveform(scene: Scene, h: float, samples: int) -> NDArray[np.float64]:
    """Return the casing's acceleration from rest at the kernel's own samples, m/s2."""
    plan = prepare_plan(scene, samples * h)
    wave, state = np.empty((samples, 2)), np.zeros((2, 6))
    kernels.run(state, wave, h, plan)
    return wave[:, 0]


def periodic_scenes(count: int) -> list[Scene]:
    """Return scenes that the periodic solver answers for too."""
    rng = np.random.default_rng(3)
    scenes = [replace(SCENE, defect=None), SCENE, replace(SCENE, defect=PIT)]
    for i in range(count - len(scenes)):
        floor = Floor("rough" if i % 2 else "smooth", seed=i)
        defect = Defect(math.radians(rng.uniform(1.0, 50.0)), rng.uniform(1.0, 32.0) * 1e-6, floor, rows=1 + i % 2)
        scenes.append(
            Scene(rng.uniform(15.0, 50.0), rng.uniform(1000.0, 5000.0), defect=defect, clearance=5e-6 * (i % 3 == 2))
        )
    return scenes


@pytest.mark.parametrize("scene", periodic_scenes(effort_count(quick=6, full=30)))
def test_without_effects_it_is_the_periodic_solver(scene: Scene) -> None:
    periodic, found = simulate(scene), simulate_time(scene, 0.4, 51200.0)
    assert found.status == "converged"
    assert found.rms == pytest.approx(periodic.rms, rel=3e-3)
    assert found.levels_of("mr")[0] == pytest.approx(periodic.levels_of("mr")[0], rel=3e-3)


@pytest.mark.parametrize(("step", "tolerance"), [(10e-6, 1.5e-2), (2e-6, 3e-3)])
@pytest.mark.parametrize("scene", periodic_scenes(4))
def test_waveform_without_effects(scene: Scene, step: float, tolerance: float) -> None:
    """The force jumps where a ball leaves an edge; what the steps alias of that falls with the step."""
    periodic = simulate(scene, steps_per_period=8192, tolerance=1e-8)
    found = simulate_time(scene, 0.2, 51200.0, settle=0.25, step=step)
    # Shift the periodic waveform by the time that was dropped.
    expected = periodic.acceleration(51200.0, 0.2, 2.0 * math.pi * math.fmod(0.25 * periodic.bpfo, 1.0))
    # Compared up to 10 kHz, where most of the signal is.
    difference = np.abs(np.fft.rfft(found.acceleration(51200.0, 0.2) - expected)[: round(0.2 * 10e3)]) / len(expected)
    assert np.sqrt(2.0 * np.sum(difference**2)) < tolerance * periodic.rms


@pytest.mark.parametrize(
    "scene",
    [
        replace(SCENE, defect=Defect(0.5, 2e-5, part="inner", position=0.3)),
        replace(SCENE, defect=Defect(0.6, 1e-5, part="ball")),
        replace(SCENE, defect=None, unbalance=1e-4, waviness=(Waviness(1e-6, 13), Waviness(5e-7, 7, "inner", 1.0))),
    ],
)
def test_order_of_the_integrator(scene: Scene) -> None:
    """The fourth order of Runge and Kutta, across the instants at which contacts open and close."""
    coarse, samples = 1.0 / 25600.0, 1280
    exact = waveform(scene, coarse / 32, 32 * samples)[::32]
    errors = [np.sqrt(np.mean((waveform(scene, coarse / n, n * samples)[::n] - exact) ** 2)) for n in (1, 2, 4)]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert orders[0] > 3.2
    assert orders[1] > 3.5
    assert errors[2] < 5e-5 * np.sqrt(np.mean(exact**2))


@pytest.mark.parametrize(
    "effect",
    [
        {"unbalance": 0.0},
        {"gravity": 0.0, "gravity_angle": 1.0},
        {"slip": Slip(0.0)},
        {"waviness": (Waviness(0.0, 9, "inner"),)},
        {"defect": replace(SPALL, first_row=0)},
    ],
)
def test_an_effect_without_amplitude_is_none_bit_for_bit(effect: dict[str, Any]) -> None:
    scene = replace(SCENE, **effect)
    assert scene.effects == ("outer_defect",)
    assert np.array_equal(waveform(scene, 1e-5, 2000), waveform(SCENE, 1e-5, 2000))


@pytest.mark.parametrize("part", ["inner", "ball"])
def test_a_defect_without_size_is_none_bit_for_bit(part: Part) -> None:
    healthy = waveform(replace(SCENE, defect=None), 1e-5, 2000)
    for defect in (Defect(0.0, 1e-5), Defect(0.1, 0.0)):
        scene = replace(SCENE, defect=replace(defect, part=part))
        assert np.array_equal(waveform(scene, 1e-5, 2000), healthy)


@pytest.mark.parametrize("part", ["outer", "inner", "ball"])
def test_a_defect_of_each_row_is_one_of_both_bit_for_bit(part: Part) -> None:
    defect = replace(PIT, part=part)
    both = waveform(replace(SCENE, defect=replace(defect, rows=2)), 1e-5, 3000)
    each = replace(SCENE, defect=defect, more_defects=(replace(defect, first_row=1),))
    assert np.array_equal(waveform(each, 1e-5, 3000), both)
    nothing = replace(each, more_defects=(*each.more_defects, Defect(0.0, 1e-5, part="inner"), Defect(0.1, 0.0)))
    assert np.array_equal(waveform(nothing, 1e-5, 3000), both)


def test_the_order_of_defects_does_not_matter() -> None:
    defects = (PIT, replace(SPALL, position=1.0), replace(PIT, part="inner"), replace(PIT, part="ball", dphi_d=0.2))
    forth, back = (
        waveform(replace(SCENE, defect=d[0], more_defects=d[1:]), 1e-5, 4000) for d in (defects, defects[::-1])
    )
    # Rounding decides beside which steps an instant counts as near: far less than the error of the steps.
    assert forth == pytest.approx(back, abs=1e-3)


def test_balls_slip_alike_over_all_defects_of_a_race() -> None:
    """One sigma a passage: the second pit is met the same angle later as the first, whatever is drawn."""
    near = replace(SCENE, defect=PIT, more_defects=(replace(PIT, position=0.5),), slip=Slip(0.02, seed=5))
    plan = prepare_plan(near, 1.0)
    count = len(plan.origin) // 2
    first, second = (np.unique(plan.offset[(plan.piece // count) == k]) for k in (0, 1))
    assert len(first) > 150
    assert len(np.intersect1d(first, second)) > 0.95 * len(first)


@pytest.mark.parametrize(
    ("name", "small"),
    [("unbalance", 1e-12), ("gravity", 1e-9), ("slip", Slip(1e-12))],
)
def test_effects_set_in_continuously(name: str, small: object) -> None:
    with_effect, without = waveform(replace(SCENE, **{name: small}), 1e-5, 4000), waveform(SCENE, 1e-5, 4000)
    assert not np.array_equal(with_effect, without)
    assert with_effect == pytest.approx(without, abs=1e-4)


@pytest.mark.parametrize("oversampling", [2, 3, 8])
def test_the_filter_passes_what_a_recorder_passes(oversampling: int) -> None:
    taps = anti_alias_filter(oversampling)
    frequency = np.linspace(0.0, 1.0, 20001)
    gain = np.abs(np.fft.rfft(taps, 40000))
    assert len(taps) % 2 == 1
    assert gain[frequency <= 0.9 / oversampling] == pytest.approx(1.0, abs=2e-4)
    assert gain[frequency >= 1.0 / oversampling].max() < 2e-4


@pytest.mark.parametrize("part", ["outer", "inner", "ball"])
@pytest.mark.parametrize("slip", [None, Slip(0.01)])
def test_balls_meet_the_defect_as_often_as_kinematics_say(part: Part, slip: Slip | None) -> None:
    defect = replace(PIT, part=part)
    scene = replace(SCENE, defect=defect, slip=None if part == "ball" else slip)
    duration = 2.0
    plan = prepare_plan(scene, duration)
    lines = kinematics(scene.bearing, scene.speed)
    rate = {"outer": lines.bpfo, "inner": lines.bpfi, "ball": 2.0 * lines.bsf}[part]
    # The first piece of every path belongs to one edge; a meeting is cut where the cage has turned by a pitch.
    firsts = [0, int(np.searchsorted(plan.origin, plan.origin[0] + 3.0))] if part == "ball" else [0]
    lengths = np.repeat(np.diff(plan.bounds), np.diff(plan.first))
    inside = np.isin(plan.piece, firsts)
    turns = sum(float(np.sum(lengths[inside & (plan.piece == p)])) for p in firsts) * abs(plan.rate[0])
    width = PIT.dphi_d / 2.0
    assert turns / (width * duration) == pytest.approx(rate, rel=1e-2)
    places = np.repeat(np.arange(len(plan.turns)), np.diff(plan.first))
    pairs = list(zip(places.tolist(), plan.slot.tolist(), strict=True))
    assert len(set(pairs)) == len(pairs)


def test_the_sensor_has_a_direction() -> None:
    scene = replace(SCENE, defect=replace(PIT, part="inner"))
    along, across, oblique = (
        recorded(simulate_time(scene, 0.1, 25600.0, direction=d)) for d in ((1.0, 0.0), (0.0, 2.0), (-0.6, 0.8))
    )
    assert oblique == pytest.approx(-0.6 * along + 0.8 * across, abs=1e-9)
    assert not np.allclose(along, across)


def test_the_same_is_the_same_and_a_seed_is_a_slip() -> None:
    scenes = [replace(SCENE, slip=Slip(0.01, seed=s)) for s in (1, 1, 2)]
    first, again, other = (recorded(simulate_time(scene, 0.1, 25600.0)) for scene in scenes)
    assert np.array_equal(first, again)
    assert not np.allclose(first, other)


def test_slip_is_uniform_and_drawn_once_a_passage() -> None:
    """Eq. 82: what a ball stands off from its place lies evenly between the largest angle and its negative."""
    largest = 0.02
    plan = prepare_plan(replace(SCENE, defect=PIT, slip=Slip(largest, seed=5)), 4.0)
    places = 2.0 * math.pi / (SCENE.bearing.n_elements * SCENE.bearing.rows)
    off = plan.offset - places * np.round(plan.offset / places)
    passages = np.unique(off)
    count = round(4.0 * kinematics(SCENE.bearing, SCENE.speed).bpfo)
    assert len(passages) == pytest.approx(count, abs=3)
    assert np.max(np.abs(passages)) <= largest
    assert np.std(passages) == pytest.approx(largest / math.sqrt(3.0), rel=0.08)
    assert abs(np.mean(passages)) < 0.1 * largest


def test_levels_and_lines_are_those_of_the_signal() -> None:
    response = simulate_time(SCENE, 1.0, 51200.0)
    periodic = simulate(SCENE)
    record = record_of(response)
    assert record.line(periodic.bpfo) == pytest.approx(periodic.harmonics[0], rel=2e-2)
    assert response.harmonics == pytest.approx(periodic.harmonics, rel=2e-2, abs=1e-3 * periodic.rms)
    level, peak = record.levels_in_band(0.0, 5000.0)
    assert level == pytest.approx(periodic.rms_in_band(1.0, 5000.0), rel=1e-2)
    assert peak > level
    with pytest.raises(ValueError, match="band"):
        record.levels_in_band(0.0, 25000.0)


@pytest.mark.parametrize("part", ["inner", "ball"])
def test_the_error_of_a_recorded_waveform_is_stated(part: Part) -> None:
    scene = replace(SCENE, defect=replace(SPALL, part=part))
    fine = simulate_time(scene, 0.3, 51200.0, step=0.625e-6)
    for step in (10e-6, 5e-6):
        found = simulate_time(scene, 0.3, 51200.0, step=step)
        difference = np.linalg.norm(recorded(found)[0] - recorded(fine)[0]) / np.linalg.norm(recorded(fine)[0])
        assert difference <= found.waveform_error <= 6.0 * difference
        assert abs(found.rms / fine.rms - 1.0) <= found.rms_error + fine.rms_error


def test_the_error_of_a_band_is_that_of_the_recorded_signal() -> None:
    """Jumps between steps are aliased into the band: more than the RMS over full bandwidth shows."""
    scene = replace(SCENE, rig=Rig(beta_c=5e-4), defect=replace(SPALL, part="inner"))
    asked = Request(accuracy=0.1, duration=0.2, band=(100.0, 5000.0))
    found, fine = (
        solve_time(scene, replace(asked, steps_per_period=n)) for n in (512, effort_count(quick=2048, full=8192))
    )
    assert abs(found.rms / fine.rms - 1.0) <= (found.rms_error - found.averaging_error) + 1e-4
    tight = solve_time(scene, replace(asked, accuracy=1.0 / effort_count(quick=500, full=10_000)))
    assert tight.rms_error - tight.averaging_error < 0.5 * (found.rms_error - found.averaging_error)


def test_steps_are_halved_until_the_accuracy_is_met() -> None:
    light = replace(SCENE, rig=Rig(m_o=0.5, m_r=0.3), defect=Defect(0.1, 2e-5, part="inner"))
    loose, tight = (solve_time(light, Request(accuracy=a, duration=0.2)) for a in (1e-1, 1e-4))
    assert tight.waveform_error < 0.6 * loose.waveform_error
    assert tight.rms == pytest.approx(loose.rms, rel=loose.rms_error + tight.rms_error)
    with pytest.raises(ValueError, match=r"duration 1000 s .* take \d+ steps of .* at most 20000000"):
        solve_time(light, Request(duration=1000.0))


def test_standard_error_is_that_of_repeated_runs() -> None:
    scene = replace(SCENE, defect=PIT)
    count = effort_count(quick=8, full=40)
    runs = [simulate_time(replace(scene, slip=Slip(0.03, seed=s)), 0.5, 25600.0) for s in range(count)]
    scatter = np.std([run.rms for run in runs], ddof=1)
    stated = np.mean([run.rms_se for run in runs])
    assert 0.3 * scatter < stated < 3.0 * scatter
    assert not any(run.repeats for run in runs)
    assert all(run.status == ("not_periodic" if run.error <= 1e-3 else "inaccurate") for run in runs)


def test_a_silent_scene_is_silent() -> None:
    response = simulate_time(Scene(40.0, 0.0), 0.05, 25600.0)
    assert response.rms < SILENCE
    assert response.status == "converged"


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"unbalance": -1.0}, "unbalance"),
        ({"gravity": math.nan}, "gravity"),
        ({"gravity_angle": math.inf}, "gravity_angle"),
        ({"slip": Slip(0.01, "mean_force")}, "mean_force_slip"),
        ({"defect": replace(PIT, first_row=2)}, "first_row"),
        ({"defect": replace(PIT, first_row=1, rows=2)}, "defect.rows"),
        ({"defect": replace(PIT, part="ball"), "slip": Slip(0.01)}, "slip"),
        ({"defect": replace(PIT, part="ball", dphi_d=4.0)}, "dphi_d"),
        ({"load": -1.0}, "load"),
        ({"model": "none"}, "model"),
        ({"bearing": from_catalogue("NU 202 ECP")}, "roller"),
    ],
)
def test_what_the_model_cannot_describe_is_refused(change: dict[str, object], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        simulate_time(replace(SCENE, **change), 0.1, 25600.0)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"duration": 0.0}, "duration"),
        ({"rate": math.inf}, "rate"),
        ({"settle": -1.0}, "settle"),
        ({"direction": (0.0, 0.0)}, "direction"),
        ({"step": 0.0}, "step"),
    ],
)
def test_senseless_arguments_are_refused(change: dict[str, Any], word: str) -> None:
    arguments: dict[str, Any] = {"duration": 0.1, "rate": 25600.0, **change}
    with pytest.raises(ValueError, match=word):
        simulate_time(SCENE, **arguments)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"unbalance": 1e-3}, "unbalance"),
        ({"slip": Slip(0.01)}, "slip"),
        ({"waviness": (Waviness(1e-6, 7, "inner"),)}, "inner_waviness"),
        ({"defect": replace(PIT, part="inner")}, "inner_defect"),
        ({"defect": replace(PIT, part="ball")}, "ball_defect"),
    ],
)
def test_the_periodic_solver_refuses_what_it_would_leave_out(change: dict[str, Any], word: str) -> None:
    scene = replace(SCENE, **change)
    assert set(scene.effects) - {"outer_defect"} == {word}
    assert not scene.repeats
    with pytest.raises(ValueError, match=rf"^{word}: "):
        solve(scene, Request())
    assert choose(scene, Request())[0].name == "time_domain"


def test_one_machine_code_serves_every_scene_with_an_unbalance_and_one_those_without() -> None:
    for unbalance in (0.0, 1e-3):
        simulate_time(Scene(40.0, 1000.0, unbalance=unbalance), 0.005, 25600.0, settle=0.0)
        every = replace(SCENE, defect=replace(PIT, part="inner"), unbalance=unbalance, waviness=(Waviness(1e-6, 7),))
        with compiling() as seconds:
            simulate_time(every, 0.01, 25600.0, settle=0.0)
        assert seconds == {}
