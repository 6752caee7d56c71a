"""Data sets of text: PRONOSTIA, IMS, XJTU-SY, the stationary tests of Ferrara."""

from __future__ import annotations

import re
from dataclasses import replace
from datetime import datetime
from zoneinfo import ZoneInfo

import numpy as np

from streams.datasets.description import POUND_FORCE, DataSet, FileFacts, file_name
from streams.files import natural_key
from streams.readers.layout import read_layout
from streams.readers.text import read_text
from streams.samples import Samples

# PRONOSTIA (IEEE PHM 2012): the challenge's description gives 25.6 kHz, a record of 0.1 s every 10 s, the conditions.
_PRONOSTIA_CONDITIONS = {"1": (1800 / 60, 4000.0), "2": (1650 / 60, 4200.0), "3": (1500 / 60, 5000.0)}
_PRONOSTIA_RATE, _PRONOSTIA_PERIOD, _PRONOSTIA_SAMPLES = 25600.0, 10.0, 2560


def _pronostia_facts(path: str, place: str, zone: ZoneInfo) -> FileFacts | None:
    match = re.fullmatch(r"acc_(\d+)\.csv", file_name(path))
    if match is None or int(match[1]) < 1:
        return None
    number = int(match[1])
    runs = re.findall(r"Bearing([123])_\d", f"{place}/{path}")
    speed, load = _PRONOSTIA_CONDITIONS[runs[-1]] if runs else (None, None)
    elapsed = (number - 1) * _PRONOSTIA_PERIOD
    return FileFacts((number,), number, elapsed, None, _PRONOSTIA_RATE, speed, load)


def _pronostia_read(data: bytes, path: str) -> Samples:
    # 16-bit samples printed with three decimals; the clock of the first four columns is not a sample clock.
    samples = read_text(data, path, separators=";,", header=False, n_columns=6, columns=(5, 6), precision=np.float32)
    return replace(samples, channels=("horizontal", "vertical"))


# IMS (Cincinnati, NASA prognostics repository): nominal 20 kHz, a record of 20480 samples; 2000 rpm, 6000 lb.
def _ims_facts(path: str, place: str, zone: ZoneInfo) -> FileFacts | None:
    name = file_name(path)
    if re.fullmatch(r"\d{4}(\.\d\d){5}", name) is None:
        return None
    try:
        local = datetime.strptime(name, "%Y.%m.%d.%H.%M.%S").replace(tzinfo=zone)
    except ValueError:
        return None
    start = local.timestamp()
    return FileFacts((start,), start=start, rate=20000.0, speed=2000 / 60, load=6000 * POUND_FORCE)


def _ims_read(data: bytes, path: str) -> Samples:
    samples = read_text(data, path, separators="\t ", header=False, n_columns=(4, 8), precision=np.float32)
    return replace(samples, channels=tuple(f"channel_{column}" for column in samples.columns))


# XJTU-SY: two columns with a header, 1.28 s at 25.6 kHz each minute; speed and load in the name of the condition.
def _xjtu_facts(path: str, place: str, zone: ZoneInfo) -> FileFacts | None:
    match = re.fullmatch(r"(\d+)\.csv", file_name(path))
    if match is None or int(match[1]) < 1:
        return None
    number = int(match[1])
    runs = re.findall(r"(\d+(?:\.\d+)?)Hz(\d+)kN", f"{place}/{path}")
    speed, load = (float(runs[-1][0]), float(runs[-1][1]) * 1e3) if runs else (None, None)
    return FileFacts((number,), number, (number - 1) * 60.0, None, 25600.0, speed, load)


def _xjtu_read(data: bytes, path: str) -> Samples:
    samples = read_text(data, path, separators=",", n_columns=2)
    return replace(samples, channels=("horizontal", "vertical"))


# Ferrara (Gabrielli and others, Mendeley Data 8wdzm5gwng): 54 text files of 15 s of raw vertical acceleration, three
# widths of defect on three bearings each. Rates as a public catalogue of data sets gives them; defect, load and speed
# are taken from a name where they stand in it, else from the configuration.
def _ferrara_facts(path: str, place: str, zone: ZoneInfo) -> FileFacts | None:
    name = file_name(path)
    if not name.lower().endswith((".txt", ".csv", ".asc")) or "readme" in name.lower():
        return None
    whole = f"{place}/{path}"
    bearing = re.findall(r"(?<![A-Za-z0-9])D([123])[\W_]{0,2}([abcABC])(?![A-Za-z])", whole)
    speed = re.findall(r"(?<!\d)([234]0)[\W_]?Hz", whole, re.IGNORECASE)
    load = re.findall(r"(?<!\d)([12]000)[\W_]?N(?![A-Za-z])", whole, re.IGNORECASE)
    rate = None
    if bearing:
        rate = 25600.0 if bearing[-1][0] == "2" and bearing[-1][1].lower() == "a" else 51200.0
    return FileFacts(
        natural_key(path),
        rate=rate,
        speed=float(speed[-1]) if speed else None,
        load=float(load[-1]) if load else None,
    )


def _ferrara_read(data: bytes, path: str) -> Samples:
    samples = read_layout(data, path)
    return replace(samples, channels=("acceleration",)) if len(samples.names) == 1 else samples


SETS = (
    DataSet(
        "pronostia", "acc_NNNNN.csv", _pronostia_facts, _pronostia_read,
        snapshot=True, samples=_PRONOSTIA_SAMPLES, counted=True,
    ),
    DataSet("ims", "YYYY.MM.DD.hh.mm.ss", _ims_facts, _ims_read, snapshot=True, samples=20480),
    DataSet("xjtu_sy", "N.csv", _xjtu_facts, _xjtu_read, snapshot=True, samples=32768, counted=True),
    DataSet("ferrara", "*.txt", _ferrara_facts, _ferrara_read, unit=None, states_rate=True, states_unit=True),
)  # fmt: skip
"""The data sets of this module."""
