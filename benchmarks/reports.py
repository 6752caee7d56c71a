"""Reports: how long a page of a long life takes and how large it is, and a batch of many runs on all cores.

Run as ``python -m benchmarks.reports [--quick] [--json FILE]``. Two tables:

1. one run of 30,000 blocks with two channels, one of them tracked and forecast from its onset on, and 400 kept envelope
   spectra of each: processor and passed seconds to read the store and to write the page, and its size; then the same
   page drawn again and laid out as PDF;
2. a batch of 100 runs of 600 blocks with 200 spectra: passed seconds and seconds a run, ten from one process, without
   and with PDF, then all from one a core, and all again when nothing has changed; tables as CSV and netCDF included.

Stores are made up; drawing costs the same whatever is drawn.
"""

from __future__ import annotations

import math
import os
import random
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import Row, arguments, print_table, write_json
from models.work.choose import local_runner
from monitor.commands.report_batch import BatchSettings, find_runs, run_batch
from monitor.health.record import Record
from monitor.health.signal.waterfall import SpectrumChange, SpectrumRow
from monitor.records.spectra import write_changes
from monitor.records.store import Store
from monitor.report.options import Options
from monitor.report.report import report_runs
from monitor.report.runs import read_runs

LONG, RUN, RUNS = 30_000, 600, 100
_START, _STEP = 1_700_000_000.0, 10.0
_BINS, _LINES = 4000, {"outer": 195.0, "inner": 284.0, "ball": 206.0, "cage": 16.3}


def made_up(blocks: int, seed: int) -> list[Record]:
    """Records of a life whose last third is the final stage of one channel."""
    draw = random.Random(seed)
    onset = 2 * blocks // 3
    return [
        Record(
            source="rig",
            sequence=number,
            name=f"block-{number:06d}",
            content_hash=f"{number:032x}",
            time=_START + _STEP * number,
            elapsed=_STEP * number,
            channels={"tested": _tested(draw, number, onset, blocks), "support": _healthy(draw, number)},
        )
        for number in range(1, blocks + 1)
    ]


def _healthy(draw: random.Random, number: int) -> dict[str, Any]:
    stage = "learning" if number <= 100 else "healthy"
    score = {} if number <= 100 else {"detect_score": draw.uniform(0.2, 2.0), "detect_threshold": 3.4}
    return {
        "rms": draw.uniform(0.48, 0.52),
        "h_or": draw.uniform(0.02, 0.03),
        "peak": draw.uniform(2.0, 3.0),
        "stage": stage,
        "quality_status": "ok",
        "speed": 40.0,
        "load": 4000.0,
        "absolute_level": "yes",
        **score,
    }


def _tested(draw: random.Random, number: int, onset: int, blocks: int) -> dict[str, Any]:
    values = _healthy(draw, number)
    if number < onset + 5:
        return {**values, "edv_status": "not_final_stage", "tt_status": "not_final_stage", "v_th": 5e-8}
    share = (number - onset) / (blocks - onset)
    t_fs, v_eq = _START + _STEP * onset, 8e-8 * share**1.6 * draw.uniform(0.9, 1.1)
    left = _STEP * (onset + (blocks - onset) * (5 / 8) ** (1 / 1.6) - number)
    values |= {"rms": values["rms"] * (4.0 + 20.0 * share), "h_or": draw.uniform(2.0, 4.0), "stage": "final"}
    values |= {"t_fs": t_fs, "t_fs_block": onset, "t_fs_known": t_fs + 5 * _STEP, "t_fs_known_block": onset + 5}
    values |= {"fault": "outer", "fault_snr": 50.0, "fault_depth": 0.8, "fault_score": 40.0 * share, "v_th": 5e-8}
    values |= {"edv_status": "ok", "v_eq": v_eq, "v_eq_lower": 0.7 * v_eq, "v_eq_upper": 1.4 * v_eq}
    if left <= 0.0:
        return {**values, "tt": 0.0, "tt_status": "already_crossed"}
    found = left * draw.uniform(0.6, 1.5)
    return {**values, "tt": found, "tt_lower": 0.5 * found, "tt_upper": 2.0 * found, "tt_status": "ok"}


def make_store(path: Path, blocks: int, spectra: int, seed: int = 1) -> None:
    """Make a store of so many blocks with so many kept spectra a channel."""
    path.parent.mkdir(parents=True, exist_ok=True)
    made = made_up(blocks, seed)
    rng = np.random.default_rng(seed)
    attributes = {"calibrated": "yes", "interval_level": 0.8, "track_method": "library", "forecast_method": "library"}
    with Store.open(path, machine=f"machine {seed}") as store:
        store.describe(attributes)
        for at in range(0, blocks, 500):
            store.commit_many([(record, {}) for record in made[at : at + 500]])
        # Spectra are found by the channels whose states are stored.
        states = {f"channel:rig:{name}": {"version": 1} for name in ("tested", "support")}
        last = Record("rig", blocks + 1, "last", "f" * 32, "flat", ("flat",), time=_START + _STEP * (blocks + 1))
        store.commit(last, states)
        with store.transaction() as connection:
            for name in ("tested", "support"):
                write_changes(connection, _changes(name, blocks, spectra, rng))


def _changes(channel: str, blocks: int, spectra: int, rng: np.random.Generator) -> list[SpectrumChange]:
    changes = []
    for number in np.unique(np.linspace(1, blocks, spectra).astype(int)).tolist():
        amplitude = rng.rayleigh(0.01, _BINS)
        if channel == "tested" and number > 2 * blocks // 3:
            amplitude[(_LINES["outer"] / 0.4 * np.arange(1, 6)).astype(int)] = 1.0
        row = SpectrumRow(
            "rig", channel, number, _START + _STEP * number, 0.4, (5e3, 9e3), 40.0, 1.0, True, amplitude, _LINES
        )
        changes.append(SpectrumChange(row, "kept"))
    return changes


def one_page(folder: Path, blocks: int, spectra: int) -> list[Row]:
    """Time the page of one long life, by step."""
    make_store(folder / "long" / "state.db", blocks, spectra)
    out = folder / "long.html"
    rows: list[Row] = []
    cpu, wall = time.process_time(), time.perf_counter()
    runs = read_runs(folder / "long" / "state.db")
    middle = time.process_time(), time.perf_counter()
    report_runs(runs, out, options=Options())
    end = time.process_time(), time.perf_counter()
    paper = out.with_suffix(".pdf")
    report_runs(runs, paper, options=Options())
    printed = time.process_time(), time.perf_counter()
    for name, first, last, path in (
        ("read the store", (cpu, wall), middle, out),
        ("judge, draw, write", middle, end, out),
        ("in all", (cpu, wall), end, out),
        ("judge, draw, write as PDF", end, printed, paper),
    ):
        rows.append(
            {
                "step": name,
                "blocks": blocks,
                "spectra": 2 * spectra,
                "processor s": last[0] - first[0],
                "passed s": last[1] - first[1],
                "MB": path.stat().st_size / 1e6,
            }
        )
    return rows


def many_pages(folder: Path, runs: int, blocks: int, spectra: int) -> list[Row]:
    """Time a batch with one process, with one a core, and taken up again."""
    for seed in range(runs):
        make_store(folder / "fleet" / f"run-{seed:03d}" / "state.db", blocks, spectra, seed)
    items = find_runs(folder / "fleet", recordings=False)
    rows: list[Row] = []
    cores = os.cpu_count() or 1
    few = items[: max(2, runs // 10)]
    for name, chosen, workers, place in (
        ("one process", few, 1, "one"),
        ("one process, with PDF", few, 1, "paper"),
        (f"{cores} processes", items, 0, "many"),
        ("nothing changed", items, 0, "many"),
    ):
        wall, cpu = time.perf_counter(), _processor_seconds()
        settings = BatchSettings(Options(), pdf=place == "paper")
        with local_runner(workers) as runner:
            outcomes = run_batch(chosen, folder / place, settings, runner)
        seconds, busy = time.perf_counter() - wall, _processor_seconds() - cpu
        size = sum(path.stat().st_size for path in (folder / place).rglob("*") if path.is_file())
        rows.append(
            {
                "batch": name,
                "runs": len(chosen),
                "blocks a run": blocks,
                "failed": sum(bool(outcome.error) for outcome in outcomes),
                "passed s": seconds,
                "s a run": seconds / len(chosen),
                "processor s a run": busy / len(chosen),
                "MB a run": size / len(chosen) / 1e6,
                "index MB": (folder / place / "index.html").stat().st_size / 1e6,
            }
        )
    return rows


def _processor_seconds() -> float:
    """Return the processor seconds of this process and of those it has waited for."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def main() -> None:
    """Run both tables."""
    options = arguments(__doc__ or "")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        tables = {
            "page": one_page(folder, 3000 if options.quick else LONG, 100 if options.quick else 400),
            "batch": many_pages(
                folder, 4 if options.quick else RUNS, 200 if options.quick else RUN, 40 if options.quick else 200
            ),
        }
    print_table("The page of one run", tables["page"])
    print_table("A batch", tables["batch"])
    share = tables["batch"][0]["s a run"]
    if isinstance(share, float) and math.isfinite(share):
        print(f"\n{3600.0 / share:,.0f} pages an hour from one process")
    write_json(options.json, tables)


if __name__ == "__main__":
    main()
