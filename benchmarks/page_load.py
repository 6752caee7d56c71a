"""How soon the live page is there, in Chromium.

Run as ``python -m benchmarks.page_load [--quick] [--json FILE]``. Milliseconds from the
navigation by the page's own clock, median and worst of several loads, each in a new browser profile (nothing cached),
beside a server of its own on the same machine:

- *content*: the first row of the overview, or the answers of a channel, stand in the page;
- *drawn*: all rows stand; or the trends and the spectrum of a channel are drawn;
- *all*: the waterfall, too;
- *kB*: what was transferred, as packed on the way;
- *longest task*: the longest time for which the page did not react, ms (1,000 rows are the hard part).

The overview has 1,000 channels. The channel has 1,000,000 records 5 s apart (``--quick``: 50,000) and 300 spectra of
1,300 bins behind it; its trends were made beforehand, as they are beside a daemon.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Browser, sync_playwright

from benchmarks.common import Row, arguments, print_table, write_json
from benchmarks.trends import BEGIN, CHANNEL, INTERVAL, fill
from monitor.health.signal.waterfall import SpectrumChange, SpectrumRow
from monitor.records.spectra import write_changes
from monitor.records.store import Store

Selectors = tuple[str, ...]
MANY = 1000
_CLI = "from monitor.cli import main; main()"
_SPECTRA, _BINS = 300, 1300
_WATCH = """
window.longest = 0;
new PerformanceObserver(list => {
  for (const entry of list.getEntries()) window.longest = Math.max(window.longest, entry.duration);
}).observe({type: 'longtask', buffered: true});
window.seen = {};
const watched = %s;
new MutationObserver(() => {
  for (const [name, selectors] of Object.entries(watched))
    if (!window.seen[name] && selectors.every(selector => document.querySelector(selector)))
      requestAnimationFrame(() => window.seen[name] ??= performance.now());
}).observe(document, {subtree: true, childList: true});
"""
"""Remembers when what is waited for first stood in a frame, in ms from the navigation."""
_ROWS = (f".rows > .row:nth-child({MANY // 2})",)
_CHARTS = ('[data-chart="rms"] canvas', "[aria-label^='Envelope spectrum of'] canvas")
_ALL = (*_CHARTS, ".board")


def _machine(folder: Path, name: str, source: str, channels: list[str]) -> Path:
    parts = [
        f'[machine]\nname = "{name}"\nstate_dir = "{name}"\nrecords_dir = "{name}/records"\n[web]\nport = 0\n',
        '[[bearing]]\nname = "b"\ndesignation = "1205 ETN9"\n[operating]\nspeed_hz = 40.0\nload_newton = 4000.0\n',
        f'[[source]]\nname = "{source}"\nurl = "folder:{folder}"\nrate_hz = 25600\n',
    ]
    parts += [
        f'[[channel]]\nname = "{channel}"\nsource = "{source}"\ncolumn = {n + 1}\nunit = "g"\nbearing = "b"\n'
        for n, channel in enumerate(channels)
    ]
    path = folder / f"{name}.toml"
    path.write_text("".join(parts))
    (folder / name).mkdir()
    return path


def _fleet(folder: Path) -> Path:
    """Write a machine of many channels and what its daemon said last."""
    names = [f"channel{n:04d}" for n in range(MANY)]
    states = ["normal"] * 90 + ["maintenance_required"] * 5 + ["check_function", "bad_data", "no_data", "failure"]
    channels: dict[str, Any] = {
        name: {
            "source": "s",
            "state": states[n % len(states)],
            "reason": "healthy",
            "last_block": 100_000 + n,
            "last_block_utc": "2026-03-01T06:00:00Z",
            "last_block_status": "ok",
            "last_block_age_s": 3.0,
            "alarms": [],
            "levels": [],
            "stage": "final" if n % 20 == 0 else "healthy",
            "fault": "outer" if n % 20 == 0 else None,
            "v_eq_mm2": 0.02 if n % 20 == 0 else None,
            "v_eq_lower_mm2": 0.01 if n % 20 == 0 else None,
            "v_eq_upper_mm2": 0.03 if n % 20 == 0 else None,
            "tt_s": 3600.0 * n if n % 20 == 0 else None,
        }
        for n, name in enumerate(names)
    }
    path = _machine(folder, "fleet", "s", names)
    said = {"machine": "fleet", "status": "stopped", "problems": {}, "sources": {}, "channels": channels}
    (folder / "fleet" / "status.json").write_text(json.dumps(said))
    return path


def _life(folder: Path, count: int) -> Path:
    """Write a machine with a long life of one channel: records, trends, spectra."""
    path = _machine(folder, "rig", "rig", [CHANNEL])
    store_path = folder / "rig" / "state.db"
    fill(store_path, count)
    amplitude = np.abs(np.random.default_rng(1).normal(size=_BINS))
    lines = {"outer": 196.0, "inner": 284.0, "ball": 190.0, "cage": 16.4}
    with Store.open(store_path, machine="rig") as store, store.transaction() as connection:
        numbers = np.linspace(1, count, _SPECTRA).astype(int).tolist()
        rows = [
            SpectrumRow(
                "rig", CHANNEL, n, BEGIN + INTERVAL * n, 1.0, (2000.0, 8000.0), 40.0, 0.1, True, amplitude, lines
            )
            for n in numbers
        ]
        write_changes(connection, [SpectrumChange(row, "kept") for row in rows])
    return path


@contextmanager
def _served(folder: Path) -> Iterator[str]:
    command = [sys.executable, "-c", _CLI, "page", "--quiet", "--config", str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip()
        finally:
            process.terminate()


def _load(browser: Browser, url: str, content: str, drawn: Selectors, complete: Selectors) -> dict[str, float]:
    context = browser.new_context(viewport={"width": 1400, "height": 900})
    page = context.new_page()
    page.add_init_script(_WATCH % json.dumps({"content": [content], "drawn": drawn, "all": complete}))
    session = context.new_cdp_session(page)
    session.send("Network.enable")
    sizes: list[float] = []
    session.on("Network.loadingFinished", lambda event: sizes.append(event["encodedDataLength"]))
    page.goto(url, wait_until="commit")
    for selector in (content, *complete):
        page.wait_for_selector(selector, state="attached")
    page.wait_for_timeout(300)
    seen, longest = page.evaluate("[window.seen, window.longest]")
    context.close()
    return {**seen, "longest task": longest, "kB": sum(sizes) / 1e3}


def measure(count: int, rounds: int) -> list[Row]:
    """Load each view several times."""
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as name, sync_playwright() as playwright:
        folder = Path(name)
        _fleet(folder)
        _life(folder, count)
        program = os.environ.get("CHROMIUM", "/usr/bin/chromium")
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        with _served(folder) as url:
            views = {
                f"overview, {MANY + 1} channels": ("#/", ".row", _ROWS, _ROWS),
                f"channel, {count} records": (f"#/channel/rig/{CHANNEL}", ".answers", _CHARTS, _ALL),
            }
            for view, (fragment, *waited) in views.items():
                _load(browser, url + fragment, *waited)
                runs = [_load(browser, url + fragment, *waited) for _ in range(rounds)]
                rows.append(_row(view, runs))
        browser.close()
    return rows


def _row(view: str, runs: list[dict[str, float]]) -> Row:
    row: dict[str, float | int | str | None] = {"view": view, "loads": len(runs)}
    for key in ("content", "drawn", "all", "longest task"):
        row[f"{key}, ms"] = statistics.median(run[key] for run in runs)
        row[f"{key}, worst"] = max(run[key] for run in runs)
    row["kB"] = statistics.median(run["kB"] for run in runs)
    return row


def main() -> None:
    """Measure, print, write."""
    options = arguments(__doc__ or "")
    count, rounds = (50_000, 5) if options.quick else (1_000_000, 20)
    rows = measure(count, rounds)
    print_table("the page in Chromium", rows)
    write_json(options.json, {"page_load": rows})


if __name__ == "__main__":
    main()
