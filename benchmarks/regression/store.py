"""Results of the baseline: those that are kept between runs, and the store that a test goes on with."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.regression.cases import LIFE_CUT
from benchmarks.regression.observe import Observation

EXPECTED = "expected.json"


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


def keep_store(result: Path, out: Path, baseline: str) -> None:
    """Write the files of the case ``store_migration`` and the blocks that must come after the store.

    Args:
        result: folder of the case's result in the baseline.
        out: folder that is written.
        baseline: commit that made the store.
    """
    out.mkdir(parents=True, exist_ok=True)
    for file in (result / "files").iterdir():
        shutil.copy(file, out)
    observed = load(result)
    onset = {key: float(observed[f"out/replay/channels/x/{key}"][0]) for key in ("t_fs_block", "t_fs_known_block")}
    made = f"python -m benchmarks.regression --keep-store {out}"
    values = {"made_by": made, "commit": baseline, "blocks": LIFE_CUT, "onset": onset, "columns": next_blocks(observed)}
    (out / EXPECTED).write_text(json.dumps(values, allow_nan=False) + "\n", encoding="utf-8")


def next_blocks(observed: Observation) -> dict[str, Any]:
    """Return the columns of the store for the blocks after the cut, as plain values; None for NaN."""
    found: dict[str, Any] = {}
    for name, column in observed.items():
        _, _, key = name.partition("/store/")
        numbers = observed.get(f"{name.rpartition('/')[0]}/sequence")
        if key and numbers is not None:
            found[key] = _plain(column[numbers > LIFE_CUT])
    return found


def _plain(column: NDArray[Any]) -> list[Any]:
    if column.dtype.kind != "f":
        return column.tolist()
    return np.where(np.isnan(column), np.array(None), column.astype(object)).tolist()
