"""``spallwatch bearing --statics balls``: what is printed and drawn of each ball, and what is refused."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from models.machine.ball_statics import BallStatics, equilibrium
from models.machine.bearing import Bearing
from monitor.commands.bearing.command import command
from monitor.commands.common import InputError

MACHINE = """
[[bearing]]
name = "right"
n_elements = 10
element_diameter_mm = 12.7
pitch_diameter_mm = 80.0
inner_groove_radius_mm = 6.477
outer_groove_radius_mm = 6.477
[operating]
speed_hz = 100.0
load_newton = 300.0
axial_load_newton = 200.0
[[source]]
name = "s"
[[channel]]
name = "x"
source = "s"
unit = "g"
bearing = "right"
"""
"""The bearing with axial load of Thibault et al. 2022; groove radii and clearance are not printed there."""


def bearing(*options: str) -> dict[str, Any]:
    result = CliRunner().invoke(command, [*options, "--json"], catch_exceptions=False)
    assert result.exit_code == 0
    found: dict[str, Any] = json.loads(result.stdout)["ball_statics"]
    return found


@pytest.fixture
def machine(tmp_path: Path) -> str:
    path = tmp_path / "machine.toml"
    path.write_text(MACHINE)
    return str(path)


def test_the_published_bearing_under_axial_load(machine: str) -> None:
    """4.26 passages a turn at 6000 rpm, -0.4 % at 20,000 rpm and +0.4 % at 1000 N (groove radii and play chosen)."""
    options = ("--config", machine, "--statics", "balls", "--clearance-um", "17.5")
    found = bearing(*options)
    assert found["axial_load_newton"] == 200.0
    assert found["play_um"] == pytest.approx(35.0)
    assert found["bpfo_order"] == pytest.approx(4.26, abs=0.01)
    assert found["loaded_balls_least"] == 10
    fast, pushed = bearing(*options, "--speed-hz", "333.3"), bearing(*options, "--axial-load-newton", "1000")
    assert 100.0 * (fast["bpfo_order"] / found["bpfo_order"] - 1.0) == pytest.approx(-0.4, abs=0.1)
    assert 100.0 * (pushed["bpfo_order"] / found["bpfo_order"] - 1.0) == pytest.approx(0.4, abs=0.1)
    assert fast["loaded_balls_least"] < 10
    assert fast["centrifugal_force_newton"] == pytest.approx(258.9, rel=0.05)
    assert found["estimated"] == []


def test_the_balls_carry_the_loads(machine: str) -> None:
    balls = bearing("--config", machine, "--statics", "balls", "--clearance-um", "17.5")["balls"]
    angle = np.radians([ball["angle_deg"] for ball in balls])
    force = np.array([ball["inner_load_newton"] for ball in balls])
    beta = np.radians([ball["inner_contact_angle_deg"] for ball in balls])
    assert np.sum(force * np.cos(beta) * np.cos(angle)) == pytest.approx(300.0, abs=1e-3)
    assert np.sum(force * np.sin(beta)) == pytest.approx(200.0, abs=1e-3)


def test_tilt_is_that_of_the_model_in_the_plane_of_the_load(machine: str) -> None:
    found = bearing("--config", machine, "--tilt-mrad", "0.35", "--clearance-um", "17.5")
    groove = 6.477e-3
    shape = Bearing("", 10, 0.0127, 0.08, inner_groove_radius=groove, outer_groove_radius=groove)
    state = equilibrium(
        BallStatics(shape, 35e-6),
        np.array([300.0, 0.0, 200.0, 0.0, 0.0]),
        100.0,
        held={"tilt_x": 0.0, "tilt_y": 0.35e-3},
    )
    assert [ball["inner_load_newton"] for ball in found["balls"]] == pytest.approx(state.inner_force.tolist(), rel=1e-6)
    straight = bearing("--config", machine, "--statics", "balls", "--clearance-um", "17.5")
    side, other = (values["balls"][0]["inner_contact_angle_deg"] for values in (found, straight))
    assert side < other
    assert found["tilting_moment_newton_m"] != pytest.approx(straight["tilting_moment_newton_m"], abs=0.1)


def test_without_load_at_the_inner_race_there_is_no_angle() -> None:
    found = bearing("6205", "--load-newton", "500", "--speed-hz", "300", "--statics", "balls")
    assert found["estimated"] == ["inner_groove_radius", "outer_groove_radius"]
    free = [ball for ball in found["balls"] if ball["inner_load_newton"] == 0.0]
    assert free
    for ball in free:
        assert ball["inner_contact_angle_deg"] is None
        assert ball["outer_load_newton"] == pytest.approx(found["centrifugal_force_newton"], rel=1e-6)
    assert 0.0 < found["contact_interval_turns"] < 1.0 / (found["ftf_hz"] / 300.0)
    assert math.isclose(found["bpfo_change_percent"], 0.0, abs_tol=1e-6)


def test_lines_and_picture(machine: str, tmp_path: Path) -> None:
    picture = tmp_path / "balls.svg"
    options = ["--config", machine, "--clearance-um", "17.5", "--plot", str(picture)]
    result = CliRunner().invoke(command, options, catch_exceptions=False)
    assert result.exit_code == 0
    assert re.search(r"BPFO\s+42[56]\.\d+ Hz \(4\.2\d+ a turn\), \+1\.\d+ %", result.stdout)
    assert len(re.findall(r"^ +\d+ +\d+\.0 ", result.stdout, re.MULTILINE)) == 10
    drawn = picture.read_text(encoding="utf-8")
    assert "Forces and contact angles" in drawn
    assert "radial load" in drawn


def test_without_any_of_the_options_nothing_is_computed() -> None:
    result = CliRunner().invoke(command, ["6205", "--load-newton", "500", "--speed-hz", "30", "--json"])
    assert json.loads(result.stdout)["ball_statics"] is None


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--statics", "balls"), "must have one row of balls, 1205 ETN9 has not"),
        (("NU205", "--statics", "balls"), "must have one row of balls"),
        (("6205", "--plot", "x.txt"), r"--plot x.txt: expected a name that ends in"),
    ],
)
def test_what_is_not_described_is_refused(options: tuple[str, ...], words: str) -> None:
    with pytest.raises(InputError, match=words):
        CliRunner().invoke(command, [*options, "--load-newton", "500", "--speed-hz", "30"], catch_exceptions=False)
