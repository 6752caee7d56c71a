"""The life of a file of a watched folder as a table: phases, events, guards and actions.

:func:`advance` is pure. Its edges are what watches (:mod:`streams.folder.register`) and what reads and commits
(:mod:`streams.folder.intake`): they tell events, and the register does the actions that come back.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

from streams.folder.copying import Order
from streams.types.listing import Stat
from streams.types.samples import Origin, ReaderError
from streams.types.source import PENDING, FileProgress

Phase = Literal["queued", "deferred", "taken", "reading", "held", "delivered", "finished"]
"""Of a file: "deferred" because it is incomplete, "taken" before and after it is "reading" in the background, "held"
because samples of it wait for more, "delivered" entirely, "finished" under its verdict or gone."""
Action = Literal["queue", "defer", "remember", "finish"]
"""Put it in the queue; skip it until it is due; store in the ledger that it is read, and count it; count it."""
PHASES: tuple[Phase, ...] = get_args(Phase)
MAX_INCOMPLETE_S = 600.0
"""Time without a change after which an incomplete file is rejected."""
# A side-car may be written after its file.
_RETRIED = ("unreadable", "short", "wrong_shape", "wrong_rate", "wrong_unit")
_MAX_RETRY_SETTLES = 10.0
_REFUSED_PAUSE_S = 1.0


@dataclass(frozen=True, kw_only=True)
class FileState:
    """What is known of a file that waits. Times are of the monotonic clock, s.

    Attributes:
        changed: when its last change was seen; ``closed`` whether it was closed or moved in since.
        whole: whether it counted as complete when it was taken.
        due: when it is tried again without a change, or ``awaits_end`` once it counts as whole.
        base: its progress in the ledger, ``counted`` the verdict under which it is counted already.
        read: its progress as of the last reading, ``read_at``, without samples; it had ``total`` samples.
        fed: number of samples taken.
        absent: since when it is missing from the folder.
        outstanding: number of unacknowledged deliveries with samples of it, ``blocks`` of all blocks with such.
        released: whether it was poisoned before, so that a rejection holds its number.
    """

    stat: Stat
    changed: float
    phase: Phase = "queued"
    closed: bool = False
    whole: bool = False
    due: float = math.inf
    awaits_end: bool = False
    base: FileProgress | None = None
    counted: str | None = None
    read: FileProgress | None = None
    total: int = 0
    fed: int = 0
    read_at: float = -math.inf
    absent: float | None = None
    outstanding: int = 0
    blocks: int = 0
    released: bool = False


def next_attempt(state: FileState, error: ReaderError, settle_s: float, now: float) -> float | None:
    """Return when a file that could not be read is read again (monotonic, s); None where it is rejected.

    Where the system refused it for want of something (:attr:`ReaderError.may_pass`), it is tried again and again.
    """
    retry = _MAX_RETRY_SETTLES * settle_s if error.status in _RETRIED else 0.0
    wait = MAX_INCOMPLETE_S if error.may_pass or error.status in ("incomplete", "empty") else retry
    if now - state.changed >= wait or state.absent is not None:
        return None
    return now + max(settle_s, _REFUSED_PAUSE_S) if error.may_pass else state.changed + wait


@dataclass(frozen=True)
class Observed:
    """A scan or an event of the file system gives the status of the file; ``closed``: just closed or moved in."""

    stat: Stat
    now: float
    closed: bool = False


@dataclass(frozen=True)
class Missing:
    """A scan of the whole folder did not find it."""

    now: float


@dataclass(frozen=True)
class Renamed:
    """A scan found it under another name; ``base`` is its progress under that."""

    base: FileProgress | None


@dataclass(frozen=True)
class Retried:
    """It is to be read as soon as it is its turn."""


@dataclass(frozen=True)
class Postponed:
    """It is incomplete, or cannot be dated or read yet."""

    due: float
    awaits_end: bool = False


@dataclass(frozen=True)
class Taken:
    """It is its turn."""

    whole: bool


@dataclass(frozen=True)
class ReadingBegun:
    """The background reads it."""

    now: float


@dataclass(frozen=True)
class ReadingEnded:
    """The background has read it, or failed to."""


@dataclass(frozen=True)
class ChangedMeanwhile:
    """It changed while it was read; ``stat`` is its new status, None where it was removed."""

    stat: Stat | None
    now: float


@dataclass(frozen=True)
class Continued:
    """Its first ``samples`` are those of blocks that are committed."""

    samples: int


@dataclass(frozen=True)
class Replaced:
    """Its content is another one; the former content was counted as a file of its own."""


@dataclass(frozen=True)
class Emitted:
    """Its samples go into blocks: all into one, or ``cut``."""

    progress: FileProgress
    total: int
    cut: bool


@dataclass(frozen=True)
class BlockDelivered:
    """A block or rejection with samples of it is handed over; ``blocks`` is 1 where it counts as a block of it."""

    blocks: int = 0


@dataclass(frozen=True)
class Drained:
    """None of its samples wait for more."""


@dataclass(frozen=True)
class Committed:
    """A delivery with samples of it is committed."""

    progress: FileProgress


@dataclass(frozen=True)
class Removed:
    """It is counted under its verdict, or no longer there."""


OfReading = Retried | Postponed | Taken | ReadingBegun | ReadingEnded | ChangedMeanwhile | Continued | Replaced
FileEvent = Observed | Missing | Renamed | OfReading | Emitted | BlockDelivered | Drained | Committed | Removed


@dataclass(frozen=True)
class Transition:
    """A row of the table: in one of ``phases`` and where ``guard`` holds, ``event`` leads to ``phase``, None: the same.

    ``change`` gives the fields that change.
    """

    event: type
    phases: tuple[Phase, ...]
    phase: Phase | None = None
    actions: tuple[Action, ...] = ()
    guard: Callable[[FileState, Any], bool] = lambda state, event: True
    change: Callable[[FileState, Any], dict[str, Any]] = lambda state, event: {}


_ALIVE = PHASES[:-1]


def _observe(state: FileState, event: Observed) -> dict[str, Any]:
    """Return the new status; its time of change begins anew with a change."""
    if event.stat == state.stat:
        return {"absent": None, "closed": state.closed or event.closed}
    return {"absent": None, "stat": event.stat, "changed": event.now, "closed": event.closed, "due": math.inf}


def _is_news(state: FileState, event: Observed) -> bool:
    return event.stat != state.stat or (state.phase == "deferred" and state.absent is not None)


def _is_there(state: FileState, event: Missing) -> bool:
    return state.absent is None


def _is_committed(state: FileState, event: Drained) -> bool:
    """Return whether a file that was read had nothing that is not committed."""
    return not state.outstanding and state.read is not None


def _is_last(state: FileState, event: Committed) -> bool:
    return state.outstanding == 1 and event.progress.verdict != PENDING


def _rename(state: FileState, event: Renamed) -> dict[str, Any]:
    return {"absent": None, "base": event.base}


def _postpone(state: FileState, event: Postponed) -> dict[str, Any]:
    return {"due": event.due, "awaits_end": event.awaits_end}


def _forget_content(state: FileState, event: Replaced) -> dict[str, Any]:
    return {"base": None, "counted": None, "fed": 0, "total": 0, "blocks": 0}


def _meet_change(state: FileState, event: ChangedMeanwhile) -> dict[str, Any]:
    gone = event.stat is None
    absent = event.now if gone else state.absent
    return {"changed": event.now, "closed": False, "absent": absent, "stat": event.stat or state.stat}


def _commit(state: FileState, event: Committed) -> dict[str, Any]:
    return {"outstanding": state.outstanding - 1, "base": event.progress}


def _deliver(state: FileState, event: BlockDelivered) -> dict[str, Any]:
    return {"outstanding": state.outstanding + 1, "blocks": state.blocks + event.blocks}


def _emit(state: FileState, event: Emitted) -> dict[str, Any]:
    fed = event.total if event.cut else state.fed
    return {"read": event.progress, "total": event.total, "fed": fed}


TABLE = (
    # Watching. A change during a reading is met by a later scan, once the file as it was is read.
    Transition(Observed, ("reading",), change=lambda state, event: {"absent": None}),
    Transition(Observed, ("deferred", "held"), "queued", ("queue",), guard=_is_news, change=_observe),
    Transition(Observed, _ALIVE, change=_observe),
    Transition(Missing, _ALIVE, guard=_is_there, change=lambda state, event: {"absent": event.now}),
    Transition(Renamed, ("queued", "deferred"), "queued", ("queue",), change=_rename),
    Transition(Renamed, _ALIVE, change=_rename),
    # Waiting.
    Transition(Retried, _ALIVE, "queued", ("queue",)),
    Transition(Postponed, _ALIVE, "deferred", ("defer",), change=_postpone),
    Transition(Taken, ("queued",), "taken", change=lambda state, event: {"whole": event.whole}),
    # Reading.
    Transition(ReadingBegun, ("taken",), "reading", change=lambda state, event: {"read_at": event.now}),
    Transition(ReadingEnded, ("reading",), "taken"),
    Transition(ChangedMeanwhile, ("taken",), "queued", ("queue",), change=_meet_change),
    Transition(Continued, ("taken",), change=lambda state, event: {"fed": max(state.fed, event.samples)}),
    Transition(Replaced, _ALIVE, change=_forget_content),
    Transition(Emitted, ("taken",), "held", guard=lambda state, event: event.cut, change=_emit),
    Transition(Emitted, ("taken",), change=_emit),
    # Committing. A file that waits to be read again keeps its phase, so that its change is not lost.
    Transition(BlockDelivered, ("taken",), "delivered", change=_deliver),
    Transition(BlockDelivered, PHASES, change=_deliver),
    Transition(Drained, ("held",), "delivered", ("remember",), guard=_is_committed),
    Transition(Drained, ("held",), "delivered"),
    Transition(Committed, ("delivered",), "delivered", ("finish",), guard=_is_last, change=_commit),
    Transition(Committed, PHASES, change=_commit),
    Transition(Removed, PHASES, "finished"),
)
"""The first row that fits an event is what happens; where none fits, nothing does."""


def advance(state: FileState, event: FileEvent) -> tuple[FileState, tuple[Action, ...]]:
    """Return what a file becomes by an event, and what is to be done."""
    for row in TABLE:
        if row.event is type(event) and state.phase in row.phases and row.guard(state, event):
            return replace(state, phase=row.phase or state.phase, **row.change(state, event)), row.actions
    return state, ()


@dataclass(eq=False, kw_only=True)
class FileEntry(Origin):
    """A file that waits, under the name it has now; ``key`` is its ``path`` in printable characters.

    ``order`` sorts the files by acquisition; ``seen`` is when it was first seen waiting, s of the monotonic clock.
    """

    path: str
    order: Order
    seen: float
    state: FileState

    def happen(self, event: FileEvent) -> tuple[Action, ...]:
        """Go on by an event; return what is to be done."""
        self.state, actions = advance(self.state, event)
        self.total = self.state.total
        return actions
