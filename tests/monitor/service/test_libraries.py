"""The library that ships: what it is made of, and what ``forecast`` says with it of a history of V_eq."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from models.lives.growth import GROWTH, TrackingError, grow_life, grow_lives
from monitor.cli import spallwatch
from monitor.commands.common import InputError
from monitor.health.size import DamageInput
from monitor.health.size.library.forecaster import LibrarySettings, LibraryState, step
from monitor.service.libraries import SHIPPED, shipped_library
from tests.support.effort import effort_count

HASH = "a9ff1c91423a2fc001c9602bf4d664ceaeb78a1a01e09f845c776628d1292617"
MAX_BYTES = 300_000
LIVES = 2500


def forecast(path: Path, *arguments: str) -> dict[str, Any]:
    done = CliRunner().invoke(spallwatch, ["forecast", "--json", str(path), *arguments], catch_exceptions=False)
    return json.loads(done.stdout)


def written(folder: Path, t: np.ndarray, v_mm2: np.ndarray) -> Path:
    path = folder / "v.csv"
    rows = "".join(f"{a!r},{b!r}\n" for a, b in zip(t.tolist(), v_mm2.tolist(), strict=True))
    path.write_text("time_s,v_eq_mm2\n" + rows)
    return path


def test_the_file_is_the_one_that_was_made_and_small() -> None:
    library = shipped_library()
    assert library.hash == HASH
    assert SHIPPED.stat().st_size < MAX_BYTES
    assert set(library.fits) == {"v_eq"}
    assert library.made_of["runs"] == LIVES
    assert library.made_of["growth"] == json.loads(GROWTH.as_json())
    assert library.prior.startswith(f"{LIVES} simulated growths of V_eq without a rig: quadratic 6%")


def test_lives_without_vibration_have_the_growth_of_their_population() -> None:
    for number, life in enumerate(grow_lives(GROWTH, range(20))):
        assert np.all(np.diff(life.v_eq) >= 0.0)
        assert np.array_equal(life.tracked, grow_life(GROWTH, number).tracked)
        assert life.crossing(GROWTH.threshold) <= life.t[-1] or life.law == "standstill"


def test_tracked_v_eq_is_off_by_as_much_as_is_said() -> None:
    error = TrackingError(sd=(0.3, 0.3))
    rng = np.random.default_rng(0)
    drawn = np.array([error.draw(rng, 60) for _ in range(1500)])
    assert drawn.std() == pytest.approx(0.3, rel=0.05)
    apart = np.mean(drawn[:, :-25] * drawn[:, 25:]) / 0.3**2
    assert apart == pytest.approx(0.65 + 0.3 / math.e, abs=0.1)


def test_a_history_is_forecast_without_a_library_and_the_answer_names_it(tmp_path: Path) -> None:
    t = 3600.0 * np.arange(60)
    v_mm2 = 0.004 * np.exp(0.04 * np.arange(60))
    found = forecast(written(tmp_path, t, v_mm2), "--threshold-mm2", "0.05", "--threshold-mm2", "0.1")
    assert found["library"] == "growth"
    assert found["method"] == "library"
    assert shipped_library().hash[:16] in found["prior"]
    for threshold in (0.05, 0.1):
        rows = [row for row in found["rows"] if row["threshold_mm2"] == threshold and row["status"] == "ok"]
        assert len(rows) > 40
        inside = [
            row["tt_lower_s"] <= 3600.0 * math.log(threshold / v) / 0.04 <= (row["tt_upper_s"] or math.inf)
            for row in rows
            if (v := 0.004 * math.exp(0.04 * row["t_issue_s"] / 3600.0)) < threshold
        ]
        assert np.mean(inside) > 0.8


def test_the_answer_has_no_scale_of_its_own(tmp_path: Path) -> None:
    t, v_mm2 = 600.0 * np.arange(40), 0.004 * np.exp(0.05 * np.arange(40))
    one = forecast(written(tmp_path, t, v_mm2), "--threshold-mm2", "0.05")["rows"]
    other = forecast(written(tmp_path, 20.0 * t, 8.0 * v_mm2), "--threshold-mm2", "0.4")["rows"]
    for a, b in zip(one, other, strict=True):
        assert a["status"] == b["status"]
        if a["tt_s"] is not None:
            assert b["tt_s"] == pytest.approx(20.0 * a["tt_s"], rel=1e-6)


def test_what_stands_still_is_said(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    v_mm2 = np.minimum(0.004 * np.exp(0.05 * np.arange(160)), 0.02) * np.exp(0.03 * rng.standard_normal(160))
    rows = forecast(written(tmp_path, 300.0 * np.arange(160), v_mm2), "--threshold-mm2", "0.05")["rows"]
    assert {row["status"] for row in rows[95:]} == {"no_growth"}
    assert all(row["p_no_growth"] >= 0.5 and row["tt_s"] is None for row in rows[95:])
    assert all(row["status"] != "no_growth" for row in rows[:30])


def test_volumes_below_zero_are_refused(tmp_path: Path) -> None:
    path = written(tmp_path, 60.0 * np.arange(3), np.array([0.01, -0.01, 0.02]))
    with pytest.raises(InputError, match=r"v\.csv.*row 2: v_eq must be a volume"):
        forecast(path)


def test_growing_lives_that_it_never_saw_are_covered() -> None:
    settings, inside = LibrarySettings(features="v_eq"), []
    for number in range(10**6, 10**6 + effort_count(quick=8, full=300)):
        life = grow_life(GROWTH, number)
        crossing, state = life.crossing(GROWTH.threshold), LibraryState()
        if not math.isfinite(crossing):
            continue
        asked = np.searchsorted(life.t, np.array([0.25, 0.5, 0.75]) * crossing, side="right") - 1
        for k in range(int(asked[-1]) + 1):
            block = DamageInput(float(life.t[k]), v_eq=float(life.tracked[k]))
            state, _, (one,) = step(state, block, shipped_library(), settings, thresholds=(GROWTH.threshold,))
            if k in asked and one.status == "ok":
                inside.append(one.tt_lower <= crossing - life.t[k] <= one.tt_upper)
    assert effort_count(quick=60, full=75) <= 100 * np.mean(inside) <= effort_count(quick=100, full=90)
