"""Take the pictures of the page: one channel, all channels, and on a phone.

python -m benchmarks.page_pictures        needs Chromium, 500 MB of temporary files, and two minutes

Three machines are watched by daemons of their own: a fan whose drive end is the demo's bearing that wears out, with its
neighbours; a mill whose logger stopped; a pump whose channels are dead half of the time.
"""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser, sync_playwright

from benchmarks.regression.trees import ROOT, Tree
from models.machine.rig import Rig
from models.maps.file import save_map
from monitor.commands.demo import SHIPPED, _demo_map, demo_config
from streams.rig import INTERVAL, RATE, SimulatedRig
from tests.support.signals import HealthyMachine, bearing_lines, impacts

HEALTHY, BLOCKS, LEARN = 130, 222, 80
WORN_SEED = 1
SECONDS, SLOW_S, FEW = 4.0, 5.0, 60
PAGES: dict[str, tuple[str, int, int, Literal["light", "dark"]]] = {
    "page": ("#/channel/fan-12/drive_end", 1400, 1290, "light"),
    "page-machines": ("#/", 1400, 880, "light"),
    "page-phone": ("#/channel/fan-12/drive_end", 360, 870, "dark"),
}
TREE = Tree("present", ROOT)


def machine_text(name: str, folder: Path, begin: float, interval: float, learn: int, more: str) -> str:
    """Return the configuration of a machine that watches a folder of .npy files."""
    return f"""
[machine]
name = "{name}"
timezone = "Europe/Rome"
state_dir = "{folder / name / "state"}"
records_dir = "{folder / name / "records"}"
spectra_interval_s = 1
[[source]]
name = "logger"
url = "folder:{folder / name / "in"}"
rate_hz = {RATE}
range_g = 50.0
settle_s = 0.1
block_s = "file"
start_utc = "{datetime.fromtimestamp(begin, UTC).isoformat()}"
time_from = "count"
interval_s = {interval}
[detect]
learn_blocks = {learn}
run_in_blocks = 15
{more}
"""


FAN = """
[rig]
calibrated = "declared"
[shaft]
calibrated = "declared"
[operating]
speed_hz = 40.0
speed_exact = true
load_newton = 4000.0
[track]
method = "library"
[forecast]
method = "library"
window_hours = 4.0
[[alarms.level]]
feature = "rms"
alert_sd = 6
danger_g = 1.2
[[alarms.level]]
feature = "tt_lower"
channels = ["drive_end"]
alert_hours = 8
danger_hours = 2
[[alarms.level]]
feature = "kurtosis"
alert = 9
[[bearing]]
name = "drive_end"
designation = "1205 ETN9"
[[bearing]]
name = "coupling"
designation = "22207"
[[bearing]]
name = "free_end"
designation = "22207"
"""


def channel(name: str, column: int, bearing: str, more: str = "") -> str:
    """Return the table of a channel."""
    return (
        f'[[channel]]\nname = "{name}"\nsource = "logger"\ncolumn = {column}\nunit = "m/s2"\nbearing = "{bearing}"\n'
        f"rms_band_hz = [0, 9500]\n{more}"
    )


def fan_blocks() -> Iterator[NDArray[np.float32]]:
    """Yield the blocks of the bench on which a bearing wears out, (sample, channel)."""
    return (block.samples.T for block in SimulatedRig("fan", WORN_SEED, healthy_blocks=HEALTHY, blocks=BLOCKS))


def mill_blocks() -> Iterator[NDArray[np.float32]]:
    """Yield blocks of two sensors on a bearing whose outer race becomes damaged."""
    rng = np.random.default_rng(7)
    _, lines = bearing_lines("6310", 24.0)
    machine = HealthyMachine.draw(rng, 24.0, lines.bpfo)
    for number, level in enumerate(machine.levels(rng, FEW).tolist()):
        x = np.stack([machine.block(rng, level, RATE, round(SECONDS * RATE)) for _ in range(2)], axis=1)
        if number > FEW // 2:
            hit = impacts(rng, "outer", lines, rate=RATE, duration=SECONDS, height=20.0, noise=0.0)
            x += np.outer(hit, [1.0, 0.7])
        yield x.astype(np.float32)


def pump_blocks() -> Iterator[NDArray[np.float32]]:
    """Yield blocks of three sensors that are dead in two blocks of three, after the first twenty."""
    rng = np.random.default_rng(8)
    for number in range(FEW):
        x = rng.standard_normal((round(SECONDS * RATE), 3))
        yield (x * (number < 20 or number % 3 == 0)).astype(np.float32)


def feed(folder: Path, blocks: Iterator[NDArray[np.float32]], ready: Callable[[], int]) -> int:
    """Put blocks into a folder, at most 30 ahead of those that were taken; return how many."""
    number = 0
    for number, samples in enumerate(blocks, 1):
        hidden = folder / f".{number}.tmp"
        with hidden.open("wb") as file:
            np.save(file, samples)
        hidden.rename(folder / f"b{number:04d}.npy")
        while number - ready() > 30:
            time.sleep(0.2)
    return number


@contextmanager
def running(*arguments: str | Path) -> Iterator[subprocess.Popen[bytes]]:
    """Run a command of the product beside."""
    process = subprocess.Popen([*TREE.command, *map(str, arguments)], cwd=ROOT)
    try:
        yield process
    finally:
        process.terminate()
        process.wait()


def status(folder: Path, name: str) -> dict[str, Any]:
    """Return what a daemon says of itself, {} before it does."""
    path = folder / name / "state" / "status.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def taken(folder: Path, name: str, daemon: subprocess.Popen[bytes]) -> int:
    """Return how many blocks a daemon has taken or rejected; exit where it has ended."""
    if daemon.poll() is not None:
        sys.exit(f"the daemon of {name} ended with {daemon.returncode}")
    sources = status(folder, name).get("sources", {})
    found = sources.get("logger", {})
    rejected = found.get("rejected", 0)
    return found.get("accepted", 0) + (sum(rejected.values()) if isinstance(rejected, dict) else rejected)


def write_machines(folder: Path) -> dict[str, Iterator[NDArray[np.float32]]]:
    """Write the configurations, with map and library of the demo; return the blocks of each machine."""
    config = demo_config()
    save_map(_demo_map(config, Rig.model, quiet=True), folder / "map.nc")
    shutil.copy(SHIPPED, folder / "library.npz")
    tracked = (
        f'track = true\nband_hz = [[7000, 9000]]\nmap = "{folder / "map.nc"}"\nlibrary = "{folder / "library.npz"}"\n'
    )
    few = '[operating]\nspeed_hz = 24.0\n[[bearing]]\nname = "bearing"\ndesignation = "6310"\n'
    now = time.time()
    fan = FAN + channel("drive_end", 1, "drive_end", tracked)
    fan += channel("coupling", 2, "coupling") + channel("free_end", 3, "free_end")
    mill = few + channel("vertical", 1, "bearing") + channel("horizontal", 2, "bearing")
    pump = few + "".join(channel(name, i, "bearing") for i, name in enumerate(("coupling", "drive_end", "free_end"), 1))
    begin = now - (BLOCKS - 0.5) * INTERVAL
    texts = {
        "fan-12": machine_text("fan-12", folder, begin, INTERVAL, LEARN, fan),
        "mill-07": machine_text("mill-07", folder, now - FEW * SLOW_S, SLOW_S, 15, mill),
        "pump-03": machine_text("pump-03", folder, now - FEW * SLOW_S, SLOW_S, 15, pump),
    }
    (folder / "machines").mkdir()
    for name, text in texts.items():
        (folder / name / "in").mkdir(parents=True)
        (folder / "machines" / f"{name}.toml").write_text(text, encoding="utf-8")
    return {"fan-12": fan_blocks(), "mill-07": mill_blocks(), "pump-03": pump_blocks()}


def take(browser: Browser, address: str) -> None:
    """Take the pictures of a page."""
    for name, (view, width, height, scheme) in PAGES.items():
        page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
        page.goto(f"{address}{view}")
        page.wait_for_timeout(5000.0)
        path = ROOT / "docs" / "pictures" / f"{name}.png"
        page.screenshot(path=path)
        page.close()
        # Few colours are seen, and a palette takes a third of the space.
        with Image.open(path) as image:
            image.convert("RGB").quantize(256).save(path, optimize=True)


def main() -> None:
    """Feed three machines and take the pictures of their page."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        sys.exit("needs Chromium on the path")
    with tempfile.TemporaryDirectory() as name, ExitStack() as running_all:
        folder = Path(name)
        fed = write_machines(folder)
        daemons = {
            machine: running_all.enter_context(
                running("run", "--config", folder / "machines" / f"{machine}.toml", "--no-page", "--quiet")
            )
            for machine in fed
        }
        # The machine that falls silent first, then those that go on.
        for machine in ("mill-07", "fan-12", "pump-03"):
            ready = partial(taken, folder, machine, daemons[machine])
            count = feed(folder / machine / "in", fed[machine], ready)
            while ready() < count:
                time.sleep(0.5)
        port = free_port()
        running_all.enter_context(running("page", "--config", folder / "machines", "--port", str(port), "--quiet"))
        time.sleep(10.0)
        playwright = running_all.enter_context(sync_playwright())
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        take(browser, f"http://127.0.0.1:{port}/")
        browser.close()


def free_port() -> int:
    """Return a port that is free now."""
    with socket.socket() as asked:
        asked.bind(("127.0.0.1", 0))
        return asked.getsockname()[1]


if __name__ == "__main__":
    main()
