"""What a pass over a recording has met and given: repetitions, and files by verdict."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from streams.files.datasets import FileFacts
from streams.reblock import Cut, name_of_recording
from streams.types.block import Block, Rejected
from streams.types.listing import shown
from streams.types.samples import Origin, ReaderError, Samples


def copy_error(name: str, original: str) -> ReaderError:
    """Return the rejection of a file with the content of another."""
    return ReaderError("duplicate", f"{name}: holds the same bytes as {original}")


def taken_error(name: str, number: int, *, same: bool) -> ReaderError:
    """Return the rejection of a file whose number a block has, of the ``same`` content or not."""
    reason = f"{name}: block {number} is there already" + ("" if same else ", with other samples")
    return ReaderError("duplicate" if same else "changed", reason)


@dataclass(frozen=True, eq=False)
class Loaded:
    """A file with its samples, or the error in their place."""

    path: str
    facts: FileFacts
    result: Samples | ReaderError
    digest: str = ""
    repeats: int = 0
    """Number of the block that has this content or number already, else 0."""

    @cached_property
    def name(self) -> str:
        """The path in printable characters, with the number of the recording where it is a later one of its file."""
        return name_of_recording(shown(self.path), 1 if isinstance(self.result, ReaderError) else self.result.number)

    @property
    def is_refused(self) -> bool:
        """Whether there are no samples."""
        return isinstance(self.result, ReaderError)

    @property
    def recordings(self) -> list[Loaded]:
        """The recordings of the file, each alone; the error alone."""
        if isinstance(self.result, ReaderError):
            return [self]
        return [replace(self, result=one) for one in self.result.recordings]


@dataclass(frozen=True)
class GivenState:
    """What a pass has given before a file.

    Attributes:
        accepted, rejected: numbers of files.
        contents: name of a file, and number of its block or 0, by digest.
        numbers: digests of the files that state the number of their block, by number.
        in_blocks: of the samples that wait for more, whether others of their file are in a block.
    """

    accepted: int
    rejected: int
    contents: Mapping[str, tuple[str, int]]
    numbers: Mapping[int, str]
    in_blocks: tuple[bool, ...] = ()


class Given:
    """Contents and numbers that one pass has given, so that it finds repetitions, and its files by verdict."""

    def __init__(self) -> None:
        """Begin before the first file."""
        self.accepted = self.rejected = 0
        self._contents: dict[str, tuple[str, int]] = {}
        self._numbers: dict[int, str] = {}
        self._in_blocks: set[Hashable] = set()
        self._counts = (0, 0, self._in_blocks)
        self._content_before: tuple[str, tuple[str, int] | None] | None = None
        self._new_number: int | None = None

    @classmethod
    def of(cls, state: GivenState) -> Given:
        """Go on from a state; see :meth:`note_held`."""
        given = cls()
        given.accepted, given.rejected = state.accepted, state.rejected
        given._contents, given._numbers = dict(state.contents), dict(state.numbers)
        return given

    def note_held(self, origins: Sequence[Hashable], in_blocks: Sequence[bool]) -> None:
        """Note of the origins of samples that wait for more whether others of them are in a block."""
        self._in_blocks |= {origin for origin, within in zip(origins, in_blocks, strict=True) if within}

    def begin_file(self) -> None:
        """Note the state before a file."""
        self._counts = (self.accepted, self.rejected, set(self._in_blocks))
        self._content_before = self._new_number = None

    def state_before(self, origins: Sequence[Hashable]) -> GivenState:
        """Return the state before the latest file, at which samples of ``origins`` waited for more."""
        accepted, rejected, in_blocks = self._counts
        contents, numbers = dict(self._contents), dict(self._numbers)
        if self._content_before is not None:
            digest, before = self._content_before
            contents.pop(digest, None)
            contents |= {} if before is None else {digest: before}
        if self._new_number is not None:
            del numbers[self._new_number]
        return GivenState(accepted, rejected, contents, numbers, tuple(origin in in_blocks for origin in origins))

    def unrepeated(self, loaded: Loaded, number: int | None, highest: int) -> Loaded:
        """Return a file, or the rejection of one whose content or ``number`` came before.

        Files whose samples are all equal are those of a dead sensor, and no copies.
        """
        self._content_before = (loaded.digest, self._contents.get(loaded.digest))
        if isinstance(loaded.result, Samples):
            this = (loaded.name, 0)
            first = self._contents.setdefault(loaded.digest, this)
            if first is not this and not loaded.result.is_constant:
                error = copy_error(loaded.name, first[0])
                return replace(loaded, result=error, repeats=first[1] or max(1, highest))
        if number is None:
            return loaded
        if number not in self._numbers:
            self._numbers[number], self._new_number = loaded.digest, number
            return loaded
        error = taken_error(loaded.name, number, same=self._numbers[number] == loaded.digest)
        if isinstance(loaded.result, ReaderError):
            error = ReaderError("changed", str(loaded.result))
        return replace(loaded, result=error, repeats=number)

    def note_file(self, loaded: Loaded, item: Block | Rejected) -> None:
        """Count a file that is a block or a rejection, by the first of its recordings where it holds several."""
        if isinstance(item, Rejected):
            self.rejected += 1
        else:
            self.accepted += 1
            self._contents[loaded.digest] = (loaded.name, item.sequence)

    def note_cut(self, cut: Cut) -> None:
        """Count the files that end with a cut: accepted if any block has samples of them."""
        for origin, end in cut.used:
            if not cut.missing:
                self._in_blocks.add(origin)
            if isinstance(origin, Origin) and end >= origin.total:
                accepted = origin in self._in_blocks
                self.accepted += accepted
                self.rejected += not accepted
                self._in_blocks.discard(origin)


def reordered(files: Iterable[Loaded], wanted: Iterator[tuple[object, ...]], archive: str) -> Iterator[Loaded]:
    """Yield files in the ``wanted`` order; one that comes too early is held back until those before it have come.

    Where the ``archive`` breaks off, what is held comes next, and the rejection of the archive last.
    """
    following = next(wanted, None)
    held: dict[tuple[object, ...], list[Loaded]] = {}
    done: set[tuple[object, ...]] = set()
    damaged: list[Loaded] = []
    try:
        for loaded in files:
            if loaded.facts.order in done:
                yield loaded
                continue
            held.setdefault(loaded.facts.order, []).append(loaded)
            while following is not None and following in held:
                done.add(following)
                yield from held.pop(following)
                following = next(wanted, None)
    except ReaderError as error:
        damaged.append(Loaded(archive, FileFacts(()), error))
    yield from (loaded for order in sorted(held) for loaded in held[order])
    yield from damaged


@dataclass(eq=False)
class Met:
    """The files of one listing: those of the data set, those of another format, and the end of a damaged archive."""

    known: dict[str, None] = field(default_factory=dict)
    others: list[str] = field(default_factory=list)
    damaged: int = 0
