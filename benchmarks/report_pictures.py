"""Draw the pictures of docs/how-to/reports.md: the first screen of a report, and a page of its evidence.

python -m benchmarks.report_pictures        needs Chromium, and about a minute for the demo that it reports
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

from click.testing import CliRunner
from PIL import Image
from playwright.sync_api import sync_playwright

from monitor.commands.demo import command as demo

ROOT = Path(__file__).resolve().parents[1]
WIDTH, HEIGHT = 1000, 900
SEED = "2"
PICTURES = [ROOT / "docs" / "pictures" / f"{name}.png" for name in ("report", "report_path", "report_forecast")]


def main() -> None:
    """Run the demo with the physical tracker and take the pictures of its page."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        sys.exit("needs Chromium on the path")
    with tempfile.TemporaryDirectory() as name, sync_playwright() as playwright:
        folder = Path(name) / "demo"
        outcome = CliRunner().invoke(demo, ["--seed", SEED, "--method", "filter", "--out", str(folder), "--quiet"])
        if outcome.exception is not None:
            raise outcome.exception
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page(
            viewport={"width": WIDTH, "height": HEIGHT}, color_scheme="light", java_script_enabled=False
        )
        page.goto((folder / "report.html").as_uri())
        page.screenshot(path=PICTURES[0])
        for figure, picture in zip(("path", "forecast"), PICTURES[1:], strict=True):
            page.locator(f'figure[data-name="{figure}"]').first.screenshot(path=picture)
        browser.close()
    for picture in PICTURES:
        # Few colours are seen, and a palette takes a third of the space.
        with Image.open(picture) as image:
            image.convert("RGB").quantize(128).save(picture, optimize=True)


if __name__ == "__main__":
    main()
