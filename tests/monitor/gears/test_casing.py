"""``spallwatch gear --casing``: a box by finite elements, from its file to a level, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from models.fe.extra import has_extra
from monitor.commands.common import InputError
from monitor.config.load import ConfigError
from monitor.fe.config_casing import CasingFile, read_casing
from monitor.gears.casing import casing_by_elements, casing_lines, lines_of
from monitor.gears.config.section import GearSection
from monitor.gears.forces import GearRun
from monitor.gears.transfer import felt, motion_values, pressure_values
from tests.support.commands import run_command
from tests.support.docs import ROOT
from tests.support.gear_forces import VARIED, run_of, toml

pytestmark = pytest.mark.skipif(not has_extra(), reason="needs the extra fe (scikit-fem)")

ONE: dict[str, Any] = {
    **VARIED,
    "shaft": [VARIED["shaft"][0], *({**shaft, "fixed_axis": True} for shaft in VARIED["shaft"][1:])],
    "support": VARIED["support"][:1],
}
"""The train with one axis that moves, so that the box is a small one."""
GEAR = GearSection.model_validate(ONE)
BOX: dict[str, Any] = {
    "size_mm": [200, 200, 120],
    "wall_mm": 15,
    "cell_mm": 100,
    "band_hz": [200, 420],
    "damping": [[0, 0.03]],
    "sound_lines": 4,
    "seat": [{"name": "b0", "wall": "z0", "at_mm": [100, 100], "bore_mm": 60, "boss_mm": 80, "cover_mm": 5}],
    "point": [{"name": "top", "at_mm": [100, 200, 60]}],
    "microphone": [{"name": "mic", "at_mm": [100, 500, 60]}],
}


def text_of(tables: dict[str, Any]) -> str:
    lines = [
        f"{key} = {json.dumps(value)}" for key, value in tables.items() if key not in ("seat", "point", "microphone")
    ]
    for key in ("seat", "point", "microphone"):
        for entry in tables.get(key, []):
            lines += [f"[[{key}]]", *(f"{name} = {json.dumps(value)}" for name, value in entry.items())]
    return "\n".join(lines)


@pytest.fixture(scope="module")
def run() -> GearRun:
    return run_of(ONE, duration=0.6)


def test_a_stiff_box_moves_and_is_heard(run: GearRun, tmp_path: Path) -> None:
    (tmp_path / "box.toml").write_text(text_of(BOX))
    told: list[str] = []
    casing, known = casing_by_elements(GEAR, tmp_path / "box.toml", told.append)
    assert casing.motion is not None
    assert casing.pressure is not None
    assert casing.motion.outputs == ("top.x", "top.y", "top.z")
    assert casing.pressure.outputs == ("mic",)
    assert (known["radiation"]["status"], known["radiation"]["inaccurate_hz"]) == ("ok", [])
    assert len(told) == 2
    assert "unknowns" in told[0]
    assert "GB" in told[1]
    # 2 plates, 4 sides of 15 mm and seats, at 7250 kg/m3.
    assert known["mass_kg"] == pytest.approx(7250 * (0.2 * 0.2 * 0.12 - 0.17 * 0.17 * 0.09), rel=0.1)
    motion, sound = (felt(run, part, 0.1) for part in (casing.motion, casing.pressure))
    level = motion_values(motion)["outputs"][1]["bands_db"]
    # The band of 315 Hz has the mesh line of 312.28 Hz, that of 250 Hz none.
    assert level[1] > level[0] + 20.0
    assert pressure_values(sound)["microphones"][0]["level_dba"] < pressure_values(sound)["microphones"][0]["level_db"]
    assert "ok" in casing_lines(known)[1]


def test_lines_are_closer_than_the_narrowest_resonance() -> None:
    class Resonances:
        frequency = np.array([250.0, 300.0, 900.0])

    wide, narrow = (
        lines_of(CasingFile.model_validate({**BOX, "band_hz": [200, 420], "damping": [[0, ratio]]}), Resonances())  # type: ignore[arg-type]
        for ratio in (0.05, 0.001)
    )
    assert wide.size == 201
    assert narrow[1] - narrow[0] <= 0.2 * 0.001 * 250.0 or narrow.size == 2001


def test_the_box_of_the_example_is_read() -> None:
    assert [seat.name for seat in read_casing(ROOT / "examples" / "parts" / "gear_casing.toml").seat] == [
        *("input_a", "input_b", "output_a", "output_b")
    ]


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"band_hz": [500, 400]}, "band_hz: the lower end"),
        ({"point": [], "microphone": []}, r"at least one \[\[point\]\] or \[\[microphone\]\]"),
        ({"point": [*BOX["point"], *BOX["point"]]}, "the name 'top' is given twice"),
        ({"seat": [{**BOX["seat"][0], "cover_mm": 0}]}, "closed surface"),
        ({"seat": [{**BOX["seat"][0], "boss_mm": 50}]}, "boss must be wider than the bore"),
        ({"seat": [{**BOX["seat"][0], "at_mm": [20, 100]}]}, "its boss needs"),
        ({"wall_mm": 90}, "walls z0 and z1"),
        ({"damping": [[0, 1.5]]}, "ratios must be from 0 to below 1"),
        ({"material": "wood"}, "'cast_iron' or 'steel'"),
    ],
)
def test_a_box_that_cannot_be_is_refused(values: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        CasingFile.model_validate({**BOX, **values})


def test_a_missing_seat_or_a_wrong_key_is_named(tmp_path: Path) -> None:
    path = tmp_path / "box.toml"
    path.write_text(text_of(BOX))
    with pytest.raises(InputError, match=r"no \[\[seat\]\] with name = 'b1'; expected one for each .*found b0"):
        casing_by_elements(GearSection.model_validate(VARIED), path, print)
    path.write_text(text_of({**BOX, "cell": 9}))
    with pytest.raises(ConfigError, match=r"box.toml:\d+: cell = 9: unknown key; did you mean 'cell_mm'"):
        casing_by_elements(GEAR, path, print)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--casing", "box.toml", "--frf", "f.csv"], "--frf f.csv and --casing box.toml: give one of them"),
        (["--casing", "box.toml", "--atv", "a.npz"], "--atv a.npz: needs --frf"),
        (["--casing", "none.toml"], "none.toml: cannot be read"),
        (["--casing", "box.txt"], "--casing box.txt: expected a name that ends in .toml"),
    ],
)
def test_options_that_do_not_go_together_are_refused(options: list[str], said: str, tmp_path: Path) -> None:
    (tmp_path / "gear.toml").write_text(toml(VARIED))
    (tmp_path / "box.toml").write_text(text_of(BOX))
    done = run_command("gear", "--config", "gear.toml", *options, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert said in done.stderr
