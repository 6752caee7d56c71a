"""The time to the alarm level, as the scripts of the page write it."""

from __future__ import annotations

from typing import Any

import pytest

from monitor.words.statuses import TTA_REFUSALS
from tests.browser.conftest import Visitor
from tests.browser.machine import Served

pytestmark = pytest.mark.browser

WRITE = """async (states) => {
  const { verdict } = await import("/static/verdict.js");
  const info = { levels: [], marks: {}, interval: 0.8 };
  const answers = (status) => verdict({ row: { status, state: "normal", reason: "" }, info, zone: "UTC", age: 0 });
  const texts = states.map((status) => [...answers(status).children].map((one) => one.textContent));
  return texts.map((found) => found.filter((text) => text.startsWith("How long to the alarm level?")));
}"""
FOUND: dict[str, Any] = {"stage": "final", "tta_status": "ok", "tta_s": 7200, "tta_lower_s": 3600, "tta_upper_s": 14400}
LEVEL: dict[str, Any] = {"tta_level_source": "alert", "tta_level_factor": 2.5}


def test_the_page_says_time_interval_level_or_why_not(pump: Served, visitor: Visitor) -> None:
    states = [
        FOUND | LEVEL,
        FOUND | {"tta_upper_s": None, "tta_level_source": "default", "tta_level_factor": 4.0},
        {"stage": "final", "tta_status": "reached", "tta_s": 0} | LEVEL,
        {"stage": "final", "tta_status": "no_trend"} | LEVEL,
        {"stage": "healthy", "tta_status": "not_final_stage"},
        {"stage": "final"},
    ]
    answers = visitor(pump.url).go().evaluate(WRITE, states)
    spaces = str.maketrans({"\u202f": " ", "\u2009": " "})
    said = [found[0].removeprefix("How long to the alarm level?").translate(spaces) for found in answers[:4]]
    assert said == [
        "2 h80 % interval 60 min – 4 hRMS reaches the alert, 2.5 times the baseline, by its trend",
        "2 h80 % interval from 60 minRMS reaches four times the baseline, by its trend",
        "reachedthe alert, 2.5 times the baseline",
        f"cannot be said{TTA_REFUSALS['no_trend']}the alert, 2.5 times the baseline",
    ]
    assert answers[4:] == [[], []]
