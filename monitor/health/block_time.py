"""The time of a block through the stages: what it states, what is judged of it, and what its record says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from monitor.health.record import Record
from monitor.health.signal.quality import OrderState, check_order
from streams.dates.observed import JudgedTime, TimeObservation
from streams.types.block import Block
from streams.types.times import MIN_TIME, TimeStatement


@dataclass(frozen=True, eq=False)
class TimedBlock:
    """A block at its judged time.

    Attributes:
        block: with start and elapsed time as judged.
        flags: by its place in the stream and its time.
        judged: why, and how surely.
    """

    block: Block
    flags: tuple[str, ...]
    judged: JudgedTime

    @property
    def time(self) -> float | None:
        """Seconds of the first sample, UTC where dated, else since the first block; None where unknown."""
        return self.block.start if self.block.start is not None else self.block.elapsed

    @property
    def values(self) -> dict[str, Any]:
        """Values of a record by variable: the same for every channel."""
        judged = self.judged
        values: dict[str, Any] = {
            "duration": self.block.duration,
            "time_uncertainty_s": judged.uncertainty,
            "time_source": judged.source,
        }
        return values if judged.stated is None else {**values, "time_stated": judged.stated}

    def reason_with(self, reason: str) -> str:
        """Return a reason of the record with why the clock is doubted, in place of the flag of each channel."""
        others = (part for part in reason.split("; ") if not (self.judged.doubt and part.endswith(": clock")))
        return "; ".join(filter(None, (self.judged.doubt, *others)))


def timed(
    state: OrderState, block: Block, now: float | None, latest: float | None = None
) -> tuple[OrderState, TimedBlock]:
    """Check the place of a block in its stream, and judge its time.

    Args:
        now: the present, s UTC, of a live stream, else None.
        latest: a time that no recorded block can have by now, s UTC; None where that is not known.
    """
    seen: TimeObservation | None = None
    if block.start is not None:
        seen = TimeObservation(block.start, block.duration, statement=block.stated)
    elif block.elapsed is not None:
        seen = TimeObservation(block.elapsed, block.duration, dated=False, statement=block.stated)
    elif block.stated is not None and not block.stated.is_stated:
        seen = TimeObservation(0.0, block.duration, statement=block.stated)
    after, flags, judged = check_order(state, block.sequence, seen, now=now, latest=latest)
    is_date = judged.time is not None and judged.time >= MIN_TIME
    if judged.time != block.start and (block.start is not None or is_date):
        elapsed = judged.elapsed
        if block.start is not None and judged.time is not None and block.elapsed is not None:
            elapsed = block.elapsed + judged.time - block.start
        block = replace(block, start=judged.time, elapsed=elapsed)
    return after, TimedBlock(block, flags, judged)


def retimed(state: OrderState, record: Record) -> tuple[OrderState, JudgedTime]:
    """Return the state after a block of which the record is left, and the judged time of the block.

    Where other files, other witnesses or the clock of that day have decided, the record is taken as it is.
    """
    channels = list(record.channels.values())
    values: Mapping[str, Any] = channels[0] if channels else {}
    length, dated = values.get("duration") or 0.0, record.time is not None or values.get("time_stated") is not None
    time = record.time if dated else record.elapsed
    stated = values.get("time_stated")
    stated = time if stated is None else stated
    if stated is None:
        after, _, judged = check_order(state, record.sequence, None)
        return after, judged
    seen = TimeObservation(stated, length, dated)
    after, flags, judged = check_order(state, record.sequence, seen)
    if "clock" not in record.flags:
        return after, replace(judged, time=time, holds=True)
    if judged.time == time and {"clock", "late"} & set(flags):
        return after, judged
    placed_s = 0.0 if time is None else time - stated
    statement = TimeStatement(
        values.get("time_source") or "order", placed_s=placed_s, margin_s=values.get("time_uncertainty_s") or 0.0
    )
    after, _, judged = check_order(state, record.sequence, replace(seen, statement=statement))
    return after, judged
