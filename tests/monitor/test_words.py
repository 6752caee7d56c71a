"""The words and numbers for people, which all surfaces share."""

from __future__ import annotations

import itertools
import math

from monitor.health.rest.trend import LEVEL_SOURCES
from monitor.health.schema import EDV_STATUSES, FAULTS, STATUSES, TT_STATUSES, TTA_STATUSES
from monitor.words.numbers import Clock, duration, volume
from monitor.words.statuses import (
    ALARM_LEVELS,
    EDV_REFUSALS,
    STATUS_MEANINGS,
    TT_REFUSALS,
    TTA_REFUSALS,
    bearing_words,
    fault_words,
    named_words,
)


def test_every_status_has_words() -> None:
    assert set(STATUS_MEANINGS) == set(STATUSES)
    assert set(EDV_REFUSALS) == set(EDV_STATUSES) - {"ok", "widened"}
    assert set(TT_REFUSALS) == set(TT_STATUSES) - {"ok", "already_crossed"}
    assert set(TTA_REFUSALS) == set(TTA_STATUSES) - {"ok", "reached", "beyond_horizon"}
    assert set(ALARM_LEVELS) == set(LEVEL_SOURCES)
    for first, second in itertools.combinations(FAULTS, 2):
        assert " or " in fault_words(f"{first}|{second}")


def test_a_hint_is_called_a_hint_and_a_bearing_has_one_line() -> None:
    assert named_words("outer", "hint") == "outer race (a hint)"
    assert named_words("outer", "verdict") == named_words("outer", None) == "outer race"
    found = {"fault": "inner|ball", "fault_basis": "verdict", "support": 0.625, "disagreement": {"v": "outer"}}
    assert bearing_words(found) == "inner race or rolling element, verdict, support 62 %; v says outer race"
    hint = {"fault": "cage", "fault_basis": "hint", "support": 0.5, "disagreement": {}}
    assert bearing_words(hint) == "cage, hint, support 50 %"
    none = hint | {"fault": None, "fault_basis": None, "support": None}
    assert bearing_words(none) == bearing_words(none | {"level_of": None}) == "no part named"
    assert bearing_words(none | {"level_of": "fan"}) == "no part named; its level rises with the damage of fan"


def test_durations_and_units_for_people() -> None:
    assert [
        duration(seconds) for seconds in (0.0, 89.0, 95.0, 5399.0, 5400.0, 7980.0, 86400.0 * 3 + 3600.0, -60.0)
    ] == [
        *("0 s", "89 s", "2 min", "1 h 30 min", "1 h 30 min", "2 h 13 min", "3 d 1 h", "−60 s"),
    ]
    assert volume(5e-8) == "0.05 mm³/mm"
    assert Clock(dated=True).moment(0.0) == "1970-01-01 00:00:00 UTC"
    assert Clock(dated=True).moment(math.nan) == "at an unknown time"
