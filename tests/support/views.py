"""Makers and checks that tests of views share."""

from __future__ import annotations

from playwright.sync_api import Page

BAD, WELL = "#/channel/pump/x0", "#/channel/pump/x1"


def drawn(page: Page, selector: str) -> int:
    """Return how many different colours a canvas shows: a picture that is not drawn has one."""
    return page.locator(selector).first.evaluate(
        "canvas => new Set(new Uint32Array(canvas.getContext('2d')"
        ".getImageData(0, 0, canvas.width, canvas.height).data.buffer)).size"
    )
