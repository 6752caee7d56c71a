"""Files of a logger on a press: two columns, one of them with the bursts of an outer race."""

from __future__ import annotations

from pathlib import Path

import numpy as np

RATE = 10_000
OUTER_HZ = 105.75
"""Of a 6205 at 29.5 Hz."""


def write_press(folder: Path, unit: str = "g", *, count: int = 3, damage: float = 0.0) -> Path:
    """Write tables of a second of noise of RMS 1, an hour apart by their names; return the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    random, times = np.random.default_rng(1), np.arange(RATE) / RATE
    bursts = damage * np.exp(-((times * OUTER_HZ) % 1.0) * 9.0) * np.sin(2 * np.pi * 2700.0 * times)
    for hour in range(count):
        noise = random.normal(size=(RATE, 2))
        rows = np.column_stack([times, noise[:, 0] + bursts, noise[:, 1]])
        lines = [",".join(f"{value:.6f}" for value in row) for row in rows]
        head = f"time (s),drive end ({unit}),other end ({unit})"
        (folder / f"2026-03-01_{hour:02d}0000.csv").write_text("\n".join([head, *lines, ""]))
    return folder
