"""What a scene cannot be made of: every field of every part refuses what is senseless, and names itself."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Any

import pytest

from models.machine.bearing import from_catalogue
from models.machine.rig import Rig
from models.machine.scene import Defect, Floor, Scene, Slip, Waviness
from models.solve.simulate import simulate
from models.solve.six_dof.periodic import effort_for
from models.solve.six_dof.setup import HIGHEST_RESONANCE, MOST_STEPS, steps_for
from models.words.request import Request

NAN, INF = math.nan, math.inf
ROLLERS = from_catalogue("NU 202 ECP")

GOOD: dict[type, dict[str, Any]] = {
    Rig: {},
    Floor: {"kind": "rough"},
    Defect: {"dphi_d": 0.1, "h_d": 1e-5},
    Waviness: {"amplitude": 1e-6, "order": 9},
    Slip: {"phi_slip": 0.01},
    Scene: {"speed": 40.0, "load": 4000.0},
}
POSITIVE, NOT_NEGATIVE, FINITE = (0.0, -1.0, NAN, INF), (-1e-9, NAN, INF, -INF), (NAN, INF, -INF)
WHOLE_FROM_0, WHOLE_FROM_1 = (-1, 0.5, 2.5, NAN, INF, True), (0, -1, 1.5, NAN, INF, True)

BAD: dict[type, dict[str, tuple[Any, ...]]] = {
    Rig: {
        **dict.fromkeys(("m_i", "m_o", "m_r", "k_i", "k_r", "k_c"), POSITIVE),
        **dict.fromkeys(("m_b", "c_i", "c_r", "alpha_c", "beta_c"), NOT_NEGATIVE),
        "element": ("balls", "", "cone"),
    },
    Floor: {
        "kind": ("ruogh", "Rough", ""),
        "sd": NOT_NEGATIVE,
        "pitch": POSITIVE,
        "cutoff": POSITIVE,
        "seed": WHOLE_FROM_0,
    },
    Defect: {
        "dphi_d": (-0.1, 6.2832, NAN, INF),
        "h_d": (-1e-9, NAN, -INF),
        "position": FINITE,
        "rows": WHOLE_FROM_1,
        "part": ("innner", "", "race"),
        "first_row": WHOLE_FROM_0,
        "width": (0.0, -0.1, 3.2, NAN, INF),
        "support": ("c", ""),
    },
    Waviness: {"amplitude": FINITE, "order": WHOLE_FROM_1, "race": ("outter", ""), "phase": FINITE},
    Slip: {"phi_slip": (-1e-9, 0.5, NAN, INF), "rule": ("sometimes", ""), "seed": WHOLE_FROM_0},
    Scene: {
        "speed": POSITIVE,
        **dict.fromkeys(("load", "clearance", "unbalance", "gravity", "couple_unbalance", "bow"), NOT_NEGATIVE),
        **dict.fromkeys(("gravity_angle", "axial_load", "speed_slope"), FINITE),
        "physics": (("gyroscope",), ("casing", "")),
    },
}
CASES = [(kind, name, value) for kind, named in BAD.items() for name, values in named.items() for value in values]
# Fields that hold another part, a switch, or a name that is looked up when the scene is simulated.
LEFT = {
    (Rig, "calibrated"),
    (Rig, "identification"),
    (Defect, "floor"),
    *((Scene, n) for n in ("bearing", "rig", "defect", "more_defects", "model", "waviness", "slip", "second_bearing")),
    (Scene, "load_turns"),
    (Scene, "speed_profile"),
}


@pytest.mark.parametrize(("kind", "name", "value"), CASES, ids=[f"{k.__name__}.{n}={v!r}" for k, n, v in CASES])
def test_a_senseless_value_is_refused_by_the_name_of_its_field(kind: type, name: str, value: object) -> None:
    good = kind(**GOOD[kind])
    with pytest.raises(ValueError, match=rf"\b{name} must"):
        kind(**{**GOOD[kind], name: value})
    with pytest.raises(ValueError, match=rf"\b{name} must"):
        replace(good, **{name: value})


def test_every_field_is_validated() -> None:
    """A field that is added needs values that it refuses, or a reason to be left."""
    for kind, named in BAD.items():
        left = {name for owner, name in LEFT if owner is kind}
        assert {field.name for field in fields(kind)} == set(named) | left, kind


def test_the_ends_of_what_is_allowed_are_allowed() -> None:
    Defect(0.0, 0.0)
    Defect(2.0 * math.pi, INF)
    Floor("rough", sd=0.0, seed=0)
    Slip(0.0)
    Rig(m_b=0.0, c_i=0.0, c_r=0.0, alpha_c=0.0, beta_c=0.0)
    Scene(1e-3, 0.0, clearance=0.0)


@pytest.mark.parametrize(("rows", "first_row"), [(3, 0), (2, 1), (1, 2)])
def test_rows_that_the_bearing_has_not_are_refused(rows: int, first_row: int) -> None:
    with pytest.raises(ValueError, match=r"defect\.rows .* defect\.first_row"):
        Scene(40.0, 4000.0, defect=Defect(0.1, 1e-5, rows=rows, first_row=first_row))


def test_further_defects_are_checked_as_the_first() -> None:
    first, other = Defect(0.1, 1e-5), Defect(0.2, 1e-5, part="inner")
    scene = Scene(40.0, 4000.0, defect=first, more_defects=(other, replace(first, position=0.11)))
    assert scene.defects == (first, other, replace(first, position=0.11))
    assert scene.healthy.defects == ()
    with pytest.raises(ValueError, match=r"more_defects must be empty"):
        replace(scene, defect=None)
    with pytest.raises(ValueError, match=r"more_defects\[0\]\.rows 1 from more_defects\[0\]\.first_row 2"):
        replace(scene, more_defects=(replace(first, first_row=2),))
    with pytest.raises(ValueError, match=r"more_defects\[1\]\.position must lie apart .*outer\), got 0\.09 rad"):
        replace(scene, more_defects=(other, replace(first, position=0.09)))
    # Around the race, in another row, or without size there is room.
    with pytest.raises(ValueError, match=r"more_defects\[0\]\.position"):
        replace(scene, more_defects=(replace(first, position=2.0 * math.pi - 0.05),))
    replace(scene, more_defects=(replace(first, first_row=1), replace(first, h_d=0.0)))


def test_the_stiffness_of_a_ball_is_not_taken_for_that_of_a_roller() -> None:
    with pytest.raises(ValueError, match=r"rig\.k_c is that of a ball, NU 202 ECP has rollers"):
        Scene(40.0, 4000.0, bearing=ROLLERS)
    with pytest.raises(ValueError, match=r"rig\.k_c is that of a roller, 1205 ETN9 has balls"):
        Scene(40.0, 4000.0, rig=Rig(element="roller"))


@pytest.mark.parametrize(("rig", "speed"), [(Rig(beta_c=0.1), 0.5), (Rig(alpha_c=1e9), 0.5)])
def test_a_speed_too_low_for_the_rig_is_refused_with_steps_and_limit(rig: Rig, speed: float) -> None:
    scene = Scene(speed, 4000.0, rig=rig)
    with pytest.raises(
        ValueError, match=rf"needs (\d+) steps .* at most {MOST_STEPS // 2} .* speed, {speed}"
    ) as caught:
        simulate(scene)
    named = int(str(caught.value).split("needs ")[1].split()[0])
    assert named > MOST_STEPS // 2
    # The number that it needs falls with the speed, and where it is within the limit the scene is taken.
    faster = replace(scene, speed=speed * 1.01 * named / (MOST_STEPS // 2))
    assert steps_for(faster) <= MOST_STEPS // 2


def test_a_speed_too_low_for_the_highest_resonance_is_refused_with_it() -> None:
    scene = Scene(0.4, 4000.0, rig=Rig(k_r=4.25e12))
    with pytest.raises(ValueError, match=r"resonance of the rig, .* times the ball rate .* speed, 0\.4 Hz") as caught:
        simulate(scene)
    times = float(str(caught.value).split("Hz, is ")[1].split()[0])
    effort = effort_for(replace(scene, speed=scene.speed * 1.02 * times / HIGHEST_RESONANCE), Request())
    assert effort.steps > 64
