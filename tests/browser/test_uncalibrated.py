"""V_eq of a rig that is not calibrated, as the scripts of the page write it."""

from __future__ import annotations

import re
from typing import Any

import pytest

from monitor.words.statuses import EDV_REFUSALS, TT_REFUSALS
from tests.browser.conftest import Visitor
from tests.browser.machine import Served

pytestmark = pytest.mark.browser

WRITE = """async ([status, info, columns]) => {
  const { verdict } = await import("/static/verdict.js");
  const { trendSpecs } = await import("/static/trend_specs.js");
  const row = { status, state: "maintenance_required", reason: "" };
  const data = { column: (name) => (columns.includes(name) ? [1, 2] : null), constant: () => null };
  return {
    text: verdict({ row, info, zone: "UTC", age: 0, machine: {} }).textContent,
    charts: trendSpecs(info, data).map((spec) => spec.name),
    lines: trendSpecs(info, data).flatMap((spec) => (spec.lines ?? []).map((line) => line.value)),
  };
}"""
STATUS = {
    "stage": "final",
    "v_eq_mm2": 0.02,
    "v_eq_lower_mm2": 0.01,
    "v_eq_upper_mm2": 0.04,
    "v_eq_relative": 2.5,
    "edv_status": "ok",
    "tt_status": "ok",
    "tt_s": 7200.0,
}
INFO: dict[str, Any] = {"tracked": True, "unit": "g", "interval": 0.8, "levels": [], "marks": {}}
COLUMNS = ["v_eq_mm2", "v_eq_lower_mm2", "v_eq_upper_mm2", "v_eq_relative"]


def written(visitor: Visitor, pump: Served, status: dict[str, Any], info: dict[str, Any]) -> dict[str, Any]:
    return visitor(pump.url).go().evaluate(WRITE, [STATUS | status, INFO | info, COLUMNS])


def test_a_calibrated_v_eq_is_a_volume(pump: Served, visitor: Visitor) -> None:
    for claim in (True, "declared"):
        found = written(visitor, pump, {"calibrated": claim}, {"calibrated": claim, "thresholds_mm2": [0.05]})
        assert "0.02\u202fmm³/mm" in found["text"].replace("\u2009", "\u202f")
        assert "calibrated" not in found["text"]
        assert (found["charts"], found["lines"]) == (["v_eq"], [0.05])


def test_an_uncalibrated_v_eq_is_a_multiple_of_its_first_value(pump: Served, visitor: Visitor) -> None:
    status = {"calibrated": False, "edv_status": "uncalibrated", "tt_status": "uncalibrated", "tt_s": None}
    found = written(visitor, pump, status, {"calibrated": False, "thresholds_mm2": []})
    assert "2.5 times the first tracked value" in found["text"]
    assert re.search(r"interval 1\.25\W+5\D", found["text"])
    assert EDV_REFUSALS["uncalibrated"] in found["text"]
    assert TT_REFUSALS["uncalibrated"] in found["text"]
    assert "mm³" not in found["text"]
    assert (found["charts"], found["lines"]) == (["v_eq_relative"], [])


def test_thresholds_that_are_asked_for_are_drawn_on_the_scale_of_the_model(pump: Served, visitor: Visitor) -> None:
    found = written(visitor, pump, {"calibrated": False}, {"calibrated": False, "thresholds_mm2": [0.05]})
    assert EDV_REFUSALS["uncalibrated"] in found["text"]
    assert (found["charts"], found["lines"]) == (["v_eq"], [0.05])
