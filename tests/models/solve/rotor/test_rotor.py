"""The rotor on two bearings: closed forms, symmetry, limits, order of convergence, massless ends, hard cases.

The rotor's kernel against an oracle that shares no code with it: every effect, rigid and elastic shaft.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from models.machine.bearing import from_catalogue, kinematics
from models.machine.scene import Defect, Part, Scene
from models.solve.rotor.elastic import Massless, shaft_of
from models.solve.rotor.plan import at_rest, prepare_plan
from models.solve.rotor.rig import RotorRig
from models.solve.rotor.solver import Rigid, RotorTrace
from models.solve.simulate import simulate
from models.words.request import Request
from tests.oracles import rotor_oracle
from tests.oracles.rotor_oracle import Case
from tests.support.effort import effort_count

BALLS = from_catalogue("6305")
SCENE = Scene(1000.0 / 60.0, 100.0, bearing=BALLS, rig=RotorRig(), clearance=11.285e-6)
FREE = replace(SCENE, load=0.0, clearance=1.0, speed=30.0)
LUMPED = replace(SCENE, rig=RotorRig(end_mass=0.3))
PIT = Defect(0.2 / 54.67, 1e-4)


def rms(x: Any) -> float:
    return float(np.sqrt(np.mean(np.abs(x) ** 2)))


def test_a_free_disc_obeys_the_closed_form_of_unbalance_and_damping() -> None:
    found = Rigid(replace(FREE, unbalance=5e-4)).trace(0.2, 50e-6)
    rig, speed = RotorRig(), 2.0 * math.pi * FREE.speed
    t, decay = found.step * np.arange(len(found.c)), rig.c_n / rig.m
    force = 5e-4 * speed**2 / (rig.m * (1j * speed + decay))
    exact = (force * (1j * speed * np.exp(1j * speed * t) + decay * np.exp(-decay * t))).real
    assert rms(found.acceleration[:, 2] - exact) < 1e-8 * rms(exact)
    assert np.all(found.tilt == 0.0)


def test_a_free_disc_obeys_the_closed_form_of_the_gyroscopic_moment() -> None:
    couple, lead = 1e-3, 0.7
    rig, speed = RotorRig(couple_angle=lead), 2.0 * math.pi * FREE.speed
    found = Rigid(replace(FREE, rig=rig, couple_unbalance=couple)).trace(0.2, 50e-6)
    t, own = found.step * np.arange(len(found.c)), speed * rig.j_p / rig.j_t
    # phi'' - i own phi' = couple speed^2 / j_t e^{i (speed t + lead)}, from rest.
    amplitude = couple * speed**2 / rig.j_t * np.exp(1j * lead) / (1j * (speed - own))
    exact = (amplitude * (1j * speed * np.exp(1j * speed * t) - 1j * own * np.exp(1j * own * t))).real
    assert rms(found.acceleration[:, 0] - rig.a * exact) < 1e-6 * rms(rig.a * exact)
    assert rms(found.acceleration[:, 1] + rig.b * exact) < 1e-6 * rms(rig.b * exact)
    assert np.all(found.acceleration[:, 2] == 0.0)


def test_springs_of_the_shaft_are_those_of_a_beam_on_two_supports() -> None:
    rig = RotorRig(a=0.3)
    k_a, k_b = rig.shaft_stiffness
    a, b = rig.a, rig.b
    stiffness = np.array([[k_a + k_b, a * k_a - b * k_b], [a * k_a - b * k_b, a**2 * k_a + b**2 * k_b]])
    bending = 3.0 * rig.modulus * math.pi * rig.shaft_diameter**4 / 64.0 * rig.length
    compliance = np.linalg.inv(stiffness)
    # Deflection and slope at the load, and slope under a moment there (Roark).
    assert compliance[0, 0] == pytest.approx(a**2 * b**2 / bending, rel=1e-12)
    assert abs(compliance[0, 1]) == pytest.approx(a * b * (b - a) / bending, rel=1e-10)
    assert compliance[1, 1] == pytest.approx((a**2 - a * b + b**2) / bending, rel=1e-12)
    assert RotorRig().shaft_stiffness[0] == pytest.approx(179.8e3, rel=1e-3)


def test_equal_cages_move_as_one_bearing_without_tilt() -> None:
    found = Rigid(replace(SCENE, rig=RotorRig(cage_angle_a=0.0))).trace(0.1, 20e-6)
    assert np.max(np.abs(found.tilt)) < 1e-12
    assert found.acceleration[:, 0] == pytest.approx(found.acceleration[:, 2], abs=1e-6)
    # All forces and masses twice as large are the same motion.
    rig = RotorRig(cage_angle_a=0.0)
    twice = replace(rig, m=2.0 * rig.m, c_n=2.0 * rig.c_n, k_c=2.0 * rig.k_c, c_b=2.0 * rig.c_b)
    heavy = Rigid(replace(SCENE, load=2.0 * SCENE.load, rig=twice)).trace(0.1, 20e-6)
    assert heavy.acceleration[:, 2] == pytest.approx(found.acceleration[:, 2], abs=1e-6)


@pytest.mark.parametrize("elastic", [False, True])
def test_exchanging_the_supports_exchanges_the_sensors(*, elastic: bool) -> None:
    ours = RotorRig(a=0.3, cage_angle_a=0.1, cage_angle_b=0.6, end_mass=0.2)
    other = replace(ours, a=0.5, cage_angle_a=0.6, cage_angle_b=0.1)
    scene = replace(SCENE, rig=ours, second_bearing=BALLS, defect=replace(PIT, position=0.05))
    mirror = replace(scene, rig=other, defect=replace(PIT, position=0.05, support="b"))
    kind = shaft_of if elastic else Rigid
    left, right = (kind(one).trace(0.05, 20e-6) for one in (scene, mirror))
    swapped = right.acceleration[:, [1, 0, 2]]
    assert rms(left.acceleration - swapped) < 1e-5 * rms(swapped)


def test_a_stiff_shaft_is_a_rigid_one() -> None:
    scene = replace(SCENE, rig=RotorRig(end_mass=0.3, length=0.2, a=0.1, modulus=200e9))
    rigid = Rigid(scene).trace(0.05, 5e-6)
    errors = []
    for modulus in (200e12, 200e13):
        bent = shaft_of(replace(scene, rig=replace(scene.rig, modulus=modulus))).trace(0.05, 0.5e-6)
        errors.append(rms(bent.c[::10][:-1] - rigid.c[:-1][: len(bent.c[::10]) - 1]) / rms(rigid.c - rigid.c[0]))
    assert errors[0] < 2e-2
    assert errors[1] < errors[0]


def test_rest_is_a_rest() -> None:
    """Shaft and cages stand still in the limit of slow speed: nothing moves away from the equilibrium."""
    for kind, elastic in ((Rigid, False), (shaft_of, True)):
        for rig in (RotorRig(end_mass=0.3, a=0.3), RotorRig(a=0.3)):
            scene = replace(SCENE, speed=1e-6, rig=replace(rig, cage_angle_b=0.1))
            found = kind(scene).trace(0.02, 5e-6)
            assert np.max(np.abs(found.acceleration)) < 1e-4
            rest = at_rest(scene, elastic=elastic)
            assert found.c[-1] == pytest.approx(rest[0] + 1j * rest[1], abs=1e-12)


def fitted_order(runs: list[RotorTrace]) -> float:
    """Return the slope of the error of a place of C over the step, of runs with halved steps; the last is exact."""
    errors = [abs(r.c[round(0.0199 / r.step)] - runs[-1].c[round(0.0199 / runs[-1].step)]) for r in runs[:-1]]
    return float(-np.polyfit(np.arange(len(errors)), np.log2(errors), 1)[0])


def test_order_of_the_kernels() -> None:
    pressed = replace(SCENE, load=5000.0, clearance=0.0, unbalance=1e-3)
    steps = [200e-6 / 2**k for k in (0, 1, 2, 6)]
    assert 3.5 < fitted_order([Rigid(pressed).trace(0.0202, h) for h in steps]) < 5.5
    lumped = replace(pressed, rig=RotorRig(end_mass=0.3, length=0.2, a=0.1))
    assert 3.5 < fitted_order([shaft_of(lumped).trace(0.0202, h / 2) for h in steps]) < 5.5
    # Over impacts the square root of the contact law at its opening leaves the order 2.5 at least.
    hit = replace(SCENE, defect=replace(PIT, position=0.02), clearance=0.0, load=500.0)
    assert fitted_order([Rigid(hit).trace(0.0202, h) for h in steps]) > 2.0
    # Backward Euler of the dampers beside the second order of the disc.
    soft = replace(pressed, rig=RotorRig(length=0.2, a=0.1))
    assert 0.8 < fitted_order([shaft_of(soft).trace(0.0202, h / 8) for h in steps]) < 2.2


def test_massless_ends_are_the_limit_of_light_ones() -> None:
    scene = replace(
        SCENE, rig=RotorRig(length=0.2, a=0.1), defect=replace(PIT, position=0.05), clearance=0.0, load=500.0
    )
    limit = shaft_of(scene).trace(0.02, 2e-6)
    errors = []
    for mass in (0.1, 0.01):
        light = shaft_of(replace(scene, rig=replace(scene.rig, end_mass=mass))).trace(0.02, 2e-6)
        errors.append(rms(light.c - limit.c) / rms(limit.c - limit.c[0]))
    assert errors[1] < 0.2 * errors[0] < 0.05


def test_newton_ends_everywhere() -> None:
    """The halvings are hardly needed: 2 iterations of each balance in the mean, the cap never."""
    for defect in (None, replace(PIT, position=0.05), Defect(0.05, 5e-5, part="ball")):
        for loss in (0.0, 1e-4):
            scene = replace(SCENE, rig=RotorRig(internal_damping=loss), defect=defect)
            shaft = Massless(scene, 0.0)
            wave = np.empty((20_000, 1))
            assert shaft.run(shaft.state(at_rest(scene, elastic=True)), 1e-5, wave, np.empty((0, 8)))
            assert shaft.iterations[0] < 2 * 3 * len(wave)
            assert shaft.iterations[1] < 60


@pytest.mark.parametrize(("speed", "grows"), [(30.0, False), (120.0, True)])
def test_internal_damping_drives_the_whirl_above_its_limit(speed: float, *, grows: bool) -> None:
    """Beyond omega (1 + c_n / c_r) a forward whirl grows (section 3.2.2); omega is 42.7 Hz, c_n / c_r 0.28."""
    rig = RotorRig(c_n=20.0, internal_damping=2e-4, end_mass=0.3, cage_angle_a=0.3)
    scene = Scene(speed, 100.0, bearing=BALLS, rig=rig)
    start = at_rest(scene, elastic=True)
    start[1] += 1e-4
    found = shaft_of(scene).trace(1.0, 20e-6, rest=start)
    quarter = len(found.c) // 4
    first, last = (rms(part - np.mean(part)) for part in (found.c[:quarter], found.c[-quarter:]))
    assert (last > 1.5 * first) if grows else (last < 0.7 * first)


@pytest.mark.parametrize("part", ["outer", "inner", "ball"])
@pytest.mark.parametrize("support", ["a", "b"])
def test_passages_are_those_of_the_kinematics(part: Part, support: Any) -> None:
    scene = replace(SCENE, second_bearing=BALLS, defect=replace(PIT, part=part, support=support, position=0.3))
    lines = kinematics(BALLS, scene.speed)
    rate = {"outer": lines.bpfo, "inner": lines.bpfi, "ball": 2.0 * lines.bsf}[part]
    plan = prepare_plan(scene, 10.0, 4)
    assert len(plan.ball) == pytest.approx(10.0 * rate, abs=2.0)
    assert set(plan.ball) <= set(range(7) if support == "a" else range(7, 14))
    if part == "ball":
        assert len(set(plan.ball)) == 1


def test_depths_of_several_defects_add() -> None:
    outer, inner = Defect(0.4, 2e-6, position=0.3), Defect(0.5, 3e-6, part="inner", position=0.2)
    both = replace(SCENE, defect=outer, more_defects=(inner,))

    def depth(scene: Scene, t: float) -> np.ndarray[Any, Any]:
        plan, total = prepare_plan(scene, 1.0, 4), np.zeros(14)
        interval = int(np.searchsorted(plan.bounds, t, side="right")) - 1
        for r in range(plan.first[interval], plan.first[interval + 1]):
            total[plan.ball[r]] += plan.depth[r] * math.sin(plan.rate[r] * t + plan.offset[r])
        return total

    times = np.linspace(0.0, 0.9, 400)
    ours = np.array([depth(both, t) for t in times])
    single = [np.array([depth(replace(SCENE, defect=d), t) for t in times]) for d in (outer, inner)]
    assert ours == pytest.approx(single[0] + single[1], abs=1e-15)
    assert np.max(ours) > 3.5e-6


HARD = {
    "no load": replace(SCENE, load=0.0),
    "no load, no clearance": replace(SCENE, load=0.0, clearance=0.0),
    "slow": replace(SCENE, speed=0.5),
    "fast": replace(SCENE, speed=500.0, unbalance=1e-4),
    "deep and wide": replace(SCENE, defect=Defect(2.0, 1e-3, position=math.pi)),
    "over the seam": replace(SCENE, defect=Defect(0.5, 1e-5, position=-math.pi)),
    "whole race": replace(SCENE, defect=Defect(2.0 * math.pi, 1e-6)),
    "two at one place": replace(
        SCENE, defect=PIT, more_defects=(replace(PIT, part="inner"), replace(PIT, part="ball"))
    ),
    "no damping": replace(SCENE, rig=RotorRig(c_b=0.0, c_n=0.0)),
    "heavy unbalance": replace(SCENE, unbalance=0.05),
    "disc at the end": replace(SCENE, rig=RotorRig(a=0.79, end_mass=0.1)),
    "other bearing": replace(SCENE, second_bearing=from_catalogue("6205")),
}


@pytest.mark.parametrize("name", list(HARD))
def test_hard_cases_stay_finite_and_within_the_clearance(name: str) -> None:
    scene = HARD[name]
    rig = scene.rig_as(RotorRig)
    for kind, end_mass in ((Rigid, 0.0), (Rigid, 0.2), (shaft_of, 0.0), (shaft_of, 0.2)):
        case = replace(scene, rig=replace(rig, end_mass=end_mass))
        shaft = kind(case)
        found = shaft.trace(0.1, min(20e-6, shaft.longest_step()))
        assert found.finite
        assert np.all(np.isfinite(found.acceleration))
        depth = sum(defect.h_d for defect in scene.defects)
        assert np.max(np.abs(found.a)) < 3.0 * (scene.clearance + depth) + 2e-3


def test_response_says_what_it_knows() -> None:
    request = Request(duration=0.3, rate=25600.0, accuracy=1e-3)
    found = Rigid(SCENE).solve(request)
    assert found.sensors == ("a", "b", "c")
    assert found.status == "converged"
    fine = Rigid(SCENE).solve(replace(request, steps_per_period=8192))
    assert abs(found.rms / fine.rms - 1.0) < 3.0 * found.rms_error + 1e-5
    alone = shaft_of(SCENE).solve(request)
    assert alone.sensors == ("c",)
    with pytest.raises(ValueError, match="sensor 'a': this model has c"):
        alone.levels_of("a")
    assert shaft_of(LUMPED).solve(request).sensors == ("a", "b", "c")
    turned = Rigid(SCENE, 0.5 * math.pi).solve(request)
    assert turned.rms != pytest.approx(found.rms, rel=0.01)
    unlike = Rigid(replace(SCENE, second_bearing=from_catalogue("6205"))).solve(request)
    assert unlike.status in ("not_periodic", "inaccurate")
    assert not unlike.repeats


def test_the_scene_chooses_the_shaft() -> None:
    request: dict[str, Any] = {"duration": 0.2, "rate": 25600.0, "accuracy": 5e-3}
    rigid = simulate(replace(SCENE, model="rotor"), **request)
    assert (rigid.model, rigid.solver) == ("rotor", "rigid")
    for scene in (LUMPED, replace(LUMPED, physics=("elastic_shaft",))):
        bent = simulate(scene, **request)
        assert (bent.model, bent.solver) == ("rotor", "elastic")
        assert bent.why is not None
        assert "bends the shaft" in bent.why


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"m": 0.0}, "rig.m must be positive"),
        ({"a": 0.9}, "rig.a must be less than rig.length"),
        ({"c_b": -1.0}, "rig.c_b"),
        ({"k_c_b": 0.0}, "rig.k_c_b"),
        ({"bow_angle": math.nan}, "rig.bow_angle"),
        ({"element": "cube"}, "rig.element"),
    ],
)
def test_a_senseless_rig_is_refused_by_name(change: dict[str, Any], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        RotorRig(**change)


def test_bearings_that_it_does_not_describe_are_refused_by_name() -> None:
    with pytest.raises(ValueError, match=r"contact angle of 10\.2 degrees"):
        Scene(40.0, 100.0, rig=RotorRig())
    with pytest.raises(ValueError, match="that of a ball, NU 202 ECP has rollers"):
        replace(SCENE, bearing=from_catalogue("NU 202 ECP"))
    with pytest.raises(ValueError, match="has rollers"):
        Rigid(replace(SCENE, second_bearing=from_catalogue("NU 202 ECP"))).solve(Request(duration=0.1))
    with pytest.raises(ValueError, match="with_elastic_shaft: rotor does not describe this with this shaft"):
        Rigid(replace(SCENE, physics=("elastic_shaft",))).solve(Request(duration=0.1))
    with pytest.raises(ValueError, match="duration"):
        Rigid(SCENE).trace(0.0, 1e-5)
    with pytest.raises(ValueError, match="step"):
        Rigid(SCENE).trace(0.1, math.nan)
    assert RotorRig(**RotorRig(a=0.3).as_dict()) == RotorRig(a=0.3)


CASES = {
    "healthy": Case(),
    "unlike arms": Case(a=0.3, b=0.5, cage=(0.1, 0.7)),
    "outer race": Case(part="outer", middle=0.02, extent=0.01, depth=1e-4),
    "inner race of B": Case(part="inner", side=1, middle=0.05, extent=0.01, depth=5e-6, cage=(0.1, 0.05)),
    "ball": Case(part="ball", middle=0.3, extent=0.05, depth=5e-5),
    "unbalance and couple": Case(unbalance=5e-4, couple=1e-3, lead=0.4, speed=40.0),
    "bow": Case(bow=5e-5, slope=1e-4, lead=1.0, speed=40.0, gap=0.0),
    "end masses": Case(end_mass=0.3, a=0.3, b=0.5, bow=2e-5),
    "elastic": Case(elastic=True, end_mass=0.3),
    "elastic, all": Case(
        elastic=True, end_mass=0.3, loss=2e-4, part="outer", middle=0.02, extent=0.01, depth=1e-5, a=0.1, b=0.15,
        unbalance=5e-4, couple=1e-3, bow=2e-5, slope=1e-4, lead=0.4, speed=30.0
    ),
}  # fmt: skip
QUICK = ("unlike arms", "outer race", "ball", "bow", "elastic, all")


def scene_of(case: Case) -> Scene:
    """Return the product's scene of a case."""
    bearing = from_catalogue("6305")
    defect = None
    if case.part != "none":
        support = "a" if case.side == 0 else "b"
        defect = Defect(case.extent, case.depth, position=case.middle, part=cast("Part", case.part), support=support)
    rig = RotorRig(
        length=case.a + case.b,
        a=case.a,
        end_mass=case.end_mass,
        internal_damping=case.loss,
        cage_angle_a=case.cage[0],
        cage_angle_b=case.cage[1],
        couple_angle=case.lead,
        bow_angle=case.lead,
        bow_slope=case.slope / case.bow if case.bow else 0.0,
    )
    return Scene(
        case.speed,
        case.load,
        bearing=bearing,
        second_bearing=bearing,
        rig=rig,
        defect=defect,
        clearance=case.gap,
        unbalance=case.unbalance,
        couple_unbalance=case.couple,
        bow=case.bow,
    )


@pytest.mark.parametrize("name", list(CASES) if effort_count(quick=1, full=2) == 2 else QUICK)
def test_accelerations_are_those_of_the_oracle(name: str) -> None:
    case, step, duration = CASES[name], 10e-6, 0.03
    scene = scene_of(case)
    found = (shaft_of if case.elastic else Rigid)(scene).trace(duration, step)
    chosen = np.arange(0, len(found.acceleration), 7)
    expected = rotor_oracle.simulate(case, step * chosen.astype(np.float64))
    level = np.sqrt(np.mean(expected**2, axis=0))
    ours = found.acceleration[chosen]
    # At the instant of a jump one of both may stand before it: the middle of the errors, and nearly all of them.
    error = np.abs(ours - expected) / level
    assert np.quantile(error, 0.99) < 5e-4
    assert np.median(error) < 2e-5
