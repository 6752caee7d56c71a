"""What a live source asks of the ledger: what is committed already. The store implements it; here is one in memory."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

PENDING = "pending"
ACCEPTED = "accepted"


@dataclass(frozen=True)
class FileProgress:
    """How far one file of a watched folder has come.

    Attributes:
        path: path below the folder, as :func:`streams.folder.names.shown` writes it.
        size: size in bytes when it was read.
        mtime_ns: time of its last change then, ns.
        inode: its number in the file system then.
        content_hash: digest of its first ``read_bytes`` bytes, by which a grown file is told from another one.
        read_bytes: number of bytes of which the samples were taken.
        samples: number of its samples, from the first one on, that are in committed blocks or in a rejection.
        verdict: "pending" while samples of it wait, "accepted", or a rejection status of the interface.
    """

    path: str
    size: int
    mtime_ns: int
    inode: int
    content_hash: str = ""
    read_bytes: int = 0
    samples: int = 0
    verdict: str = PENDING


@runtime_checkable
class Ledger(Protocol):
    """The memory of what was committed; it survives the process.

    ``committed`` and ``known`` may be called from any thread, everything else from the thread that commits.
    """

    def committed(self, source: str) -> int:
        """Return the highest committed sequence number of a source (or stream), 0 where there is none."""
        ...

    def known(self, source: str, content_hash: str) -> int | None:
        """Return the sequence number of the committed block of a source with this content, or None."""
        ...

    def files(self, source: str) -> Iterator[FileProgress]:
        """Iterate over what is known of the files of a watched folder."""
        ...

    def file_with(self, source: str, content_hash: str) -> FileProgress | None:
        """Return a file of a watched folder with this content, or None."""
        ...

    def remember(self, source: str, progress: Iterable[FileProgress]) -> None:
        """Store the progress of files outside a commit: of files that were renamed or touched, say."""
        ...

    def forget(self, source: str, path: str) -> None:
        """Drop what is known of a path, whose file goes by another name now."""
        ...


class MemoryLedger:
    """A ledger that dies with the process: for tests, and for whoever needs no memory."""

    def __init__(self) -> None:
        """Begin without memory."""
        self._lock = threading.Lock()
        self._blocks: dict[str, dict[int, str]] = {}
        self._sequences: dict[tuple[str, str], int] = {}
        self._files: dict[str, dict[str, FileProgress]] = {}
        self._contents: dict[tuple[str, str], str] = {}

    def committed(self, source: str) -> int:
        """Return the highest committed sequence number of a source, 0 where there is none."""
        with self._lock:
            return max(self._blocks.get(source, {0: ""}))

    def known(self, source: str, content_hash: str) -> int | None:
        """Return the sequence number of the committed block with this content, or None."""
        with self._lock:
            return self._sequences.get((source, content_hash))

    def files(self, source: str) -> Iterator[FileProgress]:
        """Iterate over what is known of the files of a watched folder."""
        yield from list(self._files.get(source, {}).values())

    def file_with(self, source: str, content_hash: str) -> FileProgress | None:
        """Return a file with this content, or None."""
        path = self._contents.get((source, content_hash))
        return None if path is None else self._files[source].get(path)

    def remember(self, source: str, progress: Iterable[FileProgress]) -> None:
        """Store the progress of files."""
        for item in progress:
            self._files.setdefault(source, {})[item.path] = item
            self._contents.setdefault((source, item.content_hash), item.path)

    def forget(self, source: str, path: str) -> None:
        """Drop what is known of a path."""
        gone = self._files.get(source, {}).pop(path, None)
        if gone is not None and self._contents.get((source, gone.content_hash)) == path:
            del self._contents[(source, gone.content_hash)]

    def commit(self, source: str, sequence: int, content_hash: str, progress: Iterable[FileProgress] = ()) -> str:
        """Commit a block and the progress that goes with it.

        Returns:
            "committed"; "duplicate" or "changed" where the number is taken, by the same or by another content.
        """
        with self._lock:
            blocks = self._blocks.setdefault(source, {})
            outcome = "committed"
            if sequence in blocks:
                outcome = "duplicate" if blocks[sequence] == content_hash else "changed"
            else:
                blocks[sequence] = content_hash
                if content_hash:
                    self._sequences.setdefault((source, content_hash), sequence)
        self.remember(source, progress)
        return outcome

    def blocks(self, source: str) -> dict[int, str]:
        """Return the content hashes of the committed blocks by sequence number."""
        with self._lock:
            return dict(self._blocks.get(source, {}))
