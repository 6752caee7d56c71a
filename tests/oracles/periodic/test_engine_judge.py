"""What the comparison of engine and oracle calls wrong, unstable and bounded."""

from __future__ import annotations

from dataclasses import replace

import pytest

from models.machine.bearing import kinematics
from models.solve.simulate import simulate
from reference.periodic.judge import answer, engine_scene, solve, verdict
from reference.periodic.scenes import DEVELOPMENT, scenes
from tests.support.periodic_oracle import ROLLERS, SPALL

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
}
ANSWER = {"status": "converged", "rms": 2.0, "peak": 6.0, "lines": TRUTH["lines"], "estimate": None, "ms": 1.0}


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
