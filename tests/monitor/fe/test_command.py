"""``spallwatch bearing --fe``: what is printed and drawn beside the analytic answer, and what is refused.

The bodies are computed elsewhere (tests/models/fe). Here the element's law is the analytic one and its contacts are
those of Hertz, so that both answers are known to agree.
"""

from __future__ import annotations

import json
import math
import sys
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from click.testing import CliRunner

import models.fe.bearings.bearing
import spallwatch as sw
from models.fe.bearings.assembly import AssembledBearing, FeBearing
from models.fe.bearings.element import RACES, FeContact, Progress
from models.fe.bearings.law import ElementLaw
from models.fe.bearings.oblique import ObliqueGeometry
from models.fe.bearings.oblique_bodies import fitted_law
from models.fe.bearings.self_aligning import ObliqueResult, RowInfluence, SelfAligning
from models.fe.extra import has_extra
from models.fe.meshes.geometry import FeGeometry, Race
from models.fe.meshes.sizing import NAMED_RULES, half_sizes
from models.fe.solid.condense import ContactCells
from models.fe.solid.cost import check_memory
from models.machine.bearing import from_catalogue
from models.machine.hertz import contact_stiffness
from models.words.errors import WrongInputError
from monitor.commands.bearing.command import command
from monitor.commands.common import InputError
from monitor.fe.values import fe_lines

ROLLER, BALL, SELF_ALIGNING = "NU 202 ECP", "6210", "1205 ETN9"
MESH_ERROR = 0.004

pytestmark = pytest.mark.skipif(not has_extra(), reason="needs the extra fe (scikit-fem)")


def hertz_contact(geometry: FeGeometry, race: Race, force: float) -> FeContact:
    length, width = half_sizes(geometry, race, force)
    line = geometry.element == "roller"
    x, z = np.linspace(0.0, 1.5 * width, 25), np.linspace(0.0, length if line else 1.2 * length, 13)
    cells = ContactCells.grid(x, z)
    at_x, at_z = 0.5 * (cells.x0 + cells.x1), 0.5 * (cells.z0 + cells.z1)
    shape = 1.0 - (at_x / width) ** 2 - (0.0 if line else (at_z / length) ** 2)
    pressure = np.sqrt(np.maximum(shape, 0.0))
    pressure *= 0.25 * force / float(pressure @ cells.area)
    return FeContact(cells, pressure, force, 4e-6, length, width, length, width, cast("Any", None))


def analytic_bearing(
    geometry: FeGeometry, load: float, *, clearance: float, cache: Any, progress: Any, highest: float = 1e6, **rest: Any
) -> FeBearing:
    """Stand for the meshes: the law that the command prints as the analytic one."""
    progress("inner ring", 0, 1)
    check_memory(20_000, "inner ring")
    exponent = 10.0 / 9.0 if geometry.element == "roller" else 1.5
    k_c = contact_stiffness(from_catalogue({"roller": ROLLER, "ball": BALL}[geometry.element]))
    law = replace(ElementLaw.from_power(k_c, exponent, 1e-3, highest), mesh_error=MESH_ERROR)
    assembled = AssembledBearing(law, geometry.n_elements, clearance)
    top = float(assembled.state(load).loads.max())
    contacts: dict[Race, FeContact] = {race: hertz_contact(geometry, race, top) for race in RACES}
    return FeBearing(assembled, contacts, {"inner ring": 20_000, "outer ring": 18_000, geometry.element: 9_000})


@pytest.fixture(autouse=True)
def _analytic_bodies(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(models.fe.bearings.bearing, "fe_bearing", analytic_bearing)
    monkeypatch.setattr("monitor.commands.bearing.command.published_figures", lambda designation: [])
    # Each state costs milliseconds, and a command takes hundreds.
    whole = AssembledBearing.stiffness_over_passage
    monkeypatch.setattr(
        AssembledBearing, "stiffness_over_passage", lambda self, load, points=0: whole(self, load, points=24)
    )
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def invoke(*options: str) -> Any:
    return CliRunner().invoke(command, [*options, "--fe"], catch_exceptions=False)


@cache
def values(*options: str) -> dict[str, Any]:
    result = invoke(*options, "--json")
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


@pytest.mark.parametrize("designation", [ROLLER, BALL])
def test_both_answers_stand_side_by_side_and_agree(designation: str) -> None:
    whole = values(designation, "--load-newton", "2500")
    found = whole["fe"]
    assert found["status"] == "converged"
    assert found["mesh_error_percent"] == pytest.approx(100.0 * MESH_ERROR)
    for key in ("k_xx_newton_per_m", "k_yy_newton_per_m", "displacement_um", "largest_element_load_newton"):
        assert found[key] == pytest.approx(whole[key], rel=0.01)
    rows = {row["quantity"]: row for row in found["beside"]}
    assert len(rows) == len(found["beside"]) >= 15
    for words, row in rows.items():
        if "largest" not in words and "swing" not in words:
            assert row["difference_percent"] == pytest.approx(0.0, abs=3.0), words
    assert [row["load_newton"] for row in found["radial_stiffness"]] == [625.0, 1250.0, 2500.0, 5000.0, 10000.0]
    assert sum(element["load_newton"] > 0.0 for element in found["load_distribution"]) == 5
    for ours, theirs in zip(found["load_distribution"], whole["load_distribution"], strict=True):
        assert ours["angle_deg"] == pytest.approx(theirs["angle_deg"])


def test_the_law_is_said_with_the_exponent_of_hertz() -> None:
    ball, roller = (values(name, "--load-newton", "2500")["fe"] for name in (BALL, ROLLER))
    assert ball["exponent"] == pytest.approx(1.5)
    assert ball["k_c_newton_per_m15"] == pytest.approx(contact_stiffness(from_catalogue(BALL)), rel=1e-6)
    low, high = roller["k_c_range_newton_per_m109"]
    assert low == pytest.approx(high)
    assert low == pytest.approx(roller["k_c_newton_per_m109"])


def test_the_pressure_in_the_middle_is_that_of_hertz() -> None:
    """From the force that the cells carry, as a cell holds the mean over its width."""
    for designation in (ROLLER, BALL):
        for contact in values(designation, "--load-newton", "2500")["fe"]["contacts"].values():
            assert contact["middle_pressure_mpa"] == pytest.approx(contact["hertz_pressure_mpa"], rel=0.01)
            assert contact["largest_pressure_mpa"] < 1.05 * contact["hertz_pressure_mpa"]


def test_with_clearance_the_load_zone_is_smaller() -> None:
    tight, loose = (values(ROLLER, "--load-newton", "2500", *more)["fe"] for more in ([], ["--clearance-um", "20"]))
    assert loose["load_zone_deg"] < tight["load_zone_deg"]
    assert loose["displacement_um"] > tight["displacement_um"] + 20.0


def test_a_load_beyond_the_meshes_has_a_status_and_no_stiffness(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(models.fe.bearings.bearing, "fe_bearing", partial(analytic_bearing, highest=300.0))
    found = values.__wrapped__(ROLLER, "--load-newton", "2500")["fe"]
    assert found["status"] == "outside_law"
    assert found["k_xx_newton_per_m"] is None
    assert found["stiffness_over_passage"]["k_yy_swing_percent"] is None
    known = [row["k_yy_newton_per_m"] is not None for row in found["radial_stiffness"]]
    assert known == [True, False, False, False, False]
    text = "\n".join(fe_lines(found))
    assert "outside_law (an element carries more than the meshes were made for)" in text
    assert "not computed: beyond the loads of the meshes" in text


def test_people_read_the_same_and_get_a_sheet_and_a_rig(tmp_path: Path) -> None:
    sheet, rig = tmp_path / "bearing.png", tmp_path / "rig.toml"
    text = invoke(ROLLER, "--load-newton", "2500", "--plot", str(sheet), "--write-rig", str(rig)).stdout
    assert "finite elements     rigid-shaft, default mesh: converged; mesh error 0.4 %" in text
    assert "inner ring 20,000, outer ring 18,000, roller 9,000" in text
    line = next(line for line in text.splitlines() if "stiffness across the load, k_xx, MN/m" in line)
    analytic, found = (float(word) for word in line.split()[-4:-2])
    assert found == pytest.approx(analytic, rel=0.01)
    assert sheet.read_bytes()[1:4] == b"PNG"
    written = tomllib.loads(rig.read_text())["rig"]
    assert written["bearing"] == ROLLER
    assert written["k_c_newton_per_m109"] == pytest.approx(contact_stiffness(from_catalogue(ROLLER)), rel=0.02)


def test_estimated_dimensions_are_named() -> None:
    estimated = ["inner_race_radius", "outer_race_radius", "inner_groove_radius", "outer_groove_radius"]
    assert sorted(values("6205")["fe"]["estimated"]) == sorted(estimated)
    assert values(BALL, "--load-newton", "2500")["fe"]["estimated"] == []


def test_a_stiffness_without_status_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(models.fe.bearings.bearing, "fe_bearing", partial(analytic_bearing, highest=300.0))
    with pytest.raises(InputError, match=r"--write-rig .*: there is no contact stiffness to write: outside_law"):
        invoke(ROLLER, "--load-newton", "2500", "--write-rig", str(tmp_path / "rig.toml"))
    assert not (tmp_path / "rig.toml").exists()


def test_a_shaft_is_read_before_anything_is_computed(tmp_path: Path) -> None:
    path = tmp_path / "shaft.toml"
    path.write_text("[[step]]\nlength = 5\n")
    with pytest.raises(WrongInputError, match=r"shaft\.toml:2: step\[0\]\.length"):
        invoke(ROLLER, "--shaft", str(path))


def test_options_of_finite_elements_need_them() -> None:
    for options in (["--fe-mesh", "fine"], ["--memory-gb", "2"], ["--no-cache"], ["--write-rig", "x"]):
        with pytest.raises(InputError, match=f"^{options[0]}: only with --fe$"):
            CliRunner().invoke(command, [ROLLER, *options], catch_exceptions=False)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([ROLLER, "--memory-gb", "0.001"], r"inner ring of 20,000 unknowns needs about .* \(bound of 0.001 GB"),
        ([ROLLER, "--axial-load-newton", "100"], "--fe and --axial-load-newton: finite elements take a radial load"),
        ([ROLLER, "--plot", "picture.gif"], "--plot picture.gif: expected a name that ends in .png, .svg or .html"),
        (["no such bearing"], "no such bearing"),
    ],
)
def test_what_cannot_be_computed_is_refused(options: list[str], words: str) -> None:
    with pytest.raises(WrongInputError, match=words):
        invoke(*options)


@pytest.mark.parametrize(
    ("designation", "reason"),
    [
        ("30205", "tapered rollers touch both races at different angles"),
        ("22207", "barrel rollers"),
        ("7205", "one row"),
    ],
)
def test_bearings_of_other_kinds_are_refused_with_the_reason(designation: str, reason: str) -> None:
    with pytest.raises(WrongInputError, match=f"^{designation}: .*{reason}"):
        invoke(designation, "--load-newton", "2000")


def test_a_self_aligning_bearing_has_two_rows_and_no_symmetric_contact(monkeypatch: pytest.MonkeyPatch) -> None:
    def rows(
        geometry: ObliqueGeometry, loads: Sequence[float], *, asymmetry: bool, progress: Progress
    ) -> ObliqueResult:
        assert not asymmetry
        progress("inner contact", 0, 1)
        forces = np.geomspace(10.0, max(loads), 5)
        law = fitted_law(forces, (forces / 5.45e9) ** (2.0 / 3.0) * (1.0 + 1e-3 * np.array([1, -1, 0, 1, -1])))
        alone = RowInfluence.none(geometry.n_elements)
        bearing = SelfAligning(law.law(), geometry.n_elements, geometry.contact_angle, alone)
        return ObliqueResult(bearing, law, {"inner ring": 50_000}, 1e-4)

    monkeypatch.setattr("models.fe.bearings.self_aligning.oblique_bearing", rows)
    whole = values.__wrapped__(SELF_ALIGNING, "--load-newton", "4000")
    found = whole["fe"]
    assert found["status"] == "converged"
    assert len(found["load_distribution"]) == len(whole["load_distribution"]) == 24
    assert found["contacts"] == {}
    assert found["mesh_error_percent"] == pytest.approx(0.1, rel=0.3)
    held = whole["stiffness_over_passage"]["k_xx_swing_percent"]
    assert found["stiffness_over_passage"]["k_xx_swing_percent"] == pytest.approx(held, abs=0.5)
    # A ring that moves along the shaft presses an element across the load too, which evens the stiffness.
    assert 0.5 * held < found["k_xx_swing_axially_free_percent"] < 0.8 * held
    assert "the ring is held along the shaft; free, k_xx swings by" in "\n".join(fe_lines(found))
    assert values.__wrapped__(SELF_ALIGNING, "--load-newton", "4000")["fe"]["from_cache"]
    with pytest.raises(InputError, match="takes --fe-support rigid-shaft and --fe-mesh default"):
        invoke(SELF_ALIGNING, "--fe-mesh", "fine")


@pytest.mark.parametrize("load", ["0", "-5", "nan"])
def test_a_load_that_is_none_is_refused(load: str) -> None:
    assert invoke(ROLLER, "--load-newton", load).exit_code == 2


def test_without_the_extra_the_command_that_installs_it_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "skfem", None)
    with pytest.raises(WrongInputError, match=r'pip install "spallwatch\[fe\]"'):
        invoke(ROLLER)
    # All else is as ever.
    assert CliRunner().invoke(command, [ROLLER], catch_exceptions=False).exit_code == 0


OWN = """
[[bearing]]
name = "own"
n_elements = 10
element_diameter_mm = 12.7
pitch_diameter_mm = 70.05
inner_groove_radius_mm = 6.55
outer_groove_radius_mm = 6.55
[operating]
speed_hz = 40
load_newton = 3000
[[source]]
name = "s"
[[channel]]
name = "x"
source = "s"
unit = "g"
bearing = "own"
"""


def test_dimensions_that_are_unknown_are_named_and_can_be_configured(tmp_path: Path) -> None:
    path = tmp_path / "machine.toml"
    path.write_text(OWN)
    with pytest.raises(WrongInputError, match=r"own: dimensions \(bore, outside diameter, width\) are unknown"):
        invoke("--config", str(path))
    path.write_text(OWN.replace("[operating]", "bore_mm = 50\noutside_mm = 90\nwidth_mm = 20\n[operating]"))
    assert values("--config", str(path))["fe"]["status"] == "converged"


def test_the_python_interface_gives_the_same() -> None:
    found = sw.fe_stiffness(ROLLER, load_newton=2500.0)
    answer = values(ROLLER, "--load-newton", "2500")["fe"]
    assert found.attrs["status"] == "converged"
    assert found.stiffness.sel(axis="along", axis_of_force="along").mean() == pytest.approx(answer["k_yy_newton_per_m"])
    assert found.element_load.max() == pytest.approx(answer["largest_element_load_newton"])
    assert found.attrs["k_c_newton_per_m109"] == pytest.approx(answer["k_c_newton_per_m109"])
    assert math.degrees(float(found.cage_angle[1])) < 2.0
    with pytest.raises(WrongInputError, match="load_newton must be positive"):
        sw.fe_stiffness(ROLLER, load_newton=0.0)
    with pytest.raises(WrongInputError, match="no such"):
        sw.fe_stiffness("no such", load_newton=1.0)


def test_rules_go_from_coarse_to_fine() -> None:
    sizes = [rule.size for rule in NAMED_RULES.values()]
    assert list(NAMED_RULES) == ["coarse", "default", "fine"]
    assert sizes == sorted(sizes, reverse=True)
