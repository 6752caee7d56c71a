"""Figures of signals, spectra, records, scenes and maps, as matplotlib figures that a caller changes or saves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from typing import ParamSpec

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from models.machine.bearing import Bearing, Kinematics, kinematics
from models.machine.scene import Scene
from models.maps.data import RmsMap
from models.solve.response import Response
from models.words.request import Sensor
from monitor.health.signal.cyclic import CyclicCoherence
from monitor.health.signal.settings import fundamentals
from monitor.report.figures.cyclic import cyclic_sheet
from monitor.report.figures.drawing import BLUE, GREY, STYLE, WIDTH, legend_above, log_ticks
from monitor.report.figures.rms_map import map_sheet
from monitor.report.figures.scene import fundamental_of, scene_sheet, signal_of
from monitor.report.figures.sheet import compose
from monitor.report.figures.spectrum import ORDERS, mark_parts
from spallwatch.analysis import SignalError
from spallwatch.bearings import as_bearing
from streams.types.block import STANDARD_GRAVITY

_P = ParamSpec("_P")


def _styled(draw: Callable[_P, Figure]) -> Callable[_P, Figure]:
    """Draw with the program's settings of matplotlib, which stay as they are outside of it."""

    @wraps(draw)
    def styled(*args: _P.args, **kwargs: _P.kwargs) -> Figure:
        with mpl.rc_context(STYLE):
            return draw(*args, **kwargs)

    return styled


@_styled
def plot_signal(signal: xr.DataArray) -> Figure:
    """Return the waveforms of a signal, one panel a channel; acceleration in g."""
    made, panels = _panels(signal.sizes["channel"], 1.9)
    unit = _unit(signal)
    for axes, (name, row) in zip(panels, _rows(signal), strict=True):
        axes.plot(signal.time.values, row / _one(signal), color=BLUE, linewidth=0.6)
        axes.set_ylabel(f"{name} ({unit})")
    panels[-1].set_xlabel("time (s)")
    return made


@_styled
def plot_spectrum(spectrum: xr.DataArray, frequencies: Kinematics | None = None, *, log: bool = False) -> Figure:
    """Return a spectrum, one panel a channel, with the first five fault frequencies of each part where they are given.

    Args:
        spectrum: of ``spectrum``, ``envelope_spectrum`` or ``ias_spectrum``.
        frequencies: of ``fault_frequencies``, at 1 Hz for a spectrum over events per revolution; the panels then end
            behind the highest of them.
        log: logarithmic amplitudes.
    """
    over = "order" if "order" in spectrum.dims else "frequency"
    if "channel" not in spectrum.dims:
        spectrum = spectrum.expand_dims(channel=[str(spectrum.name)])
    made, panels = _panels(spectrum.sizes["channel"], 2.4)
    unit, x = _unit(spectrum), spectrum[over].values
    marks = {} if frequencies is None else fundamentals(frequencies)
    last = float(x[-1]) if not marks else min(float(x[-1]), (ORDERS + 0.3) * max(marks.values()))
    shown = (x > 0.0) & (x <= last)
    for axes, (name, row) in zip(panels, _rows(spectrum), strict=True):
        values = row[shown] / _one(spectrum)
        axes.plot(x[shown], values, color=GREY, linewidth=0.8)
        if log:
            axes.set_yscale("log")
        top = axes.get_ylim()[1]
        mark_parts(axes, marks, last, top)
        axes.set_ylim(top=top)
        axes.set_ylabel(f"{name} ({unit})")
        axes.set_xlim(0.0, last)
    if marks:
        legend_above(panels[0])
    panels[-1].set_xlabel("events per revolution" if over == "order" else "frequency (Hz)")
    return made


@_styled
def plot_records(records: xr.Dataset, variables: Sequence[str] = ("rms", "h_or"), *, log: bool = True) -> Figure:
    """Return variables of records over time, one panel each, a line a channel, with the start of the final stage.

    ``speed`` has a band from the least to the highest speed in each block, where these are known.

    Args:
        records: of ``replay`` or ``open_records``.
        variables: numbers over (time, channel).
        log: logarithmic axes where all values are positive.

    Raises:
        SignalError: a variable is not there, or not a number over time and channel.
    """
    made, panels = _panels(len(variables), 2.1)
    for axes, name in zip(panels, variables, strict=True):
        if name not in records or records[name].dims != ("time", "channel") or records[name].dtype.kind != "f":
            raise SignalError(f"records: {name!r} is not a number over time and channel in them")
        array, one = records[name], _one(records[name])
        for channel in array.channel.values:
            (line,) = axes.plot(
                records.time.values, array.sel(channel=channel).values / one, linewidth=0.9, label=str(channel)
            )
            if name == "speed" and "speed_min" in records:
                low, high = (records[key].sel(channel=channel).values for key in ("speed_min", "speed_max"))
                axes.fill_between(records.time.values, low, high, color=line.get_color(), alpha=0.2, linewidth=0)
        values = array.values[np.isfinite(array.values)]
        if log and values.size and values.min() > 0.0:
            axes.set_yscale("log")
            log_ticks(axes.yaxis)
        axes.set_ylabel(f"{name} ({_unit(array)})" if _unit(array) else name)
        _mark_final_stage(axes, records)
    legend_above(panels[0])
    dated = records.time.dtype.kind == "M"
    panels[-1].set_xlabel("time (UTC)" if dated else "time (s)")
    return made


def plot_scene(scene: Scene, response: Response, *, sensor: Sensor | None = None) -> Figure:
    """Return the waveform, the path of a ball over the defect and the spectrum of a simulated scene."""
    chosen = sensor or response.accelerometer
    sensed = signal_of(response, chosen, fundamental_of(scene)[0])
    return compose(scene_sheet(scene, sensed, sensor=chosen, title=f"Scene of {scene.bearing.designation}"))


def plot_map(rms_map: RmsMap) -> Figure:
    """Return a map with lines of equal volume, cuts through it, and its errors."""
    return compose(map_sheet(rms_map))


def plot_cyclic(coherence: xr.DataArray, bearing: Bearing | str) -> Figure:
    """Return a map of the coherence and the enhanced envelope spectrum, with the lines of a bearing."""
    known = as_bearing(bearing)
    about = coherence.attrs
    found = CyclicCoherence(
        "order",
        coherence.order.values,
        coherence.frequency.values,
        coherence.values,
        tuple(about["band_hz"]),
        coherence.enhanced.values,
        about["limit"],
    )
    orders = fundamentals(kinematics(known, 1.0))
    facts = [("Speed", f"{about['speed_min_hz']:.4g} to {about['speed_max_hz']:.4g} Hz")]
    return compose(cyclic_sheet(found, orders, facts, f"Cyclic coherence, {known.designation}"))


def _panels(count: int, height: float) -> tuple[Figure, list[Axes]]:
    made = Figure(figsize=(WIDTH, 0.5 + height * count), layout="constrained")
    return made, [axes for row in made.subplots(count, 1, sharex=True, squeeze=False) for axes in row]


def _rows(array: xr.DataArray) -> list[tuple[str, np.ndarray]]:
    return [(str(name), array.sel(channel=name).values) for name in array.channel.values]


def _one(array: xr.DataArray) -> float:
    """Return the value of one unit that is shown."""
    return STANDARD_GRAVITY if array.attrs.get("units") == "m s-2" else 1.0


def _unit(array: xr.DataArray) -> str:
    stated = str(array.attrs.get("units", ""))
    return {"m s-2": "g", "rad s-1": "rad/s", "unknown": "own unit", "1": ""}.get(stated, stated)


def _mark_final_stage(axes: Axes, records: xr.Dataset) -> None:
    if "t_fs" not in records:
        return
    for channel in records.channel.values:
        found = records.t_fs.sel(channel=channel).dropna("time").values
        if found.size:
            axes.axvline(found[-1], color=GREY, linestyle="--", linewidth=0.9)
