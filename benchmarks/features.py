"""The features of a block: milliseconds beside the error they were bought with.

Run as ``python -m benchmarks.features [--quick] [--json FILE]``. Five tables:

1. block in, envelope spectrum out, beside the textbook's way (Butterworth band both ways, Hilbert transform, FFT, in
   float64) on the same float32 block in the same run; errors are those of the first five lines, relative to each,
   against a float64 brick-wall band at the full length. Where noise alone is read, at the places of lines that are not
   there, the aliases of the decimated envelope weigh more; that has its own column;
2. how far the textbook's Butterworth band is from the brick-wall band: a difference of definition, not an error;
3. all features of one block;
4. the amplitude of a unit line anywhere between two bins, nominal speed up to 1.9 % off;
5. how often pure noise is called detected, beside the stated probability.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from benchmarks.common import REFERENCE_MS, Row, Tables, benchmark, calibration_kernel, interleaved_ms
from monitor.health.signal.comb import line_spectrum
from monitor.health.signal.features import FAULTS, FeatureSettings, block_features
from monitor.health.signal.indicators import time_indicators
from monitor.health.signal.lines import FALSE_ALARM, fault_lines
from monitor.health.signal.plans import Precision
from monitor.health.signal.transform import Band, BlockTransform
from reference import features as oracle

BAND: Band = (7000.0, 9000.0)
BPFO = 97.8
FUNDAMENTALS = {"outer": BPFO, "inner": 142.2, "ball": 102.9, "cage": 8.15}
LENGTHS = ((128_000, 25_600.0), (256_000, 51_200.0))
TARGET_RATIO, TARGET_ALL_MS = 12.0, 4.0

Samples = NDArray[np.float32]


def impacts(n: int, rate: float, seed: int, noise: float = 0.2) -> Samples:
    """Impacts at the BPFO with one percent of jitter ring at 8 kHz in noise: what a damaged outer race sounds like."""
    rng = np.random.default_rng(seed)
    x = noise * rng.standard_normal(n)
    t = np.arange(round(0.02 * rate)) / rate
    ring = np.exp(-1500.0 * t) * np.sin(2.0 * np.pi * 8000.0 * t)
    for start in np.arange(0.0, n - 1.1 * t.size, rate / BPFO):
        first = max(0, round(start + 0.01 * rate / BPFO * rng.standard_normal()))
        x[first : first + t.size] += ring
    return x.astype(np.float32)


def textbook(rate: float, n: int) -> Callable[[Samples], NDArray[np.float64]]:
    """Return the usual way from a block to the spectrum of its envelope."""
    sos = signal.butter(4, BAND, "bandpass", fs=rate, output="sos")
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(n) / n)

    def path(x: Samples) -> NDArray[np.float64]:
        envelope = np.abs(signal.hilbert(signal.sosfiltfilt(sos, x)))
        return np.abs(np.fft.rfft((envelope - envelope.mean()) * window)) * (4.0 / n)

    return path


def line_errors(found: NDArray[np.floating], expected: NDArray[np.floating], resolution: float) -> float:
    """Largest relative difference of the first five BPFO lines of two spectra."""
    pairs = [
        (oracle.line_amplitude(found, resolution, h * BPFO), oracle.line_amplitude(expected, resolution, h * BPFO))
        for h in range(1, 6)
    ]
    return max(abs(a / b - 1.0) for a, b in pairs)


VARIANTS: tuple[Precision, ...] = ("float32", "float64")


def planned(n: int, rate: float) -> dict[str, tuple[BlockTransform, float]]:
    """Return the transforms of one length by name, each with the seconds that its planning took."""
    transforms = {}
    for precision in VARIANTS:
        start = time.perf_counter()
        transform = BlockTransform(n, rate, [BAND], raw_limit=0.0, precision=precision)
        transforms[f"one pass, {precision}"] = transform, time.perf_counter() - start
    return transforms


def envelope_rows(n: int, rate: float, quick: bool) -> tuple[list[Row], Row]:
    """The rows of tables 1 and 2 for one length."""
    usual, transforms = textbook(rate, n), planned(n, rate)
    blocks = [impacts(n, rate, seed) for seed in range(2 if quick else 6)]
    paths: dict[str, Callable[[], object]] = {
        "kernel: one rfft of 128,000": calibration_kernel(),
        "textbook, float64": partial(usual, blocks[0]),
    }
    paths |= {name: partial(transform, blocks[0]) for name, (transform, _) in transforms.items()}
    ms = interleaved_ms(paths, 21 if quick else 51)
    noise = np.random.default_rng(9).standard_normal(n).astype(np.float32)
    expected = [oracle.envelope_spectrum(block, rate, BAND)[0] for block in [*blocks, noise]]
    rows: list[Row] = []
    for name, milliseconds in ms.items():
        samples = 128_000 if name.startswith("kernel") else n
        row: dict[str, float | int | str | None] = {"path": name, "samples": samples, "ms": milliseconds}
        row |= dict.fromkeys(("times faster", "error of lines", "error in noise", "planning_s"))
        if name in transforms:
            transform, seconds = transforms[name]
            found = [transform(block).envelopes[0].amplitude for block in [*blocks, noise]]
            errors = [line_errors(f, e, rate / n) for f, e in zip(found, expected, strict=True)]
            row["times faster"] = ms["textbook, float64"] / milliseconds
            row["error of lines"], row["error in noise"], row["planning_s"] = max(errors[:-1]), errors[-1], seconds
        rows.append(row)
    difference = max(line_errors(usual(b), e, rate / n) for b, e in zip(blocks, expected, strict=False))
    return rows, {"band": "Butterworth, order 4, both ways", "samples": n, "difference of lines": difference}


def all_features_table(quick: bool) -> list[Row]:
    """Table 3."""
    rows: list[Row] = []
    for n, rate in LENGTHS:
        settings = FeatureSettings(rate, (BAND,), FUNDAMENTALS)
        x = impacts(n, rate, 0)
        paths = {"kernel": calibration_kernel(), "all": partial(block_features, x, rate, settings)}
        ms = interleaved_ms(paths, 21 if quick else 51)
        features = block_features(x, rate, settings)
        envelope, raw = oracle.envelope_spectrum(x, rate, BAND)[0], oracle.hann_spectrum(x - x.mean(dtype=np.float64))
        lines = features.lines[0]["outer"]
        places = BPFO * lines.speed_factor * np.arange(1, 7)
        expected = [oracle.line_amplitude(envelope, rate / n, f) for f in places[:5]]
        expected_raw = [oracle.line_amplitude(raw, rate / n, f) for f in places]
        exact, found = oracle.indicators(x), time_indicators(x)
        rows.append(
            {
                "features": "all of one block, one band",
                "samples": n,
                "ms": ms["all"],
                "kernel_ms": ms["kernel"],
                "target_ms here": TARGET_ALL_MS * ms["kernel"] / REFERENCE_MS if n == LENGTHS[0][0] else None,
                "error of lines": float(np.max(np.abs(lines.amplitude / expected - 1.0))),
                "error of raw lines": float(np.max(np.abs(features.bpfo_amplitude / expected_raw - 1.0))),
                "error of indicators": max(abs(getattr(found, k) / v - 1.0) for k, v in exact.items() if k != "mean"),
            }
        )
    return rows


def line_table(quick: bool) -> list[Row]:
    """Table 4: in noise of a hundredth of the line, blocks of 5 s, every line of a family of five equal ones."""
    rng = np.random.default_rng(4)
    n, rate, count = 20_000, 4000.0, 60 if quick else 600
    t = np.arange(n) / rate
    errors = []
    for _ in range(count):
        nominal = rng.uniform(60.0, 160.0)
        true = nominal * (1.0 + rng.uniform(-0.019, 0.019))
        x = 0.01 * rng.standard_normal(n)
        for h in range(1, 6):
            x += np.cos(2.0 * np.pi * (h * true * t + rng.uniform()))
        errors.append(fault_lines(line_spectrum(oracle.hann_spectrum(x), rate / n), nominal).amplitude - 1.0)
    flat = np.concatenate(errors)
    worst = float(flat[np.argmax(np.abs(flat))])
    return [{"line": "unit, anywhere", "lines": flat.size, "mean error": float(flat.mean()), "worst error": worst}]


def false_alarm_table(quick: bool) -> list[Row]:
    """Table 5: white noise through the whole way, blocks of one second; four families each."""
    n, rate, count = 25_600, 25_600.0, 1500 if quick else 12_000
    rng = np.random.default_rng(5)
    transform = BlockTransform(n, rate, [BAND], raw_limit=0.0)
    stated = (1e-2, 1e-3, FALSE_ALARM)
    alarms = dict.fromkeys(stated, 0)
    thresholds: dict[tuple[str, float], float] = {}
    for _ in range(count):
        envelope = transform(rng.standard_normal(n, dtype=np.float32)).envelopes[0]
        spectrum = line_spectrum(envelope.amplitude, envelope.resolution)
        for fault in FAULTS:
            find = partial(fault_lines, spectrum, FUNDAMENTALS[fault])
            score = find().score
            for p in stated:
                if (fault, p) not in thresholds:
                    thresholds[fault, p] = find(false_alarm=p).threshold
                alarms[p] += score > thresholds[fault, p]
    spectra = count * len(FAULTS)
    return [{"stated": p, "families of noise": spectra, "detected": k, "rate": k / spectra} for p, k in alarms.items()]


@benchmark("Speed and error of the features of a block.")
def main(quick: bool) -> Tables:
    """Run, print, write."""
    tables = [envelope_rows(n, rate, quick) for n, rate in LENGTHS]
    paths, difference = [row for rows, _ in tables for row in rows], [row for _, row in tables]
    features = all_features_table(quick)
    lines = line_table(quick)
    alarms = false_alarm_table(quick)
    return {
        "envelope_path": paths,
        "butterworth_difference": difference,
        "all_features": features,
        "line_amplitude": lines,
        "false_alarms": alarms,
    }
