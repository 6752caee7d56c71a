"""Results of the baseline that are kept between runs, and the columns of blocks after others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.regression.observe import Observation


def save(result: Path, observed: Observation) -> None:
    """Keep what was observed in the folder of a result; it is complete once its file ``done`` is there."""
    result.mkdir(parents=True, exist_ok=True)
    columns: dict[str, Any] = dict(observed)
    np.savez_compressed(result / "observed.npz", **columns)
    (result / "done").touch()


def load(result: Path) -> Observation:
    """Return what :func:`save` kept."""
    with np.load(result / "observed.npz", allow_pickle=False) as columns:
        return {name: columns[name] for name in columns.files}


def next_blocks(observed: Observation, cut: int) -> dict[str, Any]:
    """Return the columns of the store for the blocks after ``cut``, as plain values; None for NaN."""
    found: dict[str, Any] = {}
    for name, column in observed.items():
        _, _, key = name.partition("/store/")
        numbers = observed.get(f"{name.rpartition('/')[0]}/sequence")
        if key and numbers is not None:
            found[key] = _plain(column[numbers > cut])
    return found


def _plain(column: NDArray[Any]) -> list[Any]:
    if column.dtype.kind != "f":
        return column.tolist()
    return np.where(np.isnan(column), np.array(None), column.astype(object)).tolist()
