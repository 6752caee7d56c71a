"""A file of a watched folder that waits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from streams.folder.copying import Order
from streams.types.listing import Stat
from streams.types.samples import Origin
from streams.types.source import FileProgress

Phase = Literal["queued", "deferred", "reading", "held", "delivered"]


@dataclass(eq=False, kw_only=True)
class Entry(Origin):
    """A file that waits. Times are of the monotonic clock, s.

    Attributes:
        path: below the folder, as the file system gives it; ``key`` is the same in printable characters.
        order: sorts the files by acquisition.
        seen: when it was first seen waiting, ``changed`` when its last change was.
        closed: whether it was closed or moved in since its last change.
        whole: whether it counted as complete when it was taken.
        phase: "queued", "deferred" because it is incomplete, "reading" in the background, "held" because samples of it
            wait for more, "delivered" entirely.
        due: when it is tried again without a change, or ``awaits_end`` once it counts as whole.
        base: its progress in the ledger, ``counted`` the verdict under which it is counted already.
        read: its progress as of the last reading, ``read_at``, without samples.
        fed: number of samples taken.
        absent: since when it is missing from the folder.
        outstanding: number of unacknowledged deliveries with samples of it, ``blocks`` of all blocks with such.
        released: whether it was poisoned before, so that a rejection holds its number.
    """

    path: str
    stat: Stat
    order: Order
    seen: float
    changed: float
    closed: bool = False
    whole: bool = False
    phase: Phase = "queued"
    due: float = math.inf
    awaits_end: bool = False
    base: FileProgress | None = None
    counted: str | None = None
    read: FileProgress | None = None
    fed: int = 0
    read_at: float = -math.inf
    absent: float | None = None
    outstanding: int = 0
    blocks: int = 0
    released: bool = False
