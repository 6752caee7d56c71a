"""One connection of a sender to the TCP receiver, the proof that it has the key of its stream, and TLS."""

from __future__ import annotations

import enum
import hashlib
import hmac
import selectors
import socket
import ssl
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from models.platform.portable import others_may
from models.words.errors import SpallwatchError
from streams.link.wire import HEAD, HELLO, HELLO_MAGIC, frame_length, hello_length
from streams.types.spec import SourceError

_CHUNK = 1 << 18
_FIRST_PROBE_S, _PROBES = 30, 4
"""Silence after which the kernel probes a sender, and number of probes."""


class Phase(enum.Enum):
    """What a connection sends next; once it is refused, what it sends is discarded."""

    HELLO = enum.auto()
    PROOF = enum.auto()
    FRAMES = enum.auto()
    REFUSED = enum.auto()


class ClosedError(SpallwatchError):
    """The sender closed the connection; ``whole``: between two frames."""

    def __init__(self, *, whole: bool) -> None:
        """Say whether all was received."""
        super().__init__("the sender left in the middle of a message")
        self.whole = whole


@dataclass(eq=False)
class Peer:
    """A connection, with a socket that does not block.

    Attributes:
        deadline: monotonic seconds by which the message must be complete; None before its first byte.
        stream: that the sender names in its hello; before :attr:`Phase.FRAMES` that is a claim.
        nonce: of a hello of version 2, which learns why it is refused; None with version 1.
        encrypting: the TLS handshake is not complete.
        blocked: TLS has to write before it can go on.
    """

    socket: socket.socket
    address: str
    deadline: float | None
    phase: Phase = Phase.HELLO
    stream: str | None = None
    nonce: bytes | None = None
    encrypting: bool = False
    blocked: bool = False
    out: bytearray = field(default_factory=bytearray)
    _received: int = 0
    _data: bytearray = field(default_factory=bytearray)
    _needed: int = HELLO.size
    _sized: bool = False

    @property
    def name(self) -> str:
        """Address and stream, for messages."""
        return self.address if self.stream is None else f"{self.address} ({self.stream})"

    @property
    def buffered(self) -> bool:
        """Whether decrypted bytes wait, which no selector reports."""
        return isinstance(self.socket, ssl.SSLSocket) and not self.encrypting and self.socket.pending() > 0

    def interest(self, *, held: bool) -> int:
        """Return the events to wait for; a connection that is ``held`` is not read."""
        return (0 if held else selectors.EVENT_READ) | (selectors.EVENT_WRITE if self.out or self.blocked else 0)

    def shake_hands(self) -> None:
        """Go on with the TLS handshake, if one is due."""
        if self.encrypting and isinstance(self.socket, ssl.SSLSocket):
            self.socket.do_handshake()
            self.encrypting = False

    def send(self) -> None:
        """Send what the socket takes of the answers."""
        if self.out:
            del self.out[: self.socket.send(self.out)]

    def enter(self, phase: Phase) -> None:
        """Begin a phase, after a whole message."""
        self.phase = phase
        self._begin()

    def _begin(self) -> None:
        self._data = bytearray()
        self._sized = self.phase is Phase.PROOF
        self._needed = PROOF_BYTES if self.phase is Phase.PROOF else HEAD.size

    def taken(self) -> int:
        """Return how many bytes were received since the last call."""
        received, self._received = self._received, 0
        return received

    def _recv(self, most: int) -> bytes:
        data = self.socket.recv(most)
        self._received += len(data)
        return data

    def receive(self, now: float, timeout: float, max_frame: int) -> bytearray | None:
        """Receive at most one message, so that senders take turns; return it once it is whole.

        Raises:
            ClosedError: the sender closed the connection.
            WireError: what came is not the beginning of such a message.
            OSError: the connection is broken, or nothing can be read now.
        """
        if self.phase is Phase.REFUSED:
            if not self._recv(_CHUNK):
                raise ClosedError(whole=True)
            return None
        data = self._recv(min(_CHUNK, self._needed - len(self._data)))
        if not data:
            raise ClosedError(whole=not self._data and self.phase is Phase.FRAMES)
        if self.deadline is None:
            self.deadline = now + timeout
        self._data += data
        if len(self._data) < self._needed:
            return None
        if not self._sized:
            self._sized = True
            is_hello = self.phase is Phase.HELLO
            self._needed = hello_length(bytes(self._data)) if is_hello else frame_length(bytes(self._data), max_frame)
            return None
        message = self._data
        self._begin()
        if self.phase is Phase.FRAMES:
            self.deadline = None
        return message


def prepare(connection: socket.socket, tls: ssl.SSLContext | None) -> socket.socket:
    """Return an accepted connection that does not block, encrypted where TLS is on; OSError where it is lost."""
    connection.setblocking(False)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, _FIRST_PROBE_S)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, _PROBES)
    if tls is None:
        return connection
    return tls.wrap_socket(connection, server_side=True, do_handshake_on_connect=False)


NONCE_BYTES = 32
"""Random bytes that the receiver answers to a hello of version 2."""
PROOF_BYTES = 32
"""Answer of the sender: HMAC-SHA256."""
MIN_KEY_CHARACTERS = 16
_MAX_KEY_BYTES = 4096


def read_key(path: Path, where: str) -> bytes:
    """Return the key in a file, its first line; ``where`` is the key or option named in a message.

    Raises:
        SourceError: the file cannot be read or its first line is empty; the key is not in the message.
    """
    try:
        with path.open("rb") as file:
            key = file.readline(_MAX_KEY_BYTES).strip()
    except OSError as error:
        raise SourceError(f"{where}: {path} cannot be read: {error.strerror or error}") from None
    if not key:
        raise SourceError(f"{where}: the first line of {path} is empty; expected the key")
    return key


def key_weakness(path: Path, key: bytes) -> str | None:
    """Return in one sentence why a key is weak, or None."""
    if len(key) < MIN_KEY_CHARACTERS:
        return f"the key in {path} has {len(key)} characters; make it at least {MIN_KEY_CHARACTERS}"
    if others_may(path.stat().st_mode, stat.S_IROTH | stat.S_IWOTH):
        return f"others may read or change {path}; make it safe with: chmod 600 {path}"
    return None


def load_keys(files: Mapping[str, Path | None]) -> tuple[dict[str, bytes], list[str]]:
    """Return the keys of sources that have one, and what weakens them, one sentence each; SourceError as above."""
    keys, weaknesses = {}, []
    for name, path in files.items():
        if path is None:
            continue
        keys[name] = read_key(path, f"[[source]] {name}: stream_key_file")
        weakness = key_weakness(path, keys[name])
        if weakness is not None:
            weaknesses.append(f"source {name}: {weakness}")
    return keys, weaknesses


def proof(key: bytes, nonce: bytes, stream: str) -> bytes:
    """Return what a sender with the key answers to a nonce."""
    return hmac.new(key, HELLO_MAGIC + nonce + stream.encode(), hashlib.sha256).digest()


def is_proof(given: bytes, key: bytes, nonce: bytes, stream: str) -> bool:
    """Return whether an answer proves the key, in a time that does not depend on where it differs."""
    return hmac.compare_digest(given, proof(key, nonce, stream))


def receiver_context(cert_file: Path, key_file: Path, where: str) -> ssl.SSLContext:
    """Return the TLS settings of a receiver; SourceError where its files cannot be used."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        context.load_cert_chain(cert_file, key_file)
    except (OSError, ssl.SSLError) as error:
        raise SourceError(f"{where}: tls_cert_file, tls_key_file cannot be used: {error}") from None
    return context


def sender_context(ca_file: Path, where: str) -> ssl.SSLContext:
    """Return the TLS settings of a sender that trusts certificates of ``ca_file`` only; SourceError likewise."""
    try:
        return ssl.create_default_context(cafile=str(ca_file))
    except (OSError, ssl.SSLError) as error:
        raise SourceError(f"{where}: {ca_file} cannot be used: {error}") from None
