"""Effects that are too small to matter: their bounds hold, they are left out and said, and where they are not."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.machine.rig import Rig
from models.machine.scene import EFFECTS, Defect, Floor, Scene, Slip, Waviness
from models.machine.speed_profile import ramp
from models.solve.registry import MODELS, WeakEffects, solvers, weak_effects
from models.solve.response import CASING, LeftOut, Response
from models.solve.simulate import select, simulate
from models.words.request import Quantity, Request, Sensor
from reference.weak_scenes import KINDS, change_over_time, plain_scene, weak_scene, with_effect
from tests.support.effort import effort_count

PIT = Defect(0.1, 5e-4)
SCENE = Scene(40.0, 2000.0, defect=PIT)
SHORT: dict[str, Any] = {"duration": 0.1, "rate": 25600.0}
# What two simulations over time tell apart, over the RMS: further events divide other steps.
FLOOR = 3e-5
NEGLIGIBLE: dict[str, dict[str, Any]] = {
    "unbalance": {"unbalance": 1e-9},
    "slip": {"slip": Slip(1e-7)},
    "mean_force_slip": {"slip": Slip(1e-7, "mean_force")},
    "inner_waviness": {"waviness": (Waviness(1e-12, 12, "inner"),)},
    "inner_defect": {"more_defects": (Defect(1e-5, 1e-6, part="inner"),)},
    "ball_defect": {"more_defects": (Defect(0.1, 1e-12, part="ball"),)},
}


def weak() -> WeakEffects:
    found = weak_effects(Rig.model)
    assert found is not None
    return found


@cache
def settled(scene: Scene, sensor: Sensor = "mo") -> Response:
    return simulate(scene, accuracy=1e-4, sensor=sensor)


def test_each_effect_of_time_alone_is_bounded_but_a_changing_speed() -> None:
    periodic, *others = solvers(Rig.model)
    assert periodic.name == "periodic"
    only = frozenset().union(*(solver.effects for solver in others)) - periodic.effects
    assert weak().names == set(NEGLIGIBLE) == set(KINDS) == only - {"changing_speed"}
    assert all(weak_effects(model) is None for model in MODELS if model != Rig.model)


@pytest.mark.parametrize("model", ["auto", "six_dof"])
@pytest.mark.parametrize("effect", NEGLIGIBLE)
def test_what_cannot_matter_is_left_out_and_said(effect: str, model: str) -> None:
    plain = replace(SCENE, model=model)
    scene = replace(plain, **NEGLIGIBLE[effect])
    found, without = simulate(scene, accuracy=0.05), simulate(plain, accuracy=0.05)
    assert (found.solver, found.status, found.record) == ("periodic", "converged", None)
    assert found.rms == pytest.approx(without.rms, rel=0.05)
    (left,) = found.left_out
    assert left == LeftOut(effect, left.bound)
    assert 0.0 < left.bound < 0.05 / 3.0
    assert left.bound < found.rms_error <= 0.05
    assert found.why is not None
    assert f"left out, as too small to matter: {EFFECTS[effect]} (at most {left.bound:.1g} of the RMS)" in found.why
    assert (without.left_out, without.why is None) == ((), model == "six_dof")


def test_every_stated_error_contains_what_is_left_out() -> None:
    scene, asked = replace(SCENE, unbalance=1e-6), Request(accuracy=0.05 * 2.0 / 3.0)
    plain, found = select(SCENE, asked).answer(), simulate(scene, accuracy=0.05)
    change = weak().bounds(scene, plain)["unbalance"]
    assert change.wave > 1e-5
    assert 0.0 < change.rms < change.wave
    assert found.left_out == (LeftOut("unbalance", change.rms),)
    assert found.rms_error - plain.rms_error == pytest.approx(change.rms, rel=1e-3)
    assert found.waveform_error - plain.waveform_error == pytest.approx(change.wave)
    assert found.peak_error - plain.peak_error >= change.wave
    assert found.harmonics_error - plain.harmonics_error == pytest.approx(math.sqrt(2.0) * change.wave * found.rms)
    assert found.lines_error == pytest.approx(np.max(found.harmonics_error) / np.max(found.harmonics))


@pytest.mark.parametrize("quantity", ["waveform", "lines"])
def test_the_bound_is_that_of_what_is_asked_for(quantity: Quantity) -> None:
    scene = replace(SCENE, unbalance=1e-6)
    level, found = simulate(scene, accuracy=0.05), simulate(scene, quantity=quantity, accuracy=0.05)
    assert found.error == found.error_of(quantity) <= 0.05
    assert level.left_out[0].bound < found.left_out[0].bound < found.error


def test_several_are_left_out_together_or_none() -> None:
    small = replace(SCENE, unbalance=1e-9, slip=Slip(1e-7))
    both = {one.effect: one.bound for one in simulate(small, accuracy=0.05).left_out}
    alone = simulate(replace(SCENE, slip=Slip(1e-7)), accuracy=0.05).left_out[0]
    assert set(both) == {"unbalance", "slip"}
    assert alone.bound < both["slip"] <= 2.0 * alone.bound * (1.0 + 1e-2)
    found = simulate(replace(small, more_defects=(Defect(0.05, 1e-5, part="inner"),)), accuracy=0.05, **SHORT)
    assert (found.solver, found.left_out) == ("time_domain", ())
    found = simulate(replace(small, unbalance=0.1), accuracy=0.05)
    assert ([one.effect for one in found.left_out], found.added and found.added.effects) == (["slip"], ("unbalance",))


@pytest.mark.parametrize(
    ("change", "asked"),
    [
        ({"slip": Slip(0.01)}, {}),
        ({"more_defects": (Defect(0.05, 1e-5, part="inner"),)}, {}),
        # Nothing is known of these, or it is not what they are asked for.
        ({"more_defects": (Defect(0.1, 1e-12, Floor("rough"), part="inner"),)}, {}),
        ({"unbalance": 1e-9}, {"steps_per_period": 1000}),
        ({"unbalance": 1e-2, "slip": Slip(0.01)}, {}),
        ({"defect": Defect(1e-7, 1e-6, part="inner")}, {"quantity": "lines"}),
        ({"unbalance": 1e-12, "speed_profile": ramp(40.0, 40.0 * (1.0 + 1e-12), 0.1)}, {}),
        # Nothing carries a load, nothing vibrates, or the motion does not repeat.
        ({"unbalance": 1e-9, "load": 0.0}, {}),
        ({"unbalance": 1e-12, "load": 1.0, "clearance": 1e-5, "defect": Defect(math.radians(20.0), 20e-6)}, {}),
    ],
)
def test_an_effect_that_may_matter_is_simulated_over_time(change: dict[str, Any], asked: dict[str, Any]) -> None:
    scene = replace(SCENE, **change)
    options: dict[str, Any] = {"accuracy": 0.05} | SHORT | asked
    found = simulate(scene, **options)
    assert (found.solver, found.left_out) == ("time_domain", ())
    assert found.why is None or "left out" not in found.why


def test_what_no_solver_describes_is_refused_however_small() -> None:
    with pytest.raises(ValueError, match="slip moves a ball to or from a defect of a race"):
        simulate(replace(SCENE, more_defects=(Defect(1e-6, 1e-9, part="ball"),), slip=Slip(1e-9)), accuracy=0.05)
    with pytest.raises(
        ValueError, match="unbalance: no model describes this together with outer_defect, mean_force_slip"
    ):
        simulate(replace(SCENE, unbalance=1e-12, slip=Slip(1e-9, "mean_force")), accuracy=0.05)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "mean_force_slip"])
def test_the_bound_holds_over_time(kind: str) -> None:
    """With and without the effect, the same steps: what it changes of the waveform, and so of the RMS."""
    first, compared = 1000 * KINDS.index(kind), 0
    for seed in range(first, first + effort_count(quick=4, full=60)):
        scene, sensor = weak_scene(seed, kind), CASING[seed % 2]
        found = settled(weak().without(scene), sensor)
        if found.status != "converged":
            continue
        change = weak().bounds(scene, found)[kind]
        wave, level = change_over_time(scene, weak().without(scene), seconds=0.2, step=5e-6, sensor=sensor)
        assert wave <= (change.wave + FLOOR) * found.rms, seed
        assert level <= (change.rms + FLOOR) * found.rms, seed
        compared += 1
    assert compared > 0


@pytest.mark.parametrize("share", [1e-4, 1e-2, 1e-7][: effort_count(quick=1, full=3)])
def test_the_bound_holds_for_the_mean_force_of_slip(share: float) -> None:
    scene = with_effect(SCENE, "mean_force_slip", share)
    found, averaged = settled(SCENE), select(scene, Request(accuracy=2e-3)).answer()
    bound = weak().bounds(scene, found)["mean_force_slip"].rms
    assert abs(averaged.rms / found.rms - 1.0) <= bound + averaged.rms_error + found.rms_error


@given(
    kind=st.sampled_from(KINDS),
    seed=st.integers(0, 3),
    share=st.floats(1e-14, 1.0),
    factor=st.floats(1.0, 1e3),
    wide=st.booleans(),
)
def test_a_larger_effect_has_no_smaller_bound(kind: str, seed: int, share: float, factor: float, wide: bool) -> None:
    plain = plain_scene(seed, damaged=True)
    found = settled(plain)
    small, large = (with_effect(plain, kind, size, wide=wide) for size in (share, min(share * factor, 1.0)))
    if any(weak().without(scene).defect is not plain.defect for scene in (small, large)):
        return
    low, high = (weak().bounds(scene, found)[kind] for scene in (small, large))
    assert 0.0 < low.wave <= high.wave * (1.0 + 1e-9)
    assert low.rms <= high.rms * (1.0 + 1e-9)
