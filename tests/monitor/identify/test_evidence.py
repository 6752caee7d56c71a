"""``spallwatch identify`` without known defects: peaks, accelerances, run-ups, healthy recordings, priors."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from models.identify.evidence import accelerance, modes
from models.identify.space import bearing_directions
from models.machine.rig import Rig
from monitor.commands.common import InputError
from monitor.config.load import load_config
from monitor.identify.evidence_files import read_accelerance, read_peaks
from monitor.identify.rig_table import verdict_lines
from monitor.identify.trial_files import Measuring, read_trials, tracked_channel
from tests.models.identify.cases import BEARING
from tests.support.commands import run_command
from tests.support.commands_identify import MACHINE, RATE
from tests.support.evidence import LIGHT, peaks_of

LOAD = 2000.0
HELD = f"""
[operating]
speed_hz = 30
load_newton = {LOAD:g}
[rig]
m_i_kg = {LIGHT.m_i}
m_o_kg = {LIGHT.m_o}
m_r_kg = 1.0
k_i_newton_per_m = {LIGHT.k_i}
k_r_newton_per_m = 1e9
k_c_newton_per_m15 = {LIGHT.k_c}
c_i_newton_s_per_m = {LIGHT.c_i}
c_r_newton_s_per_m = {LIGHT.c_r}
beta_c_s = {LIGHT.beta_c}
"""
PEAKS = "load_newton,direction,frequency_hz,frequency_sd_hz,damping,damping_sd\n"


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    path = tmp_path / "machine.toml"
    path.write_text(MACHINE + HELD)
    return path


def write_peaks(path: Path) -> Path:
    rows = [
        f"{p.load},{p.direction},{p.frequency},{p.frequency_sd},{p.damping},{p.damping_sd}" for p in peaks_of(LIGHT)
    ]
    path.write_text(PEAKS + "\n".join(rows) + "\n")
    return path


def write_recording(path: Path, rig: Rig, seed: int) -> Path:
    """Write 20 s of the casing along the load under white forces, g."""
    count = int(20 * RATE)
    force = np.fft.rfft(np.random.default_rng(seed).standard_normal(count))
    frequency = np.arange(force.size, dtype=np.float64) * (RATE / count)
    k_b = np.array([bearing_directions(BEARING, LOAD, rig.k_c, 0.0)[1]])
    np.save(path, np.fft.irfft(force * accelerance(rig, BEARING, k_b, frequency)[0], count).astype(np.float32))
    return path


def answer(*arguments: Any) -> dict[str, Any]:
    run = run_command("identify", *arguments, "--seed", 1, "--workers", 1, "--quiet", "--json")
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


def test_peaks_become_a_calibrated_rig_where_the_rest_is_configured(machine: Path, tmp_path: Path) -> None:
    out = tmp_path / "rig.toml"
    options = ("--config", machine, "--peaks", write_peaks(tmp_path / "p.csv"), "--free", "m_r_kg,k_r_newton_per_m")
    found = answer(*options, "--out", out)
    assert {"front", "best", "intervals", "undetermined", "evaluations", "seconds"} <= set(found)
    assert found["front"] == []
    assert found["best"]["m_r_kg"] == pytest.approx(LIGHT.m_r, rel=0.02)
    assert found["peaks"] == 12
    assert found["calibrated"] is True
    assert len(found["v_eq_spread"]) == 3
    assert tomllib.loads(out.read_text())["rig"]["identification"].startswith(found["identification"])


def test_a_rig_on_values_of_the_default_bench_claims_nothing(machine: Path, tmp_path: Path) -> None:
    machine.write_text(MACHINE + HELD.replace(f"m_o_kg = {LIGHT.m_o}", ""))
    out = tmp_path / "rig.toml"
    options = ("--config", machine, "--peaks", write_peaks(tmp_path / "p.csv"), "--free", "m_r,k_r")
    found = answer(*options, "--prior", "m_r:rig:2.0", "--prior", "geometry", "--out", out)
    assert found["calibrated"] is False
    assert found["identification"] is None
    assert any("m_o neither free nor given in [rig]" in words for words in found["why_uncalibrated"])
    rig = tomllib.loads(out.read_text())["rig"]
    assert rig["calibrated"] is False
    assert "identification" not in rig
    assert "# Warning: m_o neither free" in out.read_text()
    sources = {prior["name"]: prior["source"] for prior in found["priors"]}
    assert sources["m_r_kg"] == "[rig]"
    assert sources["k_c_newton_per_m15"] == "Hertz, contacts of 1205 ETN9"
    words = "\n".join(verdict_lines(found))
    assert any("m_o neither free" in warning for warning in found["warnings"])
    assert "V_eq for the level of" in words


def test_resonances_of_a_run_up_and_of_healthy_recordings(machine: Path, tmp_path: Path) -> None:
    path = write_recording(tmp_path / "up.npy", LIGHT, 4)
    found = answer("--config", machine, "--run-up", path, "--free", "k_r")
    truth = modes(LIGHT, BEARING, np.array([bearing_directions(BEARING, LOAD, LIGHT.k_c, 0.0)[1]]))
    frequencies = [resonance["frequency_hz"] for resonance in found["resonances"]]
    assert min(abs(f / truth.frequency[0, 0] - 1.0) for f in frequencies) < 0.01
    assert min(abs(f / truth.frequency[0, 2] - 1.0) for f in frequencies) < 0.01
    assert all(resonance["extracted"] and resonance["load_newton"] == LOAD for resonance in found["resonances"])
    # A healthy recording has the same resonances, and a level that the model must not exceed.
    table = tmp_path / "tests.csv"
    table.write_text(f"recording,load_newton,speed_hz,fault\nup.npy,{LOAD:g},30,none\n")
    healthy = answer(table, "--config", machine, "--free", "k_r")
    assert healthy["resonances"] == found["resonances"]
    assert healthy["best"] == pytest.approx(found["best"])
    assert (healthy["tests"], healthy["conditions"], healthy["front"]) == (1, 1, [])


def test_an_accelerance_gives_peaks_with_levels(tmp_path: Path) -> None:
    frequency = np.arange(100.0, 9000.0, 5.0)
    k_b = np.array([bearing_directions(BEARING, LOAD, LIGHT.k_c, 0.0)[1]])
    level = np.abs(accelerance(LIGHT, BEARING, k_b, frequency))[0]
    path = tmp_path / "frf.csv"
    rows = [f"{LOAD:g},along,{f:g},{a:.8g}" for f, a in zip(frequency.tolist(), level.tolist(), strict=True)]
    path.write_text("load_newton,direction,frequency_hz,accelerance_m_s2_per_newton\n" + "\n".join(rows))
    peaks = read_accelerance(path)
    truth = modes(LIGHT, BEARING, k_b)
    at = np.abs(accelerance(LIGHT, BEARING, k_b, truth.frequency))
    for mode in (0, 2):
        peak = min(peaks, key=lambda peak, mode=mode: abs(peak.frequency - truth.frequency[0, mode]))
        assert peak.frequency == pytest.approx(truth.frequency[0, mode], rel=0.01)
        assert peak.accelerance == pytest.approx(at[0, mode], rel=0.15)
        assert peak.extracted
    path.write_text("\n".join(path.read_text().splitlines()[:20]))
    with pytest.raises(InputError, match=r"2000 N along it: 19 rows; expected 32 at least"):
        read_accelerance(path)
    path.write_text("load_newton,frequency_hz,accelerance_m_s2_per_newton\n1,5,1\n1,4,1\n")
    with pytest.raises(InputError, match="line 3: frequency_hz is '4', expected more than 5"):
        read_accelerance(path)
    flat = "".join(f"1,{f},1\n" for f in range(1, 60))
    path.write_text("load_newton,frequency_hz,accelerance_m_s2_per_newton\n" + flat)
    with pytest.raises(InputError, match="1 N: no resonance stands out"):
        read_accelerance(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("load_newton,frequency_hz\n1,1\n", "column frequency_sd_hz is missing; found frequency_hz, load_newton"),
        (PEAKS.strip() + ",colour\n1,along,1,1,1,1,red\n", "column colour is not known; allowed are load_newton"),
        (PEAKS + "1000,along,-3,1,,\n", "line 2: frequency_hz is '-3', expected a positive number"),
        (PEAKS + "1000,up,3,1,,\n", "line 2: direction is 'up', expected along, across, or nothing"),
        (PEAKS + "1000,along,3,1,0.1,\n", "line 2: damping_sd is missing beside damping"),
        (PEAKS + "1000,along,3,1,,0.1\n", "line 2: damping is missing beside damping_sd"),
    ],
)
def test_bad_peaks_name_file_line_and_column(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as raised:
        read_peaks(path)
    assert str(path) in str(raised.value)


def test_a_healthy_row_has_no_defect(machine: Path, tmp_path: Path) -> None:
    config = load_config(machine)
    channel = tracked_channel(config, None)
    measuring = Measuring(config, channel, BEARING, channel.rms_band_hz)
    path = tmp_path / "a.csv"
    header = "load_newton,speed_hz,defect_deg,fault,rms_g,a_star_g\n"
    path.write_text(header + "1000,40,,none,0.5,\n1000,40,2,outer,0.5,0.2\n")
    healthy, damaged = read_trials(path, measuring).trials
    assert healthy.condition.healthy
    assert np.isnan(healthy.a_star)
    assert not damaged.condition.healthy
    path.write_text(header + "1000,40,3,none,0.5,\n")
    with pytest.raises(InputError, match="line 2: defect_deg is '3', expected nothing, or 0: fault is none"):
        read_trials(path, measuring)
    path.write_text("load_newton,speed_hz,fault,rms_g,a_star_g\n1000,40,none,0.5,\n1000,40,outer,0.5,0.2\n")
    with pytest.raises(InputError, match="expected one of the columns defect_deg and defect_mm"):
        read_trials(path, measuring)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ((), "nothing to identify from: give TESTS with defects, --peaks, --frf or --run-up"),
        (("--prior", "m_o:5"), "'m_o:5' is not geometry|NAME:VALUE:SD|NAME:rig:SD, such as m_o:5.8:0.1"),
        (("--prior", "m_q:5:0.1"), "'m_q' cannot have a prior"),
        (("--prior", "m_q:rig:0.1"), "--prior m_q:rig: 'm_q' is no parameter of [rig]"),
        (("--shaft-mm", "30"), "'30' is not DIAMETER:LENGTH in mm, such as 30:250"),
        (("--shaft-mm", "30:0"), "'30:0': expected positive lengths in mm"),
        (("--shaft-mm", "30:300"), "--shaft-mm belongs to --prior geometry"),
        (("--run-up", "gone.npy"), "--run-up: no such file (gone.npy)"),
        (("--peaks", "peaks.csv", "--report", "page.html"), "--report shows tests with known defects alone"),
        (("--peaks", "peaks.csv", "--method", "nsga2"), "nsga2 needs tests with known defects"),
    ],
)
def test_wrong_evidence_is_named(options: tuple[str, ...], message: str, machine: Path) -> None:
    write_peaks(machine.with_name("peaks.csv"))
    given = [machine.with_name(option) if option in ("peaks.csv", "page.html") else option for option in options]
    run = run_command("identify", "--config", machine, *given)
    assert run.returncode == 2
    assert message in run.stderr
