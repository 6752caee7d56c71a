"""Spectra for the gallery of the other models: of a signal, of its envelope, and how their lines are looked up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from models.published.acceptance import BAND, envelope
from monitor.report.figures.drawing import AXIS, PURPLE, SOFT

Values = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Lines:
    """Single-sided amplitudes over frequency, Hz, in the unit of the signal, through a Hann window."""

    frequency: Values
    amplitude: Values

    @property
    def resolution(self) -> float:
        """Spacing of the frequencies, Hz."""
        return float(self.frequency[1])

    def at(self, frequency: float) -> float:
        """Return the highest amplitude within a bin and a half of a frequency."""
        near = np.abs(self.frequency - frequency) <= 1.5 * self.resolution
        return float(self.amplitude[near].max())

    def highest(self, low: float = 2.0, high: float = np.inf) -> float:
        """Return the frequency of the highest line between two frequencies, Hz."""
        inside = (self.frequency >= low) & (self.frequency <= high)
        return float(self.frequency[inside][np.argmax(self.amplitude[inside])])

    def stands_out(self, frequency: float, to: float, times: float = 5.0) -> bool:
        """Whether a line is so many times the median of the lines below ``to``, Hz."""
        below = (self.frequency > 0.0) & (self.frequency < to)
        return self.at(frequency) > times * float(np.median(self.amplitude[below]))

    def below(self, high: float) -> tuple[Values, Values]:
        """Return frequencies and amplitudes up to a frequency, without the mean."""
        shown = (self.frequency > 0.0) & (self.frequency <= high)
        return self.frequency[shown], self.amplitude[shown]


def spectrum(signal: Values, rate: float) -> Lines:
    """Return the spectrum of a signal without its mean; ``rate`` in Hz."""
    window = np.hanning(len(signal) + 2)[1:-1]
    amplitude = 2.0 * np.abs(np.fft.rfft((signal - np.mean(signal)) * window)) / float(np.sum(window))
    frequency = np.arange(len(amplitude), dtype=np.float64) * (rate / len(signal))
    return Lines(frequency, np.asarray(amplitude, dtype=np.float64))


def envelope_spectrum(signal: Values, rate: float, band: tuple[float, float] = BAND) -> Lines:
    """Return the spectrum of the envelope of a signal within a band, Hz."""
    return spectrum(envelope(signal, rate, band), rate)


def is_multiple(frequency: float, of: float, within: float) -> bool:
    """Whether a frequency lies within so many Hz of a multiple of another."""
    return abs(frequency - max(1, round(frequency / of)) * of) <= within


def mark(axes: Axes, named: Mapping[str, float], *, names: bool = True) -> None:
    """Mark frequencies of an axis with dotted lines, with their names at the top."""
    for name, frequency in named.items():
        axes.axvline(frequency, color=AXIS, lw=0.8, ls=":", zorder=0)
        if names:
            place: Any = ("data", "axes fraction")
            axes.annotate(name, (frequency, 1.02), xycoords=place, ha="center", va="bottom", fontsize=7, color=SOFT)


def named_panel(axes: Axes, name: str, *, marked: bool = False) -> None:
    """Write the name of a panel above its upper right corner; higher where names of lines stand there."""
    axes.set_title(name, loc="right", fontsize=8.5, pad=12.0 if marked else 2.0)


def panels_of_lines(
    panels: Sequence[Axes], drawn: Mapping[str, Lines], high: float, named: Mapping[str, float], *, share: bool = True
) -> None:
    """Draw a spectrum, m/s2, up to ``high`` Hz into each panel, with the names of lines above the first.

    ``share``: whether all have the scale of the highest.
    """
    highest = max(float(lines.below(high)[1].max()) for lines in drawn.values())
    for place, (axes, (name, lines)) in enumerate(zip(panels, drawn.items(), strict=True)):
        axes.plot(*lines.below(high), color=PURPLE, lw=0.9)
        axes.set(xlim=(0.0, high), ylim=(0.0, 1.08 * highest if share else None), ylabel="m/s²")
        mark(axes, named, names=place == 0)
        named_panel(axes, name, marked=place == 0 and bool(named))
    panels[-1].set_xlabel("frequency (Hz)")


def kept_lines(
    drawn: Mapping[str, Lines], high: float, step: float = 1.0, units: tuple[str, str] = ("hz", "m_s2")
) -> dict[str, Any]:
    """Return the highest amplitude in each ``step`` up to ``high`` as data of a figure, with the ``units`` of both."""
    data: dict[str, Any] = {f"frequency_step_{units[0]}": step}
    for name, lines in drawn.items():
        frequency, amplitude = lines.below(high)
        places = (frequency / step).astype(np.intp)
        starts = np.flatnonzero(np.diff(places, prepend=-1))
        data[f"highest_{name.lower()}_{units[1]}"] = np.maximum.reduceat(amplitude, starts)
    return data
