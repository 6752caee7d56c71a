"""The cases with a daemon: a watched folder, a stream over TCP, and an acknowledgement on its page."""

from __future__ import annotations

import http.client
import json
import math
import signal
import socket
import sqlite3
import subprocess
import time
from collections.abc import Callable
from contextlib import closing
from types import TracebackType
from typing import Any, Self
from urllib.parse import urlsplit

from benchmarks.regression.cases import LEVELS, Bench, outcome
from benchmarks.regression.machines import BEGIN, BLOCK, RATE, life, machine_text, save_csv, save_files
from benchmarks.regression.observe import Observation, of_json
from benchmarks.regression.trees import CaseError

_PATIENCE_S = 60.0
_FILES = {"block_s": "file", "format": "csv", "rate_hz": RATE, "settle_s": 0.2}
_CHANNELS = tuple({"name": name, "column": name} for name in ("x", "y"))


class Daemon:
    """A daemon of a tree; stopped by SIGTERM at the end of the context, which must succeed."""

    def __init__(self, bench: Bench, text: str) -> None:
        """Write the configuration; :meth:`__enter__` starts the daemon."""
        self.bench, self.state = bench, bench.folder / "state"
        self._config = bench.write(text)
        self._log = bench.folder / "daemon.log"

    def __enter__(self) -> Self:
        """Start the daemon."""
        command = [*self.bench.tree.command, "run", "--config", str(self._config), "--quiet"]
        environment = self.bench.tree.environment(self.bench.folder)
        with self._log.open("w") as log:
            self._process = subprocess.Popen(command, cwd=self.bench.tree.root, env=environment, stderr=log)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop the daemon.

        Raises:
            CaseError: it did not end in order.
        """
        self._process.send_signal(signal.SIGTERM)
        try:
            code = self._process.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            code = self._process.wait()
        if code != 0 and error is None:
            raise CaseError(f"the daemon ended with {code}: {self._words()}")

    def wait_for(self, what: str, condition: Callable[[], object], patience_s: float = _PATIENCE_S) -> None:
        """Wait until something is true.

        Raises:
            CaseError: the daemon ended, or it takes too long.
        """
        until = time.monotonic() + patience_s
        while not condition():
            if self._process.poll() is not None or time.monotonic() > until:
                raise CaseError(f"{what}: not reached; the daemon says: {self._words()}")
            time.sleep(0.05)

    def wait_for_blocks(self, number: int) -> None:
        """Wait until so many blocks are committed."""
        self.wait_for(f"{number} blocks", lambda: self._count() >= number)

    def status(self) -> dict[str, Any]:
        """Return what the status file says, {} where there is none."""
        try:
            return json.loads((self.state / "status.json").read_text(encoding="utf-8"))
        except FileNotFoundError:
            return {}

    def ask(self, method: str, path: str, value: object = None) -> Any:
        """Ask the page, with its token, and return its JSON.

        Raises:
            CaseError: the answer is an error.
        """
        token = (self.state / "web.token").read_text(encoding="utf-8").splitlines()[0]
        headers = {"Authorization": f"Bearer {token}", "Content-Type": "application/json"}
        body = None if value is None else json.dumps(value).encode()
        with closing(http.client.HTTPConnection("127.0.0.1", urlsplit(self.status()["page"]).port, timeout=30)) as page:
            page.request(method, path, body, headers)
            answer = page.getresponse()
            content = answer.read()
        if answer.status != 200:
            raise CaseError(f"{method} {path}: {answer.status} {content.decode()[:200]}")
        return json.loads(content)

    def _count(self) -> int:
        try:
            with closing(sqlite3.connect(f"file:{self.state / 'state.db'}?mode=ro", uri=True)) as connection:
                return connection.execute("SELECT count(*) FROM blocks").fetchone()[0]
        except sqlite3.OperationalError:
            return 0

    def _words(self) -> str:
        return self._log.read_text(encoding="utf-8").strip()[-500:]


def folder_live(bench: Bench) -> Observation:
    """Follow a folder of files, a rejected one among them."""
    save_files(bench.folder / "in", [0.0] * 26 + [9.0, math.nan, 9.0, 9.0, 9.0, 9.0])
    text = machine_text({"url": f"folder:{bench.folder / 'in'}", **_FILES}, *_CHANNELS, levels=LEVELS)
    with Daemon(bench, text) as daemon:
        daemon.wait_for_blocks(32)
    return outcome("live", daemon.state / "state.db", bench.folder / "records")


def tcp(bench: Bench) -> Observation:
    """Send a recording to a daemon over TCP."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        port = found.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    blocks, stated = 48, {"block_s": BLOCK / RATE, "rate_hz": RATE}
    save_csv(bench.folder / "log.csv", {"x": life(blocks, 30, 3), "y": life(blocks, 60, 4)})
    sender = bench.write(machine_text({**stated, "start_utc": "2026-03-01T06:00:00Z"}, *_CHANNELS), "sender.toml")
    with Daemon(bench, machine_text({**stated, "url": address}, *_CHANNELS)) as daemon:
        sent = bench.call("send", bench.folder / "log.csv", "--config", sender, "--to", address, "--stream", "s")
        daemon.wait_for_blocks(blocks)
    return of_json("send", sent) | outcome("live", daemon.state / "state.db", bench.folder / "records")


def acknowledge(bench: Bench) -> Observation:
    """Acknowledge a held alarm on the page; the record of the next block says that it is released."""
    inbox, first = bench.folder / "in", [0.0] * 26 + [9.0] * 5 + [0.0] * 6
    save_files(inbox, first)
    text = machine_text(
        {"url": f"folder:{inbox}", **_FILES}, *_CHANNELS, levels=LEVELS, web={"enabled": True, "port": 0}
    )
    with Daemon(bench, text) as daemon:
        daemon.wait_for_blocks(len(first))
        daemon.wait_for("the page", lambda: daemon.status().get("page"))
        found = daemon.ask("GET", "/api/events")
        events, waiting = found["events"], found["unacknowledged"]
        # Newest first: the first alarm is the one that is held.
        held = [event for event in events if event["kind"] == "alarm_raised"][-1]
        daemon.wait_for("the count of events", lambda: daemon.status()["unacknowledged"] == waiting)
        answer = daemon.ask("POST", f"/api/events/{held['id']}/acknowledge", {"who": "Ada", "note": "seen"})
        # The count falls after the alarm stage was given the acknowledgement.
        daemon.wait_for("the acknowledgement", lambda: daemon.status()["unacknowledged"] == waiting - 1)
        save_files(inbox, [0.0] * 3, len(first) + 1)
        daemon.wait_for_blocks(len(first) + 3)
        points, last = "/api/channels/m/x/records?points=20", BEGIN.timestamp() + 10.0 * (len(first) + 3)
        daemon.wait_for("records on the page", lambda: daemon.ask("GET", points)["last_s"] == last)
        rows = daemon.ask("GET", points)
    found = (
        of_json("page/events", {"events": events})
        | of_json("page/answer", {"open": answer["open"]})
        | of_json("page/points", rows)
    )
    return found | outcome("live", daemon.state / "state.db", bench.folder / "records")
