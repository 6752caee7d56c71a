"""The protocols of recordings, of live sources, and of the ledger of what is committed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, Self, runtime_checkable

from models.platform.supervision import Restarts
from streams.types.block import Block, Rejected
from streams.types.listing import Stat

PENDING = "pending"
ACCEPTED = "accepted"
MAX_IGNORED_NAMES = 100
"""Ignored files that are named; all are counted."""
POISONED = "poisoned"
RELEASED = "released"
"""A poisoned file that is to be handled again."""
MAX_DEATHS = 2
"""A file is poisoned where the process died so often in a row while it handled the file."""
HEAD_BYTES = 4096
"""Length of the head of a file for ``head_hash``."""


@dataclass(frozen=True)
class FileProgress:
    """How much of one file of a watched folder is committed.

    Attributes:
        path: below the folder, as :func:`streams.types.listing.shown` writes it.
        head_hash: digest of its first ``HEAD_BYTES``, by which candidates for the same file are found.
        content_hash: digest of its first ``read_bytes`` bytes, of which the samples were taken.
        samples: number of its samples, from the first on, in committed blocks or in a rejection.
        verdict: "pending" while samples of it wait, "accepted", a rejection status of the interface, or "released".
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

    def is_of(self, stat: Stat) -> bool:
        """Return whether a status is the one as of which this is."""
        return (self.size, self.mtime_ns, self.inode) == (stat.size, stat.mtime_ns, stat.inode)

    @property
    def is_part(self) -> bool:
        """Whether bytes at the end, half a line or segment, were left for later."""
        return self.read_bytes < self.size


@dataclass(frozen=True)
class StreamCount:
    """How a stream counts its frames, and which blocks of the ledger they are.

    A sender numbers its frames from 1; after a reset of its stream it may begin anew, while the numbers of blocks go
    on. So no block has the number of another one, and none its name.

    Attributes:
        resets: number of resets so far.
        first: number of the first frame since the latest reset.
        number: number of the block that this frame becomes.
        last: number of the last committed block since then; ``number - 1`` before the first.
    """

    resets: int = 0
    first: int = 1
    number: int = 1
    last: int = 0

    def block_of(self, frame: int) -> int:
        """Return the number of the block that a frame becomes."""
        return frame - self.first + self.number

    def frame_of(self, block: int) -> int:
        """Return the number of the frame that became a block."""
        return block - self.number + self.first

    def name_of(self, stream: str, frame: int) -> str:
        """Return the name of the block that a frame becomes, such as ``press[7]``, or ``press[1:7]`` after a reset."""
        return f"{stream}[{frame}]" if not self.resets else f"{stream}[{self.resets}:{frame}]"


@runtime_checkable
class Ledger(Protocol):
    """Record of what was committed; it outlives the process.

    The queries of blocks may be called from any thread, those of files from the one that commits.
    """

    def committed(self, source: str) -> int:
        """Return the highest committed sequence number of a source or stream, or 0."""
        ...

    def stream(self, source: str) -> StreamCount:
        """Return how a stream counts, and where it stands."""
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

    def dating(self, source: str) -> Mapping[str, Any] | None:
        """Return what dates the blocks of a source, as :class:`streams.dates.dating.Dating` writes it, or None."""
        ...

    def keep_dating(self, source: str, dating: Mapping[str, Any]) -> None:
        """Store what dates the blocks of a source, in a transaction of its own."""
        ...

    def move(self, source: str, path: str, progress: FileProgress) -> None:
        """Store progress under the new name and remove ``path``, in one transaction."""
        ...

    def handle(self, source: str, paths: Sequence[str]) -> None:
        """Note which files are being handled, none at the end, in place of those before; from any thread.

        The note outlives the process, not a power cut.
        """
        ...

    def deaths(self, source: str, path: str) -> float:
        """Return how often in a row the process died while it handled a file; a quick handling counts half."""
        ...

    def released(self, source: str) -> list[str]:
        """Return the poisoned files that are to be handled again."""
        ...


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


@runtime_checkable
class FileSource(Source, Protocol):
    """A recording of files."""

    def files(self) -> Backlog:
        """Return the counts of files as of the latest iteration; those that it has not given are pending."""
        ...

    def ignored(self) -> Mapping[str, str]:
        """Return why files are ignored, by name; at most ``MAX_IGNORED_NAMES``."""
        ...

    def closed(self) -> Mapping[str, str]:
        """Return why folders are left out, whose files are in no count, by name."""
        ...


@dataclass(frozen=True, eq=False)
class Delivery:
    """One block or rejection, and what the source needs for its acknowledgement.

    A rejection that is a repetition bears the number of the block that holds its place: the ledger counts the rejection
    and keeps the block. ``token`` is opaque; ``progress``, of the files that the block was made of, is
    committed in the same transaction as the block.
    """

    item: Block | Rejected
    token: Any = None
    progress: tuple[FileProgress, ...] = ()


@dataclass(frozen=True)
class Backlog:
    """Counts of a live source in items (files of a folder, frames of a stream).

    At any moment offered = accepted + rejected + ignored + pending: those whose samples are all in committed blocks,
    those refused with a reason in the ledger, those of another format, and those that wait, delivered but
    unacknowledged ones among them. ``oldest_age_s`` counts from when the oldest pending item was first seen, 0 where
    none is pending. ``refused`` counts connections and messages that were refused; they are not offered.
    """

    offered: int
    accepted: int
    rejected: int
    pending: int
    oldest_age_s: float
    ignored: int = 0
    refused: int = 0


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

        What happens to a folder or connection raises nothing: it becomes a rejection, or a :meth:`problem`.
        """
        ...

    def acknowledge(self, delivery: Delivery) -> None:
        """Record that a delivery is committed; only now may a sender discard it."""
        ...

    def queued_blocks(self) -> float | None:
        """Return about how many blocks wait to be delivered; None where there are more than the source knows of."""
        ...

    def ready_blocks(self) -> int:
        """Return how many deliveries :meth:`next` gives at once, those that are delivered and not committed apart."""
        return 0

    def tend(self) -> None:
        """Start again what has ended; called every second or so from the thread that commits.

        Raises:
            LostThreadError: a thread hangs that cannot be replaced.
        """

    def restarts(self) -> tuple[Restarts, ...]:
        """Return what is known of the failures of its threads."""
        return ()

    def listener(self) -> Mapping[str, Any] | None:
        """Return the counts of the connections that it took and refused; None where it does not listen."""
        return None

    def assumes_interval(self) -> bool:
        """Return whether nothing states the interval of its blocks: they are counted by the length of a file."""
        return False

    def backlog(self) -> Backlog:
        """Return the counts."""
        ...

    def ignored(self) -> Mapping[str, str]:
        """Return why items are ignored, by name; at most ``MAX_IGNORED_NAMES``, while ``backlog`` counts all."""
        return {}

    def problem(self) -> str | None:
        """Return in one sentence why the source receives nothing, or None."""
        ...

    def notices(self) -> list[dict[str, Any]]:
        """Return what is new for the event log: ``kind``, ``source``, ``text`` and further keys of the kind."""
        return []

    def close(self) -> None:
        """Stop receiving within a second; unacknowledged items are delivered again."""
        ...

    def __enter__(self) -> Self:
        """Return the source itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Close the source."""
        self.close()
