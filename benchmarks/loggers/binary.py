"""Writers of binary formats, each by the library of its makers: TDMS, HDF5, netCDF, MAT, WAV, npy; UFF58 by hand."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import h5py
import netCDF4
import numpy as np
import scipy.io
import soundfile
from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter
from numpy.typing import NDArray

from benchmarks.loggers.lvm import write_lvm
from benchmarks.loggers.names import paths_of
from benchmarks.loggers.plan import GRAVITY, SPEED_HZ, Plan, Samples, TrueChannel, with_lost
from benchmarks.loggers.text import Written, write_csv

_NAMES = (("DE", "NDE", "M"), ("X", "Y", "Z"), ("acc_1", "acc_2", "acc_3"))
_UNITS = ["g", "m/s2", "m/s^2", "mg", "mV"]
_Writer = Callable[[Path, datetime, Samples, NDArray[np.bool_]], None]


def _channels(plan: Plan) -> list[TrueChannel]:
    unit = plan.draw.one("unit", _UNITS, [4, 4, 1, 1, 1])
    sensitivity = plan.draw.one("sensitivity", [100.0, 50.0]) if unit == "mV" else None
    names = plan.draw.one("labels", _NAMES)
    found = [TrueChannel(name, unit=unit, sensitivity_mv_per_g=sensitivity) for name in names[: len(plan.signals[0])]]
    for number, each in enumerate(found, start=1):
        each.column = number
        each.key = each.name
    return found


def _written(
    plan: Plan, folder: Path, ending: str, channels: list[TrueChannel], write: _Writer, **known: Any
) -> Written:
    """Let ``write`` make each file; it is given the wall clock (a name states no zone) and the lost samples."""
    paths: list[list[str]] = []
    for index, path in enumerate(paths_of(plan, ending)):
        last = index == len(plan.signals) - 1
        values, lost = with_lost(plan.signals[index], plan.lost if last else "")
        target = folder / path
        target.parent.mkdir(parents=True, exist_ok=True)
        write(target, plan.wall(index), values, lost if last and plan.lost == "fill" else np.zeros_like(lost))
        paths.append([path])
    answers: dict[str, str] = {}
    unknowable: list[str] = list(known.get("unknowable", ()))
    sensitivity = channels[0].sensitivity_mv_per_g
    if sensitivity is not None:
        answers.update({"--unit": channels[0].unit, "--sensitivity-mv-per-g": f"{sensitivity:g}"})
        unknowable += [] if known.get("sensitivity_stated") else ["level"]
    elif "level" in unknowable:
        answers["--unit"] = channels[0].unit
    answers |= known.get("answers", {})
    epoch = plan.dating == "name" and plan.draw.chosen.get("stamp") == "epoch"
    return Written(channels, paths, bool(known.get("zone_stated")) or epoch, unknowable, [], answers)


def write_tdms(plan: Plan, folder: Path) -> Written:
    """Write TDMS files: a group of vibration, often another of slow quantities, properties of waveforms."""
    draw = plan.draw
    channels = _channels(plan)
    group = draw.one("group", ["Vibration", "Measured Data", "run"])
    process = draw.one("process", ["", "group", "same_group"], [3, 2, 1])
    scaled = draw.yes("scaled", 0.25) and channels[0].unit in ("g", "m/s2")
    start_in = draw.one("start_in", ["channel", "root"], [4, 1])
    stated = draw.yes("unit_stated", 0.9)
    for each in channels:
        each.key = f"{group}/{each.name}"

    def write(path: Path, wall: datetime, values: Samples, lost: NDArray[np.bool_]) -> None:
        start = np.datetime64(wall.astimezone(UTC).replace(tzinfo=None), "us")
        time = {"wf_start_time": start, "wf_start_offset": 0.0} if plan.dating == "head" else {}
        root: dict[str, Any] = {"Operator": "lab"}
        if start_in == "root" and time:
            root["DateTime"], time = start, {}
        if plan.speed_in == "head":
            root["Speed [rpm]"] = 60.0 * SPEED_HZ
        objects: list[Any] = [RootObject(root), GroupObject(group, {})]
        for each, row in zip(channels, values, strict=True):
            stored = each.stored(row)
            stored[lost] = np.nan
            words: dict[str, Any] = {"wf_increment": 1.0 / plan.rate, **time}
            words |= {"unit_string": each.unit} if stated else {}
            if scaled and not lost.any():
                slope = float(2.0 * np.max(np.abs(stored)) / 60000.0)
                stored, scale = np.round(stored / slope).astype(np.int16), _linear(slope)
                words |= scale
            objects.append(ChannelObject(group, each.name, stored, properties=words))
        if process:
            slow = {"wf_increment": 0.1, **time}
            place = "Process" if process == "group" else group
            count = max(2, int(10 * values.shape[1] / plan.rate))
            objects.append(
                ChannelObject(
                    place, "Speed", np.full(count, 60.0 * SPEED_HZ), properties={**slow, "unit_string": "rpm"}
                )
            )
            objects.append(
                ChannelObject(
                    place, "Temperature", np.linspace(61.0, 61.2, count), properties={**slow, "unit_string": "degC"}
                )
            )
        with TdmsWriter(path) as writer:
            writer.write_segment(objects)

    unknowable = [] if stated else ["level"]
    return _written(plan, folder, "tdms", channels, write, zone_stated=plan.dating == "head", unknowable=unknowable)


def _linear(slope: float) -> Mapping[str, Any]:
    return {
        "NI_Number_Of_Scales": np.int32(1),
        "NI_Scaling_Status": "unscaled",
        "NI_Scale[0]_Scale_Type": "Linear",
        "NI_Scale[0]_Linear_Slope": slope,
        "NI_Scale[0]_Linear_Y_Intercept": 0.0,
        "NI_Scale[0]_Linear_Input_Source": np.uint32(0xFFFFFFFF),
    }


def _packed(stored: Samples, lost: NDArray[np.bool_], unsigned: bool) -> tuple[NDArray[Any], float, float, int]:
    """Return 16-bit counts, their scale and offset, and the fill value of lost samples."""
    span = float(2.1 * np.max(np.abs(stored)))
    scale, offset = span / 64000.0, -span / 2.0 if unsigned else 0.0
    counts = np.round((stored - offset) / scale)
    fill = 65535 if unsigned else -32768
    counts[lost] = fill
    return counts.astype(np.uint16 if unsigned else np.int16), scale, offset, fill


def write_hdf5(plan: Plan, folder: Path) -> Written:
    """Write HDF5 files: attributes at the root, a group or each data set; floats or counts; sometimes one matrix."""
    draw = plan.draw
    channels = _channels(plan)
    shape = draw.one("shape", ["sets", "rows", "columns"], [4, 1, 1]) if len(channels) > 1 else "sets"
    scope = draw.one("scope", ["root", "group", "set"])
    packed = draw.yes("packed", 0.4)
    key, value = draw.one(
        "rate_key", [("fs", 1.0), ("sampling_rate", 1.0), ("rate_hz", 1.0), ("sample_rate", 1.0), ("dt", -1.0)]
    )
    unit_key = draw.one("unit_key", ["unit", "units"])
    extra = draw.one("extra", ["", "temperature", "time"], [3, 1, 1])
    group = draw.one("group", ["", "vibration/", "run1/"])
    start_key = draw.one("start_key", ["start_utc", "start_time", "timestamp"])
    for number, each in enumerate(channels, start=1):
        each.key, each.column = (f"{group}{each.name}", 1) if shape == "sets" else (f"{group}acc", number)

    def write(path: Path, wall: datetime, values: Samples, lost: NDArray[np.bool_]) -> None:
        words: dict[str, Any] = {key: plan.rate**value}
        if plan.dating == "head":
            words[start_key] = wall.isoformat()
        with h5py.File(path, "w") as file:
            place = file.require_group(group or "/")
            stored = np.stack([each.stored(row) for each, row in zip(channels, values, strict=True)])
            data: Any
            if packed:
                data, scale, offset, fill = _packed(stored, np.broadcast_to(lost, stored.shape), False)
                marks: dict[str, Any] = {"scale_factor": scale, "add_offset": offset, "_FillValue": np.int16(fill)}
            else:
                data, marks = np.where(lost, np.nan, stored), {}
            marks[unit_key] = channels[0].unit
            if shape == "sets":
                made = [place.create_dataset(each.name, data=row) for each, row in zip(channels, data, strict=True)]
            else:
                made = [place.create_dataset("acc", data=data if shape == "rows" else data.T)]
            for item in made:
                item.attrs.update(marks | (words if scope == "set" else {}))
            if scope != "set":
                (file if scope == "root" else place).attrs.update(words)
            if plan.speed_in == "head":
                file.attrs["speed_rpm"] = 60.0 * SPEED_HZ
            if extra == "temperature":
                place.create_dataset("temperature", data=np.full(values.shape[1], 48.2)).attrs[unit_key] = "degC"
            elif extra == "time":
                place.create_dataset("time", data=np.arange(values.shape[1]) / plan.rate).attrs[unit_key] = "s"

    return _written(plan, folder, "h5", channels, write, zone_stated=plan.dating == "head")


def write_netcdf(plan: Plan, folder: Path) -> Written:
    """Write netCDF: classic or netCDF-4, packed signed or unsigned or not, the rate by a coordinate or an attribute."""
    draw = plan.draw
    channels = _channels(plan)
    model: Any = draw.one("model", ["NETCDF4", "NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET"], [3, 1, 1])
    packing = draw.one("packing", ["", "signed", "unsigned"])
    rate_in = draw.one("rate_in", ["coordinate", "attribute", "global"])
    if rate_in != "coordinate" and plan.dating == "head":
        start_key = draw.one("start_key", ["start_utc", "start_time"])
    else:
        start_key = ""

    def write(path: Path, wall: datetime, values: Samples, lost: NDArray[np.bool_]) -> None:
        with netCDF4.Dataset(path, "w", format=model) as file:
            file.createDimension("time", values.shape[1])
            begin = wall.astimezone(UTC)
            if rate_in == "coordinate":
                time = file.createVariable("time", "f8", ("time",))
                time.units = f"seconds since {begin:%Y-%m-%dT%H:%M:%SZ}" if plan.dating == "head" else "s"
                time[:] = np.arange(values.shape[1]) / plan.rate
            elif rate_in == "global":
                file.sampling_rate = plan.rate
            if start_key:
                file.setncattr(start_key, wall.isoformat())
            if plan.speed_in == "head":
                file.speed_rpm = 60.0 * SPEED_HZ
            for each, row in zip(channels, values, strict=True):
                _variable(file, each, row, lost, packing, model)
                if rate_in == "attribute":
                    file[each.name].sampling_rate = plan.rate

    return _written(plan, folder, "nc", channels, write, zone_stated=plan.dating == "head")


def _variable(file: Any, each: TrueChannel, row: Samples, lost: NDArray[np.bool_], packing: str, model: str) -> None:
    stored = each.stored(row)
    if not packing:
        item = file.createVariable(each.name, "f4", ("time",), fill_value=np.float32(-9999.0) if lost.any() else None)
        item.set_auto_maskandscale(False)
        item[:] = np.where(lost, -9999.0, stored).astype(np.float32)
        item.units = each.unit
        return
    counts, scale, offset, fill = _packed(stored, lost, packing == "unsigned")
    wide = packing == "unsigned" and model == "NETCDF4"
    counts = counts if wide else counts.view(np.int16)
    value = (
        np.uint16(fill) if wide else np.array(fill, np.uint16 if packing == "unsigned" else np.int16).view(np.int16)[()]
    )
    item = file.createVariable(each.name, "u2" if wide else "i2", ("time",), fill_value=value)
    item.set_auto_maskandscale(False)
    item.scale_factor, item.add_offset, item.units = scale, offset, each.unit
    if packing == "unsigned" and not wide:
        item.setncattr("_Unsigned", "true")
    item[:] = counts


def write_mat(plan: Plan, folder: Path) -> Written:
    """Write MAT files: vectors, a matrix or a structure, with fs or dt, unit and a date."""
    draw = plan.draw
    channels = _channels(plan)
    shape = draw.one("shape", ["vectors", "matrix", "struct"], [3, 2, 2])
    key, power = draw.one("rate_key", [("fs", 1.0), ("Fs", 1.0), ("dt", -1.0), ("SampleFrequency", 1.0)])
    extra = draw.one("extra", ["", "temperature", "t"], [3, 1, 1])
    for number, each in enumerate(channels, start=1):
        each.key, each.column = {
            "vectors": (each.name, 1), "matrix": ("acc", number), "struct": (f"data.{each.name}", 1),
        }[shape]  # fmt: skip

    def write(path: Path, wall: datetime, values: Samples, lost: NDArray[np.bool_]) -> None:
        rows = [np.where(lost, np.nan, each.stored(row)) for each, row in zip(channels, values, strict=True)]
        found: dict[str, Any] = {key: plan.rate**power, "unit": channels[0].unit}
        if plan.dating == "head":
            found["start_utc"] = wall.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        if shape == "matrix":
            found["acc"] = np.stack(rows, axis=1)
        else:
            found |= {each.name: row[:, None] for each, row in zip(channels, rows, strict=True)}
        if extra == "temperature":
            found["temperature"] = np.full((values.shape[1], 1), 48.2)
        elif extra == "t":
            found["t"] = np.arange(values.shape[1])[:, None] / plan.rate
        if plan.speed_in == "head":
            found["rpm"] = 60.0 * SPEED_HZ
        scipy.io.savemat(
            path, {"data": found} if shape == "struct" else found, do_compression=draw.yes("compressed", 0.5)
        )

    return _written(plan, folder, "mat", channels, write, zone_stated=plan.dating == "head")


def write_wav(plan: Plan, folder: Path) -> Written:
    """Write WAV: integers of full scale, of which nothing states the level, all channels in one file."""
    channels = _channels(plan)
    full = plan.draw.one("full_scale_g", [20.0, 50.0])
    subtype = plan.draw.one("subtype", ["PCM_16", "PCM_24", "FLOAT"], [3, 2, 1])
    for each in channels:
        each.unit, each.sensitivity_mv_per_g, each.scale = "g", None, full

    def write(path: Path, wall: datetime, values: Samples, lost: NDArray[np.bool_]) -> None:
        soundfile.write(path, values.T / GRAVITY / full, int(plan.rate), subtype=subtype)

    answers = {"--unit": "g", "--range-g": f"{full:g}", "--scale": f"{full:g}"}
    return _written(plan, folder, "wav", channels, write, unknowable=["level"], answers=answers)


def write_npy(plan: Plan, folder: Path) -> Written:
    """Write .npy with a side-car beside each file or one for the folder."""
    draw = plan.draw
    channels = _channels(plan)
    whole = draw.yes("whole_numbers", 0.3)
    beside = plan.dating == "head" or draw.yes("sidecar_each", 0.5)

    def write(path: Path, wall: datetime, values: Samples, lost: NDArray[np.bool_]) -> None:
        stored = np.stack([each.stored(row) for each, row in zip(channels, values, strict=True)])
        first = channels[0]
        unit = "V" if first.unit == "mV" else first.unit
        words: dict[str, Any] = {"rate_hz": plan.rate, "unit": {"m/s^2": "m/s2", "mg": "g"}.get(unit, unit)}
        factor = {"mV": 1e-3, "mg": 1e-3}.get(first.unit, 1.0)
        if first.sensitivity_mv_per_g is not None:
            words["sensitivity_mv_per_g"] = first.sensitivity_mv_per_g
        if whole:
            step = 2.0**-9 if np.max(np.abs(stored)) < 60 else 2.0**-1
            stored, words["scale"] = np.round(stored / step).astype(np.int32), step * factor
        elif factor != 1.0:
            words["scale"] = factor
        words["channels"] = [each.name for each in channels]
        if plan.dating == "head":
            words["start_utc"] = wall.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        np.save(path, stored if len(stored) > 1 else stored[0])
        target = path.with_name(path.name + ".json") if beside else path.with_name("spallwatch.json")
        target.write_text(json.dumps(words), encoding="utf-8")

    return _written(plan, folder, "npy", channels, write, zone_stated=plan.dating == "head", sensitivity_stated=True)


def write_uff(plan: Plan, folder: Path) -> Written:
    """Write UFF58 in text: labels of abscissa and ordinate, ID line 3 with the date."""
    draw = plan.draw
    channels = _channels(plan)
    step = draw.one("abscissa", [("s", 1.0), ("ms", 1e3)], [3, 1])

    def write(path: Path, wall: datetime, values: Samples, lost: NDArray[np.bool_]) -> None:
        parts = [
            _set58(
                each.name,
                wall,
                each.unit,
                np.where(lost, np.nan, each.stored(row)),
                step[1] / plan.rate,
                step[0],
                number,
            )
            for number, (each, row) in enumerate(zip(channels, values, strict=True), start=1)
        ]
        path.write_text("".join(parts), encoding="ascii")

    return _written(plan, folder, "uff", channels, write)


def _set58(name: str, wall: datetime, unit: str, values: Samples, step: float, label: str, node: int) -> str:
    lines = [
        "    -1", "    58", name, "NONE", wall.strftime("%d-%b-%y %H:%M:%S"), "NONE", "NONE",
        f"{1:5d}{0:10d}{1:5d}{0:10d} {'NONE':>10s}{node:10d}{3:4d} {'NONE':>10s}{node:10d}{3:4d}",
        f"{4:10d}{len(values):10d}{1:10d}{0.0:13.5e}{step:13.5e}{0.0:13.5e}",
        f"{17:10d}{0:5d}{0:5d}{0:5d} {'Time':20s} {label:20s}",
        f"{12:10d}{0:5d}{0:5d}{0:5d} {'Acceleration':20s} {unit:20s}",
        *[f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':20s} {'NONE':20s}"] * 2,
    ]  # fmt: skip
    padded = [line if index < 2 else f"{line:80s}" for index, line in enumerate(lines)]
    rows = ["".join(f"{value:20.11e}" for value in values[begin : begin + 4]) for begin in range(0, len(values), 4)]
    return "\n".join([*padded, *rows, "    -1", ""])


WRITERS: Mapping[str, Callable[[Plan, Path], Written]] = {
    "csv": write_csv, "lvm": write_lvm, "tdms": write_tdms, "hdf5": write_hdf5, "netcdf": write_netcdf,
    "mat": write_mat, "wav": write_wav, "uff": write_uff, "npy": write_npy,
}  # fmt: skip
"""By format."""
