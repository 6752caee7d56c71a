"""``spallwatch library build`` from end to end, small."""

from __future__ import annotations

import functools
import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from models.lives.life import LifeHistory, simulate_life
from models.lives.population import Population
from models.solve.rotor.rig import RotorRig
from monitor.cli import spallwatch
from monitor.commands.common import InputError
from monitor.commands.library import _laws
from monitor.config.load import load_config
from monitor.health.size import DamageInput, EdvStatus
from monitor.health.size.library.fit import FitSettings
from monitor.health.size.library.forecaster import LibraryState, step
from monitor.records.histories import History
from monitor.records.library_file import load_library
from monitor.service.libraries import build_library, prior_words
from monitor.service.setup import source_settings
from monitor.service.summary import is_calibrated, rig_of_library
from tests.support.effort import effort_count


@pytest.fixture(autouse=True)
def quick_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fit fewer random features in quick effort: twenty lives of a few blocks do not fill the default number."""
    settings = functools.partial(FitSettings, columns=effort_count(quick=60, full=FitSettings.columns))
    monkeypatch.setattr("monitor.service.libraries.FitSettings", settings)


def build(*arguments: str) -> dict[str, Any]:
    run = CliRunner().invoke(spallwatch, ["library", "build", "--json", *arguments], catch_exceptions=False)
    return json.loads(run.stdout)


@pytest.mark.process
def test_a_small_library_is_built_said_and_usable(tmp_path: Path) -> None:
    out = tmp_path / "lives.npz"
    runs = effort_count(quick=20, full=24)
    interval = effort_count(quick=900, full=300)
    options = ("--runs", str(runs), "--seed", "5", "--duration-min", "60:120", "--interval-s", str(interval))
    options += ("--threshold-mm2", "0.05", "--workers")
    found = build(*options, "1", "--out", str(out))
    assert {"runs", "seconds", "out", "hash", "coverage", "crps_s"} <= set(found)
    library = load_library(out)
    assert library.hash == found["hash"]
    assert library.load == pytest.approx((3600.0, 4400.0), rel=0.1)
    assert library.made_of["population"]["seed"] == 5
    assert f"{runs} simulated lives" in library.prior
    block = DamageInput(0.0, 5.0, (1.0, 1.0, 1.0), 4000.0, 40.0)
    _, damage, _ = step(LibraryState(), block, library, thresholds=[5e-8])
    assert damage.status != EdvStatus.NO_LIBRARY
    # Other workers, and a table for people.
    again = ["library", "build", *options, "2", "--out", str(tmp_path / "again.npz")]
    table = CliRunner().invoke(spallwatch, again, catch_exceptions=False).stdout
    assert "rms+harmonics" in table
    assert "climatology" in table
    assert f"hash {library.hash[:16]}; prior: {runs} simulated lives" in table
    assert found["calibrated"] is False
    assert "rig not calibrated: masses and springs are those of the default test bench" in table


MACHINE = """
[[bearing]]
name = "b"
designation = "6205"
[operating]
speed_hz = 40.0
load_newton = 4000.0
[shaft]
disc_mass_kg = 6.0
calibrated = "declared"
[[source]]
name = "s"
[[channel]]
name = "x"
source = "s"
unit = "g"
bearing = "b"
track = true
rms_band_hz = [0, 9500]
"""


@pytest.mark.process
def test_a_library_of_lives_by_another_model(tmp_path: Path) -> None:
    config, out = tmp_path / "m.toml", tmp_path / "lives.npz"
    config.write_text(MACHINE)
    interval = effort_count(quick=5400, full=2700)
    options = ("--runs", "20", "--duration-min", "150:200", "--interval-s", str(interval), "--config", str(config))
    found = build(*options, "--model", "rotor", "--out", str(out))
    assert (found["model"], found["calibrated"]) == ("rotor", "declared")
    library = load_library(out)
    rig = rig_of_library(library)
    assert isinstance(rig, RotorRig)
    assert rig.m == 6.0
    assert is_calibrated(library)
    assert "by the model rotor" in library.prior
    loaded = load_config(config)
    channel = source_settings(loaded, loaded.source[0], libraries={"x": library}).channels["x"]
    assert channel.damage is not None
    assert channel.damage.library is library
    assert channel.calibration == "declared"
    with pytest.raises(InputError, match="V_eq cannot be told by the model ring_impact"):
        build("--config", str(config), "--model", "ring_impact", "--out", str(out))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--out", "lives.nc"), r"--out lives\.nc: expected a name that ends in \.npz"),
        (("--out", "no/../lives.npz", "--config", "absent.toml"), r"absent\.toml"),
        (("--out", "lives.npz", "--bearing", "nobody"), "nobody"),
    ],
)
def test_wrong_options_are_named(
    arguments: tuple[str, ...], message: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(Exception, match=message):
        CliRunner().invoke(spallwatch, ["library", "build", "--runs", "20", *arguments], catch_exceptions=False)


def test_ranges_are_checked() -> None:
    for wrong in ("5:1", "0:3", "a", "1:2:3"):
        run = CliRunner().invoke(spallwatch, ["library", "build", "--speed-hz", wrong, "--out", "x.npz"])
        assert run.exit_code == 2
        assert wrong in run.output


def test_lives_must_go_on_until_the_largest_threshold() -> None:
    with pytest.raises(ValueError, match=r"thresholds up to 0\.1 mm2 need lives that go on until there"):
        build_library(Population(), runs=20, thresholds=[1e-7])


def test_the_prior_is_said_in_words() -> None:
    words = prior_words(Population(load=(3000.0, 5000.0)), 250)
    assert "250 simulated lives" in words
    assert "4 to 20 um deep and 6 to 31 deg wide" in words
    assert "3000 to 5000 N" in words
    assert "monotone 41%" in words


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ("cubic=1", "unknown law 'cubic'; expected one of quadratic, exponential"),
        ("power", "expected NAME=WEIGHT with a weight above 0, got ''"),
        ("power=0", "expected NAME=WEIGHT with a weight above 0, got '0'"),
        ("power=much", "got 'much'"),
    ],
)
def test_a_wrong_weight_of_a_law_is_refused_by_name(given: str, why: str) -> None:
    with pytest.raises(InputError, match=why):
        _laws(["quadratic=1", given])
    assert _laws(["quadratic=2", "monotone=0.5"]) == (("quadratic", 2.0), ("monotone", 0.5))


DURATION_S = 100.0 * effort_count(quick=30, full=60)
DURATIONS_MIN = "60:120" if effort_count(quick=0, full=1) else "30:60"


def as_recorded(life: LifeHistory) -> History:
    """A life as published records would have it, from the onset to where V_eq reaches 0.05 mm2."""
    known = life.t <= life.crossing(5e-8)
    t, rms, harmonics, load, speed, v_eq = (
        part[known] for part in (life.t, life.rms, life.harmonics, life.load, life.speed, life.v_eq)
    )
    return History("a", t, t, rms, harmonics, load, speed, v_eq)


def test_recorded_runs_calibrate_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    population = Population(
        load=(4000.0, 4000.0),
        speed=(40.0, 40.0),
        durations=(DURATION_S, DURATION_S),
        laws=(("power", 1.0), ("exponential", 1.0)),
        seed=9,
    )
    lives = {f"run{number}.nc": simulate_life(population, number) for number in range(3)}
    monkeypatch.setattr("monitor.records.histories.read_history", lambda path, channel: as_recorded(lives[path.name]))
    interval = effort_count(quick=600, full=300)
    options = ("--runs", "20", "--duration-min", DURATIONS_MIN, "--interval-s", str(interval))
    options += ("--out", str(tmp_path / "lives.npz"))
    records = [option for name in lives for option in ("--calibrate", name)]
    found = build(*options, *records)
    assert found["prior"].endswith("calibrated on 3 recorded runs")
    assert set(found["calibration"]) == {"rms 0.05", "rms+harmonics 0.05"}
    assert found["calibration"]["rms 0.05"]["runs"] == 3
    assert load_library(tmp_path / "lives.npz").hash == found["hash"]


def test_records_that_cannot_calibrate_are_named(tmp_path: Path) -> None:
    options = ["library", "build", "--runs", "20", "--out", str(tmp_path / "lives.npz"), "--calibrate", "absent.nc"]
    with pytest.raises(InputError, match=r"--calibrate absent\.nc"):
        CliRunner().invoke(spallwatch, options, catch_exceptions=False)
    several = [*options, "--threshold-mm2", "0.03", "--threshold-mm2", "0.05"]
    with pytest.raises(InputError, match="give one --threshold-mm2"):
        CliRunner().invoke(spallwatch, several, catch_exceptions=False)


def test_an_unwritable_place_is_named(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    options = ["library", "build", "--runs", "20", "--duration-min", "60", "--out", str(blocked / "lives.npz")]
    with pytest.raises(InputError, match="cannot be written"):
        CliRunner().invoke(spallwatch, options, catch_exceptions=False)
