"""What a receiver over TCP listens with: the bound socket, and the pair of sockets by which its thread is woken."""

from __future__ import annotations

import contextlib
import ipaddress
import logging
import selectors
import socket

from streams.link.front import BACKLOG
from streams.types.spec import Address, SourceError

_LOG = logging.getLogger(__name__)
Place = tuple[socket.AddressFamily, tuple[str, int]]
"""Family, numerical address and port."""


def is_loopback(address: str) -> bool:
    """Return whether a numerical address is of this machine alone."""
    return ipaddress.ip_address(address.partition("%")[0]).is_loopback


def place_of(address: Address, where: str) -> Place:
    """Return where to bind; SourceError, beginning with ``where``, if the name has no address."""
    try:
        family, _, _, _, place = socket.getaddrinfo(address.host, address.port, type=socket.SOCK_STREAM)[0]
    except OSError as error:
        raise _unusable(address, where, error) from None
    return family, (str(place[0]), int(place[1]))


def bound(address: Address, place: Place, where: str, *, listen: bool) -> socket.socket:
    """Return a socket that does not block, bound to a place, and listens where it shall.

    Raises:
        SourceError: the address cannot be used.
    """
    family, at = place
    try:
        made = socket.socket(family, socket.SOCK_STREAM)
    except OSError as error:
        raise _unusable(address, where, error) from None
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if family == socket.AF_INET6:
            made.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        made.bind(at)
        if listen:
            made.listen(BACKLOG)
        made.setblocking(False)
    except OSError as error:
        made.close()
        raise _unusable(address, where, error) from None
    return made


def _unusable(address: Address, where: str, error: OSError) -> SourceError:
    return SourceError(f"{where}: {address.host}:{address.port} cannot be listened to: {error}")


class Waker:
    """Wakes the thread that waits at a selector; a socket that fails is replaced."""

    def __init__(self, selector: selectors.BaseSelector) -> None:
        """Register with a selector; OSError where there are no sockets."""
        self._selector = selector
        self.theirs, self._ours = self._pair()

    def wake(self) -> None:
        """Wake the thread; from any thread."""
        # A full pipe wakes as well; a closed one has no thread.
        with contextlib.suppress(OSError):
            self._ours.send(b"\0")

    def empty(self) -> None:
        """In the thread, after it was woken: read what woke it."""
        try:
            if self.theirs.recv(4096):
                return
        except BlockingIOError:
            return
        except OSError as error:
            _LOG.debug("the socket that wakes a receiver is replaced: %s", error)
        made = self._pair()
        self.close()
        self.theirs, self._ours = made

    def close(self) -> None:
        """Close both sockets."""
        with contextlib.suppress(KeyError, ValueError, OSError):
            self._selector.unregister(self.theirs)
        self.theirs.close()
        self._ours.close()

    def _pair(self) -> tuple[socket.socket, socket.socket]:
        theirs, ours = socket.socketpair()
        theirs.setblocking(False)
        ours.setblocking(False)
        self._selector.register(theirs, selectors.EVENT_READ)
        return theirs, ours
