"""Spectra and waveforms as an analyst uses them: axes, cursors, comparison, peaks, files."""

from __future__ import annotations

import re
from typing import Any

import pytest
from playwright.sync_api import Locator, Page, Route, expect

from tests.browser.conftest import Visitor
from tests.browser.machine import Served
from tests.support.spectra import RAW, SPECTRUM_ADDRESS
from tests.support.views import BAD, drawn
from tests.support.waiting import wait_until

pytestmark = pytest.mark.browser

RAW_ADDRESS = re.compile(r"/raw(\?|$)")


def saved(page: Page, box: Locator, kind: str) -> bytes:
    with page.expect_download() as download:
        box.get_by_role("button", name=re.compile(f"Save .* as {kind}")).click()
    assert download.value.suggested_filename.endswith(kind.lower())
    return download.value.path().read_bytes()


def test_axes_are_in_orders_and_decibels_and_another_block_is_laid_over(pump: Served, visitor: Visitor) -> None:
    page = visitor(pump.url).go(BAD)
    box = page.get_by_role("region", name="Envelope spectrum")
    expect(box).to_contain_text("block 43")
    box.get_by_label("axis").select_option("orders of the shaft")
    box.get_by_label("scale").select_option("dB")
    box.get_by_label("compare with").select_option("baseline")
    expect(box).to_contain_text("compared with block")
    assert drawn(page, ".figure:has-text('Envelope spectrum') canvas") > 5
    box.get_by_label("scale").select_option("logarithmic")
    box.get_by_text("Highest peaks").click()
    peaks = box.get_by_role("table", name="Highest peaks").get_by_role("row")
    expect(peaks.nth(1)).to_contain_text("× BPFO")
    expect(peaks.nth(0)).to_contain_text("dB re 1 µm/s², RMS")


def test_cursors_mark_all_harmonics_and_sidebands(pump: Served, visitor: Visitor) -> None:
    page = visitor(pump.url).go(BAD)
    box = page.get_by_role("region", name="Envelope spectrum")
    expect(box).to_contain_text("block 43")
    box.get_by_role("combobox", name="cursor").select_option("harmonics")
    text = box.locator(".cursor-text")
    expect(text).to_contain_text("Click into the spectrum")
    box.get_by_label("cursor at").fill("180")
    box.get_by_label("cursor at").press("Enter")
    expect(text).to_contain_text(re.compile(r"lines marked\. f 180.Hz: .* 2f 360.Hz"))
    box.get_by_role("combobox", name="cursor").select_option("sidebands")
    box.get_by_label("spacing").fill("16")
    box.get_by_label("spacing").press("Enter")
    expect(text).to_contain_text(re.compile(r"−1 164.Hz: .*; f 180.Hz: .*; \+1 196.Hz"))
    # A click takes the highest point nearby.
    plot = box.locator(".u-over")
    size = plot.bounding_box()
    assert size is not None
    plot.click(position={"x": size["width"] * 0.5, "y": 60})
    expect(box.get_by_label("cursor at")).not_to_have_value("180")


def test_what_is_zoomed_into_stays_for_the_next_block(pump: Served, visitor: Visitor) -> None:
    page = visitor(pump.url).go(BAD)
    box = page.get_by_role("region", name="Envelope spectrum")
    label = box.get_by_role("img").get_attribute("aria-label") or ""
    found = re.search(r"up to ([\d,.]+) Hz", label)
    assert found is not None
    end = float(found[1].replace(",", ""))
    box.get_by_text("Highest peaks").click()
    size = box.locator(".u-over").bounding_box()
    assert size is not None
    page.mouse.move(size["x"] + 0.2 * size["width"], size["y"] + 60)
    page.mouse.down()
    page.mouse.move(size["x"] + 0.4 * size["width"], size["y"] + 60, steps=4)
    page.mouse.up()

    def inside() -> bool:
        rows = box.get_by_role("table", name="Highest peaks").locator("tbody tr td:nth-child(2)").all_inner_texts()
        return bool(rows) and all(0.18 * end < float(row.split("\u202f")[0]) < 0.42 * end for row in rows)

    wait_until(inside)
    box.get_by_role("button", name="Earlier spectrum").click()
    expect(box).to_contain_text("block 42")
    wait_until(inside)


def test_the_samples_of_a_block_are_shown_as_acceleration_velocity_and_waveform(pump: Served, visitor: Visitor) -> None:
    page = visitor(pump.url).go(BAD)
    box = page.get_by_role("region", name=RAW)
    box.scroll_into_view_if_needed()
    expect(box).to_contain_text("block 43; 0.5 s at 2560 Hz")
    assert drawn(page, f".figure:has-text('{RAW}') canvas") > 5
    box.get_by_role("button", name="velocity").click()
    expect(box.get_by_role("img", name="Velocity spectrum of block 43")).to_be_visible()
    box.get_by_role("button", name="waveform").click()
    expect(box.get_by_role("img", name="Waveform of block 43, 0.5 s.")).to_be_visible()
    box.get_by_label("marks every period of").select_option("BPFO")
    assert drawn(page, f".figure:has-text('{RAW}') canvas") > 5
    rows = saved(page, box, "CSV").decode().splitlines()
    assert rows[1] == '"time, s","acceleration, g"'
    assert len(rows) == 2 + 1280


def test_where_no_samples_are_kept_this_is_said(pump: Served, visitor: Visitor) -> None:
    visit = visitor(pump.url)
    visit.page.route(RAW_ADDRESS, lambda route: route.fulfill(status=404, json={"error": "nothing"}))
    page = visit.go(BAD)
    box = page.get_by_role("region", name=RAW)
    box.scroll_into_view_if_needed()
    expect(box).to_contain_text("Nothing is kept of the samples of this block")
    visit.page.unroute(RAW_ADDRESS)
    visit.trouble = [text for text in visit.trouble if "404" not in text]


def test_picture_and_data_can_be_saved(pump: Served, visitor: Visitor) -> None:
    page = visitor(pump.url).go(BAD)
    box = page.get_by_role("region", name="Envelope spectrum")
    expect(box).to_contain_text("block 43")
    assert saved(page, box, "PNG")[:8] == b"\x89PNG\r\n\x1a\n"
    picture = saved(page, box, "SVG").decode()
    for words in ("<svg ", "frequency, Hz", "envelope of the acceleration, g", "BPFO", "Envelope spectrum of block 43"):
        assert words in picture
    rows = saved(page, box, "CSV").decode().splitlines()
    assert rows[1] == '"frequency, Hz","block 43, g"'
    assert next(float(cell) for cell in rows[2].split(",")) == 0.0
    for name, head in (
        ("Spectra over the life", '"frequency, Hz","block'),
        ("Kurtogram", '"from, Hz","to, Hz",kurtosis'),
    ):
        table = saved(page, page.get_by_role("region", name=name), "CSV").decode().splitlines()
        assert table[1].startswith(head)
        assert len(table) > 20
    trend = page.locator('[data-chart="rms"]')
    trend.hover()
    table = saved(page, trend, "CSV").decode().splitlines()
    assert table[1] == '"time, UTC seconds since 1970",rms_g'
    assert len(table) == 2 + 43


def test_lines_on_one_peak_are_said_to_be_one(pump: Served, visitor: Visitor) -> None:
    visit = visitor(pump.url)

    def shared(route: Route) -> None:
        found: dict[str, Any] = route.fetch().json()
        found["shared_lines"] = [[["outer", 3], ["inner", 2]]]
        route.fulfill(json=found)

    visit.page.route(SPECTRUM_ADDRESS, shared)
    page = visit.go(BAD)
    box = page.get_by_role("region", name="Envelope spectrum")
    box.get_by_text("Amplitudes at the lines").click()
    table = box.get_by_role("table", name="Amplitudes at the lines")
    expect(table).to_contain_text("3 × BPFO = 2 × BPFI")
    expect(table).to_contain_text("2 × BPFI = 3 × BPFO")
    expect(box).to_contain_text("it is one line")
    visit.page.unroute(SPECTRUM_ADDRESS)


WRITE = """async ([status, judged]) => {
  const { verdict } = await import("/static/verdict.js");
  const info = { levels: [], marks: {}, iso_class: judged };
  const answers = verdict({ row: { status, state: "normal", reason: "" }, info, zone: "UTC", age: 0 });
  return [...answers.children].map((one) => one.textContent).filter((text) => text.startsWith("Vibration of the"));
}"""


def test_the_vibration_of_the_machine_has_its_zone_or_a_reason(pump: Served, visitor: Visitor) -> None:
    page = visitor(pump.url).go()
    judged = {"text": "ISO 20816-3 group 2", "limits_mm_s": [1.4, 2.8, 4.5]}
    found = {"velocity_rms_mm_s": 3.2, "velocity_floor_mm_s": 2.0, "velocity_status": "ok"}

    def said(status: dict[str, Any], known: dict[str, Any] | None) -> str:
        texts = page.evaluate(WRITE, [status, known])
        return texts[0] if texts else ""

    in_zone = said(found | {"velocity_zone": "C"}, judged)
    for words in ("zone C: not suitable", "ISO 20816-3 group 2", "nothing of the bearings", "of it are continuous"):
        assert words in in_zone
    assert "no zone" in said(found, judged)
    assert "RMS from 10 to 1000 Hz" in said(found, None)
    refused = {"velocity_status": "low_frequency_noise", "velocity_rms_mm_s": None}
    assert "cannot be told from vibration" in said(refused, judged)
    assert said(refused, None) == said({}, judged) == ""


def test_a_sensor_of_velocity_is_said_to_be_one(pump: Served, visitor: Visitor) -> None:
    page = visitor(pump.url).go()
    write = """async (info) => {
      const { verdict } = await import("/static/verdict.js");
      const row = { status: { last_block: 3 }, state: "normal", reason: "" };
      return verdict({ row, info: { levels: [], marks: {}, ...info }, zone: "UTC", age: 0 }).textContent;
    }"""
    words = "sensor of velocity: acceleration up to 2000\N{NARROW NO-BREAK SPACE}Hz by differentiation"
    assert words in page.evaluate(write, {"velocity_limit_hz": 2000.0})
    assert "sensor of velocity" not in page.evaluate(write, {"velocity_limit_hz": None})
