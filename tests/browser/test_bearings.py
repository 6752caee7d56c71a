"""What the channels of a bearing say together, as the scripts of the page write it: one line a bearing, first."""

from __future__ import annotations

from typing import Any

import pytest
from playwright.sync_api import expect

from monitor.words.statuses import BASES
from tests.browser.conftest import Visitor
from tests.browser.machine import Served

pytestmark = pytest.mark.browser

WRITE = """async ([bearings, status]) => {
  const { verdict } = await import("/static/verdict.js");
  const { Bearings } = await import("/static/bearings.js");
  const info = { bearing: { name: "drive" }, levels: [], marks: {} };
  const row = { status, state: "normal", reason: "" };
  const machine = { name: "m", bearings };
  const list = new Bearings((a, b) => (a < b ? -1 : Number(a > b)));
  list.update({ machines: new Map([["m", machine]]), silence: () => null });
  list.filter([]);
  const shown = [...list.element.querySelectorAll("li")].filter((line) => !line.hidden);
  return {
    answers: [...verdict({ row, info, zone: "UTC", age: 0, machine }).children].map((one) => one.textContent),
    lines: shown.map((line) => [...line.children].map((cell) => cell.textContent.replace(/\\W*%/, " %"))),
    links: shown.map((line) => line.querySelector("a").getAttribute("href")),
    rest: list.rest.textContent,
  };
}"""
NONE = {"fault": None, "fault_basis": None, "support": None, "disagreement": {}, "channels": ["x"]}
HINT = NONE | {"fault": "outer", "fault_basis": "hint", "support": 0.571}
TORN = {
    "fault": "inner",
    "fault_basis": "verdict",
    "support": 0.62,
    "disagreement": {"x": "ball|cage"},
    "channels": ["x", "y"],
}


def written(visitor: Visitor, pump: Served, bearings: dict[str, Any], **status: Any) -> dict[str, Any]:
    return visitor(pump.url).go().evaluate(WRITE, [bearings, {"stage": "healthy"} | status])


def test_verdicts_come_first_and_say_who_disagrees(pump: Served, visitor: Visitor) -> None:
    found = written(visitor, pump, {"fan": NONE, "far": NONE | {"level_of": "drive"}, "free": HINT, "drive": TORN})
    assert found["lines"] == [
        ["m / drive", "inner race", "verdict", "support 62 %", "x says rolling element or cage"],
        ["m / free", "outer race", "hint", "support 57 %", ""],
        ["m / fan", "no part named", "", "", ""],
        ["m / far", "no part named", "", "", "its level rises with the damage of drive"],
    ]
    # The link leads to a channel that agrees.
    assert found["links"] == ["#/channel/m/y", *["#/channel/m/x"] * 3]
    first = found["answers"][0]
    assert first.startswith("Bearing driveinner race")
    assert BASES["verdict"][1] in first
    assert "2 channels" in first
    assert "x says rolling element or cage" in first


def test_a_channel_without_a_name_says_whose_damage_it_hears(pump: Served, visitor: Visitor) -> None:
    assert written(visitor, pump, {"drive": NONE})["answers"][0] == "Bearing driveno part named1 channel"
    found = written(visitor, pump, {"drive": NONE | {"level_of": "fan"}})
    assert "its level rises with the damage of fan" in found["answers"][0]


def test_a_hint_is_read_as_one(pump: Served, visitor: Visitor) -> None:
    found = written(visitor, pump, {"drive": HINT}, fault="outer", fault_basis="hint")
    assert sum(BASES["hint"][1] in answer for answer in found["answers"]) == 2
    found = written(visitor, pump, {"drive": HINT}, fault="outer", fault_basis="verdict")
    assert sum(BASES["hint"][1] in answer for answer in found["answers"]) == 1


def test_of_many_bearings_only_those_with_a_name_are_listed(pump: Served, visitor: Visitor) -> None:
    found = written(visitor, pump, {f"b{number}": NONE for number in range(13)} | {"drive": TORN})
    assert [line[0] for line in found["lines"]] == ["m / drive"]
    assert found["rest"] == "13 bearings without a name"


def test_the_overview_begins_with_the_bearing(pump: Served, visitor: Visitor) -> None:
    page = visitor(pump.url).go()
    expect(page.locator(".bearing")).to_have_count(1)
    expect(page.locator(".bearing")).to_contain_text("pump / b")
    page.get_by_label("Filter channels").fill("nothing of that name")
    expect(page.locator(".bearing:visible")).to_have_count(0)
