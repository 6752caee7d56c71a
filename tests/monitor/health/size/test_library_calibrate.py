"""Recorded runs put a library right: by run, and the less the fewer they are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from monitor.health.size import DamageInput
from monitor.health.size.library.calibrate import RecordedRun, calibrate
from monitor.health.size.library.fit import crps
from monitor.health.size.library.forecaster import LibrarySettings, LibraryState, step
from monitor.health.size.library.model import Library
from monitor.records.library_file import load_library, save_library
from tests.oracles.toy_lives import THRESHOLD, toy_library, toy_life
from tests.support.effort import effort_count

AT = 2
"""Place of the threshold among the targets of a fit: V_eq, 0.03 mm2, 0.05 mm2."""


def recorded(number: int, *, left: float = 1.0) -> RecordedRun:
    """A toy life as a recorded run; on this rig the parts fail when ``left`` of what the library expects has passed."""
    life = toy_life(number)
    return RecordedRun(
        f"run {number}", life.t, life.rms, life.harmonics, life.load, life.speed, left * life.crossing(THRESHOLD)
    )


def errors(known: Library, numbers: range, left: float, features: str) -> tuple[float, float]:
    """CRPS and coverage at half of the time, over runs."""
    scores, covered = [], []
    for number in numbers:
        run = recorded(number, left=left)
        state, _, forecasts = step(LibraryState(), DamageInput(0.0), None, thresholds=[THRESHOLD])
        for i in np.flatnonzero(run.t <= 0.5 * run.end):
            block = DamageInput(
                float(run.t[i]), float(run.rms[i]), tuple(run.harmonics[i]), float(run.load[i]), float(run.speed[i])
            )
            state, _, forecasts = step(state, block, known, LibrarySettings(features=features), thresholds=[THRESHOLD])
        (forecast,) = forecasts
        remains = run.end - state.history.t_first - state.history.elapsed if state.history else 0.0
        levels, quantiles = zip(*forecast.quantiles, strict=True)
        scores.append(crps(np.interp(np.linspace(0, 1, 99), levels, quantiles), remains))
        covered.append(forecast.tt_lower <= remains <= forecast.tt_upper)
    return float(np.mean(scores)), float(np.mean(covered))


@pytest.mark.parametrize("features", ["rms", "rms+harmonics"])
def test_runs_of_a_rig_that_fails_early_put_it_right(features: str) -> None:
    runs = [recorded(number, left=0.6) for number in range(5000, 5012)]
    known = calibrate(toy_library(), runs, features=features, threshold=THRESHOLD)
    unseen = range(6000, 6000 + effort_count(quick=25, full=200))
    before, covered_before = errors(toy_library(), unseen, 0.6, features)
    after, covered_after = errors(known, unseen, 0.6, features)
    assert after < 0.8 * before
    assert covered_after > covered_before
    assert covered_after >= 0.6


def test_runs_like_the_library_change_little() -> None:
    runs = [recorded(number) for number in range(7000, 7030)]
    known = calibrate(toy_library(), runs, features="rms", threshold=THRESHOLD)
    fit = known.fits["rms"]
    assert abs(fit.shift[AT]) < 0.15
    assert 0.8 < fit.stretch[AT] < 1.25


def test_the_fewer_runs_the_less_is_changed() -> None:
    shifts = []
    for count in (1, 4, 16):
        runs = [replace(recorded(5000, left=0.6), name=str(i)) for i in range(count)]
        shifts.append(calibrate(toy_library(), runs, features="rms", threshold=THRESHOLD).fits["rms"].shift[AT])
    assert shifts[2] < shifts[1] < shifts[0] < 0.0
    assert shifts[1] == pytest.approx(2.5 * shifts[0])


def test_it_is_said_kept_and_not_added_up(tmp_path: Path) -> None:
    runs = [recorded(number, left=0.6) for number in range(5000, 5004)]
    once = calibrate(toy_library(), runs, features="rms", threshold=THRESHOLD)
    assert once.prior == "toy lives; calibrated on 4 recorded runs"
    assert once.calibration["rms 0.05"]["runs"] == 4
    assert once.hash != toy_library().hash
    assert once.fits["v_eq"] is toy_library().fits["v_eq"]
    assert once.fits["rms"].shift[0] == 0.0
    assert calibrate(once, runs, features="rms", threshold=THRESHOLD).hash == once.hash
    save_library(once, tmp_path / "a.npz")
    assert load_library(tmp_path / "a.npz").hash == once.hash


def test_blocks_without_figures_are_passed_over() -> None:
    run = recorded(5001, left=0.6)
    spoiled = replace(run, rms=np.where(np.arange(len(run.t)) % 7 == 3, np.nan, run.rms))
    known = calibrate(toy_library(), [spoiled], features="rms", threshold=THRESHOLD).fits["rms"].shift[AT]
    whole = calibrate(toy_library(), [run], features="rms", threshold=THRESHOLD).fits["rms"].shift[AT]
    assert known == pytest.approx(whole, abs=0.03)


def test_runs_outside_the_library_are_left_out_and_named_where_all_are() -> None:
    far = replace(recorded(5000), load=np.full(len(recorded(5000).t), 9000.0), name="far")
    known = calibrate(toy_library(), [far, recorded(5001)], features="rms", threshold=THRESHOLD)
    assert known.calibration["rms 0.05"] | {"shift": 0, "stretch": 0} == {
        "runs": 1,
        "left_out": 1,
        "shift": 0,
        "stretch": 0,
    }
    with pytest.raises(ValueError, match=r"no moment of any run lies within the library \(far\)"):
        calibrate(toy_library(), [far], features="rms", threshold=THRESHOLD)
    with pytest.raises(ValueError, match="got 'v_eq'"):
        calibrate(toy_library(), [recorded(5001)], features="v_eq", threshold=THRESHOLD)
    with pytest.raises(ValueError, match="no runs were given"):
        calibrate(toy_library(), [], features="rms", threshold=THRESHOLD)
