"""The angle of the shaft from the vibration: its error and its refusals, on known angles and on real recordings.

    python -m benchmarks.rotation.ridge [--quick] [--json FILE]

Blocks of 5 s at 25.6 kHz with a known angle (``benchmarks.rotation.ridge_signals``) are searched from 8 to 45 Hz.
"wrong" is an angle that was given and is off by more than 0.3 turns somewhere (0.2 s at the ends left out; a steady
drift taken off), or whose mean speed is off by more than 1 %. "kept" is what such an angle leaves of a line at order
21.7, the fourth of the inner race, whose smearing is worst. Coverage is the share of blocks whose error is within two
of its stated standard deviations. The seeds of "judging" and "model" were set before and looked at once.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from scipy.io import loadmat

from benchmarks.common import REFERENCE_MS, Tables, benchmark, calibration_kernel, interleaved_ms
from benchmarks.rotation.ridge_signals import (
    BEARING,
    FAULTS,
    PROFILES,
    RATE,
    SECONDS,
    Array,
    for_judging,
    modelled,
    plain,
    rotation_of,
)
from models.machine.bearing import Bearing, from_catalogue, kinematics
from monitor.health.signal.rotation.ridge import angle_from_vibration
from monitor.health.signal.rotation.rotation import Rotation
from monitor.health.signal.speed import SpeedStatus, estimate_speed
from monitor.health.signal.transform import BlockTransform
from reference import recordings_folder

LIMITS = (8.0, 45.0)
ORDER = 21.7
WRONG_TURNS, WRONG_SPEED = 0.3, 0.01
Generator = Callable[[Rotation, str, float, np.random.Generator], Array]
SETS: dict[str, tuple[Generator, int, tuple[float, ...]]] = {
    "plain (fitted)": (plain, 11, (10.0, 0.0, -5.0, -10.0, -15.0, -20.0)),
    "judging (held out)": (for_judging, 70_011, (10.0, 0.0, -5.0, -10.0, -15.0, -20.0)),
    "model (held out)": (modelled, 80_011, (20.0, 10.0, 0.0, -10.0)),
}
_DATA = recordings_folder()
_NICE = Bearing("NICE", 8, 0.235 * 0.0254, 1.245 * 0.0254, element="roller")
_UESTC = Bearing("UESTC", 8, 7.938e-3, 33.5e-3)


def judged(found: Rotation, true: Rotation) -> dict[str, float]:
    """Return how an angle differs from the true one."""
    at = np.linspace(0.2, SECONDS - 0.2, 1000)
    error = found.turns_at(at) - true.turns_at(at)
    error = error - np.polyval(np.polyfit(at, error, 1), at)
    weight = true.speed_at(at)
    kept = abs(np.sum(weight * np.exp(2j * np.pi * ORDER * error)) / np.sum(weight))
    drift = found.mean_speed / true.mean_speed - 1.0
    return {
        "sd": float(error.std()),
        "worst": float(np.abs(error).max()),
        "drift": drift,
        "kept": float(kept),
        "covered": float(error.std() <= 2.0 * found.turns_sd),
        "speed_covered": float(abs(drift) <= 2.0 * found.speed_sd),
    }


def trials(name: str, count: int) -> Iterator[dict[str, Any]]:
    """Yield one row a block of a set: so many of each profile, fault and ratio of signal to noise."""
    generator, seed, ratios = SETS[name]
    for number, profile in enumerate(PROFILES):
        for ratio in ratios:
            for fault_number, fault in enumerate(FAULTS):
                for trial in range(count):
                    rng = np.random.default_rng([seed, number, round(50.0 + ratio), fault_number, trial])
                    true = rotation_of(profile, rng)
                    signal = generator(true, fault, ratio, rng)
                    began = time.thread_time()
                    found, status = angle_from_vibration(signal, RATE, BEARING, LIMITS)
                    row = {"profile": profile, "snr_db": ratio, "fault": fault, "status": status}
                    row["ms"] = 1e3 * (time.thread_time() - began)
                    yield row if found is None else {**row, **judged(found, true)}


def summary(rows: list[dict[str, Any]], key: str) -> list[dict[str, Any]]:
    """Return a table of trials by one of their properties, and of all."""
    values = list(dict.fromkeys(row[key] for row in rows))
    table: list[dict[str, Any]] = []
    for value in [*values, "all"]:
        part = [row for row in rows if value == "all" or row[key] == value]
        given = [row for row in part if "sd" in row]
        wrong = [row for row in given if row["worst"] > WRONG_TURNS or abs(row["drift"]) > WRONG_SPEED]

        def middle(name: str, share: float = 0.5, chosen: list[dict[str, Any]] = given) -> float | None:
            return float(np.quantile([row[name] for row in chosen], share)) if chosen else None

        table.append(
            {
                key: value,
                "blocks": len(part),
                "given_percent": 100.0 * len(given) / len(part),
                "wrong": len(wrong),
                "error_turns": middle("sd"),
                "error_turns_95": middle("sd", 0.95),
                "kept": middle("kept"),
                "kept_5": middle("kept", 0.05),
                "coverage": float(np.mean([row["covered"] for row in given])) if given else None,
                "speed_coverage": float(np.mean([row["speed_covered"] for row in given])) if given else None,
                "ms": float(np.median([row["ms"] for row in part])),
            }
        )
    return table


def without_shaft(count: int) -> dict[str, Any]:
    """Return how often an angle is given where no shaft is in the signal: noise, hum, or a race alone."""
    given = 0
    for trial in range(count):
        rng = np.random.default_rng([90_011, trial])
        signal = rng.standard_normal(int(RATE * SECONDS))
        if trial % 3 == 1:
            at = np.arange(signal.size) / RATE
            for harmonic in range(1, 9):
                signal += rng.lognormal(-0.5, 0.7) * np.cos(2.0 * np.pi * (50.01 * harmonic * at + rng.uniform()))
        elif trial % 3 == 2:
            passages = rotation_of(PROFILES[trial // 3 % len(PROFILES)], rng).turns_at(np.arange(signal.size) / RATE)
            for harmonic in range(1, 5):
                signal += np.cos(2.0 * np.pi * harmonic * kinematics(BEARING, 1.0).bpfo * passages)
        given += angle_from_vibration(signal, RATE, BEARING, LIMITS)[0] is not None
    return {"blocks": count, "given": given}


def recordings() -> Iterator[tuple[str, Array, float, Bearing, tuple[float, float], str | None]]:
    """Yield name, samples, rate, bearing, limits about the nominal speed, and the damaged part of real blocks."""
    parts = {"I": "inner", "O": "outer", "B": "ball", "N": None}
    named = {"105_0": "inner", "209_0": "inner", "130@6_0": "outer", "145@3_1": "outer", "118_0": "ball"}
    for path in sorted((_DATA / "cwru").glob("*.mat")):
        if path.stem not in (*named, "97_Normal_0"):
            continue
        values = loadmat(path)
        samples = next(value for key, value in values.items() if key.endswith("DE_time")).ravel()
        rate = 48_000.0 if path.stem == "97_Normal_0" else 12_000.0
        yield (
            f"cwru {path.stem}",
            samples[: int(5 * rate)],
            rate,
            from_catalogue("6205"),
            (15.0, 45.0),
            named.get(path.stem),
        )
    for path in sorted((_DATA / "mfpt").glob("*.mat")):
        bearing = loadmat(path, simplify_cells=True)["bearing"]
        part = "inner" if path.stem.startswith("Inner") else "outer"
        yield f"mfpt {path.stem}", np.ravel(bearing["gs"]), 48_828.0, _NICE, (12.5, 40.0), part
    for path in sorted((_DATA / "hit_sm_mfs").glob("*.mat")):
        values = loadmat(path)
        samples = next(np.ravel(value) for key, value in values.items() if not key.startswith("__"))
        part = {"I": "inner", "O": "outer", "N": None}[path.stem[0]]
        yield f"hit_sm {path.stem}", samples, 51_200.0, from_catalogue("6205"), (10.0, 32.0), part
    for path in sorted((_DATA / "uestc").glob("*.mat")):
        values = loadmat(path)
        samples, rate = np.ravel(values["Data"]).astype(np.float64), 20_000.0
        nominal = float(path.stem.split("_")[1]) / 60.0
        yield (
            f"uestc {path.stem}",
            samples[: int(10 * rate)],
            rate,
            _UESTC,
            (0.7 * nominal, 1.4 * nominal),
            parts[path.stem[0]],
        )


def real_row(
    name: str, samples: Array, rate: float, bearing: Bearing, limits: tuple[float, float], part: str | None
) -> dict[str, Any]:
    """Return what is found in a real block: both speeds, the wander, and the lines of the fault with the angle."""
    estimate = estimate_speed(samples, rate, bearing, limits)
    began = time.thread_time()
    found, status = angle_from_vibration(samples, rate, bearing, limits)
    row: dict[str, Any] = {"block": name, "status": status, "ms": 1e3 * (time.thread_time() - began)}
    called = estimate.status == SpeedStatus.OK
    row["estimate_hz"] = estimate.speed if called else None
    row["ridge_hz"] = None if found is None else found.mean_speed
    row["difference_percent"] = 100.0 * (found.mean_speed / estimate.speed - 1.0) if found and called else None
    row["wander_percent"] = None
    row["shaft_lines"] = row["fault_lines"] = None
    if found is None:
        return row
    at = np.linspace(0.05, 0.95, 200) * found.duration
    row["wander_percent"] = 100.0 * float(np.std(found.speed_at(at))) / found.mean_speed
    band = (0.05 * rate, 0.45 * rate)
    transform = BlockTransform(samples.size, rate, (band,), raw_limit=12.0 * limits[1], envelope_limit=1500.0)
    as_it_is, over_angle = transform(samples), transform(samples, rotation=found)
    row["shaft_lines"] = _ratio(over_angle.raw, as_it_is.raw, [order * found.mean_speed for order in range(1, 9)])
    if part is not None:
        lines = kinematics(bearing, found.mean_speed)
        one = {"inner": lines.bpfi, "outer": lines.bpfo, "ball": 2.0 * lines.bsf}[part]
        row["fault_lines"] = _ratio(
            over_angle.envelopes[0], as_it_is.envelopes[0], [order * one for order in (1, 2, 3, 4)]
        )
    return row


def _ratio(one: Any, other: Any, lines: list[float]) -> float:
    """Return the heights of lines in a spectrum over those in another: geometric mean, each the top within 4 %."""
    logs = []
    for line in lines:
        tops = []
        for spectrum in (one, other):
            near = np.abs(spectrum.frequency / line - 1.0) < (0.04 if len(lines) == 4 else 0.01)
            tops.append(float(np.max(spectrum.amplitude[near], initial=0.0)))
        if min(tops) > 0.0:
            logs.append(np.log(tops[0] / tops[1]))
    return float(np.exp(np.mean(logs)))


def times() -> dict[str, Any]:
    """Return the thread time of one block of 128,000 samples, beside the kernel that targets refer to."""
    rng = np.random.default_rng(5)
    signal = plain(rotation_of("ramp 5 s", rng), "inner", 0.0, rng).astype(np.float32)
    noise = rng.standard_normal(signal.size).astype(np.float32)
    ms = interleaved_ms(
        {
            "angle": lambda: angle_from_vibration(signal, RATE, BEARING, LIMITS),
            "angle_noise": lambda: angle_from_vibration(noise, RATE, BEARING, LIMITS),
            "estimate": lambda: estimate_speed(signal, RATE, BEARING, LIMITS),
            "kernel": calibration_kernel(),
        },
        9,
    )
    return {**{f"{name}_ms": value for name, value in ms.items()}, "scale": REFERENCE_MS / ms["kernel"]}


@benchmark(__doc__ or "")
def main(quick: bool) -> Tables:
    """Print the tables."""
    tables: dict[str, Any] = {"times": [times()]}
    for name in SETS:
        rows = list(trials(name, 1 if quick else 4))
        for key in ("profile", "snr_db"):
            tables[f"{name}, by {key}"] = summary(rows, key)
    tables["no shaft"] = [without_shaft(12 if quick else 150)]
    if _DATA.is_dir():
        tables["recordings"] = [real_row(*item) for item in recordings()]
    return tables
