"""The figures of a report in a real browser: with scripts, without, and on paper."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from playwright.sync_api import Locator, Page, expect

from monitor.records.store import Store
from monitor.report.report import build_report
from tests.browser.conftest import Visitor
from tests.oracles.lives import life

pytestmark = pytest.mark.browser

START = 1_700_000_000.0
EVIL = "</script><b onclick=x>"


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    with Store.open(folder / "state.db", machine="press 4") as store:
        store.describe({"config_hash": "c1"})
        store.commit_many([(record, {}) for record in life(start=START)])
    return build_report(folder, folder / "report.html", title=EVIL)


def chart(page: Page, name: str = "trends") -> Locator:
    """The charts of a figure, drawn by now."""
    figure = page.locator(f'figure[data-name="{name}"]').first
    figure.scroll_into_view_if_needed()
    expect(figure.locator(".zoom canvas").first).to_be_visible()
    return figure.locator(".zoom")


def ends(zoom: Locator) -> tuple[float, float]:
    return float(zoom.get_attribute("data-from") or "nan"), float(zoom.get_attribute("data-to") or "nan")


def drag(page: Page, zoom: Locator, first: float, last: float, panel: int = 0) -> None:
    box = zoom.locator(".u-over").nth(panel).bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + first * box["width"], box["y"] + 30)
    page.mouse.down()
    page.mouse.move(box["x"] + last * box["width"], box["y"] + 40, steps=6)
    page.mouse.up()


def test_dragging_zooms_and_a_double_click_shows_all(report: Path, visitor: Visitor) -> None:
    visit = visitor(report.as_uri())
    page = visit.go("")
    zoom = chart(page)
    whole = ends(zoom)
    assert whole[0] == pytest.approx(START)
    for panel in (0, 1):
        drag(page, zoom, 0.5, 0.75, panel)
        found = ends(zoom)
        wide = whole[1] - whole[0]
        assert found[0] == pytest.approx(whole[0] + 0.5 * wide, abs=0.02 * wide)
        assert found[1] == pytest.approx(whole[0] + 0.75 * wide, abs=0.02 * wide)
        zoom.locator(".u-over").nth(panel).dblclick()
        assert ends(zoom) == whole
    assert visit.addresses == ["about:blank", report.as_uri()] or visit.addresses == [report.as_uri()]


def test_keys_zoom_move_and_show_all(report: Path, visitor: Visitor) -> None:
    page = visitor(report.as_uri()).go("")
    zoom = chart(page)
    whole = ends(zoom)
    zoom.focus()
    page.keyboard.press("+")
    near = ends(zoom)
    assert near[1] - near[0] == pytest.approx(0.6 * (whole[1] - whole[0]))
    page.keyboard.press("ArrowRight")
    moved = ends(zoom)
    assert moved[0] > near[0]
    assert moved[1] - moved[0] == pytest.approx(near[1] - near[0])
    for _ in range(9):
        page.keyboard.press("ArrowRight")
    assert ends(zoom)[1] == whole[1]
    page.keyboard.press("Escape")
    assert ends(zoom) == whole
    for _ in range(60):
        page.keyboard.press("+")
    least = ends(zoom)
    assert 0 < least[1] - least[0] < 0.05 * (whole[1] - whole[0])
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    out = ends(zoom)
    assert out[1] - out[0] > least[1] - least[0]
    zoom.get_by_role("button", name="Show all").click()
    assert ends(zoom) == whole


def test_the_cursor_says_when_and_how_much(report: Path, visitor: Visitor) -> None:
    page = visitor(report.as_uri()).go("")
    zoom = chart(page)
    box = zoom.locator(".u-over").first.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 0.9 * box["width"], box["y"] + 30)
    expect(zoom.locator(".when")).to_have_text(re.compile(r"2023-11-\d\d \d\d:\d\d:\d\d UTC"))
    expect(zoom.locator(".key b").first).to_have_text(re.compile(r"^\d"))
    assert re.search(r"\d\d:\d\d", zoom.inner_text())


def test_charts_fit_a_phone_and_the_dark(report: Path, visitor: Visitor) -> None:
    page = visitor(report.as_uri(), width=390, height=800, dark=True).go("")
    for name in ("trends", "damage", "forecast"):
        chart(page, name)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    page.set_viewport_size({"width": 900, "height": 800})
    page.wait_for_function("document.querySelector('.zoom canvas').getBoundingClientRect().width > 700")


def test_figures_can_be_saved_as_picture_and_data(report: Path, visitor: Visitor) -> None:
    page = visitor(report.as_uri()).go("")
    figure = page.locator('figure[data-name="trends"]').first
    starts = {"SVG": b"<svg ", "PNG": b"\x89PNG", "CSV": b"time_s,"}
    for kind, start in starts.items():
        with page.expect_download() as download:
            figure.get_by_role("button", name=f"as {kind}").click()
        assert download.value.suggested_filename == f"trends-1.{kind.lower()}"
        found = download.value.path().read_bytes()
        assert found.startswith(start)
        assert kind != "SVG" or b"var(--" not in found


def test_without_scripts_the_pictures_stand(report: Path, visitor: Visitor) -> None:
    page = visitor(report.as_uri(), script=False).go("")
    figures = page.locator("figure")
    assert figures.count() > 3
    for at in range(figures.count()):
        expect(figures.nth(at).locator("svg").first).to_be_visible()
    assert page.locator(".zoom").count() == 0


def test_on_paper_the_pictures_stand(report: Path, visitor: Visitor) -> None:
    page = visitor(report.as_uri()).go("")
    zoom = chart(page)
    expect(page.locator('figure[data-name="trends"] .wide').first).to_be_hidden()
    page.emulate_media(media="print")
    expect(zoom).to_be_hidden()
    expect(page.locator('figure[data-name="trends"] .wide svg').first).to_be_visible()


def test_nothing_else_may_run_on_the_page(report: Path, visitor: Visitor, tmp_path: Path) -> None:
    text = report.read_text(encoding="utf-8")
    added = tmp_path / "added.html"
    added.write_text(
        text.replace("</main>", "<script>window.strange = 1</script><i onclick='window.strange=1'>x</i></main>")
    )
    visit = visitor(added.as_uri())
    page = visit.go("")
    chart(page)
    page.locator("main > i").click()
    assert page.evaluate("window.strange") is None
    assert page.title() == EVIL
    assert len(visit.trouble) == 2
    assert all("Content Security Policy" in trouble for trouble in visit.trouble)
    visit.trouble.clear()
