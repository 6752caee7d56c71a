"""``spallwatch gear`` with the train of the model: forces, loss of contact, files, refusals."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from monitor.commands.common import InputError
from monitor.gears import simulate as simulate_gears
from monitor.gears.forces import GearRun, amplitudes, build_train, force_lines, force_values, run_train
from monitor.gears.picture import draw_gears, gear_picture, shaft_centres
from tests.support.commands import run_command
from tests.support.config_gear_train import APPENDIX, changed
from tests.support.gear_forces import RATE, VARIED, given, run_of, toml


@pytest.fixture(scope="module")
def varied() -> dict[str, Any]:
    return force_values(run_of(VARIED))


def test_mean_forces_are_those_of_statics(varied: dict[str, Any]) -> None:
    # W = T / r_b along the line of action at 70 degrees; the idler carries both of its meshes, which cancel along x.
    force = varied["torque_newton_m"] / (0.074 * math.cos(math.radians(20.0)))
    assert [mesh["force_newton"] for mesh in varied["meshes"]] == pytest.approx([force, force], rel=1e-3)
    angle = math.radians(70.0)
    means = {support["name"]: support["mean_newton"] for support in varied["supports"]}
    along, across = force * math.cos(angle), force * math.sin(angle)
    assert means["b0"] == pytest.approx([-along, -across], rel=2e-3)
    assert means["b1"] == pytest.approx([0.0, 2.0 * across], rel=2e-3, abs=1e-3 * force)
    assert means["b2"] == pytest.approx([along, -across], rel=2e-3)


def test_the_appendix_has_nine_modes_and_settles(varied: dict[str, Any]) -> None:
    assert len(varied["natural_frequencies_hz"]) == 9
    assert varied["natural_frequencies_hz"][0] == 0.0
    assert varied["damping_ratios"][0] is None
    assert varied["status"] == "settled"
    assert varied["energy_residual"] < 1e-3
    assert [mesh["out_of_contact"] for mesh in varied["meshes"]] == [0.0, 0.0]
    assert varied["meshes"][0]["stiffness_variation"] == pytest.approx(0.3)
    lines = varied["supports"][0]["lines"]
    assert [line["hz"] for line in lines] == pytest.approx([312.28 * n for n in range(1, 7)])
    assert all(max(line["amplitude_newton"]) > 1.0 for line in lines)


def test_without_torque_enough_the_teeth_part() -> None:
    tables = {key: value for key, value in VARIED.items() if key != "power_kw"}
    tables["pair"] = [
        {**pair, "stiffness_variation": 0.9, "backlash_um": 60.0, "beta_c_s": 1e-6} for pair in tables["pair"]
    ]
    tables["beta_c_s"] = 1e-5
    values = force_values(run_of({**tables, "torque_newton_m": 10.0}, speed=20.0))
    assert max(mesh["out_of_contact"] for mesh in values["meshes"]) > 0.01
    assert any("out of contact" in line for line in force_lines(values))


def test_a_motion_that_has_not_settled_is_no_settled_one(monkeypatch: pytest.MonkeyPatch) -> None:
    from models.gears.train import motion as gear_train

    undamped = {**VARIED, "beta_c_s": 2e-7, "alpha_c_per_s": 0.0}
    undamped["pair"] = [{**pair, "beta_c_s": 2e-7} for pair in undamped["pair"]]
    monkeypatch.setattr(gear_train, "settling", lambda train: 0.0)
    run = run_of(undamped)
    assert run.status == "not_settled"
    assert any("not settled" in line for line in force_lines(force_values(run)))


def test_the_rate_follows_a_fast_mesh() -> None:
    builder = build_train(given(VARIED), 80.0)
    assert run_train(builder, 0.02).motion.rate == 102400.0


@pytest.mark.parametrize("phase", [0.0, 1.1])
def test_amplitudes_are_peaks_whatever_the_mean(phase: float) -> None:
    time = np.arange(5000) / RATE
    signal = 7.0 + 3.0 * np.cos(2.0 * math.pi * 312.28 * time + phase)
    found = amplitudes(signal[:, None], RATE, np.array([312.28, 624.56]))[:, 0]
    assert abs(found[0] - 3.0 * np.exp(1j * phase)) < 2e-3
    assert abs(found[1]) < 2e-3


def test_the_command_prints_and_writes(tmp_path: Path) -> None:
    (tmp_path / "gear.toml").write_text(toml(VARIED))
    arguments = ("--config", "gear.toml", "--duration-s", 0.1, "--rate-hz", RATE, "--csv", "f.csv")
    done = run_command("gear", *arguments, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "drive: 942.86 N m, 50 kW" in done.stdout
    assert "bearing b1: force" in done.stdout
    rows = np.genfromtxt(tmp_path / "f.csv", delimiter=",", skip_header=1)
    head = (tmp_path / "f.csv").read_text().splitlines()[0]
    assert head == "time_s,b0_x_newton,b0_y_newton,b1_x_newton,b1_y_newton,b2_x_newton,b2_y_newton," + (
        "mesh_1-3_newton,mesh_3-5_newton"
    )
    assert rows.shape == (round(RATE / 8.44), 9)


def test_the_train_is_drawn(tmp_path: Path) -> None:
    run = run_of({**VARIED, "pair": [VARIED["pair"][0], {**VARIED["pair"][1], "direction_deg": 90.0}]})
    values: dict[str, Any] = {"train": force_values(run), "casing": None, "sound": None}
    centres = shaft_centres(run)
    assert list(centres.values()) == pytest.approx([0.0, 0.148, 0.148 + 0.148j])
    picture = gear_picture(run, values, "box")
    assert picture.forces[0].force == pytest.approx(values["train"]["supports"][0]["mean_newton"])
    assert picture.wheels[2].radius == pytest.approx(0.074)
    assert set(picture.shown) == {"driver", "intermediate", "driven"}
    draw_gears(run, values, "box", tmp_path / "g.html")
    page = (tmp_path / "g.html").read_text()
    assert "box: gear train at 942.9 N m, 50 kW" in page
    assert page.count("<svg") == 4


@pytest.mark.parametrize(
    ("tables", "options", "said"),
    [
        (changed("shaft", 1, mass_kg=None), [], ["gear.toml:11: gear.shaft[1].mass_kg: is missing"]),
        ({**APPENDIX, "load": "driver"}, [], ["gear.load: expected another shaft"]),
        (APPENDIX, ["--csv", "f.txt"], ["--csv f.txt", ".csv"]),
        (APPENDIX, ["--csv", "no/f.csv"], ["--csv no/f.csv", "cannot be written"]),
        (APPENDIX, ["--rate-hz", "1000", "--speed-hz", "20"], ["--rate-hz 1000", "20 times", "14800 Hz"]),
        (changed("pair", 0, stiffness_csv="k.csv"), [], ["k.csv", "cannot be read"]),
    ],
)
def test_what_the_model_lacks_is_named(
    tables: dict[str, Any], options: list[str], said: list[str], tmp_path: Path
) -> None:
    (tmp_path / "gear.toml").write_text(toml(tables))
    done = run_command("gear", "--config", "gear.toml", "--duration-s", "0.01", *options, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    for words in said:
        assert words in done.stderr


def test_forces_need_a_train_and_a_speed(tmp_path: Path) -> None:
    done = run_command("gear", "23/71", "--csv", "f.csv", cwd=tmp_path)
    assert (done.returncode, "23/71: --csv needs the train itself" in done.stderr) == (2, True)
    with pytest.raises(InputError, match=r"machine.toml: forces need a speed"):
        build_train(given(APPENDIX), None)


def test_a_train_that_grows_without_limit_has_no_levels(varied: dict[str, Any]) -> None:
    run = run_of(VARIED)
    object.__setattr__(run.motion, "finite", False)
    values = force_values(GearRun(run.builder, run.train, run.motion))
    assert (values["status"], values["supports"], values["energy_residual"]) == ("not_finite", [], None)
    assert any("more damping is needed" in line for line in force_lines(values))


@pytest.mark.parametrize(
    ("status", "accuracy", "said"),
    [
        ("settled", 1.0, "converged"),
        ("settled", -1.0, "inaccurate"),
        ("not_settled", 1.0, "not_periodic"),
        ("not_finite", 1.0, "not_converged"),
    ],
)
def test_a_train_has_converged_if_it_settled_and_its_steps_are_fine(
    monkeypatch: pytest.MonkeyPatch, status: str, accuracy: float, said: str
) -> None:
    run = run_of(VARIED)
    run = GearRun(run.builder, run.train, replace(run.motion, finite=status != "not_finite"))
    monkeypatch.setattr(GearRun, "status", status)
    monkeypatch.setattr(simulate_gears, "_ACCURACY", accuracy)
    values = simulate_gears.levels_of(run)
    assert values["status"] == said
    assert (values["rms_g"] is None) == (status == "not_finite")
    assert said in simulate_gears.level_line(values)


def test_simulate_takes_the_train_of_the_configuration(tmp_path: Path) -> None:
    (tmp_path / "gear.toml").write_text(toml(VARIED))
    arguments = ("simulate", "--model", "gear_train", "--config", "gear.toml", "--duration-s", 0.1)
    done = run_command(*arguments, "--waveform", "f.csv", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    values = json.loads(done.stdout)
    assert (values["model"], values["status"]) == ("gear_train", "converged")
    assert values["rms_error"] < 1e-3
    assert 0.0 < values["rms_g"] < values["peak_g"]
    assert (tmp_path / "f.csv").read_text().startswith("time_s,b0_x_newton")
    refused = run_command(*arguments, "--dphi-deg", 5, cwd=tmp_path)
    assert (refused.returncode, "--dphi-deg is about a bearing" in refused.stderr) == (2, True)
    (tmp_path / "gear.toml").write_text(toml({key: VARIED[key] for key in ("wheel", "pair")}))
    lacking = run_command(*arguments, cwd=tmp_path)
    assert (lacking.returncode, "needs [[gear.shaft]]" in lacking.stderr) == (2, True)
