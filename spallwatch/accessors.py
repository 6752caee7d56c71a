"""Accessors of xarray: ``records.table()``, ``signal.bearing`` and ``records.bearing``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from models.words.errors import WrongInputError
from monitor.words.features import FEATURES

if TYPE_CHECKING:
    import pandas as pd

    from models.machine.bearing import Bearing

_WORDS = ("status", "flags", "quality_status", "stage", "fault", "edv_status", "tt_status")
_LINES = ("envelope_amplitude", "envelope_floor", "envelope_snr")


class AccessorError(WrongInputError):
    """A signal or a dataset that has not what is asked of it; the message says what it has."""


@xr.register_dataset_accessor("table")
class RecordTable:
    """``records.table()``: records as a table of pandas."""

    def __init__(self, records: xr.Dataset) -> None:
        """Take records in the form of ``open_records``."""
        self._records = records

    def __call__(self, names: Sequence[str] | None = None) -> pd.DataFrame:
        """Return a row for each block and channel.

        Args:
            names: of features and words of the records, by default the words of status and all features that have a
                value; of several bands or thresholds the first.

        Returns:
            Sorted by time and channel: index ``time`` in UTC, or the time from the first block where blocks have no
            dates; ``channel`` and words as categories, numbers in SI, their units (UDUNITS) in ``attrs["units"]``.

        Raises:
            AccessorError: the dataset holds no records, or not one of the names.
        """
        import pandas as pd

        records = self._records
        if not {"time", "channel"} <= set(records.sizes):
            raise AccessorError(
                f"table: expected records along time and channel, got {', '.join(map(str, records.sizes))}"
            )
        there = [name for name in (*_WORDS, *FEATURES) if name in records]
        chosen = there if names is None else list(names)
        if wrong := sorted(set(chosen) - set(there)):
            raise AccessorError(f"table: no {wrong[0]!r} in these records; they have {', '.join(there)}")
        times, channels = records.sizes["time"], records.sizes["channel"]
        columns: dict[str, object] = {"channel": pd.Categorical(np.tile(records["channel"].values.astype(str), times))}
        for name in chosen:
            values = _by_row(records[name], times, channels)
            is_word = values.dtype.kind in "OU"
            if names is None and not is_word and not np.isfinite(values).any():
                continue
            columns[name] = pd.Categorical(values.astype(str)) if is_word else values
        table = pd.DataFrame(columns, index=_index(records["time"].values, channels))
        units = {name: records[name].attrs.get("units", "1") for name in columns if name in FEATURES}
        table.attrs = {"units": units, "machine": str(records.attrs.get("machine", ""))}
        return table


def _by_row(array: xr.DataArray, times: int, channels: int) -> np.ndarray:
    """Return the values of a variable for each block and channel in turn; of further dimensions the first."""
    first = array.isel({dim: 0 for dim in array.dims if dim not in ("time", "channel")})
    if "channel" not in first.dims:
        return np.repeat(np.asarray(first.values), channels)
    return np.asarray(first.transpose("time", "channel").values).reshape(times * channels)


def _index(times: np.ndarray, channels: int) -> pd.Index:
    import pandas as pd

    repeated = np.repeat(times, channels)
    if times.dtype.kind == "M":
        return pd.DatetimeIndex(repeated, name="time").tz_localize("UTC")
    return pd.TimedeltaIndex(pd.to_timedelta(repeated, unit="s"), name="time")


@xr.register_dataarray_accessor("bearing")
class SignalBearing:
    """``signal.bearing``: what a signal of ``read``, ``blocks`` or ``to_signal`` says of a bearing."""

    def __init__(self, signal: xr.DataArray) -> None:
        """Take a signal."""
        self._signal = signal

    def envelope_spectrum(self, band_hz: tuple[float, float]) -> xr.DataArray:
        """Return ``spallwatch.envelope_spectrum`` of the signal; SignalError as that."""
        from spallwatch.analysis import envelope_spectrum

        return envelope_spectrum(self._signal, band_hz)

    def fault_lines(self, bearing: Bearing | str, speed_hz: float | None = None, harmonics: int = 5) -> xr.DataArray:
        """Return the frequencies at which damage shows.

        Args:
            bearing: geometry or designation.
            speed_hz: of the shaft; by default what the recording states.
            harmonics: how many lines of each part.

        Returns:
            Dimensions (part, harmonic), Hz, of pure rolling.

        Raises:
            AccessorError: neither states the speed.
            BearingError: the designation is not in the catalogue.
        """
        speed = self._signal.attrs.get("speed_hz") if speed_hz is None else speed_hz
        if speed is None:
            raise AccessorError("fault_lines: the signal states no speed; give speed_hz")
        return _orders(bearing, harmonics) * float(speed)


@xr.register_dataset_accessor("bearing")
class RecordBearing:
    """``records.bearing``: the lines of a bearing in records."""

    def __init__(self, records: xr.Dataset) -> None:
        """Take records in the form of ``open_records``."""
        self._records = records

    def fault_lines(self, bearing: Bearing | str, harmonics: int = 5) -> xr.DataArray:
        """Return the frequencies at which damage shows at the speed of each block.

        Arguments and errors as ``signal.bearing.fault_lines``; AccessorError where the records hold no speed.

        Returns:
            Dimensions (time, channel, part, harmonic), Hz; NaN where the speed of a block is not known.
        """
        if "speed" not in self._records:
            raise AccessorError("fault_lines: the dataset holds no speed of records")
        return self._records["speed"] * _orders(bearing, harmonics)

    def envelope_lines(self, bearing: Bearing | str) -> xr.Dataset:
        """Return the lines of the envelope spectra that the records keep, with their frequencies.

        Returns:
            Variables ``envelope_amplitude``, ``envelope_floor`` and ``envelope_snr`` over (time, channel, part,
            harmonic), and ``frequency`` as a coordinate.

        Raises:
            AccessorError: the dataset holds no such lines.
        """
        names = [name for name in _LINES if name in self._records]
        if not names:
            raise AccessorError(f"envelope_lines: expected records with {', '.join(_LINES)}")
        lines = self.fault_lines(bearing, self._records.sizes["harmonic"])
        return self._records[names].assign_coords(frequency=lines)


def _orders(bearing: Bearing | str, harmonics: int) -> xr.DataArray:
    """Return the lines of each part, (part, harmonic), in Hz at one turn per second."""
    from models.machine.bearing import kinematics
    from monitor.words.parts import PARTS
    from spallwatch.bearings import as_bearing

    if harmonics < 1:
        raise AccessorError(f"harmonics: expected 1 or more, got {harmonics}")
    found = kinematics(as_bearing(bearing), 1.0)
    numbers = np.arange(1, harmonics + 1)
    return xr.DataArray(
        np.outer([part.frequency(found) for part in PARTS], numbers),
        dims=("part", "harmonic"),
        coords={"part": [part.name for part in PARTS], "harmonic": numbers},
        name="frequency",
        attrs={"units": "Hz", "long_name": "frequency of pure rolling"},
    )
