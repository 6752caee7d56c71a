"""A machine with a stream, a folder and a page, its daemon and the commands beside it, and what its store must hold."""

from __future__ import annotations

import json
import shutil
import signal
import socket
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any, Self

from benchmarks.faults.shim import Shim
from benchmarks.faults.traffic import FOLDER, RATE, STREAM, Blocks, Files, Reader, Traffic

ROOT = Path(__file__).parents[2]
START_S = 120.0
STOP_S = 15.0
_RUN = """
import sys
sys.path.insert(0, sys.argv.pop(1))
if sys.argv[1] == "run":
    from monitor.service import publisher
    publisher._MIN_PAUSE_FACTOR = 1.0
from monitor.cli import main
main()
"""
"""The daemon publishes more often than it would, so that a fault of the publisher need not be waited for."""
_CONFIG = """
[machine]
name = "m"
min_free_mb = 1
state_dir = "{state}"
records_dir = "{records}"
[web]
port = {page}
[publish]
interval_s = 1
[retention]
full_days = 1
[operating]
speed_hz = 30.0
load_newton = 2000.0
[[bearing]]
name = "b"
designation = "6205"
[[source]]
name = "{stream}"
url = "tcp://127.0.0.1:{tcp}"
[[channel]]
name = "x"
source = "{stream}"
column = 1
unit = "g"
bearing = "b"
band_hz = [[7000.0, 9000.0]]
[[source]]
name = "{folder}"
url = "folder:in"
rate_hz = {rate}
settle_s = 0.1
block_s = "file"
[[channel]]
name = "y"
source = "{folder}"
column = 1
unit = "g"
bearing = "b"
band_hz = [[7000.0, 9000.0]]
"""


def free_port() -> int:
    """Return a port of this machine on which nothing listens."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


class Life:
    """One machine in a folder of its own, under the library that makes calls fail."""

    def __init__(self, tree: Path = ROOT) -> None:
        """Make the folder and start the daemon of the program in ``tree``, and its traffic."""
        self._tree = tree
        self.folder = Path(tempfile.mkdtemp(prefix="spallwatch-life-"))
        self.shim = Shim(self.folder)
        self.config, self.other = self.folder / "m.toml", self.folder / "other.toml"
        ports = {"tcp": free_port(), "page": free_port()}
        (self.folder / "in").mkdir()
        for path, prefix in ((self.config, ""), (self.other, "other-")):
            words = {"state": f"{prefix}state", "records": f"{prefix}records", "stream": STREAM, "folder": FOLDER}
            path.write_text(_CONFIG.format(**words, **ports, rate=RATE))
        self.store = self.folder / "state" / "state.db"
        self.log = self.folder / "log"
        self.known_wrongs: dict[str, int] = {}
        """What :func:`wrongs` found last."""
        self.daemon = self.start()
        self.blocks = Blocks(ports["tcp"])
        self.files = Files(self.folder / "in", self.store)
        self.reader = Reader(ports["page"], self.folder / "state" / "web.token")

    def __enter__(self) -> Self:
        """Return the life itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """End the traffic and the daemon, and remove the folder."""
        self.end_traffic()
        self.kill()
        shutil.rmtree(self.folder, ignore_errors=True)

    @property
    def traffic(self) -> Mapping[str, Traffic]:
        """What is given to the daemon, by name."""
        return {"stream": self.blocks, "folder": self.files, "page": self.reader}

    def end_traffic(self) -> None:
        """Give nothing more."""
        for each in self.traffic.values():
            each.end()

    def start(self) -> subprocess.Popen[bytes]:
        """Start the daemon; its standard error is appended to the log."""
        with self.log.open("ab") as log:
            self.daemon = subprocess.Popen(
                self._command("run", "--config", str(self.config)),
                cwd=self.folder,
                env=self.shim.environment,
                stdout=subprocess.DEVNULL,
                stderr=log,
            )
        return self.daemon

    def stop(self) -> int | None:
        """Stop the daemon as a service manager does; return its exit code, None where it had to be killed."""
        self.daemon.send_signal(signal.SIGTERM)
        try:
            return self.daemon.wait(STOP_S)
        except subprocess.TimeoutExpired:
            self.kill()
            return None

    def kill(self) -> None:
        """Kill the daemon; its children end with it."""
        self.daemon.kill()
        self.daemon.wait()

    def call(self, *words: str) -> subprocess.CompletedProcess[str]:
        """Run a command to its end under the library."""
        return subprocess.run(
            self._command(*words),
            cwd=self.folder,
            env=self.shim.environment,
            capture_output=True,
            text=True,
            check=False,
            timeout=120.0,
        )

    def _command(self, *words: str) -> list[str]:
        return [sys.executable, "-P", "-c", _RUN, str(self._tree), *words]

    def status(self) -> dict[str, Any]:
        """Return what the status file says, {} where there is none."""
        try:
            return json.loads((self.folder / "state" / "status.json").read_text())
        except (OSError, ValueError):
            return {}

    def wait_well(self, seconds: float = START_S) -> bool:
        """Wait until all traffic passes; return whether it did in time."""
        began = time.monotonic()
        while time.monotonic() < began + seconds and self.daemon.poll() is None:
            if all(each.done_after(began) is not None for each in self.traffic.values()):
                return True
            time.sleep(0.05)
        return False

    def log_size(self) -> int:
        """Return the length of the log, bytes."""
        return self.log.stat().st_size

    def log_after(self, size: int) -> list[str]:
        """Return the lines of the log after so many bytes."""
        return self.log.read_bytes()[size:].decode(errors="replace").splitlines()


def held(store: Path) -> dict[tuple[str, int], str]:
    """Return the content hashes of the accepted blocks of a store, also of condensed ones, by source and number.

    Raises:
        sqlite3.Error: it cannot be read.
    """
    with closing(sqlite3.connect(f"file:{store}?mode=ro", uri=True, timeout=10.0)) as connection:
        rows = connection.execute("SELECT source, sequence, content_hash FROM blocks").fetchall()
        query = (
            "SELECT condensed_sources.source, sequence, content FROM identities"
            " JOIN condensed_sources ON id = identities.source"
        )
        condensed = connection.execute(query).fetchall()
    found: dict[tuple[str, int], str] = {}
    for source, sequence, content in (*rows, *condensed):
        found[source, sequence] = content.hex() if isinstance(content, bytes) else content
    return found


def wrongs(life: Life) -> dict[str, int]:
    """Return how many blocks that a life was given are lost, doubled, changed, and how many of its files rejected.

    Lost and changed are acknowledged blocks; a rejected file is one of which the store holds no content.
    """
    acknowledged = dict(life.blocks.acknowledged)
    found = held(life.store)
    stream = {number: content for (source, number), content in found.items() if source == STREAM}
    files = [content for (source, _), content in found.items() if source == FOLDER]
    whole = [content for content in files if content]
    return {
        "lost": sum(number not in stream for number in acknowledged) + len(life.blocks.went_back),
        "doubled": len(stream) - len(set(stream.values())) + len(whole) - len(set(whole)),
        "changed": sum(stream.get(number, content) != content for number, content in acknowledged.items())
        + sum(content not in life.files.given.values() for content in whole),
        "rejected": len(files) - len(whole),
    }
