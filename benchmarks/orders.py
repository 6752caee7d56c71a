"""Order spectra against closed forms, beside SciPy's ways to resample, with times.

Run as ``python -m benchmarks.orders [--quick] [--json FILE]``. Five tables:

1. one signal of 40,000 samples at 8 kHz (the envelope of a band of 2 kHz in a block of 5 s) to its order spectrum, by
   this program and by four textbook ways that take so many steps of angle that nothing folds: linear interpolation,
   cubic splines, both after ``scipy.signal.resample_poly`` to eight times the rate. The signal is a line of constant
   order, up to 0.4 of the sampling order (samples over the angle in a revolution): largest error of its bins, and what
   it leaves elsewhere below that order. Then a tone of fixed frequency, against an integral by 16 times the points.
   Profiles: one speed, hunting by 10 and 20 %, a run-up from 10 to 40 Hz;
2. lines beyond what is read: how much of them folds below it;
3. the same by ``order_spectrum`` at the full rate of 25.6 kHz, up to 0.4 of the least number of samples a revolution;
4. aliases of the decimated envelope: a block with impacts through the whole transform, at four samples a bin of the
   band (as blocks are) and at eight, against 64; at one speed over time, else over the angle;
5. thread time of a block of 128,000 samples with and without the angle, and figures of one speed by both.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import resample_poly

from benchmarks.common import (
    REFERENCE_MS,
    Row,
    arguments,
    calibration_kernel,
    interleaved_ms,
    print_table,
    write_json,
)
from models.machine.bearing import kinematics
from monitor.health.signal.features import FAULTS, FeatureSettings, block_features, fundamentals
from monitor.health.signal.interference import Interference, all_combs
from monitor.health.signal.orders import SAMPLING_RATIO, Warp, order_amplitude, order_spectrum, warp_of
from monitor.health.signal.rotation.rotation import Rotation, constant
from monitor.health.signal.transform import BlockTransform
from tests.support.signals import bearing_lines, impacts

DURATION, SPEED = 5.0, 25.0
RATE, LIMIT = 8000.0, 1200.0
FULL_RATE = 25_600.0
BAND = (7000.0, 9000.0)
TARGET_ERROR, TARGET_ALIAS_DB, TARGET_MS = 1e-3, -80.0, 3.0
RESAMPLED = 8
BESIDE_BINS = 64
SEED = 20

Array = NDArray[np.floating]
Method = Callable[[Array, Rotation], tuple[Array, float]]
"""Amplitudes up to ``LIMIT`` at the mean speed, and their spacing, Hz."""


def hunting(depth: float, frequency: float = 0.4, speed: float = SPEED) -> Rotation:
    """Return a speed that swings about its mean; the cubic between 64 knots a second follows it to a nanosecond."""
    time = np.linspace(0.0, DURATION, round(64 * DURATION) + 1)
    phase = 2.0 * np.pi * frequency * time
    turns = speed * (time + depth * (1.0 - np.cos(phase)) / (2.0 * np.pi * frequency))
    return Rotation(time, turns, speed * (1.0 + depth * np.sin(phase)), DURATION)


def run_up(begin: float, end: float) -> Rotation:
    """Return a speed that rises linearly."""
    turns = np.array([0.0, 0.5 * (begin + end) * DURATION])
    return Rotation(np.array([0.0, DURATION]), turns, np.array([begin, end]), DURATION)


PROFILES: Mapping[str, Rotation] = {
    "one speed": constant(SPEED, DURATION),
    "±10 %": hunting(0.1),
    "±20 %": hunting(0.2, 1.0),
    "10 to 40 Hz": run_up(10.0, 40.0),
}


def line(order: float, turn: float, rotation: Rotation, rate: float) -> Array:
    """Return a line of unit amplitude and constant order."""
    return np.cos(2.0 * np.pi * (order * rotation.turns_at(np.arange(round(rate * DURATION)) / rate) + turn))


def hann_line(distance: Array) -> Array:
    """Return what a unit line reads so many bins away."""
    return np.abs(np.sinc(distance) + 0.5 * (np.sinc(distance - 1.0) + np.sinc(distance + 1.0)))


def of_angle(samples: Array, resolution: float) -> tuple[Array, float]:
    """Return the amplitudes of samples at equal steps of angle, Hann-windowed, up to ``LIMIT``."""
    hann = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(samples.size) / samples.size)
    found = np.abs(np.fft.rfft((samples - samples.mean()) * hann)) * (4.0 / samples.size)
    return found[: math.floor(LIMIT / resolution) + 1], resolution


def ours(signal: Array, rotation: Rotation, precision: str = "float64") -> tuple[Array, float]:
    """Return the spectrum as a block's is made, the times of the angle included."""
    warp_of.cache_clear()
    warp = _warp(rotation)
    bins = np.fft.rfft(signal).astype("complex64" if precision == "float32" else "complex128")
    return order_amplitude(bins[:-1], signal.size, warp, LIMIT)[0], warp.resolution


def textbook(signal: Array, rotation: Rotation, *, cubic: bool, resampled: int) -> tuple[Array, float]:
    """Return the spectrum of interpolated samples, at so many steps of angle that nothing folds below the limit."""
    low, _ = rotation.speed_range
    count = 2 * math.ceil(RATE * DURATION * rotation.mean_speed / low / 2.0)
    times = rotation.time_at(rotation.turned * np.arange(count) / count)
    finer = resample_poly(signal, resampled, 1) if resampled > 1 else signal
    at = np.arange(finer.size) / (RATE * resampled)
    samples = CubicSpline(at, finer)(times) if cubic else np.interp(times, at, finer)
    return of_angle(samples, rotation.mean_speed / rotation.turned)


METHODS: Mapping[str, Method] = {
    "spallwatch, float32": partial(ours, precision="float32"),
    "spallwatch, float64": ours,
    "linear": partial(textbook, cubic=False, resampled=1),
    "cubic spline": partial(textbook, cubic=True, resampled=1),
    f"resample_poly x{RESAMPLED}, linear": partial(textbook, cubic=False, resampled=RESAMPLED),
    f"resample_poly x{RESAMPLED}, cubic": partial(textbook, cubic=True, resampled=RESAMPLED),
}


def line_errors(found: Array, spacing: float, place: float) -> tuple[float, float]:
    """Return the error of the bins of a unit line at a place in Hz, and the highest bin elsewhere."""
    distance = np.arange(found.size) - place / spacing
    near, far = np.abs(distance) < 4.0, np.abs(distance) > BESIDE_BINS
    far[:2] = False
    expected = hann_line(distance)
    # A Hann window by itself leaves up to 2e-6 of a line beyond 64 bins; it is taken off where it is expected.
    left = np.abs(found[far]) - expected[far]
    return float(np.abs(found[near] - expected[near]).max()), float(left.max())


def fixed_tone(frequency: float, rotation: Rotation, bins: int) -> Array:
    """Return the order spectrum of a tone of fixed frequency by quadrature: 16 times the least number of points."""
    low, _ = rotation.speed_range
    count = 1 << math.ceil(math.log2(16.0 * RATE * DURATION * rotation.mean_speed / low / 2.0))
    samples = np.cos(2.0 * np.pi * frequency * rotation.time_at(rotation.turned * np.arange(count) / count))
    return of_angle(samples, rotation.mean_speed / rotation.turned)[0][:bins]


def accuracy_table(quick: bool) -> list[Row]:
    """Table 1."""
    rng = np.random.default_rng(SEED)
    rows: list[Row] = []
    for profile, rotation in PROFILES.items():
        mean = rotation.mean_speed
        lines = [(rng.uniform(0.02, 0.99) * LIMIT / mean, rng.uniform()) for _ in range(6 if quick else 40)]
        lines.append((0.995 * LIMIT / mean, 0.2))
        tones = [0.3 * LIMIT, 0.8 * LIMIT, 2.2 * LIMIT, 0.45 * RATE][:: 2 if quick else 1]
        exact = {tone: fixed_tone(tone, rotation, math.floor(LIMIT * rotation.turned / mean) + 1) for tone in tones}
        at = np.arange(round(RATE * DURATION)) / RATE
        ms = interleaved_ms(
            {name: partial(method, line(3.0, 0.0, rotation, RATE), rotation) for name, method in METHODS.items()},
            5 if quick else 15,
        )
        for name, method in METHODS.items():
            errors = [
                line_errors(*method(line(order, turn, rotation, RATE), rotation), order * mean) for order, turn in lines
            ]
            chirps = [
                float(np.abs(method(np.cos(2.0 * np.pi * tone * at), rotation)[0][2 : known.size] - known[2:]).max())
                for tone, known in exact.items()
            ]
            rows.append(
                {
                    "speed": profile,
                    "method": name,
                    "error of a line": max(error for error, _ in errors),
                    "elsewhere_db": decibel(max(left for _, left in errors)),
                    "fixed tone_db": decibel(max(chirps)),
                    "ms": ms[name],
                }
            )
    return rows


def decibel(amplitude: float) -> float:
    """Return an amplitude relative to 1, dB."""
    return 20.0 * math.log10(max(amplitude, 1e-15))


def fold_table(quick: bool) -> list[Row]:
    """Table 2: lines above the limit, in single precision as a block is."""
    rng = np.random.default_rng(SEED + 1)
    rows: list[Row] = []
    for profile, rotation in PROFILES.items():
        highest = 0.49 * RATE / rotation.speed_range[1]
        lowest = 1.02 * LIMIT / rotation.mean_speed
        worst = 0.0
        for _ in range(10 if quick else 100):
            order = rng.uniform(lowest, highest)
            found, spacing = ours(line(order, rng.uniform(), rotation, RATE), rotation, "float32")
            end = round(order * rotation.mean_speed / spacing) - BESIDE_BINS
            worst = max(worst, float(found[2 : min(found.size, end)].max()))
        rows.append({"speed": profile, "lines from, orders": lowest, "to": highest, "folded_db": decibel(worst)})
    return rows


def full_rate_table(quick: bool) -> list[Row]:
    """Table 3."""
    rng = np.random.default_rng(SEED + 2)
    rows: list[Row] = []
    for profile, rotation in PROFILES.items():
        sampling_order = FULL_RATE / rotation.speed_range[1]
        errors: list[tuple[float, float]] = []
        for _ in range(3 if quick else 20):
            order = rng.uniform(0.5, 0.4 * sampling_order)
            found = order_spectrum(line(order, rng.uniform(), rotation, FULL_RATE), FULL_RATE, rotation)
            errors.append(line_errors(found.amplitude, found.step, order))
        signal = line(3.0, 0.0, rotation, FULL_RATE)
        ms = interleaved_ms({"": partial(order_spectrum, signal, FULL_RATE, rotation)}, 3 if quick else 9)[""]
        rows.append(
            {
                "speed": profile,
                "sampling order": sampling_order,
                "error of a line": max(error for error, _ in errors),
                "elsewhere_db": decibel(max(left for _, left in errors)),
                "ms": ms,
            }
        )
    return rows


def ringing(rotation: Rotation, order: float, seed: int) -> NDArray[np.float32]:
    """Return impacts at a constant order that ring at 8 kHz, in noise, at the full rate."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(0.02 * FULL_RATE)) / FULL_RATE
    x = 0.2 * rng.standard_normal(round(DURATION * FULL_RATE))
    for start in rotation.time_at(np.arange(0.3 / order, rotation.turned, 1.0 / order)):
        first = math.ceil(start * FULL_RATE)
        if first + t.size < x.size:
            late = t + (first / FULL_RATE - start)
            x[first : first + t.size] += np.exp(-1500.0 * late) * np.sin(2.0 * np.pi * 8000.0 * late)
    return x.astype(np.float32)


def envelope_table(quick: bool) -> list[Row]:
    """Table 4: aliases of the envelope at four and eight samples a bin, against 64, by the lines of an outer race."""
    rows: list[Row] = []
    _, lines = bearing_lines("6205", SPEED)
    order = lines.bpfo / SPEED
    blocks = [(profile, seed) for profile in PROFILES for seed in range(1 if quick else 4)]
    for over in (4.0, 8.0):
        errors: dict[str, list[tuple[float, float]]] = {}
        for profile, seed in blocks:
            rotation = PROFILES[profile]
            x = ringing(rotation, order, seed)
            transforms = [
                BlockTransform(x.size, FULL_RATE, [BAND], raw_limit=0.0, precision="float64", oversampling=each)
                for each in (over, 64.0)
            ]
            angle = None if profile == "one speed" else rotation
            found, exact = (transform(x, rotation=angle).envelopes[0] for transform in transforms)
            places = np.rint(order * rotation.mean_speed * np.arange(1, 6) / found.resolution).astype(np.intp)
            pairs = [(found.amplitude[p - 2 : p + 3], exact.amplitude[p - 2 : p + 3]) for p in places]
            worst = max(abs(math.sqrt(np.sum(a**2) / np.sum(b**2)) - 1.0) for a, b in pairs)
            size = math.ceil(5.5 * order * rotation.mean_speed / found.resolution)
            difference = np.abs(found.amplitude[:size] - exact.amplitude[:size])
            errors.setdefault(profile, []).append((worst, float(difference.max() / exact.amplitude[:size].max())))
        rows += [
            {
                "samples a bin": over,
                "speed": profile,
                "error of lines": max(worst for worst, _ in found),
                "over highest line_db": decibel(max(left for _, left in found)),
            }
            for profile, found in errors.items()
        ]
    return rows


def _warp(rotation: Rotation) -> Warp:
    warp = warp_of(rotation, DURATION)
    assert warp is not None
    return warp


def _settings(rotation: Rotation | None, speed: float, bands: tuple[tuple[float, float], ...]) -> FeatureSettings:
    bearing, _ = bearing_lines("6205", SPEED)
    lines = fundamentals(kinematics(bearing, speed))
    return FeatureSettings(FULL_RATE, bands, lines, speed=speed, speed_sd=0.0, rotation=rotation)


def time_table(quick: bool) -> list[Row]:
    """Table 5: all features of a block."""
    rows: list[Row] = []
    three = (BAND, (3000.0, 5000.0), (5000.0, 7000.0))
    combs = all_combs((Interference(orders=(23.0,), sidebands=2),), SPEED)
    for name, bands, interference in (("one band", (BAND,), ()), ("three bands", three, ()), ("mesh", (BAND,), combs)):
        for profile, rotation in PROFILES.items():
            x = ringing(rotation, 3.58, 0)
            plain = replace(_settings(None, rotation.mean_speed, bands), interference=interference)

            def angle(x: NDArray[np.float32] = x, s: FeatureSettings = plain, r: Rotation = rotation) -> object:
                warp_of.cache_clear()
                return block_features(x, FULL_RATE, replace(s, rotation=r))

            paths = {
                "kernel": calibration_kernel(),
                "time": partial(block_features, x, FULL_RATE, plain),
                "angle": angle,
            }
            ms = interleaved_ms(paths, 31 if quick else 101)
            beyond = ms["angle"] - ms["time"]
            rows.append(
                {
                    "block": name,
                    "speed": profile,
                    "over time_ms": ms["time"],
                    "over the angle_ms": ms["angle"],
                    "kernel_ms": ms["kernel"],
                    "beyond, kernel 0.35_ms": beyond * REFERENCE_MS / ms["kernel"],
                }
            )
    return rows


def agreement(quick: bool) -> Row:
    """Compare the figures of blocks at one speed by time and by the angle."""
    figures: list[float] = []
    harmonics: list[float] = []
    blocks = 4 if quick else 24
    for seed in range(blocks):
        speed = 20.0 + seed
        _, lines = bearing_lines("6205", speed)
        fault = FAULTS[seed % 3]
        x = impacts(np.random.default_rng(seed), fault, lines, rate=FULL_RATE, duration=DURATION).astype(np.float32)
        settings = replace(_settings(None, speed, (BAND,)), fundamentals=fundamentals(lines))
        plain = block_features(x, FULL_RATE, settings)
        found = block_features(x, FULL_RATE, replace(settings, rotation=constant(speed, DURATION)))
        for name, value in plain.values.items():
            other = found.values[name]
            if isinstance(value, float) and isinstance(other, float):
                figures.append(abs(other - value) / max(abs(value), 1e-2 * plain.rms))
        harmonics += np.abs(found.lines[0][fault].amplitude / plain.lines[0][fault].amplitude - 1.0).tolist()
    return {"blocks": blocks, "figures": max(figures), "lines of the damaged part": max(harmonics)}


def main() -> None:
    """Run, print, write."""
    options = arguments("Order spectra: errors, aliases and times.")
    sampling = f"0.4 of {SAMPLING_RATIO * LIMIT:g} samples a second over the speed"
    accuracy, folds = accuracy_table(options.quick), fold_table(options.quick)
    full, envelope = full_rate_table(options.quick), envelope_table(options.quick)
    times, same = time_table(options.quick), agreement(options.quick)
    print_table(f"1. Lines up to {sampling}; targets {TARGET_ERROR:g} and {TARGET_ALIAS_DB:g} dB", accuracy)
    print_table("2. What folds of lines above the limit", folds)
    print_table("3. Full rate", full)
    print_table("4. Aliases of the decimated envelope", envelope)
    print_table(f"5. Features of a block; target {TARGET_MS:g} ms beyond the path over time", times)
    print_table("   One speed by both, largest relative difference", [same])
    write_json(
        options.json,
        {
            "lines": accuracy,
            "folded": folds,
            "full_rate": full,
            "envelope": envelope,
            "times": times,
            "one_speed": same,
        },
    )


if __name__ == "__main__":
    main()
