"""The page of a machine on a free port of this computer, served from a thread, and a client that sends anything."""

from __future__ import annotations

import asyncio
import gzip
import http.client
import json
import socket
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from monitor.config.load import load_config
from monitor.config.outputs import WebSection
from monitor.web.machines import Machines
from monitor.web.server import serve
from tests.streams.folders import csv_bytes, noise
from tests.support.daemons import make_machine
from tests.support.waiting import PATIENCE_S, join, wait_until

LEVELS = (
    '[[alarms.level]]\nfeature = "rms"\nalert_g = 0.001\non_delay_blocks = 1\nlatch = true\n'
    '[[alarms.level]]\nfeature = "kurtosis"\ndanger_factor = 9\n'
)
"""The first block of noise is above the first of them; the second must be learned."""


@dataclass(frozen=True)
class Reply:
    """What was answered."""

    status: int
    headers: Mapping[str, str]
    body: bytes
    cookies: Sequence[str] = ()

    @property
    def json(self) -> dict[str, Any]:
        """The object in the body, unpacked; no number in it is NaN or infinite."""

        def refuse(word: str) -> None:
            raise AssertionError(f"{word} in JSON")

        packed = self.headers.get("content-encoding") == "gzip"
        return json.loads(gzip.decompress(self.body) if packed else self.body, parse_constant=refuse)


class Page:
    """A page that is served, and its address."""

    def __init__(self, url: str, token: str) -> None:
        """Take the address."""
        self.url, self.token = url, token
        self.port = urlsplit(url).port or 0

    def ask(
        self, path: str, method: str = "GET", headers: Mapping[str, str] | None = None, body: bytes | None = None
    ) -> Reply:
        """Ask for an address, exactly as it is written."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)
        try:
            connection.request(method, path, body, dict(headers or {}))
            answer = connection.getresponse()
            # Of several of the same name, the first; the cookie of the session comes before the other.
            found = {key.lower(): value for key, value in reversed(answer.getheaders())}
            return Reply(answer.status, found, answer.read(), answer.headers.get_all("set-cookie") or [])
        finally:
            connection.close()

    def get(self, path: str) -> dict[str, Any]:
        """Return the JSON object at an address that must answer."""
        reply = self.ask(path)
        assert reply.status == 200, reply.body
        return reply.json

    def post(self, path: str, value: Any, **headers: str) -> Reply:
        """Send a JSON object; ``authorization`` and other headers by their names with _ for -."""
        named = {key.replace("_", "-"): text for key, text in headers.items()}
        return self.ask(path, "POST", {"content-type": "application/json", **named}, json.dumps(value).encode())

    @property
    def bearer(self) -> str:
        """What shows the token."""
        return f"Bearer {self.token}"

    def dial(self) -> socket.socket:
        """Return a bare connection."""
        return socket.create_connection(("127.0.0.1", self.port), timeout=PATIENCE_S)

    @contextmanager
    def events(self, query: str = "") -> Iterator[Iterator[tuple[str, Any]]]:
        """Listen to the stream; gives kind and data of each event."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)
        try:
            connection.request("GET", f"/api/stream{query}")
            answer = connection.getresponse()
            assert answer.status == 200, answer.read()

            def read() -> Iterator[tuple[str, Any]]:
                kind = ""
                for line in answer:
                    if line.startswith(b"event: "):
                        kind = line[7:].decode().strip()
                    elif line.startswith(b"data: "):
                        yield kind, json.loads(line[6:])

            yield read()
        finally:
            connection.close()


@contextmanager
def page_of(*configs: Path, web: WebSection | None = None) -> Iterator[Page]:
    """Serve the page of machines until the end of the block."""
    loaded = [load_config(path) for path in configs]
    state_dir, said = loaded[0].machine.state_dir, {}
    loop = asyncio.new_event_loop()
    settings = (web or WebSection()).model_copy(update={"port": 0})
    task = loop.create_task(serve(Machines(loaded), settings, state_dir, said.update))

    def run() -> None:
        try:
            loop.run_until_complete(task)
        except asyncio.CancelledError:
            pass
        finally:
            loop.run_until_complete(loop.shutdown_asyncgens())
            loop.close()

    thread = threading.Thread(target=run)
    thread.start()
    try:
        wait_until(lambda: "url" in said or not thread.is_alive())
        token_file = settings.token_file or state_dir / "web.token"
        yield Page(said["url"], token_file.read_text().strip())
    finally:
        if thread.is_alive():
            loop.call_soon_threadsafe(task.cancel)
        join(thread)


def alarmed_machine(folder: Path, sources: int = 1) -> Path:
    """Make a machine whose first block raises an alarm; return its configuration."""
    config = make_machine(folder, sources)
    config.write_text(config.read_text() + LEVELS)
    return config


def put_blocks(config: Path, number: int, blocks: int = 2, source: int = 0) -> None:
    """Give a source a file of so many blocks of noise."""
    path = config.parent / f"in{source}" / f"f{number:04d}.csv"
    path.with_suffix(".tmp").write_bytes(csv_bytes(noise(256 * blocks, 1000 * source + number)))
    path.with_suffix(".tmp").rename(path)
