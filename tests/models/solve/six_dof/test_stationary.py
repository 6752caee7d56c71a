"""Mean levels of defects that turn: against long runs, and whether their errors are what they say."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from models.machine.bearing import from_catalogue, kinematics
from models.machine.rig import Rig
from models.machine.scene import Defect, Floor, Part, Scene, Slip, Waviness
from models.solve.six_dof.stationary import StationaryLevel, stationary_level
from models.solve.six_dof.stationary_record import line_frequency, steps_in_turn, take_record
from models.solve.six_dof.time_domain import simulate_time
from reference.signals import record_of
from tests.support.effort import effort_count

ACCURACY = 2e-3
LONG_S = effort_count(quick=2, full=10)
"""Duration of a long run."""


def scene_of(part: Part, dphi_deg: float, h_d_um: float) -> Scene:
    return Scene(40.0, 4000.0, defect=Defect(math.radians(dphi_deg), 1e-6 * h_d_um, part=part))


def level_of(scene: Scene, number: int = 0) -> StationaryLevel:
    return stationary_level(scene, accuracy=ACCURACY, number=number)


@pytest.mark.parametrize(
    ("part", "dphi_deg", "h_d_um"),
    [("inner", 2, 4), ("inner", 10, 24), ("inner", 30, 8), ("ball", 2, 4), ("ball", 10, 24), ("ball", 30, 8)],
)
def test_the_level_is_that_of_a_long_run_with_fine_steps(part: Part, dphi_deg: float, h_d_um: float) -> None:
    scene = scene_of(part, dphi_deg, h_d_um)
    level, long = level_of(scene), simulate_time(scene, LONG_S, 10000.0, step=5e-6)
    assert level.status == "not_periodic"
    assert level.rms_error <= ACCURACY
    assert level.rms_se <= 5e-3 * level.rms
    allowed = 3.0 * math.hypot(level.rms_se, long.rms_se) + level.rms_error * level.rms
    assert abs(level.rms - long.rms) < allowed < 0.015 * level.rms
    for k in (1, 2):
        line = record_of(long).line(k * line_frequency(scene))
        off = abs(level.harmonics[k - 1] - line)
        assert off < 0.03 * line + 4.0 * level.harmonics_se[k - 1] + level.rms_error * level.rms


@pytest.mark.parametrize(
    ("name", "scene", "duration"),
    [
        ("light, with clearance", Scene(40.0, 50.0, clearance=10e-6, defect=Defect(0.2, 1e-5, part="inner")), 4.0),
        ("fast", Scene(400.0, 4000.0, defect=Defect(0.2, 1e-5, part="inner")), 0.2),
        (
            "light masses",
            Scene(40.0, 4000.0, rig=Rig(m_i=0.12, m_o=0.19, m_r=0.1), defect=Defect(0.2, 1e-5, part="inner")),
            3.0,
        ),
        ("rough, on a ball", Scene(40.0, 4000.0, defect=Defect(0.2, 1e-5, Floor("rough"), part="ball")), 4.0),
        (
            "another bearing",
            Scene(25.0, 1000.0, bearing=from_catalogue("6205"), defect=Defect(0.3, 1e-5, part="ball")),
            6.0,
        ),
    ],
)
def test_other_rigs_are_as_good(name: str, scene: Scene, duration: float) -> None:
    level = level_of(scene)
    # The standard error of a shorter run is larger, and says so.
    duration /= effort_count(quick=2, full=1)
    long = simulate_time(scene, duration, 10000.0, step=4e-5 / scene.speed**0.5)
    allowed = 4.0 * math.hypot(level.rms_se, long.rms_se) + (level.rms_error + 1e-3) * level.rms
    assert abs(level.rms - long.rms) < allowed, name
    assert level.status == "not_periodic", name


@pytest.mark.parametrize("part", ["inner", "ball"])
def test_the_standard_error_is_the_scatter_of_independent_records(part: Part) -> None:
    """Over several scenes: the scatter between records in other phases, and the errors that they state."""
    ratios = []
    for dphi_deg, h_d_um in ((3, 12), (14, 6), (35, 16), (45, 28)):
        levels = [level_of(scene_of(part, dphi_deg, h_d_um), number) for number in range(effort_count(quick=5, full=8))]
        scatter = np.std([level.rms for level in levels], ddof=1)
        ratios.append(scatter / np.sqrt(np.mean([level.rms_se**2 for level in levels])))
    assert 0.3 < np.sqrt(np.mean(np.square(ratios))) < 1.5
    assert max(ratios) < 2.5


def test_steps_are_halved_until_the_accuracy_is_met() -> None:
    scene = scene_of("ball", 4, 20)
    found = [stationary_level(scene, accuracy=accuracy) for accuracy in (2e-3, 2e-4)]
    assert found[1].rms_error <= 2e-4 < found[0].rms_error <= 2e-3
    assert abs(found[0].rms / found[1].rms - 1.0) < found[0].rms_error + found[1].rms_error
    impossible = stationary_level(scene, accuracy=1e-9)
    assert impossible.status == "inaccurate"
    assert impossible.rms_error > 1e-9


def test_a_smaller_standard_error_is_paid_with_more_turns() -> None:
    scene = scene_of("ball", 2, 4)
    less = 5e-4 * effort_count(quick=2, full=1)
    loose, tight = (stationary_level(scene, accuracy=ACCURACY, standard_error=asked) for asked in (5e-3, less))
    assert tight.rms_se <= less * tight.rms < loose.rms_se
    assert tight.turns > 2 * loose.turns
    assert abs(loose.rms - tight.rms) < 4.0 * math.hypot(loose.rms_se, tight.rms_se)


def test_narrow_defects_get_steps_of_their_own() -> None:
    """A ball turns by 1 degree in 27 microseconds, less than two steps that the rig alone asks for."""
    wide, narrow = scene_of("ball", 10, 20), scene_of("ball", 1, 20)
    lines = kinematics(wide.bearing, wide.speed)
    assert steps_in_turn(narrow, lines, None) > 3 * steps_in_turn(wide, lines, None)
    assert steps_in_turn(wide, lines, (0.0, 40e3)) >= 40e3 / (0.4 * lines.ftf)
    level, long = level_of(narrow), simulate_time(narrow, 2.0, 10000.0, step=2.5e-6)
    assert level.rms == pytest.approx(long.rms, rel=0.02)


def test_a_floor_out_of_reach_is_one_scene() -> None:
    assert level_of(scene_of("inner", 2, 30)) is level_of(scene_of("inner", 2, 32))
    assert level_of(scene_of("inner", 2, 30)).rms > 1.1 * level_of(scene_of("inner", 2, 6)).rms


def test_a_band_leaves_the_lines_and_takes_from_the_level() -> None:
    scene = scene_of("inner", 20, 12)
    full, half = (stationary_level(scene, accuracy=ACCURACY, band=band) for band in (None, (0.0, 5000.0)))
    rest = stationary_level(scene, accuracy=ACCURACY, band=(5000.0, 24000.0))
    assert half.harmonics == pytest.approx(full.harmonics)
    assert 0.0 < half.rms < full.rms
    assert math.hypot(half.rms, rest.rms) == pytest.approx(full.rms, rel=2e-3)


def test_rough_floors_and_slip_are_drawn() -> None:
    scene = scene_of("inner", 20, 6)
    assert scene.defect is not None
    rough = replace(scene, defect=replace(scene.defect, floor=Floor("rough", seed=3)))
    slipping = replace(scene, slip=Slip(0.01, seed=5))
    smooth = level_of(scene)
    for other in (rough, slipping):
        level, again = level_of(other), level_of(replace(other, load=4000.5))
        assert abs(level.rms - smooth.rms) > 5.0 * level.rms_se
        assert level.rms == pytest.approx(again.rms, rel=0.02)
    long = simulate_time(slipping, LONG_S, 10000.0)
    level = level_of(slipping)
    assert abs(level.rms - long.rms) < 4.0 * math.hypot(level.rms_se, long.rms_se) + ACCURACY * level.rms


def test_phases_near_a_simple_fraction_are_filled_by_more_records() -> None:
    """A roller of the 22207 spins 6.328 times in a turn of the cage: one record visits little more than thirds."""
    bearing = from_catalogue("22207")
    assert bearing.element == "roller"
    rig = Rig(k_c=5e8, element="roller")
    scene = Scene(40.0, 4000.0, bearing=bearing, rig=rig, defect=Defect(0.3, 10e-6, part="ball"))
    level, long = level_of(scene), simulate_time(scene, 0.6 * LONG_S, 10000.0, step=5e-6)
    lines = kinematics(bearing, 40.0)
    one = len(take_record(scene, steps_in_turn(scene, lines, None), 12, None).turns)
    assert level.turns >= 2 * one
    assert abs(level.rms - long.rms) < 4.0 * math.hypot(level.rms_se, long.rms_se) + level.rms_error * level.rms


@pytest.mark.parametrize(
    ("scene", "word"),
    [
        (Scene(40.0, 4000.0), "inner race or of a ball"),
        (scene_of("inner", 0, 5), "inner race or of a ball"),
        (Scene(40.0, 4000.0, defect=Defect(0.1, 1e-5)), "inner race or of a ball"),
        (replace(scene_of("inner", 5, 5), waviness=(Waviness(1e-6, 3),)), "waviness"),
        (replace(scene_of("inner", 5, 5), unbalance=1e-3), "unbalance"),
        (replace(scene_of("ball", 5, 5), slip=Slip(0.01)), "slip"),
        (replace(scene_of("inner", 5, 5), slip=Slip(0.01, "mean_force")), "mean_force"),
        (replace(scene_of("inner", 5, 5), speed=0.02), "too low"),
    ],
)
def test_what_it_does_not_describe_is_refused(scene: Scene, word: str) -> None:
    with pytest.raises(ValueError, match=word):
        level_of(scene)


@pytest.mark.parametrize(
    ("accuracy", "standard_error", "band", "word"),
    [
        (0.0, 5e-3, None, "accuracy"),
        (ACCURACY, math.nan, None, "standard_error"),
        (ACCURACY, 5e-3, (3000.0, 2000.0), "band"),
    ],
)
def test_arguments_are_checked(
    accuracy: float, standard_error: float, band: tuple[float, float] | None, word: str
) -> None:
    with pytest.raises(ValueError, match=word):
        stationary_level(scene_of("inner", 5, 5), accuracy=accuracy, standard_error=standard_error, band=band)
