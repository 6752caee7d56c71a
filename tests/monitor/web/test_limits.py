"""Limits of the page: they end what is idle, and never keep the health from being answered."""

from __future__ import annotations

import asyncio
import socket
import threading
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast, get_args

import pytest
from prometheus_client.parser import text_string_to_metric_families
from starlette.requests import Request

from monitor.config.load import load_config
from monitor.config.outputs import WebSection
from monitor.web.app import Site, _stream
from monitor.web.auth import Doorkeeper
from monitor.web.desk import NO_FOLDERS
from monitor.web.machines import Machines
from monitor.web.security import Doors
from monitor.web.server import HEAD_S, LimitedProtocol
from streams.link.front import Cause, Door
from tests.support.daemons import make_machine
from tests.support.pages import Page, page_of
from tests.support.security import machine_with_event
from tests.support.waiting import PATIENCE_S, wait_until


def is_healthy(page: Page) -> bool:
    """Return whether the health was answered; no daemon runs, so the answer is that it fails."""
    reply = page.ask("/healthz")
    return reply.status == 503 and reply.json["status"] == "failing"


def is_closed(connection: socket.socket) -> bool:
    try:
        return connection.recv(4096) == b""
    except ConnectionResetError:
        return True


@pytest.mark.parametrize("words", [b"", b"GET /healthz HTTP/1.1\r\nHost: loc", b"POST /login HTTP/1.1\r\n%s{"])
def test_idle_and_slow_connections_leave_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: bytes) -> None:
    monkeypatch.setattr("monitor.web.server.MAX_CONNECTIONS", 3)
    with page_of(machine_with_event(tmp_path)) as page:
        rest = b"Host: localhost:%d\r\nContent-Type: application/json\r\nContent-Length: 100\r\n\r\n" % page.port
        held = [page.dial() for _ in range(12)]
        for connection in held[:1]:
            connection.sendall(words.replace(b"%s", rest))
        for _ in range(5):
            assert is_healthy(page)
        # The oldest ones made room.
        assert is_closed(held[0])
        for connection in held:
            connection.close()


def test_a_stream_is_not_ended_for_a_new_connection(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("monitor.web.server.MAX_CONNECTIONS", 2)
    config = machine_with_event(tmp_path)
    with page_of(config) as page, page.events() as events:
        assert next(events)[0] == "machines"
        held = [page.dial() for _ in range(6)]
        assert is_healthy(page)
        (tmp_path / "state" / "status.json").write_text('{"up_s": 1}')
        assert next(events)[0] == "machines"
        for connection in held:
            connection.close()


def test_the_health_does_not_wait_for_other_answers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    go_on, busy = threading.Event(), threading.Semaphore(0)

    def slowly(*_: Any) -> dict[str, Any]:
        busy.release()
        go_on.wait()
        return {}

    monkeypatch.setattr("monitor.web.api.machines", slowly)
    monkeypatch.setattr("monitor.web.app._MAX_WAITING", 6)
    with page_of(machine_with_event(tmp_path)) as page:
        head = b"GET /api/machines HTTP/1.1\r\nHost: localhost:%d\r\n\r\n" % page.port
        held = [page.dial() for _ in range(6)]
        try:
            for connection in held:
                connection.sendall(head)
            for _ in range(4):
                busy.acquire()
            wait_until(lambda: page.ask("/api/events").status == 503)
            assert is_healthy(page)
        finally:
            go_on.set()
            for connection in held:
                connection.close()


def test_simultaneous_requests_do_not_exceed_the_streams(tmp_path: Path) -> None:
    web = WebSection(max_streams=3)
    site = Site(
        Machines([load_config(make_machine(tmp_path))]), Doors.of(web, 8710), Doorkeeper("x" * 20), 3, NO_FOLDERS
    )
    scope = {"type": "http", "method": "GET", "path": "/api/stream", "query_string": b"", "headers": []}

    async def open_all() -> list[int]:
        replies = [await _stream(site, Request(scope)) for _ in range(10)]
        codes = [reply.status_code for reply in replies]

        async def send(message: Any) -> None:
            await asyncio.sleep(0)

        async def receive() -> Any:
            return {"type": "http.disconnect"}

        for reply in replies[:3]:
            # The client leaves before the first byte.
            await reply({**scope, "asgi": {"spec_version": "2.3"}}, receive, send)
        assert len(site.hub) == 0
        return codes

    with site:
        assert asyncio.run(open_all()) == [200] * 3 + [429] * 7


def test_many_streams_opened_at_once_are_no_more_than_allowed(tmp_path: Path) -> None:
    with page_of(machine_with_event(tmp_path), web=WebSection(max_streams=4)) as page:
        head = b"GET /api/stream HTTP/1.1\r\nHost: localhost:%d\r\n\r\n" % page.port
        opened = [page.dial() for _ in range(20)]
        for connection in opened:
            connection.sendall(head)
        codes = sorted(connection.recv(12)[-3:] for connection in opened)
        assert codes == [b"200"] * 4 + [b"429"] * 16
        for connection in opened:
            connection.close()
        wait_until(lambda: b"spallwatch_page_streams 0.0" in page.ask("/metrics").body)


def test_who_is_signed_in_takes_the_stream_of_a_stranger(tmp_path: Path) -> None:
    with page_of(machine_with_event(tmp_path), web=WebSection(max_streams=2)) as page:
        head = b"GET /api/stream HTTP/1.1\r\nHost: localhost:%d\r\n" % page.port
        token = b"Authorization: Bearer %s\r\n" % page.token.encode()
        opened, codes = [], []
        for more in (b"", b"", b"", token, token, token):
            opened.append(page.dial())
            opened[-1].sendall(head + more + b"\r\n")
            codes.append(opened[-1].recv(12)[-3:])
        assert codes == [b"200", b"200", b"429", b"200", b"200", b"429"]
        for connection in opened:
            connection.close()


def test_a_client_that_holds_most_connections_makes_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("monitor.web.server.MAX_CONNECTIONS", 4)
    with page_of(machine_with_event(tmp_path)) as page:
        at = ("127.0.0.1", page.port)
        other = socket.create_connection(at, PATIENCE_S, source_address=("127.0.0.9", 0))
        held = [page.dial() for _ in range(9)]
        assert is_closed(held[0])
        # Though it is idle for longer than any of them.
        head = b"GET /healthz HTTP/1.1\r\nHost: localhost:%d\r\n\r\n" % page.port
        other.sendall(head)
        assert other.recv(12)[-3:] == b"503"
        for connection in (other, *held):
            connection.close()


def test_an_answer_of_which_nothing_is_taken_is_ended() -> None:
    pending, looks, ended = [0], list[float](), list[bool]()
    door: Door[LimitedProtocol] = Door(1, 1, lambda _: None)
    connection = object.__new__(type("Counted", (LimitedProtocol,), {"door": door}))
    connection.transport = cast(
        "Any", SimpleNamespace(get_write_buffer_size=lambda: pending[0], abort=lambda: ended.append(True))
    )
    connection.loop = cast("Any", SimpleNamespace(call_later=lambda seconds, _: looks.append(seconds)))
    # An idle connection, one that takes its answer slowly, and one that takes nothing more.
    for size in (0, 0, 0, 0, 900, 600, 300, 300, 300):
        pending[0] = size
        connection._check_progress()
    assert (looks, ended) == ([HEAD_S] * 9, [])
    connection._check_progress()
    assert (looks, ended) == ([HEAD_S] * 9, [True])
    assert door.refused["unread"] == 1


def test_connections_that_end_are_counted_by_cause(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("monitor.web.server.MAX_CONNECTIONS", 2)
    monkeypatch.setattr("monitor.web.server.LimitedProtocol.head_within", 0.2)

    def counts(page: Page) -> dict[str, float]:
        text = page.ask("/metrics").body.decode()
        families = text_string_to_metric_families(text)
        found = [
            sample for family in families if family.name.startswith("spallwatch_listener") for sample in family.samples
        ]
        assert {sample.labels["listener"] for sample in found} == {"page"}
        assert {sample.labels.get("cause") for sample in found} == {None, *get_args(Cause)}
        return {sample.labels.get("cause", sample.name): sample.value for sample in found}

    with page_of(machine_with_event(tmp_path)) as page:
        with page.dial() as nonsense:
            nonsense.sendall(b"\x16\x03\x01 no request\r\n\r\n")
            assert nonsense.recv(12)[-3:] == b"400"
        with page.dial() as first, page.dial() as second, page.dial() as third:
            # The first makes room, the others say nothing in time.
            assert is_closed(first)
            assert is_closed(second)
            assert is_closed(third)
        found = counts(page)
    assert found["message"] == 1
    assert found["slow"] >= 1
    assert found["replaced"] >= 1
    assert found["spallwatch_listener_connections"] == 1
    assert found["spallwatch_listener_accepted_total"] >= 3
    assert found["spallwatch_listener_received_bytes_total"] > 0


@pytest.mark.parametrize("opening", [b"[", b'{"token":', b'{"who":'])
def test_json_that_is_nested_too_deeply_is_a_wrong_question(tmp_path: Path, opening: bytes) -> None:
    with page_of(machine_with_event(tmp_path)) as page:
        headers = {"content-type": "application/json", "authorization": page.bearer}
        for path in ("/login", "/api/events/m:n1/acknowledge"):
            deep = page.ask(path, "POST", headers, opening * (8000 // len(opening)))
            assert (deep.status, list(deep.json)) == (400, ["error"])
            # What is longer than a body may be is refused by its length, before it is read.
            with suppress(BrokenPipeError):  # The connection may be closed before all of it is sent.
                assert page.ask(path, "POST", headers, opening * 100_000).status == 413
