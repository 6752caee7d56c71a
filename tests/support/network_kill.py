"""Makers and checks that tests of network kill share."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from monitor.config.load import Config, validate
from streams.types.block import Block

_RATE, _SAMPLES = 2560.0, 256


_LAST = 10**6


class Made:
    """A recording that never ends; every block is another one."""

    name = "s"

    def __len__(self) -> int:
        return _LAST

    def __iter__(self) -> Iterator[Block]:
        for number in range(1, _LAST + 1):
            yield block(number)


def block(number: int) -> Block:
    samples = np.random.default_rng(number).standard_normal((1, _SAMPLES)).astype(np.float32)
    return Block(samples, _RATE, ("x",), ("g",), "s", number, str(number), start=1.7e9 + 0.1 * number)


def config(url: str) -> Config:
    return validate(
        {
            "machine": {"name": "m"},
            "bearing": [{"name": "b", "designation": "1205 ETN9"}],
            "operating": {"speed_hz": 40.0},
            "source": [{"name": "s", "url": url}],
            "channel": [{"name": "x", "source": "s", "unit": "g", "bearing": "b", "band_hz": [[300, 1200]]}],
        },
        Path("machine.toml"),
    )
