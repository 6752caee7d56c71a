"""What a block states of its time, what is judged of it, and what is known of the clock between two blocks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from streams.types.stamps import resolution_of
from streams.types.times import TimeSource, TimeStatement


@dataclass(frozen=True)
class ClockState:
    """What is known of the clock of one source between two blocks; times in s since 1970 UTC.

    Attributes:
        time: start of the latest block whose time is believed, or None; seconds from the first block of undated ones.
        length: of that block, s.
        interval: usual one from block to block, s, or None before the second.
        before: start of the block before that, where it was believed too, else None.
        jumped: time before the latest jump ahead, the first one behind it, and the blocks since; None without one.
        began: first time that was believed of the clock as it is set now.
        believed: number of blocks believed since.
        stated: what the latest block stated, where it was doubted, else None; ``given`` the time that it got.
        doubted: blocks doubted since ``time``; ``steady`` those of them that went on from the one before.
        may_hold: whether the doubted clock may be one that was set.
        unset: s since the first block by a clock that was never set, before any time is believed.
        run_began, run_counted: start of the blocks that follow each other without a gap, and their samples in s.
        drift: s by which the clock was ahead at the end of the longest of such runs, and the length of that, s.
        lags: of other witnesses of time against the stated start, s, and how much they scattered, by source.
    """

    time: float | None = None
    length: float = 0.0
    interval: float | None = None
    before: float | None = None
    jumped: tuple[float, float, int] | None = None
    began: float | None = None
    believed: int = 0
    stated: float | None = None
    given: float | None = None
    doubted: int = 0
    steady: int = 0
    may_hold: bool = False
    unset: float = 0.0
    run_began: float | None = None
    run_counted: float = 0.0
    drift: tuple[float, float] | None = None
    lags: Mapping[str, tuple[float, float | None]] = field(default_factory=dict[str, tuple[float, float | None]])


@dataclass(frozen=True)
class TimeObservation:
    """What a block states of its time.

    Attributes:
        time: stated start, s since 1970 UTC where ``dated``, else from the first block of the source.
        length: s.
        statement: None where nothing is known but the number.
        in_order: whether the block before has the number before; False behind a gap.
    """

    time: float
    length: float = 0.0
    dated: bool = True
    statement: TimeStatement | None = None
    in_order: bool = True

    @property
    def source(self) -> TimeSource:
        """What states the time."""
        if self.statement is not None:
            return self.statement.source
        return "source" if self.dated else "count"

    @property
    def resolution(self) -> float | None:
        """Of the statement, s; None where nothing says how exact it is."""
        if not self.dated:
            return None
        return resolution_of(self.time) if self.statement is None else self.statement.resolution


@dataclass(frozen=True)
class JudgedTime:
    """The time of a block.

    Attributes:
        time: s as in the observation; None where nothing tells it.
        uncertainty: half-width of the interval in which it lies, s; None where not known.
        source: what it comes from, None where there is no time.
        doubt: why the clock is doubted, "" where it is not.
        gap: whether more time has passed than usual.
        stated: what the block states, where that is not its time.
        holds: whether its difference to the time of the block before may be used.
        advance: s since the latest block of which that holds, where the difference of the times is another one.
        elapsed: s since the first block, where that is all that a clock tells which was never set; else None.
    """

    time: float | None
    uncertainty: float | None = None
    source: TimeSource | None = None
    doubt: str = ""
    gap: bool = False
    stated: float | None = None
    holds: bool = True
    advance: float | None = None
    elapsed: float | None = None


UNKNOWN_TIME = JudgedTime(None)
"""Of a block that states none."""
