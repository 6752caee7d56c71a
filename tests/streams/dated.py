"""Sources whose blocks are to be dated, and what is compared of them."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import soundfile

from streams.open import open_source
from streams.types.block import Block, Rejected
from streams.types.spec import SourceSpec
from tests.streams.folders import CHANNELS, RATE, Rig, csv_bytes, noise

START = datetime(2024, 1, 31, 23, 0, 0, tzinfo=UTC).timestamp()
Row = tuple[str, str, float | None, float | None, str]


def write(folder: Path, name: str, seed: int, count: int = 100, head: str = "") -> Path:
    """Write a file of some samples in the format of its ending."""
    path = folder / name
    path.parent.mkdir(exist_ok=True)
    samples = noise(count, seed)
    if name.endswith(".npy"):
        np.save(path, samples)
    elif name.endswith(".wav"):
        soundfile.write(path, samples.astype(np.float32), int(RATE), subtype="FLOAT")
    else:
        path.write_bytes(head.encode() + csv_bytes(samples))
    return path


def spec_of(folder: Path, **settings: Any) -> SourceSpec:
    base: dict[str, Any] = {"rate": RATE, "channels": CHANNELS, "block_s": "file"}
    return SourceSpec("s", f"folder:{folder}", **base | settings)


def rows(items: Iterable[Block | Rejected], *, order: bool = False) -> list[Row]:
    """Return name, verdict, start, elapsed time and content of items, sorted by name unless ``order``."""
    found = [
        (item.name, "ok", item.start, item.elapsed, item.content_hash)
        if isinstance(item, Block)
        else (item.name, item.status, None, None, item.content_hash)
        for item in items
    ]
    return found if order else sorted(found, key=lambda row: row[0])


def replayed(folder: Path, **settings: Any) -> list[Row]:
    return rows(open_source(spec_of(folder, **settings)))


def starts(found: Iterable[Row]) -> dict[str, float | None]:
    return {name: None if start is None else start - START for name, _, start, _, _ in found}


def elapsed(found: Iterable[Row]) -> dict[str, float | None]:
    return {name: seconds for name, _, _, seconds, _ in found}


def live(folder: Path, **settings: Any) -> Rig:
    return Rig(folder, **settings)
