"""Velocity RMS from 10 to 1000 Hz: its error against analytic signals, what is refused, and its cost.

Run as ``python -m benchmarks.velocity [--quick] [--json FILE]``. Three tables:

1. signals whose velocity is known, in blocks of 1 s (resolution 1 Hz) and 5 s (0.2 Hz) at 25,600 Hz: tones on bins and
   between them, with an offset, with strong acceleration outside the band, at the edges of the band; drift;
2. noise of the sensor: how often it is refused, the velocity that stands otherwise, and its continuous part, over many
   seeds. Flicker noise, a step and a slow ramp are noise; white noise and lines are not refused;
3. milliseconds of one block of 128,000 samples: the velocity, and the raw spectrum that is kept to be looked at; bytes
   of what is kept with the beginning of the waveform.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import (
    REFERENCE_MS,
    Row,
    arguments,
    calibration_kernel,
    interleaved_ms,
    print_table,
    write_json,
)
from monitor.health.signal.block_view import WAVEFORM_SAMPLES, BlockView, raw_spectra
from monitor.health.signal.transform import BlockTransform
from monitor.health.signal.velocity import Velocity, velocity_of
from monitor.records.spectra import pack_view

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


def errors() -> list[Row]:
    """Return relative errors, percent."""
    rows: list[Row] = []
    by_length = [signals(seconds) for seconds in SECONDS]
    for cases in zip(*by_length, strict=True):
        row: dict[str, float | str | None] = {"signal": cases[0][0], "true_mm_s": 1e3 * cases[0][2]}
        for seconds, (_, x, true) in zip(SECONDS, cases, strict=True):
            found = velocity(x)
            row[f"error_{seconds:g}_s_percent"] = None if found.rms is None else 100.0 * (found.rms / true - 1.0)
            row[f"status_{seconds:g}_s"] = found.status
        rows.append(row)
    return rows


def coloured(seconds: float, power: float, seed: int) -> Floats:
    """Return noise whose power falls with frequency to the ``power``, 0.01 m/s2 per root hertz at 10 Hz."""
    n = round(seconds * RATE)
    random = np.random.default_rng(seed)
    frequency = np.maximum(np.fft.rfftfreq(n, 1.0 / RATE), 0.5 / seconds)
    bins = (random.normal(size=frequency.size) + 1j * random.normal(size=frequency.size)) / math.sqrt(2.0)
    density = 1e-4 * (frequency / 10.0) ** -power
    return np.fft.irfft(bins * np.sqrt(density * 0.5 * RATE * n), n)


def noises(seeds: int) -> list[Row]:
    """Return what is said of noise of the sensor, alone and beside a machine."""
    rows: list[Row] = []
    for seconds in SECONDS:
        n = round(seconds * RATE)
        step = np.where(np.arange(n) < 0.4 * n, 0.0, 5.0)
        quiet, loud = tone(seconds, 25.0, 0.2e-3), tone(seconds, 25.0, 4e-3)
        cases = {
            "white": lambda seed, s=seconds: coloured(s, 0.0, seed),
            "1/f": lambda seed, s=seconds: coloured(s, 1.0, seed),
            "1/f2": lambda seed, s=seconds: coloured(s, 2.0, seed),
            "step of 5 m/s2": lambda seed, s=seconds, add=step: coloured(s, 0.0, seed) + add,
            "white and 4 mm/s": lambda seed, s=seconds, add=loud: coloured(s, 0.0, seed) + add,
            "1/f and 0.2 mm/s": lambda seed, s=seconds, add=quiet: coloured(s, 1.0, seed) + add,
            "1/f and 4 mm/s": lambda seed, s=seconds, add=loud: coloured(s, 1.0, seed) + add,
        }
        for name, make in cases.items():
            found = [velocity(make(seed)) for seed in range(seeds)]
            kept = [v for v in found if v.rms is not None and v.floor is not None]
            rows.append(
                {
                    "noise": name,
                    "seconds": seconds,
                    "blocks": seeds,
                    "refused_percent": 100.0 * (1.0 - len(kept) / seeds),
                    "velocity_mm_s": 1e3 * float(np.median([v.rms or 0.0 for v in kept])) if kept else None,
                    "floor_mm_s": 1e3 * float(np.median([v.floor or 0.0 for v in kept])) if kept else None,
                }
            )
    return rows


def cost(rounds: int) -> list[Row]:
    """Return milliseconds for a block of 128,000 samples, beside the calibration kernel, and bytes of its view."""
    x = np.random.default_rng(1).normal(size=128_000).astype(np.float32)
    spectrum = np.asarray(np.fft.rfft(x), dtype=np.complex64)
    times = interleaved_ms(
        {
            "kernel": calibration_kernel(),
            "velocity": lambda: velocity_of(spectrum, x.size, RATE),
            "raw": lambda: raw_spectra(spectrum, x.size, RATE),
        },
        rounds,
    )
    _, packed = pack_view(BlockView(RATE, x.size, raw_spectra(spectrum, x.size, RATE), x[:WAVEFORM_SAMPLES]))
    return [
        {
            "kernel_ms": times["kernel"],
            "velocity_ms": times["velocity"],
            "velocity_ms_at_reference": times["velocity"] * REFERENCE_MS / times["kernel"],
            "raw_spectrum_ms": times["raw"],
            "raw_spectrum_ms_at_reference": times["raw"] * REFERENCE_MS / times["kernel"],
            "view_bytes": len(packed),
        }
    ]


def main() -> None:
    """Print the tables."""
    given = arguments(__doc__ or "")
    tables = {
        "errors": errors(),
        "noise": noises(20 if given.quick else 200),
        "cost": cost(50 if given.quick else 400),
    }
    for name, rows in tables.items():
        print_table(name, rows)
    write_json(given.json, tables)


if __name__ == "__main__":
    main()
