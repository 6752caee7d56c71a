"""Readable by everybody: on a phone, in the dark, by keyboard, by name."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from playwright.sync_api import expect

from tests.browser.conftest import Visitor
from tests.browser.machine import Served
from tests.support.effort import effort_count

VIEWS = ("#/", "#/channel/pump/x0", "#/events", "#/files", "#/channel/pump/x1")[: effort_count(quick=4, full=5)]
STATIC = Path(__file__).parents[2] / "monitor" / "web" / "static"

NAMELESS = """
() => [...document.querySelectorAll(
    'a[href], button, input, select, textarea, summary, [role=img], [role=slider], [role=region], section, nav')]
  .filter(e => e.checkVisibility())
  .filter(e => !(e.getAttribute('aria-label') || e.textContent.trim() || e.labels?.length
      || document.getElementById(e.getAttribute('aria-labelledby') ?? '')))
  .map(e => e.outerHTML.slice(0, 200))
"""
TWICE = """
() => { const ids = [...document.querySelectorAll('[id]')].map(e => e.id);
  return ids.filter((id, i) => ids.indexOf(id) !== i) }
"""


@pytest.mark.browser
@pytest.mark.parametrize("view", VIEWS)
def test_every_view_fits_a_phone_in_the_dark(pump: Served, visitor: Visitor, view: str) -> None:
    page = visitor(pump.url, width=360, height=800, dark=True).go(view)
    expect(page.get_by_role("heading", level=1)).to_be_visible()
    page.wait_for_load_state("load")
    if "channel" in view:
        expect(page.locator('[data-chart="rms"] canvas')).to_be_visible()
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    red, green, blue = map(
        int, re.findall(r"\d+", page.evaluate("getComputedStyle(document.body).backgroundColor"))[:3]
    )
    assert red + green + blue < 150
    page.get_by_role("button", name=re.compile("Theme")).click()
    assert page.evaluate("document.documentElement.dataset.theme") == "light"
    red, green, blue = map(
        int, re.findall(r"\d+", page.evaluate("getComputedStyle(document.body).backgroundColor"))[:3]
    )
    assert red + green + blue > 600


@pytest.mark.browser
@pytest.mark.parametrize("view", VIEWS)
def test_every_control_has_a_name(pump: Served, visitor: Visitor, view: str) -> None:
    page = visitor(pump.url).go(view)
    expect(page.get_by_role("heading", level=1)).to_be_visible()
    if "channel" in view:
        expect(page.get_by_role("slider")).to_be_visible()
    assert page.evaluate(NAMELESS) == []
    assert page.evaluate(TWICE) == []
    assert page.locator("h1").count() == 1
    assert page.locator("html").get_attribute("lang") == "en"
    for landmark in ("banner", "main", "navigation"):
        assert page.get_by_role(landmark).count() >= 1, landmark
    assert page.locator("[style]").evaluate_all("all => all.filter(e => e.tagName === 'SCRIPT').length") == 0


@pytest.mark.browser
def test_all_can_be_done_by_keyboard(pump: Served, visitor: Visitor) -> None:
    page = visitor(pump.url).go()
    expect(page.locator(".row")).to_have_count(2)
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.className") == "skip"
    assert page.evaluate("getComputedStyle(document.activeElement).outlineStyle") != "none"
    page.keyboard.press("?")
    dialog = page.get_by_role("dialog", name="Help")
    expect(dialog).to_contain_text("Out of specification")
    page.keyboard.press("Escape")
    expect(dialog).to_have_count(0)
    page.keyboard.press("/")
    page.keyboard.type("x0")
    expect(page.locator(".row:visible")).to_have_count(1)
    for _ in range(8):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.closest('.row') !== null"):
            break
    page.keyboard.press("Enter")
    expect(page.get_by_role("heading", level=1)).to_contain_text("x0")
    page.keyboard.press("e")
    expect(page.get_by_role("heading", level=1)).to_have_text("Events")
    page.keyboard.press("m")
    expect(page.get_by_role("heading", level=1)).to_have_text("Machines")


def luminance(colour: str) -> float:
    """Return the relative luminance of #rrggbb (WCAG 2.2)."""
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    """Return the contrast of two colours (WCAG 2.2)."""
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def themes() -> list[dict[str, str]]:
    """Return the colours of each block of the style sheet."""
    blocks = re.findall(r"\{[^{}]*--ground[^{}]*\}", (STATIC / "theme.css").read_text())
    return [dict(re.findall(r"--([\w-]+): (#\w{6});", block)) for block in blocks]


def test_text_can_be_read_on_its_ground() -> None:
    found = themes()
    assert len(found) == 3
    for theme in found:
        for ground in ("ground", "surface", "faint"):
            for ink in ("text", "soft", "accent"):
                assert contrast(theme[ink], theme[ground]) >= 4.5, (ink, ground)
        for ink in ("series", "series-two", "outer", "inner", "ball", "cage", "alert", "danger", "mark", "failure"):
            assert contrast(theme[ink], theme["surface"]) >= 3.0, ink


def test_the_dark_theme_is_the_same_by_choice_and_by_the_system() -> None:
    _, chosen, system = themes()
    assert chosen == system


def test_the_page_is_small_and_brings_all_it_needs() -> None:
    files = [path for path in STATIC.rglob("*") if path.is_file()]
    # Sent compressed, a third of it: 114 kB of the overview (python -m benchmarks.page_load).
    assert sum(path.stat().st_size for path in files if not path.name.startswith("desk")) < 300_000
    # Read by admins who import, when they do.
    assert sum(path.stat().st_size for path in files if path.name.startswith("desk")) < 25_000
    assert (STATIC / "vendor" / "uPlot.LICENSE").read_text().startswith("The MIT License")
    for path in files:
        if path.suffix in (".js", ".css", ".html") and "vendor" not in path.parts:
            text = path.read_text()
            assert "innerHTML" not in text, path.name
            assert not re.findall(r"(?:src|href|import|fetch|url)\W{1,3}https?:", text), path.name
    page = (STATIC / "index.html").read_text()
    # The words of the page are data, which no browser runs.
    assert not re.findall(r'<script(?![^>]*\bsrc=|\stype="application/json")|\sstyle=|\son\w+=', page)
