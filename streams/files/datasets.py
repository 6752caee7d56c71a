"""Published data sets: what the names of their files state, and how the files are read.

All files are read in the child process.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import PurePosixPath
from zoneinfo import ZoneInfo

import numpy as np

from streams.files.claims import ANOTHER_LOGGER
from streams.files.formats.mat import load_mat, mat_variables, read_mat, scalar, text
from streams.files.formats.text import read_layout, read_text
from streams.files.judge import judge_rate, judge_unit
from streams.files.keys import FACTORS, UNIT_KEYS
from streams.files.parse.child import isolated
from streams.files.statements import add_fact, plain_key, rate_statements, unit_statements
from streams.types.large import Data
from streams.types.listing import natural_key, unpacked_name
from streams.types.samples import ReaderError, Samples

POUND_FORCE = 4.4482216152605
"""N in one pound-force."""


@dataclass(frozen=True)
class FileFacts:
    """What the name of a file, or of its folder, states; None where it does not.

    ``order`` sorts the files by acquisition, ``number`` is the 1-based number of the file in its run, ``elapsed`` in s
    counts from the first sample of the run. Start in s since 1970 UTC, rate and shaft speed in Hz, radial load in N.
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
        files: names of its files, for messages.
        facts: maps path, name of the root and time zone to the facts of a file; None: no file of this set.
        read: maps the unpacked bytes and the path of a file to its rows.
        unit: of every row, None where only the configuration can state it.
        snapshot: whether each file is one short record taken at intervals, and so one block whatever ``block_s`` says.
        samples: number in a whole file, None where they differ.
        states_rate: whether each file states its rate, or may.
        states_unit: whether each file may state its unit.
        counted: whether the files of a run are numbered from 1 without gaps, so that order is known in one pass.
        plain: whether it is a format of files of any origin, which :mod:`streams.dates.dater` dates.
        endings: of the names of files of a plain format; none: any.
    """

    name: str
    files: str
    facts: Callable[[str, str, ZoneInfo], FileFacts | None]
    read: Callable[[Data, str], Samples]
    unit: str | None = "g"
    snapshot: bool = False
    samples: int | None = None
    states_rate: bool = False
    states_unit: bool = False
    counted: bool = False
    plain: bool = False
    endings: tuple[str, ...] = ()


def _file_name(path: str) -> str:
    """Return the name of a file without its folder and the suffix of its compression."""
    return unpacked_name(path.rpartition("/")[2])


def _number_in(pattern: str, path: str) -> int | None:
    """Return the positive number that the name of a file states, or None."""
    match = re.fullmatch(pattern, _file_name(path))
    return int(match[1]) if match is not None and int(match[1]) > 0 else None


# PRONOSTIA (IEEE PHM 2012): the challenge's description gives 25.6 kHz, a record of 0.1 s every 10 s, the conditions.
_PRONOSTIA_CONDITIONS = {"1": (1800 / 60, 4000.0), "2": (1650 / 60, 4200.0), "3": (1500 / 60, 5000.0)}
_PRONOSTIA_RATE, _PRONOSTIA_PERIOD, _PRONOSTIA_SAMPLES = 25600.0, 10.0, 2560
_CLOCK_TOLERANCE = 0.01


def _pronostia_facts(path: str, place: str, zone: ZoneInfo) -> FileFacts | None:
    number = _number_in(r"acc_(\d+)\.csv", path)
    if number is None:
        return None
    runs = re.findall(r"Bearing([123])_\d", f"{place}/{path}")
    speed, load = _PRONOSTIA_CONDITIONS[runs[-1]] if runs else (None, None)
    elapsed = (number - 1) * _PRONOSTIA_PERIOD
    return FileFacts((number,), number, elapsed, None, _PRONOSTIA_RATE, speed, load)


def _pronostia_read(data: bytes, path: str) -> Samples:
    # 16-bit samples printed with three decimals; the clock of the first four columns is not a sample clock.
    samples = read_text(data, path, separators=";,", header=False, n_columns=6, precision=np.float32)
    hour, minute, second, micro = (row.astype(np.float64) for row in samples.values[:4])
    limits = ((hour, 24.0), (minute, 60.0), (second, 60.0), (micro, 1e6))
    if any(np.any((row < 0.0) | (row >= limit)) for row, limit in limits):
        raise ReaderError("wrong_shape", f"{path}: columns 1 to 4 are no time as of pronostia{ANOTHER_LOGGER}")
    span = (3600.0 * hour + 60.0 * minute + second + 1e-6 * micro)[[0, -1]]
    seconds = float(span[1] - span[0]) % 86400.0
    rate = (hour.size - 1) / seconds if seconds else _PRONOSTIA_RATE
    if abs(rate - _PRONOSTIA_RATE) > _CLOCK_TOLERANCE * _PRONOSTIA_RATE:
        told = f"the times in columns 1 to 4 are those of {rate:.6g} Hz, pronostia has {_PRONOSTIA_RATE:g} Hz"
        raise ReaderError("wrong_rate", f"{path}: {told}{ANOTHER_LOGGER}")
    return replace(samples.select([4, 5]), channels=("horizontal", "vertical"))


# IMS (Cincinnati, NASA prognostics repository): nominal 20 kHz, a record of 20480 samples; 2000 rpm, 6000 lb.
_IMS_RUNS = (("2003.10.22", "2003.11.26"), ("2004.02.12", "2004.02.20"), ("2004.03.04", "2004.04.19"))
"""First day of each run, and the day behind it."""


def is_of_ims(path: str) -> bool:
    """Return whether a file is named and dated as one of the three runs: other loggers write such names, too."""
    return any(first <= _file_name(path) < behind for first, behind in _IMS_RUNS)


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


def _ims_read(data: bytes, path: str) -> Samples:
    samples = read_text(data, path, separators="\t ", header=False, n_columns=(4, 8), precision=np.float32)
    return replace(samples, channels=tuple(f"channel_{column}" for column in samples.columns))


# XJTU-SY: two columns with a header, 1.28 s at 25.6 kHz each minute; speed and load in the name of the condition.
def _xjtu_facts(path: str, place: str, zone: ZoneInfo) -> FileFacts | None:
    number = _number_in(r"(\d+)\.csv", path)
    if number is None:
        return None
    runs = re.findall(r"(\d+(?:\.\d+)?)Hz(\d+)kN", f"{place}/{path}")
    speed, load = (float(runs[-1][0]), float(runs[-1][1]) * 1e3) if runs else (None, None)
    return FileFacts((number,), number, (number - 1) * 60.0, None, 25600.0, speed, load)


def _xjtu_read(data: bytes, path: str) -> Samples:
    samples = read_text(data, path, separators=",", n_columns=2)
    return replace(samples, channels=("horizontal", "vertical"))


# Ferrara (Gabrielli and others, Mendeley Data 8wdzm5gwng): 54 text files of 15 s of raw vertical acceleration, three
# widths of defect on three bearings each. Rates as a public catalogue of data sets gives them; defect, load and speed
# are taken from a name where they stand in it, else from the configuration.
@dataclass(frozen=True)
class FerraraName:
    """What a path states of a stationary test; None where it does not.

    ``defect`` is D1 to D3, ``specimen`` the bearing of that defect, a to c; load in N, shaft speed and rate in Hz.
    """

    defect: str | None
    specimen: str | None
    load: float | None
    speed: float | None

    @property
    def rate(self) -> float | None:
        """The sampling rate of the bearing."""
        if self.defect is None or self.specimen is None:
            return None
        return 25600.0 if (self.defect, self.specimen) == ("D2", "a") else 51200.0


def ferrara_name(path: str) -> FerraraName:
    """Return what a path states; of several statements the last."""
    bearing = re.findall(r"(?<![A-Za-z0-9])D([123])(?!\d)(?:[\W_]{0,2}([abcABC])(?![A-Za-z]))?", path)
    speed = re.findall(r"(?<!\d)([234]0)[\W_]?Hz", path, re.IGNORECASE)
    load = re.findall(r"(?<!\d)([12]000)[\W_]?N(?![A-Za-z])", path, re.IGNORECASE)
    return FerraraName(
        defect=f"D{bearing[-1][0]}" if bearing else None,
        specimen=bearing[-1][1].lower() or None if bearing else None,
        load=float(load[-1]) if load else None,
        speed=float(speed[-1]) if speed else None,
    )


def _ferrara_facts(path: str, place: str, zone: ZoneInfo) -> FileFacts | None:
    name = _file_name(path)
    if not name.lower().endswith((".txt", ".csv", ".asc")) or "readme" in name.lower():
        return None
    stated = ferrara_name(f"{place}/{path}")
    return FileFacts(natural_key(path), rate=stated.rate, speed=stated.speed, load=stated.load)


def _ferrara_read(data: bytes, path: str) -> Samples:
    samples = read_layout(data, path)
    return replace(samples, channels=("acceleration",)) if len(samples.names) == 1 else samples


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
_CWRU_RPM = (1700.0, 1810.0)
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


def _cwru_facts_of(data: Data, path: str, number: str) -> dict[str, object]:
    """Return what variables beside the signals state, such as ``fs`` or ``X130_DE_unit``: in the set there are none."""
    facts: dict[str, object] = {}
    own = re.compile(rf"(?:X{number}_?)?(?:(?:DE|FE|BA)_?)?(\w+?)")
    named = {key: plain_key(match[1]) for key in mat_variables(data, path) if (match := own.fullmatch(key))}
    stating = {key: plain for key, plain in named.items() if plain in FACTORS or plain in UNIT_KEYS}
    values = load_mat(data, path, list(stating)) if stating else {}
    for key, plain in stating.items():
        value = text(values, key) or scalar(values, key)
        if value is not None:
            add_fact(facts, plain, value, key)
    return facts


def cwru_read(data: bytes, path: str) -> Samples:
    """Read a file of the Bearing Data Center: the recording of its number, its RPM, rate and unit."""
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
    if rpm is not None and not _CWRU_RPM[0] <= rpm <= _CWRU_RPM[1]:
        expected = "cwru has {:g} to {:g} rpm".format(*_CWRU_RPM)
        raise ReaderError("unreadable", f"{path}: {rpm_key} is {rpm:g}, {expected}{ANOTHER_LOGGER}")
    facts = _cwru_facts_of(data, path, chosen[0][1])
    return replace(
        samples,
        channels=tuple(_CWRU_CHANNELS[kind] for kind in kinds),
        units=(judge_unit(unit_statements(facts), path),) * len(kinds),
        **judge_rate(rate_statements(facts, path), path).fields,
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


# UESTC: Data and its SampleFrequency in Hz; class, nominal rpm and number in the name. The shaft is up to 6 % off it.
_UESTC_NAME = re.compile(r"[A-Z]+_(\d+)_\d+\.mat", re.IGNORECASE)


def _uestc_facts(path: str, place: str, zone: ZoneInfo) -> FileFacts | None:
    if not path.lower().endswith(".mat"):
        return None
    match = _UESTC_NAME.fullmatch(PurePosixPath(path).name)
    return FileFacts(natural_key(path), speed=int(match[1]) / 60 if match and int(match[1]) > 0 else None)


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
    match = _PADERBORN_NAME.fullmatch(_file_name(path))
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


_SETS = (
    DataSet(
        "pronostia", "acc_NNNNN.csv", _pronostia_facts, isolated(_pronostia_read),
        snapshot=True, samples=_PRONOSTIA_SAMPLES, counted=True,
    ),
    DataSet("ims", "YYYY.MM.DD.hh.mm.ss", _ims_facts, isolated(_ims_read), snapshot=True, samples=20480),
    DataSet("xjtu_sy", "N.csv", _xjtu_facts, isolated(_xjtu_read), snapshot=True, samples=32768, counted=True),
    DataSet("ferrara", "*.txt", _ferrara_facts, isolated(_ferrara_read), unit=None, states_rate=True, states_unit=True),
    DataSet("cwru", "NNN.mat with XNNN_DE_time", _cwru_facts, isolated(cwru_read)),
    DataSet("mfpt", "*.mat with a structure bearing", _mat_facts, isolated(mfpt_read), states_rate=True),
    DataSet("hit_sm", "CLASS_RPM.mat with one vector", _hit_sm_facts, isolated(one_vector), unit="unknown"),
    DataSet(
        "uestc", "*.mat with Data and SampleFrequency", _uestc_facts, isolated(uestc_read),
        unit="unknown", states_rate=True,
    ),
    DataSet(
        "paderborn", "N15_M07_F10_K001_1.mat", _paderborn_facts, isolated(paderborn_read),
        unit="unknown", snapshot=True,
    ),
)  # fmt: skip

DATA_SETS = {data_set.name: data_set for data_set in _SETS}
"""The published data sets by name."""
