"""``check`` says what states the level of each channel, and that nothing does."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.commands import run_command
from tests.support.streams_levels import COUNTS, FULL, hdf5, npy, sound

CONFIG = """
[machine]
name = "m"
[[bearing]]
name = "b"
designation = "6205"
[operating]
speed_hz = 30
[[source]]
name = "s"
url = "folder:in"
rate_hz = 1000
block_s = 0.5
{source}
[[channel]]
name = "x"
source = "s"
column = 1
bearing = "b"
band_hz = [[100, 400]]
{channel}
"""

WAV, NPY = sound("WAV")(COUNTS), npy(COUNTS)
FLOATS = npy((COUNTS / FULL).astype(np.float32))
SCALED = "integers, scaled as the file or its side-car states"
STATED = "stated by the file or its side-car"


def check(
    folder: Path, name: str, data: bytes, channel: str, source: str = "", sidecar: dict[str, Any] | None = None
) -> dict[str, Any]:
    (folder / "in").mkdir()
    (folder / "in" / name).write_bytes(data)
    if sidecar:
        (folder / "in" / f"{name}.json").write_text(json.dumps(sidecar))
    (folder / "m.toml").write_text(CONFIG.format(source=source, channel=channel))
    result = run_command("check", "--config", "m.toml", "--json", cwd=folder)
    found = json.loads(result.stdout)
    assert result.returncode == (2 if "problem" in {entry["severity"] for entry in found["problems"]} else 0)
    level = found["levels"].get("x", "nothing")
    assert f"level: {level}" in run_command("check", "--config", "m.toml", cwd=folder).stdout
    return found


@pytest.mark.parametrize(
    ("name", "data", "channel", "source", "sidecar", "level"),
    [
        ("a.npy", FLOATS, 'unit = "g"', "", None, "g (configured)"),
        ("a.npy", FLOATS, 'unit = "g"\nscale = 50', "", None, "g (configured), times 50 (scale)"),
        ("a.npy", FLOATS, 'unit = "g"', "", {"scale": 50}, "g (configured), scaled by the side-car"),
        ("a.npy", NPY, 'unit = "unknown"', "", None, "unknown (configured)"),
        ("a.npy", NPY, 'unit = "g"\nscale = 0.5', "", None, "g (configured), integers, one count is 0.5 g (scale)"),
        ("a.npy", NPY, 'unit = "g"', "", {"scale": 0.5, "unit": "g"}, f"g ({STATED}), {SCALED}"),
        ("a.h5", hdf5(COUNTS, scale_factor=0.001, unit="g"), 'unit = "g"', "", None, f"g ({STATED}), {SCALED}"),
        ("a.wav", WAV, 'unit = "g"', "range_g = 50", None, "g (configured), integers, full scale is 50 g (range_g)"),
        (
            "a.wav",
            WAV,
            'unit = "V"\nsensitivity_mv_per_g = 100\nscale = 5',
            "range_g = 50",
            None,
            "V (configured), 100 mV per g, integers, full scale is 5 V (scale)",
        ),
    ],
)
def test_what_states_the_level_is_said(
    name: str,
    data: bytes,
    channel: str,
    source: str,
    sidecar: dict[str, Any] | None,
    level: str,
    tmp_path: Path,
) -> None:
    found = check(tmp_path, name, data, channel, source, sidecar)
    assert found["levels"] == {"x": level}
    assert not any("wrong_unit" in problem["came"] for problem in found["problems"])


@pytest.mark.parametrize(("name", "data"), [("a.wav", WAV), ("a.npy", NPY)])
def test_integers_without_a_level_are_a_problem(name: str, data: bytes, tmp_path: Path) -> None:
    found = check(tmp_path, name, data, 'unit = "g"')
    assert found["levels"]["x"].endswith("is not stated")
    (problem,) = (problem for problem in found["problems"] if "wrong_unit" in problem["came"])
    assert problem["severity"] == "problem"
    assert "give [[channel]] scale" in problem["came"]
