"""Failures of work that is shared between workers, and how an exception crosses from a worker to the caller."""

from __future__ import annotations

import importlib
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from models.words.errors import SpallwatchError, WrongInputError
from models.work.codec import ROOTS
from models.work.redact import redact
from models.work.task import Failure


class ObjectStorageError(SpallwatchError):
    """A request to an object storage failed; the message names its URL and the cause, without credentials."""


class LostFolderError(SpallwatchError):
    """The folder of a store can no longer be written; the message names it and the cause."""


_MAX_LISTED = 20
_MAX_LOG = 20_000


@dataclass(frozen=True)
class FailedChunk:
    """A chunk that was set aside: its key, its name for people, and the last failure."""

    chunk: str
    label: str
    message: str
    log: str


class ChunksFailedError(SpallwatchError):
    """Chunks failed as often as they may and were set aside; all others are done."""

    def __init__(self, message: str, failed: Sequence[FailedChunk] = ()) -> None:
        """Take a message from :func:`chunks_failed`, and the chunks."""
        super().__init__(message)
        self.failed = tuple(failed)


class OtherProgramError(WrongInputError):
    """A worker runs another program than the caller; the message names both."""


class MemoryNeedError(WrongInputError):
    """A chunk needs more memory than its worker has; the message has both amounts."""


def chunks_failed(failed: Sequence[FailedChunk], total: int, kept: str | None) -> ChunksFailedError:
    """Return the error of chunks that were set aside.

    Args:
        failed: at least one.
        total: chunks of the run.
        kept: URL of the store that keeps the others and the logs; None where it is deleted.
    """
    lines = [f"{len(failed)} of {total} chunks failed and were set aside:"]
    lines += [f"  {chunk.label}: {chunk.message}" for chunk in failed[:_MAX_LISTED]]
    if len(failed) > _MAX_LISTED:
        lines.append(f"  and {len(failed) - _MAX_LISTED} more")
    if kept is not None:
        lines.append(f"the others are kept in {kept}, logs in failed/ there; --resume runs only what failed")
    return ChunksFailedError("\n".join(lines), failed)


def failure_of(error: BaseException, *, of_task: bool = True) -> Failure:
    """Return the failure of an exception: class, message and traceback, a long one shortened in the middle.

    Credentials are left out. A ValueError is wrong input only where a task raised it (``of_task``), not what runs it.
    """
    kind = type(error)
    log = "".join(traceback.format_exception(error))
    if len(log) > _MAX_LOG:
        log = f"{log[: _MAX_LOG // 2]}\n...\n{log[-_MAX_LOG // 2 :]}"
    message = redact(str(error)) or kind.__qualname__
    wrong = isinstance(error, WrongInputError) or (of_task and isinstance(error, ValueError))
    of_store = isinstance(error, ObjectStorageError) or (not of_task and isinstance(error, OSError))
    return Failure(f"{kind.__module__}:{kind.__qualname__}", message, redact(log), wrong, of_store)


def error_of(failure: Failure) -> Exception:
    """Return the exception of a failure, of its class where that is found and can be made of the message.

    Otherwise it is a WrongInputError for a class of this project and a ValueError for another one.
    """
    module, _, name = failure.kind.partition(":")
    error = None
    # What a worker names is neither imported from other packages nor called unless it is such a class.
    with suppress(Exception):
        found = importlib.import_module(module) if module.partition(".")[0] in ROOTS else sys.modules[module]
        kind: Any = getattr(found, name)
        error = kind(failure.message) if issubclass(kind, WrongInputError | ValueError) else None
    if error is None or str(error) != failure.message:
        error = WrongInputError(failure.message) if module.partition(".")[0] in ROOTS else ValueError(failure.message)
    error.add_note(failure.log)
    return error
