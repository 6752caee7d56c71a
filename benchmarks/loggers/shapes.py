"""Small files of which each statement can be set: what is stated, at which scope, under which key.

A statement is a key and a value as the format spells them. Scopes are ``file``, ``channel`` and ``sidecar``; keys that
begin with ``@`` are no attributes but parts of the layout: a column of times, a unit in brackets, a row of units.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import h5py
import netCDF4
import numpy as np
import scipy.io
import soundfile
from nptdms import ChannelObject, RootObject, TdmsWriter

from benchmarks.loggers.plan import GRAVITY, PER_UNIT, Samples

START = 1714564800.0
"""2024-05-01T12:00:00 UTC."""

FILE, CHANNEL, SIDECAR, NAME = "file", "channel", "sidecar", "name"
Spell = Callable[[Any], list[tuple[str, Any]]]


def iso(start: float) -> str:
    """Return a time as in ISO 8601, in UTC."""
    return f"{datetime.fromtimestamp(start, UTC):%Y-%m-%dT%H:%M:%S}Z"


def _spell(key: str, form: Callable[[Any], Any] = lambda value: value) -> Spell:
    return lambda value: [(key, form(value))]


def _dated(pattern: str) -> Callable[[float], str]:
    return lambda start: datetime.fromtimestamp(start, UTC).strftime(pattern)


_ATTRIBUTES: Mapping[str, list[Spell]] = {
    "rate": [_spell("fs"), _spell("sampling_rate"), _spell("rate_hz"), _spell("dt", lambda rate: 1.0 / rate)],
    "unit": [_spell("unit"), _spell("units")],
    "start": [_spell("start_utc", iso), _spell("start_time", iso)],
}
_HEAD: Mapping[str, list[Spell]] = {
    "rate": [
        _spell("Sample Rate", lambda rate: f"{rate:.9g} Hz"),
        _spell("Abtastrate", lambda rate: f"{rate / 1e3:.6f} kHz"),
        _spell("Sample Interval", lambda rate: f"{1e3 / rate:.9f} ms"),
        _spell("dt", lambda rate: f"{1.0 / rate:.12f}"),
    ],
    "unit": [_spell("Unit"), _spell("Einheit")],
    "start": [
        _spell("Start Time", iso),
        lambda start: [("Date", _dated("%Y-%m-%d")(start)), ("Time", _dated("%H:%M:%S")(start))],
    ],
}
_TIMES = [_spell("@s"), _spell("@ms"), _spell("@us")]
SIDECARS: Mapping[str, list[Spell]] = {
    "rate": [_spell("rate_hz")],
    "unit": [_spell("unit")],
    "start": [_spell("start_utc", iso)],
}
SPELLINGS: Mapping[str, Mapping[str, Mapping[str, list[Spell]]]] = {
    "csv": {
        FILE: _HEAD,
        CHANNEL: {"rate": _TIMES, "unit": [_spell("@brackets"), _spell("@row")], "start": [_spell("@iso")]},
    },
    "lvm": {
        FILE: {"rate": [_spell("Delta_X", lambda rate: f"{1.0 / rate:.12E}")], "start": []},
        CHANNEL: {"rate": [_spell("@x")], "unit": [_spell("Y_Unit_Label")], "start": [_spell("@segment")]},
    },
    "tdms": {
        FILE: {"start": [_spell("DateTime", lambda start: np.datetime64(int(1e6 * start), "us"))]},
        CHANNEL: {
            "rate": [_spell("wf_increment", lambda rate: 1.0 / rate)],
            "unit": [_spell("unit_string"), _spell("@brackets")],
            "start": [_spell("wf_start_time", lambda start: np.datetime64(int(1e6 * start), "us"))],
        },
    },
    "hdf5": {FILE: _ATTRIBUTES, CHANNEL: _ATTRIBUTES},
    "netcdf": {
        FILE: {"rate": _ATTRIBUTES["rate"], "start": _ATTRIBUTES["start"]},
        CHANNEL: {**_ATTRIBUTES, "rate": [*_ATTRIBUTES["rate"], _spell("@time")], "start": [_spell("@since")]},
    },
    "mat": {FILE: {**_ATTRIBUTES, "rate": [*_ATTRIBUTES["rate"], _spell("t")]}, CHANNEL: {}},
    "uff": {
        FILE: {"start": [_spell("@id3")]},
        CHANNEL: {"rate": [_spell("@step"), _spell("@step_ms")], "unit": [_spell("@label")]},
    },
    "wav": {FILE: {"rate": [_spell("@header")]}, CHANNEL: {}},
    "npy": {FILE: {}, CHANNEL: {}},
}
"""By format, scope and fact: the ways to state it, the usual one first."""

ENDINGS = {
    "csv": "csv",
    "lvm": "lvm",
    "tdms": "tdms",
    "hdf5": "h5",
    "netcdf": "nc",
    "mat": "mat",
    "uff": "uff",
    "wav": "wav",
    "npy": "npy",
}


@dataclass
class Shape:
    """A small file.

    Attributes:
        format: of it.
        samples: m/s2, shape (channel, sample).
        rate: true.
        units: in which each channel is stored.
        at: statements of each scope; those of ``channel`` hold for all but where ``one`` has others.
        one: statements of the second channel, in place of those of all.
        name: of the file, without its ending.
    """

    format: str
    samples: Samples
    rate: float
    units: list[str]
    at: dict[str, dict[str, Any]] = field(default_factory=lambda: {FILE: {}, CHANNEL: {}, SIDECAR: {}})
    one: dict[str, Any] = field(default_factory=dict)
    name: str = "x"

    def of(self, channel: int) -> dict[str, Any]:
        """Return the statements of a channel."""
        return self.at[CHANNEL] | (self.one if channel == 1 else {})

    @property
    def stored(self) -> Samples:
        """The samples in the units of the file."""
        return np.stack([row / PER_UNIT.get(unit, GRAVITY) for row, unit in zip(self.samples, self.units, strict=True)])

    def write(self, folder: Path) -> Path:
        """Write the file, and its side-car where one states anything; return its path."""
        path = folder / f"{self.name}.{ENDINGS[self.format]}"
        _WRITERS[self.format](self, path)
        if self.at[SIDECAR]:
            path.with_name(path.name + ".json").write_text(json.dumps(self.at[SIDECAR]), encoding="utf-8")
        return path


def _attributes(words: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in words.items() if not key.startswith("@")}


def _names(shape: Shape) -> list[str]:
    found: list[str] = []
    for channel, name in enumerate(("acc_1", "acc_2")[: len(shape.samples)]):
        unit = shape.of(channel).get("@brackets")
        found.append(f"{name} [{unit}]" if unit else name)
    return found


def _csv(shape: Shape, path: Path) -> None:
    own, count = shape.at[CHANNEL], shape.samples.shape[1]
    rows = [f"{key}: {value}" for key, value in shape.at[FILE].items()]
    columns, names, units = [], [], []
    if "@iso" in own:
        stamps = np.datetime64(round(1e6 * own["@iso"]), "us") + np.round(1e6 * np.arange(count) / shape.rate).astype(
            "m8[us]"
        )
        columns.append([f"{each}Z" for each in stamps])
        names.append("timestamp")
        units.append("-")
    for key, factor, digits in (("@s", 1.0, 9), ("@ms", 1e3, 6), ("@us", 1e6, 3)):
        if key in own:
            columns.append([f"{factor * i / own[key]:.{digits}f}" for i in range(count)])
            names.append(f"Time ({key[1:]})")
            units.append(key[1:])
    names += _names(shape)
    units += [str(shape.of(i).get("@row", "-")) for i in range(len(shape.samples))]
    columns += [[f"{value:.7g}" for value in row] for row in shape.stored]
    rows.append(";".join(names))
    if "@row" in own:
        rows.append(";".join(units))
    path.write_text("\n".join([*rows, *map(";".join, zip(*columns, strict=True)), ""]), encoding="utf-8")


def _lvm(shape: Shape, path: Path) -> None:
    count = len(shape.samples)
    segment = shape.at[CHANNEL].get("@segment", START)

    def line(key: str, values: Sequence[object]) -> str:
        return "\t".join([key, *map(str, values)])

    head = shape.at[FILE].get("@head", segment)
    x_rate = shape.at[CHANNEL].get("@x", shape.rate)
    step = shape.at[FILE].get("Delta_X", "")
    date, clock = _dated("%Y/%m/%d"), _dated("%H:%M:%S.0000000")
    rows = [
        "LabVIEW Measurement\t", "Writer_Version\t2", "Reader_Version\t2", "Separator\tTab", "Decimal_Separator\t.",
        "Multi_Headings\tYes", "X_Columns\tOne", "Time_Pref\tAbsolute", f"Date\t{date(head)}", f"Time\t{clock(head)}",
        "***End_of_Header***", "\t", f"Channels\t{count}", line("Samples", [shape.samples.shape[1]] * count),
        line("Date", [date(segment)] * count), line("Time", [clock(segment)] * count),
        line("Y_Unit_Label", [shape.of(i).get("Y_Unit_Label", "") for i in range(count)]),
        line("X_Dimension", ["Time"] * count), line("X0", ["0.0000000000000000E+0"] * count),
        line("Delta_X", [step if i == 0 else shape.one.get("Delta_X", step) for i in range(count)]),
        "***End_of_Header***", "\t".join(["X_Value", *_names(shape), "Comment"]),
    ]  # fmt: skip
    cells = [[f"{value:.7g}" for value in row] for row in shape.stored]
    x = [f"{i / x_rate:.9f}" for i in range(shape.samples.shape[1])]
    path.write_text("\n".join([*rows, *map("\t".join, zip(x, *cells, strict=True)), ""]), encoding="utf-8")


def _tdms(shape: Shape, path: Path) -> None:
    objects = [
        ChannelObject("run", name, row, properties=_attributes(shape.of(channel)))
        for channel, (name, row) in enumerate(zip(_names(shape), shape.stored, strict=True))
    ]
    with TdmsWriter(path) as writer:
        writer.write_segment([RootObject(shape.at[FILE]), *objects])


def _hdf5(shape: Shape, path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.attrs.update(shape.at[FILE])
        for channel, (name, row) in enumerate(zip(_names(shape), shape.stored, strict=True)):
            file.create_dataset(name, data=row).attrs.update(_attributes(shape.of(channel)))


def _netcdf(shape: Shape, path: Path) -> None:
    own = shape.at[CHANNEL]
    with netCDF4.Dataset(path, "w", format="NETCDF3_CLASSIC" if shape.samples.shape[1] % 2 else "NETCDF4") as file:
        file.createDimension("time", shape.samples.shape[1])
        file.setncatts(shape.at[FILE])
        if "@time" in own or "@since" in own:
            time = file.createVariable("time", "f8", ("time",))
            time.units = (
                f"seconds since {iso(own['@since']).removesuffix('Z').replace('T', ' ')}" if "@since" in own else "s"
            )
            time[:] = np.arange(shape.samples.shape[1]) / own.get("@time", shape.rate)
        for channel, (name, row) in enumerate(zip(_names(shape), shape.stored, strict=True)):
            item = file.createVariable(name, "f8", ("time",))
            item[:] = row
            item.setncatts(_attributes(shape.of(channel)))


def _mat(shape: Shape, path: Path) -> None:
    words = dict(shape.at[FILE])
    if "t" in words:
        words["t"] = np.arange(shape.samples.shape[1])[:, None] / words["t"]
    rows = {name: row[:, None] for name, row in zip(_names(shape), shape.stored, strict=True)}
    scipy.io.savemat(path, words | rows)


def _uff(shape: Shape, path: Path) -> None:
    parts: list[str] = []
    for channel, (name, row) in enumerate(zip(_names(shape), shape.stored, strict=True)):
        own = shape.of(channel)
        step, label = (1e3 / own["@step_ms"], "ms") if "@step_ms" in own else (1.0 / own.get("@step", shape.rate), "s")
        begin = datetime.fromtimestamp(shape.at[FILE].get("@id3", START), UTC)
        lines = [
            name, "NONE", begin.strftime("%d-%b-%y %H:%M:%S"), "NONE", "NONE",
            f"{1:5d}{0:10d}{1:5d}{0:10d} {'NONE':>10s}{channel + 1:10d}{3:4d} {'NONE':>10s}{channel + 1:10d}{3:4d}",
            f"{4:10d}{len(row):10d}{1:10d}{0.0:13.5e}{step:13.7e}{0.0:13.5e}",
            f"{17:10d}{0:5d}{0:5d}{0:5d} {'Time':20s} {label:20s}",
            f"{12:10d}{0:5d}{0:5d}{0:5d} {'Acceleration':20s} {own.get('@label', 'NONE'):20s}",
            *[f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':20s} {'NONE':20s}"] * 2,
        ]  # fmt: skip
        values = ["".join(f"{value:20.11e}" for value in row[i : i + 4]) for i in range(0, len(row), 4)]
        parts += ["    -1", f"{58:6d}{'':74s}", *(f"{line:80s}" for line in lines), *values, "    -1"]
    path.write_text("\n".join([*parts, ""]), encoding="ascii")


def _wav(shape: Shape, path: Path) -> None:
    soundfile.write(path, shape.stored.T / 64.0, round(shape.at[FILE].get("@header", shape.rate)), subtype="FLOAT")


def _npy(shape: Shape, path: Path) -> None:
    np.save(path, shape.stored)


_WRITERS: Mapping[str, Callable[[Shape, Path], None]] = {
    "csv": _csv, "lvm": _lvm, "tdms": _tdms, "hdf5": _hdf5, "netcdf": _netcdf, "mat": _mat, "uff": _uff, "wav": _wav,
    "npy": _npy,
}  # fmt: skip
