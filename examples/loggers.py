"""Files of five loggers, written by the libraries of their formats alone: nothing of the project is imported.

    python examples/loggers.py FOLDER

Each logger gets a folder of its own. The truth (start, sampling rate, RMS in g of every file) is returned, so that what
a monitor says can be compared with what was written.
"""

from __future__ import annotations

import csv
import io
import os
import sys
import wave
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import h5py
import numpy as np
import scipy.io
from nptdms import ChannelObject, TdmsWriter
from numpy.typing import NDArray

GRAVITY = 9.80665
FIRST = datetime(2024, 11, 4, 8, 0, 0, tzinfo=UTC)
"""Start of the first file of each logger."""


@dataclass(frozen=True)
class Truth:
    """What was written into one file.

    Attributes:
        name: of the file.
        start: of its first sample.
        rate_hz: sampling rate.
        rms_g: of each channel without its mean, by the name that the file gives it, g.
    """

    name: str
    start: datetime
    rate_hz: float
    rms_g: dict[str, float]


def vibration(rng: np.random.Generator, seconds: float, rate: float, shaft: float, rms_g: float) -> NDArray[np.float64]:
    """Return a machine's vibration in g: unbalance, its harmonics, a resonance that impacts excite, and noise.

    Args:
        shaft: turns per second.
        rms_g: of the whole.
    """
    time = np.arange(round(seconds * rate)) / rate
    x = sum(np.sin(2 * np.pi * k * shaft * time + rng.uniform(0, 2 * np.pi)) / k**2 for k in (1, 2, 3)) * 0.3
    ring = np.exp(-900.0 * time[: round(0.01 * rate)]) * np.sin(2 * np.pi * 0.21 * rate * time[: round(0.01 * rate)])
    impacts = np.zeros(time.size)
    impacts[(np.arange(0.0, seconds, 1 / (3.58 * shaft)) * rate).astype(int)] = 0.6
    x = x + np.convolve(impacts, ring)[: time.size] + rng.normal(0.0, 0.5, time.size)
    x -= x.mean()
    return x * (rms_g / np.sqrt(np.mean(x**2)))


def rms(x: NDArray[np.floating]) -> float:
    """Return the root mean square without the mean."""
    return float(np.std(np.asarray(x, dtype=np.float64)))


def write_csv(folder: Path, count: int, seconds: float) -> list[Truth]:
    """Write German CSV: decimal commas, semicolons, Windows-1252, the date in the name, m/s²."""
    rng, rate, found = np.random.default_rng(11), 12800.0, []
    for index in range(count):
        start = FIRST + timedelta(minutes=10 * index)
        x = vibration(rng, seconds, rate, 24.8, 0.8 + 0.02 * index) * GRAVITY
        stream = io.StringIO()
        stream.write("Messgerät;QX-4\r\nZeit [s];Beschleunigung [m/s²]\r\n")
        writer = csv.writer(stream, delimiter=";", lineterminator="\r\n")
        text = [f"{value:.5f}".replace(".", ",") for value in x]
        writer.writerows((f"{i / rate:.7f}".replace(".", ","), value) for i, value in enumerate(text))
        name = f"Messung_{start:%d.%m.%Y_%H-%M-%S}.csv"
        (folder / name).write_bytes(stream.getvalue().encode("cp1252"))
        stored = np.array([float(value.replace(",", ".")) for value in text])
        found.append(Truth(name, start, rate, {"Beschleunigung": rms(stored) / GRAVITY}))
    return found


def write_tdms(folder: Path, count: int, seconds: float) -> list[Truth]:
    """Write TDMS: two channels in g, increment and start in the properties of each."""
    rng, rate, found = np.random.default_rng(12), 20000.0, []
    for index in range(count):
        start = FIRST + timedelta(minutes=5 * index)
        rows = {name: vibration(rng, seconds, rate, 29.5, level) for name, level in (("DE", 0.5), ("NDE", 0.3))}
        stated = {
            "unit_string": "g",
            "wf_increment": 1.0 / rate,
            "wf_start_time": np.datetime64(start.replace(tzinfo=None), "us"),
            "wf_start_offset": 0.0,
        }
        name = f"run_{index + 1:04d}.tdms"
        with TdmsWriter(str(folder / name)) as writer:
            writer.write_segment([ChannelObject("Vibration", key, x, properties=stated) for key, x in rows.items()])
        found.append(Truth(name, start, rate, {key: rms(x) for key, x in rows.items()}))
    return found


def write_wav(folder: Path, count: int, seconds: float) -> list[Truth]:
    """Write 16-bit WAV: ±10 V at full scale, a sensor of 100 mV/g; speed and date (two digits a year) in the name."""
    rng, rate, found = np.random.default_rng(13), 25600, []
    for index in range(count):
        start = FIRST + timedelta(minutes=15 * index)
        volts = 0.1 * vibration(rng, seconds, rate, 1480 / 60, 1.2)
        counts = np.round(volts / 10.0 * 32768.0).astype("<i2")
        name = f"pump_1480rpm_{start:%y%m%d_%H%M%S}.wav"
        with wave.open(str(folder / name), "wb") as file:
            file.setparams((1, 2, rate, 0, "NONE", ""))
            file.writeframes(counts.tobytes())
        found.append(Truth(name, start, rate, {"": rms(counts / 32768.0 * 10.0) / 0.1}))
    return found


def write_hdf5(folder: Path, count: int, seconds: float) -> list[Truth]:
    """Write HDF5: two axes in m/s^2 with rate and start as attributes, and a temperature."""
    rng, rate, found = np.random.default_rng(14), 16384.0, []
    for index in range(count):
        start = FIRST + timedelta(hours=index)
        rows = {name: vibration(rng, seconds, rate, 33.2, level) * GRAVITY for name, level in (("x", 0.4), ("y", 0.6))}
        name = f"{index:03d}.h5"
        with h5py.File(folder / name, "w") as file:
            group = file.create_group("acceleration")
            group.attrs.update(sampling_rate=rate, start_time=start.isoformat(), units="m/s^2")
            for key, x in rows.items():
                group.create_dataset(key, data=x.astype(np.float32))
            file.attrs["temperature_degc"] = 41.0 + 0.1 * index
        levels = {key: rms(x.astype(np.float32)) / GRAVITY for key, x in rows.items()}
        found.append(Truth(name, start, rate, levels))
    return found


def write_mat(folder: Path, count: int, seconds: float) -> list[Truth]:
    """Write one MAT a day: a matrix of two sensors in m/s^2, the rate, the start as a ``datenum``."""
    rng, rate, found = np.random.default_rng(15), 10240.0, []
    for index in range(count):
        start = FIRST + timedelta(days=index)
        x = np.stack([vibration(rng, seconds, rate, 16.6, level) * GRAVITY for level in (0.9, 0.7)], axis=1)
        datenum = start.toordinal() + 366 + (start - start.replace(hour=0)).total_seconds() / 86400.0
        name = f"day_{start:%Y%m%d}.mat"
        values = {"acc": x, "fs": rate, "unit": "m/s^2", "t0": datenum, "operator": "HK"}
        scipy.io.savemat(str(folder / name), values)
        found.append(Truth(name, start, rate, {f"acc_{i + 1}": rms(x[:, i]) / GRAVITY for i in range(2)}))
    return found


LOGGERS: dict[str, Callable[[Path, int, float], list[Truth]]] = {
    "csv": write_csv,
    "tdms": write_tdms,
    "wav": write_wav,
    "hdf5": write_hdf5,
    "mat": write_mat,
}


def write_all(folder: Path, count: int = 12, seconds: float = 1.0) -> dict[str, list[Truth]]:
    """Write ``count`` files of each logger into a folder of its own; return what was written."""
    found: dict[str, list[Truth]] = {}
    for name, write in LOGGERS.items():
        (folder / name).mkdir(parents=True, exist_ok=True)
        found[name] = write(folder / name, count, seconds)
        for truth in found[name]:
            # A logger closes a file at its end.
            closed = truth.start.timestamp() + seconds
            os.utime(folder / name / truth.name, (closed, closed))
    return found


if __name__ == "__main__":
    write_all(Path(sys.argv[1]))
