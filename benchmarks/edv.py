"""The thesis' tracker and forecast: what an update costs, how exact it is, and how far off the method itself is.

Run as ``python -m benchmarks.edv [--quick] [--json FILE]``. Three tables:

1. microseconds per update on maps of 51 x 33 points, along a life and at worst for the first point (which has the whole
   map to search), beside the largest difference from a brute-force scan of the map;
2. microseconds per refitted forecast, beside its difference from the batch fit;
3. lives of known growth on analytic maps (surfaces with the traits of simulated maps, not simulated ones): the median
   of tracked over true V_eq in each quarter of the life, and the error of the forecast beside that of a constant guess.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

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
from monitor.health.rest import quadratic as forecast
from monitor.health.rest.quadratic import ForecastState
from monitor.health.size import EdvStatus, Remaining, TtStatus, edv
from monitor.health.size.edv import EdvState
from monitor.health.size.level_set import LevelMap, least_volume
from tests.oracles.edv_oracle import scan_least_volume
from tests.oracles.quadratic_oracle import fit_quadratic

Floats = NDArray[np.float64]

RADIUS = 0.02291
"""Radius of the outer race of the 1205, m."""
MM2 = 1e-6
THRESHOLD = 0.05 * MM2
BLOCK = 300.0
"""Time between blocks, s."""
NOISE = 0.02
"""Scatter of one block's RMS, as a share of it."""


def analytic_map(stripes: float, at_no_depth: float) -> LevelMap:
    """A surface with the traits of simulated maps, 51 x 33 points from 0 to 50 degrees and 0 to 32 um.

    Args:
        stripes: amplitude of the oscillation along the extent, as a share of the RMS; its period is 7.6 degrees.
        at_no_depth: RMS of a defect of no depth but some extent, as a rough floor has it, m/s2.

    Returns:
        A map that rises with depth to the power 0.55 and with extent to the power 0.1.
    """
    extent, depth = np.linspace(0.0, 50.0, 51), np.linspace(0.0, 32.0, 33)
    wave = 1.0 + stripes * np.sin(2.0 * np.pi * extent[None, :] / 7.6)
    rough = at_no_depth * np.sqrt(extent[None, :] / 50.0)
    rms = 0.5 + np.hypot(3.0 * depth[:, None] ** 0.55 * extent[None, :] ** 0.1, rough) * wave
    return LevelMap(np.radians(extent), depth * 1e-6, rms, RADIUS)


MAPS = {
    "no stripes": analytic_map(0.0, 0.0),
    "stripes": analytic_map(0.25, 0.0),
    "stripes, not zero at no depth": analytic_map(0.25, 4.0),
}


@dataclass(frozen=True)
class Life:
    """One life of known growth: times in s, true V_eq in m2, extent in rad and depth in m, each of shape (blocks,).

    ``duration`` is when the threshold is reached, s, up to one block after the last time.
    """

    law: str
    duration: float
    t: Floats
    v_eq: Floats
    dphi_d: Floats
    h_d: Floats


def draw_life(rng: np.random.Generator) -> Life:
    """A life from 0.0022 mm3/mm to the threshold: quadratic, exponential, or a stall and then fast."""
    law = ("quadratic", "exponential", "stall then fast")[int(rng.integers(3))]
    duration = 60.0 * math.exp(rng.uniform(math.log(150.0), math.log(900.0)))
    t = np.arange(0.0, duration, BLOCK)
    share = t / duration
    start = 0.0022 * MM2
    growth = {
        "quadratic": share**2,
        "exponential": np.expm1(share * math.log(THRESHOLD / start)) / (THRESHOLD / start - 1.0),
        "stall then fast": 0.2 * np.minimum(share, 0.3) / 0.3 + 0.8 * np.maximum(share - 0.6, 0.0) / 0.4,
    }[law]
    v_eq = start + (THRESHOLD - start) * growth
    h_end, depth_share = rng.uniform(4e-6, 20e-6), rng.uniform(0.2, 0.7)
    h_d = h_end * (v_eq / THRESHOLD) ** depth_share
    return Life(law, duration, t, v_eq, np.minimum(v_eq / (RADIUS * h_d), math.radians(50.0)), h_d)


def time_updates(name: str, map_slice: LevelMap, blocks: int, scans: int) -> Row:
    """Cost of ``edv.step`` over a noisy rise through the map, and its error against the scan on some of its updates."""
    rng = np.random.default_rng(1)
    span = map_slice.rms_max - map_slice.rms_min
    clean = map_slice.rms_min + span * np.linspace(0.05, 0.85, blocks)
    state, spent, statuses = EdvState(), [], []
    queries: list[tuple[float, float, float]] = []
    for rms in clean * (1.0 + NOISE * rng.standard_normal(blocks)):
        begun = time.thread_time_ns()
        after, result = edv.step(state, float(rms), map_slice=map_slice)
        spent.append((time.thread_time_ns() - begun) / 1e3)
        statuses.append(result.status)
        if result.status is EdvStatus.OK and state.dphi_d is not None and state.h_d is not None:
            queries.append((result.rms_smoothed, state.dphi_d, state.h_d))
        state = after
    above, below, slack = compare_with_scan(map_slice, queries[:: max(1, len(queries) // scans)][:scans])
    return {
        "map": name,
        "median_us": statistics.median(spent),
        "p99_us": float(np.percentile(spent, 99)),
        "first_point_us": max(time_first_point(map_slice, share) for share in (0.001, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9)),
        "widened": statuses.count(EdvStatus.WIDENED) / blocks,
        "scans": float(scans),
        "above_scan_mm2": above / MM2,
        "below_scan_mm2": below / MM2,
        "scan_slack_mm2": slack / MM2,
    }


def time_first_point(map_slice: LevelMap, share: float) -> float:
    """Median cost in us of the first update, at an RMS that lies at a share of the map's range."""
    rms = map_slice.rms_min + share * (map_slice.rms_max - map_slice.rms_min)
    spent = []
    for _ in range(51):
        begun = time.thread_time_ns()
        edv.step(EdvState(), rms, map_slice=map_slice)
        spent.append((time.thread_time_ns() - begun) / 1e3)
    return statistics.median(spent)


def compare_with_scan(map_slice: LevelMap, queries: Sequence[tuple[float, float, float]]) -> tuple[float, float, float]:
    """Most that the closed form lies above the scan, most that it lies below, and by how much the scan may be high."""
    above, below, most_slack = 0.0, 0.0, 0.0
    for level, dphi_from, h_from in queries:
        point = least_volume(map_slice, level, dphi_from, h_from)
        scanned, slack = scan_least_volume(
            map_slice.dphi_d, map_slice.h_d, map_slice.rms, RADIUS, level, (dphi_from, h_from), lines=20
        )
        v_eq = math.inf if point is None else point.v_eq
        above, below = max(above, v_eq - scanned), max(below, scanned - v_eq)
        most_slack = max(most_slack, slack)
    return above, below, most_slack


def time_forecasts(points: int) -> Row:
    """Cost of ``forecast.step`` with four thresholds, and the difference of its time from that of the batch fit."""
    t = BLOCK * np.arange(points)
    share = t / t[-1]
    noise = np.random.default_rng(2).standard_normal(points)
    v = (0.002 + 0.027 * share**2 + 1e-4 * noise) * MM2
    state, spent, t_threshold = ForecastState(), [], math.nan
    for time_now, volume in zip(t.tolist(), v.tolist(), strict=True):
        begun = time.thread_time_ns()
        state, results = forecast.step(state, time_now, volume, thresholds=[x * MM2 for x in (0.03, 0.05, 0.08, 0.1)])
        spent.append((time.thread_time_ns() - begun) / 1e3)
        t_threshold = results[1].t_threshold
    batch = fit_quadratic(t, v)
    t_batch = (batch.first_crossing(THRESHOLD) if batch else None) or math.nan
    return {
        "points": float(points),
        "median_us": statistics.median(spent),
        "last_tenth_us": statistics.median(spent[-points // 10 :]),
        "relative_error": abs(t_threshold / t_batch - 1.0),
    }


def follow(life: Life, map_slice: LevelMap, rng: np.random.Generator) -> tuple[Floats, list[Remaining]]:
    """V_eq tracked over one life, shape (blocks,), and the forecast after each block."""
    tracker, state = EdvState(), ForecastState()
    tracked, issued = [], []
    for t, dphi_d, h_d in zip(life.t.tolist(), life.dphi_d.tolist(), life.h_d.tolist(), strict=True):
        rms = map_slice.value_at(dphi_d, h_d) * (1.0 + NOISE * rng.standard_normal())
        tracker, found = edv.step(tracker, rms, map_slice=map_slice)
        state, (result,) = forecast.step(state, t, found.v_eq, thresholds=[THRESHOLD])
        tracked.append(found.v_eq)
        issued.append(result)
    return np.array(tracked), issued


def score_method(name: str, map_slice: LevelMap, lives: int) -> list[Row]:
    """How the tracked volume and the forecast compare with the truth, by quarter of the life.

    The tracker knows the very map that the lives are drawn from: what is left is the method. A forecast without a root
    is scored as the constant guess, the median life less the time gone; a threshold already crossed counts as zero.
    """
    rng = np.random.default_rng(3)
    population = [draw_life(rng) for _ in range(lives)]
    typical = statistics.median(float(life.t[-1]) for life in population)
    ratios: list[list[float]] = [[], [], [], []]
    errors: list[list[float]] = [[], [], []]
    constant: list[list[float]] = [[], [], []]
    missing, crossed = [0, 0, 0], [0, 0, 0]
    for life in population:
        tracked, issued = follow(life, map_slice, rng)
        for quarter, part in enumerate(np.array_split(tracked / life.v_eq, 4)):
            ratios[quarter].append(float(np.nanmedian(part)) if np.any(np.isfinite(part)) else math.nan)
        for k, fraction in enumerate((0.25, 0.5, 0.75)):
            at = int(fraction * (life.t.size - 1))
            left = float(life.t[-1] + BLOCK - life.t[at])
            guess = max(typical - float(life.t[at]), 0.0)
            result = issued[at]
            answered = result.status in (TtStatus.OK, TtStatus.ALREADY_CROSSED)
            missing[k] += not answered
            crossed[k] += result.status is TtStatus.ALREADY_CROSSED
            errors[k].append(abs((result.tt if answered else guess) - left) / 60.0)
            constant[k].append(abs(guess - left) / 60.0)
    rows: list[Row] = []
    for k, ratio in enumerate(ratios):
        low, high = (float(x) for x in np.nanpercentile(ratio, (10, 90)))
        row: dict[str, float | str | None] = {
            "map": name,
            "quarter": k + 1,
            "v_eq_ratio": float(np.nanmedian(ratio)),
            "v_eq_ratio_p10": low,
            "v_eq_ratio_p90": high,
            # The last quarter ends where nothing is left to forecast.
            "tt_error_min": statistics.fmean(errors[k]) if k < 3 else None,
            "constant_error_min": statistics.fmean(constant[k]) if k < 3 else None,
            "no_answer": missing[k] / lives if k < 3 else None,
            "crossed_early": crossed[k] / lives if k < 3 else None,
        }
        rows.append(row)
    return rows


def main() -> None:
    """Run the tables and print them, and write them where asked."""
    options = arguments("The thesis' tracker and forecast: cost, exactness, and error.")
    blocks, scans, points, lives = (400, 3, 2_000, 30) if options.quick else (3_000, 25, 100_000, 300)
    reference = interleaved_ms({"fft_ms": calibration_kernel()}, 51)
    print(f"planned float32 real FFT of 128,000 samples: {reference['fft_ms']:.3g} ms (targets: {REFERENCE_MS} ms)")
    tables: dict[str, Callable[[], list[Row]]] = {
        "updates": lambda: [time_updates(name, m, blocks, scans) for name, m in MAPS.items()],
        "forecasts": lambda: [time_forecasts(points)],
        "method": lambda: [row for name, m in MAPS.items() for row in score_method(name, m, lives)],
    }
    figures: dict[str, list[Row]] = {"reference": [reference]}
    for title, table in tables.items():
        figures[title] = table()
        print_table(title, figures[title])
    write_json(options.json, figures)


if __name__ == "__main__":
    main()
