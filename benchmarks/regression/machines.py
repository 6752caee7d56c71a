"""Configurations and seeded recordings of the cases."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

RATE = 2560
BLOCK = 512
"""Samples of a block: 0.2 s."""
BEGIN = datetime(2026, 3, 1, 6, tzinfo=UTC)
_OUTER_HZ = 196.0
"""About the outer-race frequency of a 1205 ETN9 at 40 Hz."""
_STEP = 0.01
"""m/s2 of one step of the whole-number recordings."""

CHANNEL = {"source": "s", "bearing": "b", "unit": "m/s2", "band_hz": [[300, 1200]], "rms_band_hz": [10, 1000]}
_SECTIONS: Mapping[str, Mapping[str, Any]] = {
    "machine": {"name": "m", "min_free_mb": 1, "spectra": 10, "spectra_interval_s": 0.4},
    "publish": {"interval_s": 0.3},
    "web": {"enabled": False},
    "operating": {"speed_hz": 40.0, "load_newton": 4000.0},
    "detect": {"learn_blocks": 20, "run_in_blocks": 2, "persist_blocks": 3, "end_of_life_peak_g": 200},
}


def machine_text(
    source: Mapping[str, Any],
    *channels: Mapping[str, Any],
    levels: Sequence[Mapping[str, Any]] = (),
    **sections: Mapping[str, Any],
) -> str:
    """Return the configuration of a machine with one source ``s`` and one bearing ``b``, a 1205 ETN9.

    Args:
        source: keys of the source.
        channels: keys of each channel, beside those of ``CHANNEL``.
        levels: alarm levels.
        sections: keys that are added to those of ``_SECTIONS``.
    """
    names = dict.fromkeys([*_SECTIONS, *sections])
    parts = [_table(f"[{name}]", {**_SECTIONS.get(name, {}), **sections.get(name, {})}) for name in names]
    parts.append(_table("[[bearing]]", {"name": "b", "designation": "1205 ETN9"}))
    parts.append(_table("[[source]]", {"name": "s", **source}))
    parts += [_table("[[channel]]", {**CHANNEL, **channel}) for channel in channels]
    parts += [_table("[[alarms.level]]", level) for level in levels]
    return "".join(parts)


def _table(head: str, values: Mapping[str, Any]) -> str:
    # Strings, numbers, booleans and lists of them are written the same in JSON and TOML.
    return f"{head}\n" + "".join(f"{key} = {json.dumps(value)}\n" for key, value in values.items())


def sound(count: int, seed: int, damage: float = 0.0, noise: float = 0.3, rate: int = RATE) -> NDArray[np.float64]:
    """Return noise (RMS, m/s2) with decaying bursts at the outer-race frequency, ``damage`` m/s2 high."""
    time = np.arange(count) / rate
    bursts = np.exp(-((time * _OUTER_HZ) % 1.0) * 8.0) * np.sin(2.0 * np.pi * 700.0 * time)
    return noise * np.random.default_rng(seed).standard_normal(count) + damage * bursts


def life(blocks: int, onset: int, seed: int) -> NDArray[np.float64]:
    """Return a life of a bearing, m/s2, shape (blocks * BLOCK,): the damage grows from a block on."""
    heights = [0.0 if block < onset else 6.0 + 0.8 * (block - onset) for block in range(1, blocks + 1)]
    return np.concatenate([sound(BLOCK, 1000 * seed + block, height) for block, height in enumerate(heights, 1)])


def save_log(path: Path, blocks: int, onset: int, seed: int) -> dict[str, Any]:
    """Write a life as one .npy file of whole numbers; return the keys of a source and channel that read it."""
    np.save(path, np.round(life(blocks, onset, seed) / _STEP).astype(np.int16))
    return {"column": 1, "scale": _STEP}


def save_csv(path: Path, columns: Mapping[str, NDArray[np.float64]], start: datetime | None = None) -> None:
    """Write channels in m/s2 as text of five digits, whole from the first moment on, with a date where one is given."""
    head = f"# rate_hz: {RATE}\n" + ("" if start is None else f"# start_utc: {start.isoformat()}\n")
    rows = zip(*columns.values(), strict=True)
    body = "".join(",".join(f"{value:.5f}" for value in row) + "\n" for row in rows)
    part = path.with_name(f".{path.name}.part")
    part.write_text(f"{head}{','.join(f'{name} [m/s2]' for name in columns)}\n{body}", encoding="utf-8")
    part.rename(path)


def save_files(folder: Path, heights: Sequence[float | None], first: int = 1) -> None:
    """Write one dated CSV file a block: noise with bursts of a height, a dead sensor where it is None."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, height in enumerate(heights, first):
        samples = np.zeros(BLOCK) if height is None else sound(BLOCK, number, height)
        start = BEGIN + timedelta(seconds=10 * number)
        save_csv(folder / f"f{number:04d}.csv", {"x": samples, "y": sound(BLOCK, number + 5000)}, start)


def save_tdms(path: Path, columns: Mapping[str, NDArray[np.float64]]) -> None:
    """Write channels in m/s2 as a TDMS file of several segments."""
    from nptdms import ChannelObject, TdmsWriter

    properties = {
        "wf_increment": 1.0 / RATE,
        "wf_start_time": np.datetime64(int(BEGIN.timestamp() * 1e6), "us"),
        "unit_string": "m/s2",
    }
    with TdmsWriter(path) as writer:
        for parts in zip(*(np.array_split(column, 3) for column in columns.values()), strict=True):
            objects = zip(columns, parts, strict=True)
            writer.write_segment([ChannelObject("run", name, part, properties=properties) for name, part in objects])
