"""Take the pictures of a machine whose speed varies: its page and its report, over orders of the shaft.

python -m benchmarks.varying_pictures [FOLDER]      needs Chromium, 400 MB of temporary files, and two minutes

A winch hunts by 15 % within each block, about a mean speed that wanders from 17 to 28 Hz; a tacho gives eight pulses a
turn. The outer race of its bearing becomes damaged; for three blocks, the tacho is disturbed. All pictures go to
FOLDER, those of the manual to docs/pictures.
"""

from __future__ import annotations

import shutil
import socket
import sys
import tempfile
import time
from contextlib import ExitStack
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser, FloatRect, sync_playwright

from benchmarks.page_pictures import free_port, running, taken
from benchmarks.regression.trees import ROOT
from monitor.report.report import build_report
from tests.support.signals import bearing_lines

RATE, SECONDS, BLOCKS = 12_800, 4.0, 150
FIRST_BAD, DISTURBED = 95, range(60, 63)
PULSES, DESIGNATION = 8, "6310"
INTERVAL_S = 120.0
TEXT = """
[machine]
name = "winch-02"
timezone = "Europe/Rome"
spectra_interval_s = 60
state_dir = "{folder}/winch-02/state"
records_dir = "{folder}/winch-02/records"
[[source]]
name = "logger"
url = "folder:{folder}/in"
rate_hz = {rate}
block_s = "file"
start_utc = "{begin}"
time_from = "count"
interval_s = {interval}
settle_s = 0.1
[operating]
speed_hz = 22.5
tacho_channel = 3
pulses_per_revolution = {pulses}
[detect]
learn_blocks = 40
run_in_blocks = 10
[[bearing]]
name = "drum"
designation = "{designation}"
[[channel]]
name = "radial"
source = "logger"
column = 1
unit = "m/s2"
bearing = "drum"
[[channel]]
name = "axial"
source = "logger"
column = 2
unit = "m/s2"
bearing = "drum"
"""


def turns_of(number: int, generator: np.random.Generator) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return angle (revolutions) and speed (Hz) at each sample of a block, both shape (sample,)."""
    at = np.arange(round(RATE * SECONDS)) / RATE
    mean = 22.5 + 4.5 * np.sin(2.0 * np.pi * number / 53.0) + 1.0 * np.sin(2.0 * np.pi * number / 17.0)
    swing, turn = 0.15 * generator.uniform(0.8, 1.2), generator.uniform(0.0, 2.0 * np.pi)
    slow = 2.0 * np.pi * generator.uniform(0.25, 0.45)
    speed = mean * (1.0 + swing * np.sin(slow * at + turn))
    angle = mean * (at - swing / slow * (np.cos(slow * at + turn) - np.cos(turn)))
    return angle + generator.uniform(0.0, 1.0), speed


def block(number: int) -> NDArray[np.float32]:
    """Return two sensors and the tacho of a block, shape (sample, 3): m/s2 and V."""
    generator = np.random.default_rng(1000 + number)
    angle, speed = turns_of(number, generator)
    _, lines = bearing_lines(DESIGNATION, 1.0)
    level = (speed / 22.5) ** 1.2
    x = level * generator.normal(0.0, 1.2, angle.size)
    for order, height in ((1.0, 0.8), (2.0, 0.4), (7.0, 0.3)):
        x += height * level * np.cos(2.0 * np.pi * order * angle + order)
    if number >= FIRST_BAD:
        x += (1.5 + 0.10 * (number - FIRST_BAD)) * _impacts(angle, speed, lines.bpfo, generator)
    y = 0.5 * x + 0.6 * generator.normal(size=x.size)
    edges = np.mod(angle * PULSES, 1.0) < 0.3
    tacho = 5.0 * edges + generator.normal(0.0, 0.05, x.size)
    if number in DISTURBED:
        tacho = generator.normal(0.0, 2.0, x.size)
    return np.stack([x, y, tacho], axis=1).astype(np.float32)


def _impacts(
    angle: NDArray[np.float64], speed: NDArray[np.float64], order: float, generator: np.random.Generator
) -> NDArray[np.float64]:
    """Return ringing once a passage of an element, with slip; shape (sample,)."""
    wanted = np.arange(np.ceil(angle[0] * order), angle[-1] * order) / order
    wanted = wanted + generator.normal(0.0, 0.01 / order, wanted.size)
    places = np.searchsorted(angle, wanted)
    places = places[(places > 0) & (places < angle.size)]
    train = np.zeros(angle.size)
    train[places] = (speed[places] / 22.5) ** 1.2 * generator.uniform(0.8, 1.2, places.size)
    at = np.arange(round(0.006 * RATE)) / RATE
    return np.convolve(train, 8.0 * np.exp(-at / 8e-4) * np.sin(2.0 * np.pi * 3200.0 * at))[: angle.size]


def write(folder: Path) -> Path:
    """Write the recording and the configuration; return the path of the latter."""
    (folder / "in").mkdir(parents=True)
    for number in range(1, BLOCKS + 1):
        np.save(folder / "in" / f"b{number:04d}.npy", block(number))
    path = folder / "winch.toml"
    begin = datetime.fromtimestamp(time.time() - (BLOCKS - 0.5) * INTERVAL_S, UTC).isoformat()
    values = {"rate": RATE, "begin": begin, "interval": INTERVAL_S, "pulses": PULSES, "designation": DESIGNATION}
    path.write_text(TEXT.format(folder=folder, **values), encoding="utf-8")
    return path


def wait_for(port: int) -> None:
    """Return when the page is served, after a minute at the latest."""
    for _ in range(120):
        with socket.socket() as asked:
            if asked.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.5)
    sys.exit(f"nothing listens at port {port}")


def take(browser: Browser, address: str, report: Path, out: Path) -> list[Path]:
    """Take the pictures; return their paths."""
    found: list[Path] = []
    page = browser.new_page(viewport={"width": 1400, "height": 1150}, color_scheme="light")
    page.goto(f"{address}#/channel/winch-02/radial")
    page.wait_for_timeout(4000.0)
    page.screenshot(path=out / "page.png", full_page=True)
    top, end = page.locator(".columns").bounding_box(), page.locator(".figure:has-text('Spectra over')").bounding_box()
    assert top is not None
    assert end is not None
    clip: FloatRect = {
        "x": 0.0,
        "y": top["y"] - 6.0,
        "width": 1400.0,
        "height": end["y"] + end["height"] - top["y"] + 12.0,
    }
    page.screenshot(path=out / "page-orders.png", full_page=True, clip=clip)
    page.locator(".figure:has-text('Spectra over the life') select").select_option("hertz")
    page.wait_for_timeout(1500.0)
    page.locator(".figure:has-text('Spectra over the life')").first.screenshot(path=out / "waterfall-hertz.png")
    page.goto(report.as_uri())
    page.wait_for_timeout(1500.0)
    page.screenshot(path=out / "report.png", full_page=True)
    for name in ("speed", "waterfall", "envelope"):
        figure = page.locator(f'figure[data-name="{name}"]').first
        if figure.count():
            path = out / f"report-{name}.png"
            figure.screenshot(path=path)
            found.append(path)
    page.close()
    return [out / "page-orders.png", *found]


def main() -> None:
    """Record, replay, and take the pictures."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        sys.exit("needs Chromium on the path")
    with tempfile.TemporaryDirectory() as name, ExitStack() as running_all:
        folder = Path(name)
        out = Path(sys.argv[1]) if len(sys.argv) > 1 else folder
        out.mkdir(parents=True, exist_ok=True)
        path = write(folder)
        daemon = running_all.enter_context(running("run", "--config", path, "--no-page", "--quiet"))
        while taken(folder, "winch-02", daemon) < BLOCKS:
            time.sleep(0.5)
        report = build_report(folder / "winch-02" / "state" / "state.db", folder / "report.html")
        port = free_port()
        running_all.enter_context(running("page", "--config", path, "--port", str(port), "--quiet"))
        wait_for(port)
        playwright = running_all.enter_context(sync_playwright())
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        pictures = take(browser, f"http://127.0.0.1:{port}/", report, out)
        browser.close()
        with Image.open(pictures[0]) as image:
            image.convert("RGB").quantize(256).save(ROOT / "docs" / "pictures" / "page-orders.png", optimize=True)


if __name__ == "__main__":
    main()
