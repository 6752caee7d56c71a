"""Makers and checks that tests of lost store share."""

from __future__ import annotations

from pathlib import Path

import xarray as xr


def blocks_of(records_dir: Path) -> int:
    found = 0
    for path in records_dir.glob("m-*.nc"):
        with xr.open_dataset(path) as dataset:
            found += dataset.sizes["time"]
    return found
