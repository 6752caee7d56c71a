"""``spallwatch orders``: lines of a block over orders, by the tacho of the configuration."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.support.commands import run_command

RATE, N = 8000, 16_000
TURNS = 20.0 * np.arange(N) / RATE + 2.0 * (np.arange(N) / RATE) ** 2
CONFIG = """
[[bearing]]
name = "b"
designation = "6205"
[operating]
speed_hz = 24.0
tacho_channel = "tacho"
pulses_per_revolution = 8
[[source]]
name = "s"
url = "run.csv"
rate_hz = 8000.0
block_s = "file"
[[channel]]
name = "drive"
source = "s"
bearing = "b"
unit = "g"
band_hz = [[2000.0, 3000.0]]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("orders")
    time = np.arange(N) / RATE
    modulated = (1.0 + 0.5 * np.cos(2.0 * np.pi * 3.25 * TURNS)) * np.cos(2.0 * np.pi * 2500.0 * time)
    noise = 1e-3 * np.random.default_rng(0).standard_normal(N)
    drive = 3.0 * np.cos(2.0 * np.pi * 5.5 * TURNS) + modulated + noise
    rows = np.column_stack([drive, 5.0 * (TURNS * 8.0 % 1.0 < 0.5)])
    np.savetxt(folder / "run.csv", rows, "%.6g", delimiter=",", header="drive,tacho", comments="")
    (folder / "machine.toml").write_text(CONFIG)
    (folder / "plain.toml").write_text(CONFIG.replace("tacho_channel", "speed_exact = true #"))
    return folder


def test_the_highest_lines_of_the_signal_are_listed_and_written(folder):
    done = run_command("orders", "run.csv", "--config", "machine.toml", "--out", "o.csv", "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)["channels"]["drive"]
    assert (found["rotation_source"], found["revolutions"]) == ("tacho", pytest.approx(48.0, abs=0.02))
    assert found["speed_max_hz"] == pytest.approx(28.0, rel=0.03)
    top = found["lines"][0]
    assert top["order"] == pytest.approx(5.5, abs=0.02)
    assert top["amplitude_g"] == pytest.approx(3.0, rel=0.02)
    rows = np.genfromtxt(folder / "o.csv", delimiter=",", names=True)
    assert rows.dtype.names == ("drive_order", "drive_amplitude_g")
    assert rows["drive_amplitude_g"].max() == pytest.approx(top["amplitude_g"])


def test_the_envelope_shows_what_modulates_its_band(folder):
    done = run_command(
        "orders", "run.csv", "--config", "machine.toml", "--envelope", "--max-order", 20, "--plot", "o.svg", cwd=folder
    )
    assert done.returncode == 0, done.stderr
    assert "order of the shaft" in (folder / "o.svg").read_text()
    block, channel, first, *_ = done.stdout.splitlines()
    assert block == "block 1 (run.csv)"
    assert channel.startswith("channel drive: 4")
    assert channel.endswith("(tacho)")
    order, amplitude, unit = first.split()
    assert float(order) == pytest.approx(3.25, abs=0.02)
    assert (float(amplitude), unit) == (pytest.approx(0.5, rel=0.05), "g")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--config", "plain.toml"), "run.csv: no channel has an angle of the shaft: none is configured"),
        (("--config", "machine.toml", "--block", "7"), "run.csv: block 7 is not accepted; replay says why"),
        (("--config", "machine.toml", "--out", "o.txt"), "--out"),
    ],
)
def test_without_an_angle_or_a_block_the_command_says_so(folder, arguments, message):
    done = run_command("orders", "run.csv", *arguments, cwd=folder)
    assert done.returncode == 2
    assert message in done.stderr
