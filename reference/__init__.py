"""What tests and benchmarks share: simulated signals, recordings with what is expected of each, slow counterparts."""

from __future__ import annotations

import os
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[1]


def recordings_folder() -> Path:
    """Return the folder of recordings: SPALLWATCH_DATA, by default ../shared/data beside the repository."""
    return Path(os.environ.get("SPALLWATCH_DATA") or _ROOT.parent / "shared" / "data")
