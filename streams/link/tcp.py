"""Frames over TCP: one thread reads all senders; what is committed is acknowledged. See docs/reference/wire.md."""

from __future__ import annotations

import contextlib
import ipaddress
import logging
import selectors
import socket
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

from streams.ledger import Ledger
from streams.link.arrivals import Arrivals, by_stream
from streams.link.wire import ACK, HEAD, HELLO, WireError, frame_length, hello_length, hello_stream
from streams.source import Backlog, Delivery
from streams.spec import NetworkSpec, SourceError, SourceSpec, parse_address, same_listener

_LOG = logging.getLogger(__name__)

_CHUNK = 1 << 18
_TICK = 0.25
"""Seconds after which deadlines are looked at."""
_FIRST_PROBE, _PROBES = 30, 4
"""Seconds of silence after which the kernel asks whether a sender is still there, and how often it asks."""
_OUT_LIMIT = 1 << 16
"""Bytes of answers that a sender may leave unread."""


@dataclass(eq=False)
class _Peer:
    """A connection: what it has sent of the message that is coming in, and what it still has to be told."""

    socket: socket.socket
    address: str
    deadline: float | None
    stream: str | None = None
    data: bytearray = field(default_factory=bytearray)
    needed: int = HELLO.size
    sized: bool = False
    out: bytearray = field(default_factory=bytearray)


class TcpReceiver:
    """Listens for the senders of one or several streams; a live source.

    The stream id of a sender must be the name of one of the sources, and its blocks bear that name. A second connection
    for a stream takes the place of the first, which may be dead without knowing it.
    """

    def __init__(self, specs: Sequence[SourceSpec], network: NetworkSpec | None = None) -> None:
        """Take the sources that share an address.

        Args:
            specs: sources with the same ``tcp://HOST:PORT``.
            network: limits and peers; those of the first source by default.

        Raises:
            SourceError: the address is none, or it is not this machine's own and no peers are named.
        """
        self.name = ",".join(spec.name for spec in specs)
        self._where = f"[[source]] {self.name}: url"
        self._address = same_listener([parse_address(spec.url, self._where) for spec in specs])
        if self._address.scheme != "tcp":
            raise SourceError(f"{self._where} {specs[0].url!r}: expected tcp://HOST:PORT")
        self._network = network or specs[0].network or NetworkSpec()
        self._arrivals = Arrivals(by_stream(specs), self._network.max_waiting)
        self._selector: selectors.BaseSelector | None = None
        self._listener: socket.socket | None = None
        self._thread: threading.Thread | None = None
        self._wake_in: socket.socket | None = None
        self._wake_out: socket.socket | None = None
        self._peers: set[_Peer] = set()
        self._current: dict[str, _Peer] = {}
        self._lock = threading.Lock()
        self._to_tell: set[str] = set()
        self._stop = False
        self._paused = False
        self._problem: str | None = None

    @property
    def port(self) -> int:
        """The port that is listened to, once open (0 in the URL lets the system choose)."""
        return self._address.port if self._listener is None else self._listener.getsockname()[1]

    def open(self, ledger: Ledger) -> None:
        """Listen.

        Raises:
            SourceError: the address cannot be listened to, or other machines could reach it and no peers are named.
        """
        if self._thread is not None:
            raise RuntimeError(f"source {self.name!r} is open already")
        self._arrivals.open(ledger)
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

    def next(self, timeout: float) -> Delivery | None:
        """Return the next delivery, or None after ``timeout`` seconds without one."""
        return self._arrivals.next(timeout)

    def acknowledge(self, delivery: Delivery) -> None:
        """Tell the sender, if it is still there, that a block is committed."""
        ticket = self._arrivals.acknowledge(delivery)
        with self._lock:
            self._to_tell.add(ticket.stream)
        self._wake()

    def backlog(self) -> Backlog:
        """Return how many frames came and what became of them."""
        return self._arrivals.backlog()

    def problem(self) -> str | None:
        """Return why the last connection was given up while nobody is connected, or that the backlog is full."""
        if self._thread is not None and not self._thread.is_alive():
            return f"{self.name}: the receiver has stopped"
        if self._paused:
            return f"{self.name}: blocks come faster than they are committed"
        return None if self._current else self._problem

    def close(self) -> None:
        """Stop listening; closing twice does nothing."""
        self._arrivals.close()
        self._stop = True
        self._wake()
        if self._thread is not None:
            self._thread.join(timeout=5.0)
            self._thread = None

    def __enter__(self) -> Self:
        """Return the receiver itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        self.close()

    def _wake(self) -> None:
        if self._wake_out is not None:
            # A full pipe wakes as well; a closed one has nobody to wake.
            with contextlib.suppress(OSError):
                self._wake_out.send(b"\0")

    def _serve(self) -> None:
        """Read, answer and look at the clock until closed; only this thread touches the sockets."""
        selector, listener, wake = self._selector, self._listener, self._wake_in
        if selector is None or listener is None or wake is None:
            return
        try:
            while not self._stop:
                for key, mask in selector.select(_TICK):
                    if key.fileobj is listener:
                        self._accept(listener, selector)
                    elif key.fileobj is wake:
                        with contextlib.suppress(BlockingIOError):
                            wake.recv(4096)
                    else:
                        self._handle(key.data, mask)
                self._tell()
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
            # The other side is gone again, or there are no descriptors left; the next round tries again.
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
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, _FIRST_PROBE)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, _PROBES)
        peer = _Peer(connection, address, time.monotonic() + self._network.read_timeout)
        self._peers.add(peer)
        selector.register(connection, self._interest(peer), peer)

    def _interest(self, peer: _Peer) -> int:
        reading = 0 if self._paused and peer.stream is not None else selectors.EVENT_READ
        return reading | (selectors.EVENT_WRITE if peer.out else 0)

    def _watch(self, peer: _Peer) -> None:
        """Wait for what can be done with a connection; while reading is paused, that may be nothing."""
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
        """Read what is there, at most one message: the senders take turns."""
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
        if len(peer.out) > _OUT_LIMIT:
            self._drop(peer, "the sender does not read what is answered")
            return
        self._watch(peer)

    def _tell(self) -> None:
        """Queue the acknowledgement of what was committed since the last time."""
        with self._lock:
            streams, self._to_tell = self._to_tell, set()
        for stream in streams:
            peer = self._current.get(stream)
            if peer is not None:
                self._answer(peer)

    def _pause_or_resume(self) -> None:
        """Stop reading while too much waits for its commit; the network then slows the senders down."""
        if self._paused == self._arrivals.full:
            return
        self._paused = not self._paused
        now = time.monotonic()
        for peer in list(self._peers):
            # A sender that was kept waiting has all its time again.
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
        """Close a connection; what its sender has not heard to be committed it will send again."""
        if reason is not None:
            self._refused(f"{peer.address}{'' if peer.stream is None else f' ({peer.stream})'}: {reason}")
        self._peers.discard(peer)
        if peer.stream is not None and self._current.get(peer.stream) is peer:
            del self._current[peer.stream]
        if self._selector is not None:
            with contextlib.suppress(KeyError, ValueError):
                self._selector.unregister(peer.socket)
        peer.socket.close()

    def _refused(self, reason: str) -> None:
        self._problem = f"{self.name}: {reason}"
        _LOG.warning("source %s: %s", self.name, reason)
