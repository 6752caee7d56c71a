"""Every view of the page, as somebody sees it who clicks through."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import expect

from tests.browser.conftest import TRAP, Visitor
from tests.browser.machine import Served
from tests.support.views import BAD, WELL, drawn
from tests.support.waiting import wait_until

pytestmark = pytest.mark.browser


def test_the_overview_shows_the_worst_first_in_words_and_symbols(pump: Served, visitor: Visitor) -> None:
    page = visitor(pump.url).go()
    expect(page.locator(".row")).to_have_count(2)
    groups = page.locator(".group:visible > h2").all_inner_texts()
    assert groups[0].startswith("Failure")
    first = page.locator(".row").first
    expect(first).to_contain_text("x0")
    expect(first).to_contain_text("danger")
    assert first.locator("use").get_attribute("href") == "#failure"
    expect(page.locator("#live")).to_have_text("live")
    page.get_by_label("Filter channels").fill("x1")
    expect(page.locator(".row:visible")).to_have_count(1)
    page.get_by_label("Filter channels").fill("nothing of that name")
    expect(page.get_by_text("No channel fits the filter")).to_be_visible()
    page.get_by_role("button", name="Show all").click()
    expect(page.locator(".row:visible")).to_have_count(2)
    page.get_by_role("button", name=re.compile("Failure")).click()
    expect(page.locator(".row:visible")).to_have_count(1)


def test_the_overview_has_levels_and_their_course(pump: Served, visitor: Visitor) -> None:
    page = visitor(pump.url).go()
    row = page.locator(".row").filter(has_text="x0")
    expect(row.get_by_role("img", name=re.compile("^RMS from .* over the life"))).to_be_visible()
    expect(row.locator(".level")).to_contain_text(re.compile(r"\d\sg"))
    assert len((row.locator("polyline").get_attribute("points") or "").split()) > 20


def test_a_channel_answers_how_it_stands(pump: Served, visitor: Visitor) -> None:
    page = visitor(pump.url).go()
    page.get_by_role("link", name=re.compile("x0")).click()
    expect(page.get_by_role("heading", level=1)).to_contain_text("x0")
    answers = page.locator(".answers")
    expect(answers).to_contain_text("Failure")
    expect(answers).to_contain_text("danger: RMS above 3")
    expect(answers).to_contain_text("not tracked")
    expect(answers).to_contain_text("block 43")
    expect(page.locator('[data-chart="rms"] .legend')).to_contain_text("RMS")
    assert drawn(page, '[data-chart="rms"] canvas') > 5
    assert drawn(page, '[data-chart="lines"] canvas') > 5
    expect(page.get_by_text("Shaft speed 40")).to_be_visible()
    page.get_by_text("Values as a table").click()
    expect(page.get_by_role("table", name="Values of the trends, newest first")).to_contain_text("CET")


def test_the_spectrum_has_the_lines_of_the_parts(pump: Served, visitor: Visitor) -> None:
    page = visitor(pump.url).go(BAD)
    box = page.get_by_role("region", name="Envelope spectrum")
    expect(box).to_contain_text("block 43")
    assert drawn(page, ".figure:has-text('Envelope spectrum') canvas") > 5
    box.get_by_text("Amplitudes at the lines").click()
    rows = box.get_by_role("table", name="Amplitudes at the lines").get_by_role("row")
    expect(rows).to_have_count(1 + 4 * 5)
    expect(rows.nth(1)).to_contain_text("BPFO")
    box.get_by_label("inner race").check()
    box.get_by_label("side lines").check()
    box.get_by_role("button", name="Earlier spectrum").click()
    expect(box.get_by_role("button", name="Latest")).to_be_visible()
    expect(box).not_to_contain_text("block 43,")


def test_a_click_on_the_waterfall_shows_that_spectrum(pump: Served, visitor: Visitor) -> None:
    page = visitor(pump.url).go(BAD)
    canvas = page.get_by_role("slider")
    canvas.scroll_into_view_if_needed()
    size = canvas.bounding_box()
    assert size is not None
    canvas.click(position={"x": size["width"] / 2, "y": size["height"] * 0.8})
    box = page.get_by_role("region", name="Envelope spectrum")
    expect(box.get_by_role("button", name="Latest")).to_be_visible()
    before = canvas.get_attribute("aria-valuetext")
    canvas.press("ArrowUp")
    expect(canvas).not_to_have_attribute("aria-valuetext", before or "")
    box.get_by_role("button", name="Latest").click()
    expect(box).to_contain_text("block 43")


def test_the_kurtogram_names_the_band_in_use(pump: Served, visitor: Visitor) -> None:
    page = visitor(pump.url).go(BAD)
    box = page.get_by_role("region", name="Kurtogram")
    box.scroll_into_view_if_needed()
    expect(box).to_contain_text("in use: 300 to")
    assert drawn(page, ".figure:has-text('Kurtogram') canvas") > 5


def test_zooming_fetches_what_is_there(pump: Served, visitor: Visitor) -> None:
    visit = visitor(pump.url)
    page = visit.go(BAD)
    plot = page.locator('[data-chart="rms"] .u-over')
    plot.scroll_into_view_if_needed()
    size = plot.bounding_box()
    assert size is not None
    with page.expect_response(re.compile("records.*from=")):
        page.mouse.move(size["x"] + 0.3 * size["width"], size["y"] + 40)
        page.mouse.down()
        page.mouse.move(size["x"] + 0.6 * size["width"], size["y"] + 40, steps=5)
        page.mouse.up()
    whole = page.get_by_role("button", name="all", exact=True)
    expect(whole).to_have_attribute("aria-pressed", "false")
    plot.dblclick()
    expect(whole).to_have_attribute("aria-pressed", "true")
    trends = page.locator(".trends")
    trends.focus()
    with page.expect_response(re.compile("records.*from=")):
        trends.press("+")
    trends.press("0")
    expect(whole).to_have_attribute("aria-pressed", "true")
    # The page's own scrolling stays; with Ctrl the wheel zooms.
    page.mouse.move(size["x"] + 0.5 * size["width"], size["y"] + 40)
    page.keyboard.down("Control")
    with page.expect_response(re.compile("records.*from=")):
        page.mouse.wheel(0, -120)
    page.keyboard.up("Control")


def test_blocks_in_doubt_are_named_and_explained(pump: Served, visitor: Visitor) -> None:
    page = visitor(pump.url).go(WELL)
    box = page.get_by_role("region", name="Rejected and flagged blocks").first
    expect(box).to_contain_text("rejected")
    expect(box).to_contain_text(TRAP)
    assert page.evaluate("window.trapped") is None
    assert page.locator("img").count() == 0


def test_a_channel_without_a_map_says_so(pump: Served, visitor: Visitor) -> None:
    page = visitor(pump.url).go(WELL)
    expect(page.get_by_role("region", name="Track on the RMS map")).to_contain_text("map")


def test_files_can_be_had(pump: Served, visitor: Visitor) -> None:
    visit = visitor(pump.url)
    wait_until(lambda: (pump.folder / "records" / "pump-20260301.nc").exists())
    page = visit.go("#/files")
    with page.expect_download() as download:
        page.get_by_role("link", name="pump-20260301.nc").click()
    assert download.value.path().read_bytes()[:4] == b"\x89HDF"


def test_an_unknown_channel_is_said_to_be_unknown(pump: Served, visitor: Visitor) -> None:
    visit = visitor(pump.url)
    page = visit.go("#/channel/pump/nobody")
    expect(page.get_by_text("There is no such channel")).to_be_visible()
    page.get_by_role("link", name="All machines", exact=True).click()
    expect(page.locator(".row")).to_have_count(2)
    visit.trouble = [text for text in visit.trouble if "404" not in text]


def test_a_request_that_fails_is_shown_and_can_be_repeated(pump: Served, visitor: Visitor) -> None:
    visit = visitor(pump.url)
    visit.page.route("**/records?**", lambda route: route.fulfill(status=503, json={"error": "the store is busy"}))
    page = visit.go(WELL)
    trends = page.get_by_role("region", name="Trends")
    expect(trends).to_contain_text("The records could not be read: the store is busy")
    visit.page.unroute("**/records?**")
    trends.get_by_role("button", name="Try again").click()
    expect(page.locator('[data-chart="rms"] canvas')).to_be_visible()
    visit.trouble = [text for text in visit.trouble if "503" not in text]


def test_times_are_of_the_machine_or_utc(pump: Served, visitor: Visitor) -> None:
    page = visitor(pump.url).go(BAD)
    expect(page.locator(".trends + .note, .under-head .when").first).to_contain_text("CET")
    page.keyboard.press("z")
    expect(page.locator(".under-head .when").first).to_contain_text("UTC")
    page.reload()
    expect(page.locator(".under-head .when").first).to_contain_text("UTC")


def test_without_script_the_page_says_what_to_do(pump: Served, visitor: Visitor) -> None:
    page = visitor(pump.url, script=False).go()
    assert page.locator(".row").count() == 0
    assert "spallwatch status" in page.locator("noscript").inner_html()


def test_before_the_first_block_nothing_pretends_to_be_well(fresh: Served, visitor: Visitor) -> None:
    visit = visitor(fresh.url)
    page = visit.go()
    expect(page.locator(".group:visible > h2").first).to_contain_text("Function check")
    page = visit.go(BAD)
    expect(page.get_by_text("No usable block has been recorded yet")).to_be_visible()
    expect(page.get_by_text("No spectrum is kept yet")).to_be_visible()
    fresh.put(1)
    expect(page.locator('[data-chart="rms"] canvas')).to_be_visible()
    visit.trouble = [text for text in visit.trouble if "404" not in text]
