"""Frames over TCP, see docs/reference/wire.md; one thread serves all senders."""

from __future__ import annotations

import contextlib
import logging
import secrets
import selectors
import socket
import ssl
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from models.platform.supervision import OwnedThread
from streams.link.arrivals import Ticket
from streams.link.front import (
    TURN_S,
    Bucket,
    Cause,
    Door,
    FullError,
    Guesses,
    OftenError,
    Visits,
    WaitingRoom,
    client_of,
)
from streams.link.listening import Place, Waker, bound, is_loopback, place_of
from streams.link.peer import NONCE_BYTES, ClosedError, Peer, Phase, is_proof, load_keys, prepare, receiver_context
from streams.link.receiver import Receiver
from streams.link.refusals import JUMP, KEY, LINK
from streams.link.wire import ACK, PROVEN, JumpError, WireError, hello_stream, hello_version, refusal
from streams.types.spec import NetworkSpec, SourceError, SourceSpec

_LOG = logging.getLogger(__name__)
_TICK = 0.25
"""Seconds between checks of the deadlines."""
_MAX_OUT_BYTES = 1 << 16
"""Answers that a sender may leave unread."""
_CONNECTIONS_PER_S = 100.0
"""Of one client, or as many as there may be at a time; of all, twice as many."""
_ACCEPTED_PER_S, _ACCEPTED_AT_ONCE = 2000.0, 32
"""Taken from the kernel's queue, also to be refused; beyond it they wait there, and take no time from senders."""
_LINGER_S = 1.0
"""Time for a refused sender to read the reason."""


class _KeyError(WireError):
    """A sender does not prove that it has the key of its stream."""


class TcpReceiver(Receiver):
    """Listens for the senders of one or several streams; a live source.

    The stream id of a sender is the name of a source. A second connection for a stream replaces the first, which may be
    half-open. A stream with a key takes senders that prove to have it; without one, addresses decide.
    """

    def __init__(self, specs: Sequence[SourceSpec], network: NetworkSpec | None = None) -> None:
        """Take the sources that share an address, see :class:`Receiver`; each has its own key."""
        super().__init__(specs, network, "tcp://HOST:PORT")
        networks = {spec.name: spec.network or self._network for spec in specs}
        if len({(found.tls_cert_file, found.tls_key_file) for found in networks.values()}) > 1:
            raise SourceError(f"{self._where}: sources at one address have the same tls_cert_file and tls_key_file")
        self._key_files = {name: found.stream_key_file for name, found in networks.items()}
        self._keyless = [name for name, path in self._key_files.items() if path is None]
        self._keys: dict[str, bytes] = {}
        self._tls: ssl.SSLContext | None = None
        self._selector: selectors.BaseSelector | None = None
        self._listener: socket.socket | None = None
        self._thread = OwnedThread(self._restarts, self._serve, self._listen, turns=True, thread=f"tcp-{self.name}")
        self._waker: Waker | None = None
        self._peers: set[Peer] = set()
        most = self._network.max_connections
        visits = Visits(max(_CONNECTIONS_PER_S, most), 2.0 * max(_CONNECTIONS_PER_S, most))
        self._door = Door(most, most, self._idleness, visits)
        self._waiting = WaitingRoom(self._admit, self._note_crowd)
        self._guesses = Guesses()
        self._rate = Bucket(_ACCEPTED_PER_S, _ACCEPTED_PER_S / 10.0)
        self._deaf_until = 0.0
        self._current: dict[str, Peer] = {}
        self._unconfirmed: set[str] = set()
        self._stopped = False
        self._paused = False

    @property
    def port(self) -> int:
        """The listening port, once open (0 in the URL lets the system choose)."""
        return self._address.port if self._listener is None else self._listener.getsockname()[1]

    def check(self, *, taken: bool = False) -> None:
        """Raise SourceError where :meth:`open` would; ``taken``: another receiver has the address by right."""
        self._load_keys()
        if taken:
            self._place()
        else:
            # Bound, but not listening: no sender is answered.
            bound(self._address, self._place(), self._where, listen=False).close()

    def _start(self) -> None:
        """Listen; SourceError where that fails, a file cannot be used, or any machine could send without a key."""
        for weakness in self._load_keys():
            _LOG.warning("%s", weakness)
        self._thread.start()
        near = is_loopback(self._place()[1][0])
        for name in self._keyless:
            who = "every user of this computer" if near else "machines among peers"
            _LOG.warning("source %s: %s may send without a key; see stream_key_file", name, who)

    def _listen(self) -> None:
        """Make what the thread uses: the listening socket, the pair by which it is woken, the selector."""
        self._close_sockets()
        self._listener = bound(self._address, self._place(), self._where, listen=True)
        # Made again, it has the same port.
        self._address = replace(self._address, port=self._listener.getsockname()[1])
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._deaf_until = 0.0
        self._waker = Waker(self._selector)

    def _load_keys(self) -> list[str]:
        """Read keys and certificate; return what weakens a key, one sentence each."""
        self._keys, weaknesses = load_keys(self._key_files)
        cert_file, key_file = self._network.tls_cert_file, self._network.tls_key_file
        if cert_file is not None and key_file is not None:
            self._tls = receiver_context(cert_file, key_file, f"[[source]] {self.name}")
        return weaknesses

    def _place(self) -> Place:
        """Return family and numerical address; SourceError where any machine could send without a key."""
        place = place_of(self._address, self._where)
        if not is_loopback(place[1][0]) and self._keyless and not self._network.peers:
            raise SourceError(
                f"{self._where}: {self._address.host} can be reached by other machines; give stream_key_file, or say "
                "which may send with peers = [...]"
            )
        return place

    def listener(self) -> Mapping[str, Any]:
        """Return the counts of connections."""
        return self._door.counts()

    def _confirm(self, ticket: Ticket) -> None:
        with self._lock:
            self._unconfirmed.add(ticket.stream)
        self._wake()

    def problem(self) -> str | None:
        """Return that the backlog is full, or why the last of no connections ended."""
        if not self._stopped and (lost := self._thread.problem()) is not None:
            return f"{self.name}: {lost}"
        if self._paused:
            return f"{self.name}: blocks come faster than they are committed"
        return None if self._current else self._problem

    def _stop(self) -> None:
        self._stopped = True
        self._thread.end()
        self._wake()
        self._thread.join(5.0)

    def tend(self) -> None:
        """Listen again where the thread has ended; see :class:`streams.types.source.LiveSource`."""
        if self._opened:
            self._thread.tend()

    def _wake(self) -> None:
        waker = self._waker
        if waker is not None:
            waker.wake()

    def _serve(self) -> None:
        """Read, answer and enforce deadlines until closed; only here are sockets used."""
        selector, listener, waker = self._selector, self._listener, self._waker
        if selector is None or listener is None or waker is None:
            return
        try:
            while not self._stopped:
                self._thread.turn()
                buffered = [peer for peer in self._peers if peer.buffered and not self._is_held(peer)]
                for key, mask in selector.select(0.0 if buffered else TURN_S if self._waiting else _TICK):
                    if key.fileobj is listener:
                        self._accept(listener, selector)
                    elif key.fileobj is waker.theirs:
                        waker.empty()
                    elif isinstance(key.data, Peer):
                        self._handle(key.data, mask)
                for peer in buffered:
                    self._handle(peer, selectors.EVENT_READ)
                self._waiting.let_in()
                if self._deaf_until and time.monotonic() >= self._deaf_until:
                    selector.register(listener, selectors.EVENT_READ)
                    self._deaf_until = 0.0
                self._send_acknowledgements()
                self._pause_or_resume()
                self._enforce_deadlines()
                self._refusals.tick()
        finally:
            for peer in list(self._peers):
                self._drop(peer)
            self._waiting.close()
            self._close_sockets()

    def _close_sockets(self) -> None:
        for used in (self._waker, self._selector, self._listener):
            if used is not None:
                used.close()
        self._selector = self._listener = self._waker = None

    def _accept(self, listener: socket.socket, selector: selectors.BaseSelector) -> None:
        """Take what waits in the kernel's queue, as far as the rate allows."""
        for _ in range(_ACCEPTED_AT_ONCE):
            try:
                connection, place = listener.accept()
            except BlockingIOError:
                return
            except OSError as error:
                # The sender has disconnected, or there are no descriptors left; the next round tries again.
                self._refused(f"a connection could not be accepted: {error}")
                return
            self._waiting.arrive(connection, str(place[0]))
            wait = self._rate.take()
            if wait > 0.0:
                selector.unregister(listener)
                self._deaf_until = time.monotonic() + wait
                return

    def _note_crowd(self) -> None:
        self._door.refused["rate"] += 1
        self._refused("connections come too often")

    def _admit(self, connection: socket.socket, address: str) -> bool:
        """Wait for the hello of a new connection, or refuse it; return whether it need not wait for its turn."""
        all_keyed = len(self._keys) == len(self._key_files)
        try:
            if not (self._network.admits(address) or (all_keyed and not self._network.peers)):
                self._door.refused["address"] += 1
                raise FullError("not among peers")
            idlest = self._door.room_for(address)
            if idlest is not None:
                self._drop(idlest, "replaced by a newer connection", "replaced")
            connection = prepare(connection, self._tls)
        except OftenError:
            return False
        except (FullError, OSError) as error:
            self._refused(f"{address}: {error}")
            connection.close()
            return True
        peer = Peer(
            connection, address, time.monotonic() + self._network.read_timeout, encrypting=self._tls is not None
        )
        self._peers.add(peer)
        self._door.add(peer, address)
        assert self._selector is not None
        self._selector.register(connection, peer.interest(held=False), peer)
        return True

    def _idleness(self, peer: Peer) -> tuple[int, float] | None:
        """Return how readily a connection makes room: none that sends frames, those with wrong keys first."""
        if peer.phase is Phase.FRAMES:
            return None
        return -self._guesses.count(client_of(peer.address)), peer.deadline or 0.0

    def _is_held(self, peer: Peer) -> bool:
        """Return whether a connection is not read because too much waits."""
        return self._paused and peer.phase is Phase.FRAMES

    def _watch(self, peer: Peer) -> None:
        """Register the events of a connection; a paused one may have none."""
        if self._selector is None or peer not in self._peers:
            return
        interest = peer.interest(held=self._is_held(peer))
        watched = peer.socket in self._selector.get_map()
        if interest and watched:
            self._selector.modify(peer.socket, interest, peer)
        elif interest:
            self._selector.register(peer.socket, interest, peer)
        elif watched:
            self._selector.unregister(peer.socket)

    def _handle(self, peer: Peer, mask: int) -> None:
        if peer not in self._peers:
            return
        blocked = False
        try:
            peer.shake_hands()
            if mask & selectors.EVENT_WRITE and peer.out:
                peer.send()
                self._watch(peer)
            if mask & selectors.EVENT_READ:
                message = peer.receive(time.monotonic(), self._network.read_timeout, self._network.max_frame)
                if message is not None:
                    self._take(peer, message)
        except (BlockingIOError, ssl.SSLWantReadError):
            pass
        except ssl.SSLWantWriteError:
            blocked = True
        except ClosedError as error:
            self._drop(peer, None if error.whole else str(error))
        except OSError as error:
            self._drop(peer, f"connection lost: {error}", "lost")
        except WireError as error:
            self._refuse(peer, error)
        except Exception as error:  # A fault of one sender must not end the others.
            self._fault(f"{peer.name} cannot be served", error)
            self._drop(peer)
        self._door.received_bytes += peer.taken()
        if blocked != peer.blocked:
            peer.blocked = blocked
            self._watch(peer)

    def _take(self, peer: Peer, message: bytearray) -> None:
        """Take a whole message; WireError where the sender is refused."""
        if peer.phase is Phase.HELLO:
            peer.stream = hello_stream(bytes(message))
            if hello_version(bytes(message)) == PROVEN:
                peer.nonce = secrets.token_bytes(NONCE_BYTES)
                peer.enter(Phase.PROOF)
                self._answer(peer, peer.nonce)
            else:
                self._greet(peer, peer.stream, None)
        elif peer.phase is Phase.PROOF and peer.stream is not None:
            self._greet(peer, peer.stream, bytes(message))
        elif peer.stream is not None and not self._arrivals.take(peer.stream, message, limit=self._network.max_frame):
            raise WireError("a frame is missing before this one; the sender must send it again")

    def _greet(self, peer: Peer, stream: str, given: bytes | None) -> None:
        """Let a sender send frames; ``given`` is its proof, None with a hello of version 1."""
        if stream not in self._arrivals.streams:
            raise WireError(f"stream {stream!a} is not configured at this address")
        key = self._keys.get(stream)
        if key is not None and (given is None or peer.nonce is None):
            raise _KeyError(f"stream {stream!r} needs its key, and the hello is of version 1")
        if key is not None and not is_proof(given or b"", key, peer.nonce or b"", stream):
            self._guesses.wrong(client_of(peer.address))
            raise _KeyError(f"the key is not that of stream {stream!r}")
        before = self._current.get(stream)
        if before is not None:
            self._drop(before, f"another sender of {stream!r} connected", "replaced")
        self._current[stream] = peer
        peer.enter(Phase.FRAMES)
        peer.deadline = None
        self._answer(peer, ACK.pack(self._arrivals.committed(stream)))

    def _answer(self, peer: Peer, answer: bytes) -> None:
        peer.out += answer
        if len(peer.out) > _MAX_OUT_BYTES:
            self._drop(peer, "the sender does not read what is answered", "unread")
            return
        self._watch(peer)

    def _send_acknowledgements(self) -> None:
        """Queue the acknowledgements of the commits since the last call."""
        with self._lock:
            streams, self._unconfirmed = self._unconfirmed, set()
        for stream in streams:
            peer = self._current.get(stream)
            if peer is not None:
                self._answer(peer, ACK.pack(self._arrivals.committed(stream)))

    def _pause_or_resume(self) -> None:
        """Stop reading while the queue is full; flow control then slows the senders down."""
        if self._paused == self._arrivals.full:
            return
        self._paused = not self._paused
        now = time.monotonic()
        for peer in list(self._peers):
            # The timeout of a paused sender starts again.
            if peer.deadline is not None and peer.phase is Phase.FRAMES:
                peer.deadline = now + self._network.read_timeout
            self._watch(peer)

    def _enforce_deadlines(self) -> None:
        now = time.monotonic()
        for peer in list(self._peers):
            if peer.deadline is None or now <= peer.deadline or self._is_held(peer):
                continue
            what = "frame" if peer.phase is Phase.FRAMES else "hello"
            reason = f"no whole {what} within {self._network.read_timeout:g} s"
            if peer.phase is Phase.REFUSED:
                self._drop(peer)
            else:
                self._drop(peer, reason, "slow")

    def _refuse(self, peer: Peer, error: WireError) -> None:
        """End a connection; a sender of version 2 learns why."""
        kind = KEY if isinstance(error, _KeyError) else JUMP if isinstance(error, JumpError) else LINK
        self._drop_from_stream(peer)
        self._door.refused["secret" if kind == KEY else "message"] += 1
        self._refused(f"{peer.name}: {error}", kind, peer.stream)
        if peer.nonce is None:
            self._drop(peer)
            return
        peer.out += refusal(str(error))
        with contextlib.suppress(OSError):
            peer.send()
            # Not closed at once: bytes of the sender that were not read would make the kernel discard the reason.
            peer.socket.shutdown(socket.SHUT_WR)
        peer.out.clear()
        peer.enter(Phase.REFUSED)
        peer.deadline = time.monotonic() + _LINGER_S
        self._watch(peer)

    def _drop_from_stream(self, peer: Peer) -> None:
        if peer.stream is not None and self._current.get(peer.stream) is peer:
            del self._current[peer.stream]

    def _drop(self, peer: Peer, reason: str | None = None, cause: Cause | None = None) -> None:
        """Close a connection; its sender repeats what was not acknowledged."""
        if reason is not None:
            self._refused(f"{peer.name}: {reason}")
        if cause is not None:
            self._door.refused[cause] += 1
        self._peers.discard(peer)
        self._door.remove(peer)
        self._drop_from_stream(peer)
        if self._selector is not None:
            with contextlib.suppress(KeyError, ValueError):
                self._selector.unregister(peer.socket)
        peer.socket.close()
