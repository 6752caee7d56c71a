"""Makers and checks that tests of records spectra share."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from monitor.config.load import Config, validate
from monitor.health.record import Record
from monitor.health.signal.waterfall import SpectrumChange
from monitor.health.state import Stored
from monitor.records.store import Store
from monitor.service.setup import source_settings
from reference.steps import Steps
from streams.types.block import Block, Rejected
from tests.support.pipeline import DETECT, RATE, SPEED, life

START = 1_700_000_000.0


def machine(folder: Path | str = "in", rows: int = 6, interval: float = 30.0, **channel: Any) -> Config:
    listening = {"name": "x", "source": "s", "column": 1, "unit": "m/s2", "bearing": "b"}
    return validate(
        {
            "machine": {"name": "m", "spectra": rows, "spectra_interval_s": interval},
            "bearing": [{"name": "b", "designation": "PRONOSTIA"}],
            "operating": {"speed_hz": SPEED},
            "source": [{"name": "s", "url": f"folder:{folder}", "rate_hz": RATE, "block_s": 0.1, "format": "csv"}],
            "channel": [listening | {"band_hz": [[500, 6000]]} | channel],
            "detect": {
                "learn_blocks": DETECT.learn_blocks,
                "run_in_blocks": DETECT.run_in_blocks,
                "persist_blocks": DETECT.persist_blocks,
            },
        },
        Path("machine.toml"),
    )


def steps_of(config: Config, stored: Stored | None = None) -> Steps:
    return Steps(source_settings(config, config.source[0]), stored)


def blocks(count: int = 80, **more: Any) -> list[Block]:
    made = []
    for place, samples in enumerate(life(count)):
        given_fields = {"start": START + 10.0 * place, "elapsed": 10.0 * place, "content_hash": f"{place}"} | more
        made.append(Block(samples[None], RATE, ("x",), ("m/s2",), "s", place + 1, f"b{place}", **given_fields))
    return made


def take(store: Store, steps: Steps, items: Sequence[Block | Rejected], batch: int = 1) -> None:
    for first in range(0, len(items), batch):
        records: list[tuple[Record, dict[str, Any]]] = []
        changes: list[SpectrumChange] = []
        for item in items[first : first + batch]:
            records.append((steps.take(item), steps.stored()))
            changes += steps.spectra
        store.commit_many(records, spectra=changes)
