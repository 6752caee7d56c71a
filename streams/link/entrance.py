"""How servers in an event loop, the page and OPC UA, accept connections; the TCP receiver accepts in its own loop."""

from __future__ import annotations

import asyncio
import random
import ssl
from collections.abc import Callable
from contextlib import suppress
from socket import socket
from typing import Any

from streams.link.front import Bucket, Door, FullError, OftenError, Visits, client_of

CONNECTIONS_PER_S = 100.0
"""Of one client."""
_ACCEPTED_PER_S, _ACCEPTED_AT_ONCE = 5000.0, 64
"""Taken from the kernel's queue, most of them only to be refused: that costs little, and a long queue much time."""
_HANDSHAKE_S = 10.0
_PAUSE_S = 0.1
WAITING, WAITING_IN_ALL = 128, 512
"""Connections of one client, and of all, that wait for their turn: about as many as may come in a second or two."""
_TURN_S = 0.02


class Entrance:
    """Accepts the connections of one listening socket; asyncio would take all that come, and limit none before TLS.

    Those of a client that connects too often wait. Where too many wait, any one of the client's is refused: who shares
    an address with a crowd has its turn in a second or two, in a flood a chance.
    """

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
        self._waiting: dict[str, list[tuple[socket, str]]] = {}
        self._crowd = asyncio.Event()

    async def run(self) -> None:
        """Accept until cancelled."""
        loop = asyncio.get_running_loop()
        self._listening.setblocking(False)
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(self._let_in(group))
                await self._accept(group, loop)
        finally:
            for queue in self._waiting.values():
                for connection, _ in queue:
                    connection.close()

    async def _accept(self, group: asyncio.TaskGroup, loop: asyncio.AbstractEventLoop) -> None:
        while True:
            try:
                self._arrive(group, *await loop.sock_accept(self._listening))
                for _ in range(_ACCEPTED_AT_ONCE):
                    self._arrive(group, *self._listening.accept())
            except BlockingIOError:
                wait = 0.0
            except OSError:
                # The client has gone, or there are no descriptors left.
                wait = _PAUSE_S
            else:
                wait = self._rate.take()
            await asyncio.sleep(wait)

    def _arrive(self, group: asyncio.TaskGroup, connection: socket, place: tuple[Any, ...]) -> None:
        """Admit a new connection, or have it wait behind those of its client."""
        address = str(place[0])
        client = client_of(address)
        if client not in self._waiting and self._admit(group, connection, address):
            return
        queue = self._waiting.setdefault(client, [])
        self._crowd.set()
        queue.append((connection, address))
        if len(queue) > WAITING or sum(map(len, self._waiting.values())) > WAITING_IN_ALL:
            # Any one of the longest queue: the first ones would all be of those who came first.
            queue = max(self._waiting.values(), key=len)
            refused, _ = queue.pop(random.randrange(len(queue)))
            refused.close()
            self._refused["rate"] += 1

    async def _let_in(self, group: asyncio.TaskGroup) -> None:
        """Admit those that wait, one of each client in turn, as soon as it may."""
        while True:
            await self._crowd.wait()
            let_in = True
            while let_in:
                let_in = False
                for client, queue in list(self._waiting.items()):
                    if queue and self._admit(group, *queue[0]):
                        let_in = True
                        del queue[0]
                    if not queue:
                        del self._waiting[client]
            if not self._waiting:
                self._crowd.clear()
            await asyncio.sleep(_TURN_S)

    def _admit(self, group: asyncio.TaskGroup, connection: socket, address: str) -> bool:
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

        task = group.create_task(self._open(connection))
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
