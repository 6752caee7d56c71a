"""The spectral coherence of the samples that are kept of a block, for those who look at it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from monitor.health.signal.cyclic import CyclicCoherence, cyclic_coherence
from monitor.health.signal.rotation.rotation import Rotation, constant
from monitor.health.signal.waterfall import SpectrumRow

HARMONICS = 4.2
"""Cyclic frequencies reach beyond the fourth line of the part with the highest first one."""


def kept_coherence(row: SpectrumRow) -> CyclicCoherence:
    """Return the coherence of the waveform of a row with a view, over the demodulated band and orders of the shaft.

    Raises:
        ValueError: the row has no view or no speed, or its waveform is too short.
    """
    if row.view is None or not row.speed > 0.0 or not row.lines:
        raise ValueError("nothing is kept of the samples of this block, or its speed is not known")
    rate, samples = row.view.rate, np.asarray(row.view.waveform, dtype=np.float64)
    duration = samples.size / rate
    rotation = constant(row.speed, duration)
    if row.speed_course is not None:
        rotation = rotation_of_course(row.speed_course, row.view.samples / rate, duration)
    highest = HARMONICS * max(row.lines.values()) / row.speed
    highest = min(highest, 0.25 * rate / rotation.speed_range[1])
    return cyclic_coherence(samples, rate, highest, rotation, row.band)


def rotation_of_course(course: Sequence[float], whole: float, duration: float) -> Rotation:
    """Return the rotation over the beginning of a block.

    Args:
        course: speed at equal steps of the whole block, Hz.
        whole, duration: of the block, and of its beginning, s.
    """
    speed = np.asarray(course, dtype=np.float64)
    step = whole / (speed.size - 1)
    # The trapezoids, and what they lack where the speed is curved.
    slope = np.gradient(speed, step)
    pieces = 0.5 * step * (speed[:-1] + speed[1:]) - step * step / 12.0 * np.diff(slope)
    turns = np.concatenate(([0.0], np.cumsum(pieces)))
    last = min(speed.size, int(np.ceil(duration / step)) + 2)
    time = np.arange(last, dtype=np.float64) * step
    return Rotation(time, turns[:last], speed[:last], duration)
