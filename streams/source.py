"""The protocols of recordings and of live sources with acknowledged deliveries."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Protocol, Self, runtime_checkable

from streams.block import Block, Rejected
from streams.ledger import FileProgress, Ledger


@runtime_checkable
class Source(Protocol):
    """Blocks in the order of acquisition; a Rejected replaces a block that failed."""

    name: str

    def __iter__(self) -> Iterator[Block | Rejected]:
        """Iterate over the blocks from the first one on."""
        ...

    def __len__(self) -> int:
        """Return the number of blocks of the recording, rejected ones included."""
        ...


@dataclass(frozen=True, eq=False)
class Delivery:
    """One block, and what the source needs for its acknowledgement.

    Attributes:
        item: the block, or the rejection in its place. A rejection ``duplicate`` or ``changed`` bears the number of
            the block that holds its place: the ledger counts the rejection and keeps the block.
        token: opaque value for the acknowledgement (a connection, a message id).
        progress: of the files that the block was made of, committed in the same transaction as the block.
    """

    item: Block | Rejected
    token: Any = None
    progress: tuple[FileProgress, ...] = ()


@dataclass(frozen=True)
class Backlog:
    """Counts of a live source in items (files of a folder, frames of a stream).

    At any moment offered = accepted + rejected + pending: those whose samples are all in committed blocks, those
    refused with a reason in the ledger, and those that wait, delivered but unacknowledged ones among them.
    ``oldest_age_s`` counts from when the oldest pending item was first seen, 0 where none is pending.
    """

    offered: int
    accepted: int
    rejected: int
    pending: int
    oldest_age_s: float


@runtime_checkable
class LiveSource(Protocol):
    """A source without end.

    Call ``open`` first and ``close`` last, or use it as a context manager around ``open``. ``next``, ``acknowledge``
    and ``close`` are called from the thread that commits, ``backlog`` from any. Several deliveries may be outstanding;
    they are acknowledged in the order of delivery. An unacknowledged item is delivered again, with the same sequence
    number, by the next ``open`` on the same ledger, and not before.
    """

    name: str

    def open(self, ledger: Ledger) -> None:
        """Start receiving, after the last committed block of the ledger.

        Raises:
            SourceError: the address cannot be listened to, the folder cannot be read; it names the source.
        """
        ...

    def next(self, timeout: float) -> Delivery | None:
        """Return the next delivery, or None after ``timeout`` seconds without one.

        A vanished folder, a dropped connection or invalid data raises nothing: it becomes a rejection, or a state that
        :meth:`problem` names.
        """
        ...

    def acknowledge(self, delivery: Delivery) -> None:
        """Record that a delivery is committed; only now may a sender discard it."""
        ...

    def backlog(self) -> Backlog:
        """Return the counts."""
        ...

    def problem(self) -> str | None:
        """Return in one sentence why the source receives nothing, or None."""
        ...

    def close(self) -> None:
        """Stop receiving within a second; unacknowledged items are delivered again."""
        ...

    def __enter__(self) -> Self:
        """Return the source itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the source."""
        self.close()
