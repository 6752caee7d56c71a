"""``spallwatch gear``: what names and teeth alone give, and what is refused."""

from __future__ import annotations

import json
import math
import tomllib
from pathlib import Path
from typing import Any

import pytest

from monitor.commands.check.command import gear_lines
from monitor.config.load import validate
from tests.support.commands import run_command
from tests.support.config import MINIMAL

GEARS = """
[gear]
bearing_shaft = "middle"
[[gear.wheel]]
name = "pinion"
teeth = 23
[[gear.wheel]]
name = "wheel"
teeth = 71
shaft = "middle"
[[gear.pair]]
wheels = ["pinion", "wheel"]
"""


def asked(*arguments: object, cwd: Path | None = None) -> dict[str, Any]:
    done = run_command("gear", *arguments, "--json", cwd=cwd)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_the_appendix_meshes_at_312_hz() -> None:
    # 37 teeth at W / Omega: 50 kW and 942.9 N m make 8.44 Hz; the print rounds it to 8.4 and has 310.8 Hz.
    values = asked("37/37", "37/37", "--speed-hz", 8.44)
    assert [pair["mesh_hz"] for pair in values["pairs"]] == pytest.approx([312.28, 312.28])
    assert asked("37/37", "--speed-hz", 8.4)["pairs"][0]["mesh_hz"] == pytest.approx(310.8)


@pytest.mark.parametrize("stages", [[(23, 71)], [(20, 40), (17, 53)], [(37, 37), (37, 37), (12, 90)]])
def test_stages_follow_each_other(stages: list[tuple[int, int]]) -> None:
    values = asked(*(f"{a}/{b}" for a, b in stages), "--speed-hz", 10.0)
    turns = 1.0
    for (a, b), pair in zip(stages, values["pairs"], strict=True):
        assert pair["mesh_hz"] == pytest.approx(10.0 * a * turns)
        # Two teeth meet again after so many whole turns of both wheels, and not before.
        first, second = pair["hunting_tooth_turns"]
        assert (first * a, math.gcd(first, second)) == (second * b, 1)
        assert pair["hunting_tooth_hz"] == pytest.approx(10.0 * turns / first)
        turns *= a / b
    assert abs(values["shafts"][-1]["turns"]) == pytest.approx(turns)
    assert [shaft["turns"] > 0 for shaft in values["shafts"]] == [place % 2 == 0 for place in range(len(stages) + 1)]


def test_a_file_may_hold_the_gears_alone(tmp_path: Path) -> None:
    (tmp_path / "config.toml").write_text(GEARS)
    values = asked(cwd=tmp_path)
    assert (values["speed_shaft"], values["speed_hz"]) == ("middle", None)
    assert values["pairs"][0]["mesh_order"] == pytest.approx(71.0)
    assert values["pairs"][0]["mesh_hz"] is None
    printed = run_command("gear", cwd=tmp_path).stdout
    assert "every 71 turns of pinion, 23 of wheel; no common factor" in printed
    assert "Hz" not in printed


def test_the_speed_of_the_machine_counts(tmp_path: Path) -> None:
    (tmp_path / "config.toml").write_text(GEARS + "[operating]\nspeed_hz = 5.0\n")
    assert asked(cwd=tmp_path)["pairs"][0]["mesh_hz"] == pytest.approx(355.0)
    assert asked("--speed-hz", 10.0, cwd=tmp_path)["pairs"][0]["mesh_hz"] == pytest.approx(710.0)
    assert "sidebands of pinion 15.435 Hz apart, of wheel 5 Hz" in run_command("gear", cwd=tmp_path).stdout


def test_check_names_the_pairs() -> None:
    config = validate({**MINIMAL, "gear": tomllib.loads(GEARS)["gear"]}, Path("machine.toml"))
    assert list(gear_lines(config)) == ["gears pinion and wheel, 23/71: mesh order 71 of shaft middle"]
    assert list(gear_lines(validate(MINIMAL, Path("machine.toml")))) == []


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["23-71"], ["'23-71'", "23/71"]),
        (["3/71"], ["gear.wheel[0].teeth = 3", "4"]),
        (["23/71", "--config", "x.toml"], ["23/71", "x.toml", "one of them"]),
        ([], ["neither stages nor --config", "23/71"]),
        (["--config", "nowhere.toml"], ["nowhere.toml", "cannot be read"]),
        (["--config", "."], ["is a folder"]),
        (["--config", "plain.toml"], ["plain.toml", "no [gear]", "[[gear.wheel]]"]),
        (["--config", "lost.toml"], ["lost.toml:12: gear.pair[0].wheels", "'whel'", "did you mean 'wheel'"]),
        (["23/71", "--speed-hz", "0"], ["--speed-hz"]),
    ],
)
def test_wrong_input_names_what_is_expected(arguments: list[str], said: list[str], tmp_path: Path) -> None:
    (tmp_path / "lost.toml").write_text(GEARS.replace('"pinion", "wheel"', '"pinion", "whel"'))
    (tmp_path / "plain.toml").write_text(
        '[[bearing]]\nname = "b"\ndesignation = "6205"\n[[source]]\nname = "s"\n'
        '[[channel]]\nname = "c"\nsource = "s"\nunit = "g"\nbearing = "b"\n'
    )
    done = run_command("gear", *arguments, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    for words in said:
        assert words in done.stderr
