"""Learned forecasts on eleven recorded runs to failure (PRONOSTIA), leave one run out, beside opponents.

Run as ``python -m benchmarks.learned.runs [--quick] [--json FILE]``. The end of a run is its last block; t_fs is that
of the axis whose final stage the detector dates first. Tables:

1. CRPS over the final stage (at most 10) and coverage of nominal 80 % intervals at 1/4, 1/2, 3/4 of it;
2. the same at moments that favour no input: over all of each life, over all hours of all lives (a run counts for as
   long as it lasts), and from when t_fs was known;
3. one axis alone, as a channel of its own has it, and files of every sixth block;
4. by the number of runs that were learned from;
5. what other constants would have given;
6. levels at the end, and P(crossed);
7. time and memory of an update, and equality after a restart.

Without the recordings (``SPALLWATCH_DATA``) there is nothing to show.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Row, Tables, benchmark
from benchmarks.learned.lives import constants
from benchmarks.learned.opponents import LEVELS, Forecast, learned, opponents
from benchmarks.onset.windows import WINDOWS, inputs_of
from monitor.health.rest.learned.fit import MIN_BLOCKS, LearnedRun, fit_runs
from monitor.health.rest.learned.forecaster import LearnedState, step
from monitor.health.rest.learned.onset import find_onset
from monitor.health.rest.learned.scores import scores_out_of_run
from monitor.health.size import DamageInput
from reference import recordings_folder

Array = NDArray[np.float64]
SHARES = (0.25, 0.5, 0.75)
MAX_SHARE = 10.0
SEED = 18
Run = tuple[LearnedRun, float]
"""A final stage, and the time since t_fs by which it was known, s."""


def read_runs(folder: Path, axis: str | None = None, every: int = 1) -> list[Run]:
    """Return the final stages that have 8 blocks, of an axis or of the one that is dated first."""
    found: dict[str, tuple[int, Run]] = {}
    for window in WINDOWS:
        blocks = inputs_of(folder, window)[::every]
        onset = find_onset(blocks)
        if onset is None or onset.known is None or (axis is not None and window.axis != axis):
            continue
        t = np.array([block.time or 0.0 for block in blocks])
        since = t[onset.place :] - t[onset.place]
        ln_rms = np.log([block.rms for block in blocks[onset.place :]])
        run = LearnedRun(window.run, since, ln_rms, onset.ln_baseline, float(since[-1]), float(t[onset.place]))
        known = float(t[onset.known] - t[onset.place])
        if window.run not in found or run.t_fs < found[window.run][1][0].t_fs:
            found[window.run] = (onset.place, (run, known))
    return [run for _, run in found.values() if len(run[0].t) >= MIN_BLOCKS]


def crps_of(sample: Array, left: float) -> float:
    """Return the CRPS of equally likely quantiles, s."""
    pinball = np.where(left >= sample, LEVELS * (left - sample), (1.0 - LEVELS) * (sample - left))
    return float(2.0 * pinball.mean())


def asked(forecast: Forecast, run: LearnedRun, at: float) -> tuple[float, bool] | None:
    """Return CRPS over the life and whether the 80 % interval held, at a time since t_fs; None for no answer."""
    place = int(np.searchsorted(run.t, at * (1.0 + 1e-12), side="right")) - 1
    left = run.life - float(run.t[place])
    sample = forecast(run, place) if left > 0.0 else None
    if sample is None:
        return None
    low, high = np.quantile(sample, (0.1, 0.9)).tolist()
    return min(crps_of(sample, left) / run.life, MAX_SHARE), low <= left <= high


Moments = Callable[[LearnedRun, float], Sequence[float]]


def leave_one_out(runs: Sequence[Run], moments: Moments) -> dict[str, list[list[tuple[float, bool] | None]]]:
    """Return by forecast the answers of each run at its moments."""
    found: dict[str, list[list[tuple[float, bool] | None]]] = {}
    for place, (run, known) in enumerate(runs):
        others = [other for number, (other, _) in enumerate(runs) if number != place]
        for name, forecast in opponents(others).items():
            found.setdefault(name, []).append([asked(forecast, run, at) for at in moments(run, known)])
    return found


def at_shares(run: LearnedRun, known: float) -> list[float]:
    """Moments at 1/4, 1/2, 3/4 of the life."""
    return [share * run.life for share in SHARES]


def over_life(run: LearnedRun, known: float) -> list[float]:
    """Twenty moments spread evenly over the life."""
    return [(i + 0.5) / 20 * run.life for i in range(20)]


def since_known(run: LearnedRun, known: float) -> list[float]:
    """Ten moments spread evenly from when t_fs was known to the end."""
    return [known + (i + 0.5) / 10 * (run.life - known) for i in range(10)]


def share_table(runs: Sequence[Run]) -> list[Row]:
    """Table 1."""
    rows: list[Row] = []
    for name, answers in leave_one_out(runs, at_shares).items():
        columns = [[row[i] for row in answers] for i in range(len(SHARES))]
        crps = {
            f"CRPS {share:g}": float(np.mean([one[0] for one in column if one]))
            for share, column in zip(SHARES, columns, strict=True)
        }
        errors = [np.mean([one[0] for one in row if one]) for row in answers]
        known = [one for row in answers for one in row if one]
        covers = {
            f"cover {share:g}": float(np.mean([one[1] for one in column if one]))
            for share, column in zip(SHARES, columns, strict=True)
        }
        spread = float(np.std(errors, ddof=1) / math.sqrt(len(errors)))
        pooled = float(np.mean([one[1] for one in known]))
        rows.append(
            {"forecast": name, **crps, "+- of the mean": spread, **covers, "cover": pooled, "asked": len(known)}
        )
    return rows


def other_moments_table(runs: Sequence[Run]) -> list[Row]:
    """Table 2."""
    all_life, known = leave_one_out(runs, over_life), leave_one_out(runs, since_known)
    lives = np.array([run.life for run, _ in runs])
    rows: list[Row] = []
    for name, answers in all_life.items():
        crps = [float(np.mean([one[0] for one in row if one])) for row in answers]
        held = [float(np.mean([one[1] for one in row if one])) for row in answers]
        later = [float(np.mean([one[0] for one in row if one])) for row in known[name]]
        held_later = [float(np.mean([one[1] for one in row if one])) for row in known[name]]
        rows.append(
            {
                "forecast": name,
                "CRPS, all of a life": float(np.mean(crps)),
                "cover": float(np.mean(held)),
                "CRPS, all hours": float(np.average(crps, weights=lives)),
                "cover, hours": float(np.average(held, weights=lives)),
                "CRPS, known": float(np.mean(later)),
                "cover, known": float(np.mean(held_later)),
            }
        )
    return rows


def one_row(label: str, runs: Sequence[Run]) -> Row:
    """Return the scores of the program at the three shares, out of run."""
    scores = scores_out_of_run([run for run, _ in runs])
    by_share = {f"CRPS {share}": one["crps_share"] for share, one in scores["by_share"].items()}
    prior = float(np.mean([one["elapsed_crps_share"] for one in scores["by_share"].values()]))
    return {"": label, "runs": len(runs), **by_share, "cover": scores["coverage"], "as long again": prior}


def number_table(runs: Sequence[Run], draws: int) -> list[Row]:
    """Table 4: random sets of other runs to learn from, every run asked."""
    rng = np.random.default_rng(SEED)
    rows: list[Row] = []
    for count in (0, 1, 2, 3, 5, 7, 10):
        answers: list[tuple[float, bool]] = []
        scales: list[float] = []
        for place, (run, _) in enumerate(runs):
            others = [other for number, (other, _) in enumerate(runs) if number != place]
            for _ in range(1 if count in (0, len(others)) else draws):
                chosen = rng.choice(len(others), count, replace=False)
                model = fit_runs([others[i] for i in chosen])
                scales.append(model.scale)
                found = [asked(learned(model), run, share * run.life) for share in SHARES]
                answers += [one for one in found if one]
        crps, held = (float(np.mean([one[i] for one in answers])) for i in (0, 1))
        rows.append({"learned from": count, "CRPS": crps, "cover": held, "scale": float(np.mean(scales))})
    return rows


def constants_table(runs: Sequence[Run]) -> list[Row]:
    """Table 5."""
    rows = [one_row("as chosen", runs)]
    for name, value in (
        ("MARGIN_SHARE", 0.0),
        ("MARGIN_SHARE", 0.05),
        ("MARGIN_SHARE", 0.15),
        ("RIDGE", (3.0,) * 5),
        ("RIDGE", (10.0,) * 5),
        ("PRIOR_RUNS", 0.5),
        ("PRIOR_RUNS", 2.0),
    ):
        with constants({name: value}):
            rows.append(one_row(f"{name.lower()} {value}", runs))
    return rows


def end_table(runs: Sequence[Run]) -> list[Row]:
    """Table 6."""
    model = fit_runs([run for run, _ in runs])
    ends = model.end_levels
    crossed = scores_out_of_run([run for run, _ in runs])["p_crossed"]
    levels = [math.exp(run.end_level) for run, _ in runs]
    return [
        {
            "runs": ends.count,
            "lowest": min(levels),
            "geometric mean": math.exp(ends.mean),
            "highest": max(levels),
            "spread, factor": math.exp(ends.sd),
            "Brier of P(crossed)": crossed["brier"],
            "Brier of the base rate": crossed["brier_base_rate"],
        }
    ]


def cost_table(runs: Sequence[Run], updates: int) -> list[Row]:
    """Table 7: a long final stage, restarted half-way."""
    model = fit_runs([run for run, _ in runs])
    rng = np.random.default_rng(SEED)
    levels = np.exp(0.1 * rng.standard_normal(updates) + np.linspace(0.0, 1.0, updates)).tolist()
    state, other = LearnedState(), LearnedState()
    took: list[float] = []
    found = after = None
    for i, level in enumerate(levels):
        block = DamageInput(10.0 * i, level)
        start = time.thread_time()
        state, found = step(state, block, model, baseline=1.0)
        took.append(time.thread_time() - start)
        if i % (updates // 10) == 0:
            other = LearnedState.from_dict(json.loads(json.dumps(other.to_dict())))
        other, after = step(other, block, model, baseline=1.0)
    scaled = [replace(run, t=60.0 * run.t, life=60.0 * run.life) for run, _ in runs]
    unit = abs(fit_runs(scaled).scale - model.scale)
    return [
        {
            "updates": updates,
            "ms, median": 1e3 * float(np.median(took)),
            "ms, 99.9 %": 1e3 * float(np.quantile(took, 0.999)),
            "state, bytes": len(json.dumps(state.to_dict())),
            "equal after restarts": "yes" if (found, state) == (after, other) else "no",
            "change in minutes": unit,
        }
    ]


@benchmark("Learned forecasts on recorded runs to failure, leave one run out.")
def main(quick: bool) -> Tables:
    """Read, score, print."""
    folder = recordings_folder()
    if not folder.is_dir():
        print("no recordings: SPALLWATCH_DATA names no folder")
        return {}
    runs = read_runs(folder)
    lives = [
        {
            "run": run.name,
            "t_fs, s": run.t_fs,
            "final stage, s": run.life,
            "blocks": len(run.t),
            "known after, s": known,
        }
        for run, known in runs
    ]
    axes = [("horizontal", "h", 1), ("vertical", "v", 1), ("every sixth block", None, 6)]
    tables: dict[str, Sequence[Row]] = {
        "0. Final stages": lives,
        "1. At shares of the final stage, CRPS over it": share_table(runs),
        "2. At other moments": other_moments_table(runs),
        "3. One axis, fewer blocks": [one_row(label, read_runs(folder, axis, every)) for label, axis, every in axes],
        "4. By the number of runs learned from": number_table(runs, 2 if quick else 6),
        "5. Other constants": constants_table(runs),
        "6. Levels at the end, times the baseline": end_table(runs),
        "7. An update": cost_table(runs, 2000 if quick else 100_000),
    }
    return {title.split(". ")[1]: list(rows) for title, rows in tables.items()}
