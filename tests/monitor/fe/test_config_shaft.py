"""The file of a shaft for finite elements, and what the command says of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from models.fe.meshes.shaft_mesh import ShaftMeshRule
from models.machine.contact_estimates import estimate_stiffness
from monitor.config.load import ConfigError
from monitor.fe.shaft import ShaftFile, SupportSection, read_shaft, shaft_lines, shaft_values

THESIS = Path(__file__).parents[3] / "examples" / "parts" / "shaft.toml"
SMALL = """
[[step]]
length_mm = 200.0
diameter_mm = 20.0
[load]
from_mm = 0.0
to_mm = 10.0
[[support]]
from_mm = 80.0
to_mm = 90.0
bearing = "NU 202 ECP"
[[support]]
from_mm = 180.0
to_mm = 190.0
bearing = "6210"
clearance_um = 5.0
"""


def read(tmp_path: Path, text: str) -> str:
    """Return the problems of a file, without its path."""
    path = tmp_path / "shaft.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError) as raised:
        read_shaft(path)
    return str(raised.value).replace(str(path), "FILE")


def test_shaft_file_of_benchmark() -> None:
    shaft = read_shaft(THESIS)
    assert shaft.length == pytest.approx(0.318)
    assert [support.seat.middle for support in shaft.supports] == pytest.approx([0.0715, 0.2665])
    assert shaft.loaded.end == pytest.approx(0.014)


def test_shaft_file_problems(tmp_path: Path) -> None:
    assert read(tmp_path, SMALL.replace("diameter_mm = 20.0", "diameter_mm = -1")).startswith(
        "FILE:4: step[0].diameter_mm = -1: expected"
    )
    assert "bore_mm must be less than diameter_mm, 20" in read(
        tmp_path, SMALL.replace("diameter_mm = 20.0", "diameter_mm = 20.0\nbore_mm = 20.0")
    )
    assert "to_mm must be more than from_mm, 80" in read(tmp_path, SMALL.replace("to_mm = 90.0", "to_mm = 70.0"))
    assert "'support0'" in read(tmp_path, SMALL.replace("to_mm = 90.0", "to_mm = 185.0"))
    assert "bearing: " in read(tmp_path, SMALL.replace("6210", "nothing of this name"))
    assert "k_c_newton_per_m15 is that of a ball" in read(
        tmp_path, SMALL.replace('ECP"', 'ECP"\nk_c_newton_per_m15 = 1e9')
    )
    assert "FILE: cannot be read" in read_missing(tmp_path)


def read_missing(tmp_path: Path) -> str:
    """Return the problem of a file that is not there."""
    path = tmp_path / "missing.toml"
    with pytest.raises(ConfigError) as raised:
        read_shaft(path)
    return str(raised.value).replace(str(path), "FILE")


def test_support_stiffness_given() -> None:
    plain = SupportSection(from_mm=0.0, to_mm=1.0, bearing="NU 202 ECP")
    k_c = estimate_stiffness(plain.to_entry()).value
    twice = plain.model_copy(update={"k_c_newton_per_m109": 2.0 * k_c})
    assert twice.to_support().spring.force(1e-6)[0] == pytest.approx(2.0 * plain.to_support().spring.force(1e-6)[0])


def test_shaft_values(tmp_path: Path) -> None:
    pytest.importorskip("skfem", reason="needs the extra fe")
    path = tmp_path / "shaft.toml"
    path.write_text(SMALL, encoding="utf-8")
    values = shaft_values(read_shaft(path), 500.0, ShaftMeshRule(size=1.0, finest=0.25))
    assert values["status"] == "converged"
    assert 0.0 < values["mesh_error_percent"] < 10.0
    over = [one["k_i_newton_per_m"] for one in values["against_load"]]
    assert over == sorted(over)
    assert values["k_i_newton_per_m"] == over[2]
    lines = list(shaft_lines(values))
    assert lines[0].startswith(f"shaft: k_i {over[2] / 1e6:.4g} MN/m at its end")
    assert len(lines) == 3


def test_shaft_file_refuses_unknown_keys() -> None:
    with pytest.raises(ValueError, match="material"):
        ShaftFile.model_validate({"material": "steel"})
