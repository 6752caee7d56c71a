"""Makers and checks that tests of library learn share."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from click.testing import CliRunner, Result

from monitor.cli import spallwatch

HEALTHY = 140


def features(path: Path, *, last: int = 60, axis: str = "", seed: int = 0, **more: Sequence[float]) -> Path:
    """Write a run of 10 s blocks: a healthy machine, then ``last`` blocks of rising RMS."""
    rng = np.random.default_rng(seed)
    level = np.ones(HEALTHY + last)
    level[HEALTHY:] = 1.8 + 4.0 * (np.arange(last) / max(last, 1)) ** 2
    rms = level * np.exp(0.03 * rng.standard_normal(level.size))
    prefix = f"{axis}_" if axis else ""
    columns: dict[str, Sequence[float]] = {
        "elapsed_s": (10.0 * np.arange(level.size)).tolist(),
        f"{prefix}rms_g": rms.tolist(),
        **more,
    }
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
    return path


def learn(*arguments: object) -> Result:
    return CliRunner().invoke(spallwatch, ["library", "learn", *map(str, arguments)])


def learned(*arguments: object) -> dict[str, Any]:
    run = learn("--json", *arguments)
    assert run.exit_code == 0, run.output
    return json.loads(run.stdout)
