"""``[shaft]`` and ``axial_load_newton``: SI values for the models that take them, and what is refused."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from models.machine.bearing import catalogue_entry, kinematics
from models.machine.contact_estimates import estimate_stiffness
from models.machine.rig import Rig
from models.solve.angular.rig import AngularRig
from models.solve.ball_inertia.rig import BallInertiaRig
from models.solve.registry import RIGS
from models.solve.ring_impact.rig import RingImpactRig
from models.solve.rotor.rig import RotorRig
from monitor.config.load import Config, ConfigError, load_config, validate
from monitor.config.shaft import RIG_KEYS, SCENE_KEYS, ShaftSection
from tests.support.commands import run_command

SHAFT = {
    "length_mm": 800,
    "outer_diameter_mm": 30,
    "inner_diameter_mm": 20,
    "modulus_gpa": 206,
    "disc_mass_kg": 4.5,
    "disc_polar_inertia_kg_m2": 0.02,
    "disc_transverse_inertia_kg_m2": 0.015,
    "disc_from_a_mm": 300,
    "end_mass_kg": 0.2,
    "contact_damping_newton_s_per_m": 900,
    "damping_newton_s_per_m": 150,
    "tilt_damping_newton_m_s": 0.5,
    "internal_damping_s": 1e-5,
}
TURNED = {"unbalance_g_mm": 72, "couple_unbalance_kg_m2": 1e-6, "bow_um": 12, "second_bearing": "far"}


def values(shaft: dict[str, Any], **operating: Any) -> dict[str, Any]:
    return {
        "bearing": [{"name": "near", "designation": "6205"}, {"name": "far", "designation": "6305"}],
        "source": [{"name": "s"}],
        "channel": [{"name": "c", "source": "s", "unit": "g", "bearing": "near"}],
        "shaft": shaft,
        "operating": {"speed_hz": 25.0, "load_newton": 1000.0, **operating},
    }


def config_of(shaft: dict[str, Any], **operating: Any) -> Config:
    return validate(values(shaft, **operating), Path("m.toml"))


def test_parameters_are_those_of_the_section_in_si() -> None:
    config, near, far = config_of(SHAFT | TURNED), catalogue_entry("6205"), catalogue_entry("6305")
    rig = config.parameters_of(RotorRig, near)
    expected = RotorRig(
        m=4.5,
        j_p=0.02,
        j_t=0.015,
        length=0.8,
        a=0.3,
        shaft_diameter=(0.03**4 - 0.02**4) ** 0.25,
        modulus=206e9,
        end_mass=0.2,
        k_c=estimate_stiffness(near).value,
        k_c_b=estimate_stiffness(far).value,
        c_b=900.0,
        c_n=150.0,
        c_t=0.5,
        internal_damping=1e-5,
    )
    assert rig.as_dict() == {name: pytest.approx(value) for name, value in expected.as_dict().items()}
    found = config.parameters_of(BallInertiaRig, near)
    assert isinstance(found, BallInertiaRig)
    assert found.m_rotor == 4.5
    assert {name: value for name, (_, value) in config.scene_values().items()} == {
        "unbalance": pytest.approx(72e-6),
        "couple_unbalance": 1e-6,
        "bow": pytest.approx(12e-6),
        "second_bearing": far.bearing,
    }


OVER_ITS_ANGLE = {
    "elements": 6,
    "poisson": 0.28,
    "density_kg_per_m3": 7850,
    "coupling_newton_m_per_rad": 900,
    "coupling_inertia_kg_m2": 0.002,
    "load_torque_newton_m": 4,
    "damping_ratio": 0.03,
}


def test_the_shaft_over_its_angle_takes_its_section_and_its_couplings() -> None:
    expected = AngularRig(
        length=0.8,
        outer_diameter=0.03,
        inner_diameter=0.02,
        elements=6,
        modulus=206e9,
        poisson=0.28,
        density=7850.0,
        disc_mass=4.5,
        disc_polar=0.02,
        disc_across=0.015,
        coupling=900.0,
        end_inertia=0.002,
        load_torque=4.0,
        damping=0.03,
    )
    rig = config_of(SHAFT | OVER_ITS_ANGLE).parameters_of(AngularRig, catalogue_entry("6205"))
    assert rig.as_dict() == {
        name: pytest.approx(value) if isinstance(value, float) else value for name, value in expected.as_dict().items()
    }
    full = config_of({"outer_diameter_mm": 25}).parameters_of(AngularRig, catalogue_entry("6205"))
    assert isinstance(full, AngularRig)
    assert (full.outer_diameter, full.inner_diameter) == (0.025, 0.0)


def test_an_empty_section_leaves_everything_to_the_models() -> None:
    config, entry = config_of({}), catalogue_entry("6205")
    assert config.parameters_of(RotorRig, entry) == RotorRig(k_c=estimate_stiffness(entry).value)
    assert config.parameters_of(Rig, entry) == config.rig_of(entry)
    assert config.parameters_of(AngularRig, entry) == AngularRig()
    assert isinstance(config.parameters_of(RingImpactRig, entry), RingImpactRig)
    assert config.scene_values() == {}


def test_the_disc_stands_in_the_middle_unless_it_is_said() -> None:
    rig = config_of({"length_mm": 500}).parameters_of(RotorRig, catalogue_entry("6205"))
    assert isinstance(rig, RotorRig)
    assert (rig.length, rig.a) == (0.5, 0.25)


def test_a_declared_shaft_vouches_for_the_models_that_take_it() -> None:
    config, entry = config_of({"calibrated": "declared"}), catalogue_entry("6205")
    assert config.parameters_of(RotorRig, entry).calibrated == "declared"
    assert config.parameters_of(RingImpactRig, entry).calibrated is False
    assert config.rig_of(entry).calibrated is False


def test_every_key_is_taken_by_a_model_or_a_scene() -> None:
    taken = {key for keys in RIG_KEYS.values() for key in keys.values()} | set(SCENE_KEYS.values())
    assert set(ShaftSection.model_fields) - taken == {"second_bearing", "calibrated"}
    for model, keys in RIG_KEYS.items():
        assert set(keys) <= set(RIGS[model].__dataclass_fields__)


@pytest.mark.parametrize(
    ("shaft", "words"),
    [
        ({"length_mm": 0}, r"m.toml: shaft.length_mm = 0: expected a number greater than 0"),
        ({"disc_from_a_mm": 100}, "shaft: disc_from_a_mm needs length_mm"),
        ({"disc_from_a_mm": 100, "length_mm": 90}, "disc_from_a_mm must be less than length_mm, 90, got 100"),
        ({"inner_diameter_mm": 10}, "inner_diameter_mm needs outer_diameter_mm"),
        ({"inner_diameter_mm": 30, "outer_diameter_mm": 20}, "less than outer_diameter_mm, 20, got 30"),
        ({"elements": 3}, "shaft.elements = 3: .*multiple of 2"),
        ({"second_bearing": "none"}, r"\[shaft\] second_bearing 'none' is not one of far, near"),
        ({"calibrated": True}, "shaft.calibrated"),
        ({"lenght_mm": 3}, "did you mean 'length_mm'"),
    ],
)
def test_what_cannot_be_used_names_file_key_and_what_was_expected(shaft: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        config_of(shaft)


def test_records_do_not_depend_on_the_shaft() -> None:
    assert config_of({}).hash == config_of(SHAFT, axial_load_newton=-20.0).hash


FILE = """
[[bearing]]
name = "near"
designation = "6205"
[[bearing]]
name = "far"
designation = "6305"
[[source]]
name = "s"
[[channel]]
name = "c"
source = "s"
unit = "g"
bearing = "near"
[operating]
speed_hz = 25
load_newton = 1000
axial_load_newton = 200
[shaft]
length_mm = 800
disc_mass_kg = 4.5
unbalance_g_mm = 300
second_bearing = "far"
"""


def test_simulate_takes_the_shaft_and_an_option_takes_precedence(tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    path.write_text(FILE)
    assert load_config(path).shaft.length_mm == 800

    def simulated(*options: str) -> dict[str, Any]:
        done = run_command("simulate", "--config", path, "--duration-s", "0.3", "--json", *options)
        assert done.returncode == 0, done.stderr
        found: dict[str, Any] = json.loads(done.stdout)
        return found

    rotor = simulated("--model", "rotor")
    assert rotor["left_out"] == [{"effect": "operating.axial_load_newton", "bound": None}]
    same = simulated("--model", "rotor", "--unbalance-kg-m", "300e-6", "--parameter", "m=4.5")
    assert same["rms_g"] == rotor["rms_g"]
    assert simulated("--model", "rotor", "--unbalance-kg-m", "600e-6")["rms_g"] > rotor["rms_g"]
    assert simulated("--model", "rotor", "--parameter", "m=9")["rms_g"] != rotor["rms_g"]
    casing = simulated("--model", "six_dof")
    assert casing["bpfo_hz"] == pytest.approx(kinematics(catalogue_entry("6205").bearing, 25.0).bpfo)
    assert casing == simulated("--model", "six_dof", "--speed-hz", "25", "--load-newton", "1000")
    assert casing != simulated("--model", "six_dof", "--speed-hz", "25", "--load-newton", "4000")
    keys = ("shaft.unbalance_g_mm", "operating.axial_load_newton", "shaft.second_bearing")
    assert casing["left_out"] == [{"effect": key, "bound": None} for key in keys]


def test_check_says_which_models_take_the_shaft(tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    path.write_text(FILE)
    done = run_command("check", "--config", path)
    assert done.returncode == 0, done.stderr
    assert "shaft, for rotor: length_mm 800, disc_mass_kg 4.5\n" in done.stdout
    assert "shaft, for ball_inertia: disc_mass_kg 4.5\n" in done.stdout
    assert re.search(r"shaft.second_bearing far, taken by .*rotor", done.stdout)
    assert "operating.axial_load_newton 200.0, taken by " in done.stdout
