"""How servers in an event loop, the page and OPC UA, accept connections; the TCP receiver accepts in its own loop."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import Callable
from contextlib import suppress
from socket import socket
from typing import Any

from streams.link.front import TURN_S, Bucket, Door, FullError, OftenError, Visits, WaitingRoom

CONNECTIONS_PER_S = 100.0
"""Of one client."""
_ACCEPTED_PER_S, _ACCEPTED_AT_ONCE = 5000.0, 64
"""Taken from the kernel's queue, most of them only to be refused: that costs little, and a long queue much time."""
_HANDSHAKE_S = 10.0
_PAUSE_S = 0.1


class Entrance:
    """Accepts the connections of one listening socket; asyncio would take all that come, and limit none before TLS."""

    _group: asyncio.TaskGroup

    def __init__(
        self,
        listening: socket,
        door: Door[Any],
        make: Callable[[], asyncio.Protocol],
        tls: ssl.SSLContext | None = None,
        in_all_per_s: float = 2.0 * CONNECTIONS_PER_S,
    ) -> None:
        """Take what listens, the door with the counts, and what makes the protocol of a connection."""
        self._listening, self._make, self._tls = listening, make, tls
        self._rate = Bucket(_ACCEPTED_PER_S / _ACCEPTED_AT_ONCE, 4.0)
        visits = Visits(CONNECTIONS_PER_S, in_all_per_s)
        # Connections that are not with the protocol yet: those that shake hands.
        self._opening: Door[asyncio.Task[None]] = Door(door.in_all, door.per_client, lambda _: (0, 0.0), visits)
        self._opening.refused = self._refused = door.refused
        self._waiting = WaitingRoom(self._admit, self._note_refusal)
        self._crowd = asyncio.Event()

    async def run(self) -> None:
        """Accept until cancelled."""
        loop = asyncio.get_running_loop()
        self._listening.setblocking(False)
        self._group = asyncio.TaskGroup()
        try:
            async with self._group:
                self._group.create_task(self._let_in())
                await self._accept(loop)
        finally:
            self._waiting.close()

    async def _accept(self, loop: asyncio.AbstractEventLoop) -> None:
        while True:
            try:
                self._arrive(*await loop.sock_accept(self._listening))
                for _ in range(_ACCEPTED_AT_ONCE):
                    self._arrive(*self._listening.accept())
            except BlockingIOError:
                wait = 0.0
            except OSError:
                # The client has gone, or there are no descriptors left.
                wait = _PAUSE_S
            else:
                wait = self._rate.take()
            await asyncio.sleep(wait)

    def _arrive(self, connection: socket, place: tuple[Any, ...]) -> None:
        self._waiting.arrive(connection, str(place[0]))
        if self._waiting:
            self._crowd.set()

    def _note_refusal(self) -> None:
        self._refused["rate"] += 1

    async def _let_in(self) -> None:
        while True:
            await self._crowd.wait()
            self._waiting.let_in()
            if not self._waiting:
                self._crowd.clear()
            await asyncio.sleep(TURN_S)

    def _admit(self, connection: socket, address: str) -> bool:
        """Open a connection, or close it where there is no place for it; return whether it need not wait."""
        try:
            oldest = self._opening.room_for(address)
        except OftenError:
            return False
        except FullError:
            connection.close()
            return True
        if oldest is not None:
            self._refused["replaced"] += 1
            self._opening.remove(oldest)
            oldest.cancel()

        def opened(task: asyncio.Task[None]) -> None:
            self._opening.remove(task)
            if task.cancelled():
                # It may not have begun.
                connection.close()

        task = self._group.create_task(self._open(connection))
        self._opening.add(task, address)
        task.add_done_callback(opened)
        return True

    async def _open(self, connection: socket) -> None:
        loop = asyncio.get_running_loop()
        limit = None if self._tls is None else _HANDSHAKE_S
        # That the client has gone is no refusal.
        with suppress(OSError):
            try:
                await loop.connect_accepted_socket(self._make, connection, ssl=self._tls, ssl_handshake_timeout=limit)
            except ConnectionAbortedError:
                self._refused["slow"] += 1
            except ssl.SSLError:
                self._refused["message"] += 1
