"""``[[interference]]`` in a configuration, and what ``check`` says of it and proposes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from models.machine.bearing import kinematics
from monitor.config.load import Config, validate
from monitor.config.plausible.rules import JudgedConfig
from monitor.desk.judge.sections import interference_lines, taken_families
from monitor.health.signal.interference import Interference
from monitor.service.setup import source_settings
from monitor.service.summary import run_attributes
from tests.support.commands import run_command
from tests.support.config import MINIMAL, message
from tests.support.interference import RATE, damaged, mesh

MACHINE = """
[[bearing]]
name = "test"
designation = "6205"
[operating]
speed_hz = 30
[[source]]
name = "logger"
url = "folder:in"
rate_hz = 25600
block_s = 1
[[channel]]
name = "de"
source = "logger"
column = 1
unit = "g"
bearing = "test"
band_hz = [[1000, 9000]]
"""


def config_of(*sections: dict[str, object]) -> Config:
    return validate({**MINIMAL, "interference": list(sections)}, Path("machine.toml"))


def test_the_section_becomes_settings_of_every_channel() -> None:
    config = config_of({"orders": [23], "sidebands": 2}, {"lines_hz": [50], "harmonics": 40, "name": "mains"})
    (channel,) = source_settings(config, config.source[0]).channels.values()
    assert channel.interference == (
        Interference(orders=(23.0,), sidebands=2),
        Interference(lines=(50.0,), harmonics=40, name="mains"),
    )


@pytest.mark.parametrize(
    ("section", "said"),
    [
        ({}, "give orders or lines_hz"),
        ({"orders": [0]}, "interference[0].orders[0]"),
        ({"lines_hz": [50], "tolerance": 0.2}, "interference[0].tolerance"),
        ({"lines_hz": [50], "harmonics": 0}, "interference[0].harmonics"),
        ({"order": [23]}, "did you mean 'orders'?"),
    ],
)
def test_refusals_name_the_key(section: dict[str, object], said: str) -> None:
    assert said in message({**MINIMAL, "interference": [section]})


def test_records_say_what_was_removed() -> None:
    config = config_of({"orders": [23], "sidebands": 2, "name": "gear"}, {"lines_hz": [50, 60], "harmonics": 40})
    channels = source_settings(config, config.source[0]).channels
    said = run_attributes(config, channels)["interference"]
    assert said == "gear: order 23, all multiples, 2 sidebands each; 50 Hz, 60 Hz, 40 multiples"
    assert "interference" not in run_attributes(config_of(), channels)


def test_a_machine_without_it_keeps_its_hash_and_one_with_it_has_another() -> None:
    without = validate(MINIMAL, Path("machine.toml"))
    assert without.hash == config_of().hash
    assert without.hash != config_of({"orders": [23]}).hash


def test_the_comb_of_a_part_is_a_problem() -> None:
    bearing = config_of().bearing[0].to_bearing()
    (section,) = config_of({"orders": [23, 3.6]}).interference
    assert section.families_removed(kinematics(bearing, 30.0)) == ("outer",)
    (section,) = config_of({"orders": [23], "lines_hz": [50]}).interference
    assert section.families_removed(kinematics(bearing, 30.0)) == ()


def test_check_names_it_and_proposes_the_mesh_of_a_recording(tmp_path: Path) -> None:
    x = damaged(duration=1.0) + mesh(25_600, 1.0, 30.0)
    np.savetxt(tmp_path / "x.csv", x[:, None], fmt="%.4f")
    (tmp_path / "in").mkdir()
    text = MACHINE + '[[interference]]\nname = "pump"\norders = [3.58]\n'
    (tmp_path / "m.toml").write_text(text)
    said = run_command("check", "--config", "m.toml", "--recording", "x.csv", cwd=tmp_path).stdout
    assert "interference pump: order 3.58, all multiples, removed before the envelope" in said
    assert "interference pump: within 2 % of the outer line of bearing 'test'" in said
    assert "[[interference]] orders = [23], sidebands = 3" in said
    done = run_command("check", "--config", "m.toml", "--recording", "x.csv", "--json", cwd=tmp_path)
    (found,) = json.loads(done.stdout)["interference_proposals"]
    assert (found["channel"], found["order"], found["sidebands"]) == ("de", 23, True)
    assert found["fundamental_hz"] == pytest.approx(690.0, rel=1e-3)
    assert found["share"] > 0.2
    assert RATE == 25_600.0


def test_nothing_is_proposed_where_a_part_is_named(tmp_path: Path) -> None:
    x = damaged(duration=1.0) + mesh(25_600, 0.4, 30.0)
    np.savetxt(tmp_path / "x.csv", x[:, None], fmt="%.4f")
    (tmp_path / "in").mkdir()
    (tmp_path / "m.toml").write_text(MACHINE)
    done = run_command("check", "--config", "m.toml", "--recording", "x.csv", "--json", cwd=tmp_path)
    assert json.loads(done.stdout)["interference_proposals"] == []


def test_a_recording_without_a_usable_block_is_refused(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "m.toml").write_text(MACHINE)
    (tmp_path / "x.csv").write_text("1\n2\n3\n")
    done = run_command("check", "--config", "m.toml", "--recording", "x.csv", cwd=tmp_path)
    assert done.returncode == 2
    assert "no block of it is accepted" in done.stderr


GEARS: dict[str, object] = {
    "wheel": [{"name": "pinion", "teeth": 23}, {"name": "wheel", "teeth": 71}],
    "pair": [{"wheels": ["pinion", "wheel"]}],
}


def with_gears(operating: Mapping[str, object]) -> Config:
    values = {**MINIMAL, "gear": GEARS, "interference": [{"lines_hz": [50]}]}
    return validate({**values, "operating": {"speed_hz": 30.0, **operating}}, Path("machine.toml"))


def test_the_meshes_of_gears_are_removed_by_themselves_as_far_as_the_shaft_is_sought() -> None:
    for operating, tolerance in (({}, 0.085), ({"speed_exact": True}, 0.005)):
        config = with_gears(operating)
        (channel,) = source_settings(config, config.source[0]).channels.values()
        mains, gear = channel.interference
        assert mains.lines == (50.0,)
        assert (gear.orders, gear.sidebands, gear.tolerance) == ((23.0,), 3, tolerance)
        assert (gear.spacing, *gear.beside) == pytest.approx((1.0, 23 / 71))
        said = run_attributes(config, {"x": channel})["interference"]
        assert said.endswith("; gear pinion, wheel: order 23, all multiples, 3 sidebands each at 1 and 0.323944 orders")


def test_gears_whose_mesh_is_the_comb_of_a_part_are_a_problem() -> None:
    assert list(taken_families(JudgedConfig(with_gears({})))) == []
    # The outer line of this bearing is 7.09 times the shaft.
    few = {"wheel": [{"name": "a", "teeth": 7}, {"name": "b", "teeth": 40}], "pair": [{"wheels": ["a", "b"]}]}
    values = {**MINIMAL, "gear": few, "bearing": [{"name": "test", "designation": "ZA-2115"}]}
    (said,) = taken_families(JudgedConfig(validate(values, Path("machine.toml"))))
    assert said.key == "gear"
    assert said.came.startswith("interference gear a, b: within 2 % of the outer line of bearing 'test'")
    assert list(interference_lines(with_gears({})))[-1].endswith("orders, removed before the envelope")
