"""Recordings as arrays of xarray."""

from __future__ import annotations

import contextlib
import itertools
import time
import warnings
from collections.abc import Container, Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import lru_cache
from os import PathLike, fspath
from pathlib import Path
from typing import Literal, TypedDict, Unpack

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from models.words.errors import WrongInputError
from monitor.health.block_time import TimedBlock, timed
from monitor.health.signal.differentiate import USUAL_LIMIT
from monitor.health.signal.quality import OrderState, check_samples
from streams.dates.best import latest_of
from streams.dates.stating import stamp_doubt
from streams.files.datasets import DATA_SETS
from streams.files.statements import known_unit, multiple_of
from streams.files.survey import Survey, survey
from streams.open import open_source
from streams.types.block import VELOCITY, Block, Rejected, to_si
from streams.types.samples import ReaderError
from streams.types.spec import DEFAULT_BLOCK_SECONDS, ChannelSpec, SourceError, SourceSpec
from streams.types.stamps import Order, utc_text

_NAME = "recording"
_MAX_KEPT_SAMPLES = 1 << 20
"""Of a block whose coordinates are kept for the next one."""
_QUANTITIES = {
    "m/s2": ("m s-2", "acceleration"),
    "m/s": ("m s-1", "velocity"),
    "unknown": ("unknown", "vibration in an unknown unit"),
}
"""Units and name of a signal by its unit in SI."""


class RecordingError(WrongInputError):
    """A recording, or a block of it, that cannot be read; the message names it, what was expected and what came."""


class LostSamplesWarning(UserWarning):
    """Samples are missing (NaN), filled with a constant or beyond what a sensor gives; the message says which."""


class DoubtedTimeWarning(UserWarning):
    """The time of a block is doubted: it contradicts itself, those before or the present; the message says how."""


class Reading(TypedDict, total=False):
    """How a recording is read; what it states itself need not be given. Keys as in ``[[source]]`` and ``[[channel]]``.

    Attributes:
        channels: names of the columns or variables that are taken, by default all of vibration or a tacho.
        unit: of all channels: "g", "m/s2", "V", "unknown" or "mm/s" of a velocity, or a multiple such as "mV".
        sensitivity_mv_per_g: of the sensors, for "V".
        scale: factor from the stored numbers to ``unit``.
        rate_hz: sampling rate.
        start_utc: of the first sample.
        format: "csv", "wav", "mat", ... or the name of a published data set, by default recognised.
        range_g: full scale of integer files, g.
        timezone: of dates without one, such as "Europe/Rome".
        time_from, time_name: what dates several files, and the strptime pattern of dates in their names.
        date_order: of day, month and year in dates that do not state it.
        interval_s: from the start of a file to that of the next one, where they are counted.
        files: pattern of the names of files of a folder, several: of those recorded at the same time, a channel each;
            by default told by their names.
        pulses: name of the array with the times of a tacho's pulses, or of the text file beside each file.
        disregard: keys in the files that are not believed, where they contradict others.
        sensor_max_hz: of sensors of velocity, up to which acceleration is their derivative, by default 2000 Hz.
    """

    channels: Sequence[str]
    unit: str
    sensitivity_mv_per_g: float
    scale: float
    rate_hz: float
    start_utc: datetime
    format: str
    range_g: float
    timezone: str
    time_from: Literal["header", "name", "count", "mtime"]
    time_name: str
    date_order: Order
    interval_s: float
    files: str | Sequence[str]
    pulses: str
    disregard: Sequence[str]
    sensor_max_hz: float


def to_signal(samples: ArrayLike, *, rate_hz: float, unit: str, channels: Sequence[str] | None = None) -> xr.DataArray:
    """Return samples as a signal that the other functions take.

    Args:
        samples: shape (sample,) or (channel, sample).
        rate_hz: sampling rate.
        unit: "g", "m/s2", "mm/s" of a velocity, or "unknown": such a signal has names and ratios, but no levels.
        channels: names of the channels.

    Returns:
        Dimensions (channel, time), in m/s2, or m/s with the attribute ``sensor_max_hz`` (2000; up to which acceleration
        is its derivative); ``time`` in s from the first sample.

    Raises:
        RecordingError: another shape, number of names, rate or unit.
    """
    values = np.atleast_2d(np.asarray(samples))
    names = tuple(channels) if channels is not None else tuple(f"channel_{i + 1}" for i in range(len(values)))
    if values.ndim != 2 or values.dtype.kind not in "fiu" or values.shape[1] < 2:
        raise RecordingError(
            f"samples: expected real numbers of shape (sample,) or (channel, sample), got {values.dtype} of shape "
            f"{np.shape(samples)}"
        )
    if len(names) != len(values):
        raise RecordingError(f"channels: expected {len(values)} names, got {len(names)}: {', '.join(names)}")
    if not (np.isfinite(rate_hz) and rate_hz > 0.0):
        raise RecordingError(f"rate_hz: expected a positive number, got {rate_hz!r}")
    if unit not in ("g", "m/s2", "unknown", VELOCITY):
        raise RecordingError(f"unit: expected g, m/s2, mm/s or unknown, got {unit!r}")
    converted, si_unit = to_si(values if values.dtype.kind == "f" else values.astype(np.float64), unit)
    return _array(converted, names, rate_hz, si_unit)


def read(path: str | PathLike[str], **how: Unpack[Reading]) -> xr.DataArray:
    """Read one file of any known format, which holds one recording.

    Args:
        path: of the file.
        how: see ``Reading``.

    Returns:
        Dimensions (channel, time), in m/s2, or of a velocity m/s; ``time`` in s from the first sample; attributes
        ``rate_hz``, and ``start_utc``, ``speed_hz``, ``load_newton`` where the file states them, ``time_source`` and
        ``time_uncertainty_s`` of the start, ``time_stated_utc`` where it is another one that is not believed,
        ``pulse_times_s`` where it has pulses, ``left_out`` with the names of rows that are no vibration.

    Warns:
        LostSamplesWarning: samples are missing, and NaN, or were filled with a constant.
        DoubtedTimeWarning: its time contradicts itself, or the present.

    Raises:
        RecordingError: it cannot be read, or rate or unit are neither stated nor given.
    """
    found = list(itertools.islice(blocks(path, block_s="file", **how), 2))
    if len(found) != 1:
        count = "no file that is read"
        if found:
            count = "several recordings" if "#" in found[1].attrs["name"] and Path(path).is_file() else "several files"
        raise RecordingError(f'{fspath(path)}: holds {count}; read is for one, blocks(..., block_s="file") yields each')
    return found[0]


def blocks(
    path: str | PathLike[str],
    *,
    block_s: float | Literal["file"] = DEFAULT_BLOCK_SECONDS,
    skip_rejected: bool = False,
    **how: Unpack[Reading],
) -> Iterator[xr.DataArray]:
    """Yield the blocks of a recording in order: of a file, a folder, an archive or ``rig:ferrara?seed=1``.

    Args:
        path: of the recording; also with the name of a data set before it, such as ``dataset:pronostia:PATH``.
        block_s: length of a block, s; "file": one block a file, or each recording of it.
        skip_rejected: go on after a block that cannot be read, instead of raising.
        how: see ``Reading``.

    Yields:
        As ``read``, with the further attributes ``name``, ``sequence`` (from 1) and ``elapsed_s``, from the first
        sample of the recording, where it is known.

    Warns:
        LostSamplesWarning: as ``read``.
        DoubtedTimeWarning: as ``read``, or the time does not go on from those before.
        NothingAcceptedWarning: with ``skip_rejected``, every block was rejected.

    Raises:
        RecordingError: the recording cannot be opened, or a block of it not be read.
    """
    how = in_own_words(how)
    spec = source_of(path, block_s, how)
    seen = folder_survey(spec)
    spec = _with_channels(spec if seen is None else replace(spec, files=seen.files), how, seen)
    given, rejection, order, latest = False, None, OrderState(), latest_of(time.time())
    try:
        for item in open_source(spec):
            if isinstance(item, Block):
                given = True
                order, placed = timed(order, item, None, latest)
                yield _signal_of(item, placed, how)
            elif not skip_rejected:
                raise _rejection(item)
            else:
                rejection = rejection or _rejection(item)
        if not given and rejection is not None:
            from spallwatch.records import NothingAcceptedWarning

            warnings.warn(f"{fspath(path)}: no block was accepted: {rejection}", NothingAcceptedWarning, stacklevel=2)
    except SourceError as error:
        raise RecordingError(_in_words_of_calls(str(error))) from None


def in_own_words(how: Reading) -> Reading:
    """Return how a recording is read with one of our units for a multiple of it, and its factor in the scale."""
    unit, factor = multiple_of(known_unit(how.get("unit")))
    if not unit:
        return how
    scale = how.get("scale", 1.0) * factor
    return {**how, "unit": unit} if factor == 1.0 else {**how, "unit": unit, "scale": scale}


def source_of(path: str | PathLike[str], block_s: float | Literal["file"], how: Reading) -> SourceSpec:
    """Return the source that arguments stand for, without its channels; TypeError for an unknown argument."""
    wrong = sorted(set(how) - set(Reading.__annotations__))
    if wrong:
        allowed = ", ".join(Reading.__annotations__)
        raise TypeError(f"{wrong[0]!r} is not an argument of a recording; expected {allowed}")
    start, files = how.get("start_utc"), how.get("files", ())
    if start is not None and start.tzinfo is None:
        start = start.replace(tzinfo=UTC)
    return SourceSpec(
        name=_NAME,
        url=fspath(path),
        start=None if start is None else start.timestamp(),
        block_s=block_s,
        format=how.get("format", "auto"),
        rate=how.get("rate_hz"),
        range_g=how.get("range_g"),
        timezone=how.get("timezone", "UTC"),
        time_from=how.get("time_from"),
        time_name=how.get("time_name"),
        date_order=how.get("date_order"),
        interval=how.get("interval_s"),
        pulses=how.get("pulses"),
        files=(files,) if isinstance(files, str) else tuple(files),
        disregard=tuple(how.get("disregard", ())),
    )


def folder_survey(spec: SourceSpec) -> Survey | None:
    """Return what the files of a folder state, also how they are read together; of a file or data set None.

    None also where nothing can be read: opening refuses it.
    """
    kind, path = _place_of(spec)
    if spec.files or kind in DATA_SETS or not Path(path).is_dir():
        return None
    with contextlib.suppress(SourceError, ReaderError):
        return survey(path, kind, spec.timezone)
    return None


def _place_of(spec: SourceSpec) -> tuple[str, str]:
    """Return the format and the path of a source of files."""
    scheme, colon, rest = spec.url.partition(":")
    if scheme == "folder" and colon:
        return spec.format, rest
    if scheme == "dataset" and colon:
        kind, _, path = rest.partition(":")
        return kind, path
    return spec.format, spec.url


def _with_channels(spec: SourceSpec, how: Reading, seen: Survey | None = None) -> SourceSpec:
    """Add the channels, all of the first readable file where unit or scale are given without them."""
    scaling = {key for key in ("unit", "scale", "sensitivity_mv_per_g") if key in how}
    names = tuple(how["channels"]) if "channels" in how else None
    if names is None and scaling:
        names = tuple(first_channels(spec, ("vibration", "tacho"), seen))
    if names is None:
        return spec
    try:
        channels = tuple(
            ChannelSpec(
                name=name,
                column=name,
                unit=how.get("unit"),
                scale=how.get("scale"),
                sensitivity_mv_per_g=how.get("sensitivity_mv_per_g"),
            )
            for name in names
        )
    except SourceError as error:
        raise RecordingError(_in_words_of_calls(str(error))) from None
    return replace(spec, channels=channels)


def first_channels(
    spec: SourceSpec, kinds: Container[str] | None = None, seen: Survey | None = None
) -> dict[str, str | None]:
    """Return the channels of the first file of a source that can be read, with their units where they are stated.

    ``kinds``: those of :mod:`streams.files.columns` that are returned, None: all; ``seen``: its files, where they were
    looked at.

    Raises:
        RecordingError: there is none.
    """
    if spec.url.startswith("rig:"):
        block = next(item for item in open_source(spec) if isinstance(item, Block))
        return dict(zip(block.channels, block.units, strict=True))
    kind, path = _place_of(spec)
    try:
        found = survey(path, kind, spec.timezone, spec.files) if seen is None else seen
    except (SourceError, ReaderError) as error:
        raise RecordingError(_in_words_of_calls(str(error)).replace("[[source]] survey: url: ", "")) from None
    rows = [row for row in found.rows if kinds is None or row.kind in kinds]
    return {row.name: row.unit or found.data_set.unit for row in rows}


def _signal_of(block: Block, placed: TimedBlock, how: Reading) -> xr.DataArray:
    """Return a block as a signal, at its judged time."""
    rows: list[NDArray[np.floating]] = []
    units: list[str] = []
    for row, unit in zip(block.samples, block.units, strict=True):
        values, si_unit = to_si(row, unit, how.get("scale", 1.0), how.get("sensitivity_mv_per_g"))
        rows.append(values)
        units.append(si_unit)
    if len(set(units)) > 1:
        both = ", ".join(f"{name}: {unit}" for name, unit in zip(block.channels, block.units, strict=True))
        raise RecordingError(f"{block.name}: channels of several quantities ({both}); choose some with channels=")
    for name, values, unit in zip(block.channels, rows, units, strict=True):
        verdict = check_samples(values, absolute=unit == "m/s2")
        if {verdict.status, *verdict.flags} & {"nan", "filled", "out_of_range"}:
            warnings.warn(f"{block.name}: {name}: {verdict.reason}", LostSamplesWarning, stacklevel=3)
    judged, start = placed.judged, placed.block.start
    doubt = judged.doubt or stamp_doubt(block.start, block.samples.shape[1] / block.rate, block.stated)
    if doubt:
        warnings.warn(f"{block.name}: {doubt}", DoubtedTimeWarning, stacklevel=3)
    found = _array(np.stack(rows), block.channels, block.rate, units[0])
    found.attrs |= {"name": block.name, "sequence": block.sequence}
    if "sensor_max_hz" in found.attrs and "sensor_max_hz" in how:
        found.attrs["sensor_max_hz"] = float(how["sensor_max_hz"])
    stated = {
        "start_utc": None if start is None else datetime.fromtimestamp(start, UTC).isoformat(),
        "time_source": judged.source,
        "time_uncertainty_s": judged.uncertainty,
        "time_stated_utc": None if judged.stated is None else utc_text(judged.stated),
        "elapsed_s": placed.block.elapsed,
        "speed_hz": block.speed,
        "load_newton": block.load,
    }
    if block.pulses is not None:
        stated |= {"pulse_times_s": block.pulses.times, "pulses_per_revolution": block.pulses.per_revolution}
    if "channels" not in how and block.left_out:
        stated |= {"left_out": list(block.left_out)}
    found.attrs |= {key: value for key, value in stated.items() if value is not None}
    return found


def _array(values: NDArray[np.floating], channels: Sequence[str], rate: float, unit: str) -> xr.DataArray:
    axes = _kept_axes if values.shape[1] <= _MAX_KEPT_SAMPLES else _axes
    return axes(tuple(channels), values.shape[1], rate, unit).copy(deep=False, data=values)


def _axes(channels: tuple[str, ...], length: int, rate: float, unit: str) -> xr.DataArray:
    """Return zeros with the coordinates and attributes of a signal, of which blocks of one kind have the same."""
    time = xr.Variable("time", np.arange(length) / rate, {"units": "s", "long_name": "time"})
    units, long_name = _QUANTITIES[unit]
    return xr.DataArray(
        np.broadcast_to(0.0, (len(channels), length)),
        dims=("channel", "time"),
        coords={"channel": list(channels), "time": time},
        name="velocity" if unit == "m/s" else "acceleration",
        attrs={"units": units, "long_name": long_name, "rate_hz": float(rate)}
        | ({"sensor_max_hz": USUAL_LIMIT} if unit == "m/s" else {}),
    )


_kept_axes = lru_cache(maxsize=2)(_axes)


def _rejection(item: Rejected) -> RecordingError:
    reason = _in_words_of_calls(item.reason.removeprefix(f"{item.name}: "))
    return RecordingError(f"{item.name}: {reason} ({item.status})")


def _in_words_of_calls(text: str) -> str:
    """Return a message about a configured source as one about the arguments of a call."""
    for keys, words in (
        (f"[[source]] {_NAME}: url: ", ""),
        (f"[[source]] {_NAME}: ", ""),
        ("give [[channel]] unit", 'give unit="g", "m/s2", "mm/s", "V" or "unknown"'),
        ("a [[channel]] with its unit is missing", 'unit is missing (unit="g", "m/s2", "mm/s", "V" or "unknown")'),
        ("[[channel]] ", ""),
        ("[[source]] ", ""),
    ):
        text = text.replace(keys, words)
    return text
