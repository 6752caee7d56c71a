"""A folder of recordings as tests: names, patterns and tables; recordings written to look like published ones."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from models.identify.evaluate import Evaluator
from models.identify.trials import Condition, gather
from models.published.thesis import EXTENTS_DEG
from models.solve.response import Response
from models.solve.simulate import simulate
from monitor.commands.common import InputError
from monitor.config.load import load_config
from monitor.identify.trial_files import Measuring, tracked_channel
from monitor.identify.trial_folder import compile_names, read_tests
from reference.once import made_once
from streams.files.datasets import ferrara_name
from streams.types.block import STANDARD_GRAVITY
from tests.models.identify.cases import BAND, BEARING, CONDITIONS, TRUTH, space_of
from tests.support.commands import run_command

MACHINE = """
[[bearing]]
name = "test"
designation = "1205 ETN9"
[[source]]
name = "recording"
rate_hz = 51200
block_s = 5
[[channel]]
name = "casing"
source = "recording"
column = 1
unit = "g"
bearing = "test"
rms_band_hz = [0, 9500]
"""
DEFECTS = dict(zip(("D1", "D2", "D3"), CONDITIONS, strict=True))
SPECIMENS = "abc"
SECONDS = 2.0


def response_at(condition: Condition) -> Response:
    """Return the vibration of the truth at a condition, with its lines up to 9500 Hz."""
    evaluator = Evaluator(space_of("m_r"), [condition], BAND)
    scene = evaluator.scene(evaluator.space.known, condition)
    return simulate(scene, accuracy=2e-3, band=BAND, lines_to=BAND[1])


def recording(response: Response, rate: float, noise: float, seed: int) -> np.ndarray:
    """Return a signal of the simulator with white noise (m/s2), in g."""
    signal = response.acceleration(rate, SECONDS, phase=seed, band=BAND)
    return (signal + noise * np.random.default_rng(seed).standard_normal(signal.size)) / STANDARD_GRAVITY


@pytest.fixture(scope="module")
def look_alikes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Nine recordings of a simulated bench at 2000 N and 40 Hz: three defects on three bearings, as text."""
    responses = made_once("look_alikes", lambda: {name: response_at(c) for name, c in DEFECTS.items()})
    folder = tmp_path_factory.mktemp("tests")
    for n, (name, response) in enumerate(responses.items()):
        for m, specimen in enumerate(SPECIMENS):
            rate = 25600.0 if (name, specimen) == ("D2", "a") else 51200.0
            # The bearings differ by 2 %.
            samples = (0.98 + 0.02 * m) * recording(response, rate, 0.3, 10 * n + m)
            path = folder / f"{name}{specimen}" / "W2000N_f40Hz.txt"
            path.parent.mkdir()
            path.write_text("\n".join(f"{value:.5f}" for value in samples) + "\n")
    (folder / "readme.txt").write_text("Acceleration signals")
    (folder / "readme.pdf").write_bytes(b"%PDF-1.4")
    return folder


@pytest.fixture
def measuring(machine: Path) -> Measuring:
    config = load_config(machine)
    channel = tracked_channel(config, None)
    return Measuring(config, channel, config.bearing_of(channel), channel.rms_band_hz)


def test_look_alikes_have_the_features_of_the_model(look_alikes: Path, measuring: Measuring) -> None:
    table = read_tests(look_alikes, measuring)
    assert (len(table.trials), table.recordings, table.race_radius, table.lines_not_found) == (9, 9, None, 0)
    found = gather(table.trials)
    # The three bearings of a defect are repetitions at its mean extent (Table 2).
    assert [round(math.degrees(c.dphi_d), 3) for c in found.conditions] == list(EXTENTS_DEG.values())
    assert {(c.load, c.speed, c.part) for c in found.conditions} == {(2000.0, 40.0, "outer")}
    assert found.count.tolist() == [[3, 3]] * 3
    # h_d is deeper than a ball reaches, which is as good as the seeded 500 um.
    truth = Evaluator(space_of("m_r"), CONDITIONS, BAND).levels([space_of("m_r").known])[0]
    assert found.mean == pytest.approx(truth.features, rel=0.01)
    assert found.scatter == pytest.approx([0.02, 0.02], rel=0.3)


def test_one_command_identifies_from_a_folder(look_alikes: Path, machine: Path, tmp_path: Path) -> None:
    out = tmp_path / "rig.toml"
    options = ("--config", machine, "--free", "m_r", "--workers", 1, "--out", out, "--json")
    run = run_command("identify", look_alikes, *options)
    assert run.returncode == 0, run.stderr
    found = json.loads(run.stdout)
    assert (found["tests"], found["conditions"], found["recordings"]) == (9, 3, 9)
    low, high = found["intervals"]["m_r_kg"]
    assert low < TRUTH.m_r < high
    assert found["best"]["m_r_kg"] == pytest.approx(TRUTH.m_r, rel=0.01)
    assert out.exists()


def test_a_pattern_says_what_names_mean(look_alikes: Path, measuring: Measuring) -> None:
    named = read_tests(look_alikes, measuring, "{defect}{specimen}/W{load_newton}N_f{speed_hz}Hz.txt")
    assert named.trials == read_tests(look_alikes, measuring).trials


def test_names_of_ones_own(look_alikes: Path, measuring: Measuring, tmp_path: Path) -> None:
    text = (look_alikes / "D3b" / "W2000N_f40Hz.txt").read_text()
    folder = tmp_path / "own"
    folder.mkdir()
    (folder / "run7_2kN_2400rpm_inner_2,5mm.txt").write_text(text)
    pattern = "run{repetition}_{load_kn}kN_{speed_rpm}rpm_{fault}_{defect_mm}mm*"
    table = read_tests(folder, measuring, pattern)
    (trial,) = table.trials
    condition = trial.condition
    assert (condition.load, condition.speed, condition.part) == (2000.0, 40.0, "inner")
    assert condition.dphi_d == pytest.approx(2.5 / 16.64)
    assert table.race_radius == pytest.approx(16.64e-3)
    assert condition.h_d == BEARING.element_diameter
    (folder / "run7_2kN_2400rpm_inner_2,5mm.txt").rename(folder / "a_500_20_3.5.txt")
    (trial,) = read_tests(folder, measuring, "*_{load_newton}_{speed_hz}_{defect_deg}.txt").trials
    assert trial.condition == Condition(500.0, 20.0, math.radians(3.5), BEARING.element_diameter)


def test_a_table_in_the_folder_is_taken(look_alikes: Path, measuring: Measuring, tmp_path: Path) -> None:
    folder = tmp_path / "with_table"
    folder.mkdir()
    (folder / "x.txt").write_text((look_alikes / "D1b" / "W2000N_f40Hz.txt").read_text())
    (folder / "y.txt").write_text((look_alikes / "D2a" / "W2000N_f40Hz.txt").read_text())
    rows = ["recording,load_newton,speed_hz,defect_deg,rate_hz", "x.txt,2000,40,2.362,", "y.txt,2000,40,4.236,25600"]
    (folder / "tests.csv").write_text("\n".join(rows))
    first, second = read_tests(folder, measuring).trials
    by_name = read_tests(look_alikes, measuring).trials
    assert (first.rms, second.rms, second.a_star) == (by_name[1].rms, by_name[3].rms, by_name[3].a_star)
    with pytest.raises(InputError, match=r"--names and tests\.csv both say"):
        read_tests(folder, measuring, "{defect}_{load_newton}_{speed_hz}")


@pytest.mark.parametrize(
    "layout",
    [
        "D{n}{s}_{load}N_{speed}Hz.txt",
        "D{n}.{s}/{load}N/{speed}Hz.txt",
        "{load} N/{speed} Hz/D{n}_{s}.txt",
        "signals/f{speed}Hz_w{load}N_D{n}-{s}_acc.txt",
    ],
)
def test_all_54_names_are_understood_in_several_layouts(layout: str) -> None:
    found = set()
    for n in (1, 2, 3):
        for s in SPECIMENS:
            for load in (1000, 2000):
                for speed in (20, 30, 40):
                    name = ferrara_name(layout.format(n=n, s=s, load=load, speed=speed))
                    assert (name.defect, name.specimen, name.load, name.speed) == (f"D{n}", s, load, speed)
                    assert name.rate == (25600.0 if (n, s) == (2, "a") else 51200.0)
                    found.add(name)
    assert len(found) == 54


def test_a_defect_without_its_bearing_has_no_rate() -> None:
    name = ferrara_name("D2_1000N_20Hz.txt")
    assert (name.defect, name.specimen, name.rate) == ("D2", None, None)
    # Neither a tenth defect nor another word is one.
    assert ferrara_name("D10_signal.txt").defect is None
    assert ferrara_name("SD1a.txt").defect is None


def test_what_a_name_does_not_state_is_not_guessed(measuring: Measuring, tmp_path: Path) -> None:
    (tmp_path / "signal_01.txt").write_text("1.0\n2.0\n")
    (tmp_path / "D1a_1000N_20Hz.txt").write_text("1.0\n2.0\n")
    with pytest.raises(InputError, match=r"names of 1 of 2 recordings do not state a test \('signal_01\.txt' has no "):
        read_tests(tmp_path, measuring)
    with pytest.raises(InputError, match=r"'signal_01\.txt' does not match --names '\{defect\}a_"):
        read_tests(tmp_path, measuring, "{defect}a_{load_newton}N_{speed_hz}Hz.txt")


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ("{defect}_{load}_{speed_hz}", r"\{load\} is not known; expected defect, specimen"),
        ("{defect}{defect}_{load_kn}_{speed_hz}", r"\{defect\} is given twice"),
        ("{defect}_{load_kn}", r"expected one of \{speed_hz\}, \{speed_rpm\}"),
        ("{defect}_{defect_mm}_{load_kn}_{speed_hz}", r"expected one of \{defect\}, \{defect_deg\}, \{defect_mm\}"),
    ],
)
def test_patterns_are_checked(names: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        compile_names(names)


def test_patterns_take_folders_above_and_nothing_else() -> None:
    pattern = compile_names("{defect}+{load_newton}N*{speed_hz}Hz.txt")
    assert pattern.fullmatch("deep/er/D1+1000N, 20.5Hz.txt")
    assert not pattern.fullmatch("D1+1000N/20Hz.txt")
    assert not pattern.fullmatch("D1+1000N20Hz_txt")


def test_folders_and_names_of_no_use_are_refused(measuring: Measuring, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no recordings; expected files that end in"):
        read_tests(tmp_path, measuring)
    table = tmp_path / "a.csv"
    table.write_text("x")
    with pytest.raises(InputError, match="--names is for a folder of recordings"):
        read_tests(table, measuring, "{defect}")
    table.unlink()
    (tmp_path / "x_0_20_3.txt").write_text("1\n")
    with pytest.raises(InputError, match="expected positive numbers, found 0, 20, 3"):
        read_tests(tmp_path, measuring, "x_{load_newton}_{speed_hz}_{defect_deg}.txt")
    (tmp_path / "x_0_20_3.txt").rename(tmp_path / "x_1_20_400.txt")
    with pytest.raises(InputError, match="wider than the whole circumference"):
        read_tests(tmp_path, measuring, "x_{load_newton}_{speed_hz}_{defect_deg}.txt")


def test_recordings_need_a_band(look_alikes: Path, measuring: Measuring) -> None:
    with pytest.raises(InputError, match="recordings need the band of the RMS"):
        read_tests(look_alikes, replace(measuring, band=None))


def test_noise_without_lines_is_said(machine: Path, tmp_path: Path) -> None:
    for n, name in enumerate(DEFECTS):
        folder = tmp_path / "noise"
        folder.mkdir(exist_ok=True)
        noise = np.random.default_rng(n).standard_normal(100_000)
        np.save(folder / f"{name}b_2000N_40Hz.npy", noise.astype(np.float32))
    options = ("--config", machine, "--free", "m_r", "--objectives", "rms", "--workers", 1)
    run = run_command("identify", tmp_path / "noise", *options)
    assert run.returncode == 0, run.stderr
    assert "3 of 3 recordings do not show the lines of the damaged part; compare the sampling rate" in run.stdout
