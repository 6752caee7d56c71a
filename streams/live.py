"""The protocol of live sources: what is delivered stays with the source until it is acknowledged after the commit."""

from __future__ import annotations

from dataclasses import dataclass
from types import TracebackType
from typing import Any, Protocol, Self, runtime_checkable

from streams.block import Block, Rejected
from streams.ledger import FileProgress, Ledger


@dataclass(frozen=True, eq=False)
class Delivery:
    """One block, and what the source needs in order to know it again.

    Attributes:
        item: the block, or the rejection that stands in its place. A rejection ``duplicate`` or ``changed`` bears the
            number of the block whose place it would take: the ledger counts it and keeps the block.
        token: whatever the source wants back with the acknowledgement (a connection, a message id); opaque to others.
        progress: of the files that the block was made of, to be committed in the same transaction as the block.
    """

    item: Block | Rejected
    token: Any = None
    progress: tuple[FileProgress, ...] = ()


@dataclass(frozen=True)
class Backlog:
    """How far a source has come; offered = accepted + rejected + pending at any moment.

    Attributes:
        offered: items seen so far: files of a folder, frames of a stream.
        accepted: of these, items whose samples are all in committed blocks.
        rejected: of these, items refused, each with a reason in the ledger.
        pending: of these, items that wait, delivered but unacknowledged ones among them.
        oldest_age_s: seconds since the oldest pending item was first seen, 0 where none is pending.
    """

    offered: int
    accepted: int
    rejected: int
    pending: int
    oldest_age_s: float


@runtime_checkable
class LiveSource(Protocol):
    """A source that goes on for ever.

    ``open`` first, ``close`` last, or use it as a context manager around ``open``. ``next``, ``acknowledge`` and
    ``close`` are called from one thread, the one that commits; ``backlog`` from any. Several deliveries may be
    outstanding; they are acknowledged in the order in which they were given. What is never acknowledged is delivered
    again, with the same sequence number, by the next ``open`` on the same ledger, and never before.
    """

    name: str

    def open(self, ledger: Ledger) -> None:
        """Begin to listen, from what the ledger has on.

        Raises:
            SourceError: the address cannot be listened to, the folder cannot be read; it names the source.
        """
        ...

    def next(self, timeout: float) -> Delivery | None:
        """Return the next delivery, or None after ``timeout`` seconds without one.

        Whatever the world does (a vanished folder, a dropped connection, nonsense on the wire) is no exception but a
        rejection, or a state that :meth:`problem` names.
        """
        ...

    def acknowledge(self, delivery: Delivery) -> None:
        """Take note that a delivery is committed (or found in the ledger); only now may a sender forget it."""
        ...

    def backlog(self) -> Backlog:
        """Return how far the source has come."""
        ...

    def problem(self) -> str | None:
        """Return in one sentence what keeps the source from hearing anything, or None."""
        ...

    def close(self) -> None:
        """Stop listening and free everything, within a second; what is not acknowledged comes again."""
        ...

    def __enter__(self) -> Self:
        """Return the source itself."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the source."""
        ...
