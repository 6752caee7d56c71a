"""A hundred hostile clients beside a user of the page, a sender and an OPC UA client: how long do these wait?

    python -m benchmarks.service.hostile [--quick] [--json FILE]

A daemon with page, TCP receiver with a key and OPC UA server has one user, sender and client alone, then for a minute
with the clients of :mod:`benchmarks.service.hostile_clients`; ``--quick``: for ten seconds. In the first case each
hostile client has an address of its own, in the others all have that of the user, as behind one router. Times are from
the begin of a connection to the last byte of the answer: of a sign-in from a browser that never signed in by this name
("new"), that has no cookie of an earlier sign-in ("again"), that has ("known"); of a view of the page (five requests);
between two messages of its stream; from the first byte of a block to its acknowledgement; of a sender that connects
anew; of a read and a new session over OPC UA. What fails is counted, and tried again.
"""

from __future__ import annotations

import asyncio
import http.client
import json
import logging
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from asyncua.client.client import Client
from prometheus_client.parser import text_string_to_metric_families

from benchmarks.common import Row, arguments, print_table, write_json
from benchmarks.service.hostile_clients import CLIENTS, Target
from benchmarks.service.soak import Process, children, frame, prepare
from monitor.records.store import Store
from monitor.web.passwords import hash_password
from monitor.web.users import USERS_FILE, User, changed_users
from streams.link.peer import NONCE_BYTES, proof
from streams.link.sender import LinkError, SendError, TcpLink
from streams.link.wire import ACK, PROVEN, hello
from streams.types.spec import Address

ALONE_S, ATTACKED_S, QUICK_S, CALM_S = 10.0, 60.0, 10.0, 5.0
_ONE = ("127.0.0.1",)
CASES: Mapping[str, tuple[tuple[str, ...], bool]] = {
    "addresses of their own": (tuple(f"127.0.1.{number}" for number in range(1, CLIENTS + 1)), True),
    "the address of the user": (_ONE, True),
    "the address of the user, without floods of connections": (_ONE, False),
}
"""Addresses of the hostile clients, and whether some of them flood the listeners with connections."""
_CLI = "from monitor.cli import main; main()"
_KEY, _PASSWORD = b"a key of at least sixteen characters", "a password that is right"
_NEW_USERS = 60
_PATIENCE_S = 30.0
_ANEW_S = 5.0
"""Between two connections of sender and OPC UA client."""
_VIEW = ("/", "/static/main.js", "/api/machines", "/api/channels/m/x0/records?points=500", "/api/events?limit=50")


@dataclass
class Watch:
    """Times and failures by what was waited for, while ``attacked`` or before."""

    page: int
    tcp: int
    opcua: int
    attacked: bool = False
    ending: threading.Event = field(default_factory=threading.Event)
    seconds: dict[tuple[str, bool], list[float]] = field(default_factory=lambda: defaultdict(list))
    failed: Counter[tuple[str, bool]] = field(default_factory=Counter)
    causes: Counter[str] = field(default_factory=Counter)

    @contextmanager
    def timed(self, what: str) -> Iterator[None]:
        """Time what follows; note its failure instead."""
        began = time.monotonic()
        try:
            yield
        except (OSError, LinkError, SendError, http.client.HTTPException, ValueError, EOFError) as error:
            self.failed[what, self.attacked] += 1
            self.causes[f"{what}: {type(error).__name__}: {error}"[:120]] += 1
        else:
            self.seconds[what, self.attacked].append(time.monotonic() - began)

    def rows(self) -> list[Row]:
        """Return a row for each that was waited for."""
        found: list[Row] = []
        for what in sorted({what for what, _ in (*self.seconds, *self.failed)}):
            row: dict[str, float | int | str | None] = {"what": what}
            for attacked, title in ((False, "alone"), (True, "attacked")):
                ms = 1e3 * np.array(self.seconds.get((what, attacked), ()))
                row[f"{title}: times"], row[f"{title}: failed"] = len(ms), self.failed[what, attacked]
                for share, name in ((50, "p50"), (99, "p99"), (100, "largest")):
                    row[f"{title}: {name} ms"] = float(np.percentile(ms, share)) if len(ms) else None
            found.append(row)
        return found


def sign_in(watch: Watch, name: str, cookie: str = "") -> list[str]:
    """Sign in over a new connection; return the cookies that are set."""
    body = json.dumps({"name": name, "password": _PASSWORD})
    return ask(
        watch, "/login", method="POST", body=body, headers={"Content-Type": "application/json", "Cookie": cookie}
    )


def ask(watch: Watch, *paths: str, **request: Any) -> list[str]:
    """Ask the page, over one new connection; return the cookies that are set. ValueError where it refuses."""
    connection = http.client.HTTPConnection("127.0.0.1", watch.page, timeout=_PATIENCE_S)
    cookies: list[str] = []
    try:
        for path in paths:
            connection.request(request.get("method", "GET"), path, request.get("body"), request["headers"])
            answer = connection.getresponse()
            answer.read()
            if answer.status not in (200, 204):
                raise ValueError(f"{path.partition('?')[0]}: {answer.status}")
            cookies += [found.partition(";")[0] for found in answer.headers.get_all("set-cookie") or []]
    finally:
        connection.close()
    return cookies


def use_page(watch: Watch) -> None:
    """Sign in as a new, a returning and a known user in turn, and look at the page, about every second."""
    known, session, number = "", "", 0
    while not watch.ending.wait(1.0):
        number += 1
        with watch.timed("sign-in, new"):
            sign_in(watch, f"u{number % _NEW_USERS}")
        with watch.timed("sign-in, again"):
            session, known = sign_in(watch, "alice")
        with watch.timed("sign-in, known"):
            sign_in(watch, "alice", known)
        with watch.timed("view of the page"):
            ask(watch, *_VIEW, headers={"Cookie": session})


def follow_page(watch: Watch) -> None:
    """Follow the stream of events, signed in; it has a message every few seconds at least."""
    while not watch.ending.wait(0.1):
        connection = http.client.HTTPConnection("127.0.0.1", watch.page, timeout=_PATIENCE_S)
        with watch.timed("stream of the page opens"):
            cookie = "; ".join(sign_in(watch, "bob"))
            connection.request("GET", "/api/stream?machine=m&channel=x0", headers={"Cookie": cookie})
            answer = connection.getresponse()
            if answer.status != 200:
                raise ValueError(f"/api/stream: {answer.status}")
        while connection.sock is not None and not watch.ending.is_set():
            with watch.timed("message of the stream"):
                while (line := answer.fp.readline()) != b"\n":
                    if not line:
                        connection.close()
                        raise EOFError("the stream ended")
        connection.close()


def send_blocks(watch: Watch, sent: list[int]) -> None:
    """Send a block every 0.1 s, and connect anew every few seconds; ``sent`` gets the numbers acknowledged."""
    link = TcpLink(Address("tcp", "127.0.0.1", watch.tcp), "s", _PATIENCE_S, key=_KEY)
    connected, due = False, 0.0
    number = sent[-1] + 1
    while not watch.ending.wait(0.1):
        if time.monotonic() > due or not connected:
            due = time.monotonic() + _ANEW_S
            connected = False
            with watch.timed("sender connects"):
                link.connect()
                connected = True
            continue
        with watch.timed("acknowledgement"):
            connected = False
            link.send(frame(number))
            while (link.committed(_PATIENCE_S) or 0) < number:
                pass
            sent.append(number)
            number, connected = number + 1, True
    link.close()


def read_opcua(watch: Watch) -> None:
    """Read a variable over OPC UA twice a second, and begin a session anew every few seconds."""

    async def session() -> None:
        client = Client(f"opc.tcp://127.0.0.1:{watch.opcua}/m", _PATIENCE_S, watchdog_intervall=_PATIENCE_S)
        client.session_timeout = 60_000
        opened = False
        with watch.timed("OPC UA session"):
            await client.connect()
            opened = True
        try:
            until = time.monotonic() + _ANEW_S
            while opened and time.monotonic() < until and not watch.ending.is_set():
                opened = False
                with watch.timed("OPC UA read"):
                    await client.get_node("ns=2;s=m:state").read_value()
                    opened = True
                await asyncio.sleep(0.5)
        finally:
            with suppress(Exception):
                await client.disconnect()

    while not watch.ending.wait(0.1):
        # What ends a session is among the failures already.
        with suppress(Exception):
            asyncio.run(session())


def record_sender(port: int) -> bytes:
    """Send the first block, and return all bytes that the sender sent."""
    with socket.create_connection(("127.0.0.1", port), _PATIENCE_S) as connection:
        connection.sendall(hello("s", PROVEN))
        proven = proof(_KEY, connection.recv(NONCE_BYTES, socket.MSG_WAITALL), "s")
        connection.sendall(proven)
        connection.recv(ACK.size, socket.MSG_WAITALL)
        connection.sendall(frame(1))
        assert ACK.unpack(connection.recv(ACK.size, socket.MSG_WAITALL)) == (1,)
    return hello("s", PROVEN) + proven + frame(1)


def configured(folder: Path) -> tuple[Path, int, int]:
    """Write configuration, key and users of a machine; return its path and the ports of receiver and OPC UA server."""
    config, tcp = prepare(folder)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        opcua = free.getsockname()[1]
    (folder / "key").write_bytes(_KEY)
    (folder / "key").chmod(0o600)
    text = config.read_text().replace("rate_hz", f'stream_key_file = "{folder}/key"\nrate_hz')
    config.write_text(f'{text}[publish.opcua]\nurl = "opc.tcp://127.0.0.1:{opcua}/m"\n')
    stored = hash_password(_PASSWORD)
    with changed_users(folder / "state" / USERS_FILE) as users:
        for name in ("alice", "bob", *(f"u{number}" for number in range(_NEW_USERS))):
            users[name] = User(name, "operator", stored)
    return config, tcp, opcua


@contextmanager
def daemon_of(folder: Path) -> Iterator[tuple[subprocess.Popen[bytes], Watch]]:
    """Run a daemon until the end of the block; its log is the file ``log``."""
    config, tcp, opcua = configured(folder)
    command = [sys.executable, "-c", _CLI, "run", "--config", str(config)]
    with (folder / "log").open("wb") as log:
        daemon = subprocess.Popen(command, stderr=log)
    try:
        page, until = None, time.monotonic() + 60.0
        while page is None or not _answers(opcua) or not _answers(tcp):
            if daemon.poll() is not None or time.monotonic() > until:
                raise RuntimeError((folder / "log").read_text(errors="replace"))
            time.sleep(0.1)
            with suppress(OSError, ValueError):
                page = json.loads((folder / "state" / "status.json").read_text()).get("page")
        yield daemon, Watch(int(page.rstrip("/").rpartition(":")[2]), tcp, opcua)
    finally:
        daemon.kill()
        daemon.wait()


def _answers(port: int) -> bool:
    with suppress(OSError), socket.create_connection(("127.0.0.1", port), 1.0):
        return True
    return False


@dataclass
class Looks:
    """What is seen of the processes, twice a second; blocks stand for phases: 0 alone, 1 attacked, 2 after."""

    pid: int
    seen: dict[str, Process] = field(default_factory=dict)

    def spend(self, seconds: float, phase: int) -> None:
        """Let time pass, looking."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            for number, role in {self.pid: "daemon", **children(self.pid)}.items():
                self.seen.setdefault(role, Process(role)).look(number, phase)
            time.sleep(0.5)

    def rows(self) -> list[Row]:
        """Return a row for each process: before, largest and after."""
        found: list[Row] = []
        for process in self.seen.values():
            row: dict[str, float | int | str | None] = {"process": process.role}
            last = {phase: at for at, phase in enumerate(process.blocks)}
            for name, values, unit in (
                ("RSS MB", process.rss, 1e-6), ("files", process.files, 1), ("threads", process.threads, 1),
            ):  # fmt: skip
                row[f"{name} before"] = unit * values[last[0]] if 0 in last else None
                row[f"{name} largest"], row[f"{name} after"] = unit * max(values), unit * values[-1]
            found.append(row)
        return found


def listener_rows(watch: Watch) -> list[Row]:
    """Return what ``/metrics`` says of each listener."""
    with urllib.request.urlopen(f"http://127.0.0.1:{watch.page}/metrics", timeout=_PATIENCE_S) as answer:
        text = answer.read().decode()
    found: dict[str, dict[str, float | int | str | None]] = {}
    for family in text_string_to_metric_families(text):
        for sample in family.samples if family.name.startswith("spallwatch_listener") else ():
            row = found.setdefault(sample.labels["listener"], {"listener": sample.labels["listener"]})
            title = sample.labels.get("cause") or sample.name.removeprefix("spallwatch_listener_").removesuffix(
                "_total"
            )
            row[title] = int(sample.value)
    return list(found.values())


def measure(case: str, attacked_s: float, alone_s: float = ALONE_S, clients: int = CLIENTS) -> dict[str, Any]:
    """Run one case; return its tables."""
    addresses, floods = CASES[case]
    with tempfile.TemporaryDirectory() as name, daemon_of(Path(name)) as (daemon, watch):
        folder, sent = Path(name), [1]
        recorded = record_sender(watch.tcp).hex()
        users = ("alice", "bob", *(f"u{number}" for number in range(_NEW_USERS)))
        target = Target(watch.page, watch.tcp, watch.opcua, addresses, users, "s", recorded, floods, clients)
        tasks: tuple[Callable[[], None], ...] = (
            lambda: use_page(watch),
            lambda: follow_page(watch),
            lambda: send_blocks(watch, sent),
            lambda: read_opcua(watch),
        )
        threads = [threading.Thread(target=task, daemon=True) for task in tasks]
        for thread in threads:
            thread.start()
        looks = Looks(daemon.pid)
        looks.spend(alone_s, 0)
        watch.attacked, before = True, (folder / "log").stat().st_size
        command = [sys.executable, "-m", "benchmarks.service.hostile_clients", json.dumps(asdict(target))]
        hostile = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        looks.spend(attacked_s, 1)
        counts = json.loads(hostile.communicate(timeout=4.0 * _PATIENCE_S)[0])
        watch.ending.set()
        for thread in threads:
            thread.join(2.0 * _PATIENCE_S)
        looks.spend(CALM_S, 2)
        listeners = listener_rows(watch)
        log_bytes = (folder / "log").stat().st_size - before
        daemon.send_signal(signal.SIGTERM)
        code = daemon.wait(30.0)
        with Store.open(folder / "state" / "state.db", read_only=True) as store:
            numbers = [record.sequence for record in store.records()]
            outcome: Row = {
                "blocks acknowledged": len(sent),
                "lost": len(set(sent) - set(numbers)),
                "doubled": len(numbers) - len(set(numbers)),
                "not ok": sum(number for status, number in store.counts().items() if status != "ok"),
                "files read": sum(found.get("files read", 0) for found in counts.values()),
                "log kB": log_bytes / 1e3,
                "exit code": code,
            }
        return {
            "waits": watch.rows(),
            "processes": looks.rows(),
            "listeners": listeners,
            "attacks": [_attack_row(name, found) for name, found in counts.items()],
            "outcome": [outcome],
            "causes": dict(watch.causes.most_common(30)),
        }


def _attack_row(name: str, counts: Mapping[str, int]) -> Row:
    values = {key: counts.get(key, 0) for key in ("clients", "connections", "answers", "errors")}
    return {"kind": name, **values, "MB sent": counts.get("bytes", 0) / 1e6}


def main() -> None:
    """Measure, print, and write what was asked for."""
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)
    options = arguments("hostile clients beside a user and a sender")
    found = {}
    for case in CASES:
        tables = measure(case, QUICK_S if options.quick else ATTACKED_S)
        found[case] = tables
        for title in ("waits", "processes", "listeners", "attacks", "outcome"):
            print_table(f"{CLIENTS} hostile clients, {case}: {title}", tables[title])
        print(*(f"{number} x {cause}" for cause, number in tables["causes"].items()), sep="\n")
    write_json(options.json, found)


if __name__ == "__main__":
    main()
