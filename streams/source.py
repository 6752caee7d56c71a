"""The Source protocol: anything that gives blocks in order."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol, runtime_checkable

from streams.block import Block, Rejected


class SourceError(Exception):
    """A source cannot be opened as configured; the message names it, what was expected and what was found."""


@runtime_checkable
class Source(Protocol):
    """Gives blocks in the order of acquisition; a block that cannot be made comes as Rejected, in its place."""

    name: str

    def __iter__(self) -> Iterator[Block | Rejected]:
        """Iterate over the blocks from the first one on."""
        ...

    def __len__(self) -> int:
        """Return how many blocks the source holds in all (a recording)."""
        ...
