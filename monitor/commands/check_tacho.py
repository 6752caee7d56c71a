"""What ``check`` says of the tacho of a source: pulses and speeds of its first block."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from monitor.config.load import Config
from monitor.config.source import SourceSection
from monitor.words.numbers import count

if TYPE_CHECKING:
    from streams.types.block import Block


@dataclass(frozen=True)
class TachoView:
    """The pulses of one block.

    Attributes:
        file: name of the block.
        status: "ok", or why the block has no angle, as in its record.
        pulses: that came.
        per_revolution: pulses of a whole turn, as they are counted.
        missing: pulses, by the repair, ``extra`` those that are too many.
        speed_min_hz: least speed of the shaft, ``speed_max_hz`` the highest; None without an angle.
    """

    file: str
    status: str
    pulses: int
    per_revolution: int
    missing: int
    extra: int
    speed_min_hz: float | None
    speed_max_hz: float | None


def tacho_view(block: Block, config: Config, section: SourceSection) -> TachoView | None:
    """Return what the tacho of a source shows in a block; None where none is configured, and none comes with it."""
    from monitor.health.signal.rotation.found import find_rotation
    from streams.turns.tacho import edge_times

    condition = config.operating.to_condition(pulses=section.pulses is not None)
    tacho = condition.tacho
    if block.pulses is None and tacho.channel is None and not tacho.of_source:
        return None
    found = find_rotation(block, condition)
    seen = 0 if block.pulses is None else block.pulses.times.size
    if block.pulses is None and tacho.channel in block.channels:
        row = block.samples[block.channels.index(tacho.channel)]
        seen = edge_times(row, block.rate, tacho.level, falling=tacho.edge == "falling").size
    stated = block.pulses_per_revolution if block.pulses is None else block.pulses.per_revolution
    speeds = (None, None) if found.rotation is None else found.rotation.speed_range
    return TachoView(
        file=block.name,
        status=found.status or "none",
        pulses=int(seen),
        per_revolution=stated or tacho.per_revolution,
        missing=0 if found.pulses is None else found.pulses.missing,
        extra=0 if found.pulses is None else found.pulses.extra,
        speed_min_hz=speeds[0],
        speed_max_hz=speeds[1],
    )


def tacho_words(view: TachoView) -> str:
    """Return the same as a line."""
    words = f"tacho: {count(view.pulses, 'pulse')} in {view.file}, {view.per_revolution} a revolution"
    if view.speed_min_hz is not None and view.speed_max_hz is not None:
        words += f": {view.speed_min_hz:.4g} to {view.speed_max_hz:.4g} Hz"
    else:
        words += f": no angle ({view.status})"
    return f"{words}; {view.missing} missing, {view.extra} too many"


def tacho_problem(view: TachoView) -> str | None:
    """Return in words that the tacho gives no angle, None where it does."""
    if view.status == "ok":
        return None
    return f"its tacho gives no angle in {view.file} ({view.pulses} pulses): rotation_status {view.status}"
