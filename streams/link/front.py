"""What all listeners share: who a client is, how many connections it may hold, which one makes room, and how often.

The page, the TCP receiver and the OPC UA server use it; the table of their limits is in docs/reference/daemon.md.
"""

from __future__ import annotations

import ipaddress
import math
import random
import time
from collections import Counter
from collections.abc import Callable, Hashable
from socket import socket
from typing import Any, Generic, Literal, TypeVar, get_args

from models.words.errors import SpallwatchError

Connection = TypeVar("Connection", bound=Hashable)

FREE_GUESSES = 5
"""Wrong secrets of a client that cost no delay: a person mistypes."""
FORGET_S = 900.0
_FIRST_DELAY_S, _MAX_DELAY_S = 1.0, 5.0
_MAX_CLIENTS = 10_000
BACKLOG = 512
"""Connections that wait in the kernel's queue of a listener."""
WAITING, WAITING_IN_ALL = 128, 512
"""Connections of one client, and of all, that wait for their turn: about as many as may come in a second or two."""
TURN_S = 0.02
"""Between two looks at those that wait."""
Cause = Literal["address", "full", "lost", "message", "rate", "replaced", "secret", "slow", "unread"]
"""Why connections are refused or ended, see docs/reference/daemon.md."""
_LATELY_S = 2.0
"""Time in which a connection counts less and less."""
_FEWER, _MIN_LEVEL = 0.995, 3.0


def client_of(address: str) -> str:
    """Return who is counted as one client: an IPv4 address, or the /64 of an IPv6 address, which one machine may have.

    What is no numerical address, such as the name of a local socket, is returned as it is.
    """
    try:
        found = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if isinstance(found, ipaddress.IPv4Address):
        return str(found)
    if found.ipv4_mapped is not None:
        return str(found.ipv4_mapped)
    return str(ipaddress.IPv6Network((int(found) >> 64 << 64, 64)))


class FullError(SpallwatchError):
    """A connection is not taken; the message says why."""


class OftenError(FullError):
    """A client connects too often; later, the connection may be taken."""


class Door(Generic[Connection]):
    """The open connections of a listener by client; used in one thread.

    ``idleness`` gives how readily a connection makes room: its class, the least first, and since when it is idle, s;
    None where it is not to be ended.
    """

    def __init__(
        self,
        in_all: int,
        per_client: int,
        idleness: Callable[[Connection], tuple[int, float] | None],
        visits: Visits | None = None,
    ) -> None:
        """Keep the limits; nothing is open yet."""
        self.in_all, self.per_client = in_all, per_client
        self._idleness, self._visits = idleness, visits
        self._client: dict[Connection, str] = {}
        self._counts: Counter[str] = Counter()
        self.taken = self.received_bytes = 0
        """Connections and bytes so far."""
        self.refused: dict[Cause, int] = dict.fromkeys(get_args(Cause), 0)
        """Connections refused or ended so far, by cause."""

    def __len__(self) -> int:
        """Return the number of open connections."""
        return len(self._client)

    def room_for(self, address: str) -> Connection | None:
        """Return which connection is to end so that one of ``address`` fits; None where it fits.

        Of those that are as idle, the one of the client with the most connections goes first.

        Raises:
            FullError: none of them is to be ended.
            OftenError: clients connect too often; it is not counted as refused yet.
        """
        client = client_of(address)
        if self._visits is not None and not self._visits.admit(client):
            raise OftenError("connects too often")
        full = self._counts[client] >= self.per_client
        if not full and len(self._client) < self.in_all:
            return None
        found: list[tuple[int, int, float, int]] = []
        connections = list(self._client)
        for place, connection in enumerate(connections):
            owner, idleness = self._client[connection], self._idleness(connection)
            if idleness is not None and (owner == client or not full):
                found.append((idleness[0], -self._counts[owner], idleness[1], place))
        if not found:
            self.refused["full"] += 1
            raise FullError("one connection too many")
        return connections[min(found)[3]]

    def add(self, connection: Connection, address: str) -> None:
        """Count a connection from now on."""
        self._client[connection] = client_of(address)
        self._counts[client_of(address)] += 1
        self.taken += 1

    def remove(self, connection: Connection) -> None:
        """Count a connection no more; an unknown one is ignored."""
        client = self._client.pop(connection, None)
        if client is not None:
            self._counts[client] -= 1
            if not self._counts[client]:
                del self._counts[client]

    def counts(self) -> dict[str, Any]:
        """Return what status and metrics have of the listener, as plain values; may be called from any thread."""
        return {
            "connections": len(self._client),
            "accepted": self.taken,
            "received_bytes": self.received_bytes,
            "refused": dict(self.refused),
        }


class WaitingRoom:
    """New connections of clients that connect too often; they wait for their turn.

    Where too many wait, any one of the client with the most is refused: who shares an address with a crowd has its turn
    in a second or two, in a flood a chance.
    """

    def __init__(self, admit: Callable[[socket, str], bool], refused: Callable[[], object]) -> None:
        """Take what admits a connection of an address, or returns that it has to wait, and what notes a refusal."""
        self._admit, self._refused = admit, refused
        self._queues: dict[str, list[tuple[socket, str]]] = {}

    def __bool__(self) -> bool:
        """Return whether there are any."""
        return bool(self._queues)

    def arrive(self, connection: socket, address: str) -> None:
        """Admit a new connection, or have it wait behind those of its client."""
        client = client_of(address)
        if client not in self._queues and self._admit(connection, address):
            return
        queue = self._queues.setdefault(client, [])
        queue.append((connection, address))
        if len(queue) > WAITING or sum(map(len, self._queues.values())) > WAITING_IN_ALL:
            # The first, or the last, would always be of the one who is quickest.
            queue = max(self._queues.values(), key=len)
            queue.pop(random.randrange(len(queue)))[0].close()
            self._refused()

    def let_in(self) -> None:
        """Admit those that may come in now, one of each client in turn."""
        going_on = True
        while going_on:
            going_on = False
            for client, queue in list(self._queues.items()):
                if queue and self._admit(*queue[0]):
                    going_on = True
                    del queue[0]
                if not queue:
                    del self._queues[client]

    def close(self) -> None:
        """End all that wait."""
        for queue in self._queues.values():
            for connection, _ in queue:
                connection.close()
        self._queues.clear()


class Bucket:
    """So many events a second, and more at once after a silence."""

    def __init__(self, per_s: float, burst: float, monotonic: Callable[[], float] = time.monotonic) -> None:
        """Begin with a whole burst."""
        self._per_s, self._burst, self._monotonic = per_s, burst, monotonic
        self._left, self._at = burst, monotonic()

    def take(self) -> float:
        """Take one event; return the seconds to wait before the next, 0 where there is none to wait."""
        now = self._monotonic()
        self._left = min(self._burst, self._left + (now - self._at) * self._per_s) - 1.0
        self._at = now
        return max(-self._left / self._per_s, 0.0)


class Visits:
    """Which new connections are taken: so many a second of one client, and so many of all.

    Where more come in all, those of the clients are refused that had most within the last seconds. How many one may
    have then is found step by step: fewer while too many are taken, more while there is room.
    """

    def __init__(
        self, per_client_per_s: float, in_all_per_s: float, monotonic: Callable[[], float] = time.monotonic
    ) -> None:
        """Begin without any; at once, a client may have those of two seconds."""
        self._monotonic = monotonic
        self._most, self._most_in_all = per_client_per_s * _LATELY_S, in_all_per_s * _LATELY_S
        self._level = self._most
        self._clients: dict[str, tuple[float, float]] = {}
        self._all = (0.0, monotonic())

    def admit(self, client: str) -> bool:
        """Return whether a new connection of a client is taken; one is, where it had none lately."""
        now = self._monotonic()
        own, total = (
            count * math.exp((at - now) / _LATELY_S) for count, at in (self._clients.pop(client, (0.0, now)), self._all)
        )
        taken = own + 1.0 <= self._level
        while len(self._clients) >= _MAX_CLIENTS:
            self._clients.pop(next(iter(self._clients)))
        self._clients[client], self._all = (own + taken, now), (total + taken, now)
        if total > self._most_in_all:
            self._level = max(self._level * _FEWER, _MIN_LEVEL)
        else:
            self._level = min(self._level / _FEWER, self._most) if total > self._most_in_all / 2.0 else self._most
        return taken


class Guesses:
    """Counts the wrong secrets of each client in a row, and says how long its next one waits.

    After the free ones the delay doubles up to 5 s; a right secret, or a quarter of an hour, ends it.
    """

    def __init__(self, monotonic: Callable[[], float] = time.monotonic) -> None:
        """Count nothing yet."""
        self._monotonic = monotonic
        self._counts: dict[str, tuple[int, float]] = {}

    def count(self, client: str) -> int:
        """Return the wrong secrets of a client in a row."""
        count, last = self._counts.get(client, (0, 0.0))
        return count if self._monotonic() - last < FORGET_S else 0

    def delay(self, client: str) -> float:
        """Return the seconds until the next secret of a client is looked at."""
        over = self.count(client) - FREE_GUESSES
        if over < 0:
            return 0.0
        wanted = min(_FIRST_DELAY_S * 2.0 ** min(over, 30), _MAX_DELAY_S)
        return max(self._counts[client][1] + wanted - self._monotonic(), 0.0)

    def wrong(self, client: str) -> None:
        """Note a wrong secret."""
        count = self.count(client)
        self._counts.pop(client, None)
        while len(self._counts) >= _MAX_CLIENTS:
            self._counts.pop(next(iter(self._counts)))
        self._counts[client] = (count + 1, self._monotonic())

    def right(self, client: str) -> None:
        """Note a right secret."""
        self._counts.pop(client, None)
