"""The page's server: how quickly each address answers, with many channels and with many records, and the stream.

Run as ``python -m benchmarks.page [--quick] [--json FILE]``. The page is ``spallwatch page`` over a folder of two
machines, and is asked over one connection that stays open, packed answers allowed. Three tables:

1. each address of a machine of 1,000 channels (ten sources of a hundred) whose status is renewed every second, and of a
   machine of one channel with 100,000 records of 5 s (``--quick``: 50,000): milliseconds, median and 99th percentile,
   and bytes as sent;
2. the first minutes: seconds until the page answers, and until all records are in the trends;
3. milliseconds from the commit of a block until who follows its channel has it, with one and with 32 open streams. The
   page looks twice a second.
"""

from __future__ import annotations

import gzip
import http.client
import json
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from benchmarks.common import Row, arguments, print_table, write_json
from benchmarks.records import made_up
from benchmarks.trends import BEGIN, CHANNEL, INTERVAL, fill
from monitor.health.record import Record
from monitor.records.store import Store
from monitor.service.system import StatusFile

_SOURCES, _CHANNELS = 10, 100
_BLOCKS = 5
_BEARING = '[[bearing]]\nname = "b"\ndesignation = "1205 ETN9"\n[operating]\nspeed_hz = 40.0\n'


def prepare_many(folder: Path) -> None:
    """Make a machine of 1,000 channels with some records, and its configuration beside the folder."""
    parts = [_machine("many"), "[web]\nport = 0\nmax_streams = 64\n", _BEARING]
    state = {"channels": {}}
    values = made_up(1)[0].channels[CHANNEL]
    (folder / "state").mkdir(parents=True)
    with Store.open(folder / "state" / "state.db", machine="many") as store:
        for source in range(_SOURCES):
            parts.append(f'[[source]]\nname = "s{source}"\nurl = "folder:in{source}"\n')
            names = [f"s{source}-c{number}" for number in range(_CHANNELS)]
            for number, name in enumerate(names):
                parts.append(f'[[channel]]\nname = "{name}"\nsource = "s{source}"\ncolumn = {number + 1}\n')
                parts.append('unit = "g"\nbearing = "b"\n')
                state["channels"][name] = _channel(f"s{source}")
            channels = dict.fromkeys(names, values)
            for block in range(1, _BLOCKS + 1):
                store.commit(_record(f"s{source}", block, channels), {})
    folder.with_suffix(".toml").write_text("".join(parts))
    (folder / "said.json").write_text(json.dumps(state))


def _machine(name: str) -> str:
    return f'[machine]\nname = "{name}"\nstate_dir = "{name}/state"\nrecords_dir = "{name}/records"\n'


def _record(source: str, block: int, channels: Any) -> Record:
    return Record(source, block, f"b{block}", f"{block:032x}", time=BEGIN + INTERVAL * block, channels=channels)


def _channel(source: str) -> dict[str, Any]:
    numbers = ("v_eq_mm2", "v_eq_lower_mm2", "v_eq_upper_mm2", "tt_s", "tt_lower_s", "tt_upper_s", "p_threshold")
    words = ("t_fs_block", "t_fs_known_block", "t_fs_utc", "t_eol_block", "fault", "fault_snr", "edv_status")
    level = {"rule": "rms", "feature": "rms", "side": "above", "alert_si": 20.0, "danger_si": None}
    return {
        "source": source,
        "state": "normal",
        "reason": "healthy",
        "last_block": _BLOCKS,
        "last_block_utc": "2026-11-21T08:00:00Z",
        "last_block_status": "ok",
        "last_block_age_s": 1.0,
        "alarms": [],
        "levels": [level],
        "stage": "healthy",
        **dict.fromkeys((*words, *numbers, "tt_status")),
    }


def prepare_long(folder: Path, records: int) -> None:
    """Make a machine of one channel with many records, and its configuration beside the folder."""
    (folder / "state").mkdir(parents=True)
    fill(folder / "state" / "state.db", records)
    folder.with_suffix(".toml").write_text(
        f'{_machine("rig")}{_BEARING}[[source]]\nname = "rig"\nurl = "folder:in"\n'
        f'[[channel]]\nname = "{CHANNEL}"\nsource = "rig"\ncolumn = 1\nunit = "g"\nbearing = "b"\n'
    )


@contextmanager
def talking(folder: Path) -> Iterator[None]:
    """Renew the status of the machine of many channels every second, as its daemon would."""
    said, over = json.loads((folder / "said.json").read_text()), threading.Event()
    names = list(said["channels"])

    def talk(file: StatusFile) -> None:
        for number in range(1_000_000):
            said["channels"][names[number % len(names)]]["last_block"] += 1
            own = {"status": "running", "machine": "many", "state": "normal", "pid": 1, "problems": {}, "sources": {}}
            file.write({**own, "updated_utc": f"2026-11-21T08:00:{number % 60:02d}Z", "up_s": number, **said})
            if over.wait(1.0):
                return

    with StatusFile.open(folder / "state") as file:
        thread = threading.Thread(target=talk, args=(file,))
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()


class Client:
    """Asks over one connection."""

    def __init__(self, url: str) -> None:
        """Take the address of the page."""
        self._port = urlsplit(url).port
        self._connection = http.client.HTTPConnection("127.0.0.1", self._port, timeout=60.0)

    def ask(self, path: str) -> bytes:
        """Return the body, packed as it came."""
        self._connection.request("GET", path, headers={"Accept-Encoding": "gzip"})
        answer = self._connection.getresponse()
        body = answer.read()
        if answer.status not in (200, 503):
            raise RuntimeError(f"{path}: {answer.status} {body[:200]!r}")
        return body

    def stream(self, query: str) -> tuple[http.client.HTTPConnection, http.client.HTTPResponse]:
        """Open a stream."""
        connection = http.client.HTTPConnection("127.0.0.1", self._port, timeout=60.0)
        connection.request("GET", f"/api/stream{query}")
        return connection, connection.getresponse()


def addresses() -> list[tuple[str, str]]:
    """Return what is asked, by words."""
    many, rig = "/api/channels/many/s0-c0", f"/api/channels/rig/{CHANNEL}"
    return [
        ("page", "/"),
        ("all machines, 1,001 channels", "/api/machines"),
        ("metrics, 1,001 channels", "/metrics"),
        ("health", "/healthz"),
        ("events", "/api/events"),
        ("one of 1,000 channels", many),
        ("its trends", f"{many}/records"),
        ("channel of many records", rig),
        ("its trends, all, 1,000 points", f"{rig}/records?points=1000"),
        ("its trends, the last day", f"{rig}/records?points=1000&from={{day}}"),
        ("its trends, the last hour", f"{rig}/records?points=1000&from={{hour}}"),
        ("its blocks", "/api/machines/rig/blocks"),
    ]


def latencies(client: Client, last: float, rounds: int) -> list[Row]:
    """Return how long each address takes, each asked in turn."""
    times: dict[str, list[float]] = {}
    sizes: dict[str, int] = {}
    for _ in range(rounds):
        for name, path in addresses():
            began = time.perf_counter()
            body = client.ask(path.format(day=last - 86400.0, hour=last - 3600.0))
            times.setdefault(name, []).append(1e3 * (time.perf_counter() - began))
            sizes[name] = len(body)
    return [
        {
            "address": name,
            "ms": statistics.median(found),
            "ms p99": sorted(found)[min(len(found) - 1, round(0.99 * len(found)))],
            "bytes": sizes[name],
        }
        for name, found in times.items()
    ]


def deliveries(client: Client, store_path: Path, next_block: int, listeners: int, rounds: int) -> Row:
    """Return how long it takes from a commit to who follows the channel."""
    streams = [client.stream(f"?machine=rig&channel={CHANNEL}") for _ in range(listeners)]
    for _, answer in streams:
        _wait_for(answer, b"event: machines")
    channels = made_up(1)[0].channels
    times: list[float] = []
    with Store.open(store_path, machine="rig") as store:
        for number in range(rounds):
            # The page looks twice a second: the commits fall anywhere in between.
            time.sleep(0.37 + 0.13 * (number % 5))
            store.commit(_record("rig", next_block + number, channels), {})
            began = time.perf_counter()
            for _, answer in streams:
                _wait_for(answer, b"event: records")
            times.append(1e3 * (time.perf_counter() - began))
    for connection, _ in streams:
        connection.close()
    return {"streams": listeners, "commits": rounds, "ms": statistics.median(times), "ms worst": max(times)}


def _wait_for(answer: http.client.HTTPResponse, line: bytes) -> None:
    while not (found := answer.readline()).startswith(line):
        if not found:
            raise RuntimeError("the stream ended")
    answer.readline()


@contextmanager
def started(folder: Path) -> Iterator[tuple[str, float]]:
    """Serve the page of a folder; yield its address, and how long the start took, s."""
    began = time.perf_counter()
    command = [sys.executable, "-c", "from monitor.cli import main; main()", "page", "--quiet", "--config", str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            url = process.stdout.readline().strip()
            if not url:
                raise RuntimeError("the page did not start")
            yield url, time.perf_counter() - began
        finally:
            process.terminate()


def run(folder: Path, records: int, rounds: int) -> dict[str, Sequence[Row]]:
    """Measure everything."""
    prepare_many(folder / "many")
    prepare_long(folder / "rig", records)
    with talking(folder / "many"), started(folder) as (url, ready):
        client, began = Client(url), time.perf_counter()
        path = f"/api/channels/rig/{CHANNEL}"
        while b'"updating":true' in _plain(client.ask(f"{path}/records?points=10")):
            time.sleep(0.2)
        caught_up = time.perf_counter() - began
        rows = latencies(client, BEGIN + INTERVAL * records, rounds)
        store = folder / "rig" / "state" / "state.db"
        few = deliveries(client, store, records + 1, 1, min(rounds, 12))
        many = deliveries(client, store, records + 100, 32, min(rounds, 12))
    start = [{"records": records, "page answers s": ready, "all records in the trends s": caught_up}]
    return {"addresses": rows, "start": start, "stream": [few, many]}


def _plain(body: bytes) -> bytes:
    return gzip.decompress(body) if body[:2] == b"\x1f\x8b" else body


def main() -> None:
    """Measure, print, and write what was asked for."""
    options = arguments("the page's server")
    with tempfile.TemporaryDirectory() as name:
        found = run(Path(name), 50_000 if options.quick else 100_000, 5 if options.quick else 15)
    print_table("addresses (wall clock, one after the other over one connection)", found["addresses"])
    print_table("start", found["start"])
    print_table("from a commit to who follows the channel (the page looks twice a second)", found["stream"])
    write_json(options.json, found)


if __name__ == "__main__":
    main()
