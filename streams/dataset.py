"""Recorded test-rig data sets: what the published descriptions say of their files, as one table.

A data set's own statements (rate, unit, speed by file name) count as configured. What a set does not state is None, and
is for the configuration to say.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import PurePosixPath
from zoneinfo import ZoneInfo

import numpy as np

from streams.files import natural_key
from streams.readers.mat import load_mat, mat_variables, read_mat, scalar
from streams.readers.packed import unpacked_name
from streams.readers.reading import ReaderError, Reading
from streams.readers.text import read_text

POUND_FORCE = 4.4482216152605
"""N in one pound-force."""


@dataclass(frozen=True)
class FileFacts:
    """What the name of a file, or of the folder that it lies in, says.

    Attributes:
        order: key that sorts the files by acquisition.
        number: 1-based number of the file in its run, or None where the names do not count.
        elapsed: seconds from the first sample of the run, or None.
        start: seconds since 1970 UTC of the first sample, or None.
        rate: sampling rate in Hz that the data set states for this file, or None.
        speed: shaft speed in Hz, or None.
        load: radial load in N, or None.
    """

    order: tuple[object, ...]
    number: int | None = None
    elapsed: float | None = None
    start: float | None = None
    rate: float | None = None
    speed: float | None = None
    load: float | None = None


@dataclass(frozen=True)
class DataSet:
    """One data set.

    Attributes:
        name: as in ``dataset:NAME:PATH``.
        files: what its files are called, for messages.
        facts: from a file's path, the name of the place that holds it and the time zone to its facts; None: no file of
            this set.
        read: from the unpacked bytes and the path of a file to its rows.
        unit: of every row, or None where only the configuration can say.
        snapshot: whether each file is one short record taken at intervals, and so one block whatever ``block_s`` says.
        samples: number of samples of a whole file, or None where they differ.
        states_rate: whether each file states its rate.
        counted: whether the files of a run are numbered from 1 without gaps, so that order is known in one pass.
    """

    name: str
    files: str
    facts: Callable[[str, str, ZoneInfo], FileFacts | None]
    read: Callable[[bytes, str], Reading]
    unit: str | None = "g"
    snapshot: bool = False
    samples: int | None = None
    states_rate: bool = False
    counted: bool = False


def _file_name(path: str) -> str:
    return unpacked_name(PurePosixPath(path).name)


# PRONOSTIA (IEEE PHM 2012): the challenge's description gives 25.6 kHz, a record of 0.1 s every 10 s, the conditions.
_PRONOSTIA_CONDITIONS = {"1": (1800 / 60, 4000.0), "2": (1650 / 60, 4200.0), "3": (1500 / 60, 5000.0)}
_PRONOSTIA_RATE, _PRONOSTIA_PERIOD, _PRONOSTIA_SAMPLES = 25600.0, 10.0, 2560


def _pronostia_facts(path: str, place: str, zone: ZoneInfo) -> FileFacts | None:
    match = re.fullmatch(r"acc_(\d+)\.csv", _file_name(path))
    if match is None or int(match[1]) < 1:
        return None
    number = int(match[1])
    runs = re.findall(r"Bearing([123])_\d", f"{place}/{path}")
    speed, load = _PRONOSTIA_CONDITIONS[runs[-1]] if runs else (None, None)
    elapsed = (number - 1) * _PRONOSTIA_PERIOD
    return FileFacts((number,), number, elapsed, None, _PRONOSTIA_RATE, speed, load)


def _pronostia_read(data: bytes, path: str) -> Reading:
    # 16-bit samples printed with three decimals; the clock of the first four columns is not a sample clock.
    reading = read_text(data, path, separators=";,", header=False, n_columns=6, columns=(5, 6), precision=np.float32)
    return replace(reading, channels=("horizontal", "vertical"))


# IMS (Cincinnati, NASA prognostics repository): nominal 20 kHz, a record of 20480 samples; 2000 rpm, 6000 lb.
def _ims_facts(path: str, place: str, zone: ZoneInfo) -> FileFacts | None:
    name = _file_name(path)
    if re.fullmatch(r"\d{4}(\.\d\d){5}", name) is None:
        return None
    try:
        local = datetime.strptime(name, "%Y.%m.%d.%H.%M.%S").replace(tzinfo=zone)
    except ValueError:
        return None
    start = local.timestamp()
    return FileFacts((start,), start=start, rate=20000.0, speed=2000 / 60, load=6000 * POUND_FORCE)


def _ims_read(data: bytes, path: str) -> Reading:
    reading = read_text(data, path, separators="\t ", header=False, n_columns=(4, 8), precision=np.float32)
    return replace(reading, channels=tuple(f"channel_{column}" for column in reading.columns))


# CWRU: the pages of the Bearing Data Center list the files of each rate by number; the files do not state it. The
# normal files, 97 to 100, were sampled at 48 kHz, as were the second set of drive-end files.
_CWRU_48K = (
    (97, 100), (109, 112), (122, 125), (135, 138), (148, 151), (161, 164), (174, 177), (189, 192), (201, 204),
    (213, 217), (226, 229), (238, 241), (250, 253), (262, 265),
)  # fmt: skip
_CWRU_12K = (
    (105, 108), (118, 121), (130, 133), (144, 147), (156, 160), (169, 172), (185, 188), (197, 200), (209, 212),
    (222, 225), (234, 237), (246, 249), (258, 261), (270, 313), (315, 318), (3001, 3008),
)  # fmt: skip
_CWRU_VARIABLE = re.compile(r"X(\d+)_(DE|FE|BA)_time")
_CWRU_CHANNELS = {"DE": "drive_end", "FE": "fan_end", "BA": "base"}


def _cwru_number(path: str) -> int | None:
    match = re.match(r"(\d{2,4})(?!\d)", PurePosixPath(path).name)
    return int(match[1]) if match else None


def _cwru_facts(path: str, place: str, zone: ZoneInfo) -> FileFacts | None:
    if not path.lower().endswith(".mat"):
        return None
    number = _cwru_number(path)
    rate = None
    for value, ranges in ((48000.0, _CWRU_48K), (12000.0, _CWRU_12K)):
        if number is not None and any(first <= number <= last for first, last in ranges):
            rate = value
    return FileFacts(natural_key(path), rate=rate)


def _cwru_read(data: bytes, path: str) -> Reading:
    found = [match for match in map(_CWRU_VARIABLE.fullmatch, mat_variables(data, path)) if match]
    # Some files hold the variables of a second file too (99 has X098 and X099): the file's own number decides.
    own = [match for match in found if int(match[1]) == _cwru_number(path)]
    chosen = own or found
    if len({match[1] for match in chosen}) > 1:
        numbers = ", ".join(sorted({f"X{match[1]}" for match in chosen}))
        raise ReaderError("wrong_shape", f"{path}: holds the variables of several recordings: {numbers}")
    patterns = [match[0] for match in chosen] or ["X*_?E_time"]
    reading = read_mat(data, path, patterns)
    kinds = [name.rsplit("_", 2)[1] for name in reading.names]
    rpm_key = f"X{chosen[0][1]}RPM"
    rpm = scalar(load_mat(data, path, [rpm_key]), rpm_key)
    return replace(
        reading,
        channels=tuple(_CWRU_CHANNELS[kind] for kind in kinds),
        speed=rpm / 60 if rpm is not None and rpm > 0 else None,
    )


# MFPT (Bechhoefer): a structure "bearing" with gs in g, sr in Hz, rate (shaft) in Hz and load in pounds.
def _mat_facts(path: str, place: str, zone: ZoneInfo) -> FileFacts | None:
    return FileFacts(natural_key(path)) if path.lower().endswith(".mat") else None


def _mfpt_read(data: bytes, path: str) -> Reading:
    reading = read_mat(data, path, ["bearing.gs"])
    values = load_mat(data, path, ["bearing.sr", "bearing.rate", "bearing.load"])
    rate, load = scalar(values, "bearing.sr"), scalar(values, "bearing.load")
    if rate is None or rate <= 0:
        raise ReaderError("wrong_rate", f"{path}: expected a positive sampling rate in bearing.sr, found {rate}")
    return replace(
        reading,
        channels=("acceleration",),
        rate=rate,
        speed=scalar(values, "bearing.rate"),
        load=None if load is None else load * POUND_FORCE,
    )


# HIT-SM (Harbin): one vector a file, 51.2 kHz; class, arc of the defect in degrees and nominal rpm in the name.
_HIT_SM_NAME = re.compile(r"(?:N|Normal|IR\d|OR\d)_(\d+)\.mat", re.IGNORECASE)


def _hit_sm_facts(path: str, place: str, zone: ZoneInfo) -> FileFacts | None:
    match = _HIT_SM_NAME.fullmatch(PurePosixPath(path).name)
    return FileFacts(natural_key(path), rate=51200.0, speed=int(match[1]) / 60) if match else None


def _one_vector(data: bytes, path: str) -> Reading:
    reading = read_mat(data, path)
    if len(reading.names) != 1:
        raise ReaderError("wrong_shape", f"{path}: expected one vector, found {', '.join(reading.names)}")
    return replace(reading, channels=("acceleration",))


# UESTC: Data and its SampleFrequency in Hz; the shaft speed is nominal only, and not in the file.
def _uestc_read(data: bytes, path: str) -> Reading:
    reading = read_mat(data, path, ["Data"])
    rate = scalar(load_mat(data, path, ["SampleFrequency"]), "SampleFrequency")
    if rate is None or rate <= 0:
        raise ReaderError("wrong_rate", f"{path}: expected a positive number in SampleFrequency, found {rate}")
    return replace(reading, rate=rate)


# XJTU-SY: two columns with a header, 1.28 s at 25.6 kHz each minute; speed and load in the name of the condition.
def _xjtu_facts(path: str, place: str, zone: ZoneInfo) -> FileFacts | None:
    match = re.fullmatch(r"(\d+)\.csv", _file_name(path))
    if match is None or int(match[1]) < 1:
        return None
    number = int(match[1])
    runs = re.findall(r"(\d+(?:\.\d+)?)Hz(\d+)kN", f"{place}/{path}")
    speed, load = (float(runs[-1][0]), float(runs[-1][1]) * 1e3) if runs else (None, None)
    return FileFacts((number,), number, (number - 1) * 60.0, None, 25600.0, speed, load)


def _xjtu_read(data: bytes, path: str) -> Reading:
    reading = read_text(data, path, separators=",", n_columns=2)
    return replace(reading, channels=("horizontal", "vertical"))


DATA_SETS = {
    data_set.name: data_set
    for data_set in (
        DataSet(
            "pronostia", "acc_NNNNN.csv", _pronostia_facts, _pronostia_read,
            snapshot=True, samples=_PRONOSTIA_SAMPLES, counted=True,
        ),
        DataSet("ims", "YYYY.MM.DD.hh.mm.ss", _ims_facts, _ims_read, snapshot=True, samples=20480),
        DataSet("cwru", "NNN.mat with XNNN_DE_time", _cwru_facts, _cwru_read),
        DataSet("mfpt", "*.mat with a structure bearing", _mat_facts, _mfpt_read, states_rate=True),
        DataSet("hit_sm", "CLASS_RPM.mat with one vector", _hit_sm_facts, _one_vector, unit="unknown"),
        DataSet(
            "uestc", "*.mat with Data and SampleFrequency", _mat_facts, _uestc_read, unit="unknown", states_rate=True
        ),
        DataSet("xjtu_sy", "N.csv", _xjtu_facts, _xjtu_read, snapshot=True, samples=32768, counted=True),
    )
}  # fmt: skip
"""The data sets by name."""


def data_set_named(name: str) -> DataSet | None:
    """Return the data set of a name, in any case, "-" and " " standing for "_", or None."""
    return DATA_SETS.get(re.sub(r"[-\s]", "_", name.strip().lower()))
