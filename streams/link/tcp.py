"""Frames over TCP, see docs/reference/wire.md; one thread serves all senders."""

from __future__ import annotations

import contextlib
import ipaddress
import selectors
import socket
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

from streams.link.arrivals import Receiver, Ticket
from streams.link.wire import ACK, HEAD, HELLO, WireError, frame_length, hello_length, hello_stream
from streams.spec import NetworkSpec, SourceError, SourceSpec

_CHUNK = 1 << 18
_TICK = 0.25
"""Seconds between checks of the deadlines."""
_FIRST_PROBE_S, _PROBES = 30, 4
"""Silence after which the kernel probes a sender, and number of probes."""
_MAX_OUT_BYTES = 1 << 16
"""Answers that a sender may leave unread."""


@dataclass(eq=False)
class _Peer:
    """A connection: the part received of a message, and the answers not yet sent."""

    socket: socket.socket
    address: str
    deadline: float | None
    stream: str | None = None
    data: bytearray = field(default_factory=bytearray)
    needed: int = HELLO.size
    sized: bool = False
    out: bytearray = field(default_factory=bytearray)


class TcpReceiver(Receiver):
    """Listens for the senders of one or several streams; a live source.

    The stream id of a sender is the name of a source. A second connection for a stream replaces the first, which may be
    half-open.
    """

    def __init__(self, specs: Sequence[SourceSpec], network: NetworkSpec | None = None) -> None:
        """Take the sources that share an address, see :class:`Receiver`."""
        super().__init__(specs, network, "tcp://HOST:PORT")
        self._selector: selectors.BaseSelector | None = None
        self._listener: socket.socket | None = None
        self._thread: threading.Thread | None = None
        self._wake_in: socket.socket | None = None
        self._wake_out: socket.socket | None = None
        self._peers: set[_Peer] = set()
        self._current: dict[str, _Peer] = {}
        self._unconfirmed: set[str] = set()
        self._stopped = False
        self._paused = False

    @property
    def port(self) -> int:
        """The listening port, once open (0 in the URL lets the system choose)."""
        return self._address.port if self._listener is None else self._listener.getsockname()[1]

    def _start(self) -> None:
        """Listen; SourceError where that fails or other machines are not named as peers."""
        self._listener = self._listen()
        self._wake_in, self._wake_out = socket.socketpair()
        self._wake_in.setblocking(False)
        self._wake_out.setblocking(False)
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._selector.register(self._wake_in, selectors.EVENT_READ)
        self._thread = threading.Thread(target=self._serve, name=f"tcp-{self.name}", daemon=True)
        self._thread.start()

    def _listen(self) -> socket.socket:
        host, port = self._address.host, self._address.port
        try:
            found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
            family, _, _, _, place = found[0]
            if not ipaddress.ip_address(str(place[0]).partition("%")[0]).is_loopback and not self._network.peers:
                raise SourceError(
                    f"{self._where}: {host} can be reached by other machines; say which may send with peers = [...]"
                )
            listener = socket.create_server(place[:2], family=family, backlog=self._network.max_connections)
        except OSError as error:
            raise SourceError(f"{self._where}: {host}:{port} cannot be listened to: {error}") from None
        listener.setblocking(False)
        return listener

    def _confirm(self, ticket: Ticket) -> None:
        with self._lock:
            self._unconfirmed.add(ticket.stream)
        self._wake()

    def problem(self) -> str | None:
        """Return that the backlog is full, or why the last of no connections ended."""
        if self._thread is not None and not self._thread.is_alive():
            return f"{self.name}: the receiver has stopped"
        if self._paused:
            return f"{self.name}: blocks come faster than they are committed"
        return None if self._current else self._problem

    def _stop(self) -> None:
        self._stopped = True
        self._wake()
        if self._thread is not None:
            self._thread.join(timeout=5.0)
            self._thread = None

    def _wake(self) -> None:
        if self._wake_out is not None:
            # A full pipe wakes the thread as well; a closed one has no thread.
            with contextlib.suppress(OSError):
                self._wake_out.send(b"\0")

    def _serve(self) -> None:
        """Read, answer and enforce deadlines until closed; only here are sockets used."""
        selector, listener, wake = self._selector, self._listener, self._wake_in
        if selector is None or listener is None or wake is None:
            return
        try:
            while not self._stopped:
                for key, mask in selector.select(_TICK):
                    if key.fileobj is listener:
                        self._accept(listener, selector)
                    elif key.fileobj is wake:
                        with contextlib.suppress(BlockingIOError):
                            wake.recv(4096)
                    else:
                        self._handle(key.data, mask)
                self._send_acknowledgements()
                self._pause_or_resume()
                self._enforce_deadlines()
        finally:
            for peer in list(self._peers):
                self._drop(peer, None)
            selector.close()
            for used in (listener, wake, self._wake_out):
                if used is not None:
                    used.close()

    def _accept(self, listener: socket.socket, selector: selectors.BaseSelector) -> None:
        try:
            connection, place = listener.accept()
        except OSError as error:
            # The sender has disconnected, or there are no descriptors left; the next round tries again.
            self._refused(f"a connection could not be accepted: {error}")
            return
        address = str(place[0])
        if not self._network.admits(address) or len(self._peers) >= self._network.max_connections:
            why = "is not among peers" if not self._network.admits(address) else "is one connection too many"
            self._refused(f"{address} {why}")
            connection.close()
            return
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, _FIRST_PROBE_S)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, _PROBES)
        peer = _Peer(connection, address, time.monotonic() + self._network.read_timeout)
        self._peers.add(peer)
        selector.register(connection, self._interest(peer), peer)

    def _interest(self, peer: _Peer) -> int:
        reading = 0 if self._paused and peer.stream is not None else selectors.EVENT_READ
        return reading | (selectors.EVENT_WRITE if peer.out else 0)

    def _watch(self, peer: _Peer) -> None:
        """Register the events of a connection; a paused one may have none."""
        if self._selector is None or peer not in self._peers:
            return
        interest = self._interest(peer)
        watched = peer.socket in self._selector.get_map()
        if interest and watched:
            self._selector.modify(peer.socket, interest, peer)
        elif interest:
            self._selector.register(peer.socket, interest, peer)
        elif watched:
            self._selector.unregister(peer.socket)

    def _handle(self, peer: _Peer, mask: int) -> None:
        if peer not in self._peers:
            return
        try:
            if mask & selectors.EVENT_WRITE and peer.out:
                del peer.out[: peer.socket.send(peer.out)]
                self._watch(peer)
            if mask & selectors.EVENT_READ:
                self._read(peer)
        except BlockingIOError:
            return
        except OSError as error:
            self._drop(peer, f"connection lost: {error}")
        except WireError as error:
            self._drop(peer, str(error))

    def _read(self, peer: _Peer) -> None:
        """Read at most one message, so that the senders take turns."""
        data = peer.socket.recv(min(_CHUNK, peer.needed - len(peer.data)))
        if not data:
            whole = not peer.data and peer.stream is not None
            self._drop(peer, None if whole else "the sender left in the middle of a message")
            return
        if peer.deadline is None:
            peer.deadline = time.monotonic() + self._network.read_timeout
        peer.data += data
        if len(peer.data) < peer.needed:
            return
        if not peer.sized:
            peer.sized = True
            if peer.stream is None:
                peer.needed = hello_length(bytes(peer.data))
            else:
                peer.needed = frame_length(bytes(peer.data), self._network.max_frame)
            return
        message, peer.data = peer.data, bytearray()
        peer.sized, peer.needed, peer.deadline = False, HEAD.size, None
        if peer.stream is None:
            self._greet(peer, hello_stream(bytes(message)))
        elif not self._arrivals.take(peer.stream, message, limit=self._network.max_frame):
            raise WireError("a frame is missing before this one; the sender must send it again")

    def _greet(self, peer: _Peer, stream: str) -> None:
        if stream not in self._arrivals.streams:
            raise WireError(f"stream {stream!a} is not configured; known are {', '.join(self._arrivals.streams)}")
        before = self._current.get(stream)
        if before is not None:
            self._drop(before, f"another sender of {stream!r} connected")
        peer.stream = stream
        self._current[stream] = peer
        self._answer(peer)

    def _answer(self, peer: _Peer) -> None:
        if peer.stream is None:
            return
        peer.out += ACK.pack(self._arrivals.committed(peer.stream))
        if len(peer.out) > _MAX_OUT_BYTES:
            self._drop(peer, "the sender does not read what is answered")
            return
        self._watch(peer)

    def _send_acknowledgements(self) -> None:
        """Queue the acknowledgements of the commits since the last call."""
        with self._lock:
            streams, self._unconfirmed = self._unconfirmed, set()
        for stream in streams:
            peer = self._current.get(stream)
            if peer is not None:
                self._answer(peer)

    def _pause_or_resume(self) -> None:
        """Stop reading while the queue is full; flow control then slows the senders down."""
        if self._paused == self._arrivals.full:
            return
        self._paused = not self._paused
        now = time.monotonic()
        for peer in list(self._peers):
            # The timeout of a paused sender starts again.
            if peer.deadline is not None:
                peer.deadline = now + self._network.read_timeout
            self._watch(peer)

    def _enforce_deadlines(self) -> None:
        now = time.monotonic()
        for peer in list(self._peers):
            held = self._paused and peer.stream is not None
            if peer.deadline is not None and now > peer.deadline and not held:
                what = "hello" if peer.stream is None else "frame"
                self._drop(peer, f"no whole {what} within {self._network.read_timeout:g} s")

    def _drop(self, peer: _Peer, reason: str | None) -> None:
        """Close a connection; its sender repeats what was not acknowledged."""
        if reason is not None:
            self._refused(f"{peer.address}{'' if peer.stream is None else f' ({peer.stream})'}: {reason}")
        self._peers.discard(peer)
        if peer.stream is not None and self._current.get(peer.stream) is peer:
            del self._current[peer.stream]
        if self._selector is not None:
            with contextlib.suppress(KeyError, ValueError):
                self._selector.unregister(peer.socket)
        peer.socket.close()
