"""Derivatives of a motion that repeats: against differences of answers, and withheld where there are none."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.machine.bearing import from_catalogue
from models.machine.rig import Rig
from models.machine.scene import Defect, Floor, Scene, Slip, Waviness
from models.solve.simulate import simulate
from models.solve.six_dof.setup import DERIVATIVES, OF_DEFECT, OF_RIG
from tests.support.effort import effort_count

ANSWER: dict[str, Any] = {"accuracy": 1e-8}
BALLS = Scene(40.0, 3000.0, defect=Defect(0.05, 3e-5, position=0.2), clearance=5e-6, gravity=9.8, gravity_angle=0.5)
SHALLOW = Scene(40.0, 3000.0, defect=Defect(0.01, 2e-6))
WAVES = replace(SHALLOW, waviness=(Waviness(1e-7, 20),), speed=25.0, clearance=2e-6)
ROLLERS = Scene(
    40.0,
    1000.0,
    bearing=from_catalogue("NU 202 ECP"),
    rig=Rig(k_c=5e8, element="roller"),
    defect=Defect(0.02, 2e-6),
    clearance=1e-6,
)


def moved(scene: Scene, name: str, by: float) -> tuple[Scene, float]:
    """Return a scene, and the direction of its sensor, with a parameter that is larger."""
    if name == "direction":
        return scene, by
    if name in OF_RIG:
        return replace(scene, rig=replace(scene.rig, **{name: getattr(scene.rig, name) + by})), 0.0
    if name in OF_DEFECT:
        assert scene.defect is not None
        return replace(scene, defect=replace(scene.defect, **{name: getattr(scene.defect, name) + by})), 0.0
    return replace(scene, **{name: getattr(scene, name) + by}), 0.0


def size_of(scene: Scene, name: str) -> float:
    if name in ("direction", "position", "gravity_angle"):
        return 1.0
    owner: Any = scene.rig if name in OF_RIG else scene.defect if name in OF_DEFECT else scene
    return float(getattr(owner, name))


def differences(scene: Scene, name: str, share: float = 1e-4, **asked: Any) -> np.ndarray:
    """Return RMS and lines by a parameter from four answers, by the differences of fourth order."""
    by, found = share * size_of(scene, name), []
    for k in (-2.0, -1.0, 1.0, 2.0):
        other, direction = moved(scene, name, k * by)
        answer = simulate(other, direction=direction, **ANSWER, **asked)
        found.append(np.append(answer.rms, answer.harmonics))
    return (8.0 * (found[2] - found[1]) - (found[3] - found[0])) / (12.0 * by)


def check(scene: Scene, names: tuple[str, ...], bound: float, **asked: Any) -> None:
    """Compare derivatives with differences, as parts of the RMS over the size of the parameter, or of themselves."""
    answer = simulate(scene, derivatives=names, **ANSWER, **asked)
    for name in names:
        one, truth = answer.derivatives[name], differences(scene, name, **asked)
        assert one.status != "withheld"
        found = np.append(one.rms, one.harmonics)
        unit = max(answer.rms / size_of(scene, name), float(np.max(np.abs(truth))))
        assert np.max(np.abs(found - truth)) <= bound * unit, name
        assert one.rms_error <= bound * unit


@settings(max_examples=effort_count(quick=2, full=30))
@given(
    load=st.floats(300.0, 6000.0),
    speed=st.floats(15.0, 60.0),
    extent=st.floats(0.005, 0.08),
    depth=st.floats(1e-6, 2e-5),
    name=st.sampled_from(sorted(set(DERIVATIVES) - {"gravity", "gravity_angle"})),
)
def test_of_any_scene_they_are_the_differences_of_answers(
    load: float, speed: float, extent: float, depth: float, name: str
) -> None:
    scene = Scene(speed, load, defect=Defect(extent, depth, position=0.1), clearance=2e-6)
    answer = simulate(scene, derivatives=(name,), **ANSWER)
    if answer.derivatives[name].status == "withheld" or answer.status != "converged":
        return
    check(scene, (name,), 2e-5)


CONTACTS = {
    "balls": (BALLS, ("load", "k_r", "h_d", "dphi_d", "position")),
    "rollers": (ROLLERS, ("load", "dphi_d", "position")),
    "waves": (WAVES, ("position",)),
}


@pytest.mark.parametrize("name", CONTACTS)
def test_they_hold_where_contacts_open_and_close(name: str) -> None:
    scene, names = CONTACTS[name]
    check(scene, names, 2e-5)


def test_of_a_band_at_the_resonator() -> None:
    check(BALLS, ("load", "k_r", "speed"), 2e-5, band=(500.0, 6000.0), sensor="mr")


@pytest.mark.parametrize("scene", [BALLS, ROLLERS], ids=["balls", "rollers"])
def test_their_errors_bound_the_true_ones_and_fall_with_the_accuracy(scene: Scene) -> None:
    names = ("load", "k_c", "dphi_d")
    truth = simulate(scene, accuracy=1e-8, derivatives=names).derivatives
    for accuracy in (1e-3, 1e-5):
        found = simulate(scene, accuracy=accuracy, derivatives=names)
        for name in names:
            one = found.derivatives[name]
            assert one.status == "checked"
            unit = max(abs(one.rms), found.rms / size_of(scene, name))
            assert one.rms_error <= accuracy * unit
            assert abs(one.rms - truth[name].rms) <= 3.0 * accuracy * unit


def test_what_a_sensor_turns_out_of_needs_no_motion() -> None:
    """In a direction, the square of the RMS is a quadratic form: its second derivative follows from three answers."""
    rms = [simulate(BALLS, direction=angle, **ANSWER).rms for angle in (0.0, 0.25 * math.pi, 0.5 * math.pi)]
    across = rms[1] ** 2 - 0.5 * (rms[0] ** 2 + rms[2] ** 2)
    found = simulate(BALLS, derivatives=("direction",), **ANSWER).derivatives["direction"]
    assert found.rms == pytest.approx(across / rms[0], rel=1e-6)


def test_unknown_names_and_scenes_without_derivatives_are_refused() -> None:
    with pytest.raises(ValueError, match=r"unknown parameter 'mass'; known are: m_i, .*position"):
        simulate(BALLS, derivatives=("mass",))
    with pytest.raises(ValueError, match="h_d belongs to a defect of the outer race, and there is none"):
        simulate(BALLS.healthy, derivatives=("h_d",))
    with pytest.raises(ValueError, match=r"six_dof \(time_domain\) has none; six_dof \(periodic\) has"):
        simulate(replace(BALLS, slip=Slip(0.01)), derivatives=("load",))


def test_what_has_none_is_withheld_with_a_reason() -> None:
    rough = replace(SHALLOW, defect=Defect(0.02, 1e-5, Floor("rough", sd=1e-6)))
    found = simulate(rough, derivatives=("position", "load")).derivatives
    assert (found["position"].status, math.isnan(found["position"].rms)) == ("withheld", True)
    assert "rough floor" in found["position"].why
    assert found["load"].status == "checked"
