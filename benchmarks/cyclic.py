"""Spectral coherence beside the envelope spectrum: how weak a fault of the inner race may be where the speed hunts.

    python -m benchmarks.cyclic [--quick] [--json FILE]

Blocks of 5 s at 25.6 kHz, hunting by 10 % about 25 Hz: lines of the shaft, impacts that ring a resonance, white noise.
The statistic of each method is the mean over the first three lines of the inner race of the highest value within 2 %,
over the median of the spectrum; its threshold is what 5 % of blocks without a fault exceed. Figures: share of blocks
with a fault beyond it, by the power of the fault over that of the noise. Also: the share of blocks of white noise that
exceed the stated limit, 1 %; and thread time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import REFERENCE_MS, arguments, calibration_kernel, interleaved_ms, print_table, write_json
from benchmarks.ridge_signals import BEARING, RATE, SECONDS, Array, impacts_of, ringing, rotation_of
from models.machine.bearing import kinematics
from monitor.health.signal.cyclic import FALSE_ALARM, cyclic_coherence
from monitor.health.signal.kurtogram import kurtogram
from monitor.health.signal.rotation.rotation import Rotation
from monitor.health.signal.transform import BlockTransform

LINES, NEAR = 3, 0.02
THRESHOLD_SHARE = 0.05
RATIOS = (-8.0, -11.0, -14.0, -17.0, -20.0, -23.0)
HIGHEST = 24.0
SEED = 33_011
Spectrum = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Orders, and values there."""


def block_of(ratio: float | None, trial: int) -> tuple[Array, Rotation]:
    """Return a block with a fault of so many dB below the noise, or without a fault, and its rotation."""
    rng = np.random.default_rng([SEED, trial, 0 if ratio is None else round(100 - ratio)])
    rotation = rotation_of("hunting 10 %", rng)
    turns = rotation.turns_at(np.arange(int(RATE * SECONDS)) / RATE)
    signal = rng.standard_normal(turns.size)
    for order in (1, 2, 3):
        signal += 0.3 * np.cos(2.0 * np.pi * (order * turns + rng.uniform()))
    if ratio is not None:
        hits = impacts_of(rotation, "inner", 1.0 - rng.uniform(0.0, 0.01), 0.01, 0.0, rng)
        rung = np.convolve(hits, ringing(rng.uniform(0.12, 0.35) * RATE, 0.03))[: turns.size]
        signal += 10.0 ** (ratio / 20.0) * rung / rung.std()
    return signal, rotation


def coherence_over_orders(samples: Array, rotation: Rotation) -> Spectrum:
    """Return the enhanced envelope spectrum along the angle."""
    found = cyclic_coherence(samples, RATE, HIGHEST, rotation)
    return found.cyclic, found.enhanced


def coherence_over_time(samples: Array, rotation: Rotation) -> Spectrum:
    """Return the enhanced envelope spectrum over time, in orders of the mean speed."""
    found = cyclic_coherence(samples, RATE, HIGHEST * rotation.mean_speed)
    return found.cyclic / rotation.mean_speed, found.enhanced


def envelope_over_orders(samples: Array, rotation: Rotation, *, banded: bool = False) -> Spectrum:
    """Return the power of the envelope spectrum along the angle, of the whole range or of the kurtogram's band."""
    band = (0.05 * RATE, 0.45 * RATE)
    if banded:
        gram = kurtogram(samples, RATE)
        best = None if gram is None else gram.best()
        if gram is not None and best is not None:
            low, high = gram.band(*best)
            band = (max(low, 200.0), min(high, 0.49 * RATE))
            if band[1] - band[0] < 2.0 * HIGHEST * rotation.mean_speed:
                middle = min(max(0.5 * (band[0] + band[1]), 900.0), 0.49 * RATE - 700.0)
                band = (middle - 700.0, middle + 700.0)
    transform = BlockTransform(samples.size, RATE, (band,), raw_limit=200.0, envelope_limit=HIGHEST * 30.0)
    found = transform(samples, rotation=rotation).envelopes[0]
    kept = found.frequency <= HIGHEST * rotation.mean_speed
    return found.frequency[kept] / rotation.mean_speed, np.square(found.amplitude[kept], dtype=np.float64)


def in_band_of_kurtogram(samples: Array, rotation: Rotation) -> Spectrum:
    """Return the envelope spectrum along the angle in the band that the kurtogram finds."""
    return envelope_over_orders(samples, rotation, banded=True)


METHODS: dict[str, Callable[[Array, Rotation], Spectrum]] = {
    "coherence over orders": coherence_over_orders,
    "coherence over time": coherence_over_time,
    "envelope over orders, all frequencies": envelope_over_orders,
    "envelope over orders, kurtogram": in_band_of_kurtogram,
}


def statistic(spectrum: Spectrum) -> float:
    """Return how high the lines of the inner race stand over the median."""
    order, values = spectrum
    first = kinematics(BEARING, 1.0).bpfi
    tops = [values[np.abs(order / (k * first) - 1.0) <= NEAR].max() for k in range(1, LINES + 1)]
    return float(np.mean(tops) / np.median(values[order > 0.5]))


def sensitivity(healthy: int, faulty: int) -> list[dict[str, Any]]:
    """Return the share of blocks with a fault beyond the threshold, by method and ratio."""
    without = [block_of(None, trial) for trial in range(healthy)]
    thresholds = {
        name: float(np.quantile([statistic(method(*block)) for block in without], 1.0 - THRESHOLD_SHARE))
        for name, method in METHODS.items()
    }
    table: list[dict[str, Any]] = []
    for ratio in RATIOS:
        blocks = [block_of(ratio, trial) for trial in range(faulty)]
        row: dict[str, Any] = {"fault_over_noise_db": ratio}
        for name, method in METHODS.items():
            beyond = [statistic(method(*block)) > thresholds[name] for block in blocks]
            row[name] = 100.0 * float(np.mean(beyond))
        table.append(row)
    return table


def false_alarms(count: int) -> dict[str, Any]:
    """Return the share of blocks of white noise that exceed the stated limit anywhere."""
    exceeded = 0
    for trial in range(count):
        rng = np.random.default_rng([SEED, 8, trial])
        rotation = rotation_of("hunting 10 %", rng)
        found = cyclic_coherence(rng.standard_normal(int(RATE * SECONDS)), RATE, HIGHEST, rotation)
        exceeded += bool(np.any(found.enhanced > found.limit))
    return {"blocks": count, "exceeded": exceeded, "stated_percent": 100.0 * FALSE_ALARM}


def closed_form() -> list[dict[str, Any]]:
    """Return the mean coherence of modulated noise beside its closed form."""
    table: list[dict[str, Any]] = []
    for depth, order in ((0.3, 5.39), (0.6, 10.0), (0.9, 21.7)):
        rng = np.random.default_rng([SEED, 9])
        rotation = rotation_of("hunting 20 %", rng)
        turns = rotation.turns_at(np.arange(int(RATE * SECONDS)) / RATE)
        signal = (1.0 + depth * np.cos(2.0 * np.pi * order * turns)) * rng.standard_normal(turns.size)
        found = cyclic_coherence(signal, RATE, HIGHEST, rotation)
        near = np.abs(found.cyclic - order) < 2.0 / rotation.turned
        exact = (depth / (1.0 + 0.5 * depth**2)) ** 2
        table.append({"depth": depth, "order": order, "found": float(found.enhanced[near].max()), "exact": exact})
    return table


def times() -> dict[str, Any]:
    """Return thread times of a block of 128,000 samples."""
    samples, rotation = block_of(-11.0, 0)
    found = {name: (lambda method=method: method(samples, rotation)) for name, method in METHODS.items()}
    ms = interleaved_ms({**found, "kernel": calibration_kernel()}, 5)
    return {**{f"{name} ms": value for name, value in ms.items()}, "scale": REFERENCE_MS / ms["kernel"]}


def main() -> None:
    """Print the tables."""
    options = arguments(__doc__ or "")
    few = options.quick
    tables: dict[str, Any] = {
        "closed form": closed_form(),
        "share of faults beyond the threshold, percent": sensitivity(20 if few else 100, 5 if few else 25),
        "white noise": [false_alarms(5 if few else 100)],
        "times": [times()],
    }
    for title, rows in tables.items():
        print_table(title, rows)
    write_json(options.json, tables)


if __name__ == "__main__":
    main()
