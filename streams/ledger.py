"""What a live source asks of the ledger: what is committed already. The store implements it; here is one in memory."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from streams.block import Block, Rejected

PENDING = "pending"
ACCEPTED = "accepted"
HEAD_BYTES = 4096
"""Length of the head of a file by whose digest files that may be one are found."""


@dataclass(frozen=True)
class FileProgress:
    """How far one file of a watched folder has come.

    Attributes:
        path: path below the folder, as :func:`streams.folder.names.shown` writes it.
        size: size in bytes when it was read.
        mtime_ns: time of its last change then, ns.
        inode: its number in the file system then.
        head_hash: digest of its first ``HEAD_BYTES``, by which files that may be one are found.
        content_hash: digest of its first ``read_bytes`` bytes, by which a grown file is told from another one.
        read_bytes: number of bytes of which the samples were taken.
        samples: number of its samples, from the first one on, that are in committed blocks or in a rejection.
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


@runtime_checkable
class Ledger(Protocol):
    """The memory of what was committed; it survives the process.

    The methods that ask about blocks may be called from any thread, those about files from the one that commits.
    """

    def committed(self, source: str) -> int:
        """Return the highest committed sequence number of a source (or stream), 0 where there is none."""
        ...

    def began(self, source: str) -> float | None:
        """Return when the first dated block of a source began, seconds since 1970 UTC, or None where none is dated."""
        ...

    def content_of(self, source: str, sequence: int) -> str | None:
        """Return the content hash of the block committed under a number, or None where the number is free."""
        ...

    def known(self, source: str, content_hash: str) -> int | None:
        """Return the number of a committed block of a source with this content, or None."""
        ...

    def file(self, source: str, path: str) -> FileProgress | None:
        """Return what is known of a file of a watched folder, or None."""
        ...

    def files_like(self, source: str, head_hash: str, content_hash: str) -> list[FileProgress]:
        """Return files of a watched folder with this content, then some that begin in the same way."""
        ...

    def pending_files(self, source: str) -> list[FileProgress]:
        """Return the files of a watched folder of which samples wait."""
        ...

    def file_counts(self, source: str) -> dict[str, int]:
        """Return how many files of a watched folder have which verdict."""
        ...

    def remember(self, source: str, progress: Iterable[FileProgress]) -> None:
        """Store the progress of files outside a commit: of files that were renamed or touched, say."""
        ...

    def move(self, source: str, path: str, progress: FileProgress) -> None:
        """Store what is known of a file under the name that it has now, in place of ``path``; both or neither."""
        ...


class MemoryLedger:
    """A ledger that dies with the process: for tests, and for whoever needs no memory."""

    def __init__(self) -> None:
        """Begin without memory."""
        self._lock = threading.Lock()
        self._blocks: dict[str, dict[int, str]] = {}
        self._highest: dict[str, int] = {}
        self._began: dict[str, float] = {}
        self._sequences: dict[tuple[str, str], int] = {}
        self._files: dict[str, dict[str, FileProgress]] = {}
        self._heads: dict[tuple[str, str], dict[str, None]] = {}

    def committed(self, source: str) -> int:
        """Return the highest committed sequence number of a source, 0 where there is none."""
        with self._lock:
            return self._highest.get(source, 0)

    def began(self, source: str) -> float | None:
        """Return when the first dated block of a source began, or None."""
        with self._lock:
            return self._began.get(source)

    def content_of(self, source: str, sequence: int) -> str | None:
        """Return the content hash of the block committed under a number, or None."""
        with self._lock:
            return self._blocks.get(source, {}).get(sequence)

    def known(self, source: str, content_hash: str) -> int | None:
        """Return the number of a committed block with this content, or None."""
        with self._lock:
            return self._sequences.get((source, content_hash))

    def file(self, source: str, path: str) -> FileProgress | None:
        """Return what is known of a file, or None."""
        return self._files.get(source, {}).get(path)

    def files_like(self, source: str, head_hash: str, content_hash: str) -> list[FileProgress]:
        """Return files with this content, then those that begin in the same way."""
        found = [self._files[source][path] for path in self._heads.get((source, head_hash), {})]
        return sorted(found, key=lambda item: item.content_hash != content_hash)

    def pending_files(self, source: str) -> list[FileProgress]:
        """Return the files of which samples wait."""
        return [item for item in self._files.get(source, {}).values() if item.verdict == PENDING]

    def file_counts(self, source: str) -> dict[str, int]:
        """Return how many files have which verdict."""
        return dict(Counter(item.verdict for item in self._files.get(source, {}).values()))

    def remember(self, source: str, progress: Iterable[FileProgress]) -> None:
        """Store the progress of files."""
        for item in progress:
            self._forget(source, item.path)
            self._files.setdefault(source, {})[item.path] = item
            self._heads.setdefault((source, item.head_hash), {})[item.path] = None

    def move(self, source: str, path: str, progress: FileProgress) -> None:
        """Store what is known of a file under the name that it has now."""
        self._forget(source, path)
        self.remember(source, [progress])

    def _forget(self, source: str, path: str) -> None:
        gone = self._files.get(source, {}).pop(path, None)
        if gone is not None:
            self._heads[(source, gone.head_hash)].pop(path)

    def commit(self, item: Block | Rejected, progress: Iterable[FileProgress] = ()) -> str:
        """Commit a block or a rejection, and the progress that goes with it.

        Returns:
            "committed"; "duplicate" or "changed" where the number is taken, by the same or by another content.
        """
        source, sequence, content_hash = item.source, item.sequence, item.content_hash
        with self._lock:
            blocks = self._blocks.setdefault(source, {})
            outcome = "committed"
            if sequence in blocks:
                outcome = "duplicate" if blocks[sequence] == content_hash else "changed"
            else:
                blocks[sequence] = content_hash
                if isinstance(item, Block) and item.start is not None:
                    self._began.setdefault(source, item.start)
                self._highest[source] = max(sequence, self._highest.get(source, 0))
                if content_hash:
                    self._sequences.setdefault((source, content_hash), sequence)
        self.remember(source, progress)
        return outcome

    def blocks(self, source: str) -> dict[int, str]:
        """Return the content hashes of the committed blocks by number."""
        with self._lock:
            return dict(self._blocks.get(source, {}))
