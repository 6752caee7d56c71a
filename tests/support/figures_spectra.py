"""Makers and checks that tests of figures spectra share."""

from __future__ import annotations

import numpy as np

from monitor.health.signal.waterfall import SpectrumRow

KINEMATIC = {"outer": 97.5, "inner": 142.0, "ball": 94.0, "cage": 8.0}


def row_of(sequence: int, time: float | None, height: float = 1.0, bins: int = 900) -> SpectrumRow:
    amplitude = np.full(bins, 0.01)
    amplitude[97] = height
    return SpectrumRow("s", "horizontal", sequence, time, 1.0, (5e3, 9e3), 30.0, 1.0, True, amplitude, KINEMATIC)
