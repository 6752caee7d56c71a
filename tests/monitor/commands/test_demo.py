"""``spallwatch demo``: its configuration by model, its libraries, and what is refused.

The pipeline itself: test_rig_line.
"""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from models.lives.life import simulate_life
from models.maps.build import build_map
from models.maps.data import RmsMap
from models.maps.plan import MapPlan
from models.solve.registry import IGNORES_DEPTH, RIGS
from models.solve.rotor.rig import RotorRig
from monitor.commands import demo_prior
from monitor.commands.common import InputError
from monitor.commands.demo import LIVES, MODELS, SHIPPED, _prior_note, command, demo_config, demo_population
from monitor.commands.demo_prior import QUADRATIC, build_quadratic, forecast_quadratic, quadratic_library
from monitor.commands.shared_folders import sole_writer
from monitor.health.size.library.model import Library, arrays_of, header_of, levels_of
from monitor.records.library_file import load_library
from monitor.records.store import Store
from monitor.service.libraries import build_library, prior_words, shipped_library
from monitor.service.replay import replay
from tests.support.commands import run_command
from tests.support.effort import effort_count


def test_the_bench_is_that_of_the_thesis() -> None:
    config = demo_config()
    assert config.bearing[0].designation == "1205 ETN9"
    assert config.forecast.method == "library"
    assert config.detect.end_of_life_peak_g == 20.0


def test_another_model_has_a_bearing_that_it_takes_and_no_library() -> None:
    config = demo_config("filter", "rotor")
    assert config.bearing[0].designation == "6205"
    assert (config.track.method, config.forecast.method) == ("filter", "thesis")
    rig = config.parameters_of(RotorRig, config.bearing[0].to_entry())
    assert rig.calibrated == "declared"
    assert set(MODELS) == set(RIGS) - set(IGNORES_DEPTH) - {"angular", "gear_pair"}


@pytest.mark.parametrize("options", [("--model", "rotor", "--method", "library"), ("--model", "ring_impact")])
def test_what_there_is_not_is_refused(options: tuple[str, ...], tmp_path: Path) -> None:
    arguments = [*options, "--out", str(tmp_path / "out")]
    if "library" in options:
        with pytest.raises(InputError, match=r"the demo has a library of six_dof only.* library build --model rotor"):
            CliRunner().invoke(command, arguments, catch_exceptions=False)
    else:
        result = CliRunner().invoke(command, arguments)
        assert result.exit_code == 2
        assert "'ring_impact' is not one of" in result.output
    assert not (tmp_path / "out").exists()


def test_the_state_of_another_machine_is_not_taken_for_an_earlier_demo(tmp_path: Path) -> None:
    with Store.open(tmp_path / "state.db", machine="press-7"):
        pass
    found = CliRunner().invoke(command, ["--out", str(tmp_path)])
    assert "holds the state of machine 'press-7'; give another folder" in str(found.exception)
    (tmp_path / "state.db").write_bytes(b"no store")
    assert "give another folder" in str(CliRunner().invoke(command, ["--out", str(tmp_path)]).exception)
    assert (tmp_path / "state.db").read_bytes() == b"no store"


def test_v_eq_as_tracked_is_forecast_once_more_by_block(monkeypatch: pytest.MonkeyPatch) -> None:
    assert QUADRATIC.laws == (("quadratic", 1.0),)
    # Another library, since a fit takes seconds: it is about which answer belongs to which block.
    monkeypatch.setattr(demo_prior, "quadratic_library", shipped_library)
    history = [(number + 7, 300.0 * number, 0.002e-6 + 5e-12 * number**2) for number in range(60)]
    whole, half = forecast_quadratic(history), forecast_quadratic(history[:30])
    assert list(whole) == [block for block, _, _ in history]
    assert all(repr(whole[block]) == repr(half[block]) for block in half)
    assert whole[60].status == "ok"


@pytest.mark.parametrize(
    ("tt", "known", "said"),
    [
        (3600.0, 7200.0, r"TT at half of the life would be 2 h.* issued is 60 min, true 1 h 30 min"),
        (None, 7200.0, "issued is none"),
        (3600.0, None, "grows by a quadratic.$"),
    ],
)
def test_the_report_says_what_the_prior_costs(tt: float | None, known: float | None, said: str) -> None:
    row = {"share_of_life": 0.5, "tt_s": tt, "tt_quadratic_s": known, "tt_true_s": 5400.0}
    assert re.search(said, _prior_note([{**row, "share_of_life": 0.25}, row]))


def test_a_demo_does_not_delete_what_another_one_is_writing(tmp_path: Path) -> None:
    out = tmp_path / "demo"
    out.mkdir()
    (out / "report.html").touch()
    with sole_writer(out):
        ended = run_command("demo", "--out", out)
    assert ended.returncode == 2
    assert f"--out {out}: another process is writing it" in ended.stderr
    assert (out / "report.html").exists()
    assert {path.name for path in tmp_path.iterdir()} == {"demo"}


@pytest.mark.usefixtures("plain_layout", "blank_pictures")
def test_a_demo_replaces_all_that_an_earlier_one_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def coarse(plan: MapPlan, **_: object) -> RmsMap:
        return build_map(replace(plan, h_d=plan.h_d[::16], dphi_d=plan.dphi_d[::50]))

    monkeypatch.setattr("models.maps.file.cached_map", coarse)
    monkeypatch.setattr("monitor.service.replay.replay", partial(replay, limit=3))
    out = tmp_path / "demo"
    left: list[set[Path]] = []
    for number in (1, 2):
        result = CliRunner().invoke(command, ["--out", str(out), "--json", "--quiet"], catch_exceptions=False)
        assert (number, result.exit_code) == (number, 0)
        left.append({path.relative_to(out) for path in out.rglob("*")})
        # The second page is as the first, of which there is enough.
        monkeypatch.setattr("monitor.commands.demo.write_report", lambda _, page, *__: page.touch() or page)
        # As one that was killed leaves them.
        for name in ("state.db-journal", ".report.html.tmp", "records/.demo-undated.nc.tmp"):
            (out / name).touch()
    assert left[0] == left[1]
    assert {"state.db", "report.html", "days.lock", "records/demo-undated.nc"} <= set(map(str, left[0]))


def test_the_library_that_ships_is_of_the_lives_of_a_demo() -> None:
    """The lives whose levels are the least and the highest of all have them still."""
    config = demo_config()
    shipped, population = load_library(SHIPPED), demo_population(config)
    assert shipped.made_of["population"] == json.loads(population.as_json())
    assert (shipped.made_of["runs"], shipped.thresholds) == (LIVES, tuple(config.forecast.thresholds))
    assert shipped.prior == prior_words(population, LIVES)
    numbers = (25, 40, 91, 98, 137, 183, 187) if effort_count(quick=1, full=0) else range(LIVES)
    lives = [simulate_life(population, number) for number in numbers]
    for name, fit in shipped.fits.items():
        relative = [
            fit.relative_levels(levels_of(name, life.rms, life.harmonics, life.v_eq), life.load, life.speed)
            for life in lives
        ]
        assert np.concatenate(relative).min(axis=0) == pytest.approx(fit.lowest, abs=1e-6)
        assert np.concatenate(relative).max(axis=0) == pytest.approx(fit.highest, abs=1e-6)
        for number, life in zip(numbers, lives, strict=True):
            assert fit.lifetimes[number] == pytest.approx([life.crossing(v) - life.t[0] for v in shipped.thresholds])
            told = np.exp((fit.said + fit.error)[fit.life == number, 0])
            assert np.abs(told[:, None] / life.v_eq - 1.0).min(axis=1) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.skipif(effort_count(quick=0, full=1) == 0, reason="simulates for a minute")
def test_the_script_makes_the_library_again() -> None:
    config, shipped = demo_config(), load_library(SHIPPED)
    again = build_library(demo_population(config), runs=LIVES, thresholds=config.forecast.thresholds)
    assert_same(again, shipped)


def test_the_script_makes_the_library_of_quadratics_again() -> None:
    assert_same(build_quadratic(), quadratic_library())


def assert_same(again: Library, shipped: Library) -> None:
    """A fit on another machine agrees to rounding, not bit for bit."""
    assert header_of(again)["made_of"] == header_of(shipped)["made_of"]
    for name, fit in shipped.fits.items():
        kept, made = arrays_of(fit), arrays_of(again.fits[name])
        assert kept.keys() == made.keys()
        for key, values in kept.items():
            np.testing.assert_allclose(made[key], values, rtol=1e-6, atol=1e-6, err_msg=key)
