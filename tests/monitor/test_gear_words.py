"""What status, replay, events and page say of wheels, and which of two faults is said first."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from monitor.commands.replay import summary_lines
from monitor.health.gears.naming import KINDS, NAMED, STATUSES
from monitor.health.gears.values import primary_fault
from monitor.health.state import SourceState
from monitor.service.summary import channel_summary
from monitor.words.advice import state_of
from monitor.words.events import badness, event_text
from monitor.words.situation import Situation
from monitor.words.statuses import GEAR_KINDS, GEAR_STATUSES, fault_words, gears_line, page_words
from tests.support.stage import CHANNEL, life


def summary(**changes: Any) -> dict[str, Any]:
    """Return the summary of the channel whose wheel has a broken tooth, with changes to the state."""
    state, records = life()
    channel = replace(state.channels["one"], **changes)
    latest = SourceState(
        **{**{name: getattr(state, name) for name in state.__dataclass_fields__}, "channels": {"one": channel}}
    )
    return channel_summary(replace(latest, latest=records[-1]), CHANNEL)


def test_every_status_and_kind_has_words() -> None:
    assert tuple(GEAR_STATUSES) == STATUSES
    assert tuple(GEAR_KINDS) == KINDS
    assert NAMED == NAMED
    assert page_words()["gears"] == GEAR_STATUSES


@pytest.mark.parametrize(
    ("fault", "basis", "gear", "first"),
    [
        ("outer", "verdict", "gear:a", "outer"),
        ("outer", "hint", "gear:a", "gear:a"),
        (None, None, "gear:a", "gear:a"),
        ("outer", "hint", None, "outer"),
        (None, None, None, None),
    ],
)
def test_a_verdict_comes_before_a_wheel_and_a_wheel_before_a_hint(
    fault: str | None, basis: str | None, gear: str | None, first: str | None
) -> None:
    assert primary_fault(fault, basis, gear) == first


def test_the_summary_names_the_wheel_beside_the_bearing() -> None:
    found = summary()
    assert (found["fault"], found["fault_basis"], found["gear_fault"]) == ("gear:wheel", "verdict", "gear:wheel")
    assert (found["bearing_fault"], found["gear_kind"]) == (None, "tooth")
    assert list(found["gears"]) == ["pinion", "wheel"]
    wheel = found["gears"]["wheel"]
    assert wheel["status"] == "ok"
    assert wheel["score"] > 1.0
    assert min(wheel[name] for name in ("fm0", "fm4", "na4", "m6a", "sideband_level", "turns")) > 0.0


def test_the_words_name_the_wheel_and_leave_the_bearing_alone() -> None:
    found = summary()
    said = state_of(Situation.of_status("one", found, "drive"))
    assert said.key == "gear"
    assert said.headline.endswith("; damage of gear wheel (a damaged tooth)")
    assert "drive" not in said.headline
    assert gears_line(found) == "gear wheel (a damaged tooth)"
    assert gears_line({}) == ""
    refused = {"gears": {"a": {"status": "no_angle"}, "b": {"status": "ok"}}}
    assert gears_line(refused) == "no gear named; a: the angle of its shaft is not known well enough"
    assert fault_words("gear:a|b") == "gear a or b"


def test_a_replay_says_the_wheel() -> None:
    whole: dict[str, Any] = dict.fromkeys(("seconds", "blocks", "accepted", "pending"), 1)
    whole |= {name: {} for name in ("flagged", "rejected", "ignored", "closed", "dating", "reasons", "bearings")}
    whole |= {"condition": None, "uncalibrated": [], "channels": {"one": summary()}}
    lines = list(summary_lines(whole))
    assert any("gear wheel (a damaged tooth)" in line for line in lines)


def test_an_event_names_the_wheel() -> None:
    body = {"kind": "fault_changed", "channel": "one", "block": 9, "from": None, "to": "gear:a", "gear_kind": "tooth"}
    assert event_text(body) == "damage of gear a (a damaged tooth) is named now"
    gone = {**body, "from": "gear:a", "to": None, "gear_kind": None}
    assert badness(gone) == 0 < badness(body)
    assert event_text(gone) == "no damage of gear a is named any more"
    bearing = {"kind": "fault_changed", "bearing": "b", "from": "inner", "to": "outer"}
    assert event_text(bearing) == "the verdict on b names the outer race now, before the inner race"
