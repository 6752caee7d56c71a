"""``spallwatch identify`` from end to end, and its inputs, good and bad."""

from __future__ import annotations

import json
import math
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from models.identify import posterior as sampling
from models.machine.bearing import from_catalogue, kinematics
from models.machine.rig import read_posterior
from monitor.cli import spallwatch
from monitor.commands.common import InputError
from monitor.commands.option import spread_names
from monitor.config.bearing import RigSection
from monitor.config.load import Config, ConfigError, load_config, validate
from monitor.identify import command as identify
from monitor.identify.trial_files import Measuring, read_trials, tracked_channel
from streams.types.block import STANDARD_GRAVITY
from tests.models.identify.cases import CONDITIONS, TRUTH, simulated_trials
from tests.support.commands import run_command
from tests.support.commands_identify import MACHINE, RATE


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """A CSV of simulated tests with 1 % of noise."""
    path = tmp_path / "tests.csv"
    rows = ["load_newton,speed_hz,defect_deg,h_d_um,fault,rms_g,a_star_g"]
    for condition, (rms, a_star) in zip(CONDITIONS, simulated_trials(0.01).mean.tolist(), strict=True):
        cells = (condition.load, condition.speed, math.degrees(condition.dphi_d), 500, "outer")
        rows.append(",".join(map(str, (*cells, rms / STANDARD_GRAVITY, a_star / STANDARD_GRAVITY))))
    path.write_text("\n".join(rows) + "\n")
    return path


def test_names_may_follow_an_option_in_succession() -> None:
    names = {"--free": ("m_r", "k_r"), "--objectives": ("rms",)}
    given = ["--free", "m_r", "k_r", "tests.csv", "k_r", "--objectives", "rms", "--json", "--free", "m_r,k_r"]
    expected = [
        "--free",
        "m_r",
        "--free",
        "k_r",
        "tests.csv",
        "k_r",
        "--objectives",
        "rms",
        "--json",
        "--free",
        "m_r,k_r",
    ]
    assert list(spread_names(given, names)) == expected


def test_tests_become_a_rig(table: Path, machine: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "rig.toml"
    write, locked = identify._write, list[bool]()

    def noted(path: Path, text: str) -> None:
        locked.append((tmp_path / ".rig.toml.lock").exists())
        write(path, text)

    monkeypatch.setattr(identify, "_write", noted)
    page = tmp_path / "rig.html"
    options = ("--config", machine, "--free", "m_r_kg", "--seed", 4, "--workers", 1, "--out", out)
    run = run_command("identify", table, *options, "--report", page, "--json")
    assert run.returncode == 0, run.stderr
    found = json.loads(run.stdout)
    assert {"front", "best", "intervals", "undetermined", "evaluations", "seconds"} <= set(found)
    assert found["best"]["m_r_kg"] == pytest.approx(TRUTH.m_r, rel=0.01)
    # Other commands with this OUT are refused until it is written.
    assert locked == [True, True]
    low, high = found["intervals"]["m_r_kg"]
    assert low < TRUTH.m_r < high
    assert found["undetermined"] == []
    assert found["rms_band_hz"] == [0.0, 9500.0]
    assert found["front"][0]["parameters"].keys() == {"m_r_kg"}
    assert found["front"][0]["objectives"].keys() == {"rms", "a_star"}
    text = out.read_text()
    rig = tomllib.loads(text)["rig"]
    assert rig["calibrated"] is True
    assert rig["identification"].partition("-")[0] == found["identification"]
    assert len(found["identification"]) == 64
    assert found["report"] == str(page)
    words = page.read_text()
    assert "The free parameter is determined" in words
    assert found["identification"] in words
    assert "rig.toml" in words
    assert found["calibrated"] is True
    assert rig["m_r_kg"] == pytest.approx(found["best"]["m_r_kg"], rel=1e-9)
    assert f"# 95 % interval {low:.4g} to {high:.4g}" in text
    # The rest of the table is the configured rig, and a configuration takes it.
    config = validate({**tomllib.loads(MACHINE), "rig": rig}, out)
    assert config.rig.k_r_newton_per_m == TRUTH.k_r
    rig_of_model = config.rig_of(config.entry_of(config.channel[0]))
    assert (rig_of_model.calibrated, rig_of_model.identification) == (True, found["identification"])
    with pytest.raises(ConfigError, match="the numbers are not those of identification"):
        validate({**tomllib.loads(MACHINE), "rig": {**rig, "m_r_kg": rig["m_r_kg"] * 1.001}}, out)
    # The machine gives no [rig]: what is not free is said to be of the default bench.
    (assumed, stiffness) = found["warnings"]
    assert assumed.startswith("m_i_kg, m_o_kg, m_b_kg, k_i_newton_per_m, k_r_newton_per_m, k_c_newton_per_m15, c_i")
    assert "not given in [rig], so that the default test bench's are taken" in assumed
    assert stiffness == "k_c_newton_per_m15 is 5.77e+09 by the geometry of the bearing"
    assert f"# Warning: {assumed}." in text
    # Its draws stand beside it, bound to it by the hash.
    assert rig["posterior"] == "rig.posterior.csv"
    draws = read_posterior(tmp_path / "rig.posterior.csv")
    assert draws.identification == found["identification"]
    assert found["posterior"]["out"] == str(tmp_path / "rig.posterior.csv")
    assert found["posterior"]["draws"] == len(draws.rows) == 256
    assert found["posterior"]["effective"] > 0.5 * sampling.ENOUGH
    assert low < np.median(draws.rows) < high
    posterior = config.posterior_of(config.entry_of(config.channel[0]))
    assert posterior is not None
    assert posterior.rows == draws.rows
    assert not (tmp_path / "rig.toml.state").exists()
    # For people, and resumed where nothing is kept.
    words = run_command("identify", table, *options, "--resume", "--quiet").stdout
    assert "m_r_kg" in words
    assert "posterior: 256 draws" in words
    assert f"identification {found['identification'][:16]}" in words


def test_a_model_that_misses_the_tests_is_no_calibration(table: Path, machine: Path, tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.csv"
    header, *rows = table.read_text().split()
    # RMS in mg, not in g.
    cells = [row.split(",") for row in rows]
    wrong.write_text("\n".join([header, *(",".join([*c[:5], str(1e3 * float(c[5])), c[6]]) for c in cells)]))
    out = tmp_path / "new" / "rig.toml"
    whole = tmp_path / "whole.toml"
    numbers = "\n".join(f"{key} = {value!r}" for key, value in RigSection().numbers.items())
    whole.write_text(f"{machine.read_text()}\n[rig]\n{numbers}\n")
    run = run_command("identify", wrong, "--config", whole, "--free", "m_r", "--workers", 1, "--out", out, "--json")
    assert run.returncode == 0, run.stderr
    found = json.loads(run.stdout)
    assert found["calibrated"] is False
    warning = found["warnings"][0]
    assert "so that this is no calibration; compare units, speed_hz, sizes of the defects" in warning
    rig = tomllib.loads(out.read_text())["rig"]
    assert rig["calibrated"] is False
    assert "identification" not in rig
    assert validate({**tomllib.loads(MACHINE), "rig": rig}, out).rig.claim is False


def test_an_interrupted_run_says_how_it_goes_on(
    table: Path, machine: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(*_: object, state: Path, **__: object) -> None:
        state.write_bytes(b"candidates")
        raise KeyboardInterrupt

    monkeypatch.setattr("monitor.identify.command.identify", stopped)
    run = run_command("identify", table, "--config", machine, "--out", tmp_path / "rig.toml")
    assert run.returncode == 1
    assert f"the candidates so far are in {tmp_path / 'rig.toml.state'}; the same command with --resume" in run.stderr


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (("identify", "tests.csv"), "rig.toml"),
        (("map", "build", "--load-newton", "2000", "--speed-hz", "40"), "map.nc"),
        (("library", "build"), "library.npz"),
    ],
)
def test_a_place_that_takes_no_file_is_refused_before_anything_is_computed(
    words: tuple[str, ...], name: str, table: Path, machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = machine.parent / "file" / name
    out.parent.write_text("in the way")
    monkeypatch.setattr("monitor.identify.command.identify", None)
    monkeypatch.setattr("monitor.commands.maps.build_refined_map", None)
    monkeypatch.setattr("monitor.commands.library.build_library", None)
    run = run_command(*words, "--config", machine, "--out", out, cwd=table.parent)
    assert run.returncode == 2
    assert f"--out {out}: cannot be written: " in run.stderr


@pytest.fixture
def measuring(machine: Path) -> Measuring:
    config = load_config(machine)
    channel = tracked_channel(config, None)
    return Measuring(config, channel, config.bearing_of(channel), channel.rms_band_hz)


def test_widths_are_divided_by_the_race_radius(tmp_path: Path, measuring: Measuring) -> None:
    path = tmp_path / "a.csv"
    rows = ["load_newton,speed_hz,defect_mm,fault,rms_g,a_star_g,repetition"]
    rows += ["1000,40,0.928,,0.5,0.2,1", "1000,40,0.928,inner,0.5,0.2,1", "1000,40,0.928,ball,0.5,0.2,1"]
    path.write_text("\n".join(rows))
    outer, inner, ball = read_trials(path, measuring).trials
    assert outer.condition.dphi_d == pytest.approx(0.928 / 22.91)
    assert inner.condition.dphi_d == pytest.approx(0.928 / 16.64)
    assert ball.condition.dphi_d == pytest.approx(0.928 / 3.56)
    assert outer.rms == pytest.approx(0.5 * STANDARD_GRAVITY)
    # Deeper than a ball reaches.
    assert outer.condition.h_d == pytest.approx(7.12e-3)
    path.write_text("\n".join(rows[:2]))
    assert read_trials(path, measuring).race_radius == pytest.approx(22.91e-3)
    # Where it is not known it is that of V_eq: pitch radius and that of an element.
    unknown = replace(measuring, bearing=from_catalogue("6205"))
    assert read_trials(path, unknown).race_radius == pytest.approx(0.5 * (39.04e-3 + 7.94e-3), rel=1e-3)


def recording(fundamental: float, amplitudes: tuple[float, ...], noise: float, seed: int = 0) -> np.ndarray:
    """Return 4 s of lines and white noise, g."""
    t = np.arange(4 * int(RATE)) / RATE
    lines = sum(a * np.sin(2.0 * np.pi * k * fundamental * t + k) for k, a in enumerate(amplitudes, 1))
    return lines + noise * np.random.default_rng(seed).standard_normal(t.size)


def write_recordings(folder: Path, noise: float) -> Path:
    line = kinematics(from_catalogue("1205 ETN9"), 40.0).bpfo
    np.save(folder / "one.npy", recording(0.995 * line, (0.3, 0.0, 0.4, 0.0, 0.0, 0.7), noise).astype(np.float32))
    path = folder / "tests.csv"
    path.write_text("recording,load_newton,speed_hz,defect_deg\none.npy,1000,40,2.362\n")
    return path


def test_features_of_recordings_are_those_of_their_lines(tmp_path: Path, measuring: Measuring) -> None:
    path = write_recordings(tmp_path, noise=1e-4)
    found = read_trials(path, measuring)
    assert found.recordings == 1
    (trial,) = found.trials
    # The sixth line is in the RMS, not in A* (Eq. 57).
    assert trial.a_star / STANDARD_GRAVITY == pytest.approx(0.5, rel=0.01)
    assert trial.rms / STANDARD_GRAVITY == pytest.approx(math.sqrt(0.5 * (0.09 + 0.16 + 0.49)), rel=1e-3)


def test_a_star_of_recordings_is_corrected_for_noise(tmp_path: Path, measuring: Measuring) -> None:
    # Noise of 20 g reads 0.28 g in each of the five lines: without correction A* would be 0.8 g.
    (found,) = read_trials(write_recordings(tmp_path, noise=20.0), measuring).trials
    assert found.a_star / STANDARD_GRAVITY == pytest.approx(0.5, rel=0.25)
    assert found.rms / STANDARD_GRAVITY == pytest.approx(20.0 * math.sqrt(9500.0 / 12800.0), rel=0.02)


def test_lines_outside_the_band_do_not_count(tmp_path: Path, measuring: Measuring) -> None:
    path = write_recordings(tmp_path, noise=1e-4)
    narrow = Measuring(measuring.config, measuring.channel, measuring.bearing, (300.0, 9500.0))
    assert read_trials(path, narrow).trials[0].a_star / STANDARD_GRAVITY == pytest.approx(0.4, rel=0.01)


HEADER = "load_newton,speed_hz,defect_deg,rms_g,a_star_g\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"bad\.csv: no rows below the header"),
        (HEADER, r"bad\.csv: no rows below the header"),
        (HEADER.replace(",", ";") + "1;1;1;1,5;1\n", "line 1: cells are separated by ';'; expected commas"),
        ("speed_hz,defect_deg,rms_g,a_star_g\n40,2,1,1\n", "column load_newton is missing; found a_star_g"),
        (HEADER + "1000,40,2.3,high,0.2\n", r"line 2: rms_g is 'high', expected a positive number"),
        (HEADER + "1000,40,2.3,0.5,0.2\n1000,-40,2.3,0.5,0.2\n", "line 3: speed_hz is '-40', expected a positive"),
        (HEADER + "1000,40,2.3,nan,0.2\n", "line 2: rms_g is 'nan', expected a positive number"),
        (HEADER + "1000,40,2.3,0.5,\n", "line 2: a_star_g is '', expected a positive number"),
        (HEADER + "1000,40,400,0.5,0.2\n", "line 2: defect_deg is '400', expected a positive number up to 360"),
        (HEADER + "1000,40,2.3,0.5\n", "line 2: expected 5 cells, found 4"),
        ("load_newton,speed_hz,rms_g,a_star_g\n1,1,1,1\n", "expected one of the columns defect_deg and defect_mm"),
        ("load_newton,speed_hz,defect_mm,defect_deg,rms_g,a_star_g\n1,1,1,1,1,1\n", "expected one of the columns"),
        ("load_newton,speed_hz,defect_deg,rms_g\n1,1,1,1\n", "expected the columns rms_g and a_star_g, or recording"),
        (HEADER.strip() + ",recording\n1,1,1,1,1,a\n", "expected the columns rms_g and a_star_g, or recording"),
        (HEADER.strip() + ",colour\n1,1,1,1,1,red\n", "column colour is not known; allowed are load_newton"),
        (HEADER.strip() + ",rms_g\n1,1,1,1,1,1\n", "line 1: column rms_g is given twice"),
        (
            HEADER.strip() + ",fault\n1000,40,2,1,1,cage\n",
            "line 2: fault is 'cage', expected one of outer, inner, ball",
        ),
        (HEADER.strip() + ",h_d_um\n1000,40,2,1,1,0\n", "line 2: h_d_um is '0', expected a positive number"),
        ("load_newton,speed_hz,defect_deg,recording\n1,1,1,gone.npy\n", "line 2: recording 'gone.npy': no such file"),
        ("load_newton,speed_hz,defect_deg,recording\n1,1,1,\n", "line 2: recording is '', expected a file"),
    ],
)
def test_bad_tables_name_file_line_and_column(text: str, message: str, tmp_path: Path, measuring: Measuring) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as raised:
        read_trials(path, measuring)
    assert str(path) in str(raised.value)


def test_files_that_are_no_tables_are_named(tmp_path: Path, measuring: Measuring) -> None:
    with pytest.raises(InputError, match=r"gone\.csv: cannot be read: No such file"):
        read_trials(tmp_path / "gone.csv", measuring)
    (tmp_path / "a.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="is no text in UTF-8"):
        read_trials(tmp_path / "a.csv", measuring)


def test_recordings_of_no_use_are_named(tmp_path: Path, measuring: Measuring) -> None:
    path = write_recordings(tmp_path, noise=1e-4)
    whole = Measuring(measuring.config, measuring.channel, measuring.bearing, None)
    with pytest.raises(InputError, match="recordings need the band of the RMS: give rms_band_hz of channel 'casing'"):
        read_trials(path, whole)
    np.save(tmp_path / "one.npy", np.ones(500, dtype=np.float32))
    with pytest.raises(InputError, match=r"line 2: .*one\.npy: 5[0-9]* samples at 25600 Hz do not resolve 5 lines"):
        read_trials(path, measuring)
    np.save(tmp_path / "one.npy", np.full(50_000, np.nan, dtype=np.float32))
    with pytest.raises(InputError, match=r"line 2: .*one\.npy: holds samples that are no finite numbers"):
        read_trials(path, measuring)


def configured(tmp_path: Path, **changes: Any) -> Config:
    values = tomllib.loads(MACHINE)
    values["channel"] = [{**values["channel"][0], **changes}, {**values["channel"][0], "name": "other", **changes}]
    return validate(values, tmp_path / "two.toml")


def test_the_channel_is_the_tracked_one_or_named(tmp_path: Path, measuring: Measuring) -> None:
    with pytest.raises(InputError, match="--channel is missing: casing, other are to choose from"):
        tracked_channel(configured(tmp_path), None)
    assert tracked_channel(configured(tmp_path, track=False), "other").name == "other"
    with pytest.raises(InputError, match="--channel motor: expected one of casing, other"):
        tracked_channel(configured(tmp_path), "motor")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--free", "q"), "spallwatch: --free q: cannot be free; expected m_i, m_o, k_i, k_c"),
        (("--free", "m_r_kgs"), "--free m_r_kgs: cannot be free; did you mean m_r_kg? expected m_i, m_o"),
        (("--free", ","), "Invalid value for '--free': ',': expected names with commas between them"),
        (("--objectives", "peak"), "objectives: expected some of rms, a_star, got ('peak',)"),
        (("--limit", "f_r:9500"), "'f_r:9500' is not NAME:LO:HI, such as f_r:4500:9500"),
        (("--limit", "f_9:1:2"), "'f_9' has no limits; expected one of m_r, k_r"),
        (("--limit", "f_r:9500:4500"), "identify: limits of f_r: expected 0 <= LO < HI"),
        (("--out", "rig.nc"), "--out rig.nc: expected a name that ends in .toml"),
        (("--report", "rig.txt"), "--report rig.txt: expected a name that ends in .html or .pdf"),
        (("--resume",), "--resume needs --out FILE"),
        (("--free", "m_r,k_r,c_i,beta_c,c_r,alpha_c"), "6 features of the tests cannot determine 6 parameters"),
    ],
)
def test_wrong_options_are_named(options: tuple[str, ...], message: str, table: Path, machine: Path) -> None:
    run = run_command("identify", table, "--config", machine, *options)
    assert run.returncode == 2
    assert message in run.stderr


def test_help_names_the_default_unknowns() -> None:
    words = CliRunner().invoke(spallwatch, ["identify", "--help"]).output
    assert "m_r, k_r, c_i, beta_c, c_r, alpha_c" in " ".join(words.split())
