"""Data sets of MAT files, read in the child process: CWRU, MFPT and others."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import PurePosixPath
from zoneinfo import ZoneInfo

import numpy as np

from streams.datasets.description import POUND_FORCE, DataSet, FileFacts, file_name
from streams.files import natural_key
from streams.readers.child import isolated
from streams.readers.mat import load_mat, mat_variables, read_mat, scalar, text
from streams.samples import ReaderError, Samples

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


def cwru_read(data: bytes, path: str) -> Samples:
    """Read a file of the Bearing Data Center: the recording of its number, its RPM."""
    found = [match for match in map(_CWRU_VARIABLE.fullmatch, mat_variables(data, path)) if match]
    # Some files hold the variables of a second file too (99 has X098 and X099): the file's own number decides.
    own = [match for match in found if int(match[1]) == _cwru_number(path)]
    chosen = own or found
    if len({match[1] for match in chosen}) > 1:
        numbers = ", ".join(sorted({f"X{match[1]}" for match in chosen}))
        raise ReaderError("wrong_shape", f"{path}: holds the variables of several recordings: {numbers}")
    patterns = [match[0] for match in chosen] or ["X*_?E_time"]
    samples = read_mat(data, path, patterns)
    kinds = [name.rsplit("_", 2)[1] for name in samples.names]
    rpm_key = f"X{chosen[0][1]}RPM"
    rpm = scalar(load_mat(data, path, [rpm_key]), rpm_key)
    return replace(
        samples,
        channels=tuple(_CWRU_CHANNELS[kind] for kind in kinds),
        speed=rpm / 60 if rpm is not None and rpm > 0 else None,
    )


# MFPT (Bechhoefer): a structure "bearing" with gs in g, sr in Hz, rate (shaft) in Hz and load in pounds.
def _mat_facts(path: str, place: str, zone: ZoneInfo) -> FileFacts | None:
    return FileFacts(natural_key(path)) if path.lower().endswith(".mat") else None


def mfpt_read(data: bytes, path: str) -> Samples:
    """Read a file of the MFPT set."""
    samples = read_mat(data, path, ["bearing.gs"])
    values = load_mat(data, path, ["bearing.sr", "bearing.rate", "bearing.load"])
    rate, load = scalar(values, "bearing.sr"), scalar(values, "bearing.load")
    if rate is None or rate <= 0:
        raise ReaderError("wrong_rate", f"{path}: expected a positive sampling rate in bearing.sr, found {rate}")
    return replace(
        samples,
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


def one_vector(data: bytes, path: str) -> Samples:
    """Read a file that holds a single vector."""
    samples = read_mat(data, path)
    if len(samples.names) != 1:
        raise ReaderError("wrong_shape", f"{path}: expected one vector, found {', '.join(samples.names)}")
    return replace(samples, channels=("acceleration",))


# UESTC: Data and its SampleFrequency in Hz; the shaft speed is nominal only, and not in the file.
def uestc_read(data: bytes, path: str) -> Samples:
    """Read a file of the UESTC set."""
    samples = read_mat(data, path, ["Data"])
    rate = scalar(load_mat(data, path, ["SampleFrequency"]), "SampleFrequency")
    if rate is None or rate <= 0:
        raise ReaderError("wrong_rate", f"{path}: expected a positive number in SampleFrequency, found {rate}")
    return replace(samples, rate=rate)


# Paderborn (Lessmeier and others, KAt data center): a structure called like the file whose Y is an array of structures
# with Name and Data; vibration at 64 kHz; the name gives rpm / 100, torque, radial load / 100 N, bearing and number.
_PADERBORN_NAME = re.compile(r"N(\d\d)_M(\d\d)_F(\d\d)_(K[AIB]?\d+)_(\d+)\.mat", re.IGNORECASE)
_PADERBORN_RATE = 64000.0


def _paderborn_facts(path: str, place: str, zone: ZoneInfo) -> FileFacts | None:
    match = _PADERBORN_NAME.fullmatch(file_name(path))
    if match is None:
        return None
    return FileFacts(
        natural_key(path), rate=_PADERBORN_RATE, speed=int(match[1]) * 100 / 60, load=float(int(match[3]) * 100)
    )


def paderborn_read(data: bytes, path: str) -> Samples:
    """Read the vibration of a file of the Paderborn set; other channels are skipped."""
    values = load_mat(data, path, ["*.Y", "*.Y(*).Name", "*.Y(*).Data", "*.Y.Name", "*.Y.Data"])
    names = {key: text(values, key) for key in values if key.endswith(".Name")}
    found = [key for key, name in names.items() if name is not None and name.startswith("vibration")]
    if not found:
        held = ", ".join(sorted(name for name in names.values() if name)) or "no structure Y with Name and Data"
        raise ReaderError("wrong_shape", f"{path}: no channel vibration_1; it holds {held}")
    rows = [np.asarray(values[key.removesuffix("Name") + "Data"]).reshape(-1) for key in found]
    if any(row.dtype.kind not in "fiu" for row in rows) or len({row.size for row in rows}) != 1:
        raise ReaderError("wrong_shape", f"{path}: the vibration is no vector of numbers")
    if not rows[0].size:
        raise ReaderError("empty", f"{path}: holds no samples")
    return Samples(np.stack(rows).astype(np.float64), tuple(names[key] or "" for key in found))


SETS = (
    DataSet("cwru", "NNN.mat with XNNN_DE_time", _cwru_facts, isolated(cwru_read)),
    DataSet("mfpt", "*.mat with a structure bearing", _mat_facts, isolated(mfpt_read), states_rate=True),
    DataSet("hit_sm", "CLASS_RPM.mat with one vector", _hit_sm_facts, isolated(one_vector), unit="unknown"),
    DataSet(
        "uestc", "*.mat with Data and SampleFrequency", _mat_facts, isolated(uestc_read),
        unit="unknown", states_rate=True,
    ),
    DataSet(
        "paderborn", "N15_M07_F10_K001_1.mat", _paderborn_facts, isolated(paderborn_read),
        unit="unknown", snapshot=True,
    ),
)  # fmt: skip
"""The data sets of this module."""
