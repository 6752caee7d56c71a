"""Several machines and one page: how soon they are ready, what memory they take, how soon they have ended.

Run as ``python -m benchmarks.fleet [--quick] [--json FILE]``. Each machine has one channel, one watched folder, and one
file that was there beforehand. All daemons and the page are started at once. Wall clock times from the first start:

- *first ready*: one daemon sent ``READY=1`` to the service manager: it could commit a block;
- *ready*: every daemon did;
- *page*: the page sent ``READY=1``: it answers;
- *first blocks*: the file of every machine is committed (settling time 0.2 s included);
- *stop*: from SIGTERM to all until the end of the last process, with the last publications;
- *restart*: from a SIGKILL of one daemon, which is started again at once, until it is ready.

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
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from benchmarks.common import Row, arguments, print_table, write_json
from monitor.records.database import StoreError
from monitor.records.store import Store
from monitor.service.system import read_status

RATE = 25_600
SETTLE_S = 5.0
_CLI = "from monitor.cli import main; main()"


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
    """Return whether the file of a machine is in its store."""
    try:
        with Store.open(folder / f"m{number}" / "state" / "state.db", create=False, read_only=True) as store:
            return store.last("s") > 0
    except StoreError:
        return False


def is_ready(folder: Path, number: int, before: int | None = None) -> bool:
    """Return whether a machine has a daemon, other than the one before, and it says that it runs."""
    found = read_status(folder / f"m{number}" / "state")
    return found["running"] and found.get("pid") != before and found["status"] in ("running", "degraded")


def start(command: str, config: Path, notify: Path, *options: str) -> subprocess.Popen[bytes]:
    """Start a daemon or the page."""
    return subprocess.Popen(
        [sys.executable, "-c", _CLI, command, "--quiet", "--config", str(config), *options],
        env={"PATH": "/usr/bin:/bin", "NOTIFY_SOCKET": str(notify), "OPENBLAS_NUM_THREADS": "1"},
        stdout=subprocess.DEVNULL,
    )


def start_daemon(folder: Path, number: int) -> subprocess.Popen[bytes]:
    """Start the daemon of a machine."""
    return start("run", folder / f"m{number}.toml", folder / "notify", "--no-page")


def ready_times(manager: socket.socket, machines: int, began: float) -> tuple[float, float, float]:
    """Return when the first and the last daemon and when the page became ready, s after the beginning."""
    daemons: list[float] = []
    page: list[float] = []
    while len(daemons) < machines or not page:
        message = manager.recv(4096)
        if b"READY=1" in message:
            (page if b"the page of" in message else daemons).append(time.monotonic() - began)
    return min(daemons), max(daemons), page[0]


def end_all(started: Sequence[subprocess.Popen[bytes]]) -> float:
    """End all processes in order; return how long that took, s."""
    asked = time.monotonic()
    for process in started:
        process.send_signal(signal.SIGTERM)
    for process in started:
        if process.wait(60.0) != 0:
            raise RuntimeError(f"a process ended with {process.returncode}")
    return time.monotonic() - asked


def one_run(machines: int, idle_s: float) -> Row:
    """Start, measure and stop the daemons of so many new machines and their page."""
    with (
        tempfile.TemporaryDirectory() as name,
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager,
        ExitStack() as opened,
    ):
        folder = Path(name)
        prepare(folder, machines)
        load = os.getloadavg()[0]
        manager.bind(str(folder / "notify"))
        manager.settimeout(120.0)
        began = time.monotonic()
        daemons = [start_daemon(folder, number) for number in range(machines)]
        page = start("page", folder, folder / "notify")
        for process in (*daemons, page):
            opened.callback(process.kill)
        earliest, ready, answers = ready_times(manager, machines, began)
        first = wait_for(lambda: all(committed(folder, number) for number in range(machines))) - began
        time.sleep(SETTLE_S)
        main = [process.pid for process in daemons]
        publishers = [pid for root in main for pid in processes(root) if pid != root]
        pids = [*main, *publishers, page.pid]
        sizes = [sum(map(memory_mb, group)) for group in (main, publishers, [page.pid])]
        used = cpu_s(pids)
        time.sleep(idle_s)
        idle = (cpu_s(pids) - used) / idle_s
        daemons[0].kill()
        killed = time.monotonic()
        daemons[0].wait()
        before = daemons[0].pid
        daemons[0] = start_daemon(folder, 0)
        opened.callback(daemons[0].kill)
        again = wait_for(lambda: is_ready(folder, 0, before)) - killed
        return {
            "machines": machines,
            "load before": load,
            "first ready s": earliest,
            "ready s": ready,
            "page s": answers,
            "first blocks s": first,
            "restart s": again,
            "stop s": end_all([*daemons, page]),
            "processes": len(pids),
            "page MB": sizes[2],
            "a daemon MB": sizes[0] / machines,
            "its publisher MB": sizes[1] / machines,
            "all MB": sum(sizes),
            "idle CPU %": 100.0 * idle,
        }


def main() -> None:
    """Measure, print, and write what was asked for."""
    options = arguments("several machines and one page")
    idle_s = 3.0 if options.quick else 10.0
    one_run(1, 0.1)
    table = [one_run(machines, idle_s) for machines in ((1, 5) if options.quick else (1, 5, 20))]
    print_table("machines and one page (target: ready in 3 s alone, stopped in 5 s)", table)
    write_json(options.json, {"fleet": table})


if __name__ == "__main__":
    main()
