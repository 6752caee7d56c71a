"""The lines of one fault family, and the depth of a comb with its error."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.comb import LineSpectrum

HANN_POWER = 1.5
"""Sum of the squares of the Hann bins of a unit line (its equivalent noise bandwidth, in bins)."""

MOST_OF_ONE_LINE = 4.0
"""The highest line of a comb counts in its depth as at most this many times the others together: one line that
happens to stand at a harmonic of a fault frequency is no comb."""

_INDEPENDENT_BINS = 2.87
"""Independent bins among five neighbouring ones of a Hann-windowed spectrum."""

NEAR_BINS = np.arange(-2, 3)
"""Bins about a line that count to it."""


@dataclass(frozen=True, eq=False)
class FaultLines:
    """The harmonics of one fault frequency in one spectrum; arrays of shape (n_harmonics,).

    Attributes:
        amplitude: amplitude of each line in the unit of the spectrum; noise adds to it in power. 0 where unresolved.
        floor: what noise alone reads in the same measure (root mean square); 0 where unresolved.
        resolved: whether the spectrum can show the line: inside it, and apart from its neighbours by four bins or more.
        fundamental: frequency at which the comb stands, Hz.
        speed_factor: that frequency over the nominal one, common to all lines; 1 where none is resolved.
        at_edge: whether the search ended at its limit: the line that it follows may stand outside.
        comb_score: sum of the excess over the lines, as the search maximises it.
        score: root mean square of ``snr`` over the resolved lines; 0 where there is none.
        threshold: the score that noise exceeds with the stated false-alarm probability, the search included.
        power, noise: power of each line and of the noise under it beside the harmonics of the shaft: what stands at
            one of them is no evidence of the bearing. None: as ``amplitude`` and ``floor`` say.
        n_averages: spectra averaged in power.
    """

    amplitude: NDArray[np.float64]
    floor: NDArray[np.float64]
    resolved: NDArray[np.bool_]
    fundamental: float
    speed_factor: float = 1.0
    at_edge: bool = False
    comb_score: float = 0.0
    score: float = 0.0
    threshold: float = math.inf
    power: NDArray[np.float64] | None = None
    noise: NDArray[np.float64] | None = None
    n_averages: int = 1

    @property
    def detected(self) -> bool:
        """Whether ``score`` exceeds ``threshold``."""
        return self.score > self.threshold

    @property
    def total(self) -> float:
        """Sum of the amplitudes (Eq. 96 for the first five lines of the envelope), in the unit of the spectrum."""
        return float(self.amplitude.sum())

    @property
    def snr(self) -> NDArray[np.float64]:
        """Amplitude of each line over its floor; 0 where unresolved."""
        return np.divide(self.amplitude, self.floor, out=np.zeros_like(self.amplitude), where=self.floor > 0.0)

    @property
    def family_snr(self) -> float:
        """Root sum of squares of the amplitudes over that of the floors; 0 where no line is resolved."""
        noise = float(np.square(self.floor).sum())
        return math.sqrt(float(np.square(self.amplitude).sum()) / noise) if noise > 0.0 else 0.0

    @property
    def depth(self) -> float:
        """Root sum of squares of the lines beside those of the shaft, the power of the noise taken off.

        The highest line counts as at most ``MOST_OF_ONE_LINE`` times the others. In the unit of the spectrum; in a
        spectrum of the envelope over its mean it is a modulation depth.
        """
        power, noise = self._evidence
        return float(comb_depth(power - noise))

    @property
    def depth_error(self) -> float:
        """Standard deviation of ``depth`` due to the noise under the lines, which averaging lowers.

        The noise adds its own scatter and the product of line and noise. Where there is no depth, it is the depth of
        noise that is one standard deviation above its mean.
        """
        power, noise = self._evidence
        lines = np.maximum(power - noise, 0.0)
        variance = float((noise * (noise + 2.0 * lines)).sum()) / (_INDEPENDENT_BINS * self.n_averages)
        depth = self.depth
        scatter = math.sqrt(variance)
        return scatter / (2.0 * depth) if depth * depth > scatter else math.sqrt(scatter)

    @property
    def _evidence(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        if self.power is None or self.noise is None:
            return np.square(self.amplitude), np.square(self.floor)
        return self.power, self.noise

    def scaled(self, factor: float) -> FaultLines:
        """Return the lines of the same spectrum in a unit of which one is ``factor`` of the present unit."""
        power, noise = (None if value is None else value * factor**2 for value in (self.power, self.noise))
        return replace(self, amplitude=self.amplitude * factor, floor=self.floor * factor, power=power, noise=noise)


def comb_depth(lines: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the depth of combs from the power of their lines without noise, shape (line, ...) to (...).

    Negative powers, of lines below the floor, take off what noise added to the others. The highest line counts as at
    most ``MOST_OF_ONE_LINE`` times the root sum of squares of the others.
    """
    highest = lines.max(axis=0)
    others = np.maximum(lines.sum(axis=0) - highest, 0.0)
    return np.sqrt(others + np.minimum(np.maximum(highest, 0.0), MOST_OF_ONE_LINE**2 * others))


def combs_depth(
    spectrum: LineSpectrum, bins: NDArray[np.intp], counted: NDArray[np.bool_] | None = None
) -> NDArray[np.float64]:
    """Return the depth of combs whose lines stand at such bins, of those counted, shape (harmonic, comb) to (comb,).

    As :attr:`FaultLines.depth`; what lies beyond the spectrum adds nothing.
    """
    net = spectrum.power - spectrum.floor
    if spectrum.beside is not None:
        net *= spectrum.beside
    net = np.pad(net, 3)
    near = np.minimum(bins[:, :, None] + (NEAR_BINS + 3), net.size - 1)
    lines = net.take(near).sum(axis=2) / HANN_POWER
    return comb_depth(lines if counted is None else lines * counted)
