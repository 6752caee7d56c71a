"""Options of commands that share their work between processes or machines, and the runner that they ask for."""

from __future__ import annotations

import functools
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from models.platform.memory import check_address_space
from models.platform.process_signals import ended_as_interrupted
from models.platform.scratch import remove_abandoned, scratch_folder
from models.words.errors import WrongInputError
from models.work.errors import ChunksFailedError, FailedChunk
from models.work.redact import redact
from monitor.commands.common import PROGRESS_AFTER_S, InputError, check_folder, say
from monitor.commands.option import PLACE, WHOLE
from monitor.commands.shared_folders import sole_writer
from monitor.words.numbers import duration

if TYPE_CHECKING:
    from models.work.runner import Runner
    from models.work.task import FileStore, Progress

F = TypeVar("F", bound=Callable[..., Any])
_CHUNKS = "spallwatch-chunks-"
_SCRATCH = ("spallwatch-work-", _CHUNKS, "spallwatch-run-", "spallwatch-archive-")
"""Temporary folders of commands that share their work; nothing may need one where all is found done."""
MAX_LOGS_SHOWN = 3
"""Failed chunks whose log is printed; those of the others are in the store."""


@dataclass(frozen=True)
class Sharing:
    """How a command shares its work, as its options say.

    Attributes:
        cluster: address of a dask scheduler, "local", or None for threads and processes of this machine.
        workers: their number; 0 is one per core, or with an address at least one.
        resume: whether what an interrupted run left is used.
        chunks: folder or URL of the chunks, None for the default.
    """

    cluster: str | None = None
    workers: int = 0
    resume: bool = False
    chunks: str | None = None

    @contextmanager
    def open(
        self, beside: Path | str | None, *, quiet: bool, progress: bool = True, locked: bool = True
    ) -> Iterator[SharedWork]:
        """Yield a runner; at the end its chunks are deleted, unless the user named their place or something failed.

        Args:
            beside: output of the command; chunks are kept in BESIDE.chunks. None where it writes none.
            quiet: whether only errors are printed.
            progress: whether chunks done and the time left are shown on a terminal.
            locked: whether other commands with this output are refused meanwhile.

        Raises:
            InputError: chunks need a place, and none was named; another process writes the output.
            WrongInputError: as ``models.work.choose.open_runner``.
        """
        from models.work.choose import open_runner

        with ExitStack() as stack:
            stack.enter_context(ended_as_interrupted())
            if beside is not None and locked:
                stack.enter_context(sole_writer(Path(beside)))
            for prefix in _SCRATCH:
                remove_abandoned(prefix)
            chunks = self._chunks(beside)
            lasting = chunks is not None
            if not lasting and self.cluster is not None:
                chunks = str(stack.enter_context(scratch_folder(_CHUNKS)))
            line = _ProgressLine(shown=progress and not quiet and sys.stderr.isatty(), quiet=quiet)
            runner = open_runner(
                cluster=self.cluster,
                workers=self.workers,
                chunks=chunks,
                resume=self.resume,
                notify=line.show,
                keep=self.chunks is not None,
                lasting=lasting,
                tell=line.tell,
            )
            shared = SharedWork(runner, self)
            line.notes = runner.tally.notes
            stack.enter_context(runner)
            stack.callback(shared.note)
            try:
                yield shared
            except ChunksFailedError as error:
                line.end()
                _print_logs(error.failed)
                raise
            except KeyboardInterrupt as error:
                line.end()
                for note in getattr(error, "__notes__", ()):
                    click.echo(f"spallwatch: {note}", err=True)
                raise
            finally:
                line.end()
                line.tell_notes()

    def _chunks(self, beside: Path | str | None) -> str | None:
        """Return the place of the chunks, None where they need not outlive the run."""
        if self.chunks is not None:
            return _named_place(self.chunks, beside)
        if self.cluster is None and not self.resume:
            return None
        if beside is not None:
            return f"{str(beside).rstrip('/')}.chunks"
        if self.resume or self.cluster != "local":
            option = "--resume" if self.resume else "--cluster"
            raise InputError(f"{option}: expected --chunks, a folder or URL that all workers reach")
        return None


def _named_place(chunks: str, out: Path | str | None) -> str:
    """Return the place of chunks that the user named.

    Raises:
        InputError: it is no store, cannot be written, or is that of the output.
    """
    from models.work.folder_store import FolderStore, open_store

    if not chunks.strip():
        raise InputError(f"--chunks: expected a folder or URL, got {chunks!r}")
    try:
        store = open_store(chunks)
    except WrongInputError as error:
        raise InputError(f"--chunks: {error}") from None
    if out is not None and _place_of(store) == _place_of(open_store(str(out))):
        raise InputError(f"--chunks {chunks}: is the output; expected another folder or URL")
    if isinstance(store, FolderStore):
        check_folder("--chunks", Path(store.url), Path(store.url))
    return chunks


def _place_of(store: FileStore) -> Path | str:
    from models.work.folder_store import FolderStore

    return Path(store.url).resolve() if isinstance(store, FolderStore) else store.url.rstrip("/")


@dataclass
class SharedWork:
    """A runner that is open, and what is said of it.

    Attributes:
        runner: runs the work of the command.
        sharing: the options.
        workers: those at hand, as far as known.
    """

    runner: Runner
    sharing: Sharing
    workers: int = 0

    def note(self) -> None:
        """Note what is unknown once the runner is closed."""
        self.workers = self.runner.executor.workers() or self.workers

    def values(self) -> dict[str, Any]:
        """Return what ``--json`` says of the work under the key ``cluster``."""
        tally = self.runner.tally
        self.note()
        return {
            "address": self.sharing.cluster,
            "workers": self.workers,
            "chunks": tally.chunks,
            "kept": tally.kept,
            "failed": [
                {"chunk": chunk.chunk, "label": chunk.label, "message": chunk.message, "log": chunk.log}
                for chunk in tally.failed
            ],
            "processors": sorted(tally.processors),
        }

    def lines(self) -> Iterator[str]:
        """Yield the lines for people of a run on a cluster, or of one that was resumed."""
        tally = self.runner.tally
        if self.sharing.cluster is not None or tally.kept:
            kept = f", {tally.kept} of them found done" if tally.kept else ""
            yield f"{tally.chunks} chunks on {self.workers} worker{'s' if self.workers != 1 else ''}{kept}"
        if len(tally.processors) > 1:
            yield f"on {len(tally.processors)} kinds of processor: equal to 1e-5, not bit for bit"


def sharing(words: str) -> Callable[[F], F]:
    """Add ``--cluster``, ``--workers``, ``--resume`` and ``--chunks``; the command takes them as ``sharing``.

    Args:
        words: what the workers of this machine are, such as "Threads or processes".
    """
    options = (
        click.option("--cluster", metavar="ADDRESS", help="Dask scheduler, tls://HOST:PORT, or local for processes."),
        click.option("--workers", type=WHOLE, default=0, help=f"{words}; 0: one per core. Of a cluster: waited for."),
        click.option("--resume", is_flag=True, help="Keep chunks as they are done, and use those of an earlier run."),
        click.option(
            "--chunks", type=PLACE, metavar="URL", help="Folder or URL of chunks.  [default: OUT.chunks while it runs]"
        ),
    )

    def add(function: F) -> F:
        @functools.wraps(function)
        def command(
            *args: Any, cluster: str | None, workers: int, resume: bool, chunks: str | None, **others: Any
        ) -> Any:
            # Before the command imports what may wait for memory without end.
            check_address_space()
            return function(*args, sharing=Sharing(cluster, workers, resume, chunks), **others)

        decorated: Any = command
        for option in reversed(options):
            decorated = option(decorated)
        return decorated

    return add


class _ProgressLine:
    """One line on a terminal that is written again and again, after ``PROGRESS_AFTER_S``."""

    def __init__(self, *, shown: bool, quiet: bool) -> None:
        self._shown = shown
        self._quiet = quiet
        self._told = 0
        self._began = time.monotonic()
        self._width = 0
        self.notes: list[str] = []

    def show(self, progress: Progress) -> None:
        """Write how far a run is, and notes that are new."""
        self.tell_notes()
        if self._shown and (self._width or time.monotonic() - self._began >= PROGRESS_AFTER_S):
            text = progress_text(progress)
            click.echo("\r" + text.ljust(self._width), nl=False, err=True)
            self._width = len(text)

    def tell(self, text: str) -> None:
        """Write a line for people above it."""
        self.end()
        say(f"spallwatch: {redact(text)}", quiet=self._quiet)

    def tell_notes(self) -> None:
        """Write notes of the runner that are new."""
        for text in self.notes[self._told :]:
            self._told += 1
            self.tell(text)

    def end(self) -> None:
        """Leave the line."""
        if self._width:
            click.echo(err=True)
        self._width = 0


def progress_text(progress: Progress) -> str:
    """Return how far a run is, for people."""
    parts = [f"{progress.name or 'chunks'}: {progress.done} of {progress.total}"]
    if progress.kept:
        parts.append(f"{progress.kept} found done")
    if progress.failed:
        parts.append(f"{progress.failed} failed")
    if progress.seconds_left is not None and progress.done < progress.total:
        parts.append(f"{duration(progress.seconds_left)} left")
    return ", ".join(parts)


def _print_logs(failed: tuple[FailedChunk, ...]) -> None:
    for chunk in failed[:MAX_LOGS_SHOWN]:
        click.echo(f"log of {chunk.label} ({chunk.chunk[:12]}):", err=True)
        for line in chunk.log.splitlines():
            click.echo(f"  {line}", err=True)
