"""The daemon's start and stop, and how soon a file is in the store.

Run as ``python -m benchmarks.service.daemon [--quick] [--json FILE]``. Wall clock times of a process, from its start to

- *ready*: it tells the service manager ``READY=1``: store, maps and sources are open, a block could be committed;
  *ready cpu* is the processor time of that, whatever else the machine does;
- *first block*: the first block of a file that was there beforehand is committed (settling time 0.2 s included);
- *page*: its status has the address of the page, which answers then;
- *stop*: from SIGTERM to the end of the process, the last publication and the end of the page included.

The page cache is warm (one start is not counted). Without a map, and with a tracked channel and its map of 1,071 nodes.
"""

from __future__ import annotations

import os
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.common import Row, Tables, benchmark
from models.maps.file import cached_map, save_map
from models.maps.plan import MapPlan
from models.work.choose import local_runner
from monitor.records.store import Store
from monitor.service.system import read_status

RATE = 25_600
BAND = (0.0, 9500.0)
_CLI = "from monitor.cli import main; main()"


def prepare(folder: Path, *, tracked: bool) -> Path:
    """Write the configuration of a machine with one channel, and one file for it; return the configuration's path."""
    (folder / "in").mkdir()
    np.save(folder / "in" / "a.npy", np.random.default_rng(0).normal(size=RATE))
    more = ""
    if tracked:
        plan = MapPlan(
            load=(4000.0,),
            speed=(40.0,),
            h_d=tuple(np.linspace(0.0, 50e-6, 21)),
            dphi_d=tuple(np.radians(np.linspace(0.0, 50.0, 51))),
            rms_band=BAND,
        )
        with local_runner(0) as runner:
            save_map(cached_map(plan, runner=runner), folder / "map.nc")
        more = 'track = true\nmap = "map.nc"\n'
    config = folder / "machine.toml"
    config.write_text(
        '[machine]\nname = "m"\n[web]\nport = 0\n[[bearing]]\nname = "b"\ndesignation = "1205 ETN9"\n'
        "[operating]\nspeed_hz = 40.0\nload_newton = 4000.0\n"
        f'[[source]]\nname = "s"\nurl = "folder:{folder / "in"}"\nrate_hz = {RATE}\nsettle_s = 0.2\nblock_s = "file"\n'
        '[[channel]]\nname = "x"\nsource = "s"\ncolumn = 1\nunit = "g"\nbearing = "b"\nband_hz = [[2000, 8000]]\n'
        f"rms_band_hz = [{BAND[0]}, {BAND[1]}]\n{more}"
    )
    return config


def processor_time(pid: int) -> float:
    """Return the processor time that a process has used, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def one_run(*, tracked: bool) -> dict[str, float]:
    """Start and stop a daemon on a new machine; return what it took, s."""
    with tempfile.TemporaryDirectory() as name, socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        folder = Path(name)
        config = prepare(folder, tracked=tracked)
        manager.bind(str(folder / "notify"))
        manager.settimeout(60.0)
        began = time.monotonic()
        daemon = subprocess.Popen(
            [sys.executable, "-c", _CLI, "run", "--quiet", "--config", str(config)],
            env={"PATH": "/usr/bin:/bin", "NOTIFY_SOCKET": str(folder / "notify")},
        )
        try:
            if not manager.recv(4096).startswith(b"READY=1"):
                raise RuntimeError("the daemon did not say that it is ready")
            ready, used = time.monotonic() - began, processor_time(daemon.pid)
            with Store.open(folder / "state" / "state.db", read_only=True) as store:
                while not store.last("s"):
                    if time.monotonic() - began > 60.0:
                        raise RuntimeError("no block was committed")
                    time.sleep(0.005)
            first = time.monotonic() - began
            while read_status(folder / "state").get("page") is None:
                if time.monotonic() - began > 60.0:
                    raise RuntimeError("the page did not answer")
                time.sleep(0.02)
            page = time.monotonic() - began
            asked = time.monotonic()
            daemon.send_signal(signal.SIGTERM)
            if daemon.wait(60.0) != 0:
                raise RuntimeError(f"the daemon ended with {daemon.returncode}")
            return {
                "ready s": ready,
                "ready cpu s": used,
                "first block s": first,
                "page s": page,
                "stop s": time.monotonic() - asked,
            }
        finally:
            daemon.kill()
            daemon.wait()


def rows(rounds: int) -> list[Row]:
    """Return median and worst of several starts, without and with a map."""
    found: list[Row] = []
    for label, tracked in (("no map", False), ("tracked on a map", True)):
        one_run(tracked=tracked)
        runs = [one_run(tracked=tracked) for _ in range(rounds)]
        row: dict[str, float | str] = {"machine": label}
        for key in runs[0]:
            row[key] = statistics.median(run[key] for run in runs)
            row[f"worst {key}"] = max(run[key] for run in runs)
        found.append(row)
    return found


@benchmark("start and stop of the daemon")
def main(quick: bool) -> Tables:
    """Measure, print, and write what was asked for."""
    table = rows(5 if quick else 20)
    return {"start": table}
