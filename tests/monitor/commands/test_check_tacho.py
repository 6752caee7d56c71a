"""What ``check`` says of a tacho: pulses and speeds of the first block, or why there is no angle."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from monitor.commands.check.command import command

RATE = 2000
CONFIG = """
[machine]
name = "m"
[[bearing]]
name = "b"
designation = "6205"
[operating]
pulses_per_revolution = 4
{operating}
[[source]]
name = "s"
url = "folder:in"
format = "csv"
rate_hz = 2000
start_utc = 2024-05-01T12:00:00Z
block_s = 1.0
{source}
[[channel]]
name = "de"
source = "s"
column = "de"
unit = "g"
bearing = "b"
"""


def check(folder: Path, monkeypatch: pytest.MonkeyPatch, operating: str = "", source: str = "") -> dict[str, Any]:
    """Check a folder of one file whose shaft turns with 25 Hz, a mark of four missing once."""
    monkeypatch.chdir(folder)
    (folder / "config.toml").write_text(CONFIG.format(operating=operating, source=source))
    (folder / "in").mkdir(exist_ok=True)
    time = np.arange(2 * RATE) / RATE
    tacho = (time * 100.0 + 0.52) % 1.0 < 0.4
    tacho[1000:1020] = False
    noise = np.random.default_rng(0).normal(size=time.size)
    rows = "".join(f"{value:.4f},{on:d}\n" for value, on in zip(noise, tacho, strict=True))
    (folder / "in" / "a.csv").write_text(f"de,tacho\n{rows}")
    result = CliRunner().invoke(command, ["--json"])
    found = json.loads(result.stdout)
    assert result.exit_code == (2 if "problem" in {entry["severity"] for entry in found["problems"]} else 0)
    return found


def test_a_channel_of_pulses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = check(tmp_path, monkeypatch, 'tacho_channel = "tacho"')
    view = found["tacho"]["s"]
    assert (view["file"], view["status"], view["per_revolution"], view["missing"]) == ("a.csv", "ok", 4, 1)
    assert view["pulses"] == 99
    assert view["speed_min_hz"] == pytest.approx(25.0, rel=0.01)
    assert not [entry for entry in found["problems"] if "speed" in entry["key"] or "tacho" in entry["came"]]
    words = CliRunner().invoke(command, []).stdout
    assert "  tacho: 99 pulses in a.csv, 4 a revolution: 25 to 25 Hz; 1 missing, 0 too many\n" in words


def test_files_of_pulses_and_a_file_without(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    key = 'pulses = "{stem}.t"'
    found = check(tmp_path, monkeypatch, source=key)
    assert found["tacho"]["s"]["status"] == "none"
    came = {entry["came"]: entry["severity"] for entry in found["problems"]}
    assert came["its tacho gives no angle in a.csv (0 pulses): rotation_status none"] == "problem"
    (tmp_path / "in" / "a.t").write_text("ppr: 2\n" + "".join(f"{0.005 + k / 50}\n" for k in range(100)))
    found = check(tmp_path, monkeypatch, source=key)
    view = found["tacho"]["s"]
    assert (view["pulses"], view["per_revolution"], view["status"]) == (50, 2, "ok")
    assert not [entry for entry in found["problems"] if "speed" in entry["key"] or "tacho" in entry["came"]]


def test_without_a_tacho_nothing_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert check(tmp_path, monkeypatch, "speed_hz = 25")["tacho"] == {}
