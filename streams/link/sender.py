"""The reference sender: streams a recording until all of it is committed."""

from __future__ import annotations

import contextlib
import socket
import ssl
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

from models.words.errors import SpallwatchError
from streams.link.peer import NONCE_BYTES, proof
from streams.link.pulse_frame import block_frames
from streams.link.wire import ACK, PROVEN, REFUSED, VERSION, WireError, hello
from streams.types.block import Block, Rejected
from streams.types.source import Source
from streams.types.spec import Address

_WINDOW_FRAMES, _WINDOW_BYTES = 32, 64 << 20
_FIRST_PAUSE_S, _MAX_PAUSE_S = 0.1, 10.0


class SendError(SpallwatchError):
    """A recording could not be sent; the message states how much was, and the reason."""


class LinkError(SpallwatchError):
    """A connection is broken or not yet possible; the sender tries again."""


class Link(Protocol):
    """A connection to a receiver: TCP, or a broker."""

    def connect(self) -> int:
        """Connect and return the number committed last; :class:`LinkError` on failure."""
        ...

    def send(self, frame: bytes) -> None:
        """Send one frame; :class:`LinkError` where the connection broke."""
        ...

    def committed(self, timeout: float) -> int | None:
        """Return the number committed last, None where none comes within ``timeout`` s."""
        ...

    def close(self) -> None:
        """Close the connection."""
        ...


@dataclass(frozen=True)
class SendResult:
    """Counts of blocks sent (without repetitions), committed before, and not readable.

    ``acknowledged`` is the number of the last committed block.
    """

    sent: int
    acknowledged: int
    skipped: int
    rejected: int
    reconnects: int


class TcpLink:
    """A connection to ``tcp://HOST:PORT``."""

    def __init__(
        self,
        address: Address,
        stream: str,
        timeout: float = 30.0,
        *,
        key: bytes | None = None,
        tls: ssl.SSLContext | None = None,
    ) -> None:
        """Prepare.

        Args:
            timeout: s of connecting and of sending without progress.
            key: of the stream; with it the hello is of version 2.
            tls: settings of an encrypted connection, None for a plain one.
        """
        self._address, self._stream = address, stream
        self._hello = hello(stream, VERSION if key is None else PROVEN)
        self._key, self._tls = key, tls
        self._timeout = timeout
        self._socket: socket.socket | None = None
        self._received = bytearray()

    def connect(self) -> int:
        """Connect, send the hello and return the number committed last.

        Raises:
            LinkError: the connection failed.
            SendError: the receiver's certificate is not trusted, or it refuses this sender: repeating is useless.
        """
        self.close()
        where = f"{self._address.host}:{self._address.port}"
        try:
            connection = socket.create_connection((self._address.host, self._address.port), self._timeout)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            self._socket = connection
            if self._tls is not None:
                self._socket = self._tls.wrap_socket(connection, server_hostname=self._address.host)
            self._socket.sendall(self._hello)
            if self._key is not None:
                self._socket.sendall(proof(self._key, self._read_nonce(), self._stream))
        except ssl.SSLCertVerificationError as error:
            raise SendError(
                f"{where}: the certificate of the receiver is not trusted: {error.verify_message}"
            ) from None
        except OSError as error:
            raise LinkError(f"{where}: {error}") from None
        answer = self.committed(self._timeout)
        if answer is None:
            raise LinkError(f"{self._address.host}:{self._address.port}: no answer to the hello")
        return answer

    def _read_nonce(self) -> bytes:
        nonce = b""
        while self._socket is not None and len(nonce) < NONCE_BYTES:
            data = self._socket.recv(NONCE_BYTES - len(nonce))
            if not data:
                raise LinkError("the receiver closed the connection; it may know hellos of version 1 only")
            nonce += data
        return nonce

    def send(self, frame: bytes) -> None:
        """Send one frame."""
        if self._socket is None:
            raise LinkError("not connected")
        try:
            self._socket.settimeout(self._timeout)
            self._socket.sendall(frame)
        except OSError as error:
            self._read_refusal()
            raise LinkError(f"connection lost: {error}") from None

    def _read_refusal(self) -> None:
        """Raise SendError if the receiver said why it ended the connection."""
        with contextlib.suppress(LinkError):
            while self._key is not None and self.committed(0.0) is not None:
                pass

    def committed(self, timeout: float) -> int | None:
        """Return the latest answer; SendError where the receiver refuses this sender."""
        if self._socket is None:
            raise LinkError("not connected")
        try:
            # A timeout of 0 would make the socket non-blocking.
            self._socket.settimeout(max(timeout, 1e-3))
            data = self._socket.recv(4096)
        except TimeoutError:
            return None
        except OSError as error:
            raise LinkError(f"connection lost: {error}") from None
        if not data:
            raise LinkError("the receiver closed the connection; its log says why")
        self._received += data
        latest: int | None = None
        while len(self._received) >= ACK.size:
            (answer,) = ACK.unpack_from(self._received)
            if self._key is not None and answer & REFUSED:
                reason = self._received[ACK.size :][: answer ^ REFUSED]
                if len(reason) < answer ^ REFUSED:
                    break
                raise SendError(f"the receiver refuses: {reason.decode(errors='replace')}")
            latest = answer
            del self._received[: ACK.size]
        return latest

    def close(self) -> None:
        """Close the connection."""
        self._received.clear()
        if self._socket is not None:
            self._socket.close()
            self._socket = None


class Sender:
    """Sends the blocks of a recording in order, keeping each until it is committed.

    At each connection the receiver states the number committed last; all after it is sent.
    """

    def __init__(
        self,
        source: Source,
        link: Link,
        *,
        pace: float | None = None,
        limit: int | None = None,
        patience: float = 60.0,
        stall: float = 30.0,
        progress: Callable[[int], None] | None = None,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """Prepare.

        Args:
            pace: times real time, None: as fast as possible.
            limit: number of the last block to send, None: all.
            patience: s without any progress after which to give up.
            stall: s without a commit, while some are due, after which to connect again.
            progress: called with the number committed last, whenever it changes.
        """
        self._source, self._link = source, link
        self._pace, self._limit = pace, limit
        self._patience, self._stall = patience, stall
        self._progress = progress
        self._sleep = sleep
        self._held: deque[tuple[int, tuple[bytes, ...]]] = deque()
        self._blocks: Iterator[Block] = iter(())
        self._position = 0
        self._released = 0
        self._committed = 0
        self._highest = 0
        self._sent = self._skipped = 0
        self._rejected: set[tuple[int, str]] = set()
        self._due = 0.0
        self._last: int | None = None

    def run(self) -> SendResult:
        """Send all of it and wait until it is committed.

        Raises:
            SendError: nothing was committed for ``patience`` seconds of trying, a block makes no frame, or the
                receiver refuses this sender or acknowledges blocks that the recording does not have.
        """
        self._blocks = self._iterate(0)
        self._due = failing_since = time.monotonic()
        pause, connections, known = _FIRST_PAUSE_S, 0, -1
        try:
            while True:
                try:
                    self._resume(self._link.connect())
                    connections += 1
                    if self._stream():
                        rejected = len(self._rejected)
                        return SendResult(self._sent, self._committed, self._skipped, rejected, connections - 1)
                    why = f"no commit within {self._stall:g} s"
                except LinkError as error:
                    why = str(error)
                if self._committed > known:
                    pause, known, failing_since = _FIRST_PAUSE_S, self._committed, time.monotonic()
                if time.monotonic() - failing_since > self._patience:
                    raise SendError(f"{why}; blocks to {self._committed} are committed, to {self._highest} sent")
                self._sleep(pause)
                pause = min(2.0 * pause, _MAX_PAUSE_S)
        finally:
            self._link.close()

    def _iterate(self, after: int) -> Iterator[Block]:
        """Yield the blocks after a number, from the start of the recording."""
        skipped = 0
        for item in self._source:
            if self._limit is not None and item.sequence > self._limit:
                break
            if isinstance(item, Rejected):
                # A copy has the number of its original.
                self._rejected.add((item.sequence, item.name))
            elif item.sequence <= after:
                skipped += 1
            else:
                if not self._sent:
                    self._skipped = skipped
                yield item
        if not self._sent:
            self._skipped = skipped

    def _resume(self, committed: int) -> None:
        """Continue after the number that the receiver committed last."""
        self._check_answer(committed)
        if committed > self._position or committed < self._released:
            self._held.clear()
            self._blocks = self._iterate(committed)
            self._position = self._released = self._committed = committed
        self._release(committed)
        for _, frames in self._held:
            for frame in frames:
                self._link.send(frame)

    def _stream(self) -> bool:
        """Send until all is committed; return False where commits fail to come."""
        progressed = time.monotonic()
        exhausted = False
        while True:
            waiting = sum(len(frame) for _, frames in self._held for frame in frames)
            room = len(self._held) < _WINDOW_FRAMES and waiting < _WINDOW_BYTES
            if not exhausted and room:
                exhausted = not self._send_next()
            if exhausted and not self._held:
                return True
            wait = not room or exhausted
            committed = self._link.committed(min(self._stall, 1.0) if wait else 0.0)
            if committed is not None:
                self._check_answer(committed)
            if (committed is not None and self._release(committed)) or not self._held:
                progressed = time.monotonic()
            if time.monotonic() - progressed > self._stall:
                return False

    def _check_answer(self, committed: int) -> None:
        """Refuse an answer beyond what this recording can have given: all that follows would be left out as known."""
        if committed <= max(self._highest, self._last if self._last is not None else len(self._source)):
            return
        if self._last is None:
            # The number of the last block can be above the number of blocks.
            self._last = max((item.sequence for item in self._source), default=0)
            self._check_answer(committed)
            return
        raise SendError(
            f"the receiver acknowledges block {committed}, but this recording ends with block {self._last}: its stream "
            "counts another recording, or a wrong number was taken; nothing more is sent. On the receiver, spallwatch "
            "stream reset SOURCE lets the stream begin anew"
        )

    def _send_next(self) -> bool:
        """Send one more block; return False where there is none."""
        block = next(self._blocks, None)
        if block is None:
            return False
        try:
            frames = block_frames(block, after=self._position)
        except WireError as error:
            raise SendError(f"{block.name}: {error}") from None
        if self._pace is not None:
            self._sleep(max(0.0, self._due - time.monotonic()))
            self._due = max(self._due, time.monotonic() - 1.0) + block.duration / self._pace
        self._position = block.sequence
        self._held.append((block.sequence, frames))
        if block.sequence > self._highest:
            self._highest = block.sequence
            self._sent += 1
        for frame in frames:
            self._link.send(frame)
        return True

    def _release(self, committed: int) -> bool:
        """Release the frames up to ``committed``; return whether it is a new number."""
        while self._held and self._held[0][0] <= committed:
            self._released = self._held.popleft()[0]
        if committed <= self._committed:
            return False
        self._committed = committed
        if self._progress is not None:
            self._progress(committed)
        return True
