"""How the servers accept: a client that comes too often waits or is refused, another one is not."""

from __future__ import annotations

import asyncio
import socket
import ssl
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from streams.link import entrance as room
from streams.link import front
from streams.link.front import Door
from tests.support.receivers import make_certificate
from tests.support.waiting import PATIENCE_S


class Greeting(asyncio.Protocol):
    """Sends one byte to every connection."""

    made = 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Greet."""
        Greeting.made += 1
        assert isinstance(transport, asyncio.Transport)
        transport.write(b"!")


@asynccontextmanager
async def entered(door: Door[Any], tls: ssl.SSLContext | None = None) -> AsyncIterator[int]:
    """Accept at a free port; give the port."""
    Greeting.made = 0
    with socket.create_server(("127.0.0.1", 0), backlog=1024) as listening:
        running = asyncio.create_task(room.Entrance(listening, door, Greeting, tls).run())
        try:
            yield listening.getsockname()[1]
        finally:
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)


def door(most: int = 1000) -> Door[Any]:
    return Door(most, most, lambda _: (0, 0.0))


async def answer(port: int, address: str, context: ssl.SSLContext | None = None) -> bytes:
    """Return what a connection gets from the entrance, b"" where it is refused."""
    try:
        async with asyncio.timeout(PATIENCE_S):
            reader, writer = await asyncio.open_connection(
                "127.0.0.1", port, local_addr=(address, 0), ssl=context, server_hostname="" if context else None
            )
            found = await reader.read(1)
            writer.close()
            return found
    except ConnectionError:
        return b""


def test_a_flood_of_one_client_leaves_room_for_another(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(room, "CONNECTIONS_PER_S", 5.0)
    monkeypatch.setattr(front, "WAITING", 5)
    found = door()

    async def act() -> int:
        async with entered(found) as port:
            began = time.monotonic()
            flood = await asyncio.gather(*(answer(port, "127.0.0.9") for _ in range(300)))
            assert 10 <= flood.count(b"!") == Greeting.made <= 11 + 5.0 * (time.monotonic() - began)
            assert await answer(port, "127.0.0.1") == b"!"
            return flood.count(b"")

    refused = asyncio.run(act())
    assert found.counts()["refused"]["rate"] == refused > 0


def test_a_crowd_behind_one_address_has_its_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(room, "CONNECTIONS_PER_S", 20.0)
    found = door()

    async def act() -> None:
        async with entered(found) as port:
            began = time.monotonic()
            crowd = await asyncio.gather(*(answer(port, "127.0.0.9") for _ in range(80)))
            assert crowd == [b"!"] * 80
            # The first forty come at once, the others at their rate.
            assert time.monotonic() - began > 1.5

    asyncio.run(act())
    assert not any(found.counts()["refused"].values())


@pytest.mark.process
def test_connections_that_do_not_shake_hands_make_room(tmp_path: Path) -> None:
    certificate, found = make_certificate(tmp_path), door(4)

    async def act() -> None:
        async with entered(found, certificate.server) as port:
            silent = [await asyncio.open_connection("127.0.0.1", port) for _ in range(10)]
            context = ssl.create_default_context(cafile=str(certificate.cert))
            context.check_hostname = False
            assert await answer(port, "127.0.0.1", context) == b"!"
            # Those that came first have ended, and the last ones wait still.
            async with asyncio.timeout(PATIENCE_S):
                assert await silent[0][0].read(1) == b""
            wrong, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(b"GET / HTTP/1.1\r\n\r\n")
            async with asyncio.timeout(PATIENCE_S):
                assert await wrong.read() != b"!"
            for _, held in (*silent, (wrong, writer)):
                held.close()

    asyncio.run(act())
    refused = found.counts()["refused"]
    assert refused["replaced"] >= 7
    assert refused["message"] == 1
    assert Greeting.made == 1


def test_without_descriptors_it_waits_and_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(room, "_PAUSE_S", 0.01)
    failures = [OSError(24, "Too many open files")] * 3

    async def act() -> None:
        loop = asyncio.get_running_loop()
        accept = loop.sock_accept

        async def refusing(listening: socket.socket) -> Any:
            if failures:
                raise failures.pop()
            return await accept(listening)

        monkeypatch.setattr(loop, "sock_accept", refusing)
        async with entered(door()) as port:
            assert await answer(port, "127.0.0.1") == b"!"

    asyncio.run(act())
    assert not failures
