"""Several machines under one supervisor: how soon they are ready, what memory they take, how soon they have ended.

Run as ``python -m benchmarks.fleet [--quick] [--json FILE]``. Each machine has one channel, one watched folder, and one
file that was there beforehand; all share one page. Wall clock times from the start of the supervisor:

- *first ready*: one daemon says that it runs;
- *ready*: the service manager is told ``READY=1``: every daemon could commit a block;
- *first blocks*: the file of every machine is committed (settling time 0.2 s included);
- *stop*: from SIGTERM to the end of the last process, with the last publications;
- *killed*: from a SIGKILL of one daemon to the next one that is ready.

Memory is the proportional set size (what is shared is divided among those who share it), 5 s after the first blocks,
when publishers and page have loaded what they need; *idle CPU* is the share of one core that all processes take then.
*Load before* is the load average of the last minute when it began: what else the computer was doing.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from benchmarks.common import Row, arguments, print_table, write_json
from monitor.records.store import Store, StoreError
from monitor.service.status_file import read_status

RATE = 25_600
SETTLE_S = 5.0
_CLI = "from monitor.cli import main; main()"
_KINDS = {"--supervised": "daemons", "publish_worker": "publishers", "web.server": "page"}


def prepare(folder: Path, machines: int) -> None:
    """Write the configurations of some machines, and a file for each."""
    signal_ = np.random.default_rng(0).normal(size=RATE)
    for number in range(machines):
        home = folder / f"m{number}"
        (home / "in").mkdir(parents=True)
        np.save(home / "in" / "a.npy", signal_)
        (folder / f"m{number}.toml").write_text(
            f'[machine]\nname = "m{number}"\nstate_dir = "{home}/state"\nrecords_dir = "{home}/records"\n'
            '[web]\nport = 0\n[[bearing]]\nname = "b"\ndesignation = "1205 ETN9"\n[operating]\nspeed_hz = 40.0\n'
            f'[[source]]\nname = "s"\nurl = "folder:{home / "in"}"\nrate_hz = {RATE}\n'
            'settle_s = 0.2\nblock_s = "file"\n'
            '[[channel]]\nname = "x"\nsource = "s"\ncolumn = 1\nunit = "g"\nbearing = "b"\nband_hz = [[2000, 8000]]\n'
        )


def processes(root: int) -> Iterator[int]:
    """Yield a process and all that descend from it."""
    yield root
    try:
        children = Path(f"/proc/{root}/task/{root}/children").read_text(encoding="ascii").split()
    except OSError:
        return
    for child in children:
        yield from processes(int(child))


def kind_of(pid: int) -> str:
    """Return what a process of the supervisor's is, by its command line."""
    words = Path(f"/proc/{pid}/cmdline").read_bytes().decode("utf-8", "replace")
    return next((kind for word, kind in _KINDS.items() if word in words), "supervisor")


def memory_mb(pid: int) -> float:
    """Return the proportional set size of a process, MB."""
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("Pss:")) * 1024 / 1e6


def cpu_s(pids: list[int]) -> float:
    """Return the processor time of some processes, s."""
    ticks = 0
    for pid in pids:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
        ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


def wait_for(what: Callable[[], bool]) -> float:
    """Return the moment at which something became true, s of the monotonic clock."""
    until = time.monotonic() + 120.0
    while not what():
        if time.monotonic() > until:
            raise RuntimeError("it did not happen within two minutes")
        time.sleep(0.01)
    return time.monotonic()


def committed(folder: Path, number: int) -> bool:
    """Tell whether the file of a machine is in its store."""
    try:
        with Store.open(folder / f"m{number}" / "state" / "state.db", create=False, read_only=True) as store:
            return store.last("s") > 0
    except StoreError:
        return False


def is_ready(folder: Path, number: int, before: int | None = None) -> bool:
    """Tell whether a machine has a daemon, other than the one before, and it says that it runs."""
    found = read_status(folder / f"m{number}" / "state")
    return found["running"] and found.get("pid") != before and found["status"] in ("running", "degraded")


def one_run(machines: int, idle_s: float) -> Row:
    """Start, measure and stop the supervisor of so many new machines, which are idle for so long."""
    with tempfile.TemporaryDirectory() as name, socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        folder = Path(name)
        prepare(folder, machines)
        load = os.getloadavg()[0]
        manager.bind(str(folder / "notify"))
        manager.settimeout(120.0)
        began = time.monotonic()
        process = subprocess.Popen(
            [sys.executable, "-c", _CLI, "run", "--quiet", "--config", str(folder)],
            env={"PATH": "/usr/bin:/bin", "NOTIFY_SOCKET": str(folder / "notify"), "OPENBLAS_NUM_THREADS": "1"},
        )
        try:
            earliest = wait_for(lambda: any(is_ready(folder, number) for number in range(machines))) - began
            while b"READY=1" not in manager.recv(4096):
                pass
            ready = time.monotonic() - began
            first = wait_for(lambda: all(committed(folder, number) for number in range(machines))) - began
            time.sleep(SETTLE_S)
            pids = list(processes(process.pid))
            sizes: dict[str, list[float]] = {"supervisor": [], "daemons": [], "publishers": [], "page": []}
            for pid in pids:
                sizes[kind_of(pid)].append(memory_mb(pid))
            used = cpu_s(pids)
            time.sleep(idle_s)
            idle = (cpu_s(pids) - used) / idle_s
            before = read_status(folder / "m0" / "state")["pid"]
            os.kill(before, signal.SIGKILL)
            killed = time.monotonic()
            again = wait_for(lambda: is_ready(folder, 0, before)) - killed
            asked = time.monotonic()
            process.send_signal(signal.SIGTERM)
            if process.wait(60.0) != 0:
                raise RuntimeError(f"the supervisor ended with {process.returncode}")
            return {
                "machines": machines,
                "load before": load,
                "first ready s": earliest,
                "ready s": ready,
                "first blocks s": first,
                "killed s": again,
                "stop s": time.monotonic() - asked,
                "processes": len(pids),
                "supervisor MB": sum(sizes["supervisor"]),
                "page MB": sum(sizes["page"]),
                "a daemon MB": sum(sizes["daemons"]) / machines,
                "its publisher MB": sum(sizes["publishers"]) / machines,
                "all MB": sum(map(sum, sizes.values())),
                "idle CPU %": 100.0 * idle,
            }
        finally:
            process.kill()
            process.wait()


def main() -> None:
    """Measure, print, and write what was asked for."""
    options = arguments("several machines under one supervisor")
    idle_s = 3.0 if options.quick else 10.0
    one_run(1, 0.1)
    table = [one_run(machines, idle_s) for machines in ((1, 5) if options.quick else (1, 5, 20))]
    print_table("machines under one supervisor (target: ready in 3 s alone, stopped in 5 s)", table)
    write_json(options.json, {"fleet": table})


if __name__ == "__main__":
    main()
