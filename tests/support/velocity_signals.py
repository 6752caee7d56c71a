"""Accelerations whose velocity from 10 to 1000 Hz is known: tones, sums of lines, coloured noise."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.transform import BlockTransform
from monitor.health.signal.velocity import Velocity

RATE = 25_600.0
BAND = (2000.0, 4000.0)
SECONDS = (1.0, 5.0)
Floats = NDArray[np.float64]


def velocity(x: Floats, rate: float = RATE) -> Velocity:
    """Return the velocity of a block of acceleration, m/s2, as the monitor computes it."""
    return BlockTransform(x.size, rate, [BAND], raw_limit=1.0)(x.astype(np.float32)).velocity


def tone(seconds: float, hertz: float, velocity_rms: float, phase: float = 0.3) -> Floats:
    """Return the acceleration, m/s2, of a tone of a velocity RMS, m/s."""
    t = np.arange(round(seconds * RATE)) / RATE
    return math.sqrt(2.0) * velocity_rms * 2.0 * math.pi * hertz * np.cos(2.0 * math.pi * hertz * t + phase)


def signals(seconds: float) -> list[tuple[str, Floats, float]]:
    """Return names, accelerations and true velocities in the band, m/s."""
    step = 1.0 / seconds
    lines = [(25.0, 2e-3), (50.0, 1e-3), (316.7, 0.5e-3)]
    machine = sum(tone(seconds, f, v) for f, v in lines) + np.zeros(1)
    true = math.hypot(*(v for _, v in lines))
    t = np.arange(machine.size) / RATE
    burst = 300.0 * np.sin(2.0 * math.pi * 6000.0 * t)
    return [
        *((f"tone {f:g} Hz, whole periods", tone(seconds, f, 1e-3), 1e-3) for f in (13.0, 25.0, 100.0, 990.0)),
        *(
            (f"tone {f:g} Hz + {share:g} of a bin", tone(seconds, f + share * step, 1e-3), 1e-3)
            for f in (13.0, 25.0, 160.0)
            for share in (0.25, 0.5)
        ),
        ("three lines", machine, true),
        ("three lines, offset of 100 m/s2", machine + 100.0, true),
        ("three lines, 300 m/s2 at 6 kHz", machine + burst, true),
        ("three lines, ramp of 10 m/s2", machine + 10.0 * t / seconds, true),
        ("three lines, 20 mm/s at 3 Hz", machine + tone(seconds, 3.0, 20e-3), true),
        ("tone of 8 Hz, outside", tone(seconds, 8.0, 1e-3) + machine, true),
        ("tone of 1100 Hz, outside", tone(seconds, 1100.0, 1e-3) + machine, true),
        ("edge: tone of 10 Hz", tone(seconds, 10.0, 1e-3), 1e-3),
        ("edge: tone of 10 Hz + 2 bins", tone(seconds, 10.0 + 2.0 * step, 1e-3), 1e-3),
        ("edge: tone of 1000 Hz", tone(seconds, 1000.0, 1e-3), 1e-3),
    ]


def coloured(seconds: float, power: float, seed: int) -> Floats:
    """Return noise whose power falls with frequency to the ``power``, 0.01 m/s2 per root hertz at 10 Hz."""
    n = round(seconds * RATE)
    random = np.random.default_rng(seed)
    frequency = np.maximum(np.fft.rfftfreq(n, 1.0 / RATE), 0.5 / seconds)
    bins = (random.normal(size=frequency.size) + 1j * random.normal(size=frequency.size)) / math.sqrt(2.0)
    density = 1e-4 * (frequency / 10.0) ** -power
    return np.fft.irfft(bins * np.sqrt(density * 0.5 * RATE * n), n)
