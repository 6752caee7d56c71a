"""Spectra of a shaft whose speed varies: the page shows them over orders."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Route, expect

from tests.browser.conftest import Visitor
from tests.browser.machine import Served
from tests.support.spectra import RAW, SPECTRUM_ADDRESS
from tests.support.views import BAD

pytestmark = pytest.mark.browser

TURNS = """async ([block, per, from, end]) => {
  const { turnMarks } = await import("/static/spectral.js");
  return turnMarks(block, per, from, end);
}"""


def changed(**values: Any) -> Any:
    """Return what answers a request with some values of the answer changed."""

    def answer(route: Route) -> None:
        route.fulfill(json=route.fetch().json() | values)

    return answer


def test_a_block_of_varying_speed_is_over_orders_and_hz_are_those_at_its_mean(pump: Served, visitor: Visitor) -> None:
    visit = visitor(pump.url)
    visit.page.route(SPECTRUM_ADDRESS, changed(domain="order", speed_range_hz=[36.0, 44.0]))
    page = visit.go(BAD)
    box = page.get_by_role("region", name="Envelope spectrum")
    expect(box).to_contain_text(re.compile("speed from 36 to 44.Hz; spectra in orders of the shaft"))
    expect(box.get_by_label("axis")).to_have_value("orders")
    with page.expect_download() as download:
        box.get_by_role("button", name="Save the data as CSV").click()
    assert download.value.path().read_text().splitlines()[1].startswith("order of the shaft,")
    box.get_by_role("combobox", name="cursor").select_option("harmonics")
    box.get_by_label("cursor at").fill("4.5")
    box.get_by_label("cursor at").press("Enter")
    expect(box.locator(".cursor-text")).to_contain_text("f order 4.5: ")
    box.get_by_label("axis").select_option("Hz")
    expect(box.locator(".cursor-text")).to_contain_text(re.compile("f 180.Hz: "))
    with page.expect_download() as download:
        box.get_by_role("button", name="Save the data as CSV").click()
    assert "Hz at the mean speed 40" in download.value.path().read_text().splitlines()[1]
    visit.page.unroute_all(behavior="wait")


def test_the_waterfall_of_a_varying_speed_can_be_seen_in_hz(pump: Served, visitor: Visitor) -> None:
    visit = visitor(pump.url)
    address = re.compile(r"/waterfall(\?|$)")
    asked: list[str] = []

    def over(route: Route) -> None:
        asked.append(route.request.url)
        found = route.fetch().json() | {"varies": True}
        if "axis=hertz" not in route.request.url:
            found |= {"domain": "order", "order": [value / 40.0 for value in found.pop("frequency_hz")]}
        route.fulfill(json=found)

    visit.page.route(address, over)
    page = visit.go(BAD)
    # Of a machine without a source of an angle, there is no angular speed to choose.
    expect(page.get_by_role("region", name=RAW).get_by_role("button", name="angular speed")).to_be_hidden()
    box = page.get_by_role("region", name="Spectra over the life")
    expect(box.get_by_label("axis")).to_have_value("order")
    box.get_by_label("axis").select_option("Hz")
    expect(box.get_by_label("axis")).to_have_value("hertz")
    assert "axis=hertz" in asked[-1]
    visit.page.unroute_all(behavior="wait")


def test_marks_of_a_waveform_follow_the_angle(pump: Served, visitor: Visitor) -> None:
    page = visitor(pump.url).go()
    course = np.linspace(20.0, 30.0, 65)
    block = {"samples": 4000, "rate_hz": 1000.0, "speed_hz": 25.0, "speed_course_hz": course.tolist()}
    marks = np.array(page.evaluate(TURNS, [block, 0.5, 1.0, 2.0]))
    # The angle of a speed that rises from 20 to 30 Hz in 4 s.
    turns = 20.0 * marks + 1.25 * marks**2
    assert np.abs(np.diff(turns) - 0.5).max() < 0.005
    assert np.abs(marks - 1.0).min() < 1e-6
    assert marks[-1] <= 2.0
    steady = page.evaluate(TURNS, [{**block, "speed_course_hz": None}, 1.0, 0.1, 0.5])
    assert steady == pytest.approx(np.arange(0.02, 0.5001, 0.04).tolist())
