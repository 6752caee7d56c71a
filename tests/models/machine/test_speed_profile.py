"""A shaft whose speed changes: its profiles, and the six-degree-of-freedom model that follows them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import quad

from models.machine.bearing import kinematics
from models.machine.scene import Defect, Part, Scene, Slip, Waviness
from models.machine.speed_profile import PHASE_ERROR, SpeedProfile, coast_down, constant, hunt, ramp, table
from models.solve.six_dof.kernels import time_domain as kernels
from models.solve.six_dof.kernels.step import P_DIRECTION_1, P_DIRECTION_2, STATUS_OK
from models.solve.six_dof.time_domain import prepare_plan, simulate_time
from tests.oracles.time_domain_oracle import Case, Oracle, Turning
from tests.support.effort import effort_count

BASE = Scene(40.0, 4000.0)
PIT = Defect(0.1, 5e-4)
WAVES = (Waviness(3e-7, 5, "inner", 0.2), Waviness(2e-7, 13))
# Speeds that change far faster than those of machines, so that milliseconds show it.
SWING = Turning(swing=0.3 * 2.0 * math.pi * 40.0, pace=2.0 * math.pi * 60.0)
STEEP = Turning(slope=2.0 * math.pi * 2000.0)
SWINGING, RISING = hunt(40.0, 0.3, 60.0, 0.05), ramp(40.0, 140.0, 0.05)
CASES = {
    "outer": (
        Case(40.0, 4000.0, "outer", 0.1, 5e-4, turning=STEEP),
        replace(BASE, defect=PIT, speed_profile=RISING),
    ),
    "inner": (
        Case(40.0, 4000.0, "inner", 0.2, 3e-5, turning=SWING),
        replace(BASE, defect=Defect(0.2, 3e-5, part="inner"), speed_profile=SWINGING),
    ),
    "ball": (
        Case(40.0, 4000.0, "ball", 0.6, 1e-5, turning=STEEP),
        replace(BASE, defect=Defect(0.6, 1e-5, part="ball"), speed_profile=RISING),
    ),
    "unbalance": (
        Case(40.0, 4000.0, unbalance=2e-3, turning=SWING),
        replace(BASE, unbalance=2e-3, speed_profile=SWINGING),
    ),
    "waviness": (
        Case(40.0, 4000.0, waves=((3e-7, 5, "inner", 0.2), (2e-7, 13, "outer", 0.0)), turning=STEEP),
        replace(BASE, waviness=WAVES, speed_profile=RISING),
    ),
}

QUICK = ("outer", "inner", "unbalance")


def relative(found: NDArray[np.float64], truth: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean((found - truth) ** 2) / np.mean(truth**2)))


def from_rest(scene: Scene, h: float, samples: int, direction: tuple[float, float] = (1.0, 0.0)) -> NDArray[np.float64]:
    """Return both sensors' acceleration from rest at the kernel's own samples, m/s2."""
    plan = prepare_plan(scene, samples * h)
    wave, state = np.empty((samples, 2)), np.zeros((2, 6))
    plan.parameter[[P_DIRECTION_1, P_DIRECTION_2]] = direction
    assert kernels.run(state, wave, h, plan) == STATUS_OK
    return wave


@pytest.mark.parametrize("name", list(CASES) if effort_count(quick=1, full=2) == 2 else QUICK)
def test_against_the_oracle(name: str) -> None:
    """DOP853 on an own writing of the equations with the angle in closed form: waveforms to 1e-3 of their RMS."""
    case, scene = CASES[name]
    h, samples = 1.0 / 102400.0, effort_count(quick=100, full=2000)
    truth = Oracle(case).run(np.linspace(0.0, (samples - 1) * h, samples))
    for k, direction in enumerate(((1.0, 0.0), (0.0, 1.0))):
        wave = from_rest(scene, h, samples, direction)
        assert relative(wave[:, 0], truth[:, 0, k]) < 1e-3
        assert relative(wave[:, 1], truth[:, 1, k]) < 1e-3
    steady = from_rest(replace(scene, speed_profile=None), h, samples)
    assert relative(steady[:, 0], truth[:, 0, 0]) > 2e-3


@pytest.mark.parametrize("part", ["outer", "inner", "ball"])
def test_a_profile_of_one_speed_is_that_speed(part: Part) -> None:
    scene = replace(BASE, defect=Defect(0.3, 2e-5, part=part), unbalance=1e-3, waviness=WAVES)
    one = replace(scene, speed_profile=constant(40.0, 0.05))
    assert one.effects == (*scene.effects, "changing_speed")
    # Rounding decides which steps end at an instant of contact.
    assert from_rest(one, 1e-5, 4000) == pytest.approx(from_rest(scene, 1e-5, 4000), abs=1e-4)


@pytest.mark.parametrize("part", ["outer", "inner", "ball"])
def test_balls_meet_the_defect_by_the_angle(part: Part) -> None:
    """Over equal angles a ramp has the meetings of one speed, in the order and of the length of those."""
    scene = replace(BASE, defect=replace(PIT, part=part), slip=None if part == "ball" else Slip(0.01, seed=3))
    profile = ramp(10.0, 40.0, 2.0)
    changing = prepare_plan(replace(scene, speed=25.0, speed_profile=profile), 2.0)
    steady = prepare_plan(replace(scene, speed=25.0), 2.0)
    assert np.array_equal(changing.piece, steady.piece)
    assert np.array_equal(changing.slot, steady.slot)
    assert np.array_equal(changing.offset, steady.offset)
    assert changing.clock is not None
    assert profile.turns_at(changing.bounds[:-1]) / 25.0 == pytest.approx(steady.bounds[:-1], abs=1e-12)
    at = changing.bounds[:-1] - changing.clock[:, 0]
    nominal = np.sum(changing.clock[:, 1:] * at[:, None] ** np.arange(4), axis=1)
    assert nominal == pytest.approx(steady.bounds[:-1], abs=1e-12)


def test_a_response_says_how_the_shaft_turned_and_its_lines_are_over_the_angle() -> None:
    scene = replace(BASE, speed=30.0, defect=Defect(0.1, 1e-5))
    profile = ramp(20.0, 40.0, 1.0)
    found = simulate_time(replace(scene, speed_profile=profile), 1.0, 25600.0, settle=0.1)
    steady = simulate_time(scene, 1.0, 25600.0, settle=0.1)
    assert found.status in ("not_periodic", "inaccurate")
    assert not found.repeats
    assert found.profile == profile
    time = np.arange(25600) / 25600.0
    assert found.turns() == pytest.approx(20.0 * time + 10.0 * time**2, abs=1e-9)
    assert steady.turns() == pytest.approx(30.0 * time, abs=1e-9)
    assert found.bpfo == pytest.approx(kinematics(scene.bearing, 30.0).bpfo)
    # Smeared over the change of speed in Hz, but not over the angle.
    assert found.record is not None
    in_hertz = 2.0 * np.abs(found.record.coefficients(found.bpfo, 6)[0, 1:])
    assert found.harmonics.max() > 5.0 * in_hertz.max()
    assert 0.3 < found.harmonics.max() / steady.harmonics.max() < 3.0


def test_the_lead_in_is_at_the_first_speed_and_time_zero_is_the_first_sample() -> None:
    """An unbalance alone, far below resonance: the phase of the vibration is that of the profile."""
    profile = hunt(20.0, 0.1, 1.0, 1.0)
    scene = replace(BASE, speed=20.0, unbalance=0.05, speed_profile=profile)
    found = simulate_time(scene, 1.0, 5120.0)
    signal = found.acceleration(5120.0, 1.0)
    turns = profile.turns_at(np.arange(5120) / 5120.0)
    ours = np.mean(signal * np.exp(-2j * math.pi * turns))
    steady = simulate_time(replace(scene, speed_profile=None), 1.0, 5120.0).acceleration(5120.0, 1.0)
    theirs = np.mean(steady * np.exp(-2j * math.pi * 20.0 * np.arange(5120) / 5120.0))
    assert abs(ours) == pytest.approx(abs(theirs), rel=0.1)
    assert math.remainder(np.angle(ours) - np.angle(theirs), 2.0 * math.pi) == pytest.approx(0.0, abs=0.05)


PROFILES: dict[str, tuple[SpeedProfile, Any]] = {
    "ramp": (ramp(10.0, 40.0, 5.0), lambda t: 10.0 + 6.0 * t),
    "hunt": (hunt(25.0, 0.2, 0.3, 10.0, phase=0.5), lambda t: 25.0 * (1 + 0.2 * math.sin(0.6 * math.pi * t + 0.5))),
    "coast": (coast_down(40.0, 10.0, 8.0), lambda t: 40.0 * 4.0 ** (-t / 8.0)),
    "table": (table([1.0, 2.0, 4.0], [10.0, 30.0, 20.0]), lambda t: np.interp(t, [0.0, 1.0, 3.0], [10.0, 30.0, 20.0])),
}


@pytest.mark.parametrize("name", list(PROFILES))
def test_a_profile_is_its_formula(name: str) -> None:
    profile, speed = PROFILES[name]
    end = profile.duration
    for time in np.linspace(0.0, end, 7):
        turns = quad(speed, 0.0, time, points=[1.0] if name == "table" else None, epsabs=1e-12, limit=200)[0]
        assert float(profile.turns_at(time)) == pytest.approx(turns, abs=10.0 * PHASE_ERROR)
        assert float(profile.speed_at(time)) == pytest.approx(speed(time), rel=1e-5)
    times = np.linspace(-1.0, end + 1.0, 4001)
    assert profile.time_at(profile.turns_at(times)) == pytest.approx(times, abs=1e-12)
    low, high = profile.speed_range
    speeds = profile.speed_at(times)
    assert low - 1e-9 <= speeds.min() <= low + 1e-2
    assert high - 1e-2 <= speeds.max() <= high + 1e-9
    assert profile.mean_speed == pytest.approx(float(profile.turns_at(end)) / end)
    assert float(profile.speed_at(-1.0)) == profile.speed[0]
    assert float(profile.speed_at(end + 1.0)) == profile.speed[-1]
    inside = times[(times > 0.1) & (times < end - 0.1)]
    slope = (profile.speed_at(inside + 1e-4) - profile.speed_at(inside - 1e-4)) / 2e-4
    assert np.median(np.abs(profile.acceleration_at(inside) - slope)) < 1e-3


@given(st.lists(st.tuples(st.floats(0.01, 3.0), st.floats(1.0, 100.0)), min_size=2, max_size=8), st.floats(0.01, 2.0))
@settings(max_examples=effort_count(quick=20, full=500))
def test_delays_and_parts_are_the_same_rotation(knots: list[tuple[float, float]], shift: float) -> None:
    profile = table(np.cumsum([step for step, _ in knots]), [speed for _, speed in knots])
    times = np.linspace(0.0, profile.duration, 50)
    later = profile.delayed(shift)
    assert later.turns_at(times + shift) - later.turns_at(shift) == pytest.approx(profile.turns_at(times), abs=1e-9)
    begin = 0.3 * profile.duration
    part = profile.part(begin, 0.5 * profile.duration)
    inside = np.linspace(0.0, 0.5 * profile.duration, 50)
    expected = profile.turns_at(begin + inside) - profile.turns_at(begin)
    assert part.turns_at(inside) == pytest.approx(expected, abs=1e-9 * profile.turns[-1])


def test_a_random_wander_has_its_size_and_its_seed() -> None:
    one, again, other = (hunt(25.0, 0.0, 0.5, 600.0, wander=0.03, seed=seed) for seed in (1, 1, 2))
    assert one == again
    assert one != other
    times = np.linspace(0.0, 600.0, 20001)
    assert np.std(one.speed_at(times)) == pytest.approx(0.75, rel=0.2)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ramp(10.0, 0.0, 5.0), "end must be positive"),
        (lambda: hunt(25.0, 1.0, 0.3, 5.0), "share of a hunting speed"),
        (lambda: hunt(25.0, 0.9, 0.3, 5.0, wander=0.3), "the shaft stops"),
        (lambda: hunt(25.0, 0.5, 1e6, 50.0), "knots, at most"),
        (lambda: coast_down(10.0, 20.0, 5.0), "ends below its beginning"),
        (lambda: table([0.0, 1.0], [10.0, -1.0]), "positive"),
        (lambda: table([0.0, 0.0], [10.0, 1.0]), "must rise"),
        (lambda: table([0.0], [10.0]), "2 at least"),
        (lambda: SpeedProfile((0.0, 1.0), (0.0, 10.0), (40.0, 10.0)), "stops or turns back"),
        (lambda: SpeedProfile((1.0, 2.0), (0.0, 10.0), (10.0, 10.0)), "must begin at 0 s"),
        (lambda: SpeedProfile((0.0, 1.0), (0.0, 10.0), (10.0,)), "must be as many"),
        (lambda: replace(BASE, speed_profile=ramp(10.0, 20.0, 1.0)), "speed must lie within the speed_profile"),
        (lambda: replace(BASE, speed_profile=RISING, speed_slope=1.0), "speed_slope must be 0"),
    ],
)
def test_what_is_no_profile_is_refused(make: Any, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        make()
