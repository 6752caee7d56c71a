"""``spallwatch map``: what is built, drawn and checked, and what is said of it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from netCDF4 import Dataset

from models.maps.file import load_map
from models.solve.response import STATUSES
from models.solve.rotor.rig import RotorRig
from monitor.commands.common import InputError
from monitor.commands.maps import command
from monitor.health.size.level_set import least_volume
from monitor.service.setup import to_slice
from tests.oracles.edv_oracle import scan_least_volume

pytestmark = pytest.mark.usefixtures("plain_layout")

AXES = ["--load-newton", "4000", "--speed-hz", "40", "--dphi-deg", "0:6:4", "--h-d-um", "0:10:3", "--workers", "1"]
# The grid as it is given; of an option that is given twice, the last counts.
SMALL = [*AXES, "--interpolation-tolerance", "0"]


def build(tmp_path: Path, *more: str, axes: list[str] = SMALL) -> tuple[dict[str, Any], Path]:
    out = tmp_path / "map.nc"
    result = CliRunner().invoke(command, ["build", *axes, *more, "--out", str(out), "--json"], catch_exceptions=False)
    assert result.exit_code == 0
    return json.loads(result.stdout), out


def test_a_built_map_says_how_wrong_it_is(tmp_path: Path) -> None:
    values, out = build(tmp_path)
    rms_map = load_map(out)
    assert values["points"] == 12
    assert values["condition_error"] is None
    assert values["floor"] == "smooth"
    assert values["shape"] == [1, 1, 3, 4]
    assert values["solver"] == "rows"
    assert 0.0 < values["error_rms"] <= values["error_max"] < 1e-2
    assert 0.0 < values["interpolation_error"] < values["interpolation_error_max"]
    assert values["spread_floors"] is values["spread_rig"] is values["standard_error"] is None
    assert values["not_monotone_h_d"] == np.count_nonzero(rms_map.falling("h_d"))
    assert values["hash"] == rms_map.hash
    assert values["status"] == dict.fromkeys(STATUSES, 0) | {"converged": 12}
    assert values["nodes_inaccurate"] == values["nodes_not_periodic"] == 0
    with Dataset(out) as dataset:
        for axis in ("h_d", "dphi_d"):
            marks = dataset[f"not_monotone_{axis}"]
            assert np.array_equal(marks[...], rms_map.falling(axis))
            assert marks.flag_meanings == "not_falling falling"
            assert marks.flag_values.tolist() == [0, 1]


def test_floors_rigs_and_slip_go_into_the_map(tmp_path: Path) -> None:
    axes = [*SMALL[:4], "--dphi-deg", "2:6:2", "--h-d-um", "5:10:2", "--workers", "1"]
    axes += ["--interpolation-tolerance", "0"]
    more = ["--floor", "rough", "--floors", "3", "--rig-draws", "2", "--slip-deg", "0.5", "--slip-seed", "7"]
    values, out = build(tmp_path, *more, axes=axes)
    assert "1 µm after filtering" in values["floor"]
    assert "R = 10 µm" in values["floor"]
    plan = load_map(out).plan
    assert plan.slip is not None
    assert plan.slip.phi_slip == pytest.approx(np.radians(0.5))
    assert (plan.slip.seed, plan.slip.rule, plan.floors, plan.rig_draws) == (7, "per_passage", 3, 2)
    assert values["solver"] == "lanes"
    assert min(values[name] for name in ("spread_floors", "spread_rig", "standard_error")) > 0.0


def test_a_tolerance_refines_the_axes_and_a_bound_holds(tmp_path: Path) -> None:
    values, out = build(tmp_path, "--interpolation-tolerance", "0.02")
    assert values["interpolation_error"] <= 0.02
    assert values["points"] == load_map(out).rms.size > 12
    arguments = ["build", *SMALL, "--interpolation-tolerance", "1e-4", "--most-nodes", "20", "--out", str(out)]
    result = CliRunner().invoke(command, arguments, catch_exceptions=False)
    assert "not met" in result.stdout
    assert result.exit_code == 1
    assert load_map(out).rms.size <= 20
    advised = CliRunner().invoke(command, ["build", *SMALL, "--out", str(out)], catch_exceptions=False)
    assert "coarse" in advised.stdout
    assert advised.exit_code == 0
    with pytest.raises(InputError, match="more than the 5"):
        CliRunner().invoke(command, [*arguments, "--most-nodes", "5"], catch_exceptions=False)


def test_a_map_is_refined_unless_it_is_asked_not_to_be(tmp_path: Path) -> None:
    values, out = build(tmp_path, axes=[*AXES, "--dphi-deg", "3:6:3", "--h-d-um", "5:10:3"])
    assert values["interpolation_tolerance"] == 0.01
    assert values["interpolation_error"] <= 0.01
    assert values["points"] == load_map(out).rms.size > 9


@pytest.mark.parametrize(("fault", "radius"), [("inner", "r_i = 16.64 mm"), ("ball", "r_b = 3.56 mm")])
def test_a_map_of_another_part_says_its_part_and_its_volume(tmp_path: Path, fault: str, radius: str) -> None:
    axes = [*SMALL[:4], "--dphi-deg", "10:20:2", "--h-d-um", "8:12:2", "--interpolation-tolerance", "0"]
    values, out = build(tmp_path, "--fault", fault, axes=axes)
    assert values["fault"] == load_map(out).part == fault
    assert values["v_eq"].endswith(radius)
    assert values["solver"] == "time"
    assert values["nodes_not_periodic"] == 4
    assert 0.0 < values["standard_error"] <= values["standard_error_max"] <= 5e-3
    told = CliRunner().invoke(command, ["build", *axes, "--fault", fault, "--out", str(out)], catch_exceptions=False)
    assert radius in told.stdout
    assert "standard error" in told.stdout
    page = tmp_path / "map.html"
    CliRunner().invoke(command, ["show", str(out), "--out", str(page)], catch_exceptions=False)
    assert radius in page.read_text()


@pytest.mark.parametrize("fault", ["iner", "", "OUTER", "inner|ball"])
def test_an_unknown_part_is_refused_by_name(tmp_path: Path, fault: str) -> None:
    result = CliRunner().invoke(command, ["build", *SMALL, "--fault", fault, "--out", str(tmp_path / "x.nc")])
    assert result.exit_code == 2
    assert "--fault" in result.stderr
    assert "'outer', 'inner', 'ball'" in result.stderr


def test_show_draws_and_check_measures(tmp_path: Path) -> None:
    _, out = build(tmp_path, axes=[*SMALL, "--load-newton", "5000"])
    picture = tmp_path / "map.svg"
    shown = CliRunner().invoke(command, ["show", str(out), "--out", str(picture), "--json"], catch_exceptions=False)
    assert json.loads(shown.stdout)["points"] == 24
    assert "falls with depth" in picture.read_text()
    checked = CliRunner().invoke(command, ["check", str(out), "--points", "3", "--json"], catch_exceptions=False)
    values = json.loads(checked.stdout)
    assert 0.0 <= values["error_rms"] < 5e-3
    assert 0.0 < values["condition_rms"] <= values["condition_max"] < 0.1


@pytest.mark.parametrize(
    ("more", "word"),
    [
        (["--floors", "3"], "floors"),
        (["--slip-deg", "1"], "floors"),
        (["--rig-draws", "1"], "rig"),
        (["--fault", "ball", "--slip-deg", "1", "--floors", "2"], "slip moves a ball"),
        (["--fault", "ball", "--dphi-deg", "0:200:3"], "dphi_d of the ball"),
    ],
)
def test_contradictions_are_refused(tmp_path: Path, more: list[str], word: str) -> None:
    with pytest.raises(InputError, match=word):
        CliRunner().invoke(command, ["build", *SMALL, *more, "--out", str(tmp_path / "x.nc")], catch_exceptions=False)


def test_uneven_axes_are_tracked_like_even_ones(tmp_path: Path) -> None:
    """The closed form on a refined map, whose extents are not evenly spaced, against a scan of the same surface."""
    _, out = build(tmp_path, "--interpolation-tolerance", "0.02")
    rms_map = load_map(out)
    assert np.ptp(np.diff(rms_map.dphi_d)) > 1e-3
    surface = to_slice(rms_map, 4000.0, 40.0)
    radius = rms_map.part_radius
    for share in (0.2, 0.5, 0.8):
        level = share * surface.rms_max
        point = least_volume(surface, level, 0.0, 0.0)
        assert point is not None
        assert surface.value_at(point.dphi_d, point.h_d) == pytest.approx(level, rel=1e-9)
        scanned, slack = scan_least_volume(
            surface.dphi_d, surface.h_d, surface.rms, radius, level, (0.0, 0.0), lines=20
        )
        assert scanned - slack - 1e-15 <= point.v_eq <= scanned + 1e-15


MACHINE = """
[[bearing]]
name = "b"
designation = "6205"
[operating]
speed_hz = 40.0
load_newton = 4000.0
[[source]]
name = "s"
[[channel]]
name = "x"
source = "s"
unit = "g"
bearing = "b"
"""


SHAFT = """
[shaft]
length_mm = 500
unbalance_g_mm = 30
second_bearing = "b"
"""


@pytest.mark.parametrize(("claim", "line"), [("", "not calibrated on this machine"), ("declared", "declared")])
def test_a_map_by_another_model_takes_the_shaft(tmp_path: Path, claim: str, line: str) -> None:
    config = tmp_path / "machine.toml"
    config.write_text(MACHINE + SHAFT + (f'calibrated = "{claim}"\n' if claim else ""))
    values, out = build(tmp_path, "--config", str(config), "--model", "rotor")
    plan = load_map(out).plan
    assert isinstance(plan.rig, RotorRig)
    assert (plan.rig.length, plan.rig.a) == (0.5, 0.25)
    assert plan.second_bearing == plan.bearing
    assert (values["model"], values["model_version"], values["sensor"]) == ("rotor", 1, "a")
    assert values["left_out"] == ["shaft.unbalance_g_mm"]
    assert values["calibrated"] == (claim or False)
    assert values["rig"].startswith(f"rig of the model rotor, {line}")
    shown = ["show", str(out), "--out", str(tmp_path / "map.svg")]
    assert "of the model rotor" in CliRunner().invoke(command, shown, catch_exceptions=False).stdout
    assert "RMS of the shaft in bearing A (g)" in (tmp_path / "map.svg").read_text(encoding="utf-8")


def test_a_map_by_a_model_without_depth_is_refused(tmp_path: Path) -> None:
    config = tmp_path / "machine.toml"
    config.write_text(MACHINE)
    arguments = ["build", *SMALL, "--config", str(config), "--model", "ring_impact", "--out", str(tmp_path / "m.nc")]
    with pytest.raises(InputError, match="V_eq cannot be told by the model ring_impact"):
        CliRunner().invoke(command, arguments, catch_exceptions=False)


@pytest.mark.parametrize(
    ("rig", "calibrated", "line"),
    [
        ("", False, "rig not calibrated: masses and springs are those of the default test bench"),
        ("m_i_kg = 2.0\n", False, "rig not calibrated on this machine; V_eq is shown as a multiple of its first value"),
        ('calibrated = "declared"\n', "declared", "rig declared, not identified"),
        (
            f'calibrated = true\nidentification = "{"ab" * 32}"\n',
            True,
            "rig calibrated (identification abababababababab)",
        ),
    ],
)
def test_a_map_says_whose_rig_it_is_of_and_carries_it(tmp_path: Path, rig: str, calibrated: object, line: str) -> None:
    config = tmp_path / "machine.toml"
    config.write_text(MACHINE + (f"[rig]\n{rig}" if rig else ""))
    values, out = build(tmp_path, "--config", str(config))
    assert values["calibrated"] == calibrated
    assert values["rig"].startswith(line)
    assert load_map(out).plan.rig.calibrated == calibrated
    arguments = ["build", *SMALL, "--config", str(config), "--out", str(out)]
    assert line in CliRunner().invoke(command, arguments, catch_exceptions=False).stdout
    shown = ["show", str(out), "--out", str(tmp_path / "map.svg")]
    assert line in CliRunner().invoke(command, shown, catch_exceptions=False).stdout
