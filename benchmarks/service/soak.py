"""Endurance of the daemon: does memory grow, does it leak descriptors or threads, how long does a block take?

    python -m benchmarks.service.soak [--quick] [--json FILE]

A daemon as people run it, with all its child processes, gets 100,000 blocks (0.1 s at 2,560 Hz, eight channels) over
TCP, each sent when the one before is acknowledged: the latency is from the first byte of a block to the
acknowledgement of its commit. The blocks are dated 5 s apart, so that a day's file has as many rows as one of a real
machine. Resident memory, open files and threads of every process are looked at every few hundred blocks, and each time
the page is asked for machines, trends and events; the slope is the least-squares line over all looks after the warm-
up. The store is on a disk that honours fsync, or the latency means little.
"""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import Row, arguments, print_table, write_json
from monitor.records.store import Store
from streams.link.sender import LinkError, TcpLink
from streams.link.wire import Frame, encode_frame
from streams.types.samples import Samples
from streams.types.spec import Address

BLOCKS, QUICK_BLOCKS = 100_000, 2_000
RATE, SAMPLES = 2560.0, 256
CHANNELS = tuple(f"x{number}" for number in range(8))
SECONDS_APART = 5
FIRST = 1_750_000_000
TARGET_SLOPE = 1000.0
"""Bytes a block."""
_LOOKS = 400
_WARM_UP = 0.2
_CLI = "from monitor.cli import main; main()"
_ROLES = {"service.publisher": "publisher", "web.server": "page", "opcua_server": "OPC UA"}


@dataclass
class Process:
    """What was seen of one process, look by look.

    Attributes:
        role: what it does.
        blocks: committed by then.
        rss: resident memory, bytes.
        files: open descriptors.
        threads: threads.
    """

    role: str
    blocks: list[int] = field(default_factory=list)
    rss: list[int] = field(default_factory=list)
    files: list[int] = field(default_factory=list)
    threads: list[int] = field(default_factory=list)

    def look(self, pid: int, blocks: int) -> None:
        """Look at the process; one that is gone is left as it was."""
        folder = Path("/proc") / str(pid)
        try:
            lines = (folder / "status").read_text(encoding="utf-8").splitlines()
            files = len(list((folder / "fd").iterdir()))
        except OSError:
            return
        values = dict(line.split(":", 1) for line in lines)
        if "VmRSS" not in values:
            return
        self.blocks.append(blocks)
        self.rss.append(1024 * int(values["VmRSS"].split()[0]))
        self.files.append(files)
        self.threads.append(int(values["Threads"]))

    def row(self, warm_up: int) -> Row:
        """Return what is said of it: the slope after the warm-up, and files and threads at its begin and its end."""
        kept = [i for i, blocks in enumerate(self.blocks) if blocks >= warm_up]
        row: dict[str, float | int | str | None] = {"process": self.role, "looks": len(kept)}
        if len(kept) < 3:
            return {**row, "slope B/block": None, "RSS MB": None, "RSS MB end": None, "most MB": None} | _empty()
        blocks, rss = np.array(self.blocks)[kept], np.array(self.rss)[kept]
        tenth = max(1, len(kept) // 10)
        row["slope B/block"] = float(np.polyfit(blocks, rss, 1)[0])
        row["RSS MB"] = float(np.median(rss[:tenth])) / 1e6
        row["RSS MB end"] = float(np.median(rss[-tenth:])) / 1e6
        row["most MB"] = float(rss.max()) / 1e6
        for name, seen in (("files", self.files), ("threads", self.threads)):
            values = np.array(seen)[kept]
            row[name] = int(np.median(values[:tenth]))
            row[f"{name} end"] = int(np.median(values[-tenth:]))
            row[f"most {name}"] = int(values.max())
        return row


def _empty() -> dict[str, None]:
    return dict.fromkeys(("files", "files end", "most files", "threads", "threads end", "most threads"))


def children(pid: int) -> dict[int, str]:
    """Return the child processes of a process, with what they do."""
    found: dict[int, str] = {}
    for path in (Path("/proc") / str(pid) / "task").glob("*/children"):
        try:
            numbers = path.read_text(encoding="ascii").split()
            for number in numbers:
                command = (Path("/proc") / number / "cmdline").read_bytes().decode(errors="replace")
                found[int(number)] = next((role for word, role in _ROLES.items() if word in command), "other")
        except OSError:
            continue
    return found


def prepare(folder: Path) -> tuple[Path, int]:
    """Write the configuration of a machine that listens on a free port; return its path and the port."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    config = folder / "machine.toml"
    config.write_text(
        '[machine]\nname = "m"\nmin_free_mb = 50\n[publish]\ninterval_s = 5\n[web]\nport = 0\n'
        '[[bearing]]\nname = "b"\ndesignation = "1205 ETN9"\n[operating]\nspeed_hz = 40.0\n'
        f'[[source]]\nname = "s"\nurl = "tcp://127.0.0.1:{port}"\nrate_hz = {RATE}\nblock_s = 0.1\n'
        + "".join(
            f'[[channel]]\nname = "{name}"\nsource = "s"\nunit = "g"\nbearing = "b"\nband_hz = [[300, 1200]]\n'
            for name in CHANNELS
        )
        + '[[alarms.level]]\nfeature = "rms"\nalert_sd = 6\ndanger_g = 50.0\n'
    )
    return config, port


def frame(sequence: int) -> bytes:
    """Return a block: noise, each another one."""
    values = np.random.default_rng(sequence).standard_normal((len(CHANNELS), SAMPLES), dtype=np.float32)
    start = (FIRST + SECONDS_APART * sequence) * 1_000_000_000
    return encode_frame(Frame(sequence, Samples(values, CHANNELS, units=("g",) * len(CHANNELS), rate=RATE), start))


def connect(port: int, daemon: subprocess.Popen[bytes]) -> TcpLink:
    """Connect as soon as the daemon listens."""
    link = TcpLink(Address("tcp", "127.0.0.1", port), "s", 60.0)
    until = time.monotonic() + 60.0
    while True:
        try:
            link.connect()
        except LinkError:
            if daemon.poll() is not None or time.monotonic() > until:
                raise
            time.sleep(0.05)
        else:
            return link


def ask_page(state: Path) -> None:
    """Ask the page for what its first view shows; it may not be there yet."""
    try:
        page = json.loads((state / "status.json").read_text(encoding="utf-8")).get("page")
    except FileNotFoundError:
        return
    for path in (
        ("api/machines", f"api/channels/m/{CHANNELS[0]}/records?points=500", "api/events?limit=50") if page else ()
    ):
        with urllib.request.urlopen(f"{page}{path}", timeout=60.0) as answer:
            answer.read()


def feed(link: TcpLink, daemon: subprocess.Popen[bytes], blocks: int, state: Path) -> tuple[list[float], list[Process]]:
    """Send the blocks one after the other; return their latencies, s, and what was seen of the processes."""
    latencies: list[float] = []
    seen: dict[str, Process] = {"daemon": Process("daemon")}
    every = max(1, blocks // _LOOKS)
    for sequence in range(1, blocks + 1):
        data = frame(sequence)
        began = time.perf_counter()
        link.send(data)
        while (link.committed(60.0) or 0) < sequence:
            if daemon.poll() is not None:
                raise RuntimeError(f"the daemon ended with {daemon.returncode} at block {sequence}")
        latencies.append(time.perf_counter() - began)
        if sequence % every == 0:
            seen["daemon"].look(daemon.pid, sequence)
            for pid, role in children(daemon.pid).items():
                seen.setdefault(role, Process(role)).look(pid, sequence)
            ask_page(state)
    return latencies, list(seen.values())


def measure(blocks: int) -> dict[str, Any]:
    """Run a daemon over so many blocks; return the rows of all tables."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        config, port = prepare(folder)
        daemon = subprocess.Popen([sys.executable, "-c", _CLI, "run", "--quiet", "--config", str(config)])
        try:
            link = connect(port, daemon)
            began = time.monotonic()
            latencies, processes = feed(link, daemon, blocks, folder / "state")
            seconds = time.monotonic() - began
            link.close()
            asked = time.monotonic()
            daemon.send_signal(signal.SIGTERM)
            code = daemon.wait(30.0)
            stopped = time.monotonic() - asked
        finally:
            daemon.kill()
            daemon.wait()
        database = folder / "state" / "state.db"
        with Store.open(database, read_only=True) as store:
            if store.last("s") != blocks or store.counts() != {"ok": blocks} or store.check() or code != 0:
                raise RuntimeError(f"not every block is there once: {store.counts()}, exit code {code}")
        late = np.array(latencies[round(_WARM_UP * blocks) :])
        delay: Row = {
            "blocks": blocks,
            "seconds": seconds,
            **{f"p{share:g} ms": 1e3 * float(np.percentile(late, share)) for share in (50, 99, 99.9)},
            "worst ms": 1e3 * float(late.max()),
            "stop s": stopped,
            "store B/block": database.stat().st_size / blocks,
        }
        return {"processes": [process.row(round(_WARM_UP * blocks)) for process in processes], "delay": [delay]}


def main() -> None:
    """Measure, print, and write what was asked for."""
    options = arguments("endurance of the daemon")
    tables = measure(QUICK_BLOCKS if options.quick else BLOCKS)
    print_table(f"memory, files and threads (target: below {TARGET_SLOPE:.0f} B a block)", tables["processes"])
    print_table("from the first byte of a block to the acknowledgement of its commit", tables["delay"])
    write_json(options.json, tables)


if __name__ == "__main__":
    main()
