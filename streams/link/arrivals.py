"""The queue of a receiver: frames from receipt to commit, in order, each once, gaps stated."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from streams.files.container import content_hash
from streams.link.pulse_frame import Held, HeldPulses, decode_pulses, item_of_frame
from streams.link.wire import PULSES, JumpError, WireError, decode_frame, frame_version
from streams.types.block import Block, Rejected
from streams.types.source import Backlog, Delivery, Ledger, StreamCount
from streams.types.spec import MAX_FRAME, SourceSpec


@dataclass(eq=False)
class Ticket:
    """A delivery until it is acknowledged; size in bytes, time of receipt of its frame.

    ``tokens`` are of the transport, of the frame and of its pulses if any, replaced when they are received again;
    ``out_of_order``: a higher number was received before, so the ledger may have this one.
    """

    stream: str
    size: int
    since: float
    tokens: tuple[Any, ...] = ()
    out_of_order: bool = False


@dataclass(eq=False)
class _Stream:
    """State of a stream; ``committed`` and ``received`` are numbers of blocks, those of ``pulses`` of frames."""

    spec: SourceSpec
    count: StreamCount = field(default_factory=StreamCount)
    committed: int = 0
    received: int = 0
    pulses: HeldPulses = field(default_factory=HeldPulses)


class Arrivals:
    """The queue of one receiver.

    The thread that reads calls :meth:`take`, the one that commits the rest. A frame is a block; their numbers are the
    same until the stream is reset (:class:`streams.types.source.StreamCount`).
    A frame received again before its commit is discarded; after it, it is delivered as a rejection ``duplicate`` or
    ``changed``, and the committed block stays. Where numbers are skipped, a rejection ``incomplete`` under the last of
    them states which are missing; but where the sender states that it did send the one before, that one was lost on
    the way, and the frame is refused until both are sent again. So it is where pulses that a frame states did not come.
    """

    def __init__(
        self, specs: Mapping[str, SourceSpec], max_waiting: int, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Begin empty.

        Args:
            specs: the allowed streams by their id; blocks bear the name of the source.
            max_waiting: bytes of frames that may wait for their commit.
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
        """Continue after the numbers in the ledger."""
        self._ledger = ledger
        for stream in self._streams.values():
            stream.count = ledger.stream(stream.spec.name)
            stream.committed = stream.received = stream.count.last

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
        """Whether the limit of waiting bytes is reached."""
        return self._bytes >= self._max_waiting

    def wait_for_room(self) -> None:
        """Wait until the limit of waiting bytes is not reached, or this is closed."""
        with self._lock:
            self._lock.wait_for(lambda: self._closed or not self.full)

    def committed(self, stream: str) -> int:
        """Return the highest committed number of a stream, as its sender counts."""
        state = self._streams[stream]
        return state.count.frame_of(state.committed)

    def source(self, stream: str | None) -> str | None:
        """Return the name of the source of a stream, None where it is not one of these."""
        found = self._streams.get(stream or "")
        return None if found is None else found.spec.name

    def take(self, stream: str, data: bytes | bytearray, token: Any = None, limit: int = MAX_FRAME) -> bool:
        """Queue a whole frame of at most ``limit`` bytes, or hold one of pulses; ``data`` must not be changed later.

        Returns:
            Whether it was taken; if not, the sender must send again from the number committed last on.

        Raises:
            WireError: the bytes do not even state their number reliably; they are not counted.
            JumpError: the number is too far ahead, or before the first one after a reset; likewise.
        """
        state = self._streams[stream]
        if frame_version(data) == PULSES:
            pulses = decode_pulses(data, limit)
            _check_jump(state, stream, state.count.block_of(pulses.sequence))
            state.pulses.put(Held(pulses, len(data), token))
            return True
        item, after, held = _item(state, stream, data, limit)
        if item is None:
            return False
        tokens = tuple(found for found in (token, None if held is None else held.token) if found is not None)
        size = len(data) + (0 if held is None else held.size)
        with self._lock:
            _check_jump(state, stream, item.sequence)
            if after is not None and state.received < after < item.sequence:
                return False
            self._queue_by_number(state, stream, item, Ticket(stream, size, self._clock(), tokens))
            if held is not None:
                state.pulses.take(held.frame.sequence)
            self._lock.notify_all()
        return True

    def spent(self, stream: str) -> list[Any]:
        """Return the tokens of frames of pulses that are not waited for any more, each once."""
        pulses = self._streams[stream].pulses
        found, pulses.spent = pulses.spent, []
        return found

    def _queue_by_number(self, state: _Stream, stream: str, item: Block | Rejected, ticket: Ticket) -> None:
        number = item.sequence
        if number > state.received:
            first = state.received + 1
            if number > first:
                gap = _gap(state, stream, first, number - 1)
                self._queue_new(gap, Ticket(stream, 0, ticket.since))
            state.received = number
            self._queue_new(item, ticket)
            return
        waiting = self._waiting.get((stream, number))
        if waiting is None:
            ticket.out_of_order = True
            self._queue_new(item, ticket)
        elif waiting[0] == item.content_hash:
            waiting[1].tokens = ticket.tokens
        else:
            self._put(Delivery(_repeated(item, waiting[0]), ticket))

    def _queue_new(self, item: Block | Rejected, ticket: Ticket) -> None:
        self._waiting[ticket.stream, item.sequence] = (item.content_hash, ticket)
        self._put(Delivery(item, ticket))

    def _put(self, delivery: Delivery) -> None:
        ticket: Ticket = delivery.token
        self._bytes += ticket.size
        self._outstanding[id(ticket)] = ticket
        self._queue.append(delivery)

    def next(self, timeout: float) -> Delivery | None:
        """Return the next delivery, or None after ``timeout`` seconds without one.

        An error of the ledger is passed on; the next call returns the delivery.
        """
        with self._lock:
            self._lock.wait_for(lambda: self._queue or self._closed, timeout)
            if not self._queue or self._closed:
                return None
            delivery = self._queue[0]
        item, ticket = delivery.item, delivery.token
        if ticket.out_of_order and self._ledger is not None:
            held = self._ledger.content_of(item.source, item.sequence)
            item = item if held is None else _repeated(item, held)
        with self._lock:
            self._queue.popleft()
        return Delivery(item, ticket)

    def acknowledge(self, delivery: Delivery) -> Ticket:
        """Record a commit; afterwards :meth:`committed` has the number for the sender."""
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
            self._lock.notify_all()
        return ticket

    @property
    def ready(self) -> int:
        """How many deliveries wait."""
        return len(self._queue)

    def queued_blocks(self) -> int | None:
        """Return how many deliveries wait; None where the limit is reached, and senders hold back more."""
        return None if self.full else len(self._queue)

    def backlog(self) -> Backlog:
        """Return the counts since :meth:`open`."""
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


def _check_jump(state: _Stream, stream: str, number: int) -> None:
    """Raise JumpError for a block number that the stream cannot have reached."""
    count, source = state.count, state.spec.name
    frame, last = count.frame_of(number), count.frame_of(state.received)
    if number < count.number:
        raise JumpError(f"frame {frame} of {stream!r} is before {count.first}, with which it began anew")
    if number - state.received > state.spec.max_gap_blocks:
        raise JumpError(
            f"frame {frame} of {stream!r} came after {last}: a jump of more than max_gap_blocks = "
            f"{state.spec.max_gap_blocks}; if the sender counts so from now on: spallwatch stream reset {source} "
            f"--first {frame}"
        )


def _gap(state: _Stream, stream: str, first: int, last: int) -> Rejected:
    """Return the rejection in place of missing blocks."""
    begin, end = state.count.frame_of(first), state.count.frame_of(last)
    which = f"frame {end}" if first == last else f"frames {begin} to {end}"
    reason = f"{stream}: {which} never came ({last - first + 1} missing): the sender went on without"
    return Rejected(state.spec.name, last, state.count.name_of(stream, end), "incomplete", reason)


def _item(
    state: _Stream, stream: str, data: bytes | bytearray, limit: int
) -> tuple[Block | Rejected | None, int | None, Held | None]:
    """Return the block or rejection of a frame, the number of the block before it if stated, and its pulses.

    There is no block where pulses that the frame states have not come.
    """
    spec, count = state.spec, state.count
    try:
        frame = decode_frame(data, limit)
    except WireError as error:
        if error.sequence is None:
            raise
        name, number = count.name_of(stream, error.sequence), count.block_of(error.sequence)
        reason = f"{name}: {error}"
        rejected = Rejected(spec.name, number, name, error.status, reason, content_hash(bytes(data)))
        return rejected, None, state.pulses.get(error.sequence)
    name, number = count.name_of(stream, frame.sequence), count.block_of(frame.sequence)
    after = None if frame.after is None else count.block_of(frame.after)
    held = state.pulses.get(frame.sequence)
    if held is None and frame.pulses is not None:
        return None, after, None
    return item_of_frame(spec, frame, held, name, number), after, held
