"""The import desk: from a folder to a saved configuration, by keyboard alone, and on a phone."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from monitor.config.load import load_config
from tests.browser.conftest import Visitor
from tests.browser.machine import Served
from tests.support.press import write_press


@pytest.fixture(scope="module")
def shop(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A daemon whose page has a desk, and a folder of a logger."""
    folder = tmp_path_factory.mktemp("shop")
    served = Served(folder, web='[web]\nport = 0\nimport_folders = ["recordings"]\n')
    write_press(folder / "recordings" / "press", damage=6.0)
    served.start()
    yield served
    served.stop()


def press_until(page: Page, key: str, selector: str) -> None:
    """Press a key until the focus is on an element that a selector finds."""
    for _ in range(60):
        page.keyboard.press(key)
        if page.evaluate("selector => document.activeElement.matches(selector)", selector):
            return
    raise AssertionError(f"{key} does not lead to {selector}")


def type_into(page: Page, name: str, words: str) -> None:
    press_until(page, "Tab", f'input[name="{name}"]')
    page.keyboard.type(words)


@pytest.mark.browser
def test_a_folder_becomes_a_configuration_by_keyboard_alone(shop: Served, visitor: Visitor) -> None:
    visit = visitor(shop.url, width=390, height=844)
    page = visit.go("#/import")
    expect(page.get_by_role("heading", level=1)).to_have_text("Import a recording")
    press_until(page, "Tab", 'input[type="password"]')
    page.keyboard.type(shop.token)
    page.keyboard.press("Enter")
    expect(page.get_by_role("button", name="recordings/")).to_be_focused()
    page.keyboard.press("Enter")
    expect(page.get_by_role("button", name="Read this folder")).to_be_visible()
    press_until(page, "Tab", ".entry")
    page.keyboard.press("Enter")
    expect(page.get_by_role("button", name="2026-03-01_000000.csv")).to_be_visible()
    press_until(page, "Tab", "button.main")
    page.keyboard.press("Enter")
    expect(page.get_by_role("table", name="Columns of the first file")).to_contain_text("drive end (g)")
    expect(page.get_by_role("img", name="Spectrum of drive_end")).to_be_visible()
    type_into(page, "bearing", "6205")
    type_into(page, "speed_hz", "1770")
    page.keyboard.press("Enter")
    expect(page.locator('input[name="speed_hz"]')).to_be_focused()
    expect(page.locator(".field", has=page.locator('input[name="speed_hz"]'))).to_contain_text("did you mean 1770 rpm?")
    visit.trouble.remove(next(line for line in visit.trouble if line.startswith("400: ")))
    page.keyboard.type(" rpm")
    page.keyboard.press("Enter")
    expect(page.get_by_role("table", name="First lines of drive_end")).to_contain_text("105.8")
    expect(page.get_by_role("heading", name="What check says")).to_be_visible()
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    # A column is left out, and taken again.
    press_until(page, "Tab", 'input[type="checkbox"][value="other end (g)"]')
    page.keyboard.press("Space")
    expect(page.get_by_role("heading", name="other_end")).to_have_count(0)
    press_until(page, "Tab", "#desk-file")
    page.keyboard.press("Enter")
    expect(page.get_by_role("status").filter(has_text="Saved as press.toml")).to_be_visible()
    config = load_config(shop.folder / "press.toml")
    assert [channel.column for channel in config.channel] == ["drive end (g)"]
    assert config.operating.speed_hz == pytest.approx(29.5)
    page.keyboard.press("Enter")
    expect(page.locator(".saved")).to_contain_text("press.toml is there already")
    visit.trouble.remove(next(line for line in visit.trouble if line.startswith("400: ")))


@pytest.mark.browser
def test_each_column_is_given_a_unit_of_its_own(shop: Served, visitor: Visitor) -> None:
    noise = np.random.default_rng(4).normal(size=(5000, 2)) * [98.1, 0.5]
    place = shop.folder / "recordings" / "mixed.csv"
    np.savetxt(place, noise, "%.6f", ",", header="Sample rate: 5000 Hz\nDE,NDE", comments="")
    page = visitor(shop.url, width=390, height=844).go("#/import")
    page.locator('input[type="password"]').fill(shop.token)
    page.keyboard.press("Enter")
    page.get_by_role("button", name="recordings/").click()
    page.get_by_role("button", name="mixed.csv").click()
    columns = page.get_by_role("table", name="Columns of the first file")
    page.get_by_label("Unit of DE", exact=True).fill("mV")
    page.keyboard.press("Tab")
    expect(page.get_by_label("Sensitivity of DE")).to_be_visible()
    expect(page.get_by_label("NDE is vibration")).to_be_focused()
    page.get_by_label("Sensitivity of DE").fill("98.1 mV/g")
    page.get_by_label("Unit of NDE").fill("g")
    page.keyboard.press("Tab")
    expect(columns).to_contain_text("g (your answer)")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    type_into(page, "bearing", "6205")
    type_into(page, "speed_hz", "estimate")
    page.keyboard.press("Enter")
    page.locator("#desk-file").press("Enter")
    expect(page.get_by_role("status").filter(has_text="Saved as mixed.toml")).to_be_visible()
    de, nde = load_config(shop.folder / "mixed.toml").channel
    assert (de.unit, de.scale, de.sensitivity_mv_per_g) == ("V", 1e-3, 98.1)
    assert (nde.unit, nde.scale, nde.sensitivity_mv_per_g) == ("g", None, None)


@pytest.mark.browser
def test_without_folders_the_page_offers_no_import(pump: Served, visitor: Visitor) -> None:
    page = visitor(pump.url).go("#/import")
    expect(page.get_by_role("heading", level=1)).to_have_text("Machines")
    expect(page.locator("#nav-import")).to_be_hidden()
