"""The judges of names: the verdict on a name, the depth that is measured apart, the machines that are drawn."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.naming import faults as seeded_faults
from benchmarks.naming.faults import HELD_OUT, TRAINING, draw, make
from benchmarks.naming.truth import comb_depth, envelope_spectrum
from models.machine.bearing import from_catalogue
from reference.recordings import CASES, OTHER_ENDS, judge

RATE, BAND = 12800.0, (1000.0, 5000.0)


@pytest.mark.parametrize(
    ("part", "fault", "verdict"),
    [
        ("outer", "outer", "right"),
        ("ball", "ball|cage", "joined"),
        ("ball", "cage", "wrong"),
        ("inner", "ball|cage", "wrong"),
        ("inner", None, "silent"),
        ("inner", "undecided", "silent"),
        (None, None, "quiet"),
        (None, "outer|inner", "healthy named"),
    ],
)
def test_a_name_is_judged(part: str | None, fault: str | None, verdict: str) -> None:
    assert judge(part, fault) == verdict


def test_what_a_case_expects_is_no_wrong_name_of_it() -> None:
    for case in (*CASES, *OTHER_ENDS):
        assert {case.judge(fault) for fault in case.allowed} <= {"right", "joined", "silent", "quiet", "disputed"}
        assert (None in case.allowed) == (case.expected is None)


@pytest.mark.parametrize("depth", [0.1, 0.3, 0.4])
def test_the_depth_of_a_known_comb_is_measured(depth: float) -> None:
    rng, t = np.random.default_rng(3), np.arange(round(8 * RATE)) / RATE
    swing = 1.0 + sum(depth / np.sqrt(5.0) * np.cos(2 * np.pi * (k * 71.3 * t + rng.uniform())) for k in range(1, 6))
    found = envelope_spectrum(rng.standard_normal(t.size) * np.abs(swing), RATE, BAND)
    # The band cuts some sidebands off.
    assert comb_depth(found, 71.3) == pytest.approx(depth, rel=0.13)
    assert comb_depth(found, 71.6, 0.01) == pytest.approx(depth, rel=0.13)
    assert comb_depth(found, 63.0) < 0.05
    assert comb_depth(found, 0.9) == 0.0


def test_one_line_is_no_comb() -> None:
    rng, t = np.random.default_rng(4), np.arange(round(8 * RATE)) / RATE
    x = rng.standard_normal(t.size) * (1.0 + 0.8 * np.cos(2 * np.pi * 71.3 * t))
    assert comb_depth(envelope_spectrum(x, RATE, BAND), 71.3) < 0.3


def test_seeds_that_were_set_aside_are_apart_and_a_seed_is_a_record() -> None:
    assert not set(TRAINING) & set(HELD_OUT)
    seed = next(seed for seed in TRAINING if draw(seed).part == "cage" and draw(seed).duration < 4.0)
    first, again = make(seed), make(seed)
    np.testing.assert_array_equal(first.samples, again.samples)
    assert first.samples.size == round(first.plan.rate * first.plan.duration)
    assert first.line == pytest.approx(first.plan.lines.ftf * (1.0 - first.plan.slip))


def test_passages_come_at_the_frequency_that_slip_gives(monkeypatch: pytest.MonkeyPatch) -> None:
    """A late cage lets the balls pass the outer race slower and the inner race faster; the pieces are not looked at."""
    monkeypatch.setattr(seeded_faults, "_pieces", lambda *_: (np.ones((1, 40)), np.zeros(1)))
    plans = [draw(seed) for seed in TRAINING]
    for part, sign in (("outer", -1.0), ("inner", 1.0)):
        few = [plan for plan in plans if plan.part == part and plan.model == "rotor" and plan.jitter < 0.005]
        plan = min((plan for plan in few if plan.speed * plan.duration > 20.0), key=lambda plan: plan.duration)
        line = make(plan.seed).line
        nominal = {"outer": plan.lines.bpfo, "inner": plan.lines.bpfi}[part]
        balls = from_catalogue(plan.bearing).n_elements
        assert line == pytest.approx(nominal + sign * plan.slip * balls * plan.lines.ftf, rel=2e-3)
