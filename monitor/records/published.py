"""What the store knows of the files that were published from it."""

from __future__ import annotations

from typing import NamedTuple

from monitor.records.store import Store


class Published(NamedTuple):
    """A file of records as it was written.

    Attributes:
        file: its name.
        day: UTC day as a number of days since 1970, or None.
        last_block: ledger number of the last block of that day that is surely in it.
        size: bytes.
    """

    file: str
    day: int | None
    last_block: int
    size: int


def note_published(store: Store, done: Published) -> None:
    """Let the store know of a file, so that it is written again only when there is more to write.

    Raises:
        StoreError: the store cannot be written.
    """
    with store.transaction() as connection:
        connection.execute("INSERT OR REPLACE INTO published VALUES (?, ?, ?, ?)", done)
