"""A winch that hunts by 15 % within each block about a mean speed that wanders from 17 to 28 Hz, with a tacho.

The outer race of its bearing becomes damaged; for three blocks, the tacho is disturbed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from reference.signals import bearing_lines

RATE, SECONDS, BLOCKS = 12_800, 4.0, 150
FIRST_BAD, DISTURBED = 95, range(60, 63)
PULSES, DESIGNATION = 8, "6310"
INTERVAL_S = 120.0
TEXT = """
[machine]
name = "winch-02"
timezone = "Europe/Rome"
spectra_interval_s = 60
state_dir = "{folder}/winch-02/state"
records_dir = "{folder}/winch-02/records"
[[source]]
name = "logger"
url = "folder:{folder}/in"
rate_hz = {rate}
block_s = "file"
start_utc = "{begin}"
time_from = "count"
interval_s = {interval}
settle_s = 0.1
[operating]
speed_hz = 22.5
tacho_channel = 3
pulses_per_revolution = {pulses}
[detect]
learn_blocks = 40
run_in_blocks = 10
[[bearing]]
name = "drum"
designation = "{designation}"
[[channel]]
name = "radial"
source = "logger"
column = 1
unit = "m/s2"
bearing = "drum"
[[channel]]
name = "axial"
source = "logger"
column = 2
unit = "m/s2"
bearing = "drum"
"""


def turns_of(number: int, generator: np.random.Generator) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return angle (revolutions) and speed (Hz) at each sample of a block, both shape (sample,)."""
    at = np.arange(round(RATE * SECONDS)) / RATE
    mean = 22.5 + 4.5 * np.sin(2.0 * np.pi * number / 53.0) + 1.0 * np.sin(2.0 * np.pi * number / 17.0)
    swing, turn = 0.15 * generator.uniform(0.8, 1.2), generator.uniform(0.0, 2.0 * np.pi)
    slow = 2.0 * np.pi * generator.uniform(0.25, 0.45)
    speed = mean * (1.0 + swing * np.sin(slow * at + turn))
    angle = mean * (at - swing / slow * (np.cos(slow * at + turn) - np.cos(turn)))
    return angle + generator.uniform(0.0, 1.0), speed


def block(number: int) -> NDArray[np.float32]:
    """Return two sensors and the tacho of a block, shape (sample, 3): m/s2 and V."""
    generator = np.random.default_rng(1000 + number)
    angle, speed = turns_of(number, generator)
    _, lines = bearing_lines(DESIGNATION, 1.0)
    level = (speed / 22.5) ** 1.2
    x = level * generator.normal(0.0, 1.2, angle.size)
    for order, height in ((1.0, 0.8), (2.0, 0.4), (7.0, 0.3)):
        x += height * level * np.cos(2.0 * np.pi * order * angle + order)
    if number >= FIRST_BAD:
        x += (1.5 + 0.10 * (number - FIRST_BAD)) * _impacts(angle, speed, lines.bpfo, generator)
    y = 0.5 * x + 0.6 * generator.normal(size=x.size)
    edges = np.mod(angle * PULSES, 1.0) < 0.3
    tacho = 5.0 * edges + generator.normal(0.0, 0.05, x.size)
    if number in DISTURBED:
        tacho = generator.normal(0.0, 2.0, x.size)
    return np.stack([x, y, tacho], axis=1).astype(np.float32)


def _impacts(
    angle: NDArray[np.float64], speed: NDArray[np.float64], order: float, generator: np.random.Generator
) -> NDArray[np.float64]:
    """Return ringing once a passage of an element, with slip; shape (sample,)."""
    wanted = np.arange(np.ceil(angle[0] * order), angle[-1] * order) / order
    wanted = wanted + generator.normal(0.0, 0.01 / order, wanted.size)
    places = np.searchsorted(angle, wanted)
    places = places[(places > 0) & (places < angle.size)]
    train = np.zeros(angle.size)
    train[places] = (speed[places] / 22.5) ** 1.2 * generator.uniform(0.8, 1.2, places.size)
    at = np.arange(round(0.006 * RATE)) / RATE
    return np.convolve(train, 8.0 * np.exp(-at / 8e-4) * np.sin(2.0 * np.pi * 3200.0 * at))[: angle.size]
