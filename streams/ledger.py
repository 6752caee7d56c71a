"""The protocol of the record of committed blocks and files, as of the store."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

PENDING = "pending"
ACCEPTED = "accepted"
HEAD_BYTES = 4096
"""Length of the head of a file for ``head_hash``."""


@dataclass(frozen=True)
class FileProgress:
    """How much of one file of a watched folder is committed.

    Attributes:
        path: below the folder, as :func:`streams.folder.listing.shown` writes it.
        head_hash: digest of its first ``HEAD_BYTES``, by which candidates for the same file are found.
        content_hash: digest of its first ``read_bytes`` bytes, of which the samples were taken.
        samples: number of its samples, from the first on, in committed blocks or in a rejection.
        verdict: "pending" while samples of it wait, "accepted", or a rejection status of the interface.
    """

    path: str
    size: int
    mtime_ns: int
    inode: int
    head_hash: str = ""
    content_hash: str = ""
    read_bytes: int = 0
    samples: int = 0
    verdict: str = PENDING

    @property
    def is_part(self) -> bool:
        """Whether bytes at the end, half a line or segment, were left for later."""
        return self.read_bytes < self.size


@runtime_checkable
class Ledger(Protocol):
    """Record of what was committed; it outlives the process.

    The queries of blocks may be called from any thread, those of files from the one that commits.
    """

    def committed(self, source: str) -> int:
        """Return the highest committed sequence number of a source or stream, or 0."""
        ...

    def began(self, source: str) -> float | None:
        """Return the start of the first dated block, s since 1970 UTC, or None."""
        ...

    def content_of(self, source: str, sequence: int) -> str | None:
        """Return the content hash of the block committed under a number, or None."""
        ...

    def known(self, source: str, content_hash: str) -> int | None:
        """Return the number of a committed block of a source with this content, or None."""
        ...

    def file(self, source: str, path: str) -> FileProgress | None:
        """Return what is known of a file of a watched folder, or None."""
        ...

    def files_like(self, source: str, head_hash: str, content_hash: str) -> list[FileProgress]:
        """Return files with this content, then some with the same beginning."""
        ...

    def pending_files(self, source: str) -> list[FileProgress]:
        """Return the files of a watched folder of which samples wait."""
        ...

    def file_counts(self, source: str) -> dict[str, int]:
        """Return how many files of a watched folder have which verdict."""
        ...

    def remember(self, source: str, progress: Iterable[FileProgress]) -> None:
        """Store progress outside a commit, such as of renamed or touched files."""
        ...

    def move(self, source: str, path: str, progress: FileProgress) -> None:
        """Store progress under the new name and remove ``path``, in one transaction."""
        ...
