"""Small recordings that were replayed, as the tasks of an archive leave them."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np

import spallwatch as sw
from monitor.fleet.result import RESULT_NAME, RecordingResult, RecordsFile, Shape

RATE = 2000.0
BLOCK = 0.5


def tables(url: Path, channels: int = 1, *, start: Any = None, **channel: Any) -> dict[str, Any]:
    """Return the configuration of a machine."""
    dated = {} if start is None else {"start_utc": start}
    names = [f"column_{number}" for number in range(1, channels + 1)]
    return {
        "bearing": [{"name": "bearing", "designation": "6205"}],
        "operating": {"speed_hz": 10.0},
        "source": [{"name": "signal", "url": str(url), "rate_hz": RATE, "block_s": BLOCK, **dated}],
        "channel": [{"name": name, "source": "signal", "bearing": "bearing", "unit": "g", **channel} for name in names],
    }


def replayed(folder: Path, name: str, blocks: int, channels: int = 1, **config: Any) -> RecordingResult:
    """Replay noise into MACHINE/RECORDING, which is ``name``, under a folder."""
    machine, recording = name.split("/")
    path = folder / f"{machine}-{recording}.npy"
    samples = np.random.default_rng(blocks).standard_normal((channels, int(blocks * RATE * BLOCK)))
    np.save(path, samples.astype(np.float32))
    sw.replay(config=tables(path, channels, **config), out=folder / name)
    found = described(folder, machine, recording)
    (folder / name / RESULT_NAME).write_bytes(found.to_json())
    return found


FEW = frozenset({"rms", "h_or", "envelope_snr", "bpfo_amplitude", "stage", "quality_flags", "fault", "t_fs", "v_th"})
"""Variables of each kind and shape; writing all of them takes ten times as long."""


def trimmed(results: list[RecordingResult], few: Collection[str] = FEW) -> list[RecordingResult]:
    """Return results as if the records had few variables."""
    return [
        replace(
            result,
            shape=replace(
                result.shape, variables={name: dims for name, dims in result.shape.variables.items() if name in few}
            ),
        )
        for result in results
    ]


def described(folder: Path, machine: str, recording: str) -> RecordingResult:
    """Return what records in a folder are."""
    found, shape = RecordingResult(machine, recording, f"file:///{recording}.npy"), Shape()
    files: list[RecordsFile] = []
    for path in sorted((folder / machine / recording / "records").glob("*.nc"), reverse=True):
        with netCDF4.Dataset(path) as file:
            times = file.variables["time"][...].tolist()
            day = int(times[0] // 86400) if file.getncattr("dated") == "yes" else None
            name = path.relative_to(folder).as_posix()
            files.append(RecordsFile(name, day, len(times), path.stat().st_size))
            along = {
                name: item.dimensions[1:]
                for name, item in file.variables.items()
                if item.dimensions[:1] == ("time",) and name != "time"
            }
            sizes = {name: len(item) for name, item in file.dimensions.items() if name != "time"}
            channels = tuple(map(str, file.variables["channel"][...]))
            shape = Shape(channels, {**along, **shape.variables}, {**sizes, **shape.sizes}, {"machine": machine})
    files.sort(key=lambda file: (file.day is not None, file.day))
    return replace(found, files=tuple(files), rows=sum(file.rows for file in files), shape=shape)
