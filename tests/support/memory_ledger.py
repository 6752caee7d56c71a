"""A ledger in memory, for tests and benchmarks, and the reference for the ledger of the store."""

from __future__ import annotations

import json
import threading
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from streams.types.block import Block, Rejected
from streams.types.source import PENDING, RELEASED, FileProgress, StreamCount


class MemoryLedger:
    """A ledger without storage."""

    def __init__(self) -> None:
        """Begin without memory; ``counts`` are those of streams that were reset."""
        self.counts: dict[str, StreamCount] = {}
        self._lock = threading.Lock()
        self._blocks: dict[str, dict[int, str]] = {}
        self._highest: dict[str, int] = {}
        self._began: dict[str, float] = {}
        self._sequences: dict[tuple[str, str], int] = {}
        self._files: dict[str, dict[str, FileProgress]] = {}
        self._datings: dict[str, dict[str, Any]] = {}
        self._heads: dict[tuple[str, str], dict[str, None]] = {}
        self.handled: list[tuple[str, tuple[str, ...]]] = []
        self.died: dict[tuple[str, str], float] = {}

    def committed(self, source: str) -> int:
        """Return the highest committed sequence number of a source, 0 where there is none."""
        with self._lock:
            return self._highest.get(source, 0)

    def stream(self, source: str) -> StreamCount:
        """Return how a stream counts."""
        count = self.counts.get(source, StreamCount())
        return replace(count, last=max(self.committed(source), count.number - 1))

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

    def dating(self, source: str) -> dict[str, Any] | None:
        """Return what dates the blocks of a source, or None."""
        return self._datings.get(source)

    def keep_dating(self, source: str, dating: Mapping[str, Any]) -> None:
        """Store what dates the blocks of a source."""
        self._datings[source] = json.loads(json.dumps(dating))

    def move(self, source: str, path: str, progress: FileProgress) -> None:
        """Store what is known of a file under the name that it has now."""
        self._forget(source, path)
        self.remember(source, [progress])

    def _forget(self, source: str, path: str) -> None:
        gone = self._files.get(source, {}).pop(path, None)
        if gone is not None:
            self._heads[(source, gone.head_hash)].pop(path)

    def handle(self, source: str, paths: Sequence[str]) -> None:
        """Note which files are being handled."""
        self.handled.append((source, tuple(paths)))

    def deaths(self, source: str, path: str) -> float:
        """Return how often the process ended while a file was being handled."""
        return self.died.get((source, path), 0)

    def released(self, source: str) -> list[str]:
        """Return the poisoned files that are to be handled again."""
        return [item.path for item in self._files.get(source, {}).values() if item.verdict == RELEASED]

    def release(self, source: str, path: str) -> None:
        """Let a poisoned file be handled again."""
        self.remember(source, [replace(self._files[source][path], verdict=RELEASED)])

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
