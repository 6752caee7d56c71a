"""What a logger of a seed measures: rate, channels, starts, faults of its clock; and the truth that is written down.

Nothing of the program is imported: what judges it shares no code with it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, TypeVar
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import NDArray

GRAVITY = 9.80665
SPEED_HZ = 24.8
OUTER_HZ = 88.9
"""Fault line of the outer race of a 6205 at that speed."""

FORMATS = (
    *("csv",) * 26, *("lvm",) * 5, *("tdms",) * 7, *("hdf5",) * 6, *("netcdf",) * 5, *("mat",) * 4, *("wav",) * 3,
    *("uff",) * 2, *("npy",) * 2,
)  # fmt: skip
"""Of the sixty layouts of a set."""

_SENSOR_MAX_HZ = 2000.0
"""Up to which sensors of velocity reach where nothing else is known of them."""
PER_UNIT = {"m/s2": 1.0, "m/s²": 1.0, "m/s^2": 1.0, "mm/s2": 1e-3, "g": GRAVITY, "mg": GRAVITY / 1e3}
"""m/s2 of one unit."""

Samples = NDArray[np.float64]
T = TypeVar("T")


class Draw:
    """Choices at random that are kept by name.

    Attributes:
        random: source of the numbers.
        chosen: what was chosen, by name.
    """

    def __init__(self, seed: int) -> None:
        """Begin the choices of a seed."""
        self.random = np.random.default_rng([20241104, seed])
        self.chosen: dict[str, Any] = {}

    def one(self, name: str, options: Sequence[T], weights: Sequence[float] | None = None) -> T:
        """Choose one of ``options`` and keep it; what has been chosen stays."""
        if name in self.chosen:
            return self.chosen[name]
        shares = None if weights is None else np.asarray(weights, float) / sum(weights)
        value = options[int(self.random.choice(len(options), p=shares))]
        self.chosen[name] = value
        return value

    def fix(self, name: str, value: T) -> T:
        """Replace what was chosen."""
        self.chosen[name] = value
        return value

    def yes(self, name: str, share: float) -> bool:
        """Choose whether, with a probability."""
        return self.one(name, [True, False], [share, 1.0 - share])


@dataclass
class TrueChannel:
    """A channel of vibration.

    Attributes:
        name: in the files.
        key: group and name, or name of the variable.
        column: from 1 on, in files of rows; in those of one channel 1.
        unit: as stored.
        sensitivity_mv_per_g: of the sensor, where volts are stored.
        scale: g of one stored count or of full scale, where counts are stored.
        acceleration: whether it is one; a velocity is its running sum.
    """

    name: str
    key: str = ""
    column: int = 1
    unit: str = "g"
    sensitivity_mv_per_g: float | None = None
    scale: float | None = None
    acceleration: bool = True

    def stored(self, si: Samples) -> Samples:
        """Return an acceleration in m/s2 as the logger stores it."""
        if self.scale is not None:
            return si / GRAVITY / self.scale
        if self.sensitivity_mv_per_g is not None:
            return si / GRAVITY * self.sensitivity_mv_per_g * (1.0 if self.unit == "mV" else 1e-3)
        if not self.acceleration:
            return 1e3 * self.velocity(si)
        return si / PER_UNIT[self.unit]

    def velocity(self, si: Samples) -> Samples:
        """Return an acceleration in m/s2 as a sensor of velocity gives it, m/s."""
        return np.cumsum(si, axis=-1) / 25600.0

    def levels(self, si: Samples, rate: float) -> tuple[float, float | None]:
        """Return the RMS in m/s2 and, of a velocity, that in m/s; the former then of its derivative up to 2 kHz.

        The spectrum of a running sum is known from that of the row, without the ends that a derivative has.
        """
        if self.acceleration:
            return float(np.std(si)), None
        turns = np.fft.rfftfreq(si.size, 1.0 / rate)
        gain = np.divide(np.pi * turns / 25600.0, np.sin(np.pi * turns / rate), where=turns > 0.0, out=0.0 * turns)
        power = np.abs(np.fft.rfft(si) * gain)[turns <= _SENSOR_MAX_HZ] ** 2
        return float(np.sqrt(2.0 * np.sum(power)) / si.size), float(np.std(self.velocity(si)))


@dataclass
class TrueFile:
    """One recording of the logger: a file, or one of each channel.

    Attributes:
        paths: relative to the folder of data.
        start_utc: s since 1970; None where nothing states it.
        rms: of each channel, m/s2; ``velocity`` that of one of velocity, m/s.
        clock: whether the clock of the logger was right.
        lost: how samples that were lost are filled, "" where none are.
    """

    paths: list[str]
    start_utc: float | None
    rms: list[float]
    clock: bool = True
    lost: str = ""
    velocity: list[float | None] = field(default_factory=list)


@dataclass
class LoggerTruth:
    """What is in the files of a logger.

    Attributes:
        seed, format: of the layout.
        rate_hz: of the vibration.
        channels: of vibration; other columns are none.
        files: in order of time.
        speed_hz: where it is stated.
        zone: what a person answers who is asked for the zone.
        unknowable: facts that nothing states ("rate", "level", "start", "order"): to ask for them is right.
        ambiguous: facts that can be read in two ways: to ask or to refuse is right, and so is the true reading.
        answers: options of ``init`` that a person answers with who knows the logger.
        chosen: what was drawn.
    """

    seed: int
    format: str
    rate_hz: float
    channels: list[TrueChannel]
    files: list[TrueFile]
    speed_hz: float | None = None
    zone: str = "UTC"
    unknowable: list[str] = field(default_factory=list)
    ambiguous: list[str] = field(default_factory=list)
    answers: dict[str, str] = field(default_factory=dict)
    chosen: dict[str, Any] = field(default_factory=dict)

    def write(self, path: Path) -> None:
        """Write it as JSON."""
        path.write_text(json.dumps(asdict(self), indent=1, ensure_ascii=False, default=str) + "\n", encoding="utf-8")


def read_truth(path: Path) -> LoggerTruth:
    """Return what :meth:`LoggerTruth.write` wrote."""
    values: Mapping[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    channels = [TrueChannel(**each) for each in values["channels"]]
    return LoggerTruth(**{**values, "channels": channels, "files": [TrueFile(**each) for each in values["files"]]})


@dataclass
class Plan:
    """What all formats draw alike.

    Attributes:
        draw: further choices.
        format: of the files.
        rate: Hz.
        signals: of each file, m/s2, shape (channel, sample).
        starts: of each file, true.
        zone: of the clock of the logger.
        dating: what states the start: "head", "name", "folder", "rows" or "none".
        grouping: "flat", "dates", "hours" or "channels" (a file for each channel).
        fault: of the clock: "" or "1970", "2006", "autumn".
        lost: how lost samples are filled, in the last file.
        speed_in: "name", "head" or "".
    """

    draw: Draw
    format: str
    rate: float
    signals: list[Samples]
    starts: list[datetime]
    zone: str
    dating: str
    grouping: str
    fault: str
    lost: str
    speed_in: str

    def wall(self, index: int) -> datetime:
        """Return what the clock of the logger showed at the start of a file, with its zone."""
        if self.fault in ("1970", "2006") and index in self.wrong_clock:
            return datetime(int(self.fault), 1, 1, 0, 10 * index, 12, tzinfo=ZoneInfo(self.zone))
        return self.starts[index].astimezone(ZoneInfo(self.zone))

    @property
    def wrong_clock(self) -> tuple[int, ...]:
        """Files that the clock dates wrongly, never the most of them."""
        if self.fault not in ("1970", "2006"):
            return ()
        return (1, 2) if len(self.starts) > 4 else (1,)


def vibration(random: np.random.Generator, rate: float, count: int, rms: float) -> Samples:
    """Return noise within a band and impacts at the fault line: no mean, the level asked for, m/s2."""
    spectrum = np.fft.rfft(random.standard_normal(count))
    frequency = np.fft.rfftfreq(count, 1.0 / rate)
    spectrum[(frequency < 0.02 * rate) | (frequency > 0.42 * rate)] = 0.0
    found = np.fft.irfft(spectrum, count)
    found /= np.sqrt(np.mean(found**2))
    ring = np.arange(int(0.004 * rate)) / rate
    shape = 4.0 * np.exp(-ring / 8e-4) * np.sin(2.0 * np.pi * 0.23 * rate * ring)
    for place in (np.arange(1, count / rate * OUTER_HZ) / OUTER_HZ * rate).astype(int):
        part = found[place : place + len(ring)]
        part += shape[: len(part)]
    found -= found.mean()
    return found * (rms / np.sqrt(np.mean(found**2)))


def plan_of(seed: int) -> Plan:
    """Draw what the formats have in common."""
    draw = Draw(seed)
    order = np.random.default_rng(60).permutation(len(FORMATS))
    form = FORMATS[order[seed % len(FORMATS)]]
    draw.chosen["format"] = form
    rates = [4000.0, 4096.0, 5000.0, 6400.0, 8192.0, 10240.0, 12800.0, 16384.0, 20000.0, 25600.0]
    rate = draw.one("rate_hz", rates)
    seconds = draw.one("seconds", [1, 2, 5] if rate < 10000 else [1, 2], [5, 3, 1] if rate < 10000 else [4, 1])
    files = int(draw.one("files", [3, 4, 5, 6]))
    axes = draw.one("axes", [1, 2, 3], [5, 3, 2])
    text = form in ("csv", "lvm")
    dating = draw.one("dating", *(_DATING[form]))
    grouping = draw.one("grouping", *(_GROUPING[dating] if text else ((("flat",), (1,)))))
    if grouping == "channels":
        axes = draw.fix("axes", draw.one("axes_of_files", [2, 3]))
    zone = draw.one("zone", ["UTC", "Europe/Berlin"], [3, 2])
    fault = draw.one("clock", ["", "1970", "2006", "autumn"], [17, 1, 1, 1]) if dating != "none" else ""
    lost = draw.one("lost", ["", "fill", "zeros", "held"], [14, 1, 1, 1]) if form not in ("wav", "npy") else ""
    signals = [_signals(draw, rate, seconds, axes) for _ in range(files)]
    starts = _starts(draw, files, seconds, fault)
    if fault == "autumn":
        zone = draw.fix("zone", "Europe/Berlin")
    speed_in = draw.one("speed_in", ["", "name", "head"], [6, 1, 1])
    return Plan(draw, form, rate, signals, starts, zone, dating, grouping, fault, lost, speed_in)


_DATING: Mapping[str, tuple[Sequence[str], Sequence[float]]] = {
    "csv": (("head", "name", "folder", "rows", "none"), (6, 5, 3, 4, 1)),
    "lvm": (("head",), (1,)),
    "tdms": (("head", "name", "none"), (6, 1, 1)),
    "hdf5": (("head", "name", "none"), (5, 2, 1)),
    "netcdf": (("head", "name"), (5, 1)),
    "mat": (("head", "name", "none"), (4, 2, 1)),
    "wav": (("name", "none"), (4, 1)),
    "uff": (("head",), (1,)),
    "npy": (("name", "head"), (1, 1)),
}
_GROUPING: Mapping[str, tuple[Sequence[str], Sequence[float]]] = {
    "head": (("flat", "dates", "channels"), (6, 1, 1)),
    "name": (("flat", "channels"), (5, 1)),
    "folder": (("dates", "hours", "channels"), (2, 1, 1)),
    "rows": (("flat", "channels"), (8, 1)),
    "none": (("flat",), (1,)),
}


def _signals(draw: Draw, rate: float, seconds: float, axes: int) -> Samples:
    level = draw.random.uniform(2.0, 9.0)
    shares = (1.0, 0.62, 0.37)[:axes]
    return np.stack([vibration(draw.random, rate, int(rate * seconds), level * share) for share in shares])


def _starts(draw: Draw, files: int, seconds: float, fault: str) -> list[datetime]:
    if fault == "autumn":
        first, interval = datetime(2025, 10, 26, 0, 10, tzinfo=UTC), 1250.0
    else:
        days = int(draw.random.integers(0, 900))
        first = datetime(2024, 1, 3, tzinfo=UTC) + timedelta(days=days, seconds=int(draw.random.integers(0, 86000)))
        interval = draw.one("interval_s", [60.0, 600.0, 3600.0, float(seconds)])
    drift = draw.one("drift_ppm", [0.0, 80.0], [5, 1])
    return [first + timedelta(seconds=round(index * interval * (1.0 + 1e-6 * drift))) for index in range(files)]


def with_lost(samples: Samples, how: str) -> tuple[Samples, NDArray[np.bool_]]:
    """Return samples of which a tenth in three runs are lost, and which; "fill" leaves their value to the format."""
    lost = np.zeros(samples.shape[1], bool)
    run = samples.shape[1] // 30
    for part in (0.2, 0.5, 0.8):
        begin = int(part * samples.shape[1])
        lost[begin : begin + run] = True
    found = samples.copy()
    if how == "zeros":
        found[:, lost] = 0.0
    elif how == "held":
        last = np.maximum.accumulate(np.where(lost, 0, np.arange(len(lost))))
        found = found[:, last]
    return found, lost
