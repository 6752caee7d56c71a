from __future__ import annotations

import json
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from models.machine.contact_estimates import LINE_CONTACTS
from tests.support.commands import run_command


@cache
def call(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command, once for the same arguments: a configuration in a test's own folder is never the same."""
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
    for key in ("k_c_geometry_newton_per_m15", "l10h_days"):
        assert known[key] is not None
        assert unknown[key] is None
    assert known["k_c_estimate_newton_per_m15"] is None
    estimate = unknown["k_c_estimate_newton_per_m15"]
    assert estimate["low"] < estimate["value"] < estimate["high"]
    assert "inner_groove_radius" in estimate["estimated"]
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
    damaged = values("--bearing", "NU 202 ECP", "--dphi-deg", "3")
    assert damaged["stiffness_over_damaged_passage"]["k_yy_least_newton_per_m"] < (
        0.9 * damaged["stiffness_over_passage"]["k_yy_least_newton_per_m"]
    )


def test_formulas_of_the_line_contact_stand_beside_each_other() -> None:
    found = {name: values("NU205", "--load-newton", "2000", "--line-contact", name) for name in LINE_CONTACTS}
    formulas = found["palmgren"]["k_c_line_contact_newton_per_m109"]
    assert set(formulas) == set(LINE_CONTACTS)
    for name, answer in found.items():
        # What is chosen is what the rest is computed with.
        assert answer["k_c_estimate_newton_per_m109"]["value"] == formulas[name]["value"]
        softer = formulas["palmgren"]["value"] / formulas[name]["value"]
        assert answer["displacement_um"] / found["palmgren"]["displacement_um"] == pytest.approx(softer**0.9, rel=1e-6)
    assert formulas["lundberg"]["value"] < formulas["houpert"]["value"] < formulas["palmgren"]["value"]
    assert "lundberg 3.08e+08" in run("NU205", "--load-newton", "2000")
    assert values("6205")["k_c_line_contact_newton_per_m109"] is None


def test_a_configured_stiffness_of_rollers_is_used(tmp_path: Path) -> None:
    config = tmp_path / "config.toml"
    text = Path("config.toml").read_text(encoding="utf-8")
    text = text.replace("[rig]", '[rig]\nbearing = "support_drive"\nk_c_newton_per_m109 = 2e8', 1)
    config.write_text(text, encoding="utf-8")
    found, other = (values(*of, "--bearing", "support_drive") for of in (("--config", str(config)), ()))
    assert found["k_c_newton_per_m109"] == 2e8
    assert other["k_c_newton_per_m109"] is None
    softer = other["k_c_estimate_newton_per_m109"]["value"] / 2e8
    assert found["displacement_um"] == pytest.approx(softer**0.9 * other["displacement_um"], rel=1e-6)
    assert "2e+08 N/m^(10/9) (configured)" in run("--config", str(config), "--bearing", "support_drive")


def test_a_needle_bearing_by_its_geometry(tmp_path: Path) -> None:
    """NK 20/16: 16 needles of 2.5 x 9.8 mm; the configuration has no other dimension of it."""
    config = tmp_path / "config.toml"
    needle = 'name = "needle"\nelement = "roller"\nn_elements = 16\nelement_diameter_mm = 2.5\n'
    lengths = "pitch_diameter_mm = 22.5\nelement_length_mm = 9.8\n"
    text = Path("config.toml").read_text(encoding="utf-8")
    config.write_text(text.replace("[rig]", f"[[bearing]]\n{needle}{lengths}\n[rig]"), encoding="utf-8")
    found = values("--config", str(config), "--bearing", "needle")
    palmgren = 8.06e10 * 9.8e-3 ** (8 / 9) / 2 ** (10 / 9)
    assert found["k_c_geometry_newton_per_m109"] == pytest.approx(palmgren, rel=1e-9)
    assert found["k_c_line_contact_newton_per_m109"]["houpert"]["value"] == pytest.approx(palmgren, rel=0.1)
    assert found["k_yy_newton_per_m"] is not None
    assert found["bpfo_hz"] == pytest.approx(0.5 * 16 * 40.0 * (1.0 - 2.5 / 22.5))


def test_published_figures_stand_beside_ours() -> None:
    rows = values()["published"]
    assert {row["verdict"] for row in rows} == {"reproduced", "close", "not reproduced"}
    printed = next(row for row in rows if row["place"] == "Table 17" and row["condition"] == "1000 N")
    assert printed["printed"] == 102.3
    assert printed["difference_percent"] == pytest.approx(-0.33, abs=0.01)
    assert "printed figures" in run()


def test_a_designation_of_the_series_says_what_is_estimated() -> None:
    text = run("NU205")
    assert "number of elements         13" in text
    assert "(estimated)" in text
    assert "13 (85 %), 12 (8 %), 14 (8 %)" in text
    assert "outer|ball: naming may answer with both" in text
    assert "20 to 45 um by ISO 5753-1" in text
    found = values("NU205")
    assert found["geometry"]["element_diameter"]["source"] == "estimated"
    assert found["geometry"]["element_diameter"]["value"] == pytest.approx(6.5)
    assert found["geometry"]["dynamic_load_rating"]["source"] == "table"
    assert 0.0 < found["bpfo_uncertainty"] < found["bsf_uncertainty"]
    assert found["l10h_days"] is not None


def test_suffixes_of_a_measured_bearing_change_its_clearance_alone() -> None:
    plain, suffixed = values("6205"), values("6205-2RS/C3")
    assert plain["clearance_range_um"] == pytest.approx([5.0, 20.0])
    assert suffixed["clearance_range_um"] == pytest.approx([13.0, 28.0])
    assert suffixed["suffixes"] == ["2RS: seals on both sides", "C3: radial clearance larger than normal"]
    assert suffixed["bpfo_hz"] == plain["bpfo_hz"]
    assert {row["source"] for row in plain["geometry"].values()} == {"measured"}
    assert plain["bpfo_uncertainty"] == 0.0


def test_the_support_bearing_of_the_example_is_an_estimate() -> None:
    found = values("22207")
    assert found["geometry"]["n_elements"]["source"] == "estimated"
    assert found["count_probabilities"]["15"] == pytest.approx(0.65)
    estimate = found["k_c_estimate_newton_per_m109"]
    assert estimate["low"] < estimate["value"] < estimate["high"]
    assert found["k_xx_newton_per_m"] is not None


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("6205-QX",), ("unknown suffix 'QX'", "2RS1")),
        (("9999",), ("'9999' is not in the catalogue", "6200 to 6221")),
        (("6205", "--bearing", "6206"), ("give one of them",)),
    ],
)
def test_a_designation_that_is_unknown(arguments: tuple[str, ...], words: tuple[str, ...]) -> None:
    result = call(*arguments)
    assert result.returncode == 2
    for word in words:
        assert word in result.stderr
