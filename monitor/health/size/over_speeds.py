"""The map of a block within which the speed varies: mean squares over its speeds.

The speed is taken to be below its mean for half of the block and above it for the other half, evenly in each: the map
is looked up at five speeds and averaged by Simpson's rule. Where one of them is outside the map, so is the block.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from monitor.health.size import DamageInput, EdvStatus
from monitor.health.size.level_set import LevelMap

if TYPE_CHECKING:
    from models.maps.data import MapSlice

Slice = TypeVar("Slice", "LevelMap", "MapSlice")
Lookup = Callable[[float | None, float | None], "tuple[Slice | None, EdvStatus | None]"]

MIN_RANGE = 0.01
"""Range of the speed over its mean below which a block has one speed."""
_WEIGHTS = np.array((1.0, 4.0, 2.0, 4.0, 1.0)) / 12.0
_SQUARED = ("rms", "harmonic_amplitude")
_LINEAR = ("rms_error", "rms_std", "harmonic_std", "rms_rig_std", "harmonic_rig_std")


def map_of_block(lookup: Lookup[Slice], block: DamageInput) -> tuple[Slice | None, EdvStatus | None]:
    """Return the map at the load and over the speeds of a block, or the status that says why there is none."""
    speeds = speeds_of(block)
    if not speeds:
        return lookup(block.load, block.speed)
    slices: list[Slice] = []
    for speed in speeds:
        found, refused = lookup(block.load, speed)
        if found is None:
            return None, refused
        slices.append(found)
    return _mean(slices), None


def speeds_of(block: DamageInput) -> tuple[float, ...]:
    """Return the five speeds of a block that varies, Hz; () of one that turns at one speed."""
    if block.speed is None or block.speed_range is None:
        return ()
    low, high = block.speed_range
    if high - low < MIN_RANGE * block.speed:
        return ()
    return low, 0.5 * (low + block.speed), block.speed, 0.5 * (block.speed + high), high


def _mean(slices: list[Slice]) -> Slice:
    def of(name: str, *, squared: bool) -> NDArray[np.float64]:
        values = np.stack([getattr(one, name) for one in slices])
        mean = np.tensordot(_WEIGHTS, np.square(values) if squared else values, axes=1)
        return np.asarray(np.sqrt(mean) if squared else mean, dtype=np.float64)

    middle = slices[2]
    if isinstance(middle, LevelMap):
        return replace(middle, rms=of("rms", squared=True))
    changed = {name: of(name, squared=name in _SQUARED) for name in (*_SQUARED, *_LINEAR)}
    return replace(middle, **changed)
