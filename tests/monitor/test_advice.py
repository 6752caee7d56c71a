"""What is said of a channel: the state first, then the part, then the level, and no more than the evidence bears."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.config.load import Config, ConfigError, validate
from monitor.health.schema import TT_STATUSES, TTA_STATUSES
from monitor.words.advice import ADVICE, Statement, advice_key, check_advice, state_of, status_line
from monitor.words.situation import Forecast, Situation
from monitor.words.statuses import STATES
from tests.support.config import MINIMAL

DAY = 86400.0
HEALTHY = Situation("x", "drive", stage="healthy")
FINAL = Situation(
    "x",
    "drive",
    state="maintenance_required",
    stage="final",
    fault="outer",
    basis="verdict",
    unverified=False,
    snr=12.0,
    blocks=214,
    level=3.1,
    to_alarm=Forecast("ok", 6 * DAY, 3 * DAY, 9 * DAY, "alert"),
    bearing_fault="outer",
    bearing_basis="verdict",
    support=0.93,
    channels=2,
)
SURE = (
    "sure: named since the onset, 214 blocks ago, lines 12 times the noise floor, 93 % of the evidence of 2 channels, "
    "the shaft speed is known"
)
TT = Forecast("ok", 20 * DAY, 14 * DAY, 30 * DAY)


def load(**more: Any) -> Config:
    return validate({**MINIMAL, **more}, Path("machine.toml"))


CASES: dict[str, tuple[Situation, str, str, str, str, str]] = {
    "healthy": (HEALTHY, "normal", "healthy so far", "", "", "nothing to do"),
    "learning": (
        Situation("x", "drive", state="check_function", stage="learning"),
        "learning",
        "still learning what healthy is",
        "",
        "",
        ADVICE["learning"],
    ),
    "a hint": (
        replace(HEALTHY, fault="outer", basis="hint", unverified=True, snr=4.04, level=1.05),
        "watch",
        "healthy so far; a pattern of the outer race of bearing drive (hint)",
        "only a hint: named without an onset of damage, lines 4.0 times the noise floor, "
        "the shaft speed is only stated",
        "level at the baseline",
        "look at the trends of channel x at the next inspection",
    ),
    "a wheel": (
        replace(HEALTHY, gear="gear:pinion", gear_kind="tooth", level=1.05),
        "gear",
        "healthy so far; damage of gear pinion (a damaged tooth)",
        "",
        "level at the baseline",
        "inspect gear pinion at the next planned stop; no part of bearing drive is named",
    ),
    "a wheel as loud as the end of a life": (
        replace(HEALTHY, stage="end_of_life", severity="danger", gear="gear:a|b", level=6.0),
        "gear",
        "danger, end of life reached; no part named; damage of gear a or b",
        "",
        "level 6.0 times the baseline",
        "inspect gear a or b without delay; no part of bearing drive is named",
    ),
    "a wheel beside a bearing": (
        replace(FINAL, gear="gear:pinion"),
        "warning",
        "final stage of its life: outer race of bearing drive; damage of gear pinion",
        SURE,
        "level 3.1 times the baseline, rising, the alert in 6 d (3 d to 9 d)",
        "inspect bearing drive and plan its exchange within 3 d, the earliest that the alert may be reached",
    ),
    "a hint while learning": (
        Situation("x", "drive", state="check_function", stage="learning", fault="inner|ball", basis="hint"),
        "learning",
        "still learning what healthy is; a pattern of the inner race or rolling element of bearing drive (hint)",
        "only a hint: named before a baseline is learned",
        "",
        ADVICE["learning"],
    ),
    "sure": (
        FINAL,
        "warning",
        "final stage of its life: outer race of bearing drive",
        SURE,
        "level 3.1 times the baseline, rising, the alert in 6 d (3 d to 9 d)",
        "inspect bearing drive and plan its exchange within 3 d, the earliest that the alert may be reached",
    ),
    "with a threshold": (
        replace(FINAL, to_threshold=TT),
        "warning",
        "final stage of its life: outer race of bearing drive",
        SURE,
        "level 3.1 times the baseline, rising, the alert in 6 d (3 d to 9 d), "
        "the threshold of damage in 20 d (14 d to 30 d)",
        "inspect bearing drive and plan its exchange within 14 d, the earliest that the threshold of damage may be "
        "reached",
    ),
    "no forecast": (
        replace(FINAL, to_alarm=Forecast("no_trend"), level=1.6),
        "warning",
        "final stage of its life: outer race of bearing drive",
        SURE,
        "level 1.6 times the baseline, no clear rise",
        "inspect bearing drive and plan its exchange at the next planned stop",
    ),
    "a danger stands": (
        replace(FINAL, severity="danger", to_alarm=Forecast("reached", 0.0, to="danger")),
        "danger",
        "danger, final stage of its life: outer race of bearing drive",
        SURE,
        "level 3.1 times the baseline, the danger is reached",
        "inspect bearing drive as soon as it can be reached, and exchange it at the next planned stop",
    ),
    "crossed": (
        replace(FINAL, to_threshold=Forecast("already_crossed")),
        "warning",
        "final stage of its life: outer race of bearing drive",
        SURE,
        "level 3.1 times the baseline, rising, the alert in 6 d (3 d to 9 d), the threshold of damage is reached",
        "inspect bearing drive and plan its exchange without delay: the threshold of damage is reached",
    ),
    "disagreement": (
        replace(FINAL, disagreement={"y": "inner"}, to_alarm=Forecast("too_few_points"), level=math.nan),
        "warning",
        "final stage of its life: outer race of bearing drive",
        "likely: named since the onset, 214 blocks ago, lines 12 times the noise floor, "
        "93 % of the evidence of 2 channels, y says inner race, the shaft speed is known",
        "too few blocks yet for a trend",
        "inspect bearing drive and plan its exchange at the next planned stop",
    ),
    "undecided": (
        replace(
            FINAL, fault="undecided", candidates=("outer", "ball"), unverified=True, bearing_fault=None, support=None
        ),
        "warning",
        "final stage of its life: outer race or rolling element of bearing drive (not decided which)",
        "not decided: named since the onset, 214 blocks ago, lines 12 times the noise floor, "
        "the shaft speed is only stated",
        "level 3.1 times the baseline, rising, the alert in 6 d (3 d to 9 d)",
        "inspect bearing drive and plan its exchange within 3 d, the earliest that the alert may be reached",
    ),
    "no part": (
        Situation("x", "drive", "maintenance_required", "final", level=2.0, to_alarm=Forecast("beyond_horizon")),
        "warning",
        "final stage of its life; no part named",
        "",
        "level 2.0 times the baseline, hardly rising",
        "inspect bearing drive and plan its exchange at the next planned stop",
    ),
    "another bearing": (
        Situation("x", "drive", "maintenance_required", "final", level=2.0, level_of="fan"),
        "watch",
        "final stage of its life; no part of its own named: its level rises with the damage of fan",
        "",
        "level 2.0 times the baseline",
        "look at the trends of channel x at the next inspection",
    ),
    "other channels": (
        replace(HEALTHY, bearing_fault="inner", bearing_basis="verdict", support=0.85, channels=3, unverified=False),
        "warning",
        "healthy so far on this channel; other channels see damage: inner race of bearing drive",
        "sure: named since the onset, 85 % of the evidence of 3 channels, the shaft speed is known",
        "",
        "inspect bearing drive and plan its exchange at the next planned stop",
    ),
    "an alert alone": (
        replace(HEALTHY, state="maintenance_required", severity="alert", level=2.4),
        "watch",
        "alert, no onset of damage so far",
        "",
        "level 2.4 times the baseline",
        "look at the trends of channel x at the next inspection",
    ),
    "end of life": (
        replace(FINAL, state="failure", stage="end_of_life", to_alarm=Forecast("reached", to="default")),
        "end_of_life",
        "end of life reached: outer race of bearing drive",
        SURE,
        "level 3.1 times the baseline, four times the baseline is reached",
        "stop the machine as soon as possible and exchange bearing drive",
    ),
    "no data": (
        replace(FINAL, state="no_data", level=math.nan, to_alarm=Forecast()),
        "no_data",
        "no data; before: final stage of its life: outer race of bearing drive",
        SURE,
        "",
        "check the logger and its connection: no data come from channel x",
    ),
    "bad data": (
        replace(HEALTHY, state="bad_data"),
        "sensor_fault",
        "bad data; before: healthy so far",
        "",
        "",
        "check sensor, cable and mounting of channel x: its data cannot be judged",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_each_state_has_its_words(name: str) -> None:
    found, key, headline, sureness, level, action = CASES[name]
    assert state_of(found) == Statement(key, headline, sureness, level, action)


def test_a_time_needs_a_forecast_that_supports_it() -> None:
    supported = replace(FINAL, to_threshold=TT, to_alarm=Forecast("no_trend"))
    assert "within 14 d" in state_of(supported).action
    for status in set(TT_STATUSES) - {"ok", "already_crossed"}:
        withheld = state_of(replace(supported, to_threshold=replace(TT, status=status)))
        assert withheld.action.endswith("at the next planned stop"), status
        assert "threshold" not in withheld.level
    uncalibrated = state_of(replace(supported, calibrated=False))
    assert "14 d" not in uncalibrated.action + uncalibrated.level
    for status in set(TTA_STATUSES) - {"ok"}:
        withheld = state_of(replace(FINAL, to_alarm=replace(FINAL.to_alarm, status=status)))
        assert "3 d" not in withheld.action + withheld.level, status
    at_once = state_of(replace(supported, to_threshold=replace(TT, lower=0.0)))
    assert at_once.action.endswith("without delay: the threshold of damage may be reached already")


def test_sure_needs_all_of_its_evidence() -> None:
    assert state_of(FINAL).sureness.startswith("sure")
    weaker: tuple[dict[str, Any], ...] = (
        *({"support": 0.79}, {"support": None}, {"disagreement": {"y": "ball"}}, {"unverified": True}),
        {"unverified": None},
    )
    for less in weaker:
        assert state_of(replace(FINAL, **less)).sureness.startswith("likely"), less
    assert state_of(replace(FINAL, bearing_basis="hint", stage="healthy")).sureness.startswith("only a hint")


@given(
    st.sampled_from(["learning", "healthy", ""]),
    st.sampled_from(list(STATES)),
    st.sampled_from(["outer", "undecided", "inner|ball"]),
    st.sampled_from([None, "alert", "danger"]),
)
def test_before_the_onset_nothing_is_called_damage_of_a_part(
    stage: str, state: str, fault: str, severity: str | None
) -> None:
    said = state_of(Situation("x", "b", state, stage, severity, fault, "hint"))
    assert said.headline.endswith("(hint)")
    assert "damage of" not in said.headline
    assert not said.sureness.startswith(("sure", "likely"))


def test_every_situation_has_an_advice() -> None:
    seen = set()
    stages = ("", "learning", "healthy", "final", "end_of_life")
    for state, stage, severity, fault, gear in itertools.product(
        STATES, stages, (None, "alert", "danger"), (None, "outer"), (None, "gear:a")
    ):
        found = Situation("x", "b", state, stage, severity, fault, "hint", gear=gear)
        seen.add(advice_key(found))
        assert state_of(found).action
    assert seen == set(ADVICE)


def test_texts_of_the_plant_replace_those_of_the_program() -> None:
    own = dict(ADVICE) | {"warning": "call 112: {part} of {bearing}, {when}, see {{manual}}"}
    assert state_of(FINAL, own).action.startswith("call 112: outer race of bearing drive, within 3 d")
    assert state_of(FINAL, own).action.endswith("see {manual}")
    for wrong in ("{name}", "{bearing.channel}", "{bearing!r}", "{when:>9}", "{", "{}", "{0}"):
        with pytest.raises(ValueError, match="no other braces"):
            check_advice(wrong)
    assert load(advice={"normal": "sleep"}).advice.texts == dict(ADVICE) | {"normal": "sleep"}
    assert load(advice={"normal": "sleep"}).hash == load().hash
    with pytest.raises(ConfigError, match=r"advice\.danger.*braces than \{bearing\}"):
        load(advice={"danger": "stop {machine}"})


@pytest.mark.parametrize(
    ("name", "words"),
    [("", "the bearing"), ("Bearing", "the bearing"), ("test_bearing", "test_bearing"), ("fan", "bearing fan")],
)
def test_a_bearing_is_called_so_once(name: str, words: str) -> None:
    assert f"inspect {words} and plan" in state_of(replace(FINAL, bearing=name)).action


def test_a_status_of_an_older_version_is_said_too() -> None:
    old = {"stage": "healthy", "state": "normal", "fault": "cage", "fault_basis": "hint"}
    assert status_line("x", old).startswith("healthy so far; a pattern of the cage (hint); only a hint")
    said = {"headline": "a", "sureness": "", "level": "c", "action": "d"}
    assert status_line("x", old | said) == "a; c; d"
