"""``spallwatch ias``: a text of times, a sampled track, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from models.words.errors import WrongInputError
from monitor.commands.ias import command
from tests.monitor.health.signal.rotation.wheels import MARKS, eccentric, wheel

BEARING_ORDERS = {"outer": 3.5848, "inner": 5.4152}
"""Of a 6205, events per revolution."""


def run(*arguments: object, code: int = 0) -> str:
    result = CliRunner().invoke(command, [str(argument) for argument in arguments])
    if code == 0:
        assert result.exit_code == 0, result.output
        return result.output
    assert isinstance(result.exception, WrongInputError)
    return str(result.exception)


def values(*arguments: object) -> dict[str, Any]:
    return json.loads(run(*arguments, "--json"))


@pytest.fixture(scope="module")
def pulses(tmp_path_factory: pytest.TempPathFactory) -> Path:
    lines = [(k * BEARING_ORDERS["outer"], 2e-5 * k, float(k)) for k in range(1, 6)]
    train = wheel(100, lines=lines, error=eccentric(0.05), jitter=1e-8, clock=1e8)
    path = tmp_path_factory.mktemp("ias") / "pulses.csv"
    kept = np.delete(train.times, [900, 12_000])
    path.write_text(f"pulses_per_revolution: {MARKS}\ntime\n" + "\n".join(f"{t:.9f}" for t in kept) + "\n")
    return path


def test_a_text_of_times(pulses: Path, tmp_path: Path) -> None:
    out, plot = tmp_path / "ias.csv", tmp_path / "ias.png"
    found = values(pulses, "--bearing", "6205", "--clock-mhz", 100, "--out", out, "--plot", plot)
    assert (found["pulses_missing"], found["pulses_extra"]) == (2, 0)
    assert found["speed_hz"] == pytest.approx(40.0, rel=1e-3)
    assert found["timing_noise_ns"] == pytest.approx(1e9 * np.hypot(1e-8, 1e-8 / 12**0.5), rel=0.1)
    assert found["clock_noise_ns"] == pytest.approx(2.887, rel=1e-3)
    assert found["wheel_error_deg"] == pytest.approx(0.05, rel=0.02)
    assert found["lines"]["outer"]["detected"]
    assert found["lines"]["outer"]["score"] > 2.0 * found["lines"]["inner"]["score"]
    assert found["lines"]["outer"]["order"] == pytest.approx(BEARING_ORDERS["outer"], rel=1e-3)
    table = np.loadtxt(out, delimiter=",", skiprows=1)
    assert table[table[:, 0] > 2.0][0, 0] == pytest.approx(2.0, abs=0.02)
    assert plot.read_bytes()[:4] == b"\x89PNG"


def test_words_for_people(pulses: Path) -> None:
    text = run(pulses, "--bearing", "6205", "--remove-wheel")
    assert "2 missing, 0 too many; 100 turns at 40" in text
    assert "taken out" in text
    assert "* stands out" in text


def test_a_sampled_track(tmp_path: Path) -> None:
    rate = 51_200.0
    time = np.arange(round(rate)) / rate
    angle = 2.0 * np.pi * 32 * (40.0 * time + 0.3 * time**2)
    np.save(tmp_path / "track.npy", np.sin(angle).astype(np.float32))
    found = values(
        tmp_path / "track.npy",
        "--tacho-channel",
        "1",
        "--rate-hz",
        rate,
        "--pulses-per-revolution",
        32,
        "--tacho-edge",
        "falling",
    )
    assert found["speed_hz"] == pytest.approx(40.3, rel=0.01)
    assert found["pulses_missing"] == 0


def test_a_configuration_states_the_wheel(pulses: Path, tmp_path: Path) -> None:
    plain, config = tmp_path / "plain.csv", tmp_path / "machine.toml"
    plain.write_text("".join(pulses.read_text().splitlines(keepends=True)[1:]))
    config.write_text(
        f"""
        [[bearing]]
        name = "drive"
        designation = "6205"
        [operating]
        speed_hz = 40
        pulses_per_revolution = {MARKS}
        tacho_ratio = 2
        [[source]]
        name = "bench"
        [[channel]]
        name = "a"
        source = "bench"
        bearing = "drive"
        unit = "g"
        """
    )
    found = values(plain, "--config", config)
    assert (found["pulses_per_revolution"], found["turns"]) == (MARKS, 100)
    assert found["resolution"] == pytest.approx(1.0 / 200.0)
    assert set(found["lines"]) == {"outer", "inner", "ball", "cage"}


def test_what_is_missing_or_contradicts_is_refused(pulses: Path, tmp_path: Path) -> None:
    plain = tmp_path / "plain.csv"
    plain.write_text("\n".join(f"{t:.6f}" for t in wheel(20).times))
    assert "--pulses-per-revolution is missing" in run(plain, code=2)
    assert "belong to --tacho-channel" in run(plain, "--tacho-level", 2, code=2)
    assert "do not follow one speed" in run(pulses, "--pulses-per-revolution", 60, "--tacho-missing-teeth", 2, code=2)
    assert "no such file" in run(tmp_path / "none.csv", code=2).lower()
    assert ".csv" in run(pulses, "--out", tmp_path / "x.txt", code=2)
