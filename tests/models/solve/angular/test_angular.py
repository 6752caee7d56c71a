"""Shaft on two ball bearings over its angle: limits in closed form, balances, order, hard cases, each part.

The shaft on two ball bearings against an oracle that shares no code with it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from models.machine.ball_statics import BallStatics, equilibrium
from models.machine.bearing import Bearing, from_catalogue
from models.machine.scene import Defect, Part, Scene
from models.machine.shaft_beam import torsion_frequencies
from models.machine.spall_contact import Spall, force_over_spall
from models.machine.speed_profile import SpeedProfile, constant, hunt, ramp
from models.solve.angular import kernel as kernels
from models.solve.angular.ball_ring_kernel import CARRIED, F_X, LEFT, OUTER, carry, pressed
from models.solve.angular.plan import assemble, at_rest, lateral_modes, prepare_plan, ring_of, tangents, torsion_modes
from models.solve.angular.rig import AngularRig
from models.solve.angular.solver import AngularTrace, longest_step, solve, trace
from models.words.request import Request
from reference.signals import record_of
from tests.oracles import angular_oracle
from tests.oracles.angular_oracle import DM, Case, D, Pit
from tests.support.effort import effort_count

LEFT_BEARING, RIGHT_BEARING = (Bearing("", balls, 12.7e-3, 80e-3) for balls in (11, 10))
SPALL = Defect(math.radians(7.0), 100e-6, width=math.radians(30.0))
SCENE = Scene(100.0, 600.0, bearing=LEFT_BEARING, second_bearing=RIGHT_BEARING, rig=AngularRig(), axial_load=-200.0)
FAST = replace(SCENE, speed=20000.0 / 60.0)
TURN = 2.0 * math.pi


def run(scene: Scene, turns: float = 1.0, step: float = 8e-6) -> AngularTrace:
    found = trace(scene, turns, TURN * scene.speed * step)
    assert found.finite
    assert found.unbalanced < 1e-6
    return found


def rms(signal: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(signal**2)))


def test_on_a_stiff_shaft_the_bearings_are_those_of_the_statics() -> None:
    stiff = replace(SCENE, rig=AngularRig(outer_diameter=0.3))
    for ring, axial in zip(assemble(stiff).rings, (0.0, 200.0), strict=True):
        assert ring.load[[0, 2]] == pytest.approx([300.0, axial], abs=15.0)
        alone = equilibrium(ring.statics, ring.load * [1.0, 0.0, 1.0, 0.0, 0.0], SCENE.speed)
        assert ring.inner_force == pytest.approx(alone.inner_force, abs=2.0)
        assert ring.bpfo == pytest.approx(alone.bpfo, rel=1e-3)


def test_it_begins_in_equilibrium() -> None:
    for scene in (SCENE, replace(SCENE, rig=replace(AngularRig(), located="a"), axial_load=200.0), FAST):
        assembly = assemble(scene)
        a, b = assembly.rings
        assert a.load[0] + b.load[0] == pytest.approx(scene.load, abs=1e-5)
        assert a.load[2] + b.load[2] == pytest.approx(-scene.axial_load, abs=1e-5)
        assert abs((a, b)[assembly.floating].load[2]) < 1e-5
        plan = prepare_plan(scene, assembly)
        begin = at_rest(plan, assembly)
        state, row = begin.copy(), np.zeros((1, kernels.TRACE))
        assert kernels.carry_over(state, row, kernels.NO_WAVE, 0.0, 1e-6, plan) == kernels.STATUS_OK
        assert row[0, 2] == pytest.approx(0.0, abs=1e-12)
        rate = (state - begin) / 1e-6 * TURN * scene.speed
        # But for the cages: nothing moves, accelerations of modes are rounding.
        assert np.abs(rate[1:-5]).max() < 1e-4


def test_turning_slowly_it_passes_through_the_equilibria() -> None:
    """Varying compliance: the forces on the shaft stay those of the load while the resisting torque follows statics."""
    slow = replace(SCENE, speed=2.0, rig=AngularRig(governor=5.0))
    found = run(slow, turns=0.11)
    chosen = np.arange(0, len(found.time), len(found.time) // 6)[1:]
    assert found.carried[:, 0, F_X] + found.carried[:, 1, F_X] == pytest.approx(
        np.full(len(found.time), 600.0), rel=1e-3
    )
    for n in chosen:
        cages = TURN * slow.speed * found.time[n] * np.array([ring.ftf for ring in assemble(slow).rings])
        rig = replace(slow.rig_as(AngularRig), cage_angle_a=float(cages[0]), cage_angle_b=float(cages[1]))
        rings = assemble(replace(slow, rig=rig)).rings
        assert found.torque[n] == pytest.approx([-ring.resistance_torque()[0] for ring in rings], rel=3e-3)


def test_torsion_rings_at_the_frequencies_of_the_shaft_with_the_damping_given() -> None:
    """130 Hz and 8480 Hz; without resistance nothing else moves the torsion."""
    rig = AngularRig(resistance=0.0, governor=1e-3, load_torque=0.0)
    scene = replace(SCENE, rig=rig)
    assembly = assemble(scene)
    plan = prepare_plan(scene, assembly)
    expected = torsion_frequencies(rig.shaft, (rig.disc,), rig.couplings)
    assert np.sqrt(plan.torsion.square[1:]) / TURN == pytest.approx(expected[1:], rel=1e-6)
    n, step = len(plan.lateral.square), TURN * 100.0 * 4e-6
    for mode, frequency, turns in ((1, 130.03, 4.0), (4, 8479.0, 0.2)):
        state = at_rest(plan, assembly)
        state[1 + 2 * n + len(expected) + mode] = 1e-3
        rows = np.zeros((round(TURN * turns / step), kernels.TRACE))
        # The first mode of the couplings leaves the disc at rest: both ends against each other.
        shown = plan.torsion._replace(shape=plan.torsion.shape.copy())
        shown.shape[kernels.T_ENCODER] = 1.0
        assert kernels.carry_over(state, rows, kernels.NO_WAVE, 0.0, step, plan._replace(torsion=shown)) == 0
        speed, time = rows[:, 2], rows[:, 0]
        crossings = np.flatnonzero(np.diff(np.sign(speed)) != 0)
        at = time[crossings] - speed[crossings] * np.diff(time)[crossings] / np.diff(speed)[crossings]
        half = float(np.mean(np.diff(at)))
        assert 0.5 / half == pytest.approx(frequency * math.sqrt(1.0 - rig.damping**2), rel=3e-4)
        peaks = np.array([np.abs(speed[a:b]).max() for a, b in pairwise(crossings)])
        decay = float(np.mean(np.diff(np.log(peaks)))) / (math.pi / math.sqrt(1.0 - rig.damping**2))
        assert -decay == pytest.approx(rig.damping, rel=0.02)


def test_the_drives_power_is_that_of_resistance_and_of_the_change_of_energy() -> None:
    """Of the torsion: what drive and load put in less what bearings and damping take is kinetic and elastic energy."""
    scene = replace(SCENE, rig=AngularRig(governor=1e-6, load_torque=0.0), defect=SPALL)
    assembly = assemble(scene)
    plan = prepare_plan(scene, assembly)
    torsion, n, m = plan.torsion, len(plan.lateral.square), len(plan.torsion.square)
    state = at_rest(plan, assembly)
    step, row = TURN * 100.0 * 4e-6, np.zeros((1, kernels.TRACE))
    times, energy, power, momentum, torque = ([] for _ in range(5))
    speeds = torsion.shape
    for _ in range(2500):
        r, v = state[1 + 2 * n : 1 + 2 * n + m].copy(), state[1 + 2 * n + m : 1 + 2 * n + 2 * m].copy()
        assert kernels.carry_over(state, row, kernels.NO_WAVE, 0.0, step, plan) == 0
        resisted = row[0, 2 + kernels.SENSORS + 5 :: CARRIED][:2]
        put_in = float(torsion.steady @ v)
        taken = resisted @ (speeds[[kernels.T_A, kernels.T_B]] @ v)
        taken += float(torsion.damping @ v**2) + plan.parameter[kernels.P_LOSS] * float(speeds[kernels.T_LOAD] @ v) ** 2
        times.append(row[0, 0])
        power.append(put_in - taken)
        energy.append(0.5 * float(v @ v + torsion.square @ r**2))
        momentum.append(v[0] / speeds[kernels.T_A, 0])
        torque.append(float(resisted.sum()) + plan.parameter[kernels.P_LOSS] * float(speeds[kernels.T_LOAD] @ v))
    work_done = CubicSpline(times, power).integrate(times[0], times[-1])
    assert float(np.ptp(energy)) > 1e-9
    assert energy[-1] - energy[0] == pytest.approx(float(work_done), abs=1e-3 * float(np.ptp(energy)))
    # The inertia as a whole turns faster by what the drive gives beyond the resistance at rest.
    begin = -sum(ring.resistance_torque()[0] for ring in assembly.rings)
    missing = CubicSpline(times, begin - np.array(torque)).integrate(times[0], times[-1])
    assert momentum[-1] - momentum[0] == pytest.approx(float(missing), abs=1e-4 * float(np.ptp(momentum)))


def test_without_resistance_the_speed_is_constant_and_the_shaft_vibrates_all_the_same() -> None:
    free = run(replace(SCENE, defect=SPALL, rig=AngularRig(resistance=0.0)), 3.0)
    held = run(replace(SCENE, defect=SPALL), 3.0)
    assert np.abs(free.ias).max() < 1e-12
    assert np.abs(held.ias).max() > 1e-3
    assert rms(free.acceleration[:, 0] - held.acceleration[:, 0]) < 1e-2 * rms(held.acceleration[:, 0])


@pytest.mark.parametrize("scene", [SCENE, replace(SCENE, defect=SPALL)], ids=["healthy", "spall"])
def test_order_of_convergence_is_four(scene: Scene) -> None:
    runs = [run(scene, effort_count(quick=1, full=2), step) for step in (8e-6, 4e-6, 2e-6, 1e-6)]
    size = len(runs[0].ias)
    for pick in (lambda found: found.ias, lambda found: found.acceleration[:, 0]):
        values = [pick(found)[:: 2**k][:size] for k, found in enumerate(runs)]
        errors = np.array([rms(value - values[-1]) for value in values[:-1]]) / rms(values[-1])
        assert errors[1] < 1e-2
        assert np.all(np.log2(errors[:-1] / errors[1:]) > 3.3)


@pytest.mark.parametrize("slope", [0.0, 200.0, -200.0])
def test_equal_angles_make_time_by_the_speed(slope: float) -> None:
    scene = replace(SCENE, speed_slope=slope)
    found = run(scene, effort_count(quick=4, full=10), 6e-6)
    steps = np.arange(len(found.angle))
    assert found.angle - found.angle[0] == pytest.approx(found.step * steps, abs=1e-9)
    end = float(found.time[-1])
    assert found.step * steps[-1] == pytest.approx(TURN * (scene.speed * end + 0.5 * slope * end**2), abs=2e-3)
    speed = 1.0 / np.gradient(found.time, found.step)
    expected = TURN * (scene.speed + slope * found.time) + found.ias
    assert speed[2:-2] == pytest.approx(expected[2:-2], rel=1e-6)


def test_a_profile_is_the_slope_and_one_speed_is_none() -> None:
    slope, rising = replace(SCENE, speed_slope=200.0), replace(SCENE, speed_profile=ramp(100.0, 300.0, 1.0))
    assert run(rising, 1.0, 6e-6).ias == pytest.approx(run(slope, 1.0, 6e-6).ias, abs=1e-9)
    one = replace(SCENE, speed_profile=constant(100.0, 1.0))
    assert np.array_equal(run(one, 1.0, 6e-6).ias, run(SCENE, 1.0, 6e-6).ias)


def test_a_hunting_shaft_follows_its_profile_and_says_how_it_turned() -> None:
    profile = hunt(100.0, 0.05, 4.0, 0.2)
    scene = replace(SCENE, rig=replace(SCENE.rig, mode_limit=10e3), speed_profile=profile)
    found = solve(scene, Request(duration=0.2, rate=12800.0, accuracy=0.1))
    assert found.profile == profile
    assert found.status in ("not_periodic", "inaccurate")
    assert not found.repeats
    turns, time = found.turns(), np.arange(2560) / 12800.0
    assert turns - profile.turns_at(time) == pytest.approx(0.0, abs=2e-3)
    speed = np.gradient(turns, time)
    assert record_of(found).of("ias") == pytest.approx(TURN * (speed - profile.speed_at(time)), abs=0.05)


@pytest.mark.parametrize("slope", [0.0, -200.0, 200.0])
def test_records_at_equal_times_are_those_over_equal_angles(slope: float) -> None:
    scene, rate = replace(SCENE, defect=SPALL, speed_slope=slope), 102400.0
    assembly = assemble(scene)
    plan = prepare_plan(scene, assembly, profile=scene.rotation(0.1))
    wave = np.zeros((effort_count(quick=1500, full=4000), kernels.SENSORS))
    assert (
        kernels.carry_over(at_rest(plan, assembly), kernels.NO_ROWS, wave, 1.0 / rate, 0.25 * TURN * 100.0 / rate, plan)
        == kernels.STATUS_OK
    )
    found = run(scene, effort_count(quick=2, full=5), 2e-6)
    times = np.arange(len(wave)) / rate
    for column, signal in ((0, found.ias), (1, found.acceleration[:, 0]), (3, found.acceleration[:, 2])):
        expected = CubicSpline(found.time, signal)(times)
        assert rms(wave[:, column] - expected) < 2e-3 * rms(expected)


HARD = {
    "20,000 rpm without axial load": replace(FAST, axial_load=0.0, defect=SPALL),
    "no load at all": replace(SCENE, load=0.0, axial_load=0.0, defect=SPALL),
    "axial load alone": replace(SCENE, load=0.0, axial_load=500.0, defect=replace(SPALL, support="b")),
    "a shaft bent by 20 kN": replace(SCENE, load=20000.0, rig=AngularRig(outer_diameter=0.034)),
    "no play": replace(SCENE, rig=AngularRig(play=0.0), axial_load=0.0, defect=replace(SPALL, part="inner")),
    "much play": replace(SCENE, clearance=100e-6, defect=SPALL),
    "all around": replace(SCENE, defect=Defect(TURN, 5e-6)),
    "three spalls": replace(
        SCENE,
        defect=SPALL,
        more_defects=(replace(SPALL, position=0.13), replace(SPALL, part="inner", support="b", position=1.0)),
    ),
    "grooves of a self-aligning race": replace(
        SCENE, bearing=replace(LEFT_BEARING, outer_groove_radius=0.0465), defect=SPALL
    ),
}


@pytest.mark.parametrize("name", list(HARD))
def test_hard_cases_run_to_their_end(name: str) -> None:
    found = run(HARD[name], 1.5, 4e-6)
    assert np.all(np.isfinite(found.acceleration))
    assert np.abs(found.ias).max() < 1.0


def test_no_state_of_the_balls_over_spalls_fails() -> None:
    """Random displacements within 100 um and 1 mrad, speeds to 20,000 rpm, balls at any place of the spalls."""
    random = np.random.default_rng(5)
    pits = (replace(SPALL, position=1.0, part="inner"), Defect(0.3, 8e-6, position=2.5, width=0.2))
    scene = replace(SCENE, defect=SPALL, more_defects=pits)
    statics = assemble(scene).statics[0]
    ring, out = ring_of(statics, scene, "a"), np.zeros(CARRIED)
    warm, worst = np.zeros((11, 2)), 0.0
    for _ in range(4000):
        q = random.uniform(-1.0, 1.0, 5) * np.array([1e-4, 1e-4, 1e-4, 1e-3, 1e-3])
        force = statics.centrifugal_force(float(random.uniform(0.0, 333.3)))
        carry(q, float(random.uniform(0.0, TURN)), force, float(random.uniform(0.0, TURN)), ring, warm, out)
        assert np.all(np.isfinite(out))
        worst = max(worst, float(out[LEFT]))
    assert worst < 1e-6


def test_the_force_over_a_spall_and_its_derivative() -> None:
    random = np.random.default_rng(1)
    statics = BallStatics(AngularRig().grooved(LEFT_BEARING), 35e-6, 200e9)
    ring = ring_of(statics, replace(SCENE, defect=replace(SPALL, h_d=4e-6, position=0.3)), "a")
    spall = Spall(4e-6, SPALL.dphi_d, math.radians(30.0), 0.3)
    partial = 0
    for _ in range(300):
        d, beta = float(random.uniform(0.1e-6, 12e-6)), float(random.uniform(-0.4, 0.4))
        angle = 0.3 + float(random.choice([-1.0, 1.0])) * 0.5 * SPALL.dphi_d + float(random.uniform(-3e-3, 3e-3))
        force, stiffness = pressed(d, np.int64(OUTER), angle, beta, ring.surfaces, ring.spalls)
        assert force == pytest.approx(force_over_spall(statics, spall, d, angle, beta), rel=1e-9, abs=1e-9)
        ends = [pressed(d + h, np.int64(OUTER), angle, beta, ring.surfaces, ring.spalls)[0] for h in (-1e-11, 1e-11)]
        sound = ring.races.k_o * 1.5 * math.sqrt(d)
        assert stiffness == pytest.approx((ends[1] - ends[0]) / 2e-11, abs=2e-3 * sound)
        partial += 1e-3 < force / (ring.races.k_o * d**1.5) < 0.999
    assert partial > 100


def test_slowed_modes_keep_their_flexibility_and_change_little() -> None:
    assembly, flexible = assemble(SCENE), []
    for limit in (8e3, 30e3, 1e6):
        rig = AngularRig(mode_limit=limit)
        modes = lateral_modes(replace(assembly, rig=rig), tangents(assembly), SCENE)
        assert math.sqrt(modes.square.max()) / TURN < limit * 1.000001
        flexible.append((modes.shape / modes.square) @ modes.push.T)
    for found in flexible[:-1]:
        assert found == pytest.approx(flexible[-1], rel=1e-6, abs=1e-12 * np.abs(flexible[-1]).max())
    plain, limited = (
        run(replace(SCENE, defect=SPALL, rig=AngularRig(mode_limit=limit)), 2.0, 4e-6).ias for limit in (100e3, 30e3)
    )
    assert rms(plain - limited) < 1e-2 * rms(plain)


def test_more_elements_change_little() -> None:
    four, eight, more = (run(replace(SCENE, rig=AngularRig(elements=n)), 2.0, 4e-6).ias for n in (4, 8, 16))
    assert rms(four - more) < 0.1 * rms(more)
    assert rms(eight - more) < 0.4 * rms(four - more)


def test_the_inertia_of_the_balls_lowers_the_second_mode_of_torsion() -> None:
    """8480 Hz, to which the disc was fitted, becomes 8.1 kHz with the second terms of Eq. 12."""
    modes = []
    for balls in (False, True):
        scene = replace(SCENE, rig=AngularRig(ball_inertia=balls))
        modes.append(np.sqrt(torsion_modes(assemble(scene), scene)[0].square) / TURN)
    assert modes[0][4] == pytest.approx(8479.0, rel=1e-3)
    assert 7900.0 < modes[1][4] < 8200.0
    assert modes[1][1] == pytest.approx(modes[0][1], rel=1e-3)


def test_centrifugal_force_and_clearance_and_unbalance_do_what_they_are() -> None:
    slow, fast = (run(scene, 1.0).torque.mean(axis=0) for scene in (SCENE, FAST))
    assert np.all(fast > 2.0 * slow)
    narrow, wide = (assemble(replace(SCENE, clearance=c)).rings[0].displacement[0] for c in (10e-6, 20e-6))
    assert wide - narrow == pytest.approx(10e-6, abs=2e-6)
    turns = effort_count(quick=20, full=40)
    turned = run(replace(SCENE, unbalance=1e-4), turns)
    line = np.mean(turned.acceleration[-6250:, 2] * np.exp(-1j * turned.angle[-6250:]))
    plain = run(SCENE, turns)
    without = np.mean(plain.acceleration[-6250:, 2] * np.exp(-1j * plain.angle[-6250:]))
    # Far below the shaft's own modes: mass times acceleration is small beside the bearings' reaction.
    assert abs(line) > 20.0 * abs(without)
    pushed = turned.carried[-6250:, :, F_X].sum(axis=1)
    shaken = 2.0 * abs(np.mean(pushed * np.exp(-1j * turned.angle[-6250:])))
    assert shaken == pytest.approx(1e-4 * (TURN * 100.0) ** 2, rel=0.2)


def test_a_speed_that_stops_and_a_bearing_it_does_not_describe_are_refused() -> None:
    with pytest.raises(ValueError, match=r"speed_slope -1500.* stops the shaft"):
        solve(replace(SCENE, speed_slope=-1500.0), Request(duration=0.1, rate=25600.0))
    with pytest.raises(ValueError, match="one row of balls"):
        replace(SCENE, bearing=from_catalogue("1205 ETN9"))
    with pytest.raises(ValueError, match="one row of balls"):
        trace(replace(SCENE, bearing=replace(LEFT_BEARING, rows=2)), 1.0, 1e-3)
    assert 5e-6 < longest_step(SCENE, prepare_plan(SCENE, assemble(SCENE))) < 15e-6


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("elements", 3),
        ("groove", 0.5),
        ("damping", 0.0),
        ("coupling", 0.0),
        ("play", -1e-6),
        ("located", "c"),
        ("encoder", "d"),
        ("mode_limit", math.inf),
        ("cage_angle_b", math.nan),
        ("inner_diameter", 0.05),
    ],
)
def test_unusable_parameters_are_refused_by_name(name: str, value: Any) -> None:
    with pytest.raises(ValueError, match=name):
        AngularRig(**{name: value})


# All modes as they are, as of the oracle.
RIG = AngularRig(mode_limit=100e3)
WIDE = math.radians(30.0)
CASES = {
    "healthy, slower and slower": Case(cages=(0.1, 0.2), slope=-300.0),
    "hunting": Case(cages=(0.1, 0.2), swing=30.0, pace=20.0, unbalance=1e-4),
    "onto a spall": Case(pits=(Pit(0, "outer", 0.13, 0.2, WIDE, 100e-6),)),
    "inner race of B, shallow": Case(speed=150.0, axial=0.0, pits=(Pit(1, "inner", -0.12, 0.2, None, 4e-6),)),
    "20,000 rpm, narrow spall": Case(20000 / 60, pits=(Pit(1, "outer", 0.1, 0.15, 0.1, 100e-6),)),
    "unbalance, seven balls": Case(50.0, 200.0, -100.0, (7, 7), 200.0, 1e-3, (0.3, 0.0), 10e-6),
}
QUICK = ("onto a spall",)


def swinging(case: Case) -> SpeedProfile:
    """Return the rotation of a case, with knots so close that its acceleration is that of the formula."""
    times = np.linspace(0.0, 0.005, 501)
    angle, speed, _ = case.nominal(times)
    return SpeedProfile(*(tuple(row.tolist()) for row in (times, angle / (2.0 * math.pi), speed / (2.0 * math.pi))))


def scene_of(case: Case) -> Scene:
    """Return the product's scene of a case."""
    defects = tuple(
        Defect(
            pit.extent, pit.depth, position=pit.middle, part=cast("Part", pit.race), width=pit.width,
            support="b" if pit.bearing else "a",
        )
        for pit in case.pits
    )  # fmt: skip
    a, b = (Bearing("", balls, D, DM) for balls in case.balls)
    return Scene(
        case.speed,
        case.load,
        bearing=a,
        second_bearing=b,
        rig=replace(RIG, cage_angle_a=case.cages[0], cage_angle_b=case.cages[1], play=case.play),
        defect=defects[0] if defects else None,
        more_defects=defects[1:],
        axial_load=case.axial,
        speed_slope=case.slope,
        unbalance=case.unbalance,
        speed_profile=swinging(case) if case.swing else None,
    )


@pytest.mark.parametrize("name", list(CASES) if effort_count(quick=1, full=2) == 2 else QUICK)
def test_speed_and_accelerations_are_those_of_the_oracle(name: str) -> None:
    # The ball meets the spall after a tenth of a millisecond.
    case, duration = CASES[name], effort_count(quick=2, full=10) * 1e-4
    scene = scene_of(case)
    found = trace(scene, duration * case.speed, 2.0 * math.pi * case.speed * 1e-6)
    assert found.finite
    assert found.unbalanced < 1e-6
    chosen = np.arange(0, len(found.time), 14)
    assembly = assemble(scene)
    cosines = tuple(math.cos(ring.mean_angle) for ring in assembly.rings)
    expected = angular_oracle.simulate(
        case,
        assembly.displacement[:-1].reshape(-1, 5),
        float(assembly.displacement[-1]),
        cast("tuple[float, float]", cosines),
        found.time[chosen],
    )
    assert found.angle[chosen] - found.angle[0] == pytest.approx(expected["angle"] - expected["angle"][0], abs=2e-9)
    for ours, other in (
        (found.ias[chosen], expected["ias"]),
        *zip(found.acceleration[chosen].T, expected["acceleration"].T, strict=True),
    ):
        level = float(np.sqrt(np.mean(other**2)))
        assert level > 0.0
        assert np.abs(ours - other).max() < 3e-3 * level
        assert np.median(np.abs(ours - other)) < 5e-4 * level
