"""A simulated scene as a picture: the waveform of a few ball periods, and the lines of its spectrum."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from models.response import Response, Sensor
from streams.block import STANDARD_GRAVITY

_PERIODS = 4
_RATE = 204800.0
_HIGHEST = 12000.0


def draw_response(response: Response, path: Path, *, sensor: Sensor, title: str) -> None:
    """Draw four ball periods and the lines up to 12 kHz; PNG or SVG by the name's ending.

    Raises:
        OSError: the file cannot be written.
    """
    figure = Figure(figsize=(9.0, 5.6), layout="constrained")
    FigureCanvasAgg(figure)
    top, bottom = figure.subplots(2, 1)
    signal = response.acceleration(_RATE, _PERIODS / response.bpfo, sensor=sensor) / STANDARD_GRAVITY
    top.plot(1e3 * np.arange(signal.size) / _RATE, signal, lw=0.8, color="#0072b2")
    top.set(xlabel="time [ms]", ylabel="acceleration [g]", xlim=(0.0, 1e3 * _PERIODS / response.bpfo))
    frequency, amplitude = response.lines(sensor)
    shown = frequency <= _HIGHEST
    bottom.vlines(frequency[shown], 0.0, amplitude[shown] / STANDARD_GRAVITY, lw=1.2, color="#7b3f72")
    bottom.set(
        xlabel=f"frequency [Hz]: multiples of BPFO, {response.bpfo:.1f} Hz",
        ylabel="amplitude [g]",
        xlim=(0.0, _HIGHEST),
        ylim=(0.0, None),
    )
    for axes in (top, bottom):
        axes.grid(alpha=0.25)
    rms = response.rms if sensor == "mo" else response.rms_resonator
    figure.suptitle(f"{title}: RMS {rms / STANDARD_GRAVITY:.3g} g ({response.status})", fontsize=10)
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "spallwatch"}):
        figure.savefig(path, dpi=120, metadata={"Date": None} if path.suffix.lower() == ".svg" else None)
