"""Files of one second each, ten minutes apart, in formats that state their start each in its own way."""

from __future__ import annotations

import json
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
from scipy.io import wavfile

from tests.support.stated_files import RATE, iso, noise, write_csv, write_hdf5, write_tdms

FIRST = datetime(2024, 5, 6, 7, 0, tzinfo=UTC)
EVERY = timedelta(minutes=10)
COUNT = 12
RIGHT = [FIRST + index * EVERY for index in range(COUNT)]
DOUBTED = {"clock", "late", "out_of_order"}
"""Flags of blocks whose time is not believed, or not in order."""


def _csv(folder: Path, index: int, clock: datetime | None) -> None:
    start = [] if clock is None else [f"Start: {iso(clock)}"]
    write_csv(folder / f"{index:02d}.csv", noise(seed=index + 1), [f"fs: {RATE:g}", "Unit: g", *start])


def _words(clock: datetime | None) -> dict[str, str]:
    return {} if clock is None else {"start_utc": iso(clock)}


def _npy(folder: Path, index: int, clock: datetime | None) -> None:
    np.save(folder / f"{index:02d}.npy", noise(seed=index + 1)[0])
    words = {"rate_hz": RATE, "unit": "g", **_words(clock)}
    (folder / f"{index:02d}.npy.json").write_text(json.dumps(words), encoding="utf-8")


def _wav(folder: Path, index: int, clock: datetime | None) -> None:
    wavfile.write(folder / f"{index:02d}.wav", int(RATE), noise(seed=index + 1)[0].astype(np.float32))
    words = {"unit": "g", **_words(clock)}
    (folder / f"{index:02d}.wav.json").write_text(json.dumps(words), encoding="utf-8")


def _hdf5(folder: Path, index: int, clock: datetime | None) -> None:
    write_hdf5(folder / f"{index:02d}.h5", noise(seed=index + 1), {"fs": RATE, **_words(clock)}, {"unit": "g"})


def _tdms(folder: Path, index: int, clock: datetime | None) -> None:
    start = {} if clock is None else {"wf_start_time": np.datetime64(clock.replace(tzinfo=None), "us")}
    words = {"wf_increment": 1 / RATE, "unit_string": "g", **start}
    write_tdms(folder / f"{index:02d}.tdms", noise(seed=index + 1), None, words)


MAKERS: dict[str, tuple[str, Callable[[Path, int, datetime | None], None]]] = {
    "csv": ('column = "acc"', _csv),
    "npy": ("column = 1", _npy),
    "wav": ("column = 1", _wav),
    "hdf5": ('key = "acc_1"', _hdf5),
    "tdms": ('key = "Vibration/acc_1"', _tdms),
}
