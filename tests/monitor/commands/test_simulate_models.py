"""``spallwatch simulate`` with other models: their parameters and sensors, and all that describe a scene."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from click.testing import CliRunner

from models.machine.bearing import catalogue_entry
from models.machine.contact_estimates import estimate_stiffness
from models.machine.hertz import in_series
from models.machine.rig import Rig
from models.machine.scene import Scene
from models.solve.ball_inertia.rig import BallInertiaRig
from models.solve.registry import MODELS, solvers
from models.solve.response import Response
from models.solve.rotor.rig import RotorRig
from monitor.commands.simulate.command import command
from monitor.commands.simulate.scene import request_of, simulated
from monitor.config.load import validate
from tests.support.effort import effort_count

pytestmark = pytest.mark.usefixtures("empty_directory")

ACCURACY = "0.1" if effort_count(quick=1, full=0) else "0.02"
SHORT = ["--bearing", "6305", "--speed-hz", "20", "--load-newton", "500", "--accuracy", ACCURACY, "--duration-s", "0.3"]
DAMAGED = [*SHORT, "--dphi-deg", "3", "--h-d-um", "20"]


Answer = Callable[[Scene, dict[str, Any]], Response]


@pytest.fixture(autouse=True, scope="module")
def answers_once() -> Iterator[Answer]:
    """Solve each scene once: comparisons of this module ask for the same ones again."""
    kept: dict[str, Response] = {}

    def once(scene: Scene, options: dict[str, Any]) -> Response:
        key = repr((scene, request_of(options)))
        if key not in kept:
            kept[key] = simulated(scene, options)
        return kept[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("monitor.commands.simulate.scene.simulated", once)
        patch.setattr("monitor.commands.simulate.command.simulated", once)
        yield once


def simulate(*options: str) -> dict[str, Any]:
    result = CliRunner().invoke(command, [*options, "--json"], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def refusal(*options: str) -> str:
    result = CliRunner().invoke(command, list(options))
    assert result.exit_code != 0
    return result.output + str(result.exception)


@pytest.mark.parametrize("model", list(MODELS))
def test_a_named_model_takes_its_own_parameters_and_first_sensor(model: str) -> None:
    found = simulate(*DAMAGED, "--model", model)
    assert (found["model"], found["why"]) == (model, None)
    assert found["rms_g"] > 0.0
    assert (found["rms_resonator_g"] is None) == (solvers(model)[0].rig is not Rig)


def test_auto_takes_the_model_that_has_what_the_scene_names() -> None:
    found = simulate(*SHORT, "--second-bearing", "6305", "--sensor", "c")
    assert (found["model"], found["sensor"]) == ("rotor", "c")
    assert "bearing at the other support" in found["why"]
    assert simulate(*DAMAGED)["model"] == "six_dof"


def test_contacts_are_those_of_the_bearing() -> None:
    values: dict[str, Any] = {
        "bearing": [{"name": "x", "designation": "6205"}],
        "source": [{"name": "s"}],
        "channel": [{"name": "c", "source": "s", "unit": "g", "bearing": "x"}],
    }
    config = validate(values, Path("m.toml"))
    for name in ("6205", "6305"):
        entry = catalogue_entry(name)
        found, expected = config.parameters_of(BallInertiaRig, entry), estimate_stiffness(entry).value
        assert isinstance(found, BallInertiaRig)
        assert in_series(found.k_ci, found.k_co, 1.5) == pytest.approx(expected)
        rotor = config.parameters_of(RotorRig, entry)
        assert isinstance(rotor, RotorRig)
        assert rotor.k_c == pytest.approx(expected)


def test_a_parameter_is_set_by_its_name() -> None:
    plain = simulate(*DAMAGED, "--model", "rotor")
    assert simulate(*DAMAGED, "--model", "rotor", "--parameter", f"m={RotorRig.m}")["rms_g"] == plain["rms_g"]
    heavy = simulate(*DAMAGED, "--model", "rotor", "--parameter", "m=10", "--parameter", "j_t=2.4")
    assert heavy["rms_g"] != plain["rms_g"]


def test_a_defect_of_the_other_support_is_heard_there() -> None:
    both = ["--second-bearing", "6305", "--model", "rotor"]
    near, far = (simulate(*DAMAGED, *both, "--support", "b", "--sensor", sensor)["rms_g"] for sensor in ("b", "a"))
    assert near > 1.2 * far


def test_all_models_that_describe_a_scene_are_compared(tmp_path: Path) -> None:
    picture = tmp_path / "compared.html"
    found = simulate(*DAMAGED, "--compare", "--plot", str(picture))
    models = {row["model"] for row in found["models"]}
    assert {"six_dof", "rotor"} <= models
    assert models | set(found["refused"]) == set(MODELS)
    for row in found["models"]:
        level = row["rms_rad_s" if row["sensor"] == "ias" else "rms_g"]
        assert level is None if row["status"] == "uncalibrated" else level > 0.0
    assert [row["model"] for row in found["models"] if row["status"] == "uncalibrated"] == ["ring_impact"]
    page = picture.read_text(encoding="utf-8")
    assert all(f"{model} (" in page for model in models)


def test_levels_without_a_unit_are_not_given_in_g() -> None:
    alone, others = (
        CliRunner().invoke(command, [*DAMAGED, *asked], catch_exceptions=False).stdout.splitlines()
        for asked in (["--model", "ring_impact"], ["--compare"])
    )
    assert alone[0].startswith("uncalibrated after")
    assert "(no unit)" in alone[0]
    assert not any(line.endswith(" g") for line in alone)
    row = next(line for line in others if line.startswith("ring_impact "))
    assert "uncalibrated" in row
    assert " g" not in row
    for lines in (alone, others):
        assert any(line.startswith("ring_impact: levels without a unit") for line in lines)


def test_what_lacks_effects_of_a_compared_scene_is_said() -> None:
    found = simulate(*DAMAGED, "--fault", "inner", "--gravity", "--compare")
    assert found["refused"]["rotor"] == "does not describe gravity"


def test_times_of_a_comparison_leave_out_the_first_call(monkeypatch: pytest.MonkeyPatch, answers_once: Answer) -> None:
    """The first call of each model takes a minute of processor time, as compiling may; the second 10 ms."""
    now, compiled = [0.0], set[str | None]()

    def slow_at_first(scene: Scene, options: dict[str, Any]) -> Response:
        now[0] += 0.01 if scene.model in compiled else 60.0
        compiled.add(scene.model)
        return answers_once(scene, options)

    clock = SimpleNamespace(process_time=lambda: now[0])
    monkeypatch.setattr("monitor.commands.simulate.scene.time", clock)
    monkeypatch.setattr("monitor.commands.simulate.scene.simulated", slow_at_first)
    found = simulate(*DAMAGED, "--compare")
    assert {row["model"] for row in found["models"]} == compiled
    assert [row["seconds"] for row in found["models"]] == pytest.approx([0.01] * len(compiled))


def test_a_picture_of_a_rotor_shows_its_orbits(tmp_path: Path) -> None:
    picture = tmp_path / "rotor.html"
    unbalanced = ["--clearance-um", "11", "--unbalance-kg-m", "5e-4", "--plot", str(picture)]
    simulate("--bearing", "6305", "--load-newton", "100", "--duration-s", "0.3", "--model", "rotor", *unbalanced)
    page = picture.read_text(encoding="utf-8")
    assert "Orbits of 3 points of the shaft: A " in page
    assert all(f"along_{point}_um" in page for point in "abc")
    assert "Circle: the radial clearance" in page
    simulate(*DAMAGED, "--plot", str(picture))
    page = picture.read_text(encoding="utf-8")
    assert "Orbits" not in page
    assert "Shaded: a ball is between the edges" in page
    assert "The way over the damage" in page


def test_a_picture_of_the_angular_speed_has_its_unit(tmp_path: Path) -> None:
    found = simulate(*DAMAGED, "--model", "angular", "--sensor", "ias", "--plot", str(tmp_path / "speed.html"))
    page = (tmp_path / "speed.html").read_text(encoding="utf-8")
    assert "angular_speed_rad_s" in page
    assert "acceleration" not in page
    assert f"RMS {found['rms_rad_s']:.3g} rad/s" in page


def test_a_picture_of_another_model_shows_no_way_and_no_passages_that_it_does_not_have(tmp_path: Path) -> None:
    """Its record begins after settling, at any angle of the cage, and its balls do not follow the contour."""
    picture = tmp_path / "rotor.html"
    assert simulate(*DAMAGED, "--model", "rotor", "--plot", str(picture))["status"] == "converged"
    page = picture.read_text(encoding="utf-8")
    assert "Shaded: a ball is between the edges" not in page
    assert "The way over the damage" not in page


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--model", "rotor", "--parameter", "weight=3"], "--parameter weight: rotor has m, j_p"),
        (["--model", "rotor", "--parameter", "m=heavy"], "--parameter m: expected such as 5.0, got 'heavy'"),
        (["--model", "rotor", "--parameter", "m=-1"], "rig.m must be positive"),
        (["--model", "rotor", "--parameter", "m"], "is not NAME=VALUE"),
        (["--model", "rotor", "--sensor", "mo"], "sensor 'mo': this model has a, b, c"),
        (["--support", "b", "--dphi-deg", "3", "--h-d-um", "20"], "support is 'b', but there is no second_bearing"),
        (
            ["--model", "six_dof", "--bow-um", "3"],
            "bow: six_dof does not describe this",
        ),
        (["--compare", "--sensor", "a"], "--sensor belongs to one model"),
        (["--compare", "--bow-um", "3", "--gravity"], "no model describes"),
        (["--second-bearing", "none"], "none"),
    ],
)
def test_what_cannot_be_asked_is_refused_by_name(options: list[str], words: str) -> None:
    assert words in refusal(*SHORT, *options)


@pytest.mark.parametrize("quantity", ["rms", "waveform", "lines", "v_eq"])
def test_the_accuracy_is_that_of_the_quantity(quantity: str) -> None:
    defect = ["--dphi-deg", "6", "--h-d-um", "10"]
    values = simulate(*defect, "--quantity", quantity, "--accuracy", "0.001")
    assert (values["quantity"], values["status"]) == (quantity, "converged")
    assert values["error"] <= 1e-3
    shown = CliRunner().invoke(command, [*defect, "--quantity", quantity]).output
    assert (f"(error of {quantity} " in shown) == (quantity != "rms")


def test_a_volume_without_a_defect_is_refused() -> None:
    assert "quantity 'v_eq' needs a scene with one defect" in refusal("--quantity", "v_eq")
