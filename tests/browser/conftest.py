"""One browser for all tests, and pages that remember whatever went wrong on them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright

from tests.browser.machine import Served
from tests.conftest import chromium_program
from tests.support.waiting import PATIENCE_S, wait_until

ALLOWED = ("data:", "blob:", "about:")
PATIENCE_MS = 1e3 * PATIENCE_S
expect.set_options(timeout=PATIENCE_MS)


class Visit:
    """A page and what went wrong on it."""

    def __init__(self, page: Page, url: str) -> None:
        """Open nothing yet; ``url`` is the page's address."""
        self.page = page
        self.url = url
        self.trouble: list[str] = []
        self.addresses: list[str] = []
        self._listeners: dict[Any, Callable[..., None]] = {
            "console": lambda message: self._console(message.type, message.text),
            "pageerror": lambda error: self.trouble.append(f"error: {error}"),
            "response": lambda response: self._answered(response.status, response.url),
            "request": lambda request: self._asked(request.url),
        }
        for name, listener in self._listeners.items():
            self.page.on(name, listener)

    def _console(self, kind: str, text: str) -> None:
        # What failed to load is written down with its address.
        if kind in ("error", "warning") and not text.startswith("Failed to load resource: the server responded"):
            self.trouble.append(f"{kind}: {text}")

    def _answered(self, status: int, url: str) -> None:
        if status >= 400:
            self.trouble.append(f"{status}: {url}")

    def _asked(self, url: str) -> None:
        self.addresses.append(url)
        if not url.startswith(ALLOWED) and urlsplit(url).netloc != urlsplit(self.url).netloc:
            self.trouble.append(f"asked another host: {url}")

    def go(self, view: str = "#/") -> Page:
        """Open a view, as one opens an address."""
        self.page.goto("about:blank")
        self.page.goto(self.url + view)
        return self.page

    def forget(self) -> None:
        """Leave the page as it was before the visit."""
        for name, listener in self._listeners.items():
            self.page.remove_listener(name, listener)
        self.page.unroute_all()
        self.page.emulate_media(media="null")
        if self.page.url.startswith("http"):
            self.page.evaluate("localStorage.clear(); sessionStorage.clear()")
        self.page.context.clear_cookies()
        self.page.mouse.move(0, 0)
        self.page.goto("about:blank")


Visitor = Callable[..., Visit]


@pytest.fixture(scope="package")
def browser() -> Iterator[Browser]:
    """Chromium of the system; while it runs, no other event loop can run in this thread."""
    with sync_playwright() as playwright:
        program = chromium_program()
        assert program is not None
        found = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield found
        found.close()


Screen = tuple[int, int, bool, bool]
"""Width and height, whether the system is dark, whether scripts run."""


@pytest.fixture(scope="package")
def screens(browser: Browser) -> Callable[[Screen], Page]:
    """Pages of the browser, one for each screen: most of the work of a new one is to compile its program again."""

    @cache
    def opened(screen: Screen) -> Page:
        width, height, dark, script = screen
        page = browser.new_page(
            viewport={"width": width, "height": height},
            color_scheme="dark" if dark else "light",
            java_script_enabled=script,
            reduced_motion="reduce",
        )
        page.set_default_timeout(PATIENCE_MS)
        return page

    return opened


@pytest.fixture
def visitor(screens: Callable[[Screen], Page]) -> Iterator[Visitor]:
    """Visit pages that remember nothing of another test, one visit at a time on a screen.

    At the end of the test nothing may have gone wrong on any, but for what was taken from its list.
    """
    visits: list[Visit] = []

    def open_page(url: str, *, width: int = 1400, height: int = 900, dark: bool = False, script: bool = True) -> Visit:
        visits.append(Visit(screens((width, height, dark, script)), url))
        return visits[-1]

    yield open_page
    for visit in visits:
        visit.forget()
    assert [visit.trouble for visit in visits if visit.trouble] == []


@pytest.fixture(scope="package")
def pump(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A daemon with a bearing that has turned bad, and one that is well."""
    served = Served(tmp_path_factory.mktemp("pump"))
    served.start()
    served.put(30)
    # One file that holds nothing a monitor could use; its name is a trap for whoever writes it into a page.
    served.put_bytes(TRAP, b"this is no csv file\n\x00\x01\x02")
    wait_until(lambda: served.status()["sources"]["s"]["rejected"] == 1)
    served.trapped = 1
    served.put(12, damage=30.0)
    yield served
    served.stop()


TRAP = "<img src=x onerror=window.trapped=1>.csv"


@pytest.fixture
def fresh(tmp_path: Path) -> Iterator[Served]:
    """A daemon of the test's own, with a page and no block yet."""
    served = Served(tmp_path)
    served.start()
    yield served
    served.stop()
