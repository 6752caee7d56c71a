"""Limits of the OPC UA server: what strangers send, hold and ask for, against the real server."""

from __future__ import annotations

import asyncio
import socket
import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from types import SimpleNamespace
from typing import Any, cast

import pytest
from asyncua import ua
from asyncua.client.client import Client
from asyncua.ua.status_codes import StatusCodes

from monitor.service.neighbours import opcua_front as front
from tests.monitor.service.neighbours.machines import Machine, serving
from tests.support.daemons import free_port
from tests.support.waiting import PATIENCE_S, wait_until


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, int]]:
    """Address and port of a server that any local client may read."""
    port = free_port()
    machine = Machine(
        tmp_path_factory.mktemp("open"), f'[publish.opcua]\nurl = "opc.tcp://127.0.0.1:{port}/pump"\nanonymous = true\n'
    )
    machine.add()
    with serving(machine) as url:
        yield url, port
    machine.close()


def dial(port: int) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)


def hello(receives: int = 65_536, sends: int = 65_536) -> bytes:
    body = struct.pack("<IIIIIi", 0, receives, sends, 0, 0, 4) + b"opc:"
    return b"HELF" + struct.pack("<I", 8 + len(body)) + body


def answers(connection: socket.socket) -> list[tuple[bytes, int]]:
    """Read until the server ends the connection; return kind of message and first number of each."""
    data = bytearray()
    with suppress(ConnectionResetError):
        while part := connection.recv(4096):
            data += part
    found = []
    while data:
        size = int.from_bytes(data[4:8], "little")
        found.append((bytes(data[:3]), int.from_bytes(data[8:12], "little")))
        del data[:size]
    return found


def is_ended(connection: socket.socket) -> bool:
    connection.settimeout(0.0)
    try:
        return connection.recv(4096) == b""
    except BlockingIOError:
        return False
    except ConnectionResetError:
        return True


def serves(url: str) -> bool:
    async def read() -> Any:
        async with Client(url, timeout=PATIENCE_S) as client:
            return await client.get_node("ns=2;s=pump:state").read_value()

    return asyncio.run(read()) == "maintenance_required"


def with_clients(url: str, act: Callable[[Client, Client], Any]) -> None:
    async def run() -> None:
        async with Client(url, timeout=PATIENCE_S) as first, Client(url, timeout=PATIENCE_S) as second:
            await act(first, second)

    asyncio.run(run())


@pytest.mark.parametrize("head", [b"MSGC", b"MSGF", b"OPNF"])
def test_a_chunk_that_claims_too_much_is_refused_before_it_comes(server: tuple[str, int], head: bytes) -> None:
    url, port = server
    with dial(port) as connection:
        connection.sendall(hello() + head[:3] + b"F" + struct.pack("<I", front.MAX_CHUNK_BYTES + 1))
        assert answers(connection)[-1] == (b"ERR", StatusCodes.BadTcpMessageTooLarge)
    assert serves(url)


@pytest.mark.parametrize(
    ("sent", "code"),
    [
        (b"MSGF" + struct.pack("<II", 64, 1), StatusCodes.BadTcpMessageTypeInvalid),
        (b"GET / HTTP/1.1\r\n\r\n", StatusCodes.BadTcpMessageTypeInvalid),
        (b"HELF" + struct.pack("<I", 1 << 20), StatusCodes.BadTcpMessageTooLarge),
        (b"HELF" + struct.pack("<I", 12) + bytes(4), StatusCodes.BadTcpMessageTypeInvalid),
        (hello(receives=0), StatusCodes.BadConnectionRejected),
        (hello(sends=1), StatusCodes.BadConnectionRejected),
        (hello() + hello(), StatusCodes.BadTcpMessageTypeInvalid),
        (hello() + b"MSGF" + struct.pack("<I", 0), StatusCodes.BadTcpMessageTooLarge),
        (hello() + b"MSGC" + struct.pack("<II", 64, 1), StatusCodes.BadTcpMessageTypeInvalid),
    ],
    ids=[
        "a message before the hello", "another protocol", "an endless hello", "half a hello", "no room for answers",
        "chunks of one byte", "a second hello", "an empty chunk", "a part of a message without a session",
    ],
)  # fmt: skip
def test_what_is_no_conversation_is_ended(server: tuple[str, int], sent: bytes, code: int) -> None:
    with dial(server[1]) as connection:
        connection.sendall(sent)
        assert answers(connection)[-1] == (b"ERR", code)
    assert serves(server[0])


def test_connections_are_counted_by_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(front, "MAX_CONNECTIONS", 4)
    monkeypatch.setattr(front, "IDLE_S", 0.3)

    async def run() -> dict[str, Any]:
        listening = front.Listener(cast("Any", _no_services()), "127.0.0.1", 0, front.TransportLimits())
        await listening.start()
        held = [await asyncio.open_connection("127.0.0.1", listening.port) for _ in range(3)]
        held[2][1].write(b"GET / HTTP/1.1\r\n\r\n")
        async with asyncio.timeout(PATIENCE_S):
            # The first makes room for the third; the second says nothing, and the third nonsense.
            assert [(await reader.read())[:3] for reader, _ in held] == [b"", b"", b"ERR"]
        for _, writer in held:
            writer.close()
        await listening.stop()
        return listening.door.counts()

    counts = asyncio.run(run())
    refused = counts.pop("refused")
    assert counts == {"connections": 0, "accepted": 3, "received_bytes": 18}
    assert {cause: number for cause, number in refused.items() if number} == {"replaced": 1, "slow": 1, "message": 1}


def _no_services() -> SimpleNamespace:
    """Return what a listener uses of the services, where nothing is ever asked."""
    return SimpleNamespace(
        max_pending_messages_per_connection=4,
        max_connections=9,
        max_pending_activation_seconds=0.0,
        asyncio_transports=[],
    )


def test_one_client_holds_at_most_half_and_another_finds_room(server: tuple[str, int]) -> None:
    url, port = server

    async def act(first: Client, second: Client) -> None:
        held = [dial(port) for _ in range(front.MAX_CONNECTIONS // 2 + 40)]
        try:
            for connection in held:
                connection.sendall(hello())
            await asyncio.to_thread(wait_until, lambda: sum(map(is_ended, held)) >= 42)
            # Those with a session stay.
            for client in (first, second):
                assert await client.get_node("ns=2;s=pump:state").read_value() == "maintenance_required"
        finally:
            for connection in held:
                connection.close()

    with_clients(url, act)
    assert serves(url)


def test_connections_without_a_session_are_ended(server: tuple[str, int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(front, "IDLE_S", 0.3)
    with dial(server[1]) as silent, dial(server[1]) as greeted:
        greeted.sendall(hello())
        assert answers(silent) == []
        assert [kind for kind, _ in answers(greeted)] == [b"ACK"]


def unconnected() -> front.LimitedConnection:
    door: front.Door[front.LimitedConnection] = front.Door(8, 4, lambda found: found.idleness)
    services = SimpleNamespace(max_pending_messages_per_connection=front._MAX_QUEUED)
    given: Any = {"iserver": services, "policies": [], "clients": [], "closing_tasks": [], "limits": None}
    return front.LimitedConnection(door, **given)


def test_a_client_that_reads_no_answers_gets_no_more_and_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(front, "_MAX_UNREAD_S", 0.2)
    processed: list[Any] = []

    async def process(header: Any, buf: Any) -> bool:
        processed.append(header)
        return True

    async def run() -> None:
        found, ended = unconnected(), asyncio.Event()
        found.transport = cast("Any", SimpleNamespace(abort=ended.set))
        found.processor = cast("Any", SimpleNamespace(process=process, session=None))
        found.pause_writing()
        first = asyncio.create_task(found._process_one_msg(ua.Header(), cast("Any", b"")))
        await asyncio.sleep(0.05)
        assert processed == []
        found.resume_writing()
        assert await first
        assert len(processed) == 1
        assert not ended.is_set()
        found.pause_writing()
        async with asyncio.timeout(PATIENCE_S):
            await ended.wait()

    asyncio.run(run())


def test_a_client_that_asks_too_fast_is_read_no_further(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(front, "_MESSAGES_PER_S", 1e-3)
    monkeypatch.setattr(front, "_BURST", 5.0)
    chunk = b"MSGF" + struct.pack("<II", 16, 1) + bytes(4)

    async def run() -> None:
        found, paused = unconnected(), list[bool]()
        found.transport = cast(
            "Any", SimpleNamespace(is_closing=lambda: False, pause_reading=lambda: paused.append(True))
        )
        found._chunk_bytes = front.MAX_CHUNK_BYTES
        for number in range(1, 6):
            found.data_received(chunk)
            assert (found.messages.qsize(), paused) == (number, [])
        found.data_received(2 * chunk)
        assert (found.messages.qsize(), paused) == (6, [True])
        found._timers["resume"].cancel()

    asyncio.run(run())


def test_a_message_and_a_session_have_a_limit(server: tuple[str, int]) -> None:
    async def act(first: Client, second: Client) -> None:
        node = first.get_node("ns=2;s=pump:state")
        assert first.session_timeout == 1000.0 * front.MAX_SESSION_S
        with pytest.raises(ua.uaerrors.BadRequestTooLarge):
            await first.read_values([node] * 15_000)
        assert await second.get_node("ns=2;s=pump:state").read_value() == "maintenance_required"

    with_clients(server[0], act)


def test_a_connection_has_one_session_and_this_is_no_discovery_server(server: tuple[str, int]) -> None:
    async def act(first: Client, _: Client) -> None:
        with pytest.raises(ua.uaerrors.BadTooManySessions):
            await first.create_session()
        with pytest.raises(ua.uaerrors.BadServiceUnsupported):
            await first.uaclient.register_server(ua.RegisteredServer())

    with_clients(server[0], act)


def test_a_client_has_no_hold_on_the_subscriptions_of_another(server: tuple[str, int]) -> None:
    class Quiet:
        def datachange_notification(self, node: Any, val: Any, data: Any) -> None:
            """Take no notice."""

    async def act(first: Client, second: Client) -> None:
        found = await first.create_subscription(50, Quiet())
        number = found.subscription_id
        assert number is not None
        results = await second.uaclient.delete_subscriptions([number])
        assert [result.value for result in results] == [StatusCodes.BadSubscriptionIdInvalid]
        node = first.get_node("ns=2;s=pump:state")
        assert await found.subscribe_data_change(node)
        assert [result.is_good() for result in await first.uaclient.delete_subscriptions([number])] == [True]

    with_clients(server[0], act)


def test_subscriptions_and_items_have_a_limit(server: tuple[str, int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(front, "MAX_SUBSCRIPTIONS", 4)
    monkeypatch.setattr(front, "MAX_ITEMS", 6)

    class Quiet:
        def datachange_notification(self, node: Any, val: Any, data: Any) -> None:
            """Take no notice."""

    async def act(first: Client, second: Client) -> None:
        subscription = await first.create_subscription(50, Quiet())
        await second.create_subscription(0, Quiet())
        with pytest.raises(ua.uaerrors.BadTooManySubscriptions):
            await second.create_subscription(50, Quiet())
        node = first.get_node("ns=2;s=pump:state")
        for _ in range(3):
            await subscription.subscribe_data_change(node)
        with pytest.raises(ua.uaerrors.BadTooManyMonitoredItems):
            await subscription.subscribe_data_change(node)

    with_clients(server[0], act)
