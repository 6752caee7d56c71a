"""What the comparison of engine and oracle calls wrong, unstable and bounded."""

from __future__ import annotations

from dataclasses import replace

import pytest

from models.machine.bearing import kinematics
from models.solve.simulate import simulate
from reference.periodic.judge import answer, compared, engine_scene, solve, verdict
from reference.periodic.rig import OracleScene, Pit, Wave
from reference.periodic.scenes import DEVELOPMENT, scenes
from reference.periodic.settle import simulate_oracle
from tests.support.periodic_oracle import ROLLERS, SPALL, thesis_scene

TRUTH = {
    "status": "settled",
    "rms": 2.0,
    "spread": 0.0,
    "standard_error": 0.0,
    "repeats": True,
    "lines": (1.0, 0.5, 0.1, 0.1, 0.1, 0.1),
    "peak": 6.0,
    "motion_resonance": 100.0,
    "error": 1e-8,
    "peak_error": 1e-8,
    "line_errors": (1e-8,) * 6,
}
ANSWER = {"status": "converged", "rms": 2.0, "peak": 6.0, "lines": TRUTH["lines"], "estimate": None, "ms": 1.0}
STATED = ANSWER | {"estimate": 1e-3, "peak_estimate": 1e-3, "line_estimates": [1e-3] * 6}


@pytest.mark.parametrize(
    ("answered", "truth", "wrong", "unstable"),
    [
        ({}, {}, False, False),
        ({"rms": 2.0059}, {}, False, False),
        ({"rms": 2.0061}, {}, True, False),
        ({"rms": 2.2, "status": "inaccurate"}, {}, False, False),
        ({"rms": 2.1}, {"status": "not_periodic", "standard_error": 0.1, "repeats": False}, False, False),
        ({"rms": 2.5}, {"status": "not_periodic", "standard_error": 0.1, "repeats": False, "spread": 0.3}, True, True),
        ({}, {"repeats": False, "spread": 1e-6}, False, False),
        ({"rms": float("nan")}, {}, True, False),
    ],
)
def test_what_is_wrong_and_what_unstable(answered: dict, truth: dict, wrong: bool, unstable: bool) -> None:
    row = verdict(SPALL, TRUTH | truth, ANSWER | answered, 1e-3)
    assert (row["wrong"], row["unstable"]) == (wrong, unstable)


def test_an_estimate_bounds_the_error_or_does_not() -> None:
    for estimate, bounded in ((1e-3, False), (6e-3, True)):
        assert verdict(SPALL, TRUTH, ANSWER | {"rms": 2.01, "estimate": estimate}, 1e-3)["bounded"] == bounded
    assert "bounded" not in verdict(SPALL, TRUTH, ANSWER, 1e-3)


def test_scenes_without_a_level_are_not_compared() -> None:
    assert "error" not in verdict(SPALL, TRUTH | {"status": "unresolved"}, ANSWER, 1e-3)
    assert "error" not in verdict(replace(SPALL, beyond=True), None, ANSWER, 1e-3)
    assert "error" not in verdict(SPALL, TRUTH, {"status": "timeout"}, 1e-3)


def test_both_describe_the_same_scene() -> None:
    for scene in scenes(DEVELOPMENT, 40):
        bearing = engine_scene(scene).bearing
        assert 1.0 / kinematics(bearing, scene.speed).bpfo == pytest.approx(scene.period, rel=1e-12)
    assert answer(SPALL, None)["rms"] == simulate(engine_scene(SPALL)).rms
    assert engine_scene(ROLLERS).bearing.element == "roller"


def test_an_entry_carries_its_scene_and_its_error() -> None:
    entry = solve(SPALL, 100_000)
    assert entry["key"] == SPALL.key()
    assert entry["result"]["status"] == "settled"
    assert entry["result"]["error"] < 1e-6


WAVY = replace(thesis_scene(40.0, 2000.0), waves=(Wave(1e-6, 5, 0.7), Wave(4e-7, 13, -1.1)))
SEVERAL = replace(thesis_scene(40.0, 2000.0, 4.0, 2e-5), position=0.1, more=(Pit(0.05, 1e-5, -0.2, 2),))


@pytest.mark.parametrize("scene", [WAVY, replace(WAVY, extent=0.05, depth=1e-5, position=-0.1, rows=1), SEVERAL])
def test_waves_and_several_defects_are_the_same_to_both(scene: OracleScene) -> None:
    truth = simulate_oracle(scene, estimate=False)
    got = simulate(engine_scene(scene), duration=0.5)
    assert truth.status == "settled"
    assert got.rms == pytest.approx(truth.rms, rel=5e-3)
    assert got.harmonics == pytest.approx(truth.lines, abs=1e-2 * max(truth.lines))


def test_each_quantity_is_held_against_the_error_that_is_stated_for_it() -> None:
    got = STATED | {"rms": 2.001, "peak": 6.03, "lines": [1.002, *TRUTH["lines"][1:]]}
    found = {c.quantity: c for c in compared(TRUTH, got)}
    assert list(found) == ["rms", "peak", *(f"line {k}" for k in range(1, 7))]
    assert {name: c.covered for name, c in found.items() if not c.covered} == {"peak": False, "line 1": False}
    assert [name for name, c in found.items() if c.wrong] == ["peak"]
    assert found["line 1"].true == pytest.approx(2e-3)


def test_what_is_not_known_is_not_compared() -> None:
    not_periodic = TRUTH | {"status": "not_periodic", "standard_error": 0.01, "repeats": False, "error": None}
    (mean,) = compared(not_periodic, STATED | {"rms": 2.025})
    assert (mean.quantity, mean.covered) == ("rms", True)
    unstated = STATED | {"peak_estimate": float("nan"), "line_estimates": [float("nan")] * 6}
    assert [c.quantity for c in compared(TRUTH, unstated)] == ["rms"]
    assert compared(TRUTH | {"error": None}, STATED) == []
    assert compared(TRUTH | {"status": "limit"}, STATED) == []
    assert compared(TRUTH, {"status": "refused"}) == []
