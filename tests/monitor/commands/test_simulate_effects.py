"""``spallwatch simulate`` with effects: keys, statuses, and what cannot be asked for."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from models.machine.bearing import from_catalogue, kinematics
from monitor.cli import main
from monitor.commands.simulate.command import command

pytestmark = pytest.mark.usefixtures("empty_directory")

PIT = ["--dphi-deg", "4", "--h-d-um", "500", "--duration-s", "0.3"]
KEYS = {
    "rms_g",
    "rms_se_g",
    "peak_g",
    "rms_resonator_g",
    "bpfo_hz",
    "bpfi_hz",
    "bsf_hz",
    "ftf_hz",
    "harmonics_g",
    "periods",
    "period_change",
    "spread_g",
    "model",
    "status",
    "rms_error",
    "peak_error",
    "waveform_error",
    "solver",
    "why",
    "left_out",
}


def simulate(*options: str) -> dict[str, Any]:
    result = CliRunner().invoke(command, [*options, "--json"], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    values: dict[str, Any] = json.loads(result.stdout)
    assert set(values) >= KEYS
    return values


@pytest.mark.parametrize(
    "options",
    [
        [*PIT, "--fault", "inner"],
        [*PIT, "--fault", "ball"],
        [*PIT, "--slip-deg", "0.5"],
        [*PIT, "--unbalance-kg-m", "1e-3", "--slip-deg", "0.5", "--duration-s", "0.3"],
        ["--waviness-um", "1", "--waviness-order", "7", "--waviness-race", "inner", "--duration-s", "0.3"],
    ],
)
def test_what_has_no_ball_period_has_a_spread(options: list[str]) -> None:
    values = simulate(*options)
    assert values["status"] == ("not_periodic" if values["error"] <= 1e-3 else "inaccurate")
    assert values["spread_g"] > 0.0
    assert 0.0 < values["rms_se_g"] < values["rms_g"] <= values["peak_g"]
    assert values["period_change"] is None
    lines = kinematics(from_catalogue("1205 ETN9"), 40.0)
    assert (values["bpfo_hz"], values["bpfi_hz"]) == pytest.approx((lines.bpfo, lines.bpfi))


def test_what_has_one_agrees_with_the_periodic_solver() -> None:
    periodic = simulate(*PIT)
    assert periodic["rms_se_g"] is None
    assert simulate(*PIT, "--first-row", "2")["rms_g"] == pytest.approx(periodic["rms_g"], rel=3e-3)
    assert simulate(*PIT, "--direction-deg", "360")["rms_g"] == pytest.approx(periodic["rms_g"], rel=3e-3)
    heavy = simulate(*PIT, "--gravity")
    assert heavy["status"] == "converged"
    assert heavy["rms_g"] == pytest.approx(periodic["rms_g"], rel=0.2)


def test_a_band_and_a_sensor_apply_over_time_too() -> None:
    options = [*PIT, "--fault", "inner"]
    full, band = simulate(*options), simulate(*options, "--rms-band-hz", "10:3000")
    assert band["rms_g"] < full["rms_g"]
    resonator = simulate(*options, "--sensor", "mr")
    assert resonator["rms_g"] == resonator["rms_resonator_g"] == full["rms_resonator_g"]


def test_the_waveform_is_the_signal() -> None:
    values = simulate(*PIT, "--fault", "ball", "--waveform", "signal.csv")
    rows = np.loadtxt("signal.csv", delimiter=",", skiprows=1)
    assert len(rows) == round(0.3 * 51200)
    assert np.sqrt(np.mean(rows[:, 1] ** 2)) == pytest.approx(values["rms_g"], rel=5e-2)


def test_the_cheapest_solver_is_taken_and_said_why() -> None:
    found = simulate(*PIT)
    assert (found["model"], found["solver"]) == ("six_dof", "periodic")
    assert "a defect of the outer race" in found["why"]
    assert 0.0 < found["peak_error"] < 1e-2
    named = simulate(*PIT, "--model", "six_dof")
    assert named["why"] is None
    assert named["rms_g"] == found["rms_g"]
    assert simulate(*PIT, "--slip-deg", "0.3", "--slip-rule", "mean_force")["solver"] == "mean_force"
    turning = simulate(*PIT, "--fault", "inner")
    assert turning["solver"] == "time_domain"
    assert 0.0 < turning["rms_error"] < 0.05


def test_an_effect_that_is_too_small_is_left_out_and_said() -> None:
    small = [*PIT, "--unbalance-kg-m", "1e-10", "--accuracy", "0.05"]
    found, plain = simulate(*small), simulate(*PIT, "--accuracy", "0.05")
    (left,) = found["left_out"]
    assert (found["solver"], found["status"], left["effect"]) == ("periodic", "converged", "unbalance")
    assert 0.0 < left["bound"] < found["error"] <= 0.05
    assert (plain["left_out"], plain["rms_g"]) == ([], pytest.approx(found["rms_g"], rel=0.05))
    assert "too small to matter: unbalance" in CliRunner().invoke(command, small, catch_exceptions=False).stdout


def test_several_defects_at_once() -> None:
    pit, both = simulate(*PIT), simulate(*PIT, "--more-defect", "inner:4:500", "--more-defect", "ball:16:500:30")
    assert both["solver"] == "time_domain"
    assert "several defects" in both["why"]
    assert both["rms_g"] > pit["rms_g"]
    apart = simulate(*PIT, "--more-defect", "outer:4:500:180")
    # Opposite to the load nothing touches it.
    assert apart["status"] in ("converged", "inaccurate")
    assert apart["rms_g"] == pytest.approx(pit["rms_g"], rel=3e-3)


def test_people_read_the_lines_of_the_part() -> None:
    result = CliRunner().invoke(command, [*PIT, "--fault", "inner"], catch_exceptions=False)
    assert "from period to period" in result.stdout
    assert "standard error" in result.stdout
    assert "BPFI 284.38 Hz" in result.stdout


def test_a_rough_floor_is_said_to_be_another_one_than_the_thesis_has() -> None:
    spall = ["--dphi-deg", "10", "--h-d-um", "20"]
    text = CliRunner().invoke(command, [*spall, "--floor", "rough"], catch_exceptions=False).stdout
    assert "standard deviation 1 µm after filtering" in text
    assert "R = 10 µm" in text
    assert "floor" not in CliRunner().invoke(command, spall, catch_exceptions=False).stdout
    assert "R = 10 µm" in " ".join(CliRunner().invoke(command, ["--help"]).stdout.split())


def test_the_formula_of_the_line_contact_changes_the_stiffness() -> None:
    rollers = ["--bearing", "NU205", "--load-newton", "2000"]
    levels = [simulate(*rollers, "--line-contact", name)["rms_g"] for name in ("palmgren", "houpert", "lundberg")]
    assert len(set(levels)) == 3
    assert levels[2] == pytest.approx(levels[0], rel=0.2)


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (["--line-contact", "houpert"], "1205 ETN9 has balls"),
        (["--fault", "inner", "--plot", "scene.pdf"], "--plot"),
        (["--fault", "ball", "--slip-deg", "1"], "slip"),
        (["--first-row", "3"], "first_row"),
        (["--fault", "inner", "--rms-band-hz", "10:30000"], "band"),
        (["--fault", "ball", "--dphi-deg", "200"], "dphi_d"),
        (["--more-defect", "axle:4:500"], "outer, inner or ball"),
        (["--more-defect", "inner:4"], "such as inner:4:500:90"),
        (["--more-defect", "outer:4:500:3"], "more_defects[0].position"),
        (["--more-defect", "inner:4:500", "--h-d-um", "0"], "--more-defect needs a first defect"),
        (["--more-defect", "inner:nan:500"], "dphi_d"),
        (["--slip-deg", "1", "--slip-rule", "mean_force", "--unbalance-kg-m", "1e-3"], "unbalance"),
        (["--model", "none"], "--model"),
        (["--fault", "inner", "--speed-hz", "0.01"], "duration"),
    ],
)
def test_what_cannot_be_is_refused_in_words(
    options: list[str], word: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["spallwatch", "simulate", *PIT, *options])
    with pytest.raises(SystemExit) as caught:
        main()
    assert caught.value.code == 2
    assert word in capsys.readouterr().err
