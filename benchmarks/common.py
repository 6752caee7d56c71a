"""What every benchmark needs: fair timings, a table for people, JSON for programs, and the speed of this machine."""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pyfftw

Row = Mapping[str, float | int | str | None]
Tables = Mapping[str, Any]
"""Rows, or one row, by the name of their table."""

CALIBRATION_SAMPLES = 128_000
REFERENCE_MS = 0.35
"""Time of the calibration kernel on the machine that targets in milliseconds refer to."""


def arguments(description: str) -> argparse.Namespace:
    """Parse the options that all benchmarks share: ``--json FILE`` and ``--quick``."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    parser.add_argument("--quick", action="store_true", help="fewer repetitions: ends within a minute")
    return parser.parse_args()


def benchmark(description: str | None) -> Callable[[Callable[[bool], Tables]], Callable[[bool], Tables]]:
    """Make a script of the last function of a module: it is called with ``quick``, its tables are printed and written.

    Nothing runs where the module is imported.
    """

    def decorate(function: Callable[[bool], Tables]) -> Callable[[bool], Tables]:
        if function.__module__ == "__main__":
            options = arguments(description or "")
            tables = function(options.quick)
            for title, rows in tables.items():
                if rows:
                    print_table(title, [rows] if isinstance(rows, Mapping) else rows)
            write_json(options.json, tables)
        return function

    return decorate


def effort_count(*, quick: int, full: int) -> int:
    """Return how many cases a test runs: ``full`` under SPALLWATCH_EFFORT=full, else ``quick``."""
    return full if os.environ.get("SPALLWATCH_EFFORT") == "full" else quick


def interleaved_ms(functions: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Return the median thread time of each function, ms.

    They take turns, so that whatever disturbs the machine disturbs all of them; each is called twice beforehand.
    """
    for function in functions.values():
        function()
        function()
    times: dict[str, list[float]] = {name: [] for name in functions}
    for _ in range(rounds):
        for name, function in functions.items():
            start = time.thread_time()
            function()
            times[name].append(time.thread_time() - start)
    return {name: 1e3 * statistics.median(values) for name, values in times.items()}


def calibration_kernel() -> Callable[[], object]:
    """Return one planned float32 real FFT of 128,000 samples (pyfftw, one thread), ready to be timed."""
    source = pyfftw.zeros_aligned(CALIBRATION_SAMPLES, "float32")
    target = pyfftw.zeros_aligned(CALIBRATION_SAMPLES // 2 + 1, "complex64")
    plan = pyfftw.FFTW(source, target, flags=("FFTW_ESTIMATE",), threads=1)
    source[:] = np.random.default_rng(0).standard_normal(CALIBRATION_SAMPLES)
    return plan.execute


def print_table(title: str, rows: Sequence[Row]) -> None:
    """Print rows with the same keys as a table, numbers with three digits."""
    names = list(rows[0])
    cells = [[_text(row[name]) for name in names] for row in rows]
    widths = [max(len(name), *(len(line[i]) for line in cells)) for i, name in enumerate(names)]
    print(f"\n{title}")
    for line in [names, ["-" * w for w in widths], *cells]:
        first, *others = zip(line, widths, strict=True)
        print("  ".join([first[0].ljust(first[1]), *(cell.rjust(width) for cell, width in others)]))


def _text(value: float | str | None) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.3g}" if abs(value) < 1e-2 or abs(value) >= 1e5 else f"{value:.4g}"
    return str(value)


def circumstances() -> dict[str, str]:
    """Return date, commit, processor and versions: what a figure is worth nothing without."""
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False)
    dirty = subprocess.run(["git", "status", "--porcelain"], capture_output=True, text=True, check=False)
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "commit": (commit.stdout.strip() or "unknown") + ("+" if dirty.stdout.strip() else ""),
        "machine": _processor(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "pyfftw": pyfftw.__version__,
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{len(names)} x {names[0]}" if names else platform.machine()


def write_json(path: Path | None, tables: Mapping[str, Sequence[Row] | Row]) -> None:
    """Write all tables and the circumstances to a file, if one was asked for."""
    if path is None:
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({**circumstances(), **tables}, indent=1) + "\n", encoding="utf-8")
