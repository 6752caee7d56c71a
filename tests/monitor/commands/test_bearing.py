from __future__ import annotations

import json
import subprocess
from typing import Any

import pytest

from tests.commands import run_command


def call(*arguments: str) -> subprocess.CompletedProcess[str]:
    return run_command("bearing", *arguments)


def run(*arguments: str) -> str:
    result = call(*arguments)
    assert result.returncode == 0, result.stderr
    return result.stdout


def values(*arguments: str) -> dict[str, Any]:
    return json.loads(run(*arguments, "--json"))


def test_keys_of_every_bearing_are_the_same() -> None:
    known, unknown = values(), values("--bearing", "6205")
    # The exponent is part of one name, and both are balls.
    assert set(known) == set(unknown)
    for key in ("k_xx_newton_per_m", "load_distribution", "stiffness_over_passage", "contact_areas_um", "l10h_days"):
        assert known[key] is not None
        assert unknown[key] is None
    assert unknown["published"] == []


def test_loads_of_the_elements_carry_the_load() -> None:
    found = values("--load-newton", "2000", "--clearance-um", "10")
    angles = [row["angle_deg"] for row in found["load_distribution"]]
    assert angles == sorted(angles)
    assert len(angles) == 24
    loads = [row["load_newton"] for row in found["load_distribution"]]
    assert max(loads) == found["largest_element_load_newton"]
    assert found["load_zone_deg"] < 180.0


def test_radial_stiffness_rises_with_the_load() -> None:
    rows = values("--load-newton", "1000")["radial_stiffness"]
    assert [row["load_newton"] for row in rows] == [250.0, 500.0, 1000.0, 2000.0, 4000.0]
    stiffness = [row["k_yy_newton_per_m"] for row in rows]
    assert stiffness == sorted(stiffness)
    assert stiffness[2] == pytest.approx(152.9e6, rel=1e-3)


def test_a_defect_swings_the_stiffness() -> None:
    found = values("--load-newton", "1000", "--dphi-deg", "6.366")
    healthy, damaged = found["stiffness_over_passage"], found["stiffness_over_damaged_passage"]
    assert healthy["k_yy_swing_percent"] < 0.02
    assert damaged["k_yy_least_newton_per_m"] / healthy["k_yy_largest_newton_per_m"] == pytest.approx(0.875, abs=1e-3)
    assert values("--load-newton", "1000")["stiffness_over_damaged_passage"] is None


def test_rollers() -> None:
    found = values("--bearing", "NU 202 ECP", "--clearance-um", "20")
    assert found["k_c_geometry_newton_per_m109"] == pytest.approx(172549 * 1e3 ** (10 / 9), rel=1e-5)
    assert found["k_c_elliptic_newton_per_m15"] is None
    assert found["contact_areas_um"]["inner"]["half_length"] == pytest.approx(2800.0)
    refused = call("--bearing", "NU 202 ECP", "--dphi-deg", "3")
    assert refused.returncode == 2
    assert "rollers" in refused.stderr
    assert "Traceback" not in refused.stderr


def test_published_figures_stand_beside_ours() -> None:
    rows = values()["published"]
    assert {row["verdict"] for row in rows} == {"reproduced", "close", "not reproduced"}
    printed = next(row for row in rows if row["place"] == "Table 17" and row["condition"] == "1000 N")
    assert printed["printed"] == 102.3
    assert printed["difference_percent"] == pytest.approx(-0.33, abs=0.01)
    assert "printed figures" in run()
