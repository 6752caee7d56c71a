"""Frames that arrived over a network on their way to the commit: in order, each once, gaps stated, memory bounded."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from streams.block import Block, Rejected
from streams.ledger import Ledger
from streams.link.wire import WireError, decode_frame
from streams.load import agreed_rate, choose_channels, content_hash
from streams.reblock import samples_hash
from streams.samples import ReaderError, Samples
from streams.source import Backlog, Delivery
from streams.spec import MAX_FRAME, SourceSpec


@dataclass(eq=False)
class Ticket:
    """What goes with a delivery until it is acknowledged.

    Attributes:
        stream: name of the stream.
        size: bytes of its frame.
        since: when it came.
        token: what the transport wants back; a frame that comes again meanwhile brings a new one.
        again: whether a higher number came before, so that the ledger may have this one.
    """

    stream: str
    size: int
    since: float
    token: Any = None
    again: bool = False


@dataclass(eq=False)
class _Stream:
    spec: SourceSpec
    committed: int = 0
    received: int = 0


class Arrivals:
    """The streams of one receiver. :meth:`take` is called by the thread that reads, the rest by the one that commits.

    A frame is a block, its sequence the block's. What comes again before its commit is swallowed; what comes again
    after it is delivered as a rejection ``duplicate`` or ``changed``, which leaves the committed block alone. Where
    numbers are skipped, a rejection ``incomplete`` under the last of them says which never came; but where the sender
    says that it did send the one before, that one was lost on the way, and the frame waits for it to be sent again.
    """

    def __init__(
        self, specs: Mapping[str, SourceSpec], max_waiting: int, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Begin empty.

        Args:
            specs: the allowed streams by their id; blocks bear the name of the source.
            max_waiting: bytes of frames that may wait for their commit.
            clock: seconds, for the age of what waits.
        """
        self._lock = threading.Condition()
        self._streams = {stream: _Stream(spec) for stream, spec in specs.items()}
        self._max_waiting = max_waiting
        self._clock = clock
        self._queue: deque[Delivery] = deque()
        self._outstanding: dict[int, Ticket] = {}
        self._waiting: dict[tuple[str, int], tuple[str, Ticket]] = {}
        self._bytes = self._accepted = self._rejected = 0
        self._closed = False
        self._ledger: Ledger | None = None

    def open(self, ledger: Ledger) -> None:
        """Take up the numbers that the ledger has."""
        self._ledger = ledger
        for stream in self._streams.values():
            stream.committed = stream.received = ledger.committed(stream.spec.name)

    def close(self) -> None:
        """Wake all waiters."""
        with self._lock:
            self._closed = True
            self._lock.notify_all()

    @property
    def streams(self) -> tuple[str, ...]:
        """The allowed streams."""
        return tuple(self._streams)

    @property
    def full(self) -> bool:
        """Whether so much waits that nothing more should be read."""
        return self._bytes >= self._max_waiting

    def committed(self, stream: str) -> int:
        """Return the highest committed number of a stream."""
        return self._streams[stream].committed

    def take(self, stream: str, data: bytes | bytearray, token: Any = None, limit: int = MAX_FRAME) -> bool:
        """Take the bytes of one frame.

        Args:
            stream: an allowed stream.
            data: the whole frame; not changed afterwards.
            token: for the transport, see :class:`Ticket`.
            limit: bytes of the largest frame to accept.

        Returns:
            Whether it was taken; if not, the sender must send again from the number committed last on.

        Raises:
            WireError: nothing in the bytes can be believed, not even their number; they are not counted.
        """
        state = self._streams[stream]
        item, after = _item(state.spec, stream, data, limit)
        with self._lock:
            if after is not None and state.received < after < item.sequence:
                return False
            self._sort(state, stream, item, Ticket(stream, len(data), self._clock(), token))
            self._lock.notify_all()
        return True

    def _sort(self, state: _Stream, stream: str, item: Block | Rejected, ticket: Ticket) -> None:
        """Put an item where it belongs by its number."""
        number = item.sequence
        if number > state.received:
            first = state.received + 1
            if number > first:
                gap = _gap(state.spec.name, stream, first, number - 1)
                self._queue_up(gap, Ticket(stream, 0, ticket.since))
            state.received = number
            self._queue_up(item, ticket)
            return
        waiting = self._waiting.get((stream, number))
        if waiting is None:
            ticket.again = True
            self._queue_up(item, ticket)
        elif waiting[0] == item.content_hash:
            waiting[1].token = ticket.token
        else:
            self._put(Delivery(_repeated(item, waiting[0]), ticket))

    def _queue_up(self, item: Block | Rejected, ticket: Ticket) -> None:
        self._waiting[ticket.stream, item.sequence] = (item.content_hash, ticket)
        self._put(Delivery(item, ticket))

    def _put(self, delivery: Delivery) -> None:
        ticket: Ticket = delivery.token
        self._bytes += ticket.size
        self._outstanding[id(ticket)] = ticket
        self._queue.append(delivery)

    def next(self, timeout: float) -> Delivery | None:
        """Return the next delivery, or None after ``timeout`` seconds without one.

        Whatever the ledger raises where it cannot be read goes through, and the delivery comes with the next call.
        """
        with self._lock:
            self._lock.wait_for(lambda: self._queue or self._closed, timeout)
            if not self._queue or self._closed:
                return None
            delivery = self._queue[0]
        item, ticket = delivery.item, delivery.token
        if ticket.again and self._ledger is not None:
            held = self._ledger.content_of(item.source, item.sequence)
            item = item if held is None else _repeated(item, held)
        with self._lock:
            self._queue.popleft()
        return Delivery(item, ticket)

    def acknowledge(self, delivery: Delivery) -> Ticket:
        """Take note of a commit; afterwards :meth:`committed` says what to tell the sender."""
        ticket, number = delivery.token, delivery.item.sequence
        if not isinstance(ticket, Ticket):
            raise ValueError("this delivery is not one of this source")
        with self._lock:
            if self._outstanding.pop(id(ticket), None) is None:
                raise ValueError(f"block {number} of {ticket.stream!r} is acknowledged already")
            self._bytes -= ticket.size
            known = self._waiting.get((ticket.stream, number))
            if known is not None and known[1] is ticket:
                del self._waiting[ticket.stream, number]
            state = self._streams[ticket.stream]
            state.committed = max(state.committed, number)
            if isinstance(delivery.item, Block):
                self._accepted += 1
            else:
                self._rejected += 1
        return ticket

    def backlog(self) -> Backlog:
        """Return how far the streams have come since :meth:`open`."""
        with self._lock:
            pending = len(self._outstanding)
            oldest = min((ticket.since for ticket in self._outstanding.values()), default=None)
            age = 0.0 if oldest is None else max(0.0, self._clock() - oldest)
            offered = self._accepted + self._rejected + pending
            return Backlog(offered, self._accepted, self._rejected, pending, age)


def _repeated(item: Block | Rejected, held: str) -> Rejected:
    """Return the rejection of an item whose number is taken by the content ``held``."""
    same = held == item.content_hash
    reason = f"{item.name} came again" if same else f"{item.name} came again with another content, or too late"
    status = "duplicate" if same else "changed"
    return Rejected(item.source, item.sequence, item.name, status, reason, item.content_hash)


def _gap(source: str, stream: str, first: int, last: int) -> Rejected:
    which = f"frame {last}" if first == last else f"frames {first} to {last}"
    reason = f"{stream}: {which} never came ({last - first + 1} missing): the sender went on without"
    return Rejected(source, last, f"{stream}[{last}]", "incomplete", reason)


def _item(spec: SourceSpec, stream: str, data: bytes | bytearray, limit: int) -> tuple[Block | Rejected, int | None]:
    """Return the block in a frame, or the rejection that stands for it, and the number before it if that is stated."""
    try:
        frame = decode_frame(data, limit)
    except WireError as error:
        if error.sequence is None:
            raise
        name = f"{stream}[{error.sequence}]"
        reason = f"{name}: {error}"
        return Rejected(spec.name, error.sequence, name, error.status, reason, content_hash(bytes(data))), None
    name = f"{stream}[{frame.sequence}]"
    samples = frame.scaled()
    digest = samples_hash(samples.values, samples.known_rate, samples.channels)
    try:
        chosen = _chosen(spec, samples, name)
    except ReaderError as error:
        return Rejected(spec.name, frame.sequence, name, error.status, str(error), digest), frame.after
    return chosen.block(spec.name, frame.sequence, name, digest, chosen.elapsed), frame.after


def _chosen(spec: SourceSpec, samples: Samples, name: str) -> Samples:
    """Return the samples of the configured channels; a frame may hold more channels than are configured."""
    unstated = replace(samples, units=("unknown",) * len(samples.units))
    chosen = choose_channels(unstated, spec.channels, None, name)
    units: list[str | None] = []
    for channel, column, unit in zip(chosen.channels, chosen.columns, chosen.units, strict=True):
        stated = samples.units[column - 1]
        wanted = unit if spec.channels and unit != "unknown" else stated
        if stated not in ("unknown", wanted):
            reason = f"{name}: channel {channel}: the frame is in {stated}, unit = {wanted!r}"
            raise ReaderError("wrong_unit", reason)
        units.append(wanted)
    return replace(chosen, units=tuple(units), rate=agreed_rate((samples.rate,), spec.rate, name))


def by_stream(specs: Sequence[SourceSpec]) -> dict[str, SourceSpec]:
    """Return sources by the stream id that their senders give: the name of the source."""
    return {spec.name: spec for spec in specs}
